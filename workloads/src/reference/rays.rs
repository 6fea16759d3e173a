//! Shadow rays.

use core::f64::consts::TAU;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::bvh::{Bvh, Ray};
use crate::eye::EyeView;
use crate::light::{Light, LightShape};
use crate::mesh::Mesh;

/// π (3 - √5): successive samples of the spiral.
pub(crate) const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
/// Rays of a receiver from which on the triangles that may block them are collected first.
const SHAFT_RAYS_MIN: usize = 8;
/// Triangles that are tried one after the other; where more may block, the hierarchy finds them faster.
const SHAFT_TRIANGLES_MAX: usize = 2048;

/// Sample positions shared by all receivers.
#[derive(Debug, Clone)]
pub struct Rays {
    light: Light,
    /// On the unit disc, equal areas, by x; for rectangles, triangles and lines in [0, 1)².
    samples: Vec<DVec2>,
}

/// Where the samples of a light lie for one receiver.
struct Spread {
    center: DVec3,
    /// Half of the two sides of a parallelogram that holds the light: turned, for a pattern on a disc.
    half: [DVec3; 2],
    /// How far a pattern on a square or a line is shifted, around its ends; `None` for one that is turned.
    shift: Option<DVec2>,
    /// Whether the light is the half of the parallelogram whose places add up to 0 or less: the other half is folded over.
    is_half: bool,
}

impl Spread {
    /// Where a sample lies in the parallelogram, from -1 to 1 along both sides.
    fn place(&self, sample: DVec2) -> DVec2 {
        let place = match self.shift {
            Some(shift) => (sample + shift).fract() * 2.0 - DVec2::ONE,
            None => sample,
        };
        if self.is_half && place.x + place.y > 0.0 { -place } else { place }
    }

    fn target(&self, sample: DVec2) -> DVec3 {
        let [u, v] = self.half;
        let s = self.place(sample);
        self.center + u * s.x + v * s.y
    }

    /// Least and greatest place, along both sides, of what a triangle can hide from `p`, with some slack.
    fn hidden_range(&self, corners: &[DVec3; 3], p: DVec3) -> [DVec2; 2] {
        let everything = [DVec2::NEG_INFINITY, DVec2::INFINITY];
        let [u, v] = self.half;
        let across = u.cross(v);
        if u.dot(v).abs() > 1e-9 * across.length() {
            return everything; // a slanted parallelogram
        }
        let distance = (self.center - p).dot(across);
        let reach = p.abs().max_element().max(self.center.abs().max_element());
        let lengths = DVec2::new(u.length_squared(), v.length_squared());
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for corner in corners {
            let arm = *corner - p;
            // Behind the receiver or beside it, a corner has no place; seen edge-on, nor has the light.
            let stretch = distance / arm.dot(across);
            if !(stretch > 0.0 && stretch < 1e6) {
                return everything;
            }
            let at = p + arm * stretch - self.center;
            let place = DVec2::new(at.dot(u), at.dot(v)) / lengths;
            let off = 64.0 * f64::EPSILON * (reach + corner.abs().max_element()) * (1.0 + stretch);
            let slack =
                DVec2::splat(1e-6) + DVec2::splat(off) / DVec2::new(lengths.x.sqrt(), lengths.y.sqrt());
            low = low.min(place - slack);
            high = high.max(place + slack);
        }
        if low.is_finite() && high.is_finite() { [low, high] } else { everything }
    }
}

impl Rays {
    /// `count` rays a receiver; a light without extent takes one.
    #[must_use]
    pub fn new(light: &Light, count: u32) -> Self {
        let point = is_point(light);
        let count = if point { 1 } else { count.max(1) };
        let n = f64::from(count);
        let sample = |i: u32| match light {
            Light::Rect { .. } | Light::Triangle { .. } => {
                // Additive recurrence by the plastic number: even in two dimensions for any count.
                let k = f64::from(i) + 0.5;
                DVec2::new((k * 0.754_877_666_246_692_8).fract(), (k * 0.569_840_290_998_053_3).fract())
            }
            Light::Linear { .. } => DVec2::new((f64::from(i) + 0.5) / n, 0.0),
            _ if point => DVec2::ZERO,
            _ => on_spiral(i, count),
        };
        let mut samples: Vec<DVec2> = (0..count).map(sample).collect();
        samples.sort_unstable_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        Self { light: *light, samples }
    }

