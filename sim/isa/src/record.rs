//! Recording: a uop in a host thread's buffers for every operation of a task, and from there a stream.

use core::cell::Cell;

use crate::arena::map_bytes;
use crate::emit::Emit;
use crate::lanes::{LANES, Lanes};
use crate::spill;
use crate::stream::{Stream, TASK_UOPS_MAX};
use crate::uop::{Class, DISTANCE_MAX, LINES_MAX, Uop};

/// Id of the first uop of a task. More than [`DISTANCE_MAX`], so that id 0, a constant, is always too far back to name.
const FIRST_ID: usize = DISTANCE_MAX as usize + 2;

/// Uops that may follow one another without a branch: there is room for as many past every branch.
///
/// Every loop of a kernel whose length the host compiler does not know ends in a branch, so this bounds straight code.
const RUN_UOPS_MAX: usize = 4096;

/// Uops that there is room for from the start: what a task is meant to have at most.
const IDS_AT_FIRST: usize = 64 << 10;

/// No id is as high: the first branch past the last place of a task begins again.
const ID_LIMIT: usize = TASK_UOPS_MAX + RUN_UOPS_MAX;

/// Where one host thread records.
///
/// Uops are written without a check each. What makes that sound: the places of a whole run past every branch are there
/// before it begins, and a longer run stops.
#[derive(Debug)]
pub(crate) struct Buffers {
    /// Nothing before the first task.
    places: Option<Places>,
    /// [`TASK_UOPS_MAX`] but in tests.
    ids_max: usize,
    /// The highest id of a task that is too long, whose uops are lost; 0 for all others.
    lost: usize,
}

/// Memory for the uops of a task, all zero at first and committed by the operating system as touched.
#[derive(Debug)]
struct Places {
    /// Keeps the pages alive; all below point into it.
    _map: memmap2::MmapMut,
    at: Pointers,
}

/// The parts of [`Places`].
#[derive(Debug, Clone, Copy)]
struct Pointers {
    /// Uops by id.
    uops: *mut u32,
    /// The id of the last reader of each vector register by the id of its maker; 0 between tasks.
    last_reader: *mut u32,
    /// Line numbers; as many as the uops can have, and room for one vector past the last.
    lines: *mut u32,
    /// How many vector registers have their last reader at each id; 0 between tasks.
    ends: *mut u8,
    /// The id from which on there is less than the room for a run.
    ids_end: usize,
}

impl Places {
    /// Places for `ids_end` ids and a run more; `None` if the host refuses.
    fn new(ids_end: usize) -> Option<Places> {
        let ids = ids_end + RUN_UOPS_MAX;
        let lines = LINES_MAX * ids + LANES;
        let bytes = 4 * (ids + ids + lines) + ids;
        let mut map = map_bytes(bytes)?;
        let uops = map.as_mut_ptr().cast::<u32>();
        let last_reader = uops.wrapping_add(ids);
        let line_numbers = last_reader.wrapping_add(ids);
        let ends = line_numbers.wrapping_add(lines).cast();
        Some(Places { _map: map, at: Pointers { uops, last_reader, lines: line_numbers, ends, ids_end } })
    }
}

impl Buffers {
    const fn new() -> Buffers {
        Buffers { places: None, ids_max: TASK_UOPS_MAX, lost: 0 }
    }

    /// Runs `record` with this host thread's buffers. A task that panics loses them, so the next one finds clean ones.
    pub(crate) fn with<R>(record: impl FnOnce(&mut Buffers) -> R) -> R {
        thread_local! {
            static BUFFERS: Cell<Option<Box<Buffers>>> = const { Cell::new(None) };
        }
        let mut buffers = BUFFERS.take().unwrap_or_else(|| Box::new(Buffers::new()));
        let result = record(&mut buffers);
        BUFFERS.set(Some(buffers));
        result
    }

    /// Where a task that has begun records.
    #[inline(always)]
    fn pointers(&self) -> Pointers {
        self.places.as_ref().expect("a task begins only where it has places").at
    }

    /// Has places for a task of the usual length; `false` if the host refuses.
    pub(crate) fn prepare(&mut self) -> bool {
        if self.places.is_none() {
            self.places = Places::new(IDS_AT_FIRST);
        }
        self.places.is_some()
    }

