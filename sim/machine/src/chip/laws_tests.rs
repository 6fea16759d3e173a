//! Laws of whole chips, over random machines and random programs, and the seeded defects that they catch.

use super::tests::{LEVELS, config, one_core};
use super::*;
use crate::cache::Ports;
use crate::coherence::{Fault, explore};
use crate::config::MachineConfig;
use crate::laws;
use crate::occupancy::Slots;
use crate::streams::{Builder, Mix, Random, Tasks, same};
use lrbsim_isa::uop::Class;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// A machine like no other.
fn random_machine(random: &mut Random) -> MachineConfig {
    let mut config = config(["larrabee-24", "knc-5110p"][random.below(2) as usize]);
    config.cores = 1 + random.below(12);
    config.threads_per_core = 1 + random.below(4);
    config.ring.cores_per_ring = 2 + random.below(15);
    config.ring.bytes_per_cycle = [8, 32, 64][random.below(3) as usize];
    config.memory.controllers = 1 + random.below(config.cores.min(4));
    config.memory.bandwidth_gb_per_s = [0.5, 5.0, 48.0, 500.0][random.below(4) as usize];
    config.memory.banks = [1, 4, 16][random.below(3) as usize];
    config.memory.write_buffer_lines = 1 + random.below(16);
    (config.l1d.mshrs, config.l2.mshrs) = (1 + random.below(8), 1 + random.below(32));
    config.l1d.capacity_bytes = 64 * u64::from(config.l1d.ways << random.below(5));
    config.l2.capacity_bytes =
        config.l1d.capacity_bytes.max(64 * u64::from(config.l2.ways << random.below(7)));
    config.directory.interval_cycles = 1 + random.below(20);
    config.directory.lookup_cycles = 1 + random.below(60);
    config.core.l1_accesses_per_cycle = 1 + random.below(2);
    config.core.gather_lines_per_cycle = [0.25, 1.0, 2.0][random.below(3) as usize];
    config.core.blocks_on_l1_miss = random.below(2) == 0;
    config.core.posted_streaming_stores = random.below(2) == 0;
    config.core.thread_issue_interval_cycles = 1 + random.below(2);
    config.memory.acknowledges_writes = random.below(2) == 0;
    config.scheduler.chunk_tasks_max = 1 + random.below(4);
    config
}

/// A stream of all classes, on a few lines that all tasks share and on `own` lines from `base` on.
fn random_stream(
    random: &mut Random,
    uops: usize,
    (base, own): (u32, u32),
    shared: bool,
    stack: bool,
) -> Stream {
    let line = |random: &mut Random| {
        if shared && random.below(3) == 0 { 600 + random.below(20) } else { base + random.below(own) }
    };
    Builder::default()
        .repeat(uops, |b, _| {
            let producer = random.below(4) as u8;
            let class = Class::ALL[random.below(Class::COUNT as u32) as usize];
            match class {
                Class::SpillStore | Class::SpillLoad if !stack => b.alu(Class::VectorAlu, [producer, 0, 0]),
                Class::SpillStore | Class::SpillLoad => b.on_stack(class, producer, random.below(8)),
                Class::Gather
                | Class::Scatter
                | Class::AtomicGather
                | Class::AtomicScatter
                | Class::GatherPrefetch => {
                    let mut lines: Vec<u32> = (0..1 + random.below(8)).map(|_| line(random)).collect();
                    lines.sort_unstable();
                    lines.dedup();
                    b.memory(class, producer, &lines)
                }
                _ if class.is_memory() => b.memory(class, producer, &[line(random)]),
                _ => b.alu(class, [producer, 0, 0]),
            }
        })
        .build()
}

/// Tasks of random streams, some lines of which they share.
fn random_tasks(seed: u64, count: u32) -> Tasks<impl Fn(u32) -> Stream> {
    let make = move |task: u32| {
        let mut random = Random::new(seed * 1000 + u64::from(task));
        random_stream(&mut random, 200, (10_000 + task % 7 * 100, 300), true, true)
    };
    Tasks { count, make }
}

