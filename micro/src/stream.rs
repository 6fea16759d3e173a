//! Bandwidth: loops over arrays, a line a turn, of L1, L2 or memory.

use crate::chase::align;
use crate::threads::{Placement, again, start};
use crate::{Prepared, Threads, pass, short};
use lrbsim_isa::kernel::Kernel;
use lrbsim_isa::vpu::Vpu;
use lrbsim_isa::{Addr, Arena, Step};

/// Lines of each array between two branches.
const UNROLL: u64 = 8;
const LINE_WORDS: u32 = 16;

/// Lines that a load goes ahead of the arithmetic on it, which goes a line ahead of its store: what is loaded is there
/// when it is used, and loads and stores find something to pair with, as a compiler for a machine of two pipes orders
/// them.
const LOAD_AHEAD: u64 = 2;

/// How a loop stores its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Store {
    /// The loop stores nothing: it adds its result up in a register.
    No,
    /// The loop stores to an array of its own, with ordinary stores.
    Ordinary,
    /// The loop stores over the first array that it read, with ordinary stores.
    InPlace,
    /// The loop stores to an array of its own, with stores that do not read the line first.
    Streaming,
}

/// Software prefetch: how many lines ahead, as a compiler would put it into the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Prefetch {
    /// The loop prefetches nothing.
    No,
    /// The loop prefetches into L1 only.
    L1 {
        /// Lines ahead of the use that a line is asked for.
        ahead: u32,
    },
    /// The loop prefetches into L2, and later into L1.
    Both {
        /// Lines ahead of the use that a line is asked for in L2.
        l2_ahead: u32,
        /// Lines ahead of the use that a line is asked for in L1.
        l1_ahead: u32,
    },
}

/// Where the threads' parts of the arrays lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Arrays {
    /// Each array has so many bytes, of which every thread has its part, one behind the other; it works on the first
    /// lines of that.
    Split {
        /// Bytes of each array.
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
    /// How the loop stores its result.
    pub store: Store,
    /// How far ahead the loop prefetches.
    pub prefetch: Prefetch,
    /// Where the threads' parts of the arrays lie.
    pub arrays: Arrays,
    /// The threads that run the loop.
    pub threads: Threads,
    /// Lines of each array that each pass works on.
    pub extent: Extent,
}

/// Lines of each array that a thread works on, in multiples of 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Extent {
    /// Every pass works on the same lines, over and over.
    Laps {
        /// Lines of a lap, of which one goes before the measured passes.
        lines: u32,
        /// Laps of the long pass, a multiple of 4.
        laps: u32,
    },
    /// Every pass works on lines that no pass before has worked on.
    Onward {
        /// Lines before the measured passes.
        warm_lines: u32,
        /// Lines of the long pass, a multiple of 32.
        lines: u32,
    },
}

/// First line, lines a lap and laps of a pass.
#[derive(Debug, Clone, Copy)]
struct Part {
    first: u32,
    lines: u32,
    laps: u32,
}

impl Extent {
    /// Lines that a thread works on in all passes together.
    pub fn lines_worked(self) -> u32 {
        self.parts().iter().map(|part| part.lines * part.laps).sum()
    }

    /// The warm, the short and the long pass.
    fn parts(self) -> [Part; 3] {
        match self {
            Extent::Laps { lines, laps } => {
                [1, short(laps, 1), laps].map(|laps| Part { first: 0, lines, laps })
            }
            Extent::Onward { warm_lines, lines } => {
                let few = short(lines, UNROLL as u32);
                [(0, warm_lines), (warm_lines, few), (warm_lines + few, lines)].map(|(first, lines)| Part {
                    first,
                    lines,
                    laps: 1,
                })
            }
        }
    }
}

