//! Lights that faces reach into, and lights whose middle lies exactly in the plane of one: brute force beside shadow rays.

use glam::{DVec2, DVec3};

use super::tests::receivers;
use super::{ErrorMetrics, Occluders, Truth, spiral};
use crate::adjacency::{Adjacency, Aspect, CUT_TRIANGLES_MAX, Stance, prepare};
use crate::light::Light;
use crate::mesh::Mesh;
use crate::{EyeView, ShadowInput};

const RADIUS: f64 = 0.25;

/// Parts of scenes, each with corners of its own.
#[derive(Default)]
struct Parts(Mesh);

impl Parts {
    fn with(mut self, corners: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let first = self.0.positions.len() as u32;
        self.0.positions.extend(corners);
        self.0.triangles.extend(triangles.iter().map(|t| t.map(|v| v + first)));
        self
    }

    /// A level sheet of `sides` by `sides` fields.
    fn level(self, center: DVec3, half: f64, sides: u32) -> Self {
        let row = sides + 1;
        let at = |k: u32| f64::from(k) / f64::from(sides) * 2.0 - 1.0;
        let corners: Vec<DVec3> =
            (0..row * row).map(|i| center + DVec3::new(at(i % row), 0.0, at(i / row)) * half).collect();
        let field = |i: u32| {
            let a = i / sides * row + i % sides;
            [[a, a + row, a + row + 1], [a, a + row + 1, a + 1]]
        };
        self.with(&corners, &(0..sides * sides).flat_map(field).collect::<Vec<_>>())
    }

    fn block(self, low: DVec3, high: DVec3) -> Self {
        let corner = |i: u32| {
            let side = |bit: u32, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
            DVec3::new(side(0, low.x, high.x), side(1, low.y, high.y), side(2, low.z, high.z))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        self.with(&(0..8).map(corner).collect::<Vec<_>>(), &triangles)
    }

    fn finish(mut self) -> Mesh {
        prepare(&mut self.0);
        self.0
    }
}

/// Points all around, those that are `outside`; none is on a plane.
fn around(outside: impl Fn(DVec3) -> bool) -> Vec<DVec3> {
    let golden = DVec3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_2);
    let point = |k: u32| (golden * f64::from(k) + 0.37).fract() * DVec3::new(4.0, 3.0, 4.0);
    (0..1000).map(|k| point(k) - DVec3::new(2.0, -0.0137, 2.0)).filter(|p| outside(*p)).collect()
}

/// Brute force beside 1024 rays: mean and greatest error over all receivers, and the mean error of the rays themselves.
fn off(mesh: &Mesh, light: Light, points: Vec<DVec3>) -> (f64, f64, f64) {
    let eye = receivers(points);
    let truth = Truth::new(mesh, &light, &eye, 1024, &|| ());
    let occluders = Occluders::from_mesh(mesh, &Adjacency::new(mesh), &light);
    let middle = occluders.middle();
    let visible: Vec<f64> =
        eye.points.iter().map(|&p| occluders.visibility_at(p - middle, u32::MAX)).collect();
    let metrics = ErrorMetrics::new(&truth.visibility(), &visible);
    let doubt = truth.doubt().iter().sum::<f64>() / metrics.shadowed.max(1) as f64;
    (metrics.atty_mae, metrics.max, doubt)
}

/// Checks that the mean error beside rays is within `most` past twice theirs.
fn right(what: &str, most: f64, mesh: &Mesh, light: Light, points: Vec<DVec3>) {
    let (mean, max, doubt) = off(mesh, light, points);
    println!("{what}: mean {mean:.5} (rays {doubt:.5}), max {max:.4}");
    assert!(mean <= 2.0 * doubt + most, "{what}: {mean}, rays {doubt}, max {max}");
}

fn sphere(center: DVec3) -> Light {
    Light::Sphere { center, radius: RADIUS }
}

/// Lights of each kind about a middle, askew.
fn lights(center: DVec3) -> [Light; 4] {
    let half_u = DVec3::new(0.11, 0.22, -0.07);
    [
        sphere(center),
        Light::Disc { center, normal: DVec3::new(0.8, 0.36, -0.48), radius: RADIUS },
        Light::Rect { center, half_u, half_v: DVec3::new(-0.12, 0.05, 0.03) },
        Light::Linear { p0: center - half_u, p1: center + half_u },
    ]
}

const HEIGHTS: [f64; 9] = [1.2, 0.9, 0.5, 0.1, 1e-3, 1e-6, 1e-9, 0.0, -0.3];

