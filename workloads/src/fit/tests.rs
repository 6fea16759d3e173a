use std::path::Path;

use super::*;
use crate::procedural;
use crate::scene::{Procedural, load_scene};

fn generated(name: &str) -> Mesh {
    procedural::build(&Procedural { procedural: name.to_owned(), seed: 1, detail: 1 }).expect("there")
}

#[test]
fn a_furnished_room_is_seen_and_lit_from_inside() {
    let scene = fit_scene(generated("saloon"));
    assert!(scene.fit.expect("fitted").interior);
    let bounds = scene.mesh.bounds();
    for p in [scene.camera.eye, scene.light.center()] {
        assert!(p.cmpgt(bounds.min).all() && p.cmplt(bounds.max).all(), "{p}");
    }
    let radius = scene.light.disc_radius();
    assert!((radius / bounds.diagonal() - 0.03).abs() < 1e-9);
}

#[test]
fn a_body_alone_gets_a_floor_and_a_scene_with_a_ground_does_not() {
    let mut cube = Mesh::default();
    let tiny = generated("tiny");
    let range = &tiny.objects[2];
    cube.positions = tiny.positions.clone();
    cube.triangles = tiny.triangles[range.first as usize..range.last as usize].to_vec();
    let scene = fit_scene(cube);
    assert!(scene.fit.expect("fitted").floor_added);
    assert_eq!(scene.mesh.triangles.len(), 14);
    assert!(!fit_scene(generated("table")).fit.expect("fitted").floor_added);
}

#[test]
fn shared_models_get_views_with_the_light_where_it_belongs() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes/models");
    if !folder.exists() {
        println!("SKIPPED: {} is not here", folder.display());
        return;
    }
    for (file, interior, floor_added) in [
        ("tavern.obj", true, false),
        ("cornell_box.obj", true, false),
        ("bunny.obj", false, true),
        ("teapot.obj", false, true),
        ("street_city.obj", false, false),
        ("fern_bed.obj", false, false),
    ] {
        let scene = load_scene(file, &folder).expect(file);
        assert_eq!(scene.fit, Some(FitInfo { interior, floor_added }), "{file}");
    }
}
