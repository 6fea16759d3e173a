//! Which host instructions compute the lanes, and functional runs on many host threads.

use core::fmt;
use core::str::FromStr;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::arena::Arena;
use crate::emit::OpCounts;
use crate::program::{Ordering, Step};

/// Host instructions that compute the lanes. Results do not depend on it, only host time does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostSimd {
    /// 512-bit registers and masks.
    Avx512,
    /// 256-bit registers with fused multiply-add.
    Avx2,
    /// Plain loops: the `Scalar` back end, and the definition of every operation.
    Portable,
}

impl HostSimd {
    /// All of them, fastest first.
    pub const ALL: [HostSimd; 3] = [HostSimd::Avx512, HostSimd::Avx2, HostSimd::Portable];

    /// The fastest that this host has.
    pub fn detect() -> HostSimd {
        HostSimd::ALL.into_iter().find(|simd| simd.is_available()).unwrap_or(HostSimd::Portable)
    }

    /// Whether this host has it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx512 => {
                HostSimd::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512cd")
            }
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("fma")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(not(target_arch = "x86_64"))]
            HostSimd::Avx512 | HostSimd::Avx2 => false,
            HostSimd::Portable => true,
        }
    }
}

impl fmt::Display for HostSimd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            HostSimd::Avx512 => "avx512",
            HostSimd::Avx2 => "avx2",
            HostSimd::Portable => "portable",
        })
    }
}

impl FromStr for HostSimd {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        HostSimd::ALL
            .into_iter()
            .find(|simd| simd.to_string() == text)
            .ok_or_else(|| format!("'{text}' is no host SIMD level; it must be avx512, avx2 or portable"))
    }
}

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

/// Asks the host for the cache line of `place`, ahead of its use. Changes no result.
#[inline(always)]
pub fn prefetch<T>(place: &T) {
    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "a prefetch reads nothing and cannot fault")]
    // SAFETY: every x86-64 host has the instruction.
    unsafe {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(core::ptr::from_ref(place).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = place;
}
