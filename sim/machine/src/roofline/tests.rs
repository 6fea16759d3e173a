use super::*;
use crate::chip::Chip;
use crate::config::MachineConfig;
use crate::fidelity::Fidelity;
use crate::streams::{Builder, Mix, Tasks, same};

fn spec(change: impl Fn(&mut MachineConfig)) -> MachineSpec {
    let mut config = shipped("larrabee-24");
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

fn cycles(spec: &MachineSpec, tasks: &dyn TaskSource) -> u64 {
    Roofline::new(spec, 1).run_step(tasks).expect("moves").cycles
}

/// Tasks that each have the same stream, of `uops` uops that each wait for the one before.
fn chains(class: Class, uops: usize, count: u32) -> Tasks<impl Fn(u32) -> Stream + Sync> {
    same(count, Builder::default().repeat(uops, |b, _| b.alu(class, [1, 0, 0])).build())
}

#[test]
fn a_chain_takes_its_latencies() {
    let spec = spec(|config| config.cores = 1);
    for (class, latency) in [(Class::ScalarAlu, 1), (Class::VectorFma, 4), (Class::ScalarMul, 10)] {
        let exact =
            Chip::new(&spec, Fidelity::Windowed, 1).run_step(&chains(class, 10_000, 1)).expect("moves");
        let found = cycles(&spec, &chains(class, 10_000, 1));
        assert!(exact.cycles.abs_diff(latency * 10_000) < 500, "{class:?}: {}", exact.cycles);
        // Limits that are close add up in part: a chain of one cycle each is the issue limit too.
        let most = if latency == 1 { 1.3 } else { 1.05 };
        assert!(
            found >= 10_000 * latency && (found as f64) < 10_000.0 * latency as f64 * most,
            "{class:?}: {found}"
        );
    }
}

#[test]
fn private_work_costs_the_same_on_any_number_of_cores() {
    let of = |cores: u32| {
        let spec = spec(|config| {
            config.cores = cores;
            config.ideal.queue = true;
            config.ideal.barrier = true;
        });
        cycles(&spec, &chains(Class::VectorFma, 3000, 8 * cores))
    };
    assert!([2, 7, 24, 64].into_iter().all(|cores| of(cores) == of(1)), "{:?}", [1, 2, 7, 24, 64].map(of));
}

#[test]
fn better_parts_never_hurt() {
    type Change = fn(&mut MachineConfig);
    let better: [(&str, Change); 10] = [
        ("memory", |config| config.memory.bandwidth_gb_per_s *= 2.0),
        ("latency", |config| config.memory.latency_ns *= 0.75),
        ("l2", |config| config.l2.capacity_bytes *= 2),
        ("l2 hit", |config| config.l2.hit_cycles /= 2),
        ("l1", |config| config.l1d.capacity_bytes *= 2),
        ("mshrs", |config| config.l1d.mshrs *= 2),
        ("ring", |config| config.ring.address_rings *= 2),
        ("no memory", |config| config.ideal.memory = true),
        ("no queue", |config| config.ideal.queue = true),
        ("no barrier", |config| config.ideal.barrier = true),
    ];
    for mix in Mix::ALL {
        for count in [1, 97, 2000] {
            let tasks = tasks(mix, count);
            let base = cycles(&spec(|_| ()), &tasks);
            for (what, change) in better {
                let found = cycles(&spec(change), &tasks);
                assert!(found <= base, "{mix:?}, {count} tasks, {what}: {found} for {base}");
            }
        }
    }
}

/// Every task runs once, in order where order matters, whatever is read of the step.
#[test]
fn every_task_runs_once() {
    struct Once {
        ordered: bool,
        ran: std::sync::Mutex<Vec<u32>>,
    }
    impl TaskSource for Once {
        fn name(&self) -> &str {
            "once"
        }
        fn tasks(&self) -> u32 {
            1000
        }
        fn is_ordered(&self) -> bool {
            self.ordered
        }
        fn record(&self, task: u32, stream: &mut Stream) {
            self.ran.lock().expect("free").push(task);
            *stream = Mix::AluHeavy.stream(task, 60);
        }
        fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
            for task in tasks {
                self.ran.lock().expect("free").push(task);
                counts.class_counts[0] += 60;
            }
        }
    }
    for ordered in [false, true] {
        let source = Once { ordered, ran: std::sync::Mutex::default() };
        let report = Roofline::new(&spec(|_| ()), 3).run_step(&source).expect("moves");
        assert_eq!(report.tasks, 1000);
        let mut ran = source.ran.into_inner().expect("free");
        if !ordered {
            ran.sort_unstable();
        }
        assert!(ran.iter().copied().eq(0..1000), "ordered: {ordered}");
    }
}
