//! What sums are kept in and how angles are taken: rounding to the last bit, and what each costs a picture.

mod common;

use common::{
    Lanewise, On, Random, Run, back_ends, cases, evaluate, input, of_loops, power_of_ten, random_scene,
    shipped, sphere,
};
use lrbsim_isa::{HostSimd, Vpu};
use lrbsim_kernels::irregular::primitives::Form;
use lrbsim_kernels::segment::{Angle, acos};
use lrbsim_kernels::sism::kept::Kept;
use lrbsim_kernels::sism::{Choices, Overlap};
use lrbsim_workloads::glam::DVec2;
use lrbsim_workloads::reference::{ErrorMetrics, Occluders};

const KEPT: [Kept; 5] = [Kept::Fixed, Kept::F32, Kept::Bf16, Kept::F16, Kept::F16Truncating];

/// The sum of two numbers in a format.
#[derive(Clone)]
struct Sum(Kept);

impl Lanewise<2, 1> for Sum {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [a, b]: [V::F32; 2]) -> [V::F32; 1] {
        [self.0.sum(v, a, b)]
    }
}

/// The number of a format that a float becomes.
#[derive(Clone)]
struct Rounded(Kept);

impl Lanewise<1, 1> for Rounded {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [x]: [V::F32; 1]) -> [V::F32; 1] {
        [self.0.rounded(v, x)]
    }
}

#[test]
fn floats_of_16_bits_add_up_to_what_the_oracles_say() {
    let all = cases("fp16_add");
    let inputs: Vec<[f32; 2]> =
        all.iter().map(|c| ["a", "b"].map(|x| c["inputs"][x].as_f64().expect("a number") as f32)).collect();
    for (kept, what) in [(Kept::F16, "rne"), (Kept::F16Truncating, "trunc")] {
        for (case, [found]) in all.iter().zip(evaluate(&Sum(kept), &inputs)) {
            assert_eq!(Some(f64::from(found)), case["expected"][what].as_f64(), "{} {what}", case["id"]);
        }
    }
}

/// `x`, which f64 holds exactly, in a format of 16 bits, by the definition.
fn defined(kept: Kept, x: f64) -> f64 {
    let (digits, least) = if kept == Kept::Bf16 { (7, -126) } else { (10, -14) };
    if x == 0.0 {
        return 0.0;
    }
    let exponent = (x.abs().log2().floor() as i32).max(least);
    // Exact: a power of two.
    let unit = 2.0_f64.powi(exponent - digits);
    let multiple = x / unit;
    unit * if kept == Kept::F16Truncating { multiple.trunc() } else { multiple.round_ties_even() }
}

#[test]
fn rounding_is_that_of_the_formats_to_the_last_bit() {
    let mut random = Random(16);
    for kept in [Kept::Bf16, Kept::F16, Kept::F16Truncating] {
        let mut value = || {
            let sign = if random.unit() < 0.5 { -1.0 } else { 1.0 };
            (sign * power_of_ten(random.within(-9.0, 3.0)) * random.unit()) as f32
        };
        let mut values: Vec<[f32; 1]> = (0..40_000).map(|_| [value()]).collect();
        // Ties, and numbers next to powers of two.
        for k in -30..12 {
            for near in [1.0, 1.0 + 1.0 / 2048.0, 1.0 + 3.0 / 2048.0, 1.0 + 1.0 / 256.0, 1.0 - 1.0 / 4096.0] {
                let x = 2.0_f32.powi(k) * near;
                values.extend([x, -x, x.next_up(), x.next_down()].map(|x| [x]));
            }
        }
        for ([x], [found]) in values.iter().zip(evaluate(&Rounded(kept), &values)) {
            assert_eq!(f64::from(found), defined(kept, f64::from(*x)), "{kept:?} of {x:e}");
        }
        let pairs: Vec<[f32; 2]> =
            (0..40_000).map(|_| [value(), value()].map(|x| defined(kept, f64::from(x)) as f32)).collect();
        for ([a, b], [found]) in pairs.iter().zip(evaluate(&Sum(kept), &pairs)) {
            let sum = f64::from(*a) + f64::from(*b);
            // Of bf16, sums that f64 itself rounds are left out.
            if sum - f64::from(*a) == f64::from(*b) {
                assert_eq!(f64::from(found), defined(kept, sum), "{kept:?}: {a:e} + {b:e}");
            }
        }
    }
}

#[derive(Clone)]
struct Acos;

impl Lanewise<1, 1> for Acos {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [x]: [V::F32; 1]) -> [V::F32; 1] {
        [acos(v, x)]
    }
}

