//! Shadow rays.

use core::f64::consts::TAU;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::eye::EyeView;
use crate::light::Light;
use crate::mesh::Mesh;

/// Hits nearer than this part of the ray are the receiver's own surface, whose points carry f64 rounding.
const SELF_HIT_EPS: f64 = 1e-8;
/// π (3 - √5): successive samples of the spiral.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// Sample positions shared by all receivers.
#[derive(Debug, Clone)]
pub struct Rays {
    light: Light,
    /// On the unit disc, equal areas; for rectangles and lines in [-1, 1]².
    samples: Vec<DVec2>,
}

impl Rays {
    /// `count` rays a receiver; a point light, or a radius of 0, takes one.
    #[must_use]
    pub fn new(light: &Light, count: u32) -> Self {
        let point = match light {
            Light::Rect { .. } | Light::Linear { .. } => false,
            round => round.disc_radius() == 0.0,
        };
        let count = if point { 1 } else { count.max(1) };
        let n = f64::from(count);
        let sample = |i: u32| match light {
            Light::Rect { .. } => {
                // Additive recurrence by the plastic number: even in two dimensions for any count.
                let k = f64::from(i) + 0.5;
                DVec2::new((k * 0.754_877_666_246_692_8).fract(), (k * 0.569_840_290_998_053_3).fract())
            }
            Light::Linear { .. } => DVec2::new((f64::from(i) + 0.5) / n, 0.0),
            _ if point => DVec2::ZERO,
            _ => {
                let (radius, angle) = (((f64::from(i) + 0.5) / n).sqrt(), f64::from(i) * GOLDEN_ANGLE);
                DVec2::new(libm::cos(angle), libm::sin(angle)) * radius
            }
        };
        Self { light: *light, samples: (0..count).map(sample).collect() }
    }

    /// How far the pattern is turned at pixel or receiver `number`, in [0, 1): by the golden section from one to the
    /// next, so that few rays do not show as bands.
    #[must_use]
    pub fn turn(number: u32) -> f64 {
        (f64::from(number) * 0.618_033_988_749_895).fract()
    }

    /// Visible part of the light, in [0, 1], from `p` on triangle `own`; `turn` in [0, 1) turns the pattern.
    #[must_use]
    pub fn visibility(&self, bvh: &Bvh, p: DVec3, own: u32, turn: f64) -> f64 {
        let (sin, cos) = (libm::sin(turn * TAU), libm::cos(turn * TAU));
        let center = self.light.center();
        let [u, v] = match self.light {
            Light::Rect { half_u, half_v, .. } => [half_u, half_v],
            Light::Linear { p0, p1 } => [(p1 - p0) * 0.5, DVec3::ZERO],
            _ => {
                let axis = self.light.disc_normal().unwrap_or_else(|| (p - center).normalize_or(DVec3::Y));
                let (u, v) = axis.any_orthonormal_pair();
                [u * self.light.disc_radius(), v * self.light.disc_radius()]
            }
        };
        let target = |s: DVec2| match self.light {
            // A pattern on a square or a line is shifted around instead of turned.
            Light::Rect { .. } | Light::Linear { .. } => {
                let x = (s + DVec2::splat(turn)).fract() * 2.0 - DVec2::ONE;
                center + u * x.x + v * x.y
            }
            _ => center + u * (s.x * cos - s.y * sin) + v * (s.x * sin + s.y * cos),
        };
        let blocked =
            |s: &&DVec2| bvh.any(p, target(**s) - p, SELF_HIT_EPS, 1.0 - SELF_HIT_EPS, |t| t != own);
        let hidden = self.samples.iter().filter(blocked).count();
        1.0 - hidden as f64 / self.samples.len() as f64
    }
}

/// Visibility of each receiver of `eye` by `count` rays each. r.m.s. error about `0.27 count^-3/4` in a one-edge
/// penumbra [algorithms, §0]. Runs on all host threads; the result does not depend on them.
#[must_use]
pub fn shadow_rays(mesh: &Mesh, light: &Light, eye: &EyeView, count: u32) -> Vec<f64> {
    let bvh = Bvh::new(mesh);
    let rays = Rays::new(light, count);
    (0..eye.points.len())
        .into_par_iter()
        .map(|i| rays.visibility(&bvh, eye.points[i], eye.triangles[i], hash(eye.pixels[i])))
        .collect()
}

/// A number in [0, 1) that differs wildly between neighbors (PCG's output permutation).
fn hash(pixel: u32) -> f64 {
    let state = pixel.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    f64::from((word >> 22) ^ word) / 4_294_967_296.0
}
