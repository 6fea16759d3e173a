//! Latency: loads that each need the one before.

use crate::threads::{Plan, again, start};
use crate::{Prepared, Threads, pass};
use lrbsim_isa::kernel::Kernel;
use lrbsim_isa::vpu::Vpu;
use lrbsim_isa::{Addr, Arena, Step};

/// Loads between two branches.
const UNROLL: u32 = 64;

/// The words that a chase visits, over and over, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Order {
    /// `count` words, each `stride_bytes` after the one before.
    Stride {
        /// How many.
        count: u32,
        /// Bytes from one to the next, a multiple of 4.
        stride_bytes: u32,
    },
    /// One word of every line of so many, a power of two, each time on the next page and one line further: near lines are
    /// never visited one after the other.
    Diagonal {
        /// How many.
        lines: u32,
    },
    /// One word of every line of `bytes` bytes, in an order without pattern.
    Random {
        /// Bytes, a multiple of 64.
        bytes: u32,
    },
}

/// Dependent loads of one thread on core 0. Units: loads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Chase {
    /// What is loaded.
    pub order: Order,
    /// Loads in the passes before the measured one, a multiple of 64 or 0 for none.
    pub warm_loads: u32,
    /// Loads that are measured, a multiple of 64.
    pub loads: u32,
}

/// How another core holds the lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Copy {
    /// It wrote them.
    Modified,
    /// It alone read them.
    Exclusive,
    /// It and a third core read them.
    Shared,
}

/// Dependent loads on core 0 of lines that another core holds. Units: loads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Remote {
    /// How it holds them.
    pub copy: Copy,
    /// Which core.
    pub owner: u32,
    /// Lines, a power of two from 128 on.
    pub lines: u32,
}

impl Order {
    /// Words visited, by index from the base, in order.
    fn words(self) -> Vec<u32> {
        match self {
            Order::Stride { count, stride_bytes } => (0..count).map(|i| i * (stride_bytes / 4)).collect(),
            Order::Diagonal { lines } => (0..lines).map(|i| i * 65 % lines * 16).collect(),
            Order::Random { bytes } => {
                let mut words: Vec<u32> = (0..bytes / 64).map(|line| line * 16).collect();
                // Fisher and Yates, with a fixed seed.
                let mut random = 0x2545_f491_4f6c_dd1d_u64;
                for end in (1..words.len()).rev() {
                    random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    words.swap(end, (random >> 33) as usize % (end + 1));
                }
                words
            }
        }
    }

    /// Allocates the words and links them into a ring; returns base and first index.
    ///
    /// The base is 2 MB aligned, so that strides meet sets as the measured programs' page-aligned arrays do.
    fn link(self, arena: &mut Arena) -> (Addr, u32) {
        let words = self.words();
        let base = align(arena, 1 << 21);
        arena.alloc(words.iter().max().map_or(0, |last| u64::from(*last) + 16));
        for (word, next) in words.iter().zip(words.iter().cycle().skip(1)) {
            arena.write_u32(base.plus(4 * u64::from(*word)), *next);
        }
        (base, words[0])
    }
}

/// The next address that is a multiple of `bytes`.
pub(crate) fn align(arena: &mut Arena, bytes: u64) -> Addr {
    let used = arena.used_bytes();
    if !used.is_multiple_of(bytes) {
        arena.alloc_bytes(used.next_multiple_of(bytes) - used);
    }
    Addr(used.next_multiple_of(bytes))
}

impl Chase {
    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        let threads = Threads::OnCore { core: 0, threads: 1 };
        let plan = threads.plan(&mut arena, cores, |_| 0);
        let (base, first) = self.order.link(&mut arena);
        let mut passes = Vec::new();
        if self.warm_loads > 0 {
            passes.push(chase_pass("warm", &plan, base, first, self.warm_loads));
        }
        // Goes on where the first pass stopped.
        let words = self.order.words();
        let first = words[self.warm_loads as usize % words.len()];
        passes.push(chase_pass("chase", &plan, base, first, self.loads));
        Prepared { arena, passes, units: u64::from(self.loads) }
    }
}

impl Remote {
    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        let (base, first) = Order::Diagonal { lines: self.lines }.link(&mut arena);
        let mut plan_of = |core| Threads::OnCore { core, threads: 1 }.plan(&mut arena, cores, |_| 0);
        let (reader, owner) = (plan_of(0), plan_of(self.owner));
        let touch = |plan: &Plan, write| {
            pass("hold", plan.tasks, Touch { table: plan.table(), base, lines: self.lines, write })
        };
        let mut passes = vec![touch(&owner, self.copy == Copy::Modified)];
        if self.copy == Copy::Shared {
            // Farther from core 0 than the owner, or as near.
            let third = if self.owner + 1 < cores { self.owner + 1 } else { self.owner - 1 };
            passes.push(touch(&plan_of(third), false));
        }
        passes.push(chase_pass("chase", &reader, base, first, self.lines));
        Prepared { arena, passes, units: u64::from(self.lines) }
    }
}

fn chase_pass(name: &'static str, plan: &Plan, base: Addr, first: u32, loads: u32) -> Step {
    assert!(loads > 0 && loads.is_multiple_of(UNROLL), "{loads} loads");
    let kernel = Follow { table: plan.table(), base, first: first as i32, turns: (loads / UNROLL) as i32 };
    pass(name, plan.tasks, kernel)
}

/// Follows the links.
struct Follow {
    table: Addr,
    base: Addr,
    first: i32,
    turns: i32,
}

impl Kernel for Follow {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        if start(v, self.table, task).is_none() {
            return;
        }
        let (mut index, mut left) = (v.s_imm(self.first), v.s_imm(self.turns));
        loop {
            for _ in 0..UNROLL {
                index = v.s_load(self.base, index);
            }
            if !again(v, &mut left) {
                return;
            }
        }
    }
}

/// Reads a word of every line, and writes it back if told to.
struct Touch {
    table: Addr,
    base: Addr,
    lines: u32,
    write: bool,
}

impl Kernel for Touch {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        if start(v, self.table, task).is_none() {
            return;
        }
        let (mut index, step) = (v.s_imm(0), v.s_imm(16));
        let mut left = v.s_imm(self.lines as i32);
        loop {
            let word = v.s_load(self.base, index);
            if self.write {
                v.s_store(self.base, index, word);
            }
            index = v.s_add(index, step);
            if !again(v, &mut left) {
                return;
            }
        }
    }
}
