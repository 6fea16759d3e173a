//! Who runs which task, and the barrier behind the last.
//!
//! Tasks are numbered; a thread that has none adds a chunk's length to the counter, a line in the arena that moves from
//! core to core through the same protocol as any other: its core times that, and the uncore says which tasks it got
//! ([`TaskCounter::take`]), in the order in which threads asked. The chunk is `remaining / (2 · threads)`,
//! at least 1 and at most `chunk_tasks_max`: as a step runs out, chunks shrink, so that nobody is left with a long one.
//!
//! A step wakes as many hardware threads as it has tasks, first one on every core, then a second, and so on: threads that
//! cannot get a task do not come to ask.

#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::config::MachineSpec;
use crate::ring::{Message, Rings};
use std::ops::Range;

/// The task counter of a step.
#[derive(Debug)]
pub(crate) struct TaskCounter {
    next: u32,
    /// Lengths of the chunks to come.
    lengths: std::vec::IntoIter<u32>,
}

impl TaskCounter {
    /// A counter at 0 that gives chunks of these lengths.
    pub(crate) fn new(lengths: Vec<u32>) -> TaskCounter {
        TaskCounter { next: 0, lengths: lengths.into_iter() }
    }

    /// The next chunk; empty at the end.
    pub(crate) fn take(&mut self) -> Range<u32> {
        let first = self.next;
        self.next += self.lengths.next().unwrap_or(0);
        first..self.next
    }
}

/// Lengths of the chunks in which `threads` threads get a step of `tasks` tasks.
pub(crate) fn chunk_lengths(tasks: u32, threads: u32, spec: &MachineSpec) -> Vec<u32> {
    let mut remaining = tasks;
    let next = || {
        let chunk = (remaining / (2 * threads.max(1))).clamp(1, spec.chunk_tasks_max).min(remaining);
        remaining -= chunk;
        (chunk > 0).then_some(chunk)
    };
    std::iter::from_fn(next).collect()
}

/// Cycles from the arrival of the last thread at the barrier until all go on.
///
/// In closed form, not by messages: the threads of a core meet at a line in their L1 (one locked operation each), the
/// cores in `⌈log2 cores⌉` rounds of a dissemination barrier, each round one transfer of a line between cores at the mean
/// idle latency and an overhead.
pub(crate) fn barrier_cycles(spec: &MachineSpec, rings: &Rings) -> Cycle {
    if spec.ideal.barrier {
        return 0;
    }
    let rounds = u64::from(spec.cores.next_power_of_two().trailing_zeros());
    let round = spec.barrier_round + mean_transfer_cycles(spec, rings);
    u64::from(spec.threads_per_core) * spec.atomic_cycles + rounds * round
}

/// Mean cycles of a read that another core's L2 answers, on an idle chip.
pub(crate) fn mean_transfer_cycles(spec: &MachineSpec, rings: &Rings) -> Cycle {
    let cores = spec.cores;
    // All pairs while they are few, a regular sample of them beyond.
    let stride = cores.div_ceil(64) as usize;
    let (mut short, mut line, mut pairs) = (0, 0, 0);
    for from in (0..cores).step_by(stride) {
        for to in (0..cores).step_by(stride) {
            short += rings.idle_cycles(from, to, Message::Address);
            line += rings.idle_cycles(from, to, Message::Line);
            pairs += 1;
        }
    }
    2 * spec.l2.hit_cycles + spec.directory_lookup + (2 * short + line).div_ceil(pairs)
}
