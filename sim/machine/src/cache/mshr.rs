//! Misses in flight.

use super::tags::{GROUP, NO_LINE, Slot, equal_ways};
use crate::Cycle;
use crate::when::When;

/// One miss in flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Mshr {
    /// When the line arrives; [`When::NEVER`] until that is known.
    fill: When,
    /// When the MSHR is free again: with the fill, or when the line that made room has been taken by its controller.
    free: Cycle,
    /// When the line may arrive at the earliest: what is known of `fill` before the answer.
    not_before: Cycle,
    /// The MSHR of the level below that this one waits for.
    below: u16,
    /// Where the line goes.
    slot: Slot,
}

/// The MSHRs of one cache. They free themselves as time passes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Mshrs {
    table: Vec<Mshr>,
    /// The line of each, in groups for the search.
    lines: Vec<[u32; GROUP]>,
    /// Those without an answer yet.
    unanswered: u32,
}

impl Mshrs {
    pub(crate) fn new(count: u32) -> Mshrs {
        let count = count as usize;
        let free = Mshr { fill: When::ZERO, free: 0, not_before: 0, below: 0, slot: Slot::FIRST };
        Mshrs {
            table: vec![free; count],
            lines: vec![[NO_LINE; GROUP]; count.div_ceil(GROUP)],
            unanswered: 0,
        }
    }

    /// Calls `f` with the places that hold `line`, or held it last.
    #[inline(always)]
    fn each_of(&self, line: u32, mut f: impl FnMut(usize, &Mshr)) {
        for (group, lines) in self.lines.iter().enumerate() {
            let mut equal = equal_ways(lines, line);
            while equal != 0 {
                let place = group * GROUP + equal.trailing_zeros() as usize;
                f(place, &self.table[place]);
                equal &= equal - 1;
            }
        }
    }

    /// The MSHR that `line` arrives with, and when, if it is still under way at `now`. Of several the last: the line was lost
    /// to another core before those before it had arrived.
    #[inline]
    pub(crate) fn in_flight(&self, line: u32, now: Cycle) -> Option<(usize, When)> {
        let mut last = (0, When::ZERO);
        self.each_of(line, |place, mshr| {
            if mshr.fill >= last.1 {
                last = (place, mshr.fill);
            }
        });
        (last.1.at() > now).then_some(last)
    }

    /// Whether a fill of `line` is on its way whose time is not known yet.
    #[inline]
    pub(crate) fn awaits(&self, line: u32) -> bool {
        let mut awaits = false;
        if self.unanswered > 0 {
            self.each_of(line, |_, mshr| awaits |= mshr.fill == When::NEVER);
        }
        awaits
    }

    /// The place of one that is free at `now`; `Err` is the time when one will be, [`When::NEVER`]'s when none of them has its
    /// answer. The first of them: requests that are timed late for an early time then find others that nobody has held yet.
    #[inline]
    pub(crate) fn free(&self, now: Cycle) -> Result<usize, Cycle> {
        let mut earliest = Cycle::MAX;
        for (place, mshr) in self.table.iter().enumerate() {
            if mshr.free <= now {
                return Ok(place);
            }
            earliest = earliest.min(mshr.free);
        }
        Err(earliest.min(When::NEVER.at()))
    }

    /// Whether more than `spared` are free at `now`.
    pub(crate) fn has_more_than(&self, spared: usize, now: Cycle) -> bool {
        self.table.iter().filter(|mshr| mshr.free <= now).nth(spared).is_some()
    }

    /// Takes the one at `place`, where [`Mshrs::free`] found one free, until `line` arrives at `fill`.
    #[inline]
    pub(crate) fn hold(&mut self, place: usize, line: u32, fill: When) {
        self.table[place] = Mshr { fill, free: fill.at(), not_before: 0, below: 0, slot: Slot::FIRST };
        self.lines[place / GROUP][place % GROUP] = line;
    }

    /// Takes the one at `place` for `line`, which goes to `slot`, until the answer to MSHR `below` of the level below, but not
    /// before `not_before`.
    #[inline]
    pub(crate) fn ask(&mut self, place: usize, line: u32, slot: Slot, below: u16, not_before: Cycle) {
        let never = When::NEVER;
        self.table[place] = Mshr { fill: never, free: never.at(), not_before, below, slot };
        self.lines[place / GROUP][place % GROUP] = line;
        self.unanswered += 1;
    }

    /// Where the line of the one at `place` goes.
    #[inline]
    pub(crate) fn slot(&self, place: usize) -> Slot {
        self.table[place].slot
    }

    /// The line that the one at `place` holds.
    #[inline]
    pub(crate) fn line(&self, place: usize) -> u32 {
        self.lines[place / GROUP][place % GROUP]
    }

    /// When the line of the one at `place` arrives.
    #[inline]
    pub(crate) fn fill(&self, place: usize) -> When {
        self.table[place].fill
    }

    /// The MSHR of the level below that the one at `place` waits for, if it does.
    #[inline]
    pub(crate) fn below(&self, place: usize) -> u16 {
        self.table[place].below
    }

    /// When the line of the one at `place` arrives at the earliest, before its answer.
    #[inline]
    pub(crate) fn not_before(&self, place: usize) -> Cycle {
        self.table[place].not_before
    }

    /// The line of the one at `place` arrives at `fill`. It stays taken until [`Mshrs::release`] if it is `kept`.
    #[inline]
    pub(crate) fn answer(&mut self, place: usize, fill: When, kept: bool) {
        assert!(self.table[place].fill == When::NEVER, "MSHR {place} is answered twice");
        let mshr = &mut self.table[place];
        mshr.fill = fill;
        mshr.free = if kept { When::NEVER.at() } else { fill.at() };
        self.unanswered -= 1;
    }

    /// The one at `place` is free from `at` on.
    #[inline]
    pub(crate) fn release(&mut self, place: usize, at: Cycle) {
        self.table[place].free = at.max(self.table[place].fill.at());
    }

    /// Answers all that wait for MSHR `below` of the level below; returns whether there was one.
    #[inline]
    pub(crate) fn answer_all(&mut self, below: u16, fill: When) -> bool {
        let before = self.unanswered;
        if before > 0 {
            for mshr in &mut self.table {
                if mshr.fill == When::NEVER && mshr.below == below {
                    mshr.fill = fill.not_before(mshr.not_before);
                    mshr.free = mshr.fill.at();
                    self.unanswered -= 1;
                }
            }
        }
        self.unanswered < before
    }

    /// Those without an answer.
    #[cfg(test)]
    pub(crate) fn unanswered(&self) -> u32 {
        self.unanswered
    }

    /// Those under way at `now`, for messages: their lines, and when they are free.
    pub(crate) fn occupied(&self, now: Cycle) -> Vec<(u32, Cycle)> {
        let lines = self.lines.iter().flatten();
        lines
            .zip(&self.table)
            .filter(|(_, mshr)| mshr.free > now)
            .map(|(line, mshr)| (*line, mshr.free))
            .collect()
    }
}
