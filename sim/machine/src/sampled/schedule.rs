//! When a step is over whose chunks go to whichever thread is free first.

use super::rate::speed_up;
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Cycles until the last of `threads` threads on `cores` cores is done with chunks, each given to the first that is free. A chunk takes its
/// duration while all threads have work; once there is none left for others, those of the same core go faster, see [`speed_up`].
pub(super) fn makespan(durations: impl Iterator<Item = f64>, [threads, cores]: [u32; 2], ready: f64) -> f64 {
    let (threads, cores) = (threads as usize, cores as usize);
    // When each thread would be done; thread k is one of core k mod cores.
    let mut done = vec![0.0; threads];
    let mut free: BinaryHeap<Reverse<(Time, usize)>> =
        (0..threads).map(|thread| Reverse((Time(0.0), thread))).collect();
    for duration in durations {
        let Reverse((Time(at), thread)) = free.pop().expect("a thread");
        done[thread] = at + duration;
        free.push(Reverse((Time(done[thread]), thread)));
    }
    (0..cores.min(threads))
        .map(|core| {
            let mut of_core: Vec<f64> = done[core..].iter().step_by(cores).copied().collect();
            of_core.sort_unstable_by(f64::total_cmp);
            let (mut now, mut before) = (0.0, 0.0);
            for (gone, until) in of_core.iter().enumerate() {
                now += (until - before) / speed_up(ready, of_core.len() - gone, of_core.len());
                before = *until;
            }
            now
        })
        .fold(0.0, f64::max)
}

/// Cycles, in their order.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Time(f64);

impl Eq for Time {}

impl PartialOrd for Time {
    fn partial_cmp(&self, other: &Time) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Time {
    fn cmp(&self, other: &Time) -> Ordering {
        self.0.total_cmp(&other.0)
    }
}
