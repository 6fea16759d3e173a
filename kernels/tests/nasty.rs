//! Meshes made to break things: every valid one gives finite visibilities.

mod common;

use std::path::Path;

use common::{On, Run, data, draw, input, one_of_each_kind, polygons, sphere};
use lrbsim_isa::HostSimd;
use lrbsim_kernels::method::{METHODS, Method};
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::{Adjacency, EyeView, Light, Scene, ShadowInput, load_scene};
use serde_json::Value;

/// What `method` draws of `input`, with a small map if it has one.
fn small(method: &dyn Method, input: &ShadowInput) -> Vec<f32> {
    let has_map = method.entry().options.iter().any(|option| option.name == "size");
    draw(method, if has_map { "size=128" } else { "" }, input, On::Host(HostSimd::detect(), 2)).visibility
}

/// `light`, or in its place the first of another kind that `method` draws.
fn light_for(method: &dyn Method, light: Light) -> Light {
    let options = method.entry().options("").expect("options have defaults");
    let all = [light].into_iter().chain(one_of_each_kind(light));
    all.into_iter()
        .find(|light| method.objection_to_light(&options, light).is_none())
        .expect("a method draws some light")
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
    let folder = data("nasty");
    let text = std::fs::read_to_string(folder.join("manifest.json")).expect("the manifest can be read");
    let manifest: Value = serde_json::from_str(&text).expect("the manifest is JSON");
    let (mut seen, mut empty) = (0, Vec::new());
    for entry in manifest.as_array().expect("a list") {
        let file = entry["file"].as_str().expect("a name");
        if entry["valid"] != true {
            continue;
        }
        let path = folder.join(file);
        let scene = match load_scene(&path, Path::new(".")) {
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
        let mut run = Run::new(&input, On::Host(HostSimd::detect(), 2));
        assert_eq!(run.visibility().len(), eye.points.len(), "{file}");
        if input.triangles.len() * input.receivers.len() < 20_000_000 {
            assert_eq!(run.sums(), run.brute_force(On::Host(HostSimd::detect(), 2)), "{file}");
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
