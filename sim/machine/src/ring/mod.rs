//! The rings: cores at their stops, and slots that travel past them.
//!
//! ```text
//!   ring 0   o─o─o─o        ring 1   o─o─o─o         o  a core, its L2, a slice of the directory;
//!            │     │                 │     │            at some stops a memory controller
//!            o─X─o─o                 o─X─o─o         X  stop 0: where messages change rings
//!              ╚═════ ring of rings ═══╝
//! ```
//!
//! Stops store nothing and messages never pause on their way [seiler08, §3.4]: a message waits at its stop until a slot
//! comes by that stays free all the way. Lines, addresses and acknowledgements have rings of their own, as on Knights
//! Corner, where there are several for the short ones [chrysos12].

mod belt;
mod links;

#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::config::{MachineSpec, RingSpec};
use crate::counters::RingCounters;
use belt::Belt;
use links::Counts;
use std::collections::BTreeMap;

/// Bytes of a request or acknowledgement, for the counters.
const SHORT_BYTES: u64 = 8;

/// What travels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Message {
    /// A request, a forward, an invalidation or a notice.
    Address,
    /// An acknowledgement.
    Acknowledge,
    /// A line.
    Line,
}

/// What became of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sent {
    /// When it has arrived whole.
    pub(crate) at: Cycle,
    /// Cycles of that in which it waited for slots.
    pub(crate) waited: Cycle,
}

/// Which strands of a ring a kind of message takes, in turns. A strand is one of the buses that run side by side: for lines,
/// for addresses, for acknowledgements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Strands {
    first: u32,
    count: u32,
    /// Whose turn it is.
    turn: u32,
}

impl Strands {
    /// The next strand.
    #[inline(always)]
    fn next(&mut self) -> u32 {
        let strand = self.first + self.turn;
        self.turn = if self.turn + 1 == self.count { 0 } else { self.turn + 1 };
        strand
    }
}

/// Where a core sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    ring: u32,
    stop: u32,
}

/// One ring, or the ring of rings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Loop {
    stops: u32,
    hop_cycles: u32,
    track: Track,
}

/// How the slots of a ring are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Track {
    /// Every slot, on belts of its own, of which this is the first: `cycle`, and rings with too many stops for the other way.
    Slots(u32),
    /// How many in a window: `windowed`. The first of its ways and the first of its links.
    Counts(u32, u32),
}

/// The shortest way from a stop to another.
#[derive(Debug, Clone, Copy)]
struct Way {
    hops: u32,
    /// 0 up, 1 down: in even cycles and in odd ones, which take turns where both ways are as short.
    directions: [u8; 2],
}

/// All rings.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rings {
    spec: RingSpec,
    /// By core.
    places: Vec<Place>,
    /// The rings, then the ring of rings.
    loops: Vec<Loop>,
    tracks: Tracks,
    /// Slots that a message takes, by kind.
    slots: [u32; 3],
    /// Strands that a message takes, by kind.
    strands: [Strands; 3],
    /// Strands of each ring.
    strand_count: u32,
    /// Lines sent.
    lines: u64,
    counters: RingCounters,
}

/// The slots of all rings.
#[derive(Debug, Clone, PartialEq)]
struct Tracks {
    /// By ring, strand and direction.
    belts: Vec<Belt>,
    counts: Counts,
}

/// The shortest way on a ring of `stops`.
#[inline(always)]
fn way(stops: u32, from: u32, to: u32) -> Way {
    let up = if to >= from { to - from } else { to + stops - from };
    let down = stops - up;
    Way { hops: up.min(down), directions: [u8::from(down < up), u8::from(down <= up)] }
}

