//! Stretches of time that a resource is taken for, of different lengths.

use crate::Cycle;

const WORDS: usize = 64;
/// Ticks that are remembered; what lies farther back counts as free, and nobody asks for it any more.
const HORIZON: u64 = WORDS as u64 * 64;

/// When one resource is taken, a bit a tick. As with [`Slots`](crate::occupancy::Slots), requests may come slightly out of
/// time order: an early one that is asked for late finds the gap that later ones left.
#[derive(Debug, Clone)]
pub(super) struct Spans {
    /// A tick has two to this power of cycles: one, unless spans are so long that too few of them would be remembered.
    tick_shift: u32,
    words: [Word; WORDS],
}

#[derive(Debug, Clone, Copy, Default)]
struct Word {
    taken: u64,
    /// Which stretch of 64 ticks this is.
    stretch: u64,
}

impl Word {
    #[inline(always)]
    fn is_free(&self, stretch: u64, bits: u64) -> bool {
        self.stretch != stretch || self.taken & bits == 0
    }

    #[inline(always)]
    fn take(&mut self, stretch: u64, bits: u64) {
        if self.stretch < stretch {
            *self = Word { taken: 0, stretch };
        }
        if self.stretch == stretch {
            self.taken |= bits;
        }
    }
}

impl Spans {
    /// For spans of at most `longest` cycles.
    pub(super) fn new(longest: Cycle) -> Spans {
        let tick_cycles = longest.div_ceil(HORIZON / 16).max(1).next_power_of_two();
        Spans { tick_shift: tick_cycles.trailing_zeros(), words: [Word::default(); WORDS] }
    }

    /// Takes the first `cycles` cycles in a row, at least one, that are free at or after `now`; returns the first.
    #[inline]
    pub(super) fn take(&mut self, now: Cycle, cycles: Cycle) -> Cycle {
        let first = now >> self.tick_shift;
        let ticks = (cycles + (1 << self.tick_shift) - 1) >> self.tick_shift;
        // The common case: what is wanted is free, and lies in two stretches at most.
        let (stretch, shift) = (first / 64, first % 64);
        if ticks <= 64 {
            let span = u128::from(u64::MAX >> (64 - ticks)) << shift;
            let wanted = [(stretch, span as u64), (stretch + 1, (span >> 64) as u64)];
            if wanted.iter().all(|(stretch, bits)| self.word(*stretch).is_free(*stretch, *bits)) {
                for (stretch, bits) in wanted.into_iter().filter(|(_, bits)| *bits != 0) {
                    self.word(stretch).take(stretch, bits);
                }
                return now;
            }
        }
        now.max(self.take_ticks(first, ticks) << self.tick_shift)
    }

    #[inline(always)]
    fn word(&mut self, stretch: u64) -> &mut Word {
        &mut self.words[stretch as usize % WORDS]
    }

    #[inline(never)]
    fn take_ticks(&mut self, now: u64, cycles: u64) -> u64 {
        let mut first = now;
        while let Some(last) = self.last_taken(first, cycles) {
            first = last + 1;
            // More is asked for than can ever be served: wait no longer than is remembered.
            if first - now >= HORIZON / 2 {
                break;
            }
        }
        let mut at = first;
        while at < first + cycles {
            let (stretch, shift) = (at / 64, at % 64);
            let count = (64 - shift).min(first + cycles - at);
            self.word(stretch).take(stretch, bits(shift, count));
            at += count;
        }
        first
    }

    /// The last tick that is taken of the `cycles` from `first` on.
    fn last_taken(&self, first: Cycle, cycles: Cycle) -> Option<Cycle> {
        let end = first + cycles;
        let mut stretch = (end - 1) / 64;
        loop {
            let from = first.max(stretch * 64);
            let until = end.min(stretch * 64 + 64);
            let word = &self.words[stretch as usize % WORDS];
            let taken = word.taken & bits(from % 64, until - from);
            if word.stretch == stretch && taken != 0 {
                return Some(stretch * 64 + 63 - u64::from(taken.leading_zeros()));
            }
            if from == first {
                return None;
            }
            stretch -= 1;
        }
    }
}

/// `count` bits from `shift` on, 1 to 64 of them.
fn bits(shift: u64, count: u64) -> u64 {
    (u64::MAX >> (64 - count)) << shift
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
