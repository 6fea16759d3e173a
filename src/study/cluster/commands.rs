//! The shards of a plan as a list of commands, for whatever runs commands.

use std::path::Path;

use super::super::crew::Store as _;
use super::super::file::Study;
use super::super::run::{Options, StudyProgress};
use super::super::work::Work;
use super::plan::{Cut, Plan, Site};
use super::store::PlanStore;
use crate::error::BadInput;

/// What is thought of where nobody says how many CPUs there are. Array jobs of most systems have no more tasks.
const SITE: Site = Site { cpus: 16, shards_max: 1000 };

/// The environment variable that says where models are looked up: what a worker needs besides its plan.
const SCENES: &str = "LRBSIM_SCENES";

/// The workers that a study needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Commands {
    /// A line of shell for each shard that misses a point.
    pub lines: Vec<String>,
    /// Shards of the plan.
    pub shards: usize,
    /// Folder of the plan.
    pub plan: std::path::PathBuf,
}

/// Plans a study and lists the commands that compute what is missing, each on `options.jobs` CPUs.
pub fn commands(
    study: &Study,
    options: &Options,
    shards: Option<usize>,
    progress: &dyn StudyProgress,
) -> Result<Commands, BadInput> {
    let work = Work::of(study, 0..study.len())?;
    let cut = Cut { shards, threads: options.jobs };
    let plan = Plan::open_or_make(study, &work, &options.cache, cut, || Ok(SITE), progress)?;
    let store = PlanStore::new(&plan.basis, &plan.folder)?;
    let is_missing = |point: &usize| store.find(&plan.basis.keys[*point]).is_none();
    let missing = plan.shards.iter().enumerate().filter(|(_, part)| part.points.iter().any(is_missing));
    let worker = worker(&plan.folder, options.jobs)?;
    let assignment = assignment().map_or_else(String::new, |assignment| format!("{assignment} "));
    let lines = missing.map(|(number, _)| format!("{assignment}{worker} --shard {number}")).collect();
    Ok(Commands { lines, shards: plan.shards.len(), plan: plan.folder })
}

/// The command of a worker but for its shard.
pub(super) fn worker(plan: &Path, threads: usize) -> Result<String, BadInput> {
    let program = std::env::current_exe()
        .map_err(|error| BadInput::new(format!("the host does not tell where this program is: {error}")))?;
    let (program, plan) = (quoted(&program.display().to_string()), quoted(&plan.display().to_string()));
    Ok(format!("{program} study-worker --plan {plan} --threads {threads}"))
}

/// The environment that a worker needs, as shells assign it; `None` where it is the usual one.
pub(super) fn assignment() -> Option<String> {
    let scenes = std::env::var(SCENES).ok()?;
    // Relative folders begin where the worker goes first: in the folder where the study was planned.
    Some(format!("{SCENES}={}", quoted(&scenes)))
}

/// `text` as one word of a shell.
pub fn quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/-_.=,:".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_a_shell() {
        assert_eq!(quoted("/a/b-1.json"), "/a/b-1.json");
        assert_eq!(quoted("it's $HOME"), r"'it'\''s $HOME'");
        assert_eq!(quoted(""), "''");
    }
}