/// Lets all that is under way after a step arrive; then nothing may be open. Returns what was counted of it.
fn come_to_rest(chip: &mut Chip) -> StepReport {
    chip.cores.set_active(0);
    while chip.uncore.next_due() < Cycle::MAX {
        let (now, Chip { cores, tables, uncore, .. }) = (chip.uncore.next_due(), &mut *chip);
        uncore.run_until(now, &mut AsPeers { cores, tables });
    }
    chip.cores.each(|core| {
        assert!(core.inbox.is_empty(), "core {}", core.index);
        let caches = &core.shared.caches;
        assert_eq!(caches.l1_mshrs.unanswered() + caches.l2_mshrs.unanswered(), 0, "core {}", core.index);
    });
    let mut left = StepReport::default();
    chip.collect(&mut left);
    left
}

#[test]
fn every_request_is_served_and_answered_once_on_random_machines() {
    let mut random = Random::new(23);
    for round in 0..20 {
        let config = random_machine(&mut random);
        let spec = config.validate().expect("sound");
        for fidelity in LEVELS {
            let mut chip = Chip::new(&spec, fidelity, 1);
            let mut sum = StepReport::default();
            for step in 0..3 {
                sum += chip.run_step(&random_tasks(round * 10 + step, 30)).expect("moves");
            }
            sum += come_to_rest(&mut chip);
            // Each miss of an L2 is a transaction, which gets its line from one place at most.
            assert_eq!(sum.directory.transactions, sum.l2.misses, "{fidelity} {config:?}");
            assert!(sum.memory.reads + sum.directory.forwards <= sum.l2.misses, "{fidelity} {config:?}");
        }
    }
}

#[test]
fn any_number_of_host_threads_gives_the_same_reports() {
    let mut random = Random::new(31);
    for round in 0..4_u64 {
        let mut machine = random_machine(&mut random);
        machine.cores = 8 + random.below(8);
        machine.memory.controllers = 2;
        let spec = machine.validate().expect("sound");
        for fidelity in LEVELS {
            let reports = [1, 2, 4, 8].map(|threads| {
                let mut chip = Chip::new(&spec, fidelity, threads);
                let mut reports: Vec<StepReport> = (0..2)
                    .map(|step| chip.run_step(&random_tasks(round * 10 + step, 40)).expect("moves"))
                    .collect();
                let mix = Mix::ALL[round as usize % Mix::ALL.len()];
                let tasks = Tasks { count: 40, make: |task| mix.stream(task, 200) };
                reports.push(chip.run_step(&tasks).expect("moves"));
                reports
            });
            assert!(reports.iter().all(|one| *one == reports[0]), "{fidelity}, round {round}");
        }
    }
}

#[test]
fn private_work_costs_on_many_cores_what_it_costs_on_one_and_invalidates_nothing() {
    for (name, fidelity, threads) in ["larrabee-24", "knc-5110p"]
        .into_iter()
        .flat_map(|name| LEVELS.map(|level| (name, level)))
        .flat_map(|(name, level)| [1, 4].map(|threads| (name, level, threads)))
    {
        // Stacks of different threads lie in different sets of the L1: either they fit beside the rest, or there are none.
        let cost = |cores: u32, lines: u32, stack: bool| {
            let mut machine = config(name);
            machine.cores = cores;
            machine.memory.controllers = machine.memory.controllers.min(cores);
            (machine.ideal.queue, machine.ideal.barrier) = (true, true);
            let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
            // A task a thread, and thread k runs on core k mod cores: a step of equal tasks on far lines.
            let make = |task: u32| {
                let (core, thread) = (task % cores, task / cores);
                random_stream(
                    &mut Random::new(thread.into()),
                    800,
                    ((1 << 20) + core * (1 << 16), lines),
                    false,
                    stack,
                )
            };
            let tasks = Tasks { count: cores * threads, make };
            // The lines stay, and so do the pages; what the first step left on its way arrives.
            for _ in 0..3 {
                chip.run_step(&tasks).expect("moves");
                chip.now += 100_000;
            }
            let report = chip.run_step(&tasks).expect("moves");
            assert_eq!(report.directory.invalidations + report.l2.invalidations, 0);
            assert_eq!(report.l2.misses, 0, "warm");
            report.cycles
        };
        for (lines, stack) in [(400, false), (100, true)] {
            let one = cost(1, lines, stack);
            for cores in [2, 7, 24] {
                let cycles = cost(cores, lines, stack);
                assert_eq!(
                    cycles, one,
                    "{name} {fidelity}: {cores} cores of {threads} threads, {lines} lines"
                );
            }
        }
    }
}

