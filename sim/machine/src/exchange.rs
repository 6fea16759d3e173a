//! What a core and the uncore say to one another: the only ties between the two rooms of the machine.
//!
//! ```text
//! core: threads, L1, L2, TLB, MSHRs ──Request, Pull──► uncore: directory, rings, controllers, task counter
//!                                   ◄────Message────
//! ```

use crate::Cycle;
use crate::cache::Intent;
use crate::when::When;
use lrbsim_isa::stream::Stream;

/// A line that a core wants, or wants to write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Request {
    /// The time of the uop: the L2 has found out that it misses `l2.hit_cycles` later.
    pub(crate) time: Cycle,
    pub(crate) line: u32,
    pub(crate) intent: Intent,
    /// The MSHR of the L2 that waits.
    pub(crate) mshr: u16,
    /// Whether the L2 has a copy, or waits for one that was asked for before, which is not enough.
    pub(crate) held: bool,
    /// The line that makes room, and whether it was modified.
    pub(crate) victim: Option<Victim>,
}

/// A line that a core throws out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Victim {
    pub(crate) line: u32,
    /// Whether its data go back to memory.
    pub(crate) write_back: bool,
    /// Whether the home is told.
    pub(crate) notify_home: bool,
}

/// A thread that asks for tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Pull {
    pub(crate) time: Cycle,
    pub(crate) thread: u8,
}

/// What the uncore tells a core.
#[derive(Debug)]
pub(crate) enum Message {
    /// The line of MSHR `mshr` of the L2 arrives at `fill`.
    Answer {
        mshr: u16,
        fill: When,
        /// Whether the core owns the line from then on.
        owned: bool,
        /// Whether the MSHR stays taken until [`Message::Release`].
        kept: bool,
    },
    /// MSHR `mshr` of the L2 is free from `at` on: what its miss threw out has been taken by a controller.
    Release { mshr: u16, at: Cycle },
    /// What another core wants of a line that this one has.
    Claim(Claim),
    /// The thread has got these tasks, none when the counter is at its end, and can begin at `from` at the earliest.
    Tasks { thread: u8, streams: Vec<Stream>, from: Cycle },
}

impl Message {
    /// When it can wake a thread at the earliest.
    pub(crate) fn wakes_at(&self) -> Cycle {
        match self {
            Message::Answer { fill, .. } => fill.at(),
            Message::Release { at, .. } | Message::Tasks { from: at, .. } => *at,
            Message::Claim(_) => Cycle::MAX,
        }
    }
}

/// What another core wants of a line that this one has: until then it may use the line as before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Claim {
    pub(crate) at: Cycle,
    pub(crate) line: u32,
    /// Whether the other becomes its owner, not only a reader.
    pub(crate) owns: bool,
}