    /// How many rays a receiver has.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.samples.len() as u32
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
        1.0 - f64::from(self.hidden(bvh, p, own, turn)) / self.samples.len() as f64
    }

    /// How many of the rays from `p` on triangle `own` are blocked; `turn` in [0, 1) turns the pattern.
    #[must_use]
    pub fn hidden(&self, bvh: &Bvh, p: DVec3, own: u32, turn: f64) -> u32 {
        let spread = self.spread(p, turn);
        let mut near = Vec::new();
        let few = self.samples.len() >= SHAFT_RAYS_MIN
            && bvh.in_shaft(p, &spread.hull(p), SHAFT_TRIANGLES_MAX, &mut near);
        if !few {
            return self.hidden_one_by_one(bvh, p, own, turn);
        }
        self.count_hidden_by(bvh, &near, &spread, p, own)
    }

    /// How many rays a few triangles block, one after the other: of all rays, only those near a triangle are tried.
    fn count_hidden_by(&self, bvh: &Bvh, near: &[u32], spread: &Spread, p: DVec3, own: u32) -> u32 {
        if near.is_empty() {
            return 0;
        }
        let hull = spread.hull(p);
        let mut blocked = vec![false; self.samples.len()];
        let mut count = 0;
        for &place in near {
            let (triangle, corners) = bvh.found(place);
            if triangle == own || !hull.iter().any(|corner| parts(corners, p, *corner)) {
                continue;
            }
            let [low, high] = spread.hidden_range(corners, p);
            let (first, end) = if spread.shift.is_none() {
                // These lie by x.
                (
                    self.samples.partition_point(|s| s.x < low.x),
                    self.samples.partition_point(|s| s.x <= high.x),
                )
            } else {
                (0, self.samples.len())
            };
            for (sample, is_blocked) in self.samples[first..end].iter().zip(&mut blocked[first..end]) {
                let s = spread.place(*sample);
                if *is_blocked || s.cmplt(low).any() || s.cmpgt(high).any() {
                    continue;
                }
                let target = spread.target(*sample);
                let meets = Ray::new(p, target - p).triangle(corners, 0.0, 1.0).is_some();
                if meets && parts(corners, p, target) {
                    *is_blocked = true;
                    count += 1;
                }
            }
            if count as usize == self.samples.len() {
                break;
            }
        }
        count
    }

    /// How many of the rays from `p` on triangle `own` are blocked, found for each ray on its own.
    pub(super) fn hidden_one_by_one(&self, bvh: &Bvh, p: DVec3, own: u32, turn: f64) -> u32 {
        self.count_blocked(&self.spread(p, turn), |target| {
            bvh.any(p, target - p, 0.0, 1.0, |t, corners| t != own && parts(corners, p, target))
        })
    }

    fn count_blocked(&self, spread: &Spread, mut is_blocked: impl FnMut(DVec3) -> bool) -> u32 {
        self.samples.iter().map(|&sample| u32::from(is_blocked(spread.target(sample)))).sum()
    }

    fn spread(&self, p: DVec3, turn: f64) -> Spread {
        let mut center = self.light.center();
        // Two numbers of one: a rectangle is shifted along either side.
        let shift = DVec2::new(turn, (turn * 65_536.0).fract());
        let (half, shift) = match self.light {
            Light::Rect { half_u, half_v, .. } => ([half_u, half_v], Some(shift)),
            Light::Linear { p0, p1 } => ([(p1 - p0) * 0.5, DVec3::ZERO], Some(shift)),
            Light::Triangle { p0, p1, p2 } => {
                center = (p1 + p2) * 0.5;
                ([(p1 - p0) * 0.5, (p2 - p0) * 0.5], Some(shift))
            }
            Light::Sphere { .. } | Light::Disc { .. } | Light::Point { .. } => {
                let axis = match self.light.shape() {
                    LightShape::Disc { normal } => normal,
                    _ => (p - center).normalize_or(DVec3::Y),
                };
                let (u, v) = axis.any_orthonormal_pair();
                let (u, v) = (u * self.light.radius(), v * self.light.radius());
                let (sin, cos) = (libm::sin(turn * TAU), libm::cos(turn * TAU));
                ([u * cos + v * sin, v * cos - u * sin], None)
            }
        };
        let is_half = matches!(self.light, Light::Triangle { .. });
        Spread { center, half, shift, is_half }
    }
}