/// Machines that are narrow in one place each.
fn narrow() -> Vec<(&'static str, MachineConfig)> {
    let narrow = |what, edit: &dyn Fn(&mut MachineConfig)| {
        let mut config = config("larrabee-24");
        config.cores = 6;
        edit(&mut config);
        (what, config)
    };
    vec![
        narrow("memory", &|c| c.memory.bandwidth_gb_per_s = 0.5),
        narrow("one bank", &|c| c.memory.banks = 1),
        narrow("one entry in the write buffer", &|c| c.memory.write_buffer_lines = 1),
        narrow("one MSHR", &|c| (c.l1d.mshrs, c.l2.mshrs) = (1, 1)),
        narrow("ring", &|c| c.ring.bytes_per_cycle = 1),
        narrow("directory", &|c| c.directory.interval_cycles = 200),
        narrow("one port", &|c| c.core.l1_accesses_per_cycle = 1),
        narrow("gather", &|c| c.core.gather_lines_per_cycle = 0.1),
        narrow("one way", &|c| {
            (c.l1d.ways, c.l1d.capacity_bytes) = (1, 256);
            (c.l2.ways, c.l2.capacity_bytes) = (1, 512);
        }),
    ]
}

/// A task that streams `lines` lines out.
fn streaming_stores(task: u32, lines: usize) -> Stream {
    let base = 100_000 + task * 8192;
    Builder::default().repeat(lines, |b, i| b.memory(Class::VectorStreamStore, 0, &[base + i as u32])).build()
}

#[test]
fn no_resource_beats_its_peak_in_any_step_on_narrow_machines() {
    for ((what, config), posted) in
        narrow().into_iter().flat_map(|narrow| [false, true].map(|p| (narrow.clone(), p)))
    {
        let mut config = config;
        config.core.posted_streaming_stores = posted;
        let spec = config.validate().expect("sound");
        for fidelity in LEVELS {
            let mut chip = Chip::new(&spec, fidelity, 1);
            let (mut bytes, mut cycles) = (0, 0);
            let mut add = |report: StepReport| {
                bytes += report.memory.bytes;
                cycles += report.cycles;
            };
            // `laws::check` looks at every step.
            for step in 0..2 {
                add(chip
                    .run_step(&Tasks { count: 24, make: |task| streaming_stores(task, 150) })
                    .expect("moves"));
                add(chip.run_step(&random_tasks(step, 30)).expect("moves"));
            }
            // What is served in all does not beat it either, but for what is still to be moved.
            let peak = config.memory.bandwidth_gb_per_s / config.clock_ghz;
            let left = 64 * chip.uncore.memory.line_times_from(chip.now);
            let moved = bytes - left.min(bytes);
            assert!(
                moved as f64 <= peak * cycles as f64 + 64.0 * 8.0,
                "{what} {fidelity}: {moved} in {cycles}"
            );
        }
    }
}

