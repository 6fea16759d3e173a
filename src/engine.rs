//! Runs the steps of a program: functionally, or on a simulated chip, whose cores are run by as many host threads.
//!
//! How many these are never shows in a result.

use lrbsim_isa::host::HostSimd;
use lrbsim_isa::program::{StepSource, TaskSource};
use lrbsim_isa::stream::TASK_UOPS_MAX;
use lrbsim_isa::{Arena, OpCounts, Step, Stream};
use lrbsim_machine::work::{Work, doing};
use lrbsim_machine::{CoreActivity, Fidelity, MachineSpec, StepReport, Timing};
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::error::BadInput;
use crate::progress::Progress;

/// The number of no task: a step has fewer.
const NO_TASK: u32 = u32::MAX;

/// What runs the steps of a frame.
pub struct Engine {
    timing: Box<dyn Timing>,
    simd: HostSimd,
    host_threads: usize,
}

impl Engine {
    /// An engine at `fidelity` on a cold machine.
    pub fn new(spec: &MachineSpec, fidelity: Fidelity, simd: HostSimd, host_threads: usize) -> Engine {
        Engine { timing: fidelity.timing(spec, host_threads), simd, host_threads }
    }

    /// Cycles in which each core issued in the last step, by core; `None` when nothing is timed.
    pub fn core_busy_cycles(&self) -> Option<Vec<u64>> {
        busy_cycles(self.timing.activity())
    }

    /// Runs all tasks of `step` and the barrier that ends it.
    pub fn run(
        &mut self,
        step: &Step,
        arena: &mut Arena,
        progress: &dyn Progress,
    ) -> Result<StepReport, BadInput> {
        let Engine { timing, simd, host_threads } = self;
        let report = with_tasks(step, arena, (*simd, *host_threads), progress, |tasks| {
            let _work = doing(Work::Other);
            timing.run_step(tasks)
        })?;
        report.map_err(|stuck| BadInput::new(format!("step `{}`: {stuck}", step.name())))
    }
}

/// Cycles in which each core issued; `None` when nothing is timed.
pub(crate) fn busy_cycles(cores: &[CoreActivity]) -> Option<Vec<u64>> {
    (!cores.is_empty()).then(|| cores.iter().map(|core| core.busy_cycles).collect())
}

/// Hands the tasks of `step` to `run`.
///
/// # Errors
/// Where a task is too long to be recorded.
pub(crate) fn with_tasks<T>(
    step: &Step,
    arena: &mut Arena,
    (simd, host_threads): (HostSimd, usize),
    progress: &dyn Progress,
    run: impl FnOnce(&dyn TaskSource) -> T,
) -> Result<T, BadInput> {
    let too_long = AtomicU32::new(NO_TASK);
    let inner = StepSource::new(step, arena, simd, host_threads);
    let result = run(&Watched { inner, progress, too_long: &too_long });
    match too_long.into_inner() {
        NO_TASK => Ok(result),
        task => Err(BadInput::new(format!(
            "task {task} of step `{}` has more instructions than can be recorded: more than {TASK_UOPS_MAX}, or \
             more than the host has memory for",
            step.name()
        ))
        .with_help("a smaller image or mesh has shorter tasks; `--fidelity functional` records none")),
    }
}

/// Tells of every task that is recorded for the chip.
struct Watched<'a, T> {
    inner: T,
    progress: &'a dyn Progress,
    /// The lowest task whose stream was cut short, [`NO_TASK`] so far if none was.
    too_long: &'a AtomicU32,
}

impl<T: TaskSource> TaskSource for Watched<'_, T> {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn tasks(&self) -> u32 {
        self.inner.tasks()
    }

    fn is_ordered(&self) -> bool {
        self.inner.is_ordered()
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        {
            let _work = doing(Work::Emission);
            self.inner.record(task, stream);
        }
        if stream.cut_short {
            self.too_long.fetch_min(task, Relaxed);
        }
        self.progress.task(stream.uops.len() as u64);
    }

    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
        let count = tasks.len() as u32;
        {
            let _work = doing(Work::Function);
            self.inner.skip(tasks, counts);
        }
        self.progress.skipped(count);
    }
}
