//! The geometry of one micro-patch, by axis: what of the image plane its penumbra reaches, and what part of the light it hides
//! [atty06, §3.3, §3.4].
//!
//! All is said by places on the image plane and reciprocal depths, which maps hold: a patch from x0 to x1 at depth z_P is
//! `x0 / z_P` to `x1 / z_P` there, and the paper's `(x0 z_R - x z_P) / (z_R - z_P)`, where the line from a receiver past an edge of
//! the patch meets the light, becomes a difference of places over a difference of reciprocal depths.

use lrbsim_isa::Vpu;

/// How far a penumbra reaches beyond its patch on the image plane, for a light of half width `half`, on what is no deeper than the
/// reciprocal depth `farthest`: `L / 2 (1 / z_P - 1 / z_R)`, below 0 where nothing lies behind the patch.
#[inline(always)]
pub fn reach<V: Vpu>(v: &mut V, patch: V::F32, farthest: V::F32, half: V::F32) -> V::F32 {
    let between = v.vsub(patch, farthest);
    v.vmul(between, half)
}

/// Numbers that are the same for all patches and receivers, each loaded once.
pub struct Numbers<V: Vpu> {
    zero: V::F32,
    half: V::F32,
    one: V::F32,
}

impl<V: Vpu> Numbers<V> {
    /// Loads the numbers.
    #[inline(always)]
    pub fn new(v: &mut V) -> Numbers<V> {
        Numbers { zero: v.vset_f32(0.0), half: v.vset_f32(0.5), one: v.vset_f32(1.0) }
    }

    /// What a difference of places on the image plane is on the light, seen from receivers at reciprocal depth `receiver` past a
    /// patch at `patch`; 0 where the patch is not nearer to the light than the receiver, so that it hides nothing. Three operations.
    #[inline(always)]
    pub fn per_place(&self, v: &mut V, patch: V::F32, receiver: V::F32) -> V::F32 {
        let between = v.vsub(patch, receiver);
        let before = v.vcmp_gt(between, self.zero);
        v.vrcp_or(self.zero, before, between)
    }

    /// Where the line from a receiver past an edge meets the light, along one axis: 0 and 1 at its ends. `from`: from the place of the
    /// receiver to that of the edge; `per_place` in widths of the light. One operation.
    #[inline(always)]
    pub fn reprojected(&self, v: &mut V, from: V::F32, per_place: V::F32) -> V::F32 {
        v.vmadd(from, per_place, self.half)
    }

    /// Part of the light between two places on it. Four operations; of places side by side the parts add up.
    #[inline(always)]
    pub fn between(&self, v: &mut V, low: V::F32, high: V::F32) -> V::F32 {
        let low = v.vmax(low, self.zero);
        let high = v.vmin(high, self.one);
        let part = v.vsub(high, low);
        v.vmax(part, self.zero)
    }
}

/// Depth of the tip of a penumbra, between light and patch, for a light and a patch of these widths: `z_P r / (1 + r)` with
/// `r = L / P` [atty06, §3.3].
///
/// The paper calls it z_O, and by the same letter the depth of the occluder in §5 and Appendix A.
pub fn apex(light: f64, patch: f64, depth: f64) -> f64 {
    depth * light / (patch + light)
}

/// Extent on the light by which two patches that are neighbors overlap or gape, `step` apart in depth, seen from `x` beside the place
/// where they join [atty06, Eq. 1, whose sign is that of x1 - x2; algorithms, 4.4].
pub fn overlap(depth: f64, step: f64, receiver: f64, x: f64) -> f64 {
    (x * receiver * step / ((receiver - depth) * (receiver - depth - step))).abs()
}

/// Farthest that the `x` of [`overlap`] can be, for a light of width `light` [atty06, Eq. 2].
pub fn overlap_from(depth: f64, receiver: f64, light: f64) -> f64 {
    0.5 * light * (receiver - depth) / depth
}

/// Most that [`overlap`] can be, for a light of width `light` [atty06, Eq. 3].
pub fn overlap_bound(depth: f64, step: f64, receiver: f64, light: f64) -> f64 {
    (0.5 * light * receiver * step / (depth * (receiver - depth - step))).abs()
}

/// Part of the light's width that a patch hides, seen from receivers at reciprocal depth `receiver`: `texel` is its width on the
/// image plane, `2 tan(alpha) / N`, and `patch` its reciprocal depth.
pub fn patch_width(texel: f64, patch: f64, receiver: f64, light: f64) -> f64 {
    texel / ((patch - receiver) * light)
}

/// Part of the light's width that a patch must hide so that floats of 16 bits do not lose it beside the whole light: a 32nd,
/// whose square is a unit of the last of ten digits [atty06, Eq. 4].
pub const F16_WIDTH: f64 = 1.0 / 32.0;
