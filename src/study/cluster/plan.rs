//! `plan.json`: which points a study has, who may compute them, and how they are cut into shards.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};
use std::path::{Path, PathBuf};
use std::time::Duration;

use lrbsim_reports::files::write_with_temporary;
use lrbsim_reports::lock::{Lock, is_without_locks};
use lrbsim_reports::picture::sha256;
use lrbsim_reports::study::StudyFile;
use lrbsim_reports::table::counted;
use serde::{Deserialize, Serialize};

use super::super::file::Study;
use super::super::run::StudyProgress;
use super::super::work::{Task, Work};
use super::store::{PATIENCE_SECONDS, PlanStore};
use crate::error::BadInput;
use crate::frame::SEMANTICS;
use crate::host::{Stopwatch, build, partial};
use crate::json;
use crate::results::safe_name;

/// Version of the layout of [`Plan`].
const PLAN_SCHEMA_VERSION: u32 = 1;

/// Name of the file of a plan in its folder.
const PLAN: &str = "plan.json";

/// Digits of a plan's hash in names.
const HASH_DIGITS: usize = 12;

/// Host seconds that a unit of work takes where no point of a study is finished yet: between 4 and 9 millionths, measured
/// at every fidelity on `tiny` and `saloon-small`.
const SECONDS_PER_WORK: f64 = 6e-6;

/// Host seconds that a point takes besides its work: claim, arena, result.
const SECONDS_PER_POINT: f64 = 5e-3;

/// Shards for each worker that can run at once: the end of a study is then shared too.
const SHARDS_PER_WORKER: usize = 4;

/// Forecast seconds of a worker with its shard: shorter ones are mostly start, longer ones are much to lose.
const SHARD_SECONDS: (f64, f64) = (30.0, 1800.0);

/// Seconds after which somebody who waits is told what for.
pub(super) const SILENT_SECONDS: f64 = 3.0;

/// A study that is cut into shards. Its file is written once and never changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Plan {
    schema_version: u32,
    /// SHA-256 of `basis` as compact JSON.
    pub hash: String,
    /// What the plan is of.
    pub basis: Basis,
    /// The shards, each with about the same forecast cost.
    pub shards: Vec<Part>,
    /// The folder of the plan.
    #[serde(skip)]
    pub folder: PathBuf,
}

/// Everything that decides what is computed, by whom and to where. Paths are absolute: workers start anywhere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Basis {
    lrbsim_version: String,
    semantics: u32,
    /// SHA-256 of the program.
    pub build: String,
    study: StudyFile,
    /// The study file, beside which other files are looked up.
    path: Option<PathBuf>,
    /// Where relative paths begin.
    directory: PathBuf,
    /// Folder of finished points.
    pub cache: PathBuf,
    /// Bytes that the largest point takes.
    pub memory: u64,
    /// Hash of everything that determines each point; empty for one that cannot be.
    pub keys: Vec<String>,
}

/// A part of a study that one worker computes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Part {
    /// Forecast seconds on one CPU.
    pub seconds: f64,
    /// Numbers of its points, the dearest first.
    pub points: Vec<usize>,
}

/// What a plan is cut by.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    /// Shards that were asked for.
    pub shards: Option<usize>,
    /// CPUs of each worker.
    pub threads: usize,
}

/// What will run the shards of a plan.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    /// CPUs that may work at once.
    pub cpus: usize,
    /// Shards at most.
    pub shards_max: usize,
}

impl Plan {
    /// Whether no task of it has ever left a trace.
    pub fn is_untouched(&self) -> bool {
        let is_empty = |name: &str| {
            std::fs::read_dir(self.folder.join(name)).is_ok_and(|mut files| files.next().is_none())
        };
        is_empty("log") && is_empty("failed")
    }

    /// Takes the plan away, so that the study is planned anew. Best effort: one that stays harms nobody.
    pub fn discard(&self) {
        let _ = std::fs::remove_file(self.folder.join(PLAN));
    }

