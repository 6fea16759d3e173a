//! The printed form by brute force.

use glam::{DVec2, DVec3};

use super::occluders::{ObjectRule, Occluders, covered, of_receivers};
use super::segment::area_beyond;
use crate::shadow_input::ShadowInput;

/// Part of an edge's least distance from the light below which its points leave the image plane. They touch no receiver of a 90 degree
/// view, unless the light's radius is 0.7 of that distance: a point at depth z would have to lie within `r + sqrt(2) z` of the axis.
const CLIP: f64 = 0.2;

/// The image plane of a view from the light: axes x, y and z, at depth 1 along z.
#[derive(Debug, Clone, Copy)]
pub struct ImagePlane {
    axes: [DVec3; 3],
}

impl ImagePlane {
    /// The plane of the face of the grid that receiver `p` (light-centred) lies in: along its largest component, the last of equal
    /// ones but x before y.
    #[must_use]
    pub fn of_face(p: DVec3) -> Self {
        let size = p.abs();
        let axis = if size.z > size.x.max(size.y) {
            2
        } else if size.y > size.x {
            1
        } else {
            0
        };
        Self::along(DVec3::AXES[axis] * p[axis].signum())
    }

    /// A plane across `axis`, a unit vector.
    #[must_use]
    pub fn along(axis: DVec3) -> Self {
        let (x, y) = axis.any_orthonormal_pair();
        Self { axes: [x, y, axis] }
    }

    /// A point as the view has it: image and depth in one.
    fn seen(self, p: DVec3) -> DVec3 {
        DVec3::from(self.axes.map(|axis| p.dot(axis)))
    }
}

/// Image of a point that a view sees.
fn image(p: DVec3) -> DVec2 {
    p.truncate() / p.z
}

/// Radius of the light's footprint on the image plane of a receiver at depth `z_p` for an occluder at `z_q`; 0 or less where that is
/// not in front of the receiver. [johnson09, §2.3; algorithms, §2.2]
#[must_use]
pub fn footprint_radius(radius: f64, z_q: f64, z_p: f64) -> f64 {
    radius * (z_p - z_q) / (z_p * z_q)
}

/// [`Occluders`] as the paper has them: one circle per edge and receiver, on an image plane.
///
/// A receiver's own triangle and triangles that the light is cut by, of which the paper says nothing, are taken out as in the exact
/// form.
pub struct AsPrinted<'a>(pub &'a Occluders);

impl AsPrinted<'_> {
    /// The part of the circle of receiver `p` that is beyond the edge from `a` to `b`, unsigned.
    fn part(&self, p: DVec3, plane: ImagePlane, a: DVec3, b: DVec3) -> f64 {
        let along = b - a;
        let foot = -a.dot(along) / along.length_squared();
        let foot = if foot.is_nan() { 0.0 } else { foot.clamp(0.0, 1.0) };
        let floor = CLIP * (a + along * foot).length();
        let (p, mut a, mut b) = (plane.seen(p), plane.seen(a), plane.seen(b));
        if a.z < floor && b.z < floor {
            return 0.0;
        }
        let cut = a + (b - a) * ((floor - a.z) / (b.z - a.z));
        if a.z < floor {
            a = cut;
        }
        if b.z < floor {
            b = cut;
        }
        let (from, to, at) = (image(a), image(b), image(p));
        let e = to - from;
        if e.length_squared() == 0.0 {
            return 0.0;
        }
        // q: depth along a projected edge is linear in its reciprocal.
        let s = ((at - from).dot(e) / e.length_squared()).clamp(0.0, 1.0);
        let z_q = 1.0 / ((1.0 - s) / a.z + s / b.z);
        let footprint = footprint_radius(self.0.radius, z_q, p.z);
        if footprint <= 0.0 { 0.0 } else { area_beyond((from - at) / footprint, (to - at) / footprint) }
    }

    /// The sums (F, B) at receiver `p` (light-centred), which lies on triangle `own`, not clamped.
    #[must_use]
    pub fn sums(&self, p: DVec3, own: u32, plane: ImagePlane) -> (f64, f64) {
        self.0.sums_of(p, own, |_, v0, v1| self.part(p, plane, v0, v1))
    }

    /// Visible part of the light, in [0, 1], at receiver `p`, see [`Occluders::coverage_at`].
    #[must_use]
    pub fn visibility_at(&self, p: DVec3, own: u32, plane: ImagePlane) -> f64 {
        1.0 - covered(self.sums(p, own, plane), self.0.cut_sums(p, own))
    }

    /// [`Occluders::visibility_by_object`] of each receiver of `input`, which the occluders were made from, on the image plane of its face.
    #[must_use]
    pub fn visibility_by_object(&self, input: &ShadowInput, rule: ObjectRule) -> Vec<f64> {
        of_receivers(input, |p, own| {
            let plane = ImagePlane::of_face(p);
            self.0.by_object(p, own, |_, v0, v1| self.part(p, plane, v0, v1), rule)
        })
    }

    /// Visibility of each receiver of `input`, which the occluders were made from, on the image plane of its face.
    #[must_use]
    pub fn visibility(&self, input: &ShadowInput) -> Vec<f64> {
        of_receivers(input, |p, own| self.visibility_at(p, own, ImagePlane::of_face(p)))
    }
}
