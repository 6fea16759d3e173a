//! What the soft kernel keeps its sums in: fixed point, or floats of 32 or 16 bits as a cheaper machine would.
//!
//! Sums in fixed point are the same in any order; those in floats depend on it, which a run repeats all the same. A term is
//! rounded to the format, and so is each sum. Registers hold 32 bits: a float of 16 bits is an f32 that it can stand for, and
//! rounding takes the operations of [`Kept::rounded`], which the machine is charged for; a chip with conversions or arithmetic of
//! that width would save them.

use lrbsim_isa::Vpu;

use super::soft::WHOLE;
use crate::expression::{each, int};
use crate::field;
use crate::irregular::primitives::EdgeRecord;
use crate::plane::{Vec3, side};
use crate::record::Record;

/// What sums of parts are kept in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kept {
    /// Whole numbers of 2^-24 of the light.
    #[default]
    Fixed,
    /// Floats of 32 bits.
    F32,
    /// Floats of 16 bits, 8 of them of exponent, rounded to the nearest, ties to even.
    Bf16,
    /// Floats of 16 bits, 5 of them of exponent, rounded to the nearest, ties to even.
    F16,
    /// Floats of 16 bits, 5 of them of exponent, rounded towards 0 [atty06, App. A].
    F16Truncating,
}

/// Least normal float of 16 bits with 5 of exponent.
const F16_NORMAL_MIN: f32 = 1.0 / (1 << 14) as f32;

/// Greatest of them.
const F16_MAX: f32 = 65_504.0;

impl Kept {
    /// Adds part `f` to sums in this format, see [`super::soft::add_part`]; not for fixed point.
    #[inline(always)]
    pub(super) fn add<V: Vpu>(
        self,
        v: &mut V,
        live: V::Mask,
        f: V::F32,
        points: Vec3<V>,
        edge: Record<V, EdgeRecord>,
        coverage: [V::I32; 2],
    ) -> [V::I32; 2] {
        let normal = edge.vec3(v, field!(EdgeRecord.normal));
        let side = side(v, points, normal);
        let none = v.vset_i32(0);
        let zero = v.vset_f32(0.0);
        let left = v.vicmp_ge(side, none);
        let signed = v.vsub_or(f, left, zero, f);
        let front = edge.int(v, field!(EdgeRecord.weights[0]));
        let back = edge.int(v, field!(EdgeRecord.weights[1]));
        each!(part in [(coverage[0], front), (coverage[1], back)] => {
            let (before, weight) = part;
            let weight = v.vcvt_i32_f32(weight);
            let term = v.vmul(signed, weight);
            let term = self.rounded(v, term);
            let sum = v.from_bits(before);
            let sum = self.sum(v, sum, term);
            let sum = v.bits_of(sum);
            v.vblend_i32(live, sum, before)
        })
    }

    /// The sum of two numbers of this format, rounded once.
    ///
    /// f32 holds more than twice the digits of the 16 bits: rounding to the nearest twice is as good as once. Towards 0 it is
    /// not: where f32 has rounded away from 0, the sum is a bit too large.
    #[inline(always)]
    pub fn sum<V: Vpu>(self, v: &mut V, a: V::F32, b: V::F32) -> V::F32 {
        let mut sum = v.vadd(a, b);
        if self == Kept::F16Truncating {
            // What the sum lacks, exactly: the two-sum of Knuth.
            let of_b = v.vsub(sum, a);
            let of_a = v.vsub(sum, of_b);
            let lost_b = v.vsub(b, of_b);
            let lost_a = v.vsub(a, of_a);
            let lost = v.vadd(lost_a, lost_b);
            let against = v.vmul(lost, sum);
            let zero = v.vset_f32(0.0);
            let too_large = v.vcmp_lt(against, zero);
            let one = v.vset_i32(1);
            let bits = v.bits_of(sum);
            let bits = v.visub_or(bits, too_large, bits, one);
            sum = v.from_bits(bits);
        }
        self.rounded(v, sum)
    }

    /// The number `x` of this format. 6 operations in bf16, 12 in f16 to the nearest, 16 towards 0; constants are among them.
    #[inline(always)]
    pub fn rounded<V: Vpu>(self, v: &mut V, x: V::F32) -> V::F32 {
        match self {
            Kept::Fixed | Kept::F32 => x,
            Kept::Bf16 => nearest(v, x, 7, None),
            Kept::F16 => nearest(v, x, 10, Some(F16_NORMAL_MIN)),
            Kept::F16Truncating => {
                let bits = v.bits_of(x);
                let kept = v.vset_i32(!0x1fff);
                let normal = int!(v, bits & kept);
                let normal = v.from_bits(normal);
                // Below the normal ones, multiples of 2^-24.
                let whole = v.vset_f32(WHOLE);
                let unit = v.vset_f32(1.0 / WHOLE);
                let multiple = v.vmul(x, whole);
                let multiple = v.vcvt_f32_i32(multiple);
                let multiple = v.vcvt_i32_f32(multiple);
                let small = v.vmul(multiple, unit);
                let size = v.vabs(x);
                let least = v.vset_f32(F16_NORMAL_MIN);
                let is_small = v.vcmp_lt(size, least);
                let rounded = v.vblend_f32(is_small, small, normal);
                within(v, rounded)
            }
        }
    }

    /// A sum of this format in fixed point, for composition: nothing is lost that f32 would keep beside a layer.
    #[inline(always)]
    pub fn in_fixed_point<V: Vpu>(self, v: &mut V, sum: V::I32) -> V::I32 {
        if self == Kept::Fixed {
            return sum;
        }
        let sum = v.from_bits(sum);
        let whole = v.vset_f32(WHOLE);
        let scaled = v.vmul(sum, whole);
        let rounded = v.vround(scaled);
        v.vcvt_f32_i32(rounded)
    }
}

/// `x` rounded to so many `digits` after the leading one, ties to even; below `least` to those of numbers there.
///
/// A number is added, and taken away again, whose last bit in f32 is worth what the last digit is to be worth.
#[inline(always)]
fn nearest<V: Vpu>(v: &mut V, x: V::F32, digits: i32, least: Option<f32>) -> V::F32 {
    let exponent = v.vset_i32(0x7f80_0000);
    let bits = v.bits_of(x);
    let leading = int!(v, bits & exponent);
    let mut leading = v.from_bits(leading);
    if let Some(least) = least {
        let least = v.vset_f32(least);
        leading = v.vmax(leading, least);
    }
    let shift = v.vset_f32(1.5 * (1 << (23 - digits)) as f32);
    let large = v.vmul(leading, shift);
    let sum = v.vadd(x, large);
    let rounded = v.vsub(sum, large);
    if least.is_some() { within(v, rounded) } else { rounded }
}

/// `x`, but no larger than a float of 16 bits can be: so that there is no infinity, of which two would make a NaN.
#[inline(always)]
fn within<V: Vpu>(v: &mut V, x: V::F32) -> V::F32 {
    let most = v.vset_f32(F16_MAX);
    let least = v.vset_f32(-F16_MAX);
    let x = v.vmin(x, most);
    v.vmax(x, least)
}
