//! Light sources.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::mesh::distance_to_triangle;
use crate::reference::{GOLDEN_ANGLE, spiral};

/// An area light, in world units. A directional light is a far one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Light {
    /// Seen from any receiver as the disc of `radius` through `center` that faces the receiver [algorithms, §0].
    Sphere {
        /// Middle of the light.
        #[schemars(with = "[f64; 3]")]
        center: DVec3,
        /// 0 or more; 0 gives hard shadows.
        radius: f64,
    },
    /// A disc that does not turn; shines to both sides.
    Disc {
        /// Middle of the light.
        #[schemars(with = "[f64; 3]")]
        center: DVec3,
        /// Direction across the disc, any length but 0.
        #[schemars(with = "[f64; 3]")]
        normal: DVec3,
        /// Radius of the disc, 0 or more.
        radius: f64,
    },
    /// The parallelogram `center + s half_u + t half_v`, s and t in [-1, 1]. No kernel draws it yet: scenes with one
    /// are refused, and only the reference rays sample it.
    Rect {
        /// Middle of the light.
        #[schemars(with = "[f64; 3]")]
        center: DVec3,
        /// Half of one side of the parallelogram.
        #[schemars(with = "[f64; 3]")]
        half_u: DVec3,
        /// Half of the other side of the parallelogram.
        #[schemars(with = "[f64; 3]")]
        half_v: DVec3,
    },
    /// The straight line from `p0` to `p1`. No kernel draws it yet: scenes with one are refused, and only the reference
    /// rays sample it.
    Linear {
        /// One end of the line.
        #[schemars(with = "[f64; 3]")]
        p0: DVec3,
        /// The other end.
        #[schemars(with = "[f64; 3]")]
        p1: DVec3,
    },
    /// A point: hard shadows.
    Point {
        /// Place of the light.
        #[schemars(with = "[f64; 3]")]
        center: DVec3,
    },
}

impl Light {
    /// Middle of the light: origin of the light-centred coordinates.
    #[must_use]
    pub fn center(&self) -> DVec3 {
        match *self {
            Self::Sphere { center, .. }
            | Self::Disc { center, .. }
            | Self::Rect { center, .. }
            | Self::Point { center } => center,
            Self::Linear { p0, p1 } => p0 * 0.5 + p1 * 0.5,
        }
    }

    /// Radius of the disc that kernels take the light for: of a sphere, a disc or a point.
    ///
    /// # Panics
    /// If the light is a rectangle or a line, which no kernel draws and no scene may have.
    #[must_use]
    pub fn disc_radius(&self) -> f64 {
        match *self {
            Self::Sphere { radius, .. } | Self::Disc { radius, .. } => radius,
            Self::Point { .. } => 0.0,
            Self::Rect { .. } | Self::Linear { .. } => panic!("no kernel draws {self:?}"),
        }
    }

    /// Unit normal of the disc that kernels take the light for; `None` if that disc turns to face each receiver.
    ///
    /// # Panics
    /// As [`Light::disc_radius`].
    #[must_use]
    pub fn disc_normal(&self) -> Option<DVec3> {
        match *self {
            Self::Disc { normal, .. } => Some(normal.normalize()),
            Self::Sphere { .. } | Self::Point { .. } => None,
            Self::Rect { .. } | Self::Linear { .. } => panic!("no kernel draws {self:?}"),
        }
    }

    /// How near a triangle comes to the middle of the light where it could cut it, world units: anywhere for a sphere,
    /// whose disc turns, and in its own plane for a disc, infinite if it does not meet that. Nearer than
    /// [`Light::disc_radius`], it cuts it.
    ///
    /// # Panics
    /// As [`Light::disc_radius`].
    #[must_use]
    pub fn distance_to(&self, corners: [DVec3; 3]) -> f64 {
        let center = self.center();
        match self.disc_normal() {
            None => distance_to_triangle(center, corners),
            Some(normal) => cut_by_plane(corners, center, normal)
                .map_or(f64::INFINITY, |[a, b]| distance_to_triangle(center, [a, b, b])),
        }
    }

    /// `count` equal lights, each as bright as the `count`th part of this one, that lie over it as evenly as can be: together
    /// they are nearly the same light, and each has the silhouettes that it sees itself [johnson09, §5.1]. A light without
    /// extent stays one.
    ///
    /// Their radius is that of a disc of the `count`th part of the area, and their middles spread so far that the second
    /// moments agree. Those of a disc lie on a spiral on it; those of a sphere in a ball, so dense that from every side they
    /// seem to lie evenly on a disc.
    #[must_use]
    pub fn split(self, count: u32) -> Vec<Self> {
        let n = f64::from(count);
        let (part, spread) = ((1.0 / n).sqrt(), (1.0 - 1.0 / n).sqrt());
        // Few places are not quite even: their mean is put back into the middle.
        let about = |center: DVec3, places: Vec<DVec3>, radius: f64| {
            let mean = places.iter().sum::<DVec3>() / n;
            places.into_iter().map(move |place| center + (place - mean) * (radius * spread))
        };
        match self {
            _ if count <= 1 => vec![self],
            Self::Sphere { center, radius } if radius > 0.0 => {
                let places = (0..count).map(|i| in_ball(i, count)).collect();
                let part = |center| Self::Sphere { center, radius: radius * part };
                about(center, places, radius).map(part).collect()
            }
            Self::Disc { center, normal, radius } if radius > 0.0 => {
                let (u, v) = normal.normalize().any_orthonormal_pair();
                let places = spiral(count).into_iter().map(|at| u * at.x + v * at.y).collect();
                let part = |center| Self::Disc { center, normal, radius: radius * part };
                about(center, places, radius).map(part).collect()
            }
            _ => vec![self],
        }
    }

