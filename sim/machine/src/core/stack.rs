//! What a core's cycles were spent on.

use crate::Cycle;
use crate::counters::Cause;
use crate::when::When;

/// Cycles by cause, complete up to a cycle.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Stack {
    cycles: [u64; Cause::COUNT],
    /// All cycles before this one are accounted.
    accounted: Cycle,
}

impl Stack {
    /// Starts to account at `now`.
    pub(crate) fn start(&mut self, now: Cycle) {
        *self = Stack { accounted: now, ..Stack::default() };
    }

    /// An issue at `now`; the cycles since the last one went to what the issuing thread waited for.
    #[inline(always)]
    pub(crate) fn issue(&mut self, now: Cycle, waited_for: When) {
        self.cycles[waited_for.cause_index() as usize] += now - self.accounted;
        self.cycles[Cause::Issue as usize] += 1;
        self.accounted = now + 1;
    }

    /// `run` issues from `now` on.
    #[inline(always)]
    pub(super) fn issue_run(&mut self, now: Cycle, run: u64, cause_index: u8) {
        self.cycles[cause_index as usize] += now - self.accounted;
        self.cycles[Cause::Issue as usize] += run;
        self.accounted = now + run;
    }

    /// The cycles up to `until`, if any are left, went to `cause`.
    pub(crate) fn fill(&mut self, until: Cycle, cause: Cause) {
        self.cycles[cause as usize] += until.saturating_sub(self.accounted);
        self.accounted = self.accounted.max(until);
    }

    /// Cycles by cause, in the order of [`Cause::ALL`].
    pub(crate) fn cycles(&self) -> [u64; Cause::COUNT] {
        self.cycles
    }
}
