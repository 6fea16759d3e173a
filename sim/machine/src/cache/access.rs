//! The path of an access through the caches of its core, from a uop to the time its line is usable or to the request that
//! leaves the core.

use super::l2::L2Access;
use super::{CoreCaches, Intent, Slot, Tags};
use crate::Cycle;
use crate::coherence::{Event, State, transition};
use crate::config::MachineSpec;
use crate::counters::Cause;
use crate::exchange::Claim;
use crate::when::When;
use crate::work::{Work, doing};

/// What the path of an access asks of the machine.
#[derive(Debug, Clone)]
pub(crate) struct AccessRules {
    pub(crate) l1_hit_cycles: Cycle,
    pub(super) l2_hit_cycles: Cycle,
    /// Whether translation costs anything.
    translates: bool,
    /// Whether every access is a hit.
    pub(super) ideal: bool,
    posted_streaming_stores: bool,
    /// MSHRs that the prefetcher leaves free; `None` when there is none.
    prefetcher_spares: Option<usize>,
}

impl AccessRules {
    pub(crate) fn new(spec: &MachineSpec) -> AccessRules {
        AccessRules {
            l1_hit_cycles: spec.l1d.hit_cycles,
            l2_hit_cycles: spec.l2.hit_cycles,
            translates: spec.tlb.is_some() && !spec.ideal.memory,
            ideal: spec.ideal.memory,
            posted_streaming_stores: spec.core.posted_streaming_stores,
            prefetcher_spares: spec.prefetcher.as_ref().map(|prefetcher| prefetcher.mshrs_spared),
        }
    }
}

/// What became of an access.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Access {
    /// When the line is usable, and what the time was spent on; [`When::NEVER`] when that is for the uncore to say, which
    /// answers MSHR `mshr` of the L2.
    pub(crate) ready: When,
    /// Whether the L1 did not have it ready.
    pub(crate) missed: bool,
    pub(crate) mshr: u16,
    /// When the line is usable at the earliest, if it is for the uncore to say.
    pub(crate) not_before: Cycle,
}

impl Access {
    #[inline(always)]
    pub(crate) fn known(ready: When, missed: bool) -> Access {
        Access { ready, missed, mshr: 0, not_before: 0 }
    }
}

/// An access that has to be made again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Again {
    /// When; the time of [`When::NEVER`]: with the next answer of the uncore.
    pub(crate) at: Cycle,
    /// What it waits for: a free MSHR, or the translation of its address, which has begun.
    pub(crate) why: Cause,
}

impl Again {
    pub(super) fn mshr(at: Cycle) -> Again {
        Again { at, why: Cause::Mshr }
    }
}

impl CoreCaches {
    /// A hit in L1 at `now`, the common case. `Err` when it is anything else: where the line lies, if it is there; then nothing has
    /// changed.
    #[inline(always)]
    pub(crate) fn l1_hit(
        &mut self,
        rules: &AccessRules,
        line: u32,
        write: bool,
        now: Cycle,
    ) -> Result<(), Option<Slot>> {
        if rules.translates && !self.tlb.hit(line, now) {
            return Err(None);
        }
        let (mask, wanted, bits) = if write {
            (Tags::WRITABLE | Tags::PENDING, Tags::WRITABLE, Tags::DIRTY)
        } else {
            (Tags::PENDING, 0, 0)
        };
        self.l1.use_if(line, mask, wanted, bits)?;
        self.l1_counters.hits += 1;
        Ok(())
    }

    /// An access to `line` at `now`; `Err` says when to make it again, and then nothing has changed but that a translation has
    /// begun.
    #[inline(always)]
    pub(crate) fn access(
        &mut self,
        rules: &AccessRules,
        line: u32,
        intent: Intent,
        now: Cycle,
    ) -> Result<Access, Again> {
        match self.l1_hit(rules, line, intent != Intent::Read, now) {
            Ok(()) => Ok(hit(rules, now)),
            Err(slot) => self.access_beyond_hit(rules, line, slot, intent, now),
        }
    }

