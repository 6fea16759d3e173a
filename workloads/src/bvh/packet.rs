//! Sixteen rays from one point together: what each of them meets, bit for bit as if it went alone.
//!
//! Rays that look the same way along all axes visit nodes in the same order. A packet visits each node once for all of its rays, with a
//! mask of those that come there; all that is computed for a ray is what [`Bvh::closest`] computes for it, in the same order.

#![expect(unsafe_code, reason = "wide instructions of the host are called where it has them")]

use glam::DVec3;

use super::{Bvh, Hit, Node, Ray, STACK};

/// Rays of a packet.
pub const RAYS: usize = 16;

/// One number a ray.
type Lanes = [f64; RAYS];

/// The rays of a packet, all of one sign along each axis and with the same largest axis.
struct Packet {
    origin: DVec3,
    /// Whether the rays go up along each axis.
    is_up: [bool; 3],
    inverse: [Lanes; 3],
    axes: [usize; 3],
    shear: [Lanes; 3],
}

impl Packet {
    /// The packet of these rays; `None` where they do not look the same way, or one of them lies along a plane of the axes.
    #[inline(always)]
    fn new(origin: DVec3, directions: &[DVec3; RAYS]) -> Option<Packet> {
        let first = Ray::new(origin, directions[0]);
        let is_up = [0, 1, 2].map(|k| directions[0][k] >= 0.0);
        let along: [Lanes; 3] = [0, 1, 2].map(|k| directions.map(|direction| direction[k]));
        let [x, y, z] = first.axes;
        let mut inverse = [[0.0; RAYS]; 3];
        let mut shear = [[0.0; RAYS]; 3];
        let mut same = [true; RAYS];
        for i in 0..RAYS {
            for k in 0..3 {
                inverse[k][i] = 1.0 / along[k][i];
                same[i] &= ((along[k][i] >= 0.0) == is_up[k]) & inverse[k][i].is_finite();
            }
            let [of_x, of_y, of_z] = [0, 1, 2].map(|k| along[k][i].abs());
            let longest = if (of_x > of_y) & (of_x > of_z) { 0 } else { 1 + usize::from(of_z >= of_y) };
            same[i] &= longest == z;
            shear[0][i] = along[x][i] / along[z][i];
            shear[1][i] = along[y][i] / along[z][i];
            shear[2][i] = 1.0 / along[z][i];
        }
        let same = same.iter().all(|same| *same);
        same.then_some(Packet { origin, is_up, inverse, axes: first.axes, shear })
    }

    /// The rays that meet the box of `node` before their limits, one a bit: [`Ray::meets`].
    #[inline(always)]
    fn meet(&self, node: &Node, limits: &Lanes) -> u32 {
        let mut low = (node.bounds.min - self.origin).to_array();
        let mut high = (node.bounds.max - self.origin).to_array();
        for k in 0..3 {
            if !self.is_up[k] {
                (low[k], high[k]) = (high[k], low[k]);
            }
        }
        let mut meets = [0; RAYS];
        for (i, meets) in meets.iter_mut().enumerate() {
            let (mut near, mut far) = (0.0, limits[i]);
            for k in 0..3 {
                let (enter, leave) = (low[k] * self.inverse[k][i], high[k] * self.inverse[k][i]);
                near = if enter > near { enter } else { near };
                far = if leave < far { leave } else { far };
            }
            *meets = bit(i, near <= far + far.abs() * (8.0 * f64::EPSILON));
        }
        all(&meets)
    }
}

/// What the rays of a packet have met so far.
struct Best {
    /// Distances; infinite where nothing was met.
    limits: Lanes,
    triangles: [u32; RAYS],
    weights: [Lanes; 3],
}

impl Best {
    /// Tests the rays of `active` with a triangle: [`Ray::triangle`].
    #[inline(always)]
    fn test(&mut self, packet: &Packet, active: u32, corners: &[DVec3; 3], triangle: u32) {
        let [x, y, z] = packet.axes;
        // The coordinates in the order of the axes, out of the loop.
        let relative = |corner: DVec3| {
            let p = (corner - packet.origin).to_array();
            (p[x], p[y], p[z])
        };
        let (a_x, a_y, a_z) = relative(corners[0]);
        let (b_x, b_y, b_z) = relative(corners[1]);
        let (c_x, c_y, c_z) = relative(corners[2]);
        let [mut u, mut v, mut w, mut det] = [[0.0; RAYS]; 4];
        let mut inside = [0; RAYS];
        for i in 0..RAYS {
            let (along_x, along_y) = (packet.shear[0][i], packet.shear[1][i]);
            let (ax, ay) = (a_x - along_x * a_z, a_y - along_y * a_z);
            let (bx, by) = (b_x - along_x * b_z, b_y - along_y * b_z);
            let (cx, cy) = (c_x - along_x * c_z, c_y - along_y * c_z);
            (u[i], v[i], w[i]) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
            let below = (u[i] < 0.0) | (v[i] < 0.0) | (w[i] < 0.0);
            let above = (u[i] > 0.0) | (v[i] > 0.0) | (w[i] > 0.0);
            det[i] = u[i] + v[i] + w[i];
            inside[i] = bit(i, !(below & above) & (det[i] != 0.0));
        }
        let mut left = all(&inside) & active;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            let t = (u[i] * a_z + v[i] * b_z + w[i] * c_z) * packet.shear[2][i] / det[i];
            let wins = t < self.limits[i] || (t == self.limits[i] && triangle < self.triangles[i]);
            if t > 0.0 && t < f64::INFINITY && wins {
                self.limits[i] = t;
                self.triangles[i] = triangle;
                for (weights, part) in self.weights.iter_mut().zip([u[i], v[i], w[i]]) {
                    weights[i] = part / det[i];
                }
            }
        }
    }
}

