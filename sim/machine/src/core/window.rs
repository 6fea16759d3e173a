//! Issue of a window at once.
//!
//! Each thread in turn takes free issue slots at or after the time it can go on; the turn moves on with every window. What
//! the threads lose by not being interleaved inside a window they gain in the next.

use super::{Core, CoreTables, Shared, State, Thread};
use crate::Cycle;
use crate::cache::WINDOW_MAX;
use crate::when::When;
use std::num::NonZeroU64;

/// A window under way.
struct Window {
    start: Cycle,
    end: Cycle,
    /// Issue slots that are left, a bit a cycle; none from the end on.
    free: u64,
    causes: [u8; WINDOW_MAX as usize],
}

impl Core {
    /// Looks at what the uncore has said, and issues what fits in the window from `start` to before `end`.
    #[inline(never)]
    pub(crate) fn run_window(&mut self, tables: &CoreTables, start: Cycle, end: Cycle) {
        // What others claim in the first half of the window goes at its beginning, what they claim later with the next: half a
        // window too early or too late at most, and as often one as the other.
        self.read_inbox(tables, start, start + (end - start) / 2);
        if self.wake >= end {
            return;
        }
        self.shared.caches.ports.begin(start);
        let slots = u64::MAX >> (WINDOW_MAX - (end - start));
        let mut window = Window { start, end, free: slots, causes: [0; WINDOW_MAX as usize] };
        let count = self.threads.len();
        for offset in 0..count {
            let thread = &mut self.threads[wrapped(self.turn + offset, count)];
            thread.run_in(tables, &mut self.shared, &mut window);
        }
        self.turn = wrapped(self.turn + 1, count);

        // Account the runs of issues and the gaps before them.
        let mut left = slots & !window.free;
        while left != 0 {
            let first = left.trailing_zeros();
            let run = (left >> first).trailing_ones();
            let cause = window.causes[first as usize];
            self.stack.issue_run(window.start + u64::from(first), u64::from(run), cause);
            left = if first + run == 64 { 0 } else { left & (u64::MAX << (first + run)) };
        }
        self.update_wake();
        self.wake = self.wake.max(end);
    }
}

impl Thread {
    /// Does what it can before the end of a window.
    #[inline(always)]
    fn run_in(&mut self, tables: &CoreTables, shared: &mut Shared, window: &mut Window) {
        let end = When::bare(window.end);
        while self.next < end {
            if self.state != State::Running {
                self.act(tables, shared, window.end);
            } else if self.issue_in(tables, shared, window) {
                break;
            }
        }
    }

    /// Issues in the free slots of a window; returns whether none is left for it.
    #[inline(always)]
    fn issue_in(&mut self, tables: &CoreTables, shared: &mut Shared, window: &mut Window) -> bool {
        let (start, end) = (When::bare(window.start), When::bare(window.end));
        let (mut pc, mut next, mut free) = (self.pc, self.next, window.free);
        let mut row = self.row;
        let mut full = false;
        // When the next slot may be: only the first issue can be due before the window. From here to there goes what the host
        // waits for, uop after uop, so that every step counts.
        let mut from = next.max(start);
        // The stream has a uop at `pc`: else the thread would not run.
        while next < end {
            let earliest = from.at() - window.start;
            let Some(left) = NonZeroU64::new(free >> earliest) else {
                full = true;
                break;
            };
            let wait = u64::from(left.trailing_zeros());
            let slot = earliest + wait;
            free &= !(1 << slot);
            window.causes[slot as usize % WINDOW_MAX as usize] = next.cause_index();
            let now = from.bare_and_later(wait);
            match self.issue(tables, shared, now, window.end, &mut pc, &mut row) {
                Ok(go_on) => (next, from) = (go_on, go_on),
                Err(held) => {
                    next = held;
                    break;
                }
            }
        }
        (self.pc, self.next, self.row, window.free) = (pc, next, row, free);
        self.stop_issuing();
        full
    }
}

/// `index mod count`, for an index below twice the count: without the host's slow division.
#[inline(always)]
fn wrapped(index: usize, count: usize) -> usize {
    if index >= count { index - count } else { index }
}
