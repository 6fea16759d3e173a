//! Functional runs: the tasks of a step on many host threads, without timing.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::arena::Arena;
use crate::emit::OpCounts;
use crate::host::HostSimd;
use crate::program::{Ordering, Step};

/// Runs all tasks of `step` on `threads` host threads, without timing, and counts their operations.
///
/// An ordered step runs on one thread. Memory afterwards and the counts do not depend on `threads`.
pub fn run_functional(step: &Step, arena: &Arena, simd: HostSimd, threads: usize) -> OpCounts {
    let mut counts = OpCounts::default();
    if step.ordering == Ordering::Ordered || threads <= 1 || step.tasks <= 1 {
        step.kernel.run(simd, arena, 0..step.tasks, false, &mut counts);
        return counts;
    }
    // Small chunks in index order: tasks differ in cost by orders of magnitude.
    let next = AtomicU32::new(0);
    let work = || {
        let mut counts = OpCounts::default();
        loop {
            let task = next.fetch_add(1, Relaxed);
            if task >= step.tasks {
                return counts;
            }
            step.kernel.run(simd, arena, task..task + 1, true, &mut counts);
        }
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        for worker in workers {
            match worker.join() {
                Ok(partial) => counts.add(&partial),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
    });
    counts
}
