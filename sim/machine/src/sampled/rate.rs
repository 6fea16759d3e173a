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

/// How many times as long as the longest chunk that tells a rate others may be before it is not trusted to hold for them.
const TRUSTED: f64 = 2.0;

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

/// Cycles of a thread for each task and for each uop that is no spill, and how far they may be off.
#[derive(Debug, Clone)]
pub(super) struct Rate {
    all: Fit,
    /// What the rate would be without each group of neighbors, which have data, and so errors, in common.
    without: Vec<Fit>,
    /// Relative standard deviation that comes of the model.
    model: f64,
    /// Uops and cycles of the longest chunk of all, each for itself.
    longest: [f64; 2],
    /// Cycles in which a core issues, for each uop: no thread is done sooner with it.
    issue: f64,
}

/// Cycles for each task and for each uop.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fit {
    task: f64,
    uop: f64,
}

impl Rate {
    /// The rate of `chunks`, told by a run of so many `uops` in which the chip has spent its time on the causes of `stack`.
    pub(super) fn of(chunks: &[Told], uops: u64, stack: &CycleStack) -> Rate {
        let all = Sums::of(chunks);
        let without =
            chunks.chunk_by(|a, b| a.group == b.group).map(|group| (all - Sums::of(group)).fit()).collect();
        let data = model(stack);
        let ends = all.doubt / all.cycles.max(1.0);
        Rate {
            all: all.fit(),
            without,
            model: (data * data + ends * ends).sqrt(),
            longest: chunks
                .iter()
                .fold([0.0; 2], |[uops, cycles], chunk| [chunk.uops.max(uops), chunk.cycles.max(cycles)]),
            issue: stack.issue as f64 / uops.max(1) as f64,
        }
    }

    /// Cycles of a thread for some tasks, which have so many uops together.
    pub(super) fn cycles(&self, tasks: f64, uops: f64) -> f64 {
        self.all.cycles(tasks, uops)
    }

    /// Cycles of a thread for tasks of one chunk that is not timed, at least and at most. For how much longer it is than [`TRUSTED`] times the
    /// longest chunk that tells the rate, it takes anything from what its core takes to issue that to what the rate says.
    pub(super) fn bounds(&self, tasks: f64, uops: f64) -> [f64; 2] {
        let most = self.cycles(tasks, uops).max(uops * self.issue);
        let beyond = (uops - TRUSTED * self.longest[0]).max(0.0);
        [(most - beyond * self.all.uop).max(uops * self.issue), most]
    }

    /// Cycles of the longest chunk that tells the rate.
    pub(super) fn longest_cycles(&self) -> f64 {
        self.longest[1]
    }

    /// Standard deviation of [`Rate::cycles`] that comes of the choice of chunks alone: a jackknife over groups.
    pub(super) fn choice_deviation(&self, tasks: f64, uops: f64) -> f64 {
        let count = self.without.len() as f64;
        let cycles = || self.without.iter().map(|fit| fit.cycles(tasks, uops));
        let mean = cycles().sum::<f64>() / count.max(1.0);
        let squares: f64 = cycles().map(|cycles| (cycles - mean) * (cycles - mean)).sum();
        // Of few groups the deviation itself is uncertain: that of Student's distribution with as many degrees of freedom as there are
        // more of them than numbers that were fitted.
        let freedom = count - if self.all.task > 0.0 { 2.0 } else { 1.0 };
        (squares * (count - 1.0) / count.max(1.0) * (freedom / (freedom - 2.0).max(1.0)).max(1.0)).sqrt()
    }

    /// Relative standard deviation of a time that comes of the model.
    pub(super) fn model_deviation(&self) -> f64 {
        self.model
    }
}

impl Fit {
    fn cycles(self, tasks: f64, uops: f64) -> f64 {
        tasks * self.task + uops * self.uop
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

/// What a fit needs of some chunks.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    tasks: f64,
    uops: f64,
    cycles: f64,
    doubt: f64,
    /// The sums of tasks squared and of tasks times cycles, each over the uops.
    squares: f64,
    products: f64,
}

impl Sums {
    fn of(chunks: &[Told]) -> Sums {
        chunks.iter().fold(Sums::default(), |sums, chunk| {
            let per_uops = chunk.tasks / chunk.uops.max(1.0);
            Sums {
                tasks: sums.tasks + chunk.tasks,
                uops: sums.uops + chunk.uops,
                cycles: sums.cycles + chunk.cycles,
                doubt: sums.doubt + chunk.doubt,
                squares: sums.squares + chunk.tasks * per_uops,
                products: sums.products + chunk.cycles * per_uops,
            }
        })
    }

    /// Cycles for each task and for each uop, by least squares. What a chunk is off by grows with the root of its uops; so the cycles of
    /// all of them together are met.
    ///
    /// A task that does next to nothing has its first lines to wait for all the same: by uops alone, a long task among many short ones would
    /// seem to take far too long.
    fn fit(self) -> Fit {
        let Sums { tasks, uops, cycles, squares, products, .. } = self;
        let by_uops = Fit { task: 0.0, uop: cycles / uops.max(1.0) };
        let determinant = squares * uops - tasks * tasks;
        // Chunks that are all alike do not tell the two apart.
        if determinant <= ALIKE * tasks * tasks {
            return by_uops;
        }
        let task = (products * uops - cycles * tasks) / determinant;
        if task <= 0.0 {
            return by_uops;
        }
        let uop = (cycles - task * tasks) / uops.max(1.0);
        if uop < 0.0 { Fit { task: cycles / tasks, uop: 0.0 } } else { Fit { task, uop } }
    }
}

impl std::ops::Sub for Sums {
    type Output = Sums;

    fn sub(self, other: Sums) -> Sums {
        Sums {
            tasks: self.tasks - other.tasks,
            uops: self.uops - other.uops,
            cycles: self.cycles - other.cycles,
            doubt: self.doubt - other.doubt,
            squares: self.squares - other.squares,
            products: self.products - other.products,
        }
    }
}
