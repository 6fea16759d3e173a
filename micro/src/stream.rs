//! Bandwidth: loops over arrays, a line a turn, of L1, L2 or memory.

use crate::chase::align;
use crate::threads::{Plan, again, start};
use crate::{Prepared, Threads, pass};
use lrbsim_isa::kernel::Kernel;
use lrbsim_isa::vpu::Vpu;
use lrbsim_isa::{Addr, Arena, Step};

/// Lines of each array between two branches.
const UNROLL: u64 = 8;
const LINE_WORDS: u32 = 16;

/// How the result is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Store {
    /// It is added up in a register.
    No,
    /// Ordinary stores, to an array of its own.
    Ordinary,
    /// Ordinary stores, over the first array that was read.
    InPlace,
    /// Stores that do not read the line first.
    Streaming,
}

/// Software prefetch: how many lines ahead, as a compiler would put it into the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Prefetch {
    /// None.
    No,
    /// Into L1 only.
    L1 {
        /// Lines ahead.
        ahead: u32,
    },
    /// Into L2, and later into L1.
    Both {
        /// Lines ahead of the use that a line is asked for in L2.
        l2_ahead: u32,
        /// The same for L1.
        l1_ahead: u32,
    },
}

/// Where the threads' parts of the arrays lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Arrays {
    /// Each array has so many bytes, of which every thread has its part, one behind the other; it works on the first
    /// lines of that.
    Split {
        /// Bytes of an array.
        bytes: u64,
    },
    /// Every thread works on the first lines of the same array.
    Same,
}

/// A loop over arrays. Units: bytes that the program reads and writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Stream {
    /// Arrays that are read, 0 to 2.
    pub reads: u32,
    /// What becomes of the result.
    pub store: Store,
    /// Software prefetch.
    pub prefetch: Prefetch,
    /// Where the arrays lie.
    pub arrays: Arrays,
    /// Who runs the loop.
    pub threads: Threads,
    /// Lines of each array that a thread works on before it is measured, a multiple of 8.
    pub warm_lines: u32,
    /// Lines that are measured, a multiple of 8.
    pub lines: u32,
    /// Whether the measured lines are those of the passes before, rather than the ones behind them.
    pub again: bool,
}

impl Stream {
    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        let count = self.threads.count();
        let extent = if self.again { self.warm_lines.max(self.lines) } else { self.warm_lines + self.lines };
        // Where a thread's part begins, in words of the array.
        let part_words = match self.arrays {
            Arrays::Split { bytes } => {
                let part = bytes / u64::from(count) / 64 * u64::from(LINE_WORDS);
                part.max(u64::from(extent * LINE_WORDS)) as u32
            }
            Arrays::Same => 0,
        };
        let words = u64::from(part_words) * u64::from(count) + u64::from(extent * LINE_WORDS);
        let writes = matches!(self.store, Store::Ordinary | Store::Streaming);
        let mut bases = [Addr(0); 3];
        for base in &mut bases[..self.reads as usize + usize::from(writes)] {
            *base = align(&mut arena, 4096);
            arena.alloc(words);
        }
        let mut plan_from =
            |line: u32| self.threads.plan(&mut arena, cores, |rank| rank * part_words + line * LINE_WORDS);
        let mut passes = Vec::new();
        if self.warm_lines > 0 {
            passes.push(self.pass("warm", &plan_from(0), bases, self.warm_lines));
        }
        let first = if self.again { 0 } else { self.warm_lines };
        passes.push(self.pass("stream", &plan_from(first), bases, self.lines));
        let lines_touched = self.reads + u32::from(self.store != Store::No);
        let units = 64 * u64::from(lines_touched) * u64::from(self.lines) * u64::from(count);
        Prepared { arena, passes, units }
    }

    fn pass(&self, name: &'static str, plan: &Plan, bases: [Addr; 3], lines: u32) -> Step {
        assert!(lines > 0 && u64::from(lines).is_multiple_of(UNROLL), "{lines} lines");
        let turns = (u64::from(lines) / UNROLL) as i32;
        let table = plan.table();
        // One kernel a shape, so that what a loop does not do is not in it.
        macro_rules! shape {
            ($reads:literal, $store:ident) => {{
                let kernel =
                    Loop::<$reads, { Store::$store as u8 }> { table, bases, turns, prefetch: self.prefetch };
                pass(name, plan.tasks, kernel)
            }};
        }
        match (self.reads, self.store) {
            (1, Store::No) => shape!(1, No),
            (0, Store::Ordinary) => shape!(0, Ordinary),
            (1, Store::Ordinary) => shape!(1, Ordinary),
            (2, Store::Ordinary) => shape!(2, Ordinary),
            (1, Store::InPlace) => shape!(1, InPlace),
            (2, Store::InPlace) => shape!(2, InPlace),
            (0, Store::Streaming) => shape!(0, Streaming),
            (1, Store::Streaming) => shape!(1, Streaming),
            (2, Store::Streaming) => shape!(2, Streaming),
            (reads, store) => panic!("no kernel reads {reads} arrays and stores {store:?}"),
        }
    }
}