#[test]
fn streaming_stores_run_at_memory_bandwidth_and_not_above() {
    for posted in [false, true] {
        let mut machine = config("larrabee-24");
        machine.core.posted_streaming_stores = posted;
        let mut chip = Chip::new(&machine.validate().expect("sound"), Fidelity::Windowed, 1);
        // The first step fills the L2s: from then on a line goes out for each that is stored.
        chip.run_step(&Tasks { count: 96, make: |task| streaming_stores(task, 1500) }).expect("moves");
        let report = chip
            .run_step(&Tasks { count: 96, make: |task| streaming_stores(task + 96, 3000) })
            .expect("moves");
        let share = report.memory.bytes as f64 / report.cycles as f64 / 48.0;
        println!("posted {posted}: {share:.3} of the peak");
        assert!((0.85..=1.001).contains(&share), "posted {posted}: {share} of the peak");
    }
}

/// Cycles of a step of equal tasks on one warm core of four threads, and its report.
fn on_one_core(
    edit: impl Fn(&mut MachineConfig),
    fidelity: Fidelity,
    stream: &Stream,
    spoil: impl Fn(&mut Chip),
) -> StepReport {
    let mut machine = config("larrabee-24");
    one_core(&mut machine);
    (machine.ideal.queue, machine.ideal.barrier) = (true, true);
    edit(&mut machine);
    let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
    chip.run_step(&same(4, stream.clone())).expect("moves");
    chip.now += 10_000;
    spoil(&mut chip);
    chip.run_step(&same(4, stream.clone())).expect("moves")
}

fn gathers() -> Stream {
    let lines: Vec<u32> = (1000..1016).collect();
    Builder::default().repeat(100, |b, _| b.memory(Class::Gather, 0, &lines)).build()
}

fn stores_and_loads() -> Stream {
    let pair = |b: Builder, _| b.memory(Class::VectorStore, 0, &[1000]).memory(Class::VectorLoad, 0, &[1001]);
    Builder::default().repeat(400, pair).build()
}

/// Whether four threads of a core gather at the rate of one.
fn gathers_take_turns(spoil: impl Fn(&mut Chip)) -> laws::Verdict {
    for (fidelity, rate) in
        LEVELS.into_iter().flat_map(|level| [0.25, 0.5, 1.0, 2.0].map(|rate| (level, rate)))
    {
        let report = on_one_core(|c| c.core.gather_lines_per_cycle = rate, fidelity, &gathers(), &spoil);
        let expected = 4.0 * 1600.0 / rate;
        let cycles = report.cycles as f64;
        if cycles < expected - 16.0 || cycles > expected * 1.05 + 20.0 {
            return Err(format!("{fidelity}: 6400 lines at {rate} a cycle in {cycles} cycles"));
        }
    }
    Ok(())
}

#[test]
fn four_threads_of_a_core_gather_at_the_rate_of_the_core() {
    gathers_take_turns(|_| ()).expect("kept");
}

/// Whether four threads of a core share its ports.
fn ports_are_shared(spoil: impl Fn(&mut Chip)) -> laws::Verdict {
    for (fidelity, ports) in LEVELS.into_iter().flat_map(|level| [1, 2].map(|ports| (level, ports))) {
        let report =
            on_one_core(|c| c.core.l1_accesses_per_cycle = ports, fidelity, &stores_and_loads(), &spoil);
        // A store and a load pair.
        let expected = u64::from(4 * 800 / ports);
        if !(expected..=expected + expected / 20).contains(&report.cycles) {
            return Err(format!("{fidelity}: 3200 accesses of {ports} ports in {} cycles", report.cycles));
        }
    }
    Ok(())
}

#[test]
fn four_threads_of_a_core_share_the_ports_of_its_l1() {
    ports_are_shared(|_| ()).expect("kept");
}

