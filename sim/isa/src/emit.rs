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
    fn reads<const N: usize>(&mut self, _: [(); N]) {}
    #[inline(always)]
    fn under_mask(&mut self, k: u16) {
        self.0.lanes_masked += u64::from(k.count_zeros());
    }
}

/// Id of the first uop of a task. More than [`DISTANCE_MAX`], so that id 0, a constant, is always too far back to name.
const FIRST_ID: u32 = DISTANCE_MAX + 2;

/// Most uops of one task: far more than the 64 K that a kernel should keep to, and a bound on what a runaway loop costs.
pub const TASK_UOPS_MAX: u32 = 1 << 23;

/// Most lines of one task.
pub const TASK_LINES_MAX: u32 = 1 << 24;

/// Where one host thread records: as large as the largest task may get, committed by the operating system as touched.
///
/// The size is fixed so that a full buffer ends the run: a buffer that could move would have to be reloaded after every
/// uop, and nothing could be kept in host registers across the call that moves it.
#[derive(Debug)]
pub(crate) struct Buffers {
    /// Uops by id.
    uops: Vec<u32>,
    /// The id of the last reader of each vector register by the id of its maker; 0 between tasks.
    last_reader: Vec<u32>,
    /// How many vector registers have their last reader at each id; 0 between tasks.
    ends: Vec<u8>,
    lines: Vec<u32>,
}

impl Buffers {
    fn new() -> Buffers {
        let uops = (FIRST_ID + TASK_UOPS_MAX) as usize;
        Buffers {
            uops: vec![0; uops],
            last_reader: vec![0; uops],
            ends: vec![0; uops],
            lines: vec![0; TASK_LINES_MAX as usize],
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
    pub(crate) fn finish(&mut self, recorded: Recorded, stream: &mut Stream) {
        let (first, next) = (FIRST_ID as usize, recorded.next as usize);
        stream.uops.extend_from_slice(&self.uops[first..next]);
        stream.lines.extend_from_slice(&self.lines[..recorded.lines as usize]);
        stream.lanes_masked += recorded.lanes_masked;
        stream.lanes_active += LANES as u64 * recorded.vector_uops - recorded.lanes_masked;
        let pressure = spill::pressure(&self.last_reader[..next], &mut self.ends[..next], first);
        stream.live_vectors_max = stream.live_vectors_max.max(pressure.live_max);
        spill::charge(stream, pressure.spills);
        self.last_reader[..next].fill(0);
        self.ends[..next].fill(0);
    }
}

/// How much of the buffers a task has filled, and its lane-slots.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Recorded {
    next: u32,
    lines: u32,
    vector_uops: u64,
    lanes_masked: u64,
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
        let size = (FIRST_ID + TASK_UOPS_MAX) as usize;
        assert!(
            buffers.uops.len() == size && buffers.last_reader.len() == size && buffers.ends.len() == size
        );
        assert!(buffers.lines.len() == TASK_LINES_MAX as usize);
        Record {
            uops: buffers.uops.as_mut_ptr(),
            last_reader: buffers.last_reader.as_mut_ptr(),
            lines: buffers.lines.as_mut_ptr(),
            recorded: Recorded { next: FIRST_ID, lines: 0, vector_uops: 0, lanes_masked: 0 },
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
        if id >= FIRST_ID + TASK_UOPS_MAX {
            too_many("uops", TASK_UOPS_MAX);
        }
        // SAFETY: `new` asserted the size of the buffer, `id` lies inside it.
        unsafe { self.uops.add(id as usize).write(Uop(word).0) };
        self.recorded.next = id.wrapping_add(1);
        self.recorded.vector_uops = self.recorded.vector_uops.wrapping_add(u64::from(class.is_vector()));
        id
    }
}

#[cold]
#[inline(never)]
fn too_many(what: &str, max: u32) -> ! {
    panic!("a task has more than {max} {what}; its kernel must split the work")
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
            // SAFETY: ids come from `push`, so they lie inside the buffer, which `new` found as long as that of uops.
            unsafe { self.last_reader.add(id as usize).write(self.recorded.next) };
        }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn line(&mut self, line: u32) {
        let at = self.recorded.lines;
        if at >= TASK_LINES_MAX {
            too_many("lines", TASK_LINES_MAX);
        }
        // SAFETY: `new` asserted the size of the buffer, `at` lies inside it.
        unsafe { self.lines.add(at as usize).write(line) };
        self.recorded.lines = at.wrapping_add(1);
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn distinct_lines<L: Lanes>(&mut self, k: u16, lines: L::I) -> u8 {
        let at = self.recorded.lines;
        if at > TASK_LINES_MAX - LANES as u32 {
            too_many("lines", TASK_LINES_MAX);
        }
        // SAFETY: `new` asserted the size of the buffer, 16 words from `at` on lie inside it.
        let count = unsafe { L::store_distinct(k, self.lines.add(at as usize).cast(), lines) };
        self.recorded.lines = at.wrapping_add(count);
        count as u8
    }

    #[inline(always)]
    fn under_mask(&mut self, k: u16) {
        self.recorded.lanes_masked = self.recorded.lanes_masked.wrapping_add(u64::from(k.count_zeros()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            buffers.finish(recorded, &mut stream);
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
    #[should_panic(expected = "must split the work")]
    fn a_runaway_task_is_stopped() {
        record(|record| {
            loop {
                record.alu(Class::ScalarAlu, []);
            }
        });
    }
}
