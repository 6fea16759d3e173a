//! What an operation leaves behind: nothing but a count, or a uop in a stream.

use core::cell::Cell;
use core::marker::PhantomData;

use crate::lanes::{LANES, Lanes};
use crate::spill;
use crate::stream::Stream;
use crate::uop::{Class, DISTANCE_MAX, Uop};

/// Takes note of every operation.
pub trait Emit {
    /// Names the uop that produced a value.
    type Id: Copy;
    /// The producer of a constant: none.
    const NONE: Self::Id;
    /// Whether lines are wanted; finding them costs host time.
    const LINES: bool;

    /// An ALU uop with its producers.
    fn alu<const N: usize>(&mut self, class: Class, producers: [Self::Id; N]) -> Self::Id;
    /// A memory uop with its producers; its `lines` lines have just been pushed.
    fn memory<const N: usize>(&mut self, class: Class, producers: [Self::Id; N], lines: u8) -> Self::Id;
    /// One line of the memory uop to come.
    fn line(&mut self, line: u32);
    /// The distinct lines among those of the active lanes, in lane order, of the memory uop to come; how many.
    fn distinct_lines<L: Lanes>(&mut self, k: u16, lines: L::I) -> u8;
    /// The `count` lines of the memory uop just emitted once more, for the memory uop to come.
    fn repeat_lines<L: Lanes>(&mut self, count: u8);
    /// The uop to come reads these vector registers: they are taken until then.
    fn reads<const N: usize>(&mut self, vectors: [Self::Id; N]);
    /// The vector uop to come runs under mask `k`.
    fn under_mask(&mut self, k: u16);
}

/// Operations by class, and lane-slots.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OpCounts {
    /// Operations by class byte.
    pub class_counts: [u64; Class::COUNT],
    /// Lane-slots of vector operations that were masked off.
    pub lanes_masked: u64,
}

impl Default for OpCounts {
    fn default() -> Self {
        OpCounts { class_counts: [0; Class::COUNT], lanes_masked: 0 }
    }
}

impl OpCounts {
    /// Lane-slots of vector operations that did work.
    pub fn lanes_active(&self) -> u64 {
        lane_slots(&self.class_counts) - self.lanes_masked
    }

    /// All operations.
    pub fn total(&self) -> u64 {
        self.class_counts.iter().sum()
    }

    /// Adds what another thread counted.
    pub fn add(&mut self, other: &OpCounts) {
        for (sum, count) in self.class_counts.iter_mut().zip(other.class_counts) {
            *sum += count;
        }
        self.lanes_masked += other.lanes_masked;
    }
}

/// Lane-slots of the vector operations among `class_counts`: 16 each.
pub fn lane_slots(class_counts: &[u64; Class::COUNT]) -> u64 {
    Class::ALL
        .iter()
        .zip(class_counts)
        .filter(|(class, _)| class.is_vector())
        .map(|(_, count)| 16 * count)
        .sum()
}

/// Counts operations by class; values carry nothing.
#[derive(Debug)]
pub struct Count<'a>(pub &'a mut OpCounts);

impl Emit for Count<'_> {
    type Id = ();
    const NONE: () = ();
    const LINES: bool = false;

    #[inline(always)]
    fn alu<const N: usize>(&mut self, class: Class, _: [(); N]) {
        self.0.class_counts[class as usize] += 1;
    }
    #[inline(always)]
    fn memory<const N: usize>(&mut self, class: Class, _: [(); N], _: u8) {
        self.0.class_counts[class as usize] += 1;
    }
    #[inline(always)]
    fn line(&mut self, _: u32) {}
    #[inline(always)]
    fn distinct_lines<L: Lanes>(&mut self, _: u16, _: L::I) -> u8 {
        0
    }
    #[inline(always)]
    fn repeat_lines<L: Lanes>(&mut self, _: u8) {}
    #[inline(always)]
    fn reads<const N: usize>(&mut self, _: [(); N]) {}
    #[inline(always)]
    fn under_mask(&mut self, k: u16) {
        self.0.lanes_masked += u64::from(k.count_zeros());
    }
}

/// Id of the first uop of a task. More than [`DISTANCE_MAX`], so that id 0, a constant, is always too far back to name.
const FIRST_ID: u32 = DISTANCE_MAX + 2;

/// Ids, and lines of a task, from which on it is stopped at its next branch. As many uops are some 20 GiB: no host runs a
/// task of a frame into this.
const TASK_END: u32 = 1 << 31;

/// Numbers that a `u32` can be, one word each.
const WORDS: usize = 1 << 32;

