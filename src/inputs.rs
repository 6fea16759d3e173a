//! Machines and scenes from names, files and the command line.

use std::path::{Path, PathBuf};

use crate::error::BadInput;
use crate::json::{self, Spots};
use crate::settings::{self, Setting, distance};
use lrbsim_machine::{MachineConfig, MachineSpec, builtin_machine, builtin_machine_names};
use lrbsim_workloads::scene::{
    builtin_names, builtin_scene, find_bare_model, find_model, model_names, parse_scene, validate,
    validate_light_size,
};
use lrbsim_workloads::{Scene, SceneError, SceneFile, load_scene};

/// A machine that was checked.
#[derive(Debug, Clone)]
pub struct Machine {
    /// The effective configuration, every default filled in.
    pub config: MachineConfig,
    /// The same in the units of timing.
    pub spec: MachineSpec,
}

impl Machine {
    /// Loads a shipped machine by name or one from a JSON file, and applies `settings` in order.
    pub fn load(name: impl AsRef<Path>, settings: &[Setting]) -> Result<Machine, BadInput> {
        let name = name.as_ref();
        let shown = name.display();
        let (file, text) = match name.to_str().and_then(builtin_machine) {
            Some(text) => (format!("{shown}.json"), text.to_owned()),
            None if looks_like_file(name, "json") => (shown.to_string(), json::text(name)?),
            None => return Err(unknown_name(name, "machine", "FILE.json", builtin_machine_names())),
        };
        Machine::from_text(&file, &text, settings)
    }

    /// This machine with `settings`, in order.
    pub fn with(&self, settings: &[Setting]) -> Result<Machine, BadInput> {
        let config = apply(&self.config, settings)?;
        let spec = config.validate().map_err(|error| BadInput::new(error.to_string()))?;
        Ok(Machine { config, spec })
    }

    /// `machine` with further `settings`, which must name fields and have their types; whether the machine is sound is not
    /// checked.
    pub(crate) fn apply_settings(machine: &Machine, settings: &[Setting]) -> Result<MachineConfig, BadInput> {
        apply(&machine.config, settings)
    }

    /// Reads the machine in the text of `file` and applies `settings` in order.
    pub fn from_text(file: &str, text: &str, settings: &[Setting]) -> Result<Machine, BadInput> {
        let mut config: MachineConfig = json::read(file, text)?;
        if !settings.is_empty() {
            config = apply(&config, settings)?;
        }
        let spec = config.validate().map_err(|error| {
            let mut bad = BadInput::new(error.to_string());
            if let Some(setting) = settings.iter().rfind(|setting| setting.path == error.path) {
                return bad.with_help(format!("it was set by {}", setting.said));
            }
            if let Some(span) = Spots::of(text).value(&error.path) {
                bad = bad.at(file, text, span, format!("must be {}", error.expected));
            }
            bad
        })?;
        Ok(Machine { config, spec })
    }
}

/// `config` with all `settings`; what they set is no longer from the machine's sources.
fn apply(config: &MachineConfig, settings: &[Setting]) -> Result<MachineConfig, BadInput> {
    // Sources say where the file's numbers come from; they are no parameter.
    let mut bare = config.clone();
    let mut sources = std::mem::take(&mut bare.sources);
    let mut tree = serde_json::to_value(bare).expect("a configuration has string keys");
    tree.as_object_mut().expect("a configuration is an object").remove("sources");
    settings::apply(&mut tree, settings, "a machine")?;
    tree["sources"] = serde_json::json!({});
    let mut config: MachineConfig = settings::read_back(tree, settings)?;
    sources.extend(settings.iter().map(|s| (s.path.clone(), "assumed: set for this run".to_owned())));
    config.sources = sources;
    Ok(config)
}

pub(crate) fn looks_like_file(path: &Path, extension: &str) -> bool {
    has_extension(path, extension) || path.components().count() > 1 || path.is_file()
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

pub(crate) fn unknown_name(name: &Path, what: &str, files: &str, known: &[&str]) -> BadInput {
    let name = &*name.to_string_lossy();
    let message = format!("`{name}` is no {what}; it must be {files} or one of: {}", known.join(", "));
    let bad = BadInput::new(message);
    match known.iter().min_by_key(|candidate| distance(name, candidate)) {
        Some(nearest) if distance(name, nearest) <= name.len().div_ceil(3) => {
            bad.with_help(format!("did you mean `{nearest}`?"))
        }
        _ => bad,
    }
}

/// Loads a scene: a shipped one by name, a scene file (`.json`) or a model (`.obj`).
pub fn scene(name: impl AsRef<Path>) -> Result<Scene, BadInput> {
    let path = name.as_ref();
    if shipped_scene(path).is_some() {
        return load_scene(path, Path::new("")).map_err(|error| BadInput::new(error.to_string()));
    }
    if !looks_like_file(path, "json") && !looks_like_file(path, "obj") {
        let known = [builtin_names(), model_names()].concat();
        return Err(unknown_name(path, "scene", "FILE.json, FILE.obj", &known));
    }
    let shown = path.display().to_string();
    if !has_extension(path, "json") {
        return load_scene(path, Path::new("")).map_err(|error| bad_scene(&shown, None, &error));
    }
    let text = json::text(path)?;
    // Checked here first: these errors then have a place in the file.
    let file: SceneFile = json::read(&shown, &text)?;
    validate(&file).map_err(|error| bad_scene(&shown, Some(&text), &error))?;
    let stem = path.file_stem().map_or_else(|| shown.clone(), |stem| stem.to_string_lossy().into_owned());
    parse_scene(&text, &stem, path.parent().unwrap_or(Path::new("")))
        .map_err(|error| bad_scene(&shown, Some(&text), &error))
}

/// Text of the shipped scene of this name.
fn shipped_scene(name: &Path) -> Option<&'static str> {
    name.to_str().and_then(builtin_scene)
}

