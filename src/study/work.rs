//! What the points of a study are: keys, cost and memory of each, and how one is run.

use std::collections::BTreeMap;
use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::Arc;

use lrbsim_isa::host::HostSimd;
use lrbsim_machine::{Fidelity, KEPT_BYTES, Seats};
use lrbsim_workloads::Scene;

use super::cache::{Entry, Inputs, SceneId};
use super::file::Study;
use super::forecast::Forecast;
use super::memory;
use super::recipe::Recipe;
use crate::error::BadInput;
use crate::frame::{HostOptions, RunOutput, RunRequest, machine_hash, run_frame, run_on_machines};
use crate::inputs::Machine;
use crate::progress::Quiet;
use crate::reference::ReferenceRequest;

/// Scenes that are kept loaded; more are loaded again for each point.
const SCENES_KEPT: usize = 8;

/// Bytes of a machine that is not simulated, its results included.
const COUNTED_MACHINE_BYTES: u64 = 1 << 20;

/// Points of a study, ready to be run. A point is held as little more than its key: there may be many.
pub(super) struct Work<'a> {
    study: &'a Study,
    base: Recipe,
    /// The points in the order they were asked for; one that cannot be has its error.
    pub tasks: Vec<Result<Task, String>>,
    /// For each of them the first that is the same.
    pub first: Vec<usize>,
}

/// A point that can be run.
pub(super) struct Task {
    /// Number of the point in the study.
    pub point: usize,
    /// Hash of everything that determines it.
    pub key: String,
    /// Work in units that are the same for all points of a kind.
    pub work: f64,
    /// Bytes that it takes beside those of its scene.
    machine_memory: u64,
    /// What points have in common that one functional run serves; `None` of a point that runs alone.
    pub together: Option<String>,
    fidelity: Fidelity,
    /// Rays of the reference that its picture is judged by.
    reference: Option<u32>,
    scene: Arc<KnownScene>,
}

/// A scene of a study that was loaded once, by which everything that points ask of it is known.
struct KnownScene {
    id: SceneId,
    /// Work of one frame, in units that are the same for all scenes.
    work: f64,
    /// Bytes that points with it take beside those of their machines.
    memory: u64,
    /// The scene itself; `None` past those that are kept.
    kept: Option<Scene>,
}

/// Why a point has no result.
#[derive(Debug, Clone)]
pub(super) struct Fault {
    /// What is wrong, on one line.
    pub message: String,
    /// What is at fault.
    pub of: FaultOf,
}

/// What is at fault where a point has no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FaultOf {
    /// The point: it will never have one.
    Point,
    /// Files that are not what they were.
    Files,
    /// The host, and only for now.
    Host,
}