/// Whether vector atomics on one line exclude one another, in a core and between cores, and are counted.
fn atomics_exclude(spoil: impl Fn(&mut Chip)) -> laws::Verdict {
    for (fidelity, cores, class) in LEVELS
        .into_iter()
        .flat_map(|level| [1, 4].map(|cores| (level, cores)))
        .flat_map(|(level, cores)| [Class::AtomicGather, Class::Atomic].map(|class| (level, cores, class)))
    {
        let task = Builder::default().repeat(50, |b, _| b.memory(class, 0, &[777])).build();
        let edit = |c: &mut MachineConfig| (c.cores, c.atomic.latency_cycles) = (cores, 7);
        let mut machine = config("larrabee-24");
        one_core(&mut machine);
        (machine.ideal.queue, machine.ideal.barrier) = (true, true);
        edit(&mut machine);
        let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
        chip.run_step(&same(4 * cores, task.clone())).expect("moves");
        chip.now += 10_000;
        spoil(&mut chip);
        let report = chip.run_step(&same(4 * cores, task)).expect("moves");
        let operations = u64::from(4 * cores) * 50;
        if report.atomics.operations != operations {
            return Err(format!("{} operations instead of {operations}", report.atomics.operations));
        }
        if report.cycles < 7 * operations {
            return Err(format!(
                "{fidelity}, {cores} cores: {operations} operations in {} cycles",
                report.cycles
            ));
        }
    }
    Ok(())
}

#[test]
fn locked_operations_on_one_line_exclude_one_another_and_are_counted() {
    atomics_exclude(|_| ()).expect("kept");
}

/// Whether a step of private transfers costs what spills cost and invalidates nothing.
fn stacks_are_private(spoil: impl Fn(&mut Chip)) -> laws::Verdict {
    let cost = |fidelity, store, load| {
        let task = Builder::default()
            .repeat(100, |b, i| b.on_stack(store, 0, i as u32 % 8).on_stack(load, 1, i as u32 % 8))
            .build();
        let mut machine = config("larrabee-24");
        machine.ideal.queue = true;
        let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
        chip.run_step(&same(96, Builder::default().alu(Class::ScalarAlu, [0; 3]).build())).expect("moves");
        spoil(&mut chip);
        let report = chip.run_step(&same(96, task)).expect("moves");
        (report.cycles, report.directory.invalidations)
    };
    for fidelity in LEVELS {
        let spills = cost(fidelity, Class::SpillStore, Class::SpillLoad);
        let extracts = cost(fidelity, Class::VectorStore, Class::ScalarLoad);
        let splats = cost(fidelity, Class::ScalarStore, Class::VectorBroadcastLoad);
        if spills.1 + extracts.1 + splats.1 > 0 || extracts != spills || splats != spills {
            return Err(format!("{fidelity}: cycles and invalidations {spills:?}, {extracts:?}, {splats:?}"));
        }
    }
    Ok(())
}

#[test]
fn values_between_lanes_and_scalars_cost_what_spills_cost() {
    stacks_are_private(|_| ()).expect("kept");
}

#[test]
fn a_machine_of_a_thousandth_of_a_gb_per_s_runs_to_its_end() {
    for fidelity in LEVELS {
        let mut machine = config("larrabee-24");
        machine.memory.bandwidth_gb_per_s = 0.001;
        let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
        let make = |task: u32| {
            Builder::default()
                .repeat(8, |b, i| b.memory(Class::ScalarLoad, 0, &[5000 + task * 8 + i as u32]))
                .build()
        };
        let report = chip.run_step(&Tasks { count: 24, make }).expect("moves, if slowly");
        // 192 lines and that of the task counter.
        assert!(report.cycles > 190 * 64_000, "{}", report.cycles);
        come_to_rest(&mut chip);
    }
}

/// What a chip that is spoiled says of a step, after one that readies all its cores.
fn spoiled(fault: Fault, fidelity: Fidelity) -> Result<StepReport, Stuck> {
    let mut machine = config("larrabee-24");
    machine.cores = 4;
    let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
    chip.run_step(&same(16, Builder::default().alu(Class::ScalarAlu, [0; 3]).build())).expect("moves");
    seed(&mut chip, fault);
    chip.run_step(&random_tasks(5, 40))
}

fn seed(chip: &mut Chip, fault: Fault) {
    chip.uncore.fault = Some(fault);
    chip.cores.each(|core| core.shared.caches.fault = Some(fault));
}

