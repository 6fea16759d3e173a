//! Bodies, and a consistent winding within each.

use glam::DVec3;

use super::{Adjacency, NO_COMPONENT};
use crate::mesh::Mesh;

/// Bodies of a mesh and which of their triangles must be turned over.
pub struct Orientation {
    /// Body of each triangle.
    pub component: Vec<u32>,
    /// Triangles to turn over so that all of a body run the same way.
    pub flip: Vec<bool>,
    /// Whether each body, which is a component, can be given one outside.
    pub orientable: Vec<bool>,
}

/// Walks each body over edges with exactly two faces, from its first triangle, breadth first.
pub fn orientation(mesh: &Mesh, adjacency: &Adjacency) -> Orientation {
    let triangles = mesh.triangles.len();
    let mut result = Orientation {
        component: vec![NO_COMPONENT; triangles],
        flip: vec![false; triangles],
        orientable: vec![],
    };

    // Neighbors over two-faced edges: three slots a triangle, filled in edge order.
    let mut neighbors: Vec<[(u32, bool); 3]> = vec![[(u32::MAX, false); 3]; triangles];
    let mut listed = vec![false; triangles];
    let mut slots = vec![0_usize; triangles];
    for edge in 0..adjacency.edges.len() {
        let faces = adjacency.faces(edge);
        for face in faces {
            listed[(face >> 1) as usize] = true;
        }
        if let &[a, b] = faces {
            // Both sides equal: the two triangles run along the edge the same way, one must turn.
            let turned = (a & 1) == (b & 1);
            for (from, to) in [(a >> 1, b >> 1), (b >> 1, a >> 1)] {
                neighbors[from as usize][slots[from as usize]] = (to, turned);
                slots[from as usize] += 1;
            }
        }
    }

    let mut queue = std::collections::VecDeque::new();
    for (seed, &is_listed) in listed.iter().enumerate() {
        if !is_listed || result.component[seed] != NO_COMPONENT {
            continue;
        }
        let id = result.orientable.len() as u32;
        result.orientable.push(true);
        result.component[seed] = id;
        queue.push_back(seed);
        while let Some(t) = queue.pop_front() {
            for &(next, turned) in &neighbors[t][..slots[t]] {
                let flip = result.flip[t] ^ turned;
                let next = next as usize;
                if result.component[next] == NO_COMPONENT {
                    result.component[next] = id;
                    result.flip[next] = flip;
                    queue.push_back(next);
                } else if result.flip[next] != flip {
                    result.orientable[id as usize] = false;
                }
            }
        }
    }
    result
}

/// Turns triangles over so that each orientable body has one winding, and bodies with a volume have it outward.
///
/// Outward, so that the far side of a body lies in the shadow of its near side rather than of itself. A triangle
/// `[a, b, c]` becomes `[a, c, b]`.
pub fn orient(mesh: &mut Mesh) {
    let adjacency = Adjacency::new(mesh);
    let orientation = orientation(mesh, &adjacency);
    let bodies = orientation.orientable.len();

    // Signed volume of each body about the middle of its corners.
    let mut center = vec![(DVec3::ZERO, 0_u32); bodies];
    for (t, &c) in orientation.component.iter().enumerate() {
        if c != NO_COMPONENT {
            let corners = mesh.corners(t);
            center[c as usize].0 += (corners[0] + corners[1] + corners[2]) / 3.0;
            center[c as usize].1 += 1;
        }
    }
    let mut volume = vec![0.0; bodies];
    for (t, &c) in orientation.component.iter().enumerate() {
        if c != NO_COMPONENT {
            let (sum, count) = center[c as usize];
            let [p, q, r] = mesh.corners(t).map(|x| x - sum / f64::from(count));
            let signed = p.dot(q.cross(r));
            volume[c as usize] += if orientation.flip[t] { -signed } else { signed };
        }
    }

    for (t, &c) in orientation.component.iter().enumerate() {
        if c == NO_COMPONENT || !orientation.orientable[c as usize] {
            continue;
        }
        // A sheet has nearly no volume; which way it runs does not matter, both of its sides count.
        if orientation.flip[t] ^ (volume[c as usize] < 0.0) {
            mesh.triangles[t].swap(1, 2);
        }
    }
}
