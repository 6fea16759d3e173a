//! The light as a receiver sees it: a disc, a rectangle or a line, and where occluders project on it.

use lrbsim_isa::Vpu;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::{LightShape, Outline};

use crate::expression::each;
use crate::plane::{Vec3, cross, dot, sub};
use crate::record::{Field, Record};
use crate::rectangle::{line, square};
use crate::segment::{Angle, Vec2, segment_by};

/// Nearest and farthest height of an occluder over its receiver, in parts of the light's height: nearer is the receiver's
/// own neighbourhood, farther is behind the light.
const HEIGHT_MIN: f32 = 1e-6;

/// The light in the frame of 16 receivers, one a lane.
///
/// `axis` points from the receiver to the light's plane at a right angle, `s` and `t` span that plane. The products of a point
/// with `s` and `t` are its place, but for the factor `per_radius`: in radii on a disc, in half sides on a rectangle; on a line in
/// half lines along it and aside.
pub struct View<V: Vpu> {
    receiver: Vec3<V>,
    axis: Vec3<V>,
    s: Vec3<V>,
    t: Vec3<V>,
    /// The vectors that lead from the middle to the places (1, 0) and (0, 1); `None` for a disc, where they are `s` and `t`
    /// times the radius.
    units: Option<[Vec3<V>; 2]>,
    /// Height of the light over the receiver.
    height: V::F32,
    /// `1 / radius` of a disc.
    per_radius: V::F32,
    /// The height times `per_radius`.
    scale: V::F32,
    /// Least height of what can be an occluder.
    lowest: V::F32,
    /// Place of the receiver's foot point on the light's plane; `None` for a facing disc, whose middle it is.
    foot: Option<Vec2<V>>,
    /// What places belong to the light.
    pub outline: Outline,
}

/// An occluder's point in a [`View`]: along s, along t, height over the receiver.
pub type Seen<V> = [<V as Vpu>::F32; 3];

impl<V: Vpu> View<V> {
    /// The frame of receivers `receiver` (light-centred) for a light of this shape; if it is a disc, of radius `1 / per_radius`.
    #[inline(always)]
    pub fn new(v: &mut V, shape: &LightShape, receiver: Vec3<V>, per_radius: V::F32) -> View<V> {
        let outline = shape.outline();
        let least = v.vset_f32(HEIGHT_MIN);
        match shape {
            LightShape::Facing => {
                // a = -p/|p|; s and t by the branchless basis of Duff et al. 2017.
                let squared = dot(v, receiver, receiver);
                let inverse = v.vrsqrt(squared);
                let height = v.vmul(squared, inverse);
                let zero = v.vset_f32(0.0);
                let minus = v.vsub(zero, inverse);
                let axis =
                    [v.vmul(receiver[0], minus), v.vmul(receiver[1], minus), v.vmul(receiver[2], minus)];
                let (s, t) = basis(v, axis);
                let scale = v.vmul(height, per_radius);
                let lowest = v.vmul(height, least);
                View {
                    receiver,
                    axis,
                    s,
                    t,
                    units: None,
                    height,
                    per_radius,
                    scale,
                    lowest,
                    foot: None,
                    outline,
                }
            }
            LightShape::Disc { normal } => {
                let normal = constant(v, *normal);
                let (_, axis, height) = View::away(v, receiver, normal);
                let (s, t) = basis(v, axis);
                let scale = v.vmul(height, per_radius);
                let along_s = dot(v, receiver, s);
                let along_t = dot(v, receiver, t);
                let foot = Some([v.vmul(along_s, per_radius), v.vmul(along_t, per_radius)]);
                let lowest = v.vmul(height, least);
                View { receiver, axis, s, t, units: None, height, per_radius, scale, lowest, foot, outline }
            }
            LightShape::Rect { halves: [a, b] } | LightShape::Triangle { halves: [a, b] } => {
                let across = a.cross(*b);
                let normal = constant(v, across.normalize());
                let (above, axis, height) = View::away(v, receiver, normal);
                let per_square = across.length_squared().recip();
                let [s, t] = [b.cross(across) * per_square, across.cross(*a) * per_square];
                // Turned around with the axis: from either side, left of an edge is left of it.
                let [s, t] = around(v, shape, above, [s, t]);
                let units = Some(around(v, shape, above, [*a, *b]));
                let foot = Some([dot(v, receiver, s), dot(v, receiver, t)]);
                let per_radius = v.vset_f32(1.0);
                let lowest = v.vmul(height, least);
                View { receiver, axis, s, t, units, height, per_radius, scale: height, lowest, foot, outline }
            }
            LightShape::Line { half } => {
                let s = constant(v, *half * half.length_squared().recip());
                let unit = constant(v, *half);
                let along = dot(v, receiver, s);
                let beside = each!(axis in [0, 1, 2] => v.vnmadd(along, unit[axis], receiver[axis]));
                let squared = dot(v, beside, beside);
                let inverse = v.vrsqrt(squared);
                let height = v.vmul(squared, inverse);
                let zero = v.vset_f32(0.0);
                let minus = v.vsub(zero, inverse);
                let axis = each!(axis in [0, 1, 2] => v.vmul(beside[axis], minus));
                let t = cross(v, axis, s);
                let aside = cross(v, axis, unit);
                let foot = Some([along, zero]);
                let per_radius = v.vset_f32(1.0);
                let units = Some([unit, aside]);
                let lowest = v.vmul(height, least);
                View { receiver, axis, s, t, units, height, per_radius, scale: height, lowest, foot, outline }
            }
        }
    }

