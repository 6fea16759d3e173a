//! The `sampled` level: some chunks of a step's tasks are timed, all others are run and counted, and the time of the step follows
//! from both.
//!
//! ```text
//! chunks of the step ─► choose ─► a chip, windowed ─► durations ─► rate: cycles for each task and each uop ─┐
//!                         └─► the others, run and counted ─► tasks and uops of each chunk ──────────────────┤
//!                                            schedule: all chunks, one after the other, on all threads ◄────┘
//! ```
//!
//! What is not timed touches no cache. So neighbors are chosen together, as far as their data is to be found where the chip has
//! it; what is left of that error is part of the interval ([`Sampling`]).

pub(crate) mod choose;
mod durations;
mod rate;
mod schedule;
#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::chip::{Chip, CoreActivity, Stuck};
use crate::config::MachineSpec;
use crate::counters::{CacheCounters, Cause, CycleStack, NORMAL_95, StepReport};
use crate::fidelity::Fidelity;
use crate::scheduler::chunk_lengths;
use crate::timing::Timing;
use choose::{Chosen, Chunks, Part};
use durations::Durations;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::{Class, OpCounts, skip_all};
use rate::{Rate, Told};
use std::ops::Range;

/// How much of each step is timed, and which part of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Sampling {
    /// Half of the interval, with 95 % confidence, that the choice may add to the time of a step, in percent of all time until its end. Where
    /// it would be wider, more is timed; only tasks that are run in order cannot be chosen a second time.
    pub error_percent: u32,
    /// What the choice is hashed from, beside the number of the step.
    pub seed: u32,
}

impl Sampling {
    /// What users get who ask for nothing else.
    pub const DEFAULT: Sampling = Sampling { error_percent: 5, seed: 0 };
}

/// Rounds of timing at most: each after the first doubles what is timed.
const ROUNDS_MAX: u32 = 5;

/// Steps of fewer uops than this, as far as a pilot tells, are timed whole but for the pilot: a few of their chunks may have most of
/// the uops, and it takes next to no time.
const SHORT_UOPS: f64 = 2e6;

/// A chip that times some of the tasks of each step.
pub(crate) struct Sampled {
    chip: Chip<Durations>,
    spec: MachineSpec,
    sampling: Sampling,
    host_threads: usize,
    /// Steps so far, and their cycles.
    steps: u32,
    now: Cycle,
    /// Whether anything was left out so far.
    has_skipped: bool,
    activity: Vec<CoreActivity>,
}

/// What is known of a step under way.
#[derive(Default)]
struct Sample {
    /// The sum over all that was timed.
    timed: StepReport,
    /// Uops of tasks that were timed, spills left out.
    uops: u64,
    /// By chunk the cycles that those of its tasks that were timed would have taken, had all threads had work all the time.
    cycles: Vec<f64>,
    /// Part of the cycles in which a thread is ready to issue.
    ready: f64,
    /// The chunks that tell the rate.
    told: Vec<Told>,
    /// What ran in between because tasks must be run in order, or ahead in the pilot, or in the end.
    skipped: Skipped,
}

/// When the last thread is done with its tasks.
struct Arrival {
    cycles: f64,
    variance: f64,
}

/// What tasks did that were run and not timed.
#[derive(Debug, Default)]
pub(crate) struct Skipped {
    /// Each task, or the first of neighbors of one chunk, with its uops.
    pub(crate) uops: Vec<(u32, u64)>,
    pub(crate) counts: OpCounts,
}

impl Sampled {
    /// A cold chip whose cores at most `host_threads` host threads run. How many these are changes no result.
    pub(crate) fn new(spec: &MachineSpec, sampling: Sampling, host_threads: usize) -> Sampled {
        Sampled {
            chip: Chip::observed(spec, Fidelity::Windowed, host_threads, Durations::default()),
            spec: spec.clone(),
            sampling,
            host_threads,
            steps: 0,
            now: 0,
            has_skipped: false,
            activity: vec![CoreActivity::default(); spec.cores as usize],
        }
    }

