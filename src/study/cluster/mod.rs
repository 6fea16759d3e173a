//! A study on more than one machine: a plan cuts it into shards, a worker anywhere computes one of them, and files alone
//! say what is done.
//!
//! ```text
//! PLAN/plan.json            immutable: what every point is, by its key, the build that computes them, and the shards
//! PLAN/failed/<key>.json    a point that has no result, and why
//! PLAN/log/                 what workers said
//! CACHE/ab/ab12….json       a finished point, as of any study
//! ```
//!
//! A worker knows of no cluster; what runs workers, Slurm or whatever takes a list of commands, knows of no point.

mod commands;
mod plan;
mod slurm;
mod store;
mod worker;

pub use commands::{Commands, commands, quoted};
pub use slurm::{SlurmOptions, run_on_slurm};
pub use worker::{Shard, Stopped, Tally, run_shard};
