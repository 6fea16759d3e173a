//! Whole steps: the two levels against each other, and what must hold of every run.

use super::*;
use crate::cache::{AccessRules, Intent};
use crate::config::{MachineConfig, shipped};
use crate::ring::Message;
use crate::streams::{Builder, Mix, Random, Tasks, same};
use lrbsim_isa::uop::Class;

pub(super) fn config(name: &str) -> MachineConfig {
    shipped(name)
}

/// Two steps of a mix on a fresh chip: the sum of their reports.
fn run(config: &MachineConfig, fidelity: Fidelity, mix: Mix) -> StepReport {
    let spec = config.validate().expect("sound");
    let mut chip = Chip::new(&spec, fidelity, 1);
    let mut sum = StepReport::default();
    for _ in 0..2 {
        let tasks = Tasks { count: 300, make: |task| mix.stream(task, 2000) };
        sum += chip.run_step(&tasks).expect("moves");
    }
    assert_eq!(sum.cycles, chip.now());
    sum
}

fn percent(a: u64, b: u64) -> f64 {
    (a as f64 / b as f64 - 1.0) * 100.0
}

/// Known gap: in `cycle`, round robin keeps the threads of a core in step, so that all wait for locked operations at one
/// time; `windowed` lets one thread run ahead inside a window, which spreads them. `windowed` is 8 % too fast there.
const ATOMICS_GAP_PERCENT: f64 = 9.0;

/// Known gap: `windowed` times each transaction whole, so that controllers see reads out of the order of time.
const GATHER_GAP_PERCENT: f64 = 3.0;

#[test]
fn windowed_is_within_2_percent_of_cycle() {
    for mix in Mix::ALL {
        let config = config("larrabee-24");
        let windowed = run(&config, Fidelity::Windowed, mix);
        let cycle = run(&config, Fidelity::Cycle, mix);
        let error = percent(windowed.cycles, cycle.cycles);
        println!("{mix:?}: windowed {} cycle {} ({error:+.2} %)", windowed.cycles, cycle.cycles);
        assert_eq!(windowed.class_counts, cycle.class_counts);
        let tolerance = match mix {
            Mix::Atomics => ATOMICS_GAP_PERCENT,
            Mix::RandomGather => GATHER_GAP_PERCENT,
            _ => 2.0,
        };
        assert!(error.abs() <= tolerance, "{mix:?}: {error:+.2} %");
    }
}

#[test]
fn the_same_run_gives_the_same_report() {
    for fidelity in LEVELS {
        assert_eq!(
            run(&config("larrabee-24"), fidelity, Mix::Kernel),
            run(&config("larrabee-24"), fidelity, Mix::Kernel)
        );
    }
}

pub(super) const MACHINES: [&str; 2] = ["larrabee-24", "knc-5110p"];
pub(super) const LEVELS: [Fidelity; 2] = [Fidelity::Windowed, Fidelity::Cycle];

/// Cycles of a step of `tasks` equal tasks on a chip without queue and barrier, at both levels, which must agree.
fn cycles(edit: impl Fn(&mut MachineConfig), warm: &[Stream], tasks: u32, stream: &Stream) -> Cycle {
    let [windowed, cycle] = LEVELS.map(|fidelity| {
        let mut config = config("larrabee-24");
        (config.ideal.queue, config.ideal.barrier) = (true, true);
        edit(&mut config);
        let mut chip = Chip::new(&config.validate().expect("sound"), fidelity, 1);
        for stream in warm {
            chip.run_step(&same(1, stream.clone())).expect("moves");
            // Everything that the warming left in flight arrives.
            chip.now += 10_000;
        }
        chip.run_step(&same(tasks, stream.clone())).expect("moves").cycles
    });
    assert_eq!(windowed, cycle);
    cycle
}

pub(super) fn one_core(config: &mut MachineConfig) {
    config.cores = 1;
    config.memory.controllers = 1;
}

#[test]
fn a_dependent_chain_takes_its_latencies() {
    for (class, latency) in
        [(Class::VectorFma, 4), (Class::Mask, 2), (Class::ScalarMul, 10), (Class::ScalarAlu, 1)]
    {
        let chain = Builder::default().repeat(100, |b, _| b.alu(class, [1, 0, 0])).build();
        assert_eq!(cycles(|_| (), &[], 1, &chain), 99 * latency + 1, "{class:?}");
    }
}

