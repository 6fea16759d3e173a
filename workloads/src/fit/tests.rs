use std::path::Path;

use super::*;
use crate::EyeView;
use crate::procedural;
use crate::reference::shadow_rays;
use crate::scene::{Procedural, load_scene};

fn generated(name: &str) -> Mesh {
    procedural::build(&Procedural { procedural: name.to_owned(), seed: 1, detail: 1, pieces: 1 })
        .expect("there")
}

#[test]
fn a_furnished_room_is_seen_and_lit_from_inside() {
    let scene = fit_scene(generated("saloon"));
    assert!(scene.fit.expect("fitted").interior);
    let bounds = scene.mesh.bounds();
    for p in [scene.camera.eye, scene.light.center()] {
        assert!(p.cmpgt(bounds.min).all() && p.cmplt(bounds.max).all(), "{p}");
    }
    let radius = scene.light.radius();
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

/// A model of the repository, by its path from there.
fn model(path: &str) -> Scene {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    load_scene(path, &root).expect(path)
}

const MODELS: [(&str, bool, bool); 5] = [
    ("configs/scenes/models/tavern.obj", true, false),
    ("configs/scenes/models/dinner_table.obj", false, false),
    ("configs/scenes/models/table_blocker.obj", false, false),
    ("tests/data/models/cornell_box.obj", true, false),
    // The inside of its cab is no room.
    ("tests/data/models/truck.obj", false, true),
];

#[test]
fn models_are_seen_from_where_they_are_meant_to_be() {
    for (path, interior, floor_added) in MODELS {
        assert_eq!(model(path).fit, Some(FitInfo { interior, floor_added }), "{path}");
    }
}

#[test]
fn fitted_views_show_shadows_and_their_lights_are_clear_of_everything() {
    for (path, ..) in MODELS {
        let scene = model(path);
        let eye = EyeView::render(&scene.mesh, &scene.camera, 80, 60);
        let visible = shadow_rays(&scene.mesh, &scene.light, &eye, 16);
        let share = |is_so: fn(f64) -> bool| {
            visible.iter().filter(|&&v| is_so(v)).count() as f64 / visible.len() as f64
        };
        let (dark, penumbra) = (share(|v| v < 0.5), share(|v| v > 0.0 && v < 1.0));
        assert!(dark > 0.08 && dark < 0.6 && penumbra > 0.03, "{path}: {dark} dark, {penumbra} penumbra");
        assert_eq!(scene.warnings(&Adjacency::new(&scene.mesh)), [], "{path}");
    }
}

#[test]
fn the_same_view_is_fitted_on_any_number_of_host_threads() {
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| fit_scene(generated("table")))
    };
    assert_eq!(with(1), with(3));
}
