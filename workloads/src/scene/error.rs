//! What can be wrong with a scene.

use crate::obj::ObjError;

/// Why a scene could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The name is neither a shipped one nor that of a file of a known kind.
    #[error("`{found}` is not a scene; it must be FILE.json, FILE.obj, or one of: {known}")]
    Unknown {
        /// The name that was asked for.
        found: String,
        /// Names of the shipped scenes.
        known: String,
    },
    /// The scene file could not be read.
    #[error("cannot read `{path}`: {source}")]
    Read {
        /// Path of the scene file.
        path: String,
        /// What the system said of the scene file.
        source: std::io::Error,
    },
    /// Not JSON, an unknown field, or a value of the wrong type. Line and column are in the message.
    #[error("{0}")]
    Json(#[from] serde_json::Error),
    /// A value that cannot be rendered.
    #[error("`{at}` is {found}; it must be {expected}")]
    Value {
        /// JSON path of the value, such as `camera.fov_y_degrees`.
        at: String,
        /// The value that was found.
        found: String,
        /// The values that would be right.
        expected: String,
    },
    /// The mesh could not be read.
    #[error(transparent)]
    Obj(#[from] ObjError),
    /// The model that a scene file names is nowhere.
    #[error(
        "the model `{model}` is not in {searched}; set LRBSIM_SCENES to the folder that has it, or put it beside the \
         scene file"
    )]
    ModelMissing {
        /// The model as the scene file names it.
        model: String,
        /// Folders that were searched.
        searched: String,
    },
    /// The mesh has no triangles: there is nothing to see.
    #[error("`{mesh}` has no triangles; a scene needs at least one")]
    NoTriangles {
        /// The mesh as the scene names it.
        mesh: String,
    },
    /// The mesh has no extent: nothing of it could be seen from anywhere.
    #[error("all vertices of `{mesh}` lie at one point; a scene must measure at least 1e-100")]
    NoExtent {
        /// The mesh as the scene names it.
        mesh: String,
    },
}

impl SceneError {
    /// JSON path of the value at fault, if it is one value.
    #[must_use]
    pub fn json_path(&self) -> Option<&str> {
        match self {
            Self::Value { at, .. } => Some(at),
            _ => None,
        }
    }
}
