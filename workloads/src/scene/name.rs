//! What a scene is called by.

use core::fmt;
use std::path::{Path, PathBuf};

use super::builtin::{builtin_names, builtin_scene, model_names};
use super::search::{find_bare_model, find_model};
use super::validate::validate_mesh;
use super::{Scene, SceneError, SceneFile};
use crate::{fit, obj};

/// The name that somebody gave a scene, told apart once: what is loaded, what it is called and which files it is made
/// of follow from this.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SceneName {
    /// A scene inside the program, by its name.
    Shipped(&'static str),
    /// A scene file, by its path.
    File(PathBuf),
    /// An OBJ file that is a scene by itself: its view is fitted.
    Model(PathBuf),
}

impl fmt::Display for SceneName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shipped(name) => f.write_str(name),
            Self::File(path) | Self::Model(path) => path.display().fmt(f),
        }
    }
}

impl SceneName {
    /// Tells apart a shipped name, `FILE.json` and `FILE.obj`; `None` for anything else. Reads nothing.
    pub fn parse(name: impl AsRef<Path>) -> Option<Self> {
        let name = name.as_ref();
        let has_extension =
            |wanted: &str| name.extension().is_some_and(|found| found.eq_ignore_ascii_case(wanted));
        let shipped = builtin_names().into_iter().chain(model_names()).find(|known| Path::new(known) == name);
        match shipped {
            Some(known) => Some(Self::Shipped(known)),
            None if has_extension("json") => Some(Self::File(name.to_owned())),
            None if has_extension("obj") => Some(Self::Model(name.to_owned())),
            None => None,
        }
    }

    /// The name of this scene for somebody in `folder`: files are relative to it.
    #[must_use]
    pub fn within(self, folder: &Path) -> Self {
        match self {
            Self::Shipped(name) => Self::Shipped(name),
            Self::File(path) => Self::File(folder.join(path)),
            Self::Model(path) => Self::Model(folder.join(path)),
        }
    }

    /// How the scene calls itself in reports and folders: its shipped name, or the stem of its file.
    #[must_use]
    pub fn stem(&self) -> String {
        match self {
            Self::Shipped(name) => (*name).to_owned(),
            Self::File(path) | Self::Model(path) => {
                path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
            }
        }
    }

    /// Where the model that the scene file names may lie, after the folders of [`super::search`].
    fn beside(&self) -> &Path {
        match self {
            Self::Shipped(_) => Path::new(""),
            Self::File(path) | Self::Model(path) => path.parent().unwrap_or(Path::new("")),
        }
    }

    /// Loads the scene.
    ///
    /// # Errors
    /// If a file cannot be read or is not sound; names the place, what was found and what would be right.
    pub fn load(&self) -> Result<Scene, SceneError> {
        match self {
            Self::Shipped(name) => {
                self.scene_of_text(builtin_scene(name).expect("a shipped name has its text"))
            }
            Self::File(path) => {
                let text = std::fs::read_to_string(path)
                    .map_err(|source| SceneError::Read { path: path.display().to_string(), source })?;
                self.scene_of_text(&text)
            }
            Self::Model(path) => {
                let shown = self.to_string();
                let obj::ObjFile { mesh, left_out } = obj::read_file(&find_bare_model(path))?;
                validate_mesh(&mesh, &shown)?;
                Ok(Scene { name: self.stem(), source: shown, left_out, ..fit::fit_scene(mesh) })
            }
        }
    }

    /// Makes the scene whose scene file has this text.
    pub(super) fn scene_of_text(&self, text: &str) -> Result<Scene, SceneError> {
        // Some editors put a byte order mark first.
        self.scene_of(&serde_json::from_str(text.trim_start_matches('\u{feff}'))?)
    }

    /// Makes the scene that `file` describes, which is what the scene file of this name says, or a changed one.
    ///
    /// # Errors
    /// If a value is unsound, or the model cannot be read or is not sound.
    pub fn scene_of(&self, file: &SceneFile) -> Result<Scene, SceneError> {
        Scene::of_file(&self.stem(), file, self.beside())
    }

    /// The files that were read for `scene`, which was loaded by this name: its scene file and its model.
    #[must_use]
    pub fn files(&self, scene: &Scene) -> Vec<PathBuf> {
        match self {
            Self::Model(path) => vec![find_bare_model(path)],
            // What is made by code names no file, and is found nowhere.
            Self::Shipped(_) => find_model(&scene.source, self.beside()).into_iter().collect(),
            Self::File(path) => {
                [path.clone()].into_iter().chain(find_model(&scene.source, self.beside())).collect()
            }
        }
    }
}
