//! Runs a study on this machine.

use std::path::PathBuf;

use super::cache::{Cache, Claim, Entry};
use super::crew::{self, Store};
use super::file::Study;
use super::memory;
use super::output::StudyOutput;
use super::work::{Fault, Task, Work};
use crate::error::BadInput;
use crate::host::Stopwatch;
use crate::progress::Quiet;

/// How a study is run; changes no result.
#[derive(Debug, Clone)]
pub struct Options {
    /// Host threads at once: so many points, or machines of points that share a functional run.
    pub jobs: usize,
    /// Folder of finished points.
    pub cache: PathBuf,
}

/// How far a study is.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Status {
    /// Points of the study.
    pub points: usize,
    /// Points that were finished before this call, or by somebody else.
    pub found: usize,
    /// Points that were run by this call.
    pub computed: usize,
    /// Points that failed.
    pub failed: usize,
    /// Points that are running; on a cluster, tasks.
    pub running: usize,
    /// Tasks that a cluster has queued or running, which go on without this call.
    pub queued: usize,
    /// Part of the work that is done, in [0, 1].
    pub part_done: f64,
    /// Seconds since the start.
    pub seconds: f64,
    /// Seconds to the end; `None` while no point is finished.
    pub seconds_left: Option<f64>,
}

/// Hears how far a study is. Nothing it does can change a result.
pub trait StudyProgress: Sync {
    /// The state of things, several times a second.
    fn status(&self, status: &Status);

    /// Something that somebody who waits should know, in a sentence or more.
    fn say(&self, text: &str) {
        let _ = text;
    }
}

impl StudyProgress for Quiet {
    fn status(&self, _status: &Status) {}
}

/// Runs a study: what is in the cache is taken from there, what is not is run and stored.
pub fn run_study(
    study: &Study,
    options: &Options,
    progress: &dyn StudyProgress,
) -> Result<StudyOutput, BadInput> {
    let watch = Stopwatch::start();
    let cache = Cache::open(&options.cache)?;
    let work = Work::of(study, 0..study.len())?;
    let (outcomes, status) = crew::run(&work, &cache, (options.jobs, memory::budget()), watch, progress)?;
    Ok(StudyOutput::new(study, &work, outcomes, cache, status))
}

/// Points are shared by all studies over a cache. One that fails is tried again by the next.
impl Store for Cache {
    fn find(&self, key: &str) -> Option<Result<f64, String>> {
        self.peek(key).map(|finished| Ok(finished.seconds))
    }

    fn claim(&self, key: &str, _waited: f64) -> Result<Option<Claim>, BadInput> {
        Cache::claim(self, key)
    }

    fn cache(&self) -> &Cache {
        self
    }

    fn keep(&self, claim: &Claim, _task: &Task, outcome: Result<&mut Entry, &Fault>) -> Result<(), BadInput> {
        outcome.map_or(Ok(()), |entry| claim.finish(entry))
    }
}
