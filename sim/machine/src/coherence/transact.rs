//! A transaction: what a miss or an upgrade asks of the home, and what follows.
//!
//! It is timed whole when it leaves the core. All shared resources remember which of their slots are taken, so a request
//! that leaves a little earlier than one already timed still finds its place before it.

use super::access::L2Access;
use super::transition::{Event, Others, Source, State, transition};
use super::{Hierarchy, directory::Record, sharers::Sharers};
use crate::Cycle;
use crate::cache::{Intent, Slot, Tags};
use crate::counters::Cause;
use crate::ring::Message;
use crate::when::When;

impl Hierarchy {
    /// The core at whose stop the home of `line` is: spread uniformly over all of them [chrysos12].
    pub(crate) fn home_of(&self, line: u32) -> u32 {
        let hash =
            u64::from(line.wrapping_mul(0x9e37_79b1) ^ line >> 15).wrapping_mul(0x2545_f491) & 0xffff_ffff;
        ((hash * u64::from(self.spec.cores)) >> 32) as u32
    }

    /// The core at whose stop the controller of `line` is.
    pub(crate) fn controller_stop(&self, line: u32) -> u32 {
        self.controller_stops[self.memory.controller_of(line) as usize]
    }

    /// Serves a request that leaves `core` at `now`, whose L2 has the line in `l2_slot` if at all. Returns when line or
    /// ownership are there, and what held them up.
    #[inline(always)]
    pub(super) fn transact(
        &mut self,
        core: usize,
        line: u32,
        l2_slot: Option<Slot>,
        intent: Intent,
        now: Cycle,
    ) -> L2Access {
        let me = core as u32;
        let home = self.home_of(line);
        let ring_waits_before = self.rings.wait_cycles();
        self.counters.transactions += 1;

        // Records are seldom in the host's caches: ask for both that this transaction needs now, so that the host has them
        // by the time the request has travelled.
        self.directory.prefetch(line);
        let place = match l2_slot {
            Some(slot) => slot,
            None => {
                let l2 = &self.caches[core].l2;
                let place = l2.place_for(line);
                if let Some(victim) = l2.line_at(place) {
                    self.directory.prefetch(victim);
                }
                place
            }
        };

        // To the home, and wait there for the slice and for earlier transactions on the line.
        let arrived = self.rings.send(me, home, Message::Address, now);
        let served = self.slices[home as usize].take(arrived);
        let record = *self.directory.record(line).0;
        let others = match record.sharers.owner() {
            Some(owner) if owner != me => Others::Own,
            Some(_) => Others::Nobody,
            None if record.sharers.nearest(me, &self.directory.pool).is_some() => Others::Share,
            None => Others::Nobody,
        };
        let state = l2_slot.map_or(State::I, |slot| State::from_bits(self.caches[core].l2.bits(slot)));
        let event = match intent {
            Intent::Read => Event::Read(others),
            Intent::Write => Event::Write(others),
            Intent::Stream => Event::Stream(others),
        };
        let (next, actions) = transition(state, event).expect("the directory knows every copy");
        let changes_owner = others == Others::Own || next.is_owner();
        let start =
            served.max(if changes_owner { record.busy.write_after() } else { record.busy.read_after() });
        self.counters.wait_cycles += start - arrived;
        let leaves = start + self.spec.directory_lookup;

        // Copies of others: who supplies, who is downgraded, who loses it.
        let before = record.sharers;
        let mut done = leaves;
        if actions.data == Source::Peer || actions.invalidate_others {
            let supplier = match before.owner() {
                Some(owner) => Some(owner),
                None => before.nearest(me, &self.directory.pool),
            };
            let supplier = supplier.filter(|_| actions.data == Source::Peer);
            // An owner's L1 may be newer than its L2 and is looked into first.
            let newer = if others == Others::Own { self.spec.l1d.hit_cycles } else { 0 };
            let supplies = |peer| (supplier == Some(peer)).then_some(newer);
            self.counters.forwards += u64::from(supplier.is_some());
            if !actions.invalidate_others {
                let supplier = supplier.expect("only a peer's data are asked for without a loss");
                let asked = self.rings.send(home, supplier, Message::Address, leaves);
                self.supply(supplier, line, asked);
                done = done.max(self.answer(supplier, me, true, asked + newer));
            } else if let Some(few) = before.few() {
                for peer in few.filter(|peer| *peer != me) {
                    done = done.max(self.invalidate(peer, home, me, line, supplies(peer), leaves));
                }
            } else {
                let mut peers = std::mem::take(&mut self.peers);
                before.for_each(&self.directory.pool, |peer| peers.push(peer));
                for peer in peers.drain(..).filter(|peer| *peer != me) {
                    done = done.max(self.invalidate(peer, home, me, line, supplies(peer), leaves));
                }
                self.peers = peers;
            }
        }

        // Memory, or the home's permission when no data are needed.
        match actions.data {
            Source::Memory => {
                let controller = self.controller_stop(line);
                let asked = self.rings.send(home, controller, Message::Address, leaves);
                let read = self.memory.read(line, asked);
                done = done.max(self.rings.send(controller, me, Message::Line, read));
                // The home is told that the line has left and that it has arrived; nobody waits for that.
                if self.spec.ring.acknowledge_rings > 0 {
                    self.rings.send(controller, home, Message::Acknowledge, read);
                    self.rings.send(me, home, Message::Acknowledge, done);
                }
            }
            Source::Nowhere => done = done.max(self.rings.send(home, me, Message::Acknowledge, leaves)),
            Source::Peer => {}
        }

        self.note(core, line, next, others, changes_owner, done);
        let written_back = self.fill_l2(core, line, place, l2_slot.is_some(), next, done);

        let ring_waits = self.rings.wait_cycles() - ring_waits_before;
        let cause = if ring_waits * 2 > done - now {
            Cause::Ring
        } else if actions.data == Source::Memory {
            Cause::Memory
        } else {
            Cause::Remote
        };
        L2Access { ready: When::new(done, cause), owned: next.is_owner(), missed: true, written_back }
    }

