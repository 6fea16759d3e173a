//! The picture stays the same where it must: at other scales and offsets, as the light becomes a point, as it moves.

mod common;

use common::{On, Random, Run, input, on, polygons, shipped};
use lrbsim_isa::HostSimd;
use lrbsim_kernels::sism::Overlap;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::reference::Occluders;
use lrbsim_workloads::{Adjacency, EyeView, Light, Mesh, Scene, ShadowInput};

/// Visibility of every pixel of `scene`, 2 where it sees nothing.
fn picture(scene: &Scene, overlap: Overlap, [width, height]: [u32; 2]) -> Vec<f32> {
    let eye = EyeView::render(&scene.mesh, &scene.camera, width, height);
    let input = ShadowInput::new(scene, &Adjacency::new(&scene.mesh), &eye);
    let mut pixels = vec![2.0; (width * height) as usize];
    for (pixel, visible) in eye.pixels.iter().zip(Run::with(&input, overlap, on()).visibility()) {
        pixels[*pixel as usize] = visible;
    }
    pixels
}

/// `scene` with every length times `scale` and then moved by `offset`.
fn placed(scene: &Scene, scale: f64, offset: DVec3) -> Scene {
    let place = |p: DVec3| p * scale + offset;
    let mut scene = scene.clone();
    scene.mesh.positions.iter_mut().for_each(|p| *p = place(*p));
    scene.camera.eye = place(scene.camera.eye);
    scene.camera.target = place(scene.camera.target);
    let (center, radius) = (place(scene.light.center()), scene.light.radius() * scale);
    scene.light = Light::Sphere { center, radius };
    scene
}

/// How many values differ by more than 1e-3.
fn off(a: &[f32], b: &[f32]) -> usize {
    a.iter().zip(b).filter(|(a, b)| (**a - **b).abs() > 1e-3).count()
}

#[test]
fn the_picture_is_the_same_at_every_scale_and_far_from_the_origin() {
    const SIZE: [u32; 2] = [200, 150];
    let (scene, ..) = shipped("tiny", None);
    let size = scene.mesh.bounds().diagonal();
    let direction = DVec3::new(0.6, -0.48, 0.64);
    for (what, moved) in [
        ("scale 1e-3", placed(&scene, 1e-3, DVec3::ZERO)),
        ("scale 1e3", placed(&scene, 1e3, DVec3::ZERO)),
        ("scale 1e6", placed(&scene, 1e6, DVec3::ZERO)),
        ("1e5 sizes off the origin", placed(&scene, 1.0, direction * (1e5 * size))),
    ] {
        for overlap in Overlap::ALL {
            let plain = picture(&scene, overlap, SIZE);
            let different = off(&plain, &picture(&moved, overlap, SIZE));
            println!("{what}, {overlap:?}: {different} of {} pixels", plain.len());
            assert!(
                different * 10_000 <= plain.len(),
                "{what}, {overlap:?}: {different} of {} pixels",
                plain.len()
            );
        }
    }
}

#[test]
fn a_light_of_radius_0_casts_the_hard_shadow_bit_for_bit_and_a_small_one_nearly() {
    let (mut scene, eye, _) = shipped("tiny", None);
    let adjacency = Adjacency::new(&scene.mesh);
    let center = scene.light.center();
    let mut run = |light| {
        scene.light = light;
        Run::new(&ShadowInput::new(&scene, &adjacency, &eye), on())
    };
    let mut point = run(Light::Point { center });
    let hard = point.visibility();
    let shadowed = hard.iter().filter(|v| **v == 0.0).count();
    assert!(shadowed > 100 && shadowed + 100 < hard.len() && hard.iter().all(|v| [0.0, 1.0].contains(v)));
    // By brute force: in shadow is what lies behind a layer.
    let sums = point.brute_force(on());
    let layers = eye.pixels.iter().map(|pixel| {
        let [front, back, ..] = sums[pixel];
        if front == 0 && back == 0 { 1.0 } else { 0.0 }
    });
    assert_eq!(hard, layers.collect::<Vec<f32>>());
    assert_eq!(run(Light::Sphere { center, radius: 0.0 }).visibility(), hard);
    assert_eq!(run(Light::Disc { center, normal: DVec3::NEG_Y, radius: 0.0 }).visibility(), hard);

    let mut last = usize::MAX;
    for radius in [0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
        let different = off(&hard, &run(Light::Sphere { center, radius }).visibility());
        println!("radius {radius}: {different} of {} receivers", hard.len());
        assert!(different <= last, "radius {radius}: {different} receivers, {last} at the radius before");
        last = different;
    }
    assert!(last * 10_000 <= hard.len(), "{last} of {} receivers", hard.len());
}

