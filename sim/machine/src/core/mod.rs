//! A core with its caches, a room of its own: hardware threads that issue in order, one thread a cycle, two uops when they pair.
//!
//! ```text
//! thread 0 ─ ready ring, next ─┐
//! thread 1 ─ ready ring, next ─┤ round robin      U: any uop
//! thread 2 ─ ready ring, next ─┼────────────► issue
//! thread 3 ─ ready ring, next ─┘                  V: scalar, mask, loads, stores, branch
//! ```
//!
//! A core runs alone for a window, or for a cycle, and leaves [`Request`](crate::exchange::Request)s behind; what it needs of
//! others comes as [`Message`]s before the next. Nothing else of the machine can be reached from here, so cores may run on
//! any number of host threads.
//!
//! Every time of a thread carries its cause (see [`When`]), so that a cycle in which nothing issues is charged to what the
//! thread that issues next has waited for.

mod cycle;
mod stack;
mod table;
mod thread;
mod waiting;
mod walk;
mod window;

pub(crate) use stack::Stack;
pub(crate) use table::{Kind, Row, table};
pub(crate) use thread::{State, Thread};

use crate::Cycle;
use crate::cache::{AccessRules, CoreCaches, Intent, Slot};
use crate::config::MachineSpec;
use crate::counters::{AtomicCounters, Cause};
use crate::exchange::{Message, Pull};
use crate::when::{Span, When};
use lrbsim_isa::arena::TASK_COUNTER_LINE;
use lrbsim_isa::stream::Stream;
use waiting::{WaitList, Waiter, Waiting};
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
    access: AccessRules,
    /// Until the thread that issued can issue again.
    issue_interval: Span,
    blocks_on_l1_miss: bool,
    gather_overhead: Cycle,
    atomic_cycles: Cycle,
    /// From the task counter to the first uop of a task; `None` when tasks are there for the asking.
    dispatch_cycles: Option<Cycle>,
}

impl CoreTables {
    pub(crate) fn new(spec: &MachineSpec) -> CoreTables {
        CoreTables {
            rows: table(spec),
            access: AccessRules::new(spec),
            issue_interval: Span::new(spec.core.issue_interval, Cause::Dependency),
            blocks_on_l1_miss: spec.core.blocks_on_l1_miss,
            gather_overhead: spec.core.gather_overhead,
            atomic_cycles: spec.atomic_cycles,
            dispatch_cycles: (!spec.ideal.queue).then_some(spec.dispatch_cycles),
        }
    }

    /// The row of a uop.
    #[inline(always)]
    fn row(&self, uop: u32) -> Row {
        self.rows[(uop & 0xff) as usize]
    }
}

/// What the threads of a core share. First comes what others look at between two windows.
#[repr(C)]
pub(crate) struct Shared {
    /// Threads that ask for tasks, to leave with the requests.
    pub(crate) pulls: Vec<Pull>,
    /// Buffers of streams that have been run.
    pub(crate) spent: Vec<Stream>,
    pub(crate) caches: CoreCaches,
    waiting: WaitList,
    /// Room for those that wait no longer.
    resolved: Vec<Waiting>,
    pub(crate) atomics: AtomicCounters,
    /// Uops of the streams that have been run in this step.
    pub(crate) issued: u64,
}

/// One core. What others look at between two windows lies in two lines of the host's cache, since another host thread may
/// have run the core.
#[repr(C, align(64))]
pub(crate) struct Core {
    /// Least [`Thread::next`] of the threads, or the time of a message: nothing happens before.
    pub(crate) wake: Cycle,
    /// What the uncore has told it and it has not looked at yet, in order.
    pub(crate) inbox: Vec<Message>,
    /// Threads that still have or may still get a task.
    pub(crate) running: u32,
    pub(crate) shared: Shared,
    pub(crate) index: usize,
    pub(crate) threads: Vec<Thread>,
    pub(crate) stack: Stack,
    /// When the last of its threads came to the barrier.
    pub(crate) arrival: Cycle,
    /// Where the round robin stands.
    turn: usize,
}

