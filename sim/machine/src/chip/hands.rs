//! Who runs the cores on the host: one thread, or a crew of them.
//!
//! Cores do not know of one another inside a window, so what comes out does not depend on who runs them. Each host thread
//! begins with cores of its own, which its caches know from the last window, and who is done helps the others. Between two
//! windows the calling thread alone has everything.

use super::cores::{Cores, Slot};
use super::step::{StepTasks, Tally};
use crate::Cycle;
use crate::core::CoreTables;
use crate::work::{Work, doing};
use crossbeam_utils::CachePadded;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock, RwLockWriteGuard};

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
    fn record(&mut self, step: &mut StepTasks<'_>, tasks: Range<u32>) -> bool;
}

/// The calling thread, alone.
pub(super) struct Alone;

impl Hands for Alone {
    fn run_window(&mut self, cores: &mut Cores, tables: &CoreTables, start: Cycle, end: Cycle) {
        let _work = doing(Work::Issue);
        cores.each_active(|core| core.run_window(tables, start, end));
    }

    fn record(&mut self, _step: &mut StepTasks<'_>, _tasks: Range<u32>) -> bool {
        false
    }
}

/// What the host threads of a crew do next. As a word of the host no two in a row are equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    /// To wait for the first.
    None,
    /// To run cores from `start` to before `end`.
    Window {
        start: Cycle,
        end: Cycle,
    },
    /// To record tasks below `end`.
    Record {
        end: u32,
    },
    Stop,
}

impl Job {
    /// ```text
    /// bits 0..2   which
    ///      2..9   cycles of a window
    ///      9..64  its first cycle; of a record job, the end
    /// ```
    fn to_word(self) -> u64 {
        match self {
            Job::None => 0,
            Job::Window { start, end } => start << 9 | (end - start) << 2 | 1,
            Job::Record { end } => u64::from(end) << 9 | 2,
            Job::Stop => 3,
        }
    }

    fn from_word(word: u64) -> Job {
        let (first, cycles) = (word >> 9, word >> 2 & 127);
        match word & 3 {
            0 => Job::None,
            1 => Job::Window { start: first, end: first + cycles },
            2 => Job::Record { end: first as u32 },
            _ => Job::Stop,
        }
    }
}

/// Cores of a window that a host thread has yet to run.
///
/// ```text
/// bits 0..16   the first
///      16..32  the one behind the last
///      32..64  the window: the low half of its first cycle
/// ```
#[derive(Debug, Default)]
struct Share(AtomicU64);

impl Share {
    fn deal(&self, cores: Range<usize>, start: Cycle) {
        self.0.store(start << 32 | (cores.end as u64) << 16 | cores.start as u64, Ordering::Relaxed);
    }

    /// Takes a core of the window that begins at `start`: the first, for the host thread whose share it is, or the last for another.
    fn take(&self, start: Cycle, is_first: bool) -> Option<usize> {
        let mut share = self.0.load(Ordering::Relaxed);
        loop {
            let (first, end) = (share & 0xffff, share >> 16 & 0xffff);
            // Who is late must not take cores of a later window.
            if first == end || share >> 32 != start & 0xffff_ffff {
                return None;
            }
            let (core, left) = if is_first { (first, share + 1) } else { (end - 1, share - (1 << 16)) };
            // The cores themselves are handed over by their locks.
            match self.0.compare_exchange_weak(share, left, Ordering::Relaxed, Ordering::Relaxed) {
                Ok(_) => return Some(core as usize),
                Err(now) => share = now,
            }
        }
    }
}

/// What a host thread has recorded: tasks with their streams, spare buffers, and what the tasks did.
type Recorded = (Vec<(u32, Stream)>, Vec<Stream>, Tally);

/// What a crew shares. A job is over when all its cores are run or all its tasks recorded: nobody waits for a host thread that
/// has not begun, and one that comes late finds nothing to take.
pub(super) struct Crew<'a> {
    tables: &'a CoreTables,
    source: &'a dyn TaskSource,
    /// The [`Job`].
    job: CachePadded<AtomicU64>,
    /// How many cores are run, or tasks recorded.
    done: CachePadded<AtomicUsize>,
    failed: AtomicBool,
    /// All cores, while a window runs.
    slots: RwLock<Vec<Slot>>,
    /// What each host thread runs first.
    shares: Vec<CachePadded<Share>>,
    next_task: AtomicU32,
    /// What each host thread has recorded.
    recorded: Vec<Mutex<Recorded>>,
}

