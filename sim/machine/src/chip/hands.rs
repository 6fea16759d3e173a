//! Who runs the cores on the host: one thread, or a crew of them.
//!
//! Cores do not know of one another inside a window, and each host thread has cores of its own, so what comes out does not
//! depend on who is faster. Between two windows the calling thread alone has everything.

use super::cores::{Cores, Group};
use super::step::{Step, Tally};
use crate::Cycle;
use crate::core::CoreTables;
use crossbeam_utils::CachePadded;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Windows in which fewer cores act are run by the calling thread: waking the others costs more.
const CORES_FOR_CREW: usize = 4;

/// Looks that a host thread takes before it gives its processor away: a few times as long as a window lasts. On a host that has
/// other work, that may be for thousands of windows.
const SPINS_MAX: u32 = 5_000;

/// How late the crew may be, in points, before the captain runs alone for a while. A window without anybody late takes one off.
const LATE_MAX: u32 = 400;

/// Points that a window in which somebody is late adds.
const LATE: u32 = 100;

/// Windows that the captain then runs alone: twice as many each time, until the crew is in time again.
const WINDOWS_ALONE: Range<u32> = 2_000..500_000;

/// Times that a host thread gives its processor away before it sleeps between two looks.
const YIELDS_AWAKE_MAX: u32 = 200;

/// What runs cores and records tasks.
pub(super) trait Hands {
    /// Runs every core that takes part from `start` to before `end`.
    fn run_window(&mut self, cores: &mut Cores, tables: &CoreTables, start: Cycle, end: Cycle);

    /// Records `tasks`, the next of `step`; returns false, and does nothing, when there is nobody to share them with.
    fn record(&mut self, step: &mut Step<'_>, tasks: Range<u32>) -> bool;
}

/// Runs the first `active` cores of a group from `start` to before `end`.
fn run_group(group: &mut Group, active: usize, tables: &CoreTables, start: Cycle, end: Cycle) {
    for index in 0..active.min(group.len()) {
        if let Some(Some(next)) = group.get(index + 1) {
            next.prefetch();
        }
        if let Some(core) = &mut group[index] {
            core.run_window(tables, start, end);
        }
    }
}

/// Cores below `active` of `groups` that are in group `group`.
fn active_in(active: usize, group: usize, groups: usize) -> usize {
    (active + groups - 1 - group) / groups
}

/// The calling thread, alone.
pub(super) struct Alone;

impl Hands for Alone {
    fn run_window(&mut self, cores: &mut Cores, tables: &CoreTables, start: Cycle, end: Cycle) {
        let active = cores.active();
        let count = cores.groups().len();
        for (number, group) in cores.groups().iter_mut().enumerate() {
            run_group(group, active_in(active, number, count), tables, start, end);
        }
    }

    fn record(&mut self, _step: &mut Step<'_>, _tasks: Range<u32>) -> bool {
        false
    }
}

/// What the host threads of a crew do next.
#[derive(Debug, Clone, Copy)]
enum Job {
    Window { start: Cycle, end: Cycle },
    Record { end: u32 },
    Stop,
}

/// What a host thread has recorded: tasks with their streams, spare buffers, and what the tasks did.
type Recorded = (Vec<(u32, Stream)>, Vec<Stream>, Tally);

/// What a crew shares.
pub(super) struct Crew<'a> {
    tables: &'a CoreTables,
    source: &'a dyn TaskSource,
    active: usize,
    job: Mutex<Job>,
    /// Jobs so far.
    epoch: CachePadded<AtomicU64>,
    /// Host threads that are done with the job.
    done: CachePadded<AtomicUsize>,
    failed: AtomicBool,
    /// The cores of each host thread, while it runs them.
    groups: Vec<Mutex<Group>>,
    next_task: AtomicU32,
    /// What each host thread has recorded.
    recorded: Vec<Mutex<Recorded>>,
}

impl<'a> Crew<'a> {
    pub(super) fn new(
        tables: &'a CoreTables,
        source: &'a dyn TaskSource,
        active: usize,
        threads: usize,
    ) -> Crew<'a> {
        Crew {
            tables,
            source,
            active,
            job: Mutex::new(Job::Stop),
            epoch: CachePadded::new(AtomicU64::new(0)),
            done: CachePadded::new(AtomicUsize::new(0)),
            failed: AtomicBool::new(false),
            groups: (0..threads).map(|_| Mutex::new(Group::new())).collect(),
            next_task: AtomicU32::new(0),
            recorded: (0..threads).map(|_| Mutex::default()).collect(),
        }
    }

    /// What host thread `number` does, from 1 on, until the crew is dismissed.
    pub(super) fn work(&self, number: usize) {
        let _told = TellOfFailure(&self.failed);
        let mut epoch = 0;
        loop {
            let seen = epoch;
            wait_until(|| {
                epoch = self.epoch.load(Ordering::Acquire);
                epoch != seen
            });
            let job = *lock(&self.job);
            match job {
                Job::Window { start, end } => self.run(number, start, end),
                Job::Record { end } => self.record_some(number, end),
                Job::Stop => return,
            }
            self.done.fetch_add(1, Ordering::Release);
        }
    }

    fn run(&self, number: usize, start: Cycle, end: Cycle) {
        let active = active_in(self.active, number, self.groups.len());
        run_group(&mut lock(&self.groups[number]), active, self.tables, start, end);
    }

    /// Records tasks as long as there are any below `end` that nobody has begun.
    fn record_some(&self, number: usize, end: u32) {
        let (recorded, spare, tally) = &mut *lock(&self.recorded[number]);
        loop {
            let task = self.next_task.fetch_add(1, Ordering::Relaxed);
            if task >= end {
                return;
            }
            let mut stream = spare.pop().unwrap_or_default();
            tally.record(self.source, task, &mut stream);
            recorded.push((task, stream));
        }
    }

    /// Has the others begin a job.
    fn begin(&self, job: Job) {
        *lock(&self.job) = job;
        self.done.store(0, Ordering::Relaxed);
        self.epoch.fetch_add(1, Ordering::Release);
    }

    /// Waits for the others to end it; returns how often it gave its processor away meanwhile.
    fn wait(&self) -> u32 {
        let others = self.groups.len() - 1;
        wait_until(|| {
            assert!(!self.failed.load(Ordering::Relaxed), "a host thread of the chip has failed");
            self.done.load(Ordering::Acquire) == others
        })
    }
}

