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
    /// The parallelogram `center + s half_u + t half_v`, s and t in [-1, 1]. No kernel draws it yet: scenes with one are
    /// refused, and only the reference rays sample it.
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
    /// The straight line from `p0` to `p1`. No kernel draws it yet: scenes with one are refused, and only the reference
    /// rays sample it.
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
