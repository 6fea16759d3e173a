//! Misses in flight.

use super::tags::{GROUP, NO_LINE, equal_ways};
use crate::Cycle;
use crate::when::When;

/// One miss in flight.
#[derive(Debug, Clone, Copy)]
struct Mshr {
    /// When the line arrives.
    fill: When,
    /// When the MSHR is free again: then, or when the line that made room has been written back.
    free: Cycle,
}

/// The MSHRs of one cache. They free themselves as time passes.
#[derive(Debug, Clone)]
pub(crate) struct Mshrs {
    table: Vec<Mshr>,
    /// The line of each, in groups for the search.
    lines: Vec<[u32; GROUP]>,
}

impl Mshrs {
    pub(crate) fn new(count: u32) -> Mshrs {
        let count = count as usize;
        Mshrs {
            table: vec![Mshr { fill: When::ZERO, free: 0 }; count],
            lines: vec![[NO_LINE; GROUP]; count.div_ceil(GROUP)],
        }
    }

    /// When `line` arrives, if it is still under way at `now`. Of several times the last: the line was lost to another core
    /// before those before it had arrived.
    #[inline]
    pub(crate) fn in_flight(&self, line: u32, now: Cycle) -> Option<When> {
        let mut last = When::ZERO;
        for (group, lines) in self.lines.iter().enumerate() {
            let mut equal = equal_ways(lines, line);
            while equal != 0 {
                last = last.max(self.table[group * GROUP + equal.trailing_zeros() as usize].fill);
                equal &= equal - 1;
            }
        }
        (last.at() > now).then_some(last)
    }

    /// The place of one that is free at `now`; `Err` is the time when one will be. The first of them: requests that are timed
    /// late for an early time then find others that nobody has held yet.
    #[inline]
    pub(crate) fn free(&self, now: Cycle) -> Result<usize, Cycle> {
        let mut earliest = Cycle::MAX;
        for (place, mshr) in self.table.iter().enumerate() {
            if mshr.free <= now {
                return Ok(place);
            }
            earliest = earliest.min(mshr.free);
        }
        Err(earliest)
    }

    /// Whether more than `spared` are free at `now`.
    pub(crate) fn has_more_than(&self, spared: usize, now: Cycle) -> bool {
        self.table.iter().filter(|mshr| mshr.free <= now).nth(spared).is_some()
    }

    /// Takes the one at `place`, where [`Mshrs::free`] found one free, until `line` arrives, and until `free` if that is later.
    #[inline]
    pub(crate) fn hold(&mut self, place: usize, line: u32, fill: When, free: Cycle) {
        self.table[place] = Mshr { fill, free: free.max(fill.at()) };
        self.lines[place / GROUP][place % GROUP] = line;
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
