//! Light sources.

use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bvh::Ray;
use crate::mesh::distance_to_triangle;
use crate::reference::GOLDEN_ANGLE;

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
    /// The parallelogram `center + s half_u + t half_v`, s and t in [-1, 1]; shines to both sides.
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
    /// The straight line from `p0` to `p1`, which has no width.
    Linear {
        /// One end of the line.
        #[schemars(with = "[f64; 3]")]
        p0: DVec3,
        /// The other end.
        #[schemars(with = "[f64; 3]")]
        p1: DVec3,
    },
    /// The triangle between three corners; shines to both sides.
    Triangle {
        /// First corner.
        #[schemars(with = "[f64; 3]")]
        p0: DVec3,
        /// Second corner.
        #[schemars(with = "[f64; 3]")]
        p1: DVec3,
        /// Third corner.
        #[schemars(with = "[f64; 3]")]
        p2: DVec3,
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
            Self::Triangle { p0, p1, p2 } => (p0 + p1 + p2) / 3.0,
        }
    }

    /// Distance from the middle of the light to what of it is farthest; 0 for a point.
    #[must_use]
    pub fn radius(&self) -> f64 {
        match *self {
            Self::Sphere { radius, .. } | Self::Disc { radius, .. } => radius,
            Self::Rect { half_u, half_v, .. } => (half_u + half_v).length().max((half_u - half_v).length()),
            Self::Linear { p0, p1 } => (p1 * 0.5 - p0 * 0.5).length(),
            Self::Triangle { p0, p1, p2 } => {
                [p0, p1, p2].map(|corner| corner.distance(self.center())).into_iter().fold(0.0, f64::max)
            }
            Self::Point { .. } => 0.0,
        }
    }

    /// The light's shape about its middle.
    #[must_use]
    pub fn shape(&self) -> LightShape {
        match *self {
            Self::Sphere { .. } | Self::Point { .. } => LightShape::Facing,
            Self::Disc { normal, .. } => LightShape::Disc { normal: normal.normalize() },
            Self::Rect { half_u, half_v, .. } => LightShape::Rect { halves: [half_u, half_v] },
            Self::Linear { p0, p1 } => LightShape::Line { half: p1 * 0.5 - p0 * 0.5 },
            Self::Triangle { p0, p1, p2 } => {
                LightShape::Triangle { halves: [p1, p2].map(|p| (p - p0) * 0.5) }
            }
        }
    }

    /// How near a triangle comes to the middle of the light where it could cut it, world units: anywhere for a sphere,
    /// whose disc turns, and in the plane of a disc; infinite if it does not meet that, or misses a rectangle, a triangle or a line. Nearer
    /// than [`Light::radius`], it cuts it.
    #[must_use]
    pub fn distance_to(&self, corners: [DVec3; 3]) -> f64 {
        let center = self.center();
        let in_plane = |normal: DVec3| cut_by_plane(corners, center, normal);
        let distance = |[a, b]: [DVec3; 2]| distance_to_triangle(center, [a, b, b]);
        match self.shape() {
            LightShape::Facing => distance_to_triangle(center, corners),
            LightShape::Disc { normal } => in_plane(normal).map_or(f64::INFINITY, distance),
            LightShape::Rect { halves: [u, v] } | LightShape::Triangle { halves: [u, v] } => {
                let [s, t] = dual(u, v);
                let place = |at: DVec3| DVec2::new((at - center).dot(s), (at - center).dot(t));
                let is_triangle = matches!(self, Self::Triangle { .. });
                let meets = if is_triangle { meets_triangle } else { meets_square };
                in_plane(u.cross(v))
                    .filter(|[a, b]| meets(place(*a), place(*b)))
                    .map_or(f64::INFINITY, distance)
            }
            LightShape::Line { half } => Ray::new(center - half, half * 2.0)
                .triangle(&corners, 0.0, 1.0)
                .map_or(f64::INFINITY, |(at, _)| (half * (2.0 * at - 1.0)).length()),
        }
    }

    /// `count` equal lights, each as bright as the `count`th part of this one, that lie over it as evenly as can be: together
    /// they are nearly the same light, and each has the silhouettes that it sees itself [johnson09, §5.1]. A light without
    /// extent stays one, and so does a triangle, which no method splits.
    ///
    /// Those of a rectangle or a line tile it. Discs cannot tile a disc: those of a disc or a sphere overlap a little, which
    /// makes the light's rim smoother, and their middles spread so far that the second moments agree.
    #[must_use]
    pub fn split(self, count: u32) -> Vec<Self> {
        let n = f64::from(count);
        // Radius of the parts of a disc: some half more than where their areas add up to its own was found to be best.
        let part = (1.5 / n.sqrt()).min(core::f64::consts::FRAC_1_SQRT_2);
        let spread = (1.0 - part * part).sqrt();
        match self {
            _ if count <= 1 => vec![self],
            Self::Sphere { center, radius } if radius > 0.0 => {
                let place = |place: DVec3| center + place * (radius * spread);
                let part = |at| Self::Sphere { center: place(at), radius: radius * part };
                even_places(count, DVec3::ONE).into_iter().map(part).collect()
            }
            Self::Disc { center, normal, radius } if radius > 0.0 => {
                let (u, v) = normal.normalize().any_orthonormal_pair();
                let place = |place: DVec3| center + (u * place.x + v * place.y) * (radius * spread);
                let part = |at| Self::Disc { center: place(at), normal, radius: radius * part };
                even_places(count, DVec3::new(1.0, 1.0, 0.0)).into_iter().map(part).collect()
            }
            Self::Rect { center, half_u, half_v } => {
                let [columns, rows] = grid(count, half_u.length() / half_v.length());
                let (u, v) = (half_u / f64::from(columns), half_v / f64::from(rows));
                let part = |i: u32| {
                    let along = |number: u32, of: u32| f64::from(2 * number + 1) - f64::from(of);
                    let middle = u * along(i % columns, columns) + v * along(i / columns, rows);
                    Self::Rect { center: center + middle, half_u: u, half_v: v }
                };
                (0..count).map(part).collect()
            }
            Self::Linear { p0, p1 } => {
                let end = |i: u32| p0.lerp(p1, f64::from(i) / n);
                (0..count).map(|i| Self::Linear { p0: end(i), p1: end(i + 1) }).collect()
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
            Self::Rect { .. } | Self::Linear { .. } | Self::Triangle { .. } => None,
        }
    }
}

