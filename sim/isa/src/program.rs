//! Programs: phases of steps of tasks.
//!
//! ```text
//! program ─ Phase "grid" ─ Step "bounds"  (tasks 0..n, then a global barrier)
//!                        ─ Step "count"
//!         ─ Phase "bin"  ─ …
//! ```
//!
//! A program is a host function that hands its steps to a [`Runner`], one after the other. Between two steps it may read
//! totals that earlier ones left in the arena, allocate arrays of the right size and choose the number of tasks of the next;
//! steps of which there are as many as the data wants are a loop.

use core::fmt;
use core::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::arena::Arena;
use crate::emit::OpCounts;
use crate::host::HostSimd;
use crate::kernel::{AnyKernel, Kernel};
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
    name: &'static str,
    ordering: Ordering,
    tasks: u32,
    kernel: Box<dyn AnyKernel>,
}

impl Step {
    /// A step of `tasks` tasks, which may be none, that run functionally one after the other. `name` is for messages and
    /// timelines.
    pub fn ordered(name: &'static str, tasks: u32, kernel: impl Kernel + 'static) -> Step {
        Step { name, ordering: Ordering::Ordered, tasks, kernel: Box::new(kernel) }
    }

    /// A step of `tasks` tasks, which may be none, that may run on many host threads at once. `name` is for messages and
    /// timelines.
    ///
    /// # Safety
    /// A word of the arena that one of the tasks writes is read and written by no other of them; but all may add to a word
    /// by atomics, as long as none of them uses what the atomic returns or reads or writes the word. Anything else is a data
    /// race of the host. Debug builds stop tasks that write to one word, on one host thread as on many.
    #[expect(unsafe_code, reason = "that tasks are independent is seen by no compiler")]
    pub unsafe fn independent(name: &'static str, tasks: u32, kernel: impl Kernel + 'static) -> Step {
        Step { name, ordering: Ordering::Independent, tasks, kernel: Box::new(kernel) }
    }

    /// Name of the step, for messages and timelines.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Number of tasks of the step, which may be 0.
    pub fn tasks(&self) -> u32 {
        self.tasks
    }

    /// The code that each task of the step runs.
    pub fn kernel(&self) -> &dyn AnyKernel {
        &*self.kernel
    }
}

/// A row of the timing table: one or more steps in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Phase {
    /// The id of the phase, as reports and studies name it.
    pub id: &'static str,
    /// The title of the phase, as tables have it.
    pub title: &'static str,
    /// Whether the published totals of Johnson et al. 2009 contain this phase.
    pub in_paper_total: bool,
}

/// The error of a program whose runner has stopped it; the runner knows why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stopped;

impl fmt::Display for Stopped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the program was stopped by what runs it")
    }
}

impl core::error::Error for Stopped {}

/// What a [`Runner`] does with each step: all of its tasks on the arena, and the global barrier that ends it.
pub type RunStep<'a> = dyn FnMut(&'static Phase, &Step, &mut Arena) -> Result<(), Stopped> + 'a;

/// What a program hands its steps to.
pub struct Runner<'a> {
    /// The arena that the steps run on. Between steps the program reads totals there, and makes arrays.
    pub arena: &'a mut Arena,
    /// What the program has found that makes its result suspicious: sentences for users that say what would be right.
    pub warnings: Vec<String>,
    /// The phase that steps belong to.
    phase: Option<&'static Phase>,
    run_step: &'a mut RunStep<'a>,
}

impl<'a> Runner<'a> {
    /// A runner that has `run_step` run every step of a program on `arena`.
    pub fn new(arena: &'a mut Arena, run_step: &'a mut RunStep<'a>) -> Runner<'a> {
        Runner { arena, warnings: Vec::new(), phase: None, run_step }
    }

    /// Begins `phase`: the steps from here on belong to its row.
    pub fn phase(&mut self, phase: &'static Phase) {
        self.phase = Some(phase);
    }

    /// Runs all tasks of `step`, and the global barrier that ends it.
    ///
    /// # Errors
    /// [`Stopped`], of which the program makes nothing but an end.
    ///
    /// # Panics
    /// Where the program has begun no phase.
    pub fn run(&mut self, step: &Step) -> Result<(), Stopped> {
        let phase = self.phase.unwrap_or_else(|| panic!("step `{}` belongs to no phase", step.name()));
        (self.run_step)(phase, step, self.arena)
    }
}

/// The tasks of a step, as what times them sees them: it has each of them run once, recorded or not.
pub trait TaskSource: Sync {
    /// Name of the step, for messages and timelines.
    fn name(&self) -> &str;