    /// The plan of a study whose points are `work`: the one that is there, or a new one, for which `site` is asked.
    pub fn open_or_make(
        study: &Study,
        work: &Work,
        cache: &Path,
        cut: Cut,
        site: impl Fn() -> Result<Site, BadInput>,
        progress: &dyn StudyProgress,
    ) -> Result<Plan, BadInput> {
        let absolute = |path: &Path| {
            let path = std::path::absolute(path).map_err(|error| BadInput::unreadable(path, &error))?;
            match path.to_str() {
                Some(_) => Ok(path),
                None => Err(BadInput::new(format!("`{}` is not UTF-8 text", path.display()))
                    .with_help("a plan names its folders in JSON; work in a folder with another name")),
            }
        };
        let of_task =
            |task: &Result<_, String>, key: fn(&Task) -> String| task.as_ref().map(key).unwrap_or_default();
        let basis = Basis {
            lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
            semantics: SEMANTICS,
            build: build().to_owned(),
            study: study.file.clone(),
            path: study.path.as_deref().map(absolute).transpose()?,
            directory: absolute(Path::new("."))?,
            cache: absolute(cache)?,
            memory: work.tasks.iter().flatten().map(|task| Task::memory(&[task])).max().unwrap_or(0),
            keys: work.tasks.iter().map(|task| of_task(task, |task| task.key.clone())).collect(),
        };
        let hash = basis.hash();
        let name = safe_name(&format!("plan-{}-{}", study.file.name, &hash[..HASH_DIGITS]));
        let folder = absolute(&Path::new("out").join(name))?;
        let file = folder.join(PLAN);
        // Asked before anything is written: a plan that is cut by a wrong answer would stay.
        let asked = if file.exists() { None } else { Some(site()?) };
        for name in ["log", "failed"] {
            std::fs::create_dir_all(folder.join(name)).map_err(|error| cannot_write(&folder, &error))?;
        }
        if let Some(asked) = asked {
            // Two that plan at once: the second takes what the first has written.
            let _lock = locked(&folder, PATIENCE_SECONDS, progress)?;
            if !file.exists() {
                let shards = cut.shards(&asked, work, &PlanStore::new(&basis, &folder)?);
                let plan =
                    Plan { schema_version: PLAN_SCHEMA_VERSION, hash, basis, shards, folder: folder.clone() };
                let text = serde_json::to_string(&plan).expect("a plan has string keys and UTF-8 paths");
                write_with_temporary(&file, &partial(&file), text.as_bytes())?;
            }
        }
        let plan = Plan::load(&folder)?;
        if let Some(asked) = cut.shards {
            let found = plan.shards.len();
            // No more than there are points, and than the site allows: so it was when the plan was cut.
            let points = plan.shards.iter().map(|shard| shard.points.len()).sum::<usize>();
            let wanted = asked.clamp(1, points.max(1));
            if wanted != found && wanted.min(site()?.shards_max) != found {
                return Err(BadInput::new(format!(
                    "`--shards` is {asked}, and the plan in `{}` has {}",
                    folder.display(),
                    counted(found as u64, "shard")
                ))
                .with_help("leave `--shards` out, or remove that folder once none of its tasks is queued"));
            }
        }
        Ok(plan)
    }

    /// Reads the plan in `folder`, which this build may compute.
    pub fn load(folder: &Path) -> Result<Plan, BadInput> {
        let path = folder.join(PLAN);
        let text = json::text(&path)?;
        let shown = path.display().to_string();
        let mut plan: Plan = json::read(&shown, &text)?;
        let unsound = |what: String| BadInput::new(format!("`{shown}`: {what}"));
        if plan.schema_version != PLAN_SCHEMA_VERSION {
            let found = plan.schema_version;
            return Err(unsound(format!("`schema_version` is {found}; it must be {PLAN_SCHEMA_VERSION}")));
        }
        if plan.basis.hash() != plan.hash {
            return Err(unsound("`basis` has another hash than `hash`: a plan is never edited".to_owned())
                .with_help("remove the folder, and plan the study again"));
        }
        if plan.basis.build != build() {
            return Err(unsound(format!(
                "the plan was made by build {} of lrbsim, and this is build {}; results of different builds are never mixed",
                shortened(&plan.basis.build),
                shortened(build())
            ))
            .with_help("start the program that made the plan, or plan the study again with this one"));
        }
        // Points that cannot be run are in no shard, and of those that are the same only the first is.
        let mut keys = BTreeSet::new();
        let points = plan.basis.keys.iter().enumerate();
        let points: Vec<usize> = points
            .filter(|(_, key)| !key.is_empty() && keys.insert(key.as_str()))
            .map(|(point, _)| point)
            .collect();
        let mut owned: Vec<usize> =
            plan.shards.iter().flat_map(|shard| shard.points.iter().copied()).collect();
        owned.sort_unstable();
        if plan.shards.is_empty() || owned != points {
            return Err(unsound(
                "`shards` must have each point that can be run once: a plan is never edited".to_owned(),
            )
            .with_help("remove the folder, and plan the study again"));
        }
        folder.clone_into(&mut plan.folder);
        Ok(plan)
    }

