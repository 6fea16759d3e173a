use super::choose::Chunks;
use super::*;
use crate::config::shipped;
use crate::observer::Observer;
use crate::streams::{Mix, Random, Tasks};
use lrbsim_isa::stream::Stream;
use std::ops::Range;
use std::sync::Mutex;

/// Few cores, so that few tasks are many for each thread.
fn spec() -> MachineSpec {
    let mut config = shipped("larrabee-24");
    config.cores = 4;
    config.validate().expect("sound")
}

fn sampled(sampling: Sampling, host_threads: usize) -> Sampled {
    Sampled::new(&spec(), sampling, host_threads)
}

/// Tasks of a kind, one longer than the other.
fn uneven(mix: Mix, count: u32) -> Tasks<impl Fn(u32) -> Stream + Sync> {
    let make = move |task: u32| mix.stream(task, 200 + (task * 37 % 101 * 8) as usize);
    Tasks { count, make }
}

#[test]
fn times_lie_in_their_intervals_and_everything_adds_up() {
    let spec = spec();
    for mix in Mix::ALL {
        let tasks = uneven(mix, 6000);
        let exact = Chip::new(&spec, Fidelity::Windowed, 1).run_step(&tasks).expect("moves");
        let report = sampled(Sampling::DEFAULT, 1).run_step(&tasks).expect("moves");
        let deviation = (report.cycles_variance as f64).sqrt();
        let error = report.cycles as f64 - exact.cycles as f64;
        println!("{mix:?}: {:+.4}, {:.4}", error / exact.cycles as f64, deviation / exact.cycles as f64);
        assert!(error.abs() <= NORMAL_95 * deviation, "{mix:?}: {error} of {}, {deviation}", exact.cycles);
        // What is counted is counted, and nothing that is drawn from it can tell.
        assert_eq!((report.steps, report.tasks, report.issued), (1, exact.tasks, exact.issued), "{mix:?}");
        assert_eq!(report.class_counts, exact.class_counts);
        // A stream that is written by hand tells of no lanes.
        assert_eq!(exact.lanes_active, 0);
        assert_eq!(report.cycle_stack.total(), u64::from(spec.cores) * report.cycles);
        assert_eq!(report.issued, report.cycle_stack.issue + report.paired);
        let l1d = report.l1d;
        assert_eq!(l1d.accesses, l1d.hits + l1d.misses + l1d.merged);
        assert_eq!(report.atomics.task_pulls, exact.atomics.task_pulls, "{mix:?}");
    }
}

#[test]
fn cycles_of_tasks_are_told_from_those_of_uops() {
    let chunk = |tasks: f64, uops: f64, group: usize| Told {
        tasks,
        uops,
        cycles: 300.0 * tasks + 4.0 * uops,
        doubt: 0.0,
        group,
    };
    let stack = CycleStack::default();
    let chunks: Vec<_> = (0..20).map(|i| chunk(4.0, 80.0 + 1000.0 * f64::from(i % 5), i as usize)).collect();
    let rate = Rate::of(&chunks, 1, &stack);
    assert!((rate.cycles(10.0, 100.0) - 3400.0).abs() < 1e-6 && rate.choice_deviation(10.0, 100.0) < 1e-6);
    // Who has more uops is done sooner, or more tasks: one of the two stands for all.
    for cycles in [[900.0, 500.0], [10.0, 90_000.0]] {
        let told = |i: usize| Told { cycles: cycles[i], ..chunk([1.0, 4.0][i], [900.0, 400.0][i], i) };
        let chunks = [told(0), told(1)];
        let rate = Rate::of(&chunks, 1, &stack);
        let all = rate.cycles(5.0, 1300.0);
        assert!((all - cycles[0] - cycles[1]).abs() < 1e-6, "{cycles:?}: {all}");
        assert!(rate.cycles(1.0, 0.0) >= 0.0 && rate.cycles(0.0, 1.0) >= 0.0, "{cycles:?}");
    }
    assert_eq!(Rate::of(&[], 0, &stack).cycles(1.0, 1.0), 0.0);
    // Of chunks that are all alike the whole is all that is known.
    let rate = Rate::of(&[chunk(4.0, 100.0, 0), chunk(4.0, 100.0, 1)], 1, &stack);
    assert!((rate.cycles(4.0, 100.0) - 1600.0).abs() < 1e-9 && rate.cycles(4.0, 0.0) == 0.0);
}

