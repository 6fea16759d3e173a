//! Functional runs: the tasks of a step on many host threads, without timing.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::arena::Arena;
use crate::emit::OpCounts;
use crate::host::HostSimd;
use crate::program::{Step, StepSource, TaskSource};

/// Runs all tasks of `step` on `host_threads` host threads, without timing, and counts their operations.
///
/// An ordered step runs on one thread. Memory afterwards and the counts do not depend on `host_threads`.
pub fn run_functional(step: &Step, arena: &mut Arena, simd: HostSimd, host_threads: usize) -> OpCounts {
    skip_all(&StepSource::new(step, arena, simd, host_threads), host_threads)
}

/// Runs all tasks of `source` on `host_threads` host threads, as [`run_functional`] does, and records none.
pub fn skip_all(source: &dyn TaskSource, host_threads: usize) -> OpCounts {
    let tasks = source.tasks();
    let mut counts = OpCounts::default();
    if source.is_ordered() || host_threads <= 1 || tasks <= 1 {
        source.skip(0..tasks, &mut counts);
        return counts;
    }
    // Small chunks in index order: tasks differ in cost by orders of magnitude.
    let next = AtomicU32::new(0);
    let work = || {
        let mut counts = OpCounts::default();
        loop {
            let task = next.fetch_add(1, Relaxed);
            if task >= tasks {
                return counts;
            }
            source.skip(task..task + 1, &mut counts);
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..host_threads).map(|_| scope.spawn(work)).collect();
        for worker in workers {
            match worker.join() {
                Ok(partial) => counts.add(&partial),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
    });
    counts
}
