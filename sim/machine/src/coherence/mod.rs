//! Coherence: MESI at line grain, one transaction a line at a time, served by the line's home directory.
//!
//! ```text
//! requester ──request──► home ──forward──► owner ──line──► requester
//!                          │└──invalidate─► sharers ──ack──► requester
//!                          └──read──► controller ──line──► requester
//! ```
//!
//! [`transition`] says what happens; `Hierarchy` says what it costs.

mod access;
mod directory;
mod sharers;
mod transact;
mod transition;

#[cfg(test)]
mod explore;
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
}

#[cfg(test)]
impl Fault {
    pub(crate) const ALL: [Fault; 7] = [
        Fault::KeepCopy,
        Fault::KeepOwner,
        Fault::ForgetReader,
        Fault::ForgetEviction,
        Fault::LoseWrite,
        Fault::LoseSharedWrite,
        Fault::KeepInL1,
    ];
}

pub(crate) use access::{Access, Hierarchy};
pub(crate) use directory::Directory;
pub use transition::{Actions, Event, Others, Source, State, transition};
