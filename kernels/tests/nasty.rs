//! Meshes made to break things: every valid one gives finite visibilities.

mod common;

use common::{
    NastyMesh, Run, draw, input, light_for, nasty_meshes, on, options_with_small_map, polygons, sphere,
};
use lrbsim_kernels::method::{METHODS, Method};
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::{Adjacency, EyeView, Scene, ShadowInput};

/// What `method` draws of `input`, with a small map if it has one.
fn small(method: &dyn Method, input: &ShadowInput) -> Vec<f32> {
    draw(method, options_with_small_map(method), input, on()).visibility
}

#[test]
fn every_method_draws_empty_frames() {
    let floor = [(-2.0, -2.0), (-2.0, 2.0), (2.0, 2.0), (2.0, -2.0)].map(|(x, z)| DVec3::new(x, -1.5, z));
    let on_floor = [(DVec3::new(0.3, -1.5, 0.2), 1), (DVec3::new(-0.7, -1.5, 0.9), 0)];
    for method in METHODS {
        let light = light_for(method, sphere(0.1));
        // No receiver; then nothing that could hide the light.
        assert_eq!(small(method, &input(polygons(&[floor.to_vec()]), light, &[])), [0.0; 0]);
        assert_eq!(small(method, &input(polygons(&[floor.to_vec()]), light, &on_floor)), [1.0; 2]);
    }
}

#[test]
fn every_valid_nasty_mesh_gives_visibilities() {
    let (mut seen, mut empty) = (0, Vec::new());
    for NastyMesh { file, scene, .. } in nasty_meshes().into_iter().filter(|mesh| mesh.valid) {
        let scene = match scene {
            Ok(scene) => scene,
            // Valid files without geometry are no scenes.
            Err(error) => {
                empty.push(format!("{file}: {error}"));
                continue;
            }
        };
        let eye = EyeView::render(&scene.mesh, &scene.camera, 64, 48);
        let adjacency = Adjacency::new(&scene.mesh);
        let input = ShadowInput::new(&scene, &adjacency, &eye);
        let mut run = Run::new(&input, on());
        assert_eq!(run.visibility().len(), eye.points.len(), "{file}");
        if input.triangles.len() * input.receivers.len() < 20_000_000 {
            assert_eq!(run.sums(), run.brute_force(on()), "{file}");
        }
        for method in METHODS {
            let light = light_for(method, scene.light);
            println!("{file}: {}", method.entry().name);
            small(method, &ShadowInput::new(&Scene { light, ..scene.clone() }, &adjacency, &eye));
        }
        seen += 1;
    }
    println!("{seen} meshes; no scenes: {empty:#?}");
    assert!(seen >= 40, "only {seen} of the valid meshes are scenes: {empty:#?}");
}