impl Rings {
    /// Rings that know every slot (`exact`), or count them in windows where that is faster.
    pub(crate) fn new(spec: &MachineSpec, exact: bool) -> Rings {
        let rings = spec.ring.rings;
        let size = |ring: u32| first_core(spec.cores, rings, ring + 1) - first_core(spec.cores, rings, ring);
        // One strand for lines, then those for addresses, then those for acknowledgements.
        let (address, acknowledge) = (spec.ring.address_rings, spec.ring.acknowledge_rings);
        let strand_count = 1 + address + acknowledge;
        let addresses = Strands { first: 1, count: address, turn: 0 };
        let acknowledges = match acknowledge {
            0 => addresses,
            count => Strands { first: 1 + address, count, turn: 0 },
        };
        let strands = [addresses, acknowledges, Strands { first: 0, count: 1, turn: 0 }];
        let places: Vec<Place> =
            (0..rings).flat_map(|ring| (0..size(ring)).map(move |stop| Place { ring, stop })).collect();

        // The tracks of each ring, and of the ring of rings.
        let cycles = |cycles| u32::try_from(cycles).expect("validated: far below 2^32 cycles");
        let (hop_cycles, crossing_cycles) = (cycles(spec.ring.hop_cycles), cycles(spec.ring.crossing_cycles));
        let ring_sizes = (0..rings).map(|ring| (size(ring), hop_cycles));
        let mut tracks = Tracks { belts: Vec::new(), counts: Counts::new() };
        let mut ways = BTreeMap::new();
        let loops = ring_sizes.chain([(rings, crossing_cycles)]).map(|(stops, hop_cycles)| {
            let track = if exact || stops > links::STOPS_MAX {
                let first = tracks.belts.len();
                // Links are pipelined: between two stops there are as many slots as a hop has cycles.
                let belts = (0..2 * strand_count).map(|_| Belt::new(stops * hop_cycles));
                tracks.belts.extend(belts);
                Track::Slots(first as u32)
            } else {
                let counts = &mut tracks.counts;
                let ways =
                    *ways.entry((stops, hop_cycles)).or_insert_with(|| counts.add_ways(stops, hop_cycles));
                Track::Counts(ways, counts.add_links(strand_count as usize))
            };
            Loop { stops, hop_cycles, track }
        });
        Rings {
            spec: spec.ring.clone(),
            places,
            loops: loops.collect(),
            tracks,
            slots: [1, 1, spec.ring.line_slots],
            strands,
            strand_count,
            lines: 0,
            counters: RingCounters::default(),
        }
    }

    /// Sends a message from the stop of one core to that of another. Nobody sends before `floor` from now on.
    #[inline]
    pub(crate) fn send(&mut self, from: u32, to: u32, message: Message, now: Cycle, floor: Cycle) -> Sent {
        debug_assert!(floor <= now, "asked for {now}, which lies before the floor, {floor}");
        if from == to || self.spec.free {
            self.counters.local += 1;
            return Sent { at: now, waited: 0 };
        }
        let slots = self.slots[message as usize];
        let strand = self.strands[message as usize].next();
        let [from, to] = [from, to].map(|core| self.places[core as usize]);
        let trip = Trip { at: now, waited: 0, hops: 0 };
        let trip = if from.ring == to.ring {
            self.ride(from.ring as usize, strand, (from.stop, to.stop), slots, floor, trip)
        } else {
            let bridge = self.loops.len() - 1;
            let trip = self.ride(from.ring as usize, strand, (from.stop, 0), slots, floor, trip);
            let trip = self.ride(bridge, strand, (from.ring, to.ring), slots, floor, trip);
            self.ride(to.ring as usize, strand, (0, to.stop), slots, floor, trip)
        };
        self.counters.messages += 1;
        self.lines += u64::from(message == Message::Line);
        self.counters.slot_hops += u64::from(slots * trip.hops);
        self.counters.wait_cycles += trip.waited;
        Sent { at: trip.at, waited: trip.waited }
    }

    /// Takes a message of `slots` slots, which has come as far as `trip`, along a ring from a stop to another.
    #[inline(always)]
    fn ride(
        &mut self,
        ring: usize,
        strand: u32,
        (from, to): (u32, u32),
        slots: u32,
        floor: Cycle,
        trip: Trip,
    ) -> Trip {
        if from == to {
            return trip;
        }
        let ring = self.loops[ring];
        let Boarding { board, ride_cycles, hops } = match ring.track {
            Track::Counts(ways, links) => {
                let way = ways + from * ring.stops + to;
                self.tracks.counts.ride(way, links + 2 * strand, slots, trip.at, floor)
            }
            Track::Slots(belts) => {
                self.tracks.board(ring, belts + 2 * strand, (from, to), slots, trip.at, floor)
            }
        };
        Trip {
            at: board + ride_cycles,
            // All slots could be had one after the other from the first cycle on: the rest is waiting.
            waited: trip.waited + (board - trip.at - u64::from(slots - 1)),
            hops: trip.hops + hops,
        }
    }

