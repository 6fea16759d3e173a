//! What a task and a uop take of a thread while all others have work too.

use super::choose::Part;
use super::durations::{Durations, issue_share};
use crate::counters::CycleStack;

/// Relative standard deviation of a rate whatever is measured: what is not timed leaves caches cold, and threads end at other times.
pub(super) const MODEL: f64 = 0.025;

/// What is added to [`MODEL`] where cores do nothing but wait for data from outside of their caches.
pub(super) const MODEL_OUTSIDE: f64 = 0.08;

/// Relative standard deviation of the time that a step takes beyond what all of its chunks, shared out evenly, would: it is that of its
/// longest chunks, and how long one chunk takes is known less well than how long all do. It counts as far as tasks are not timed.
pub(super) const TAIL: f64 = 0.3;

/// How near threads come to knowing of no other, from not at all to wholly: as found on `saloon`, `street` and `fern` (`benches/sampled.rs`).
pub(super) const INDEPENDENT: f64 = 0.75;

/// Cycles for each task are told from those for each uop where chunks differ by this part, squared, in uops for each task.
const ALIKE: f64 = 0.01;

/// A chunk that tells a rate, or several.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Told {
    /// Its tasks.
    pub(super) tasks: f64,
    /// Its uops but for spills.
    pub(super) uops: f64,
    /// Cycles that its thread would have had it, had all others had work all the time.
    pub(super) cycles: f64,
    /// Standard deviation of these, which all chunks have in common.
    pub(super) doubt: f64,
    /// The group of neighbors that it was chosen with.
    pub(super) group: usize,
}

/// Cycles of a thread for each task and for each uop that is no spill.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rate {
    task: f64,
    uop: f64,
    /// Relative standard deviation that comes of the choice of chunks.
    choice: f64,
    /// Relative standard deviation that comes of the model.
    model: f64,
}

impl Rate {
    /// The rate of `chunks`, in which the chip has spent its time on the causes of `stack`.
    pub(super) fn of(chunks: &[Told], stack: &CycleStack) -> Rate {
        let Told { cycles, doubt, .. } = sum(chunks);
        let [task, uop] = fit(chunks);
        let mut rate = Rate { task, uop, choice: 0.0, model: 0.0 };
        // Neighbors have data, and so errors, in common.
        let (mut count, mut squares) = (0.0_f64, 0.0);
        for group in chunks.chunk_by(|a, b| a.group == b.group).map(sum) {
            let error = group.cycles - rate.cycles(group.tasks, group.uops);
            (count, squares) = (count + 1.0, squares + error * error);
        }
        // Of few groups the deviation itself is uncertain: that of Student's distribution with as many degrees of freedom as there are
        // more of them than numbers that were fitted.
        let fitted = if task > 0.0 { 2.0 } else { 1.0 };
        let freedom = (count - fitted - 2.0).max(1.0);
        rate.choice = (squares * count / freedom).sqrt() / cycles.max(1.0);
        let data = model(stack);
        let ends = doubt / cycles.max(1.0);
        rate.model = (data * data + ends * ends).sqrt();
        rate
    }

    /// Cycles of a thread for some tasks, which have so many uops together.
    pub(super) fn cycles(&self, tasks: f64, uops: f64) -> f64 {
        tasks * self.task + uops * self.uop
    }

    /// Relative standard deviation of the rate that comes of the choice alone.
    pub(super) fn choice_deviation(&self) -> f64 {
        self.choice
    }

    /// Relative standard deviation of the rate.
    pub(super) fn deviation(&self) -> f64 {
        // No `hypot`, which hosts round as they like.
        (self.choice * self.choice + self.model * self.model).sqrt()
    }
}

/// Relative standard deviation, whatever is measured, of a time that went to the causes of `stack`, where not all is timed.
pub(super) fn model(stack: &CycleStack) -> f64 {
    let outside = stack.memory + stack.remote + stack.ring + stack.tlb + stack.mshr;
    let waited = outside as f64 / (stack.total() - stack.barrier).max(1) as f64;
    MODEL + MODEL_OUTSIDE * waited
}

/// What each of `parts` tells of a run in which a thread is `ready` to issue in that part of the cycles. Once other threads of a core have
/// run out of work, those that are left may go faster: not at all where threads fill each other's gaps so well that all of them had
/// room, and as if no thread knew of any other where they do not.
pub(super) fn told(durations: &Durations, parts: &[Part], uops: &[u64], ready: f64) -> Vec<Told> {
    // The truth is taken to be anywhere between both, with equal chance.
    let [below, above] = [INDEPENDENT, 1.0 - INDEPENDENT];
    let deviation = ((below * below * below + above * above * above) / 3.0).sqrt();
    let tell = |(chunk, part): (usize, &Part)| {
        let (least, most) = (durations.cycles(chunk) as f64, durations.crowded_cycles(chunk, ready));
        Told {
            tasks: part.tasks.len() as f64,
            uops: uops[chunk] as f64,
            cycles: least + INDEPENDENT * (most - least),
            doubt: deviation * (most - least),
            group: part.group,
        }
    };
    parts.iter().enumerate().map(tell).collect()
}

/// How much faster than with `of` threads each of the `threads` of a core is that still have work, if each is `ready` in that part of
/// the cycles.
pub(super) fn speed_up(ready: f64, threads: usize, of: usize) -> f64 {
    1.0 + INDEPENDENT * (issue_share(ready, threads) / issue_share(ready, of) - 1.0)
}

/// Cycles for each task and for each uop that `chunks` tell, by least squares. What a chunk is off by grows with the root of its uops; so
/// the cycles of all of them together are met.
///
/// A task that does next to nothing has its first lines to wait for all the same: by uops alone, a long task among many short ones would
/// seem to take far too long.
fn fit(chunks: &[Told]) -> [f64; 2] {
    let Told { tasks, uops, cycles, .. } = sum(chunks);
    let (mut squares, mut products) = (0.0, 0.0);
    for chunk in chunks {
        let per_uops = chunk.tasks / chunk.uops.max(1.0);
        squares += chunk.tasks * per_uops;
        products += chunk.cycles * per_uops;
    }
    let by_uops = cycles / uops.max(1.0);
    let determinant = squares * uops - tasks * tasks;
    // Chunks that are all alike do not tell the two apart.
    if determinant <= ALIKE * tasks * tasks {
        return [0.0, by_uops];
    }
    let task = (products * uops - cycles * tasks) / determinant;
    if task <= 0.0 {
        return [0.0, by_uops];
    }
    let uop = (cycles - task * tasks) / uops.max(1.0);
    if uop < 0.0 { [cycles / tasks, 0.0] } else { [task, uop] }
}

fn sum(chunks: &[Told]) -> Told {
    chunks.iter().fold(Told::default(), |sum, chunk| Told {
        tasks: sum.tasks + chunk.tasks,
        uops: sum.uops + chunk.uops,
        cycles: sum.cycles + chunk.cycles,
        doubt: sum.doubt + chunk.doubt,
        group: chunk.group,
    })
}
