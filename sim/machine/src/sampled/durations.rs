//! How long threads have each chunk.

use crate::Cycle;
use crate::observer::Observer;
use std::ops::Range;

/// Notes who has each chunk, from when to when, in the order in which chunks are given out.
#[derive(Debug, Default)]
pub(super) struct Durations {
    chunks: Vec<Chunk>,
    /// By core and thread the chunk that it has, if any.
    open: Vec<Vec<Option<usize>>>,
    /// By core when its threads found no more chunks, in order.
    idle: Vec<Vec<Cycle>>,
    start: Cycle,
    barrier: Cycle,
}

#[derive(Debug, Clone, Copy)]
struct Chunk {
    core: usize,
    /// When the thread asked for it, and when for the next.
    asked: Cycle,
    done: Cycle,
}

impl Durations {
    /// Cycles that the barrier takes.
    pub(super) fn barrier_cycles(&self) -> Cycle {
        self.barrier
    }

    /// Cycles that a thread has a chunk, from its request for it to that for the next.
    pub(super) fn cycles(&self, chunk: usize) -> Cycle {
        let Chunk { asked, done, .. } = self.chunks[chunk];
        done - asked
    }

    /// Part of the cycles in which a thread is ready to issue, if cores issued in `busy` cycles, all together, and no thread knew of any
    /// other: a core of `k` threads issues in `1 - (1 - ready)^k` of them.
    pub(super) fn readiness(&self, busy: u64) -> f64 {
        let issued = |ready: f64| {
            let of_core = |idle: &Vec<Cycle>| {
                let mut from = self.start;
                let mut sum = 0.0;
                for (gone, until) in idle.iter().enumerate() {
                    let threads = idle.len() - gone;
                    sum += (until - from) as f64 * issue_share(ready, threads) * (ready * threads as f64);
                    from = *until;
                }
                sum
            };
            self.idle.iter().map(of_core).sum::<f64>()
        };
        // Twenty halvings leave a millionth.
        let (mut least, mut most) = (0.0, 1.0);
        for _ in 0..20 {
            let middle = 0.5 * (least + most);
            if issued(middle) < busy as f64 { least = middle } else { most = middle }
        }
        least
    }

    /// Cycles that a thread would have had a chunk, had all threads of its core had work all the time, where each is `ready` to issue
    /// in that part of the cycles, see [`Durations::readiness`].
    pub(super) fn crowded_cycles(&self, chunk: usize, ready: f64) -> f64 {
        let Chunk { core, asked, done } = self.chunks[chunk];
        let idle = &self.idle[core];
        let speed = |threads: usize| issue_share(ready, threads);
        let crowded = speed(idle.len());
        let (mut from, mut sum) = (asked, 0.0);
        for (gone, until) in idle.iter().enumerate() {
            let until = (*until).clamp(from, done);
            if until > from {
                sum += (until - from) as f64 * (speed(idle.len() - gone) / crowded);
            }
            from = until;
        }
        sum
    }
}

/// Part of the cycles that each of `threads` threads issues in, relative to a thread alone, if each is `ready` to in that part of them.
pub(super) fn issue_share(ready: f64, threads: usize) -> f64 {
    // (1 - (1 - ready)^k) / (k ready), as a sum that holds for 0 too.
    let mut waits = 1.0;
    let mut sum = 0.0;
    for _ in 0..threads {
        sum += waits;
        waits *= 1.0 - ready;
    }
    sum / threads as f64
}

impl Observer for Durations {
    fn step(&mut self, _: &str, _: u32, start: Cycle) {
        *self = Durations { start, ..Durations::default() };
    }

    fn tasks(&mut self, core: usize, thread: u8, tasks: Range<u32>, asked: Cycle, _: Cycle) {
        let thread = usize::from(thread);
        if self.open.len() <= core {
            self.open.resize(core + 1, Vec::new());
            self.idle.resize(core + 1, Vec::new());
        }
        let open = &mut self.open[core];
        if open.len() <= thread {
            open.resize(thread + 1, None);
        }
        if let Some(chunk) = open[thread].take() {
            self.chunks[chunk].done = asked;
        }
        if tasks.is_empty() {
            self.idle[core].push(asked);
        } else {
            open[thread] = Some(self.chunks.len());
            self.chunks.push(Chunk { core, asked, done: asked });
        }
    }

    fn barrier(&mut self, arrival: Cycle, end: Cycle) {
        self.barrier = end - arrival;
    }
}
