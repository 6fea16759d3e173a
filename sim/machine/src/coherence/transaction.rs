//! A transaction: what a miss or an upgrade asks of the home, and what follows, leg by leg.

use super::agenda::TransactionId;
use super::directory::{Directory, Record};
use super::sharers::{Pool, Sharers};
use super::uncore::{Peers, Uncore};
use super::{Actions, Event, Others, Source, State, transition};
use crate::Cycle;
use crate::cache::Intent;
use crate::counters::Cause;
use crate::exchange::{Claim, Message, Request, Victim};
use crate::ring::Message as OnRing;
use crate::when::When;

/// What happens next in a transaction. Each leg asks one shared resource, at the time at which it is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Leg {
    /// The request leaves its core.
    Depart,
    /// The request has arrived at the home of its line.
    Home,
    /// The slice of the directory has taken it: it waits for earlier transactions on the line.
    Queue,
    /// The turn of a transaction that had to wait has come: the directory is looked up, and decides.
    Decide,
    /// The home asks a peer to give up its copy, or to supply it.
    AskPeer { peer: u32, supplies: bool },
    /// The peer has been asked.
    AtPeer { peer: u32, supplies: bool },
    /// The peer answers.
    FromPeer { peer: u32, supplies: bool },
    /// The home asks the controller.
    AskMemory,
    /// The controller has been asked.
    AtMemory,
    /// The line leaves the controller.
    FromMemory,
    /// The home gives its permission: no data are needed.
    Permit,
    /// An answer is with the requester.
    Arrive,
    /// The home is told that a line has left its controller, or has arrived; nobody waits for that.
    Tell { from: u32, to: u32 },
    /// A modified line leaves a core for its controller.
    WriteBack { from: u32, line: u32 },
    /// A modified line has arrived at its controller.
    Write { from: u32, line: u32 },
    /// The acknowledgement of a line that was written leaves the controller.
    Acknowledge { to: u32, line: u32 },
    /// The requester knows that a line that was written back is safe.
    Written,
}

/// One transaction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transaction {
    core: u32,
    line: u32,
    intent: Intent,
    mshr: u16,
    held: bool,
    victim: Option<Victim>,
    /// When it left its core.
    departed: Cycle,
    /// When it came to its home.
    arrived: Cycle,
    /// Cycles that its messages waited for ring slots.
    waited: Cycle,
    /// Answers that have not arrived.
    answers: u32,
    /// When the last answer so far arrived.
    done: Cycle,
    /// Lines that it has caused to be written back and that no controller has taken.
    write_backs: u32,
    /// When the last of those taken was safe.
    written: Cycle,
    /// Legs of which nobody waits for the end.
    loose: u32,
    data: Source,
    owned: bool,
    changes_owner: bool,
    /// Whether another core owned the line.
    from_owner: bool,
    answered: bool,
}

impl Transaction {
    #[inline(always)]
    pub(super) fn new(core: u32, request: &Request) -> Transaction {
        let Request { line, intent, mshr, held, victim, .. } = *request;
        Transaction {
            core,
            line,
            intent,
            mshr,
            held,
            victim,
            departed: 0,
            arrived: 0,
            waited: 0,
            answers: 0,
            done: 0,
            write_backs: 0,
            written: 0,
            loose: 0,
            data: Source::Nowhere,
            owned: false,
            changes_owner: false,
            from_owner: false,
            answered: false,
        }
    }

    pub(super) fn line(&self) -> u32 {
        self.line
    }

    pub(super) fn changes_owner(&self) -> bool {
        self.changes_owner
    }

    /// Whether nothing of it is left to do.
    pub(super) fn is_over(&self) -> bool {
        self.answered && self.write_backs == 0 && self.loose == 0
    }

    /// What the directory makes of it, when `sharers` have the line.
    #[inline(always)]
    fn decision(&self, sharers: Sharers, pool: &Pool) -> Decision {
        let owner = sharers.owner();
        let others = match owner {
            Some(owner) if owner != self.core => Others::Own,
            None if sharers.has_other(self.core) => Others::Share,
            Some(_) | None => Others::Nobody,
        };
        // A core that has thrown its copy out and asks again has none, whatever the directory has heard so far.
        let mine = if !self.held {
            State::I
        } else if owner == Some(self.core) {
            State::E
        } else if sharers.contains(self.core, pool) {
            State::S
        } else {
            State::I
        };
        let event = match self.intent {
            Intent::Read => Event::Read(others),
            Intent::Write => Event::Write(others),
            Intent::Stream => Event::Stream(others),
        };
        let (next, actions) = transition(mine, event).expect("the directory knows every copy");
        Decision { next, actions, from_owner: others == Others::Own }
    }