    /// More places for a task that has come to the end of them; where it goes on.
    ///
    /// A task that is too long still runs to its end, for what it does to the arena: it records over what it recorded.
    #[cold]
    #[inline(never)]
    #[expect(unsafe_code, reason = "copies between raw buffers")]
    fn more(&mut self, at: At) -> At {
        let old = self.pointers();
        let ids_end = 2 * old.ids_end;
        let more = if ids_end > self.ids_max { None } else { Places::new(ids_end) };
        let Some(places) = more else {
            self.lost = self.lost.max(at.next);
            return At { next: FIRST_ID, lines: 0 };
        };
        let new = places.at;
        // SAFETY: as many ids and lines as the task recorded have places in both, which do not overlap.
        unsafe {
            new.uops.copy_from_nonoverlapping(old.uops, at.next);
            new.last_reader.copy_from_nonoverlapping(old.last_reader, at.next.max(self.lost));
            new.lines.copy_from_nonoverlapping(old.lines, at.lines);
        }
        self.places = Some(places);
        at
    }

    /// Appends what a task left here to `stream`, spills included, and makes them ready for the next task.
    #[inline(always)]
    #[expect(unsafe_code, reason = "the filled part of the buffers as slices")]
    pub(crate) fn finish<L: Lanes>(&mut self, Recorded { at, lane_slots }: Recorded, stream: &mut Stream) {
        let pointers = self.pointers();
        let ids = at.next.max(self.lost);
        // SAFETY: all bytes were zero from the start; every id and line of the task has its place; the four do not
        // overlap, and `&mut self` is the only way to them.
        let (uops, last_reader, ends, lines) = unsafe {
            (
                core::slice::from_raw_parts(pointers.uops, ids),
                core::slice::from_raw_parts_mut(pointers.last_reader, ids),
                core::slice::from_raw_parts_mut(pointers.ends, ids),
                core::slice::from_raw_parts(pointers.lines, at.lines),
            )
        };
        if self.lost > 0 {
            last_reader.fill(0);
            self.lost = 0;
            stream.cut_short = true;
            return;
        }
        stream.uops.extend_from_slice(&uops[FIRST_ID..]);
        stream.lines.extend_from_slice(lines);
        let slots = LANES as u64;
        let lanes_masked = slots * lane_slots.masked_uops - lane_slots.masked_lanes_active;
        stream.lanes_masked += lanes_masked;
        stream.lanes_active += slots * lane_slots.vector_uops - lanes_masked;
        let pressure = spill::pressure::<L>(last_reader, ends, FIRST_ID);
        stream.live_vectors_max = stream.live_vectors_max.max(pressure.live_max);
        spill::charge(stream, pressure.spills);
    }
}

/// How far a task has come.
#[derive(Debug, Clone, Copy)]
struct At {
    /// Id of the uop to come.
    next: usize,
    /// Lines so far.
    lines: usize,
}

/// What a task left.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Recorded {
    at: At,
    lane_slots: LaneSlots,
}

/// Lane-slots of a task.
#[derive(Debug, Clone, Copy, Default)]
struct LaneSlots {
    vector_uops: u64,
    /// Uops under a mask, and their lanes that did work.
    masked_uops: u64,
    masked_lanes_active: u64,
}

/// Appends a uop to a host thread's buffers for every operation; values carry the id of their producer.
///
/// All that changes is here by value and no call ever sees it in place, so that it lives in host registers: in a straight
/// run of a kernel, distances then are constants of the host code, and the length of the run is one that costs nothing.
#[derive(Debug)]
pub struct Record<'a> {
    pointers: Pointers,
    recorded: Recorded,
    /// Uops since the last branch.
    run: usize,
    buffers: &'a mut Buffers,
}

impl<'a> Record<'a> {
    /// Starts a task in `buffers`, which are prepared.
    #[inline(always)]
    pub(crate) fn new(buffers: &'a mut Buffers) -> Self {
        Record {
            pointers: buffers.pointers(),
            recorded: Recorded { at: At { next: FIRST_ID, lines: 0 }, lane_slots: LaneSlots::default() },
            run: 0,
            buffers,
        }
    }

