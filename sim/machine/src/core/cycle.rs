//! Issue cycle by cycle: how `cycle` runs a core.

use super::{Core, CoreTables, State};
use crate::Cycle;
use crate::when::When;

impl Core {
    /// Looks at what the uncore has said, and does what can be done in the cycle `now`: every thread goes on with what is no
    /// issue, and the next in turn that can issues.
    pub(crate) fn run_cycle(&mut self, tables: &CoreTables, now: Cycle) {
        self.read_inbox(tables, now, now);
        if self.wake > now {
            return;
        }
        let end = now + 1;
        self.shared.caches.ports.begin(now);
        let count = self.threads.len();
        let mut chosen = None;
        for offset in 1..=count {
            let index = (self.turn + offset) % count;
            let thread = &mut self.threads[index];
            while thread.next.at() <= now && thread.state != State::Running {
                thread.act(tables, &mut self.shared, end);
            }
            if thread.next.at() <= now && chosen.is_none() {
                chosen = Some(index);
            }
        }
        if let Some(index) = chosen {
            let thread = &mut self.threads[index];
            self.stack.issue(now, thread.next);
            let (mut pc, mut row) = (thread.pc, thread.row);
            let (Ok(next) | Err(next)) =
                thread.issue(tables, &mut self.shared, When::bare(now), end, &mut pc, &mut row);
            (thread.pc, thread.next, thread.row) = (pc, next, row);
            thread.stop_issuing();
            self.turn = index;
        }
        self.update_wake();
        // One issue a cycle: threads that are ready now go on in the next.
        self.wake = self.wake.max(end);
    }
}