impl Core {
    /// A core that has never run, of a machine.
    pub(crate) fn new(index: usize, spec: &MachineSpec) -> Core {
        let shared = Shared {
            caches: CoreCaches::new(spec),
            waiting: WaitList::default(),
            resolved: Vec::new(),
            pulls: Vec::new(),
            atomics: AtomicCounters::default(),
            issued: 0,
            spent: Vec::new(),
        };
        Core {
            index,
            threads: Vec::new(),
            shared,
            inbox: Vec::new(),
            stack: Stack::default(),
            arrival: 0,
            running: 0,
            wake: Cycle::MAX,
            turn: 0,
        }
    }

    /// Readies the first `count` threads of at most `per_core` for a step that begins at `now`; the others sleep.
    pub(crate) fn start_step(&mut self, count: usize, per_core: u32, now: Cycle) {
        while self.threads.len() < count {
            let index = self.threads.len() as u8;
            self.threads.push(Thread::new(index, self.index as u32 * per_core + u32::from(index)));
        }
        for (index, thread) in self.threads.iter_mut().enumerate() {
            thread.state = if index < count { State::Ended } else { State::Done };
            thread.next = When::NEVER;
        }
        self.stack.start(now);
        (self.shared.issued, self.arrival, self.turn) = (0, now, 0);
        self.running = count as u32;
        self.update_wake();
    }

    /// Has `thread` of a core that has been readied ask for its first task at `now`.
    pub(crate) fn ask_first(&mut self, tables: &CoreTables, thread: usize, now: Cycle) {
        self.shared.caches.ports.begin(now);
        self.threads[thread].next = When::new(now, Cause::Queue);
        self.threads[thread].pull(tables, &mut self.shared);
        self.update_wake();
    }

    /// Finds [`Core::wake`] again after threads moved.
    #[inline]
    pub(crate) fn update_wake(&mut self) {
        self.wake = self.threads.iter().map(|thread| thread.next.at()).min().unwrap_or(Cycle::MAX);
    }

    /// Notes what the uncore says, to be looked at before the core runs on.
    #[inline]
    pub(crate) fn tell(&mut self, message: Message) {
        self.wake = self.wake.min(message.wakes_at());
        self.inbox.push(message);
    }

    /// Looks at everything that the uncore has said, and grants claims that are due by `claims_until`; nothing will happen before
    /// `floor` any more.
    #[inline]
    pub(crate) fn read_inbox(&mut self, tables: &CoreTables, floor: Cycle, claims_until: Cycle) {
        if !self.inbox.is_empty() {
            self.read_messages(tables, floor);
        }
        self.shared.caches.grant_claims(claims_until);
    }

    #[inline(never)]
    fn read_messages(&mut self, tables: &CoreTables, floor: Cycle) {
        let mut answered = false;
        let mut inbox = std::mem::take(&mut self.inbox);
        for message in inbox.drain(..) {
            match message {
                Message::Answer { mshr, fill, owned, kept } => {
                    assert!(
                        fill.at() >= floor,
                        "Chip.Core[{}], cycle {floor}: an answer for cycle {}, which has passed",
                        self.index,
                        fill.at()
                    );
                    self.shared.caches.answer(mshr, fill, owned, kept);
                    answered = true;
                }
                Message::Release { mshr, at } => {
                    self.shared.caches.l2_mshrs.release(mshr.into(), at);
                    answered = true;
                }
                Message::Claim(claim) => self.shared.caches.claim(claim),
                Message::Tasks { thread, streams, from } => {
                    let thread = &mut self.threads[usize::from(thread)];
                    thread.queue.extend(streams);
                    thread.fed_from = Some(from);
                    self.running -= thread.start_fed(tables, &mut self.shared, &mut self.arrival);
                }
            }
        }
        self.inbox = inbox;
        if answered {
            self.resolve(tables, floor);
        }
        self.update_wake();
    }

