//! Host time from a scene's name to its prepared mesh, and to all that one frame of the paper's size needs from here:
//! each shipped scene, one host thread but for the eye view. Making a mesh must take less than 2 s.
//!
//! `cargo bench -p lrbsim-workloads`

use std::path::Path;
use std::time::Instant;

use lrbsim_workloads::{Adjacency, EyeView, ShadowInput, builtin_names, load_scene};

/// Times each is made; the least counts, as what disturbs a host only adds.
const ROUNDS: u32 = 3;

/// Least seconds of [`ROUNDS`], and what was made.
#[expect(clippy::disallowed_methods, reason = "measures the host")]
fn least<T>(mut make: impl FnMut() -> T) -> (f64, T) {
    let mut round = || {
        let start = Instant::now();
        let made = make();
        (start.elapsed().as_secs_f64(), made)
    };
    let mut best = round();
    for _ in 1..ROUNDS {
        let next = round();
        if next.0 < best.0 {
            best = next;
        }
    }
    best
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "{:14} {:>9} {:>8} {:>10} {:>9} {:>7}",
        "scene", "triangles", "mesh s", "adjacency", "eye view", "input"
    );
    for name in builtin_names() {
        let (mesh, scene) = least(|| load_scene(name, Path::new(".")));
        let scene = scene?;
        let (edges, adjacency) = least(|| Adjacency::new(&scene.mesh));
        let (view, eye) =
            least(|| EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height));
        let (copy, _) = least(|| ShadowInput::new(&scene, &adjacency, &eye));
        println!(
            "{name:14} {:>9} {mesh:>8.3} {edges:>10.3} {view:>9.3} {copy:>7.3}",
            scene.mesh.triangles.len()
        );
    }
    Ok(())
}
