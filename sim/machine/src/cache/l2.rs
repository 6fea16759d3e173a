//! The L2 of a core: a line that the L1 lacks is there, on its way, or asked for at its home; it includes the L1.

use super::access::{AccessRules, Again};
use super::{CoreCaches, Intent, Tags};
use crate::Cycle;
use crate::coherence::{Event, State, transition};
use crate::counters::Cause;
use crate::exchange::{Request, Victim};
use crate::when::When;

/// What became of an access to the L2.
pub(super) struct L2Access {
    /// When the line is usable; [`When::NEVER`] when that is for the uncore to say.
    pub(super) ready: When,
    /// Whether the core may write the line, as far as it knows.
    pub(super) owned: bool,
    /// Whether the L2 neither had the line nor waited for it.
    pub(super) missed: bool,
    /// Number of the MSHR that the line is waited for with.
    pub(super) mshr: u16,
}

impl CoreCaches {
    /// Has the streamer see an access to the L2, and fetches what it wants as far as MSHRs go.
    pub(super) fn run_ahead(
        &mut self,
        rules: &AccessRules,
        line: u32,
        missed: bool,
        spared: usize,
        now: Cycle,
    ) {
        let Some(stream) = self.prefetcher.observe(line, missed) else { return };
        while let Some(wanted) = self.prefetcher.wanted(stream) {
            // Not now, when demands might have to wait for an MSHR; the next access to the stream asks again.
            if self.l2.find(wanted).is_none()
                && (!self.l2_mshrs.has_more_than(spared, now)
                    || self.l2_access(rules, wanted, Intent::Read, now).is_err())
            {
                return;
            }
            self.prefetcher.advance(stream);
        }
    }

    /// Brings `line` into the L2 and no further.
    pub(crate) fn prefetch_l2(&mut self, rules: &AccessRules, line: u32, now: Cycle) -> Result<(), Again> {
        if rules.ideal {
            return Ok(());
        }
        self.translate(rules, line, now)?;
        self.l2_access(rules, line, Intent::Read, now).map(|_| ())
    }

    /// An L1 miss or L2 prefetch at `now`, the time of the uop.
    pub(super) fn l2_access(
        &mut self,
        rules: &AccessRules,
        line: u32,
        intent: Intent,
        now: Cycle,
    ) -> Result<L2Access, Again> {
        let slot = self.l2.find(line);
        if let Some(slot) = slot {
            let bits = self.l2.bits(slot);
            let owned = State::from_bits(bits).is_owner();
            if intent == Intent::Read || owned {
                self.l2.touch(slot);
                let state = if intent == Intent::Read { 0 } else { State::M as u8 };
                if bits & Tags::PENDING != 0
                    && let Some((place, fill)) = self.l2_mshrs.in_flight(line, now)
                {
                    self.l2.set_bits(slot, bits | state);
                    self.l2_counters.merged += 1;
                    let ready = fill.not_before(now + rules.l2_hit_cycles);
                    return Ok(L2Access { ready, owned, missed: false, mshr: place as u16 });
                }
                self.l2.set_bits(slot, bits & !Tags::PENDING | state);
                self.l2_counters.hits += 1;
                let ready = When::new(now + rules.l2_hit_cycles, Cause::L2);
                return Ok(L2Access { ready, owned, missed: false, mshr: 0 });
            }
        }

        // A miss: an MSHR and a place must be free.
        #[cfg(test)]
        if self.fault == Some(crate::coherence::Fault::RefuseAlways) {
            return Err(Again::mshr(now + 1));
        }
        let mshr = self.l2_mshrs.free(now).map_err(Again::mshr)?;
        let place = match slot {
            Some(slot) => slot,
            None => self.l2.place_for(line).ok_or(Again::mshr(When::NEVER.at()))?,
        };
        self.l2_counters.misses += 1;
        self.l2_mshrs.ask(mshr, line, place, 0, 0);
        let owned = intent != Intent::Read;
        let state = if owned { State::M } else { State::S };
        let bits = state as u8 | Tags::PENDING;
        let victim = if slot.is_some() {
            self.l2_counters.upgrades += 1;
            self.l2.set_bits(place, bits);
            self.l2.touch(place);
            None
        } else {
            self.reclaim(line);
            self.l2.insert(place, line, bits).map(|(victim, bits)| self.throw_out(victim, bits))
        };
        let held = slot.is_some();
        self.doubles += u32::from(held && self.l2.is_reserved(place));
        self.l2.reserve(place);
        self.outbox.push(Request { time: now, line, intent, mshr: mshr as u16, held, victim });
        Ok(L2Access { ready: When::NEVER, owned, missed: true, mshr: mshr as u16 })
    }

    /// Takes `line` back from the requests that throw it out and have not left the core: it is wanted again before it went.
    fn reclaim(&mut self, line: u32) {
        for request in &mut self.outbox {
            if let Some(victim) = &mut request.victim
                && victim.line == line
            {
                victim.notify_home = false;
            }
        }
    }

    /// What becomes of a line that has to make room in the L2.
    fn throw_out(&mut self, line: u32, bits: u8) -> Victim {
        self.l2_counters.evictions += 1;
        let mut state = State::from_bits(bits);
        #[cfg(test)]
        let keeps_l1 = self.fault == Some(crate::coherence::Fault::KeepInL1);
        #[cfg(not(test))]
        let keeps_l1 = false;
        // The L2 is inclusive: the L1 loses what the L2 loses.
        if let Some(slot) = self.l1.find(line)
            && !keeps_l1
        {
            if self.l1.bits(slot) & Tags::DIRTY != 0 {
                state = State::M;
                self.l1_counters.writebacks += 1;
            }
            self.l1.remove(slot);
            self.l1_counters.invalidations += 1;
        }
        let (_, actions) = transition(state, Event::Evict).expect("a held line can be evicted");
        if actions.write_back {
            self.l2_counters.writebacks += 1;
        }
        Victim { line, write_back: actions.write_back, notify_home: actions.notify_home }
    }

    /// Asks the host for what an access to `line` that misses will look at.
    #[inline(always)]
    pub(crate) fn prefetch(&self, line: u32) {
        self.l2.prefetch(line);
    }

    /// A modified line came down from the L1.
    pub(super) fn mark_modified(&mut self, line: u32) {
        let slot = self.l2.find(line).expect("the L2 includes the L1");
        let bits = self.l2.bits(slot);
        self.l2.set_bits(slot, bits | State::M as u8);
    }
}