    /// An access that [`CoreCaches::l1_hit`] is not enough for, which found the line in `l1_slot` if at all.
    #[inline(never)]
    pub(crate) fn access_beyond_hit(
        &mut self,
        rules: &AccessRules,
        line: u32,
        l1_slot: Option<Slot>,
        intent: Intent,
        now: Cycle,
    ) -> Result<Access, Again> {
        let write = intent != Intent::Read;
        if rules.ideal {
            self.l1_counters.hits += 1;
            return Ok(hit(rules, now));
        }
        let _work = doing(Work::PrivateCaches);
        self.translate(rules, line, now)?;
        // Nobody has looked for it while its address was not translated.
        let l1_slot = if rules.translates { self.l1.find(line) } else { l1_slot };

        if let Some(slot) = l1_slot {
            let bits = self.l1.bits(slot);
            if !write || bits & Tags::WRITABLE != 0 {
                // On its way: wait for the same fill.
                if let Some((place, fill)) = self.l1_mshrs.in_flight(line, now) {
                    self.use_l1(slot, bits, write);
                    self.l1_counters.merged += 1;
                    let earliest = now + rules.l1_hit_cycles;
                    return Ok(Access {
                        ready: fill.not_before(earliest),
                        missed: true,
                        mshr: self.l1_mshrs.below(place),
                        not_before: earliest.max(self.l1_mshrs.not_before(place)),
                    });
                }
                // It has arrived since.
                self.use_l1(slot, bits & !Tags::PENDING, write);
                self.l1_counters.hits += 1;
                return Ok(hit(rules, now));
            }
        }

        // A streaming store that is posted needs nothing of the L1, and nobody waits for it.
        if intent == Intent::Stream && l1_slot.is_none() && rules.posted_streaming_stores {
            self.l2_access(rules, line, intent, now)?;
            self.l1_counters.misses += 1;
            return Ok(Access::known(When::new(now + 1, Cause::L1), false));
        }

        // A miss: every resource it needs must be free before anything changes.
        let l1_mshr = self.l1_mshrs.free(now).map_err(Again::mshr);
        #[cfg(test)]
        if self.fault == Some(crate::coherence::Fault::RefusedWriteClearsPending)
            && let (Err(_), true, Some(slot)) = (l1_mshr, write, l1_slot)
        {
            self.l1.set_bits(slot, self.l1.bits(slot) & !Tags::PENDING);
        }
        let l1_mshr = l1_mshr?;
        let L2Access { ready, owned, missed, mshr } = self.l2_access(rules, line, intent, now)?;
        self.l1_counters.misses += 1;
        let not_before = now + rules.l2_hit_cycles;
        if ready == When::NEVER {
            self.l1_mshrs.ask(l1_mshr, line, Slot::FIRST, mshr, not_before);
        } else {
            self.l1_mshrs.hold(l1_mshr, line, ready);
        }

        // Fill the L1 now; PENDING sends those who come early to the MSHR.
        let mut bits = Tags::PENDING;
        bits |= if owned { Tags::WRITABLE } else { 0 };
        bits |= if write { Tags::DIRTY } else { 0 };
        // The slot is still the line's: making room in the L2 takes other lines only.
        match l1_slot {
            Some(slot) => {
                self.l1_counters.upgrades += 1;
                self.l1.set_bits(slot, bits);
                self.l1.touch(slot);
            }
            None => {
                let place = self.l1.place_for(line).expect("nothing is reserved in an L1");
                if let Some((victim, victim_bits)) = self.l1.insert(place, line, bits) {
                    self.l1_counters.evictions += 1;
                    if victim_bits & Tags::DIRTY != 0 {
                        self.l1_counters.writebacks += 1;
                        self.mark_modified(victim);
                    }
                }
            }
        }
        if let Some(spared) = rules.prefetcher_spares {
            self.run_ahead(rules, line, missed, spared, now);
        }
        Ok(Access { ready, missed: true, mshr, not_before })
    }

    /// Has the address of `line` translated; `Err` when that takes until later.
    #[inline(always)]
    pub(super) fn translate(&mut self, rules: &AccessRules, line: u32, now: Cycle) -> Result<(), Again> {
        if rules.translates && !self.tlb.hit(line, now) {
            let cycles = self.tlb.translate(line, now);
            if cycles > 0 {
                #[cfg(test)]
                if self.fault == Some(crate::coherence::Fault::WrongCause) {
                    return Err(Again { at: now + cycles, why: Cause::L1 });
                }
                return Err(Again { at: now + cycles, why: Cause::Tlb });
            }
        }
        Ok(())
    }

    /// Reads or writes the line in `slot` of the L1, which has `bits`.
    #[inline(always)]
    fn use_l1(&mut self, slot: Slot, bits: u8, write: bool) {
        self.l1.set_bits(slot, if write { bits | Tags::DIRTY } else { bits });
        self.l1.touch(slot);
    }

    /// The line of MSHR `mshr` of the L2 arrives at `fill`. What others claimed of it before concerns the copy before this one.
    pub(crate) fn answer(&mut self, mshr: u16, fill: When, owned: bool, kept: bool) {
        let place = usize::from(mshr);
        let (line, slot) = (self.l2_mshrs.line(place), self.l2_mshrs.slot(place));
        self.l2_mshrs.answer(place, fill, kept);
        let waits = self.l1_mshrs.answer_all(mshr, fill);
        // A line that was asked for twice keeps its place until it has come twice.
        if self.doubles > 0 && self.l2_mshrs.awaits(line) {
            self.doubles -= 1;
        } else {
            self.l2.release(slot);
        }
        debug_assert_eq!(self.l2.line_at(slot), Some(line), "no fill loses its place");
        let bits = self.l2.bits(slot);
        if owned && State::from_bits(bits) == State::S {
            // Read, and nobody else has it.
            self.l2.set_bits(slot, bits & !Tags::STATE | State::E as u8);
            if waits && let Some(slot) = self.l1.find(line) {
                self.l1.set_bits(slot, self.l1.bits(slot) | Tags::WRITABLE);
            }
        }
        // Threads run ahead of one another inside a window, so a write may be served before a read that was made before it;
        // another core that came between has what was written.
        if !owned && State::from_bits(bits).is_owner() && !self.l2_mshrs.awaits(line) {
            self.share(line, slot);
        }
        if self.next_claim < Cycle::MAX {
            let claims = self.claims.iter().filter(|claim| claim.line == line && claim.owns).count();
            self.l2_counters.invalidations += claims as u64;
            self.claims.retain(|claim| claim.line != line);
        }
    }

