//! Stretches of time that banks are taken for, of different lengths.

use crate::Cycle;
use crate::occupancy::Ticks;
use crate::pages::Hints;

/// Near pages of a bank.
const PAGES: usize = 64;

/// When each bank is taken, a bit a tick. As with [`Slots`](crate::occupancy::Slots), requests may come out of time order: an
/// early one that is asked for late finds the gap that later ones left.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Spans {
    /// A tick has two to this power of cycles: one, unless spans are so long that they would fill the near pages.
    tick_shift: u32,
    ticks: Ticks<PAGES>,
    /// By bank and ticks: where so many do not fit.
    full: Hints<(u32, u32)>,
}

impl Spans {
    /// For `banks`, and spans of at most `longest` cycles.
    pub(super) fn new(banks: u32, longest: Cycle) -> Spans {
        let tick_cycles = longest.div_ceil(PAGES as u64 * 64 / 16).max(1).next_power_of_two();
        Spans { tick_shift: tick_cycles.trailing_zeros(), ticks: Ticks::new(banks), full: Hints::new() }
    }

    /// Takes the first `cycles` cycles in a row, at least one, for which `bank` is free at or after `now`; returns the first.
    #[inline]
    pub(super) fn take(&mut self, bank: u32, now: Cycle, cycles: Cycle, floor: Cycle) -> Cycle {
        let (wanted, count) = self.at_once(now, cycles);
        let floor = floor >> self.tick_shift;
        if self.ticks.take(bank, wanted, count, floor) {
            return now;
        }
        let (wanted, count) = self.later(now, cycles);
        let first = self.free_from(bank, wanted, count);
        let taken = self.ticks.take(bank, first, count, floor);
        debug_assert!(taken, "free and not free");
        self.full.learn((bank, count), wanted, first, floor);
        first << self.tick_shift
    }

    /// The ticks, first and number, of a span that begins now: the first may have begun before.
    #[inline(always)]
    fn at_once(&self, now: Cycle, cycles: Cycle) -> (u64, u32) {
        let first = now >> self.tick_shift;
        (first, (((now + cycles - 1) >> self.tick_shift) - first + 1) as u32)
    }

    /// The ticks of a span that begins with a tick.
    fn later(&self, now: Cycle, cycles: Cycle) -> (u64, u32) {
        let tick_cycles = 1 << self.tick_shift;
        (now.div_ceil(tick_cycles), cycles.div_ceil(tick_cycles) as u32)
    }

    /// The first tick at or after `wanted` from which on `count` are free.
    fn free_from(&self, bank: u32, wanted: u64, count: u32) -> u64 {
        let mut first = self.full.skip((bank, count), wanted);
        while let Some(last) = self.ticks.last_taken(bank, first, count) {
            first = self.full.skip((bank, count), last + 1);
        }
        first
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laws::{self, Model, Resource};
    use crate::streams::Random;

    #[test]
    fn spans_stand_one_behind_the_other() {
        let mut spans = Spans::new(1, 64);
        let starts: Vec<Cycle> = [42, 58, 42].iter().map(|cycles| spans.take(0, 100, *cycles, 0)).collect();
        assert_eq!(starts, [100, 142, 200]);
    }

    #[test]
    fn an_early_request_finds_the_gap_and_only_if_it_is_long_enough() {
        let mut spans = Spans::new(1, 64);
        assert_eq!(spans.take(0, 100, 40, 0), 100);
        assert_eq!(spans.take(0, 70, 30, 0), 70);
        assert_eq!(spans.take(0, 40, 31, 0), 140);
    }

    #[test]
    fn no_two_spans_overlap_however_long_a_tick_is() {
        for longest in [130, 2000] {
            let (mut spans, mut random) = (Spans::new(3, longest), Random::new(3));
            let mut taken = std::collections::BTreeMap::new();
            for i in 0..400_u32 {
                let cycles = Cycle::from(1 + random.below(longest as u32));
                let now = Cycle::from(i * 80 + random.below(90));
                let first = spans.take(2, now, cycles, 0);
                assert!(first >= now && taken.insert(first, first + cycles).is_none());
            }
            let ends: Vec<(Cycle, Cycle)> = taken.into_iter().collect();
            assert!(ends.windows(2).all(|pair| pair[0].1 <= pair[1].0));
        }
    }

    /// One bank, and spans of three lengths.
    #[derive(Debug, Clone, PartialEq)]
    struct Bank(Spans);

    fn cycles(request: u32) -> Cycle {
        [40, 58, 250][request as usize % 3]
    }

    impl Resource for Bank {
        fn ask(&mut self, request: u32, at: Cycle, floor: Cycle) -> Cycle {
            self.0.take(0, at, cycles(request), floor)
        }

        /// As if all were of the shortest length.
        fn peak(&self, cycles: Cycle) -> u64 {
            cycles.div_ceil(40) + 1
        }
    }

    #[test]
    fn spans_obey_the_laws() {
        let model = || -> Model {
            let mut taken = std::collections::BTreeMap::new();
            Box::new(move |request, at| {
                let mut first = at;
                for (from, to) in &taken {
                    if *from < first + cycles(request) && first < *to {
                        first = *to;
                    }
                }
                taken.insert(first, first + cycles(request));
                first
            })
        };
        laws::obeys(&Bank(Spans::new(1, 256)), model).expect("kept");
    }
}
