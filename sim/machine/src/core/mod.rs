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
use crate::coherence::Hierarchy;
use crate::config::MachineSpec;
use crate::counters::Cause;
use lrbsim_isa::arena::{STACK_BASE_LINE, STACK_LINES};
use table::{Kind, Row, table};
use walk::Walk;

/// A time and what it was spent on, in one word that compares by time first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct When(u64);

impl When {
    pub(crate) const NEVER: When = When(u64::MAX);

    #[inline(always)]
    pub(crate) const fn new(at: Cycle, cause: Cause) -> When {
        When(at << 4 | cause as u64)
    }

    #[inline(always)]
    pub(crate) const fn at(self) -> Cycle {
        self.0 >> 4
    }

    /// The cause's place in [`Cause::ALL`].
    #[inline(always)]
    pub(crate) const fn cause_index(self) -> u8 {
        (self.0 & 15) as u8
    }
}

/// What does not change while a core runs.
pub(crate) struct CoreTables {
    rows: Box<[Row; 256]>,
    issue_interval: Cycle,
    blocks_on_l1_miss: bool,
    gather_interval_x256: u64,
    gather_overhead: Cycle,
    atomic_cycles: Cycle,
    l1_hit_cycles: Cycle,
    /// Whether lines of a gather are asked for cycle by cycle (`cycle`) rather than when it issues (`windowed`).
    stepwise: bool,
}

impl CoreTables {
    pub(crate) fn new(spec: &MachineSpec, stepwise: bool) -> CoreTables {
        CoreTables {
            rows: table(spec),
            issue_interval: spec.core.issue_interval,
            blocks_on_l1_miss: spec.core.blocks_on_l1_miss,
            gather_interval_x256: spec.core.gather_interval_x256,
            gather_overhead: spec.core.gather_overhead,
            atomic_cycles: spec.atomic_cycles,
            l1_hit_cycles: spec.l1d.hit_cycles,
            stepwise,
        }
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
    pub(crate) paired: u64,
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
            paired: 0,
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
        (self.issued, self.paired, self.arrival) = (0, 0, now);
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
            let uops = thread.issue(tables, hierarchy, self.index, now);
            self.issued += uops;
            self.paired += uops - 1;
            self.stack.issue(now, waited_for);
            self.turn = index;
        }
        self.update_wake();
        // One issue a cycle: threads that are ready now go on in the next.
        self.wake = self.wake.max(now + 1);
    }
}

impl Thread {
    /// Issues the next uop at `now`, and the one after it if they pair; returns how many. Then [`Thread::next`] says when
    /// the thread can go on.
    #[inline(always)]
    pub(crate) fn issue(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        now: Cycle,
    ) -> u64 {
        let first = self.stream.uops[self.pc];
        let row = tables.rows[(first & 0xff) as usize];
        let free = When::new(now + tables.issue_interval, Cause::Dependency);
        let mut hold = free;
        self.execute(tables, hierarchy, core, now, first, row, &mut hold);
        let mut uops = 1;

        // The second pipe: the next uop, if its sources are there now and the two need different things.
        if self.pc < self.stream.uops.len() {
            let second = self.stream.uops[self.pc];
            let second_row = tables.rows[(second & 0xff) as usize];
            let mut sources = self.sources(second, second_row);
            if row.pairs_with(second_row)
                && sources.at() <= now
                && hold == free
                && self.state == State::Running
            {
                self.execute(tables, hierarchy, core, now, second, second_row, &mut hold);
                uops = 2;
                if self.pc < self.stream.uops.len() {
                    let third = self.stream.uops[self.pc];
                    sources = self.sources(third, tables.rows[(third & 0xff) as usize]);
                } else {
                    sources = When(0);
                }
            }
            self.next = if self.state == State::Walking { hold } else { hold.max(sources) };
        } else {
            self.next = hold;
        }
        if self.pc == self.stream.uops.len() && self.state == State::Running {
            self.state = State::Ended;
        }
        uops
    }

    /// When the sources of the uop at `pc` are there.
    #[inline(always)]
    fn sources(&mut self, uop: u32, row: Row) -> When {
        // Distance 0 looks at the uop's own place, where it finds 0: always ready.
        self.ready[self.pc % 256] = When(0);
        let place = |distance: u32| self.pc.wrapping_sub(distance as usize) % 256;
        let a = self.ready[place(uop >> 8 & 0xff)];
        let b = self.ready[place(uop >> 16 & 0xff)];
        let c = self.ready[place(uop >> 24 & row.third_producer())];
        a.max(b).max(c)
    }

    /// Executes a uop at `now`: its result's time goes to the ready ring, and `hold` is moved to when its thread may go on.
    #[inline(always)]
    #[expect(
        clippy::too_many_arguments,
        reason = "inlined into its only caller; a struct would go through memory"
    )]
    fn execute(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        now: Cycle,
        uop: u32,
        row: Row,
        hold: &mut When,
    ) {
        let place = self.pc % 256;
        self.pc += 1;
        if row.is_compute() {
            self.ready[place] = When::new(now + row.latency(), Cause::Dependency);
            return;
        }
        if row.is_branch() {
            self.ready[place] = When::new(now + 1, Cause::Dependency);
            *hold = (*hold).max(When::new(now + row.latency(), Cause::Dependency));
            return;
        }
        if let Some(write) = row.access_writes()
            && uop >> 24 == 1
        {
            // The common case: one line, and the L1 has it.
            let line = self.stream.lines[self.line_pc];
            if hierarchy.l1_hit(core, line, write).is_ok() {
                self.line_pc += 1;
                self.ready[place] = When::new(now + row.latency(), Cause::L1);
                return;
            }
        }
        self.start_walk(tables, hierarchy, core, now, uop, hold);
    }

    /// Starts handing the lines of a memory uop to the caches.
    #[inline(never)]
    fn start_walk(
        &mut self,
        tables: &CoreTables,
        hierarchy: &mut Hierarchy,
        core: usize,
        now: Cycle,
        uop: u32,
        hold: &mut When,
    ) {
        let row = tables.rows[(uop & 0xff) as usize];
        let lines = uop >> 24;
        let walk = Walk::new(self.pc - 1, row, lines, now);
        let until = if tables.stepwise { now } else { Cycle::MAX };
        *hold = (*hold).max(self.advance_walk(tables, hierarchy, core, walk, until));
    }

    /// Goes on with a gather whose next line is due.
    fn continue_walk(&mut self, tables: &CoreTables, hierarchy: &mut Hierarchy, core: usize, now: Cycle) {
        let hold = self.advance_walk(tables, hierarchy, core, self.walk, now);
        if self.state == State::Walking {
            self.next = hold;
            return;
        }
        self.next = hold.max(When::new(now + 1, Cause::Dependency));
        if self.pc < self.stream.uops.len() {
            let uop = self.stream.uops[self.pc];
            self.next = self.next.max(self.sources(uop, tables.rows[(uop & 0xff) as usize]));
        } else {
            self.state = State::Ended;
        }
    }

    /// The line of the walk's next access.
    fn next_line(&self, kind: Kind) -> u32 {
        let line = self.stream.lines[self.line_pc];
        match kind {
            Kind::Spill(_) => STACK_BASE_LINE + self.number * STACK_LINES + line % STACK_LINES,
            _ => line,
        }
    }
}
