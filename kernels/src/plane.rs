//! Points against planes, most of them through the light: what the homogeneous test is made of [algorithms, 1.2].

use lrbsim_isa::Vpu;

use crate::expression::each;
use crate::record::{Field, Record};

/// A vector of three components in each of 16 lanes.
pub type Vec3<V> = [<V as Vpu>::F32; 3];

/// What f32 may make of a point on a triangle's plane, as a part of the sizes of the terms of `point . normal`: eight
/// roundings, of the point, the corner and two dot products. See [`plane_slack`].
pub const PLANE_SLACK: f32 = 1.0 / (1 << 21) as f32;

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
    let of_normal = each!(axis in [0, 1, 2] => v.vabs(normal[axis]));
    let terms = each!(corner in [corners[0], corners[1], corners[2]] => {
        let of_corner = each!(axis in [0, 1, 2] => v.vabs(corner[axis]));
        dot(v, of_corner, of_normal)
    });
    let greatest = v.vmax(terms[0], terms[1]);
    let greatest = v.vmax(greatest, terms[2]);
    let part = v.vset_f32(PLANE_SLACK);
    v.vmul(greatest, part)
}

/// The cross product `a x b` in every lane.
#[inline(always)]
pub fn cross<V: Vpu>(v: &mut V, a: Vec3<V>, b: Vec3<V>) -> Vec3<V> {
    each!(axis in [0, 1, 2] => {
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let p = v.vmul(a[i], b[j]);
        let q = v.vmul(a[j], b[i]);
        v.vsub(p, q)
    })
}

/// The difference `a - b` in every lane.
#[inline(always)]
pub fn sub<V: Vpu>(v: &mut V, a: Vec3<V>, b: Vec3<V>) -> Vec3<V> {
    [v.vsub(a[0], b[0]), v.vsub(a[1], b[1]), v.vsub(a[2], b[2])]
}

/// The product of `point` with a vector of a record, as [`dot`] has it; a component is loaded while the one before is used, with which it pairs.
#[inline(always)]
pub fn dot_of<V: Vpu, R>(
    v: &mut V,
    point: Vec3<V>,
    record: Record<V, R>,
    field: Field<R, [f32; 3]>,
) -> V::F32 {
    let z = record.float(v, field.at(2));
    let of_z = v.vmul(point[2], z);
    let y = record.float(v, field.at(1));
    let of_yz = v.vmadd(point[1], y, of_z);
    let x = record.float(v, field.at(0));
    v.vmadd(point[0], x, of_yz)
}

/// On which side of an edge's plane points lie: the sign bit is set for those right of `low -> high`.
///
/// The one predicate of umbra and penumbra [algorithms, 2.4].
#[inline(always)]
pub fn side<V: Vpu>(v: &mut V, point: Vec3<V>, normal: Vec3<V>) -> V::I32 {
    let distance = dot(v, point, normal);
    v.bits_of(distance)
}
