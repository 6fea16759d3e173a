//! One point of a study as names and settings: what `run` takes on its command line.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use lrbsim_machine::Fidelity;
use lrbsim_reports::sheet::show_value;
use lrbsim_reports::study::Base;
use lrbsim_workloads::{Scene, SceneName};
use serde_json::Value;

use crate::algorithm::Algorithm;
use crate::error::BadInput;
use crate::frame::check_warm_frames;
use crate::inputs::{self, Machine};
use crate::reference::check_samples;
use crate::settings::{Setting, nearest_first};

/// First names of a path that are not fields of the machine.
const ROOTS: [&str; 7] = ["scene", "machine", "algorithm", "fidelity", "warm_frames", "time", "reference"];

/// What determines one run, before anything is loaded.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    scene: String,
    scene_settings: Vec<Setting>,
    machine: String,
    machine_settings: Vec<Setting>,
    algorithm: String,
    /// Options of the algorithm by name, in place of those in `algorithm`; the last of a name counts.
    algorithm_options: Vec<(String, String)>,
    fidelity: String,
    warm_frames: u32,
    /// Time in a scene that moves.
    time: Option<f64>,
    /// Rays of the reference that pictures are judged by.
    reference: Option<u32>,
    /// Where files are looked up.
    folder: PathBuf,
}

/// Bad input, and what is at fault.
pub type Refusal = (BadInput, Fault);

/// Which part of a setting is at fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// There is no such path.
    Path,
    /// The path does not take this value.
    Value,
}

impl Recipe {
    /// The base of a study whose file stands in `folder`.
    pub fn of_base(base: &Base, folder: &Path) -> Result<Recipe, BadInput> {
        let mut recipe = Recipe {
            scene: base.scene.clone(),
            scene_settings: Vec::new(),
            machine: base.machine.clone(),
            machine_settings: Vec::new(),
            algorithm: base.algorithm.clone(),
            algorithm_options: Vec::new(),
            fidelity: base.fidelity.clone(),
            warm_frames: base.warm_frames,
            time: None,
            reference: base.reference,
            folder: folder.to_owned(),
        };
        for (path, value) in &base.set {
            recipe.set(path, value).map_err(|(bad, _)| bad)?;
        }
        Ok(recipe)
    }

    /// Tries everything that has a name but the scene, which may be large.
    pub fn try_names(&self) -> Result<(), BadInput> {
        self.machine()?;
        self.algorithm()?;
        self.fidelity()?;
        self.reference.map_or(Ok(()), |samples| check_samples(samples.into(), "`reference`").map(|_| ()))?;
        check_warm_frames(self.warm_frames)
    }

    /// Tries the scene, as far as can be without making its triangles.
    pub fn try_scene(&self) -> Result<(), BadInput> {
        inputs::check_scene(&self.scene_name()?, &self.scene_settings).map_err(|(bad, _)| bad)
    }

    /// Sets what `path` names, and checks path and type.
    pub fn set(&mut self, path: &str, value: &Value) -> Result<(), Refusal> {
        let said = format!("`{path}` = {value}");
        let (root, rest) = path.split_once('.').unwrap_or((path, ""));
        let wrong = |bad: BadInput| (bad, Fault::Value);
        let text = || match value.as_str() {
            Some(text) => Ok(text.to_owned()),
            None => Err(wrong(BadInput::new(format!("{said}: `{path}` must be a name in quotes")))),
        };
        match (root, rest) {
            ("scene", "") => self.scene = text()?,
            ("scene", rest) => {
                self.scene_settings.push(Setting { path: rest.to_owned(), value: value.clone(), said });
                let known = inputs::check_scene(&self.scene_name().map_err(wrong)?, &self.scene_settings);
                known.map_err(|(bad, found)| (bad, if found { Fault::Value } else { Fault::Path }))?;
            }
            ("machine", "") => {
                self.machine = text()?;
                self.machine().map_err(wrong)?;
            }
            ("algorithm", "") => {
                self.algorithm = text()?;
                self.algorithm().map_err(wrong)?;
            }
            ("algorithm", option) => {
                let of = self.algorithm().map_err(wrong)?;
                let known: Vec<String> = of.options().map(|(name, _)| name.to_owned()).collect();
                if !known.iter().any(|name| name == option) {
                    let bad = BadInput::new(format!(
                        "`{path}` is no path: the algorithm `{}` has no option `{option}`",
                        of.name()
                    ));
                    return Err((bad.with_help(nearest_first(option, "options", &known)), Fault::Path));
                }
                self.algorithm_options.push((option.to_owned(), show_value(value)));
                self.algorithm().map_err(wrong)?;
            }
            ("fidelity", "") => {
                self.fidelity = text()?;
                self.fidelity().map_err(wrong)?;
            }
            ("warm_frames", "") => {
                let frames = value.as_u64().and_then(|frames| u32::try_from(frames).ok());
                self.warm_frames = frames.ok_or_else(|| {
                    wrong(BadInput::new(format!("{said}: `warm_frames` must be a whole number, 0 or more")))
                })?;
                check_warm_frames(self.warm_frames).map_err(wrong)?;
            }
            ("reference", "") => {
                let samples = value.as_u64().ok_or_else(|| {
                    wrong(BadInput::new(format!("{said}: `reference` must be a whole number of shadow rays")))
                })?;
                self.reference = Some(check_samples(samples, "`reference`").map_err(wrong)?);
            }
            ("time", "") => {
                let time = value.as_f64().filter(|time| (0.0..=1.0).contains(time));
                self.time = Some(time.ok_or_else(|| {
                    wrong(BadInput::new(format!("{said}: `time` must be a number from 0 to 1")))
                })?);
            }
            (root, rest) if ROOTS.contains(&root) => {
                let bad = BadInput::new(format!("`{path}` is no path: `{root}` has no fields"));
                let help = match root {
                    "machine" => format!("fields of the machine are paths by themselves: `{rest}`"),
                    root => format!("`{root}` is a path by itself"),
                };
                return Err((bad.with_help(help), Fault::Path));
            }
            _ => {
                self.machine_settings.push(Setting { path: path.to_owned(), value: value.clone(), said });
                self.check_machine(path)?;
            }
        }
        Ok(())
    }

