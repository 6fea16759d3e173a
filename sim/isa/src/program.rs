//! Programs: phases of steps of tasks.
//!
//! ```text
//! Program ─ Phase "grid" ─ Step "bounds"  (tasks 0..n, then a global barrier)
//!                        ─ Step "count"
//!         ─ Phase "bin"  ─ …
//! ```
//!
//! A step is made by a host closure when its turn comes, so that it may read totals that earlier steps left in the
//! arena, allocate arrays of the right size and choose its number of tasks.

use crate::arena::Arena;
use crate::host::HostSimd;
use crate::kernel::AnyKernel;
use crate::stream::Stream;

/// How the tasks of a step depend on one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ordering {
    /// Values returned by atomics are used: tasks run functionally one after the other, in index order.
    Ordered,
    /// Tasks touch disjoint data or only add: they may run on many host threads.
    Independent,
}

/// Tasks of one kind that may run at once, ended by a global barrier.
pub struct Step {
    /// Name for messages and timelines.
    pub name: &'static str,
    /// Whether its tasks may run on many host threads.
    pub ordering: Ordering,
    /// Number of tasks; may be 0.
    pub tasks: u32,
    /// What a task does.
    pub kernel: Box<dyn AnyKernel>,
}

/// Makes a step when its turn comes.
pub type MakeStep<S> = fn(&mut S, &mut Arena) -> Step;

/// A row of the timing table: one or more steps in order.
pub struct Phase<S> {
    /// Stable id, as in reports.
    pub id: &'static str,
    /// Title, as in tables.
    pub title: &'static str,
    /// Whether the published totals of Johnson et al. 2009 contain this phase.
    pub in_paper_total: bool,
    /// Its steps, in order.
    pub steps: Vec<MakeStep<S>>,
}

/// Phases in order, and what their steps share.
pub struct Program<S> {
    /// What the host knows of the frame: addresses, sizes, options.
    pub state: S,
    /// The rows of the timing table.
    pub phases: Vec<Phase<S>>,
}

/// Where a machine gets the streams of a step.
pub trait TaskSource: Sync {
    /// Number of tasks of the step.
    fn tasks(&self) -> u32;

    /// Whether tasks must be recorded one after the other, in index order, because values returned by their atomics are
    /// used.
    fn is_ordered(&self) -> bool;

    /// Runs task `task` functionally and leaves its stream in `stream`, whose old content is dropped.
    ///
    /// Asked once for every task: in index order when [`TaskSource::is_ordered`], else in any order and from several host
    /// threads at once.
    fn record(&self, task: u32, stream: &mut Stream);
}

/// Records the tasks of a step, each on the host thread that asks for it.
pub struct StepSource<'a> {
    /// The step.
    pub step: &'a Step,
    /// Simulated memory.
    pub arena: &'a Arena,
    /// Which host instructions compute the lanes.
    pub simd: HostSimd,
    /// Whether several host threads record at once, so that adds to the arena must be host atomics. Streams and memory
    /// are the same either way.
    pub shared: bool,
}

impl TaskSource for StepSource<'_> {
    fn tasks(&self) -> u32 {
        self.step.tasks
    }

    fn is_ordered(&self) -> bool {
        self.step.ordering == Ordering::Ordered
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        stream.clear();
        self.step.kernel.record_shared(self.simd, self.arena, task, self.shared, stream);
    }
}
