//! Times that know what they were spent on.

use crate::Cycle;
use crate::counters::Cause;

/// A time and what it was spent on, in one word that compares by time first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct When(u64);

impl When {
    /// No later than any time.
    pub(crate) const ZERO: When = When(0);
    pub(crate) const NEVER: When = When(u64::MAX >> 1);

    #[inline(always)]
    pub(crate) const fn new(at: Cycle, cause: Cause) -> When {
        When(at << 4 | cause as u64)
    }

    /// The beginning of a cycle: no later than any time in it.
    #[inline(always)]
    pub(crate) const fn bare(at: Cycle) -> When {
        When(at << 4)
    }

    /// A bare time, one cycle later.
    #[inline(always)]
    pub(crate) const fn next_cycle(self) -> When {
        When(self.0 + 16)
    }

    /// The beginning of the cycle of this time, so many cycles later.
    #[inline(always)]
    pub(crate) const fn bare_and_later(self, cycles: Cycle) -> When {
        When((self.0 & !15) + (cycles << 4))
    }

    /// A bare time, later by `span`.
    #[inline(always)]
    pub(crate) const fn plus(self, span: Span) -> When {
        When(self.0 + span.0)
    }

    /// The time `at` if that is later, with the cause that this has.
    #[inline(always)]
    pub(crate) fn not_before(self, at: Cycle) -> When {
        When(self.0.max(at << 4 | self.0 & 15))
    }

    #[inline(always)]
    pub(crate) const fn at(self) -> Cycle {
        self.0 >> 4
    }

    /// The cause's place in [`Cause::ALL`].
    #[inline(always)]
    pub(crate) const fn cause_index(self) -> u8 {
        (self.0 & 15) as u8
    }
}

/// What to add to the beginning of a cycle (see [`When::bare`]) for a time so many cycles later, and its cause.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span(u64);

impl Span {
    #[inline(always)]
    pub(crate) const fn new(cycles: Cycle, cause: Cause) -> Span {
        Span(When::new(cycles, cause).0)
    }

    /// From the bits of [`Span::bits`].
    #[inline(always)]
    pub(crate) const fn from_bits(bits: u64) -> Span {
        Span(bits)
    }

    #[inline(always)]
    pub(crate) const fn bits(self) -> u64 {
        self.0
    }

    #[inline(always)]
    pub(crate) const fn cycles(self) -> Cycle {
        When(self.0).at()
    }
}