/// Loads a scene as [`scene`] does and applies `settings` in order: fields of its scene file, such as `light.radius`.
///
/// A model has no scene file: its camera, picture size and light can be set.
pub fn scene_with(name: impl AsRef<Path>, settings: &[Setting]) -> Result<Scene, BadInput> {
    let name = name.as_ref();
    let mut scene = scene(name)?;
    if settings.is_empty() {
        return Ok(scene);
    }
    let before = scene_file(name, &scene)?;
    let mut tree = serde_json::to_value(&before).expect("a scene has string keys");
    settings::apply(&mut tree, settings, "a scene")?;
    let file: SceneFile = settings::read_back(tree, settings)?;
    let said = || settings.iter().map(|setting| setting.said.as_str()).collect::<Vec<_>>().join(", ");
    let unsound =
        |error: SceneError| BadInput::new(error.to_string()).with_help(format!("set by {}", said()));
    if file.mesh != before.mesh {
        let text = serde_json::to_string(&file).expect("a scene has string keys");
        let folder = name.parent().unwrap_or(Path::new(""));
        return parse_scene(&text, &scene.name, folder).map_err(unsound);
    }
    validate(&file).and_then(|()| validate_light_size(&file.light, &scene.mesh)).map_err(unsound)?;
    (scene.camera, scene.image, scene.light, scene.motion) =
        (file.camera, file.image, file.light, file.motion);
    Ok(scene)
}

/// Checks `settings` of the scene `name` without making its triangles. With an error comes whether all paths were found.
pub(crate) fn check_scene_settings(name: &Path, settings: &[Setting]) -> Result<(), (BadInput, bool)> {
    // What is wrong with the scene itself is not the fault of a path.
    let file = match scene_file_text(name).map_err(|bad| (bad, true))? {
        Some(text) => json::read(&name.display().to_string(), &text).map_err(|bad| (bad, true))?,
        None => scene(name).map(|scene| file_of_model(&scene)).map_err(|bad| (bad, true))?,
    };
    let mut tree = serde_json::to_value::<SceneFile>(file).expect("a scene has string keys");
    settings::apply(&mut tree, settings, "a scene").map_err(|bad| (bad, false))?;
    let file: SceneFile = settings::read_back(tree, settings).map_err(|bad| (bad, true))?;
    validate(&file).map_err(|error| (BadInput::new(error.to_string()), true))
}

/// The scene file of a scene; for a model, the one that would give the same view of it.
fn scene_file(name: &Path, scene: &Scene) -> Result<SceneFile, BadInput> {
    match scene_file_text(name)? {
        Some(text) => json::read(&name.display().to_string(), &text),
        None => Ok(file_of_model(scene)),
    }
}

/// Text of the scene file `name`; `None` for a model.
fn scene_file_text(name: &Path) -> Result<Option<String>, BadInput> {
    if let Some(text) = shipped_scene(name) {
        return Ok(Some(text.to_owned()));
    }
    if has_extension(name, "json") { json::text(name).map(Some) } else { Ok(None) }
}

/// The scene file that would give the same view of a model.
fn file_of_model(scene: &Scene) -> SceneFile {
    SceneFile {
        mesh: lrbsim_workloads::MeshSource::Path(scene.source.clone()),
        camera: scene.camera,
        image: scene.image,
        light: scene.light,
        motion: scene.motion.clone(),
    }
}

/// The files that `scene` was read from when it was asked for as `name`.
pub fn scene_files(name: &Path, scene: &Scene) -> Vec<PathBuf> {
    let shipped = shipped_scene(name).is_some();
    if !shipped && !has_extension(name, "json") {
        return vec![find_bare_model(name, Path::new(""))];
    }
    // What is made by code names no file, and is found nowhere.
    let beside = if shipped { Path::new("") } else { name.parent().unwrap_or(Path::new("")) };
    let model = find_model(&scene.source, beside).ok();
    (!shipped).then(|| name.to_owned()).into_iter().chain(model).collect()
}

/// The file that the machine `name` was read from.
pub fn machine_file(name: &Path) -> Option<PathBuf> {
    name.to_str().and_then(builtin_machine).is_none().then(|| name.to_owned())
}