#[test]
fn a_light_cut_by_a_sheet_is_hidden_by_it_exactly() {
    for sides in [1, 3] {
        let at = DVec3::new(0.2, 1.3, 0.0);
        let mesh = Parts::default().level(at, 0.6, sides).finish();
        for height in HEIGHTS {
            let center = at + DVec3::new(0.13, RADIUS * height, 0.07);
            for light in lights(center) {
                let what = format!("{light:?}, {height} radii over {sides} by {sides} fields");
                right(&what, 1e-3, &mesh, light, around(|_| true));
            }
        }
    }
}

#[test]
fn a_light_at_the_edge_or_the_corner_of_a_sheet_is_hidden_by_it_exactly() {
    let at = DVec3::new(-0.5, 1.3, 0.0);
    let mesh = Parts::default().level(at, 0.6, 1).finish();
    for distance in HEIGHTS {
        for (what, foot) in [("edge", DVec3::new(0.6, 0.0, 0.07)), ("corner", DVec3::new(0.6, 0.0, 0.6))] {
            let center = at + foot + DVec3::new(0.8, 0.6, 0.0) * (RADIUS * distance);
            for light in lights(center) {
                right(&format!("{what} at {distance}, {light:?}"), 1e-3, &mesh, light, around(|_| true));
            }
        }
    }
}

#[test]
fn the_tip_of_a_triangle_in_a_light_hides_what_it_hides() {
    let lamp = DVec3::new(0.1, 2.0, 0.03);
    for distance in HEIGHTS {
        let tip = lamp + DVec3::new(0.36, -0.8, 0.48) * (RADIUS * distance);
        let mesh = Parts::default()
            .with(&[tip, DVec3::new(0.3, 0.8, -0.5), DVec3::new(-0.2, 0.9, 0.6)], &[[0, 1, 2]])
            .finish();
        for light in lights(lamp) {
            right(&format!("tip at {distance}, {light:?}"), 1e-3, &mesh, light, around(|_| true));
        }
    }
}

/// The middle of a light far from a face that lies in its plane: half of the light is beyond the plane.
#[test]
fn a_face_whose_plane_holds_the_middle_of_a_light_hides_what_is_beyond_it() {
    for (sides, tilt) in [(1, 0.0), (4, 0.0), (4, 0.37)] {
        let turn = glam::DQuat::from_rotation_z(tilt);
        let mut mesh = Parts::default().level(DVec3::ZERO, 2.0, sides).finish();
        mesh.positions.iter_mut().for_each(|p| *p = turn * *p);
        for height in [0.01, 1e-6, 0.0, -1e-6] {
            let light = sphere(turn * DVec3::new(3.2, height, 0.1));
            let what = format!("{sides} by {sides} fields, tilted by {tilt}, {height} over the plane");
            let points: Vec<DVec3> = around(|_| true).into_iter().map(|p| p - DVec3::Y).collect();
            right(&what, 1e-3, &mesh, light, points);
        }
        // Nothing hides anything from the sheet itself.
        let light = sphere(turn * DVec3::new(3.2, 0.0, 0.1));
        let occluders = Occluders::from_mesh(&mesh, &Adjacency::new(&mesh), &light);
        for p in around(|_| true) {
            let on = turn * DVec3::new(p.x, 0.0, p.z) - occluders.middle();
            let of = mesh.triangles.iter().position(|t| {
                let [a, b, c] = t.map(|v| mesh.positions[v as usize] - occluders.middle());
                let normal = (b - a).cross(c - a);
                [(a, b), (b, c), (c, a)].iter().all(|(v, w)| (*w - *v).cross(on - *v).dot(normal) >= 0.0)
            });
            if let Some(own) = of {
                let covered = occluders.coverage_at(on, own as u32);
                assert!(covered < 1e-4, "{sides} {tilt}: {covered} of the light hidden from {p}");
            }
        }
    }
}

#[test]
fn a_light_that_reaches_into_a_body_is_dark_where_it_is_inside() {
    let (low, high) = (DVec3::new(-0.5, 0.5, -0.5), DVec3::new(0.5, 1.5, 0.5));
    let mesh = Parts::default().block(low, high).finish();
    let outside = |p: DVec3| !(p.cmpge(low - 0.01).all() && p.cmple(high + 0.01).all());
    for height in HEIGHTS {
        for (what, foot, out) in [
            ("face", DVec3::new(0.11, 1.5, 0.07), DVec3::Y),
            ("edge", DVec3::new(0.5, 1.5, 0.07), DVec3::new(0.8, 0.6, 0.0)),
            ("corner", DVec3::new(0.5, 1.5, 0.5), DVec3::new(0.6, 0.64, 0.48)),
        ] {
            let center = foot + out * (RADIUS * height);
            right(
                &format!("{what} of a body at {height}"),
                if height > 1.0 { 0.01 } else { 1e-3 },
                &mesh,
                sphere(center),
                around(outside),
            );
        }
    }
}