    /// Has the copy of `peer` invalidated by `home` at `now`; returns when its answer is with `requester`: the line, after so
    /// many cycles, if it `supplies` that.
    #[inline(always)]
    fn invalidate(
        &mut self,
        peer: u32,
        home: u32,
        requester: u32,
        line: u32,
        supplies: Option<Cycle>,
        now: Cycle,
    ) -> Cycle {
        self.counters.invalidations += 1;
        let asked = self.rings.send(home, peer, Message::Address, now);
        self.lose(peer as usize, line);
        self.answer(peer, requester, supplies.is_some(), asked + supplies.unwrap_or(0))
    }

    /// What `peer`, asked at `now`, sends: a supplier reads its L2, an acknowledgement leaves at once.
    #[inline(always)]
    fn answer(&mut self, peer: u32, requester: u32, supplies: bool, now: Cycle) -> Cycle {
        if supplies {
            self.rings.send(peer, requester, Message::Line, now + self.spec.l2.hit_cycles)
        } else {
            self.rings.send(peer, requester, Message::Acknowledge, now)
        }
    }

    /// Writes down who has the line now, and until when it is busy.
    fn note(
        &mut self,
        core: usize,
        line: u32,
        next: State,
        others: Others,
        changes_owner: bool,
        done: Cycle,
    ) {
        #[cfg(test)]
        if self.fault == Some(super::Fault::ForgetReader) && !next.is_owner() {
            return;
        }
        let (record, pool) = self.directory.record(line);
        let Record { sharers, busy } = record;
        if next.is_owner() {
            sharers.clear(pool);
            *sharers = Sharers::owned_by(core as u32);
        } else {
            debug_assert!(others != Others::Nobody, "alone and not the owner");
            sharers.add(core as u32, pool);
        }
        *busy = busy.extended(done, changes_owner);
    }