    /// The direction along `normal` that looks away from the receiver, and the height of the plane through the middle of the
    /// light across it; first, the lanes in which it is the opposite of `normal`.
    #[inline(always)]
    fn away(v: &mut V, receiver: Vec3<V>, normal: Vec3<V>) -> (V::Mask, Vec3<V>, V::F32) {
        let zero = v.vset_f32(0.0);
        let over = dot(v, receiver, normal);
        let above = v.vcmp_gt(over, zero);
        let axis = turned(v, above, normal);
        (above, axis, v.vabs(over))
    }

    /// Part of the light beyond the edge `u0 -> u1` of places, inside the wedge that the edge subtends at the light's middle: in
    /// [0, 1/2], and the lanes of `live` where it is any; `None` where it is none in all. `angle` is that of a disc's part.
    #[inline(always)]
    pub fn part_beyond(
        &self,
        v: &mut V,
        live: V::Mask,
        u0: Vec2<V>,
        u1: Vec2<V>,
        angle: Angle,
    ) -> Option<(V::Mask, V::F32)> {
        match self.outline {
            Outline::Disc => segment_by(v, live, u0, u1, angle),
            Outline::Square => square(v, live, u0, u1),
            Outline::Line => line(v, live, u0, u1),
            Outline::Triangle => panic!("`sism`, which takes parts of lights, refuses triangles"),
        }
    }

    /// This view with its places turned about the middle of the light, by the angle of this cosine and sine: any of a disc,
    /// multiples of a quarter turn of a rectangle, and of a half turn of a line.
    #[inline(always)]
    pub fn turned(self, v: &mut V, cos: V::F32, sin: V::F32) -> View<V> {
        let pairs = each!(axis in [0, 1, 2] => turn(v, cos, sin, [self.s[axis], self.t[axis]]));
        let units = match self.units {
            None => None,
            Some([s, t]) => {
                let pairs = each!(axis in [0, 1, 2] => turn(v, cos, sin, [s[axis], t[axis]]));
                Some([pairs.map(|[s, _]| s), pairs.map(|[_, t]| t)])
            }
        };
        let foot = match self.foot {
            None => None,
            Some(foot) => Some(turn(v, cos, sin, foot)),
        };
        View { s: pairs.map(|[s, _]| s), t: pairs.map(|[_, t]| t), units, foot, ..self }
    }

    /// The vectors that lead from the middle of the light to the places (1, 0) and (0, 1). `radius`: of a disc.
    #[inline(always)]
    pub fn spans(&self, v: &mut V, radius: f32) -> [Vec3<V>; 2] {
        if let Some(units) = self.units {
            return units;
        }
        let radius = v.vset_f32(radius);
        each!(of in [self.s, self.t] => each!(axis in [0, 1, 2] => v.vmul(of[axis], radius)))
    }

