//! Scenes: a mesh with camera, picture size and light.

mod builtin;
mod error;
mod file;
mod motion;
pub mod search;
mod validate;
mod warning;

#[cfg(test)]
mod tests;

use std::path::Path;

pub use builtin::{builtin_names, builtin_scene, model_names};
pub use error::SceneError;
pub use file::{MeshSource, Procedural, SceneFile};
pub use motion::{Motion, Track};
pub use search::{find_bare_model, find_model};
pub use validate::{validate, validate_light_size};
pub use warning::SceneWarning;

use validate::validate_extent;

use crate::adjacency::prepare;
use crate::camera::{Camera, ImageSize};
use crate::fit::{FitInfo, fit_scene};
use crate::light::Light;
use crate::mesh::Mesh;
use crate::obj::LeftOut;
use crate::{obj, procedural};

/// A scene that can be rendered: valid, mesh prepared ([`prepare`]) and with at least one triangle.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Name of a shipped scene, or the stem of its file.
    pub name: String,
    /// Welded and oriented triangles, world space.
    pub mesh: Mesh,
    /// Where it is seen from.
    pub camera: Camera,
    /// Size of the picture.
    pub image: ImageSize,
    /// What casts the shadows.
    pub light: Light,
    /// Where the mesh came from: a path as given, or `procedural NAME`.
    pub source: String,
    /// What moves, if anything does.
    pub motion: Option<Motion>,
    /// What was fitted, if the scene is a bare OBJ file.
    pub fit: Option<FitInfo>,
    /// Statements of the OBJ file that were not understood.
    pub left_out: Vec<LeftOut>,
}

impl Scene {
    /// Puts a scene together from a file's content and its mesh, which is prepared here.
    ///
    /// # Errors
    /// If a value is unsound, or the mesh has no triangles or no extent.
    pub fn new(name: &str, file: &SceneFile, mut mesh: Mesh) -> Result<Self, SceneError> {
        validate(file)?;
        let source = file.mesh.to_string();
        if mesh.triangles.is_empty() {
            return Err(SceneError::NoTriangles { mesh: source });
        }
        validate_extent(&mesh, &source)?;
        validate_light_size(&file.light, &mesh)?;
        prepare(&mut mesh);
        if let Some(motion) = &file.motion {
            motion.check_objects(&mesh)?;
        }
        let SceneFile { camera, image, light, .. } = *file;
        let motion = file.motion.clone();
        Ok(Self {
            name: name.to_owned(),
            mesh,
            camera,
            image,
            light,
            source,
            motion,
            fit: None,
            left_out: Vec::new(),
        })
    }
}

/// Loads a scene: the name of a shipped one, a `FILE.json`, or a `FILE.obj`, which gets a fitted view.
///
/// Paths of files are relative to `base_dir`; models are looked up as [`search`] says.
///
/// # Errors
/// If a file cannot be read or is not sound; names the place, what was found and what would be right.
pub fn load_scene(arg: impl AsRef<Path>, base_dir: &Path) -> Result<Scene, SceneError> {
    let arg = arg.as_ref();
    let shown = arg.display().to_string();
    if let Some(text) = arg.to_str().and_then(builtin_scene) {
        return parse_scene(text, &shown, base_dir);
    }
    let path = base_dir.join(arg);
    let name = path.file_stem().map_or_else(|| shown.clone(), |s| s.to_string_lossy().into_owned());
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("json") => {
            let text = std::fs::read_to_string(&path)
                .map_err(|source| SceneError::Read { path: path.display().to_string(), source })?;
            parse_scene(&text, &name, path.parent().unwrap_or(base_dir))
        }
        Some("obj") => {
            let obj::ObjFile { mesh, left_out } = obj::read_file(&find_bare_model(arg, base_dir))?;
            if mesh.triangles.is_empty() {
                return Err(SceneError::NoTriangles { mesh: shown });
            }
            validate_extent(&mesh, &shown)?;
            Ok(Scene { name, source: shown, left_out, ..fit_scene(mesh) })
        }
        _ => Err(SceneError::Unknown { found: shown, known: builtin_names().join(", ") }),
    }
}

/// Makes a scene of the text of a scene file that stands in `mesh_dir`; its model is looked up as [`search`] says.
///
/// # Errors
/// As [`load_scene`].
pub fn parse_scene(text: &str, name: &str, mesh_dir: &Path) -> Result<Scene, SceneError> {
    // Some editors put a byte order mark first.
    let file: SceneFile = serde_json::from_str(text.trim_start_matches('\u{feff}'))?;
    validate(&file)?;
    let (mesh, left_out) = match &file.mesh {
        MeshSource::Path(path) => {
            let obj::ObjFile { mesh, left_out } = obj::read_file(&find_model(path, mesh_dir)?)?;
            (mesh, left_out)
        }
        MeshSource::Procedural(procedural) => (procedural::build(procedural)?, Vec::new()),
    };
    Ok(Scene { left_out, ..Scene::new(name, &file, mesh)? })
}
