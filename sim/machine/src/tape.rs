//! The streams of one functional run, written once and read by many machines, each as fast as it can.
//!
//! ```text
//!                    ┌──────────────── kept: what some machine has still to read ────────────────┐
//! program ─ write ─► │ step │ stream │ stream │ step │ stream │ stream │ stream │ stream │ stream │
//!                    └──▲────────────────────────▲────────────────────────────────────────▲──────┘
//!                   machine 2                machine 0                                machine 1
//! ```
//!
//! The program waits while more is kept than there is to be, and a machine while there is nothing for it to read. Whoever waits gives its
//! seat to another: no more threads compute than there are seats.

use lrbsim_isa::OpCounts;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Bytes of streams that are kept at most, but for one stream that is longer.
pub const KEPT_BYTES: usize = 64 << 20;

/// Bytes that an entry takes beside its uops and lines.
const ENTRY_BYTES: usize = 200;

/// Buffers of streams that are kept to be used again.
const SPARE_MAX: usize = 32;

/// How many threads may compute at once; several programs may share them.
#[derive(Debug)]
pub struct Seats {
    count: usize,
    free: Mutex<usize>,
    changed: Condvar,
}

impl Seats {
    /// `count` seats, all free; at least one.
    pub fn new(count: usize) -> Seats {
        let count = count.max(1);
        Seats { count, free: Mutex::new(count), changed: Condvar::new() }
    }

    /// How many there are, free or not.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Takes a seat, once there is one.
    pub fn take(&self) -> Seat<'_> {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let mut free =
            self.changed.wait_while(free, |free| *free == 0).unwrap_or_else(PoisonError::into_inner);
        *free -= 1;
        Seat { of: self }
    }
}

/// A seat, until it is dropped.
#[derive(Debug)]
pub struct Seat<'a> {
    of: &'a Seats,
}

impl Drop for Seat<'_> {
    fn drop(&mut self) {
        *self.of.free.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        self.of.changed.notify_one();
    }
}

/// What is written.
#[derive(Debug, Clone)]
enum Entry {
    /// A frame begins: what came before is not asked for any more.
    Frame,
    /// A step with its name and the number of its tasks, whose streams come next.
    Step(Arc<str>, u32),
    /// The stream of a task.
    Task(Arc<Stream>),
}

impl Entry {
    fn bytes(&self) -> usize {
        match self {
            Entry::Frame | Entry::Step(..) => ENTRY_BYTES,
            Entry::Task(stream) => ENTRY_BYTES + 4 * (stream.uops.len() + stream.lines.len()),
        }
    }
}

/// Streams on their way from one program to some machines.
#[derive(Debug)]
pub(crate) struct Tape<'a> {
    seats: &'a Seats,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// What is kept, each with the number of readers that have still to read it.
    entries: VecDeque<(Entry, usize)>,
    /// The number of the first that is kept.
    first: u64,
    bytes: usize,
    /// Readers that there are.
    readers: usize,
    /// Whether nothing more is written.
    has_ended: bool,
    /// Buffers of streams, to be used again.
    spare: Vec<Stream>,
}

impl State {
    fn end(&self) -> u64 {
        self.first + self.entries.len() as u64
    }

    /// Whether more may be written: nobody waits for what is there without end, for whoever has read all of it reads what comes.
    fn has_room(&self) -> bool {
        self.bytes < KEPT_BYTES || self.readers == 0
    }

    /// Gives up what all have read.
    fn shift(&mut self) {
        while let Some((entry, 0)) = self.entries.front() {
            self.bytes -= entry.bytes();
            self.first += 1;
            self.entries.pop_front();
        }
    }
}