    /// Times all of a step.
    fn time_whole(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck> {
        let mut report = self.chip.run_step(tasks)?;
        if self.has_skipped {
            // What earlier steps would have left in caches is not there.
            let deviation = report.cycles as f64 * rate::model(&report.cycle_stack);
            report.cycles_variance = (deviation * deviation) as u64;
        }
        self.activity.copy_from_slice(self.chip.activity());
        self.now += report.cycles;
        Ok(report)
    }

    /// Runs the pilot of a step, and tells whether there are so few uops that all others are to be timed.
    fn is_short(&self, tasks: &dyn TaskSource, chunks: &mut Chunks, skipped: &mut Skipped) -> bool {
        let pilot = chunks.pilot();
        skipped.run_all(tasks, &pilot, self.host_threads);
        let of_pilot: usize = pilot.iter().map(|part| part.tasks.len()).sum();
        let uops = skipped.counts.total() as f64 * (f64::from(tasks.tasks()) / of_pilot.max(1) as f64);
        uops <= SHORT_UOPS
    }

    /// Times some chunks, and more of them until the interval is as narrow as asked.
    fn time_some(
        &mut self,
        tasks: &dyn TaskSource,
        chunks: &mut Chunks,
        sample: &mut Sample,
    ) -> Result<(), Stuck> {
        let threads = f64::from(self.spec.threads_for(tasks.tasks()));
        let asked = f64::from(self.sampling.error_percent) / 100.0;
        let (first, ends) = (chunks.first_round(), threads as usize);
        self.time(tasks, &first, ends..first.len() - ends, sample)?;
        for _ in 1..ROUNDS_MAX {
            // As if the tasks that are left were as long as those that were timed.
            let rate = sample.rate();
            let (timed_tasks, timed_uops) = (sample.timed.tasks as f64, sample.uops as f64);
            let more = 1.0 / chunks.timed_share() - 1.0;
            let choice = rate.choice_deviation(more * timed_tasks, more * timed_uops) / threads;
            let all = (1.0 + more) * rate.cycles(timed_tasks, timed_uops) / threads;
            // The longer the longest chunk is, the likelier it is the last to be done.
            let longest = rate.longest_cycles();
            let tail = rate::TAIL * longest * (longest / all.max(1.0)).min(1.0);
            let half = NORMAL_95 * (choice * choice + tail * tail).sqrt();
            if half <= asked * (self.now as f64 + all) || tasks.is_ordered() {
                break;
            }
            let more = chunks.next_round();
            if more.is_empty() {
                break;
            }
            self.time(tasks, &more, 0..more.len(), sample)?;
        }
        Ok(())
    }

    /// Times `parts` of `tasks`, of which those of numbers in `measured` tell the rate.
    fn time(
        &mut self,
        tasks: &dyn TaskSource,
        parts: &[Part],
        measured: Range<usize>,
        sample: &mut Sample,
    ) -> Result<(), Stuck> {
        let chosen = Chosen::new(tasks, parts);
        let lengths = parts.iter().map(|part| part.tasks.len() as u32).collect();
        let report = self.chip.run_chunks(&chosen, lengths)?;
        let (uops, skipped) = chosen.into_counts(parts);
        let durations = self.chip.observer();
        let ready = durations.readiness(report.cycle_stack.issue);
        let told = rate::told(durations, parts, &uops, ready);
        for (part, told) in parts.iter().zip(&told) {
            sample.cycles[part.chunk] += told.cycles;
        }
        sample.told.extend_from_slice(&told[measured]);
        sample.ready = ready;
        sample.timed += report;
        sample.uops += uops.iter().sum::<u64>();
        sample.skipped.add(skipped);
        for (sum, core) in self.activity.iter_mut().zip(self.chip.activity()) {
            sum.issued += core.issued;
            sum.busy_cycles += core.busy_cycles;
        }
        Ok(())
    }
}

impl Sample {
    fn rate(&self) -> Rate {
        Rate::of(&self.told, self.uops, &self.timed.cycle_stack)
    }

    /// Tasks and uops, all together, of what was not timed.
    fn untimed(&self, tasks: u32) -> (f64, f64) {
        ((u64::from(tasks) - self.timed.tasks) as f64, self.skipped.counts.total() as f64)
    }

    /// What is expected of a step of which all but a pilot was timed at once, in order.
    fn arrival_nearly_whole(&self, tasks: u32, threads: u32, barrier: Cycle) -> Arrival {
        let (rate, (untimed_tasks, untimed_uops)) = (self.rate(), self.untimed(tasks));
        let pilot = rate.cycles(untimed_tasks, untimed_uops) / f64::from(threads);
        let choice = rate.choice_deviation(untimed_tasks, untimed_uops) / f64::from(threads);
        let cycles = (self.timed.cycles - barrier) as f64 + pilot;
        // What earlier steps would have left in caches is not there.
        let model = cycles * rate::model(&self.timed.cycle_stack);
        Arrival { cycles, variance: choice * choice + model * model }
    }

