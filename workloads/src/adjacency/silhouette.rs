//! Weights of edges as seen from a light.

use glam::DVec3;

use super::{Adjacency, Counting, NO_COMPONENT};
use crate::mesh::{Mesh, distance_to_triangle};

/// Weights of one edge: how many more counted faces lie left of `v[0] -> v[1]` than right of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct EdgeWeights {
    /// Weight of the edge in the sum F of faces towards the light.
    pub front: i32,
    /// Weight of the edge in the sum B of faces away from the light.
    pub back: i32,
}

impl EdgeWeights {
    /// Whether the edge is a silhouette in either sum.
    #[must_use]
    pub fn is_silhouette(self) -> bool {
        self.front != 0 || self.back != 0
    }

    /// Adds a face with determinant `det` of its corners about the light, `side` as in `Adjacency::edge_faces`.
    pub fn add(&mut self, counting: Counting, det: f64, side: u32) {
        if det == 0.0 {
            return; // edge-on to the light: no layer [algorithms, §6.12]
        }
        // A positive determinant puts a face left of the edges that it runs along.
        let left = if (det > 0.0) ^ (side & 1 == 1) { 1 } else { -1 };
        let (front, back) = counts(counting, det);
        self.front += left * front;
        self.back += left * back;
    }
}

/// Layers (in F, in B) of a face whose corners have determinant `det` about the light; negative is front.
pub(crate) fn counts(counting: Counting, det: f64) -> (i32, i32) {
    match counting {
        _ if det == 0.0 => (0, 0),
        Counting::Sheet => (1, 1),
        Counting::Closed if det < 0.0 => (1, 1),
        Counting::Closed => (0, 0),
        Counting::Shell if det < 0.0 => (1, 0),
        Counting::Shell => (0, 1),
    }
}

/// Weights of all edges for a light at `light_center`, f64.
#[must_use]
pub fn edge_weights(mesh: &Mesh, adjacency: &Adjacency, light_center: DVec3) -> Vec<EdgeWeights> {
    let stance = stances(mesh, adjacency, light_center);
    let det: Vec<f64> = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p - light_center);
            let det = a.dot(b.cross(c));
            match stance[t] {
                Stance::AsItRuns => det,
                Stance::TurnedOver => -det,
                Stance::LeftOut | Stance::Cut => 0.0,
            }
        })
        .collect();
    (0..adjacency.edges.len())
        .map(|edge| {
            let mut weights = EdgeWeights::default();
            for &face in adjacency.faces(edge) {
                let t = (face >> 1) as usize;
                weights.add(adjacency.counting[t], det[t], stance[t].side(face) & 1);
            }
            weights
        })
        .collect()
}

/// Number of edges with a weight other than 0 for a light at `light_center`.
#[must_use]
pub fn silhouette_edges(mesh: &Mesh, adjacency: &Adjacency, light_center: DVec3) -> usize {
    edge_weights(mesh, adjacency, light_center).iter().filter(|w| w.is_silhouette()).count()
}

/// How a triangle of a prepared mesh counts for a light at some place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stance {
    /// The triangle counts with the winding that it has.
    AsItRuns,
    /// The triangle counts with the other winding: it belongs to a closed, outward body that has the light inside or on
    /// it.
    ///
    /// Such a body (a room, a lantern) must be counted by its inner side: none of its outward faces looks at the light.
    TurnedOver,
    /// The triangle does not count: the light lies on it, and which of its sides looks at the light would be a matter
    /// of rounding.
    LeftOut,
    /// The triangle does not count as one that is seen from the middle of the light: the light is cut by it, and what it hides is
    /// found for each receiver by itself, see [`Aspect`](super::Aspect).
    Cut,
}

impl Stance {
    /// The corners of a triangle with this stance as they are counted: one of them three times where it does not count.
    #[must_use]
    pub fn corners(self, [a, b, c]: [u32; 3]) -> [u32; 3] {
        match self {
            Self::AsItRuns => [a, b, c],
            Self::TurnedOver => [a, c, b],
            Self::LeftOut | Self::Cut => [a; 3],
        }
    }

    /// An entry of `Adjacency::edge_faces` for a triangle with this stance.
    #[must_use]
    pub fn side(self, face: u32) -> u32 {
        face ^ u32::from(self == Self::TurnedOver)
    }
}

/// A light lies on a triangle if it is nearer than this part of the triangle's reach from it: kernels take their sides
/// in f32, of coordinates about the light.
const ON_TRIANGLE: f64 = 1.0 / (1 << 22) as f64;

/// How each triangle counts for a light at `light_center`.
///
/// Whether a light is inside a body is found by the body's solid angle about it: 4π inside and 0 outside. A light on
/// the body counts as inside: what its ray meets next is the inner side of the body, or, on the way out, nothing of it.
#[must_use]
pub fn stances(mesh: &Mesh, adjacency: &Adjacency, light_center: DVec3) -> Vec<Stance> {
    let bodies = adjacency.component.iter().filter(|&&c| c != NO_COMPONENT).max().map_or(0, |c| c + 1);
    let mut angle = vec![0.0; bodies as usize];
    let mut touched = vec![false; bodies as usize];
    let mut stance = vec![Stance::AsItRuns; mesh.triangles.len()];
    for (t, &body) in adjacency.component.iter().enumerate() {
        let corners = mesh.corners(t).map(|p| p - light_center);
        if is_on(&corners) {
            stance[t] = Stance::LeftOut;
        }
        if body == NO_COMPONENT || adjacency.counting[t] != Counting::Closed {
            continue;
        }
        touched[body as usize] |= stance[t] == Stance::LeftOut;
        let [a, b, c] = corners.map(DVec3::normalize_or_zero);
        let above = a.dot(b.cross(c));
        let below = 1.0 + a.dot(b) + b.dot(c) + c.dot(a);
        angle[body as usize] += 2.0 * libm::atan2(above, below);
    }
    let is_inside = |body: u32| {
        body != NO_COMPONENT && (touched[body as usize] || angle[body as usize] > core::f64::consts::TAU)
    };
    for (t, &body) in adjacency.component.iter().enumerate() {
        if stance[t] == Stance::AsItRuns && is_inside(body) {
            stance[t] = Stance::TurnedOver;
        }
    }
    stance
}

/// Whether the origin lies on the triangle.
fn is_on(corners: &[DVec3; 3]) -> bool {
    let [a, b, c] = *corners;
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let near = ON_TRIANGLE * low.abs().max(high.abs()).max_element();
    low.max_element() <= near
        && high.min_element() >= -near
        && distance_to_triangle(DVec3::ZERO, *corners) <= near
}
