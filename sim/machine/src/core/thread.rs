//! A hardware thread.

use super::walk::Walk;
use crate::counters::Cause;
use crate::when::When;
use lrbsim_isa::stream::Stream;
use std::collections::VecDeque;

/// What a thread does at [`Thread::next`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum State {
    /// Issues its next uop.
    Running,
    /// Hands the next line of a gather to the L1.
    Walking,
    /// Has come to the end of its stream: takes the next one.
    Ended,
    /// Has found the task counter at its end.
    Done,
}

/// One hardware thread and the tasks it holds. What every uop needs lies in the first line of the host's cache.
#[repr(C, align(64))]
pub(crate) struct Thread {
    /// When it acts next, and what it waits for.
    pub(crate) next: When,
    pub(super) pc: usize,
    pub(crate) state: State,
    /// Number on the chip: whose stack spills go to.
    pub(super) number: u32,
    /// When the results of the last 256 uops are there, by place in the stream modulo 256.
    pub(super) ready: Box<[When; 256]>,
    pub(crate) stream: Stream,
    pub(super) line_pc: usize,
    /// The rest of its chunk.
    pub(crate) queue: VecDeque<Stream>,
    pub(super) walk: Walk,
}

impl Thread {
    pub(crate) fn new(number: u32) -> Thread {
        Thread {
            number,
            state: State::Ended,
            next: When::NEVER,
            stream: Stream::default(),
            queue: VecDeque::new(),
            pc: 0,
            line_pc: 0,
            ready: Box::new([When::new(0, Cause::Dependency); 256]),
            walk: Walk::idle(),
        }
    }

    /// Begins with the stream at the head of its queue at `when`; gives back the buffer of the one before.
    pub(crate) fn begin(&mut self, stream: Stream, when: When) -> Stream {
        self.pc = 0;
        self.line_pc = 0;
        self.ready.fill(When::new(0, Cause::Dependency));
        self.next = when;
        self.state = if stream.uops.is_empty() { State::Ended } else { State::Running };
        std::mem::replace(&mut self.stream, stream)
    }

    /// Uops issued and to issue, for messages.
    pub(crate) fn progress(&self) -> (usize, usize) {
        (self.pc, self.stream.uops.len())
    }
}
