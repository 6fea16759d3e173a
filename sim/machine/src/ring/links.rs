//! The links of one direction of one ring, counted in windows: how `windowed` sees a short ring.
//!
//! A link carries one slot a cycle. Here only the number of slots that it carries in each window of 64 cycles is kept, a
//! byte a link, so that all links of a ride are looked at and taken in one word of the host. A message that finds a link of
//! its ride full waits for the next window; below that nobody waits.

use crate::Cycle;

/// Stops at most: a byte of a word for the link behind each.
pub(super) const STOPS_MAX: u32 = 16;
/// Cycles of a window, and slots that a link carries in it.
const WINDOW: u64 = 64;
/// Windows that are remembered: far past any backlog that finite MSHRs can build.
const WINDOWS: u64 = 32;
/// One in every byte.
const ONES: u128 = u128::MAX / 255;
/// What a byte starts with, so that its top bit tells that the link is full.
const EMPTY: u128 = ONES * (128 - WINDOW as u128);

/// Links that a message passes: the top bit of the byte of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Ride(u128);

impl Ride {
    /// `hops` links from link `first` on, round a ring of `stops`.
    pub(super) fn new(first: u32, hops: u32, stops: u32) -> Ride {
        Ride((first..first + hops).fold(0, |links, link| links | 0x80 << (8 * (link % stops))))
    }
}

/// Slots taken on all links, by window modulo [`WINDOWS`].
#[derive(Debug)]
pub(super) struct Links([Word; WINDOWS as usize]);

#[derive(Debug, Clone, Copy)]
struct Word {
    counts: u128,
    /// Which window this is; older ones are forgotten.
    window: u64,
}

impl Links {
    pub(super) fn new() -> Links {
        Links([Word { counts: EMPTY, window: 0 }; WINDOWS as usize])
    }

    /// Takes `slots` slots of all links of `ride`, at `now` or as soon as none of them is full. Returns when.
    #[inline(always)]
    pub(super) fn take(&mut self, ride: Ride, slots: u32, now: Cycle) -> Cycle {
        if self.take_in(now / WINDOW, ride, slots) { now } else { self.wait(ride, slots, now) }
    }

    #[inline(always)]
    fn take_in(&mut self, window: u64, ride: Ride, slots: u32) -> bool {
        let word = &mut self.0[(window % WINDOWS) as usize];
        if word.window != window {
            if word.window > window {
                // Older than what is remembered.
                return true;
            }
            *word = Word { counts: EMPTY, window };
        }
        let free = word.counts & ride.0 == 0;
        if free {
            word.counts += (ride.0 >> 7) * u128::from(slots);
        }
        free
    }

    /// The first window behind that of `now` in which no link of the ride is full.
    #[inline(never)]
    fn wait(&mut self, ride: Ride, slots: u32, now: Cycle) -> Cycle {
        let first = now / WINDOW + 1;
        let last = first + WINDOWS - 2;
        let window = (first..last).find(|window| self.take_in(*window, ride, slots));
        window.unwrap_or(last) * WINDOW
    }
}
