//! What is done of a plan: finished points in the cache that the plan's own build computed, and points that failed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use lrbsim_reports::files::write_with_temporary;
use serde::{Deserialize, Serialize};

use super::super::cache::{Cache, Claim, Entry, open_anew};
use super::super::crew::Store;
use super::super::run::StudyProgress;
use super::super::work::{Fault, FaultOf, Task};
use super::plan::Basis;
use crate::error::BadInput;
use crate::host::{node, partial};
use crate::progress::Quiet;

/// Seconds that a lock is waited for: as long as servers of network file systems keep locks of hosts that have died. Later
/// a worker computes the point too, which harms nobody.
pub(super) const PATIENCE_SECONDS: f64 = 120.0;

/// Where results of a plan are found.
pub(super) struct PlanStore<'a> {
    pub cache: Cache,
    failed: PathBuf,
    /// SHA-256 of the program whose results count.
    build: String,
    /// How a worker's node is called where it is not called by its host's name.
    node: Option<String>,
    /// Who is told of each point that is run: what was computed is seen while that goes on.
    log: &'a dyn StudyProgress,
    /// Whether files are not those that were planned with.
    pub changed: AtomicBool,
}

/// A point that has no result.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Failure {
    key: String,
    node: String,
    error: String,
}

impl<'a> PlanStore<'a> {
    /// The results of the plan in `folder`.
    pub fn new(basis: &Basis, folder: &Path) -> Result<PlanStore<'a>, BadInput> {
        PlanStore::at(&basis.cache, folder, basis.build.clone())
    }

    pub(super) fn at(cache: &Path, folder: &Path, build: String) -> Result<PlanStore<'a>, BadInput> {
        let (cache, failed) = (Cache::open(cache)?, folder.join("failed"));
        Ok(PlanStore { cache, failed, build, node: None, log: &Quiet, changed: AtomicBool::new(false) })
    }

    /// This store for a worker that tells `log` of its points, on a node of this name if it has one.
    pub fn of_worker(self, node: Option<String>, log: &'a dyn StudyProgress) -> PlanStore<'a> {
        PlanStore { node: node.filter(|name| !name.is_empty()), log, ..self }
    }

    fn node(&self) -> String {
        self.node.clone().unwrap_or_else(node)
    }

    /// Folder of the points that failed.
    pub fn failed(&self) -> &Path {
        &self.failed
    }

    /// Has a network file system look anew for the results of these points.
    pub fn freshen(&self, keys: &BTreeSet<&str>) {
        self.cache.freshen(keys);
        open_anew(&self.failed);
    }

    /// Whether the point is there, computed by another build.
    pub fn is_foreign(&self, key: &str) -> bool {
        self.cache.peek(key).is_some_and(|finished| finished.build != self.build)
    }
}

impl Store for PlanStore<'_> {
    fn find(&self, key: &str) -> Option<Result<f64, String>> {
        if let Some(finished) = self.cache.peek(key).filter(|finished| finished.build == self.build) {
            return Some(Ok(finished.seconds));
        }
        let text = std::fs::read_to_string(self.failed.join(format!("{key}.json"))).ok()?;
        let failure: Failure = serde_json::from_str(&text).ok()?;
        (failure.key == key).then_some(Err(failure.error))
    }

    fn claim(&self, key: &str, waited: f64) -> Result<Option<Claim>, BadInput> {
        match waited > PATIENCE_SECONDS {
            true => self.cache.claim_anyway(key).map(Some),
            false => self.cache.claim(key),
        }
    }

    fn cache(&self) -> &Cache {
        &self.cache
    }

    fn keep(&self, claim: &Claim, task: &Task, outcome: Result<&mut Entry, &Fault>) -> Result<(), BadInput> {
        match outcome {
            Ok(entry) => {
                entry.host.node = self.node();
                claim.finish(entry)?;
                self.log.say(&format!("point {} took {:.3} s", task.point, entry.host.seconds));
            }
            Err(fault) if fault.of != FaultOf::Point => {
                if fault.of == FaultOf::Files {
                    self.changed.store(true, Ordering::Relaxed);
                }
                return Err(BadInput::new(format!("point {}: {}", task.point, fault.message)));
            }
            Err(fault) => {
                let failure =
                    Failure { key: task.key.clone(), node: self.node(), error: fault.message.clone() };
                let text = serde_json::to_string(&failure).expect("a failure has string keys");
                let path = self.failed.join(format!("{}.json", task.key));
                write_with_temporary(&path, &partial(&path), text.as_bytes())?;
                self.log.say(&format!("point {} failed: {}", task.point, fault.message));
            }
        }
        Ok(())
    }
}
