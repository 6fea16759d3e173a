//! A core: hardware threads that issue in order, one thread a cycle, two uops when they pair.
//!
//! ```text
//! thread 0 ─ ready ring, next ─┐
//! thread 1 ─ ready ring, next ─┤ round robin      U: any uop
//! thread 2 ─ ready ring, next ─┼────────────► issue
//! thread 3 ─ ready ring, next ─┘                  V: scalar, mask, loads, stores, branch
//! ```
//!
//! Every time of a thread carries its cause (see [`When`]), so that a cycle in which nothing issues is charged to what the
//! thread that issues next has waited for.

mod stack;
mod table;
mod thread;
mod walk;
mod window;

pub(crate) use stack::Stack;
pub(crate) use thread::{State, Thread};
pub(crate) use walk::locked;
pub(crate) use window::{WINDOW, Window};

use crate::Cycle;
use crate::cache::Intent;
use crate::coherence::Hierarchy;
use crate::config::MachineSpec;
use crate::counters::Cause;
use crate::when::{Span, When};
use table::{Row, table};
use walk::Walk;

/// When each source of a uop is there.
#[derive(Debug, Clone, Copy)]
struct Sources([When; 3]);

impl Sources {
    /// Whether all are there at `now`, a bare time.
    #[inline(always)]
    fn are_there(self, now: When) -> bool {
        let Sources([a, b, c]) = self;
        a.max(b).max(c) < now.next_cycle()
    }

    /// When all are there and `held` is over.
    #[inline(always)]
    fn after(self, held: When) -> When {
        // In pairs, not in a row: every uop waits for this.
        let Sources([a, b, c]) = self;
        a.max(b).max(c.max(held))
    }
}

/// What does not change while a core runs.
pub(crate) struct CoreTables {
    rows: Box<[Row; 256]>,
    /// Until the thread that issued can issue again.
    issue_interval: Span,
    /// The same for a gather of one line.
    gather_hold: Span,
    blocks_on_l1_miss: bool,
    gather_interval_x256: u64,
    gather_overhead: Cycle,
    atomic_cycles: Cycle,
    l1_hit_cycles: Cycle,
}

impl CoreTables {
    pub(crate) fn new(spec: &MachineSpec) -> CoreTables {
        CoreTables {
            rows: table(spec),
            issue_interval: Span::new(spec.core.issue_interval, Cause::Dependency),
            gather_hold: Span::new(1 + spec.core.gather_overhead, Cause::GatherLines),
            blocks_on_l1_miss: spec.core.blocks_on_l1_miss,
            gather_interval_x256: spec.core.gather_interval_x256,
            gather_overhead: spec.core.gather_overhead,
            atomic_cycles: spec.atomic_cycles,
            l1_hit_cycles: spec.l1d.hit_cycles,
        }
    }

    /// The row of the uop at `pc`.
    #[inline(always)]
    fn row(&self, uops: &[u32], pc: usize) -> Row {
        self.rows[(uops[pc] & 0xff) as usize]
    }
}

/// One core.
pub(crate) struct Core {
    pub(crate) index: usize,
    pub(crate) threads: Vec<Thread>,
    pub(crate) stack: Stack,
    /// When the last of its threads came to the barrier.
    pub(crate) arrival: Cycle,
    /// Threads that still have or may still get a task.
    pub(crate) running: u32,
    /// Least [`Thread::next`] of the threads: nothing happens before.
    pub(crate) wake: Cycle,
    /// Where the round robin stands.
    turn: usize,
    pub(crate) issued: u64,
}

impl Core {
    pub(crate) fn new(index: usize) -> Core {
        Core {
            index,
            threads: Vec::new(),
            stack: Stack::default(),
            arrival: 0,
            running: 0,
            wake: Cycle::MAX,
            turn: 0,
            issued: 0,
        }
    }

