//! Runs the points of a study that are not finished yet, several at once.

use std::collections::{BTreeMap, VecDeque};
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::Duration;

use lrbsim_isa::host::HostSimd;
use lrbsim_machine::Fidelity;
use lrbsim_reports::study::{STUDY_SCHEMA_VERSION, StudyPoint, StudyReport};
use lrbsim_workloads::Scene;

use super::cache::{Cache, Entry, Inputs, SceneId};
use super::file::Study;
use super::forecast::Forecast;
use super::memory;
use super::points::Point;
use super::recipe::Recipe;
use crate::error::BadInput;
use crate::frame::{HostOptions, RunRequest, SEMANTICS, machine_hash, run_frame};
use crate::host::Stopwatch;
use crate::inputs::Machine;
use crate::progress::Quiet;
use crate::reference::ReferenceRequest;

/// Scenes that are kept loaded; more are loaded again for each point.
const SCENES_KEPT: usize = 8;

/// How often progress is told, and how long a point waits for memory or another process before it asks again.
const TICK: Duration = Duration::from_millis(100);

/// How a study is run; changes no result.
#[derive(Debug, Clone)]
pub struct Options {
    /// Points at once, one host thread each.
    pub jobs: usize,
    /// Folder of finished points.
    pub cache: PathBuf,
}

/// How far a study is.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Status {
    /// Points of the study.
    pub points: usize,
    /// Points that were run by this call.
    pub found: usize,
    /// Points run now.
    pub computed: usize,
    /// Points that failed.
    pub failed: usize,
    /// Points that are running.
    pub running: usize,
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
}

impl StudyProgress for Quiet {
    fn status(&self, _status: &Status) {}
}

/// What came out of a study.
#[derive(Debug, Clone)]
pub struct StudyOutput {
    /// The results of all points.
    pub report: StudyReport,
    /// How the study went.
    pub status: Status,
}

/// A scene of a study that was loaded once, by which everything that points ask of it is known.
#[derive(Clone)]
struct KnownScene {
    id: SceneId,
    /// Work of one frame, in units that are the same for all scenes.
    work: f64,
    /// Bytes that a point with it takes.
    memory: u64,
    /// The scene itself; `None` past those that are kept.
    kept: Option<Arc<Scene>>,
}

/// A point that can be run.
struct Job {
    recipe: Recipe,
    machine: Machine,
    scene: KnownScene,
    fidelity: Fidelity,
    key: String,
    memory: u64,
}

/// Runs a study: what is in the cache is taken from there, what is not is run and stored.
pub fn run_study(
    study: &Study,
    options: &Options,
    progress: &dyn StudyProgress,
) -> Result<StudyOutput, BadInput> {
    let watch = Stopwatch::start();
    let cache = Cache::open(&options.cache)?;
    let folder = study.path.as_deref().and_then(|path| path.parent()).unwrap_or("".as_ref()).to_owned();
    let base = Recipe::of_base(&study.file.base, &folder)?;

    // What each point is; one that cannot be is recorded with its error.
    let mut scenes = BTreeMap::new();
    let jobs: Vec<Result<Job, String>> = study
        .points
        .iter()
        .map(|point| job(study, &base, point, &mut scenes).map_err(|bad| explained(&bad)))
        .collect();

    // The same point twice is run once.
    let mut first: BTreeMap<&str, usize> = BTreeMap::new();
    for (index, job) in jobs.iter().enumerate() {
        if let Ok(job) = job {
            first.entry(&job.key).or_insert(index);
        }
    }
    let crew = Crew::new(&jobs, &first, &cache, watch);
    std::thread::scope(|scope| {
        for _ in 0..options.jobs.max(1) {
            scope.spawn(|| crew.work());
        }
        crew.watch(options.jobs, progress);
    });

    let status = crew.state().status(options.jobs, watch.elapsed().as_secs_f64());
    let state = crew.state.into_inner().expect("nobody panics with the state in hand");
    if let Some(bad) = state.fatal {
        return Err(bad);
    }
    let points = study.points.iter().zip(&jobs).map(|(values, job)| {
        let finished = job.as_ref().map(|job| &state.finished[first[job.key.as_str()]]);
        let (error, report) = match finished {
            Err(error) => (Some(error.clone()), None),
            Ok(Some(Ok(entry))) => (None, Some(entry.report.clone())),
            Ok(Some(Err(error))) => (Some(error.clone()), None),
            Ok(None) => (Some("it was not run".to_owned()), None),
        };
        let key = job.as_ref().map(|job| job.key.clone()).unwrap_or_default();
        StudyPoint { values: values.clone(), key, error, report }
    });
    let report = StudyReport {
        schema_version: STUDY_SCHEMA_VERSION,
        lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
        semantics: SEMANTICS,
        study: study.file.clone(),
        points: points.collect(),
    };
    Ok(StudyOutput { report, status })
}

