//! Studies: a base run, axes, and many points, each stored under a hash of everything that determines it.
//!
//! ```text
//! study file ─► points ─► recipes ─► keys ─► cache hit?  ─► report
//!                                     └► crew: admitted by memory, one host thread a point ─► cache ─► report
//! ```
//!
//! On more than one machine a plan cuts the points into shards, and each has a crew of its own: [`run_on_slurm`], [`commands`].

mod cache;
mod cluster;
mod crew;
mod file;
mod forecast;
mod ledger;
mod memory;
mod output;
mod points;
mod recipe;
mod run;
mod work;

use std::path::{Path, PathBuf};

pub use cache::Cache;
pub use cluster::{Commands, Shard, SlurmOptions, Stopped, Tally, commands, quoted, run_on_slurm, run_shard};
pub use file::{Study, builtin_study_names};
pub use forecast::Forecast;
pub use output::{StudyOutput, drawings};
pub use points::SplitMix;
pub use recipe::Recipe;
pub use run::{Options, Status, StudyProgress, run_study};
pub(crate) use work::said;

use crate::results::safe_name;

/// Default folder of a study's results.
pub fn default_dir(name: &str) -> PathBuf {
    Path::new("out").join(safe_name(&format!("study-{name}")))
}
