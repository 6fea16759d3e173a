//! The caches of one core: an L1 that its threads share, and an L2 that includes it.
//!
//! ```text
//! uop ─► L1 tags ──hit──► ready after l1d.hit_cycles
//!           │miss
//!           ▼
//!        L1 MSHRs ──in flight──► ready with that fill
//!           │free one
//!           ▼
//!        L2 tags ──hit──► ready after l2.hit_cycles, counted from the uop
//!           │miss or only readable
//!           ▼
//!        L2 MSHRs ─► home directory (crate::coherence)
//! ```
//!
//! Timing only: bytes live in the arena. The path itself is [`crate::coherence::Hierarchy::access`], since a miss touches
//! other cores' caches; here are the arrays it walks.

mod mshr;
mod prefetcher;
mod tags;
mod tlb;

#[cfg(test)]
mod tests;

pub(crate) use mshr::Mshrs;
pub(crate) use prefetcher::Prefetcher;
pub(crate) use tags::{Slot, Tags};
pub(crate) use tlb::Tlb;

use crate::Cycle;
use crate::config::MachineSpec;
use crate::counters::CacheCounters;

/// What an access wants of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Intent {
    /// To read it.
    Read,
    /// To write parts of it: needs ownership and data.
    Write,
    /// To write all of it: needs ownership only.
    Stream,
}

/// The caches of one core.
#[derive(Debug)]
pub(crate) struct CoreCaches {
    pub(crate) l1: Tags,
    pub(crate) l2: Tags,
    pub(crate) l1_mshrs: Mshrs,
    pub(crate) l2_mshrs: Mshrs,
    /// Follows nothing on a machine without one.
    pub(crate) prefetcher: Prefetcher,
    /// Asked only on a machine that translates.
    pub(crate) tlb: Tlb,
    /// Lines that locked operations of this core last used, and when the last of them ends.
    locks: [(u32, Cycle); 8],
    pub(crate) l1_counters: CacheCounters,
    pub(crate) l2_counters: CacheCounters,
}

impl CoreCaches {
    /// Caches that hold nothing and take no memory: of a core that has not run yet.
    pub(crate) fn absent() -> CoreCaches {
        CoreCaches {
            l1: Tags::absent(),
            l2: Tags::absent(),
            l1_mshrs: Mshrs::new(0),
            l2_mshrs: Mshrs::new(0),
            prefetcher: Prefetcher::new(None),
            tlb: Tlb::new(None),
            locks: [(u32::MAX, 0); 8],
            l1_counters: CacheCounters::default(),
            l2_counters: CacheCounters::default(),
        }
    }

    /// Makes the arrays of a core that is about to run for the first time.
    pub(crate) fn power_up(&mut self, spec: &MachineSpec) {
        if self.l1.is_absent() {
            self.l1 = Tags::new(spec.l1d.sets, spec.l1d.ways);
            self.l2 = Tags::new(spec.l2.sets, spec.l2.ways);
            self.l1_mshrs = Mshrs::new(spec.l1d.mshrs);
            self.l2_mshrs = Mshrs::new(spec.l2.mshrs);
            self.prefetcher = Prefetcher::new(spec.prefetcher.as_ref());
            self.tlb = Tlb::new(spec.tlb.as_ref());
        }
    }

    /// Holds the owned `line` for a locked operation that may start at `now`; returns when it ends.
    pub(crate) fn lock(&mut self, line: u32, now: Cycle, cycles: Cycle) -> Cycle {
        let lock = &mut self.locks[line as usize % 8];
        let start = if lock.0 == line { now.max(lock.1) } else { now };
        *lock = (line, start + cycles);
        start + cycles
    }
}
