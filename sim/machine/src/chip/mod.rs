//! The chip: wires cores, caches, rings and memory together and runs steps on them.

mod cycle;
mod step;
mod windowed;

#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::coherence::Hierarchy;
use crate::config::MachineSpec;
use crate::core::{Core, CoreTables, Thread};
use crate::counters::{Cause, CycleStack, StepReport};
use crate::fidelity::Fidelity;
use crate::scheduler::{TaskCounter, barrier_cycles};
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use step::Step;

/// Cycles without anything happening after which a run is given up as stuck.
const NO_PROGRESS_CYCLES_MAX: Cycle = 10_000_000;

/// A simulated chip. Its caches stay warm from step to step.
///
/// Storage and host time follow the cores that have run and the lines that were touched.
pub struct Chip {
    fidelity: Fidelity,
    tables: CoreTables,
    hierarchy: Hierarchy,
    /// By index; `None` until a core's first task.
    cores: Vec<Option<Box<Core>>>,
    activity: Vec<CoreActivity>,
    /// Buffers of streams, to be used again.
    spare: Vec<Stream>,
    barrier_cycles: Cycle,
    now: Cycle,
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

impl Chip {
    /// A cold chip.
    pub fn new(spec: &MachineSpec, fidelity: Fidelity) -> Chip {
        let exact = fidelity == Fidelity::Cycle;
        let hierarchy = Hierarchy::new(spec, exact);
        Chip {
            fidelity,
            tables: CoreTables::new(spec),
            barrier_cycles: barrier_cycles(spec, &hierarchy.rings),
            hierarchy,
            cores: (0..spec.cores).map(|_| None).collect(),
            activity: vec![CoreActivity::default(); spec.cores as usize],
            spare: Vec::new(),
            now: 0,
        }
    }

    /// Runs all tasks of a step and the barrier that ends it.
    ///
    /// Under [`Fidelity::Functional`] tasks are recorded and counted, and no time passes.
    ///
    /// # Panics
    /// When nothing moves for ten million cycles, or the cycle stack does not add up: defects of the simulator.
    pub fn run_step(&mut self, tasks: &mut dyn TaskSource) -> StepReport {
        let mut step = Step::new(tasks, std::mem::take(&mut self.spare));
        if self.fidelity == Fidelity::Functional {
            step.record_all();
            self.spare = step.spare;
            return step.report;
        }

        // Wake the threads.
        let start = self.now;
        let total_tasks = step.tasks();
        let spec = &self.hierarchy.spec;
        let threads = total_tasks.min(spec.cores * spec.threads_per_core);
        step.counter = TaskCounter::new(total_tasks, threads, spec);
        let mut active = Vec::new();
        for index in 0..threads.min(self.hierarchy.spec.cores) as usize {
            let mut core = self.cores[index].take().unwrap_or_else(|| Box::new(Core::new(index)));
            self.wake_core(&mut core, threads, start);
            active.push(core);
        }

        // All threads ask for their first task at once: the first of every core, then the second.
        for thread in 0..self.hierarchy.spec.threads_per_core as usize {
            for core in active.iter_mut().filter(|core| core.takes_part(thread)) {
                step.feed(core, thread, &mut self.hierarchy);
                core.update_wake();
            }
        }

        // Run.
        match self.fidelity {
            Fidelity::Functional => {}
            Fidelity::Windowed => {
                windowed::run(&mut active, &self.tables, &mut self.hierarchy, &mut step, start)
            }
            Fidelity::Cycle => cycle::run(&mut active, &self.tables, &mut self.hierarchy, &mut step, start),
        }

        // The barrier, for all cores of the chip.
        let end = if threads == 0 { start } else { step.last_arrival } + self.barrier_cycles;
        self.now = end;
        let cycles = end - start;
        self.activity.fill(CoreActivity::default());
        let mut stack = [0_u64; Cause::COUNT];
        let idle_cores = self.cores.len() as u64 - active.len() as u64;
        stack[Cause::Barrier as usize] = idle_cores * cycles;
        for mut core in active {
            core.stack.fill(core.arrival, Cause::Queue);
            core.stack.fill(end, Cause::Barrier);
            for (sum, cycles) in stack.iter_mut().zip(core.stack.cycles()) {
                *sum += cycles;
            }
            let busy_cycles = core.stack.cycles()[Cause::Issue as usize];
            self.activity[core.index] =
                CoreActivity { issued: core.issued, busy_cycles, arrival_cycles: core.arrival - start };
            step.report.issued += core.issued;
            // Two uops in a cycle are a pair.
            step.report.paired += core.issued - busy_cycles;
            let index = core.index;
            self.cores[index] = Some(core);
        }

        let mut report = step.report;
        report.cycles = cycles;
        report.cycle_stack = CycleStack::from_array(stack);
        self.spare = step.spare;
        self.collect(&mut report);
        assert_eq!(
            report.cycle_stack.total(),
            self.cores.len() as u64 * cycles,
            "Chip, cycle {end}: the causes of the cycle stack do not add up to cores x cycles: {:?}",
            report.cycle_stack
        );
        assert_eq!(
            report.issued,
            report.class_counts.iter().sum::<u64>(),
            "Chip, cycle {end}: uops issued and uops recorded differ"
        );
        report
    }

