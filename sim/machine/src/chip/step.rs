//! A step under way: the tasks that are left, and what has been counted of those recorded.

use super::hands::Hands;
use crate::counters::StepReport;
use crate::scheduler::TaskCounter;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use std::collections::VecDeque;
use std::ops::Range;

/// Tasks that are recorded at once at most, where several host threads do it: a stream has up to about 64 K uops, a few hundred KiB.
const RECORDED_AT_ONCE: u32 = 64;

/// Uops that the tasks which are recorded at once are to have together at most, if they are like those before: some 25 MB of streams.
const RECORDED_UOPS: u64 = 4 << 20;

/// What recorded tasks did.
#[derive(Debug, Default)]
pub(super) struct Tally(pub(super) StepReport);

impl Tally {
    /// Records `task` of `source` in `stream` and counts what it did.
    pub(super) fn record(&mut self, source: &dyn TaskSource, task: u32, stream: &mut Stream) {
        source.record(task, stream);
        self.0.count_task(stream);
    }
}

/// The tasks of a step under way, as cores take them.
pub(super) struct StepTasks<'a> {
    source: &'a dyn TaskSource,
    counter: TaskCounter,
    /// Streams of the tasks that come next, recorded ahead.
    recorded: VecDeque<Stream>,
    pub(super) spare: Vec<Stream>,
    pub(super) tally: Tally,
}

impl<'a> StepTasks<'a> {
    /// A step whose tasks `counter` gives out.
    pub(super) fn new(source: &'a dyn TaskSource, counter: TaskCounter, spare: Vec<Stream>) -> StepTasks<'a> {
        StepTasks { source, counter, recorded: VecDeque::new(), spare, tally: Tally::default() }
    }

    /// Takes the buffers of streams that have been run.
    #[inline(always)]
    pub(super) fn take_back(&mut self, spent: &mut Vec<Stream>) {
        if !spent.is_empty() {
            spent.iter_mut().for_each(Stream::clear);
            self.spare.append(spent);
        }
    }

    /// The next chunk of tasks and their streams; none when the counter is at its end.
    pub(super) fn next_chunk(&mut self, hands: &mut dyn Hands) -> (Range<u32>, Vec<Stream>) {
        let chunk = self.counter.take();
        let missing = chunk.len().saturating_sub(self.recorded.len()) as u32;
        if missing > 0 {
            let first = chunk.end - missing;
            // Tasks that depend on one another are recorded one by one, by whoever asks.
            let many = first.saturating_add(missing.max(self.at_once())).min(self.source.tasks());
            if self.source.is_ordered() || !hands.record(self, first..many) {
                for task in first..chunk.end {
                    let mut stream = self.spare.pop().unwrap_or_default();
                    self.tally.record(self.source, task, &mut stream);
                    self.recorded.push_back(stream);
                }
            }
        }
        let streams = self.recorded.drain(..chunk.len()).collect();
        (chunk, streams)
    }

    /// Tasks to be recorded at once.
    fn at_once(&self) -> u32 {
        let report = &self.tally.0;
        let uops: u64 = report.class_counts.iter().sum();
        // Of the first ones nothing is known.
        let fitting = RECORDED_UOPS.saturating_mul(report.tasks) / uops.max(1);
        if report.tasks == 0 { RECORDED_AT_ONCE } else { fitting.clamp(1, RECORDED_AT_ONCE.into()) as u32 }
    }

    /// Takes in streams of the tasks behind those recorded so far, in order.
    pub(super) fn add_recorded(&mut self, streams: impl Iterator<Item = Stream>, tally: Tally) {
        self.recorded.extend(streams);
        self.tally.0 += tally.0;
    }
}