/// What of a light is to be known but where it stands: the shape that its middle is the origin of, in the units of its space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightShape {
    /// A disc that turns to face each receiver: what a sphere is taken for [algorithms, §0]. Its radius is told elsewhere.
    Facing,
    /// A disc that stands still. Its radius is told elsewhere.
    Disc {
        /// Unit normal of the disc.
        normal: DVec3,
    },
    /// The parallelogram of the points `s halves[0] + t halves[1]`, s and t in [-1, 1].
    Rect {
        /// Half of either side.
        halves: [DVec3; 2],
    },
    /// The triangle of the points `s halves[0] + t halves[1]`, s and t at least -2/3 and together at most 2/3.
    Triangle {
        /// Half of either side from the corner where both are -2/3.
        halves: [DVec3; 2],
    },
    /// The line from `-half` to `half`.
    Line {
        /// One end of the line.
        half: DVec3,
    },
}

/// What the places on a light are that belong to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outline {
    /// Those up to 1 from the middle.
    Disc,
    /// Those whose numbers are both in [-1, 1].
    Square,
    /// Those whose numbers are at least -2/3 and together at most 2/3.
    Triangle,
    /// Those whose first number is in [-1, 1] and whose second is 0.
    Line,
}

impl Outline {
    /// Square of the distance of its farthest place from the middle.
    #[must_use]
    pub fn reach2(self) -> f32 {
        match self {
            Self::Disc | Self::Line => 1.0,
            Self::Square => 2.0,
            // Its corners (4/3, -2/3) and (-2/3, 4/3).
            Self::Triangle => 20.0 / 9.0,
        }
    }
}

