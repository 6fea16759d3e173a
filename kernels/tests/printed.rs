//! The printed form: kernel, brute force in f64, and how far the two of them are from the exact form.

mod common;

use common::{
    Lanewise, On, Random, Run, add_triangle, back_ends, cases, evaluate, input, polygons, power_of_ten,
    random_scene, shipped, sphere, vec3,
};
use lrbsim_isa::{HostSimd, Vpu};
use lrbsim_kernels::irregular::primitives::Form;
use lrbsim_kernels::segment::{Angle, sector_less_triangle};
use lrbsim_kernels::sism::kept::Kept;
use lrbsim_kernels::sism::{Choices, Overlap};
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::reference::{AsPrinted, ErrorMetrics, ImagePlane, ObjectRule, Occluders};
use lrbsim_workloads::{Light, ShadowInput};
use serde_json::Value;

const PRINTED: Choices =
    Choices { overlap: Overlap::Sum, form: Form::Printed, sums: Kept::Fixed, angle: Angle::Atan2 };

/// Runs the kernels; every receiver must have the sums that all edges on its face give, bit by bit.
fn agree(what: &str, input: &ShadowInput) -> Run {
    common::agree(what, input, PRINTED)
}

#[test]
fn no_edge_is_missed_in_shipped_scenes() {
    for (name, size) in [("tiny", None), ("saloon-small", Some((96, 72))), ("table", Some((128, 96)))] {
        agree(name, &shipped(name, size).2);
    }
}

#[test]
fn no_edge_is_missed_by_lights_of_any_size() {
    for seed in 0..60 {
        let (mesh, receivers) = random_scene(seed, 700);
        for radius in [0.0, 1e-6, 1e-3, 0.02, 0.1, 0.4, 2.0, 10.0] {
            let what = format!("seed {seed}, radius {radius}");
            agree(&what, &input(mesh.clone(), sphere(radius), &receivers));
        }
    }
}

#[test]
fn no_edge_is_missed_very_near_the_light() {
    for seed in 200..240 {
        let mut random = Random(seed);
        let (mut mesh, receivers) = random_scene(seed, 500);
        let radius = power_of_ten(random.within(-5.0, -1.0));
        for _ in 0..20 {
            let near = random.vector().normalize() * radius * power_of_ten(random.within(-0.5, 2.0));
            let size = random.within(0.02, 1.0);
            add_triangle(&mut mesh, [near, near + random.vector() * size, near + random.vector() * size]);
        }
        agree(&format!("near, seed {seed}"), &input(mesh.clone(), sphere(radius), &receivers));
    }
}

#[test]
fn no_edge_is_missed_by_far_lights_or_where_faces_meet() {
    for seed in 300..330 {
        let mut random = Random(seed);
        let (mesh, mut receivers) = random_scene(seed, 500);
        let center = random.vector().normalize() * 1e3;
        for radius in [0.0, 1.0, 50.0, 300.0] {
            let light = Light::Sphere { center, radius };
            agree(&format!("far, seed {seed}, radius {radius}"), &input(mesh.clone(), light, &receivers));
        }
        for (i, (p, _)) in receivers.iter_mut().enumerate() {
            // Two or three components of one size.
            let size = p.abs().max_element();
            match i % 3 {
                0 => p.x = p.x.signum() * p.y.abs(),
                1 => p.z = p.z.signum() * size,
                _ => *p = p.signum() * size,
            }
        }
        agree(&format!("seams, seed {seed}"), &input(mesh, sphere(0.15), &receivers));
    }
}

/// Only rounding parts the kernel from f64.
fn only_rounding(name: &str, size: Option<(u32, u32)>) {
    let input = shipped(name, size).2;
    let run = Run::with(&input, PRINTED, On::Host(HostSimd::detect(), 2));
    let truth = AsPrinted(&Occluders::from_input(&input)).visibility(&input);
    common::only_rounding(name, &truth, &run.visibility());
}