    /// What is expected of a step of which some chunks were timed, when all go to the first of `threads` threads on so many cores that
    /// is free.
    fn arrival(&self, chunks: &Chunks, tasks: u32, [threads, cores]: [u32; 2]) -> Arrival {
        let rate = self.rate();
        let mut left: Vec<(u32, u64)> = chunks.left().map(|tasks| (tasks, 0)).collect();
        for (task, uops) in &self.skipped.uops {
            left[chunks.chunk_of(*task)].1 += uops;
        }
        let [least, most] = [0, 1].map(|bound| {
            let of_chunk = |(cycles, (tasks, uops)): (&f64, &(u32, u64))| {
                cycles + rate.bounds(f64::from(*tasks), *uops as f64)[bound]
            };
            let durations: Vec<f64> = self.cycles.iter().zip(&left).map(of_chunk).collect();
            let makespan = schedule::makespan(durations.iter().copied(), [threads, cores], self.ready);
            (makespan, durations.iter().sum::<f64>() / f64::from(threads))
        });
        let cycles = 0.5 * (least.0 + most.0);
        let (untimed_tasks, untimed_uops) = self.untimed(tasks);
        let choice = rate.choice_deviation(untimed_tasks, untimed_uops) / f64::from(threads);
        // What is timed finds caches colder than it would, too.
        let model = rate.model_deviation() * cycles;
        let tail = rate::TAIL * (cycles - 0.5 * (least.1 + most.1)).max(0.0) * (1.0 - chunks.timed_share());
        // Anywhere between both, with equal chance.
        let beyond = (most.0 - least.0) / 12.0_f64.sqrt();
        Arrival { cycles, variance: choice * choice + model * model + tail * tail + beyond * beyond }
    }

    /// The report of a step of so many tasks, all of which have run.
    fn report(&self, tasks: u32, arrival: &Arrival, barrier: Cycle, spec: &MachineSpec) -> StepReport {
        let cycles = arrival.cycles.round() as Cycle + barrier;
        // A task that is too long to be recorded leaves none; that run is refused.
        let (untimed_tasks, untimed_uops) = self.untimed(tasks);
        let more = untimed_uops / self.uops.max(1) as f64;
        let cores = u64::from(spec.cores);
        let mut report =
            extrapolate(&self.timed, cycles, 1.0 + more, [cores * (cycles - barrier), cores * barrier]);
        report.cycles_variance = arrival.variance as u64;
        let mut untimed = StepReport::of_counts(untimed_tasks as u32, &self.skipped.counts);
        // The others hold what their registers do not in memory too, and functional runs do not count that.
        for class in [Class::SpillStore, Class::SpillLoad] {
            let spills = self.timed.class_counts[class as usize] as f64 * more;
            untimed.class_counts[class as usize] = spills.round() as u64;
            untimed.issued += spills.round() as u64;
        }
        report += untimed;
        report.paired = report.issued.saturating_sub(report.cycle_stack.issue);
        report
    }
}

impl Skipped {
    /// Runs and counts the tasks of `parts`, on several host threads unless they are ordered.
    fn run_all(&mut self, tasks: &dyn TaskSource, parts: &[Part], host_threads: usize) {
        let chosen = Chosen::new(tasks, parts);
        self.counts.add(&skip_all(&chosen, host_threads));
        let (uops, _) = chosen.into_counts(parts);
        self.uops.extend(parts.iter().zip(uops).map(|(part, uops)| (part.tasks.start, uops)));
    }

