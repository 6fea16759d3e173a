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
    rows: [Row; WORDS],
}

/// 64 slots in a row. Bits and number lie side by side: a request touches one line of the host's cache.
#[derive(Debug, Clone, Copy)]
#[repr(align(16))]
struct Row {
    taken: u64,
    /// Which stretch of 64 slots this is.
    stretch: u64,
}

impl Slots {
    pub(crate) fn new(interval_x256: u64) -> Slots {
        Slots { interval_x256: Divisor::new(interval_x256), rows: [Row { taken: 0, stretch: 0 }; WORDS] }
    }

    /// Takes the first free slot at or after `now`; returns when it begins, but not before `now`.
    pub(crate) fn take(&mut self, now: Cycle) -> Cycle {
        let (wanted, _) = self.interval_x256.div_rem(now << 8);
        let mut slot = wanted;
        loop {
            let stretch = slot / 64;
            let row = &mut self.rows[(stretch % WORDS as u64) as usize];
            if row.stretch != stretch {
                if row.stretch > stretch {
                    // Older than what is remembered.
                    return now;
                }
                *row = Row { taken: 0, stretch };
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