    /// Simulated time: cycles since the chip was made.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// What each core did in the last step, by core.
    pub fn activity(&self) -> &[CoreActivity] {
        &self.activity
    }

    /// Readies a core for a step in which `threads` threads of the chip take part.
    fn wake_core(&mut self, core: &mut Core, threads: u32, start: Cycle) {
        let spec = &self.hierarchy.spec;
        self.hierarchy.caches[core.index].power_up(spec);
        // Thread k of the step runs on core k mod cores.
        let first = core.index as u32;
        let count = (threads - first).div_ceil(spec.cores) as usize;
        while core.threads.len() < count {
            let number = first * spec.threads_per_core + core.threads.len() as u32;
            core.threads.push(Thread::new(number));
        }
        core.start_step(count, start);
    }

    /// Moves the counters of the step from the components to the report.
    fn collect(&mut self, report: &mut StepReport) {
        for caches in &mut self.hierarchy.caches {
            report.l1d += std::mem::take(&mut caches.l1_counters);
            report.l2 += std::mem::take(&mut caches.l2_counters);
        }
        for counters in [&mut report.l1d, &mut report.l2] {
            counters.accesses = counters.hits + counters.misses + counters.merged;
        }
        report.ring = self.hierarchy.rings.take_counters();
        report.directory = std::mem::take(&mut self.hierarchy.counters);
        report.memory = std::mem::take(&mut self.hierarchy.memory.counters);
        report.atomics = std::mem::take(&mut self.hierarchy.atomics);
        report.atomics.barriers = 1;
    }
}

/// Stops a run in which nothing moves, and says what everybody waits for.
#[cold]
fn stuck(cores: &[Box<Core>], hierarchy: &Hierarchy, now: Cycle) -> ! {
    use std::fmt::Write;
    let mut text = String::new();
    for core in cores {
        for (thread_index, thread) in core.threads.iter().enumerate() {
            let (at, of) = thread.progress();
            let (state, next) = (thread.state, thread.next.at());
            let _ = writeln!(
                text,
                "Chip.Core[{}].Thread[{thread_index}]: {state:?}, uop {at} of {of}, next {next}",
                core.index
            );
        }
        let caches = &hierarchy.caches[core.index];
        let _ = writeln!(text, "Chip.Core[{}].L1d.Mshrs: {:?}", core.index, caches.l1_mshrs.occupied(now));
        let _ = writeln!(text, "Chip.Core[{}].L2.Mshrs: {:?}", core.index, caches.l2_mshrs.occupied(now));
    }
    panic!("Chip, cycle {now}: nothing has moved for {NO_PROGRESS_CYCLES_MAX} cycles\n{text}");
}