impl<'a> Tape<'a> {
    /// An empty tape with so many readers, to be made by [`Tape::reader`].
    pub(crate) fn new(seats: &'a Seats, readers: usize) -> Tape<'a> {
        Tape { seats, state: Mutex::new(State { readers, ..State::default() }), changed: Condvar::new() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits without a seat until `is_so`.
    fn wait<'s>(
        &'s self,
        mut state: MutexGuard<'s, State>,
        seat: &mut Option<Seat<'a>>,
        is_so: impl Fn(&State) -> bool,
    ) -> MutexGuard<'s, State> {
        while !is_so(&state) {
            *seat = None;
            drop(
                self.changed.wait_while(state, |state| !is_so(state)).unwrap_or_else(PoisonError::into_inner),
            );
            // Not with the state in hand: whoever has a seat may want it.
            *seat = Some(self.seats.take());
            state = self.state();
        }
        state
    }

    /// Writes that a frame begins.
    pub(crate) fn write_frame(&self, seat: &mut Option<Seat<'a>>) {
        self.push(Entry::Frame, seat);
    }

    /// Whether anybody reads what is written.
    pub(crate) fn is_read(&self) -> bool {
        self.state().readers > 0
    }

    /// Says that one of the readers is not to be.
    pub(crate) fn do_without(&self) {
        self.state().readers -= 1;
    }

    /// Writes a step: all of its tasks are recorded, in order.
    pub(crate) fn write_step(&self, tasks: &dyn TaskSource, seat: &mut Option<Seat<'a>>) {
        self.push(Entry::Step(tasks.name().into(), tasks.tasks()), seat);
        for task in 0..tasks.tasks() {
            let mut stream = self.state().spare.pop().unwrap_or_default();
            tasks.record(task, &mut stream);
            self.push(Entry::Task(Arc::new(stream)), seat);
        }
    }

    fn push(&self, entry: Entry, seat: &mut Option<Seat<'a>>) {
        let mut state = self.wait(self.state(), seat, State::has_room);
        state.bytes += entry.bytes();
        let readers = state.readers;
        state.entries.push_back((entry, readers));
        state.shift();
        self.changed.notify_all();
    }

    /// Says that nothing more is written.
    pub(crate) fn end(&self) {
        self.state().has_ended = true;
        self.changed.notify_all();
    }

    /// One of the readers, at the beginning.
    pub(crate) fn reader(&self) -> Reader<'_, 'a> {
        Reader { tape: self, next: 0, seat: Some(self.seats.take()) }
    }
}

/// What reads a tape for one machine. When it is dropped, nobody waits for it any more.
#[derive(Debug)]
pub(crate) struct Reader<'t, 'a> {
    tape: &'t Tape<'a>,
    next: u64,
    seat: Option<Seat<'a>>,
}

impl Reader<'_, '_> {
    /// The name of the next step and the number of its tasks, behind the beginnings of frames, of which it tells whether there were any;
    /// `None` at the end.
    pub(crate) fn step(&mut self) -> Option<(Arc<str>, u32, bool)> {
        let mut is_new = false;
        loop {
            match self.read()? {
                Entry::Frame => is_new = true,
                Entry::Step(name, tasks) => return Some((name, tasks, is_new)),
                Entry::Task(_) => unreachable!("all tasks of a step are read before the next"),
            }
        }
    }

    /// Gives the buffers of a stream back that nobody else has.
    fn give_back(&self, stream: Arc<Stream>) {
        let Some(mut stream) = Arc::into_inner(stream) else { return };
        stream.clear();
        let mut state = self.tape.state();
        if state.spare.len() < SPARE_MAX {
            state.spare.push(stream);
        }
    }

    fn read(&mut self) -> Option<Entry> {
        let next = self.next;
        let is_there = |state: &State| state.end() > next || state.has_ended;
        let mut state = self.tape.wait(self.tape.state(), &mut self.seat, is_there);
        let place = (next - state.first) as usize;
        let (entry, left) = state.entries.get_mut(place)?;
        *left -= 1;
        let entry = entry.clone();
        self.next += 1;
        let had_room = state.has_room();
        state.shift();
        if !had_room && state.has_room() {
            self.tape.changed.notify_all();
        }
        Some(entry)
    }
}

impl Drop for Reader<'_, '_> {
    fn drop(&mut self) {
        let mut state = self.tape.state();
        let read = (self.next - state.first) as usize;
        state.entries.iter_mut().skip(read).for_each(|(_, left)| *left -= 1);
        state.readers -= 1;
        state.shift();
        self.tape.changed.notify_all();
    }
}

/// A step of a tape, as a machine runs it.
pub(crate) struct TapedStep<'r, 't, 'a> {
    name: Arc<str>,
    tasks: u32,
    /// Whether it is the first of its frame.
    pub(crate) is_first: bool,
    reader: Mutex<&'r mut Reader<'t, 'a>>,
}

