//! Microbenchmarks: small kernels that each ask a machine one question.
//!
//! ```text
//! Bench (plain data) ─ prepare ─► Prepared { arena, passes } ─ the driver runs the passes on a chip
//!
//! passes   warm … │ short: n/4 units │ long: n units       measured: long - short
//! ```
//!
//! A benchmark is a few passes; all threads run each at once. The first ones bring caches, TLBs and other cores into
//! the state that the question is about. The last two are the same loop, once a quarter as long as the other, and their
//! difference is measured: what it costs to begin and to end (the start of the threads, the first misses, the filling
//! of queues) is in both and cancels, and what remains is the steady state, which the measured programs reach by
//! running for seconds. Kernels are those of the measured programs: loops over the same arrays, with the same
//! operations and prefetches a line. They know no machine but its number of cores, which says where a thread runs.

mod atomic;
mod chase;
mod gather;
mod issue;
mod stream;
mod threads;

#[cfg(test)]
mod tests;

pub use atomic::{Atomic, LineOperation, LockedLine};
pub use chase::{Chase, Copy as CopyState, Order, Remote};
pub use gather::Gather;
pub use issue::{Issue, Operation};
pub use stream::{Arrays, Extent, Prefetch, Store, Stream};
pub use threads::Threads;

use lrbsim_isa::program::Step;
use lrbsim_isa::{Arena, kernel::Kernel};

/// A benchmark: everything that determines what is run.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Bench {
    /// Dependent loads of one thread.
    Chase(Chase),
    /// Dependent loads of lines that another core holds.
    Remote(Remote),
    /// Arithmetic on registers.
    Issue(Issue),
    /// Loops over arrays.
    Stream(Stream),
    /// Gathers from a table.
    Gather(Gather),
    /// Locked operations on lines.
    Atomic(Atomic),
}

/// A benchmark that can be run.
pub struct Prepared {
    /// Simulated memory, with the arrays that the passes work on.
    pub arena: Arena,
    /// What all threads run, one after the other, at least two: the last takes [`Prepared::units`] longer than the one
    /// before it.
    pub passes: Vec<Step>,
    /// Work in the last pass less work in the one before: accesses, instructions, bytes or operations, as the benchmark
    /// says.
    pub units: u64,
}

/// Length of the short pass that belongs to a long one, both in steps of `step`.
const fn short(long: u32, step: u32) -> u32 {
    assert!(long >= 4 * step && long.is_multiple_of(4 * step), "a quarter is no whole number of steps");
    long / 4
}

impl Bench {
    /// Lays the benchmark out for a machine of `cores` cores.
    pub fn prepare(&self, cores: u32) -> Prepared {
        let arena = Arena::new();
        match self {
            Bench::Chase(bench) => bench.prepare(arena, cores),
            Bench::Remote(bench) => bench.prepare(arena, cores),
            Bench::Issue(bench) => bench.prepare(arena, cores),
            Bench::Stream(bench) => bench.prepare(arena, cores),
            Bench::Gather(bench) => bench.prepare(arena, cores),
            Bench::Atomic(bench) => bench.prepare(arena, cores),
        }
    }
}

/// A pass of `tasks` tasks, one a thread.
fn pass(name: &'static str, tasks: u32, kernel: impl Kernel + 'static) -> Step {
    Step::ordered(name, tasks, kernel)
}
