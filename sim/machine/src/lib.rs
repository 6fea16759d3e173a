//! Timing of uop streams on a Larrabee-style many-core chip.
//!
//! ```text
//!        tasks ──► scheduler ──► hardware threads ─┐
//!                                                  ▼
//!                core: issue, scoreboard ──► L1D ──► L2 ──► ring ──► home: directory ──► memory controller
//!                                                            ▲              │
//!                                                            └── other L2s ◄┘
//! ```
//!
//! A core with its caches is one room, which runs alone for a window; everything that cores share is the other.
//! [`Chip::run_step`] takes the tasks of a step and returns what they cost. Function and timing are apart: streams say
//! which lines a task touches and which uops need which results, never what is in them.

mod cache;
pub mod chip;
pub mod coherence;
pub mod config;
mod core;
pub mod counters;
mod division;
mod exchange;
pub mod fidelity;
pub mod fleet;
mod memory;
pub mod observer;
mod occupancy;
mod pages;
mod ring;
mod roofline;
mod sampled;
mod scheduler;
mod tape;
pub mod timing;
mod when;
pub mod work;

#[cfg(test)]
mod laws;
#[cfg(test)]
mod streams;

pub use chip::{Chip, CoreActivity, Stuck};
pub use config::{ConfigError, MachineConfig, MachineSpec, builtin_machine, builtin_machine_names};
pub use counters::{Bounds, Cause, CycleStack, PhaseCounters, StepReport};
pub use fidelity::Fidelity;
pub use observer::Observer;
pub use sampled::Sampling;
pub use tape::{KEPT_BYTES, Seat, Seats};
pub use timing::Timing;

/// A time or a number of core cycles.
pub type Cycle = u64;