    /// A peer's copy is read by another core: it stays, shared, and memory gets what it does not have.
    fn supply(&mut self, peer: u32, line: u32, now: Cycle) {
        #[cfg(test)]
        if self.fault == Some(super::Fault::KeepOwner) {
            return;
        }
        let caches = &mut self.caches[peer as usize];
        let slot = caches.l2.find(line).expect("the directory knows every copy");
        let bits = caches.l2.bits(slot);
        let mut state = State::from_bits(bits);
        if let Some(l1) = caches.l1.find(line) {
            let l1_bits = caches.l1.bits(l1);
            if l1_bits & Tags::DIRTY != 0 {
                state = State::M;
                caches.l1_counters.writebacks += 1;
            }
            caches.l1.set_bits(l1, l1_bits & !(Tags::WRITABLE | Tags::DIRTY));
        }
        let (next, actions) = transition(state, Event::RemoteRead).expect("a copy can be read");
        caches.l2.set_bits(slot, bits & !Tags::STATE | next as u8);
        #[cfg(test)]
        if self.fault == Some(super::Fault::LoseSharedWrite) {
            return;
        }
        if actions.write_back {
            caches.l2_counters.writebacks += 1;
            self.write_back(peer, line, now);
        }
    }

    /// A core's copy is lost to a writer.
    fn lose(&mut self, peer: usize, line: u32) {
        #[cfg(test)]
        if self.fault == Some(super::Fault::KeepCopy) {
            return;
        }
        let caches = &mut self.caches[peer];
        let slot = caches.l2.find(line).expect("the directory knows every copy");
        let state = State::from_bits(caches.l2.bits(slot));
        let (next, _) = transition(state, Event::RemoteWrite).expect("a copy can be lost");
        assert_eq!(next, State::I);
        caches.l2.remove(slot);
        caches.l2_counters.invalidations += 1;
        #[cfg(test)]
        if self.fault == Some(super::Fault::KeepInL1) {
            return;
        }
        if let Some(l1) = caches.l1.find(line) {
            caches.l1.remove(l1);
            caches.l1_counters.invalidations += 1;
        }
    }

    /// Puts a line in a core's L2 at `place`, where it is already if it is `held`; otherwise makes room for it. Returns when
    /// the line that made room has been written back, if somebody waits for that.
    fn fill_l2(
        &mut self,
        core: usize,
        line: u32,
        place: Slot,
        held: bool,
        state: State,
        now: Cycle,
    ) -> Cycle {
        let caches = &mut self.caches[core];
        let bits = state as u8 | Tags::PENDING;
        if held {
            caches.l2_counters.upgrades += 1;
            caches.l2.set_bits(place, bits);
            caches.l2.touch(place);
            return 0;
        }
        let Some((victim, victim_bits)) = caches.l2.insert(place, line, bits) else { return 0 };
        caches.l2_counters.evictions += 1;
        let mut state = State::from_bits(victim_bits);
        // The L2 is inclusive: the L1 loses what the L2 loses.
        if let Some(l1) = caches.l1.find(victim) {
            if caches.l1.bits(l1) & Tags::DIRTY != 0 {
                state = State::M;
                caches.l1_counters.writebacks += 1;
            }
            caches.l1.remove(l1);
            caches.l1_counters.invalidations += 1;
        }
        let (_, actions) = transition(state, Event::Evict).expect("a held line can be evicted");
        if actions.write_back {
            caches.l2_counters.writebacks += 1;
        }
        // Nobody waits for the notice; it only takes slots.
        #[cfg(test)]
        let actions = match self.fault {
            Some(super::Fault::ForgetEviction) => super::Actions { notify_home: false, ..actions },
            Some(super::Fault::LoseWrite) => super::Actions { write_back: false, ..actions },
            _ => actions,
        };
        if actions.notify_home {
            let home = self.home_of(victim);
            self.rings.send(core as u32, home, Message::Address, now);
            let (record, pool) = self.directory.record(victim);
            record.sharers.remove(core as u32, pool);
        }
        if actions.write_back { self.write_back(core as u32, victim, now) } else { 0 }
    }

    /// Sends a line to memory; returns when the core knows that it is there, 0 when it is not told.
    fn write_back(&mut self, core: u32, line: u32, now: Cycle) -> Cycle {
        let controller = self.controller_stop(line);
        let arrived = self.rings.send(core, controller, Message::Line, now);
        let written = self.memory.write(line, arrived);
        if !self.spec.memory.acknowledges_writes {
            return 0;
        }
        self.rings.send(controller, core, Message::Acknowledge, written)
    }
}
