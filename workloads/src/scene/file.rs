//! Scene files as written.

use core::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::motion::Motion;
use crate::camera::{Camera, ImageSize};
use crate::light::Light;

/// A scene as in `configs/scenes/*.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// The triangles of the scene.
    pub mesh: MeshSource,
    /// The camera that the scene is seen from.
    pub camera: Camera,
    /// Size of the picture.
    pub image: ImageSize,
    /// The light that casts the shadows.
    pub light: Light,
    /// What moves in the scene over time, if anything does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<Motion>,
}

/// Where triangles come from: `"PATH.obj"` or `{"procedural": NAME, …}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "a mesh is the path of an OBJ file, or {\"procedural\": NAME, \"seed\": N, \"detail\": N}"
)]
pub enum MeshSource {
    /// An OBJ file: looked up in the folders of the environment variable `LRBSIM_SCENES` (`configs/scenes/models` if
    /// that is not set), then beside the scene file.
    Path(String),
    /// Triangles made by code.
    Procedural(Procedural),
}

/// A mesh made by code.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Procedural {
    /// Name of the generator.
    pub procedural: String,
    /// Seed of its random choices; 1 if left out.
    #[serde(default = "one")]
    pub seed: u32,
    /// Fineness of round parts: their sides are multiplied by this, in 1..=16. 1 if left out.
    #[serde(default = "one")]
    pub detail: u32,
    /// How many pieces each way the plate of `plates` is cut into: 1, 2, 4, 8 or 16; no other generator cuts anything. 1 if left out.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub pieces: u32,
}

fn one() -> u32 {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_one(number: &u32) -> bool {
    *number == 1
}

impl fmt::Display for MeshSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Path(path) => f.write_str(path),
            Self::Procedural(p) => write!(f, "procedural {}", p.procedural),
        }
    }
}