#[test]
fn scenes_are_right_but_for_rounding() {
    for (name, size) in [("tiny", None), ("table", Some((96, 72))), ("saloon-small", Some((80, 60)))] {
        only_rounding(name, size);
    }
}

#[test]
fn objects_are_told_apart_in_this_form_too() {
    for seed in 0..12 {
        let (mesh, receivers) = random_scene(seed, 400);
        let input = input(mesh, sphere(0.1), &receivers);
        let occluders = Occluders::from_input(&input);
        for (overlap, rule) in [(Overlap::Product, ObjectRule::Product), (Overlap::Max, ObjectRule::Max)] {
            let truth = AsPrinted(&occluders).visibility_by_object(&input, rule);
            let choices = Choices { overlap, ..PRINTED };
            let found = Run::with(&input, choices, On::Host(HostSimd::detect(), 2)).visibility();
            let off = |(truth, found): (&f64, &f32)| (truth - f64::from(*found)).abs() > 1e-3;
            let other = truth.iter().zip(&found).filter(|pair| off(*pair)).count();
            assert!(other <= 4, "seed {seed}, {overlap:?}: {other} of {} differ", found.len());
        }
    }
}

#[test]
fn all_back_ends_have_one_picture() {
    let (mesh, receivers) = random_scene(5, 600);
    let input = input(mesh, sphere(0.1), &receivers);
    let first = Run::with(&input, PRINTED, On::Host(HostSimd::detect(), 1));
    for on in back_ends() {
        let run = Run::with(&input, PRINTED, on);
        assert_eq!((run.visibility(), run.sums()), (first.visibility(), first.sums()), "{on:?}");
    }
}

/// The occluders of an oracle's scene, the position of its receiver, and its radius.
fn scene(case: &Value) -> (Vec<Vec<DVec3>>, DVec3, DVec3, f64) {
    let inputs = &case["inputs"];
    let polygon = |polygon: &Value| polygon.as_array().expect("corners").iter().map(vec3).collect();
    let polygons = inputs["polygons"].as_array().expect("polygons").iter().map(polygon).collect();
    (polygons, vec3(&inputs["light"]), vec3(&inputs["p"]), inputs["r"].as_f64().expect("a radius"))
}

/// What a sum of layers and parts covers by Eq. 4, which the oracles clamp as it is printed: a negative sum is nothing.
fn clamped((front, back): (f64, f64)) -> f64 {
    front.max(back).clamp(0.0, 1.0)
}

/// The sums of the only receiver, as the kernels left them.
fn sums_of_one(run: &Run) -> (f64, f64) {
    let [layers_front, layers_back, front, back] = run.sums()[&0];
    let sum = |layers: i32, part: i32| f64::from(layers) + f64::from(part) / f64::from(1 << 24);
    (sum(layers_front, front), sum(layers_back, back))
}

/// `sism_per_edge_R` of the oracles is this form, with Eq. 4 as it is printed.
#[test]
fn scene_oracles_have_what_the_printed_form_makes_of_them() {
    let mut by_kernel = 0;
    for case in cases("scene3d") {
        let Some(expected) = case["expected"]["sism_per_edge_R"].as_f64() else { continue };
        let (corners, center, p, radius) = scene(&case);
        let light = Light::Sphere { center, radius };
        let input = input(polygons(&corners), light, &[(p, u32::MAX)]);
        let occluders = Occluders::from_input(&input);
        let receiver = DVec3::from(input.receivers[0].map(f64::from));
        // The oracles have one view, along z, also of receivers that lie in another face.
        let plane = ImagePlane::along(DVec3::Z);
        let covered = clamped(AsPrinted(&occluders).sums(receiver, u32::MAX, plane));
        let tolerance = case["tolerance"]["f32"].as_f64().expect("a tolerance");
        assert!((covered - expected).abs() <= tolerance, "{}: {covered}, expected {expected}", case["id"]);
        let p = p - center;
        if p.z > p.x.abs().max(p.y.abs()) {
            by_kernel += 1;
            // Next to a contact the circle is of the size of 2^13 roundings of a position on the image plane, where the exact form
            // subtracts positions before it projects them.
            let most = if case["id"] == "receiver_in_a_contact_penumbra" { 4e-5 } else { tolerance };
            for on in back_ends() {
                let covered = clamped(sums_of_one(&Run::with(&input, PRINTED, on)));
                let off = (covered - expected).abs();
                assert!(off <= most, "{} {on:?}: {covered}, expected {expected}", case["id"]);
            }
        }
    }
    assert!(by_kernel > 10, "only {by_kernel} receivers lie in the face along z");
}