impl Spread {
    /// Corners of a parallelogram that holds all targets of `p`, in order, and a little more, so that rounding takes no
    /// triangle out of the shaft.
    fn hull(&self, p: DVec3) -> [DVec3; 4] {
        let [u, v] = self.half;
        let slack = 64.0 * f64::EPSILON * (self.center.abs().max_element() + p.abs().max_element());
        let across = if v == DVec3::ZERO {
            // A line has no width: give it next to none, facing the receiver.
            u.cross(self.center - p).normalize_or_zero() * (1e-6 * u.length())
        } else {
            v
        };
        let wider = |side: DVec3| side * 1.001 + side.normalize_or_zero() * slack;
        let (u, v) = (wider(u), wider(across));
        [self.center - u - v, self.center + u - v, self.center + u + v, self.center - u + v]
    }
}

/// Sample `i` of a spiral of `count` samples on the unit disc.
fn on_spiral(i: u32, count: u32) -> DVec2 {
    let (radius, angle) = (((f64::from(i) + 0.5) / f64::from(count)).sqrt(), f64::from(i) * GOLDEN_ANGLE);
    DVec2::new(libm::cos(angle), libm::sin(angle)) * radius
}

/// Samples of the unit disc, of equal areas: a spiral that turns by the golden angle [algorithms, §0].
#[must_use]
pub fn spiral(count: u32) -> Vec<DVec2> {
    (0..count).map(|i| on_spiral(i, count)).collect()
}

/// Whether all of the light is one point.
pub(super) fn is_point(light: &Light) -> bool {
    match *light {
        Light::Sphere { radius, .. } | Light::Disc { radius, .. } => radius == 0.0,
        Light::Point { .. } => true,
        Light::Linear { p0, p1 } => p0 == p1,
        Light::Triangle { p0, p1, p2 } => p0 == p1 && p0 == p2,
        Light::Rect { half_u, half_v, .. } => half_u == DVec3::ZERO && half_v == DVec3::ZERO,
    }
}

/// Whether the plane of a triangle parts two points, by more than f64 rounding can have taken them to its other side.
///
/// What starts a ray on a surface, and not on its other side, is this and no distance: a receiver on the plane of a
/// triangle is not shadowed by it, at any angle, scale or offset, nor by one whose plane the light lies in.
fn parts(corners: &[DVec3; 3], p: DVec3, target: DVec3) -> bool {
    let [a, e1, e2] = [corners[0], corners[1] - corners[0], corners[2] - corners[0]];
    let n = e1.cross(e2);
    let one_norm = |v: DVec3| v.abs().element_sum();
    let side = |x: DVec3| {
        let offset = x - a;
        // The point is off by some roundings of its coordinates; the normal by those of its products, which are large
        // beside it in a sliver.
        let slack = 16.0 * one_norm(n) * x.abs().max_element().max(a.abs().max_element())
            + 8.0 * one_norm(e1) * one_norm(e2) * one_norm(offset);
        let height = n.dot(offset);
        if height.abs() > f64::EPSILON * slack { height.signum() } else { 0.0 }
    };
    side(p) * side(target) < 0.0
}

/// What shadow rays find at the receivers of a view, and how sure they are of it.
///
/// The rays of a receiver are two patterns, each turned on its own by a hash of the pixel: two estimates that do not
/// depend on one another. Half of their difference has, root mean square, the size of the error of their mean, but for what
/// no turn changes: at most 1 by the number of rays, where an edge runs around the middle of the light. [algorithms, §0]
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Truth {
    /// Rays of either pattern.
    counts: [u32; 2],
    /// How many rays of either pattern are blocked, by receiver.
    hidden: Vec<[u32; 2]>,
}

