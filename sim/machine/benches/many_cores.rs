//! What cores that take no part cost the host: steps of 96 tasks on 24 and on 1024 configured cores, time and memory.
//!
//! `cargo bench -p lrbsim-machine --bench many_cores`
//!
//! 96 tasks are one for each hardware thread of 24 cores, or for the first thread of 96 cores of 1024.

#[path = "../src/streams.rs"]
#[expect(dead_code, reason = "shared with the unit tests, which use more of it")]
mod streams;

use lrbsim_isa::stream::Stream;
use lrbsim_machine::{Fidelity, MachineConfig, builtin_machine};
use streams::{Mix, Tasks};

const TASKS: u32 = 96;
const STEPS: u32 = 8;
const PASSES: u32 = 5;

/// Best seconds of some passes, each on a cold machine of `cores` cores.
#[expect(clippy::disallowed_methods, reason = "a benchmark measures the host")]
fn seconds(cores: u32, streams: &[Stream]) -> f64 {
    let text = builtin_machine("larrabee-24").expect("shipped");
    let mut config: MachineConfig = serde_json::from_str(text).expect("shipped machines parse");
    config.cores = cores;
    let spec = config.validate().expect("any number of cores is sound");
    let pass = |_| {
        let start = std::time::Instant::now();
        let mut timing = Fidelity::Windowed.timing(&spec, 1);
        for _ in 0..STEPS {
            let tasks = Tasks { count: TASKS, make: |task| streams[task as usize].clone() };
            timing.run_step(&tasks).expect("moves");
        }
        start.elapsed().as_secs_f64()
    };
    (0..PASSES).map(pass).fold(f64::INFINITY, f64::min)
}

/// The most memory that this process has had so far, in KiB; `None` where the system does not say.
fn peak_kib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse().ok()
}

fn main() {
    println!("{TASKS} tasks a step, larrabee-24, windowed, one host thread, best of {PASSES}");
    println!(
        "{:<14} {:>9} {:>9} {:>7} {:>9} {:>9} {:>7}",
        "mix", "24 s", "1024 s", "times", "24 MB", "1024 MB", "times"
    );
    for mix in Mix::ALL {
        let streams: Vec<Stream> = (0..TASKS).map(|task| mix.stream(task, 40_000)).collect();
        // The smaller machine first: a peak never falls. It is that of all mixes so far.
        let [few, many] =
            [24, 1024].map(|cores| (seconds(cores, &streams), peak_kib().unwrap_or(f64::NAN) / 1024.0));
        println!(
            "{:<14} {:>9.3} {:>9.3} {:>7.2} {:>9.1} {:>9.1} {:>7.2}",
            format!("{mix:?}"),
            few.0,
            many.0,
            many.0 / few.0,
            few.1,
            many.1,
            many.1 / few.1
        );
        if mix == Mix::ALL[0] {
            println!("(memory of later mixes holds that of earlier ones)");
        }
    }
}
