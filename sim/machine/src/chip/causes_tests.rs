//! Every cause of the cycle stack has one meaning: for each a step in which it is the only one beside issue.

use super::tests::{LEVELS, config, one_core, own};
use super::*;
use crate::config::MachineConfig;
use crate::streams::{Builder, same};
use lrbsim_isa::uop::{Class, Uop};

/// A machine without queue and barrier, and one core.
fn plain(name: &str) -> MachineConfig {
    let mut config = config(name);
    one_core(&mut config);
    (config.ideal.queue, config.ideal.barrier) = (true, true);
    config
}

/// Two dependent uops for each of `lines`: a load and its consumer.
fn loads(lines: impl IntoIterator<Item = u32>) -> Stream {
    let mut b = Builder::default();
    for line in lines {
        b = b.memory(Class::ScalarLoad, 1, &[line]).alu(Class::ScalarAlu, [1, 0, 0]);
    }
    b.build()
}

fn prefetches(class: Class, lines: impl IntoIterator<Item = u32>) -> Builder {
    lines.into_iter().fold(Builder::default(), |b, line| b.memory(class, 0, &[line]))
}

/// Runs what warms the chip, then `tasks` tasks, whose stack must hold `cause` and issue alone.
fn alone(cause: Cause, config: &MachineConfig, warm: &[Stream], tasks: u32, stream: &Stream) {
    // Behind the last uop that issues, a core waits for the end of its last task and charges that to the queue.
    let mut stream = stream.clone();
    stream.uops.push(Uop::alu(Class::ScalarAlu, 0, 0, 0).0);
    for fidelity in LEVELS {
        let mut chip = Chip::new(&config.validate().expect("sound"), fidelity, 1);
        for stream in warm {
            chip.run_step(&same(1, stream.clone())).expect("moves");
            chip.now += 10_000;
        }
        let report = chip.run_step(&same(tasks, stream.clone())).expect("moves");
        is_alone(cause, &report.cycle_stack, &format!("{fidelity}"));
    }
}

fn is_alone(cause: Cause, stack: &CycleStack, level: &str) {
    println!("{cause:?} {level}: {stack:?}");
    for (other, cycles) in stack.iter() {
        if other == cause {
            assert!(cycles > 0, "{level}: no {cause:?}: {stack:?}");
        } else if other != Cause::Issue {
            assert_eq!(cycles, 0, "{level}: {other:?} beside {cause:?}: {stack:?}");
        }
    }
}

#[test]
fn issue_alone() {
    let stream = Builder::default().repeat(100, |b, _| b.alu(Class::VectorMul, [0; 3])).build();
    alone(Cause::Issue, &plain("larrabee-24"), &[], 4, &stream);
}

#[test]
fn dependency_alone() {
    let stream = Builder::default().repeat(100, |b, _| b.alu(Class::VectorFma, [1, 0, 0])).build();
    alone(Cause::Dependency, &plain("larrabee-24"), &[], 1, &stream);
}

#[test]
fn l1_alone() {
    let stream = loads(100..150);
    alone(Cause::L1, &plain("larrabee-24"), std::slice::from_ref(&stream), 1, &stream);
}

#[test]
fn a_wait_for_a_port_of_the_l1_is_charged_to_the_l1() {
    let mut config = plain("larrabee-24");
    config.core.l1_accesses_per_cycle = 1;
    let b = |b: Builder, i: usize| {
        b.memory(Class::VectorStore, 0, &[100]).memory(Class::VectorLoad, 0, &[101 + i as u32])
    };
    let stream = Builder::default().repeat(20, b).build();
    alone(Cause::L1, &config, std::slice::from_ref(&stream), 1, &stream);
}

#[test]
fn l2_alone() {
    alone(
        Cause::L2,
        &plain("larrabee-24"),
        &[prefetches(Class::PrefetchL2, 100..150).build()],
        1,
        &loads(100..150),
    );
}

#[test]
fn mshr_alone() {
    let mut config = plain("larrabee-24");
    config.l2.mshrs = 1;
    alone(Cause::Mshr, &config, &[], 1, &prefetches(Class::PrefetchL1, 100..150).build());
}