impl Truth {
    /// Receivers that one thread computes together.
    const CHUNK: usize = 1024;

    /// How often [`Truth::new`] calls `done` for so many receivers.
    #[must_use]
    pub fn parts(receivers: usize) -> usize {
        receivers.div_ceil(Self::CHUNK)
    }

    /// Casts `samples` rays from each receiver of `eye`, at least 2; a light without extent takes one.
    ///
    /// r.m.s. error about `0.32 samples^-3/4` in the penumbra of one edge: that of one pattern of half as many samples
    /// [algorithms, §0] by √2. Runs on all threads of the pool, which call `done` now and then; the result does not
    /// depend on them.
    #[must_use]
    pub fn new(mesh: &Mesh, light: &Light, eye: &EyeView, samples: u32, done: &(dyn Fn() + Sync)) -> Self {
        let bvh = Bvh::new(mesh);
        let (counts, patterns) = Self::patterns(light, samples);
        let hidden_at = |i: usize| {
            let turns = [hash(eye.pixels[i]), hash(!eye.pixels[i])];
            let (p, own) = (eye.points[i], eye.triangles[i]);
            let first = patterns[0].hidden(&bvh, p, own, turns[0]);
            let second = if is_point(light) { first } else { patterns[1].hidden(&bvh, p, own, turns[1]) };
            [first, second]
        };
        let count = eye.points.len();
        let chunks: Vec<Vec<[u32; 2]>> = (0..Self::parts(count))
            .into_par_iter()
            .map(|chunk| {
                let end = count.min((chunk + 1) * Self::CHUNK);
                let found = (chunk * Self::CHUNK..end).map(hidden_at).collect();
                done();
                found
            })
            .collect();
        Self { counts, hidden: chunks.concat() }
    }

    /// The truth that [`Truth::hidden`] came from; `None` if it cannot have come from so many samples.
    #[must_use]
    pub fn from_hidden(light: &Light, samples: u32, hidden: Vec<[u32; 2]>) -> Option<Self> {
        let (counts, _) = Self::patterns(light, samples);
        let fits = hidden.iter().all(|[first, second]| *first <= counts[0] && *second <= counts[1]);
        fits.then_some(Self { counts, hidden })
    }

    fn patterns(light: &Light, samples: u32) -> ([u32; 2], [Rays; 2]) {
        let samples = samples.max(2);
        let patterns = [samples.div_ceil(2), samples / 2].map(|count| Rays::new(light, count));
        ([patterns[0].count(), patterns[1].count()], patterns)
    }

    /// How many rays of either pattern are blocked, by receiver.
    #[must_use]
    pub fn hidden(&self) -> &[[u32; 2]] {
        &self.hidden
    }

    /// Visible part of the light, in [0, 1], by receiver.
    #[must_use]
    pub fn visibility(&self) -> Vec<f64> {
        let all = f64::from(self.counts[0] + self.counts[1]);
        self.hidden.iter().map(|[first, second]| 1.0 - f64::from(first + second) / all).collect()
    }

    /// By how much the visibility of each receiver may be off: half of what its two patterns differ by, in [0, 1/2]. A
    /// single one says little; their root mean square over many is that of the errors of [`Truth::visibility`].
    #[must_use]
    pub fn doubt(&self) -> Vec<f64> {
        let part = |hidden: u32, count: u32| f64::from(hidden) / f64::from(count);
        let differ =
            |[first, second]: &[u32; 2]| part(*first, self.counts[0]) - part(*second, self.counts[1]);
        self.hidden.iter().map(|hidden| differ(hidden).abs() / 2.0).collect()
    }
}

/// Visibility of each receiver of `eye` by `count` rays each: that of [`Truth`].
#[must_use]
pub fn shadow_rays(mesh: &Mesh, light: &Light, eye: &EyeView, count: u32) -> Vec<f64> {
    Truth::new(mesh, light, eye, count, &|| ()).visibility()
}

/// A number in [0, 1) that differs wildly between neighbors (PCG's output permutation).
fn hash(pixel: u32) -> f64 {
    let state = pixel.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    f64::from((word >> 22) ^ word) / 4_294_967_296.0
}
