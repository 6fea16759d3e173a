//! One silhouette edge against the unit light disc: the robust form of Eq. 3 [algorithms, 2.3].

use lrbsim_isa::{Vpu, math};

/// A point in the plane of the light, in units of its radius.
pub type Vec2<V> = [<V as Vpu>::F32; 2];

/// `1 / (2 pi)`.
const TURN: f32 = core::f32::consts::FRAC_1_PI / 2.0;

/// Part F of the unit disc beyond the edge `u0 -> u1`, inside the wedge that the edge subtends at the centre.
///
/// In [0, 1/2], unsigned; 0 outside the lanes returned, which are those of `live` where the edge cuts the disc. Error
/// below 2e-7 of the disc, also for edges of 1e6 radii and of 1e-6. 88 operations; 17 where all lines
/// miss the disc.
#[inline(always)]
pub fn segment<V: Vpu>(v: &mut V, live: V::Mask, u0: Vec2<V>, u1: Vec2<V>) -> (V::Mask, V::F32) {
    let zero = v.vset_f32(0.0);
    let one = v.vset_f32(1.0);

    // Distance d of the line from the centre.
    let e = [v.vsub(u1[0], u0[0]), v.vsub(u1[1], u0[1])];
    let c = cross(v, u0, u1);
    let length2 = dot(v, e, e);
    let per_length = v.vrsqrt(length2);
    let c = v.vabs(c);
    let d = v.vmul(c, per_length);
    let live = v.vcmp_gt_masked(live, length2, zero);
    let live = v.vcmp_lt_masked(live, d, one);
    if !v.branch_any(live) {
        return (live, zero);
    }

    // Clamp the end points, measured along the edge from the foot of the perpendicular, to the half chord.
    let below = v.vsub(one, d);
    let above = v.vadd(one, d);
    let half_chord2 = v.vmul(below, above);
    let h = math::sqrt(v, half_chord2);
    let minus_h = v.vsub(zero, h);
    let a = along(v, u0, e, per_length);
    let a = v.vmax(a, minus_h);
    let a = v.vmin(a, h);
    let b = along(v, u1, e, per_length);
    let b = v.vmax(b, minus_h);
    let b = v.vmin(b, h);
    let live = v.vcmp_lt_masked(live, a, b);
    if !v.branch_any(live) {
        return (live, zero);
    }

    // Sector minus triangle.
    let width = v.vsub(b, a);
    let triangle = v.vmul(d, width);
    let d2 = v.vmul(d, d);
    let x = v.vmadd(a, b, d2);
    let theta = math::atan2(v, triangle, x);
    let area = v.vsub(theta, triangle);
    let turn = v.vset_f32(TURN);
    let f = v.vmul(area, turn);
    let f = v.vmax(f, zero);
    (live, v.vblend_f32(live, f, zero))
}

/// The product `a x b`, as a two-FMA difference: it keeps its digits where the ends of an edge are far from the disc and its
/// line is near.
#[inline(always)]
pub fn cross<V: Vpu>(v: &mut V, a: Vec2<V>, b: Vec2<V>) -> V::F32 {
    let right = v.vmul(a[1], b[0]);
    let lost = v.vnmadd(a[1], b[0], right);
    let left = v.vmsub(a[0], b[1], right);
    v.vadd(left, lost)
}

/// How far `u` lies along the direction of `e`.
#[inline(always)]
fn along<V: Vpu>(v: &mut V, u: Vec2<V>, e: Vec2<V>, per_length: V::F32) -> V::F32 {
    let t = dot(v, u, e);
    v.vmul(t, per_length)
}

/// The product `a . b` of vectors in the plane of the light.
#[inline(always)]
pub fn dot<V: Vpu>(v: &mut V, a: Vec2<V>, b: Vec2<V>) -> V::F32 {
    let y = v.vmul(a[1], b[1]);
    v.vmadd(a[0], b[0], y)
}