    /// What the task left, for [`Buffers::finish`].
    #[inline(always)]
    pub(crate) fn recorded(&self) -> Recorded {
        self.recorded
    }

    /// Distance to `id` from the uop to come, 0 when it cannot be named.
    #[inline(always)]
    fn distance(&self, id: usize) -> u32 {
        let distance = self.recorded.at.next.wrapping_sub(id);
        if distance > DISTANCE_MAX as usize { 0 } else { distance as u32 }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn push(&mut self, class: Class, word: u32) -> usize {
        let id = self.recorded.at.next;
        // SAFETY: the last branch left places for a run, which is checked below.
        unsafe { self.pointers.uops.add(id).write(Uop(word).0) };
        self.recorded.at.next = id.wrapping_add(1);
        self.recorded.lane_slots.vector_uops =
            self.recorded.lane_slots.vector_uops.wrapping_add(u64::from(class.is_vector()));
        if class == Class::Branch {
            self.run = 0;
            if self.recorded.at.next >= self.pointers.ids_end {
                // Only registers go there and back: what a call sees in place would live in host memory.
                self.recorded.at = self.buffers.more(self.recorded.at);
                self.pointers = self.buffers.pointers();
            }
            // So the host compiler knows that a constant, of id 0, is too far back to name.
            // SAFETY: ids begin there, and there are no places for more.
            unsafe {
                core::hint::assert_unchecked(
                    self.recorded.at.next >= FIRST_ID && self.recorded.at.next < ID_LIMIT,
                )
            };
        } else {
            self.run = self.run.wrapping_add(1);
            if self.run >= RUN_UOPS_MAX {
                endless_run();
            }
        }
        id
    }
}

#[cold]
#[inline(never)]
fn endless_run() -> ! {
    panic!("a kernel runs {RUN_UOPS_MAX} uops without a branch; its loops must branch")
}

/// The youngest three of `N` producers, in no order; the older ones have arrived when these have.
#[inline(always)]
fn youngest_three<const N: usize>(ids: [usize; N]) -> [usize; 3] {
    let mut kept = [0; 3];
    for (i, id) in ids.into_iter().enumerate() {
        if i < 3 {
            kept[i] = id;
        } else {
            // Drop the oldest of the four.
            let (old, young) = (kept[0].min(kept[1]), kept[0].max(kept[1]));
            let (old2, young2) = (kept[2].min(id), kept[2].max(id));
            kept = [young, young2, old.max(old2)];
        }
    }
    kept
}

/// The youngest two of `N` producers.
#[inline(always)]
fn youngest_two<const N: usize>(ids: [usize; N]) -> [usize; 2] {
    let mut kept = [0; 2];
    for (i, id) in ids.into_iter().enumerate() {
        if i < 2 {
            kept[i] = id;
        } else {
            let (old, young) = (kept[0].min(kept[1]), kept[0].max(kept[1]));
            kept = [young, old.max(id)];
        }
    }
    kept
}

impl Emit for Record<'_> {
    type Id = usize;
    const NONE: usize = 0;
    const LINES: bool = true;

    #[inline(always)]
    fn alu<const N: usize>(&mut self, class: Class, producers: [usize; N]) -> usize {
        let ids = youngest_three(producers);
        let mut word = class as u32;
        if N >= 1 {
            word |= self.distance(ids[0]) << 8;
        }
        if N >= 2 {
            word |= self.distance(ids[1]) << 16;
        }
        if N >= 3 {
            word |= self.distance(ids[2]) << 24;
        }
        self.push(class, word)
    }

