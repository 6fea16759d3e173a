//! Who is told how far a run has come.

pub use crate::host::Stopwatch;

/// Hears of a run's progress, from several host threads at once. Nothing it does can change a result.
pub trait Progress: Sync {
    /// A part of the run begins that is not simulated, such as loading.
    fn part(&self, what: &str) {
        let _ = what;
    }

    /// A part of the run begins that is not simulated and has `count` pieces.
    fn counted(&self, what: &str, count: u32) {
        let _ = (what, count);
    }

    /// A piece of such a part is done.
    fn one_done(&self) {}

    /// A step with `tasks` tasks of phase `title` begins.
    fn step(&self, title: &str, tasks: u32) {
        let _ = (title, tasks);
    }

    /// A task of `uops` instructions was recorded.
    fn task(&self, uops: u64) {
        let _ = uops;
    }

    /// So many tasks ran that were not recorded.
    fn skipped(&self, tasks: u32) {
        let _ = tasks;
    }

    /// A step ended that was not watched task by task.
    fn uops(&self, uops: u64) {
        let _ = uops;
    }
}

/// Nobody: hears of progress and does nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Quiet;

impl Progress for Quiet {}
