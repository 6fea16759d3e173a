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
mod tests;

pub(crate) use access::{Access, Hierarchy};
pub(crate) use directory::Directory;
pub use transition::{Actions, Event, Others, Source, State, transition};