    /// Sends the first `count` threads to the task counter at `now`; the others sleep.
    pub(crate) fn start_step(&mut self, count: usize, now: Cycle) {
        for (index, thread) in self.threads.iter_mut().enumerate() {
            let takes_part = index < count;
            thread.state = if takes_part { State::Ended } else { State::Done };
            thread.next = if takes_part { When::new(now, Cause::Queue) } else { When::NEVER };
        }
        self.stack.start(now);
        (self.issued, self.arrival) = (0, now);
        self.running = count as u32;
        self.update_wake();
    }

    /// Finds [`Core::wake`] again after threads moved.
    #[inline]
    pub(crate) fn update_wake(&mut self) {
        self.wake = self.threads.iter().map(|thread| thread.next.at()).min().unwrap_or(Cycle::MAX);
    }

    /// Whether `thread` has been sent to the task counter and not yet got anything.
    pub(crate) fn takes_part(&self, thread: usize) -> bool {
        self.threads.get(thread).is_some_and(|thread| thread.state == State::Ended)
    }

    /// A thread that has come to the end of its stream by `now`.
    pub(crate) fn ended(&self, now: Cycle) -> Option<usize> {
        self.threads.iter().position(|thread| thread.state == State::Ended && thread.next.at() <= now)
    }

    /// One cycle: every gather whose next line is due hands it on, and the next thread in turn that can issue does.
    pub(crate) fn step(&mut self, tables: &CoreTables, hierarchy: &mut Hierarchy, now: Cycle) {
        let count = self.threads.len();
        let mut chosen = None;
        let mut index = self.turn;
        for _ in 0..count {
            index = if index + 1 >= count { 0 } else { index + 1 };
            let thread = &mut self.threads[index];
            if thread.next.at() > now {
                continue;
            }
            match thread.state {
                State::Walking => thread.continue_walk(tables, hierarchy, self.index, now),
                State::Running if chosen.is_none() => chosen = Some(index),
                State::Running | State::Ended | State::Done => {}
            }
        }
        if let Some(index) = chosen {
            let thread = &mut self.threads[index];
            let waited_for = thread.next;
            let (before, mut pc) = (thread.pc, thread.pc);
            let mut row = tables.row(&thread.stream.uops, pc);
            thread.next =
                thread.issue::<true>(tables, hierarchy, self.index, When::bare(now), &mut pc, &mut row);
            thread.pc = pc;
            thread.note_end();
            self.issued += (pc - before) as u64;
            self.stack.issue(now, waited_for);
            self.turn = index;
        }
        self.update_wake();
        // One issue a cycle: threads that are ready now go on in the next.
        self.wake = self.wake.max(now + 1);
    }
}

impl Thread {
    /// Issues the uop at `pc`, whose class has `row`, at `now`, a bare time, and the one after it if they pair; moves `pc` and
    /// `row` past them. Returns when the thread can go on. Lines of a gather are handed on when they are due if `STEPWISE`
    /// (`cycle`), else at once (`windowed`).
    #[inline(always)]
    fn issue<const STEPWISE: bool>(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        now: When,
        pc: &mut usize,
        row: &mut Row,
    ) -> When {
        let free = now.plus(tables.issue_interval);
        let held = self.execute::<STEPWISE>(tables, hierarchy, core, now, *pc, *row).max(free);
        *pc += 1;
        if *pc >= self.stream.uops.len() || STEPWISE && self.state == State::Walking {
            return held;
        }

        // The second pipe: the next uop, if its sources are there now and the two need different things.
        let first_row = *row;
        *row = tables.row(&self.stream.uops, *pc);
        let sources = self.sources(*pc, *row);
        if !(first_row.pairs_with(*row) && held == free && sources.are_there(now)) {
            return sources.after(held);
        }
        let held = self.execute::<STEPWISE>(tables, hierarchy, core, now, *pc, *row).max(free);
        *pc += 1;
        if *pc >= self.stream.uops.len() || STEPWISE && self.state == State::Walking {
            return held;
        }
        *row = tables.row(&self.stream.uops, *pc);
        self.sources(*pc, *row).after(held)
    }