    /// Number of tasks of the step.
    fn tasks(&self) -> u32;

    /// Whether tasks must be run one after the other, in index order, because values returned by their atomics are used.
    fn is_ordered(&self) -> bool;

    /// Runs task `task` functionally and leaves its stream in `stream`, whose old content is dropped.
    ///
    /// Tasks of a step that [`TaskSource::is_ordered`] are asked for in index order, those of any other in any order and
    /// from several host threads at once.
    fn record(&self, task: u32, stream: &mut Stream);

    /// Runs `tasks` functionally, records nothing, and adds their operations to `counts`; asked for like
    /// [`TaskSource::record`].
    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts);
}

/// A step and the arena that its tasks run on, which nothing else reaches meanwhile: tasks are counted or recorded, each on
/// the host thread that asks for it.
pub struct StepSource<'a> {
    step: &'a Step,
    arena: &'a mut Arena,
    simd: HostSimd,
    /// Whether several host threads run tasks at once, so that adds to the arena must be host atomics. Streams and memory
    /// are the same either way.
    shared: bool,
    /// Held by the host thread that runs a task of an ordered step.
    turn: Mutex<()>,
    /// Tasks that were asked for: a second time they would race with themselves.
    asked: Vec<AtomicBool>,
}

// SAFETY: all of it but the arena is `Sync`. Nobody else reaches the arena as long as this borrows it, and through this only
// tasks of the step do. Those of an ordered step hold `turn`; those of an independent one touch disjoint words or only add,
// by host atomics, as its maker has vouched.
#[expect(unsafe_code, reason = "tasks share the arena under the contract of independent steps")]
unsafe impl Sync for StepSource<'_> {}

impl<'a> StepSource<'a> {
    /// The tasks of `step` on `arena`, asked for by at most `host_threads` host threads; lanes are computed by `simd`.
    pub fn new(step: &'a Step, arena: &'a mut Arena, simd: HostSimd, host_threads: usize) -> StepSource<'a> {
        let is_independent = step.ordering == Ordering::Independent;
        if is_independent {
            arena.independent_tasks_begin();
        }
        let asked = std::iter::repeat_with(AtomicBool::default).take(step.tasks as usize).collect();
        let shared = is_independent && host_threads > 1;
        StepSource { step, arena, simd, shared, turn: Mutex::new(()), asked }
    }

    /// Notes that `task` is run.
    ///
    /// # Panics
    /// Where the step has no such task, or it has been run before.
    fn ask(&self, task: u32) {
        let again = self.asked[task as usize].swap(true, Relaxed);
        assert!(!again, "task {task} of step `{}` is run twice", self.step.name);
    }

    /// Waits until no other task of an ordered step runs.
    fn turn(&self) -> Option<MutexGuard<'_, ()>> {
        self.is_ordered().then(|| self.turn.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for StepSource<'_> {
    fn drop(&mut self) {
        self.arena.independent_tasks_end();
    }
}

impl TaskSource for StepSource<'_> {
    fn name(&self) -> &str {
        self.step.name
    }

    fn tasks(&self) -> u32 {
        self.step.tasks
    }

    fn is_ordered(&self) -> bool {
        self.step.ordering == Ordering::Ordered
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        self.ask(task);
        let _turn = self.turn();
        stream.clear();
        self.step.kernel.record_shared(self.simd, self.arena, task, self.shared, stream);
    }

    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
        tasks.clone().for_each(|task| self.ask(task));
        let _turn = self.turn();
        self.step.kernel.run(self.simd, self.arena, tasks, self.shared, counts);
    }
}
