use std::path::Path;

use glam::{DVec2, DVec3};
use serde_json::Value;

use super::*;
use crate::adjacency::{Adjacency, prepare};
use crate::light::{Light, LightShape};
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
            let facing = Projection::new(p, r, LightShape::Facing).vertex(v).length();
            check(&case, "len_u_facing", facing, 1e-12 * expected.abs().max(1.0));
        }
        if case["expected"]["u_parallel"].is_array() {
            let expected = vec2(&case["expected"]["u_parallel"]).length();
            let parallel = Projection::new(p, r, LightShape::Disc { normal: DVec3::Z }).vertex(v).length();
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
fn footprints_have_the_radii_that_the_oracles_say() {
    for case in group("footprint_radius") {
        let [r, z_q, z_p] = ["r", "z_q", "z_p"].map(|what| case["inputs"][what].as_f64().expect("a number"));
        let expected = case["expected"]["R"].as_f64().expect("a number");
        let relative = case["tolerance"]["rel_f64"].as_f64().expect("a tolerance");
        check(&case, "R", printed::footprint_radius(r, z_q, z_p), relative * expected.abs());
    }
}

/// One view along z, as the oracles have it, also for receivers that lie in another face of a cube.
#[test]
fn the_printed_form_covers_what_the_scene_oracles_say() {
    for case in group("scene3d") {
        let inputs = &case["inputs"];
        let (center, p) = (vec3(&inputs["light"]), vec3(&inputs["p"]));
        let mesh = polygons(&inputs["polygons"]);
        let light = Light::Sphere { center, radius: inputs["r"].as_f64().expect("a radius") };
        let occluders = Occluders::from_mesh(&mesh, &Adjacency::new(&mesh), &light);
        let plane = ImagePlane::along(DVec3::Z);
        // Eq. 4 as it is printed: a negative sum is nothing.
        let (front, back) = AsPrinted(&occluders).sums(p - center, u32::MAX, plane);
        let covered = front.max(back).clamp(0.0, 1.0);
        let tolerance = case["tolerance"]["f64"].as_f64().expect("a tolerance");
        check(&case, "sism_per_edge_R", covered, tolerance);
    }
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
    // The first receiver is lit in both, the second is darkened, the last two are in shadow.
    let metrics = ErrorMetrics::new(&[1.0, 1.0, 0.5, 0.0], &[1.0, 0.75, 0.25, 0.5]);
    assert_eq!((metrics.shadowed, metrics.in_question), (2, 3));
    assert_eq!((metrics.max, metrics.p99, metrics.off_by_quarter), (0.5, 0.5, 1));
    assert_eq!((metrics.atty_mae, metrics.bias, metrics.mean), (0.5, 0.0, 0.25));
    // Half a light is let into umbra, a quarter is missing in the penumbra, another in the light, over two that are shadowed.
    assert_eq!(metrics.places, [0.25, 0.125, 0.125]);
    assert!((metrics.rmse - (0.375_f64 / 3.0).sqrt()).abs() < 1e-15);
    let none = ErrorMetrics::new(&[1.0, 1.0], &[1.0, 1.0]);
    assert_eq!(none, ErrorMetrics::default());
    // Atty's measure is 0 without shadows; the others are not.
    let darkened = ErrorMetrics::new(&[1.0, 1.0], &[1.0, 0.5]);
    assert_eq!((darkened.atty_mae, darkened.rmse, darkened.max), (0.0, 0.5, 0.5));
}

/// Receivers at these points, on no triangle.
pub(super) fn receivers(points: Vec<DVec3>) -> EyeView {
    let count = points.len() as u32;
    EyeView {
        width: count,
        height: 1,
        normals: vec![glam::Vec3::Z; points.len()],
        triangles: vec![u32::MAX; points.len()],
        pixels: (0..count).collect(),
        points,
    }
}

/// Half a plane at height 2, which covers x > 0.
fn half_plane() -> Mesh {
    polygons(&serde_json::json!([[[0, -1e3, 2], [1e3, -1e3, 2], [1e3, 1e3, 2], [0, 1e3, 2]]]))
}

fn r_m_s(values: impl Iterator<Item = f64>) -> f64 {
    let squares: Vec<f64> = values.map(|x| x * x).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

const DISC: Light = Light::Disc { center: DVec3::ZERO, normal: DVec3::Z, radius: 0.5 };

#[test]
fn with_nothing_between_or_everything_covered_the_truth_is_exact() {
    let mesh =
        polygons(&serde_json::json!([[[-1e3, -1e3, 2], [1e3, -1e3, 2], [1e3, 1e3, 2], [-1e3, 1e3, 2]]]));
    let light = Light::Sphere { center: DVec3::ZERO, radius: 0.5 };
    let at = |z: f64| receivers((0..40).map(|i| DVec3::new(f64::from(i) * 0.1, 0.3, z)).collect());
    for (z, visible) in [(1.9, 1.0), (4.0, 0.0)] {
        let truth = Truth::new(&mesh, &light, &at(z), 33, &|| ());
        assert!(truth.visibility().iter().all(|v| *v == visible), "{z}");
        assert!(truth.doubt().iter().all(|doubt| *doubt == 0.0), "{z}");
    }
}

/// Errors in the penumbra of one edge, across which receivers lie evenly, and what the truth says of its own error.
fn errors_of_one_edge(samples: u32) -> (f64, f64) {
    let n = 1500;
    // A receiver twice as far as the edge sees it on the light as far to the other side as it is away from it.
    let offsets: Vec<f64> = (0..n).map(|i| -1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(n)).collect();
    let eye = receivers(offsets.iter().map(|d| DVec3::new(-d * 0.5, 0.0, 4.0)).collect());
    let truth = Truth::new(&half_plane(), &DISC, &eye, samples, &|| ());
    let closed = |d: f64| 1.0 - (libm::acos(d) - d * (1.0 - d * d).sqrt()) / core::f64::consts::PI;
    let off = truth.visibility().into_iter().zip(&offsets).map(|(v, &d)| v - closed(d));
    (r_m_s(off), r_m_s(truth.doubt().into_iter()))
}

#[test]
fn four_times_the_samples_are_nearly_three_times_as_near_and_the_truth_knows_it() {
    let found: Vec<(f64, f64)> = [64, 256, 1024].map(errors_of_one_edge).to_vec();
    println!("{found:?}");
    for (samples, (error, stated)) in [64.0_f64, 256.0, 1024.0].into_iter().zip(&found) {
        let law = 0.32 * samples.powf(-0.75);
        assert!((error / law - 1.0).abs() < 0.2, "{samples}: {error}, by the law {law}");
        assert!((stated / error - 1.0).abs() < 0.2, "{samples}: {error}, stated {stated}");
    }
    for pair in found.windows(2) {
        let fell = pair[0].0 / pair[1].0;
        assert!((2.4..3.4).contains(&fell), "N^-3/4 is 2.83 times less: {fell}");
    }
}

#[test]
fn rectangles_and_lines_have_their_closed_forms_too() {
    let half_u = DVec3::new(0.5, 0.0, 0.0);
    let lights = [
        Light::Rect { center: DVec3::ZERO, half_u, half_v: DVec3::new(0.0, 0.25, 0.0) },
        Light::Linear { p0: -half_u, p1: half_u },
    ];
    let offsets: Vec<f64> = (0..200).map(|i| -0.995 + f64::from(i) / 100.0).collect();
    let eye = receivers(offsets.iter().map(|d| DVec3::new(-d * 0.5, 0.1, 4.0)).collect());
    for light in lights {
        let truth = Truth::new(&half_plane(), &light, &eye, 1024, &|| ()).visibility();
        let error = r_m_s(truth.iter().zip(&offsets).map(|(v, d)| v - (1.0 + d) / 2.0));
        assert!(error < 3e-3, "{light:?}: {error}");
    }
    // Of a triangle with a side along the edge, what is not seen yet falls with the square.
    let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let light = Light::Triangle { p0: corner(-0.5, -0.2), p1: corner(-0.5, 0.4), p2: corner(0.5, 0.1) };
    let moved = offsets.iter().map(|d| DVec3::new(-d * 0.5, 0.1, 4.0)).collect();
    let truth = Truth::new(&half_plane(), &light, &receivers(moved), 1024, &|| ()).visibility();
    let error = r_m_s(truth.iter().zip(&offsets).map(|(v, d)| v - (1.0 - ((1.0 - d) / 2.0).powi(2))));
    println!("a triangle: {error}");
    assert!(error < 4e-3, "{light:?}: {error}");
}

#[test]
fn the_truth_does_not_depend_on_host_threads() {
    let scene = load_scene("tiny", Path::new(".")).expect("tiny is shipped");
    let eye = EyeView::render(&scene.mesh, &scene.camera, 64, 48);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let parts = core::sync::atomic::AtomicUsize::new(0);
        let count = || _ = parts.fetch_add(1, core::sync::atomic::Ordering::Relaxed);
        let truth = pool.install(|| Truth::new(&scene.mesh, &scene.light, &eye, 18, &count));
        assert_eq!(parts.into_inner(), Truth::parts(eye.points.len()));
        truth
    };
    let one = with(1);
    assert!(with(2) == one && with(7) == one);
    assert_eq!(Truth::from_hidden(&scene.light, 18, one.hidden().to_vec()), Some(one.clone()));
    assert_eq!(Truth::from_hidden(&scene.light, 4, one.hidden().to_vec()), None, "more hidden than cast");
}

/// Triangles that are collected for all rays of a receiver are those that the rays meet one by one.
#[test]
fn no_triangle_is_lost_between_receiver_and_light() {
    for (name, light) in [
        ("tiny", None),
        ("cornell", None),
        ("cornell", Some(Light::Linear { p0: DVec3::new(-0.3, 1.9, 0.1), p1: DVec3::new(0.4, 1.7, 0.0) })),
        (
            "cornell",
            Some(Light::Rect {
                center: DVec3::new(0.1, 1.9, 0.1),
                half_u: DVec3::X * 0.3,
                half_v: DVec3::Z * 0.1,
            }),
        ),
        // With a right angle, so that only rays near an occluder are tried.
        (
            "cornell",
            Some(Light::Triangle {
                p0: DVec3::new(-0.3, 1.9, 0.1),
                p1: DVec3::new(0.4, 1.9, 0.1),
                p2: DVec3::new(-0.3, 1.9, -0.4),
            }),
        ),
        ("table", Some(Light::Sphere { center: DVec3::new(0.3, 1.5, 0.2), radius: 1e-9 })),
        ("table", Some(DISC)),
    ] {
        let scene = load_scene(name, Path::new(".")).expect("shipped");
        let light = light.unwrap_or(scene.light);
        let bvh = crate::Bvh::new(&scene.mesh);
        let eye = EyeView::render_with(&bvh, &scene.mesh, &scene.camera, 48, 36);
        let (all, few) = (Rays::new(&light, 16), Rays::new(&light, 1));
        let mut hidden = 0;
        for (i, &p) in eye.points.iter().enumerate() {
            let together = all.hidden(&bvh, p, eye.triangles[i], 0.3);
            let alone = all.hidden_one_by_one(&bvh, p, eye.triangles[i], 0.3);
            assert_eq!(together, alone, "{name} {light:?} receiver {i}");
            hidden += together;
        }
        assert!(hidden > 0 && few.count() == 1, "{name} {light:?}");
    }
}

/// A floor of two triangles under a lamp that is let into a ceiling: a million scene sizes away, rounding moves both off
/// their planes, by more than a fixed part of a grazing ray allows for.
#[test]
fn the_planes_of_receiver_and_light_shadow_nothing_wherever_they_lie() {
    for offset in [DVec3::ZERO, DVec3::new(3e6, -7e6, 1e6)] {
        let tilted =
            |x: f64, y: f64, z: f64| offset + DVec3::new(x + 0.3 * y, y - 0.3 * x + 0.1 * z, z - 0.1 * y);
        let quad = |y: f64, size: f64| {
            [(-size, -size), (size, -size), (size, size), (-size, size)].map(|(x, z)| tilted(x, y, z))
        };
        let mut mesh = Mesh::default();
        for corners in [quad(0.0, 5.0), quad(1.0, 0.3)] {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(corners);
            mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        let normal = tilted(0.0, 1.0, 0.0) - offset;
        let light = Light::Disc { center: tilted(0.0, 1.0, 0.0), normal, radius: 0.1 };
        let points: Vec<DVec3> = (0..400).map(|i| tilted(-4.9 + 0.0245 * f64::from(i), 0.0, 0.3)).collect();
        let eye = EyeView { triangles: vec![0; points.len()], ..receivers(points) };
        let truth = Truth::new(&mesh, &light, &eye, 16, &|| ());
        let dark = truth.visibility().iter().filter(|v| **v < 1.0).count();
        assert_eq!(dark, 0, "of 400 at {offset}");
    }
}

#[test]
fn brute_force_agrees_with_the_truth_within_its_own_error() {
    // One flat convex occluder: nothing overlaps, so that the form is exact.
    let corners: Vec<[f64; 3]> = (0..5)
        .map(|k| core::f64::consts::TAU * f64::from(k) / 5.0)
        .map(|angle| [0.4 * libm::cos(angle), 2.0 + 0.2 * libm::sin(angle), 0.5 * libm::sin(angle)])
        .collect();
    let mesh = polygons(&serde_json::json!([corners]));
    let center = DVec3::new(0.2, 4.0, 0.1);
    for light in [
        Light::Sphere { center, radius: 0.3 },
        Light::Disc { center, normal: DVec3::new(0.3, 1.0, 0.2), radius: 0.3 },
        Light::Rect { center, half_u: DVec3::new(0.3, 0.05, 0.0), half_v: DVec3::new(0.1, 0.0, 0.2) },
        Light::Linear { p0: center - DVec3::new(0.3, 0.1, 0.1), p1: center + DVec3::new(0.3, 0.1, 0.1) },
    ] {
        let points = (0..2500)
            .map(|i| DVec3::new(f64::from(i % 50) * 0.06 - 1.6, 0.0, f64::from(i / 50) * 0.06 - 1.6));
        let eye = receivers(points.collect());
        let truth = Truth::new(&mesh, &light, &eye, 256, &|| ());
        let adjacency = Adjacency::new(&mesh);
        let exact = Occluders::from_mesh(&mesh, &adjacency, &light);
        let visible: Vec<f64> =
            eye.points.iter().map(|&p| exact.visibility_at(p - light.center(), u32::MAX)).collect();
        let metrics = ErrorMetrics::new(&truth.visibility(), &visible);
        let doubt = truth.doubt();
        let stated = (doubt.iter().map(|x| x * x).sum::<f64>() / metrics.in_question as f64).sqrt();
        println!("{light:?}: {metrics:?}, stated {stated}");
        assert!(metrics.shadowed > 300 && metrics.rmse < 1.25 * stated, "{light:?}: {metrics:?}, {stated}");
        assert!(metrics.bias.abs() < stated / 4.0, "{light:?}: {metrics:?}, stated {stated}");
    }
}

/// Part of the square beyond an edge, as a count of the cells whose middles are.
fn cells_beyond(u0: DVec2, u1: DVec2) -> f64 {
    const SIDE: i32 = 400;
    let beyond = |i: i32| {
        let at = |k: i32| (2.0 * f64::from(k) + 1.0) / f64::from(SIDE) - 1.0;
        let place = DVec2::new(at(i % SIDE), at(i / SIDE));
        let side = u0.perp_dot(u1);
        let in_wedge = u0.perp_dot(place) * side > 0.0 && place.perp_dot(u1) * side > 0.0;
        in_wedge && (place - u0).perp_dot(u1 - u0) * (-u0).perp_dot(u1 - u0) < 0.0
    };
    f64::from((0..SIDE * SIDE).filter(|&i| beyond(i)).count() as u32) / f64::from(SIDE * SIDE)
}

#[test]
fn what_lies_beyond_an_edge_of_a_square_is_what_can_be_counted() {
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
    };
    for reach in [0.8, 1.5, 6.0] {
        for _ in 0..40 {
            let (u0, u1) = (DVec2::new(random(), random()) * reach, DVec2::new(random(), random()) * reach);
            let (part, count) = (square_beyond(u0, u1), cells_beyond(u0, u1));
            assert!((part - count).abs() < 0.004, "{u0} {u1}: {part}, counted {count}");
            assert!((square_beyond(u1, u0) - part).abs() < 1e-15, "{u0} {u1}");
        }
    }
    let part = |u0: [f64; 2], u1: [f64; 2]| square_beyond(u0.into(), u1.into());
    // Half of it, a quarter, a corner cut off, sides, and what has no length, no wedge or no end.
    assert_eq!(part([-3.0, 0.0], [3.0, 0.0]), 0.5);
    assert_eq!(part([-3.0, 0.5], [3.0, 0.5]), 0.25);
    assert!((part([0.5, 1.0], [1.0, 0.5]) - 0.125 / 4.0).abs() < 1e-15);
    assert_eq!(part([-1.0, 1.0], [1.0, 1.0]), 0.0);
    assert_eq!(part([0.3, 0.3], [0.3, 0.3]), 0.0);
    assert_eq!(part([0.0, 0.0], [0.5, 0.5]), 0.0);
    assert!((part([-1e9, 0.5 - 1e9], [1e9, 0.5 + 1e9]) - 0.28125).abs() < 1e-7);
    // A line: from where it is crossed to its end.
    assert_eq!(line_beyond([0.5, -1.0].into(), [0.5, 2.0].into()), 0.25);
    assert_eq!(line_beyond([-0.5, 2.0].into(), [-0.5, -1.0].into()), 0.25);
    assert_eq!(line_beyond([1.5, -1.0].into(), [1.5, 2.0].into()), 0.0);
    assert_eq!(line_beyond([0.5, 1.0].into(), [0.5, 2.0].into()), 0.0);
}

#[test]
fn brute_force_and_shadow_rays_agree_on_the_tiny_scene() {
    let scene = load_scene("tiny", Path::new(".")).expect("tiny is shipped");
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height);
    let input = ShadowInput::new(&scene, &adjacency, &eye);
    let truth = shadow_rays(&scene.mesh, &scene.light, &eye, 512);
    let exact = Occluders::from_mesh(&scene.mesh, &adjacency, &scene.light);
    let analytic = exact.visibility_of_view(&adjacency, &eye);
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
    let analytic = occluders.visibility_of_view(&adjacency, &eye);
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
