//! Occluders that overlap on the light: closed forms, and the kernel against counts that are made one by one in f64.

mod common;

use common::{
    On, Random, Run, add_box, back_ends, cases, input, loops, of_loops, random_scene, shipped, sphere, turned,
};
use lrbsim_isa::HostSimd;
use lrbsim_kernels::samples::{places, turns};
use lrbsim_kernels::sism::Overlap;
use lrbsim_workloads::glam::{DVec2, DVec3, Vec3};
use lrbsim_workloads::reference::{ObjectRule, Occluders};
use lrbsim_workloads::{Light, Mesh, ShadowInput};

/// Ways to compare samples of the light, and how many there are.
const BITS: [(Overlap, u32); 2] = [(Overlap::Bits64, 64), (Overlap::Bits256, 256)];

/// Compares the kernel with counts of single samples: nearly all receivers must have the same, none may be far off; where the light
/// is cut, two may, that lie next to a face which cuts it and see it nearly edge-on.
fn agree(what: &str, input: &ShadowInput) {
    let occluders = Occluders::from_input(input);
    let outline = input.light_shape.outline();
    let turns = turns(outline);
    for (overlap, count) in BITS {
        let places = places(outline, count);
        let found = Run::with(input, overlap, On::Host(HostSimd::detect(), 2)).visibility();
        let (mut other, mut far) = (0, 0);
        for (i, found) in found.iter().enumerate() {
            let p = Vec3::from(input.receivers[i]).as_dvec3();
            let places = turned(&places, &turns, input.receiver_pixel.at(i));
            let covered = occluders.covered_samples(p, input.receiver_triangle[i], &places);
            let samples = (f64::from(*found) * f64::from(count) - (f64::from(count) - covered as f64)).abs();
            other += usize::from(samples > 0.01);
            far += usize::from(samples > 2.01);
        }
        let all = found.len();
        let (most, most_far) = if input.cut.is_empty() { (all / 50, 0) } else { (all / 25, 2) };
        assert!(
            other <= most && far <= most_far,
            "{what}, {count} samples: {other} of {all} differ, {far} by more than two"
        );
    }
}

#[test]
fn random_scenes_have_the_samples_covered_that_are() {
    for seed in 0..20 {
        let (mesh, receivers) = random_scene(seed, 400);
        for radius in [1e-3, 0.02, 0.1, 0.4, 2.0] {
            agree(&format!("seed {seed}, radius {radius}"), &input(mesh.clone(), sphere(radius), &receivers));
        }
        let light = Light::Disc { center: Default::default(), normal: Random(seed).vector(), radius: 0.3 };
        agree(&format!("disc, seed {seed}"), &input(mesh.clone(), light, &receivers));
        let (half_u, half_v) = (DVec3::new(0.3, 0.1, 0.0), DVec3::new(0.0, 0.05, -0.2));
        let light = Light::Rect { center: DVec3::ZERO, half_u, half_v };
        // In the plane of the light, but for rounding, it is a line, and its places are rounding.
        let across = half_u.cross(half_v).normalize();
        let (beside, within): (Vec<_>, Vec<_>) =
            receivers.iter().copied().partition(|(p, _)| p.dot(across).abs() > 1e-5 * p.length());
        assert!(within.len() <= 1, "seed {seed}: {} receivers in the plane of the light", within.len());
        agree(&format!("rectangle, seed {seed}"), &input(mesh.clone(), light, &beside));
        let light = Light::Linear { p0: -half_u, p1: half_u };
        agree(&format!("line, seed {seed}"), &input(mesh, light, &receivers));
    }
}

/// Compares what objects hide with brute force: hardly a receiver may be off.
fn objects_agree(what: &str, input: &ShadowInput) {
    let occluders = Occluders::from_input(input);
    for (overlap, rule) in [(Overlap::Product, ObjectRule::Product), (Overlap::Max, ObjectRule::Max)] {
        let found = Run::with(input, overlap, On::Host(HostSimd::detect(), 2)).visibility();
        let off = |i: usize| {
            let p = Vec3::from(input.receivers[i]).as_dvec3();
            let visible = occluders.visibility_by_object(p, input.receiver_triangle[i], rule);
            (visible - f64::from(found[i])).abs()
        };
        let off: Vec<f64> = (0..found.len()).map(off).collect();
        let other = off.iter().filter(|off| **off > 1e-3).count();
        let most = off.iter().copied().fold(0.0, f64::max);
        assert!(other <= found.len() / 200, "{what}, {overlap:?}: {other} differ, by {most} at most");
    }
}