/// Where one host thread records: address space for all ids that there are, committed by the operating system as touched.
///
/// A place for every `u32` needs no check a uop, and a buffer that never moves no reload: what a task changes can live in
/// host registers. It grows by being touched, and that it ends is noticed at branches, which every loop of a kernel has.
#[derive(Debug)]
pub(crate) struct Buffers {
    /// Keeps the pages alive; all below point into it.
    _map: memmap2::MmapMut,
    /// Uops by id.
    uops: *mut u32,
    /// The id of the last reader of each vector register by the id of its maker; 0 between tasks.
    last_reader: *mut u32,
    /// Line numbers, and room for one vector past the last.
    lines: *mut u32,
    /// How many vector registers have their last reader at each id; 0 between tasks.
    ends: *mut u8,
}

impl Buffers {
    fn new() -> Buffers {
        let bytes = 4 * (3 * WORDS + LANES) + WORDS;
        match memmap2::MmapOptions::new().len(bytes).no_reserve_swap().map_anon() {
            Ok(mut map) => {
                let uops = map.as_mut_ptr().cast::<u32>();
                let last_reader = uops.wrapping_add(WORDS);
                let lines = last_reader.wrapping_add(WORDS);
                let ends = lines.wrapping_add(WORDS + LANES).cast();
                Buffers { _map: map, uops, last_reader, lines, ends }
            }
            Err(error) => panic!("the host refuses {bytes} bytes of address space for a task: {error}"),
        }
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

    /// Appends what a task left here to `stream`, spills included, and makes the buffers ready for the next task.
    #[inline(always)]
    #[expect(unsafe_code, reason = "the filled part of the buffers as slices")]
    pub(crate) fn finish<L: Lanes>(&mut self, recorded: Recorded, stream: &mut Stream) {
        let (first, next) = (FIRST_ID as usize, recorded.next as usize);
        // SAFETY: all bytes were zero from the start; each part has a place for every `u32`; the four do not overlap, and
        // `&mut self` is the only way to them.
        let (uops, last_reader, ends, lines) = unsafe {
            (
                core::slice::from_raw_parts(self.uops, next),
                core::slice::from_raw_parts_mut(self.last_reader, next),
                core::slice::from_raw_parts_mut(self.ends, next),
                core::slice::from_raw_parts(self.lines, recorded.lines as usize),
            )
        };
        stream.uops.extend_from_slice(&uops[first..]);
        stream.lines.extend_from_slice(lines);
        let slots = LANES as u64;
        let lanes_masked = slots * recorded.masked_uops - recorded.masked_lanes_active;
        stream.lanes_masked += lanes_masked;
        stream.lanes_active += slots * recorded.vector_uops - lanes_masked;
        let pressure = spill::pressure::<L>(last_reader, ends, first);
        stream.live_vectors_max = stream.live_vectors_max.max(pressure.live_max);
        spill::charge(stream, pressure.spills);
        last_reader.fill(0);
        ends.fill(0);
    }
}

/// How much of the buffers a task has filled, and its lane-slots.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Recorded {
    next: u32,
    lines: u32,
    vector_uops: u64,
    /// Uops under a mask, and their lanes that did work.
    masked_uops: u64,
    masked_lanes_active: u64,
}

/// Appends a uop to a host thread's buffers for every operation; values carry the id of their producer.
///
/// All that changes is here by value and no call that returns ever sees it, so that it lives in host registers: in a
/// straight run of a kernel, distances then are constants of the host code.
#[derive(Debug)]
pub struct Record<'a> {
    uops: *mut u32,
    last_reader: *mut u32,
    lines: *mut u32,
    recorded: Recorded,
    buffers: PhantomData<&'a mut Buffers>,
}

impl<'a> Record<'a> {
    /// Starts a task in `buffers`.
    #[inline(always)]
    pub(crate) fn new(buffers: &'a mut Buffers) -> Self {
        Record {
            uops: buffers.uops,
            last_reader: buffers.last_reader,
            lines: buffers.lines,
            recorded: Recorded {
                next: FIRST_ID,
                lines: 0,
                vector_uops: 0,
                masked_uops: 0,
                masked_lanes_active: 0,
            },
            buffers: PhantomData,
        }
    }

    /// What the task left, for [`Buffers::finish`].
    #[inline(always)]
    pub(crate) fn recorded(&self) -> Recorded {
        self.recorded
    }

