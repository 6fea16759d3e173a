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

/// Both directions of one ring, for both kinds of message.
#[derive(Debug)]
struct Loop {
    stops: u32,
    /// `[kind][direction]`
    belts: [[Belt; 2]; 2],
}

/// All rings.
#[derive(Debug)]
pub(crate) struct Rings {
    spec: RingSpec,
    /// Ring and stop of each core.
    places: Vec<(u32, u32)>,
    rings: Vec<Loop>,
    bridge: Loop,
    pub(crate) counters: RingCounters,
}

impl Loop {
    fn new(stops: u32, hop_cycles: Cycle) -> Loop {
        // Links are pipelined: between two stops there are as many slots as a hop has cycles.
        let belt = || Belt::new(stops * hop_cycles as u32);
        Loop { stops, belts: [[belt(), belt()], [belt(), belt()]] }
    }

    /// Shortest way from a stop to another: hops, and the direction (0 up, 1 down). Where both are as short, cycles take
    /// turns.
    fn way(&self, from: u32, to: u32, now: Cycle) -> (u32, usize) {
        let up = if to >= from { to - from } else { to + self.stops - from };
        let down = self.stops - up;
        match up.cmp(&down) {
            std::cmp::Ordering::Less => (up, 0),
            std::cmp::Ordering::Greater => (down, 1),
            std::cmp::Ordering::Equal => (up, (now & 1) as usize),
        }
    }
}

impl Rings {
    pub(crate) fn new(spec: &MachineSpec) -> Rings {
        let rings = spec.ring.rings;
        let size = |ring: u32| first_core(spec.cores, rings, ring + 1) - first_core(spec.cores, rings, ring);
        Rings {
            spec: spec.ring.clone(),
            places: (0..rings).flat_map(|ring| (0..size(ring)).map(move |stop| (ring, stop))).collect(),
            rings: (0..rings).map(|ring| Loop::new(size(ring), spec.ring.hop_cycles)).collect(),
            bridge: Loop::new(rings, spec.ring.crossing_cycles),
            counters: RingCounters::default(),
        }
    }

    /// Ring and stop of a core.
    fn place(&self, core: u32) -> (u32, u32) {
        self.places[core as usize]
    }

    /// Sends a message from the stop of one core to that of another; returns when it has arrived whole.
    pub(crate) fn send(&mut self, from: u32, to: u32, message: Message, now: Cycle) -> Cycle {
        if from == to || self.spec.free {
            return now;
        }
        self.counters.messages += 1;
        self.counters.bytes += match message {
            Message::Short => SHORT_BYTES,
            Message::Line => lrbsim_isa::arena::LINE_BYTES,
        };
        let (from_ring, from_stop) = self.place(from);
        let (to_ring, to_stop) = self.place(to);
        if from_ring == to_ring {
            return self.leg(Some(from_ring), from_stop, to_stop, message, now);
        }
        let out = self.leg(Some(from_ring), from_stop, 0, message, now);
        let across = self.leg(None, from_ring, to_ring, message, out);
        self.leg(Some(to_ring), 0, to_stop, message, across)
    }

    /// One way on one ring; `None` is the ring of rings.
    fn leg(&mut self, ring: Option<u32>, from: u32, to: u32, message: Message, now: Cycle) -> Cycle {
        let (on, hop_cycles) = match ring {
            Some(ring) => (&mut self.rings[ring as usize], self.spec.hop_cycles),
            None => (&mut self.bridge, self.spec.crossing_cycles),
        };
        let (hops, direction) = on.way(from, to, now);
        if hops == 0 {
            return now;
        }
        let slots = match message {
            Message::Short => 1,
            Message::Line => self.spec.line_slots,
        };
        let ride_cycles = u64::from(hops) * hop_cycles;
        let belt = &mut on.belts[message as usize][direction];
        let mut board = now;
        for slot in 0..slots {
            let next = if slot == 0 { board } else { board + 1 };
            board = belt.board(from * hop_cycles as u32, ride_cycles as u32, direction, next);
        }
        self.counters.slot_hops += u64::from(slots * hops);
        // All slots could be had one after the other from the first cycle on: the rest is waiting.
        self.counters.wait_cycles += board - now - u64::from(slots - 1);
        board + ride_cycles
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
        let cross = self.spec.crossing_cycles;
        let (from_ring, from_stop) = self.place(from);
        let (to_ring, to_stop) = self.place(to);
        let leg = |on: &Loop, from, to, hop: Cycle| match on.way(from, to, 0).0 {
            0 => 0,
            hops => u64::from(hops) * hop + tail,
        };
        if from_ring == to_ring {
            return leg(&self.rings[from_ring as usize], from_stop, to_stop, self.spec.hop_cycles);
        }
        leg(&self.rings[from_ring as usize], from_stop, 0, self.spec.hop_cycles)
            + leg(&self.bridge, from_ring, to_ring, cross)
            + leg(&self.rings[to_ring as usize], 0, to_stop, self.spec.hop_cycles)
    }
}

/// First core of a ring: cores are spread as evenly as they go.
fn first_core(cores: u32, rings: u32, ring: u32) -> u32 {
    (u64::from(ring) * u64::from(cores) / u64::from(rings)) as u32
}
