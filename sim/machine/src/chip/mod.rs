//! The chip: wires cores and the uncore together and runs steps on them.
//!
//! ```text
//! core 0: threads, L1, L2 ─┐ requests      ┌─ directory slices
//! core 1: threads, L1, L2 ─┼─────────────► │  rings
//!   …                      │ ◄──────────── │  memory controllers
//! core n: threads, L1, L2 ─┘ messages      └─ task counter
//! ```

mod cores;
mod cycle;
mod hands;
mod laws;
mod step;
mod stuck;
mod windowed;

#[cfg(test)]
mod causes_tests;
#[cfg(test)]
mod laws_tests;
#[cfg(test)]
mod tests;

pub use stuck::Stuck;

use crate::Cycle;
use crate::coherence::Uncore;
use crate::config::MachineSpec;
use crate::core::{Core, CoreTables};
use crate::counters::{Cause, CycleStack, StepReport};
use crate::fidelity::Fidelity;
use crate::observer::Observer;
use crate::scheduler::{TaskCounter, barrier_cycles, chunk_lengths};
use crate::timing::Timing;
use cores::{AsPeers, Cores};
use hands::{Alone, Captain, Crew, Hands};
use laws::Carried;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use step::StepTasks;

/// A simulated chip. Its caches stay warm from step to step.
///
/// Storage and host time follow the cores that have run and the lines that were touched.
pub struct Chip<O = ()> {
    spec: MachineSpec,
    observer: O,
    fidelity: Fidelity,
    host_threads: usize,
    tables: CoreTables,
    uncore: Uncore,
    cores: Cores,
    activity: Vec<CoreActivity>,
    /// Buffers of streams, to be used again.
    spare: Vec<Stream>,
    barrier_cycles: Cycle,
    now: Cycle,
    /// Work that was asked for in earlier steps and is done in later ones.
    carried: Carried,
}

/// What one core did in the last step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CoreActivity {
    /// Uops issued.
    pub issued: u64,
    /// Cycles in which at least one uop issued.
    pub busy_cycles: u64,
    /// Cycles from the start of the step until the last of its threads came to the barrier; 0 when it took no part.
    pub arrival_cycles: u64,
}

/// What a level of modeling works on.
struct Parts<'a, 's, O> {
    observer: &'a mut O,
    cores: &'a mut Cores,
    tables: &'a CoreTables,
    uncore: &'a mut Uncore,
    step: &'a mut StepTasks<'s>,
    hands: &'a mut dyn Hands,
    /// Room for the requests of a window: time, core and number.
    order: Vec<u64>,
    /// Room for threads that ask for tasks: time, thread and core.
    pulls: Vec<(Cycle, u8, usize)>,
}

impl Chip {
    /// A cold chip at a fidelity that is timed, whose cores at most `host_threads` host threads run. How many these are
    /// changes no result.
    ///
    /// # Panics
    /// Where `fidelity` is not timed.
    pub fn new(spec: &MachineSpec, fidelity: Fidelity, host_threads: usize) -> Chip {
        Chip::observed(spec, fidelity, host_threads, ())
    }
}

impl<O: Observer> Chip<O> {
    /// A chip as [`Chip::new`] makes it, which `observer` watches.
    ///
    /// # Panics
    /// Where `fidelity` is not timed.
    pub fn observed(spec: &MachineSpec, fidelity: Fidelity, host_threads: usize, observer: O) -> Chip<O> {
        assert!(fidelity.is_timed(), "a chip has times, and {fidelity} has none");
        let uncore = Uncore::new(spec, fidelity == Fidelity::Cycle);
        let host_threads = host_threads.clamp(1, spec.cores as usize);
        Chip {
            observer,
            fidelity,
            host_threads,
            tables: CoreTables::new(spec),
            barrier_cycles: barrier_cycles(spec, &uncore.rings),
            uncore,
            cores: Cores::new(spec.cores as usize),
            activity: vec![CoreActivity::default(); spec.cores as usize],
            spare: Vec::new(),
            now: 0,
            carried: Carried::default(),
            spec: spec.clone(),
        }
    }