    /// The study of the plan, with all of its points. From here on relative paths begin where they did when it was made.
    pub fn study(&self) -> Result<Study, BadInput> {
        let Basis { study, path, directory, keys, .. } = &self.basis;
        std::env::set_current_dir(directory).map_err(|error| {
            BadInput::new(format!("cannot go to `{}`: {error}", directory.display()))
                .with_help("a node must see the folders of a plan under the same names")
        })?;
        let text = serde_json::to_string(study).expect("a study has string keys");
        let study =
            Study::from_text(&self.folder.join(PLAN).display().to_string(), &text, path.clone(), true)?;
        if study.len() != keys.len() {
            return Err(BadInput::new(format!(
                "the study has {} points here, {} in its plan",
                study.len(),
                keys.len()
            ))
            .with_help("files that it is made of differ; plan the study again"));
        }
        Ok(study)
    }

    /// Name of the plan's tasks where they are queued.
    pub fn name(&self) -> String {
        task_name(&self.hash[..HASH_DIGITS])
    }

    /// Names of the tasks of other plans of the study, as of another build, with their folders.
    pub fn others(&self) -> Vec<(String, PathBuf)> {
        let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
        let own = name(&self.folder).unwrap_or_default();
        let begin = own.strip_suffix(&self.hash[..HASH_DIGITS]).unwrap_or(&own);
        let beside = self.folder.parent().and_then(|folder| folder.read_dir().ok());
        let mut others = Vec::new();
        for path in beside.into_iter().flatten().flatten().map(|entry| entry.path()) {
            let Some(other) = name(&path).filter(|name| *name != own) else { continue };
            if let Some(hash) = other.strip_prefix(begin).filter(|hash| hash.len() == HASH_DIGITS) {
                others.push((task_name(hash), path));
            }
        }
        others.sort();
        others
    }

    /// CPU-seconds of the dearest shard.
    pub fn shard_seconds_max(&self) -> f64 {
        self.shards.iter().map(|shard| shard.seconds).fold(0.0, f64::max)
    }
}

/// Name of the tasks of the plan with this hash.
fn task_name(hash: &str) -> String {
    format!("lrbsim-{hash}")
}

fn cannot_write(folder: &Path, error: &std::io::Error) -> BadInput {
    BadInput::new(format!("cannot write to `{}`: {error}", folder.display()))
        .with_help("a plan lies in `out`, in the current folder, which all nodes must see")
}

