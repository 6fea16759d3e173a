//! A small math library on top of the operations, with its errors.
//!
//! Errors are the largest seen over the stated range, in units in the last place (ulp) of the result, and are held by
//! tests.

use crate::vpu::Vpu;

/// `a / b`: reciprocal, one refinement of the quotient.
///
/// Within 1 ulp for `|a|` of at least 2^-102, normal `b` and a normal quotient; a zero of either sign for `a` = 0; a NaN
/// for `b` = 0, denormal or infinite. Four operations.
#[inline(always)]
pub fn div<V: Vpu>(v: &mut V, a: V::F32, b: V::F32) -> V::F32 {
    let reciprocal = v.vrcp(b);
    let quotient = v.vmul(a, reciprocal);
    let rest = v.vnmadd(quotient, b, a);
    v.vmadd(rest, reciprocal, quotient)
}

/// Square root: reciprocal square root, one refinement.
///
/// Within 1 ulp for `a` of at least 2^-102; 0 for 0; a NaN below 0 and for infinity.
#[inline(always)]
pub fn sqrt<V: Vpu>(v: &mut V, a: V::F32) -> V::F32 {
    let reciprocal = v.vrsqrt(a);
    let half = v.vset_f32(0.5);
    let root = v.vmul(a, reciprocal);
    let half_reciprocal = v.vmul(half, reciprocal);
    let rest = v.vnmadd(root, root, a);
    let refined = v.vmadd(rest, half_reciprocal, root);
    let zero = v.vset_f32(0.0);
    let is_zero = v.vcmp_eq(a, zero);
    v.vblend_f32(is_zero, a, refined)
}

/// Angle of the point (x, y) from the x axis in [-pi, pi]; 0 for the origin.
///
/// Absolute error at most 3e-7, and relative error at most 4e-7 of an angle that is normal, where the greater of |x| and
/// |y| lies in [2^-100, 2^126], and not for others. Zeros have no sign: (-1, -0) is at +pi. One reciprocal, a polynomial of degree 9 in the tangent
/// reduced to [-tan(pi/8), tan(pi/8)] (coefficients of Cephes `atanf`), and three foldings.
#[inline(always)]
pub fn atan2<V: Vpu>(v: &mut V, y: V::F32, x: V::F32) -> V::F32 {
    let abs_y = v.vabs(y);
    let (angle, high) = angle_above(v, abs_y, x);
    let zero = v.vset_f32(0.0);
    let below = v.vcmp_lt(y, zero);
    let angle = v.vsub_or(angle, below, zero, angle);
    let origin = v.vcmp_eq(high, zero);
    v.vblend_f32(origin, zero, angle)
}

/// Angle of the point (x, y) from the x axis in [0, pi], for `y` of at least 0: [`atan2`] but for the foldings that it needs no more. A NaN
/// for the origin.
#[inline(always)]
pub fn atan2_above<V: Vpu>(v: &mut V, y: V::F32, x: V::F32) -> V::F32 {
    angle_above(v, y, x).0
}

/// The angle of the point (x, y), for `y` of at least 0, and the greater of |x| and y.
///
/// Constants are loaded between the operations, which they pair with.
#[inline(always)]
fn angle_above<V: Vpu>(v: &mut V, y: V::F32, x: V::F32) -> (V::F32, V::F32) {
    // Fold to the first octant.
    let abs_x = v.vabs(x);
    let tan_pi_8 = v.vset_f32(0.414_213_57);
    let high = v.vmax(abs_x, y);
    let low = v.vmin(abs_x, y);
    // Past pi/8 measure from pi/4 on: tan(a - pi/4) = (t - 1)/(t + 1).
    let bound = v.vmul(tan_pi_8, high);
    let c0 = v.vset_f32(8.053_744_5e-2);
    let past = v.vcmp_gt(low, bound);
    let c1 = v.vset_f32(-1.387_768_6e-1);
    let num = v.vsub_or(low, past, low, high);
    let den = v.vadd_or(high, past, low, high);
    let per_den = v.vrcp(den);
    let t = v.vmul(num, per_den);
    let z = v.vmul(t, t);
    let c2 = v.vset_f32(1.997_771_1e-1);
    let p = v.vmadd(c0, z, c1);
    let c3 = v.vset_f32(-3.333_295e-1);
    let p = v.vmadd(p, z, c2);
    let tz = v.vmul(t, z);
    let p = v.vmadd(p, z, c3);
    let pi_4 = v.vset_f32(core::f32::consts::FRAC_PI_4);
    let angle = v.vmadd(p, tz, t);
    let angle = v.vadd_or(angle, past, angle, pi_4);
    // Unfold.
    let pi_2 = v.vset_f32(core::f32::consts::FRAC_PI_2);
    let steep = v.vcmp_gt(y, abs_x);
    let zero = v.vset_f32(0.0);
    let angle = v.vsub_or(angle, steep, pi_2, angle);
    let pi = v.vset_f32(core::f32::consts::PI);
    let behind = v.vcmp_lt(x, zero);
    (v.vsub_or(angle, behind, pi, angle), high)
}

/// Sum over the lanes, in every lane: four swizzles and adds.
#[inline(always)]
pub fn reduce_add<V: Vpu>(v: &mut V, a: V::F32) -> V::F32 {
    let other = v.vswizzle_cdab(a);
    let a = v.vadd(a, other);
    let other = v.vswizzle_badc(a);
    let a = v.vadd(a, other);
    let other = v.vpermute_quads_cdab(a);
    let a = v.vadd(a, other);
    let other = v.vpermute_quads_badc(a);
    v.vadd(a, other)
}

/// Least lane, in every lane: four swizzles and minima.
#[inline(always)]
pub fn reduce_min<V: Vpu>(v: &mut V, a: V::F32) -> V::F32 {
    let other = v.vswizzle_cdab(a);
    let a = v.vmin(a, other);
    let other = v.vswizzle_badc(a);
    let a = v.vmin(a, other);
    let other = v.vpermute_quads_cdab(a);
    let a = v.vmin(a, other);
    let other = v.vpermute_quads_badc(a);
    v.vmin(a, other)
}

/// Greatest lane, in every lane: four swizzles and maxima.
#[inline(always)]
pub fn reduce_max<V: Vpu>(v: &mut V, a: V::F32) -> V::F32 {
    let other = v.vswizzle_cdab(a);
    let a = v.vmax(a, other);
    let other = v.vswizzle_badc(a);
    let a = v.vmax(a, other);
    let other = v.vpermute_quads_cdab(a);
    let a = v.vmax(a, other);
    let other = v.vpermute_quads_badc(a);
    v.vmax(a, other)
}