    /// Runs all tasks of a step and the barrier that ends it.
    ///
    /// # Errors
    /// When nothing moves any more: a defect of the simulator, after which the chip is of no use.
    ///
    /// # Panics
    /// When a law is broken, such as a resource that beats its peak, or a cycle stack that does not add up: defects of the
    /// simulator too.
    pub fn run_step(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck> {
        let lengths = chunk_lengths(tasks.tasks(), self.spec.threads_for(tasks.tasks()), &self.spec);
        self.run_chunks(tasks, lengths)
    }

    /// Runs all tasks of a step like [`Chip::run_step`], but gives them out in chunks of `lengths`, which add up to them.
    pub(crate) fn run_chunks(
        &mut self,
        tasks: &dyn TaskSource,
        lengths: Vec<u32>,
    ) -> Result<StepReport, Stuck> {
        let total_tasks = tasks.tasks();
        debug_assert_eq!(lengths.iter().sum::<u32>(), total_tasks);
        let threads = self.spec.threads_for(total_tasks);
        let mut step = StepTasks::new(tasks, TaskCounter::new(lengths), std::mem::take(&mut self.spare));

        // What earlier steps left on its way arrives first.
        let start = self.now;
        self.observer.step(tasks.name(), total_tasks, start);
        self.cores.set_active(0);
        let (cores, tables) = (&mut self.cores, &self.tables);
        self.uncore.run_until(start, &mut AsPeers { cores, tables });

        // Thread k of the step runs on core k mod cores.
        let active = threads.min(self.spec.cores);
        self.cores.set_active(active as usize);
        for index in 0..active {
            let core = self.cores.slot(index as usize);
            let core = core.get_or_insert_with(|| Box::new(Core::new(index as usize, &self.spec)));
            let count = (threads - index).div_ceil(self.spec.cores);
            core.start_step(count as usize, self.spec.threads_per_core, start);
        }

        let run_level =
            if self.fidelity == Fidelity::Windowed { windowed::run::<O> } else { cycle::run::<O> };
        let host_threads = self.host_threads.min(active as usize);
        let (cores, tables, uncore) = (&mut self.cores, &self.tables, &mut self.uncore);
        // All threads ask for their first task at once.
        cores.each_active(|core| {
            for thread in 0..core.running as usize {
                core.ask_first(tables, thread, start);
            }
        });
        let mut parts = Parts {
            observer: &mut self.observer,
            cores,
            tables,
            uncore,
            step: &mut step,
            hands: &mut Alone,
            order: Vec::new(),
            pulls: Vec::new(),
        };
        if host_threads > 1 {
            let crew = Crew::new(tables, tasks, host_threads);
            std::thread::scope(|scope| {
                // Dismissed at the end of the scope, before its threads are waited for.
                let mut captain = Captain::new(&crew);
                for number in 1..host_threads {
                    let crew = &crew;
                    scope.spawn(move || crew.work(number));
                }
                run_level(&mut Parts { hands: &mut captain, ..parts }, start)
            })?;
        } else {
            run_level(&mut parts, start)?;
        }
        self.spare = step.spare;
        Ok(self.end_step(start, step.tally.0))
    }

    /// The barrier, for all cores of the chip, and the report of a step that began at `start`.
    fn end_step(&mut self, start: Cycle, tally: StepReport) -> StepReport {
        let mut report = StepReport { steps: 1, ..tally };
        let mut last_arrival = start;
        self.cores.each_active(|core| last_arrival = last_arrival.max(core.arrival));
        let end = last_arrival + self.barrier_cycles;
        self.observer.barrier(last_arrival, end);
        let cycles = end - start;
        self.now = end;
        self.activity.fill(CoreActivity::default());
        let mut stack = [0_u64; Cause::COUNT];
        let idle_cores = self.cores.len() - self.cores.active();
        stack[Cause::Barrier as usize] = idle_cores as u64 * cycles;
        let activity = &mut self.activity;
        self.cores.each_active(|core| {
            core.stack.fill(core.arrival, Cause::Queue);
            core.stack.fill(end, Cause::Barrier);
            for (sum, cycles) in stack.iter_mut().zip(core.stack.cycles()) {
                *sum += cycles;
            }
            let busy_cycles = core.stack.cycles()[Cause::Issue as usize];
            activity[core.index] = CoreActivity {
                issued: core.shared.issued,
                busy_cycles,
                arrival_cycles: core.arrival - start,
            };
            report.issued += core.shared.issued;
            // Two uops in a cycle are a pair.
            report.paired += core.shared.issued - busy_cycles;
        });
        report.cycles = cycles;
        report.cycle_stack = CycleStack::from_array(stack);
        // What is due by the end of the barrier belongs to this step; the cores have no more to do in it.
        self.cores.set_active(0);
        let (cores, tables) = (&mut self.cores, &self.tables);
        self.uncore.run_until(end, &mut AsPeers { cores, tables });
        self.collect(&mut report);
        self.carried = laws::check(&report, &self.spec, &mut self.uncore, end, self.carried);
        report
    }

    /// What watches the chip.
    pub fn observer(&self) -> &O {
        &self.observer
    }

    /// Simulated time: cycles since the chip was made.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// What each core did in the last step, by core.
    pub fn activity(&self) -> &[CoreActivity] {
        &self.activity
    }

    /// Moves the counters of the step from the components to the report.
    fn collect(&mut self, report: &mut StepReport) {
        self.cores.each(|core| {
            report.l1d += std::mem::take(&mut core.shared.caches.l1_counters);
            report.l2 += std::mem::take(&mut core.shared.caches.l2_counters);
            report.atomics += std::mem::take(&mut core.shared.atomics);
        });
        for counters in [&mut report.l1d, &mut report.l2] {
            counters.accesses = counters.hits + counters.misses + counters.merged;
        }
        report.ring = self.uncore.rings.take_counters();
        report.directory = std::mem::take(&mut self.uncore.counters);
        report.memory = std::mem::take(&mut self.uncore.memory.counters);
        report.atomics.barriers = 1;
    }
}

impl<O: Observer> Timing for Chip<O> {
    fn run_step(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck> {
        Chip::run_step(self, tasks)
    }

    fn activity(&self) -> &[CoreActivity] {
        &self.activity
    }
}