    /// Notices that the last uop of the stream has been issued, and its lines handed on.
    #[inline(always)]
    fn note_end(&mut self) {
        if self.pc == self.stream.uops.len() && self.state == State::Running {
            self.state = State::Ended;
        }
    }

    /// When the sources of the uop at `pc` are there.
    #[inline(always)]
    fn sources(&mut self, pc: usize, row: Row) -> Sources {
        let uop = self.stream.uops[pc];
        // Distance 0 looks at the uop's own place, where it finds 0: always ready.
        self.ready[pc % 256] = When::ZERO;
        let ready = |distance: u32| self.ready[pc.wrapping_sub(distance as usize) % 256];
        Sources([ready(uop >> 8 & 0xff), ready(uop >> 16 & 0xff), ready(uop >> 24 & row.third_producer())])
    }

    /// Executes the uop at `pc` at `now`, a bare time: its result's time goes to the ready ring. Returns until when it holds
    /// its thread.
    #[inline(always)]
    fn execute<const STEPWISE: bool>(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        now: When,
        pc: usize,
        row: Row,
    ) -> When {
        if row.is_compute() {
            self.ready[pc % 256] = now.plus(row.latency());
            return When::ZERO;
        }
        self.execute_other::<STEPWISE>(tables, hierarchy, core, now, pc)
    }

    /// The same for a branch or a uop that touches memory.
    #[inline(never)]
    fn execute_other<const STEPWISE: bool>(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        now: When,
        pc: usize,
    ) -> When {
        let uop = self.stream.uops[pc];
        let row = tables.rows[(uop & 0xff) as usize];
        if row.is_branch() {
            // Nobody reads its result.
            return now.plus(row.latency());
        }
        let mut due = now.at();
        if uop >> 24 == 1 {
            // The common case: one line, which is handed on here and now.
            match self.one_line(tables, hierarchy, core, now, row, pc) {
                Some(Ok(held)) => return held,
                Some(Err(retry)) => due = retry,
                None => {}
            }
        }
        let walk = Walk::new(pc, row, uop >> 24, now.at(), due);
        self.advance_walk::<STEPWISE>(tables, hierarchy, core, walk, now.at())
    }

    /// The same for a load, a store, a gather, a scatter or an L1 prefetch of one line; `None` for others. `Err` is the time
    /// to ask again, when all MSHRs are taken.
    #[inline(always)]
    fn one_line(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        now: When,
        row: Row,
        pc: usize,
    ) -> Option<Result<When, Cycle>> {
        let lines = &self.stream.lines[self.line_pc..];
        let mut ready = now.plus(row.latency());
        let mut held = When::ZERO;
        if let Some(intent) = row.loads_or_stores() {
            let access = match walk::load_or_store(hierarchy, core, lines, intent, now.at()) {
                Ok(access) => access,
                Err(retry) => return Some(Err(retry)),
            };
            ready = ready.max(access.ready);
            if row.is_gather() {
                held = now.plus(tables.gather_hold);
            }
            if tables.blocks_on_l1_miss && access.missed {
                held = held.max(ready);
            }
        } else if row.is_l1_prefetch() {
            // Nothing waits for it.
            if let Err(retry) = hierarchy.access(core, lines[0], Intent::Read, now.at()) {
                return Some(Err(retry));
            }
        } else {
            return None;
        }
        self.line_pc += 1;
        self.ready[pc % 256] = ready;
        Some(Ok(held))
    }

    /// Goes on with a gather whose next line is due.
    fn continue_walk(&mut self, tables: &CoreTables, hierarchy: &mut Hierarchy, core: usize, now: Cycle) {
        let hold = self.advance_walk::<true>(tables, hierarchy, core, self.walk, now);
        if self.state == State::Walking {
            self.next = hold;
            return;
        }
        self.next = hold.max(When::new(now + 1, Cause::Dependency));
        if self.pc < self.stream.uops.len() {
            let row = tables.row(&self.stream.uops, self.pc);
            self.next = self.sources(self.pc, row).after(self.next);
        }
        self.note_end();
    }
}