    /// The point at `place` on the light, light-centred. `radius`: of a disc.
    #[inline(always)]
    pub fn point(&self, v: &mut V, place: Vec2<V>, radius: f32) -> Vec3<V> {
        let (place, [s, t]) = match self.units {
            Some(units) => (place, units),
            None => {
                let radius = v.vset_f32(radius);
                (each!(axis in [0, 1] => v.vmul(place[axis], radius)), [self.s, self.t])
            }
        };
        each!(axis in [0, 1, 2] => {
            let along_t = v.vmul(place[1], t[axis]);
            v.vmadd(place[0], s[axis], along_t)
        })
    }

    /// Point `vertex` (light-centred) in this frame.
    #[inline(always)]
    pub fn see(&self, v: &mut V, vertex: Vec3<V>) -> Seen<V> {
        let q = sub(v, vertex, self.receiver);
        [dot(v, q, self.s), dot(v, q, self.t), dot(v, q, self.axis)]
    }

    /// The two points at `ends` of a record in this frame, as [`View::see`] has each.
    ///
    /// A coordinate is loaded while the one before is used, with which it pairs.
    #[inline(always)]
    pub fn see_ends<R>(
        &self,
        v: &mut V,
        record: Record<V, R>,
        ends: [Field<R, [f32; 3]>; 2],
    ) -> [Seen<V>; 2] {
        let first = record.float(v, ends[0].at(2));
        let (a, next) = self.see_loading(v, record, ends[0], first, Some(ends[1].at(2)));
        let (b, _) = self.see_loading(v, record, ends[1], next, None);
        [a, b]
    }

    /// The point at `end` of a record in this frame, whose last coordinate is `z`; what is at `next`, if anything, is loaded too.
    #[inline(always)]
    fn see_loading<R>(
        &self,
        v: &mut V,
        record: Record<V, R>,
        end: Field<R, [f32; 3]>,
        z: V::F32,
        next: Option<Field<R, f32>>,
    ) -> (Seen<V>, V::F32) {
        let q = v.vsub(z, self.receiver[2]);
        let y = record.float(v, end.at(1));
        let s = v.vmul(q, self.s[2]);
        let t = v.vmul(q, self.t[2]);
        let height = v.vmul(q, self.axis[2]);
        let q = v.vsub(y, self.receiver[1]);
        let x = record.float(v, end.at(0));
        let s = v.vmadd(q, self.s[1], s);
        let t = v.vmadd(q, self.t[1], t);
        let height = v.vmadd(q, self.axis[1], height);
        let q = v.vsub(x, self.receiver[0]);
        let next = match next {
            Some(next) => record.float(v, next),
            None => x,
        };
        let s = v.vmadd(q, self.s[0], s);
        let t = v.vmadd(q, self.t[0], t);
        ([s, t, v.vmadd(q, self.axis[0], height)], next)
    }

    /// The places of the ends of the edge `a -> b`, see [`View::project`], clipped to heights between receiver and light; first, the lanes of
    /// `live` in which some of it is left.
    ///
    /// Two compares and a branch where nothing is to be clipped, which is the common case.
    #[inline(always)]
    pub fn place(&self, v: &mut V, live: V::Mask, [mut a, mut b]: [Seen<V>; 2]) -> (V::Mask, [Vec2<V>; 2]) {
        let lower = v.vmin(a[2], b[2]);
        let upper = v.vmax(a[2], b[2]);
        let low = self.lowest;
        let inside = v.vcmp_le(upper, self.height);
        let inside = v.vcmp_ge_masked(inside, lower, low);
        // What the branch waits for and what is wanted next, by turns.
        let mut per_a = v.vrcp(a[2]);
        let cut = v.kandn(inside, live);
        let mut per_b = v.vrcp(b[2]);
        let mut live = live;
        if v.branch_any(cut) {
            live = clip_to(v, live, [inside, cut], [low, self.height], &mut a, &mut b);
            per_a = v.vrcp(a[2]);
            per_b = v.vrcp(b[2]);
        }
        let k = v.vmul(self.scale, per_a);
        let from = self.place_of(v, a, k);
        let k = v.vmul(self.scale, per_b);
        let to = self.place_of(v, b, k);
        (live, [from, to])
    }

    /// The place of a point that is `seen`, for the factor `k` from it to the light.
    #[inline(always)]
    fn place_of(&self, v: &mut V, seen: Seen<V>, k: V::F32) -> Vec2<V> {
        match self.foot {
            None => [v.vmul(seen[0], k), v.vmul(seen[1], k)],
            Some(foot) => [v.vmadd(seen[0], k, foot[0]), v.vmadd(seen[1], k, foot[1])],
        }
    }