/// One shape of loop: `READS` arrays read, the result stored as the [`Store`] with the number `STORE`.
struct Loop<const READS: usize, const STORE: u8> {
    table: Addr,
    /// The arrays that are read, then the one that is written.
    bases: [Addr; 3],
    turns: i32,
    prefetch: Prefetch,
}

impl<const READS: usize, const STORE: u8> Loop<READS, STORE> {
    const STREAMING: bool = STORE == Store::Streaming as u8;

    /// The array that is written.
    fn output(&self) -> Option<Addr> {
        match STORE {
            s if s == Store::No as u8 => None,
            s if s == Store::InPlace as u8 => Some(self.bases[0]),
            _ => Some(self.bases[READS]),
        }
    }

    /// Asks for line `line` of this turn of every array that will be read, be it to own it.
    #[inline(always)]
    fn prefetch_line<V: Vpu>(&self, v: &mut V, line: u64, index: V::S32) {
        let owned = usize::from(STORE == Store::Ordinary as u8);
        for base in &self.bases[..READS + owned] {
            let at = |ahead: u32| base.plus(64 * (line + u64::from(ahead)));
            match self.prefetch {
                Prefetch::No => {}
                Prefetch::L1 { ahead } => v.prefetch_l1(at(ahead), index),
                Prefetch::Both { l2_ahead, l1_ahead } => {
                    v.prefetch_l2(at(l2_ahead), index);
                    v.prefetch_l1(at(l1_ahead), index);
                }
            }
        }
    }
}

impl<const READS: usize, const STORE: u8> Kernel for Loop<READS, STORE> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Some(mut index) = start(v, self.table, task) else { return };
        let factor = v.vset_f32(0.5);
        let factor_bits = v.bits_of(factor);
        let all = v.mask_all();
        let step = v.s_imm((UNROLL * u64::from(LINE_WORDS)) as i32);
        let mut left = v.s_imm(self.turns);
        let mut sums = [factor; UNROLL as usize];
        loop {
            // All loads and what is computed from them, then all stores: the order that hides latencies best.
            for line in 0..UNROLL {
                self.prefetch_line(v, line, index);
                let sum = &mut sums[line as usize];
                *sum = match READS {
                    0 => factor,
                    1 => {
                        let a = v.vload_f32(self.bases[0].plus(64 * line), index);
                        if self.output().is_none() { v.vadd(*sum, a) } else { v.vmul(a, factor) }
                    }
                    _ => {
                        let a = v.vload_f32(self.bases[0].plus(64 * line), index);
                        let b = v.vload_f32(self.bases[1].plus(64 * line), index);
                        v.vmadd(a, factor, b)
                    }
                };
            }
            if let Some(output) = self.output() {
                for line in 0..UNROLL {
                    let at = output.plus(64 * line);
                    if Self::STREAMING {
                        let bits = if READS == 0 { factor_bits } else { v.bits_of(sums[line as usize]) };
                        v.vstore_stream(at, index, bits);
                    } else {
                        v.vstore_f32(all, at, index, sums[line as usize]);
                    }
                }
            }
            index = v.s_add(index, step);
            if !again(v, &mut left) {
                return;
            }
        }
    }
}