impl<'a> Work<'a> {
    /// The points of `study` with these numbers.
    pub fn of(study: &'a Study, points: impl Iterator<Item = usize>) -> Result<Work<'a>, BadInput> {
        let folder = study.path.as_deref().and_then(Path::parent).unwrap_or(Path::new("")).to_owned();
        let base = Recipe::of_base(&study.file.base, &folder)?;
        let mut work = Work { study, base, tasks: Vec::new(), first: Vec::new() };
        let mut scenes = BTreeMap::new();
        let mut keys: BTreeMap<String, usize> = BTreeMap::new();
        for (index, point) in points.enumerate() {
            let task = work.task(point, &mut scenes).map_err(|bad| explained(&bad));
            let first = match &task {
                Ok(task) => *keys.entry(task.key.clone()).or_insert(index),
                Err(_) => index,
            };
            work.first.push(first);
            work.tasks.push(task);
        }
        Ok(work)
    }

    /// What is known of the cost of these points before any is begun.
    pub fn forecast(&self) -> Forecast {
        Forecast::new(self.tasks.iter().map(|task| match task {
            Ok(task) => (task.work, task.kind()),
            Err(_) => (0.0, String::new()),
        }))
    }

    /// What `run` would be told for a point.
    fn recipe(&self, point: usize) -> Result<Recipe, BadInput> {
        let mut recipe = self.base.clone();
        for (axis, value) in self.study.file.axes.iter().zip(&self.study.points[point]) {
            for (path, value) in axis.settings(value) {
                recipe.set(path, value).map_err(|(bad, _)| bad)?;
            }
        }
        Ok(recipe)
    }

    fn task(&self, point: usize, scenes: &mut BTreeMap<String, Arc<KnownScene>>) -> Result<Task, BadInput> {
        let recipe = self.recipe(point)?;
        let machine = recipe.machine()?;
        let fidelity = recipe.fidelity()?;
        let text = recipe.scene_text();
        let scene = match scenes.get(&text) {
            Some(scene) => scene.clone(),
            None => {
                let scene = recipe.scene()?;
                let pixels = f64::from(scene.image.width) * f64::from(scene.image.height);
                let scene = Arc::new(KnownScene {
                    id: SceneId::of(&scene),
                    work: pixels + 4.0 * scene.mesh.triangles.len() as f64,
                    memory: memory::of_scene(&scene),
                    kept: (scenes.len() < SCENES_KEPT).then_some(scene),
                });
                scenes.insert(text, scene.clone());
                scene
            }
        };
        let algorithm = recipe.algorithm()?.to_string();
        let inputs = |machine: &str| {
            Inputs {
                machine_hash: machine,
                scene: &scene.id,
                algorithm: &algorithm,
                fidelity: &fidelity.to_string(),
                warm_frames: recipe.warm_frames(),
                reference: recipe.reference(),
                pictures: self.study.file.base.pictures,
            }
            .key()
        };
        let key = inputs(&machine_hash(&machine));
        let together = fidelity.takes_many().then(|| inputs("any"));
        let machine_memory = memory::of_machine(&machine);
        let level = match fidelity {
            Fidelity::Functional => 0.1,
            Fidelity::Roofline => 0.12,
            Fidelity::Sampled(_) => 0.15,
            Fidelity::Windowed => 1.0,
            Fidelity::Cycle => 8.0,
        };
        // More cores share more lines: measured, 64 of them cost 1.6 times the host time of one.
        let sharing = 1.0 + 0.1 * f64::from(machine.config.cores).log2();
        let work = scene.work * level * sharing * f64::from(1 + recipe.warm_frames());
        Ok(Task {
            point,
            key,
            work,
            machine_memory,
            together,
            fidelity,
            reference: recipe.reference(),
            scene,
        })
    }

    /// Runs the points of `tasks`, which can be run together ([`Task::together`]), with no more threads than `seats` at once; references
    /// are kept in the folder `cache`.
    pub fn run(&self, tasks: &[&Task], seats: &Seats, cache: &Path) -> Vec<Result<Entry, Fault>> {
        // A defect of the simulator that points show is their result; the others go on.
        let ran = std::panic::catch_unwind(AssertUnwindSafe(|| self.outputs(tasks, seats, cache)));
        let outputs = ran.unwrap_or_else(|panic| {
            let message = format!("the simulator failed: {}", said(panic.as_ref()));
            Err(Fault { message, of: FaultOf::Point })
        });
        outputs.unwrap_or_else(|fault| tasks.iter().map(|_| Err(fault.clone())).collect())
    }

    fn outputs(
        &self,
        tasks: &[&Task],
        seats: &Seats,
        cache: &Path,
    ) -> Result<Vec<Result<Entry, Fault>>, Fault> {
        let first = tasks[0];
        let recipe = self.recipe(first.point).map_err(failed)?;
        let machine = |task: &&Task| self.recipe(task.point)?.machine();
        let machines: Vec<Result<Machine, BadInput>> = tasks.iter().map(machine).collect();
        let sound: Vec<Machine> = machines.iter().flatten().cloned().collect();
        let Some(any) = sound.first() else {
            // None can be run: each has its own error.
            return Ok(machines.into_iter().filter_map(Result::err).map(|bad| Err(failed(bad))).collect());
        };
        let request = RunRequest {
            scene: match &first.scene.kept {
                Some(scene) => scene.clone(),
                None => recipe.scene().map_err(failed)?,
            },
            machine: any.clone(),
            algorithm: recipe.algorithm().map_err(failed)?,
            fidelity: first.fidelity,
            warm_frames: recipe.warm_frames(),
            reference: first
                .reference
                .map(|samples| ReferenceRequest { samples, cache: Some(cache.to_owned()) }),
            host: HostOptions { threads: 1, simd: HostSimd::detect() },
        };
        if tasks.len() == 1 {
            let _seat = seats.take();
            let output = run_frame(&request, &Quiet).map_err(failed);
            return Ok(vec![output.and_then(|output| self.entry(first, output))]);
        }
        // Each entry is made as its output comes: an output has a whole frame.
        let places: Vec<usize> = (0..tasks.len()).filter(|place| machines[*place].is_ok()).collect();
        let mut places = places.into_iter();
        let mut entries: Vec<Option<Result<Entry, Fault>>> = tasks.iter().map(|_| None).collect();
        run_on_machines(&request, &sound, seats, |output| {
            let place = places.next().expect("one output a machine");
            let output = output.map_err(failed);
            entries[place] = Some(output.and_then(|output| self.entry(tasks[place], output)));
        })
        .map_err(failed)?;
        let entry = |(entry, machine): (Option<_>, Result<Machine, BadInput>)| match machine {
            Err(bad) => Err(failed(bad)),
            Ok(_) => entry.expect("one output a machine"),
        };
        Ok(entries.into_iter().zip(machines).map(entry).collect())
    }

    /// What is stored of a point.
    fn entry(&self, task: &Task, output: RunOutput) -> Result<Entry, Fault> {
        let entry = Entry::new(output, self.study.file.base.pictures);
        if entry.key != task.key {
            // The key says what was asked for and the entry what was run: files that are read again may be others.
            let message = format!(
                "the files of scene `{}` changed while the study ran; run the study again",
                entry.report.scene.name
            );
            return Err(Fault { message, of: FaultOf::Files });
        }
        Ok(entry)
    }
}

/// Why a point has no result that was refused.
fn failed(bad: BadInput) -> Fault {
    Fault { message: explained(&bad), of: if bad.is_passing() { FaultOf::Host } else { FaultOf::Point } }
}

impl Task {
    /// Whether a machine is simulated, and not only what it is asked counted.
    pub fn is_simulated(&self) -> bool {
        match self.fidelity {
            Fidelity::Functional | Fidelity::Roofline => false,
            Fidelity::Sampled(_) | Fidelity::Windowed | Fidelity::Cycle => true,
        }
    }

