//! Closed bodies to build scenes from: boxes, turned bodies, rings.
//!
//! All are closed and wound outward, so that they count as `Counting::Closed`.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use crate::mesh::{Mesh, ObjectRange};

/// Collects bodies into a mesh.
#[derive(Debug, Default)]
pub struct Builder {
    mesh: Mesh,
    /// Sides of round parts are multiplied by this.
    detail: u32,
    place: Place,
}

/// Where bodies go: `turn * p + shift`.
#[derive(Debug, Clone, Copy)]
struct Place {
    turn: DMat3,
    shift: DVec3,
}

impl Default for Place {
    fn default() -> Self {
        Self { turn: DMat3::IDENTITY, shift: DVec3::ZERO }
    }
}

/// Turn about +y by `angle` (radians).
pub fn turn_y(angle: f64) -> DMat3 {
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    DMat3::from_cols(DVec3::new(c, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, c))
}

/// Turn about +z by `angle` (radians).
pub fn turn_z(angle: f64) -> DMat3 {
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z)
}

impl Builder {
    /// An empty mesh; round parts get `detail` times their usual number of sides.
    #[must_use]
    pub fn new(detail: u32) -> Self {
        Self { detail: detail.max(1), ..Self::default() }
    }

    /// The mesh that was built.
    #[must_use]
    pub fn finish(self) -> Mesh {
        self.mesh
    }

    /// Number of triangles so far.
    #[must_use]
    pub fn triangles(&self) -> usize {
        self.mesh.triangles.len()
    }

    /// Adds all that `make` adds as one object, turned and then shifted, within the place in force.
    pub fn object(&mut self, name: &str, turn: DMat3, shift: DVec3, make: impl FnOnce(&mut Self)) {
        let outer = self.place;
        self.place = Place { turn: outer.turn * turn, shift: outer.turn * shift + outer.shift };
        let first = self.mesh.triangles.len() as u32;
        make(self);
        let last = self.mesh.triangles.len() as u32;
        self.place = outer;
        // Only the outermost object is named: ranges do not nest.
        self.mesh.objects.retain(|o| o.last <= first);
        self.mesh.objects.push(ObjectRange { name: name.to_owned(), groups: String::new(), first, last });
    }

    /// Sides of a round part that has `sides` at detail 1.
    pub(super) fn sides(&self, sides: u32) -> u32 {
        sides * self.detail
    }

    pub(super) fn vertex(&mut self, p: DVec3) -> u32 {
        self.mesh.positions.push(self.place.turn * p + self.place.shift);
        self.mesh.positions.len() as u32 - 1
    }

    pub(super) fn triangle(&mut self, corners: [u32; 3]) {
        self.mesh.triangles.push(corners);
    }

