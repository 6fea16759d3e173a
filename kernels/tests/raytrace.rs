//! Ray tracing on the machine: the order along the curve, the tree, single rays, and pictures.

mod common;

use common::{
    draw, input, on, one_of_each_kind, random_scene, ray_hits, same_on_all_back_ends, shipped, sphere,
    under_a_point,
};
use lrbsim_kernels::raytrace::Raytrace;
use lrbsim_kernels::raytrace::trace::tasks_log2;
use lrbsim_kernels::sism::Sism;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::reference::{ErrorMetrics, Truth};
use lrbsim_workloads::{Adjacency, ShadowInput};

#[test]
fn rays_to_a_point_hit_what_they_hit_in_f64() {
    let (mut compared, mut shadowed) = (0, 0);
    for seed in 0..24 {
        let (mesh, receivers) = random_scene(seed, 400);
        let input = input(mesh, sphere(0.0), &receivers);
        let ours = draw(&Raytrace, "", &input, on()).visibility;
        for (receiver, visible) in ours.iter().enumerate() {
            if let Some(hit) = ray_hits(&input, receiver, DVec3::ZERO) {
                assert_eq!(*visible == 0.0, hit, "seed {seed}, receiver {receiver}");
                compared += 1;
                shadowed += usize::from(hit);
            }
        }
    }
    assert!(compared > 5000 && shadowed > 1000, "{shadowed} of {compared}");
}

#[test]
fn tasks_have_numbers_however_many_rays_there_are() {
    assert_eq!([tasks_log2(4800, 1), tasks_log2(4800, 16), tasks_log2(4800, 17)], [0, 4, 5]);
    for groups in [0, 1, 2, 4_194_304, 1 << 28, u32::MAX >> 1] {
        for rays in [1, 3, 256, 1024] {
            let tasks = u64::from(groups) << tasks_log2(groups, rays);
            assert!(tasks <= u64::from(u32::MAX) >> 1, "{groups} {rays}: {tasks}");
        }
    }
}

#[test]
fn under_a_point_it_draws_the_hard_shadow_but_for_ties() {
    for name in ["tiny", "table", "saloon-small"] {
        let (scene, eye, _) = shipped(name, Some((160, 120)));
        let input = under_a_point(&scene, &eye);
        let rays = draw(&Raytrace, "", &input, on()).visibility;
        let hard = draw(&Sism, "", &input, on()).visibility;
        let off: Vec<usize> = (0..rays.len()).filter(|i| rays[*i] != hard[*i]).collect();
        println!("{name}: {} of {} differ", off.len(), rays.len());
        // Ties: their rays pass a border within a ten thousandth of a triangle.
        let told = off.iter().find(|i| ray_hits(&input, **i, DVec3::ZERO).is_some());
        assert!(told.is_none(), "{name}: receiver {told:?}, whose ray passes no border");
        assert!(off.len() * 2000 <= rays.len(), "{name}: {} of {} differ", off.len(), rays.len());
    }
}

#[test]
fn its_error_falls_faster_with_the_number_of_rays_than_by_lot() {
    let (mut scene, eye, _) = shipped("tiny", Some((160, 120)));
    let adjacency = Adjacency::new(&scene.mesh);
    for light in one_of_each_kind(scene.light) {
        scene.light = light;
        let truth = Truth::new(&scene.mesh, &light, &eye, 4096, &|| ()).visibility();
        let input = ShadowInput::new(&scene, &adjacency, &eye);
        let error = |rays: u32| {
            let ours = draw(&Raytrace, &format!("rays={rays}"), &input, on()).visibility;
            let ours: Vec<f64> = ours.into_iter().map(f64::from).collect();
            let metrics = ErrorMetrics::new(&truth, &ours);
            println!("{light:?}, {rays}: {metrics:?}");
            assert!(metrics.bias.abs() < 0.05 * metrics.atty_mae + 1e-3, "{light:?}, {rays}: {metrics:?}");
            metrics.atty_mae
        };
        let (few, many) = (error(4), error(256));
        let exponent = (few / many).ln() / 64.0_f64.ln();
        println!("{light:?}: error falls with the {exponent:.3}");
        assert!((0.65..1.1).contains(&exponent), "{light:?}: {exponent}");
    }
}

#[test]
fn rays_see_a_light_that_triangles_cut() {
    // A level sheet through the middle of the light hides the half of it that is on the other side.
    let corners = [(-9.0, -9.0), (-9.0, 9.0), (9.0, 9.0), (9.0, -9.0)].map(|(x, z)| DVec3::new(x, 0.0, z));
    let mesh = common::polygons(&[corners.to_vec()]);
    let receivers: Vec<(DVec3, u32)> =
        (0..256).map(|k| (DVec3::new(4.0, 0.0, f64::from(k) * 1e-3), u32::MAX)).collect();
    let above: Vec<_> = receivers.iter().map(|(p, own)| (*p + DVec3::Y * 0.4, *own)).collect();
    let visible = draw(&Raytrace, "rays=64", &input(mesh, sphere(0.5), &above), on()).visibility;
    let mean = visible.iter().sum::<f32>() / visible.len() as f32;
    assert!((mean - 0.5).abs() < 0.02, "{mean}");
}

#[test]
fn ray_tracing_is_the_same_on_all_back_ends_and_its_tasks_are_short() {
    let (_, _, input) = shipped("tiny", Some((120, 90)));
    for rays in ["rays=1", "rays=2", "rays=3", "rays=16"] {
        same_on_all_back_ends(&Raytrace, rays, &input);
    }
}
