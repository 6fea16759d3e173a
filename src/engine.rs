//! Runs the steps of a program: functionally, or on a simulated chip, whose cores are run by as many host threads.
//!
//! How many these are never shows in a result.

use lrbsim_isa::host::HostSimd;
use lrbsim_isa::program::{StepSource, TaskSource};
use lrbsim_isa::stream::TASK_UOPS_MAX;
use lrbsim_isa::{Arena, Step, Stream, run_functional};
use lrbsim_machine::{Chip, Fidelity, MachineSpec, StepReport};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::error::BadInput;
use crate::progress::Progress;

/// The number of no task: a step has fewer.
const NO_TASK: u32 = u32::MAX;

/// What runs the steps of a frame.
pub struct Engine {
    /// `None`: nothing is timed.
    chip: Option<Chip>,
    simd: HostSimd,
    host_threads: usize,
}

impl Engine {
    /// An engine at `fidelity` on a cold chip.
    pub fn new(spec: &MachineSpec, fidelity: Fidelity, simd: HostSimd, host_threads: usize) -> Engine {
        let chip = (fidelity != Fidelity::Functional).then(|| Chip::new(spec, fidelity, host_threads));
        Engine { chip, simd, host_threads }
    }

    /// Cycles in which each core issued in the last step, by core; `None` when nothing is timed.
    pub fn core_busy_cycles(&self) -> Option<impl Iterator<Item = u64>> {
        self.chip.as_ref().map(|chip| chip.activity().iter().map(|core| core.busy_cycles))
    }

    /// Runs all tasks of `step` and the barrier that ends it.
    pub fn run(
        &mut self,
        step: &Step,
        arena: &mut Arena,
        progress: &dyn Progress,
    ) -> Result<StepReport, BadInput> {
        let Some(chip) = &mut self.chip else {
            return Ok(run_untimed(step, arena, self.simd, self.host_threads));
        };
        let too_long = AtomicU32::new(NO_TASK);
        let inner = StepSource::new(step, arena, self.simd, self.host_threads);
        let report = chip
            .run_step(&Watched { inner, progress, too_long: &too_long })
            .map_err(|stuck| BadInput::new(format!("step `{}`: {stuck}", step.name())))?;
        match too_long.into_inner() {
            NO_TASK => Ok(report),
            task => Err(BadInput::new(format!(
                "task {task} of step `{}` has more instructions than can be recorded: more than {TASK_UOPS_MAX}, or \
                 more than the host has memory for",
                step.name()
            ))
            .with_help("a smaller image or mesh has shorter tasks; `--fidelity functional` records none")),
        }
    }
}

/// Counts operations, without a machine.
fn run_untimed(step: &Step, arena: &mut Arena, simd: HostSimd, threads: usize) -> StepReport {
    let counts = run_functional(step, arena, simd, threads);
    StepReport {
        steps: 1,
        tasks: u64::from(step.tasks()),
        issued: counts.total(),
        lanes_active: counts.lanes_active(),
        lanes_masked: counts.lanes_masked,
        class_counts: counts.class_counts,
        ..StepReport::default()
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
    fn tasks(&self) -> u32 {
        self.inner.tasks()
    }

    fn is_ordered(&self) -> bool {
        self.inner.is_ordered()
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        self.inner.record(task, stream);
        if stream.cut_short {
            self.too_long.fetch_min(task, Relaxed);
        }
        self.progress.task(stream.uops.len() as u64);
    }
}
