//! The path of an access, from a uop to the time its line is usable.

use super::{Directory, State};
use crate::Cycle;
use crate::cache::{CoreCaches, Intent, Slot, Tags};
use crate::config::MachineSpec;
use crate::counters::{AtomicCounters, Cause, DirectoryCounters};
use crate::memory::Memory;
use crate::occupancy::Slots;
use crate::ring::Rings;
use crate::when::When;

/// Everything between the cores and the memory chips.
pub(crate) struct Hierarchy {
    pub(crate) spec: MachineSpec,
    /// Whether translation costs anything.
    translates: bool,
    pub(crate) caches: Vec<CoreCaches>,
    pub(super) directory: Directory,
    /// When the slice at each stop serves.
    pub(super) slices: Vec<Slots>,
    pub(crate) rings: Rings,
    pub(crate) memory: Memory,
    /// The core at whose stop each controller is: spread evenly.
    pub(super) controller_stops: Vec<u32>,
    /// Room for the list of cores that a transaction has to ask.
    pub(super) peers: Vec<u32>,
    pub(crate) counters: DirectoryCounters,
    pub(crate) atomics: AtomicCounters,
    #[cfg(test)]
    pub(super) fault: Option<super::Fault>,
}

/// What became of an access.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Access {
    /// When the line is usable, and what the time was spent on.
    pub(crate) ready: When,
    /// Whether the L1 did not have it ready.
    pub(crate) missed: bool,
}

/// What became of an access to the L2.
pub(super) struct L2Access {
    /// When the line is usable, and what the time was spent on.
    pub(super) ready: When,
    /// Whether the core may write the line from then on.
    pub(super) owned: bool,
    /// Whether the L2 neither had the line nor waited for it.
    pub(super) missed: bool,
    /// When the line that made room has been written back; 0 when nobody waits for that.
    pub(super) written_back: Cycle,
}

impl Hierarchy {
    /// Cold and idle; with rings that know every slot (`exact`) or count them in windows.
    pub(crate) fn new(spec: &MachineSpec, exact: bool) -> Hierarchy {
        Hierarchy {
            translates: spec.tlb.is_some() && !spec.ideal.memory,
            caches: (0..spec.cores).map(|_| CoreCaches::absent()).collect(),
            directory: Directory::default(),
            slices: vec![Slots::new(spec.directory_interval * 256); spec.cores as usize],
            rings: Rings::new(spec, exact),
            memory: Memory::new(&spec.memory),
            controller_stops: (0..spec.memory.controllers)
                .map(|controller| {
                    (u64::from(controller) * u64::from(spec.cores) / u64::from(spec.memory.controllers))
                        as u32
                })
                .collect(),
            peers: Vec::new(),
            counters: DirectoryCounters::default(),
            atomics: AtomicCounters::default(),
            #[cfg(test)]
            fault: None,
            spec: spec.clone(),
        }
    }

    /// A hit in L1, the common case. `Err` when it is anything else: where the line lies, if it is there; then nothing has
    /// changed.
    #[inline(always)]
    pub(crate) fn l1_hit(&mut self, core: usize, line: u32, write: bool) -> Result<(), Option<Slot>> {
        let caches = &mut self.caches[core];
        if self.translates && !caches.tlb.hit(line) {
            return Err(None);
        }
        let (mask, wanted, bits) = if write {
            (Tags::WRITABLE | Tags::PENDING, Tags::WRITABLE, Tags::DIRTY)
        } else {
            (Tags::PENDING, 0, 0)
        };
        caches.l1.use_if(line, mask, wanted, bits)?;
        caches.l1_counters.hits += 1;
        Ok(())
    }

    /// An access of `core` to `line` at `now`; `Err` is the time to ask again, when all MSHRs that it needs are taken, and
    /// then nothing has changed.
    #[inline(always)]
    pub(crate) fn access(
        &mut self,
        core: usize,
        line: u32,
        intent: Intent,
        now: Cycle,
    ) -> Result<Access, Cycle> {
        match self.l1_hit(core, line, intent != Intent::Read) {
            Ok(()) => Ok(self.hit(now)),
            Err(slot) => self.access_beyond_hit(core, line, slot, intent, now),
        }
    }