/// Whether the host has what [`Bvh::walk_together_avx2`] is made of.
#[cfg(target_arch = "x86_64")]
fn has_wide_instructions() -> bool {
    use std::arch::is_x86_feature_detected as has;
    has!("avx2") && has!("bmi1") && has!("bmi2") && has!("lzcnt")
}

/// Bit `i`, if `is_set`: as wide as a number of a lane, so that lanes stay where they are.
#[inline(always)]
fn bit(i: usize, is_set: bool) -> u64 {
    if is_set { 1 << i } else { 0 }
}

/// The bits of all lanes.
#[inline(always)]
fn all(lanes: &[u64; RAYS]) -> u32 {
    lanes.iter().fold(0, |bits, lane| bits | lane) as u32
}

impl Bvh {
    /// [`Bvh::closest`] of sixteen rays from one point, with no limits but 0 and infinity.
    #[must_use]
    pub fn closest_of_packet(&self, origin: DVec3, directions: &[DVec3; RAYS]) -> [Option<Hit>; RAYS] {
        if self.nodes.is_empty() {
            return [None; RAYS];
        }
        #[cfg(target_arch = "x86_64")]
        let together = if has_wide_instructions() {
            // SAFETY: the host has these instructions.
            unsafe { self.walk_together_avx2(origin, directions) }
        } else {
            self.walk_together(origin, directions)
        };
        #[cfg(not(target_arch = "x86_64"))]
        let together = self.walk_together(origin, directions);
        together.unwrap_or_else(|| {
            directions.map(|direction| self.closest(origin, direction, 0.0, f64::INFINITY))
        })
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt")]
    fn walk_together_avx2(&self, origin: DVec3, directions: &[DVec3; RAYS]) -> Option<[Option<Hit>; RAYS]> {
        self.walk_together(origin, directions)
    }

    /// What each ray meets; `None` where the rays are no packet. There must be a node.
    #[inline(always)]
    fn walk_together(&self, origin: DVec3, directions: &[DVec3; RAYS]) -> Option<[Option<Hit>; RAYS]> {
        let packet = Packet::new(origin, directions)?;
        let mut best =
            Best { limits: [f64::INFINITY; RAYS], triangles: [u32::MAX; RAYS], weights: [[0.0; RAYS]; 3] };
        // A node, and the rays that meet the one above it.
        let mut stack = [(0_u32, 0_u32); STACK];
        stack[0].1 = u32::MAX >> (32 - RAYS);
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (index, above) = stack[depth];
            let node = &self.nodes[index as usize];
            let active = packet.meet(node, &best.limits) & above;
            if active == 0 {
                continue;
            }
            if node.count == 0 {
                let [near, far] = node.children(index, packet.is_up[node.axis as usize]);
                stack[depth] = (far, active);
                stack[depth + 1] = (near, active);
                depth += 2;
                continue;
            }
            for k in node.first as usize..(node.first + node.count) as usize {
                best.test(&packet, active, &self.corners[k], self.order[k]);
            }
        }
        Some(core::array::from_fn(|i| {
            let weights = [0, 1, 2].map(|k| best.weights[k][i]);
            let triangle = best.triangles[i];
            (triangle != u32::MAX).then_some(Hit { t: best.limits[i], triangle, weights })
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;

    /// Numbers in [-1, 1) that differ from call to call.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    /// Triangles here and there, some of them twice, and some in a plane that rays from the origin run along.
    fn mesh(state: &mut u64) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..400 {
            let middle = DVec3::from([0; 3].map(|_| 3.0 * random(state)));
            let corners = [0; 3].map(|_| middle + DVec3::from([0; 3].map(|_| 0.5 * random(state))));
            for _ in 0..1 + i % 2 {
                let first = mesh.positions.len() as u32;
                let flat = |p: DVec3| if i % 7 == 0 { DVec3::new(p.x, 0.0, p.z) } else { p };
                mesh.positions.extend(corners.map(flat));
                mesh.triangles.push([first, first + 1, first + 2]);
            }
        }
        mesh
    }

    #[test]
    fn each_ray_of_a_packet_meets_what_it_meets_alone() {
        let mut state = 5;
        let bvh = Bvh::new(&mesh(&mut state));
        let (mut met, mut together) = (0, 0);
        for number in 0..3000 {
            let origin = DVec3::from([0; 3].map(|_| 2.0 * random(&mut state)));
            let origin = if number % 5 == 0 { DVec3::ZERO } else { origin };
            let ahead = DVec3::from([0; 3].map(|_| random(&mut state)));
            let directions: [DVec3; RAYS] = core::array::from_fn(|_| {
                let aside = DVec3::from([0; 3].map(|_| random(&mut state)));
                let mut direction = ahead + aside * 0.1;
                // Now and then along a plane of the axes, as rays through the middle of a picture are.
                if number % 11 == 0 {
                    direction.y = 0.0;
                }
                direction
            });
            let alone = directions.map(|direction| bvh.closest(origin, direction, 0.0, f64::INFINITY));
            assert_eq!(bvh.closest_of_packet(origin, &directions), alone, "packet {number}");
            if let Some(narrow) = bvh.walk_together(origin, &directions) {
                assert_eq!(narrow, alone, "packet {number} without wide instructions");
                together += 1;
            }
            met += alone.iter().flatten().count();
        }
        println!("{met} rays meet something, {together} packets stay together");
        assert!(met > 10_000 && together > 1000, "{met} {together}");
        let none = Bvh::new(&Mesh::default()).closest_of_packet(DVec3::ZERO, &[DVec3::ONE; RAYS]);
        assert_eq!(none, [None; RAYS]);
    }
}
