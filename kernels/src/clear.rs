//! Arrays that begin as zero: counters and sums that tasks add to, and what they look up without having written it.
//!
//! All that a phase needs is cleared by one step, on the machine and in its time. Arrays that their tasks write before they
//! read them need none of it: [`Arena::overwritten`].

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::arena::LINE_BYTES;
use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu};

use crate::columns::task_range;
use crate::expression::scalar;

/// Number of words that a task clears: few lines, since a thread waits for each.
const TASK: u32 = 256;

/// Allocates an array of each of some numbers of words, and clears them all with one step.
pub fn zeroed<const N: usize>(runner: &mut Runner<'_>, words: [u64; N]) -> Result<[Addr; N], Stopped> {
    // The arrays follow one another, so that they are cleared as one.
    let first = Addr(runner.arena.used_bytes());
    let arrays = words.map(|words| Arena::overwritten(runner.arena, words));
    let words = (runner.arena.used_bytes() - first.0) / 4;
    let words = u32::try_from(words).unwrap_or(u32::MAX);
    // SAFETY: each task writes its own words.
    runner.run(&unsafe { Step::independent("clear", words.div_ceil(TASK), Clear { first, words }) })?;
    Ok(arrays)
}

/// Clears `words` words, whole lines, from `first` on.
struct Clear {
    first: Addr,
    words: u32,
}

impl Kernel for Clear {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (first, end) = task_range(v, task, TASK, self.words);
        clear_lines(v, self.first, first, end);
    }
}

/// Clears words `first..end` of the array at `base`, whole lines of it.
#[inline(always)]
pub fn clear_lines<V: Vpu>(v: &mut V, base: Addr, first: V::S32, end: V::S32) {
    let zero = v.vset_i32(0);
    fill_lines(v, base, first, end, zero);
}

/// Fills words `first..end` of the array at `base`, whole lines of it, with `value`.
#[inline(always)]
pub fn fill_lines<V: Vpu>(v: &mut V, base: Addr, first: V::S32, end: V::S32, value: V::I32) {
    let mut i = first;
    while v.branch(Compare::Less, i, end) {
        v.vstore_stream(base, i, value);
        i = scalar!(v, i + { (LINE_BYTES / 4) as i32 });
    }
}
