use super::*;
use crate::chip::Chip;
use crate::fidelity::Fidelity;
use crate::streams::{Mix, Tasks};

fn spec(change: impl Fn(&mut MachineConfig)) -> MachineSpec {
    let text = builtin_machine("larrabee-24").expect("shipped");
    let mut config: MachineConfig = serde_json::from_str(text).expect("parses");
    change(&mut config);
    config.validate().expect("sound")
}

fn tasks(mix: Mix, count: u32) -> Tasks<impl Fn(u32) -> Stream + Sync> {
    Tasks { count, make: move |task: u32| mix.stream(task, 200 + (task * 37 % 101 * 8) as usize) }
}

#[test]
fn what_is_counted_is_counted_and_everything_adds_up() {
    let spec = spec(|config| config.cores = 4);
    for mix in Mix::ALL {
        for count in [0, 1, 3, 50, 2000] {
            let tasks = tasks(mix, count);
            let exact = Chip::new(&spec, Fidelity::Windowed, 1).run_step(&tasks).expect("moves");
            let mut level = Roofline::new(&spec, 2);
            let report = level.run_step(&tasks).expect("moves");
            println!("{mix:?} {count}: {} for {}, {:?}", report.cycles, exact.cycles, report.bounds);
            assert_eq!((report.steps, report.tasks, report.issued), (1, exact.tasks, exact.issued));
            assert_eq!(report.class_counts, exact.class_counts);
            assert_eq!(report.cycle_stack.total(), u64::from(spec.cores) * report.cycles);
            assert_eq!(report.issued, report.cycle_stack.issue + report.paired);
            let busy: u64 = level.activity().iter().map(|core| core.busy_cycles).sum();
            assert_eq!(busy, report.cycle_stack.issue);
            assert!(report.bounds.named().iter().all(|(_, cycles)| *cycles <= report.cycles.max(1)));
            assert_eq!(report, Roofline::new(&spec, 1).run_step(&tasks).expect("moves"));
        }
    }
}

/// Steps of one kind each, which one limit holds.
#[test]
fn the_limit_that_holds_is_named() {
    for (mix, limits) in [
        (Mix::AluHeavy, &["issue", "chains"][..]),
        (Mix::Streaming, &["memory"]),
        (Mix::RandomGather, &["memory", "chains", "l2"]),
        (Mix::Atomics, &["atomics", "chains"]),
    ] {
        let report = Roofline::new(&spec(|_| ()), 1).run_step(&tasks(mix, 8000)).expect("moves");
        let name = report.bounds.greatest().expect("a limit");
        assert!(limits.contains(&name), "{mix:?}: {name}, {:?}", report.bounds);
    }
}
