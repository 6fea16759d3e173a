//! Handing the lines of one memory uop to the caches, one after the other.

use super::table::{Kind, Row};
use super::waiting::{Waiter, WaitingId};
use super::{CoreTables, Shared, State, Thread};
use crate::Cycle;
use crate::cache::{Access, Again, Intent, Slot};
use crate::counters::Cause;
use crate::when::When;

/// How far a memory uop has come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walk {
    /// The uop's place in the stream.
    uop: usize,
    row: Row,
    lines: u32,
    done: u32,
    issued: Cycle,
    /// When the next line is due.
    due: Cycle,
    /// Whether its turn among the lines of gathers is that cycle.
    has_turn: bool,
    /// Whether the L1 has taken it for that cycle already.
    taken: bool,
    /// What it waited for last.
    why: Cause,
    /// When the last line so far was handed on.
    last: Cycle,
    ready: When,
    /// Latest known time at which a line that missed arrives.
    missing: When,
    /// Where the lines are noted whose times are not known.
    waiting: Option<WaitingId>,
}

impl Walk {
    /// The walk of the uop at place `uop`, issued at `now`: the first of its lines is due then.
    pub(super) fn new(uop: usize, row: Row, lines: u32, now: Cycle) -> Walk {
        let gathers = row.kind().is_gather();
        Walk {
            uop,
            row,
            lines,
            done: 0,
            issued: now,
            due: now,
            has_turn: false,
            taken: false,
            why: if gathers { Cause::GatherLines } else { Cause::L1 },
            last: now,
            ready: When::bare(now).plus(row.latency()),
            missing: When::new(0, Cause::Dependency),
            waiting: None,
        }
    }

    /// This walk of a load or a store of whose lines `done` have been handed on, one a cycle, and have hit: the next is due at
    /// `due`, and the L1 has taken it for then if `taken`.
    pub(super) fn behind(self, done: u32, due: Cycle, taken: bool) -> Walk {
        let last = if done > 0 { due - 1 } else { self.issued };
        Walk {
            done,
            due,
            last,
            taken,
            has_turn: taken,
            ready: When::bare(last).plus(self.row.latency()),
            ..self
        }
    }

    pub(super) fn idle() -> Walk {
        Walk::new(0, Row::NONE, 0, 0)
    }

    /// This walk, with its next line to be handed on again.
    fn again(self, again: Again) -> Walk {
        Walk { due: again.at, why: again.why, has_turn: false, taken: false, ..self }
    }

    /// When its next line is due, and what it waits for.
    pub(super) fn next(&self) -> When {
        if self.due >= When::NEVER.at() { When::NEVER } else { When::new(self.due, self.why) }
    }

    /// MSHRs have been answered: one that waits for any tries again at `at`, and finds out when the first is free.
    pub(super) fn retry(&mut self, at: Cycle) {
        self.due = at.max(self.last);
    }
}

impl Thread {
    /// Hands on the lines of `walk` that are due before `end`. Returns when the thread may go on; [`When::NEVER`] when it has
    /// to wait with more lines ([`State::Walking`]) or for the uncore.
    #[inline(never)]
    pub(super) fn advance_walk(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        mut walk: Walk,
        end: Cycle,
    ) -> When {
        let kind = walk.row.kind();
        let base = shared.caches.ports.base();
        while walk.done < walk.lines {
            // A port of the L1, and for a gather the turn of its line.
            if walk.due < end && !walk.taken {
                if kind.is_gather() && !walk.has_turn {
                    walk.due = shared.caches.gather_lines.take(walk.due, base);
                    walk.has_turn = true;
                }
                let port = if walk.due < end { shared.caches.ports.take(walk.due, end) } else { None };
                walk.taken = port.is_some();
                walk.due = port.unwrap_or(walk.due.max(end));
            }
            if walk.due >= end {
                self.walk = walk;
                self.state = State::Walking;
                return When::NEVER;
            }
            let line = self.line();
            // Where one line misses those behind it often do: the host fetches what they will need meanwhile.
            if let Some(later) = self.line_ahead(2) {
                shared.caches.prefetch(later);
            }
            match shared.hand_on(tables, line, kind, walk.due) {
                Err(again) => walk = walk.again(again),
                Ok(access) => {
                    self.line_pc += 1;
                    walk.done += 1;
                    walk.last = walk.due;
                    (walk.has_turn, walk.taken) = (false, false);
                    walk.due += 1;
                    self.note_access(tables, shared, &mut walk, line, access);
                }
            }
        }
        self.end_walk(tables, shared, &walk)
    }

    /// Keeps what the walk has to know of a line that was handed on.
    #[inline(always)]
    fn note_access(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        walk: &mut Walk,
        line: u32,
        access: Access,
    ) {
        let kind = walk.row.kind();
        if kind.is_prefetch() {
            // Nothing waits for it.
            return;
        }
        if access.ready != When::NEVER {
            walk.ready = walk.ready.max(access.ready);
            if access.missed {
                walk.missing = walk.missing.max(access.ready);
            }
            return;
        }
        // A store is done for its thread when the line is there; nobody reads its result.
        let wanted = kind.intent() == Intent::Read || kind.locks() || tables.blocks_on_l1_miss;
        if wanted {
            let waiter = Waiter::Uop { place: walk.uop, generation: self.generation };
            let id = *walk.waiting.get_or_insert_with(|| shared.waiting.add(self.index, waiter));
            shared.waiting.wait_for(id, access, kind.locks().then_some(line));
        }
    }