#[test]
fn a_chip_that_cannot_move_says_who_waits_for_whom() {
    for (fault, fidelity) in [Fault::DropAnswer, Fault::RefuseAlways]
        .into_iter()
        .flat_map(|fault| LEVELS.map(|level| (fault, level)))
    {
        let stuck = spoiled(fault, fidelity).expect_err("nothing moves");
        let message = stuck.to_string();
        println!("{fault:?} {fidelity}: {message}");
        assert!(message.contains("Chip.Core[0].Thread["), "{message}");
        assert!(message.len() < 1500, "{} bytes: {message}", message.len());
        if fault == Fault::DropAnswer {
            assert!(message.contains("lines: "), "{message}");
        }
    }
}

/// Whether a hit below a refused write waits for its line.
fn refused_writes_change_nothing(fault: Option<Fault>) -> laws::Verdict {
    use crate::cache::{AccessRules, CoreCaches, Intent};
    let mut random = Random::new(4);
    for _ in 0..200 {
        let mut machine = random_machine(&mut random);
        machine.prefetcher.streams = 0;
        machine.tlb.enabled = random.below(2) == 0;
        (machine.l1d.mshrs, machine.l2.mshrs) = (1 + random.below(4), 1 + random.below(4));
        let spec = machine.validate().expect("sound");
        let (mut caches, rules) = (CoreCaches::new(&spec), AccessRules::new(&spec));
        caches.fault = fault;
        let mut refused = 0;
        for now in 0..200 {
            let (line, kind) = (random.below(12) * 65, random.below(4));
            let ask = |caches: &mut CoreCaches| match kind {
                0 => caches.prefetch_l2(&rules, line, now).err(),
                1 => caches.access(&rules, line, Intent::Read, now).err(),
                2 => caches.access(&rules, line, Intent::Write, now).err(),
                _ => caches.access(&rules, line, Intent::Stream, now).err(),
            };
            let mut before = caches.clone();
            let result = ask(&mut caches);
            if machine.tlb.enabled && result.is_some() {
                // The TLB knows that its page was asked for, and a translation has begun: once.
                before = caches.clone();
                if ask(&mut caches).is_none() {
                    continue;
                }
            }
            if result.is_some() {
                refused += 1;
                if caches != before {
                    return Err(format!(
                        "cycle {now}: line {line}, kind {kind} is refused and changes the caches"
                    ));
                }
            }
        }
        if refused == 0 {
            return Err("nothing was refused".to_owned());
        }
    }
    Ok(())
}

#[test]
fn a_refused_access_leaves_the_caches_as_they_were() {
    refused_writes_change_nothing(None).expect("kept");
}

/// Whether the time of translations is charged to them.
fn translations_are_charged(fault: Option<Fault>) -> laws::Verdict {
    for fidelity in LEVELS {
        let mut machine = config("knc-5110p");
        one_core(&mut machine);
        let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
        chip.run_step(&same(1, Builder::default().alu(Class::ScalarAlu, [0; 3]).build())).expect("moves");
        if let Some(fault) = fault {
            seed(&mut chip, fault);
        }
        let stores = (0..50)
            .fold(Builder::default(), |b, i| b.memory(Class::ScalarStore, 0, &[65_536 + i % 5 * 1024]));
        for _ in 0..2 {
            chip.run_step(&same(1, stores.clone().build())).expect("moves");
        }
        let stack = chip.run_step(&same(1, stores.build())).expect("moves").cycle_stack;
        if stack.tlb == 0 || stack.l1 > 0 {
            return Err(format!("{fidelity}: {stack:?}"));
        }
    }
    Ok(())
}

#[test]
fn threads_that_throw_one_another_out_of_the_tlb_get_on() {
    for fidelity in LEVELS {
        let mut machine = config("knc-5110p");
        one_core(&mut machine);
        (machine.tlb.small.entries, machine.tlb.small.ways) = (1, 1);
        let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
        let make = |task: u32| {
            Builder::default()
                .repeat(10, |b, _| b.memory(Class::ScalarLoad, 0, &[65_536 + task * 64]))
                .build()
        };
        let report = chip.run_step(&Tasks { count: 4, make }).expect("moves");
        println!("{fidelity}: {} cycles, {:?}", report.cycles, report.cycle_stack);
    }
}