    /// Whether it would change the owner of its line, as things stand.
    pub(super) fn would_change_owner(&self, directory: &Directory) -> bool {
        self.decision(directory.known(self.line).sharers, &directory.pool).changes_owner()
    }
}

/// What the directory decides.
#[derive(Debug, Clone, Copy)]
struct Decision {
    /// What the requester's copy becomes.
    next: State,
    actions: Actions,
    /// Whether another core owns the line.
    from_owner: bool,
}

impl Decision {
    fn changes_owner(self) -> bool {
        self.from_owner || self.next.is_owner()
    }
}

impl Uncore {
    /// Does a leg of `transaction` at `at`, and all that follow from it: at once if not `STEPWISE`, so that the transaction
    /// is timed whole but for its write-backs; else they go to the agenda, where `id` names the transaction. Returns whether
    /// the line is free for the next transaction.
    #[inline(never)]
    pub(super) fn run<const STEPWISE: bool>(
        &mut self,
        id: TransactionId,
        transaction: &mut Transaction,
        leg: Leg,
        at: Cycle,
        floor: Cycle,
        peers: &mut impl Peers,
    ) -> bool {
        let me = transaction.core;
        let line = transaction.line;
        let home = self.home_of(line);
        let (mut leg, mut at) = (leg, at);
        loop {
            let (next_leg, next_at) = match leg {
                Leg::Depart => {
                    transaction.departed = at;
                    let waited = &mut transaction.waited;
                    (Leg::Home, self.send((me, home), OnRing::Address, at, floor, waited))
                }
                Leg::Home => {
                    self.counters.transactions += 1;
                    transaction.arrived = at;
                    (Leg::Queue, self.slices[home as usize].take(at, floor))
                }
                Leg::Queue | Leg::Decide => {
                    let Record { sharers, busy } = self.directory.known(line);
                    let decision = transaction.decision(sharers, &self.directory.pool);
                    // Nothing may come between the turn of a transaction and its decision.
                    if STEPWISE {
                        if leg == Leg::Queue && !self.agenda.enter(id, line, decision.changes_owner()) {
                            return false;
                        }
                    } else {
                        let free =
                            if decision.changes_owner() { busy.write_after() } else { busy.read_after() };
                        at = at.max(free);
                    }
                    self.counters.wait_cycles += at - transaction.arrived;
                    match self.decide::<STEPWISE>(id, transaction, decision, sharers, at + self.lookup_cycles)
                    {
                        Some(next) => next,
                        None => return false,
                    }
                }
                Leg::AskPeer { peer, supplies } => {
                    let waited = &mut transaction.waited;
                    let asked = self.send((home, peer), OnRing::Address, at, floor, waited);
                    (Leg::AtPeer { peer, supplies }, asked)
                }
                Leg::AtPeer { peer, supplies } => {
                    let at = peers.unlocked(peer, line, at);
                    (
                        Leg::FromPeer { peer, supplies },
                        self.ask_peer::<STEPWISE>(id, transaction, peer, supplies, at, peers),
                    )
                }
                Leg::FromPeer { peer, supplies } => {
                    let message = if supplies { OnRing::Line } else { OnRing::Acknowledge };
                    let waited = &mut transaction.waited;
                    (Leg::Arrive, self.send((peer, me), message, at, floor, waited))
                }
                Leg::AskMemory => {
                    let waited = &mut transaction.waited;
                    let controller = self.controller_stop(line);
                    (Leg::AtMemory, self.send((home, controller), OnRing::Address, at, floor, waited))
                }
                Leg::AtMemory => (Leg::FromMemory, self.memory.read(line, at, floor)),
                Leg::FromMemory => {
                    let controller = self.controller_stop(line);
                    if self.tells_home {
                        let tell = Leg::Tell { from: controller, to: home };
                        transaction.loose += 1;
                        self.later::<STEPWISE>(id, tell, at);
                    }
                    let waited = &mut transaction.waited;
                    (Leg::Arrive, self.send((controller, me), OnRing::Line, at, floor, waited))
                }
                Leg::Permit => {
                    let waited = &mut transaction.waited;
                    (Leg::Arrive, self.send((home, me), OnRing::Acknowledge, at, floor, waited))
                }
                Leg::Arrive => {
                    transaction.done = transaction.done.max(at);
                    transaction.answers -= 1;
                    if transaction.answers > 0 {
                        return false;
                    }
                    let at = transaction.done;
                    self.answer::<STEPWISE>(id, transaction, at, floor, peers);
                    return true;
                }
                Leg::Tell { from, to } => {
                    self.send((from, to), OnRing::Acknowledge, at, floor, &mut 0);
                    transaction.loose -= 1;
                    return false;
                }
                Leg::WriteBack { from, line } => {
                    let controller = self.controller_stop(line);
                    (
                        Leg::Write { from, line },
                        self.send((from, controller), OnRing::Line, at, floor, &mut 0),
                    )
                }
                Leg::Write { from, line } => {
                    let write = self.memory.write(line, at, floor);
                    if self.acknowledges_writes {
                        (Leg::Acknowledge { to: from, line }, write.written)
                    } else {
                        (Leg::Written, write.accepted)
                    }
                }
                Leg::Acknowledge { to, line } => {
                    let controller = self.controller_stop(line);
                    (Leg::Written, self.send((controller, to), OnRing::Acknowledge, at, floor, &mut 0))
                }
                Leg::Written => {
                    transaction.write_backs -= 1;
                    transaction.written = transaction.written.max(at);
                    self.release(transaction, peers);
                    return false;
                }
            };
            if STEPWISE {
                self.agenda.add(id, next_leg, next_at);
                return false;
            }
            (leg, at) = (next_leg, next_at);
        }
    }