#[test]
fn a_light_that_reaches_through_the_wall_of_a_room_is_dark_beyond_it() {
    for inward in [false, true] {
        let (low, high) = (DVec3::new(-2.0, 0.0, -2.0), DVec3::new(2.0, 3.1, 2.0));
        let mut mesh = Parts::default()
            .block(low, high)
            .block(DVec3::new(0.3, 0.6, -0.4), DVec3::new(0.9, 1.2, 0.3))
            .finish();
        if inward {
            mesh.triangles[..12].iter_mut().for_each(|t| t.swap(0, 1));
        }
        let outside =
            |p: DVec3| !(p.x > 0.29 && p.x < 0.91 && p.y > 0.59 && p.y < 1.21 && p.z > -0.41 && p.z < 0.31);
        for depth in [0.9, 0.5, 0.1, 1e-6, 0.0, -0.2] {
            let light = sphere(DVec3::new(0.2, 3.1 - RADIUS * depth, 0.1));
            right(&format!("room, {depth} radii below its ceiling"), 1e-3, &mesh, light, around(outside));
        }
    }
}

/// Samples of the light that are hidden, one by one, are as many as the area says.
#[test]
fn samples_and_areas_of_a_cut_light_agree() {
    let at = DVec3::new(0.2, 1.3, 0.0);
    let mesh = Parts::default().level(at, 0.6, 2).finish();
    let even = |i: u32| f64::from(2 * i + 1) / 64.0 - 1.0;
    let square = (0..4096).map(|i| DVec2::new(even(i % 64), even(i / 64))).collect();
    let line = (0..4096).map(|i| DVec2::new(f64::from(2 * i + 1) / 4096.0 - 1.0, 0.0)).collect();
    let [sphere, disc, rect, linear] = lights(at + DVec3::new(0.13, RADIUS * 0.3, 0.07));
    let cases: [(_, Vec<DVec2>, f64); 4] = [
        (sphere, spiral(4096), 4e-3),
        (disc, spiral(4096), 4e-3),
        (rect, square, 0.02),
        (linear, line, 1e-3),
    ];
    for (light, places, most) in cases {
        let occluders = Occluders::from_mesh(&mesh, &Adjacency::new(&mesh), &light);
        for p in around(|_| true) {
            let p = p - occluders.middle();
            let covered = occluders.covered_samples(p, u32::MAX, &places) as f64 / 4096.0;
            let area = occluders.coverage_at(p, u32::MAX);
            assert!((covered - area).abs() < most, "{light:?}: {covered} of the samples, {area} at {p}");
        }
    }
}

#[test]
fn a_light_that_is_cut_nowhere_has_the_aspect_of_its_middle_and_a_point_is_never_cut() {
    let at = DVec3::new(0.2, 1.3, 0.0);
    let mesh = Parts::default().level(at, 0.6, 12).finish();
    let adjacency = Adjacency::new(&mesh);
    let over = |height: f64| Light::Sphere { center: at + DVec3::new(0.13, height, 0.07), radius: RADIUS };
    let clear = Aspect::new(&over(0.3), &mesh, &adjacency);
    assert!(clear.cut.is_empty() && clear.middle == over(0.3).center());
    assert!(clear.stance.iter().all(|stance| *stance == Stance::AsItRuns));
    let point = Aspect::new(&Light::Point { center: over(0.0).center() }, &mesh, &adjacency);
    assert!(point.cut.is_empty() && point.middle == over(0.0).center());
    assert!(point.stance.contains(&Stance::LeftOut));

    let cut = Aspect::new(&over(0.1), &mesh, &adjacency);
    assert!(!cut.cut.is_empty() && cut.cut_left.is_none(), "{cut:?}");
    let large = Light::Sphere { center: at, radius: 10.0 };
    let all = Aspect::new(&large, &mesh, &adjacency);
    let left = all.cut_left.map(|left| left.triangles);
    assert_eq!((all.cut.len(), left), (CUT_TRIANGLES_MAX, Some(288 - CUT_TRIANGLES_MAX)));
    let input = ShadowInput::new(
        &crate::Scene {
            mesh: mesh.clone(),
            light: large,
            ..crate::load_scene("tiny", std::path::Path::new(".")).expect("tiny is shipped")
        },
        &adjacency,
        &EyeView { triangles: vec![0], ..receivers(vec![DVec3::ZERO]) },
    );
    assert_eq!(input.cut, all.cut);
}
