//! Meshes made to break things: every valid one gives finite visibilities.

mod common;

use std::path::Path;

use common::{On, Run, data};
use lrbsim_isa::HostSimd;
use lrbsim_workloads::{Adjacency, EyeView, ShadowInput, load_scene};
use serde_json::Value;

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
        let input = ShadowInput::new(&scene, &Adjacency::new(&scene.mesh), &eye);
        let mut run = Run::new(&input, On::Host(HostSimd::detect(), 2));
        assert_eq!(run.visibility().len(), eye.points.len(), "{file}");
        if input.triangles.len() * input.receivers.len() < 20_000_000 {
            assert_eq!(run.sums(), run.brute_force(On::Host(HostSimd::detect(), 2)), "{file}");
        }
        seen += 1;
    }
    println!("{seen} meshes; no scenes: {empty:#?}");
    assert!(seen >= 40, "only {seen} of the valid meshes are scenes: {empty:#?}");
}