    /// Adds a leg beside the one that follows.
    #[inline(always)]
    fn later<const STEPWISE: bool>(&mut self, id: TransactionId, leg: Leg, at: Cycle) {
        if STEPWISE {
            self.agenda.add(id, leg, at);
        } else {
            self.open.push((leg, at));
        }
    }

    /// Has a modified line written back that leaves core `from` at `at`: once that time has come for all, since it stands behind
    /// reads that are asked for before then.
    #[inline(always)]
    fn write_back<const STEPWISE: bool>(
        &mut self,
        id: TransactionId,
        transaction: &mut Transaction,
        (from, line): (u32, u32),
        at: Cycle,
    ) {
        transaction.write_backs += 1;
        let leg = Leg::WriteBack { from, line };
        if STEPWISE {
            self.agenda.add(id, leg, at);
        } else {
            self.write_backs.push((leg, at));
        }
    }

    /// What the directory has decided of a line that `before` have leaves the home at `at`. Returns a leg of that, beside those
    /// it adds.
    #[inline(always)]
    fn decide<const STEPWISE: bool>(
        &mut self,
        id: TransactionId,
        transaction: &mut Transaction,
        decision: Decision,
        before: Sharers,
        at: Cycle,
    ) -> Option<(Leg, Cycle)> {
        let Decision { next, actions, from_owner } = decision;
        let me = transaction.core;
        transaction.data = actions.data;
        transaction.owned = next.is_owner();
        transaction.from_owner = from_owner;
        transaction.changes_owner = decision.changes_owner();

        // Copies of others: who supplies, and who loses it.
        let mut last = None;
        if actions.data == Source::Peer || actions.invalidate_others {
            let nearest = || before.nearest(me, &self.directory.pool);
            let supplier = before.owner().or_else(nearest).filter(|_| actions.data == Source::Peer);
            self.counters.forwards += u64::from(supplier.is_some());
            if actions.invalidate_others {
                let mut legs = std::mem::take(&mut self.open);
                let first = legs.len();
                before.for_each(&self.directory.pool, |peer| {
                    if peer != me {
                        let supplies = supplier == Some(peer);
                        legs.push((Leg::AskPeer { peer, supplies }, at));
                    }
                });
                self.counters.invalidations += (legs.len() - first) as u64;
                transaction.answers += (legs.len() - first) as u32;
                if STEPWISE {
                    legs.drain(first..).for_each(|(leg, at)| self.agenda.add(id, leg, at));
                } else {
                    // Asked for last, taken first: in the order of the directory.
                    legs[first..].reverse();
                }
                self.open = legs;
            } else {
                let peer = supplier.expect("only a peer's data are asked for without a loss");
                transaction.answers += 1;
                last = Some(Leg::AskPeer { peer, supplies: true });
            }
        }

        // Memory, or the home's permission when no data are needed.
        match actions.data {
            Source::Memory => last = Some(Leg::AskMemory),
            Source::Nowhere => last = Some(Leg::Permit),
            Source::Peer => {}
        }
        transaction.answers += u32::from(actions.data != Source::Peer);
        self.note(transaction, next);
        last.map(|leg| (leg, at))
    }

    /// Writes down who has the line now.
    #[inline(always)]
    fn note(&mut self, transaction: &Transaction, next: State) {
        #[cfg(test)]
        if self.fault == Some(super::Fault::ForgetReader) && !next.is_owner() {
            return;
        }
        let (record, pool) = self.directory.record(transaction.line);
        if next.is_owner() {
            record.sharers.own(transaction.core, pool);
        } else {
            record.sharers.add(transaction.core, pool);
        }
    }

