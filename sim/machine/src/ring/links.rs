//! The links of the rings, counted in windows: how `windowed` sees short rings.
//!
//! A link carries one slot a cycle. Here only the number of slots that it carries in each window of 32 cycles is kept, a
//! byte a link, so that all links of a ride are looked at and taken in two words of the host. A message that finds a link of
//! its ride full waits for the next window; below that nobody waits.

use super::{Loop, Place, legs, way};
use crate::Cycle;
use crate::counters::RingCounters;

/// Stops at most: a byte of two words for the link behind each.
pub(super) const STOPS_MAX: u32 = 16;
/// Cycles of a window, and slots that a link carries in it.
const WINDOW: u64 = 32;
/// Windows that are remembered: far past any backlog that finite MSHRs can build.
const WINDOWS: u64 = 64;
/// What the bytes start with, so that the top bit of each tells that the link is full.
const EMPTY: [u64; 2] = [u64::MAX / 255 * (128 - WINDOW); 2];

/// All links of all rings.
#[derive(Debug)]
pub(super) struct Counts {
    cores: usize,
    /// The ways that a message takes from each core to each other, row by row; behind the last, [`END`].
    routes: Vec<[u16; LEGS_MAX + 1]>,
    /// The ways from each stop of a ring to each other, row by row, ring by ring.
    ways: Vec<CountedWay>,
    /// By ring, lane and direction.
    links: Vec<Links>,
}

/// Rings that a message rides on at most.
const LEGS_MAX: usize = 3;
/// No way.
const END: u16 = u16::MAX;

/// The shortest way from a stop to another; by parity of the cycle, which decides between two that are as short.
#[derive(Debug)]
struct CountedWay {
    rides: [Ride; 2],
    /// The place of its links, for lane 0.
    links: [u32; 2],
    hops: u32,
    ride_cycles: u32,
}

impl Counts {
    /// For cores at `places`; the last of the `loops` is the ring of rings.
    pub(super) fn new(places: &[Place], loops: &[Loop], lanes: usize) -> Counts {
        let (mut ways, mut links, mut first_ways) = (Vec::new(), Vec::new(), Vec::new());
        for &Loop { stops, hop_cycles } in loops {
            let first_links = links.len() as u32;
            let counted = |from: u32, to: u32| {
                let way = way(stops, from, to);
                // Link l joins stop l and the next.
                let ride = |direction| match direction {
                    0 => Ride::new(from, way.hops, stops),
                    _ => Ride::new(from + stops - way.hops, way.hops, stops),
                };
                CountedWay {
                    rides: way.directions.map(ride),
                    links: way.directions.map(|direction| first_links + u32::from(direction)),
                    hops: way.hops,
                    ride_cycles: way.hops * hop_cycles,
                }
            };
            first_ways.push(ways.len() as u32);
            ways.extend((0..stops).flat_map(|from| (0..stops).map(move |to| counted(from, to))));
            links.extend((0..2 * lanes).map(|_| Links::EMPTY));
        }
        let route = |from: Place, to: Place| {
            let (mut route, mut count) = ([END; LEGS_MAX + 1], 0);
            legs(loops.len() - 1, from, to, 0, |ring, from, to, now| {
                if from != to {
                    route[count] = (first_ways[ring] + from * loops[ring].stops + to) as u16;
                    count += 1;
                }
                now
            });
            route
        };
        let routes = places.iter().flat_map(|from| places.iter().map(|to| route(*from, *to))).collect();
        Counts { cores: places.len(), routes, ways, links }
    }

    /// Takes a message of `slots` slots of a lane from one core to another; returns when it has arrived whole.
    #[inline(always)]
    pub(super) fn carry(
        &mut self,
        from: u32,
        to: u32,
        lane: usize,
        slots: u32,
        now: Cycle,
        counters: &mut RingCounters,
    ) -> Cycle {
        let route = &self.routes[from as usize * self.cores + to as usize];
        let (mut now, mut leg) = (now, 0);
        // The end of a route is no way.
        while let Some(way) = self.ways.get(usize::from(route[leg])) {
            now = ride(way, &mut self.links, 2 * lane, slots, now, counters);
            leg += 1;
        }
        now
    }
}

/// Takes a message along one ring.
#[inline(always)]
fn ride(
    way: &CountedWay,
    links: &mut [Links],
    lane: usize,
    slots: u32,
    now: Cycle,
    counters: &mut RingCounters,
) -> Cycle {
    let parity = (now & 1) as usize;
    let links = &mut links[way.links[parity] as usize + lane];
    let ride = &way.rides[parity];
    let mut board = now;
    if !links.take(now / WINDOW, ride, slots) {
        board = links.wait(now / WINDOW, ride, slots);
        counters.wait_cycles += board - now;
    }
    counters.slot_hops += u64::from(slots * way.hops);
    board + u64::from(slots - 1 + way.ride_cycles)
}

/// Links that a message passes: the top bit of the byte of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Ride([u64; 2]);

impl Ride {
    /// `hops` links from link `first` on, round a ring of `stops`.
    fn new(first: u32, hops: u32, stops: u32) -> Ride {
        let mut words = [0; 2];
        for link in (first..first + hops).map(|link| link % stops) {
            words[link as usize / 8] |= 0x80 << (8 * (link % 8));
        }
        Ride(words)
    }
}

/// Slots taken on all links of one direction of one ring, by window modulo [`WINDOWS`].
#[derive(Debug)]
struct Links([Word; WINDOWS as usize]);

#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
struct Word {
    counts: [u64; 2],
    /// Which window this is; older ones are forgotten.
    window: u64,
}

impl Links {
    const EMPTY: Links = Links([Word { counts: EMPTY, window: 0 }; WINDOWS as usize]);

    /// Takes `slots` slots of all links of `ride` in a window, unless one of them is full.
    #[inline(always)]
    fn take(&mut self, window: u64, Ride(ride): &Ride, slots: u32) -> bool {
        let word = &mut self.0[(window % WINDOWS) as usize];
        if word.window != window {
            if word.window > window {
                // Older than what is remembered.
                return true;
            }
            *word = Word { counts: EMPTY, window };
        }
        let free = (word.counts[0] & ride[0]) | (word.counts[1] & ride[1]) == 0;
        if free {
            word.counts[0] += (ride[0] >> 7) * u64::from(slots);
            word.counts[1] += (ride[1] >> 7) * u64::from(slots);
        }
        free
    }

    /// Takes them in the first window behind `full` in which no link of the ride is; returns when it begins.
    #[inline(never)]
    fn wait(&mut self, full: u64, ride: &Ride, slots: u32) -> Cycle {
        let last = full + WINDOWS - 1;
        let window = (full + 1..last).find(|window| self.take(*window, ride, slots));
        window.unwrap_or(last) * WINDOW
    }
}
