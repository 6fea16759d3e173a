//! Machines and scenes from names, files and the command line.

use std::path::{Path, PathBuf};

use lrbsim_machine::{MachineConfig, MachineSpec, builtin_machine, builtin_machine_names};
use lrbsim_workloads::scene::{
    builtin_names, builtin_scene, model_names, parse_scene, validate, validate_light_size,
};
use lrbsim_workloads::{Scene, SceneError, SceneFile, load_scene};
use serde_json::Value;

use crate::error::BadInput;
use crate::json::{self, Spots};

/// A machine that was checked.
#[derive(Debug, Clone)]
pub struct Machine {
    /// The effective configuration, every default filled in.
    pub config: MachineConfig,
    /// The same in the units of timing.
    pub spec: MachineSpec,
}

/// A change to a machine, from `--set PATH=VALUE`.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Path from the machine's root, such as `l2.capacity_bytes`.
    pub path: String,
    /// The new value.
    pub value: Value,
}

impl std::str::FromStr for Setting {
    type Err = BadInput;

    fn from_str(text: &str) -> Result<Setting, BadInput> {
        let Some((path, value)) = text.split_once('=') else {
            return Err(BadInput::new(format!(
                "`--set {text}` has no `=`; it must be PATH=VALUE, such as cores=8"
            )));
        };
        // What is not JSON is a string: names need no quotes.
        let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
        Ok(Setting { path: path.trim().to_owned(), value })
    }
}

impl Machine {
    /// Loads a shipped machine by name or one from a JSON file, and applies `settings` in order.
    pub fn load(name: &str, settings: &[Setting]) -> Result<Machine, BadInput> {
        let (file, text) = match builtin_machine(name) {
            Some(text) => (format!("{name}.json"), text.to_owned()),
            None if looks_like_file(name, "json") => {
                let text = std::fs::read_to_string(name)
                    .map_err(|error| BadInput::unreadable(Path::new(name), &error))?;
                (name.to_owned(), text)
            }
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

    /// Reads the machine in the text of `file` and applies `settings` in order.
    pub fn from_text(file: &str, text: &str, settings: &[Setting]) -> Result<Machine, BadInput> {
        let mut config: MachineConfig = json::read(file, text)?;
        if !settings.is_empty() {
            config = apply(&config, settings)?;
        }
        let spec = config.validate().map_err(|error| {
            let mut bad = BadInput::new(error.to_string());
            if let Some(setting) = settings.iter().rfind(|setting| setting.path == error.path) {
                return bad.with_help(format!("it was set by `--set {}={}`", setting.path, setting.value));
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
    let mut tree = serde_json::to_value(config).expect("a configuration has string keys");
    for setting in settings {
        *leaf(&mut tree, setting)? = setting.value.clone();
    }
    let mut config: MachineConfig = serde_path_to_error::deserialize(tree).map_err(|error| {
        let path = error.path().to_string();
        BadInput::new(format!("`--set {path}`: {}", error.inner()))
    })?;
    for setting in settings {
        config.sources.insert(setting.path.clone(), "assumed: set for this run".to_owned());
    }
    Ok(config)
}

/// The number, flag or name that `setting` changes.
fn leaf<'a>(tree: &'a mut Value, setting: &Setting) -> Result<&'a mut Value, BadInput> {
    let mut place = tree;
    let mut parent = String::new();
    for name in setting.path.split('.') {
        let Value::Object(members) = place else {
            return Err(BadInput::new(format!("`--set {}`: `{parent}` has no fields", setting.path)));
        };
        // Sources say where the file's numbers come from; they are no parameter.
        let known: Vec<String> =
            members.keys().filter(|key| !(parent.is_empty() && *key == "sources")).cloned().collect();
        let Some(member) = members.get_mut(name).filter(|_| known.iter().any(|key| key == name)) else {
            let at = if parent.is_empty() { "a machine".to_owned() } else { format!("`{parent}`") };
            return Err(BadInput::new(format!("`--set {}`: {at} has no field `{name}`", setting.path))
                .with_help(nearest_first(name, &known)));
        };
        place = member;
        parent = if parent.is_empty() { name.to_owned() } else { format!("{parent}.{name}") };
    }
    if let Value::Object(members) = place {
        let fields: Vec<String> = members.keys().map(|key| format!("{}.{key}", setting.path)).collect();
        return Err(BadInput::new(format!("`--set {}` names a group of fields, not one", setting.path))
            .with_help(format!("fields: {}", fields.join(", "))));
    }
    Ok(place)
}

/// The valid names, those most like `name` first.
fn nearest_first(name: &str, known: &[String]) -> String {
    let mut names: Vec<&String> = known.iter().collect();
    names.sort_by_cached_key(|candidate| distance(name, candidate));
    match names.first() {
        Some(nearest) if distance(name, nearest) <= name.len().div_ceil(3).max(1) => {
            let rest: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
            format!("did you mean `{nearest}`? fields: {}", rest.join(", "))
        }
        _ => format!("fields: {}", known.join(", ")),
    }
}

/// Levenshtein's distance in bytes.
fn distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.bytes().enumerate() {
            let substituted = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

fn looks_like_file(name: &str, extension: &str) -> bool {
    let path = Path::new(name);
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
        || name.contains(['/', '\\'])
        || path.is_file()
}

fn unknown_name(name: &str, what: &str, files: &str, known: &[&str]) -> BadInput {
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
pub fn scene(name: &str) -> Result<Scene, BadInput> {
    if builtin_scene(name).is_some() {
        return load_scene(name, Path::new("")).map_err(|error| BadInput::new(error.to_string()));
    }
    if !looks_like_file(name, "json") && !looks_like_file(name, "obj") {
        let known = [builtin_names(), model_names()].concat();
        return Err(unknown_name(name, "scene", "FILE.json, FILE.obj", &known));
    }
    let path = Path::new(name);
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")) {
        return load_scene(name, Path::new("")).map_err(|error| bad_scene(name, None, &error));
    }
    let text = std::fs::read_to_string(path).map_err(|error| BadInput::unreadable(path, &error))?;
    // Checked here first: these errors then have a place in the file.
    let file: SceneFile = json::read(name, &text)?;
    validate(&file).map_err(|error| bad_scene(name, Some(&text), &error))?;
    let stem = path.file_stem().map_or_else(|| name.to_owned(), |stem| stem.to_string_lossy().into_owned());
    parse_scene(&text, &stem, path.parent().unwrap_or(Path::new("")))
        .map_err(|error| bad_scene(name, Some(&text), &error))
}

/// The files that `scene` was read from when it was asked for as `name`.
pub fn scene_files(name: &str, scene: &Scene) -> Vec<PathBuf> {
    if builtin_scene(name).is_some() {
        return Vec::new();
    }
    let path = Path::new(name);
    // Of a model itself, the source is its own name again; what is made by code names no file.
    let mesh = path.parent().unwrap_or(Path::new("")).join(&scene.source);
    vec![path.to_owned(), mesh]
}

/// The file that the machine `name` was read from.
pub fn machine_file(name: &str) -> Option<PathBuf> {
    builtin_machine(name).is_none().then(|| PathBuf::from(name))
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
    let file = SceneFile {
        mesh: lrbsim_workloads::MeshSource::Path(scene.source.clone()),
        camera: scene.camera,
        image: scene.image,
        light: scene.light,
    };
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

    #[test]
    fn distances_count_changes() {
        assert_eq!((distance("cores", "cores"), distance("cors", "cores"), distance("abc", "")), (0, 1, 3));
    }
}
