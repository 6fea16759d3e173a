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
    let zero = v.vset_f32(0.0);
    let half = v.vset_f32(0.5);
    let reciprocal = v.vrsqrt(a);
    let root = v.vmul(a, reciprocal);
    let rest = v.vnmadd(root, root, a);
    let half_reciprocal = v.vmul(half, reciprocal);
    let refined = v.vmadd(rest, half_reciprocal, root);
    let is_zero = v.vcmp_eq(a, zero);
    v.vblend_f32(is_zero, a, refined)
}

/// Angle of the point (x, y) from the x axis in [-pi, pi]; 0 for the origin.
///
/// Absolute error at most 3e-7, and relative error at most 4e-7 of an angle that is normal, where the greater of |x| and
/// |y| lies in [2^-100, 2^126]; a NaN where it is denormal, infinite or beyond f32::MAX / 2. Zeros have no sign: (-1, -0)
/// is at +pi. One division, a polynomial of degree 9 in the tangent
/// reduced to [-tan(pi/8), tan(pi/8)] (coefficients of Cephes `atanf`), and three foldings.
#[inline(always)]
pub fn atan2<V: Vpu>(v: &mut V, y: V::F32, x: V::F32) -> V::F32 {
    let zero = v.vset_f32(0.0);
    // Fold to the first octant.
    let abs_x = v.vabs(x);
    let abs_y = v.vabs(y);
    let high = v.vmax(abs_x, abs_y);
    let low = v.vmin(abs_x, abs_y);
    // Past pi/8 measure from pi/4 on: tan(a - pi/4) = (t - 1)/(t + 1).
    let tan_pi_8 = v.vset_f32(0.414_213_57);
    let bound = v.vmul(tan_pi_8, high);
    let past = v.vcmp_gt(low, bound);
    let num = v.vsub_or(low, past, low, high);
    let den = v.vadd_or(high, past, low, high);
    let t = div(v, num, den);
    let z = v.vmul(t, t);
    let c0 = v.vset_f32(8.053_744_5e-2);
    let c1 = v.vset_f32(-1.387_768_6e-1);
    let c2 = v.vset_f32(1.997_771_1e-1);
    let c3 = v.vset_f32(-3.333_295e-1);
    let p = v.vmadd(c0, z, c1);
    let p = v.vmadd(p, z, c2);
    let p = v.vmadd(p, z, c3);
    let tz = v.vmul(t, z);
    let angle = v.vmadd(p, tz, t);
    let pi_4 = v.vset_f32(core::f32::consts::FRAC_PI_4);
    let angle = v.vadd_or(angle, past, angle, pi_4);
    // Unfold.
    let steep = v.vcmp_gt(abs_y, abs_x);
    let pi_2 = v.vset_f32(core::f32::consts::FRAC_PI_2);
    let angle = v.vsub_or(angle, steep, pi_2, angle);
    let behind = v.vcmp_lt(x, zero);
    let pi = v.vset_f32(core::f32::consts::PI);
    let angle = v.vsub_or(angle, behind, pi, angle);
    let below = v.vcmp_lt(y, zero);
    let angle = v.vsub_or(angle, below, zero, angle);
    let origin = v.vcmp_eq(high, zero);
    v.vblend_f32(origin, zero, angle)
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
