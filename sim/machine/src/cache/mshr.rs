//! Misses in flight.

use crate::Cycle;
use crate::counters::Cause;

/// One miss in flight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mshr {
    pub(crate) line: u32,
    /// When the line arrives.
    pub(crate) fill: Cycle,
    /// When the MSHR is free again: then, or when the line that made room has been written back.
    pub(crate) free: Cycle,
    /// What that time was spent on.
    pub(crate) cause: Cause,
}

/// The MSHRs of one cache. They free themselves as time passes.
#[derive(Debug, Clone)]
pub(crate) struct Mshrs {
    table: Vec<Mshr>,
}

impl Mshrs {
    pub(crate) fn new(count: u32) -> Mshrs {
        Mshrs { table: vec![Mshr { line: u32::MAX, fill: 0, free: 0, cause: Cause::L1 }; count as usize] }
    }

    /// The miss that brings `line`, if it is still under way at `now`.
    #[inline]
    pub(crate) fn in_flight(&self, line: u32, now: Cycle) -> Option<Mshr> {
        self.table.iter().find(|mshr| mshr.line == line && mshr.fill > now).copied()
    }

    /// The place of one that is free at `now`; `Err` is the time when one will be.
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

    /// Takes the one at `place`, where [`Mshrs::free`] found one free, until `line` arrives.
    #[inline]
    pub(crate) fn hold(&mut self, place: usize, line: u32, fill: Cycle, cause: Cause) {
        self.table[place] = Mshr { line, fill, free: fill, cause };
    }

    /// Keeps the one at `place` until `free`, if that is later.
    #[inline]
    pub(crate) fn keep(&mut self, place: usize, free: Cycle) {
        self.table[place].free = self.table[place].free.max(free);
    }

    /// Those under way at `now`, for messages.
    pub(crate) fn occupied(&self, now: Cycle) -> Vec<Mshr> {
        self.table.iter().filter(|mshr| mshr.free > now).copied().collect()
    }
}