    pub(super) fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }

    /// A box between two corners: 12 triangles.
    pub fn cuboid(&mut self, min: DVec3, max: DVec3) {
        let corner = |k: usize| {
            let pick = |axis: usize| if k >> axis & 1 == 1 { max[axis] } else { min[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        self.hexahedron(core::array::from_fn(corner));
    }

    /// A box about `center` with the given edge lengths.
    pub fn block(&mut self, center: DVec3, size: DVec3) {
        self.cuboid(center - size * 0.5, center + size * 0.5);
    }

    /// Eight corners; bit 0 of the number is x, bit 1 y, bit 2 z. Sides should be flat.
    pub fn hexahedron(&mut self, corners: [DVec3; 8]) {
        let v = corners.map(|p| self.vertex(p));
        for side in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            self.quad(side.map(|k| v[k]));
        }
    }

    /// A straight post of square section from `from` to `to`, thinner or thicker at its ends.
    pub fn post(&mut self, from: DVec3, to: DVec3, from_width: f64, to_width: f64) {
        let axis = (to - from).normalize();
        let helper = if axis.y.abs() < 0.9 { DVec3::Y } else { DVec3::X };
        let u = helper.cross(axis).normalize();
        let w = axis.cross(u);
        let corner = |k: usize| {
            let (end, width) = if k >> 2 & 1 == 1 { (to, to_width) } else { (from, from_width) };
            let side = |bit: usize| if k >> bit & 1 == 1 { width * 0.5 } else { width * -0.5 };
            end + u * side(0) + w * side(1)
        };
        self.hexahedron(core::array::from_fn(corner));
    }

    /// A turned body about +y through the origin: `profile` is (radius, y), from the bottom up, all radii above 0;
    /// flat caps at both ends. `sides * detail` sides.
    pub fn lathe(&mut self, sides: u32, profile: &[(f64, f64)]) {
        let n = sides * self.detail;
        let rings: Vec<Vec<u32>> = profile
            .iter()
            .map(|&(radius, y)| (0..n).map(|k| self.vertex(around(k, n, radius) + DVec3::Y * y)).collect())
            .collect();
        for pair in rings.windows(2) {
            for k in 0..n as usize {
                let next = (k + 1) % n as usize;
                self.quad([pair[0][k], pair[1][k], pair[1][next], pair[0][next]]);
            }
        }
        let (bottom, top) = (profile[0].1, profile[profile.len() - 1].1);
        let (low, high) = (self.vertex(DVec3::Y * bottom), self.vertex(DVec3::Y * top));
        for k in 0..n as usize {
            let next = (k + 1) % n as usize;
            self.mesh.triangles.push([low, rings[0][k], rings[0][next]]);
            self.mesh.triangles.push([high, rings[rings.len() - 1][next], rings[rings.len() - 1][k]]);
        }
    }

    /// A ring about +y: circle of `radius`, section of `thickness` (its radius).
    pub fn torus(&mut self, sides: u32, section: u32, radius: f64, thickness: f64) {
        let (n, m) = (sides * self.detail, section * self.detail);
        let mut grid = Vec::new();
        for k in 0..n {
            for j in 0..m {
                let t = TAU * f64::from(j) / f64::from(m);
                let out = radius + thickness * libm::cos(t);
                grid.push(self.vertex(around(k, n, out) + DVec3::Y * (thickness * libm::sin(t))));
            }
        }
        let at = |k: u32, j: u32| grid[((k % n) * m + j % m) as usize];
        for k in 0..n {
            for j in 0..m {
                self.quad([at(k, j), at(k, j + 1), at(k + 1, j + 1), at(k + 1, j)]);
            }
        }
    }

    /// A ball about `center`, `sides * detail` around.
    pub fn ball(&mut self, center: DVec3, radius: f64, sides: u32) {
        let n = sides * self.detail;
        let rows = (n / 2).max(2);
        let bottom = self.vertex(center - DVec3::Y * radius);
        let rings: Vec<Vec<u32>> = (1..rows)
            .map(|row| {
                let t = TAU * 0.5 * f64::from(row) / f64::from(rows);
                let (out, y) = (radius * libm::sin(t), -radius * libm::cos(t));
                (0..n).map(|k| self.vertex(center + around(k, n, out) + DVec3::Y * y)).collect()
            })
            .collect();
        let top = self.vertex(center + DVec3::Y * radius);
        let last = rings.len() - 1;
        for k in 0..n as usize {
            let next = (k + 1) % n as usize;
            self.mesh.triangles.push([bottom, rings[0][k], rings[0][next]]);
            self.mesh.triangles.push([top, rings[last][next], rings[last][k]]);
            for pair in rings.windows(2) {
                self.quad([pair[0][k], pair[1][k], pair[1][next], pair[0][next]]);
            }
        }
    }
}

/// Corner `k` of `n` on the circle of `radius` about +y.
fn around(k: u32, n: u32, radius: f64) -> DVec3 {
    let angle = TAU * f64::from(k) / f64::from(n);
    DVec3::new(radius * libm::cos(angle), 0.0, radius * libm::sin(angle))
}
