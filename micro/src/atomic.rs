//! Locked operations, and stores to lines that another core wrote.

use crate::threads::{again, start};
use crate::{Prepared, Threads, pass, short};
use lrbsim_isa::kernel::Kernel;
use lrbsim_isa::vpu::Vpu;
use lrbsim_isa::{Addr, Arena};

/// Operations of a thread in the long pass.
const OPERATIONS: u32 = 256;

/// Which core has the lines that the benchmark operates on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum LockedLine {
    /// The core that operates has it: one line, in its L1.
    Own,
    /// Core 1 wrote the lines, and each of them is operated on once.
    Remote,
    /// All cores operate on one line.
    Contended,
}

/// The instruction that the benchmark times on a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum LineOperation {
    /// The operation is a plain store.
    Store,
    /// The operation is a locked add.
    Add,
    /// The operation is a locked compare-exchange.
    CompareExchange,
}

/// Operations of one thread, or of one thread a core. Units: operations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Atomic {
    /// Which core has the lines before they are operated on.
    pub line: LockedLine,
    /// The instruction that is timed on the lines.
    pub operation: LineOperation,
}

impl Atomic {
    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        let one = |core| Threads::OnCore { core, threads: 1 };
        let (me, before, stride) = match self.line {
            LockedLine::Own => (one(0), one(0), 0),
            LockedLine::Remote => (one(0), one(1), 16),
            LockedLine::Contended => (Threads::Spread(cores), Threads::Spread(cores), 0),
        };
        let few = short(OPERATIONS, 1);
        let all = 2 * few + OPERATIONS;
        let base = arena.overwritten(u64::from(all) * 16);
        // Of remote lines each pass has its own.
        let mut operate = |name, threads: Threads, operation, first: u32, operations: u32| {
            let placement = threads.place(&mut arena, cores, |_| first * stride as u32);
            let operations = operations as i32;
            pass(
                name,
                placement.tasks,
                Operate { table: placement.table(), base, stride, operation, operations },
            )
        };
        let passes = vec![
            operate("own", before, LineOperation::Store, 0, all),
            operate("warm", me, self.operation, 0, few),
            operate("short", me, self.operation, few, few),
            operate("operate", me, self.operation, 2 * few, OPERATIONS),
        ];
        Prepared { arena, passes, units: u64::from((OPERATIONS - few) * me.count()) }
    }
}

struct Operate {
    table: Addr,
    base: Addr,
    stride: i32,
    operation: LineOperation,
    operations: i32,
}

impl Kernel for Operate {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Some(mut index) = start(v, self.table, task) else { return };
        let (one, stride) = (v.s_imm(1), v.s_imm(self.stride));
        let mut left = v.s_imm(self.operations);
        loop {
            match self.operation {
                LineOperation::Store => v.s_store(self.base, index, one),
                LineOperation::Add => {
                    v.s_atomic_add(self.base, index, one);
                }
                LineOperation::CompareExchange => {
                    v.s_atomic_compare_exchange(self.base, index, one, one);
                }
            }
            index = v.s_add(index, stride);
            if !again(v, &mut left) {
                return;
            }
        }
    }
}