    /// Distance to `id` from the uop to come, 0 when it cannot be named.
    #[inline(always)]
    fn distance(&self, id: u32) -> u32 {
        let distance = self.recorded.next.wrapping_sub(id);
        if distance > DISTANCE_MAX { 0 } else { distance }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn push(&mut self, class: Class, word: u32) -> u32 {
        let id = self.recorded.next;
        if class == Class::Branch && (id | self.recorded.lines) >= TASK_END {
            endless_task();
        }
        // SAFETY: there is a place for every `u32`.
        unsafe { self.uops.add(id as usize).write(Uop(word).0) };
        self.recorded.next = id.wrapping_add(1);
        self.recorded.vector_uops = self.recorded.vector_uops.wrapping_add(u64::from(class.is_vector()));
        id
    }
}

#[cold]
#[inline(never)]
fn endless_task() -> ! {
    panic!("a task has more than {TASK_END} uops or lines; its kernel must split the work")
}

/// The youngest three of `N` producers, in no order; the older ones have arrived when these have.
#[inline(always)]
fn youngest_three<const N: usize>(ids: [u32; N]) -> [u32; 3] {
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
fn youngest_two<const N: usize>(ids: [u32; N]) -> [u32; 2] {
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
    type Id = u32;
    const NONE: u32 = 0;
    const LINES: bool = true;

    #[inline(always)]
    fn alu<const N: usize>(&mut self, class: Class, producers: [u32; N]) -> u32 {
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
    fn memory<const N: usize>(&mut self, class: Class, producers: [u32; N], lines: u8) -> u32 {
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
    fn reads<const N: usize>(&mut self, vectors: [u32; N]) {
        for id in vectors {
            debug_assert!(id < self.recorded.next, "a value of another task");
            // SAFETY: there is a place for every `u32`.
            unsafe { self.last_reader.add(id as usize).write(self.recorded.next) };
        }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn line(&mut self, line: u32) {
        let at = self.recorded.lines;
        // SAFETY: there is a place for every `u32`.
        unsafe { self.lines.add(at as usize).write(line) };
        self.recorded.lines = at.wrapping_add(1);
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn distinct_lines<L: Lanes>(&mut self, k: u16, lines: L::I) -> u8 {
        let at = self.recorded.lines;
        // SAFETY: as in `line`; past the last there is room for one vector more.
        let count = unsafe { L::store_distinct(k, self.lines.add(at as usize).cast(), lines) };
        self.recorded.lines = at.wrapping_add(count);
        count as u8
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn repeat_lines<L: Lanes>(&mut self, count: u8) {
        let at = self.recorded.lines;
        debug_assert!(u32::from(count) <= at);
        // SAFETY: as in `distinct_lines`; the last uop pushed `count` lines, so they lie before `at`.
        unsafe {
            let to = self.lines.add(at as usize);
            L::store(to.cast(), L::load(to.sub(count as usize).cast()));
        }
        self.recorded.lines = at.wrapping_add(u32::from(count));
    }

    #[inline(always)]
    fn under_mask(&mut self, k: u16) {
        self.recorded.masked_uops = self.recorded.masked_uops.wrapping_add(1);
        self.recorded.masked_lanes_active =
            self.recorded.masked_lanes_active.wrapping_add(u64::from(k.count_ones()));
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

    fn record(task: impl FnOnce(&mut Record<'_>)) -> Stream {
        let mut stream = Stream::default();
        Buffers::with(|buffers| {
            let mut record = Record::new(buffers);
            task(&mut record);
            let recorded = record.recorded();
            buffers.finish::<Portable>(recorded, &mut stream);
        });
        stream
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
            let made: [u32; 20] = core::array::from_fn(|_| record.alu(Class::VectorAlu, []));
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
    #[should_panic(expected = "its kernel must split the work")]
    fn an_endless_task_is_stopped_at_a_branch() {
        record(|record| {
            record.recorded.next = TASK_END - 1;
            record.alu(Class::ScalarAlu, []);
            record.alu(Class::Branch, []);
        });
    }

    #[test]
    #[should_panic(expected = "its kernel must split the work")]
    fn endless_lines_are_stopped_at_a_branch() {
        record(|record| {
            record.recorded.lines = TASK_END;
            record.alu(Class::Branch, []);
        });
    }

    #[test]
    fn a_task_of_ten_million_uops_is_recorded_whole() {
        const UOPS: u32 = 10_000_000;
        let stream = record(|record| {
            let mut before = record.alu(Class::VectorAlu, []);
            for i in 1..UOPS {
                record.reads([before]);
                if i % 1000 == 0 {
                    record.line(i);
                    before = record.memory(Class::VectorLoad, [before], 1);
                } else {
                    before = record.alu(Class::VectorAlu, [before]);
                }
            }
        });
        assert_eq!(stream.uops.len(), UOPS as usize);
        assert_eq!(stream.lines, (1000..UOPS).step_by(1000).collect::<Vec<u32>>());
        assert!(stream.uops[1..].iter().all(|uop| uop >> 8 & 0xff == 1));
        assert_eq!((stream.live_vectors_max, stream.lanes_active), (1, 16 * u64::from(UOPS)));
    }
}
