//! One silhouette edge against the unit light disc: the robust form of Eq. 3 [algorithms, 2.3].

use lrbsim_isa::{Vpu, math};

/// A point in the plane of the light, in units of its radius.
pub type Vec2<V> = [<V as Vpu>::F32; 2];

/// `1 / (2 pi)`.
const TURN: f32 = core::f32::consts::FRAC_1_PI / 2.0;

/// How the angle that a cut edge spans, seen from the centre, is taken from its ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Angle {
    /// From sine and cosine: all digits at every angle [algorithms, 2.3].
    #[default]
    Atan2,
    /// From the cosine alone, as printed [johnson09, Eq. 3], see [`acos`]: it tells no angles apart below some 3e-4.
    Acos,
}

/// Part F of the unit disc beyond the edge `u0 -> u1`, inside the wedge that the edge subtends at the centre.
///
/// In [0, 1/2], unsigned; 0 outside the lanes returned, which are those of `live` where the edge cuts the disc. Error
/// below 2e-7 of the disc, also for edges of 1e6 radii and of 1e-6. 73 operations; 19 where all lines
/// miss the disc.
#[inline(always)]
pub fn segment<V: Vpu>(v: &mut V, live: V::Mask, u0: Vec2<V>, u1: Vec2<V>) -> (V::Mask, V::F32) {
    let part = segment_by(v, live, u0, u1, Angle::Atan2);
    or_nothing(v, part)
}

/// A part and the lanes that have one: 0 in the others, and in all where none has.
#[inline(always)]
pub fn or_nothing<V: Vpu>(v: &mut V, part: Option<(V::Mask, V::F32)>) -> (V::Mask, V::F32) {
    let zero = v.vset_f32(0.0);
    match part {
        Some((live, part)) => (live, v.vblend_f32(live, part, zero)),
        None => (v.mask_none(), zero),
    }
}

/// The part that [`segment`] is, with its angle taken as `angle` has it, in the lanes returned; `None` where no lane has any.
#[inline(always)]
pub fn segment_by<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    u0: Vec2<V>,
    u1: Vec2<V>,
    angle: Angle,
) -> Option<(V::Mask, V::F32)> {
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
        return None;
    }

    // The end points, measured along the edge from the foot of the perpendicular.
    let d2 = v.vmul(d, d);
    let chord = chord(v, d2, [zero, one]);
    let a = along(v, u0, e, per_length);
    let a = on_chord(v, a, chord);
    let b = along(v, u1, e, per_length);
    let b = on_chord(v, b, chord);
    stretch(v, live, [d, d2], [a, b], angle, zero)
}

/// The ends of the unit disc's chord on a line whose distance has the square `d2` < 1 (NaN at 1), from the foot of the perpendicular;
/// constants 0 and 1 are the caller's.
#[inline(always)]
pub fn chord<V: Vpu>(v: &mut V, d2: V::F32, [zero, one]: [V::F32; 2]) -> [V::F32; 2] {
    let half_chord2 = v.vsub(one, d2);
    // Ends are cut off there, where the part hardly changes: a rounding or two more do no harm, nor does it that short chords, beyond which
    // there is next to nothing, are off by more.
    let per_h = v.vrsqrt(half_chord2);
    let h = v.vmul(half_chord2, per_h);
    [v.vsub(zero, h), h]
}

/// The place `t` on a line, or the end of the `chord` that it is beyond.
#[inline(always)]
pub fn on_chord<V: Vpu>(v: &mut V, t: V::F32, chord: [V::F32; 2]) -> V::F32 {
    let t = v.vmax(t, chord[0]);
    v.vmin(t, chord[1])
}