#[test]
fn a_translation_that_costs_nothing_finds_the_line_where_it_is() {
    for fidelity in LEVELS {
        let mut machine = config("knc-5110p");
        one_core(&mut machine);
        (machine.tlb.small.miss_cycles, machine.tlb.second.miss_cycles) = (0, 0);
        (machine.tlb.small.entries, machine.tlb.small.ways) = (1, 1);
        let mut chip = Chip::new(&machine.validate().expect("sound"), fidelity, 1);
        let b = |b: Builder, i: usize| b.memory(Class::ScalarLoad, 0, &[65_536 + i as u32 % 2 * 64]);
        let report = chip.run_step(&same(1, Builder::default().repeat(100, b).build())).expect("moves");
        // Two lines and that of the task counter.
        assert_eq!(report.l1d.misses, 3, "{fidelity}");
    }
}

#[test]
fn better_parts_of_a_core_never_hurt() {
    type Better = fn(&mut MachineConfig);
    let better: [(&str, Better); 4] = [
        ("ports", |c| c.core.l1_accesses_per_cycle = 4),
        ("gather lines", |c| c.core.gather_lines_per_cycle *= 2.0),
        ("write buffer", |c| c.memory.write_buffer_lines *= 4),
        ("ring", |c| c.ring.bytes_per_cycle = 64),
    ];
    for mix in [Mix::NearGather, Mix::Kernel, Mix::Streaming] {
        let mut base = config("larrabee-24");
        (base.core.l1_accesses_per_cycle, base.core.gather_lines_per_cycle) = (1, 0.5);
        (base.ring.bytes_per_cycle, base.cores) = (16, 8);
        let cycles = |config: &MachineConfig| {
            let mut chip = Chip::new(&config.validate().expect("sound"), Fidelity::Windowed, 1);
            chip.run_step(&Tasks { count: 60, make: |task| mix.stream(task, 1000) }).expect("moves").cycles
        };
        let before = cycles(&base);
        let mut ideal = base.clone();
        (ideal.ideal.memory, ideal.ideal.ring) = (true, true);
        (ideal.ideal.queue, ideal.ideal.barrier) = (true, true);
        assert!(cycles(&ideal) <= before, "{mix:?}: ideal");
        for (what, edit) in better {
            let mut config = base.clone();
            edit(&mut config);
            let after = cycles(&config);
            assert!(after as f64 <= before as f64 * 1.03, "{mix:?}, better {what}: {before} to {after}");
        }
    }
}

/// Whether a step keeps the laws that are asserted in every step, and ends.
fn keeps_the_laws(step: impl FnOnce() -> Result<StepReport, Stuck>) -> laws::Verdict {
    match catch_unwind(AssertUnwindSafe(step)) {
        Ok(Ok(_)) => Ok(()),
        Ok(Err(stuck)) => Err(stuck.to_string()),
        Err(panic) => Err(panic.downcast_ref::<String>().cloned().unwrap_or_default()),
    }
}

/// Prefetches without throttle, from a memory with a defect or none.
fn memory_keeps_its_peak(fault: Option<laws::Fault>) -> laws::Verdict {
    keeps_the_laws(|| {
        let mut machine = config("larrabee-24");
        (machine.memory.controllers, machine.memory.bandwidth_gb_per_s) = (1, 2.0);
        // Only with so many MSHRs is anything far enough ahead to be forgotten.
        (machine.l1d.mshrs, machine.l2.mshrs) = (1024, 1024);
        let mut chip = Chip::new(&machine.validate().expect("sound"), Fidelity::Windowed, 1);
        if let Some(fault) = fault {
            chip.uncore.memory.seed(fault);
        }
        let make = |task| {
            let line = |i| 100_000 + task * 8192 + i as u32;
            Builder::default().repeat(900, |b, i| b.memory(Class::PrefetchL1, 0, &[line(i)])).build()
        };
        chip.run_step(&Tasks { count: 24, make })?;
        chip.run_step(&Tasks { count: 24, make: |task| make(task + 24) })
    })
}

