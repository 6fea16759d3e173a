//! A step under way: the tasks that are left, and what has been counted.

use crate::Cycle;
use crate::coherence::Hierarchy;
use crate::core::{Core, State};
use crate::counters::{Cause, StepReport};
use crate::scheduler::{TaskCounter, pull};
use crate::when::When;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;

pub(super) struct Step<'a> {
    source: &'a mut dyn TaskSource,
    pub(super) counter: TaskCounter,
    pub(super) spare: Vec<Stream>,
    pub(super) report: StepReport,
    /// When the last thread so far came to the barrier.
    pub(super) last_arrival: Cycle,
}

impl<'a> Step<'a> {
    pub(super) fn new(source: &'a mut dyn TaskSource, spare: Vec<Stream>) -> Step<'a> {
        let report = StepReport { steps: 1, ..StepReport::default() };
        Step { source, counter: TaskCounter::empty(), spare, report, last_arrival: 0 }
    }

    pub(super) fn tasks(&self) -> u32 {
        self.source.tasks()
    }

    /// Records one task and counts what it did.
    fn record(&mut self, task: u32) -> Stream {
        let mut stream = self.spare.pop().unwrap_or_default();
        self.source.record(task, &mut stream);
        let report = &mut self.report;
        report.tasks += 1;
        for (sum, count) in report.class_counts.iter_mut().zip(stream.count_classes()) {
            *sum += count;
        }
        report.lanes_active += stream.lanes_active;
        report.lanes_masked += stream.lanes_masked;
        report.live_vectors_max = report.live_vectors_max.max(u64::from(stream.live_vectors_max));
        stream
    }

    /// Records all tasks and times none.
    pub(super) fn record_all(&mut self) {
        for task in 0..self.tasks() {
            let stream = self.record(task);
            self.spare.push(stream);
        }
        self.report.issued = self.report.class_counts.iter().sum();
    }

    /// Gives a thread that came to the end of its stream the next one, from its chunk or from the task counter; or sends it
    /// to the barrier.
    pub(super) fn feed(&mut self, core: &mut Core, thread: usize, hierarchy: &mut Hierarchy) {
        let context = &mut core.threads[thread];
        assert_eq!(context.state, State::Ended, "Chip.Core[{}].Thread[{thread}]", core.index);
        let mut when = context.next;
        if context.queue.is_empty() {
            let ready = pull(hierarchy, core.index, when.at());
            when = When::new(ready, Cause::Queue);
            for task in self.counter.take() {
                let stream = self.record(task);
                context.queue.push_back(stream);
            }
        }
        match context.queue.pop_front() {
            Some(stream) => {
                let used = context.begin(stream, when);
                self.spare.push(used);
            }
            None => {
                context.state = State::Done;
                context.next = When::NEVER;
                core.running -= 1;
                core.arrival = core.arrival.max(when.at());
                self.last_arrival = self.last_arrival.max(when.at());
            }
        }
    }
}
