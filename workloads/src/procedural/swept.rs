//! Closed bodies swept along a path: tubes, leaves, ground, pebbles.

use core::f64::consts::TAU;

use glam::DVec3;

use super::random::Random;
use super::shapes::Builder;

/// Directions along a path and across it, carried along without turning about it.
struct CrossAxes {
    side: DVec3,
    normal: DVec3,
}

/// The cross axes at each point of a path of at least two different points; the first side is level where the path is
/// not upright.
fn cross_axes(path: &[DVec3]) -> Vec<CrossAxes> {
    let last = path.len() - 1;
    let along = |k: usize| (path[(k + 1).min(last)] - path[k.max(1) - 1]).normalize();
    let helper = if along(0).y.abs() < 0.99 { DVec3::Y } else { DVec3::X };
    let mut side = helper.cross(along(0)).normalize();
    (0..=last)
        .map(|k| {
            side = (side - along(k) * side.dot(along(k))).normalize();
            CrossAxes { side, normal: along(k).cross(side) }
        })
        .collect()
}

impl Builder {
    /// A body around `rings`, all of equally many points that run about the direction of the rings; pointed or flat at
    /// `start` and `end`.
    pub fn loft(&mut self, start: DVec3, rings: &[Vec<DVec3>], end: DVec3) {
        let start = self.vertex(start);
        let rings: Vec<Vec<u32>> =
            rings.iter().map(|ring| ring.iter().map(|&p| self.vertex(p)).collect()).collect();
        let end = self.vertex(end);
        let (first, last) = (&rings[0], &rings[rings.len() - 1]);
        let n = first.len();
        for k in 0..n {
            let next = (k + 1) % n;
            self.triangle([start, first[next], first[k]]);
            self.triangle([end, last[k], last[next]]);
            for pair in rings.windows(2) {
                self.quad([pair[0][k], pair[0][next], pair[1][next], pair[1][k]]);
            }
        }
    }

    /// A round rod along `path`; `radius` of the part of the way, in [0, 1]. `sides * detail` sides.
    pub fn tube(&mut self, path: &[DVec3], sides: u32, radius: impl Fn(f64) -> f64) {
        let n = self.sides(sides);
        let last = (path.len() - 1) as f64;
        let rings: Vec<Vec<DVec3>> = cross_axes(path)
            .iter()
            .zip(path)
            .enumerate()
            .map(|(row, (axes, &p))| {
                let r = radius(row as f64 / last);
                let corner = |k| TAU * f64::from(k) / f64::from(n);
                (0..n)
                    .map(|k| p + (axes.side * libm::cos(corner(k)) + axes.normal * libm::sin(corner(k))) * r)
                    .collect()
            })
            .collect();
        self.loft(path[0], &rings, path[path.len() - 1]);
    }

    /// A leaf whose midrib is `path`, both ends pointed: `width` of the part of the way, lens-shaped across and
    /// `thickness` times as thick as wide. `sides * detail` points across, at least 4.
    pub fn leaf(&mut self, path: &[DVec3], sides: u32, thickness: f64, width: impl Fn(f64) -> f64) {
        let n = self.sides(sides);
        let last = path.len() - 1;
        let axes = cross_axes(path);
        let rings: Vec<Vec<DVec3>> = (1..last)
            .map(|row| {
                let half = width(row as f64 / last as f64) * 0.5;
                let axes = &axes[row];
                (0..n)
                    .map(|k| {
                        let angle = TAU * f64::from(k) / f64::from(n);
                        let across = axes.side * (libm::cos(angle) * half);
                        path[row] + across + axes.normal * (libm::sin(angle) * half * thickness)
                    })
                    .collect()
            })
            .collect();
        self.loft(path[0], &rings, path[last]);
    }

    /// Ground: `height` above the rectangle from `min` to `max` (x, z) in `cells` (x, z), flat at `bottom` below.
    pub fn ground(
        &mut self,
        (min, max): ([f64; 2], [f64; 2]),
        cells: [u32; 2],
        bottom: f64,
        height: impl Fn(f64, f64) -> f64,
    ) {
        let [nx, nz] = cells;
        let place = |i: u32, j: u32| {
            let x = min[0] + (max[0] - min[0]) * f64::from(i) / f64::from(nx);
            let z = min[1] + (max[1] - min[1]) * f64::from(j) / f64::from(nz);
            (x, z)
        };
        let mut top = Vec::new();
        for j in 0..=nz {
            for i in 0..=nx {
                let (x, z) = place(i, j);
                top.push(self.vertex(DVec3::new(x, height(x, z), z)));
            }
        }
        let at = |i: u32, j: u32| top[(j * (nx + 1) + i) as usize];
        for j in 0..nz {
            for i in 0..nx {
                self.quad([at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
            }
        }
        // Once around the rim, from above in the order of a clock's hands turned back.
        let rim: Vec<(u32, u32)> = (0..nz)
            .map(|j| (0, j))
            .chain((0..nx).map(|i| (i, nz)))
            .chain((0..nz).map(|j| (nx, nz - j)))
            .chain((0..nx).map(|i| (nx - i, 0)))
            .collect();
        let low: Vec<u32> = rim
            .iter()
            .map(|&(i, j)| {
                let (x, z) = place(i, j);
                self.vertex(DVec3::new(x, bottom, z))
            })
            .collect();
        let middle = self.vertex(DVec3::new((min[0] + max[0]) * 0.5, bottom, (min[1] + max[1]) * 0.5));
        for k in 0..rim.len() {
            let next = (k + 1) % rim.len();
            let (a, b) = (at(rim[k].0, rim[k].1), at(rim[next].0, rim[next].1));
            self.quad([low[k], low[next], b, a]);
            self.triangle([middle, low[next], low[k]]);
        }
    }

    /// A rounded stone about `center`, as large as `size` along each axis; `uneven` by that part of it.
    pub fn pebble(&mut self, center: DVec3, size: DVec3, sides: u32, uneven: f64, random: &mut Random) {
        let n = self.sides(sides);
        let rows = (n / 2).max(3);
        let phase = [0.0; 3].map(|_: f64| random.range(0.0, TAU));
        let lobes = uneven * random.range(0.6, 1.4);
        let point = |row: f64, k: u32| {
            let (around, down) = (TAU * f64::from(k) / f64::from(n), TAU * 0.5 * row / f64::from(rows));
            let uneven = 1.0
                + lobes * libm::sin(2.0 * around + phase[0]) * libm::sin(down)
                + lobes * libm::sin(3.0 * around + phase[1]) * libm::sin(down) * libm::cos(down + phase[2]);
            let out = libm::sin(down) * uneven * 0.5;
            center
                + size * DVec3::new(out * libm::cos(around), -0.5 * libm::cos(down), -out * libm::sin(around))
        };
        let rings: Vec<Vec<DVec3>> =
            (1..rows).map(|row| (0..n).map(|k| point(f64::from(row), k)).collect()).collect();
        self.loft(center - size * DVec3::Y * 0.5, &rings, center + size * DVec3::Y * 0.5);
    }
}

/// `count + 1` points of a curve.
pub fn curve(count: u32, at: impl Fn(f64) -> DVec3) -> Vec<DVec3> {
    (0..=count).map(|k| at(f64::from(k) / f64::from(count))).collect()
}
