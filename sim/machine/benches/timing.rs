//! Millions of simulated uops a host second of the timing models, on synthetic streams.
//!
//! `cargo bench -p lrbsim-machine [-- MIX…]`

#[path = "../src/streams.rs"]
#[expect(dead_code, reason = "shared with the unit tests, which use more of it")]
mod streams;

use lrbsim_isa::stream::Stream;
use lrbsim_machine::{Fidelity, MachineConfig, StepReport, builtin_machine};
use streams::{Mix, Tasks};

const TASKS: u32 = 1500;
const STEPS: u32 = 3;

#[expect(clippy::disallowed_methods, reason = "a benchmark measures the host")]
fn main() {
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with('-')).collect();
    let text = builtin_machine("larrabee-24").expect("shipped");
    let config: MachineConfig = serde_json::from_str(text).expect("shipped machines parse");
    let spec = config.validate().expect("shipped machines are sound");
    println!(
        "{:<14} {:>9} {:>9} {:>12} {:>8} {:>8}",
        "mix", "level", "M uops/s", "cycles", "acc/uop", "L1 miss"
    );
    for mix in Mix::ALL {
        if !wanted.is_empty() && !wanted.iter().any(|name| format!("{mix:?}") == *name) {
            continue;
        }
        let streams: Vec<Stream> = (0..TASKS).map(|task| mix.stream(task, 4000)).collect();
        for fidelity in Fidelity::ALL {
            let mut timing = fidelity.timing(&spec, 1);
            let mut sum = StepReport::default();
            let start = std::time::Instant::now();
            for _ in 0..STEPS {
                let tasks = Tasks { count: TASKS, make: |task| streams[task as usize].clone() };
                sum += timing.run_step(&tasks).expect("moves");
            }
            let seconds = start.elapsed().as_secs_f64();
            println!(
                "{:<14} {:>10} {:>8.1} {:>12} {:>8.2} {:>7.1}%",
                format!("{mix:?}"),
                fidelity.to_string(),
                sum.issued as f64 / seconds / 1e6,
                sum.cycles,
                sum.l1d.accesses as f64 / sum.issued as f64,
                100.0 * sum.l1d.misses as f64 / (sum.l1d.accesses as f64).max(1.0),
            );
        }
    }
}
