//! What runs the steps of a program and says what they cost: the one door behind which every fidelity stands.

use crate::chip::{CoreActivity, Stuck};
use crate::counters::StepReport;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::skip_all;

/// A model of the machine at some fidelity, with what it remembers from step to step.
pub trait Timing {
    /// Runs all tasks of a step and the barrier that ends it: each task once, recorded by
    /// [`TaskSource::record`] or, where its stream is not needed, run by [`TaskSource::skip`].
    ///
    /// # Errors
    /// [`Stuck`] when nothing moves any more: a defect of the simulator, after which the model is of no use.
    fn run_step(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck>;

    /// What each core did in the last step, by core; empty where nothing is timed.
    fn activity(&self) -> &[CoreActivity];
}

/// The model that has no time: it counts operations.
#[derive(Debug, Clone, Copy)]
pub struct Untimed {
    host_threads: usize,
}

impl Untimed {
    /// A model that runs tasks on at most `host_threads` host threads.
    pub fn new(host_threads: usize) -> Untimed {
        Untimed { host_threads }
    }
}

impl Timing for Untimed {
    fn run_step(&mut self, tasks: &dyn TaskSource) -> Result<StepReport, Stuck> {
        let counts = skip_all(tasks, self.host_threads);
        Ok(StepReport { steps: 1, ..StepReport::of_counts(tasks.tasks(), &counts) })
    }

    fn activity(&self) -> &[CoreActivity] {
        &[]
    }
}
