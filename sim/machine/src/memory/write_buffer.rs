//! The write buffer of a controller.

use crate::Cycle;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The entries of one write buffer. Writes come in the order of time, or nearly so: one that comes late for an early time takes
/// the entry that is given back first all the same, so that no entry ever holds two lines.
#[derive(Debug, Clone)]
pub(super) struct WriteBuffer {
    lines: usize,
    /// When each entry is given back, of those that were ever taken.
    ends: BinaryHeap<Reverse<Cycle>>,
    #[cfg(test)]
    pub(super) fault: Option<crate::laws::Fault>,
}

impl PartialEq for WriteBuffer {
    fn eq(&self, other: &WriteBuffer) -> bool {
        self.ends.clone().into_sorted_vec() == other.ends.clone().into_sorted_vec()
    }
}

impl WriteBuffer {
    /// An empty buffer of `lines` entries, at least one.
    pub(super) fn new(lines: u32) -> WriteBuffer {
        WriteBuffer {
            lines: lines as usize,
            ends: BinaryHeap::new(),
            #[cfg(test)]
            fault: None,
        }
    }

    /// When a write that has arrived at `now` gets an entry.
    #[inline]
    pub(super) fn free_from(&self, now: Cycle) -> Cycle {
        #[cfg(test)]
        if self.fault == Some(crate::laws::Fault::UnboundedWriteBuffer) {
            return now;
        }
        match self.ends.peek() {
            Some(Reverse(first)) if self.ends.len() == self.lines => now.max(*first),
            _ => now,
        }
    }

    /// Holds the entry that [`WriteBuffer::free_from`] spoke of until `end`.
    #[inline]
    pub(super) fn hold(&mut self, end: Cycle) {
        if self.ends.len() < self.lines {
            self.ends.push(Reverse(end));
        } else if let Some(mut first) = self.ends.peek_mut() {
            *first = Reverse(end);
        }
    }
}
