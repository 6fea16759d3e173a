//! How often the layers of a body count.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::orient::Orientation;
use super::{Adjacency, NO_COMPONENT};
use crate::mesh::Mesh;

/// Which faces of a body count as layers between receiver and light [algorithms, §2.4].
///
/// Two sums are kept, F and B, and the coverage of a receiver is `min(max(|F|, |B|, |F - B|), 1)`. A body that is closed
/// would darken twice if both its front and its back counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum Counting {
    /// No boundary: faces towards the light count, in both sums.
    Closed = 0,
    /// A body with holes: faces towards the light count in F, faces away from it in B.
    ///
    /// Either is right where the holes are not seen through; the larger one is right where light would enter by a
    /// hole and leave by none.
    Shell = 1,
    /// A sheet, one layer thick: both facings count, in both sums.
    Sheet = 2,
}

/// A body with a boundary is a sheet if the length of its vector area is above this part of its area.
///
/// A closed body has 0, a box without its floor 1/5, a half sphere 1/2, a slope of 45 degrees 0.7, a flat card 1.
/// Up to a half sphere a body hides its own far side from some lights, and both facings would count twice.
const SHEET_VECTOR_AREA: f64 = 0.6;

/// Counting rule of each triangle, from the body it belongs to.
pub fn classify(mesh: &Mesh, adjacency: &Adjacency, orientation: &Orientation) -> Vec<Counting> {
    let bodies = orientation.orientable.len();

    // Boundary of the chain: an edge that the body's triangles do not run equally often in both directions.
    let mut has_boundary = vec![false; bodies];
    let mut runs: Vec<(u32, i32)> = Vec::new();
    for edge in 0..adjacency.edges.len() {
        runs.clear();
        for &face in adjacency.faces(edge) {
            let t = (face >> 1) as usize;
            let direction = if (face & 1 == 1) ^ orientation.flip[t] { -1 } else { 1 };
            let body = orientation.component[t];
            match runs.iter_mut().find(|(b, _)| *b == body) {
                Some((_, sum)) => *sum += direction,
                None => runs.push((body, direction)),
            }
        }
        for &(body, sum) in &runs {
            has_boundary[body as usize] |= sum != 0;
        }
    }

    // Vector area against area, scaled by the diagonal so that nothing overflows.
    let scale = mesh.bounds().diagonal().max(f64::MIN_POSITIVE);
    let mut area = vec![(DVec3::ZERO, 0.0); bodies];
    for (t, &body) in orientation.component.iter().enumerate() {
        if body != NO_COMPONENT {
            let [a, b, c] = mesh.corners(t);
            let normal = ((b - a) / scale).cross((c - a) / scale);
            let entry = &mut area[body as usize];
            entry.0 += if orientation.flip[t] { -normal } else { normal };
            entry.1 += normal.length();
        }
    }

    let rule: Vec<Counting> = (0..bodies)
        .map(|body| {
            let (vector_area, total) = area[body];
            if !orientation.orientable[body] {
                Counting::Sheet
            } else if !has_boundary[body] {
                Counting::Closed
            } else if vector_area.length() > SHEET_VECTOR_AREA * total {
                Counting::Sheet
            } else {
                Counting::Shell
            }
        })
        .collect();
    let of = |&body: &u32| if body == NO_COMPONENT { Counting::Sheet } else { rule[body as usize] };
    orientation.component.iter().map(of).collect()
}
