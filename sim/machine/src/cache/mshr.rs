//! Misses in flight.

use crate::Cycle;
use crate::counters::Cause;

/// One miss in flight.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mshr {
    pub(crate) line: u32,
    /// When the line arrives; the MSHR is free from then on.
    pub(crate) fill: Cycle,
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
        Mshrs { table: vec![Mshr { line: u32::MAX, fill: 0, cause: Cause::L1 }; count as usize] }
    }

    /// The miss that brings `line`, if it is still under way at `now`.
    #[inline]
    pub(crate) fn in_flight(&self, line: u32, now: Cycle) -> Option<Mshr> {
        self.table.iter().find(|mshr| mshr.line == line && mshr.fill > now).copied()
    }

    /// When one is free, at or after `now`.
    #[inline]
    pub(crate) fn free_at(&self, now: Cycle) -> Cycle {
        let mut earliest = Cycle::MAX;
        for mshr in &self.table {
            if mshr.fill <= now {
                return now;
            }
            earliest = earliest.min(mshr.fill);
        }
        earliest
    }

    /// Takes one that is free at `now`.
    ///
    /// # Panics
    /// When none is: the caller did not ask [`Mshrs::free_at`].
    #[inline]
    pub(crate) fn hold(&mut self, line: u32, now: Cycle, fill: Cycle, cause: Cause) {
        let free = self.table.iter_mut().find(|mshr| mshr.fill <= now);
        *free.expect("an MSHR is free: free_at said so") = Mshr { line, fill, cause };
    }

    /// Those under way at `now`, for messages.
    pub(crate) fn occupied(&self, now: Cycle) -> Vec<Mshr> {
        self.table.iter().filter(|mshr| mshr.fill > now).copied().collect()
    }
}