/// The message of an error with its remedy, on one line.
fn explained(bad: &BadInput) -> String {
    match miette::Diagnostic::help(bad) {
        Some(help) => format!("{bad} ({help})"),
        None => bad.to_string(),
    }
}

/// What the point is that has these values.
fn job(
    study: &Study,
    base: &Recipe,
    point: &Point,
    scenes: &mut BTreeMap<String, KnownScene>,
) -> Result<Job, BadInput> {
    let mut recipe = base.clone();
    for (axis, value) in study.file.axes.iter().zip(point) {
        recipe.set(&axis.path, value).map_err(|(bad, _)| bad)?;
    }
    let machine = recipe.machine()?;
    let fidelity = recipe.fidelity()?;
    let text = recipe.scene_text();
    let scene = match scenes.get(&text) {
        Some(scene) => scene.clone(),
        None => {
            let scene = Arc::new(recipe.scene()?);
            let pixels = f64::from(scene.image.width) * f64::from(scene.image.height);
            let scene = KnownScene {
                id: SceneId::of(&scene),
                work: pixels + 4.0 * scene.mesh.triangles.len() as f64,
                memory: memory::estimate(&scene, &machine),
                kept: (scenes.len() < SCENES_KEPT).then_some(scene),
            };
            scenes.insert(text, scene.clone());
            scene
        }
    };
    let key = Inputs {
        machine_hash: &machine_hash(&machine),
        scene: &scene.id,
        algorithm: &recipe.algorithm()?.to_string(),
        fidelity: &fidelity.to_string(),
        warm_frames: recipe.warm_frames(),
        reference: recipe.reference(),
    }
    .key();
    // The caches of another machine may be larger.
    let memory = match &scene.kept {
        Some(scene) => memory::estimate(scene, &machine),
        None => scene.memory,
    };
    Ok(Job { recipe, machine, scene, fidelity, key, memory })
}

impl Job {
    /// Work in units that are the same for all points of a kind.
    fn work(&self) -> f64 {
        let level = match self.fidelity {
            Fidelity::Functional => 0.1,
            Fidelity::Windowed => 1.0,
            Fidelity::Cycle => 8.0,
        };
        // More cores share more lines: measured, 64 of them cost 1.6 times the host time of one.
        let sharing = 1.0 + 0.1 * f64::from(self.machine.config.cores).log2();
        self.scene.work * level * sharing * f64::from(1 + self.recipe.warm_frames())
    }

    /// Points of one kind have the same cost for the same work.
    fn kind(&self) -> String {
        format!("{:?} {} {:?}", self.scene.id, self.fidelity, self.recipe.reference())
    }

    /// Runs the point.
    fn run(&self, cache: &Path) -> Result<Entry, String> {
        let scene = match &self.scene.kept {
            Some(scene) => Scene::clone(scene),
            None => self.recipe.scene().map_err(|bad| explained(&bad))?,
        };
        let request = RunRequest {
            scene,
            machine: self.machine.clone(),
            algorithm: self.recipe.algorithm().map_err(|bad| explained(&bad))?,
            fidelity: self.fidelity,
            warm_frames: self.recipe.warm_frames(),
            reference: self
                .recipe
                .reference()
                .map(|samples| ReferenceRequest { samples, cache: Some(cache.to_owned()) }),
            host: HostOptions { threads: 1, simd: HostSimd::detect() },
        };
        // A defect of the simulator that one point shows is that point's result; the others go on.
        let output = std::panic::catch_unwind(AssertUnwindSafe(|| run_frame(&request, &Quiet)))
            .map_err(|panic| format!("the simulator failed: {}", said(panic.as_ref())))?
            .map_err(|bad| explained(&bad))?;
        let entry = Entry::new(output.report, output.host.seconds);
        if entry.key != self.key {
            // The key says what was asked for and the entry what was run: a scene that is loaded again may be another
            // one.
            return Err(format!(
                "the files of scene `{}` changed while the study ran; run the study again",
                entry.report.scene.name
            ));
        }
        Ok(entry)
    }
}

