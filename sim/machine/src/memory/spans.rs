//! Stretches of time that a resource is taken for, of different lengths.

use crate::Cycle;
use crate::occupancy::Ticks;

const WORDS: usize = 64;
/// Ticks that are remembered; what lies farther back counts as free, and nobody asks for it any more.
const HORIZON: u64 = WORDS as u64 * 64;

/// When one resource is taken, a bit a tick. As with [`Slots`](crate::occupancy::Slots), requests may come slightly out of
/// time order: an early one that is asked for late finds the gap that later ones left.
#[derive(Debug, Clone)]
pub(super) struct Spans {
    /// A tick has two to this power of cycles: one, unless spans are so long that too few of them would be remembered.
    tick_shift: u32,
    ticks: Ticks<WORDS>,
}

impl Spans {
    /// For spans of at most `longest` cycles.
    pub(super) fn new(longest: Cycle) -> Spans {
        let tick_cycles = longest.div_ceil(HORIZON / 16).max(1).next_power_of_two();
        Spans { tick_shift: tick_cycles.trailing_zeros(), ticks: Ticks::EMPTY }
    }

    /// Takes the first `cycles` cycles in a row, at least one, that are free at or after `now`; returns the first.
    #[inline]
    pub(super) fn take(&mut self, now: Cycle, cycles: Cycle) -> Cycle {
        let wanted = now >> self.tick_shift;
        // At most a sixteenth of the horizon.
        let count = ((cycles + (1 << self.tick_shift) - 1) >> self.tick_shift) as u32;
        if self.ticks.take(wanted, count) { now } else { self.wait(wanted, count) << self.tick_shift }
    }

    /// The first tick behind `wanted` from which on `count` are free, and takes them.
    #[inline(never)]
    fn wait(&mut self, wanted: u64, count: u32) -> u64 {
        let mut first = wanted;
        while let Some(last) = self.ticks.last_taken(first, count) {
            first = last + 1;
            // More is asked for than can ever be served: wait no longer than is remembered.
            if first - wanted >= HORIZON / 2 {
                break;
            }
        }
        self.ticks.take_regardless(first, count);
        first
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::Random;

    #[test]
    fn spans_stand_one_behind_the_other() {
        let mut spans = Spans::new(64);
        let starts: Vec<Cycle> = [42, 58, 42].iter().map(|cycles| spans.take(100, *cycles)).collect();
        assert_eq!(starts, [100, 142, 200]);
    }

    #[test]
    fn an_early_request_finds_the_gap_and_only_if_it_is_long_enough() {
        let mut spans = Spans::new(64);
        assert_eq!(spans.take(100, 40), 100);
        assert_eq!(spans.take(70, 30), 70);
        assert_eq!(spans.take(40, 31), 140);
    }

    #[test]
    fn no_two_spans_overlap() {
        let (mut spans, mut random) = (Spans::new(130), Random::new(3));
        let mut taken = std::collections::BTreeMap::new();
        for i in 0..400_u32 {
            let cycles = Cycle::from(1 + random.below(130));
            let first = spans.take(Cycle::from(i * 80 + random.below(90)), cycles);
            assert_eq!(taken.insert(first, first + cycles), None);
        }
        let ends: Vec<(Cycle, Cycle)> = taken.into_iter().collect();
        assert!(ends.windows(2).all(|pair| pair[0].1 <= pair[1].0));
    }
}
