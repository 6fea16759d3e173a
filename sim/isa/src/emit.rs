//! What an operation leaves behind: nothing but a count, or a uop in a stream.

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
    Class::ALL.iter().zip(class_counts).filter(|(class, _)| class.is_vector()).map(|(_, count)| 16 * count).sum()
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
    fn under_mask(&mut self, k: u16) {
        self.0.lanes_masked += u64::from(k.count_zeros());
    }
}

/// Id of the first uop of a stream. More than [`DISTANCE_MAX`], so that id 0, a constant, is always too far back to name.
const FIRST_ID: u32 = DISTANCE_MAX + 2;

/// Where the last use of a value lies that is used more than [`DISTANCE_MAX`] uops after it was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FarUse {
    pub producer: u32,
    pub user: u32,
}

/// Appends a uop to a stream for every operation; values carry the id of their producer.
#[derive(Debug)]
pub struct Record<'a> {
    stream: &'a mut Stream,
    far: &'a mut Vec<FarUse>,
}

impl<'a> Record<'a> {
    pub(crate) fn new(stream: &'a mut Stream, far: &'a mut Vec<FarUse>) -> Self {
        Record { stream, far }
    }

    /// Distance to `id` from the uop to come, 0 when it cannot be named.
    #[inline(always)]
    fn distance(&mut self, next: u32, id: u32) -> u32 {
        let distance = next - id;
        if distance > DISTANCE_MAX {
            self.note_far_use(next, id);
            return 0;
        }
        distance
    }

    /// Keeps the last use of a value that outlives what a distance can name: it holds its register until then.
    #[inline(always)]
    fn note_far_use(&mut self, next: u32, id: u32) {
        if id != 0 {
            self.push_far_use(FarUse { producer: id - FIRST_ID, user: next - FIRST_ID });
        }
    }

    #[cold]
    #[inline(never)]
    fn push_far_use(&mut self, far: FarUse) {
        // A loop uses the same few constants over and over: extend their latest entry.
        for earlier in self.far.iter_mut().rev().take(16) {
            if earlier.producer == far.producer {
                earlier.user = far.user;
                return;
            }
        }
        self.far.push(far);
    }
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
        let next = self.stream.uops.len() as u32 + FIRST_ID;
        let ids = youngest_three(producers);
        let mut word = class as u32;
        if N >= 1 {
            word |= self.distance(next, ids[0]) << 8;
        }
        if N >= 2 {
            word |= self.distance(next, ids[1]) << 16;
        }
        if N >= 3 {
            word |= self.distance(next, ids[2]) << 24;
        }
        self.stream.uops.push(Uop(word).0);
        next
    }

    #[inline(always)]
    fn memory<const N: usize>(&mut self, class: Class, producers: [u32; N], lines: u8) -> u32 {
        let next = self.stream.uops.len() as u32 + FIRST_ID;
        let ids = youngest_two(producers);
        let mut word = class as u32 | u32::from(lines) << 24;
        if N >= 1 {
            word |= self.distance(next, ids[0]) << 8;
        }
        if N >= 2 {
            word |= self.distance(next, ids[1]) << 16;
        }
        self.stream.uops.push(Uop(word).0);
        next
    }

    #[inline(always)]
    fn line(&mut self, line: u32) {
        self.stream.lines.push(line);
    }

    #[inline(always)]
    fn under_mask(&mut self, k: u16) {
        self.stream.lanes_masked += u64::from(k.count_zeros());
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

    #[test]
    fn a_constant_and_a_far_producer_are_no_dependency() {
        let (mut stream, mut far) = (Stream::default(), Vec::new());
        let mut record = Record::new(&mut stream, &mut far);
        let first = record.alu(Class::VectorAlu, [Record::NONE]);
        for _ in 0..DISTANCE_MAX - 1 {
            record.alu(Class::VectorAlu, []);
        }
        record.alu(Class::VectorAlu, [first, Record::NONE]);
        record.alu(Class::VectorAlu, [first]);
        let distances: Vec<_> = stream.uops.iter().rev().take(2).map(|uop| uop >> 8 & 0xff).collect();
        assert_eq!(distances, [0, DISTANCE_MAX]);
        assert_eq!(stream.uops[0] >> 8, 0);
        assert_eq!(far, [FarUse { producer: 0, user: 255 }]);
    }
}
