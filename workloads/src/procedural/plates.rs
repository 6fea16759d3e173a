//! A plate over a floor, whole or cut into pieces: triangles and silhouette edges are chosen apart from one another.

use glam::{DMat3, DVec3};

use super::shapes::Builder;
use crate::mesh::Mesh;

/// Edges along each side of the plate, all pieces together.
const RIM: u32 = 64;

/// Squares along each side of the plate at detail 1, all pieces together.
const SQUARES: u32 = 16;

/// Half of a side of the plate.
const HALF: f64 = 2.0;

/// Bottom and top of the plate.
const HEIGHTS: [f64; 2] = [2.0, 2.02];

/// A part of a piece's side that its neighbor is away.
const GAP: f64 = 0.1;

/// The middle of a piece, as a part of its side, that has squares; around it lies a strip that leads to the rim.
const MIDDLE: f64 = 0.9;

/// A plate of side 4 at height 2, over a floor of 12 triangles and side 8, cut into `pieces` by `pieces` (a divisor of 16). From above, its
/// silhouette has 256 `pieces` edges, all of one length. Its triangles are some 1024 `detail`², and 128 (8 + `detail`) more for each
/// of `pieces`.
pub fn plates(detail: u32, pieces: u32) -> Mesh {
    let mut b = Builder::new(detail);
    b.object("floor", DMat3::IDENTITY, DVec3::ZERO, |b| {
        b.cuboid(DVec3::new(-4.0, -0.1, -4.0), DVec3::new(4.0, 0.0, 4.0));
    });
    let pitch = 2.0 * HALF / f64::from(pieces);
    b.object("plate", DMat3::IDENTITY, DVec3::ZERO, |b| {
        for number in 0..pieces * pieces {
            let at = |number: u32| (f64::from(number) + 0.5) * pitch - HALF;
            let center = [at(number % pieces), at(number / pieces)];
            piece(b, center, 0.5 * pitch * (1.0 - GAP), RIM / pieces, SQUARES * detail / pieces);
        }
    });
    b.finish()
}

/// A closed piece about `center`: `rim` edges and `squares` squares along each of its sides.
fn piece(b: &mut Builder, [x, z]: [f64; 2], half: f64, rim: u32, squares: u32) {
    let rims = HEIGHTS.map(|y| {
        let point = |[u, v]: [f64; 2]| DVec3::new(x + half * u, y, z + half * v);
        let outline: Vec<u32> = outline(rim).map(|at| b.vertex(point(at))).collect();
        let line = |i: u32| MIDDLE * (2.0 * f64::from(i) / f64::from(squares) - 1.0);
        let grid: Vec<u32> = (0..=squares)
            .flat_map(|j| (0..=squares).map(move |i| [i, j]))
            .map(|[i, j]| b.vertex(point([line(i), line(j)])))
            .collect();
        let at = |i: u32, j: u32| grid[(j * (squares + 1) + i) as usize];
        let is_top = y == HEIGHTS[1];
        let mut face = |[p, q, r]: [u32; 3]| b.triangle(if is_top { [p, r, q] } else { [p, q, r] });
        for (i, j) in (0..squares).flat_map(|j| (0..squares).map(move |i| (i, j))) {
            face([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            face([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        // The same way around as the outline.
        let inner = |side: u32, j: u32| match side {
            0 => at(j, 0),
            1 => at(squares, j),
            2 => at(squares - j, squares),
            _ => at(0, squares - j),
        };
        let outer = |side: u32, i: u32| outline[((side * rim + i) % (4 * rim)) as usize];
        for side in 0..4 {
            let (mut i, mut j) = (0, 0);
            while i < rim || j < squares {
                // Whichever of both is behind goes on.
                if i < rim && (i + 1) * squares <= (j + 1) * rim || j == squares {
                    face([outer(side, i), outer(side, i + 1), inner(side, j)]);
                    i += 1;
                } else {
                    face([outer(side, i), inner(side, j + 1), inner(side, j)]);
                    j += 1;
                }
            }
        }
        outline
    });
    let [bottom, top] = &rims;
    for here in 0..bottom.len() {
        let next = (here + 1) % bottom.len();
        b.quad([bottom[here], top[here], top[next], bottom[next]]);
    }
}

/// The corners of a square from -1 to 1, and the ends of `rim` edges along each side: four times as many points.
fn outline(rim: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..4 * rim).map(move |number| {
        let along = 2.0 * f64::from(number % rim) / f64::from(rim) - 1.0;
        match number / rim {
            0 => [along, -1.0],
            1 => [1.0, along],
            2 => [-along, 1.0],
            _ => [-1.0, -along],
        }
    })
}
