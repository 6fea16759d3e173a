//! What a light with an extent makes of a mesh: what it sees from its middle, and what it reaches into.
//!
//! Silhouettes are those that the middle of the light sees, and a layer is what lies between the middle and a receiver. Of a
//! light that a face reaches into, parts lie beyond that face, where both say nothing. Such faces are taken out of the mesh
//! and listed: what each hides of the light is found for each receiver by itself, as the area of a polygon, whichever side
//! of it the middle is on. The rest of the mesh then keeps clear of the light, and ends where these faces were.

use glam::DVec3;

use super::silhouette::{Stance, stances};
use super::{Adjacency, Counting, is_degenerate};
use crate::light::{Light, LightShape};
use crate::mesh::{Mesh, distance_to_triangle};

/// Triangles that a light is cut by, at most: every one is looked at from every receiver. The nearest are taken.
pub const CUT_TRIANGLES_MAX: usize = 64;

/// Triangles nearer to the middle than this part of the radius count as cutting a light that does not turn, whether they meet it or
/// not.
const NEXT_TO_MIDDLE: f64 = 1.0 / 256.0;

/// How far the middle of a light is moved off planes that it lies in exactly, in radii, or in sizes of a smaller scene: more than f32 takes points off their
/// planes in most scenes, and little enough to move no shadow by a hundred-thousandth of the light.
const OFF_PLANE: f64 = 1.0 / (1 << 16) as f64;

/// A triangle that the light is cut by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CutTriangle {
    /// Number of the triangle in its mesh.
    pub number: u32,
    /// Its corners, as the mesh has them.
    pub corners: [u32; 3],
    /// Counting rule of its body: of a sheet it hides light in both sums, of a shell in F where it is entered on the way from the
    /// light to the receiver and in B where it is left.
    pub counting: Counting,
}

/// A mesh as a light has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Aspect {
    /// The place that is taken for the middle of the light: the middle, or next to it where that lies exactly in the plane of a
    /// face, which would be seen edge-on from there and hide nothing.
    pub middle: DVec3,
    /// How each triangle counts from the middle.
    pub stance: Vec<Stance>,
    /// The counting rule of each triangle. A closed body that the light reaches into is a shell: from the parts of the light
    /// within it, it is left and not entered.
    pub counting: Vec<Counting>,
    /// The triangles that the light is cut by, by number; no more than [`CUT_TRIANGLES_MAX`].
    pub cut: Vec<CutTriangle>,
    /// Further triangles that the light is cut by, which count as if it was not.
    pub cut_left: Option<CutLeft>,
}

/// Triangles that a light is cut by beyond the greatest number of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CutLeft {
    /// How many there are.
    pub triangles: usize,
    /// The one that is nearest to the middle of the light.
    pub nearest: u32,
}

impl Aspect {
    /// The aspect of `mesh`, which `adjacency` is of, for `light`.
    #[must_use]
    pub fn new(light: &Light, mesh: &Mesh, adjacency: &Adjacency) -> Self {
        let mut counting = adjacency.counting.clone();
        let radius = light.radius();
        if radius == 0.0 {
            let middle = light.center();
            let stance = stances(mesh, adjacency, middle);
            return Self { middle, stance, counting, cut: Vec::new(), cut_left: None };
        }
        let (cut, cut_left) = cut(light, mesh, adjacency);
        let middle = off_planes(light, mesh, adjacency);
        let mut stance = stances(mesh, adjacency, middle);

        // Bodies that the light reaches into have no one side that looks at it.
        let bodies = bodies_of(cut.iter().copied(), adjacency);
        if !bodies.is_empty() {
            for (t, body) in adjacency.component.iter().enumerate() {
                if counting[t] == Counting::Closed && bodies.binary_search(body).is_ok() {
                    counting[t] = Counting::Shell;
                    if stance[t] == Stance::TurnedOver {
                        stance[t] = Stance::AsItRuns;
                    }
                }
            }
        }
        for &t in &cut {
            stance[t as usize] = Stance::Cut;
        }
        let triangle = |number: u32| {
            let t = number as usize;
            CutTriangle { number, corners: mesh.triangles[t], counting: counting[t] }
        };
        let cut = cut.into_iter().map(triangle).collect();
        Self { middle, stance, counting, cut, cut_left }
    }
}

/// Whether a triangle counts at all.
fn is_listed(mesh: &Mesh, adjacency: &Adjacency, t: usize) -> bool {
    adjacency.stands_for[t] as usize == t && !is_degenerate(mesh, t)
}