impl LightShape {
    /// What a light of this shape is called in messages.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Facing => "sphere",
            Self::Disc { .. } => "disc",
            Self::Rect { .. } => "rectangle",
            Self::Triangle { .. } => "triangle",
            Self::Line { .. } => "line",
        }
    }

    /// What places belong to a light of this shape: on a disc in radii, on a rectangle and a triangle in half sides, on a line in half
    /// lines along it and aside.
    #[must_use]
    pub fn outline(&self) -> Outline {
        match self {
            Self::Facing | Self::Disc { .. } => Outline::Disc,
            Self::Rect { .. } => Outline::Square,
            Self::Triangle { .. } => Outline::Triangle,
            Self::Line { .. } => Outline::Line,
        }
    }

    /// The shape with each of its vectors changed by `change`.
    #[must_use]
    pub fn map(self, change: impl Fn(DVec3) -> DVec3) -> Self {
        match self {
            Self::Facing => Self::Facing,
            Self::Disc { normal } => Self::Disc { normal: change(normal) },
            Self::Rect { halves } => Self::Rect { halves: halves.map(change) },
            Self::Triangle { halves } => Self::Triangle { halves: halves.map(change) },
            Self::Line { half } => Self::Line { half: change(half) },
        }
    }
}

/// The vectors `s` and `t` in the plane of `u` and `v` whose products with a point of it are its place in units of `u` and `v`.
pub(crate) fn dual(u: DVec3, v: DVec3) -> [DVec3; 2] {
    let normal = u.cross(v);
    let squared = normal.length_squared();
    [v.cross(normal) / squared, normal.cross(u) / squared]
}

/// Columns and rows of `count` equal parts of a rectangle, so that they come as near to squares as they can; `ratio`: its width
/// over its height.
fn grid(count: u32, ratio: f64) -> [u32; 2] {
    let off = |columns: &u32| {
        let rows = count / columns;
        libm::log(ratio * f64::from(rows) / f64::from(*columns)).abs()
    };
    let columns = (1..=count).filter(|columns| count.is_multiple_of(*columns));
    let best = columns.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(1);
    [best, count / best]
}

/// Whether the line from `a` to `b` has a point in the square of all places from -1 to 1.
fn meets_square(a: DVec2, b: DVec2) -> bool {
    let e = b - a;
    // Apart along an axis, or across the line.
    let apart = |low: f64, high: f64| low.min(high) > 1.0 || low.max(high) < -1.0;
    !apart(a.x, b.x) && !apart(a.y, b.y) && a.perp_dot(e).abs() <= e.x.abs() + e.y.abs()
}

/// Whether the line from `a` to `b` has a point in the triangle of [`Outline::Triangle`].
fn meets_triangle(a: DVec2, b: DVec2) -> bool {
    // The part of the line that is inside of each side, from one parameter to another.
    let inside = |p: DVec2| [p.x + 2.0 / 3.0, p.y + 2.0 / 3.0, 2.0 / 3.0 - p.x - p.y];
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for (at_a, at_b) in inside(a).into_iter().zip(inside(b)) {
        if at_a < 0.0 && at_b < 0.0 {
            return false;
        }
        if at_a < 0.0 {
            from = from.max(at_a / (at_a - at_b));
        } else if at_b < 0.0 {
            to = to.min(at_a / (at_a - at_b));
        }
    }
    from <= to
}

