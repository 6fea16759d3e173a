//! The `roofline` level: every task is run and counted, some are recorded and read, and each step takes what limits it most.
//!
//! ```text
//! groups of neighbors ─► choose ─► record ─► read: pairs, waits, distances of accesses ─┐
//!            └─► the others, run and counted ──────────────────────────────────────────┴─► profile of the step
//!                                                   any machine: profile ─► limits ─► cycles ◄┘
//! ```
//!
//! Nothing is simulated: no cache has contents and no message a time, so that queues and bursts are not there; [williams09] has
//! the idea, with one limit of computing and one of memory. The profile is the same for all machines; a further one costs microseconds. It ranks
//! machines and says which limit holds; times are to be had from the other levels.

mod bounds;
mod profile;
mod reuse;
#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::chip::{CoreActivity, Stuck};
use crate::config::{MachineSpec, builtin_machine_names, shipped};
use crate::counters::{Cause, CycleStack, StepReport};
use crate::sampled::choose::{Chosen, Part, hash};
use crate::sampled::share_out;
use crate::timing::Timing;
use bounds::{Costs, Estimate};
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use lrbsim_isa::uop::Class;
use lrbsim_isa::{OpCounts, skip_all};
use profile::{Profile, Reader};
use std::ops::Range;

/// Tasks of a group at most: as many as a thread gets at once.
const GROUP_TASKS: u32 = 4;

/// Groups of a step at least, as far as there are so many tasks.
const GROUPS_MIN: u32 = 48;

/// Part of a step's groups that is read, where it is more than the least.
const SHARE: u32 = 50;

/// Uops of a step that are read: no more groups are begun beyond, but for the least of all, [`GROUPS_LEAST`].
const UOPS_MAX: u64 = 2 << 20;

/// Groups that are read however long they are.
const GROUPS_LEAST: u32 = 6;

/// A machine whose steps take what limits them most, with what runs them.
pub(crate) struct Roofline {
    survey: Survey,
    machine: Machine,
}

/// A machine whose steps take what limits them most.
pub(crate) struct Machine {
    costs: Costs,
    activity: Vec<CoreActivity>,
}

/// What runs steps, and finds what they ask of any machine.
pub(crate) struct Survey {
    reader: Reader,
    host_threads: usize,
    /// Steps so far.
    steps: u64,
    streams: Vec<Stream>,
}

/// How unlike one another the tasks of a step are.
#[derive(Debug, Clone, Copy, Default)]
struct Lengths {
    /// The part of the step's work that its longest task has.
    longest: f64,
    /// The part that the task has in which a uop drawn at random is, on average.
    typical: f64,
}

impl Lengths {
    /// How unlike tasks of so many uops are.
    fn of(uops: &[u64]) -> Lengths {
        let sum = uops.iter().sum::<u64>().max(1) as f64;
        let part = |uops: &u64| *uops as f64 / sum;
        Lengths {
            longest: uops.iter().map(part).fold(0.0, f64::max),
            typical: uops.iter().map(|uops| part(uops) * part(uops)).sum(),
        }
    }
}

/// What was found of a step.
pub(crate) struct Found {
    profile: Profile,
    /// What was counted.
    counts: StepReport,
    lengths: Lengths,
}

impl Survey {
    /// One that has run nothing; at most `host_threads` host threads run tasks. How many these are changes no result.
    pub(crate) fn new(host_threads: usize) -> Survey {
        // The machine whose latencies say in which order results come; the estimate has those of the machine that is asked for.
        let nominal = shipped(builtin_machine_names()[0]).validate().expect("shipped machines are sound");
        Survey { reader: Reader::new(&nominal), host_threads, steps: 0, streams: Vec::new() }
    }

    /// Runs the tasks of a step, and reads some of them.
    pub(crate) fn step(&mut self, tasks: &dyn TaskSource) -> Found {
        self.steps += 1;
        let count = tasks.tasks();
        let group = (count / (GROUPS_MIN * GROUP_TASKS)).clamp(1, GROUP_TASKS);
        let groups = count.div_ceil(group);
        let tasks_of = |number: u32| number * group..((number + 1) * group).min(count);
        let mut picked = self.pick(groups, tasks.is_ordered());

        let mut counts = StepReport { steps: 1, ..StepReport::default() };
        let parts = parts(picked.iter().map(|number| tasks_of(*number)));
        let chosen = Chosen::new(tasks, &parts);
        let (mut read, mut position, mut uops) = (0, 0, 0);
        for number in &picked {
            if !tasks.is_ordered() && uops > UOPS_MAX && read >= GROUPS_LEAST {
                break;
            }
            self.streams.resize_with(tasks_of(*number).len(), Stream::default);
            for stream in &mut self.streams {
                stream.clear();
                chosen.record(position, stream);
                counts.count_task(stream);
                position += 1;
                uops += stream.uops.len() as u64;
            }
            self.reader.read(&self.streams);
            read += 1;
        }
        let mut lengths: Vec<u64> = chosen.uops().collect();
        let (_, skipped) = chosen.into_counts(&parts);

        // The others are run and counted; those of ordered steps were on the way.
        let mut others: OpCounts = skipped.counts;
        lengths.extend(skipped.uops.iter().map(|(_, uops)| uops));
        picked.truncate(read as usize);
        if !tasks.is_ordered() {
            picked.sort_unstable();
            let is_left = |number: &u32| picked.binary_search(number).is_err();
            let left = parts_of((0..groups).filter(is_left).flat_map(tasks_of));
            let chosen = Chosen::new(tasks, &left);
            others.add(&skip_all(&chosen, self.host_threads));
            lengths.extend(chosen.uops());
        }
        let spills = [Class::SpillStore, Class::SpillLoad].map(|class| counts.class_counts[class as usize]);
        counts.issued = counts.class_counts.iter().sum();
        let uops = counts.issued - spills.iter().sum::<u64>();
        let all = uops + others.total();
        let profile = self.reader.finish(groups, all);
        let left = u64::from(count) - counts.tasks;
        counts += StepReport::of_counts(left as u32, &others);
        // Functional runs do not count what registers lose to memory.
        for (class, read) in [Class::SpillStore, Class::SpillLoad].into_iter().zip(spills) {
            let more = (read as f64 * (others.total() as f64 / uops.max(1) as f64)).round() as u64;
            counts.class_counts[class as usize] += more;
            counts.issued += more;
        }
        Found { profile, counts, lengths: Lengths::of(&lengths) }
    }

