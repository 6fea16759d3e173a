//! Which chunks of a step are timed.

use super::Skipped;
use lrbsim_isa::Class;
use lrbsim_isa::OpCounts;
use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::Stream;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Part of a step's chunks that is timed at first: with less of them, too many are timed while other threads have run out of work.
const SHARE: f64 = 0.045;

/// Chunks for each thread that are timed at least.
const PER_THREAD: f64 = 1.25;

/// Chunks that are timed at least: with fewer, how much they differ is not known.
const CHUNKS_MIN: f64 = 120.0;

/// Neighbors that are timed together at most: what one of them has in its caches the next may need.
const GROUP_MAX: usize = 8;

/// Groups of neighbors at least, as far as there are so many chunks.
const GROUPS_MIN: usize = 12;

/// Tasks of the first chunk of each thread that are timed: what is cold is cold for them.
const FIRST_TASKS: u32 = 1;

/// Chunks of the pilot.
const PILOT: usize = 16;

/// Steps of which more than this would be timed are timed whole.
const WHOLE_SHARE: f64 = 0.8;

/// Tasks of one chunk that a thread gets at once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Part {
    /// The number of the chunk.
    pub(crate) chunk: usize,
    pub(crate) tasks: Range<u32>,
    /// The number of the group of neighbors that it was chosen with.
    pub(crate) group: usize,
}

/// The chunks of a step, and which of them are timed so far.
pub(super) struct Chunks {
    /// The first task of each chunk, and the number of all tasks.
    starts: Vec<u32>,
    threads: usize,
    seed: u64,
    /// By chunk the end of those of its tasks that are timed; its start if none is.
    timed: Vec<u32>,
    /// Groups of neighbors so far.
    groups: usize,
    /// The chunks of the pilot, in order.
    pilot: Vec<usize>,
}

/// Mixes bits (splitmix64).
pub(crate) fn hash(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Chunks {
    pub(super) fn new(lengths: &[u32], threads: usize, seed: u64) -> Chunks {
        let mut starts = vec![0];
        for length in lengths {
            starts.push(starts[starts.len() - 1] + length);
        }
        let timed = starts[..lengths.len()].to_vec();
        Chunks { starts, threads, seed: hash(seed), timed, groups: 0, pilot: Vec::new() }
    }

    fn count(&self) -> usize {
        self.timed.len()
    }

    /// What is timed first, in order: the first chunk of each thread in part, groups in the middle, and the last chunk of each
    /// thread, so that the others are not alone while they run.
    pub(super) fn first_round(&mut self) -> Vec<Part> {
        let middle = self.middle();
        let mut parts: Vec<Part> = (0..self.threads).map(|chunk| self.part(chunk, FIRST_TASKS)).collect();
        let all: Vec<usize> = middle.clone().filter(|chunk| !self.is_taken(*chunk)).collect();
        parts.extend(self.groups(&all, self.wanted()));
        parts.extend((middle.end..self.count()).map(|chunk| self.part(chunk, u32::MAX)));
        parts
    }

    /// Whether there are so few that all are timed.
    pub(super) fn are_few(&self) -> bool {
        (self.wanted() + 2 * self.threads) as f64 > WHOLE_SHARE * self.count() as f64
    }

    /// Groups of neighbors that are wanted first, in chunks.
    fn wanted(&self) -> usize {
        let least = (PER_THREAD * self.threads as f64).max(CHUNKS_MIN);
        (self.count() as f64 * SHARE).max(least) as usize
    }

    /// The chunks between the first and the last of each thread.
    fn middle(&self) -> Range<usize> {
        self.threads..self.count().saturating_sub(self.threads)
    }

    /// Chunks here and there that are never timed: what they have to do tells how much the step has.
    pub(super) fn pilot(&mut self) -> Vec<Part> {
        let middle = self.middle();
        for number in 0..PILOT {
            let share = middle.len() * number / PILOT..middle.len() * (number + 1) / PILOT;
            if !share.is_empty() {
                let at = hash(self.seed ^ !(number as u64)) % share.len() as u64;
                self.pilot.push(middle.start + share.start + at as usize);
            }
        }
        let part = |chunk: &usize| Part {
            chunk: *chunk,
            tasks: self.starts[*chunk]..self.starts[chunk + 1],
            group: 0,
        };
        self.pilot.iter().map(part).collect()
    }

    /// All chunks but those of the pilot, in order.
    pub(super) fn all_but_pilot(&mut self) -> Vec<Part> {
        let all: Vec<usize> = (0..self.count()).filter(|chunk| !self.is_taken(*chunk)).collect();
        self.groups(&all, all.len())
    }

    /// Whether any of the tasks of a chunk are timed, or it is one of the pilot's.
    fn is_taken(&self, chunk: usize) -> bool {
        self.timed[chunk] > self.starts[chunk] || self.pilot.binary_search(&chunk).is_ok()
    }

    /// As many chunks more as are timed so far, or those that are left; none where they are fewer than threads.
    pub(super) fn next_round(&mut self) -> Vec<Part> {
        self.seed = hash(self.seed);
        let (taken, left): (Vec<usize>, Vec<usize>) =
            (0..self.count()).partition(|chunk| self.is_taken(*chunk));
        // Fewer than threads would not have a core as full as the others had.
        if left.len() < self.threads {
            return Vec::new();
        }
        self.groups(&left, taken.len() - self.pilot.len())
    }

    /// Groups of neighbors among `chunks`, some `wanted` in all: one at a hashed place of each of as many equal shares.
    fn groups(&mut self, chunks: &[usize], wanted: usize) -> Vec<Part> {
        if wanted >= chunks.len() {
            let all = chunks.chunks(GROUP_MAX).flat_map(|some| self.group(some));
            return all.collect();
        }
        let group = (wanted / GROUPS_MIN).clamp(1, GROUP_MAX);
        let groups = (wanted / group).max(1);
        let mut picked = Vec::new();
        for number in 0..groups {
            let share = &chunks[chunks.len() * number / groups..chunks.len() * (number + 1) / groups];
            let room = share.len().saturating_sub(group) + 1;
            let at = (hash(self.seed ^ number as u64) % room as u64) as usize;
            picked.extend(self.group(&share[at..share.len().min(at + group)]));
        }
        picked
    }

    /// Neighbors that are chosen together.
    fn group(&mut self, chunks: &[usize]) -> Vec<Part> {
        self.groups += 1;
        chunks.iter().map(|chunk| self.part(*chunk, u32::MAX)).collect()
    }

    /// Up to `tasks` tasks of a chunk, which are timed from here on.
    fn part(&mut self, chunk: usize, tasks: u32) -> Part {
        let start = self.starts[chunk];
        let end = self.starts[chunk + 1].min(start.saturating_add(tasks));
        self.timed[chunk] = end;
        Part { chunk, tasks: start..end, group: self.groups }
    }

    /// Part of the tasks that is timed.
    pub(super) fn timed_share(&self) -> f64 {
        let timed: u32 = self.timed.iter().zip(&self.starts).map(|(end, start)| end - start).sum();
        f64::from(timed) / f64::from(self.starts[self.count()])
    }

    /// By chunk how many of its tasks are not timed.
    pub(super) fn left(&self) -> impl Iterator<Item = u32> {
        self.timed.iter().zip(&self.starts[1..]).map(|(timed, end)| end - timed)
    }

    /// What is not timed and was not in the pilot.
    pub(super) fn untimed(&self) -> Vec<Part> {
        (0..self.count())
            .filter(|chunk| self.pilot.binary_search(chunk).is_err())
            .map(|chunk| Part { chunk, tasks: self.timed[chunk]..self.starts[chunk + 1], group: 0 })
            .filter(|part| !part.tasks.is_empty())
            .collect()
    }

    /// The chunk that task `task` is in.
    pub(super) fn chunk_of(&self, task: u32) -> usize {
        self.starts.partition_point(|start| *start <= task) - 1
    }
}

/// The chosen tasks of a step, by position: as a chip sees them that times them, or what runs them without.
pub(crate) struct Chosen<'a> {
    inner: &'a dyn TaskSource,
    /// The number of each task.
    tasks: Vec<u32>,
    /// The uops of each task but for spills, once it has run.
    uops: Vec<AtomicU64>,
    /// Where tasks are run in order: the next, and what those did that were not chosen.
    skipped: Mutex<(u32, Skipped)>,
}