impl<'a> Crew<'a> {
    /// A crew of `threads` host threads, the captain among them.
    pub(super) fn new(tables: &'a CoreTables, source: &'a dyn TaskSource, threads: usize) -> Crew<'a> {
        Crew {
            tables,
            source,
            job: CachePadded::new(AtomicU64::new(Job::None.to_word())),
            done: CachePadded::default(),
            failed: AtomicBool::new(false),
            slots: RwLock::new(Vec::new()),
            shares: (0..threads).map(|_| CachePadded::default()).collect(),
            next_task: AtomicU32::new(0),
            recorded: (0..threads).map(|_| Mutex::default()).collect(),
        }
    }

    /// What host thread `number` does, from 1 on, until the crew is dismissed.
    pub(super) fn work(&self, number: usize) {
        let _told = TellOfFailure(&self.failed);
        let _work = doing(Work::Waiting);
        let mut word = Job::None.to_word();
        loop {
            let seen = word;
            wait_until(|| {
                word = self.job.load(Ordering::Acquire);
                word != seen
            });
            match Job::from_word(word) {
                Job::None => {}
                Job::Window { start, end } => self.run(number, start, end),
                Job::Record { end } => self.record_some(number, end),
                Job::Stop => return,
            }
        }
    }

    /// Runs cores from `start` to before `end`, until all are run or being run.
    fn run(&self, number: usize, start: Cycle, end: Cycle) {
        let (before, after) = self.shares.split_at(number);
        let next = || {
            let others = || after[1..].iter().chain(before).find_map(|share| share.take(start, false));
            after[0].take(start, true).or_else(others)
        };
        let mut cores = std::iter::from_fn(next).peekable();
        // Who comes late and finds nothing keeps nobody waiting for a lock.
        if cores.peek().is_none() {
            return;
        }
        let _work = doing(Work::Issue);
        let mut done = 0;
        let slots = self.slots.read().unwrap_or_else(PoisonError::into_inner);
        for core in cores {
            let mut slot = lock(&slots[core]);
            slot.as_mut().expect("a core that takes part exists").run_window(self.tables, start, end);
            done += 1;
        }
        drop(slots);
        self.done.fetch_add(done, Ordering::Release);
    }

    /// Records tasks as long as there are any below `end` that nobody has begun.
    fn record_some(&self, number: usize, end: u32) {
        let relaxed = Ordering::Relaxed;
        let next =
            || self.next_task.fetch_update(relaxed, relaxed, |task| (task < end).then_some(task + 1)).ok();
        let mut tasks = std::iter::from_fn(next).peekable();
        if tasks.peek().is_none() {
            return;
        }
        let _work = doing(Work::Emission);
        let mut done = 0;
        let mut recorded = lock(&self.recorded[number]);
        let (streams, spare, tally) = &mut *recorded;
        for task in tasks {
            let mut stream = spare.pop().unwrap_or_default();
            tally.record(self.source, task, &mut stream);
            streams.push((task, stream));
            done += 1;
        }
        drop(recorded);
        self.done.fetch_add(done, Ordering::Release);
    }

    /// Has the others begin a job.
    fn begin(&self, job: Job) {
        self.done.store(0, Ordering::Relaxed);
        self.job.store(job.to_word(), Ordering::Release);
    }

    /// Waits until `count` cores are run or tasks recorded; returns how often it gave its processor away meanwhile.
    fn wait_for(&self, count: usize) -> u32 {
        let _work = doing(Work::Waiting);
        wait_until(|| {
            assert!(!self.failed.load(Ordering::Relaxed), "a host thread of the chip has failed");
            self.done.load(Ordering::Acquire) == count
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
        let (active, crew) = (cores.active(), self.crew);
        let threads = crew.shares.len();
        for (number, share) in crew.shares.iter().enumerate() {
            share.deal(number * active / threads..(number + 1) * active / threads, start);
        }
        std::mem::swap(&mut *write(&crew.slots), cores.slots());
        crew.begin(Job::Window { start, end });
        crew.run(0, start, end);
        // On a host that has other work too, windows wait for threads that have no processor. Who runs a core changes nothing.
        if crew.wait_for(active) > 0 {
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
        std::mem::swap(&mut *write(&crew.slots), cores.slots());
    }

    fn record(&mut self, step: &mut StepTasks<'_>, tasks: Range<u32>) -> bool {
        let (count, crew) = (tasks.len(), self.crew);
        if count < 2 {
            return false;
        }
        let share = count.div_ceil(crew.recorded.len());
        for recorded in &crew.recorded {
            let (_, spare, _) = &mut *lock(recorded);
            let from = step.spare.len() - share.saturating_sub(spare.len()).min(step.spare.len());
            spare.extend(step.spare.drain(from..));
        }
        crew.next_task.store(tasks.start, Ordering::Relaxed);
        crew.begin(Job::Record { end: tasks.end });
        crew.record_some(0, tasks.end);
        crew.wait_for(count);
        let (mut streams, mut tally) = (Vec::with_capacity(count), Tally::default());
        for recorded in &crew.recorded {
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

/// A lock that nobody else holds for long.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A lock that nobody else holds for long.
fn write<T>(lock: &RwLock<T>) -> RwLockWriteGuard<'_, T> {
    lock.write().unwrap_or_else(PoisonError::into_inner)
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