    #[inline(always)]
    fn memory<const N: usize>(&mut self, class: Class, producers: [usize; N], lines: u8) -> usize {
        let ids = youngest_two(producers);
        let mut word = class as u32 | u32::from(lines) << 24;
        if N >= 1 {
            word |= self.distance(ids[0]) << 8;
        }
        if N >= 2 {
            word |= self.distance(ids[1]) << 16;
        }
        self.push(class, word)
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked store would need the length in a host register")]
    fn reads<const N: usize>(&mut self, vectors: [usize; N]) {
        for id in vectors {
            // SAFETY: ids are those of this task, and every one had its place, which is never given back.
            unsafe { self.pointers.last_reader.add(id).write(self.recorded.at.next as u32) };
        }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn line(&mut self, line: u32) {
        // SAFETY: the last branch left places for the lines of a run.
        unsafe { self.pointers.lines.add(self.recorded.at.lines).write(line) };
        self.recorded.at.lines = self.recorded.at.lines.wrapping_add(1);
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn line_or_two(&mut self, first: u32, last: u32) -> u8 {
        let more = last.wrapping_sub(first);
        debug_assert!(more < 2);
        // SAFETY: as in `line`; there is room for one vector past the last.
        unsafe {
            let to = self.pointers.lines.add(self.recorded.at.lines);
            to.write(first);
            to.add(1).write(last);
        }
        self.recorded.at.lines = self.recorded.at.lines.wrapping_add(1).wrapping_add(more as usize);
        (1 + more) as u8
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn distinct_lines<L: Lanes>(&mut self, k: u16, lines: L::I) -> u8 {
        // SAFETY: as in `line`; there is room for one vector past the last.
        let count =
            unsafe { L::store_distinct(k, self.pointers.lines.add(self.recorded.at.lines).cast(), lines) };
        self.recorded.at.lines = self.recorded.at.lines.wrapping_add(count as usize);
        count as u8
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn repeat_lines<L: Lanes>(&mut self, count: u8) {
        debug_assert!(usize::from(count) <= self.recorded.at.lines);
        // SAFETY: as in `distinct_lines`; the last uop pushed `count` lines, so they lie before these.
        unsafe {
            let to = self.pointers.lines.add(self.recorded.at.lines);
            L::store(to.cast(), L::load(to.sub(usize::from(count)).cast()));
        }
        self.recorded.at.lines = self.recorded.at.lines.wrapping_add(usize::from(count));
    }

    #[inline(always)]
    fn under_mask(&mut self, k: u16) {
        let slots = &mut self.recorded.lane_slots;
        slots.masked_uops = slots.masked_uops.wrapping_add(1);
        slots.masked_lanes_active = slots.masked_lanes_active.wrapping_add(u64::from(k.count_ones()));
    }
}
#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Portable;

    #[test]
    fn the_youngest_producers_are_kept() {
        let mut kept = youngest_three([5, 9, 1, 7, 8]);
        kept.sort_unstable();
        assert_eq!(kept, [7, 8, 9]);
        let mut kept = youngest_two([5, 1, 9, 7]);
        kept.sort_unstable();
        assert_eq!(kept, [7, 9]);
    }

    fn record_in(buffers: &mut Buffers, task: impl FnOnce(&mut Record<'_>)) -> Stream {
        let mut stream = Stream::default();
        assert!(buffers.prepare());
        let mut record = Record::new(buffers);
        task(&mut record);
        let recorded = record.recorded();
        buffers.finish::<Portable>(recorded, &mut stream);
        stream
    }

    fn record(task: impl FnOnce(&mut Record<'_>)) -> Stream {
        Buffers::with(|buffers| record_in(buffers, task))
    }

    #[test]
    fn a_constant_and_a_far_producer_are_no_dependency() {
        let stream = record(|record| {
            let first = record.alu(Class::VectorAlu, [Record::NONE]);
            for _ in 0..DISTANCE_MAX - 1 {
                record.alu(Class::VectorAlu, []);
            }
            record.alu(Class::VectorAlu, [first, Record::NONE]);
            record.alu(Class::VectorAlu, [first]);
        });
        let distances: Vec<_> = stream.uops.iter().rev().take(2).map(|uop| uop >> 8 & 0xff).collect();
        assert_eq!(distances, [0, DISTANCE_MAX]);
        assert_eq!(stream.uops[0] >> 8, 0);
    }

    #[test]
    fn tasks_do_not_see_what_earlier_ones_left() {
        let task = |record: &mut Record<'_>| {
            let made: [usize; 20] = core::array::from_fn(|_| record.alu(Class::VectorAlu, []));
            record.line(7);
            record.reads(made);
            record.alu(Class::VectorAlu, made);
        };
        let first = record(task);
        assert_eq!(first, record(task));
        assert_eq!((first.live_vectors_max, first.lines.as_slice()), (20, [7].as_slice()));
    }

    #[test]
    fn a_task_that_panics_leaves_nothing_behind() {
        let broken = std::panic::catch_unwind(|| {
            record(|record| {
                let made = record.alu(Class::VectorAlu, []);
                record.reads([made]);
                panic!("a defect of the kernel");
            })
        });
        assert!(broken.is_err());
        let stream = record(|record| {
            record.alu(Class::VectorAlu, []);
        });
        assert_eq!(stream.live_vectors_max, 0);
    }

    #[test]
    #[should_panic(expected = "its loops must branch")]
    fn a_run_without_a_branch_is_stopped_before_its_places_end() {
        record(|record| {
            for _ in 0..RUN_UOPS_MAX {
                record.alu(Class::ScalarAlu, []);
            }
        });
    }

    #[test]
    fn the_longest_run_fits_behind_the_last_branch_that_asks_for_no_more() {
        let mut buffers = Buffers::new();
        let uops = IDS_AT_FIRST - FIRST_ID - 1 + RUN_UOPS_MAX;
        let stream = record_in(&mut buffers, |record| {
            for _ in 0..IDS_AT_FIRST - FIRST_ID - 1 {
                record.alu(Class::Branch, []);
            }
            for id in 0..RUN_UOPS_MAX {
                let (k, lines) = (u16::MAX, core::array::from_fn(|lane| (id * LANES + lane) as i32));
                assert_eq!(record.distinct_lines::<Portable>(k, lines), 16);
                // The last is a branch, which then asks for more.
                let class = if id == RUN_UOPS_MAX - 1 { Class::Branch } else { Class::Gather };
                record.memory(class, [], 16);
            }
        });
        assert_eq!(stream.uops.len(), uops);
        assert_eq!(stream.lines, (0..(RUN_UOPS_MAX * LANES) as u32).collect::<Vec<u32>>());
    }

    /// `uops` uops with a load at every thousandth, a branch after it, and each reading the one before.
    fn chain(record: &mut Record<'_>, uops: u32) {
        let mut before = record.alu(Class::VectorAlu, []);
        let mut i = 1;
        while i < uops {
            record.reads([before]);
            if i % 1000 == 0 {
                record.line(i);
                before = record.memory(Class::VectorLoad, [before], 1);
                record.alu(Class::Branch, [before]);
                i += 1;
            } else {
                before = record.alu(Class::VectorAlu, [before]);
            }
            i += 1;
        }
    }

    #[test]
    fn a_task_of_ten_million_uops_is_recorded_whole() {
        const UOPS: u32 = 10_000_000;
        let stream = record(|record| chain(record, UOPS));
        assert!(!stream.cut_short);
        assert_eq!(stream.uops.len(), UOPS as usize);
        assert_eq!(stream.lines, (1000..UOPS).step_by(1000).collect::<Vec<u32>>());
        let near = |uop: &u32| matches!(uop >> 8 & 0xff, 1 | 2);
        assert!(stream.uops[1..].iter().all(near));
        assert_eq!(stream.live_vectors_max, 1);
    }

    #[test]
    fn a_task_past_all_bounds_is_said_to_be_cut_short_and_the_next_is_not() {
        let mut buffers = Buffers { ids_max: 4 * IDS_AT_FIRST, ..Buffers::new() };
        let short = |buffers: &mut Buffers| record_in(buffers, |record| chain(record, 5000));
        let before = short(&mut buffers);
        for uops in [4 * IDS_AT_FIRST, 4 * IDS_AT_FIRST + 1000, 20 * IDS_AT_FIRST] {
            let long = record_in(&mut buffers, |record| chain(record, uops as u32));
            assert!(long.cut_short, "{uops}");
            assert_eq!((long.uops.len(), long.lines.len(), long.lanes_active), (0, 0, 0));
            assert_eq!(short(&mut buffers), before, "after {uops}");
        }
        let long = record_in(&mut buffers, |record| chain(record, 3 * IDS_AT_FIRST as u32));
        assert_eq!((long.cut_short, long.uops.len()), (false, 3 * IDS_AT_FIRST));
    }
}
