//! Where the threads of a benchmark run.

use lrbsim_isa::vpu::{Compare, Vpu};
use lrbsim_isa::{Addr, Arena};

/// Threads pinned to hardware threads, as the measured programs pin theirs.
///
/// A machine runs task `t` of a step that has as many tasks as threads on core `t mod cores`, so pinning is a choice of
/// tasks; those in between end at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Threads {
    /// So many threads: one on each core, then a second one on each core, and so on.
    Spread(u32),
    /// Threads that all run on one core.
    OnCore {
        /// The core that the threads run on.
        core: u32,
        /// How many threads run on the core.
        threads: u32,
    },
}

/// For each task, where its thread starts; [`Placement::IDLE`] for tasks without a thread.
pub(crate) struct Placement {
    pub(crate) tasks: u32,
    table: Addr,
}

impl Threads {
    /// How many threads there are.
    pub fn count(self) -> u32 {
        match self {
            Threads::Spread(threads) | Threads::OnCore { threads, .. } => threads,
        }
    }

    /// Cores that they run on, of `cores`.
    pub fn cores_used(self, cores: u32) -> u32 {
        match self {
            Threads::Spread(threads) => threads.min(cores),
            Threads::OnCore { .. } => 1,
        }
    }

    /// The task that thread `rank` is.
    fn task(self, rank: u32, cores: u32) -> u32 {
        match self {
            Threads::Spread(_) => rank,
            Threads::OnCore { core, .. } => core + rank * cores,
        }
    }

    /// Tells the thread of each rank where it starts.
    pub(crate) fn place(self, arena: &mut Arena, cores: u32, start_of: impl Fn(u32) -> u32) -> Placement {
        let tasks = (0..self.count()).map(|rank| self.task(rank, cores) + 1).max().unwrap_or(0);
        let mut starts = vec![Placement::IDLE as u32; tasks as usize];
        for rank in 0..self.count() {
            let start = start_of(rank);
            assert!(start <= i32::MAX as u32, "thread {rank} starts past what an index reaches");
            starts[self.task(rank, cores) as usize] = start;
        }
        Placement { tasks, table: arena.alloc_u32(&starts) }
    }
}

impl Placement {
    const IDLE: i32 = -1;

    /// The table of places where threads start, for [`start`].
    pub(crate) fn table(&self) -> Addr {
        self.table
    }
}

/// Where `task` starts; `None` when it has no thread.
#[inline(always)]
pub(crate) fn start<V: Vpu>(v: &mut V, table: Addr, task: V::S32) -> Option<V::S32> {
    let start = v.s_load(table, task);
    let idle = v.s_imm(Placement::IDLE);
    v.branch(Compare::NotEqual, start, idle).then_some(start)
}

/// Counts a loop down: `left` less one, and whether anything is left.
#[inline(always)]
pub(crate) fn again<V: Vpu>(v: &mut V, left: &mut V::S32) -> bool {
    let (zero, one) = (v.s_imm(0), v.s_imm(1));
    *left = v.s_sub(*left, one);
    v.branch(Compare::NotEqual, *left, zero)
}
