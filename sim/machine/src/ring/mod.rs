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

/// Which tracks of a ring a kind of message takes, in turns.
#[derive(Debug, Clone, Copy)]
struct Lanes {
    first: usize,
    count: u64,
}

/// Where a core sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    ring: u32,
    stop: u32,
}

/// One ring, or the ring of rings.
#[derive(Debug, Clone, Copy)]
struct Loop {
    stops: u32,
    hop_cycles: u32,
}

/// How the slots of the rings are kept.
#[derive(Debug)]
enum Tracks {
    /// Every slot, by ring, lane and direction: `cycle`, and rings with too many stops for the other way.
    Slots(Vec<Belt>),
    /// How many in a window: `windowed`.
    Counts(Counts),
}

/// The shortest way from a stop to another.
#[derive(Debug, Clone, Copy)]
struct Way {
    hops: u32,
    /// 0 up, 1 down: in even cycles and in odd ones, which take turns where both ways are as short.
    directions: [u8; 2],
}

/// All rings.
#[derive(Debug)]
pub(crate) struct Rings {
    spec: RingSpec,
    /// By core.
    places: Vec<Place>,
    /// The rings, then the ring of rings.
    loops: Vec<Loop>,
    tracks: Tracks,
    /// Slots that a message takes, by kind.
    slots: [u32; 3],
    /// Tracks that it takes, by kind.
    lanes: [Lanes; 3],
    /// Lanes of each ring.
    lane_count: usize,
    /// Lines sent.
    lines: u64,
    counters: RingCounters,
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
        // One lane for lines, then those for addresses, then those for acknowledgements.
        let (address, acknowledge) = (spec.ring.address_rings, spec.ring.acknowledge_rings);
        let count = 1 + address + acknowledge;
        let addresses = Lanes { first: 1, count: address.into() };
        let acknowledges = match acknowledge {
            0 => addresses,
            _ => Lanes { first: 1 + address as usize, count: acknowledge.into() },
        };
        let lanes = [addresses, acknowledges, Lanes { first: 0, count: 1 }];
        let places: Vec<Place> =
            (0..rings).flat_map(|ring| (0..size(ring)).map(move |stop| Place { ring, stop })).collect();
        let cycles = |cycles| u32::try_from(cycles).expect("validated: far below 2^32 cycles");
        let mut loops: Vec<Loop> = (0..rings)
            .map(|ring| Loop { stops: size(ring), hop_cycles: cycles(spec.ring.hop_cycles) })
            .collect();
        loops.push(Loop { stops: rings, hop_cycles: cycles(spec.ring.crossing_cycles) });
        let lane_count = count as usize;
        let tracks = if exact || loops.iter().any(|ring| ring.stops > links::STOPS_MAX) {
            // Links are pipelined: between two stops there are as many slots as a hop has cycles.
            let belts =
                |ring: &Loop| (0..2 * lane_count).map(|_| Belt::new(ring.stops * ring.hop_cycles)).collect();
            Tracks::Slots(loops.iter().flat_map::<Vec<Belt>, _>(belts).collect())
        } else {
            Tracks::Counts(Counts::new(&places, &loops, lane_count))
        };
        Rings {
            spec: spec.ring.clone(),
            places,
            loops,
            tracks,
            slots: [1, 1, spec.ring.line_slots],
            lanes,
            lane_count,
            lines: 0,
            counters: RingCounters::default(),
        }
    }

    /// Sends a message from the stop of one core to that of another; returns when it has arrived whole.
    #[inline]
    pub(crate) fn send(&mut self, from: u32, to: u32, message: Message, now: Cycle) -> Cycle {
        if from == to || self.spec.free {
            self.counters.local += 1;
            return now;
        }
        self.counters.messages += 1;
        self.lines += u64::from(message == Message::Line);
        let slots = self.slots[message as usize];
        let Lanes { first, count } = self.lanes[message as usize];
        let lane = if count == 1 { first } else { first + (self.counters.messages % count) as usize };
        let counters = &mut self.counters;
        match &mut self.tracks {
            Tracks::Counts(counts) => counts.carry(from, to, lane, slots, now, counters),
            Tracks::Slots(belts) => {
                let (from, to) = (self.places[from as usize], self.places[to as usize]);
                let carry = |ring: usize, from, to, now| {
                    let belts = &mut belts[2 * (ring * self.lane_count + lane)..][..2];
                    self.loops[ring].carry(belts, from, to, slots, now, counters)
                };
                legs(self.loops.len() - 1, from, to, now, carry)
            }
        }
    }

    /// Cycles that messages have waited for slots so far.
    #[inline(always)]
    pub(crate) fn wait_cycles(&self) -> Cycle {
        self.counters.wait_cycles
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
        let leg = |ring: usize, from, to, now| match way(self.loops[ring].stops, from, to).hops {
            0 => now,
            hops => now + u64::from(hops * self.loops[ring].hop_cycles) + tail,
        };
        legs(self.loops.len() - 1, self.places[from as usize], self.places[to as usize], 0, leg)
    }
}

/// Has a message go from place to place: on one ring, or by the ring of rings, `bridge`, from one to another. `carry` takes it
/// along a ring from stop to stop, when it is there, and returns when it has arrived.
#[inline(always)]
fn legs(
    bridge: usize,
    from: Place,
    to: Place,
    now: Cycle,
    mut carry: impl FnMut(usize, u32, u32, Cycle) -> Cycle,
) -> Cycle {
    if from.ring == to.ring {
        return carry(from.ring as usize, from.stop, to.stop, now);
    }
    let out = carry(from.ring as usize, from.stop, 0, now);
    let across = carry(bridge, from.ring, to.ring, out);
    carry(to.ring as usize, 0, to.stop, across)
}

impl Loop {
    /// Takes a message of `slots` slots from a stop to another, on the `belts` of its lane, up and down.
    #[inline(always)]
    fn carry(
        self,
        belts: &mut [Belt],
        from: u32,
        to: u32,
        slots: u32,
        now: Cycle,
        counters: &mut RingCounters,
    ) -> Cycle {
        let way = way(self.stops, from, to);
        if way.hops == 0 {
            return now;
        }
        let direction = usize::from(way.directions[(now & 1) as usize]);
        let ride_cycles = way.hops * self.hop_cycles;
        let mut board = belts[direction].board(from * self.hop_cycles, ride_cycles, direction, now);
        for _ in 1..slots {
            board = belts[direction].board(from * self.hop_cycles, ride_cycles, direction, board + 1);
        }
        counters.slot_hops += u64::from(slots * way.hops);
        // All slots could be had one after the other from the first cycle on: the rest is waiting.
        counters.wait_cycles += board - now - u64::from(slots - 1);
        board + u64::from(ride_cycles)
    }
}

/// First core of a ring: cores are spread as evenly as they go.
fn first_core(cores: u32, rings: u32, ring: u32) -> u32 {
    (u64::from(ring) * u64::from(cores) / u64::from(rings)) as u32
}