/// An error of a scene, with its place in the scene file where there is one.
fn bad_scene(file: &str, text: Option<&str>, error: &SceneError) -> BadInput {
    let bad = BadInput::new(error.to_string());
    let Some(text) = text else { return bad };
    let spots = Spots::of(text);
    match error {
        SceneError::Value { at, expected, .. } => match spots.value(at) {
            Some(span) => bad.at(file, text, span, format!("must be {expected}")),
            None => bad.at(file, text, 0..0, format!("`{at}` must be {expected}")),
        },
        SceneError::Obj(_)
        | SceneError::ModelMissing { .. }
        | SceneError::NoTriangles { .. }
        | SceneError::NoExtent { .. } => match spots.value("mesh") {
            Some(span) => bad.at(file, text, span, "this mesh"),
            None => bad,
        },
        SceneError::Json(_) | SceneError::Read { .. } | SceneError::Unknown { .. } => bad,
    }
}

/// The scene at `time`, from 0 to 1; `asked` is who asks for it.
pub fn at_time(scene: &Scene, time: f64, asked: &str) -> Result<Scene, BadInput> {
    if scene.motion.is_none() {
        return Err(BadInput::new(format!("{asked}: nothing moves in `{}`", scene.name))
            .with_help("a scene with `motion` is needed, such as saloon-orbit; see `lrbsim schema scene`"));
    }
    if !(0.0..=1.0).contains(&time) {
        return Err(BadInput::new(format!("{asked}: the time is {time}; it must be from 0 to 1")));
    }
    scene.at(time).map_err(|error| BadInput::new(format!("{asked}: at time {time}: {error}")))
}

/// Sets the size of the picture.
pub fn resize(scene: &mut Scene, width: u32, height: u32) -> Result<(), BadInput> {
    scene.image.width = width;
    scene.image.height = height;
    recheck(scene, "--size")
}

/// Sets the radius of the light.
pub fn set_light_radius(scene: &mut Scene, radius: f64) -> Result<(), BadInput> {
    let Some(light) = scene.light.with_radius(radius) else {
        return Err(BadInput::new("`--light-radius`: the light of this scene has no radius")
            .with_help("only spheres, discs and points take one"));
    };
    scene.light = light;
    recheck(scene, "--light-radius")
}

fn recheck(scene: &Scene, option: &str) -> Result<(), BadInput> {
    let file = file_of_model(scene);
    validate(&file)
        .and_then(|()| validate_light_size(&scene.light, &scene.mesh))
        .map_err(|error| BadInput::new(format!("`{option}`: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(texts: &[&str]) -> Vec<Setting> {
        texts.iter().map(|text| text.parse().expect("PATH=VALUE")).collect()
    }

    fn refusal(texts: &[&str]) -> String {
        let error = Machine::load("larrabee-24", &settings(texts)).expect_err("bad settings");
        format!(
            "{error} {}",
            miette::Diagnostic::help(&error).map(|help| help.to_string()).unwrap_or_default()
        )
    }

    #[test]
    fn every_shipped_machine_is_sound() {
        for name in builtin_machine_names() {
            Machine::load(name, &[]).expect(name);
        }
    }

    #[test]
    fn settings_change_the_machine_and_its_sources() {
        let machine =
            Machine::load("larrabee-24", &settings(&["cores=8", "l2.capacity_bytes=524288", "name=mine"]));
        let machine = machine.expect("sound settings");
        assert_eq!((machine.config.cores, machine.spec.cores), (8, 8));
        assert_eq!(machine.config.name, "mine");
        assert_eq!(machine.config.sources["l2.capacity_bytes"], "assumed: set for this run");
    }

    #[test]
    fn an_unknown_path_lists_the_nearest_fields() {
        let message = refusal(&["l2.capacity_byte=1"]);
        assert!(message.contains("`l2` has no field `capacity_byte`"), "{message}");
        assert!(message.contains("did you mean `capacity_bytes`?"), "{message}");
        assert!(refusal(&["coress=1"]).contains("did you mean `cores`?"));
        assert!(refusal(&["cores.x=1"]).contains("`cores` has no fields"));
        assert!(refusal(&["l2=1"]).contains("l2.ways"));
        assert!(refusal(&["sources.cores=1"]).contains("no field `sources`"));
    }

    #[test]
    fn a_value_of_the_wrong_type_is_refused() {
        assert!(refusal(&["cores=many"]).contains("expected u32"));
        assert!(refusal(&["cores=2.5"]).contains("expected u32"));
        assert!(refusal(&["core.dual_issue=1"]).contains("expected a boolean"));
    }

    #[test]
    fn an_unsound_value_names_the_setting() {
        let message = refusal(&["cores=0"]);
        assert!(
            message.contains("`cores` is 0; it must be") && message.contains("`--set cores=0`"),
            "{message}"
        );
    }

    #[test]
    fn a_name_that_is_nearly_one_is_suggested() {
        let error = Machine::load("larabee-24", &[]).expect_err("no such machine");
        assert_eq!(
            miette::Diagnostic::help(&error).expect("a hint").to_string(),
            "did you mean `larrabee-24`?"
        );
    }
}
