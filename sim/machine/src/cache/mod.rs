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
//! Timing only: bytes live in the arena. A request that leaves the core is answered by the uncore ([`crate::coherence`]).

mod access;
mod l2;
mod locks;
mod mshr;
mod ports;
mod prefetcher;
mod tags;
mod tlb;

#[cfg(test)]
mod tests;

pub(crate) use access::{Access, AccessRules, Again, hit};
pub(crate) use locks::Locks;
pub(crate) use mshr::Mshrs;
pub(crate) use ports::{PORTS_MAX, Ports, WINDOW_MAX};
pub(crate) use prefetcher::Prefetcher;
pub(crate) use tags::{Slot, Tags};
pub(crate) use tlb::Tlb;

use crate::Cycle;
use crate::config::MachineSpec;
use crate::counters::CacheCounters;
use crate::exchange::{Claim, Request};
use crate::occupancy::Slots;

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
#[derive(Debug, Clone, PartialEq)]
#[repr(C)]
pub(crate) struct CoreCaches {
    /// What leaves the core with the end of its window, or of the cycle: beside what else others look at of a core.
    pub(crate) outbox: Vec<Request>,
    pub(crate) l1: Tags,
    pub(crate) l2: Tags,
    pub(crate) l1_mshrs: Mshrs,
    pub(crate) l2_mshrs: Mshrs,
    /// Follows nothing on a machine without one.
    prefetcher: Prefetcher,
    /// Asked only on a machine that translates.
    tlb: Tlb,
    pub(crate) locks: Locks,
    pub(crate) ports: Ports,
    /// When the lines of gathers and scatters are handed on.
    pub(crate) gather_lines: Slots,
    /// Requests on their way for lines that an earlier one was on its way for.
    doubles: u32,
    /// What other cores have claimed and is not due yet, in the order in which it was served, and when the first is due.
    claims: Vec<Claim>,
    next_claim: Cycle,
    pub(crate) l1_counters: CacheCounters,
    pub(crate) l2_counters: CacheCounters,
    /// A defect to be seeded.
    #[cfg(test)]
    pub(crate) fault: Option<crate::coherence::Fault>,
}

impl CoreCaches {
    /// Empty caches.
    pub(crate) fn new(spec: &MachineSpec) -> CoreCaches {
        CoreCaches {
            l1: Tags::new(spec.l1d.sets, spec.l1d.ways),
            l2: Tags::new(spec.l2.sets, spec.l2.ways),
            l1_mshrs: Mshrs::new(spec.l1d.mshrs),
            l2_mshrs: Mshrs::new(spec.l2.mshrs),
            prefetcher: Prefetcher::new(spec.prefetcher.as_ref()),
            tlb: Tlb::new(spec.tlb.as_ref()),
            locks: Locks::default(),
            ports: Ports::new(spec.core.l1_accesses_per_cycle),
            gather_lines: Slots::new(spec.core.gather_interval_x256),
            doubles: 0,
            claims: Vec::new(),
            next_claim: Cycle::MAX,
            outbox: Vec::new(),
            l1_counters: CacheCounters::default(),
            l2_counters: CacheCounters::default(),
            #[cfg(test)]
            fault: None,
        }
    }
}