#[test]
fn tlb_alone() {
    // Five pages that meet in one set of four ways, whose lines are in the L1: stores wait for nothing but translation.
    let lines = || (0..50).map(|i| 64 * 1024 + i % 5 * 1024);
    let stores = lines().fold(Builder::default(), |b, line| b.memory(Class::ScalarStore, 0, &[line])).build();
    let mut config = plain("knc-5110p");
    config.core.thread_issue_interval_cycles = 1;
    alone(Cause::Tlb, &config, std::slice::from_ref(&stores), 1, &stores);
}

#[test]
fn remote_alone() {
    for fidelity in LEVELS {
        let mut config = config("larrabee-24");
        (config.ideal.queue, config.ideal.barrier) = (true, true);
        let mut chip = Chip::new(&config.validate().expect("sound"), fidelity, 1);
        chip.now = 100_000;
        for line in 100..104 {
            own(&mut chip, 17, line);
        }
        // The other cores have no task and are at the barrier.
        let mut report = chip.run_step(&same(1, loads(100..104))).expect("moves");
        assert_eq!(report.cycle_stack.barrier, 23 * report.cycles);
        report.cycle_stack.barrier = 0;
        is_alone(Cause::Remote, &report.cycle_stack, &format!("{fidelity}"));
    }
}

#[test]
fn ring_alone() {
    // Lines of 64 slots: whoever comes behind a crowd of prefetches, for which nobody waits, waits for slots.
    for fidelity in LEVELS {
        let mut config = plain("larrabee-24");
        (config.cores, config.ring.bytes_per_cycle) = (8, 1);
        (config.l1d.mshrs, config.l2.mshrs) = (1024, 1024);
        (config.ideal.barrier, config.memory.bandwidth_gb_per_s) = (true, 1000.0);
        let mut chip = Chip::new(&config.validate().expect("sound"), fidelity, 1);
        let make = |task: u32| {
            let own = 4096 + task * 512;
            prefetches(Class::PrefetchL1, own..own + 200)
                .memory(Class::ScalarLoad, 0, &[own + 300])
                .alu(Class::ScalarAlu, [1, 0, 0])
                .build()
        };
        let mut report = chip.run_step(&crate::streams::Tasks { count: 8, make }).expect("moves");
        // Those that are done first wait for the others.
        report.cycle_stack.barrier = 0;
        is_alone(Cause::Ring, &report.cycle_stack, &format!("{fidelity}"));
    }
}

#[test]
fn memory_alone() {
    alone(Cause::Memory, &plain("larrabee-24"), &[], 1, &loads((0..50).map(|i| 4096 + 64 * i)));
}

#[test]
fn atomic_alone() {
    for (class, lines) in [(Class::Atomic, 1), (Class::AtomicGather, 1)] {
        let stream = Builder::default().repeat(50, |b, _| b.memory(class, 0, &[100; 4][..lines])).build();
        alone(Cause::Atomic, &plain("larrabee-24"), std::slice::from_ref(&stream), 1, &stream);
    }
}

#[test]
fn gather_lines_alone() {
    let lines: Vec<u32> = (100..116).collect();
    let gather = Builder::default().repeat(20, |b, _| b.memory(Class::Gather, 0, &lines)).build();
    let warm = prefetches(Class::PrefetchL1, lines.clone()).build();
    alone(Cause::GatherLines, &plain("larrabee-24"), &[warm], 4, &gather);
}

#[test]
fn queue_alone() {
    let mut config = plain("larrabee-24");
    config.ideal.queue = false;
    let one = Builder::default().alu(Class::ScalarAlu, [0; 3]).build();
    alone(Cause::Queue, &config, &[], 40, &one);
}

#[test]
fn barrier_alone() {
    let mut config = plain("larrabee-24");
    config.ideal.barrier = false;
    let one = Builder::default().alu(Class::ScalarAlu, [0; 3]).build();
    alone(Cause::Barrier, &config, &[], 1, &one);
}