impl Stream {
    /// Lines of each array between two branches.
    pub const UNROLL: u32 = UNROLL as u32;
    /// Uops of a turn of the loop that touch no line: two to count, a compare and a branch.
    pub const LOOP_UOPS: u32 = 4;

    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        let count = self.threads.count();
        let parts = self.extent.parts();
        let [_, few, many] = parts;
        let extent = many.first + many.lines;
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
            arena.overwritten(words);
        }
        let mut placement_from =
            |line: u32| self.threads.place(&mut arena, cores, |rank| rank * part_words + line * LINE_WORDS);
        // Where the passes start at one place they share the table, and all but the first find it cached.
        let mut placement = placement_from(parts[0].first);
        let mut passes = Vec::new();
        let mut last = parts[0].first;
        for (name, part) in ["warm", "short", "stream"].into_iter().zip(parts) {
            if part.first != last {
                (placement, last) = (placement_from(part.first), part.first);
            }
            passes.push(self.pass(name, &placement, bases, part));
        }
        let lines_touched = self.reads + u32::from(self.store != Store::No);
        let lines = many.lines * many.laps - few.lines * few.laps;
        let units = 64 * u64::from(lines_touched) * u64::from(lines) * u64::from(count);
        Prepared { arena, passes, units }
    }

    fn pass(&self, name: &'static str, placement: &Placement, bases: [Addr; 3], part: Part) -> Step {
        let lines = part.lines;
        assert!(lines > 0 && u64::from(lines).is_multiple_of(UNROLL), "{lines} lines");
        let turns = (u64::from(lines) / UNROLL) as i32;
        let laps = part.laps as i32;
        let table = placement.table();
        // One kernel a shape, so that what a loop does not do is not in it.
        macro_rules! shape {
            ($reads:literal, $store:ident) => {{
                let prefetch = self.prefetch;
                let kernel = Loop::<$reads, { Store::$store as u8 }> { table, bases, turns, laps, prefetch };
                pass(name, placement.tasks, kernel)
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
    /// Turns of the loop in a lap.
    turns: i32,
    laps: i32,
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

    /// The value that the loop makes of the lines it read, one of each array.
    #[inline(always)]
    fn compute<V: Vpu>(
        &self,
        v: &mut V,
        factor: V::F32,
        sum: &mut V::F32,
        operands: [V::F32; READS],
    ) -> V::F32 {
        match operands[..] {
            [] => factor,
            [a] if self.output().is_none() => {
                *sum = v.vadd(*sum, a);
                *sum
            }
            [a] => v.vmul(a, factor),
            [a, b, ..] => v.vmadd(a, factor, b),
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
        let Some(first) = start(v, self.table, task) else { return };
        let factor = v.vset_f32(0.5);
        let factor_bits = v.bits_of(factor);
        let all = v.mask_all();
        let step = v.s_imm((UNROLL * u64::from(LINE_WORDS)) as i32);
        let mut laps_left = v.s_imm(self.laps);
        let mut sums = [factor; UNROLL as usize];
        loop {
            let (mut index, mut left) = (first, v.s_imm(self.turns));
            // The first lines have nothing before them to issue beside.
            let mut operands = [[factor; READS]; LOAD_AHEAD as usize];
            for (line, operands) in (0..).zip(&mut operands) {
                self.prefetch_line(v, line, index);
                for (operand, base) in operands.iter_mut().zip(self.bases) {
                    *operand = v.vload_f32(base.plus(64 * line), index);
                }
            }
            let mut result = self.compute(v, factor, &mut sums[0], operands[0]);
            for (operand, base) in operands[0].iter_mut().zip(self.bases) {
                *operand = v.vload_f32(base.plus(64 * LOAD_AHEAD), index);
            }
            for turn in 0..self.turns {
                // The last turn is peeled off: nothing is loaded past the end.
                let is_last = turn + 1 == self.turns;
                for line in 0..UNROLL {
                    let (loaded, computed) = (line + LOAD_AHEAD + 1, line + 1);
                    let slot = &mut operands[(computed % LOAD_AHEAD) as usize];
                    let (has_load, has_result) = (!is_last || loaded < UNROLL, !is_last || computed < UNROLL);
                    let ready = *slot;
                    // A load beside the arithmetic of an earlier line, the next beside the store of one before that.
                    if has_load {
                        self.prefetch_line(v, loaded, index);
                    }
                    if has_load && READS > 0 {
                        slot[0] = v.vload_f32(self.bases[0].plus(64 * loaded), index);
                    }
                    let stored = result;
                    if has_result {
                        let sum = &mut sums[(computed % UNROLL) as usize];
                        result = self.compute(v, factor, sum, ready);
                    }
                    if has_load && READS > 1 {
                        slot[1] = v.vload_f32(self.bases[1].plus(64 * loaded), index);
                    }
                    if let Some(output) = self.output() {
                        let at = output.plus(64 * line);
                        if Self::STREAMING {
                            let bits = if READS == 0 { factor_bits } else { v.bits_of(stored) };
                            v.vstore_stream(at, index, bits);
                        } else {
                            v.vstore_f32(all, at, index, stored);
                        }
                    }
                }
                index = v.s_add(index, step);
                let goes_on = again(v, &mut left);
                debug_assert_eq!(goes_on, !is_last, "the simulated loop counts as the host's does");
            }
            if !again(v, &mut laps_left) {
                return;
            }
        }
    }
}