impl<'r, 't, 'a> TapedStep<'r, 't, 'a> {
    /// The next step that `reader` reads; `None` at the end.
    pub(crate) fn next(reader: &'r mut Reader<'t, 'a>) -> Option<TapedStep<'r, 't, 'a>> {
        let (name, tasks, is_first) = reader.step()?;
        Some(TapedStep { name, tasks, is_first, reader: Mutex::new(reader) })
    }
}

impl TaskSource for TapedStep<'_, '_, '_> {
    fn name(&self) -> &str {
        &self.name
    }

    fn tasks(&self) -> u32 {
        self.tasks
    }

    /// A tape has one order.
    fn is_ordered(&self) -> bool {
        true
    }

    fn record(&self, _task: u32, stream: &mut Stream) {
        stream.clear();
        let mut reader = self.reader.lock().unwrap_or_else(PoisonError::into_inner);
        // A step that was not written to its end, because the program failed: nobody will ask for what this machine makes of it.
        let Some(Entry::Task(taped)) = reader.read() else { return };
        stream.uops.extend_from_slice(&taped.uops);
        stream.lines.extend_from_slice(&taped.lines);
        let Stream { lanes_active, lanes_masked, live_vectors_max, cut_short, .. } = *taped;
        (stream.lanes_active, stream.lanes_masked) = (lanes_active, lanes_masked);
        (stream.live_vectors_max, stream.cut_short) = (live_vectors_max, cut_short);
        reader.give_back(taped);
    }

    fn skip(&self, _tasks: Range<u32>, _counts: &mut OpCounts) {
        unreachable!("a tape holds streams, for levels that record every task");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::{Mix, Tasks};
    use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

    /// Readers that each read at another pace, some of which leave early: all that stay get all, in order, and no more threads than seats
    /// compute at once.
    #[test]
    fn every_reader_gets_everything_in_order_and_nobody_waits_for_those_who_left() {
        for (seats, uops) in [(1, 100), (2, 100), (3, 100_000), (1, 100_000)] {
            let (seats, computing, most) = (Seats::new(seats), AtomicUsize::new(0), AtomicUsize::new(0));
            let allowed = *seats.free.lock().expect("free");
            let tape = Tape::new(&seats, 4);
            let steps = [3_u32, 0, 400, 1];
            let make = move |task: u32| Mix::Kernel.stream(task, uops);
            let at_work = || {
                most.fetch_max(computing.fetch_add(1, SeqCst) + 1, SeqCst);
                std::thread::yield_now();
                computing.fetch_sub(1, SeqCst);
            };
            std::thread::scope(|scope| {
                for number in 0..4 {
                    let (tape, at_work) = (&tape, &at_work);
                    scope.spawn(move || {
                        let mut reader = tape.reader();
                        for tasks in steps {
                            if number == 3 && tasks == 400 {
                                return;
                            }
                            let step = TapedStep::next(&mut reader).expect("written");
                            assert_eq!((step.name(), step.tasks()), ("synthetic", tasks));
                            assert_eq!(step.is_first, tasks == 3);
                            for task in 0..tasks {
                                let mut stream = Stream::default();
                                step.record(task, &mut stream);
                                at_work();
                                if task % 50 == 0 {
                                    assert_eq!(stream, make(task));
                                }
                                if number == 2 && task == 300 {
                                    return;
                                }
                            }
                        }
                        assert!(reader.step().is_none());
                    });
                }
                let mut seat = Some(seats.take());
                tape.write_frame(&mut seat);
                for count in steps {
                    tape.write_step(&Tasks { count, make }, &mut seat);
                    at_work();
                }
                tape.end();
                drop(seat);
            });
            assert!(most.into_inner() <= allowed);
            let state = tape.state();
            assert!(state.entries.is_empty() && state.bytes == 0 && state.readers == 0);
            assert_eq!(*seats.free.lock().expect("free"), allowed);
        }
    }
}