/// The faces of the grid, its bins and its cells lie about the light: as it moves, they pass over receivers and edges.
#[test]
fn a_light_that_moves_through_a_thousand_places_shows_no_seam() {
    let mut random = Random(11);
    let mut mesh = Mesh::default();
    for _ in 0..24 {
        let center = random.vector();
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([(); 3].map(|()| center + random.vector() * 0.3));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let receivers: Vec<_> = (0..96).map(|_| (random.vector() * 1.5, u32::MAX)).collect();
    let (mut different, mut all) = (0, 0);
    for step in 0..1000 {
        // A curve through the scene that never comes back to where it was.
        let time = f64::from(step) * 0.0063;
        let turn = |rate: f64| sine(time * rate);
        let center = DVec3::new(turn(1.0), turn(1.37) * 0.9, turn(0.61)) * 0.8;
        let input = input(mesh.clone(), Light::Sphere { center, radius: 0.06 }, &receivers);
        let mut run = Run::new(&input, On::Host(HostSimd::detect(), 1));
        assert_eq!(run.sums(), run.brute_force(On::Host(HostSimd::detect(), 1)), "light at {center}");
        let truth = Occluders::from_input(&input).visibility(&input);
        let ours = run.visibility();
        different += truth.iter().zip(&ours).filter(|(a, b)| (*a - f64::from(**b)).abs() > 1e-3).count();
        all += ours.len();
    }
    println!("{different} of {all} receivers off the brute force in f64 by more than 1e-3");
    assert!(different * 10_000 <= all, "{different} of {all}");
}

/// The sine of `x`, as the y of a direction.
fn sine(x: f64) -> f64 {
    lrbsim_workloads::glam::DVec2::from_angle(x).y
}

/// A face that is seen edge-on from the middle of the light hides nearly half of it from a receiver just over its plane, as it
/// does a hair above and below. It was left out. [deviations, "Where pictures break"]
#[test]
fn a_face_whose_plane_holds_the_middle_of_the_light_hides_what_is_beyond_it() {
    let corners = [(-2.0, -2.0), (-2.0, 2.0), (2.0, 2.0), (2.0, -2.0)].map(|(x, z)| DVec3::new(x, 0.0, z));
    let sheet = polygons(&[corners.to_vec()]);
    let receivers = [(DVec3::new(0.0, 0.05, 0.1), u32::MAX), (DVec3::new(0.0, -0.05, 0.1), u32::MAX)];
    for height in [1e-3, 1e-6, 1e-9, 0.0, -1e-9, -1e-6, -1e-3] {
        let light = Light::Sphere { center: DVec3::new(3.2, height, 0.0), radius: 0.25 };
        let input = input(sheet.clone(), light, &receivers);
        let brute_force = Occluders::from_input(&input).visibility(&input);
        for (ours, brute_force) in Run::new(&input, on()).visibility().into_iter().zip(brute_force) {
            assert!((f64::from(ours) - 0.576).abs() < 0.01, "{height}: {ours}");
            assert!((f64::from(ours) - brute_force).abs() < 1e-4, "{height}: {ours} and {brute_force}");
        }
    }
}

/// From a floor whose plane holds the middle of the light, all of the light is seen: half of it is below the horizon, which is
/// shading and no shadow.
#[test]
fn a_floor_that_holds_the_middle_of_the_light_does_not_shadow_itself() {
    let corners = [(-2.0, -2.0), (-2.0, 2.0), (2.0, 2.0), (2.0, -2.0)].map(|(x, z)| DVec3::new(x, 0.0, z));
    let floor = polygons(&[corners.to_vec()]);
    let mut random = Random(4);
    let receivers: Vec<(DVec3, u32)> = (0..1000)
        .map(|_| {
            let (x, z) = (random.within(-1.99, 1.99), random.within(-1.99, 1.99));
            (DVec3::new(x, 0.0, z), u32::from(x > z))
        })
        .collect();
    for height in [1e-6, 1e-8, 1e-9, 1e-10, 0.0, -1e-9, -1e-6] {
        let light = Light::Sphere { center: DVec3::new(3.2, height, 0.0), radius: 0.25 };
        let input = input(floor.clone(), light, &receivers);
        for overlap in Overlap::ALL {
            let visible = Run::with(&input, overlap, on()).visibility();
            let least = visible.iter().copied().fold(1.0, f32::min);
            assert!(least > 0.999, "{height}, {overlap:?}: {least}");
        }
    }
}
