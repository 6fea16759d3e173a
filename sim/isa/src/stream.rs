//! The stream of one task: its uops, and beside them the lines they touch.

use crate::uop::Class;

/// Uops of one task at most: a thousand times what a task is meant to have.
pub const TASK_UOPS_MAX: usize = 1 << 26;

/// What one task leaves behind for a machine to time.
///
/// `uops` in program order, `lines` the line numbers (arena offset / 64) of the memory uops in the same order, one entry
/// per distinct line. Streams are reused: consumed and cleared, never stored.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Stream {
    /// Encoded [`Uop`](crate::uop::Uop)s.
    pub uops: Vec<u32>,
    /// Line numbers of the memory uops.
    pub lines: Vec<u32>,
    /// Lane-slots of vector uops that did work.
    pub lanes_active: u64,
    /// Lane-slots of vector uops that were masked off.
    pub lanes_masked: u64,
    /// Most vector registers live at once, before spills were charged.
    pub live_vectors_max: u32,
    /// The task had more than [`TASK_UOPS_MAX`] uops, or more than the host has memory for: this holds none of them, and
    /// times from it are void.
    pub cut_short: bool,
}

impl Stream {
    /// Empties the stream and keeps its buffers.
    pub fn clear(&mut self) {
        self.uops.clear();
        self.lines.clear();
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
