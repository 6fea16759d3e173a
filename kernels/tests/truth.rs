//! The kernels against what is known to be right: f64 on the host, and shadow rays.

mod common;

use common::{On, Random, Run, input, one_of_each_kind, polygons, shipped};
use lrbsim_isa::HostSimd;
use lrbsim_kernels::sism::Overlap;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::reference::{ErrorMetrics, Occluders, shadow_rays};
use lrbsim_workloads::{Adjacency, Light, ShadowInput};

/// Only rounding parts the kernels from brute force in f64 over the same f32 input.
fn only_rounding(name: &str, size: Option<(u32, u32)>) {
    let input = shipped(name, size).2;
    let run = Run::new(&input, On::Host(HostSimd::detect(), 2));
    common::only_rounding(name, &Occluders::from_input(&input).visibility(&input), &run.visibility());
}

#[test]
fn tiny_is_right_but_for_rounding() {
    only_rounding("tiny", None);
}

#[test]
fn the_table_is_right_but_for_rounding() {
    only_rounding("table", Some((96, 72)));
}

#[test]
fn the_small_saloon_is_right_but_for_rounding() {
    only_rounding("saloon-small", Some((80, 60)));
}

#[test]
fn shadow_rays_agree_on_tiny_for_every_kind_of_light() {
    let (mut scene, eye, _) = shipped("tiny", None);
    let adjacency = Adjacency::new(&scene.mesh);
    // But for triangles, which the method does not draw.
    for light in &one_of_each_kind(scene.light)[..4] {
        scene.light = *light;
        let truth = shadow_rays(&scene.mesh, light, &eye, 512);
        let input = ShadowInput::new(&scene, &adjacency, &eye);
        for (overlap, most) in [(Overlap::Sum, 0.03), (Overlap::Bits256, 0.01)] {
            let run = Run::with(&input, overlap, On::Host(HostSimd::detect(), 2));
            let kernels: Vec<f64> = run.visibility().into_iter().map(f64::from).collect();
            let metrics = ErrorMetrics::new(&truth, &kernels);
            println!("{light:?} {overlap:?}: {metrics:?}");
            assert!(metrics.shadowed > 100 && metrics.atty_mae < most, "{light:?} {overlap:?}: {metrics:?}");
        }
    }
}

/// Positions are light-centred f32: at a distance of thousands of scenes they still part the scene into thousands of steps.
/// What is left is the slack of the planes, which lets light in within some 5e-7 of the distance from a contact.
#[test]
fn a_light_thousands_of_scenes_away_casts_the_right_shadows() {
    for distance in [1e2, 1e3, 1e4] {
        let (mut scene, eye, _) = shipped("tiny", None);
        scene.light = Light::Sphere { center: DVec3::new(0.1, 1.0, 0.1) * distance, radius: 0.01 * distance };
        let adjacency = Adjacency::new(&scene.mesh);
        let input = ShadowInput::new(&scene, &adjacency, &eye);
        let run = Run::new(&input, On::Host(HostSimd::detect(), 2));
        let test: Vec<f64> = run.visibility().into_iter().map(f64::from).collect();
        let metrics = ErrorMetrics::new(&shadow_rays(&scene.mesh, &scene.light, &eye, 256), &test);
        println!("light at {distance}: {metrics:?}");
        assert!(metrics.off_by_quarter * 50 <= test.len(), "light at {distance}: {metrics:?}");
    }
}

/// Triangles on all sides and at all slopes, the light a thousand times their size away: a receiver on the plane of one is
/// lit, and one behind it by a millionth of the distance lies in its shadow. Not so when the slack was a part of the
/// distance: light came in behind thin leaves.
#[test]
fn a_far_light_neither_darkens_the_plane_of_a_triangle_nor_passes_a_thin_leaf() {
    let mut random = Random(7);
    let mut direction = || loop {
        let v = DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - DVec3::ONE;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    };
    let light = Light::Point { center: DVec3::ZERO };
    for k in 0..64 {
        let toward = direction();
        let center = toward * 1000.0;
        // From head-on to nearly edge-on.
        let slope = 0.02_f64.max(1.0 - f64::from(k) / 60.0);
        let across = toward.cross(direction()).normalize();
        let normal = toward * slope + across * (1.0 - slope * slope).sqrt();
        let (s, t) = normal.any_orthonormal_pair();
        let corners = [(1.0, 0.0), (-0.5, 0.8), (-0.5, -0.8)].map(|(x, y)| center + s * x + t * y);
        let shift = (s * 0.1 + t * 0.2) * f64::from(k) / 64.0;
        let on_plane = center + shift;
        let behind = on_plane + normal * 1e-3;
        let input = input(polygons(&[corners.to_vec()]), light, &[(on_plane, u32::MAX), (behind, u32::MAX)]);
        let visible = Run::new(&input, On::Host(HostSimd::detect(), 1)).visibility();
        assert_eq!(visible, [1.0, 0.0], "triangle {k}, cosine {slope}");
    }
}