/// A nearly radial plate that light and receiver have on one side: the parts add up to less than nothing. Eq. 4 as printed clamps
/// that to 0, where 0.072 of the light is hidden; the size of the sum is what is hidden, in this form as in the exact one: only the edge
/// nearest to the light counts, which lies along the image plane, so that one depth for all of it is right.
#[test]
fn a_steep_plate_under_the_lamp_is_lost_by_the_clamp_of_eq_4() {
    let all = cases("scene3d");
    let case = all.iter().find(|case| case["id"] == "steep_edge_under_the_lamp").expect("it is there");
    let (corners, center, p, radius) = scene(case);
    let input = input(polygons(&corners), Light::Sphere { center, radius }, &[(p, u32::MAX)]);
    let run = Run::with(&input, PRINTED, On::Host(HostSimd::detect(), 1));
    let expected = |what: &str| case["expected"][what].as_f64().expect("a number");
    assert_eq!(clamped(sums_of_one(&run)), expected("sism_per_edge_R"));
    assert!((1.0 - f64::from(run.visibility()[0]) - expected("coverage_parallel")).abs() < 1e-6);
}

/// A plate under the light and a grid of receivers on a plane below it, all within 45 degrees of z.
fn plate(depths: [f64; 2], radius: f64) -> (ShadowInput, Occluders, Occluders) {
    let corners = [(-0.625, -0.5, 0), (0.75, -0.5, 1), (0.75, 0.5625, 1), (-0.625, 0.5625, 0)]
        .map(|(x, y, end)| DVec3::new(x, y, depths[end]));
    let receivers: Vec<_> = (0..120 * 120)
        .map(|i| {
            let at = |k: i32| (f64::from(k) + 0.5) / 120.0 * 7.9 - 3.95;
            (DVec3::new(at(i % 120), at(i / 120), 4.0), u32::MAX)
        })
        .collect();
    let mesh = polygons(&[corners.to_vec()]);
    let parallel = Light::Disc { center: DVec3::ZERO, normal: DVec3::Z, radius };
    let exact = Occluders::from_input(&input(mesh.clone(), parallel, &receivers));
    let input = input(mesh, sphere(radius), &receivers);
    let printed = Occluders::from_input(&input);
    (input, printed, exact)
}

/// Error of one circle per edge and receiver against each vertex by its own depth, for a disc along the image plane: harmless unless
/// the plate is steep and the light large [algorithms, 2.5, whose numbers these are but for the choice of receivers].
#[test]
fn one_circle_for_an_edge_errs_as_derived() {
    let table = [
        ([2.0, 3.0], 0.1, 0.00001, 0.0002),
        ([2.0, 3.0], 0.5, 0.0010, 0.009),
        ([2.0, 3.0], 1.0, 0.0042, 0.017),
        ([2.0, 3.0], 2.0, 0.012, 0.076),
        ([1.5, 3.5], 0.5, 0.0030, 0.016),
        ([1.2, 3.8], 0.5, 0.0046, 0.020),
    ];
    for (depths, radius, mean, max) in table {
        let (input, printed, exact) = plate(depths, radius);
        let truth = exact.visibility(&input);
        let metrics = ErrorMetrics::new(&truth, &AsPrinted(&printed).visibility(&input));
        let run = Run::with(&input, PRINTED, On::Host(HostSimd::detect(), 2));
        let kernel: Vec<f64> = run.visibility().into_iter().map(f64::from).collect();
        let of_kernel = ErrorMetrics::new(&truth, &kernel);
        for (what, found) in [("f64", metrics), ("kernel", of_kernel)] {
            println!(
                "depth {depths:?}, radius {radius}, {what}: {:.5} / {:.4}, derived {mean} / {max}",
                found.atty_mae, found.max
            );
            assert!(
                (found.atty_mae - mean).abs() <= 0.1 * mean + 1e-5,
                "{depths:?}, {radius}, {what}: {found:?}"
            );
            // The worst receiver of a grid is another on a finer one.
            assert!((found.max - max).abs() <= 0.2 * max + 0.0015, "{depths:?}, {radius}, {what}: {found:?}");
        }
    }
}

