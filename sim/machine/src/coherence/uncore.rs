//! Everything that cores share: directory, rings, memory.

use super::agenda::TransactionId;
use super::{Agenda, Directory, Leg, State, Transaction};
use crate::Cycle;
use crate::config::MachineSpec;
use crate::counters::DirectoryCounters;
use crate::exchange::{Message, Request};
use crate::memory::Memory;
use crate::occupancy::Slots;
use crate::ring::{Message as OnRing, Rings};

/// The other cores, as the uncore sees them.
pub(crate) trait Peers {
    /// The state of the copy that `core` has of `line`.
    fn state(&mut self, core: u32, line: u32) -> State;

    /// When `core` can give `line` away, if it is asked for it at `now`: not in the middle of a locked operation.
    fn unlocked(&mut self, core: u32, line: u32, now: Cycle) -> Cycle;

    /// Tells `core` something.
    fn tell(&mut self, core: u32, message: Message);
}

/// Directory, rings and controllers.
pub(crate) struct Uncore {
    pub(super) cores: u32,
    pub(super) l1_hit_cycles: Cycle,
    pub(super) l2_hit_cycles: Cycle,
    pub(super) lookup_cycles: Cycle,
    /// Whether the home is told when a line from memory has left its controller and has arrived.
    pub(super) tells_home: bool,
    /// Whether a write-back keeps its MSHR until the controller has acknowledged it, not only until it has taken it.
    pub(super) acknowledges_writes: bool,
    pub(super) directory: Directory,
    /// When the slice at each stop serves.
    pub(super) slices: Vec<Slots>,
    pub(crate) rings: Rings,
    pub(crate) memory: Memory,
    /// The core at whose stop each controller is: spread evenly.
    controller_stops: Vec<u32>,
    /// Legs of the transaction that is timed whole which have to be looked at yet.
    pub(super) open: Vec<(Leg, Cycle)>,
    /// Write-backs of the transaction that is timed whole.
    pub(super) write_backs: Vec<(Leg, Cycle)>,
    /// What is to be done later: all legs where transactions run side by side, write-backs where they are timed whole.
    pub(super) agenda: Agenda,
    pub(crate) counters: DirectoryCounters,
    #[cfg(test)]
    pub(crate) fault: Option<super::Fault>,
}

impl Uncore {
    /// Cold and idle; with rings that know every slot (`exact`) or count them in windows.
    pub(crate) fn new(spec: &MachineSpec, exact: bool) -> Uncore {
        let stop =
            |controller| u64::from(controller) * u64::from(spec.cores) / u64::from(spec.memory.controllers);
        Uncore {
            cores: spec.cores,
            l1_hit_cycles: spec.l1d.hit_cycles,
            l2_hit_cycles: spec.l2.hit_cycles,
            lookup_cycles: spec.directory_lookup,
            tells_home: spec.ring.acknowledge_rings > 0,
            acknowledges_writes: spec.memory.acknowledges_writes,
            directory: Directory::default(),
            slices: vec![Slots::new(spec.directory_interval * 256); spec.cores as usize],
            rings: Rings::new(spec, exact),
            memory: Memory::new(&spec.memory),
            controller_stops: (0..spec.memory.controllers)
                .map(|controller| stop(controller) as u32)
                .collect(),
            open: Vec::new(),
            write_backs: Vec::new(),
            agenda: Agenda::default(),
            counters: DirectoryCounters::default(),
            #[cfg(test)]
            fault: None,
        }
    }

    /// Cycles from the uop of a request to its answer at the least: how long a core can run alone.
    ///
    /// The L2 has to find out that it misses, and the directory to look the line up, be its home at the core's own stop.
    pub(crate) fn answer_cycles_min(&self) -> Cycle {
        self.l2_hit_cycles + self.lookup_cycles
    }

    /// The core at whose stop the home of `line` is: spread uniformly over all of them [chrysos12].
    #[inline(always)]
    pub(crate) fn home_of(&self, line: u32) -> u32 {
        let hash =
            u64::from(line.wrapping_mul(0x9e37_79b1) ^ line >> 15).wrapping_mul(0x2545_f491) & 0xffff_ffff;
        ((hash * u64::from(self.cores)) >> 32) as u32
    }

    /// The core at whose stop the controller of `line` is.
    #[inline(always)]
    pub(crate) fn controller_stop(&self, line: u32) -> u32 {
        self.controller_stops[self.memory.controller_of(line) as usize]
    }

    /// Asks the host for what a request of `core` will look at.
    #[inline(always)]
    pub(crate) fn prefetch(&self, request: &Request) {
        self.directory.prefetch(request.line);
        if let Some(victim) = request.victim {
            self.directory.prefetch(victim.line);
        }
    }

