//! What an operation leaves behind: nothing but a count, or a uop in a stream.

use crate::arena::Line;
use crate::lanes::Lanes;
#[cfg(target_arch = "x86_64")]
use crate::record::Record;
use crate::stream::StreamLine;
use crate::uop::Class;

/// Takes note of every operation.
pub trait Emit {
    /// What names the uop that produced a value.
    type Id: Copy;
    /// The name that stands for no uop: constants have no producer.
    const NONE: Self::Id;
    /// Whether the lines that memory uops touch are wanted; finding them costs host time.
    const LINES: bool;

    /// Takes note of an ALU uop and its producers; the name of the uop.
    fn alu<const N: usize>(&mut self, class: Class, producers: [Self::Id; N]) -> Self::Id;
    /// Takes note of a memory uop and its producers, whose `lines` lines were noted just before; the name of the uop.
    fn memory<const N: usize>(&mut self, class: Class, producers: [Self::Id; N], lines: u8) -> Self::Id;
    /// Takes note of one line that the memory uop to come touches.
    fn line(&mut self, line: StreamLine);
    /// Takes note of the lines from `first` to `last`, one or two neighbours, that the memory uop to come touches; how many
    /// they are.
    fn line_or_two(&mut self, first: Line, last: Line) -> u8;
    /// Takes note of the lines that the memory uop to come touches, `lines[i]` in every lane `i` of `k`: each once, in lane
    /// order; how many they are.
    fn distinct_lines<L: Lanes>(&mut self, k: u16, lines: L::I) -> u8;
    /// Takes note that the memory uop to come touches the `count` lines of the memory uop before it.
    fn repeat_lines<L: Lanes>(&mut self, count: u8);
    /// Takes note that the uop to come reads these vector registers, which are taken until then.
    fn reads<const N: usize>(&mut self, vectors: [Self::Id; N]);
    /// Takes note that the vector uop to come runs under mask `k`.
    fn under_mask(&mut self, k: u16);
}

/// How many operations were done, by class, and how many of their lane-slots did no work.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OpCounts {
    /// Number of operations of each class, by class byte.
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

    /// Number of operations of all classes.
    pub fn total(&self) -> u64 {
        self.class_counts.iter().sum()
    }

    /// Adds the operations that another host thread counted.
    pub fn add(&mut self, other: &OpCounts) {
        for (sum, count) in self.class_counts.iter_mut().zip(other.class_counts) {
            *sum += count;
        }
        self.lanes_masked += other.lanes_masked;
    }
}

/// Lane-slots of the vector operations among `class_counts`: 16 for each operation.
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
    fn line(&mut self, _: StreamLine) {}
    #[inline(always)]
    fn line_or_two(&mut self, _: Line, _: Line) -> u8 {
        0
    }
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

/// Counts operations or records them, as is known when a kernel runs: one copy of its code does both.
///
/// For lanes so slow that a call for each operation costs little; the code of such kernels was most of the time to compile them.
#[cfg(target_arch = "x86_64")]
pub enum Either<'a> {
    /// Counts.
    Count(Count<'a>),
    /// Records.
    Record(Record<'a>),
}

#[cfg(target_arch = "x86_64")]
impl Emit for Either<'_> {
    type Id = usize;
    const NONE: usize = Record::NONE;
    const LINES: bool = true;

    #[inline(never)]
    fn alu<const N: usize>(&mut self, class: Class, producers: [usize; N]) -> usize {
        match self {
            Self::Count(count) => count.alu(class, [(); N]),
            Self::Record(record) => return record.alu(class, producers),
        }
        Self::NONE
    }
    #[inline(never)]
    fn memory<const N: usize>(&mut self, class: Class, producers: [usize; N], lines: u8) -> usize {
        match self {
            Self::Count(count) => count.memory(class, [(); N], lines),
            Self::Record(record) => return record.memory(class, producers, lines),
        }
        Self::NONE
    }
    #[inline(never)]
    fn line(&mut self, line: StreamLine) {
        if let Self::Record(record) = self {
            record.line(line);
        }
    }
    #[inline(never)]
    fn line_or_two(&mut self, first: Line, last: Line) -> u8 {
        if let Self::Record(record) = self { record.line_or_two(first, last) } else { 0 }
    }
    #[inline(never)]
    fn distinct_lines<L: Lanes>(&mut self, k: u16, lines: L::I) -> u8 {
        if let Self::Record(record) = self { record.distinct_lines::<L>(k, lines) } else { 0 }
    }
    #[inline(never)]
    fn repeat_lines<L: Lanes>(&mut self, count: u8) {
        if let Self::Record(record) = self {
            record.repeat_lines::<L>(count);
        }
    }
    #[inline(never)]
    fn reads<const N: usize>(&mut self, vectors: [usize; N]) {
        if let Self::Record(record) = self {
            record.reads(vectors);
        }
    }
    #[inline(never)]
    fn under_mask(&mut self, k: u16) {
        match self {
            Self::Count(count) => count.under_mask(k),
            Self::Record(record) => record.under_mask(k),
        }
    }
}