    /// Gives their times to uops whose lines have got them, and wakes threads.
    fn resolve(&mut self, tables: &CoreTables, floor: Cycle) {
        let Core { threads, shared, arrival, running, .. } = self;
        if !shared.waiting.is_empty() {
            let mut done = std::mem::take(&mut shared.resolved);
            let Shared { caches, waiting, .. } = shared;
            waiting.resolve(caches, tables.atomic_cycles, floor, |waiting| done.push(waiting));
            for waiting in done.drain(..) {
                let thread = &mut threads[usize::from(waiting.thread)];
                *running -= thread.take_result(tables, shared, waiting, arrival);
            }
            shared.resolved = done;
        }
        for thread in threads {
            thread.look_again(floor);
        }
    }

    /// A number that grows whenever the core gets on.
    pub(crate) fn progress(&self) -> u64 {
        let atomics = self.shared.atomics.operations + self.shared.atomics.task_pulls;
        let caches = &self.shared.caches;
        // What is issued of a stream counts while it runs, and with `issued` once it has been given back.
        let under_way: u64 = self.threads.iter().map(|thread| thread.pc as u64).sum();
        self.shared.issued
            + under_way
            + atomics
            + caches.l1_counters.hits
            + caches.l1_counters.misses
            + caches.l2_counters.hits
    }
}

impl Thread {
    /// Issues the uop at `pc`, whose class has `row`, at `now`, a bare time, and the one after it if they pair; moves `pc` and
    /// `row` past them. Returns when the thread can go on, `Err` when there it has come to the end of its stream;
    /// [`When::NEVER`] when the uncore or more lines that are not due before `end` decide.
    #[inline(always)]
    fn issue(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        now: When,
        end: Cycle,
        pc: &mut usize,
        row: &mut Row,
    ) -> Result<When, When> {
        let free = now.plus(tables.issue_interval);
        let first_row = *row;
        let held = self.execute(tables, shared, now, end, free, *pc, *row);
        *pc += 1;
        self.held = held;
        let Some(uop) = self.stream.uops.get(*pc).copied() else { return Err(held) };

        // The second pipe: the next uop, if its sources are there now and the two need different things.
        *row = tables.row(uop);
        let sources = self.sources(uop, *pc, *row);
        if !(first_row.pairs_with(*row) && held == free && sources.are_there(now)) {
            return Ok(sources.after(held));
        }
        let held = self.execute(tables, shared, now, end, free, *pc, *row);
        *pc += 1;
        self.held = held;
        let Some(uop) = self.stream.uops.get(*pc).copied() else { return Err(held) };
        *row = tables.row(uop);
        Ok(self.sources(uop, *pc, *row).after(held))
    }

    /// After a run of issues: notices that a walk has more lines, or that the stream has come to its end.
    #[inline(always)]
    fn stop_issuing(&mut self) {
        if self.state == State::Walking {
            self.next = self.walk.next();
        } else if self.pc == self.stream.uops.len() && self.state == State::Running {
            self.state = State::Ended;
        }
    }

    /// When the sources of `uop`, which is at `pc` and has `row`, are there.
    #[inline(always)]
    fn sources(&mut self, uop: u32, pc: usize, row: Row) -> Sources {
        // Distance 0 looks at the uop's own place, where it finds 0: always ready.
        self.ready[pc % 256] = When::ZERO;
        let ready = |distance: u32| self.ready[pc.wrapping_sub(distance as usize) % 256];
        let third = uop >> 24 & row.third_producer();
        Sources([ready(uop >> 8 & 0xff), ready(uop >> 16 & 0xff), ready(third)])
    }

