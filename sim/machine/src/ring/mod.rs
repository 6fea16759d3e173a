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

#[cfg(test)]
mod tests;

use crate::Cycle;
use crate::config::{MachineSpec, RingSpec};
use crate::counters::RingCounters;
use belt::Belt;

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
    /// By message and direction.
    belts: [Belt; 4],
}

/// The shortest way from a stop to another.
#[derive(Debug, Clone, Copy)]
struct Way {
    hops: u32,
    /// 0 up, 1 down.
    direction: u8,
    /// Whether the other direction is as short: then cycles take turns.
    both: bool,
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
    fn new(stops: u32, hop_cycles: Cycle) -> Loop {
        let hop_cycles = u32::try_from(hop_cycles).expect("validated: far below 2^32 cycles");
        // Links are pipelined: between two stops there are as many slots as a hop has cycles.
        let belt = || Belt::new(stops * hop_cycles);
        Loop { stops, hop_cycles, belts: [belt(), belt(), belt(), belt()] }
    }

    #[inline(always)]
    fn way(&self, from: u32, to: u32) -> Way {
        let up = if to >= from { to - from } else { to + self.stops - from };
        let down = self.stops - up;
        Way { hops: up.min(down), direction: u8::from(down < up), both: up == down }
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
        let Way { hops, direction, both } = self.way(from, to);
        if hops == 0 {
            return now;
        }
        let direction = usize::from(direction) | usize::from(both) & now as usize;
        let ride_cycles = hops * self.hop_cycles;
        let belt = &mut self.belts[message as usize * 2 + direction];
        let place = from * self.hop_cycles;
        let mut board = belt.board(place, ride_cycles, direction, now);
        for _ in 1..slots {
            board = belt.board(place, ride_cycles, direction, board + 1);
        }
        counters.slot_hops += u64::from(slots * hops);
        // All slots could be had one after the other from the first cycle on: the rest is waiting.
        counters.wait_cycles += board - now - u64::from(slots - 1);
        board + u64::from(ride_cycles)
    }
}

impl Rings {
    pub(crate) fn new(spec: &MachineSpec) -> Rings {
        let rings = spec.ring.rings;
        let size = |ring: u32| first_core(spec.cores, rings, ring + 1) - first_core(spec.cores, rings, ring);
        let places = |ring| (0..size(ring)).map(move |stop| Place { ring, stop });
        Rings {
            spec: spec.ring.clone(),
            places: (0..rings).flat_map(places).collect(),
            rings: (0..rings).map(|ring| Loop::new(size(ring), spec.ring.hop_cycles)).collect(),
            bridge: Loop::new(rings, spec.ring.crossing_cycles),
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
        let leg = |on: &Loop, from, to| match on.way(from, to).hops {
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