/// `count` places about the origin that from every side seem to lie evenly on the unit disc, with its second moments: in a
/// ball, or in a plane for `axes` with a 0 for the axis across it.
///
/// What an edge parts is told by how far the places lie across it, and for a disc these distances should be those that cut it
/// into equal areas. Places are moved towards them, over many directions at once [paulin20].
fn even_places(count: u32, axes: DVec3) -> Vec<DVec3> {
    /// Directions that edges are looked at across.
    const DIRECTIONS: u32 = 128;
    const ROUNDS: u32 = 200;
    let wanted = equal_cuts(count);
    let dimensions = axes.element_sum();
    let unit = |i: u32, of: u32| {
        // A spiral around a sphere, or the plane's circle.
        let along = (1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(of)) * axes.z;
        let angle = f64::from(i) * GOLDEN_ANGLE;
        let across = (1.0 - along * along).sqrt();
        DVec3::new(across * libm::cos(angle), across * libm::sin(angle), along)
    };
    let directions: Vec<DVec3> = (0..DIRECTIONS).map(|i| unit(i, DIRECTIONS)).collect();
    // They begin where none is another's double: outward and inward by the bits of the number read backward.
    let begin = |i: u32| {
        unit(i, count) * (f64::from(i.reverse_bits()) / 4_294_967_296.0 + 0.5 / f64::from(count)).sqrt()
    };
    let mut places: Vec<DVec3> = (0..count).map(begin).collect();
    let mut order: Vec<usize> = (0..places.len()).collect();
    for round in 0..ROUNDS {
        let step = if round < ROUNDS / 2 { 0.5 } else { 0.2 } * dimensions / f64::from(DIRECTIONS);
        let mut moves = vec![DVec3::ZERO; places.len()];
        for direction in &directions {
            let across: Vec<f64> = places.iter().map(|place| place.dot(*direction)).collect();
            order.sort_by(|&a, &b| across[a].total_cmp(&across[b]).then(a.cmp(&b)));
            for (&place, wanted) in order.iter().zip(&wanted) {
                moves[place] += *direction * (wanted - across[place]);
            }
        }
        places.iter_mut().zip(moves).for_each(|(place, by)| *place += by * step);
    }
    let mean = places.iter().sum::<DVec3>() / f64::from(count);
    places.iter_mut().for_each(|place| *place -= mean);
    // Of the disc each moment is 1/4.
    let moment: f64 = places.iter().map(|place| place.length_squared()).sum();
    let scale = (0.25 * f64::from(count) * dimensions / moment).sqrt();
    places.into_iter().map(|place| place * scale).collect()
}