impl<'a> Chosen<'a> {
    pub(crate) fn new(inner: &'a dyn TaskSource, parts: &[Part]) -> Chosen<'a> {
        let tasks: Vec<u32> = parts.iter().flat_map(|part| part.tasks.clone()).collect();
        let uops = std::iter::repeat_with(AtomicU64::default).take(tasks.len()).collect();
        Chosen { inner, tasks, uops, skipped: Mutex::default() }
    }

    /// The uops, but for spills, of each task; 0 of those that have not run.
    pub(crate) fn uops(&self) -> impl Iterator<Item = u64> {
        self.uops.iter().map(|uops| uops.load(Relaxed))
    }

    /// By part its uops but for spills, and what ran in between.
    pub(crate) fn into_counts(self, parts: &[Part]) -> (Vec<u64>, Skipped) {
        let mut uops = self.uops.into_iter().map(AtomicU64::into_inner);
        let by_part = parts.iter().map(|part| uops.by_ref().take(part.tasks.len()).sum()).collect();
        (by_part, self.skipped.into_inner().unwrap_or_else(PoisonError::into_inner).1)
    }
}

impl TaskSource for Chosen<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn tasks(&self) -> u32 {
        self.tasks.len() as u32
    }

    fn is_ordered(&self) -> bool {
        self.inner.is_ordered()
    }

    fn record(&self, position: u32, stream: &mut Stream) {
        let task = self.tasks[position as usize];
        if self.is_ordered() {
            let mut skipped = self.skipped.lock().unwrap_or_else(PoisonError::into_inner);
            let (next, skipped) = &mut *skipped;
            for task in *next..task {
                let uops = skip(self.inner, task, &mut skipped.counts);
                skipped.uops.push((task, uops));
            }
            *next = task + 1;
        }
        self.inner.record(task, stream);
        let counts = stream.count_classes();
        let spills = counts[Class::SpillStore as usize] + counts[Class::SpillLoad as usize];
        self.uops[position as usize].store(counts.iter().sum::<u64>() - spills, Relaxed);
    }

    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
        tasks.for_each(|position| {
            let uops = skip(self.inner, self.tasks[position as usize], counts);
            self.uops[position as usize].store(uops, Relaxed);
        });
    }
}

/// Runs a task, adds its operations to `counts`, and tells how many they are.
fn skip(tasks: &dyn TaskSource, task: u32, counts: &mut OpCounts) -> u64 {
    let before = counts.total();
    tasks.skip(task..task + 1, counts);
    counts.total() - before
}
