//! Scenes as text.

use std::fmt::Write as _;

use crate::light::Light;
use crate::mesh::Mesh;
use crate::scene::{MeshSource, Scene, SceneFile};

/// The mesh as OBJ text: objects, positions, triangles.
///
/// Numbers are the shortest that read back as the same f64, so a prepared mesh reads back the same.
#[must_use]
pub fn mesh_obj(mesh: &Mesh) -> String {
    let mut text = String::from("# written by lrbsim\n");
    for p in &mesh.positions {
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).expect("a String takes everything");
    }
    for object in &mesh.objects {
        writeln!(text, "o {}", object.name).expect("a String takes everything");
        if !object.groups.is_empty() {
            writeln!(text, "g {}", object.groups).expect("a String takes everything");
        }
        for t in &mesh.triangles[object.first as usize..object.last as usize] {
            writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).expect("a String takes everything");
        }
    }
    text
}

/// The scene as a scene file whose mesh is the OBJ file `mesh_path`.
#[must_use]
pub fn scene_json(scene: &Scene, mesh_path: &str) -> String {
    let file = SceneFile {
        mesh: MeshSource::Path(mesh_path.to_owned()),
        camera: scene.camera,
        image: scene.image,
        light: scene.light,
        motion: scene.motion.clone(),
    };
    serde_json::to_string_pretty(&file).expect("numbers of a valid scene are finite")
}

/// The light as in a scene file (`light.json` of a dump).
#[must_use]
pub fn light_json(light: &Light) -> String {
    serde_json::to_string_pretty(light).expect("numbers of a valid light are finite")
}
