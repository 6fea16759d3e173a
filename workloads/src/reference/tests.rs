use std::path::Path;

use glam::{DVec2, DVec3};
use serde_json::Value;

use super::*;
use crate::adjacency::{Adjacency, prepare};
use crate::light::Light;
use crate::mesh::Mesh;
use crate::{EyeView, ShadowInput, load_scene};

/// Cases of one group of the oracles.
fn group(name: &str) -> Vec<Value> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/oracles.json");
    let text = std::fs::read_to_string(path).expect("the oracles can be read");
    let all: Value = serde_json::from_str(&text).expect("oracles are JSON");
    let groups = all["groups"].as_array().expect("groups");
    let found = groups.iter().find(|g| g["name"] == name).expect("the group is there");
    found["cases"].as_array().expect("cases").clone()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

fn vec2(value: &Value) -> DVec2 {
    DVec2::from_slice(&numbers(value))
}

fn vec3(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

fn check(case: &Value, what: &str, found: f64, tolerance: f64) {
    if let Some(expected) = case["expected"][what].as_f64() {
        assert!((found - expected).abs() <= tolerance, "{} {what}: {found}, expected {expected}", case["id"]);
    }
}

#[test]
fn segments_agree_with_the_oracles() {
    for case in group("segment") {
        let (u0, u1) = (vec2(&case["inputs"]["u0"]), vec2(&case["inputs"]["u1"]));
        let tolerance = case["tolerance"]["f64"].as_f64().expect("a tolerance");
        let area = area_beyond(u0, u1);
        check(&case, "F", area, tolerance);
        if let Some(d) = case["expected"]["d"].as_f64() {
            check(&case, "V", if d > 0.0 { -area } else { area }, tolerance);
        }
    }
}

#[test]
fn closed_silhouettes_cover_exactly_what_the_oracles_say() {
    for case in group("polygon") {
        let mut umbra = 0.0;
        let mut penumbra = 0.0;
        for lp in case["inputs"]["loops"].as_array().expect("loops") {
            let points: Vec<DVec2> = lp.as_array().expect("points").iter().map(vec2).collect();
            for (k, &a) in points.iter().enumerate() {
                let b = points[(k + 1) % points.len()];
                let left = a.perp_dot(b) >= 0.0;
                penumbra += if left { -area_beyond(a, b) } else { area_beyond(a, b) };
                // Winding about the center: crossings of the ray towards +x.
                if (a.y <= 0.0) != (b.y <= 0.0) && left == (b.y > a.y) {
                    umbra += if b.y > a.y { 1.0 } else { -1.0 };
                }
            }
        }
        if case["tie"] == true {
            continue;
        }
        check(&case, "coverage", umbra + penumbra, case["tolerance"]["f64"].as_f64().expect("a tolerance"));
    }
}

#[test]
fn the_hard_test_agrees_with_the_oracles() {
    for case in group("hard") {
        let v: Vec<DVec3> = case["inputs"]["v"].as_array().expect("corners").iter().map(vec3).collect();
        let hit = hard_test([v[0], v[1], v[2]], [0, 1, 2], vec3(&case["inputs"]["p"]));
        if let Some(inside) = case["expected"]["inside"].as_bool() {
            assert_eq!(hit.map(|h| h.inside), Some(inside), "{}", case["id"]);
        }
        if let Some(t) = case["expected"]["t"].as_f64() {
            check(&case, "t", hit.expect("not edge-on").t, t.abs() * 1e-12);
        }
    }
}

#[test]
fn vertices_land_on_the_light_where_the_oracles_say() {
    for case in group("vertex_to_light_disc") {
        let (p, v) = (vec3(&case["inputs"]["p"]), vec3(&case["inputs"]["v"]));
        let r = case["inputs"]["r"].as_f64().expect("a radius");
        if let Some(expected) = case["expected"]["len_u_facing"].as_f64() {
            let facing = Projection::new(p, r, None).vertex(v).length();
            check(&case, "len_u_facing", facing, 1e-12 * expected.abs().max(1.0));
        }
        if case["expected"]["u_parallel"].is_array() {
            let expected = vec2(&case["expected"]["u_parallel"]).length();
            let parallel = Projection::new(p, r, Some(DVec3::Z)).vertex(v).length();
            assert!((parallel - expected).abs() <= 1e-12 * expected.max(1.0), "{}", case["id"]);
        }
    }
}

/// A mesh of flat polygons, as fans.
fn polygons(value: &Value) -> Mesh {
    let mut mesh = Mesh::default();
    for polygon in value.as_array().expect("polygons") {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(polygon.as_array().expect("corners").iter().map(vec3));
        let n = mesh.positions.len() as u32 - first;
        mesh.triangles.extend((1..n - 1).map(|k| [first, first + k, first + k + 1]));
    }
    prepare(&mut mesh);
    mesh
}

#[test]
fn brute_force_covers_what_the_scene_oracles_say() {
    for case in group("scene3d") {
        let inputs = &case["inputs"];
        let (center, p) = (vec3(&inputs["light"]), vec3(&inputs["p"]));
        let radius = inputs["r"].as_f64().expect("a radius");
        let mesh = polygons(&inputs["polygons"]);
        let adjacency = Adjacency::new(&mesh);
        let tolerance = case["tolerance"]["f64"].as_f64().expect("a tolerance");
        let lights = [
            ("coverage_facing", Light::Sphere { center, radius }),
            ("coverage_parallel", Light::Disc { center, normal: DVec3::Z, radius }),
        ];
        for (what, light) in lights {
            let occluders = Occluders::from_mesh(&mesh, &adjacency, &light);
            check(&case, what, occluders.coverage_at(p - center, u32::MAX), tolerance);
        }
    }
}

#[test]
fn the_metric_agrees_with_the_oracles() {
    for case in group("atty_metric") {
        let metrics =
            ErrorMetrics::new(&numbers(&case["inputs"]["truth"]), &numbers(&case["inputs"]["test"]));
        check(&case, "atty_mae", metrics.atty_mae, 1e-12);
    }
}

#[test]
fn a_metric_reports_tail_and_bias() {
    let metrics = ErrorMetrics::new(&[1.0, 0.5, 0.0], &[1.0, 0.25, 0.5]);
    assert_eq!(metrics.max, 0.5);
    assert_eq!(metrics.off_by_quarter, 1);
    assert!((metrics.bias - 0.25 / 3.0).abs() < 1e-15);
}

#[test]
fn brute_force_and_shadow_rays_agree_on_the_tiny_scene() {
    let scene = load_scene("tiny", Path::new(".")).expect("tiny is shipped");
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height);
    let input = ShadowInput::new(&scene, &adjacency, &eye);
    let truth = shadow_rays(&scene.mesh, &scene.light, &eye, 512);
    let exact = Occluders::from_mesh(&scene.mesh, &adjacency, &scene.light);
    let analytic = exact.visibility_of_view(&adjacency, &scene.light, &eye);
    let metrics = ErrorMetrics::new(&truth, &analytic);
    println!("{metrics:?}");
    assert!(metrics.shadowed > 100 && metrics.atty_mae < 0.03, "{metrics:?}");

    let rounded = Occluders::from_input(&input).visibility(&input);
    let rounding = ErrorMetrics::new(&analytic, &rounded);
    assert!(rounding.mean < 1e-4, "{rounding:?}");
}

