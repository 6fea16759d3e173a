//! Scenes for the soft-shadow workload: meshes, cameras, lights, the eye view, and references on the host.
//!
//! ```text
//! OBJ text ──► obj ──┐
//! procedural ────────┴► Mesh ─► weld, orient ─► Scene ─┬─► Adjacency ─┐
//! scene JSON ─► camera, light ─────────────────────────┤              ├─► ShadowInput (what kernels see)
//!                                                      └─► EyeView ───┘
//! ```
//!
//! Everything here is untimed host code in f64; nothing depends on a clock, on hash order or on the number of
//! host threads. [`ShadowInput`] is the only type that kernels need.

mod mesh;
pub mod obj;

pub mod adjacency;
mod bvh;
mod camera;
mod light;

mod eye;
mod pixels;
mod shadow_input;

pub mod scene;

mod export;
mod fit;
mod preview;
pub mod procedural;
pub mod reference;

pub use adjacency::{Adjacency, Counting, silhouette_edges};
pub use bvh::{Bvh, Hit};
pub use camera::{Camera, ImageSize};
pub use export::{light_json, mesh_obj, scene_json};
pub use eye::EyeView;
pub use fit::{FitInfo, Fitted, fit_scene, fit_view};
pub use light::{Light, LightShape, Outline};
pub use mesh::{Bounds, Mesh, ObjectRange};
pub use pixels::Pixels;
pub use preview::Preview;
pub use scene::{
    MeshSource, Motion, Scene, SceneError, SceneFile, SceneName, SceneWarning, builtin_names, builtin_scene,
    load_scene,
};
pub use shadow_input::ShadowInput;

pub use glam;
