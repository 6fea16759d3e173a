//! When a step is over whose chunks go to whichever thread is free first.

use crate::Cycle;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Cycles until the last of `threads` threads is done with chunks of `durations` cycles, each given to the first that is free.
pub(super) fn makespan(durations: impl Iterator<Item = Cycle>, threads: usize) -> Cycle {
    let mut free: BinaryHeap<Reverse<Cycle>> = std::iter::repeat_n(Reverse(0), threads).collect();
    let mut last = 0;
    for duration in durations {
        let Reverse(at) = free.pop().expect("a thread");
        let done = at + duration;
        last = last.max(done);
        free.push(Reverse(done));
    }
    last
}
