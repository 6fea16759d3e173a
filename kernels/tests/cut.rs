//! Lights that triangles reach into: the kernel against f64 brute force, which the workloads' tests hold to shadow rays.

mod common;

use common::{
    On, Random, Run, add_box, back_ends, input, on, polygons, random_scene, shipped, sphere, turned,
};
use lrbsim_kernels::samples::{places, turns};
use lrbsim_kernels::sism::Overlap;
use lrbsim_workloads::adjacency::CUT_TRIANGLES_MAX;
use lrbsim_workloads::glam::{DVec3, Vec3};
use lrbsim_workloads::reference::Occluders;
use lrbsim_workloads::{Light, Mesh, Outline, ShadowInput};

/// How many receivers are off the f64 brute force by more than 1e-3, and the greatest difference.
fn off(input: &ShadowInput, on: On) -> (usize, f64) {
    let truth = Occluders::from_input(input).visibility(input);
    let ours = Run::new(input, on).visibility();
    let differences = || truth.iter().zip(&ours).map(|(a, b)| (a - f64::from(*b)).abs());
    (differences().filter(|x| *x > 1e-3).count(), differences().fold(0.0, f64::max))
}

/// Receivers all around the light of a scene, a few units away at most, on no triangle.
fn around(count: usize) -> Vec<(DVec3, u32)> {
    let mut random = Random(5);
    (0..count).map(|_| (random.vector() * 2.0, u32::MAX)).collect()
}

/// Lights of each kind about the origin, of this radius, those that do not turn across `normal`.
fn lights(radius: f64, normal: DVec3) -> [Light; 4] {
    let center = DVec3::ZERO;
    let (s, t) = normal.normalize().any_orthonormal_pair();
    [
        sphere(radius),
        Light::Disc { center, normal, radius },
        Light::Rect { center, half_u: (s * 0.9 + t * 0.1) * radius, half_v: (t * 0.4 - s * 0.1) * radius },
        Light::Linear { p0: -s * radius, p1: s * radius },
    ]
}

fn sheet(center: DVec3, half: f64) -> Mesh {
    let corner = |(x, z): (f64, f64)| center + DVec3::new(x, 0.0, z) * half;
    polygons(&[[(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)].map(corner).to_vec()])
}

/// Scenes whose light is cut by a face, at an edge, at a corner, at a tip, by a body, with its middle so many radii from it.
fn scenes(distance: f64) -> Vec<(&'static str, Mesh)> {
    const RADIUS: f64 = 0.25;
    let away = RADIUS * distance;
    let mut block = Mesh::default();
    add_box(&mut block, DVec3::new(-0.5, -0.5 - away, 0.07), DVec3::splat(0.5));
    let mut corner = Mesh::default();
    add_box(&mut corner, DVec3::splat(-0.5) - DVec3::new(0.6, 0.64, 0.48) * away, DVec3::splat(0.5));
    let tip = DVec3::new(0.36, -0.8, 0.48) * away;
    vec![
        ("face", sheet(DVec3::new(0.13, -away, 0.07), 0.6)),
        ("edge", sheet(DVec3::new(-0.6, 0.0, 0.07) - DVec3::new(0.8, 0.6, 0.0) * away, 0.6)),
        ("tip", polygons(&[vec![tip, DVec3::new(0.3, -1.2, -0.5), DVec3::new(-0.2, -1.1, 0.6)]])),
        ("edge of a body", block),
        ("corner of a body", corner),
    ]
}

#[test]
fn a_cut_light_is_seen_as_by_brute_force_however_near_its_middle_the_cut_is() {
    for distance in [0.9, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 1e-9, 0.0, -0.3] {
        for (what, mesh) in scenes(distance) {
            for light in lights(0.25, DVec3::new(0.3, 0.8, -0.52)) {
                let input = input(mesh.clone(), light, &around(4000));
                assert!(!input.cut.is_empty() || light != sphere(0.25), "{what} {distance}");
                let (off, most) = off(&input, on());
                println!("{what} at {distance}, {} cut: {off} off, at most {most:.2e}", input.cut.len());
                assert!(off <= 4, "{what} at {distance}, {light:?}: {off} off, at most {most}");
            }
        }
    }
}