    /// Executes the uop at `pc`, which has `row`, at `now`, a bare time: its result's time goes to the ready ring. Returns until when it holds its
    /// thread, at least until `free`.
    #[inline(always)]
    #[expect(
        clippy::too_many_arguments,
        reason = "place and row are kept in registers of the host while a window runs"
    )]
    fn execute(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        now: When,
        end: Cycle,
        free: When,
        pc: usize,
        row: Row,
    ) -> When {
        if row.is_compute() {
            self.ready[pc % 256] = now.plus(row.latency());
            return free;
        }
        self.execute_other(tables, shared, now, end, pc).max(free)
    }

    /// Executes a branch or a uop that touches memory.
    #[inline(never)]
    fn execute_other(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        now: When,
        end: Cycle,
        pc: usize,
    ) -> When {
        let uop = self.stream.uops[pc];
        let row = tables.row(uop);
        let lines = uop >> 24;
        if lines == 1
            && let Some(intent) = row.loads_or_stores()
            && shared.caches.ports.take_now(now.at())
        {
            // The common case: one line, which the L1 takes here and now, and has.
            let line = self.line();
            return match shared.caches.l1_hit(&tables.access, line, intent != Intent::Read, now.at()) {
                Ok(()) => {
                    self.line_pc += 1;
                    self.ready[pc % 256] = now.plus(row.latency());
                    When::ZERO
                }
                Err(slot) => self.miss_one_line(tables, shared, (pc, row), slot, now, end),
            };
        }
        if let Some(intent) = row.loads_or_stores() {
            return self.load_or_store(tables, shared, (pc, row, lines), intent, now, end);
        }
        if row.is_branch() {
            // Nobody reads its result.
            return now.plus(row.latency());
        }
        self.begin_walk(tables, shared, (pc, row, lines), now, end)
    }

    /// Begins to hand on the lines of the uop at `pc`.
    #[inline(never)]
    fn begin_walk(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        (pc, row, lines): (usize, Row, u32),
        now: When,
        end: Cycle,
    ) -> When {
        let walk = Walk::new(pc, row, lines, now.at());
        self.advance_walk(tables, shared, walk, end)
    }

    /// Hands on the lines of the load or store at `pc`, one a cycle, as long as the L1 takes them before `end` and has them; from
    /// the first that it has not, the uop is walked.
    #[inline(never)]
    fn load_or_store(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        (pc, row, lines): (usize, Row, u32),
        intent: Intent,
        now: When,
        end: Cycle,
    ) -> When {
        let mut due = now.at();
        for done in 0..lines {
            let port = shared.caches.ports.take(due, end);
            let is_there = port.is_some_and(|at| {
                due = at;
                shared.caches.l1_hit(&tables.access, self.line(), intent != Intent::Read, at).is_ok()
            });
            if !is_there {
                let walk = Walk::new(pc, row, lines, now.at()).behind(done, due, port.is_some());
                return self.advance_walk(tables, shared, walk, end);
            }
            self.line_pc += 1;
            due += 1;
        }
        self.ready[pc % 256] = When::bare(due - 1).plus(row.latency());
        When::new(due, Cause::L1)
    }

    /// Hands on the one line of the load or store at `pc`, which the L1 has taken at `now` and found in `slot` if at all, but not
    /// ready.
    #[inline(never)]
    fn miss_one_line(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        (pc, row): (usize, Row),
        slot: Option<Slot>,
        now: When,
        end: Cycle,
    ) -> When {
        let line = self.line();
        let intent = row.kind().intent();
        let result = shared.load_or_store_beyond_hit(tables, line, slot, intent, now.at());
        let walk = Walk::new(pc, row, 1, now.at()).behind(0, now.at(), true);
        self.end_one_line(tables, shared, walk, line, result, end)
    }

    /// Goes on with a walk whose next line is due before `end`.
    fn continue_walk(&mut self, tables: &CoreTables, shared: &mut Shared, end: Cycle) {
        self.state = State::Running;
        let held = self.advance_walk(tables, shared, self.walk, end).max(self.held_by_issue());
        if self.state == State::Walking {
            self.next = self.walk.next();
            return;
        }
        self.held = held;
        self.next = self.next_issue();
        self.stop_issuing();
    }

    /// What the issue of a uop that is still walking holds its thread for: over long since, but for the walk.
    fn held_by_issue(&self) -> When {
        if self.held == When::NEVER { When::ZERO } else { self.held }
    }

    /// When the thread can issue its next uop, or has come to the end of its stream.
    fn next_issue(&mut self) -> When {
        match self.stream.uops.get(self.pc).copied() {
            Some(uop) => self.sources(uop, self.pc, self.row).after(self.held),
            None => self.held,
        }
    }

    /// Takes the time of a result, or of the task counter, that was left open. Returns how many threads ended: 1 or 0.
    fn take_result(
        &mut self,
        tables: &CoreTables,
        shared: &mut Shared,
        waiting: Waiting,
        arrival: &mut Cycle,
    ) -> u32 {
        match waiting.waiter {
            Waiter::Pull => {
                self.counter_read = waiting.ready;
                return self.start_fed(tables, shared, arrival);
            }
            Waiter::Uop { place, generation } => {
                if generation == self.generation && self.pc - place <= 255 {
                    self.ready[place % 256] = waiting.ready;
                }
                if waiting.holds {
                    self.holders -= 1;
                    self.held = self.held_by_issue().max(waiting.hold).max(waiting.ready);
                }
            }
        }
        0
    }

    /// After answers of the uncore: finds out again when it can go on, if that was for the uncore to say.
    fn look_again(&mut self, floor: Cycle) {
        if self.next != When::NEVER || self.holders > 0 {
            return;
        }
        match self.state {
            State::Running => self.next = self.next_issue(),
            State::Walking => {
                self.walk.retry(floor);
                self.next = self.walk.next();
            }
            State::Ended if self.held != When::NEVER => self.next = self.held.not_before(floor),
            State::Ended | State::Asking | State::Done => {}
        }
    }

    /// Goes on with what is not an issue: a walk, or the end of a stream.
    #[inline(never)]
    fn act(&mut self, tables: &CoreTables, shared: &mut Shared, end: Cycle) {
        match self.state {
            State::Walking => self.continue_walk(tables, shared, end),
            State::Ended => self.take_next(tables, shared),
            State::Running | State::Asking | State::Done => {}
        }
    }

    /// At the end of a stream: begins the next one of the chunk, or asks for tasks.
    fn take_next(&mut self, tables: &CoreTables, shared: &mut Shared) {
        match self.queue.pop_front() {
            Some(stream) => {
                self.begin(tables, shared, stream, self.next);
            }
            None => self.pull(tables, shared),
        }
    }

    /// Adds to the task counter and asks for what that gives, at [`Thread::next`]; tries again later if all MSHRs are taken.
    fn pull(&mut self, tables: &CoreTables, shared: &mut Shared) {
        let now = self.next.at();
        if tables.dispatch_cycles.is_some() {
            match shared.locked(tables, TASK_COUNTER_LINE.0, now) {
                Err(again) if again.at >= When::NEVER.at() => {
                    (self.next, self.held) = (When::NEVER, When::new(now, Cause::Queue));
                    return;
                }
                Err(again) => {
                    self.next = When::new(again.at, Cause::Queue);
                    return;
                }
                Ok(access) if access.ready == When::NEVER => {
                    let id = shared.waiting.add(self.index, Waiter::Pull);
                    shared.waiting.wait_for(id, access, Some(TASK_COUNTER_LINE.0));
                    let open = shared.waiting.hand_on(id);
                    debug_assert!(open.is_none());
                    self.counter_read = When::NEVER;
                }
                Ok(access) => self.counter_read = access.ready,
            }
            shared.atomics.task_pulls += 1;
        } else {
            self.counter_read = When::bare(now);
        }
        shared.pulls.push(Pull { time: now, thread: self.index });
        (self.state, self.next, self.fed_from) = (State::Asking, When::NEVER, None);
    }

    /// Begins with the first of its new tasks, or goes to the barrier if it got none, once it knows both what it got and when
    /// the task counter has been read. Returns how many threads went to the barrier: 1 or 0.
    fn start_fed(&mut self, tables: &CoreTables, shared: &mut Shared, arrival: &mut Cycle) -> u32 {
        let Some(from) = self.fed_from else { return 0 };
        if self.counter_read == When::NEVER {
            return 0;
        }
        self.fed_from = None;
        let ready = self.counter_read.at() + tables.dispatch_cycles.unwrap_or(0);
        match self.queue.pop_front() {
            Some(stream) => {
                self.begin(tables, shared, stream, When::new(ready.max(from), Cause::Queue));
                0
            }
            None => {
                self.state = State::Done;
                self.next = When::NEVER;
                self.give_back(shared, Stream::default());
                *arrival = (*arrival).max(ready);
                1
            }
        }
    }
}
