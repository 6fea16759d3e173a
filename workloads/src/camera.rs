//! Pinhole cameras.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A pinhole camera as in a scene file. Right-handed; pixel rows run downwards.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Position of the eye, world units.
    #[schemars(with = "[f64; 3]")]
    pub eye: DVec3,
    /// Point in the middle of the picture; not equal to `eye`.
    #[schemars(with = "[f64; 3]")]
    pub target: DVec3,
    /// Direction that points up in the picture; not parallel to the view. `[0, 1, 0]` if left out.
    #[serde(default = "y_axis")]
    #[schemars(with = "[f64; 3]")]
    pub up: DVec3,
    /// Angle between the lowest and the highest ray, in degrees, in (0, 180).
    pub fov_y_degrees: f64,
}

fn y_axis() -> DVec3 {
    DVec3::Y
}

/// Picture size in pixels, each side in 1..=16384.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageSize {
    /// Columns of the picture.
    pub width: u32,
    /// Rows of the picture.
    pub height: u32,
}

/// Axes of a camera: the ray through (x, y) in [-1, 1]² is `forward + x * right + y * up`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axes {
    pub forward: DVec3,
    pub right: DVec3,
    pub up: DVec3,
}

impl Camera {
    /// Axes for a picture of `size`; square pixels. The camera must be valid.
    pub(crate) fn axes(&self, size: ImageSize) -> Axes {
        let forward = (self.target - self.eye).normalize();
        let right = forward.cross(self.up.normalize()).normalize();
        let up = right.cross(forward);
        let half_height = libm::tan(self.fov_y_degrees.to_radians() * 0.5);
        let half_width = half_height * f64::from(size.width) / f64::from(size.height);
        Axes { forward, right: right * half_width, up: up * half_height }
    }

    /// Direction (not normalized) through the center of pixel (`x`, `y`).
    #[must_use]
    pub fn direction(&self, size: ImageSize, x: u32, y: u32) -> DVec3 {
        self.axes(size).direction(size, x, y)
    }
}

impl Axes {
    pub fn direction(&self, size: ImageSize, x: u32, y: u32) -> DVec3 {
        let s = (f64::from(x) + 0.5) / f64::from(size.width) * 2.0 - 1.0;
        let t = 1.0 - (f64::from(y) + 0.5) / f64::from(size.height) * 2.0;
        self.forward + self.right * s + self.up * t
    }
}