/// Part of the unit disc beyond the stretch `a..b` of a chord, at a distance that is given with its square, as [`sector_less_triangle`] has it, in the lanes
/// returned, which are those of `live` where the stretch has any length; `None` where no lane has. The constant 0 is the caller's.
#[inline(always)]
pub fn stretch<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    distance: [V::F32; 2],
    [a, b]: [V::F32; 2],
    angle: Angle,
    zero: V::F32,
) -> Option<(V::Mask, V::F32)> {
    let live = v.vcmp_lt_masked(live, a, b);
    if !v.branch_any(live) {
        return None;
    }
    let f = sector_less_triangle(v, distance, [a, b], angle);
    // The greater of a NaN and 0 is 0: a stretch on the centre itself has no angle.
    Some((live, v.vmax(f, zero)))
}

/// The sector of the unit disc that the stretch `a..b` of a line spans, seen from the centre, less the triangle between them, as a part of
/// the disc [johnson09, Eq. 3]. The line's distance is given with its square; the stretch is measured from the foot of the perpendicular.
#[inline(always)]
pub fn sector_less_triangle<V: Vpu>(
    v: &mut V,
    [d, d2]: [V::F32; 2],
    [a, b]: [V::F32; 2],
    angle: Angle,
) -> V::F32 {
    let width = v.vsub(b, a);
    let triangle = v.vmul(d, width);
    let x = v.vmadd(a, b, d2);
    let theta = match angle {
        Angle::Atan2 => math::atan2_above(v, triangle, x),
        Angle::Acos => {
            // With w0 = -a and w1 = b.
            let to_a2 = v.vmadd(a, a, d2);
            let to_b2 = v.vmadd(b, b, d2);
            let product = v.vmul(to_a2, to_b2);
            let inverse = v.vrsqrt(product);
            let cosine = v.vmul(x, inverse);
            acos(v, cosine)
        }
    };
    let area = v.vsub(theta, triangle);
    let turn = v.vset_f32(TURN);
    v.vmul(area, turn)
}

/// Angle whose cosine is `x`, in [0, pi].
///
/// The argument is cut to [-1, 1], and a NaN counts as 1: rounding takes the quotient of [johnson09, Eq. 3] past 1, and an end
/// on the centre makes it 0/0 [algorithms, 2.3]. Error below 4e-7. The arcus sine of Cephes, `asinf`, past 1/2 of the half
/// angle.
#[inline(always)]
pub fn acos<V: Vpu>(v: &mut V, x: V::F32) -> V::F32 {
    let one = v.vset_f32(1.0);
    let minus_one = v.vset_f32(-1.0);
    let half = v.vset_f32(0.5);
    let zero = v.vset_f32(0.0);
    // The lesser of a NaN and 1 is 1, by the definition of the operation.
    let x = v.vmin(x, one);
    let x = v.vmax(x, minus_one);
    let size = v.vabs(x);
    let near_one = v.vcmp_gt(size, half);
    let square = v.vmul(x, x);
    let halved = v.vnmadd(size, half, half);
    let z = v.vblend_f32(near_one, halved, square);
    let root = math::sqrt(v, z);
    let s = v.vblend_f32(near_one, root, size);
    let c0 = v.vset_f32(4.216_32e-2);
    let c1 = v.vset_f32(2.418_131e-2);
    let c2 = v.vset_f32(4.547_002_6e-2);
    let c3 = v.vset_f32(7.495_300_5e-2);
    let c4 = v.vset_f32(1.666_675_2e-1);
    let p = v.vmadd(c0, z, c1);
    let p = v.vmadd(p, z, c2);
    let p = v.vmadd(p, z, c3);
    let p = v.vmadd(p, z, c4);
    let sz = v.vmul(s, z);
    let arc = v.vmadd(p, sz, s);
    let quarter = v.vset_f32(core::f32::consts::FRAC_PI_2);
    let rest = v.vsub(quarter, arc);
    let angle = v.vadd_or(rest, near_one, arc, arc);
    let pi = v.vset_f32(core::f32::consts::PI);
    let behind = v.vcmp_lt(x, zero);
    v.vsub_or(angle, behind, pi, angle)
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