    /// Bytes that points take which are run together.
    pub fn memory(together: &[&Task]) -> u64 {
        let scene = together.first().map_or(0, |task| task.scene.memory);
        let tape = if together.len() > 1 { KEPT_BYTES as u64 } else { 0 };
        let machine =
            |task: &&Task| if task.is_simulated() { task.machine_memory } else { COUNTED_MACHINE_BYTES };
        together.iter().map(machine).fold(scene.saturating_add(tape), u64::saturating_add)
    }

    /// Points of one kind have the same cost for the same work.
    pub fn kind(&self) -> String {
        format!("{:?} {} {:?}", self.scene.id, self.fidelity, self.reference)
    }
}

/// The message of an error with its remedy, on one line.
fn explained(bad: &BadInput) -> String {
    match miette::Diagnostic::help(bad) {
        Some(help) => format!("{bad} ({help})"),
        None => bad.to_string(),
    }
}

/// What a panic said.
pub(crate) fn said(panic: &(dyn std::any::Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it does not say why")
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let mut work = Work::of(&study, 0..1).expect("a sound base");
        let mut task = work.tasks.remove(0).expect("a sound point");
        // As of a scene beyond those that are kept loaded.
        Arc::get_mut(&mut task.scene).expect("nobody else has it").kept = None;
        let run = |task: &Task| work.run(&[task], &Seats::new(1), folder.path()).remove(0);
        assert_eq!(run(&task).expect("the model is as it was").key, task.key);
        write("f 1 2 3\nf 1 2 4\n");
        let refusal = run(&task).expect_err("another model");
        assert_eq!(refusal.of, FaultOf::Files);
        assert!(refusal.message.contains("scene `model` changed while the study ran"), "{refusal:?}");
    }

    #[test]
    fn what_a_panic_says_is_kept() {
        assert_eq!(said(&"plain"), "plain");
        assert_eq!(said(&String::from("made")), "made");
        assert_eq!(said(&3), "it does not say why");
    }
}
