//! Issue of 64 cycles at once.
//!
//! Each thread in turn takes free issue slots at or after the time it can go on; the turn moves on with every window. What
//! the threads lose by not being interleaved inside a window they gain in the next.

use super::{Core, CoreTables, State, Thread};
use crate::Cycle;
use crate::coherence::Hierarchy;
use crate::when::When;

/// Cycles in a window: bits in a word of the host. Half as many are no closer to `cycle` (`cargo bench --bench fidelity`).
pub(crate) const WINDOW: Cycle = 64;

/// A window under way.
pub(crate) struct Window {
    start: Cycle,
    taken: u64,
    causes: [u8; WINDOW as usize],
    /// Which thread, counted from the turn, is to issue.
    offset: usize,
}

impl Window {
    pub(crate) fn new(start: Cycle) -> Window {
        Window { start, taken: 0, causes: [0; WINDOW as usize], offset: 0 }
    }
}

impl Core {
    /// Issues what fits in the window, up to a thread that needs its next stream, which is returned: give it one and call
    /// again. `None` when the window is done.
    #[inline(never)]
    pub(crate) fn run_window(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        window: &mut Window,
    ) -> Option<usize> {
        let count = self.threads.len();
        while window.offset < count {
            let index = wrapped(self.turn + window.offset, count);
            let thread = &mut self.threads[index];
            let before = thread.pc;
            let wants_stream = thread.issue_in(tables, hierarchy, self.index, window);
            self.issued += (thread.pc - before) as u64;
            if wants_stream {
                return Some(index);
            }
            window.offset += 1;
        }
        self.turn = wrapped(self.turn + 1, count);

        // Account the runs of issues and the gaps before them.
        let mut left = window.taken;
        while left != 0 {
            let first = left.trailing_zeros();
            let run = (left >> first).trailing_ones();
            let cause = window.causes[first as usize];
            self.stack.issue_run(window.start + u64::from(first), u64::from(run), cause);
            left = if first + run == 64 { 0 } else { left & (u64::MAX << (first + run)) };
        }
        self.update_wake();
        None
    }
}

impl Thread {
    /// Issues in the free slots of a window; returns whether it stopped because it needs its next stream.
    #[inline(always)]
    fn issue_in(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        window: &mut Window,
    ) -> bool {
        let (start, end) = (When::bare(window.start), When::bare(window.start + WINDOW));
        if self.next >= end {
            return false;
        }
        if self.state != State::Running {
            return true;
        }
        let (mut pc, mut next, mut free) = (self.pc, self.next, !window.taken);
        let mut row = tables.row(&self.stream.uops, pc);
        while next < end && pc < self.stream.uops.len() {
            let earliest = next.max(start).at() - window.start;
            let left = free >> earliest;
            if left == 0 {
                break;
            }
            let slot = earliest + u64::from(left.trailing_zeros());
            free &= !(1 << slot);
            window.causes[slot as usize % WINDOW as usize] = next.cause_index();
            let now = When::bare(window.start + slot);
            next = self.issue::<false>(tables, hierarchy, core, now, &mut pc, &mut row);
        }
        (self.pc, self.next, window.taken) = (pc, next, !free);
        self.note_end();
        self.state == State::Ended && next < end
    }
}

/// `index mod count`, for an index below twice the count: without the host's slow division.
#[inline(always)]
fn wrapped(index: usize, count: usize) -> usize {
    if index >= count { index - count } else { index }
}
