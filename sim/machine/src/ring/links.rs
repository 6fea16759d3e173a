//! The links of the rings, counted in windows: how `windowed` sees short rings.
//!
//! A link carries one slot a cycle. Here only the number of slots that it carries in each window of 32 cycles is kept, a
//! byte a link, so that all links of a ride are looked at and taken in two words of the host. A message that finds a link of
//! its ride full waits for the next window; below that nobody waits. All links of a ride are taken in the window in which it
//! boards.

use super::{Boarding, way};
use crate::Cycle;
use crate::pages::{Far, Hints, Marks, Near, far_from};

/// Stops at most: a byte of two words for the link behind each.
pub(super) const STOPS_MAX: u32 = 16;
/// Cycles of a window, and slots that a link carries in it.
pub(super) const WINDOW: Cycle = 32;
/// What the bytes start with, so that the top bit of each tells that the link is full.
const EMPTY: u64 = u64::MAX / 255 * (128 - WINDOW);

/// Links of rings of up to [`STOPS_MAX`] stops.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Counts {
    /// The ways from each stop to each other, row by row, for each size and speed of ring; of each way two, for even cycles and
    /// for odd ones, which take turns where both ways round are as short.
    ways: Vec<[CountedWay; 2]>,
    /// By ring, strand and direction; near windows.
    links: Vec<Near<Taken, 64>>,
    far: Far<Taken>,
    /// By row of `links` and ride: windows in which a link of the ride is full.
    full: Hints<(u32, Ride)>,
    #[cfg(test)]
    pub(super) fault: Option<crate::laws::Fault>,
}

/// The shortest way from a stop to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct CountedWay {
    ride: Ride,
    direction: u8,
    hops: u8,
    ride_cycles: u32,
}

impl Counts {
    pub(super) const fn new() -> Counts {
        Counts {
            ways: Vec::new(),
            links: Vec::new(),
            far: Far::new(),
            full: Hints::new(),
            #[cfg(test)]
            fault: None,
        }
    }

    /// Adds the links of a ring of so many strands; returns the first.
    pub(super) fn add_links(&mut self, strands: usize) -> u32 {
        let first = self.links.len();
        self.links.resize(first + 2 * strands, Near::EMPTY);
        first as u32
    }

    /// Adds the ways on a ring of `stops`; returns the first. Rings that are alike share them.
    pub(super) fn add_ways(&mut self, stops: u32, hop_cycles: u32) -> u32 {
        let first = self.ways.len();
        let counted = |from: u32, to: u32| {
            let way = way(stops, from, to);
            // Link l joins stop l and the next.
            let ride = |direction| match direction {
                0 => Ride::new(from, way.hops, stops),
                _ => Ride::new(from + stops - way.hops, way.hops, stops),
            };
            way.directions.map(|direction| CountedWay {
                ride: ride(direction),
                direction,
                hops: way.hops as u8,
                ride_cycles: way.hops * hop_cycles,
            })
        };
        self.ways.extend((0..stops).flat_map(|from| (0..stops).map(move |to| counted(from, to))));
        first as u32
    }

    /// Takes a message of `slots` slots along a way on the links from `links` on, up and down; returns when its last
    /// slot boards, and the ride.
    #[inline(always)]
    pub(super) fn ride(&mut self, way: u32, links: u32, slots: u32, now: Cycle, floor: Cycle) -> Boarding {
        let CountedWay { ride, direction, hops, ride_cycles } = self.ways[way as usize][(now & 1) as usize];
        let row = links + u32::from(direction);
        let mut board = self.board(row, ride, now, floor);
        for _ in 1..slots {
            board = self.board(row, ride, board + 1, floor);
        }
        Boarding { board, ride_cycles: ride_cycles.into(), hops: hops.into() }
    }

    /// Takes one slot of each link of a ride.
    #[inline(always)]
    fn board(&mut self, row: u32, ride: Ride, now: Cycle, floor: Cycle) -> Cycle {
        let links = &mut self.links[row as usize];
        match links.here(now / WINDOW, || floor / WINDOW, &self.far) {
            Some(taken) if taken.has_room(ride) => {
                taken.add(ride);
                now
            }
            _ => self.wait(row, ride, now, floor),
        }
    }

    /// Takes one slot of each link of a ride whose first window is full or not at hand.
    #[inline(never)]
    fn wait(&mut self, row: u32, ride: Ride, now: Cycle, floor: Cycle) -> Cycle {
        let (wanted, floor) = (now / WINDOW, floor / WINDOW);
        let links = &mut self.links[row as usize];
        let mut window = self.full.skip((row, ride), wanted);
        while !links.get(row, window, &self.far).has_room(ride) {
            window = self.full.skip((row, ride), window + 1);
        }
        links.page(row, window, floor, &mut self.far).add(ride);
        self.full.learn((row, ride), wanted, window, floor);
        #[cfg(test)]
        if self.fault == Some(crate::laws::Fault::LinksForget) {
            self.far.clear();
            self.full = Hints::new();
        }
        now.max(window * WINDOW)
    }

    /// Slots of all links that are taken in the window of cycle `from` and later.
    pub(super) fn taken_from(&self, from: Cycle) -> u64 {
        let first = from / WINDOW;
        let near = self.links.iter().flat_map(|links| links.from(first));
        near.chain(far_from(&self.far, first)).map(|page| page.marks.sum()).sum()
    }
}

/// Links that a message passes: the top bit of the byte of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
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

/// Slots taken in one window on all links of one direction of one ring, above [`EMPTY`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Taken([u64; 2]);

impl Marks for Taken {
    const NONE: Taken = Taken([EMPTY; 2]);
}

impl Taken {
    #[inline(always)]
    fn has_room(self, Ride(ride): Ride) -> bool {
        (self.0[0] & ride[0]) | (self.0[1] & ride[1]) == 0
    }

    #[inline(always)]
    fn add(&mut self, Ride(ride): Ride) {
        self.0[0] += ride[0] >> 7;
        self.0[1] += ride[1] >> 7;
    }

    fn sum(self) -> u64 {
        self.0.iter().flat_map(|word| (word - EMPTY).to_le_bytes()).map(u64::from).sum()
    }
}