    /// A hit in L1 at `now`.
    #[inline(always)]
    pub(crate) fn hit(&self, now: Cycle) -> Access {
        Access { ready: When::new(now + self.spec.l1d.hit_cycles, Cause::L1), missed: false }
    }

    /// An access that [`Hierarchy::l1_hit`] is not enough for, which found the line in `l1_slot` if at all.
    #[inline(never)]
    pub(crate) fn access_beyond_hit(
        &mut self,
        core: usize,
        line: u32,
        l1_slot: Option<Slot>,
        intent: Intent,
        now: Cycle,
    ) -> Result<Access, Cycle> {
        let write = intent != Intent::Read;
        let (mut l1_slot, mut now) = (l1_slot, now);
        if self.spec.ideal.memory {
            self.caches[core].l1_counters.hits += 1;
            return Ok(self.hit(now));
        }

        // Translate first; it may have been only the TLB that missed.
        if self.translates && !self.caches[core].tlb.hit(line) {
            now += self.caches[core].tlb.translate(line);
            match self.l1_hit(core, line, write) {
                Ok(()) => return Ok(Access { missed: true, ..self.hit(now) }),
                Err(slot) => l1_slot = slot,
            }
        }
        let caches = &mut self.caches[core];

        // On its way: wait for the same fill.
        if let Some(slot) = l1_slot {
            let bits = caches.l1.bits(slot);
            let may = !write || bits & Tags::WRITABLE != 0;
            if bits & Tags::PENDING != 0
                && may
                && let Some(fill) = caches.l1_mshrs.in_flight(line, now)
            {
                caches.use_l1(slot, bits, write);
                caches.l1_counters.merged += 1;
                return Ok(Access { ready: fill.not_before(now + self.spec.l1d.hit_cycles), missed: true });
            }
            let arrived = bits & !Tags::PENDING;
            caches.l1.set_bits(slot, arrived);
            if may {
                // It has arrived since.
                caches.use_l1(slot, arrived, write);
                caches.l1_counters.hits += 1;
                return Ok(self.hit(now));
            }
        }

        // A streaming store that is posted needs nothing of the L1, and nobody waits for it.
        if intent == Intent::Stream && l1_slot.is_none() && self.spec.core.posted_streaming_stores {
            self.l2_access(core, line, intent, now)?;
            self.caches[core].l1_counters.misses += 1;
            return Ok(Access { ready: When::new(now + 1, Cause::L1), missed: false });
        }

        // A miss: every resource it needs must be free before anything changes.
        let mshr = caches.l1_mshrs.free(now)?;
        let L2Access { ready, owned, missed, .. } = self.l2_access(core, line, intent, now)?;
        let caches = &mut self.caches[core];
        caches.l1_counters.misses += 1;
        caches.l1_mshrs.hold(mshr, line, ready, 0);

        // Fill the L1 now; PENDING sends those who come early to the MSHR.
        let mut bits = Tags::PENDING;
        bits |= if owned { Tags::WRITABLE } else { 0 };
        bits |= if write { Tags::DIRTY } else { 0 };
        // The slot is still the line's: making room in the L2 takes other lines only.
        match l1_slot {
            Some(slot) => {
                caches.l1_counters.upgrades += 1;
                caches.l1.set_bits(slot, bits);
                caches.l1.touch(slot);
            }
            None => {
                if let Some((victim, victim_bits)) = caches.l1.insert(caches.l1.place_for(line), line, bits) {
                    caches.l1_counters.evictions += 1;
                    if victim_bits & Tags::DIRTY != 0 {
                        caches.l1_counters.writebacks += 1;
                        caches.mark_modified(victim);
                    }
                }
            }
        }
        if let Some(prefetcher) = &self.spec.prefetcher {
            self.run_ahead(core, line, missed, prefetcher.mshrs_spared, now);
        }
        Ok(Access { ready, missed: true })
    }