/// Longer than the watch over progress looks away: a stream that touches no memory leaves no trace but its uops.
#[test]
fn a_long_stream_without_memory_is_progress() {
    let chain = Builder::default().repeat(300_000, |b, _| b.alu(Class::ScalarAlu, [1, 0, 0])).build();
    assert_eq!(cycles(one_core, &[], 1, &chain), 300_000);
}

#[test]
fn independent_uops_issue_one_a_cycle_whatever_the_number_of_threads() {
    let stream = Builder::default().repeat(640, |b, _| b.alu(Class::VectorMul, [0; 3])).build();
    for threads in 1..=4 {
        assert_eq!(cycles(one_core, &[], threads, &stream), 640 * Cycle::from(threads));
    }
}

#[test]
fn four_chains_on_four_threads_fill_the_vector_pipe() {
    let chain = Builder::default().repeat(1000, |b, _| b.alu(Class::VectorFma, [1, 0, 0])).build();
    assert_eq!(cycles(one_core, &[], 4, &chain), 4000);
}

#[test]
fn a_thread_that_cannot_issue_back_to_back_has_half_the_rate() {
    let stream = Builder::default().repeat(100, |b, _| b.alu(Class::VectorMul, [0; 3])).build();
    let knc = |config: &mut MachineConfig| config.core.thread_issue_interval_cycles = 2;
    assert_eq!(cycles(knc, &[], 1, &stream), 200);
}

#[test]
fn a_vector_and_a_scalar_uop_pair_and_two_vector_uops_do_not() {
    let pairs = Builder::default()
        .repeat(50, |b, _| b.alu(Class::VectorMul, [0; 3]).alu(Class::ScalarAlu, [0; 3]))
        .build();
    assert_eq!(cycles(|_| (), &[], 1, &pairs), 50);
    assert_eq!(cycles(|config| config.core.dual_issue = false, &[], 1, &pairs), 100);
}

/// A uop that needs the result of a load of `line`: the step's cycles are the load's latency + 1.
fn probe(line: u32) -> Stream {
    Builder::default().memory(Class::ScalarLoad, 0, &[line]).alu(Class::ScalarAlu, [1, 0, 0]).build()
}

#[test]
fn hits_are_answered_exactly_at_their_latency() {
    let l1 = Builder::default().memory(Class::ScalarLoad, 0, &[77]).build();
    let l2 = Builder::default().memory(Class::PrefetchL2, 0, &[77]).build();
    assert_eq!(cycles(|_| (), &[l1], 1, &probe(77)), 3 + 1);
    assert_eq!(cycles(|_| (), &[l2], 1, &probe(77)), 24 + 1);
}

#[test]
fn a_gather_takes_a_cycle_a_line() {
    for lines in 1..=16_u32 {
        let touched: Vec<u32> = (1000..1000 + lines).collect();
        let warm = Builder::default()
            .repeat(lines as usize, |b, i| b.memory(Class::ScalarLoad, 0, &[1000 + i as u32]));
        let gather =
            Builder::default().memory(Class::Gather, 0, &touched).alu(Class::VectorAlu, [1, 0, 0]).build();
        // The last line is asked for at lines - 1 and there 3 later; the consumer takes one.
        assert_eq!(cycles(|_| (), &[warm.build()], 1, &gather), u64::from(lines) - 1 + 3 + 1);
    }
}

/// Has `core` write `line` at time 0, on a chip that has not run, long before the first step.
pub(super) fn own(chip: &mut Chip, core: usize, line: u32) {
    let Chip { cores, tables, uncore, spec, .. } = chip;
    let owner = cores.slot(core).get_or_insert_with(|| Box::new(Core::new(core, spec)));
    let caches = &mut owner.shared.caches;
    let rules = AccessRules::new(spec);
    // It may have to be translated first.
    let again = caches.access(&rules, line, Intent::Write, 0).err();
    if let Some(again) = again {
        caches.access(&rules, line, Intent::Write, again.at).expect("free MSHRs");
    }
    for request in std::mem::take(&mut caches.outbox) {
        uncore.serve(core as u32, &request, 0, &mut AsPeers { cores, tables });
    }
}

