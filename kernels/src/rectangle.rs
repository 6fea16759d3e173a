//! One silhouette edge against a rectangular and a linear light: what [`segment`](crate::segment::segment) is to a disc.

use lrbsim_isa::Vpu;

use crate::expression::each;
use crate::segment::{Vec2, cross, dot};

/// Part of the square of all places from -1 to 1 beyond the edge `u0 -> u1`, inside the wedge that the edge subtends at its middle.
///
/// In [0, 1/2], unsigned, in the lanes returned, which are those of `live` where the edge cuts the square. What of the
/// edge lies in the square is cut out; the part is its wedge's area of the square, less that of the triangle between it and the
/// middle. Error below 3e-7 of the square. `None` where no lane has a part.
#[inline(always)]
pub fn square<V: Vpu>(v: &mut V, live: V::Mask, u0: Vec2<V>, u1: Vec2<V>) -> Option<(V::Mask, V::F32)> {
    let zero = v.vset_f32(0.0);
    let one = v.vset_f32(1.0);
    let minus_one = v.vset_f32(-1.0);
    let e = [v.vsub(u1[0], u0[0]), v.vsub(u1[1], u0[1])];

    // The line of the edge passes the square where its distance from the middle is too great, whatever its direction.
    let c = cross(v, u0, u1);
    let distance = v.vabs(c);
    let width = v.vabs(e[0]);
    let height = v.vabs(e[1]);
    let reach = v.vadd(width, height);
    let live = v.vcmp_lt_masked(live, distance, reach);
    if !v.branch_any(live) {
        return None;
    }

    // Where the line enters the square and leaves it. What side it meets there is told by the place on that side, which is found
    // from the line's distance from the middle: the ends of the edge may be far out.
    let per_e = [v.vrcp(e[0]), v.vrcp(e[1])];
    let forward = each!(axis in [0, 1] => {
        let rising = v.vcmp_gt(e[axis], zero);
        v.vblend_f32(rising, one, minus_one)
    });
    let backward = [v.vsub(zero, forward[0]), v.vsub(zero, forward[1])];
    let minus_c = v.vsub(zero, c);
    let [leaves, enters] = each!(sides in [forward, backward] => {
        let y = v.vmadd(sides[0], e[1], minus_c);
        let y = v.vmul(y, per_e[0]);
        let x = v.vmadd(sides[1], e[0], c);
        let x = v.vmul(x, per_e[1]);
        let x = v.vmax(x, minus_one);
        let x = v.vmin(x, one);
        let from_y = v.vabs(y);
        let upright = v.vcmp_le(from_y, one);
        [v.vblend_f32(upright, sides[0], x), v.vblend_f32(upright, y, sides[1])]
    });
    // What of that the edge has: from its beginning or where it enters, to its end or where it leaves.
    let to_leave = ahead(v, e, leaves, u0);
    let live = v.vcmp_gt_masked(live, to_leave, zero);
    let from_enter = ahead(v, e, u1, enters);
    let live = v.vcmp_gt_masked(live, from_enter, zero);
    if !v.branch_any(live) {
        return None;
    }
    let to_enter = ahead(v, e, enters, u0);
    let begins_outside = v.vcmp_gt(to_enter, zero);
    let from_leave = ahead(v, e, u1, leaves);
    let ends_outside = v.vcmp_gt(from_leave, zero);
    let a = each!(axis in [0, 1] => v.vblend_f32(begins_outside, enters[axis], u0[axis]));
    let b = each!(axis in [0, 1] => v.vblend_f32(ends_outside, leaves[axis], u1[axis]));

    // Wedge less triangle. The middle is in no direction: an end there makes no wedge.
    let (from, some_from) = around(v, live, a);
    let (to, live) = around(v, some_from, b);
    let wedge = v.vsub(to, from);
    let wedge = v.vabs(wedge);
    let whole = v.vset_f32(4.0);
    let back = v.vsub(whole, wedge);
    let wedge = v.vmin(wedge, back);
    let triangle = cross(v, a, b);
    let triangle = v.vabs(triangle);
    let half = v.vset_f32(0.5);
    let area = v.vnmadd(triangle, half, wedge);
    let quarter = v.vset_f32(0.25);
    let part = v.vmul(area, quarter);
    Some((live, v.vmax(part, zero)))
}

/// Area of the square of all places from -1 to 1 between the x axis and the direction of `u`, counterclockwise, in
/// [-1/2, 7/2]; the lanes of `live` where `u` is not the middle.
#[inline(always)]
fn around<V: Vpu>(v: &mut V, live: V::Mask, u: Vec2<V>) -> (V::F32, V::Mask) {
    let zero = v.vset_f32(0.0);
    let x = v.vabs(u[0]);
    let y = v.vabs(u[1]);
    let steep = v.vcmp_gt(y, x);
    let long = v.vblend_f32(steep, u[1], u[0]);
    let short = v.vblend_f32(steep, u[0], u[1]);
    let short = v.vsub_or(short, steep, zero, short);
    let live = v.vcmp_neq_masked(live, long, zero);
    let inverse = v.vrcp(long);
    let ratio = v.vmul(short, inverse);
    // East 0, north 1, west 2, south 3.
    let one = v.vset_f32(1.0);
    let two = v.vset_f32(2.0);
    let base = v.vblend_f32(steep, one, zero);
    let behind = v.vcmp_lt(long, zero);
    let base = v.vadd_or(base, behind, base, two);
    let half = v.vset_f32(0.5);
    (v.vmadd(ratio, half, base), live)
}

/// How far `to` is ahead of `from` in the direction of `e`, times the length of `e`.
#[inline(always)]
fn ahead<V: Vpu>(v: &mut V, e: Vec2<V>, to: Vec2<V>, from: Vec2<V>) -> V::F32 {
    let way = [v.vsub(to[0], from[0]), v.vsub(to[1], from[1])];
    dot(v, way, e)
}

/// Part of the line from (-1, 0) to (1, 0) beyond the edge `u0 -> u1`, seen from its middle: in [0, 1/2], unsigned, in the
/// lanes returned, which are those of `live` where the edge crosses it. `None` where no lane has a part.
#[inline(always)]
pub fn line<V: Vpu>(v: &mut V, live: V::Mask, u0: Vec2<V>, u1: Vec2<V>) -> Option<(V::Mask, V::F32)> {
    let zero = v.vset_f32(0.0);
    let starts_left = v.vcmp_ge(u0[1], zero);
    let ends_left = v.vcmp_ge(u1[1], zero);
    let crosses = v.kxor(starts_left, ends_left);
    let live = v.kand(crosses, live);
    if !v.branch_any(live) {
        return None;
    }
    let c = cross(v, u0, u1);
    let rise = v.vsub(u1[1], u0[1]);
    let per_rise = v.vrcp(rise);
    let place = v.vmul(c, per_rise);
    let place = v.vabs(place);
    let half = v.vset_f32(0.5);
    let part = v.vnmadd(place, half, half);
    Some((live, v.vmax(part, zero)))
}
