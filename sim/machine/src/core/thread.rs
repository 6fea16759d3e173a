//! A hardware thread.

use super::table::Row;
use super::walk::Walk;
use super::{CoreTables, Shared};
use crate::counters::Cause;
use crate::when::When;
use lrbsim_isa::stream::Stream;
use std::collections::VecDeque;

/// What a thread does at [`Thread::next`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum State {
    /// Issues its next uop.
    Running,
    /// Hands the next line of a memory uop to the L1.
    Walking,
    /// Has come to the end of its stream: takes the next one.
    Ended,
    /// Has asked for tasks.
    Asking,
    /// Has found the task counter at its end.
    Done,
}

/// One hardware thread and the tasks it holds. What every uop needs lies in the first line of the host's cache.
#[repr(C, align(64))]
pub(crate) struct Thread {
    /// When it acts next, and what it waits for; [`When::NEVER`] while that is for the uncore to say.
    pub(crate) next: When,
    /// Until when the uops that it has issued hold it, as far as that is known.
    pub(super) held: When,
    pub(super) pc: usize,
    /// The row of the uop at `pc`.
    pub(super) row: Row,
    pub(super) line_pc: usize,
    pub(crate) state: State,
    /// Number on the chip: whose stack its stack slots are.
    number: u32,
    pub(crate) stream: Stream,
    /// Number in its core.
    pub(super) index: u8,
    /// Streams begun and given back: uops of earlier ones are nobody's sources.
    pub(super) generation: u32,
    /// Uops without a time that hold it.
    pub(super) holders: u16,
    /// The rest of its chunk.
    pub(super) queue: VecDeque<Stream>,
    pub(super) walk: Walk,
    /// While it asks for tasks: when the task counter has been read, and from when on it may begin, if it has got any.
    pub(super) counter_read: When,
    pub(super) fed_from: Option<u64>,
    /// When the results of the last 256 uops are there, by place in the stream modulo 256.
    pub(super) ready: [When; 256],
}

impl Thread {
    pub(crate) fn new(index: u8, number: u32) -> Thread {
        Thread {
            index,
            number,
            state: State::Done,
            next: When::NEVER,
            held: When::ZERO,
            stream: Stream::default(),
            queue: VecDeque::new(),
            pc: 0,
            row: Row::NONE,
            line_pc: 0,
            ready: [When::new(0, Cause::Dependency); 256],
            generation: 0,
            holders: 0,
            walk: Walk::idle(),
            counter_read: When::NEVER,
            fed_from: None,
        }
    }

    /// Begins with `stream` at `when`.
    pub(super) fn begin(&mut self, tables: &CoreTables, shared: &mut Shared, stream: Stream, when: When) {
        self.give_back(shared, stream);
        self.pc = 0;
        self.line_pc = 0;
        self.ready.fill(When::new(0, Cause::Dependency));
        self.next = when;
        self.held = when;
        self.state = State::Ended;
        if let Some(uop) = self.stream.uops.first() {
            self.state = State::Running;
            self.row = tables.row(*uop);
        }
    }

    /// Takes `stream` and gives back the one that has been run.
    pub(super) fn give_back(&mut self, shared: &mut Shared, stream: Stream) {
        let used = std::mem::replace(&mut self.stream, stream);
        if used.uops.capacity() > 0 {
            shared.issued += used.uops.len() as u64;
            shared.spent.push(used);
        }
        self.pc = 0;
        self.generation = self.generation.wrapping_add(1);
    }

    /// The line that the uop which is issued touches next, as the chip numbers lines: one road for all classes.
    #[inline(always)]
    pub(super) fn line(&self) -> u32 {
        self.stream.lines[self.line_pc].resolved(self.number)
    }

    /// The line `count` places behind [`Thread::line`], if the stream has so many.
    #[inline(always)]
    pub(super) fn line_ahead(&self, count: usize) -> Option<u32> {
        self.stream.lines.get(self.line_pc + count).map(|line| line.resolved(self.number))
    }

    /// A defect to be seeded: it works on the stack of thread 0.
    #[cfg(test)]
    pub(crate) fn share_stack(&mut self) {
        self.number = 0;
    }

    /// Uops issued and to issue, for messages.
    pub(crate) fn progress(&self) -> (usize, usize) {
        (self.pc, self.stream.uops.len())
    }
}