#[test]
fn objects_hide_together_what_brute_force_says_in_whatever_order_their_triangles_are() {
    for seed in 0..20 {
        let (mesh, receivers) = random_scene(seed, 400);
        let mut shuffled = mesh.clone();
        // Triangles of an object far from one another in the order, so that the records of cells are in none.
        let count = mesh.triangles.len();
        let to = |t: usize| if count.is_multiple_of(7) { count - 1 - t } else { t * 7 % count };
        for (t, corners) in mesh.triangles.iter().enumerate() {
            shuffled.triangles[to(t)] = *corners;
        }
        let on = |t: u32| if t == u32::MAX { t } else { to(t as usize) as u32 };
        let moved: Vec<_> = receivers.iter().map(|(p, t)| (*p, on(*t))).collect();
        for radius in [0.02, 0.1, 0.4] {
            let what = format!("seed {seed}, radius {radius}");
            objects_agree(&what, &input(mesh.clone(), sphere(radius), &receivers));
            objects_agree(&format!("{what}, shuffled"), &input(shuffled.clone(), sphere(radius), &moved));
        }
        let (half_u, half_v) = (DVec3::new(0.3, 0.1, 0.0), DVec3::new(0.0, 0.05, -0.2));
        let light = Light::Rect { center: DVec3::ZERO, half_u, half_v };
        objects_agree(&format!("rectangle, seed {seed}"), &input(mesh, light, &receivers));
    }
    for (name, size) in [("tiny", (64, 48)), ("table", (64, 48)), ("saloon-small", (40, 30))] {
        objects_agree(name, &shipped(name, Some(size)).2);
    }
}

#[test]
fn one_object_hides_by_every_rule_what_its_sum_is() {
    let mut mesh = Mesh::default();
    add_box(&mut mesh, DVec3::new(-0.2, -1.0, -0.2), DVec3::new(0.4, 0.3, 0.5));
    let mut random = Random(2);
    let receivers: Vec<_> = (0..2000).map(|_| (random.vector() * 2.0, u32::MAX)).collect();
    let input = input(mesh, sphere(0.2), &receivers);
    let picture = |overlap| Run::with(&input, overlap, On::Host(HostSimd::detect(), 1)).visibility();
    let sum = picture(Overlap::Sum);
    for overlap in [Overlap::Product, Overlap::Max] {
        for (sum, found) in sum.iter().zip(picture(overlap)) {
            assert!((sum - found).abs() < 1e-6, "{overlap:?}: {found}, by sums {sum}");
        }
    }
}

#[test]
fn scenes_have_the_samples_covered_that_are() {
    for (name, size) in [("tiny", (64, 48)), ("table", (64, 48)), ("saloon-small", (40, 30))] {
        agree(name, &shipped(name, Some(size)).2);
    }
}

/// The oracles know what several occluders hide together, and what the sum of their parts makes of it.
#[test]
fn occluders_together_hide_what_the_oracles_say() {
    for case in cases("overlap") {
        let polygons = loops(&case["inputs"]["polygons"]);
        let input = of_loops(&polygons, DVec2::ZERO);
        let expected = |what: &str| case["expected"][what].as_f64().expect("a number");
        for on in back_ends() {
            let covered = |overlap| 1.0 - f64::from(Run::with(&input, overlap, on).visibility()[0]);
            let sum = covered(Overlap::Sum);
            assert!((sum - expected("sum_clamped")).abs() < 4e-6, "{}: sum {sum}", case["id"]);
            for (overlap, rule) in [(Overlap::Product, "product"), (Overlap::Max, "max")] {
                let covered = covered(overlap);
                assert!((covered - expected(rule)).abs() < 4e-6, "{}: {rule} {covered}", case["id"]);
            }
            // What a spiral makes of one edge is 0.27 n^(-3/4) off, root mean square [algorithms, 0].
            for (overlap, count) in BITS {
                let off = (covered(overlap) - expected("exact")).abs();
                let most = 3.0 * 0.27 * f64::from(count).powf(-0.75) * (polygons.len() as f64).sqrt();
                assert!(off < most, "{}: {count} samples are {off} off, at most {most}", case["id"]);
            }
        }
    }
}

/// Without a penumbra there is nothing to compare: the picture is that of the sum, bit by bit.
#[test]
fn a_point_light_has_one_picture() {
    let (mesh, receivers) = random_scene(7, 500);
    let input = input(mesh, sphere(0.0), &receivers);
    let picture = |overlap| Run::with(&input, overlap, On::Host(HostSimd::detect(), 1)).visibility();
    let sum = picture(Overlap::Sum);
    for overlap in Overlap::ALL {
        assert_eq!(picture(overlap), sum);
    }
}
