//! Latency: loads that each need the one before.

use crate::threads::{Placement, again, start};
use crate::{Prepared, Threads, pass, short};
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
        /// How many words are visited.
        count: u32,
        /// Bytes from one word to the next, a multiple of 4.
        stride_bytes: u32,
    },
    /// One word of every line of so many, a power of two, each time on the next page and one line further: near lines
    /// are never visited one after the other.
    Diagonal {
        /// How many lines are visited, a power of two.
        lines: u32,
    },
    /// One word of every line of `bytes` bytes, in an order without pattern.
    Random {
        /// Bytes of the lines that are visited, a multiple of 64.
        bytes: u32,
    },
}

/// Dependent loads of one thread on core 0. Units: loads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Chase {
    /// The words that are loaded, in their order.
    pub order: Order,
    /// Loads in the passes before the measured one, a multiple of 64 or 0 for none.
    pub warm_loads: u32,
    /// Loads in the long pass, a multiple of 256.
    pub loads: u32,
}

impl Chase {
    /// Loads in the passes that are measured, the short one and the long one.
    pub fn loads_measured(loads: u32) -> u32 {
        loads + short(loads, UNROLL)
    }
}

/// The state in which another core holds the lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Copy {
    /// The other core wrote the lines.
    Modified,
    /// The other core alone read the lines.
    Exclusive,
    /// The other core and a third one read the lines.
    Shared,
}

/// Dependent loads on core 0 of lines that another core holds. Units: loads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Remote {
    /// The state in which the other core holds the lines.
    pub copy: Copy,
    /// The core that holds the lines.
    pub owner: u32,
    /// Lines, a power of two from 512 on: each is loaded once, a quarter of them before the measured passes.
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

    /// Allocates the words and links them into a ring; returns their base.
    ///
    /// The base is 2 MB aligned, so that strides meet sets as the measured programs' page-aligned arrays do.
    fn link(self, arena: &mut Arena) -> Addr {
        let words = self.words();
        let base = align(arena, 1 << 21);
        arena.overwritten(words.iter().max().map_or(0, |last| u64::from(*last) + 16));
        for (word, next) in words.iter().zip(words.iter().cycle().skip(1)) {
            arena.write_u32(base.plus(4 * u64::from(*word)), *next);
        }
        base
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
        let placement = threads.place(&mut arena, cores, |_| 0);
        let base = self.order.link(&mut arena);
        let few = short(self.loads, UNROLL);
        let loads = [("warm", self.warm_loads), ("short", few), ("chase", self.loads)];
        let passes = chase_passes(&placement, base, &self.order.words(), &loads);
        Prepared { arena, passes, units: u64::from(self.loads - few) }
    }
}

impl Remote {
    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        let order = Order::Diagonal { lines: self.lines };
        let base = order.link(&mut arena);
        let mut placement_of = |core| Threads::OnCore { core, threads: 1 }.place(&mut arena, cores, |_| 0);
        let (reader, owner) = (placement_of(0), placement_of(self.owner));
        let touch = |placement: &Placement, write| {
            pass("hold", placement.tasks, Touch { table: placement.table(), base, lines: self.lines, write })
        };
        let mut passes = vec![touch(&owner, self.copy == Copy::Modified)];
        if self.copy == Copy::Shared {
            // Farther from core 0 than the owner, or as near.
            let third = if self.owner + 1 < cores { self.owner + 1 } else { self.owner - 1 };
            passes.push(touch(&placement_of(third), false));
        }
        let quarter = self.lines / 4;
        // The first quarter meets all pages.
        let loads = [("warm", quarter), ("short", quarter), ("chase", 2 * quarter)];
        passes.extend(chase_passes(&reader, base, &order.words(), &loads));
        Prepared { arena, passes, units: u64::from(quarter) }
    }
}

/// Passes of so many loads that each go on where the one before stopped; those without loads are left out.
fn chase_passes(
    placement: &Placement,
    base: Addr,
    words: &[u32],
    loads: &[(&'static str, u32)],
) -> Vec<Step> {
    let mut done = 0;
    let mut passes = Vec::new();
    for (name, loads) in loads {
        assert!(loads.is_multiple_of(UNROLL), "{loads} loads");
        let first = words[done as usize % words.len()] as i32;
        if *loads > 0 {
            let turns = (loads / UNROLL) as i32;
            passes.push(pass(name, placement.tasks, Follow { table: placement.table(), base, first, turns }));
        }
        done += loads;
    }
    passes
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