    /// Asks the host for what an access to `line` that misses will look at.
    #[inline(always)]
    pub(crate) fn prefetch(&self, core: usize, line: u32) {
        self.directory.prefetch(line);
        self.caches[core].l2.prefetch(line);
    }

    /// Has the streamer see an access to the L2, and fetches what it wants as far as MSHRs go.
    fn run_ahead(&mut self, core: usize, line: u32, missed: bool, mshrs_spared: usize, now: Cycle) {
        let Some(stream) = self.caches[core].prefetcher.observe(line, missed) else { return };
        while let Some(wanted) = self.caches[core].prefetcher.wanted(stream) {
            // Not now, when demands might have to wait for an MSHR; the next access to the stream asks again.
            let caches = &self.caches[core];
            if caches.l2.find(wanted).is_none()
                && (!caches.l2_mshrs.has_more_than(mshrs_spared, now)
                    || self.l2_access(core, wanted, Intent::Read, now).is_err())
            {
                return;
            }
            self.caches[core].prefetcher.advance(stream);
        }
    }

    /// Brings `line` into the L2 and no further.
    pub(crate) fn prefetch_l2(&mut self, core: usize, line: u32, now: Cycle) -> Result<(), Cycle> {
        if self.spec.ideal.memory {
            return Ok(());
        }
        let mut now = now;
        if self.translates && !self.caches[core].tlb.hit(line) {
            now += self.caches[core].tlb.translate(line);
        }
        self.l2_access(core, line, Intent::Read, now).map(|_| ())
    }

    /// An L1 miss or L2 prefetch at `now`, the time of the uop.
    fn l2_access(&mut self, core: usize, line: u32, intent: Intent, now: Cycle) -> Result<L2Access, Cycle> {
        let hit_cycles = self.spec.l2.hit_cycles;
        let caches = &mut self.caches[core];
        let l2_slot = caches.l2.find(line);
        if let Some(slot) = l2_slot {
            let bits = caches.l2.bits(slot);
            let owned = State::from_bits(bits).is_owner();
            if intent == Intent::Read || owned {
                caches.l2.touch(slot);
                if intent != Intent::Read {
                    caches.l2.set_bits(slot, bits | State::M as u8);
                }
                if bits & Tags::PENDING != 0 {
                    if let Some(fill) = caches.l2_mshrs.in_flight(line, now) {
                        caches.l2_counters.merged += 1;
                        let ready = fill.not_before(now + hit_cycles);
                        return Ok(L2Access { ready, owned, missed: false, written_back: 0 });
                    }
                    let bits = caches.l2.bits(slot);
                    caches.l2.set_bits(slot, bits & !Tags::PENDING);
                }
                caches.l2_counters.hits += 1;
                let ready = When::new(now + hit_cycles, Cause::L2);
                return Ok(L2Access { ready, owned, missed: false, written_back: 0 });
            }
        }
        let mshr = caches.l2_mshrs.free(now)?;
        caches.l2_counters.misses += 1;
        // The L2 has to find out that it misses first.
        let access = self.transact(core, line, l2_slot, intent, now + hit_cycles);
        self.caches[core].l2_mshrs.hold(mshr, line, access.ready, access.written_back);
        Ok(access)
    }
}

impl CoreCaches {
    /// Reads or writes the line in `slot` of the L1, which has `bits`.
    #[inline(always)]
    fn use_l1(&mut self, slot: Slot, bits: u8, write: bool) {
        if write {
            self.l1.set_bits(slot, bits | Tags::DIRTY);
        }
        self.l1.touch(slot);
    }

    /// A modified line came down from the L1.
    pub(super) fn mark_modified(&mut self, line: u32) {
        let slot = self.l2.find(line).expect("the L2 includes the L1");
        let bits = self.l2.bits(slot);
        self.l2.set_bits(slot, bits | State::M as u8);
    }
}
