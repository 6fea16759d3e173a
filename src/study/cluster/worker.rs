//! Computes one shard of a plan, wherever it is started and however often.

use std::path::Path;
use std::sync::atomic::Ordering;

use super::super::run::{Status, StudyProgress};
use super::super::work::Work;
use super::super::{crew, memory};
use super::plan::Plan;
use super::store::PlanStore;
use crate::error::BadInput;
use crate::host::Stopwatch;

/// Which part of which plan a worker computes, and how.
#[derive(Debug, Clone)]
pub struct Shard<'a> {
    /// Folder of the plan.
    pub plan: &'a Path,
    /// Number of the shard.
    pub number: usize,
    /// Host threads: so many points at once, or machines of points that share a functional run.
    pub threads: usize,
    /// How the node is called where it is not called by its host's name.
    pub node: Option<String>,
}

/// How far a worker came with its shard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tally {
    /// Shards of the plan.
    pub shards: usize,
    /// Points of the shard, and how they ended.
    pub status: Status,
}

/// Why a worker did not finish its shard.
#[derive(Debug)]
pub enum Stopped {
    /// The plan, or what it is made of, cannot be used: starting again is of no use.
    Refused(BadInput),
    /// The host did not let it go on, as with a full disk: it may be started again.
    Early(BadInput),
}

/// Computes the points of a shard that have no result, and tells `log` of each.
pub fn run_shard(shard: &Shard, log: &dyn StudyProgress) -> Result<Tally, Stopped> {
    let watch = Stopwatch::start();
    let folder = std::path::absolute(shard.plan)
        .map_err(|error| Stopped::Refused(BadInput::unreadable(shard.plan, &error)))?;
    let plan = Plan::load(&folder).map_err(Stopped::Refused)?;
    let shards = plan.shards.len();
    let Some(part) = plan.shards.get(shard.number) else {
        let bad = format!("`--shard` is {}; the plan has shards 0 to {}", shard.number, shards - 1);
        return Err(Stopped::Refused(BadInput::new(bad)));
    };
    let store =
        PlanStore::new(&plan.basis, &folder).map_err(Stopped::Early)?.of_worker(shard.node.clone(), log);
    let study = plan.study().map_err(Stopped::Refused)?;
    let work = Work::of(&study, part.points.iter().copied()).map_err(Stopped::Refused)?;
    for (task, point) in work.tasks.iter().zip(&part.points) {
        let found = task.as_ref().map_or_else(|error| error.as_str(), |task| &task.key);
        if found != plan.basis.keys[*point] {
            let bad = format!("point {point} is not the one that was planned: {found}");
            return Err(Stopped::Refused(BadInput::new(bad).with_help(
                "files that it is made of have changed, or this node does not see them; plan the study again",
            )));
        }
    }
    // What was asked of the cluster for this task.
    let asked = plan.basis.memory.saturating_mul(shard.threads as u64);
    let ended = crew::run(&work, &store, (shard.threads, memory::budget().min(asked)), watch, log);
    match ended {
        Ok((_, status)) => Ok(Tally { shards, status }),
        Err(bad) if store.changed.load(Ordering::Relaxed) => Err(Stopped::Refused(bad)),
        Err(bad) => Err(Stopped::Early(bad)),
    }
}