    /// The same light with another radius; `None` for kinds that have none.
    #[must_use]
    pub fn with_radius(self, radius: f64) -> Option<Self> {
        match self {
            Self::Sphere { center, .. } => Some(Self::Sphere { center, radius }),
            Self::Disc { center, normal, .. } => Some(Self::Disc { center, normal, radius }),
            Self::Point { center } => Some(Self::Sphere { center, radius }),
            Self::Rect { .. } | Self::Linear { .. } => None,
        }
    }
}

/// Place `i` of `count` in the unit ball, so dense that they lie evenly on the disc that is seen from any side: in proportion
/// to `1 / sqrt(1 - r²)`.
fn in_ball(i: u32, count: u32) -> DVec3 {
    // A spiral around a sphere, outward and inward by the bits of the number read backward.
    let along = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(count);
    let angle = f64::from(i) * GOLDEN_ANGLE;
    let across = (1.0 - along * along).sqrt();
    let direction = DVec3::new(across * libm::cos(angle), across * libm::sin(angle), along);
    let part = (f64::from(i.reverse_bits()) + 0.5 * 4_294_967_296.0 / f64::from(count)) / 4_294_967_296.0;
    // The part of the ball within r is (2/pi) (asin r - r sqrt(1 - r²)).
    let within = |r: f64| core::f64::consts::FRAC_2_PI * (libm::asin(r) - r * (1.0 - r * r).sqrt());
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if within(middle) < part.min(1.0) { low = middle } else { high = middle }
    }
    direction * low
}

/// Where a triangle crosses the plane through `center` across `normal`: a line from end to end; `None` where it does
/// not.
fn cut_by_plane(corners: [DVec3; 3], center: DVec3, normal: DVec3) -> Option<[DVec3; 2]> {
    let heights = corners.map(|corner| (corner - center).dot(normal));
    let crosses = heights.iter().any(|height| *height > 0.0) && heights.iter().any(|height| *height < 0.0);
    let mut points = (0..3).filter(|_| crosses).filter_map(|i| {
        let (j, from, to) = ((i + 1) % 3, heights[i], heights[(i + 1) % 3]);
        (from == 0.0 || from * to < 0.0).then(|| corners[i].lerp(corners[j], from / (from - to)))
    });
    Some([points.next()?, points.next()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a light seen along each axis has for second moments about its middle, over its radius squared: 1/4 for a disc.
    fn moments(parts: &[Light], radius: f64) -> DVec3 {
        let own = parts[0].disc_radius().powi(2) / 4.0;
        let sum: DVec3 = parts.iter().map(|part| part.center() * part.center()).sum();
        (sum / parts.len() as f64 + own) / radius.powi(2)
    }

    #[test]
    fn parts_of_a_light_have_its_area_its_middle_and_its_spread() {
        let radius = 3.0;
        let sphere = Light::Sphere { center: DVec3::ZERO, radius };
        let disc = Light::Disc { center: DVec3::ZERO, normal: DVec3::Z, radius };
        for count in [4_u32, 16, 64] {
            for light in [sphere, disc] {
                let parts = light.split(count);
                let area: f64 = parts.iter().map(|part| part.disc_radius().powi(2)).sum();
                assert!((area - radius * radius).abs() < 1e-12, "{count} parts of {light:?}");
                let middle: DVec3 = parts.iter().map(|part| part.center()).sum();
                let off = middle.length() / f64::from(count) / radius;
                assert!(off < 1e-12, "{count} parts of {light:?}: the middle is off by {off}");
                let most = 0.8 / f64::from(count).sqrt();
                let moments = moments(&parts, radius);
                let axes =
                    if light == disc { vec![moments.x, moments.y] } else { moments.to_array().to_vec() };
                for moment in axes {
                    assert!((moment - 0.25).abs() < 0.25 * most, "{count} parts of {light:?}: {moment}");
                }
            }
        }
        assert_eq!(sphere.split(1), [sphere]);
        let point = Light::Point { center: DVec3::ONE };
        assert_eq!(point.split(16), [point]);
    }

    #[test]
    fn a_light_touches_what_reaches_into_it() {
        let triangle = |height| {
            [DVec3::new(-4.0, height, -4.0), DVec3::new(4.0, height, -4.0), DVec3::new(0.0, height, 5.0)]
        };
        let touches = |light: Light, height| light.distance_to(triangle(height)) < light.disc_radius();
        let center = DVec3::Y;
        let sphere = Light::Sphere { center, radius: 0.5 };
        assert!(touches(sphere, 0.6) && !touches(sphere, 0.4));
        assert!(!touches(Light::Point { center }, 1.0));
        // A lamp set into a ceiling is not cut by it.
        let lamp = Light::Disc { center, normal: DVec3::NEG_Y, radius: 0.5 };
        assert!(!touches(lamp, 1.001) && !touches(lamp, 1.0));
        let upright = Light::Disc { center, normal: DVec3::X, radius: 0.5 };
        assert!(touches(upright, 1.4) && !touches(upright, 1.6));
    }
}
