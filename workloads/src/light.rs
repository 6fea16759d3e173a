//! Light sources.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
        /// Across the disc, any length but 0.
        #[schemars(with = "[f64; 3]")]
        normal: DVec3,
        /// 0 or more.
        radius: f64,
    },
    /// The parallelogram `center + s half_u + t half_v`, s and t in [-1, 1].
    Rect {
        /// Middle of the light.
        #[schemars(with = "[f64; 3]")]
        center: DVec3,
        /// Half of one side.
        #[schemars(with = "[f64; 3]")]
        half_u: DVec3,
        /// Half of the other side.
        #[schemars(with = "[f64; 3]")]
        half_v: DVec3,
    },
    /// The straight line from `p0` to `p1`.
    Linear {
        /// One end.
        #[schemars(with = "[f64; 3]")]
        p0: DVec3,
        /// The other end.
        #[schemars(with = "[f64; 3]")]
        p1: DVec3,
    },
    /// A point: hard shadows.
    Point {
        /// Where it is.
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

    /// Radius of the disc that kernels take the light for.
    ///
    /// Exact for sphere, disc and point. A rectangle counts as the disc of the same area, a line as one half as
    /// wide as the line is long: kernels know discs only.
    #[must_use]
    pub fn disc_radius(&self) -> f64 {
        match *self {
            Self::Sphere { radius, .. } | Self::Disc { radius, .. } => radius,
            Self::Rect { half_u, half_v, .. } => {
                (4.0 * half_u.cross(half_v).length() / core::f64::consts::PI).sqrt()
            }
            Self::Linear { p0, p1 } => (p1 - p0).length() * 0.25,
            Self::Point { .. } => 0.0,
        }
    }

    /// Unit normal of the disc that kernels take the light for; `None` if that disc turns to face each receiver.
    #[must_use]
    pub fn disc_normal(&self) -> Option<DVec3> {
        match *self {
            Self::Disc { normal, .. } => Some(normal.normalize()),
            Self::Rect { half_u, half_v, .. } => Some(half_u.cross(half_v).normalize()),
            Self::Sphere { .. } | Self::Linear { .. } | Self::Point { .. } => None,
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
