//! Prefix sums: the middle of count → scan → fill.
//!
//! ```text
//! step 1  scan blocks   each task: running sums of one block in place, its total to `totals`
//! step 2  scan totals   one task: running sums of the totals
//! step 3  scan offsets  each task: adds the total of all earlier blocks to one block
//! ```
//!
//! Sums are exclusive: word `i` becomes the sum of the words before it, and the word after the last holds the total.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu};

use crate::expression::{int, scalar};

/// Number of words of a block.
const BLOCK: u32 = 1024;

/// An array that is scanned in place, and the totals of its blocks.
#[derive(Debug, Clone, Copy)]
pub struct Scan {
    words: Addr,
    totals: Addr,
    blocks: u32,
}

/// Words to allocate for an array of `count` words that is to be scanned: whole blocks, and room for the total. What the
/// surplus holds does not matter.
pub fn padded(count: u64) -> u64 {
    (count + 1).next_multiple_of(u64::from(BLOCK))
}

impl Scan {
    /// Prepares the scan of `count` words at `words`, an array of [`padded`] words.
    pub fn new(arena: &mut Arena, words: Addr, count: u64) -> Scan {
        let blocks = (padded(count) / u64::from(BLOCK)) as u32;
        Scan { words, totals: arena.overwritten(padded(u64::from(blocks))), blocks }
    }

    /// Scans the array: word `i` becomes the sum of the words before it.
    pub fn run(self, runner: &mut Runner<'_>) -> Result<(), Stopped> {
        runner.run(&self.scan_blocks())?;
        runner.run(&self.scan_totals())?;
        runner.run(&self.add_offsets())
    }

    fn scan_blocks(self) -> Step {
        let kernel = ScanBlock { words: self.words, totals: self.totals, count: BLOCK };
        // SAFETY: each task writes the words of its own block and its own total.
        unsafe { Step::independent("scan blocks", self.blocks, kernel) }
    }

    fn scan_totals(self) -> Step {
        let count = self.blocks.next_multiple_of(16);
        let after = self.totals.plus_words(u64::from(count));
        Step::ordered("scan totals", 1, ScanBlock { words: self.totals, totals: after, count })
    }

    fn add_offsets(self) -> Step {
        let kernel = AddOffset { words: self.words, totals: self.totals };
        // SAFETY: each task writes the words of its own block; totals are only read.
        unsafe { Step::independent("scan offsets", self.blocks, kernel) }
    }
}

/// Scans `count` words of block `task` in place and stores their sum in `totals[task]`.
struct ScanBlock {
    words: Addr,
    totals: Addr,
    count: u32,
}

impl Kernel for ScanBlock {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let start = scalar!(v, task * { self.count as i32 });
        let end = scalar!(v, start + { self.count as i32 });
        let all = v.mask_all();
        let zero = v.vset_i32(0);
        let lane = v.viota();
        let last = v.vset_i32(15);
        let mut carry = zero;
        let mut i = start;
        while v.branch(Compare::Less, i, end) {
            let words = v.vload_i32(self.words, i);
            let sums = running_sums(v, words, lane, zero);
            let inclusive = int!(v, sums + carry);
            let exclusive = int!(v, inclusive - words);
            v.vstore_i32(all, self.words, i, exclusive);
            carry = v.vpermute(inclusive, last);
            i = scalar!(v, i + 16);
        }
        let total = v.vextract(carry, 0);
        v.s_store(self.totals, task, total);
    }
}

/// Sums of each lane of `words` and those below it. `lane`: numbers of the lanes; `zero`: 0 in each.
#[inline(always)]
pub(crate) fn running_sums<V: Vpu>(v: &mut V, words: V::I32, lane: V::I32, zero: V::I32) -> V::I32 {
    // By doubling: lane i adds lane i - 1, - 2, - 4, - 8.
    let sums = add_from(v, words, lane, 1, zero);
    let sums = add_from(v, sums, lane, 2, zero);
    let sums = add_from(v, sums, lane, 4, zero);
    add_from(v, sums, lane, 8, zero)
}

/// Adds to each lane of `sums` the one `distance` lanes before it, if there is one.
#[inline(always)]
fn add_from<V: Vpu>(v: &mut V, sums: V::I32, lane: V::I32, distance: i32, zero: V::I32) -> V::I32 {
    let distance = v.vset_i32(distance);
    let from = int!(v, lane - distance);
    let has = v.vicmp_ge(from, zero);
    let moved = v.vpermute(sums, from);
    v.viadd_or(sums, has, sums, moved)
}

/// Adds `totals[task]` to block `task`.
struct AddOffset {
    words: Addr,
    totals: Addr,
}

impl Kernel for AddOffset {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let start = scalar!(v, task * { BLOCK as i32 });
        let end = scalar!(v, start + { BLOCK as i32 });
        let all = v.mask_all();
        let offset = v.vbroadcast_i32(self.totals, task);
        let mut i = start;
        while v.branch(Compare::Less, i, end) {
            let words = v.vload_i32(self.words, i);
            let words = int!(v, words + offset);
            v.vstore_i32(all, self.words, i, words);
            i = scalar!(v, i + 16);
        }
    }
}
