//! Which triangles meet at which edge, and how the layers of each body are counted.
//!
//! `weld` joins positions, `copies` splits faces that are there twice alike, `orient` makes windings consistent,
//! `counting` classifies bodies; [`prepare`] runs the first three, once, when a scene is made.

mod aspect;
mod copies;
mod counting;
mod objects;
mod orient;
mod silhouette;
mod weld;

#[cfg(test)]
mod tests;

pub use aspect::{Aspect, CUT_TRIANGLES_MAX, CutLeft, CutTriangle};
pub use counting::Counting;
pub use objects::objects;
pub(crate) use silhouette::counts;
pub use silhouette::{EdgeWeights, Stance, edge_weights, silhouette_edges, stances};

use crate::mesh::{Mesh, normal_direction};

/// No component: degenerate and duplicate triangles.
pub const NO_COMPONENT: u32 = u32::MAX;

/// Edges of a prepared mesh with the faces on them, in compressed rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adjacency {
    /// Vertex pairs, `v[0] < v[1]`, sorted.
    pub edges: Vec<[u32; 2]>,
    /// Faces of edge `e` are `edge_faces[edge_first[e]..edge_first[e + 1]]`; length `edges + 1`.
    pub edge_first: Vec<u32>,
    /// `triangle << 1 | side`, ascending within an edge; side 0: the triangle runs `v[0] -> v[1]`.
    pub edge_faces: Vec<u32>,
    /// How the layers of each triangle are counted. Per triangle.
    pub counting: Vec<Counting>,
    /// Body each triangle belongs to: connected over edges with exactly two faces. [`NO_COMPONENT`] for triangles
    /// that are on no edge. Per triangle.
    pub component: Vec<u32>,
    /// The triangle that stands for this one: itself, or the first of its duplicates. Per triangle.
    pub stands_for: Vec<u32>,
}

impl Adjacency {
    /// Adjacency of `mesh`, whose positions are shared by index ([`prepare`]).
    ///
    /// Triangles with a repeated corner or exactly zero area are on no edge; of triangles with the same three
    /// corners only the first is: a sheet that is there twice casts the shadow of one.
    #[must_use]
    pub fn new(mesh: &Mesh) -> Self {
        let stands_for = duplicates(mesh);
        let EdgeRows { edges, edge_first, edge_faces } = EdgeRows::new(mesh, &stands_for);
        let mut adjacency =
            Self { edges, edge_first, edge_faces, counting: Vec::new(), component: Vec::new(), stands_for };
        let orientation = orient::orientation(mesh, &adjacency);
        adjacency.counting = counting::classify(mesh, &adjacency, &orientation);
        adjacency.component = orientation.component;
        adjacency
    }

    /// Faces on edge `edge`, as in `edge_faces`.
    #[must_use]
    pub fn faces(&self, edge: usize) -> &[u32] {
        &self.edge_faces[self.edge_first[edge] as usize..self.edge_first[edge + 1] as usize]
    }
}

/// The edges of an [`Adjacency`], before bodies are told apart.
struct EdgeRows {
    edges: Vec<[u32; 2]>,
    edge_first: Vec<u32>,
    edge_faces: Vec<u32>,
}

impl EdgeRows {
    fn new(mesh: &Mesh, stands_for: &[u32]) -> Self {
        let listed = |t: usize| stands_for[t] as usize == t && !is_degenerate(mesh, t);
        // All sides of all triangles, sorted by edge.
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(mesh.triangles.len() * 3);
        for (index, t) in mesh.triangles.iter().enumerate().filter(|(i, _)| listed(*i)) {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                sides.push(([a.min(b), a.max(b)], (index as u32) << 1 | u32::from(a > b)));
            }
        }
        sides.sort_unstable();
        let mut rows =
            Self { edges: vec![], edge_first: vec![], edge_faces: Vec::with_capacity(sides.len()) };
        for (edge, face) in sides {
            if rows.edges.last() != Some(&edge) {
                rows.edges.push(edge);
                rows.edge_first.push(rows.edge_faces.len() as u32);
            }
            rows.edge_faces.push(face);
        }
        rows.edge_first.push(rows.edge_faces.len() as u32);
        rows
    }

    fn faces(&self, edge: usize) -> &[u32] {
        &self.edge_faces[self.edge_first[edge] as usize..self.edge_first[edge + 1] as usize]
    }
}

/// Welds and orients `mesh` and orders its vertices by first use. Doing it twice changes nothing more.
///
/// The number and order of triangles stay; windings may be turned over, and a flat face that is there twice is split
/// the second time as it is the first.
pub fn prepare(mesh: &mut Mesh) {
    weld::weld(mesh);
    copies::split_alike(mesh);
    orient::orient(mesh);
    weld::order_by_first_use(mesh);
}

/// A repeated corner, or exactly no area in f64.
pub(crate) fn is_degenerate(mesh: &Mesh, index: usize) -> bool {
    let [a, b, c] = mesh.triangles[index];
    if a == b || b == c || c == a {
        return true;
    }
    normal_direction(mesh.corners(index)) == glam::DVec3::ZERO
}

fn duplicates(mesh: &Mesh) -> Vec<u32> {
    let mut stands_for: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    let mut sorted: Vec<([u32; 3], u32)> = mesh
        .triangles
        .iter()
        .zip(0..)
        .map(|(t, index)| {
            let mut key = *t;
            key.sort_unstable();
            (key, index)
        })
        .collect();
    sorted.sort_unstable();
    for pair in sorted.windows(2) {
        if pair[0].0 == pair[1].0 {
            stands_for[pair[1].1 as usize] = stands_for[pair[0].1 as usize];
        }
    }
    stands_for
}