    /// A point `vertex` (light-centred) in this frame moved to the middle of the light: its height is that over the light's plane, and
    /// what is near the middle keeps its digits.
    #[inline(always)]
    pub fn see_from_middle(&self, v: &mut V, vertex: Vec3<V>) -> Seen<V> {
        [dot(v, vertex, self.s), dot(v, vertex, self.t), dot(v, vertex, self.axis)]
    }

    /// Height over the light's plane, which is negative, from which on points are above the receiver.
    #[inline(always)]
    pub fn lowest_from_middle(&self, v: &mut V) -> V::F32 {
        let part = v.vset_f32(HEIGHT_MIN - 1.0);
        v.vmul(self.height, part)
    }

    /// Clips the edge `a -> b` to heights between receiver and light, for points that are seen from the middle; the lanes of `live` in which
    /// some of it is left.
    ///
    /// In the plane of the light an edge is cut from its end that is nearer to that plane: a corner next to the middle would else lose
    /// the digits that say on which side of the middle its edge passes.
    #[inline(always)]
    pub fn clip_from_middle(&self, v: &mut V, live: V::Mask, a: &mut Seen<V>, b: &mut Seen<V>) -> V::Mask {
        let zero = v.vset_f32(0.0);
        let a_over = v.vcmp_gt(a[2], zero);
        let b_over = v.vcmp_gt(b[2], zero);
        let beyond = v.kand(a_over, b_over);
        let live = v.kandn(beyond, live);
        let crosses = v.kxor(a_over, b_over);
        let crosses = v.kand(crosses, live);
        if v.branch_any(crosses) {
            let of_a = v.vabs(a[2]);
            let of_b = v.vabs(b[2]);
            let from_a = v.vcmp_le(of_a, of_b);
            let both = v.vadd(of_a, of_b);
            let per_rise = v.vrcp(both);
            let nearer = v.vmin(of_a, of_b);
            let part = v.vmul(nearer, per_rise);
            let moves_a = v.kand(crosses, a_over);
            let moves_b = v.kand(crosses, b_over);
            for i in 0..3 {
                let near = v.vblend_f32(from_a, a[i], b[i]);
                let far = v.vblend_f32(from_a, b[i], a[i]);
                let span = v.vsub(far, near);
                let at = v.vmadd(span, part, near);
                let at = if i == 2 { zero } else { at };
                a[i] = v.vblend_f32(moves_a, at, a[i]);
                b[i] = v.vblend_f32(moves_b, at, b[i]);
            }
        }
        // What is nearer to the receiver than its own neighborhood lies far from the middle: as any other edge.
        let low = self.lowest_from_middle(v);
        clip_between(v, live, low, zero, a, b)
    }

    /// As [`View::project`], for a point that is seen from the middle: one in the light's plane stays where it is.
    #[inline(always)]
    pub fn project_from_middle(&self, v: &mut V, seen: Seen<V>) -> Vec2<V> {
        let over = v.vadd(self.height, seen[2]);
        let inverse = v.vrcp(over);
        let per_height = v.vmul(self.scale, inverse);
        let Some(foot) = self.foot else {
            return [v.vmul(seen[0], per_height), v.vmul(seen[1], per_height)];
        };
        let stretch = v.vmul(self.height, inverse);
        let from_foot = [v.vnmadd(foot[0], stretch, foot[0]), v.vnmadd(foot[1], stretch, foot[1])];
        [v.vmadd(seen[0], per_height, from_foot[0]), v.vmadd(seen[1], per_height, from_foot[1])]
    }