#[test]
fn busy_cycles_of_cores_add_up_to_those_of_the_step() {
    let mut level = sampled(Sampling::DEFAULT, 1);
    let report = level.run_step(&uneven(Mix::Kernel, 6000)).expect("moves");
    let sum = |of: fn(&CoreActivity) -> u64| level.activity().iter().map(of).sum::<u64>();
    assert_eq!(sum(|core| core.busy_cycles), report.cycle_stack.issue);
    assert_eq!(sum(|core| core.issued), report.issued);
}

#[test]
fn short_steps_are_timed_whole() {
    let tasks = uneven(Mix::Kernel, 60);
    let exact = Chip::new(&spec(), Fidelity::Windowed, 1).run_step(&tasks).expect("moves");
    assert_eq!(sampled(Sampling::DEFAULT, 1).run_step(&tasks).expect("moves"), exact);
}

#[test]
fn any_number_of_host_threads_gives_the_same_report() {
    let run = |host_threads: usize| {
        let mut level = sampled(Sampling { error_percent: 3, seed: 7 }, host_threads);
        [Mix::Kernel, Mix::RandomGather].map(|mix| level.run_step(&uneven(mix, 6000)).expect("moves"))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn who_asks_for_less_error_gets_no_wider_an_interval_and_another_seed_another_choice() {
    let run = |error_percent: u32, seed: u32| {
        let report =
            sampled(Sampling { error_percent, seed }, 1).run_step(&uneven(Mix::Kernel, 6000)).expect("moves");
        (report.cycles, report.cycles_variance)
    };
    let half = |(cycles, variance): (u64, u64)| NORMAL_95 * (variance as f64).sqrt() / cycles as f64;
    let [wide, narrow, least] = [50, 3, 1].map(|percent| run(percent, 0));
    assert!(half(wide) >= half(narrow) && half(narrow) > half(least), "{wide:?} {narrow:?} {least:?}");
    assert_ne!(run(5, 0), run(5, 1));
}

/// Tasks that note how they are run.
struct Noted<T> {
    inner: T,
    is_ordered: bool,
    runs: Mutex<Vec<u32>>,
}

impl<T: TaskSource> TaskSource for Noted<T> {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn tasks(&self) -> u32 {
        self.inner.tasks()
    }

    fn is_ordered(&self) -> bool {
        self.is_ordered
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        self.runs.lock().expect("no panic").push(task);
        self.inner.record(task, stream);
    }

    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
        self.runs.lock().expect("no panic").extend(tasks.clone());
        self.inner.skip(tasks, counts);
    }
}

#[test]
fn every_task_runs_once_and_in_order_where_it_must() {
    // Those of 2500 tasks are short.
    for (count, is_ordered, error_percent) in
        [(2500, true, 5), (2500, true, 1), (2500, false, 5), (6000, false, 5), (6000, false, 1)]
    {
        let tasks = Noted { inner: uneven(Mix::Atomics, count), is_ordered, runs: Mutex::default() };
        let report = sampled(Sampling { error_percent, seed: 0 }, 2).run_step(&tasks).expect("moves");
        assert!(report.cycles_variance > 0 && report.tasks == u64::from(count));
        let mut runs = tasks.runs.into_inner().expect("no panic");
        if !is_ordered {
            runs.sort_unstable();
        }
        assert_eq!(runs, (0..count).collect::<Vec<_>>(), "{count} {is_ordered} {error_percent}");
    }
}

#[test]
fn chunks_that_are_timed_and_those_that_are_not_are_all_tasks() {
    let mut random = Random::new(5);
    let mut sampled = 0;
    for seed in 0..300 {
        let lengths: Vec<u32> = (0..1 + random.below(900)).map(|_| 1 + random.below(5)).collect();
        let tasks: u32 = lengths.iter().sum();
        let mut chunks = Chunks::new(&lengths, (1 + random.below(99)) as usize, seed);
        if chunks.are_few() {
            continue;
        }
        sampled += 1;
        let pilot = if random.below(2) == 0 { Vec::new() } else { chunks.pilot() };
        let mut parts = if random.below(4) == 0 { chunks.all_but_pilot() } else { chunks.first_round() };
        for _ in 0..random.below(3) {
            parts.extend(chunks.next_round());
        }
        let timed: u32 = parts.iter().map(|part| part.tasks.len() as u32).sum();
        assert!((chunks.timed_share() - f64::from(timed) / f64::from(tasks)).abs() < 1e-12);
        parts.extend(chunks.untimed());
        parts.extend(pilot);
        for part in &parts {
            assert!(part.tasks.clone().all(|task| chunks.chunk_of(task) == part.chunk));
        }
        let mut all: Vec<u32> = parts.into_iter().flat_map(|part| part.tasks).collect();
        all.sort_unstable();
        assert_eq!(all, (0..tasks).collect::<Vec<_>>(), "{seed}");
    }
    assert!(sampled > 100, "{sampled}");
}

#[test]
fn a_schedule_is_as_long_as_who_is_done_last() {
    let makespan = |durations: &[f64], threads, cores, ready| {
        schedule::makespan(durations.iter().copied(), [threads, cores], ready)
    };
    // A core for each thread.
    let alone = |durations: &[f64], threads| makespan(durations, threads, threads, 1.0);
    assert_eq!(alone(&[], 3), 0.0);
    assert_eq!(alone(&[7.0; 9], 3), 21.0);
    assert_eq!(alone(&[7.0; 10], 3), 28.0);
    // The long one begins when the first is done.
    assert_eq!(alone(&[1.0, 5.0, 5.0, 10.0], 3), 11.0);
    assert_eq!(alone(&[3.0, 1.0, 4.0, 1.0, 5.0], 1), 14.0);

    // Threads of one core that are hardly ever ready are not in each other's way. Where they always are, one alone is as fast as two, as
    // far as it may be.
    assert_eq!(makespan(&[40.0, 100.0], 2, 1, 0.0), 100.0);
    assert_eq!(makespan(&[40.0, 100.0], 2, 1, 1.0), 40.0 + 60.0 / (1.0 + rate::INDEPENDENT));
    // Threads 0 and 2 are one core's, 1 and 3 the other's: it is over when the slower core is.
    assert_eq!(makespan(&[100.0, 40.0, 100.0, 40.0], 4, 2, 1.0), 100.0);
    let slower = 40.0 + 60.0 / (1.0 + rate::INDEPENDENT);
    assert_eq!(makespan(&[100.0, 40.0, 40.0, 40.0], 4, 2, 1.0), slower);
}

#[test]
fn a_chunk_takes_longer_where_others_would_have_had_work() {
    let mut durations = Durations::default();
    durations.step("", 2, 0);
    durations.tasks(0, 0, 0..1, 0, 5);
    durations.tasks(0, 1, 1..2, 0, 5);
    durations.tasks(0, 1, 2..2, 100, 100);
    durations.tasks(0, 0, 2..2, 160, 160);
    assert_eq!([0, 1].map(|chunk| durations.cycles(chunk)), [160, 100]);
    // For 60 cycles one of two threads has the core: no faster where threads are hardly ever ready, twice as fast where they always
    // are; ready every other cycle, two issue in 3 of 4 cycles and one in 2.
    assert_eq!([0.0, 0.5, 1.0].map(|ready| durations.crowded_cycles(0, ready)), [160.0, 180.0, 220.0]);
    assert_eq!(durations.crowded_cycles(1, 1.0), 100.0);
    // Ready every other cycle, they issue in 3 of 4 of the first 100 and in 1 of 2 of the other 60.
    assert!((durations.readiness(105) - 0.5).abs() < 1e-5);
    assert!(durations.readiness(0) < 1e-5 && durations.readiness(160) > 1.0 - 1e-5);
}

/// Eight groups of twelve chunks of ten uops.
fn alike(cycles: fn(usize) -> f64, doubt: f64) -> Vec<Told> {
    let told = |chunk| Told { tasks: 1.0, uops: 10.0, cycles: cycles(chunk), doubt, group: chunk / 12 };
    (0..96).map(told).collect()
}

#[test]
fn a_rate_is_a_ratio_whose_error_is_that_of_its_groups() {
    let stack = CycleStack { issue: 100, barrier: 50, ..CycleStack::default() };
    let rate = |chunks: &[Told], stack| Rate::of(chunks, 200, stack);
    let even = rate(&alike(|_| 30.0, 0.0), &stack);
    assert_eq!((even.cycles(0.0, 1.0), even.choice_deviation(0.0, 1.0)), (3.0, 0.0));
    assert_eq!(even.model_deviation(), rate::MODEL);
    // Waits for what lies outside of the core count, and the barrier does not.
    let waits = CycleStack { issue: 100, memory: 100, barrier: 50, ..CycleStack::default() };
    let deviation = rate(&alike(|_| 30.0, 0.0), &waits).model_deviation();
    assert!((deviation - rate::MODEL - 0.5 * rate::MODEL_OUTSIDE).abs() < 1e-12);
    // Half of the groups take 2 cycles a uop, half 4: without one of them the rate is off by a seventh. Of eight deviations, their mean
    // being known, five sevenths are certain.
    let uneven = rate(&alike(|chunk| if chunk < 48 { 20.0 } else { 40.0 }, 0.0), &stack);
    let choice = (8.0_f64 / 49.0 * (7.0 / 8.0) * (7.0 / 5.0)).sqrt();
    assert!((uneven.cycles(0.0, 1.0) - 3.0).abs() < 1e-12, "{uneven:?}");
    assert!((uneven.choice_deviation(0.0, 1.0) - choice).abs() < 1e-12, "{uneven:?}");
    assert!((uneven.choice_deviation(0.0, 70.0) - 70.0 * choice).abs() < 1e-9);
    // What all have in common does not grow less with their number.
    let deviation = rate(&alike(|_| 30.0, 3.0), &stack).model_deviation();
    assert!((deviation - (0.01 + rate::MODEL * rate::MODEL).sqrt()).abs() < 1e-12);
}

#[test]
fn what_is_unlike_the_sample_is_less_certain() {
    // Chunks of different lengths whose cycles are off, by turns.
    let told = |group: usize| {
        let uops = 100.0 + 100.0 * (group % 4) as f64;
        let off = [0.9, 1.1, 1.0][group % 3];
        Told { tasks: 4.0, uops, cycles: off * (400.0 + 3.0 * uops), doubt: 0.0, group }
    };
    let chunks: Vec<Told> = (0..24).map(told).collect();
    let rate = Rate::of(&chunks, 10_000, &CycleStack::default());
    let relative = |tasks, uops| rate.choice_deviation(tasks, uops) / rate.cycles(tasks, uops);
    let alike = relative(4.0, 250.0);
    assert!(alike > 0.0 && relative(4.0, 25_000.0) > 2.0 * alike && relative(4.0, 2.5) > 1.2 * alike);
}

#[test]
fn how_long_a_chunk_takes_that_is_far_longer_than_all_that_were_timed_is_open() {
    // A core issues in 0.5 cycles for each uop; the rate is 3.
    let stack = CycleStack { issue: 100, ..CycleStack::default() };
    let rate = Rate::of(&alike(|_| 30.0, 0.0), 200, &stack);
    assert_eq!(rate.longest_cycles(), 30.0);
    assert_eq!(rate.bounds(1.0, 20.0), [60.0, 60.0]);
    assert_eq!(rate.bounds(1.0, 21.0), [60.0, 63.0]);
    assert_eq!(rate.bounds(1.0, 1000.0), [500.0, 3000.0]);
    // No rate lets a thread issue faster than its core.
    let slow = Rate::of(&alike(|_| 1.0, 0.0), 200, &stack);
    assert_eq!(slow.bounds(1.0, 10.0), [5.0, 5.0]);
}

/// Tasks of `uops` uops, but for one in 500, which has 200 times as many.
fn few_long(count: u32, uops: usize) -> Tasks<impl Fn(u32) -> Stream + Sync> {
    let make = move |task: u32| Mix::Kernel.stream(task, if task % 500 == 377 { 200 * uops } else { uops });
    Tasks { count, make }
}

#[test]
fn few_long_tasks_among_many_short_ones_do_not_mislead() {
    for (count, uops, most) in [(4000, 60, 0.02), (4000, 1000, 0.3)] {
        let tasks = few_long(count, uops);
        let exact = Chip::new(&spec(), Fidelity::Windowed, 1).run_step(&tasks).expect("moves").cycles as f64;
        for seed in 0..4 {
            let report = sampled(Sampling { seed, ..Sampling::DEFAULT }, 1).run_step(&tasks).expect("moves");
            let deviation = (report.cycles_variance as f64).sqrt();
            let error = report.cycles as f64 - exact;
            println!("{uops}, {seed}: {:+.4}, {:.4}", error / exact, deviation / exact);
            assert!(error.abs() <= NORMAL_95 * deviation, "{uops}, {seed}: {error} of {exact}, {deviation}");
            assert!(error.abs() <= most * exact, "{uops}, {seed}: {error} of {exact}");
        }
    }
}

#[test]
fn shares_add_up_and_none_is_above_what_there_is_room_for() {
    assert_eq!(shares(10, &[1, 1, 2], u64::MAX), [3, 2, 5]);
    assert_eq!(shares(10, &[1, 1, 2], 4), [4, 2, 4]);
    assert_eq!(shares(12, &[1, 1, 8], 5), [5, 2, 5]);
    assert_eq!(shares(7, &[0, 0], 9), [7, 0]);
    assert_eq!(shares(0, &[3, 4], 9), [0, 0]);
}

#[test]
fn no_core_is_busy_for_longer_than_the_step_and_the_barrier_has_its_cycles() {
    let mut level = sampled(Sampling::DEFAULT, 1);
    let report = level.run_step(&uneven(Mix::AluHeavy, 6000)).expect("moves");
    let barrier = level.chip.observer().barrier_cycles();
    assert!(barrier > 0 && report.cycle_stack.barrier >= u64::from(spec().cores) * barrier);
    for core in level.activity() {
        assert!(core.busy_cycles <= core.arrival_cycles && core.arrival_cycles == report.cycles - barrier);
        assert!(core.issued >= core.busy_cycles && core.issued <= 2 * core.busy_cycles, "{core:?}");
    }
}

#[test]
fn one_thread_alone_and_tasks_without_uops_are_no_trouble() {
    let mut spec = spec();
    (spec.cores, spec.threads_per_core) = (1, 1);
    let run = |make: fn(u32) -> Stream| {
        let mut level = Sampled::new(&spec, Sampling::DEFAULT, 1);
        level.run_step(&Tasks { count: 2000, make }).expect("moves")
    };
    let report = run(|task| Mix::Kernel.stream(task, 60));
    assert!(report.cycles_variance > 0 && report.cycle_stack.total() == report.cycles);
    let report = run(|_| Stream::default());
    assert_eq!((report.issued, report.tasks), (0, 2000));
}
