//! The math library against f64.

use super::{Random, levels};
use crate::arena::{Addr, Arena};
use crate::emit::OpCounts;
use crate::kernel::{AnyKernel, Kernel};
use crate::vpu::{Compare, Vpu};

/// Evaluates one function of the math library on all words of two arrays.
struct Math {
    function: u8,
    count: u32,
    a: Addr,
    b: Addr,
    out: Addr,
}

impl Kernel for Math {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, mut i: V::S32) {
        let all = v.mask_all();
        let (step, end) = (v.s_imm(16), v.s_imm(self.count as i32));
        while v.branch(Compare::Less, i, end) {
            let (a, b) = (v.vload_f32(self.a, i), v.vload_f32(self.b, i));
            let result = match self.function {
                0 => crate::math::div(v, a, b),
                1 => crate::math::sqrt(v, a),
                2 => crate::math::atan2(v, a, b),
                3 => crate::math::reduce_add(v, a),
                4 => crate::math::reduce_min(v, a),
                _ => crate::math::reduce_max(v, a),
            };
            v.vstore_f32(all, self.out, i, result);
            i = v.s_add(i, step);
        }
    }
}

fn evaluate(function: u8, a: &[f32], b: &[f32]) -> Vec<f32> {
    let mut arena = Arena::new();
    let mut padded = |values: &[f32]| {
        let mut values = values.to_vec();
        values.resize(values.len().next_multiple_of(16), 1.0);
        arena.alloc_f32(&values)
    };
    let (at_a, at_b) = (padded(a), padded(b));
    let count = a.len().next_multiple_of(16) as u32;
    let out = arena.overwritten(u64::from(count));
    let kernel = Math { function, count, a: at_a, b: at_b, out };
    let mut results: Option<Vec<u32>> = None;
    for simd in levels() {
        AnyKernel::run(&kernel, simd, &arena, 0..1, false, &mut OpCounts::default());
        let bits = arena.read_u32s(out, a.len());
        assert!(bits == *results.get_or_insert(bits.clone()), "function {function} on {simd}");
    }
    results.unwrap_or_default().into_iter().map(f32::from_bits).collect()
}

/// Error of `found` in units in the last place of `right`, which is normal.
fn ulps(found: f32, right: f64) -> f64 {
    let unit = f64::from(f32::from_bits((right as f32).to_bits() & 0x7f80_0000)) * f64::from(f32::EPSILON);
    (f64::from(found) - right).abs() / unit
}

/// A float of either sign with a binary exponent in `exponents`.
fn float_in(random: &mut Random, exponents: core::ops::Range<i32>) -> f32 {
    let exponent = exponents.start + random.below((exponents.end - exponents.start) as u32) as i32;
    let word = random.word();
    f32::from_bits(word & 0x807f_ffff | ((exponent + 127) as u32) << 23)
}

const SAMPLES: usize = 400_000;

#[test]
fn division_is_within_one_ulp() {
    let mut random = Random(3);
    let (mut a, mut b) = (Vec::new(), Vec::new());
    while a.len() < SAMPLES {
        let (x, y) = (float_in(&mut random, -102..128), float_in(&mut random, -126..128));
        let quotient = (f64::from(x) / f64::from(y)).abs();
        if (1.2e-38..3.4e38).contains(&quotient) {
            a.push(x);
            b.push(y);
        }
    }
    let worst = evaluate(0, &a, &b)
        .into_iter()
        .enumerate()
        .map(|(i, found)| (ulps(found, f64::from(a[i]) / f64::from(b[i])), i))
        .fold((0.0, 0), |worst, this| if this.0 <= worst.0 { worst } else { this });
    assert!(worst.0 <= 1.0, "{} ulp for {:e} / {:e}", worst.0, a[worst.1], b[worst.1]);
    let special = evaluate(0, &[1.0, 0.0, -0.0], &[0.0, 3.0, 3.0]);
    assert!(special[0].is_nan() && special[1] == 0.0 && special[2] == 0.0);
}

#[test]
fn square_root_is_within_one_ulp() {
    let mut random = Random(4);
    let mut a: Vec<f32> = (0..SAMPLES).map(|_| float_in(&mut random, -102..128).abs()).collect();
    a.extend([2f32.powi(-102), 1.0, 4.0, f32::MAX]);
    for (a, found) in a.iter().zip(evaluate(1, &a, &a)) {
        let error = ulps(found, f64::from(*a).sqrt());
        assert!(error <= 1.0, "{error} ulp for sqrt({a:e})");
    }
    let special = evaluate(1, &[0.0, -1.0, f32::INFINITY], &[0.0; 3]);
    assert!(special[0] == 0.0 && special[1].is_nan() && special[2].is_nan());
}

#[test]
fn atan2_is_right_in_all_octants() {
    let mut random = Random(5);
    let mut points = Vec::new();
    for _ in 0..SAMPLES {
        // Near each other, far apart, and anywhere on a circle.
        let x = float_in(&mut random, -60..60);
        let angle = random.word() as f32 * 1.5e-9;
        points.push((x, x * float_in(&mut random, -3..4)));
        points.push((x, float_in(&mut random, -60..60)));
        points.push((x * angle.sin(), x * angle.cos()));
    }
    let extremes = [0.0, 1.0, -1.0, 1e-30, -1e-30, 1e37, -1e37, 0.414_213_57, 2.414_213_6];
    for y in extremes {
        points.extend(extremes.map(|x| (y, x)));
    }
    let (y, x): (Vec<f32>, Vec<f32>) = points.into_iter().unzip();
    let (mut absolute, mut relative) = (0.0f64, 0.0f64);
    for (i, found) in evaluate(2, &y, &x).into_iter().enumerate() {
        let right = f64::from(y[i]).atan2(f64::from(x[i]));
        let error = (f64::from(found) - right).abs();
        assert!(error <= 4e-7, "atan2({:e}, {:e}) is {found}; it must be {right}", y[i], x[i]);
        absolute = absolute.max(error);
        // Below that the angle is denormal.
        if right.abs() > 1.2e-38 {
            relative = relative.max(error / right.abs());
        }
    }
    eprintln!("atan2: absolute {absolute:e}, relative {relative:e}");
    assert!(absolute <= 3e-7 && relative <= 4e-7, "absolute {absolute:e}, relative {relative:e}");
}

#[test]
fn reductions_hold_in_every_lane() {
    let a: Vec<f32> = (0..16).map(|i| ((i * 7) % 16) as f32).collect();
    assert_eq!(evaluate(3, &a, &a), [120.0; 16]);
    assert_eq!(evaluate(4, &a, &a), [0.0; 16]);
    assert_eq!(evaluate(5, &a, &a), [15.0; 16]);
}
