//! Triangles as seen from the light: the homogeneous test of a point against planes through the light.

use lrbsim_isa::{Addr, Vpu};

/// Three floats a lane.
pub type Vec3<V> = [<V as Vpu>::F32; 3];

/// What f32 may make of a point on a triangle's plane, as a part of the sizes of the terms of `point . normal`: eight
/// roundings, of the point, the corner and two dot products. See [`plane_slack`].
pub const PLANE_SLACK: f32 = 1.0 / (1 << 21) as f32;

/// Words of a triangle's record: one line.
///
/// `0..9` normals of the planes through the light and the edges 01, 12, 20, each `low x high` by vertex number;
/// `9..12` normal of the triangle, away from the light; `12` its plane, farther by [`plane_slack`];
/// `13..16` flags of the three edges: sign bit set where the triangle lies right of `low -> high`; in `13` also
/// [`FRONT`], [`BACK`], [`AWAY`], and from bit [`FACES_SHIFT`] on the faces around the light that it can shadow.
pub const TRIANGLE_WORDS: u32 = 16;

/// The triangle is a layer of the sum F.
pub const FRONT: i32 = 1;
/// The triangle is a layer of the sum B.
pub const BACK: i32 = 2;
/// The determinant of its corners is positive: it faces away from the light.
pub const AWAY: i32 = 4;
/// Where in the flags the bits of the faces begin.
pub const FACES_SHIFT: i32 = 8;

/// `a . b`, in the one order of operations that all kernels share: predicates must agree to the last bit.
#[inline(always)]
pub fn dot<V: Vpu>(v: &mut V, a: Vec3<V>, b: Vec3<V>) -> V::F32 {
    let z = v.vmul(a[2], b[2]);
    let yz = v.vmadd(a[1], b[1], z);
    v.vmadd(a[0], b[0], yz)
}

/// Normal of the plane through the light and the edge `low -> high`: `low x high`, formed as `low x (high - low)`.
///
/// Of two long vectors that are nearly the same the product would lose all digits that tell them apart: under a light a
/// thousand scenes away planes would be off by half a scene. The ends are ordered by vertex number, so that all who share an
/// edge get the same bits [algorithms, 1.2].
#[inline(always)]
pub fn edge_normal<V: Vpu>(v: &mut V, low: Vec3<V>, high: Vec3<V>) -> Vec3<V> {
    let along = sub(v, high, low);
    cross(v, low, along)
}

/// How much farther along its `normal` than a triangle's plane a point must lie to be shadowed by it: rounding of f32,
/// nothing else; it replaces slope bias [algorithms, 1.2].
///
/// Not a part of the distance: that would be too little for a plane that is nearly edge-on to the light, and let light in
/// behind leaves and at contacts under a far one.
#[inline(always)]
pub fn plane_slack<V: Vpu>(v: &mut V, corners: [Vec3<V>; 3], normal: Vec3<V>) -> V::F32 {
    let size = |v: &mut V, a: Vec3<V>| [v.vabs(a[0]), v.vabs(a[1]), v.vabs(a[2])];
    let of_normal = size(v, normal);
    let mut terms = |corner: Vec3<V>| {
        let of_corner = size(v, corner);
        dot(v, of_corner, of_normal)
    };
    let terms = corners.map(&mut terms);
    let greatest = v.vmax(terms[0], terms[1]);
    let greatest = v.vmax(greatest, terms[2]);
    let part = v.vset_f32(PLANE_SLACK);
    v.vmul(greatest, part)
}

/// `a x b`.
#[inline(always)]
pub fn cross<V: Vpu>(v: &mut V, a: Vec3<V>, b: Vec3<V>) -> Vec3<V> {
    let mut component = |i: usize, j: usize| {
        let p = v.vmul(a[i], b[j]);
        let q = v.vmul(a[j], b[i]);
        v.vsub(p, q)
    };
    [component(1, 2), component(2, 0), component(0, 1)]
}

/// `a - b`.
#[inline(always)]
pub fn sub<V: Vpu>(v: &mut V, a: Vec3<V>, b: Vec3<V>) -> Vec3<V> {
    [v.vsub(a[0], b[0]), v.vsub(a[1], b[1]), v.vsub(a[2], b[2])]
}

/// Three consecutive words of a record, each in every lane.
#[inline(always)]
pub fn broadcast3<V: Vpu>(v: &mut V, records: Addr, index: V::S32) -> Vec3<V> {
    [
        v.vbroadcast_f32(records, index),
        v.vbroadcast_f32(records.plus(4), index),
        v.vbroadcast_f32(records.plus(8), index),
    ]
}

/// On which side of an edge's plane points lie: the sign bit is set for those right of `low -> high`.
///
/// The one predicate of umbra and penumbra [algorithms, 2.4].
#[inline(always)]
pub fn side<V: Vpu>(v: &mut V, point: Vec3<V>, normal: Vec3<V>) -> V::I32 {
    let distance = dot(v, point, normal);
    v.bits_of(distance)
}

/// Points of `live` that the triangle of record `index` (in words) hides from the light.
///
/// * `points`: light-centred.
/// * `triangles`, `own`: records; number of the triangle that each point lies on, which does not shadow it.
/// * `number`: the record's triangle, in every lane.
///
/// Homogeneous test of [algorithms, 1.2]: no division, right for triangles that cross the light's plane. 30 operations
/// for a miss by the edges: 12 broadcast loads, 16 vector operations, a mask test and a branch. 9 more for the plane.
#[inline(always)]
pub fn hidden<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    points: Vec3<V>,
    own: V::I32,
    number: V::I32,
    triangles: Addr,
    index: V::S32,
) -> V::Mask {
    // Inside: on the triangle's side of all three edge planes; sign bits of side and flag agree.
    let mut outside = None;
    for edge in 0..3 {
        let normal = broadcast3(v, triangles.plus(12 * edge), index);
        let side = side(v, points, normal);
        let flag = v.vbroadcast_i32(triangles.plus(52 + 4 * edge), index);
        let differs = v.vxor(side, flag);
        outside = Some(match outside {
            None => differs,
            Some(before) => v.vor(before, differs),
        });
    }
    let zero = v.vset_i32(0);
    let inside = match outside {
        Some(signs) => v.vicmp_ge_masked(live, signs, zero),
        None => live,
    };
    if !v.branch_any(inside) {
        return inside;
    }
    // Beyond the plane, and not on the triangle itself.
    let normal = broadcast3(v, triangles.plus(36), index);
    let plane = v.vbroadcast_f32(triangles.plus(48), index);
    let depth = dot(v, points, normal);
    let beyond = v.vcmp_gt_masked(inside, depth, plane);
    v.vicmp_neq_masked(beyond, own, number)
}