    /// All lines are handed on. Returns when the thread may go on.
    fn end_walk(&mut self, tables: &CoreTables, shared: &mut Shared, walk: &Walk) -> When {
        self.state = State::Running;
        let kind = walk.row.kind();
        let mut hold = When::new(walk.last, walk.why);
        if kind.is_gather() {
            hold = When::new(walk.last + 1 + tables.gather_overhead, walk.why);
        } else if walk.last > walk.issued {
            hold = When::new(walk.last + 1, walk.why);
        }
        let mut ready = walk.ready;
        let mut missing = walk.missing;
        if let Some(id) = walk.waiting {
            let holds = tables.blocks_on_l1_miss || kind.locks();
            let waiting = shared.waiting.get(id);
            waiting.ready = waiting.ready.max(walk.ready);
            (waiting.hold, waiting.holds) = (hold, holds);
            match shared.waiting.hand_on(id) {
                // All answers came while it still handed lines on.
                Some(waiting) => (ready, missing) = (waiting.ready, waiting.ready),
                None => {
                    self.ready[walk.uop % 256] = When::NEVER;
                    self.holders += u16::from(holds);
                    return if holds { When::NEVER } else { hold };
                }
            }
        }
        self.ready[walk.uop % 256] = ready;
        if tables.blocks_on_l1_miss {
            hold = hold.max(missing);
        }
        if kind.locks() {
            hold = hold.max(ready);
        }
        hold
    }

    /// The one line of a load, a store, a gather or a scatter was asked of the uncore, or has to be asked for again: what
    /// [`Thread::advance_walk`] does with it.
    #[inline(never)]
    pub(super) fn end_one_line(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        mut walk: Walk,
        line: u32,
        result: Result<Access, Again>,
        end: Cycle,
    ) -> When {
        match result {
            Err(again) => self.advance_walk(tables, shared, walk.again(again), end),
            Ok(access) => {
                self.line_pc += 1;
                self.note_access(tables, shared, &mut walk, line, access);
                self.end_walk(tables, shared, &walk)
            }
        }
    }
}

impl Shared {
    /// Hands one line of a memory uop of `kind` to the L1, which has taken it for the cycle `now`.
    #[inline(always)]
    fn hand_on(&mut self, tables: &CoreTables, line: u32, kind: Kind, now: Cycle) -> Result<Access, Again> {
        match kind {
            Kind::Access(intent) | Kind::Gather(intent) => self.load_or_store(tables, line, intent, now),
            Kind::PrefetchL1 | Kind::GatherPrefetch => {
                self.caches.access(&tables.access, line, Intent::Read, now)
            }
            Kind::PrefetchL2 => {
                self.caches.prefetch_l2(&tables.access, line, now)?;
                Ok(crate::cache::hit(&tables.access, now))
            }
            Kind::Atomic | Kind::AtomicGather => {
                let access = self.locked(tables, line, now)?;
                self.atomics.operations += 1;
                self.atomics.transfers += u64::from(access.missed);
                Ok(access)
            }
            Kind::Compute | Kind::Branch => unreachable!("touches no line"),
        }
    }

    /// A line of a load, a store, a gather or a scatter.
    #[inline(always)]
    fn load_or_store(
        &mut self,
        tables: &CoreTables,
        line: u32,
        intent: Intent,
        now: Cycle,
    ) -> Result<Access, Again> {
        match self.caches.l1_hit(&tables.access, line, intent != Intent::Read, now) {
            // A store goes into the store buffer: it is done at once.
            Ok(()) if intent != Intent::Read => Ok(Access::known(When::new(now + 1, Cause::L1), false)),
            Ok(()) => Ok(crate::cache::hit(&tables.access, now)),
            Err(slot) => self.load_or_store_beyond_hit(tables, line, slot, intent, now),
        }
    }

    /// A line of a load, a store, a gather or a scatter that the L1 does not have ready, but in `slot` if at all.
    #[inline(always)]
    pub(super) fn load_or_store_beyond_hit(
        &mut self,
        tables: &CoreTables,
        line: u32,
        slot: Option<Slot>,
        intent: Intent,
        now: Cycle,
    ) -> Result<Access, Again> {
        let mut access = self.caches.access_beyond_hit(&tables.access, line, slot, intent, now)?;
        if intent != Intent::Read && !access.missed {
            access.ready = When::new(now + 1, Cause::L1);
        }
        Ok(access)
    }

    /// A locked operation: owns the line, then works on it alone. While the uncore has not said when the line arrives, the
    /// lock waits with the uop.
    pub(super) fn locked(&mut self, tables: &CoreTables, line: u32, now: Cycle) -> Result<Access, Again> {
        let end = self.caches.locks.free(line, now) + tables.atomic_cycles;
        self.caches.yield_to_claim(&tables.access, line, now, end)?;
        let access = self.caches.access(&tables.access, line, Intent::Write, now)?;
        if access.ready == When::NEVER {
            return Ok(access);
        }
        // The operation's latency contains the look-up of a hit.
        let start = if access.missed { access.ready.at() } else { now };
        let floor = self.caches.ports.base();
        let ready = self.caches.locks.lock(line, start, tables.atomic_cycles, floor);
        Ok(Access { ready: When::new(ready, Cause::Atomic), ..access })
    }
}