    /// The groups to be read, in an order in which any first few are spread over the step; of ordered steps in theirs, with the last.
    fn pick(&self, groups: u32, ordered: bool) -> Vec<u32> {
        let wanted = groups.min(GROUPS_MIN.max(groups / SHARE));
        let share = |number: u32| (u64::from(groups) * u64::from(number) / u64::from(wanted.max(1))) as u32;
        let place = |number: u32| {
            let (start, end) = (share(number), share(number + 1));
            start + (hash(self.steps << 32 | u64::from(number)) % u64::from(end - start)) as u32
        };
        let mut picked: Vec<u32> = (0..wanted).map(place).collect();
        if ordered {
            // What comes behind the last that is recorded would not run.
            picked.pop();
            picked.extend(groups.checked_sub(1));
        } else {
            picked.sort_unstable_by_key(|number| hash(self.steps << 32 | u64::from(*number) | 1 << 31));
        }
        picked
    }
}

/// One part for each range of tasks.
fn parts(ranges: impl Iterator<Item = Range<u32>>) -> Vec<Part> {
    ranges.enumerate().map(|(chunk, tasks)| Part { chunk, tasks, group: 0 }).collect()
}

/// One part for each task.
fn parts_of(tasks: impl Iterator<Item = u32>) -> Vec<Part> {
    parts(tasks.map(|task| task..task + 1))
}

impl Roofline {
    /// A machine; at most `host_threads` host threads run its tasks. How many these are changes no result.
    pub(crate) fn new(spec: &MachineSpec, host_threads: usize) -> Roofline {
        Roofline { survey: Survey::new(host_threads), machine: Machine::new(spec) }
    }
}

impl Machine {
    pub(crate) fn new(spec: &MachineSpec) -> Machine {
        let activity = vec![CoreActivity::default(); spec.cores as usize];
        Machine { costs: Costs::new(spec), activity }
    }

    /// What each core did in the last step, by core.
    pub(crate) fn activity(&self) -> &[CoreActivity] {
        &self.activity
    }

    /// The report of a step on this machine.
    pub(crate) fn report(&mut self, found: &Found) -> StepReport {
        let Found { profile, counts, lengths } = found;
        let tasks = counts.tasks as u32;
        let estimate = self.costs.estimate(profile, tasks, *lengths);
        let cycles = estimate.cycles.round() as Cycle;
        let barrier = estimate.bounds.barrier.min(cycles);
        let mut report = StepReport { cycles, bounds: estimate.bounds, ..counts.clone() };
        let cores = self.activity.len();
        let active = cores.min(tasks as usize);
        report.cycle_stack =
            stack(&estimate, [cores, active].map(|cores| cores as u64), cycles, barrier, counts.issued);
        report.paired = counts.issued - report.cycle_stack.issue;
        let whole = |count: f64| count.round() as u64;
        report.l1d.misses = whole(estimate.l1_misses);
        report.l1d.hits = whole(profile.lines).saturating_sub(report.l1d.misses);
        report.l2.misses = whole(estimate.l2_misses).min(report.l1d.misses);
        report.l2.hits = report.l1d.misses - report.l2.misses;
        for cache in [&mut report.l1d, &mut report.l2] {
            cache.accesses = cache.hits + cache.misses;
        }
        (report.memory.reads, report.memory.writes) = (whole(estimate.reads), whole(estimate.writes));
        report.memory.bytes = lrbsim_isa::arena::LINE_BYTES * (report.memory.reads + report.memory.writes);
        report.atomics.operations = whole(profile.locked);
        report.atomics.barriers = 1;
        self.activity.fill(CoreActivity::default());
        self.activity[..active].fill(CoreActivity { issued: 1, busy_cycles: 1, arrival_cycles: 0 });
        share_out(&mut self.activity, &report, cycles - barrier);
        report
    }
}

/// Core-cycles by cause: issue as counted, the barrier as estimated, that of idle cores too, and the rest as threads wait.
fn stack(
    estimate: &Estimate,
    [cores, active]: [u64; 2],
    cycles: Cycle,
    barrier: Cycle,
    issued: u64,
) -> CycleStack {
    let running = active * (cycles - barrier);
    let issue = (estimate.issue.round() as u64).min(running).min(issued);
    let room = running - issue;
    let waits: f64 = estimate.waits.iter().sum();
    let mut stack = estimate.waits.map(|cycles| (cycles / waits.max(1.0) * room as f64) as u64);
    stack[Cause::Issue as usize] = issue;
    stack[Cause::Queue as usize] = active * (estimate.start as u64).min(barrier);
    let sum: u64 = stack.iter().sum();
    stack[Cause::Barrier as usize] += cores * cycles - sum;
    CycleStack::from_array(stack)
}

impl Timing for Roofline {
    fn run_step(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck> {
        let found = self.survey.step(tasks);
        Ok(self.machine.report(&found))
    }

    fn activity(&self) -> &[CoreActivity] {
        self.machine.activity()
    }
}
