//! The homogeneous hard-shadow test.

use glam::DVec3;

/// Which side of the plane through the light and the edge `v0 v1` a receiver is on; light at the origin.
///
/// The one predicate that umbra test and sign of the penumbra share [algorithms, §2.4]. `v0` must be the vertex of
/// lower index: exactly on the plane counts as left of the edge in that order, so a receiver between two triangles
/// is in exactly one of them.
pub(super) fn is_left(p: DVec3, v0: DVec3, v1: DVec3) -> bool {
    p.dot(v0.cross(v1)) >= 0.0
}

/// The ray from the light (the origin) to a receiver, against one triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HardHit {
    /// The line through light and receiver meets the triangle.
    pub inside: bool,
    /// Where the ray from the light meets the triangle's plane: 0 at the light, 1 at the receiver.
    pub t: f64,
}

/// How far along its normal f32 may take a point off the plane of triangle `v`: eight roundings of the terms of
/// `point . normal`, as the kernels have it.
pub(super) fn plane_slack(v: [DVec3; 3]) -> f64 {
    const ROUNDINGS: f64 = 1.0 / (1 << 21) as f64;
    let n = (v[1] - v[0]).cross(v[2] - v[0]);
    ROUNDINGS * v.map(|p| p.abs().dot(n.abs())).into_iter().fold(0.0, f64::max)
}

/// Greatest [`HardHit::t`] at which triangle `v` shadows: it must be nearer than the receiver by more than its
/// [`plane_slack`].
pub(super) fn greatest_t(v: [DVec3; 3]) -> f64 {
    let n = (v[1] - v[0]).cross(v[2] - v[0]);
    let distance = v[0].dot(n).abs();
    distance / (distance + plane_slack(v))
}

/// Tests triangle `v` with vertex numbers `index` against receiver `p`; `None` if it is edge-on to the light.
///
/// No division before `t`, no clipping: right for triangles that cross the light's plane. [algorithms, §1.2]
#[must_use]
pub fn hard_test(v: [DVec3; 3], index: [u32; 3], p: DVec3) -> Option<HardHit> {
    let n = (v[1] - v[0]).cross(v[2] - v[0]);
    let det = v[0].dot(n);
    if det == 0.0 {
        return None;
    }
    let left = |i: usize, j: usize| {
        if index[i] < index[j] { is_left(p, v[i], v[j]) } else { !is_left(p, v[j], v[i]) }
    };
    let first = left(0, 1);
    Some(HardHit { inside: left(1, 2) == first && left(2, 0) == first, t: det / p.dot(n) })
}
