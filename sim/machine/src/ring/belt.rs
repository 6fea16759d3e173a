//! The slots of one direction of one ring.
//!
//! Seen from the ring, slots travel past the places on it, one a tick (cycle); seen from a slot, time passes. So a message
//! that boards at a tick takes *one* slot for as many ticks as its ride lasts, and all its links are a run of bits in that
//! slot's row of ticks: one or two words of the host, however far it goes.

use crate::Cycle;
use crate::division::Divisor;
use crate::occupancy::Ticks;
use crate::pages::Hints;

/// Rows of ticks, one a slot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Belt {
    places: Divisor,
    rows: Ticks<16>,
    /// By place and ride: when no slot comes by that is free all the way.
    full: Hints<(u32, u32)>,
}

impl Belt {
    pub(super) fn new(places: u32) -> Belt {
        Belt { places: Divisor::new(u64::from(places)), rows: Ticks::new(places), full: Hints::new() }
    }

    /// Boards a message of `ride` ticks at place `from`, at `tick` or as soon after as a slot passes that is free all the way.
    /// Returns the tick. Nobody boards before `floor` any more.
    #[inline(always)]
    pub(super) fn board(
        &mut self,
        from: u32,
        ride: u32,
        direction: usize,
        tick: Cycle,
        floor: Cycle,
    ) -> Cycle {
        let slot = self.slot_at(from, direction, tick);
        if self.rows.take(slot, tick, ride, floor) {
            return tick;
        }
        self.wait(from, ride, direction, tick, floor)
    }

    /// The slot that is at place `from`: slots move up in direction 0, down in direction 1.
    #[inline(always)]
    fn slot_at(&self, from: u32, direction: usize, tick: Cycle) -> u32 {
        let places = self.places.get() as u32;
        let phase = self.places.div_rem(tick).1 as u32;
        let back = if direction == 0 { phase } else { places - phase };
        if from >= back { from - back } else { from + places - back }
    }

    /// Waits for a free slot behind the one that passes at `tick`.
    #[inline(never)]
    fn wait(&mut self, from: u32, ride: u32, direction: usize, tick: Cycle, floor: Cycle) -> Cycle {
        let mut at = tick;
        loop {
            at = self.full.skip((from, ride), at + 1);
            let slot = self.slot_at(from, direction, at);
            if self.rows.take(slot, at, ride, floor) {
                self.full.learn((from, ride), tick, at, floor);
                return at;
            }
        }
    }

    /// Ticks of all slots that are taken from `tick` on.
    pub(super) fn taken_from(&self, tick: Cycle) -> u64 {
        self.rows.taken_from(tick)
    }
}
