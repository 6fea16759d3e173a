//! Which slots of a shared resource are taken.
//!
//! A resource that serves one request in so many cycles is a row of slots of that length. A request takes the first free
//! slot at or after its time. Requests may come slightly out of time order, as they do when cores are simulated in turn:
//! an early request that is asked for late finds the gap that later ones left. In time order this is exactly a queue.

use crate::Cycle;
use crate::division::Divisor;

const WORDS: usize = 32;
/// Slots that are remembered; older ones count as free, and nobody asks for them any more.
const HORIZON: u64 = WORDS as u64 * 64;

/// Slots of one resource.
#[derive(Debug, Clone)]
pub(crate) struct Slots {
    /// Length of a slot in 1/256 cycles.
    interval_x256: Divisor,
    rows: [Stretch; WORDS],
}

/// 64 slots in a row. Bits and number lie side by side: a request touches one line of the host's cache.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
struct Stretch {
    taken: u64,
    /// Which stretch of 64 slots this is; older ones are forgotten.
    number: u64,
}

impl Stretch {
    const EMPTY: Stretch = Stretch { taken: 0, number: 0 };

    fn is_free(&self, number: u64, bits: u64) -> bool {
        self.number != number || self.taken & bits == 0
    }

    fn take(&mut self, number: u64, bits: u64) {
        if self.number < number {
            *self = Stretch { taken: 0, number };
        }
        if self.number == number {
            self.taken |= bits;
        }
    }
}

/// When something is taken, a bit a tick, for runs of ticks of any length; the last 64 · `WORDS` ticks are remembered.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(crate) struct Ticks<const WORDS: usize>([Stretch; WORDS]);

impl<const WORDS: usize> Ticks<WORDS> {
    pub(crate) const EMPTY: Ticks<WORDS> = Ticks([Stretch::EMPTY; WORDS]);

    /// Takes ticks `[first, first + count)`, at least one, if all are free.
    #[inline(always)]
    pub(crate) fn take(&mut self, first: u64, count: u32) -> bool {
        let (number, shift) = (first / 64, (first % 64) as u32);
        let [index, next] = [number as usize % WORDS, (number as usize + 1) % WORDS];
        if count > 64 || self.0[index].number > number || self.0[next].number > number + 1 {
            return self.take_runs(first, count);
        }
        // The common case: the ticks lie in two stretches at most, of which nothing later has been asked for.
        let bits = u64::MAX >> (64 - count);
        let (low, high) = (bits << shift, bits >> 1 >> (63 - shift));
        let taken_in = |stretch: Stretch, number| if stretch.number == number { stretch.taken } else { 0 };
        let taken = taken_in(self.0[index], number);
        if taken & low != 0 {
            return false;
        }
        if high != 0 {
            let taken = taken_in(self.0[next], number + 1);
            if taken & high != 0 {
                return false;
            }
            self.0[next] = Stretch { taken: taken | high, number: number + 1 };
        }
        self.0[index] = Stretch { taken: taken | low, number };
        true
    }

    /// The same for any ticks.
    #[inline(never)]
    fn take_runs(&mut self, first: u64, count: u32) -> bool {
        let free =
            runs(first, count).all(|(number, bits)| self.0[number as usize % WORDS].is_free(number, bits));
        if free {
            self.take_regardless(first, count);
        }
        free
    }

    /// Takes ticks `[first, first + count)`, free or not.
    pub(crate) fn take_regardless(&mut self, first: u64, count: u32) {
        for (number, bits) in runs(first, count) {
            self.0[number as usize % WORDS].take(number, bits);
        }
    }

    /// The last tick that is taken of the `count` from `first` on.
    pub(crate) fn last_taken(&self, first: u64, count: u32) -> Option<u64> {
        let taken_in = |(number, bits): (u64, u64)| {
            let stretch = &self.0[number as usize % WORDS];
            let taken = if stretch.number == number { stretch.taken & bits } else { 0 };
            (taken != 0).then(|| number * 64 + 63 - u64::from(taken.leading_zeros()))
        };
        runs(first, count).filter_map(taken_in).last()
    }
}

/// Cuts a run of ticks at the borders of words.
#[inline]
fn runs(first: u64, count: u32) -> impl Iterator<Item = (u64, u64)> {
    let mut at = first;
    let end = first + u64::from(count);
    std::iter::from_fn(move || {
        if at >= end {
            return None;
        }
        let take = (64 - at % 64).min(end - at);
        let run = (at / 64, (u64::MAX >> (64 - take)) << (at % 64));
        at += take;
        Some(run)
    })
}

impl Slots {
    pub(crate) fn new(interval_x256: u64) -> Slots {
        Slots { interval_x256: Divisor::new(interval_x256), rows: [Stretch::EMPTY; WORDS] }
    }

    /// Takes the first free slot at or after `now`; returns when it begins, but not before `now`.
    pub(crate) fn take(&mut self, now: Cycle) -> Cycle {
        let (wanted, _) = self.interval_x256.div_rem(now << 8);
        let mut slot = wanted;
        loop {
            let stretch = slot / 64;
            let row = &mut self.rows[(stretch % WORDS as u64) as usize];
            if row.number != stretch {
                if row.number > stretch {
                    // Older than what is remembered.
                    return now;
                }
                *row = Stretch { taken: 0, number: stretch };
            }
            let free = !row.taken & (u64::MAX << (slot % 64));
            if free != 0 {
                let bit = free.trailing_zeros();
                row.taken |= 1 << bit;
                slot = stretch * 64 + u64::from(bit);
                break;
            }
            slot = (stretch + 1) * 64;
            // Every word full: stay in the row rather than forget slots that are still to come.
            if slot - wanted >= HORIZON {
                break;
            }
        }
        // Rounded up: no slot starts before the one before it has ended.
        now.max((slot * self.interval_x256.get()).div_ceil(256))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_at_one_time_are_served_one_interval_apart() {
        let mut slots = Slots::new(4 * 256);
        let starts: Vec<Cycle> = (0..5).map(|_| slots.take(8)).collect();
        assert_eq!(starts, [8, 12, 16, 20, 24]);
    }

    #[test]
    fn a_fraction_of_a_cycle_adds_up() {
        let mut slots = Slots::new(256 * 4 / 3);
        let last = (0..300).map(|_| slots.take(0)).max().expect("300 requests");
        assert!((397..=399).contains(&last), "300 requests of 4/3 cycles end at {last}");
    }

    #[test]
    fn a_late_asker_finds_the_gap_before_an_early_one() {
        let mut slots = Slots::new(256);
        assert_eq!(slots.take(100), 100);
        assert_eq!(slots.take(50), 50);
        assert_eq!(slots.take(100), 101);
    }

    #[test]
    fn no_request_is_served_before_it_was_made() {
        let mut slots = Slots::new(700);
        let mut random = 1_u64;
        for _ in 0..100_000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let now = random >> 44;
            assert!(slots.take(now) >= now);
        }
    }
}
