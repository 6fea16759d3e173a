//! Scenes by name, with settings.

use std::path::Path;

use lrbsim_workloads::scene::{builtin_names, builtin_scene, model_names, validate, validate_light_size};
use lrbsim_workloads::{MeshSource, Scene, SceneError, SceneFile, SceneName};

use super::unknown_name;
use crate::error::BadInput;
use crate::json::{self, Spots};
use crate::settings::{self, Setting};

/// Loads the scene that somebody calls `name`: a shipped one, a scene file (`.json`) or a model (`.obj`).
pub fn scene(name: impl AsRef<Path>) -> Result<Scene, BadInput> {
    scene_with(&scene_name(name)?, &[])
}

/// Tells apart what `name` is. Reads nothing.
pub fn scene_name(name: impl AsRef<Path>) -> Result<SceneName, BadInput> {
    let name = name.as_ref();
    SceneName::parse(name).ok_or_else(|| {
        unknown_name(name, "scene", "FILE.json, FILE.obj", &[builtin_names(), model_names()].concat())
    })
}

/// Text of the scene file of `name`; `None` for a model, which has none.
fn scene_text(name: &SceneName) -> Result<Option<String>, BadInput> {
    match name {
        SceneName::Shipped(known) => Ok(builtin_scene(known).map(str::to_owned)),
        SceneName::File(path) => json::text(path).map(Some),
        SceneName::Model(_) => Ok(None),
    }
}

/// What the scene file of `name` says; `None` for a model, which has none.
pub fn scene_file(name: &SceneName) -> Result<Option<SceneFile>, BadInput> {
    scene_text(name)?.map(|text| json::read(&name.to_string(), &text)).transpose()
}

/// Loads a scene and applies `settings` in order: fields of its scene file, such as `light.radius`.
///
/// A model has no scene file: its camera, picture size and light can be set.
pub fn scene_with(name: &SceneName, settings: &[Setting]) -> Result<Scene, BadInput> {
    let (scene, before) = match scene_text(name)? {
        Some(text) => {
            let file = json::read(&name.to_string(), &text)?;
            (name.scene_of(&file).map_err(|error| bad_scene(name, &text, &error))?, file)
        }
        None => {
            let scene = name.load().map_err(|error| BadInput::new(error.to_string()))?;
            let file = view_of(&scene);
            (scene, file)
        }
    };
    if settings.is_empty() {
        return Ok(scene);
    }
    let file = changed(&before, settings).map_err(|(bad, _)| bad)?;
    let said: Vec<&str> = settings.iter().map(|setting| setting.said.as_str()).collect();
    let unsound =
        |error: SceneError| BadInput::new(error.to_string()).with_help(format!("set by {}", said.join(", ")));
    if file.mesh != before.mesh {
        return name.scene_of(&file).map_err(unsound);
    }
    validate(&file).and_then(|()| validate_light_size(&file.light, &scene.mesh)).map_err(unsound)?;
    let SceneFile { camera, image, light, motion, .. } = file;
    Ok(Scene { camera, image, light, motion, ..scene })
}

/// Checks `settings` of a scene without making its triangles. With an error comes whether all paths were found.
pub(crate) fn check_scene(name: &SceneName, settings: &[Setting]) -> Result<(), (BadInput, bool)> {
    // What is wrong with the scene itself is not the fault of a path.
    let file = match scene_file(name).map_err(|bad| (bad, true))? {
        Some(file) => file,
        None => view_of(&scene_with(name, &[]).map_err(|bad| (bad, true))?),
    };
    let file = changed(&file, settings)?;
    validate(&file).map_err(|error| (BadInput::new(error.to_string()), true))
}

/// Where the triangles of a scene with `settings` come from; `None` where it is a model.
pub(crate) fn mesh_source(name: &SceneName, settings: &[Setting]) -> Result<Option<MeshSource>, BadInput> {
    let Some(file) = scene_file(name)? else { return Ok(None) };
    Ok(Some(changed(&file, settings).map_err(|(bad, _)| bad)?.mesh))
}

/// `file` with all `settings`; with an error comes whether all paths were found.
fn changed(file: &SceneFile, settings: &[Setting]) -> Result<SceneFile, (BadInput, bool)> {
    let mut tree = serde_json::to_value(file).expect("a scene has string keys");
    settings::apply(&mut tree, settings, "a scene").map_err(|bad| (bad, false))?;
    settings::read_back(tree, settings).map_err(|bad| (bad, true))
}

/// An error of the scene `name`, with its place in the text of the scene file where somebody wrote that.
fn bad_scene(name: &SceneName, text: &str, error: &SceneError) -> BadInput {
    let bad = BadInput::new(error.to_string());
    let SceneName::File(path) = name else { return bad };
    let (shown, spots) = (path.display().to_string(), Spots::of(text));
    match error {
        SceneError::Value { at, expected, .. } => match spots.value(at) {
            Some(span) => bad.at(&shown, text, span, format!("must be {expected}")),
            None => bad.at(&shown, text, 0..0, format!("`{at}` must be {expected}")),
        },
        SceneError::Obj(_)
        | SceneError::ModelMissing { .. }
        | SceneError::NoTriangles { .. }
        | SceneError::NoExtent { .. } => match spots.value("mesh") {
            Some(span) => bad.at(&shown, text, span, "this mesh"),
            None => bad,
        },
        SceneError::Json(_) | SceneError::Read { .. } | SceneError::Unknown { .. } => bad,
    }
}

/// The scene file that would give the same view of the mesh.
fn view_of(scene: &Scene) -> SceneFile {
    SceneFile {
        mesh: MeshSource::Path(scene.source.clone()),
        camera: scene.camera,
        image: scene.image,
        light: scene.light,
        motion: scene.motion.clone(),
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
    let file = view_of(scene);
    validate(&file)
        .and_then(|()| validate_light_size(&scene.light, &scene.mesh))
        .map_err(|error| BadInput::new(format!("`{option}`: {error}")))
}