#[test]
fn every_seeded_fault_is_caught() {
    let all = |f: &dyn Fn(&mut crate::cache::CoreCaches), chip: &mut Chip| {
        chip.cores.each(|core| f(&mut core.shared.caches));
    };
    let share_stacks = |chip: &mut Chip| {
        chip.cores.each(|core| core.threads.iter_mut().for_each(crate::core::Thread::share_stack));
    };
    let spoil_each = |fault| {
        LEVELS
            .map(|level| keeps_the_laws(|| spoiled(fault, level)))
            .into_iter()
            .find(Result::is_err)
            .unwrap_or(Ok(()))
    };
    let notices =
        |fault| if explore::notices(fault) { Err("a state that is not sound".to_owned()) } else { Ok(()) };
    // What is wrong, and the law that catches it.
    let caught: Vec<(&str, &str, laws::Verdict)> = vec![
        ("A1: threads share a stack", "private work invalidates nothing", stacks_are_private(share_stacks)),
        (
            "A2: memory forgets slots",
            "lines at most peak x time",
            memory_keeps_its_peak(Some(laws::Fault::SlotsForget)),
        ),
        (
            "A2: a write buffer without end",
            "never holds more than its lines",
            crate::memory::tests::write_buffers_are_finite(Some(laws::Fault::UnboundedWriteBuffer)),
        ),
        (
            "A3: a refused write clears PENDING",
            "a refused request changes nothing",
            refused_writes_change_nothing(Some(Fault::RefusedWriteClearsPending)),
        ),
        (
            "A4: ports by thread",
            "accesses at most ports x cycles",
            keeps_the_laws(|| {
                let spoil = |chip: &mut Chip| all(&|caches| caches.ports = Ports::new(4), chip);
                Ok(on_one_core(
                    |c| c.core.l1_accesses_per_cycle = 1,
                    Fidelity::Cycle,
                    &stores_and_loads(),
                    spoil,
                ))
            }),
        ),
        (
            "A4: gather lines by thread",
            "four threads gather at the rate of the core",
            gathers_take_turns(|chip| all(&|caches| caches.gather_lines = Slots::new(64), chip)),
        ),
        (
            "A5: atomics without a lock",
            "operations on a line exclude one another",
            atomics_exclude(|chip| all(&|caches| caches.locks.none = true, chip)),
        ),
        (
            "A6: translation charged to the L1",
            "every cause has one meaning",
            translations_are_charged(Some(Fault::WrongCause)),
        ),
        ("a second answer", "every request is answered once", spoil_each(Fault::AnswerTwice)),
        (
            "an answer before its time",
            "no answer for a cycle that has passed",
            spoil_each(Fault::EarlyAnswer),
        ),
        ("no answer", "every few turns something moves", spoil_each(Fault::DropAnswer)),
        ("refused for ever", "every few turns something moves", spoil_each(Fault::RefuseAlways)),
        ("an eviction is forgotten", "the directory knows every copy", notices(Fault::ForgetEviction)),
        ("a copy stays where another writes", "one writer or many readers", notices(Fault::KeepCopy)),
    ];
    for (fault, law, verdict) in caught {
        let broken = verdict.expect_err(&format!("{fault} was not noticed by: {law}"));
        println!("{fault}: {law}: {}", &broken[..broken.len().min(160)]);
    }
}

#[test]
fn without_a_fault_nothing_is_caught() {
    memory_keeps_its_peak(None).expect("kept");
    crate::memory::tests::write_buffers_are_finite(None).expect("kept");
    translations_are_charged(None).expect("kept");
}