#[test]
fn a_miss_takes_the_sum_of_its_parts_and_not_a_cycle_off() {
    for (fidelity, name) in LEVELS.into_iter().flat_map(|level| MACHINES.map(|name| (level, name))) {
        for line in [4096, 5000, 77_777] {
            for from_peer in [false, true] {
                let mut config = config(name);
                (config.ideal.queue, config.ideal.barrier) = (true, true);
                let spec = config.validate().expect("sound");
                let mut chip = Chip::new(&spec, fidelity, 1);
                chip.now = 100_000;
                let home = chip.uncore.home_of(line);
                let ride = |chip: &Chip, from, to, message| chip.uncore.rings.idle_cycles(from, to, message);
                let (supplier, served) = if from_peer {
                    own(&mut chip, 17, line);
                    (17, spec.l1d.hit_cycles + spec.l2.hit_cycles)
                } else {
                    (chip.uncore.controller_stop(line), spec.memory.row_miss_cycles)
                };
                // The first access to the page misses both TLBs, where there are any.
                let translation =
                    spec.tlb.as_ref().map_or(0, |tlb| tlb.first.miss_cycles + tlb.second.miss_cycles);
                let expected = translation
                    + spec.l2.hit_cycles
                    + ride(&chip, 0, home, Message::Address)
                    + spec.directory_lookup
                    + ride(&chip, home, supplier, Message::Address)
                    + served
                    + ride(&chip, supplier, 0, Message::Line);
                let report = chip.run_step(&same(1, probe(line))).expect("moves");
                assert_eq!(
                    report.cycles,
                    expected + spec.core.issue_interval,
                    "line {line} from_peer {from_peer}"
                );
                println!("{name} {fidelity} line {line} from_peer {from_peer}: {expected} cycles");
            }
        }
    }
}

#[test]
fn task_counter_and_barrier_cost_what_they_are_made_of() {
    for fidelity in LEVELS {
        let spec = config("larrabee-24").validate().expect("sound");
        let mut chip = Chip::new(&spec, fidelity, 1);
        let barrier = barrier_cycles(&spec, &chip.uncore.rings);
        let one = Builder::default().alu(Class::ScalarAlu, [0; 3]).build();
        chip.run_step(&same(1, one.clone())).expect("moves");
        // The counter's line is owned by now: two locked adds on it, one for the task, one that finds no more.
        let report = chip.run_step(&same(1, one)).expect("moves");
        assert_eq!(report.cycles, 2 * (5 + 10) + 1 + barrier);
        println!("{fidelity}: barrier {barrier}");
        let nothing = chip.run_step(&same(0, Stream::default())).expect("moves");
        assert_eq!(nothing.cycles, barrier);
    }
}

#[test]
fn ideal_is_a_lower_bound_and_more_never_hurts() {
    let slack = 1.02;
    for mix in [Mix::Streaming, Mix::RandomGather, Mix::Kernel] {
        let base = run(&config("larrabee-24"), Fidelity::Windowed, mix).cycles;
        let with = |edit: &dyn Fn(&mut MachineConfig)| {
            let mut config = config("larrabee-24");
            edit(&mut config);
            run(&config, Fidelity::Windowed, mix).cycles
        };
        assert!(run(&config("ideal"), Fidelity::Windowed, mix).cycles <= base, "{mix:?}: ideal");
        let bandwidth = with(&|config| config.memory.bandwidth_gb_per_s *= 2.0);
        assert!(bandwidth as f64 <= base as f64 * slack, "{mix:?}: bandwidth {bandwidth} {base}");
        let cores = with(&|config| config.cores = 32);
        assert!(cores as f64 <= base as f64 * slack, "{mix:?}: cores {cores} {base}");
    }
}

/// A machine like no other: numbers of `base` changed within reason.
fn random_machine(base: &str, random: &mut Random) -> MachineConfig {
    let mut config = config(base);
    config.cores = 2 + random.below(12);
    config.threads_per_core = 1 + random.below(4);
    config.l1d.mshrs = 4 + random.below(8);
    config.l2.mshrs = 4 + random.below(28);
    config.memory.bandwidth_gb_per_s = f64::from(5 + random.below(100));
    config.directory.interval_cycles = 1 + random.below(20);
    config.core.blocks_on_l1_miss = random.below(2) == 0;
    config.core.thread_issue_interval_cycles = 1 + random.below(2);
    config
}

