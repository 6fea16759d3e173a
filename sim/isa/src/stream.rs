//! The stream of one task: its uops, and beside them the lines they touch.

use crate::arena::{CONSTANT_LINE, Line, RUNTIME_LINES, STACK_BASE_LINE, STACK_LINES, TASK_COUNTER_LINE};
use crate::uop::Class;

/// Uops of one task at most: a thousand times what a task is meant to have.
pub const TASK_UOPS_MAX: usize = 1 << 26;

/// Uops, and lines, for which an empty stream keeps its buffers. Few tasks are longer; were theirs kept, every stream would come to
/// have room for the longest task of all.
const KEPT: usize = 1 << 20;

/// A line that a uop touches, as the stream of its task has it: before it is known which hardware thread runs the task.
///
/// One word: below [`STACK_BASE_LINE`] the number of a line of the arena, from there on `STACK_BASE_LINE + slot`. The class
/// of the uop says nothing about where its line lies: spills go to the stack, and so do the loads and stores that carry
/// values between lanes and scalars.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct StreamLine(u32);

/// Where a [`StreamLine`] lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// This line of the arena, among those that [`Arena::overwritten`](crate::Arena::overwritten) gives out. All threads share it.
    Arena(u32),
    /// This slot of the stack of the hardware thread that runs the task, below [`STACK_LINES`]. No other thread has it.
    Stack(u32),
    /// This line of the runtime, below [`RUNTIME_LINES`]: task counter, barrier, constants. All threads share it.
    Runtime(u32),
}

impl StreamLine {
    /// The line of the runtime that holds the task counter of the running step.
    pub const TASK_COUNTER: StreamLine = StreamLine::arena(TASK_COUNTER_LINE);

    /// The line of the runtime that holds the constant pool.
    pub const CONSTANTS: StreamLine = StreamLine::arena(CONSTANT_LINE);

    /// A line of the arena or, among its first [`RUNTIME_LINES`], of the runtime.
    #[inline(always)]
    pub const fn arena(line: Line) -> StreamLine {
        debug_assert!(line.0 < STACK_BASE_LINE);
        StreamLine(line.0)
    }

    /// Slot `slot` of the stack of whichever hardware thread runs the task, below [`STACK_LINES`].
    #[inline(always)]
    pub const fn stack(slot: u32) -> StreamLine {
        debug_assert!(slot < STACK_LINES);
        StreamLine(STACK_BASE_LINE + slot)
    }

    /// Where the line lies: in the arena, on a stack, or among those of the runtime.
    #[inline(always)]
    pub const fn place(self) -> Place {
        if self.0 >= STACK_BASE_LINE {
            Place::Stack(self.0 - STACK_BASE_LINE)
        } else if self.0 < RUNTIME_LINES {
            Place::Runtime(self.0)
        } else {
            Place::Arena(self.0)
        }
    }

    /// The number of the line on the chip when hardware thread `hardware_thread` of the chip runs the task: a line of the
    /// arena or the runtime is itself, a slot is one of the thread's own stack.
    ///
    /// Every access of every class passes here, so it costs the host one comparison and one addition, and no branch.
    #[inline(always)]
    pub const fn resolved(self, hardware_thread: u32) -> u32 {
        let is_stack = (self.0 >= STACK_BASE_LINE) as u32;
        // All bits of the mask are set for a slot, none for any other line.
        let mask = 0_u32.wrapping_sub(is_stack);
        self.0 + ((hardware_thread * STACK_LINES) & mask)
    }

    /// The word that stands for it in a stream, for hashes and messages.
    #[inline(always)]
    pub const fn bits(self) -> u32 {
        self.0
    }
}

/// What one task leaves behind for a machine to time.
///
/// `uops` in program order, `lines` the lines of the memory uops in the same order, one entry per distinct line. Streams are
/// reused: consumed and cleared, never stored.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Stream {
    /// The uops in program order, each an encoded [`Uop`](crate::uop::Uop).
    pub uops: Vec<u32>,
    /// The lines that the memory uops touch, in program order.
    pub lines: Vec<StreamLine>,
    /// Number of lane-slots of vector uops that did work.
    pub lanes_active: u64,
    /// Number of lane-slots of vector uops that were masked off.
    pub lanes_masked: u64,
    /// Most vector registers live at once, before spills were charged.
    pub live_vectors_max: u32,
    /// The task had more than [`TASK_UOPS_MAX`] uops, or more than the host has memory for: this holds none of them, and
    /// times from it are void.
    pub cut_short: bool,
}

impl Stream {
    /// Empties the stream and keeps its buffers, but for what an unusually long task had.
    pub fn clear(&mut self) {
        self.uops.clear();
        self.uops.shrink_to(KEPT);
        self.lines.clear();
        self.lines.shrink_to(KEPT);
        self.lanes_active = 0;
        self.lanes_masked = 0;
        self.live_vectors_max = 0;
        self.cut_short = false;
    }

    /// How many uops of each class the stream holds.
    pub fn count_classes(&self) -> [u64; Class::COUNT] {
        // Four tables: neighbors are often of one class, and would wait for each other's count.
        let mut tables = [[0_u32; 256]; 4];
        let (fours, rest) = self.uops.as_chunks::<4>();
        for uops in fours {
            for (table, uop) in tables.iter_mut().zip(uops) {
                table[(*uop & 0xff) as usize] += 1;
            }
        }
        for uop in rest {
            tables[0][(*uop & 0xff) as usize] += 1;
        }
        std::array::from_fn(|class| tables.iter().map(|table| u64::from(table[class])).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cleared_stream_keeps_the_buffers_of_a_task_and_gives_those_of_a_long_one_back() {
        let mut stream = Stream::default();
        for (length, kept) in [(KEPT / 2, KEPT / 2), (8 * KEPT, KEPT)] {
            stream.uops.resize(length, 0);
            stream.lines.resize(length, StreamLine::CONSTANTS);
            stream.clear();
            assert!(stream.uops.is_empty() && stream.lines.is_empty());
            for capacity in [stream.uops.capacity(), stream.lines.capacity()] {
                assert!((kept..2 * kept + 1).contains(&capacity), "{length}: room for {capacity}");
            }
        }
    }
}
