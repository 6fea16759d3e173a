//! Recording: a uop in a host thread's buffers for every operation of a task, and from there a stream.

mod buffers;
#[cfg(test)]
mod tests;

use crate::arena::Line;
use crate::emit::Emit;
use crate::lanes::Lanes;
use crate::stream::StreamLine;
use crate::uop::{Class, DISTANCE_MAX, Uop};
use buffers::{At, FIRST_ID, ID_LIMIT, LaneSlots, Pointers, RUN_UOPS_MAX};
pub(crate) use buffers::{Buffers, Recorded};

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

    /// How much the task has recorded, for [`Buffers::finish`].
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

/// Producers that an operation has at most.
const PRODUCERS_MAX: usize = 6;

/// Producer `index` of `N`; [`Record::NONE`] past the last.
///
/// What follows asks for one after the other, and not in a loop: a kernel has thousands of operations, and the compiler spent
/// more than half of its time on their loops of two or three turns.
#[inline(always)]
fn producer<const N: usize>(ids: &[usize; N], index: usize) -> usize {
    const { assert!(N <= PRODUCERS_MAX, "an operation with more producers than are looked at") };
    if index < N { ids[index] } else { Record::NONE }
}

/// The youngest three of `N` producers, in no order; the older ones have arrived when these have.
#[inline(always)]
fn youngest_three<const N: usize>(ids: [usize; N]) -> [usize; 3] {
    // Drops the oldest of four.
    let keep = |[a, b, c]: [usize; 3], id: usize| {
        let (old, young) = (a.min(b), a.max(b));
        let (old2, young2) = (c.min(id), c.max(id));
        [young, young2, old.max(old2)]
    };
    let mut kept = [producer(&ids, 0), producer(&ids, 1), producer(&ids, 2)];
    if N >= 4 {
        kept = keep(kept, producer(&ids, 3));
    }
    if N >= 5 {
        kept = keep(kept, producer(&ids, 4));
    }
    if N >= 6 {
        kept = keep(kept, producer(&ids, 5));
    }
    kept
}

/// The youngest two of `N` producers.
#[inline(always)]
fn youngest_two<const N: usize>(ids: [usize; N]) -> [usize; 2] {
    // Drops the oldest of three.
    let keep = |[a, b]: [usize; 2], id: usize| {
        let (old, young) = (a.min(b), a.max(b));
        [young, old.max(id)]
    };
    let mut kept = [producer(&ids, 0), producer(&ids, 1)];
    if N >= 3 {
        kept = keep(kept, producer(&ids, 2));
    }
    if N >= 4 {
        kept = keep(kept, producer(&ids, 3));
    }
    if N >= 5 {
        kept = keep(kept, producer(&ids, 4));
    }
    if N >= 6 {
        kept = keep(kept, producer(&ids, 5));
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
        let read = |index: usize| {
            let id = producer(&vectors, index);
            // SAFETY: ids are those of this task, and every one had its place, which is never given back.
            unsafe { self.pointers.last_reader.add(id).write(self.recorded.at.next as u32) };
        };
        if N >= 1 {
            read(0);
        }
        if N >= 2 {
            read(1);
        }
        if N >= 3 {
            read(2);
        }
        if N >= 4 {
            read(3);
        }
        if N >= 5 {
            read(4);
        }
        if N >= 6 {
            read(5);
        }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn line(&mut self, line: StreamLine) {
        // SAFETY: the last branch left places for the lines of a run.
        unsafe { self.pointers.lines.add(self.recorded.at.lines).write(line) };
        self.recorded.at.lines = self.recorded.at.lines.wrapping_add(1);
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "a checked push would keep the length in host memory")]
    fn line_or_two(&mut self, first: Line, last: Line) -> u8 {
        let more = last.0.wrapping_sub(first.0);
        debug_assert!(more < 2);
        // SAFETY: as in `line`; there is room for one vector past the last.
        unsafe {
            let to = self.pointers.lines.add(self.recorded.at.lines);
            to.write(StreamLine::arena(first));
            to.add(1).write(StreamLine::arena(last));
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