/// Means of the distances across the unit disc of each of `count` stripes that have equal areas.
fn equal_cuts(count: u32) -> Vec<f64> {
    // Area up to x, and the moment of what lies beyond, both as parts of the whole.
    let area = |x: f64| 0.5 + (x * (1.0 - x * x).sqrt() + libm::asin(x)) / core::f64::consts::PI;
    let moment = |x: f64| -2.0 / (3.0 * core::f64::consts::PI) * (1.0 - x * x) * (1.0 - x * x).sqrt();
    let cut = |i: u32| {
        let (mut low, mut high) = (-1.0, 1.0);
        for _ in 0..60 {
            let middle: f64 = 0.5 * (low + high);
            if area(middle) < f64::from(i) / f64::from(count) { low = middle } else { high = middle }
        }
        if i == 0 { -1.0 } else { high }
    };
    (0..count).map(|i| f64::from(count) * (moment(cut(i + 1)) - moment(cut(i)))).collect()
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
        let own = parts[0].radius().powi(2) / 4.0;
        let sum: DVec3 = parts.iter().map(|part| part.center() * part.center()).sum();
        (sum / parts.len() as f64 + own) / radius.powi(2)
    }

    /// Part of a disc at `from` of its edge, in radii, that lies beyond.
    fn beyond(from: f64) -> f64 {
        let d = from.clamp(-1.0, 1.0);
        (libm::acos(d) - d * (1.0 - d * d).sqrt()) / core::f64::consts::PI
    }

    /// Root mean square of what edges in many directions and places hide of the parts, less what they hide of the disc.
    fn error_of_edges(parts: &[Light], radius: f64, directions: &[DVec3]) -> f64 {
        let mut squares = 0.0;
        for direction in directions {
            for offset in -20..=20 {
                let offset = f64::from(offset) / 20.0;
                let hidden: f64 = parts
                    .iter()
                    .map(|part| beyond((offset * radius - part.center().dot(*direction)) / part.radius()))
                    .sum();
                squares += (hidden / parts.len() as f64 - beyond(offset)).powi(2);
            }
        }
        (squares / (41 * directions.len()) as f64).sqrt()
    }

    #[test]
    fn parts_of_a_light_are_nearly_that_light() {
        let radius = 3.0;
        let sphere = Light::Sphere { center: DVec3::ZERO, radius };
        let disc = Light::Disc { center: DVec3::ZERO, normal: DVec3::Z, radius };
        for (count, most) in [(2_u32, 0.06), (4, 0.03), (5, 0.03), (16, 0.012), (64, 0.006)] {
            for light in [sphere, disc] {
                let parts = light.split(count);
                let middle: DVec3 = parts.iter().map(|part| part.center()).sum();
                let off = middle.length() / f64::from(count) / radius;
                assert!(off < 1e-12, "{count} parts of {light:?}: the middle is off by {off}");
                let moments = moments(&parts, radius);
                let flat = light == disc;
                let moments = if flat { moments.x + moments.y } else { moments.element_sum() };
                assert!((moments - if flat { 0.5 } else { 0.75 }).abs() < 1e-12, "{count} parts: {moments}");
                let around = |i: u32| {
                    let z = if flat { 0.0 } else { (f64::from(i) + 0.5) / 150.0 - 1.0 };
                    let across = DVec2::from_angle(f64::from(i) * 2.399) * (1.0 - z * z).sqrt();
                    across.extend(z)
                };
                let directions: Vec<DVec3> = (0..300).map(around).collect();
                let error = error_of_edges(&parts, radius, &directions);
                println!("{count} parts of {light:?}: edges are off by {error}");
                assert!(error < most, "{count} parts of {light:?}: edges are off by {error}");
            }
        }
        // Those of a rectangle and of a line tile it, as near to squares as they can be.
        let rect = Light::Rect { center: DVec3::ONE, half_u: DVec3::X * 4.0, half_v: DVec3::Y };
        let parts = rect.split(16);
        for (i, part) in parts.iter().enumerate() {
            let center = DVec3::ONE + DVec3::new((i % 8) as f64 - 3.5, (i / 8) as f64 - 0.5, 0.0);
            assert_eq!(*part, Light::Rect { center, half_u: DVec3::X * 0.5, half_v: DVec3::Y * 0.5 }, "{i}");
        }
        let line = Light::Linear { p0: DVec3::ZERO, p1: DVec3::X };
        let parts = line.split(4);
        let place = |x: f64| DVec3::X * x;
        assert_eq!(parts[3], Light::Linear { p0: place(0.75), p1: place(1.0) });
        assert_eq!(parts.len(), 4);
        assert_eq!(sphere.split(1), [sphere]);
        let point = Light::Point { center: DVec3::ONE };
        assert_eq!(point.split(16), [point]);
    }

    #[test]
    fn a_light_touches_what_reaches_into_it() {
        let triangle = |height| {
            [DVec3::new(-4.0, height, -4.0), DVec3::new(4.0, height, -4.0), DVec3::new(0.0, height, 5.0)]
        };
        let touches = |light: Light, height| light.distance_to(triangle(height)) < light.radius();
        let center = DVec3::Y;
        let sphere = Light::Sphere { center, radius: 0.5 };
        assert!(touches(sphere, 0.6) && !touches(sphere, 0.4));
        assert!(!touches(Light::Point { center }, 1.0));
        // A lamp set into a ceiling is not cut by it.
        let lamp = Light::Disc { center, normal: DVec3::NEG_Y, radius: 0.5 };
        assert!(!touches(lamp, 1.001) && !touches(lamp, 1.0));
        let upright = Light::Disc { center, normal: DVec3::X, radius: 0.5 };
        assert!(touches(upright, 1.4) && !touches(upright, 1.6));
        // Rectangles, triangles and lines have corners and ends: nothing beside them touches them.
        let sail =
            Light::Triangle { p0: center - DVec3::Y * 0.2, p1: center + DVec3::Z, p2: center - DVec3::Z };
        assert!(touches(sail, 0.9) && !touches(sail, 0.7) && !touches(sail, 1.01));
        let wide = Light::Rect { center, half_u: DVec3::Z, half_v: DVec3::Y * 0.2 };
        assert!(touches(wide, 1.15) && !touches(wide, 1.3));
        let line = Light::Linear { p0: center - DVec3::Y * 0.2, p1: center + DVec3::Y * 0.2 };
        assert!(
            touches(line, 1.15)
                && !touches(line, 1.3)
                && (line.distance_to(triangle(1.15)) - 0.15).abs() < 1e-12
        );
    }
}