    /// The copy of `peer` is given up, or read, at `at`; returns when the answer leaves.
    #[inline(always)]
    fn ask_peer<const STEPWISE: bool>(
        &mut self,
        id: TransactionId,
        transaction: &mut Transaction,
        peer: u32,
        supplies: bool,
        at: Cycle,
        peers: &mut impl Peers,
    ) -> Cycle {
        let line = transaction.line;
        #[cfg(test)]
        let fault = self.fault;
        if transaction.owned {
            #[cfg(test)]
            if fault == Some(super::Fault::KeepCopy) {
                return at;
            }
            peers.tell(peer, Message::Claim(Claim { at, line, owns: true }));
        } else if transaction.changes_owner {
            #[cfg(test)]
            if fault == Some(super::Fault::KeepOwner) {
                return at;
            }
            // The owner keeps its copy, shared, and memory gets what it does not have.
            let (_, actions) = match peers.state(peer, line) {
                // On its way out: its write-back goes by itself.
                State::I => transition(State::S, Event::RemoteRead),
                state => transition(state, Event::RemoteRead),
            }
            .expect("a copy can be read");
            peers.tell(peer, Message::Claim(Claim { at, line, owns: false }));
            #[cfg(test)]
            let actions = Actions {
                write_back: actions.write_back && fault != Some(super::Fault::LoseSharedWrite),
                ..actions
            };
            if actions.write_back {
                self.write_back::<STEPWISE>(id, transaction, (peer, line), at);
            }
        }
        if !supplies {
            return at;
        }
        // An owner's L1 may be newer than its L2 and is looked into first.
        let newer = if transaction.from_owner { self.l1_hit_cycles } else { 0 };
        at + newer + self.l2_hit_cycles
    }

    /// All answers are with the requester at `at`: it is told, the line that makes room leaves, and the line is free for the next
    /// transaction.
    #[inline(always)]
    fn answer<const STEPWISE: bool>(
        &mut self,
        id: TransactionId,
        transaction: &mut Transaction,
        at: Cycle,
        floor: Cycle,
        peers: &mut impl Peers,
    ) {
        let me = transaction.core;
        let line = transaction.line;
        transaction.answered = true;
        if !STEPWISE {
            let record = self.directory.record(line).0;
            record.busy = record.busy.extended(at, transaction.changes_owner);
        }
        if transaction.data == Source::Memory && self.tells_home {
            self.send((me, self.home_of(line)), OnRing::Acknowledge, at, floor, &mut 0);
        }
        if let Some(victim) = transaction.victim {
            // Nobody waits for the notice; it only takes slots.
            if victim.notify_home {
                self.send((me, self.home_of(victim.line)), OnRing::Address, at, floor, &mut 0);
            }
            #[cfg(test)]
            let victim = Victim {
                write_back: victim.write_back && self.fault != Some(super::Fault::LoseWrite),
                ..victim
            };
            if victim.write_back {
                self.write_back::<STEPWISE>(id, transaction, (me, victim.line), at);
            }
        }
        let cause = if transaction.waited * 2 > at - transaction.departed {
            Cause::Ring
        } else if transaction.data == Source::Memory {
            Cause::Memory
        } else {
            Cause::Remote
        };
        let (mshr, owned, kept) = (transaction.mshr, transaction.owned, transaction.write_backs > 0);
        #[cfg(test)]
        let at = match self.fault {
            Some(super::Fault::DropAnswer) => return,
            Some(super::Fault::EarlyAnswer) => transaction.departed - self.l2_hit_cycles,
            Some(super::Fault::AnswerTwice) => {
                peers.tell(me, Message::Answer { mshr, fill: When::new(at, cause), owned, kept });
                at
            }
            _ => at,
        };
        peers.tell(me, Message::Answer { mshr, fill: When::new(at, cause), owned, kept });
        if !kept && transaction.written > 0 {
            // What it caused to be written back was taken before the line arrived, or is.
            peers.tell(me, Message::Release { mshr, at: transaction.written });
        }
    }

    /// Frees the MSHR of a transaction that has been answered, once all that it caused to be written back is safe.
    #[inline(always)]
    fn release(&mut self, transaction: &Transaction, peers: &mut impl Peers) {
        if transaction.answered && transaction.write_backs == 0 {
            let at = transaction.written.max(transaction.done);
            peers.tell(transaction.core, Message::Release { mshr: transaction.mshr, at });
        }
    }
}
