//! Issue of 32 cycles at once.
//!
//! Each thread in turn takes free issue slots at or after the time it can go on; the turn moves on with every window. What
//! the threads lose by not being interleaved inside a window they gain in the next.

use super::{Core, CoreTables, State};
use crate::Cycle;
use crate::coherence::Hierarchy;

/// Cycles in a window: half a word of the host. With 64 a short step came out up to 5 % off `cycle`, with 32 within 1 %.
pub(crate) const WINDOW: Cycle = 32;

/// A bit for every slot of a window.
const ALL_SLOTS: u64 = u64::MAX >> (64 - WINDOW);

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
    pub(crate) fn run_window(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        window: &mut Window,
    ) -> Option<usize> {
        let count = self.threads.len();
        let end = window.start + WINDOW;
        let (mut issued, mut cycles) = (0, 0);
        while window.offset < count {
            let index = wrapped(self.turn + window.offset, count);
            let thread = &mut self.threads[index];
            while thread.next.at() < end {
                if thread.state != State::Running {
                    debug_assert!(thread.state == State::Ended);
                    self.note_issues(issued, cycles);
                    return Some(index);
                }
                let earliest = thread.next.at().max(window.start) - window.start;
                let free = !window.taken & ALL_SLOTS & (u64::MAX << earliest);
                if free == 0 {
                    break;
                }
                let slot = free.trailing_zeros();
                window.taken |= 1 << slot;
                window.causes[slot as usize] = thread.next.cause_index();
                issued += thread.issue(tables, hierarchy, self.index, window.start + u64::from(slot));
                cycles += 1;
            }
            window.offset += 1;
        }
        self.note_issues(issued, cycles);
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

    /// Counts uops issued, and the cycles in which they were.
    #[inline(always)]
    fn note_issues(&mut self, uops: u64, cycles: u64) {
        self.issued += uops;
        self.paired += uops - cycles;
    }
}

/// `index mod count`, for an index below twice the count: without the host's slow division.
#[inline(always)]
fn wrapped(index: usize, count: usize) -> usize {
    if index >= count { index - count } else { index }
}