#[test]
fn on_random_machines_better_parts_never_hurt() {
    // A better part changes who comes first, and with it which lines are thrown out: that much may be lost.
    let slack = 1.05;
    type Better = fn(&mut MachineConfig);
    let better: [(&str, Better); 6] = [
        ("bandwidth", |c| c.memory.bandwidth_gb_per_s *= 2.0),
        ("MSHRs", |c| (c.l1d.mshrs, c.l2.mshrs) = (2 * c.l1d.mshrs, 2 * c.l2.mshrs)),
        ("latency of the memory", |c| (c.memory.latency_ns, c.memory.row_hit_latency_ns) = (30.0, 30.0)),
        ("directory", |c| (c.directory.lookup_cycles, c.directory.interval_cycles) = (5, 1)),
        ("ways of the L2", |c| (c.l2.ways, c.l2.capacity_bytes) = (2 * c.l2.ways, 2 * c.l2.capacity_bytes)),
        ("no memory system", |c| c.ideal.memory = true),
    ];
    let mut random = Random::new(17);
    for round in 0..6 {
        let base = random_machine(MACHINES[round % 2], &mut random);
        let mix = [Mix::Streaming, Mix::RandomGather, Mix::Kernel][round / 2];
        let cycles = |config: &MachineConfig| {
            let mut chip = Chip::new(&config.validate().expect("sound"), Fidelity::Windowed, 1);
            chip.run_step(&Tasks { count: 120, make: |task| mix.stream(task, 1000) }).expect("moves").cycles
        };
        let before = cycles(&base);
        for (what, edit) in better {
            let mut config = base.clone();
            edit(&mut config);
            let after = cycles(&config);
            assert!(
                after as f64 <= before as f64 * slack,
                "round {round}, {mix:?}, better {what}: {before} to {after}"
            );
        }
    }
}

#[test]
fn a_page_that_was_not_translated_costs_its_misses_once() {
    // Two dependent loads of two lines of one page, both in L2: only the first translates.
    let lines = |b: Builder, class| b.memory(class, 0, &[6400]).memory(class, 1, &[6401]);
    let warm = lines(Builder::default(), Class::PrefetchL2).build();
    let probe = lines(Builder::default(), Class::ScalarLoad).alu(Class::ScalarAlu, [1, 0, 0]).build();
    let spec = config("knc-5110p").validate().expect("sound");
    let far = Builder::default()
        .repeat(64, |b, i| b.memory(Class::ScalarLoad, 0, &[640_000 + 64 * i as u32]))
        .build();
    let knc = |c: &mut MachineConfig| {
        let (queue, barrier) = (c.ideal.queue, c.ideal.barrier);
        *c = config("knc-5110p");
        (c.ideal.queue, c.ideal.barrier) = (queue, barrier);
    };
    let miss = spec.tlb.as_ref().expect("knc-5110p translates").first.miss_cycles;
    let issue = spec.core.issue_interval;
    assert_eq!(
        cycles(knc, std::slice::from_ref(&warm), 1, &probe),
        2 * 24 + issue,
        "the page is still there"
    );
    assert_eq!(cycles(knc, &[warm, far], 1, &probe), miss + 2 * 24 + issue, "64 other pages came between");
}

#[test]
fn values_between_lanes_and_scalars_cost_what_spills_cost_and_are_nobody_elses() {
    let carried = |store, load| {
        let task = Builder::default()
            .repeat(100, |b, i| b.on_stack(store, 0, i as u32 % 8).on_stack(load, 1, i as u32 % 8))
            .build();
        LEVELS.map(|fidelity| {
            let mut config = config("larrabee-24");
            // The line of the task counter goes round.
            config.ideal.queue = true;
            let mut chip = Chip::new(&config.validate().expect("sound"), fidelity, 1);
            let report = chip.run_step(&same(96, task.clone())).expect("moves");
            assert_eq!(report.directory.invalidations, 0, "{store:?} {fidelity}");
            report.cycles
        })
    };
    let spills = carried(Class::SpillStore, Class::SpillLoad);
    assert_eq!(carried(Class::VectorStore, Class::ScalarLoad), spills, "vextract");
    assert_eq!(carried(Class::ScalarStore, Class::VectorBroadcastLoad), spills, "vsplat");
}

#[test]
fn a_big_chip_runs_a_small_step_on_few_cores() {
    let mut config = config("larrabee-24");
    config.cores = 1024;
    let mut chip = Chip::new(&config.validate().expect("sound"), Fidelity::Windowed, 1);
    let report =
        chip.run_step(&Tasks { count: 5, make: |task| Mix::Kernel.stream(task, 500) }).expect("moves");
    assert_eq!(chip.activity().iter().filter(|core| core.issued > 0).count(), 5);
    let mut built = 0;
    chip.cores.each(|_| built += 1);
    assert_eq!(built, 5);
    assert_eq!(report.cycle_stack.total(), 1024 * report.cycles);
}