    /// Notes what another core claims, to be granted when it is due.
    ///
    /// One that wants to read a line which this core owns and has not modified gets it at once: what this core wrote until then
    /// would not be written back.
    pub(crate) fn claim(&mut self, claim: Claim) {
        if !claim.owns && self.state_of(claim.line) == State::E {
            self.grant(claim);
        } else {
            self.claims.push(claim);
            self.next_claim = self.next_claim.min(claim.at);
        }
    }

    /// Grants all claims that are due by `until`.
    #[inline]
    pub(crate) fn grant_claims(&mut self, until: Cycle) {
        if self.next_claim <= until {
            self.grant_due_claims(until);
        }
    }

    #[inline(never)]
    fn grant_due_claims(&mut self, until: Cycle) {
        let claims = std::mem::take(&mut self.claims);
        let (due, later): (Vec<Claim>, Vec<Claim>) = claims.into_iter().partition(|claim| claim.at <= until);
        due.into_iter().for_each(|claim| self.grant(claim));
        self.next_claim = later.iter().map(|claim| claim.at).min().unwrap_or(Cycle::MAX);
        self.claims = later;
    }

    /// Gives `line` to another core before its claim is due, if a locked operation at `now` that ends at `end` would not be over
    /// then; `Err`, and nothing given, when the core could not ask for it again at once.
    pub(crate) fn yield_to_claim(
        &mut self,
        rules: &AccessRules,
        line: u32,
        now: Cycle,
        end: Cycle,
    ) -> Result<(), Again> {
        if self.next_claim >= end {
            return Ok(());
        }
        let claim = self.claims.iter().position(|claim| claim.line == line && claim.owns && claim.at < end);
        if let Some(place) = claim
            && self.l2.find(line).is_some()
        {
            self.translate(rules, line, now)?;
            self.l1_mshrs.free(now).map_err(Again::mshr)?;
            self.l2_mshrs.free(now).map_err(Again::mshr)?;
            let claim = self.claims.remove(place);
            self.grant(claim);
        }
        Ok(())
    }

    /// Gives another core what it claims of a line.
    fn grant(&mut self, claim: Claim) {
        let Claim { line, owns, .. } = claim;
        // It may have been thrown out meanwhile.
        let Some(slot) = self.l2.find(line) else { return };
        // Or asked for again: what is claimed is the copy before that, which has gone; the next is on its way.
        if self.l2_mshrs.awaits(line) {
            self.l2_counters.invalidations += u64::from(owns);
            return;
        }
        if owns { self.lose(line, slot) } else { self.share(line, slot) }
    }

    /// Another core becomes the owner of `line`, which is in `slot` of the L2.
    fn lose(&mut self, line: u32, slot: Slot) {
        self.l2_counters.invalidations += 1;
        let state = State::from_bits(self.l2.bits(slot));
        let (next, _) = transition(state, Event::RemoteWrite).expect("a copy can be lost");
        assert_eq!(next, State::I);
        self.l2.remove(slot);
        #[cfg(test)]
        if self.fault == Some(crate::coherence::Fault::KeepInL1) {
            return;
        }
        if let Some(slot) = self.l1.find(line) {
            self.l1.remove(slot);
            self.l1_counters.invalidations += 1;
        }
    }

    /// Another core has read `line`, which this one owned and has in `slot` of the L2: it stays, shared.
    fn share(&mut self, line: u32, slot: Slot) {
        let bits = self.l2.bits(slot);
        let mut state = State::from_bits(bits);
        if let Some(slot) = self.l1.find(line) {
            let bits = self.l1.bits(slot);
            if bits & Tags::DIRTY != 0 {
                state = State::M;
                self.l1_counters.writebacks += 1;
            }
            self.l1.set_bits(slot, bits & !(Tags::WRITABLE | Tags::DIRTY));
        }
        let (next, actions) = transition(state, Event::RemoteRead).expect("a copy can be read");
        self.l2.set_bits(slot, bits & !Tags::STATE | next as u8);
        self.l2_counters.writebacks += u64::from(actions.write_back);
    }

    /// The state of this core's copy of `line`, as far as it has been told, with what its L1 has written.
    pub(crate) fn state_of(&self, line: u32) -> State {
        let Some(slot) = self.l2.find(line) else { return State::I };
        let dirty = || self.l1.find(line).is_some_and(|slot| self.l1.bits(slot) & Tags::DIRTY != 0);
        match State::from_bits(self.l2.bits(slot)) {
            State::E if dirty() => State::M,
            state => state,
        }
    }
}

/// A hit in L1 at `now`.
#[inline(always)]
pub(crate) fn hit(rules: &AccessRules, now: Cycle) -> Access {
    Access::known(When::new(now + rules.l1_hit_cycles, Cause::L1), false)
}