/// What a panic said.
pub(crate) fn said(panic: &(dyn std::any::Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it does not say why")
}

/// The workers and what they share.
struct Crew<'a> {
    jobs: &'a [Result<Job, String>],
    cache: &'a Cache,
    watch: Stopwatch,
    memory_budget: u64,
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    waiting: VecDeque<usize>,
    running: usize,
    memory: u64,
    finished: Vec<Option<Result<Entry, String>>>,
    forecast: Forecast,
    points: usize,
    found: usize,
    computed: usize,
    failed: usize,
    /// Why the study cannot go on.
    fatal: Option<BadInput>,
}

impl State {
    /// Whether a point of this size may run too. One runs always: there is no better moment for it.
    fn has_room(&self, memory: u64, budget: u64) -> bool {
        self.running == 0 || self.memory.saturating_add(memory) <= budget
    }

    fn over(&self) -> bool {
        self.running == 0 && (self.waiting.is_empty() || self.fatal.is_some())
    }

    fn status(&self, jobs: usize, now: f64) -> Status {
        Status {
            points: self.points,
            found: self.found,
            computed: self.computed,
            failed: self.failed,
            running: self.running,
            part_done: self.forecast.part_done(now),
            seconds: now,
            seconds_left: self.forecast.left(now, jobs),
        }
    }
}

