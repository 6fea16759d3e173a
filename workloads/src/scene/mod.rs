//! Scenes: a mesh with camera, picture size and light.

mod builtin;
mod error;
mod file;
mod motion;
mod name;
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
pub use name::SceneName;
pub use search::find_model;
pub use validate::{validate, validate_light_size};
pub use warning::SceneWarning;

use validate::validate_mesh;

use crate::adjacency::prepare;
use crate::camera::{Camera, ImageSize};
use crate::fit::FitInfo;
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
    /// Camera that the scene is seen from.
    pub camera: Camera,
    /// Size of the picture.
    pub image: ImageSize,
    /// Light that casts the shadows.
    pub light: Light,
    /// Where the mesh came from: a path as given, or `procedural NAME`.
    pub source: String,
    /// What moves in the scene, if anything does.
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
        validate_mesh(&mesh, &source)?;
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

    /// Makes the scene that `file` describes; its model is looked up as [`search`] says, `beside` being the file's
    /// folder.
    fn of_file(name: &str, file: &SceneFile, beside: &Path) -> Result<Self, SceneError> {
        // First what costs nothing: a model may be large.
        validate(file)?;
        let (mesh, left_out) = match &file.mesh {
            MeshSource::Path(path) => {
                let obj::ObjFile { mesh, left_out } = obj::read_file(&find_model(path, beside)?)?;
                (mesh, left_out)
            }
            MeshSource::Procedural(procedural) => (procedural::build(procedural)?, Vec::new()),
        };
        Ok(Self { left_out, ..Self::new(name, file, mesh)? })
    }
}

/// Loads the scene that somebody in `folder` calls `name`: a shipped name, `FILE.json`, or `FILE.obj`, which gets a
/// fitted view.
///
/// # Errors
/// If it is no name of a scene, or as [`SceneName::load`].
pub fn load_scene(name: impl AsRef<Path>, folder: &Path) -> Result<Scene, SceneError> {
    let name = name.as_ref();
    let unknown =
        || SceneError::Unknown { found: name.display().to_string(), known: builtin_names().join(", ") };
    SceneName::parse(name).ok_or_else(unknown)?.within(folder).load()
}