    /// The line in which a plane through each receiver, of this `normal`, cuts the light's plane.
    #[inline(always)]
    pub fn horizon(&self, v: &mut V, live: V::Mask, normal: Vec3<V>) -> Horizon<V> {
        // Places lie on the plane where `slope . place = offset`.
        let [unit_s, unit_t] = self.units.unwrap_or([self.s, self.t]);
        let slope = [dot(v, normal, unit_s), dot(v, normal, unit_t)];
        let offset = dot(v, normal, self.receiver);
        let offset = v.vmul(offset, self.per_radius);
        let slope2 = v.vmul(slope[1], slope[1]);
        let slope2 = v.vmadd(slope[0], slope[0], slope2);
        let mut offset2 = v.vmul(offset, offset);
        if matches!(self.outline, Outline::Square | Outline::Triangle) {
            let less = v.vset_f32(1.0 / self.outline.reach2());
            offset2 = v.vmul(offset2, less);
        }
        let cuts = v.vcmp_lt_masked(live, offset2, slope2);
        let inverse = v.vrsqrt(slope2);
        let distance = v.vmul(offset, inverse);
        let across = [v.vmul(slope[0], inverse), v.vmul(slope[1], inverse)];
        // Two either way from the foot of the perpendicular: both off the light.
        let foot = [v.vmul(across[0], distance), v.vmul(across[1], distance)];
        let two = v.vset_f32(2.0);
        let from = [v.vmadd(across[1], two, foot[0]), v.vnmadd(across[0], two, foot[1])];
        let to = [v.vnmadd(across[1], two, foot[0]), v.vmadd(across[0], two, foot[1])];
        Horizon { cuts, places: [from, to], offset }
    }

    /// The place where the line from the receiver through `seen` meets the light's plane: the exact normalisation of each
    /// vertex by its own depth [algorithms, 2.5 and 2.6]. `seen` must be higher than the receiver.
    #[inline(always)]
    pub fn project(&self, v: &mut V, seen: Seen<V>) -> Vec2<V> {
        let inverse = v.vrcp(seen[2]);
        let k = v.vmul(self.scale, inverse);
        self.place_of(v, seen, k)
    }
}

/// The line in which a plane through each receiver cuts the light's plane.
pub struct Horizon<V: Vpu> {
    /// Lanes where the line cuts the circle about the light.
    pub cuts: V::Mask,
    /// Two places of the line, on either side of the light.
    pub places: [Vec2<V>; 2],
    /// Distance of the receiver's plane from the middle of the light, times something positive: the middle is left of the line
    /// where this is above 0. The places cannot tell, where the line goes through the middle within what they are rounded by.
    pub offset: V::F32,
}

/// A place, turned by the angle of this cosine and sine.
#[inline(always)]
fn turn<V: Vpu>(v: &mut V, cos: V::F32, sin: V::F32, [s, t]: Vec2<V>) -> Vec2<V> {
    let of_t = v.vmul(t, sin);
    let new_s = v.vmadd(s, cos, of_t);
    let of_s = v.vmul(s, sin);
    [new_s, v.vmsub(t, cos, of_s)]
}

/// The vector `x`, its opposite in the lanes `around`.
#[inline(always)]
fn turned<V: Vpu>(v: &mut V, around: V::Mask, x: Vec3<V>) -> Vec3<V> {
    let zero = v.vset_f32(0.0);
    each!(axis in [0, 1, 2] => v.vsub_or(x[axis], around, zero, x[axis]))
}

/// Two vectors along the sides of a rectangle or a triangle, in an order that goes the other way around in the lanes `above`: one
/// side of a rectangle is its opposite there, and those of a triangle are exchanged, either of which leaves the shape what it is.
#[inline(always)]
fn around<V: Vpu>(v: &mut V, shape: &LightShape, above: V::Mask, sides: [DVec3; 2]) -> [Vec3<V>; 2] {
    let [a, b] = sides;
    let (a, b) = (constant(v, a), constant(v, b));
    if matches!(shape, LightShape::Triangle { .. }) {
        let first = each!(axis in [0, 1, 2] => v.vblend_f32(above, b[axis], a[axis]));
        let second = each!(axis in [0, 1, 2] => v.vblend_f32(above, a[axis], b[axis]));
        return [first, second];
    }
    [a, turned(v, above, b)]
}

/// A vector that all lanes have.
#[inline(always)]
fn constant<V: Vpu>(v: &mut V, x: DVec3) -> Vec3<V> {
    each!(axis in [0, 1, 2] => v.vset_f32(x[axis] as f32))
}

/// Clips `a -> b` to heights from `low` to `high`; the lanes of `live` in which some of it is left.
#[inline(always)]
fn clip_between<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    low: V::F32,
    high: V::F32,
    a: &mut Seen<V>,
    b: &mut Seen<V>,
) -> V::Mask {
    let lower = v.vmin(a[2], b[2]);
    let upper = v.vmax(a[2], b[2]);
    let inside = v.vcmp_ge(lower, low);
    let inside = v.vcmp_le_masked(inside, upper, high);
    let cut = v.kandn(inside, live);
    if !v.branch_any(cut) {
        return live;
    }
    clip_to(v, live, [inside, cut], [low, high], a, b)
}