impl<'a> Crew<'a> {
    fn new(
        jobs: &'a [Result<Job, String>],
        first: &BTreeMap<&str, usize>,
        cache: &'a Cache,
        watch: Stopwatch,
    ) -> Crew<'a> {
        let costs = jobs.iter().map(|job| match job {
            Ok(job) => (job.work(), job.kind()),
            Err(_) => (0.0, String::new()),
        });
        let mut state = State {
            waiting: VecDeque::new(),
            running: 0,
            memory: 0,
            finished: jobs.iter().map(|_| None).collect(),
            forecast: Forecast::new(costs),
            points: jobs.len(),
            found: 0,
            computed: 0,
            failed: 0,
            fatal: None,
        };
        for (index, job) in jobs.iter().enumerate() {
            let Ok(job) = job else {
                state.failed += 1;
                state.forecast.gone(index);
                continue;
            };
            if first[job.key.as_str()] != index {
                // It is another point's double.
                state.found += 1;
                state.forecast.gone(index);
            } else if let Some(entry) = cache.get(&job.key) {
                state.found += 1;
                state.forecast.done(index, entry.host_seconds);
                state.finished[index] = Some(Ok(entry));
            } else {
                state.waiting.push_back(index);
            }
        }
        // The dearest first: the end is then not one worker's.
        let work = |index: &usize| jobs[*index].as_ref().map_or(0.0, Job::work);
        state.waiting.make_contiguous().sort_by(|a, b| work(b).total_cmp(&work(a)));
        Crew {
            jobs,
            cache,
            watch,
            memory_budget: memory::budget(),
            state: Mutex::new(state),
            changed: Condvar::new(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("nobody panics with the state in hand")
    }

    fn now(&self) -> f64 {
        self.watch.elapsed().as_secs_f64()
    }

    /// Tells of the progress until all is done.
    fn watch(&self, jobs: usize, progress: &dyn StudyProgress) {
        let mut state = self.state();
        while !state.over() {
            progress.status(&state.status(jobs, self.now()));
            state = self.changed.wait_timeout(state, TICK).expect("nobody panics with the state in hand").0;
        }
    }

    /// Runs points until there are none.
    fn work(&self) {
        while let Some((index, job)) = self.next() {
            let attempt = self.compute(job);
            let mut state = self.state();
            state.running -= 1;
            state.memory -= job.memory;
            match attempt {
                Ok(Attempt::Busy) => state.waiting.push_back(index),
                Ok(Attempt::Found(entry)) => {
                    state.found += 1;
                    state.forecast.done(index, entry.host_seconds);
                    state.finished[index] = Some(Ok(*entry));
                }
                Ok(Attempt::Computed(entry)) => {
                    state.computed += 1;
                    state.forecast.done(index, entry.host_seconds);
                    state.finished[index] = Some(Ok(*entry));
                }
                Ok(Attempt::Failed(error)) => {
                    state.failed += 1;
                    state.forecast.gone(index);
                    state.finished[index] = Some(Err(error));
                }
                Err(bad) => state.fatal = Some(bad),
            }
            self.changed.notify_all();
        }
    }

    /// The next point for which there is room; waits for it.
    fn next(&self) -> Option<(usize, &Job)> {
        let mut state = self.state();
        loop {
            if state.waiting.is_empty() || state.fatal.is_some() {
                return None;
            }
            let job = |index: usize| self.jobs[index].as_ref().expect("only points that can be run wait");
            let fits = |index: &usize| state.has_room(job(*index).memory, self.memory_budget);
            if let Some(place) = state.waiting.iter().position(fits) {
                let index = state.waiting.remove(place).expect("it was found there");
                state.running += 1;
                state.memory += job(index).memory;
                let now = self.now();
                state.forecast.begin(index, now);
                return Some((index, job(index)));
            }
            state = self.changed.wait_timeout(state, TICK).expect("nobody panics with the state in hand").0;
        }
    }

    fn compute(&self, job: &Job) -> Result<Attempt, BadInput> {
        let Some(claim) = self.cache.claim(&job.key)? else {
            std::thread::sleep(TICK);
            return Ok(Attempt::Busy);
        };
        if let Some(entry) = self.cache.get(&job.key) {
            return Ok(Attempt::Found(Box::new(entry)));
        }
        match job.run(self.cache.folder()) {
            Ok(entry) => {
                claim.finish(&entry)?;
                Ok(Attempt::Computed(Box::new(entry)))
            }
            Err(error) => Ok(Attempt::Failed(error)),
        }
    }
}

/// How it went when a worker took a point.
enum Attempt {
    /// Another process computes the point.
    Busy,
    /// Another process has finished the point.
    Found(Box<Entry>),
    /// The worker has computed the point.
    Computed(Box<Entry>),
    /// The point cannot be computed, for this reason.
    Failed(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_run_together_only_as_far_as_they_fit() {
        let mut state = State {
            waiting: VecDeque::new(),
            running: 0,
            memory: 0,
            finished: Vec::new(),
            forecast: Forecast::new(std::iter::empty()),
            points: 0,
            found: 0,
            computed: 0,
            failed: 0,
            fatal: None,
        };
        assert!(state.has_room(1000, 100), "one runs, however large");
        (state.running, state.memory) = (1, 60);
        assert!(state.has_room(40, 100) && !state.has_room(41, 100) && !state.has_room(u64::MAX, 100));
    }

    #[test]
    fn a_model_that_is_edited_while_a_study_runs_is_not_taken_for_what_it_was() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let model = folder.path().join("model.obj");
        let corners = "v -1 0 -1\nv 1 0 -1\nv 0 0 1\nv 0 1 0\n";
        let write = |faces: &str| std::fs::write(&model, format!("{corners}{faces}")).expect("writable");
        write("f 1 2 3\n");
        let text = r#"{"name": "edit", "base": {"scene": "model.obj", "fidelity": "functional",
            "set": {"scene.image.width": 8, "scene.image.height": 8}}, "axes": [{"path": "cores", "values": [1]}]}"#;
        let study = Study::from_text("edit.json", text, Some(folder.path().join("edit.json")), false);
        let study = study.expect("a sound study");
        let base = Recipe::of_base(&study.file.base, folder.path()).expect("a sound base");
        let mut job = job(&study, &base, &study.points[0], &mut BTreeMap::new()).expect("a sound point");
        // As of a scene beyond those that are kept loaded.
        job.scene.kept = None;
        assert_eq!(job.run(folder.path()).expect("the model is as it was").key, job.key);
        write("f 1 2 3\nf 1 2 4\n");
        let refusal = job.run(folder.path()).expect_err("another model");
        assert!(refusal.contains("scene `model` changed while the study ran"), "{refusal}");
    }

    #[test]
    fn what_a_panic_says_is_kept() {
        assert_eq!(said(&"plain"), "plain");
        assert_eq!(said(&String::from("made")), "made");
        assert_eq!(said(&3), "it does not say why");
    }
}
