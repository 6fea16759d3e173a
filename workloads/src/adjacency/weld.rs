//! Joining vertices that are meant to be one.

use std::collections::HashMap;

use glam::DVec3;

use crate::mesh::{Mesh, length};

/// Weld distance as a part of the scene's diagonal: half a step of the grid of 2^-20 [algorithms, §6.5].
const WELD_FRACTION: f64 = 0.5 / 1_048_576.0;

/// A vertex is never moved by more than this part of the shortest edge on it: a 2 mm cube above a floor of 2000 km
/// stays a cube.
const SHORTEST_EDGE_FRACTION: f64 = 1.0 / 16.0;

/// Joins vertices no farther apart than [`WELD_FRACTION`] of the diagonal; each takes the position of the first.
///
/// Vertices are looked up in cells of a few weld distances and, near a cell's border, in the cells beyond it, so
/// that near-duplicates are found wherever the grid lines run. Kept vertices are farther apart than that distance,
/// hence welding twice changes nothing. Cost: O(n), about one look-up a vertex.
pub fn weld(mesh: &mut Mesh) {
    let bounds = mesh.bounds();
    let reach = bounds.diagonal() * WELD_FRACTION;
    let limit = limits(mesh, reach);
    let cell_size = (reach * 8.0).max(f64::MIN_POSITIVE);

    // Look-ups only, never iterated: hash order cannot show.
    let mut kept: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut target: Vec<u32> = vec![u32::MAX; mesh.positions.len()];
    for &v in mesh.triangles.iter().flatten() {
        if target[v as usize] != u32::MAX {
            continue;
        }
        let p = mesh.positions[v as usize];
        let local = (p - bounds.min) / cell_size;
        target[v as usize] = find(&kept, &mesh.positions, &limit, v, local, reach / cell_size)
            .unwrap_or_else(|| {
                kept.entry(local.floor().to_array().map(|x| x as i64)).or_default().push(v);
                v
            });
    }
    for v in mesh.triangles.iter_mut().flatten() {
        *v = target[*v as usize];
    }
}

/// The first kept vertex within reach of `v`; `None` if there is none.
fn find(
    kept: &HashMap<[i64; 3], Vec<u32>>,
    positions: &[DVec3],
    limit: &[f64],
    v: u32,
    local: DVec3,
    reach: f64,
) -> Option<u32> {
    let low = (local - DVec3::splat(reach)).floor().to_array().map(|x| x as i64);
    let high = (local + DVec3::splat(reach)).floor().to_array().map(|x| x as i64);
    let mut best = None;
    for x in low[0]..=high[0] {
        for y in low[1]..=high[1] {
            for z in low[2]..=high[2] {
                for &other in kept.get(&[x, y, z]).into_iter().flatten() {
                    let apart = length(positions[other as usize] - positions[v as usize]);
                    let near = apart <= limit[other as usize].min(limit[v as usize]);
                    // The lowest index, so that the order of cells does not show.
                    if near && best.is_none_or(|b| other < b) {
                        best = Some(other);
                    }
                }
            }
        }
    }
    best
}

/// How far each vertex may be moved.
fn limits(mesh: &Mesh, reach: f64) -> Vec<f64> {
    let mut limit = vec![reach; mesh.positions.len()];
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k] as usize, t[(k + 1) % 3] as usize);
            let edge = length(mesh.positions[a] - mesh.positions[b]) * SHORTEST_EDGE_FRACTION;
            if edge > 0.0 {
                limit[a] = limit[a].min(edge);
                limit[b] = limit[b].min(edge);
            }
        }
    }
    limit
}

/// Numbers vertices by first use and drops those that no triangle uses.
pub fn order_by_first_use(mesh: &mut Mesh) {
    let mut new_index: Vec<u32> = vec![u32::MAX; mesh.positions.len()];
    let mut positions = Vec::new();
    for v in mesh.triangles.iter_mut().flatten() {
        let slot = &mut new_index[*v as usize];
        if *slot == u32::MAX {
            *slot = positions.len() as u32;
            positions.push(mesh.positions[*v as usize]);
        }
        *v = *slot;
    }
    mesh.positions = positions;
}