/// Clips `a -> b` to heights from `low` to `high`, which lanes of `cut` are not within and those `inside` are; the lanes of `live` in which
/// some of it is left.
#[inline(always)]
fn clip_to<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    [inside, cut]: [V::Mask; 2],
    [low, high]: [V::F32; 2],
    a: &mut Seen<V>,
    b: &mut Seen<V>,
) -> V::Mask {
    // Parameters at which the edge crosses the two heights; its end points where it does not.
    let zero = v.vset_f32(0.0);
    let one = v.vset_f32(1.0);
    let rise = v.vsub(b[2], a[2]);
    let per_rise = v.vrcp(rise);
    let to_low = v.vsub(low, a[2]);
    let to_high = v.vsub(high, a[2]);
    let at_low = v.vmul(to_low, per_rise);
    let at_high = v.vmul(to_high, per_rise);
    let rising = v.vcmp_gt(rise, zero);
    let enter = v.vblend_f32(rising, at_low, at_high);
    let leave = v.vblend_f32(rising, at_high, at_low);
    let enter = v.vmax(enter, zero);
    let leave = v.vmin(leave, one);
    // A level edge is inside or outside as a whole.
    let level = v.vcmp_eq(rise, zero);
    let sloped = v.kandn(level, cut);
    let left = v.vcmp_lt_masked(sloped, enter, leave);
    let untouched = v.kand(inside, live);
    let live = v.kor(untouched, left);
    // Move the end points of the lanes that are cut; the other end stays as it is where it was inside.
    let moves_a = v.vcmp_gt_masked(left, enter, zero);
    let moves_b = v.vcmp_lt_masked(left, leave, one);
    for i in 0..3 {
        let span = v.vsub(b[i], a[i]);
        let from = a[i];
        a[i] = v.vmadd_or(from, moves_a, span, enter, from);
        b[i] = v.vmadd_or(b[i], moves_b, span, leave, from);
    }
    // Rounding must not leave a cut end on the wrong side.
    a[2] = v.vmax_or(a[2], moves_a, a[2], low);
    b[2] = v.vmax_or(b[2], moves_b, b[2], low);
    live
}

/// Two unit vectors at right angles to the unit vector `n` and to each other [duff17].
#[inline(always)]
fn basis<V: Vpu>(v: &mut V, n: Vec3<V>) -> (Vec3<V>, Vec3<V>) {
    let zero = v.vset_f32(0.0);
    let one = v.vset_f32(1.0);
    let minus_one = v.vset_f32(-1.0);
    let up = v.vcmp_ge(n[2], zero);
    let sign = v.vblend_f32(up, one, minus_one);
    let sum = v.vadd(sign, n[2]);
    let inverse = v.vrcp(sum);
    let a = v.vsub(zero, inverse);
    let xy = v.vmul(n[0], n[1]);
    let b = v.vmul(xy, a);
    let sx = v.vmul(sign, n[0]);
    let sxx = v.vmul(sx, n[0]);
    let s0 = v.vmadd(sxx, a, one);
    let s1 = v.vmul(sign, b);
    let s2 = v.vsub(zero, sx);
    let yy = v.vmul(n[1], n[1]);
    let t1 = v.vmadd(yy, a, sign);
    let t2 = v.vsub(zero, n[1]);
    ([s0, s1, s2], [b, t1, t2])
}

/// Radius of the light's footprint on the image plane at distance 1: `r (z_p - z_q) / (z_p z_q)` [algorithms, 2.2].
///
/// 0 or less where the occluder at depth `z_q` is not in front of the receiver at `z_p`. With the least depth of an edge
/// and the greatest of its receivers it is the half width of the edge's penumbra [algorithms, 2.7].
#[inline(always)]
pub fn footprint_radius<V: Vpu>(v: &mut V, radius: V::F32, z_q: V::F32, z_p: V::F32) -> V::F32 {
    // The difference first: that of the reciprocals loses all digits near contact.
    let between = v.vsub(z_p, z_q);
    let product = v.vmul(z_p, z_q);
    let num = v.vmul(radius, between);
    lrbsim_isa::math::div(v, num, product)
}
