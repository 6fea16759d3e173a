//! The uncore: a directory with a slice at every ring stop, rings and memory controllers. Coherence is MESI at line grain, one
//! transaction a line at a time, served by the line's home.
//!
//! ```text
//! requester ──request──► home ──forward──► owner ──line──► requester
//!                          │└──invalidate─► sharers ──ack──► requester
//!                          └──read──► controller ──line──► requester
//! ```
//!
//! [`transition`] says what happens; `Uncore` says what it costs. A transaction is a chain of legs (`Leg`), each of which
//! asks one shared resource. `windowed` times the chain of one request whole before it looks at the next; `cycle` keeps all
//! legs in an agenda, so that every resource is asked in the order of time.

mod agenda;
mod directory;
mod sharers;
mod transaction;
mod transition;
mod uncore;

#[cfg(test)]
pub(crate) mod bench;
#[cfg(test)]
pub(crate) mod explore;
#[cfg(test)]
mod tests;

/// A defect to be seeded, for tests that show that the checks notice.
#[cfg(test)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// A copy stays where another core writes.
    KeepCopy,
    /// An owner that was read stays the owner.
    KeepOwner,
    /// The home does not note a new reader.
    ForgetReader,
    /// The home is not told of a copy that is gone.
    ForgetEviction,
    /// A modified line that has to make room is not written back.
    LoseWrite,
    /// An owner that is read does not give memory what it wrote.
    LoseSharedWrite,
    /// The L1 keeps what the L2 loses.
    KeepInL1,
    /// A request is answered twice.
    AnswerTwice,
    /// A request is answered when it leaves its core.
    EarlyAnswer,
    /// A request is never answered.
    DropAnswer,
    /// Whoever needs an MSHR of the L2 is asked to come again, for ever.
    RefuseAlways,
    /// A write that finds all MSHRs taken makes its line look as if it had arrived.
    RefusedWriteClearsPending,
    /// The time of translations is charged to the L1.
    WrongCause,
}

#[cfg(test)]
impl Fault {
    /// Those that break the protocol.
    pub(crate) const PROTOCOL: [Fault; 7] = [
        Fault::KeepCopy,
        Fault::KeepOwner,
        Fault::ForgetReader,
        Fault::ForgetEviction,
        Fault::LoseWrite,
        Fault::LoseSharedWrite,
        Fault::KeepInL1,
    ];
}

use agenda::Agenda;
pub(crate) use directory::Directory;
use transaction::{Leg, Transaction};
pub use transition::{Actions, Event, Others, Source, State, transition};
pub(crate) use uncore::{Peers, Uncore};
