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
//! comes by that stays free all the way. Lines and short messages (requests, acknowledgements) have rings of their own, as
//! on Knights Corner [chrysos12].

mod belt;
mod links;

#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::config::{MachineSpec, RingSpec};
use crate::counters::RingCounters;
use belt::Belt;
use links::{Links, Ride};

/// Bytes of a request or acknowledgement, for the counters.
const SHORT_BYTES: u64 = 8;

/// What travels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Message {
    /// A request, an invalidation or an acknowledgement.
    Short,
    /// A line.
    Line,
}

/// Where a core sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    ring: u32,
    stop: u32,
}

/// Both directions of one ring, for both kinds of message.
#[derive(Debug)]
struct Loop {
    stops: u32,
    hop_cycles: u32,
    tracks: Tracks,
}

/// How the slots of a ring are kept, by message and direction.
#[derive(Debug)]
enum Tracks {
    /// Every slot: `cycle`, and rings with too many stops for the other way.
    Slots([Belt; 4]),
    /// How many in a window: `windowed`. From each stop to each other there is a way, row by row.
    Counts { ways: Vec<CountedWay>, links: Box<[Links; 4]> },
}

/// The shortest way from a stop to another.
#[derive(Debug, Clone, Copy)]
struct Way {
    hops: u32,
    /// 0 up, 1 down: in even cycles and in odd ones, which take turns where both ways are as short.
    directions: [u8; 2],
}

/// The same where slots are counted.
#[derive(Debug)]
struct CountedWay {
    way: Way,
    ride_cycles: u32,
    rides: [Ride; 2],
}

/// All rings.
#[derive(Debug)]
pub(crate) struct Rings {
    spec: RingSpec,
    /// By core.
    places: Vec<Place>,
    rings: Vec<Loop>,
    bridge: Loop,
    /// Slots that a short message and a line take.
    slots: [u32; 2],
    counters: RingCounters,
}

impl Loop {
    fn new(stops: u32, hop_cycles: Cycle, exact: bool) -> Loop {
        let hop_cycles = u32::try_from(hop_cycles).expect("validated: far below 2^32 cycles");
        let tracks = if exact || stops > links::STOPS_MAX {
            // Links are pipelined: between two stops there are as many slots as a hop has cycles.
            Tracks::Slots([0; 4].map(|_| Belt::new(stops * hop_cycles)))
        } else {
            let counted = |from: u32, to: u32| {
                let way = way(stops, from, to);
                // Link l joins stop l and the next.
                let ride = |direction| match direction {
                    0 => Ride::new(from, way.hops, stops),
                    _ => Ride::new(from + stops - way.hops, way.hops, stops),
                };
                CountedWay { way, ride_cycles: way.hops * hop_cycles, rides: way.directions.map(ride) }
            };
            let ways = (0..stops).flat_map(|from| (0..stops).map(move |to| counted(from, to))).collect();
            Tracks::Counts { ways, links: Box::new([0; 4].map(|_| Links::new())) }
        };
        Loop { stops, hop_cycles, tracks }
    }

    /// Takes a message of `slots` slots from a stop to another; returns when it has arrived whole.
    #[inline(always)]
    fn carry(
        &mut self,
        from: u32,
        to: u32,
        message: Message,
        slots: u32,
        now: Cycle,
        counters: &mut RingCounters,
    ) -> Cycle {
        let parity = (now & 1) as usize;
        let (board, hops, ride_cycles) = match &mut self.tracks {
            Tracks::Counts { ways, links } => {
                let CountedWay { way, ride_cycles, rides } = &ways[(from * self.stops + to) as usize];
                if way.hops == 0 {
                    return now;
                }
                let links = &mut links[message as usize * 2 + usize::from(way.directions[parity])];
                let board = links.take(rides[parity], slots, now) + u64::from(slots - 1);
                (board, way.hops, *ride_cycles)
            }
            Tracks::Slots(belts) => {
                let way = way(self.stops, from, to);
                if way.hops == 0 {
                    return now;
                }
                let direction = usize::from(way.directions[parity]);
                let ride_cycles = way.hops * self.hop_cycles;
                let belt = &mut belts[message as usize * 2 + direction];
                let mut board = belt.board(from * self.hop_cycles, ride_cycles, direction, now);
                for _ in 1..slots {
                    board = belt.board(from * self.hop_cycles, ride_cycles, direction, board + 1);
                }
                (board, way.hops, ride_cycles)
            }
        };
        counters.slot_hops += u64::from(slots * hops);
        // All slots could be had one after the other from the first cycle on: the rest is waiting.
        counters.wait_cycles += board - now - u64::from(slots - 1);
        board + u64::from(ride_cycles)
    }
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
        let places = |ring| (0..size(ring)).map(move |stop| Place { ring, stop });
        Rings {
            spec: spec.ring.clone(),
            places: (0..rings).flat_map(places).collect(),
            rings: (0..rings).map(|ring| Loop::new(size(ring), spec.ring.hop_cycles, exact)).collect(),
            bridge: Loop::new(rings, spec.ring.crossing_cycles, exact),
            slots: [1, spec.ring.line_slots],
            counters: RingCounters::default(),
        }
    }

    /// Sends a message from the stop of one core to that of another; returns when it has arrived whole.
    #[inline]
    pub(crate) fn send(&mut self, from: u32, to: u32, message: Message, now: Cycle) -> Cycle {
        if from == to || self.spec.free {
            return now;
        }
        let counters = &mut self.counters;
        counters.messages += 1;
        counters.bytes += [SHORT_BYTES, lrbsim_isa::arena::LINE_BYTES][message as usize];
        let slots = self.slots[message as usize];
        let (from, to) = (self.places[from as usize], self.places[to as usize]);
        if from.ring == to.ring {
            let ring = &mut self.rings[from.ring as usize];
            return ring.carry(from.stop, to.stop, message, slots, now, counters);
        }
        let out = self.rings[from.ring as usize].carry(from.stop, 0, message, slots, now, counters);
        let across = self.bridge.carry(from.ring, to.ring, message, slots, out, counters);
        self.rings[to.ring as usize].carry(0, to.stop, message, slots, across, counters)
    }

    /// Cycles that messages have waited for slots so far.
    #[inline(always)]
    pub(crate) fn wait_cycles(&self) -> Cycle {
        self.counters.wait_cycles
    }

    /// Gives out what was counted since the last time.
    pub(crate) fn take_counters(&mut self) -> RingCounters {
        std::mem::take(&mut self.counters)
    }

    /// Cycles a message takes on idle rings.
    pub(crate) fn idle_cycles(&self, from: u32, to: u32, message: Message) -> Cycle {
        if from == to || self.spec.free {
            return 0;
        }
        let tail = match message {
            Message::Short => 0,
            Message::Line => u64::from(self.spec.line_slots - 1),
        };
        let leg = |on: &Loop, from, to| match way(on.stops, from, to).hops {
            0 => 0,
            hops => u64::from(hops * on.hop_cycles) + tail,
        };
        let (from, to) = (self.places[from as usize], self.places[to as usize]);
        if from.ring == to.ring {
            return leg(&self.rings[from.ring as usize], from.stop, to.stop);
        }
        leg(&self.rings[from.ring as usize], from.stop, 0)
            + leg(&self.bridge, from.ring, to.ring)
            + leg(&self.rings[to.ring as usize], 0, to.stop)
    }
}

/// First core of a ring: cores are spread as evenly as they go.
fn first_core(cores: u32, rings: u32, ring: u32) -> u32 {
    (u64::from(ring) * u64::from(cores) / u64::from(rings)) as u32
}