#[test]
fn the_arcus_cosine_is_right_and_what_is_no_cosine_has_one() {
    let values: Vec<[f32; 1]> = (-4000..=4000).map(|i| [i as f32 / 4000.0]).collect();
    for ([x], [found]) in values.iter().zip(evaluate(&Acos, &values)) {
        assert!((f64::from(found) - f64::from(*x).acos()).abs() < 4e-7, "acos {x} is {found}");
    }
    let odd = [1.0_f32.next_up(), (-1.0_f32).next_down(), 2.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let found = evaluate(&Acos, &odd.map(|x| [x]));
    let pi = core::f32::consts::PI;
    assert_eq!(found.concat(), [0.0, pi, 0.0, 0.0, 0.0, pi]);
}

/// What a disc of so many edges covers in one setting, and what it does cover.
fn circle(edges: u32, choices: Choices) -> (f64, f64) {
    let points = (0..edges)
        .map(|i| {
            let angle = core::f64::consts::TAU * f64::from(i) / f64::from(edges);
            DVec2::from([0.25 + 0.6 * angle.cos(), 0.1 + 0.6 * angle.sin()].map(|x| f64::from(x as f32)))
        })
        .collect();
    let input = of_loops(&[points], DVec2::ZERO);
    let run = Run::with(&input, choices, On::Host(HostSimd::detect(), 1));
    let receiver = lrbsim_workloads::glam::Vec3::from(input.receivers[0]).as_dvec3();
    let (truth, found) =
        (Occluders::from_input(&input).visibility_at(receiver, u32::MAX), f64::from(run.visibility()[0]));
    (found, truth)
}

/// The table of docs/accuracy.md: what a disc is off by, whose edges become many and short.
#[test]
fn a_disc_of_many_edges_is_off_by_what_the_table_says() {
    // Of 4, 64, 1024, 4096, 16384 and 65536 edges, at most.
    for (kept, angle, most) in [
        (Kept::Fixed, Angle::Atan2, [1e-6, 1e-6, 1e-6, 2e-6, 2e-6, 4e-6]),
        (Kept::F32, Angle::Atan2, [1e-6, 1e-6, 1e-6, 2e-6, 4e-6, 1e-5]),
        (Kept::Bf16, Angle::Atan2, [3e-3, 8e-3, 0.2, 0.6, 0.65, 0.65]),
        (Kept::F16, Angle::Atan2, [1e-3, 2e-3, 1e-2, 0.2, 0.5, 0.65]),
        (Kept::F16Truncating, Angle::Atan2, [2e-3, 1e-2, 0.2, 0.4, 0.6, 0.65]),
        (Kept::Fixed, Angle::Acos, [1e-6, 2e-6, 1e-4, 1e-3, 5e-3, 0.4]),
    ] {
        let mut row = Vec::new();
        for (edges, most) in [4, 64, 1024, 4096, 16_384, 65_536].into_iter().zip(most) {
            let choices = Choices { sums: kept, angle, ..Overlap::Sum.into() };
            let (found, truth) = circle(edges, choices);
            let off = found - truth;
            row.push(format!("{off:+.1e}"));
            // What loses terms has lost the better part of them in the end.
            assert!(edges < 65_536 || most < 0.1 || off.abs() > 0.1, "{kept:?} {angle:?}: only {off} off");
            assert!(
                (found - truth).abs() <= most,
                "{kept:?} {angle:?}, {edges} edges: {found}, truth {truth}"
            );
        }
        println!("| {kept:?} {angle:?} | {} |", row.join(" | "));
    }
}

/// The other table of docs/accuracy.md: scenes against brute force in f64.
#[test]
fn scenes_are_off_by_what_the_table_says() {
    for (name, size) in [
        ("tiny", None),
        ("table", Some((96, 72))),
        ("saloon-small", Some((80, 60))),
        ("fern", Some((80, 60))),
    ] {
        let input = shipped(name, size).2;
        let truth = Occluders::from_input(&input).visibility(&input);
        for (kept, angle, most) in [
            (Kept::Fixed, Angle::Atan2, 5e-7),
            (Kept::F32, Angle::Atan2, 5e-7),
            (Kept::Bf16, Angle::Atan2, 5e-3),
            (Kept::F16, Angle::Atan2, 1e-3),
            (Kept::F16Truncating, Angle::Atan2, 2e-2),
            (Kept::Fixed, Angle::Acos, 5e-5),
        ] {
            let choices = Choices { sums: kept, angle, ..Overlap::Sum.into() };
            let run = Run::with(&input, choices, On::Host(HostSimd::detect(), 2));
            let found: Vec<f64> = run.visibility().into_iter().map(f64::from).collect();
            let metrics = ErrorMetrics::new(&truth, &found);
            println!(
                "| {name} | {kept:?} {angle:?} | {:.1e} | {:.1e} | {:.1e} | {:+.1e} | {} |",
                metrics.atty_mae, metrics.p99, metrics.max, metrics.bias, run.phases["soft"]
            );
            assert!(metrics.atty_mae <= most, "{name} {kept:?} {angle:?}: {metrics:?}");
        }
    }
}

#[test]
fn every_setting_is_one_picture_on_all_back_ends_and_no_nan() {
    for seed in 0..3 {
        let (mesh, receivers) = random_scene(seed, 120);
        for radius in [0.1, 2.0] {
            let input = input(mesh.clone(), sphere(radius), &receivers);
            for form in [Form::Exact, Form::Printed] {
                for angle in [Angle::Atan2, Angle::Acos] {
                    for sums in KEPT {
                        let choices = Choices { overlap: Overlap::Sum, form, sums, angle };
                        let mut pictures =
                            back_ends().into_iter().map(|on| Run::with(&input, choices, on).visibility());
                        let first = pictures.next().expect("a back end");
                        assert!(pictures.all(|other| other == first), "{choices:?}, seed {seed}");
                    }
                }
            }
        }
    }
}