    /// Whether the last setting of the machine names a field and has its type. Its soundness is the point's affair: a
    /// value may be sound beside one value of another axis and not beside the next.
    fn check_machine(&self, path: &str) -> Result<(), Refusal> {
        let name = self.machine_name();
        let plain = Machine::load(name, &[]).map_err(|bad| (bad, Fault::Value))?;
        let mut tree = serde_json::to_value(&plain.config).expect("a configuration has string keys");
        tree.as_object_mut().expect("an object").remove("sources");
        let pointer = format!("/{}", path.replace('.', "/"));
        let first = path.split('.').next().unwrap_or(path);
        if tree.get(first).is_none() {
            let mut known: Vec<String> = tree.as_object().expect("an object").keys().cloned().collect();
            known.extend(ROOTS.map(str::to_owned));
            let bad = BadInput::new(format!("`{path}` is no path: a machine has no field `{first}`"));
            return Err((bad.with_help(nearest_first(first, "paths", &known)), Fault::Path));
        }
        let is_leaf = tree.pointer(&pointer).is_some_and(|leaf| !leaf.is_object());
        match Machine::apply_settings(&plain, &self.machine_settings) {
            Ok(_) => Ok(()),
            Err(bad) => Err((bad, if is_leaf { Fault::Value } else { Fault::Path })),
        }
    }

    /// The value that stands at `path`.
    pub fn value(&self, path: &str) -> Result<Value, BadInput> {
        let (root, rest) = path.split_once('.').unwrap_or((path, ""));
        let at = |tree: Value, rest: &str| {
            let pointer = format!("/{}", rest.replace('.', "/"));
            tree.pointer(&pointer).cloned().ok_or_else(|| BadInput::new(format!("the base has no `{path}`")))
        };
        match (root, rest) {
            ("scene", "") => Ok(Value::from(self.scene.as_str())),
            ("scene", rest) => {
                let scene = self.scene()?;
                let light = serde_json::to_value(scene.light).expect("string keys");
                let mesh = inputs::mesh_source(&self.scene_name()?, &self.scene_settings)?;
                at(
                    serde_json::json!({"camera": scene.camera, "image": scene.image, "light": light, "mesh": mesh}),
                    rest,
                )
            }
            ("machine", "") => Ok(Value::from(self.machine.as_str())),
            ("algorithm", "") => Ok(Value::from(self.algorithm.as_str())),
            ("algorithm", option) => {
                let value = self.algorithm()?.options().find(|(name, _)| *name == option);
                let (_, text) = value.ok_or_else(|| BadInput::new(format!("the base has no `{path}`")))?;
                // What is not JSON is a string, as in `--set`.
                Ok(serde_json::from_str(&text).unwrap_or(Value::String(text)))
            }
            ("fidelity", "") => Ok(Value::from(self.fidelity.as_str())),
            ("warm_frames", "") => Ok(Value::from(self.warm_frames)),
            ("reference", "") => Ok(Value::from(self.reference)),
            ("time", "") => Ok(Value::from(self.time.unwrap_or(0.0))),
            _ => at(serde_json::to_value(self.machine()?.config).expect("string keys"), path),
        }
    }

    /// The machine.
    pub fn machine(&self) -> Result<Machine, BadInput> {
        Machine::load(self.machine_name(), &self.machine_settings)
    }

    /// The scene.
    pub fn scene(&self) -> Result<Scene, BadInput> {
        let scene = inputs::scene_with(&self.scene_name()?, &self.scene_settings)?;
        match self.time {
            None => Ok(scene),
            Some(time) => inputs::at_time(&scene, time, &format!("`time` = {time}")),
        }
    }

    /// Names the scene with its settings: recipes of one name share a scene.
    pub fn scene_text(&self) -> String {
        let settings: Vec<&str> = self.scene_settings.iter().map(|setting| setting.said.as_str()).collect();
        format!("{:?} {} {:?}", self.scene, settings.join(" "), self.time)
    }

    /// The algorithm.
    pub fn algorithm(&self) -> Result<Algorithm, BadInput> {
        let base = Algorithm::from_str(&self.algorithm)?;
        base.with_options(self.algorithm_options.iter().map(|(name, value)| format!("{name}={value}")))
    }

    /// The fidelity.
    pub fn fidelity(&self) -> Result<Fidelity, BadInput> {
        Ok(Fidelity::from_str(&self.fidelity)?)
    }

    /// Frames before the measured one.
    pub fn warm_frames(&self) -> u32 {
        self.warm_frames
    }

    /// Rays of the reference that pictures are judged by; `None`: they are not.
    pub fn reference(&self) -> Option<u32> {
        self.reference
    }

    fn machine_name(&self) -> PathBuf {
        self.beside(&self.machine)
    }

    fn scene_name(&self) -> Result<SceneName, BadInput> {
        match inputs::scene_name(&self.scene)? {
            SceneName::Shipped(name) => Ok(SceneName::Shipped(name)),
            SceneName::File(_) | SceneName::Model(_) => inputs::scene_name(self.beside(&self.scene)),
        }
    }

    /// A file beside the study file, if there is one of this name; the name itself otherwise.
    fn beside(&self, name: &str) -> PathBuf {
        let path = self.folder.join(name);
        if path.is_file() { path } else { PathBuf::from(name) }
    }
}
