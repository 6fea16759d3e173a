//! Flat faces that are there twice, split into triangles in two ways.
//!
//! A double-sided export, or a quad beside its triangulated copy, covers the same ground twice with other triangles.
//! Each of the two would cast its shadow. Split alike they are duplicates, of which one counts.

use glam::DVec3;

use super::{EdgeRows, duplicates};
use crate::mesh::{Mesh, length, normal_direction};

/// Triangles farther than this part of their size from a plane do not lie in it: exporters round to six digits or more.
const FLAT: f64 = 1e-6;
/// Faces of more triangles than this are not compared: floors with much on them would be walked again and again.
const FACE_TRIANGLES_MAX: usize = 32;

/// Splits each flat face as the first one that covers the same ground. Number and order of triangles stay.
pub fn split_alike(mesh: &mut Mesh) {
    // Copies of a copy had nothing to tell them from it; now they have.
    while split_once(mesh) {}
}

/// Splits faces alike that differ; whether there were any.
fn split_once(mesh: &mut Mesh) -> bool {
    let rows = EdgeRows::new(mesh, &duplicates(mesh));
    let mut rewritten = vec![false; mesh.triangles.len()];
    for edge in 0..rows.edges.len() {
        let faces: Vec<u32> = rows.faces(edge).iter().map(|face| face >> 1).collect();
        for (k, &first) in faces.iter().enumerate() {
            for &second in &faces[k + 1..] {
                if rewritten[first as usize] || rewritten[second as usize] {
                    continue;
                }
                if let Some([from, to]) = same_ground(mesh, &rows, rows.edges[edge], [first, second]) {
                    for (&from, &to) in from.iter().zip(&to) {
                        mesh.triangles[to as usize] = mesh.triangles[from as usize];
                        rewritten[to as usize] = true;
                    }
                }
            }
        }
    }
    rewritten.contains(&true)
}

/// The two faces that the triangles `seeds` on one side of `edge` belong to, if they cover the same ground: each grows
/// over its inner edges, which the other does not have, until both have the same rim.
fn same_ground(mesh: &Mesh, rows: &EdgeRows, edge: [u32; 2], seeds: [u32; 2]) -> Option<[Vec<u32>; 2]> {
    let plane = Plane::of(mesh, seeds[0]);
    if !plane.holds(mesh, seeds[1]) || plane.side(mesh, edge, seeds[0]) != plane.side(mesh, edge, seeds[1]) {
        return None;
    }
    let mut faces = [vec![], vec![]];
    // Edges on the rim of one face and not of the other, with a triangle of that face.
    let mut open: Vec<([u32; 2], usize, u32)> = Vec::new();
    let mut next = seeds.into_iter().enumerate().collect::<Vec<_>>();
    loop {
        for (face, triangle) in next.drain(..) {
            faces[face].push(triangle);
            for side in sides(mesh, triangle) {
                match open.iter().position(|&(known, ..)| known == side) {
                    Some(k) => drop(open.swap_remove(k)),
                    None => open.push((side, face, triangle)),
                }
            }
        }
        if open.is_empty() {
            return (faces[0].len() == faces[1].len()).then_some(faces);
        }
        if faces[0].len() + faces[1].len() == 2 * FACE_TRIANGLES_MAX {
            return None;
        }
        // Over an inner edge a face goes on in one triangle. At an outer one that the other has not reached yet, that
        // other lies on the same side.
        let beyond = |&(edge, face, inside): &([u32; 2], usize, u32)| {
            let row = rows.edges.binary_search(&edge).expect("triangles of faces are listed");
            let &[a, b] = rows.faces(row) else { return None };
            let beyond = if a >> 1 == inside { b >> 1 } else { a >> 1 };
            let taken = faces.iter().any(|face| face.contains(&beyond));
            let goes_on = plane.side(mesh, edge, inside) != plane.side(mesh, edge, beyond);
            (!taken && goes_on && plane.holds(mesh, beyond)).then_some((face, beyond))
        };
        next.push(open.iter().find_map(beyond)?);
    }
}

fn sides(mesh: &Mesh, triangle: u32) -> [[u32; 2]; 3] {
    let [a, b, c] = mesh.triangles[triangle as usize];
    [[a, b], [b, c], [c, a]].map(|[v, w]| [v.min(w), v.max(w)])
}

/// The plane of a triangle that has an area.
struct Plane {
    at: DVec3,
    normal: DVec3,
}

impl Plane {
    fn of(mesh: &Mesh, triangle: u32) -> Self {
        let corners = mesh.corners(triangle as usize);
        let normal = normal_direction(corners);
        Self { at: corners[0], normal: normal / length(normal) }
    }

    /// Whether all corners of a triangle lie in the plane.
    fn holds(&self, mesh: &Mesh, triangle: u32) -> bool {
        let corners = mesh.corners(triangle as usize).map(|p| p - self.at);
        let size = corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        corners.iter().all(|p| p.dot(self.normal).abs() <= FLAT * size)
    }

    /// On which side of its edge a triangle in the plane lies.
    fn side(&self, mesh: &Mesh, edge: [u32; 2], triangle: u32) -> bool {
        let [p, q] = edge.map(|v| mesh.positions[v as usize]);
        let across = self.normal.cross((q - p) / (q - p).abs().max_element());
        let third = mesh.triangles[triangle as usize].iter().find(|v| !edge.contains(v));
        third.is_some_and(|&v| across.dot(mesh.positions[v as usize] - p) > 0.0)
    }
}