#[test]
fn random_scenes_in_the_light_are_as_by_brute_force() {
    let (mut all, mut different, mut cut) = (0, 0, 0);
    for seed in 0..24 {
        let (mesh, receivers) = random_scene(seed, 600);
        for radius in [0.05, 0.3, 1.0] {
            for light in lights(radius, Random(seed).vector()) {
                let input = input(mesh.clone(), light, &receivers);
                let (off, most) = off(&input, on());
                if off > 0 {
                    println!(
                        "seed {seed}, {light:?}, {} cut: {off} off, at most {most:.2e}",
                        input.cut.len()
                    );
                }
                (all, different, cut) = (all + receivers.len(), different + off, cut + input.cut.len());
            }
        }
    }
    println!("{different} of {all} receivers, {cut} triangles");
    assert!(different * 1000 <= all && cut > 500, "{different} of {all}, {cut} cut");
}

#[test]
fn samples_of_a_cut_light_are_hidden_that_are() {
    let turns = turns(Outline::Disc);
    for distance in [0.5, 1e-4, 0.0] {
        for (what, mesh) in scenes(distance) {
            let input = input(mesh, sphere(0.25), &around(1000));
            let occluders = Occluders::from_input(&input);
            for (overlap, count) in [(Overlap::Bits64, 64_u32), (Overlap::Bits256, 256)] {
                let found = Run::with(&input, overlap, on()).visibility();
                let mut other = 0;
                for (i, found) in found.iter().enumerate() {
                    let p = Vec3::from(input.receivers[i]).as_dvec3();
                    let places = turned(&places(Outline::Disc, count), &turns, input.receiver_pixel.at(i));
                    let covered = occluders.covered_samples(p, input.receiver_triangle[i], &places);
                    let hidden = f64::from(count) * (1.0 - f64::from(*found));
                    other += usize::from((hidden - covered as f64).abs() > 0.01);
                }
                println!("{what} at {distance}, {count} samples: {other} differ");
                assert!(other <= found.len() / 100, "{what} at {distance}, {count} samples: {other} differ");
            }
        }
    }
}

#[test]
fn a_cut_light_has_one_picture_on_every_back_end_and_short_tasks() {
    let mut mesh = Mesh::default();
    let mut random = Random(3);
    for _ in 0..30 {
        add_box(&mut mesh, random.vector() * 0.2, random.vector().abs() * 0.1 + 0.02);
    }
    let input = input(mesh, sphere(0.25), &around(700));
    assert_eq!(input.cut.len(), CUT_TRIANGLES_MAX);
    for overlap in [Overlap::Sum, Overlap::Bits64, Overlap::Bits256] {
        let mut pictures = back_ends().into_iter().chain([on()]).map(|on| {
            let run = Run::with(&input, overlap, on);
            for (step, figures) in run.steps.iter().filter(|(step, _)| step.starts_with("cut")) {
                println!("{overlap:?} {step}: {figures:?}");
                assert!(figures.live_vectors_max <= 64, "{overlap:?}, {step}: {figures:?}");
                assert!(figures.longest_task < 64 << 10, "{overlap:?}, {step}: {figures:?}");
            }
            run.visibility()
        });
        let first = pictures.next().expect("there is a back end");
        assert!(pictures.all(|picture| picture == first), "{overlap:?}");
    }
}

#[test]
fn a_light_that_nothing_reaches_into_costs_no_step() {
    let run = Run::new(&shipped("tiny", None).2, on());
    assert!(run.steps.keys().all(|step| !step.starts_with("cut")));
    // Nor does a point.
    let input = input(sheet(DVec3::ZERO, 0.6), sphere(0.0), &around(100));
    assert!(input.cut.is_empty());
}

/// Receivers on a face that the light is cut by see all of the part above it; those on its other half, too.
#[test]
fn a_face_that_cuts_the_light_does_not_shadow_itself() {
    let mesh = sheet(DVec3::new(0.13, -0.1, 0.07), 2.0);
    let mut random = Random(9);
    let points: Vec<(DVec3, u32)> = (0..2000)
        .map(|_| {
            let (x, z) = (random.within(-1.9, 1.9), random.within(-1.9, 1.9));
            // Triangle 0 has the corners where x - z is least.
            (DVec3::new(0.13 + x, -0.1, 0.07 + z), u32::from(x > z))
        })
        .collect();
    let visible = Run::new(&input(mesh, sphere(0.25), &points), on()).visibility();
    let least = visible.iter().copied().fold(1.0, f32::min);
    assert!(least > 0.999, "{least}");
}