#[test]
fn a_point_light_gives_the_same_hard_shadow_both_ways() {
    let mut scene = load_scene("table", Path::new(".")).expect("table is shipped");
    scene.light = Light::Point { center: scene.light.center() };
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, 96, 72);
    let truth = shadow_rays(&scene.mesh, &scene.light, &eye, 64);
    let occluders = Occluders::from_mesh(&scene.mesh, &adjacency, &scene.light);
    let analytic = occluders.visibility_of_view(&adjacency, &scene.light, &eye);
    let different = truth.iter().zip(&analytic).filter(|(a, b)| a != b).count();
    // The far sides of bodies are in their own shadow within the epsilon of the two tests.
    assert!(different * 500 < truth.len(), "{different} of {}", truth.len());
}

/// The ceiling around a lamp that is let into it: f64 has the lamp's plane pass through the receiver, or nearly so.
#[test]
fn a_receiver_in_the_plane_of_a_disc_gets_a_number() {
    let mesh = polygons(&serde_json::json!([[[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]]]));
    let light = Light::Disc { center: DVec3::ZERO, normal: DVec3::Y, radius: 0.5 };
    let occluders = Occluders::from_mesh(&mesh, &Adjacency::new(&mesh), &light);
    for y in [0.0, 1e-300, -1e-17, 1e-9] {
        let visible = occluders.visibility_at(DVec3::new(3.0, y, 0.1), u32::MAX);
        assert!((0.0..=1.0).contains(&visible), "{y}: {visible}");
    }
}

#[test]
fn one_straight_edge_gives_the_closed_form_by_rays_too() {
    // Half a plane right under the light covers the part of the disc beyond its edge.
    let mesh = polygons(&serde_json::json!([[[0.1, -1e3, 2], [1e3, -1e3, 2], [1e3, 1e3, 2], [0.1, 1e3, 2]]]));
    let light = Light::Sphere { center: DVec3::ZERO, radius: 0.5 };
    let bvh = crate::Bvh::new(&mesh);
    let visible = Rays::new(&light, 4096).visibility(&bvh, DVec3::new(0.0, 0.0, 4.0), u32::MAX, 0.3);
    let d: f64 = 0.1 * 2.0 / 0.5;
    let covered = (libm::acos(d) - d * (1.0 - d * d).sqrt()) / core::f64::consts::PI;
    assert!((1.0 - visible - covered).abs() < 0.002, "{visible}");
}