/// The right to write the plan in `folder`, or to submit it: waits for whoever has it, `patience` seconds at most. `None`
/// where nothing locks, or a host has died with the lock: two may then plan or submit at once, and workers find the points of
/// each other.
pub(super) fn locked(
    folder: &Path,
    patience: f64,
    progress: &dyn StudyProgress,
) -> Result<Option<Lock>, BadInput> {
    let path = folder.join(".lock");
    let watch = Stopwatch::start();
    let mut told = false;
    loop {
        match Lock::try_now(&path) {
            Ok(Some(lock)) => return Ok(Some(lock)),
            Ok(None) => {}
            Err(error) if is_without_locks(&error) => return Ok(None),
            Err(error) => return Err(cannot_write(folder, &error)),
        }
        let waited = watch.elapsed().as_secs_f64();
        if waited >= patience {
            progress.say(&format!("going on without `{}`, which somebody has held for long", path.display()));
            return Ok(None);
        }
        if waited >= SILENT_SECONDS && !std::mem::replace(&mut told, true) {
            progress.say(&format!("waiting for whoever plans or submits this study: `{}`", path.display()));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

impl Basis {
    fn hash(&self) -> String {
        sha256(serde_json::to_string(self).expect("a plan has string keys and UTF-8 paths").as_bytes())
    }
}

impl Cut {
    /// Cuts `work` into shards of about the same cost: each point, the dearest first, goes to the shard that has least.
    fn shards(&self, site: &Site, work: &Work, store: &PlanStore) -> Vec<Part> {
        // What finished points took tells what others take.
        let mut forecast = work.forecast();
        let mut runnable: Vec<usize> = Vec::new();
        for (index, task) in work.tasks.iter().enumerate() {
            let Ok(task) = task else { continue };
            if work.first[index] != index {
                continue;
            }
            runnable.push(index);
            if let Some(finished) = store.cache.peek(&task.key) {
                forecast.done(index, finished.seconds);
            }
        }
        let cost = |index: usize| {
            let work = work.tasks[index].as_ref().map_or(0.0, |task| task.work);
            SECONDS_PER_POINT + forecast.seconds(index).unwrap_or(work * SECONDS_PER_WORK)
        };
        let mut points: Vec<(f64, usize)> = runnable.into_iter().map(|index| (cost(index), index)).collect();
        points.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let whole: f64 = points.iter().map(|point| point.0).sum();
        let count = self.count(site, whole).clamp(1, points.len().max(1));

        // Nanoseconds: floating point has no order for a heap.
        let mut parts = vec![Part { seconds: 0.0, points: Vec::new() }; count];
        let mut least: BinaryHeap<Reverse<(u64, usize)>> =
            (0..count).map(|part| Reverse((0, part))).collect();
        for (seconds, index) in points {
            let Reverse((load, part)) = least.pop().expect("there is a shard");
            parts[part].seconds += seconds;
            parts[part].points.push(work.tasks[index].as_ref().map_or(0, |task| task.point));
            least.push(Reverse((load + (seconds * 1e9) as u64, part)));
        }
        parts
    }

    /// How many shards to make of `whole` CPU-seconds.
    fn count(&self, site: &Site, whole: f64) -> usize {
        let (low, high) = SHARD_SECONDS;
        let workers = (site.cpus / self.threads).max(1);
        let whole = whole / self.threads as f64;
        let each = (whole / (SHARDS_PER_WORKER * workers) as f64).clamp(low, high);
        self.shards.unwrap_or((whole / each).ceil() as usize).min(site.shards_max)
    }
}

/// The first digits of a hash, for people.
pub(super) fn shortened(hash: &str) -> &str {
    hash.get(..HASH_DIGITS).unwrap_or("without a name")
}

#[cfg(test)]
mod tests {
    use super::*;

    const SITE: Site = Site { cpus: 16, shards_max: 1000 };
    const CUT: Cut = Cut { shards: None, threads: 1 };

    #[test]
    fn shards_are_long_enough_to_start_and_short_enough_to_lose() {
        assert_eq!(CUT.count(&SITE, 10.0), 1, "10 000 points of a millisecond are one shard");
        assert_eq!(CUT.count(&SITE, 640.0), 22, "no shard of less than half a minute");
        assert_eq!(CUT.count(&SITE, 64.0 * 600.0), 64, "four for each CPU");
        assert_eq!(CUT.count(&SITE, 1800.0 * 640.0), 640, "no shard of more than half an hour");
        assert_eq!(CUT.count(&SITE, 1e9), 1000, "as many as a site allows");
        assert_eq!(Cut { shards: Some(7), ..CUT }.count(&SITE, 1e9), 7);
        let wide = Cut { threads: 4, ..CUT };
        assert_eq!(wide.count(&SITE, 64.0 * 600.0), 16, "four for each worker of four CPUs");
        assert_eq!(wide.count(&SITE, 1800.0 * 640.0), 160, "half an hour of four CPUs");
    }

    #[test]
    fn a_lock_that_a_dead_host_has_left_is_not_waited_for_without_end() {
        struct Heard(std::sync::Mutex<String>);
        impl StudyProgress for Heard {
            fn status(&self, _status: &super::super::super::run::Status) {}
            fn say(&self, text: &str) {
                self.0.lock().expect("nobody panics with it").push_str(text);
            }
        }
        let folder = tempfile::tempdir().expect("a temporary folder");
        let heard = Heard(std::sync::Mutex::default());
        let held = locked(folder.path(), 0.2, &heard).expect("writable");
        assert!(held.is_some());
        assert!(locked(folder.path(), 0.2, &heard).expect("writable").is_none());
        let said = heard.0.into_inner().expect("nobody panics with it");
        assert!(said.contains("going on without"), "{said}");
    }

    #[test]
    fn shards_of_points_that_differ_a_hundredfold_cost_the_same() {
        let text = r#"{"name": "x", "base": {"scene": "tiny", "fidelity": "functional"},
            "axes": [{"path": "warm_frames", "values": [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 99]}, {"path": "cores", "values": [1, 2, 3, 4]}]}"#;
        let study = Study::from_text("x.json", text, None, false).expect("sound");
        let work = Work::of(&study, 0..study.len()).expect("sound");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let store = PlanStore::at(folder.path(), folder.path(), String::new()).expect("writable");
        let parts = Cut { shards: Some(4), ..CUT }.shards(&SITE, &work, &store);
        let mut all: Vec<usize> = parts.iter().flat_map(|part| part.points.clone()).collect();
        all.sort_unstable();
        assert_eq!(all, (0..44).collect::<Vec<_>>(), "every point is in one shard");
        let seconds: Vec<f64> = parts.iter().map(|part| part.seconds).collect();
        let (least, most) =
            (seconds.iter().copied().fold(f64::MAX, f64::min), seconds.iter().copied().fold(0.0, f64::max));
        assert!(most < 1.2 * least, "{seconds:?}");
        assert!(parts.iter().all(|part| part.points.len() > 1), "several points each");
    }
}
