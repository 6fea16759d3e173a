//! Plain parts that made scenes are put together from.

use core::f64::consts::{PI, TAU};

use lrbsim_workloads::glam::{DMat3, DVec2, DVec3};
use lrbsim_workloads::{Mesh, ObjectRange};

/// A mesh that grows part by part; every part is an object with a name, so that warnings can name it.
#[derive(Debug, Default)]
pub(crate) struct Parts(Mesh);

impl Parts {
    pub fn finish(self) -> Mesh {
        self.0
    }

    /// The parts so far with one more: flat or not, `corners` with `triangles` between them.
    pub fn with(mut self, name: &str, corners: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let last = triangles.len() as u32;
        let objects = vec![ObjectRange { name: name.to_owned(), groups: String::new(), first: 0, last }];
        self.0.append(&Mesh { positions: corners.to_vec(), triangles: triangles.to_vec(), objects });
        self
    }

    /// The parts so far with a flat sheet of four corners, in order around it.
    pub fn quad(self, name: &str, corners: [DVec3; 4]) -> Self {
        self.with(name, &corners, &[[0, 1, 2], [0, 2, 3]])
    }

    /// The parts so far with a level sheet about `center`.
    pub fn level(self, name: &str, center: DVec3, half: f64) -> Self {
        let at = |x: f64, z: f64| center + DVec3::new(x, 0.0, z) * half;
        self.quad(name, [at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0), at(1.0, -1.0)])
    }

    /// The parts so far with a closed block from `low` to `high`.
    pub fn block(self, name: &str, low: DVec3, high: DVec3) -> Self {
        let corner = |i: u32| {
            let side = |bit: u32, low: f64, high: f64| if i >> bit & 1 == 1 { high } else { low };
            DVec3::new(side(0, low.x, high.x), side(1, low.y, high.y), side(2, low.z, high.z))
        };
        let corners: Vec<DVec3> = (0..8).map(corner).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> =
            quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        self.with(name, &corners, &triangles)
    }

    /// The parts so far with a level disc of `sides` edges about `center`, as a fan.
    pub fn disc(self, name: &str, center: DVec3, radius: f64, sides: u32) -> Self {
        let rim = (0..sides).map(|k| {
            let out = DVec2::from_angle(TAU * f64::from(k) / f64::from(sides));
            center + DVec3::new(out.x, 0.0, out.y) * radius
        });
        let corners: Vec<DVec3> = std::iter::once(center).chain(rim).collect();
        let triangles: Vec<[u32; 3]> = (0..sides).map(|k| [0, 1 + k, 1 + (k + 1) % sides]).collect();
        self.with(name, &corners, &triangles)
    }

    /// The parts so far with a wavy sheet of `sides * sides` fields, two triangles each, about `center`.
    pub fn waves(self, name: &str, center: DVec3, half: f64, sides: u32) -> Self {
        let row = sides + 1;
        let corner = |i: u32| {
            let part = |k: u32| 2.0 * f64::from(k) / f64::from(sides) - 1.0;
            let (x, z) = (part(i % row), part(i / row));
            center
                + DVec3::new(x, 0.1 * DVec2::from_angle(7.0 * x).y * DVec2::from_angle(5.0 * z).x, z) * half
        };
        let corners: Vec<DVec3> = (0..row * row).map(corner).collect();
        let field = |i: u32| {
            let a = i / sides * row + i % sides;
            [[a, a + row, a + row + 1], [a, a + row + 1, a + 1]]
        };
        let triangles: Vec<[u32; 3]> = (0..sides * sides).flat_map(field).collect();
        self.with(name, &corners, &triangles)
    }

    /// The parts so far with a round body about `center`, of `rings` rings of twice as many fields, two triangles each.
    pub fn ball(self, name: &str, center: DVec3, radius: f64, rings: u32) -> Self {
        let row = 2 * rings;
        let ring = |i: u32| {
            let level = DVec2::from_angle(PI * f64::from(i) / f64::from(rings));
            let corner = move |k: u32| {
                let out = DVec2::from_angle(TAU * f64::from(k) / f64::from(row)) * level.y;
                center + DVec3::new(out.x, level.x, out.y) * radius
            };
            (0..row).map(corner)
        };
        let corners: Vec<DVec3> = (1..rings)
            .flat_map(ring)
            .chain([center + DVec3::Y * radius, center - DVec3::Y * radius])
            .collect();
        let [top, bottom] = [(rings - 1) * row, (rings - 1) * row + 1];
        let column = |k: u32| {
            let next = (k + 1) % row;
            let last = (rings - 2) * row;
            let caps = [[top, next, k], [bottom, last + k, last + next]];
            let field = move |i: u32| {
                let [a, b] = [i * row + k, i * row + next];
                [[a, b, b + row], [a, b + row, a + row]]
            };
            (0..rings - 2).flat_map(field).chain(caps)
        };
        let triangles: Vec<[u32; 3]> = (0..row).flat_map(column).collect();
        self.with(name, &corners, &triangles)
    }

    /// The parts so far with a slanted sheet of two halves, which meet at a seam about `center` that only one of them has
    /// `corners` on.
    pub fn seam(self, center: DVec3, corners: u32) -> Self {
        let at = |s: f64, t: f64| turned(DVec3::new(0.6 * s, 0.0, 1.2 * t - 0.6)) + center;
        let count = corners + 1;
        let right: Vec<DVec3> = (0..=count)
            .map(|k| f64::from(k) / f64::from(count))
            .flat_map(|t| [at(0.0, t), at(1.0, t)])
            .collect();
        let triangles: Vec<[u32; 3]> =
            (0..count).map(|k| 2 * k).flat_map(|a| [[a, a + 2, a + 3], [a, a + 3, a + 1]]).collect();
        self.quad("left half", [at(-1.0, 0.0), at(-1.0, 1.0), at(0.0, 1.0), at(0.0, 0.0)]).with(
            "right half",
            &right,
            &triangles,
        )
    }
}

/// `p` turned about two axes, so that no coordinate stays a round number.
pub(crate) fn turned(p: DVec3) -> DVec3 {
    DMat3::from_rotation_z(0.23) * (DMat3::from_rotation_y(0.37) * p)
}