    /// Serves a request of `core` whole, all legs of it but write-backs, which wait until they are due; nobody will ask for a time
    /// before `floor` again.
    #[inline(always)]
    pub(crate) fn serve(&mut self, core: u32, request: &Request, floor: Cycle, peers: &mut impl Peers) {
        // What is written back by the time at which this request can be with a controller comes before it there.
        self.write_back_until(request.time + self.answer_cycles_min(), floor, peers);
        self.note_victim(core, request);
        let mut transaction = Transaction::new(core, request);
        let start = request.time + self.l2_hit_cycles;
        self.run::<false>(0, &mut transaction, Leg::Depart, start, floor, peers);
        while let Some((leg, at)) = self.open.pop() {
            self.run::<false>(0, &mut transaction, leg, at, floor, peers);
        }
        if self.write_backs.is_empty() {
            debug_assert!(transaction.is_over());
            return;
        }
        let id = self.agenda.keep(transaction);
        for (leg, at) in self.write_backs.drain(..) {
            self.agenda.add(id, leg, at);
        }
    }

    /// Does all write-backs that are due by `now`, each whole, where transactions are timed whole; nobody will ask for a time
    /// before `floor` again.
    #[inline(always)]
    pub(crate) fn write_back_until(&mut self, now: Cycle, floor: Cycle, peers: &mut impl Peers) {
        while let Some((id, leg, at)) = self.agenda.pop(now) {
            self.run_kept::<false>(id, leg, at, floor, peers);
        }
    }

    /// Takes a request of `core` in, to be served leg by leg.
    pub(crate) fn accept(&mut self, core: u32, request: &Request) {
        self.note_victim(core, request);
        let start = request.time + self.l2_hit_cycles;
        let id = self.agenda.keep(Transaction::new(core, request));
        self.agenda.add(id, Leg::Depart, start);
    }

    /// When the next leg is due; [`Cycle::MAX`] when all that was asked for is done.
    pub(crate) fn next_due(&self) -> Cycle {
        self.agenda.next()
    }

    /// Does all legs that are due by `now`.
    pub(crate) fn run_until(&mut self, now: Cycle, peers: &mut impl Peers) {
        while let Some((id, leg, at)) = self.agenda.pop(now) {
            self.run_leg(id, leg, at, peers);
        }
    }

    /// Does one leg of an accepted request, and those that follow from it at once.
    pub(super) fn run_leg(&mut self, id: TransactionId, leg: Leg, at: Cycle, peers: &mut impl Peers) {
        let (transaction, left) = self.run_kept::<true>(id, leg, at, at, peers);
        if left {
            // Those that waited for the line go on, in their order.
            let line = transaction.line();
            self.agenda.leave(line, transaction.changes_owner());
            loop {
                let (agenda, directory) = (&mut self.agenda, &self.directory);
                let next = agenda.admit_next(line, |waiting| waiting.would_change_owner(directory));
                let Some(next) = next else { break };
                self.run_leg(next, Leg::Decide, at, peers);
            }
        }
    }

    /// Does one leg of a transaction that the agenda keeps, and forgets it if it is over then. Returns what has become of it, and
    /// whether its line is free for the next.
    #[inline(always)]
    fn run_kept<const STEPWISE: bool>(
        &mut self,
        id: TransactionId,
        leg: Leg,
        at: Cycle,
        floor: Cycle,
        peers: &mut impl Peers,
    ) -> (Transaction, bool) {
        let mut transaction = *self.agenda.transaction(id);
        let left = self.run::<STEPWISE>(id, &mut transaction, leg, at, floor, peers);
        if transaction.is_over() {
            self.agenda.forget(id);
        } else {
            *self.agenda.transaction(id) = transaction;
        }
        (transaction, left)
    }

    /// The home knows at once of a line that makes room; the notice itself travels when the fill has arrived.
    #[inline(always)]
    fn note_victim(&mut self, core: u32, request: &Request) {
        if let Some(victim) = request.victim
            && victim.notify_home
        {
            #[cfg(test)]
            if self.fault == Some(super::Fault::ForgetEviction) {
                return;
            }
            let (record, pool) = self.directory.record(victim.line);
            record.sharers.remove(core, pool);
        }
    }

    /// Sends a message; returns when it has arrived whole, and adds to `waited` what it waited.
    #[inline(always)]
    pub(super) fn send(
        &mut self,
        (from, to): (u32, u32),
        message: OnRing,
        now: Cycle,
        floor: Cycle,
        waited: &mut Cycle,
    ) -> Cycle {
        let sent = self.rings.send(from, to, message, now, floor);
        *waited += sent.waited;
        sent.at
    }

    /// Transactions that slices have taken on and serve from `from` on.
    pub(crate) fn transactions_from(&self, from: Cycle) -> u64 {
        self.slices.iter().map(|slice| slice.taken_from(from)).sum()
    }
}