/// The calling thread and its crew, which is dismissed at the end.
pub(super) struct Captain<'a> {
    crew: &'a Crew<'a>,
    /// How late the crew has been of late: [`LATE`] for a window in which somebody was.
    late: u32,
    /// Windows that it runs alone before it calls the crew again, and how many it will the next time.
    alone: u32,
    alone_next: u32,
}

impl<'a> Captain<'a> {
    pub(super) fn new(crew: &'a Crew<'a>) -> Captain<'a> {
        Captain { crew, late: 0, alone: 0, alone_next: WINDOWS_ALONE.start }
    }
}

impl Drop for Captain<'_> {
    fn drop(&mut self) {
        self.crew.begin(Job::Stop);
    }
}

impl Hands for Captain<'_> {
    fn run_window(&mut self, cores: &mut Cores, tables: &CoreTables, start: Cycle, end: Cycle) {
        let mut acting = 0;
        cores.each_active(|core| acting += usize::from(core.wake < end));
        if acting < CORES_FOR_CREW || self.alone > 0 {
            self.alone = self.alone.saturating_sub(1);
            return Alone.run_window(cores, tables, start, end);
        }
        let groups = cores.groups();
        for (lent, group) in self.crew.groups.iter().zip(groups.iter_mut()) {
            std::mem::swap(&mut *lock(lent), group);
        }
        self.crew.begin(Job::Window { start, end });
        self.crew.run(0, start, end);
        // On a host that has other work too, windows wait for threads that have no processor. Who runs a core changes nothing.
        if self.crew.wait() > 0 {
            self.late += LATE;
            if self.late > LATE_MAX {
                (self.late, self.alone) = (0, self.alone_next);
                self.alone_next = (2 * self.alone_next).min(WINDOWS_ALONE.end);
            }
        } else if self.late > 0 {
            self.late -= 1;
        } else {
            self.alone_next = WINDOWS_ALONE.start;
        }
        for (lent, group) in self.crew.groups.iter().zip(groups.iter_mut()) {
            std::mem::swap(&mut *lock(lent), group);
        }
    }

    fn record(&mut self, step: &mut Step<'_>, tasks: Range<u32>) -> bool {
        let count = tasks.len();
        if count < 2 {
            return false;
        }
        let share = count.div_ceil(self.crew.recorded.len());
        for recorded in &self.crew.recorded {
            let (_, spare, _) = &mut *lock(recorded);
            let from = step.spare.len() - share.saturating_sub(spare.len()).min(step.spare.len());
            spare.extend(step.spare.drain(from..));
        }
        self.crew.next_task.store(tasks.start, Ordering::Relaxed);
        self.crew.begin(Job::Record { end: tasks.end });
        self.crew.record_some(0, tasks.end);
        self.crew.wait();
        let (mut streams, mut tally) = (Vec::with_capacity(count), Tally::default());
        for recorded in &self.crew.recorded {
            let (some, spare, counts) = &mut *lock(recorded);
            streams.append(some);
            step.spare.append(spare);
            tally.0 += &std::mem::take(counts).0;
        }
        streams.sort_unstable_by_key(|(task, _)| *task);
        step.add_recorded(streams.into_iter().map(|(_, stream)| stream), tally);
        true
    }
}

/// Tells the captain of a host thread that panics, so that nobody waits for it.
struct TellOfFailure<'a>(&'a AtomicBool);

impl Drop for TellOfFailure<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.store(true, Ordering::Relaxed);
        }
    }
}

/// A lock that nobody else holds: phases take turns.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits until `is_so`, at first with the processor, since windows are short; returns how often it gave that away.
fn wait_until(mut is_so: impl FnMut() -> bool) -> u32 {
    let (mut spins, mut yields) = (0, 0);
    while !is_so() {
        if spins < SPINS_MAX {
            spins += 1;
            std::hint::spin_loop();
            continue;
        }
        yields += 1;
        if yields < YIELDS_AWAKE_MAX {
            std::thread::yield_now();
        } else {
            std::thread::sleep(std::time::Duration::from_micros(50));
        }
    }
    yields
}