    /// Slots of links, one a hop, that are taken in cycles from `from` on, which is not before the floor.
    ///
    /// Where slots are counted in windows, a ride belongs whole to the window in which it boards, and the window of `from`
    /// counts whole: too many by at most 32 a link, too few by what rides that boarded in earlier windows have still to go.
    /// Where every slot is known, each counts in the cycle in which it is on its link, a started hop as a hop.
    pub(crate) fn slot_hops_from(&self, from: Cycle) -> u64 {
        let belts_of = |ring: &Loop| match ring.track {
            Track::Slots(first) => {
                let belts = self.tracks.belts[first as usize..].iter().take(2 * self.strand_count as usize);
                belts.map(|belt| belt.taken_from(from)).sum::<u64>().div_ceil(ring.hop_cycles.into())
            }
            Track::Counts(..) => 0,
        };
        self.tracks.counts.taken_from(from) + self.loops.iter().map(belts_of).sum::<u64>()
    }

    /// Most slots of links, one a hop, that all strands of all rings carry in `cycles` cycles in a row. Rounded up: by one
    /// cycle, and where slots are counted in windows to whole windows and one more.
    pub(crate) fn peak_slot_hops(&self, cycles: Cycle) -> u64 {
        let peak = |ring: &Loop| {
            let of_link = match ring.track {
                Track::Slots(_) => cycles + 1,
                Track::Counts(..) => (cycles.div_ceil(links::WINDOW) + 1) * links::WINDOW,
            };
            // A ring of one stop has no links.
            let links = if ring.stops == 1 { 0 } else { 2 * self.strand_count * ring.stops };
            u64::from(links) * of_link
        };
        self.loops.iter().map(peak).sum()
    }

    /// Gives out what was counted since the last time.
    pub(crate) fn take_counters(&mut self) -> RingCounters {
        let counters = std::mem::take(&mut self.counters);
        let lines = std::mem::take(&mut self.lines);
        let bytes = SHORT_BYTES * (counters.messages - lines) + lrbsim_isa::arena::LINE_BYTES * lines;
        RingCounters { bytes, ..counters }
    }

    /// Cycles a message takes on idle rings.
    pub(crate) fn idle_cycles(&self, from: u32, to: u32, message: Message) -> Cycle {
        if from == to || self.spec.free {
            return 0;
        }
        let tail = match message {
            Message::Address | Message::Acknowledge => 0,
            Message::Line => u64::from(self.spec.line_slots - 1),
        };
        let [from, to] = [from, to].map(|core| self.places[core as usize]);
        let cycles = |ring: Loop, from, to| match way(ring.stops, from, to).hops {
            0 => 0,
            hops => u64::from(hops * ring.hop_cycles) + tail,
        };
        let [ring, last] = [from.ring, to.ring].map(|ring| self.loops[ring as usize]);
        if from.ring == to.ring {
            return cycles(ring, from.stop, to.stop);
        }
        let bridge = self.loops[self.loops.len() - 1];
        cycles(ring, from.stop, 0) + cycles(bridge, from.ring, to.ring) + cycles(last, 0, to.stop)
    }
}

/// How far a message has come.
#[derive(Debug, Clone, Copy)]
struct Trip {
    at: Cycle,
    /// Cycles of that in which it waited for slots.
    waited: Cycle,
    hops: u32,
}

/// When the last slot of a message boards a ring, and its ride.
#[derive(Debug, Clone, Copy)]
struct Boarding {
    board: Cycle,
    ride_cycles: Cycle,
    hops: u32,
}

impl Tracks {
    /// Takes a message of `slots` slots along a ring whose every slot is known, on the belts from `belts` on, up and down.
    #[inline(never)]
    fn board(
        &mut self,
        ring: Loop,
        belts: u32,
        (from, to): (u32, u32),
        slots: u32,
        now: Cycle,
        floor: Cycle,
    ) -> Boarding {
        let way = way(ring.stops, from, to);
        let direction = usize::from(way.directions[(now & 1) as usize]);
        let belt = &mut self.belts[belts as usize + direction];
        let (from, ride) = (from * ring.hop_cycles, way.hops * ring.hop_cycles);
        let mut board = belt.board(from, ride, direction, now, floor);
        for _ in 1..slots {
            board = belt.board(from, ride, direction, board + 1, floor);
        }
        Boarding { board, ride_cycles: ride.into(), hops: way.hops }
    }
}

/// First core of a ring: cores are spread as evenly as they go.
fn first_core(cores: u32, rings: u32, ring: u32) -> u32 {
    (u64::from(ring) * u64::from(cores) / u64::from(rings)) as u32
}
