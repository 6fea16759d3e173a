//! The slots of one direction of one ring.
//!
//! Seen from the ring, slots travel past the places on it, one a tick (cycle); seen from a slot, time passes. So a message
//! that boards at a tick takes *one* slot for as many ticks as its ride lasts, and all its links are a run of bits in that
//! slot's row of ticks: one or two words of the host, however far it goes.

use crate::division::Divisor;
use crate::occupancy::Ticks;

/// Ticks searched for a free slot before a message goes regardless: far past any backlog that finite MSHRs can build.
const SEARCH_MAX: u64 = 512;

/// Rows of ticks, one a slot.
#[derive(Debug)]
pub(super) struct Belt {
    places: Divisor,
    rows: Vec<Row>,
}

/// The ticks of one slot.
type Row = Ticks<16>;

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