    fn add(&mut self, mut other: Skipped) {
        self.uops.append(&mut other.uops);
        self.counts.add(&other.counts);
    }
}

impl Timing for Sampled {
    fn run_step(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck> {
        self.steps += 1;
        self.activity.fill(CoreActivity::default());
        let threads = self.spec.threads_for(tasks.tasks());
        let lengths = chunk_lengths(tasks.tasks(), threads, &self.spec);
        let seed = u64::from(self.sampling.seed) << 32 | u64::from(self.steps);
        let mut chunks = Chunks::new(&lengths, threads as usize, seed);
        if chunks.are_few() {
            return self.time_whole(tasks);
        }

        let mut sample = Sample { cycles: vec![0.0; lengths.len()], ..Sample::default() };
        // Tasks that are run in order cannot be run ahead.
        let is_short = !tasks.is_ordered() && self.is_short(tasks, &mut chunks, &mut sample.skipped);
        if is_short {
            let all = chunks.all_but_pilot();
            self.time(tasks, &all, 0..all.len(), &mut sample)?;
        } else {
            self.time_some(tasks, &mut chunks, &mut sample)?;
        }
        // The others are run and counted; those of ordered steps were on the way to the last chunk, which is timed.
        self.has_skipped = true;
        if !tasks.is_ordered() {
            sample.skipped.run_all(tasks, &chunks.untimed(), self.host_threads);
        }
        let barrier = self.chip.observer().barrier_cycles();
        let arrival = if is_short {
            sample.arrival_nearly_whole(tasks.tasks(), threads, barrier)
        } else {
            sample.arrival(&chunks, tasks.tasks(), [threads, self.spec.cores])
        };
        let mut report = sample.report(tasks.tasks(), &arrival, barrier, &self.spec);
        report.atomics.task_pulls = lengths.len() as u64 + u64::from(threads);
        self.now += report.cycles;
        share_out(&mut self.activity, &report, report.cycles - barrier);
        Ok(report)
    }

    fn activity(&self) -> &[CoreActivity] {
        &self.activity
    }
}

/// The report of a step that takes `cycles`, of which `timed` is a sample: what the machine counts is `factor` times as much, but for what
/// all cores have `running` cycles and those of the `barrier` for. Instructions, lanes and tasks are those of the sample.
fn extrapolate(timed: &StepReport, cycles: Cycle, factor: f64, [running, barrier]: [Cycle; 2]) -> StepReport {
    let scaled = |count: u64| (count as f64 * factor).round() as u64;
    let mut report = StepReport { steps: 1, cycles, ..timed.clone() };
    let mut stack = Cause::ALL.map(|cause| scaled(timed.cycle_stack.get(cause)));
    // Who waits at the barrier, and for how long, a sample does not tell: it is what the others leave.
    stack[Cause::Barrier as usize] = 0;
    let issue = stack[Cause::Issue as usize].min(running);
    stack[Cause::Issue as usize] = 0;
    let waits: u64 = stack.iter().sum();
    let room = running - issue;
    if waits > room {
        stack = stack.map(|cycles| (cycles as f64 * (room as f64 / waits as f64)) as u64);
    }
    let waits: u64 = stack.iter().sum();
    stack[Cause::Issue as usize] = issue;
    stack[Cause::Barrier as usize] = barrier + room.saturating_sub(waits);
    report.cycle_stack = CycleStack::from_array(stack);
    for counters in [&mut report.l1d, &mut report.l2] {
        let CacheCounters { accesses, hits, misses, merged, upgrades, writebacks, evictions, invalidations } =
            counters;
        for count in [&mut *hits, misses, merged, upgrades, writebacks, evictions, invalidations] {
            *count = scaled(*count);
        }
        *accesses = *hits + *misses + *merged;
    }
    let (ring, directory, memory) = (&mut report.ring, &mut report.directory, &mut report.memory);
    for count in [
        &mut ring.messages,
        &mut ring.local,
        &mut ring.bytes,
        &mut ring.slot_hops,
        &mut ring.wait_cycles,
        &mut directory.transactions,
        &mut directory.forwards,
        &mut directory.invalidations,
        &mut directory.wait_cycles,
        &mut memory.reads,
        &mut memory.writes,
        &mut memory.bytes,
        &mut memory.row_hits,
        &mut memory.row_misses,
        &mut memory.wait_cycles,
        &mut report.atomics.operations,
        &mut report.atomics.transfers,
    ] {
        *count = scaled(*count);
    }
    report.atomics.barriers = 1;
    report
}

/// Makes the sums over `cores` those of the step, each core with the part of them that it had of the sample, as far as the step's cycles
/// before its barrier, `arrival`, allow.
pub(crate) fn share_out(cores: &mut [CoreActivity], report: &StepReport, arrival: Cycle) {
    let [busy, paired]: [Vec<u64>; 2] = [
        cores.iter().map(|core| core.busy_cycles).collect(),
        cores.iter().map(|core| core.issued - core.busy_cycles).collect(),
    ];
    let busy = shares(report.cycle_stack.issue, &busy, arrival);
    let paired = shares(report.paired, &paired, u64::MAX);
    for ((core, busy), paired) in cores.iter_mut().zip(busy).zip(paired) {
        let arrival_cycles = if core.issued > 0 { arrival } else { 0 };
        *core = CoreActivity { issued: busy + paired, busy_cycles: busy, arrival_cycles };
    }
}

/// Whole numbers in proportion to `parts` that add up to `total`, none above `most`.
fn shares(total: u64, parts: &[u64], most: u64) -> Vec<u64> {
    let sum = parts.iter().sum::<u64>().max(1) as f64;
    let (mut before, mut given) = (0, 0);
    let mut shares: Vec<u64> = parts
        .iter()
        .map(|part| {
            before += part;
            // What one has no room for, the next gets.
            let share =
                ((total as f64 * (before as f64 / sum)).round() as u64).saturating_sub(given).min(most);
            given += share;
            share
        })
        .collect();
    for share in &mut shares {
        let more = total.saturating_sub(given).min(most - *share);
        (*share, given) = (*share + more, given + more);
    }
    shares
}
