//! Weights of edges as seen from a light.

use glam::DVec3;

use super::{Adjacency, Counting, NO_COMPONENT};
use crate::mesh::Mesh;

/// Weights of one edge: how many more counted faces lie left of `v[0] -> v[1]` than right of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct EdgeWeights {
    /// In the sum F of faces towards the light.
    pub front: i32,
    /// In the sum B of faces away from the light.
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
    let inside = light_inside(mesh, adjacency, light_center);
    let det: Vec<f64> = (0..mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p - light_center);
            a.dot(b.cross(c)) * if inside[t] { -1.0 } else { 1.0 }
        })
        .collect();
    (0..adjacency.edges.len())
        .map(|edge| {
            let mut weights = EdgeWeights::default();
            for &face in adjacency.faces(edge) {
                let t = (face >> 1) as usize;
                weights.add(adjacency.counting[t], det[t], face & 1 ^ u32::from(inside[t]));
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

/// Per triangle: whether it belongs to a closed, outward body that has the light inside.
///
/// Such a body (a room, a lantern) must be counted by its inner side: none of its outward faces looks at the light.
/// Found by the solid angle of the body about the light, ±4π inside and 0 outside.
#[must_use]
pub fn light_inside(mesh: &Mesh, adjacency: &Adjacency, light_center: DVec3) -> Vec<bool> {
    let bodies = adjacency.component.iter().filter(|&&c| c != NO_COMPONENT).max().map_or(0, |c| c + 1);
    let mut angle = vec![0.0; bodies as usize];
    for (t, &body) in adjacency.component.iter().enumerate() {
        if body == NO_COMPONENT || adjacency.counting[t] != Counting::Closed {
            continue;
        }
        let [a, b, c] = mesh.corners(t).map(|p| (p - light_center).normalize_or_zero());
        let above = a.dot(b.cross(c));
        let below = 1.0 + a.dot(b) + b.dot(c) + c.dot(a);
        angle[body as usize] += 2.0 * libm::atan2(above, below);
    }
    let is_inside = |&body: &u32| body != NO_COMPONENT && angle[body as usize] > core::f64::consts::TAU;
    adjacency.component.iter().map(is_inside).collect()
}
