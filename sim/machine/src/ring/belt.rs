//! The slots of one direction of one ring.
//!
//! Seen from the ring, slots travel past the places on it, one a tick (cycle); seen from a slot, time passes. So a message
//! that boards at a tick takes *one* slot for as many ticks as its ride lasts, and all its links are a run of bits in that slot's row of ticks: one or two
//! words of the host, however far it goes.

use crate::division::Divisor;

const WORDS: usize = 16;
/// Ticks searched for a free slot before a message goes regardless: far past any backlog that finite MSHRs can build.
const SEARCH_MAX: u64 = 512;

/// Rows of ticks, one a slot.
#[derive(Debug)]
pub(super) struct Belt {
    places: Divisor,
    rows: Vec<Row>,
}

#[derive(Debug, Clone)]
#[repr(align(64))]
struct Row {
    stretches: [Stretch; WORDS],
}

/// 64 ticks of a row. Bits and number lie side by side: most rides touch one line of the host's cache.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    taken: u64,
    /// Which stretch of 64 ticks this is; older ones are forgotten.
    number: u64,
}

impl Row {
    const EMPTY: Row = Row { stretches: [Stretch { taken: 0, number: 0 }; WORDS] };

    /// Takes ticks `[first, first + count)`, at least one, if all are free.
    #[inline(always)]
    fn take(&mut self, first: u64, count: u32) -> bool {
        let (number, shift) = (first / 64, (first % 64) as u32);
        let stretch = &mut self.stretches[number as usize % WORDS];
        if shift + count > 64 || stretch.number > number {
            return self.take_spans(first, count);
        }
        // The common case: the ride lies in one stretch, of which nothing later has been asked for.
        let bits = (u64::MAX >> (64 - count)) << shift;
        let taken = if stretch.number == number { stretch.taken } else { 0 };
        if taken & bits != 0 {
            return false;
        }
        *stretch = Stretch { taken: taken | bits, number };
        true
    }

    /// The same for any ride.
    #[inline(never)]
    fn take_spans(&mut self, first: u64, count: u32) -> bool {
        let mut runs = spans(first, count);
        if !runs.all(|(number, bits)| self.stretches[number as usize % WORDS].is_free(number, bits)) {
            return false;
        }
        for (number, bits) in spans(first, count) {
            self.stretches[number as usize % WORDS].take(number, bits);
        }
        true
    }
}

impl Stretch {
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

/// Cuts a run of ticks at the borders of words.
fn spans(first: u64, count: u32) -> impl Iterator<Item = (u64, u64)> {
    let mut at = first;
    let end = first + u64::from(count);
    std::iter::from_fn(move || {
        if at >= end {
            return None;
        }
        let take = (64 - at % 64).min(end - at);
        let span = (at / 64, (u64::MAX >> (64 - take)) << (at % 64));
        at += take;
        Some(span)
    })
}

impl Belt {
    pub(super) fn new(places: u32) -> Belt {
        Belt { places: Divisor::new(u64::from(places)), rows: vec![Row::EMPTY; places as usize] }
    }

    /// Boards a message of `ride` ticks at place `from`, at `tick` or as soon after as a slot passes that is free all the way.
    /// Returns the tick.
    #[inline(always)]
    pub(super) fn board(&mut self, from: u32, ride: u32, direction: usize, tick: u64) -> u64 {
        // The slot now at `from`: slots move up in direction 0, down in direction 1.
        let places = self.places.get();
        let (_, phase) = self.places.div_rem(tick);
        let back = if direction == 0 { phase } else { places - phase };
        let from = u64::from(from);
        let slot = if from >= back { from - back } else { from + places - back };
        if self.rows[slot as usize].take(tick, ride) {
            return tick;
        }
        self.wait(slot, ride, direction, tick)
    }

    /// Waits for a free slot behind `slot`, which passes at `tick` and is taken.
    #[inline(never)]
    fn wait(&mut self, mut slot: u64, ride: u32, direction: usize, tick: u64) -> u64 {
        let places = self.places.get();
        for wait in 1..SEARCH_MAX {
            slot = match direction {
                0 if slot == 0 => places - 1,
                0 => slot - 1,
                _ if slot + 1 == places => 0,
                _ => slot + 1,
            };
            if self.rows[slot as usize].take(tick + wait, ride) {
                return tick + wait;
            }
        }
        tick + SEARCH_MAX
    }
}