/// Largest error across one edge of a circle on the image plane, so far off the axis, against a disc that faces the receiver.
#[test]
fn a_circle_for_an_ellipse_errs_as_derived() {
    let table = [(10.0, 0.005), (20.0, 0.020), (30.0, 0.046), (45.0, 0.108), (54.7356, 0.167), (60.0, 0.205)];
    for (degrees, derived) in table {
        let error = off_axis_error(degrees);
        println!("{degrees} degrees: {error:.4}, derived {derived}");
        assert!((error - derived).abs() < 6e-4, "{degrees} degrees: {error}, derived {derived}");
    }
}

/// Receivers at this angle about z, an edge across their radius far longer than the light.
fn off_axis_error(degrees: f64) -> f64 {
    let (sin, cos) = f64::to_radians(degrees).sin_cos();
    let radius = 0.01;
    let p = DVec3::new(4.0 * sin / cos, 0.0, 4.0);
    let mut worst = 0.0_f64;
    for step in -200..=200 {
        // A half plane at half the depth, whose edge crosses the light's footprint.
        let x = 0.5 * p.x + f64::from(step) / 200.0 * 2.5 * radius;
        let corners = [(x, -40.0), (x + 80.0, -40.0), (x + 80.0, 40.0), (x, 40.0)];
        let corners = corners.map(|(x, y)| DVec3::new(x, y, 2.0)).to_vec();
        let input = input(polygons(&[corners]), sphere(radius), &[(p, u32::MAX)]);
        let occluders = Occluders::from_input(&input);
        let receiver = DVec3::from(input.receivers[0].map(f64::from));
        let printed = AsPrinted(&occluders).visibility_at(receiver, u32::MAX, ImagePlane::along(DVec3::Z));
        worst = worst.max((printed - occluders.visibility_at(receiver, u32::MAX)).abs());
    }
    worst
}

/// Eq. 3 from a signed distance and the signed ends of an edge, cut to the half chord.
#[derive(Clone)]
struct Eq3(Angle);

impl Lanewise<3, 1> for Eq3 {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [d, w0, w1]: [V::F32; 3]) -> [V::F32; 1] {
        let zero = v.vset_f32(0.0);
        let size = v.vabs(d);
        let size2 = v.vmul(size, size);
        let a = v.vsub(zero, w0);
        let part = sector_less_triangle(v, [size, size2], [a, w1], self.0);
        let inside = v.vcmp_lt(d, zero);
        [v.vsub_or(part, inside, zero, part)]
    }
}

#[test]
fn eq_3_is_what_the_oracles_say_with_either_angle() {
    let all = cases("eq3_printed");
    let of = |case: &Value, what: &str| case["inputs"][what].as_f64().expect("a number") as f32;
    let inputs: Vec<_> = all.iter().map(|c| ["d", "w0", "w1"].map(|what| of(c, what))).collect();
    for angle in [Angle::Atan2, Angle::Acos] {
        for (case, [found]) in all.iter().zip(evaluate(&Eq3(angle), &inputs)) {
            let expected = case["expected"]["V"].as_f64().expect("a number");
            let tolerance = case["tolerance"]["f32"].as_f64().expect("a tolerance");
            let off = (f64::from(found) - expected).abs();
            assert!(off <= tolerance, "{} {angle:?}: {found}, expected {expected}", case["id"]);
        }
    }
}