/// The triangles that the light is cut by, ascending, and those beyond the greatest number.
///
/// As far as there is room, those come with them that lie in bodies of these, but for sheets, and have planes that cut the
/// light: they are entered from one part of the light and left from another.
fn cut(light: &Light, mesh: &Mesh, adjacency: &Adjacency) -> (Vec<u32>, Option<CutLeft>) {
    let (center, radius, shape) = (light.center(), light.radius(), light.shape());
    let mut near: Vec<(f64, u32)> = Vec::new();
    for t in 0..mesh.triangles.len() {
        let corners = mesh.corners(t);
        let [a, b, c] = corners.map(|p| p - center);
        // Most triangles are far from the light by their bounds.
        let apart = a.min(b).min(c).max_element().max(-a.max(b).max(c).min_element());
        if apart < radius && is_listed(mesh, adjacency, t) {
            let mut distance = light.distance_to(corners);
            if shape != LightShape::Facing && distance >= radius {
                // A silhouette next to the middle needs more digits than f32 has, on whichever side of a light that does not turn
                // it is. What lies along the light holds it and has none.
                let [a, b, c] = corners;
                let normal = (b - a).cross(c - a).normalize();
                let from_middle = distance_to_triangle(center, corners);
                if off_along(shape, normal) >= 1e-3 && from_middle < NEXT_TO_MIDDLE * radius {
                    distance = from_middle;
                }
            }
            if distance < radius {
                near.push((distance, t as u32));
            }
        }
    }
    let bodies = bodies_of(near.iter().map(|(_, t)| *t), adjacency);
    let triangles = near.len().saturating_sub(CUT_TRIANGLES_MAX);
    if near.len() < CUT_TRIANGLES_MAX && !bodies.is_empty() {
        let known: Vec<u32> = near.iter().map(|(_, t)| *t).collect();
        let in_plane = |t: usize| {
            let corners = mesh.corners(t);
            let [a, b, c] = corners.map(|p| p - center);
            let normal = (b - a).cross(c - a);
            let cuts = a.dot(normal).abs() < radius * normal.length();
            (cuts && is_listed(mesh, adjacency, t)).then(|| distance_to_triangle(center, corners))
        };
        let others = (0..mesh.triangles.len()).filter(|t| {
            adjacency.counting[*t] != Counting::Sheet
                && bodies.binary_search(&adjacency.component[*t]).is_ok()
                && known.binary_search(&(*t as u32)).is_err()
        });
        near.extend(others.filter_map(|t| Some((radius + in_plane(t)?, t as u32))));
    }
    near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let left = (triangles > 0).then(|| CutLeft { triangles, nearest: near[CUT_TRIANGLES_MAX].1 });
    near.truncate(CUT_TRIANGLES_MAX);
    let mut cut: Vec<u32> = near.into_iter().map(|(_, t)| t).collect();
    cut.sort_unstable();
    (cut, left)
}

/// Sine of the angle between the light and a plane of this unit normal: 0 where the light lies along it. A sphere lies along none.
fn off_along(shape: LightShape, normal: DVec3) -> f64 {
    match shape {
        LightShape::Facing => 1.0,
        LightShape::Disc { normal: across } => across.cross(normal).length(),
        LightShape::Rect { halves: [u, v] } | LightShape::Triangle { halves: [u, v] } => {
            u.cross(v).normalize().cross(normal).length()
        }
        LightShape::Line { half } => half.normalize().dot(normal).abs(),
    }
}

/// The bodies that triangles belong to, ascending.
fn bodies_of(triangles: impl Iterator<Item = u32>, adjacency: &Adjacency) -> Vec<u32> {
    let mut bodies: Vec<u32> = triangles.map(|t| adjacency.component[t as usize]).collect();
    bodies.sort_unstable();
    bodies.dedup();
    bodies
}

/// The middle of the light; a hair beside it where it lies exactly in the plane of a face.
///
/// A face that is seen edge-on hides nothing of the middle and nearly half of the light from beside its plane. Moved off the
/// plane, the middle sees it as any other, and receivers on that plane, too, have the light on one side of it; nor is a corner
/// then exactly in the middle, where it has no direction. A disc that does not turn and a rectangle move within their own plane, a
/// line along itself: they must not get behind the face that they lie in.
fn off_planes(light: &Light, mesh: &Mesh, adjacency: &Adjacency) -> DVec3 {
    let center = light.center();
    let shape = light.shape();
    let edge_on = |t: usize| {
        let [a, b, c] = mesh.corners(t).map(|p| p - center);
        let normal = (b - a).cross(c - a);
        let terms = a.abs().dot(normal.abs());
        if a.dot(normal).abs() > 8.0 * f64::EPSILON * terms {
            return None;
        }
        let normal = normal.try_normalize()?;
        (is_listed(mesh, adjacency, t) && off_along(shape, normal) >= 1e-9).then_some(normal)
    };
    let planes: Vec<DVec3> = (0..mesh.triangles.len()).filter_map(edge_on).collect();
    if planes.is_empty() {
        return center;
    }
    // Of some directions that are no round numbers the one that leads off all of these planes the most.
    let directions = (1..=16).map(|k| {
        let turn = f64::from(k) * crate::reference::GOLDEN_ANGLE;
        let (sin, cos) = (libm::sin(turn), libm::cos(turn));
        let in_plane = |across: DVec3| {
            let (s, t) = across.any_orthonormal_pair();
            s * cos + t * sin
        };
        match shape {
            LightShape::Facing => {
                let up = 0.5 + f64::from(k) / 40.0;
                let flat = (1.0 - up * up).sqrt();
                DVec3::new(flat * cos, up, flat * sin)
            }
            LightShape::Disc { normal } => in_plane(normal),
            LightShape::Rect { halves: [u, v] } | LightShape::Triangle { halves: [u, v] } => {
                in_plane(u.cross(v).normalize())
            }
            LightShape::Line { half } => half.normalize(),
        }
    });
    let least = |direction: &DVec3| planes.iter().map(|n| n.dot(*direction).abs()).fold(1.0, f64::min);
    let direction = directions.max_by(|a, b| least(a).total_cmp(&least(b))).expect("there are some");
    let reach = mesh.positions.iter().map(|p| (*p - center).abs().max_element()).fold(0.0, f64::max);
    center + direction * (OFF_PLANE * light.radius().min(reach))
}
