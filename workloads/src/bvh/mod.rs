//! A bounding volume hierarchy over triangles, all in f64, for the eye view and the reference rays.
//!
//! Crates for this keep boxes and hit distances in f32; receivers must be exact hit points, and scenes may lie
//! 5000 km off the origin, so the hierarchy is ours: binned surface-area splits, watertight triangle test.

pub mod packet;

use glam::DVec3;

use crate::mesh::{Bounds, Mesh, distance_to_triangle};

/// Leaves hold at most this many triangles, unless they cannot be split.
const LEAF_TRIANGLES: usize = 4;
/// Bins tried by the surface-area heuristic along each axis.
const BINS: usize = 16;
/// Depth of the traversal stack; the build never goes deeper.
const STACK: usize = 64;

/// A hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Parameter along the ray, in units of the direction given.
    pub t: f64,
    /// Triangle that was hit.
    pub triangle: u32,
    /// Weights of the three corners; they sum to 1.
    pub weights: [f64; 3],
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bounds: Bounds,
    /// Leaf: first entry in `order`. Inner node: index of the right child; the left one follows the node.
    first: u32,
    /// Triangles of a leaf, 0 for an inner node.
    count: u32,
    /// Axis of the split.
    axis: u8,
}

impl Node {
    /// Makes this the root of two subtrees; `right`: the number of the second one's root.
    fn become_inner(&mut self, axis: usize, right: u32) {
        (self.first, self.count, self.axis) = (right, 0, axis as u8);
    }

    /// This node of a subtree whose nodes are numbered from `offset` on.
    fn moved(self, offset: u32) -> Node {
        let first = if self.count == 0 { self.first + offset } else { self.first };
        Node { first, ..self }
    }

    /// The children of the inner node `index`, nearest first for a ray that goes up along the axis of the split if `is_up`.
    fn children(&self, index: u32, is_up: bool) -> [u32; 2] {
        if is_up { [index + 1, self.first] } else { [self.first, index + 1] }
    }
}

/// The hierarchy, with a copy of the corners in leaf order.
#[derive(Debug, Clone)]
pub struct Bvh {
    nodes: Vec<Node>,
    corners: Vec<[DVec3; 3]>,
    order: Vec<u32>,
}

/// A ray made ready for the watertight test: axes permuted so that the direction is largest along the third.
pub(crate) struct Ray {
    origin: DVec3,
    inverse: DVec3,
    axes: [usize; 3],
    shear: DVec3,
}

impl Ray {
    pub(crate) fn new(origin: DVec3, direction: DVec3) -> Self {
        let abs = direction.abs();
        let z = if abs.x > abs.y && abs.x > abs.z { 0 } else { 1 + usize::from(abs.z >= abs.y) };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            core::mem::swap(&mut x, &mut y);
        }
        let shear = DVec3::new(direction[x] / direction[z], direction[y] / direction[z], 1.0 / direction[z]);
        Self { origin, inverse: direction.recip(), axes: [x, y, z], shear }
    }

    /// Woop, Benthin and Wald 2013: no ray slips between two triangles that share an edge.
    pub(crate) fn triangle(&self, corners: &[DVec3; 3], t_min: f64, t_max: f64) -> Option<(f64, [f64; 3])> {
        let [x, y, z] = self.axes;
        let [a, b, c] = corners.map(|p| p - self.origin);
        let (ax, ay) = (a[x] - self.shear.x * a[z], a[y] - self.shear.y * a[z]);
        let (bx, by) = (b[x] - self.shear.x * b[z], b[y] - self.shear.y * b[z]);
        let (cx, cy) = (c[x] - self.shear.x * c[z], c[y] - self.shear.y * c[z]);
        let (u, v, w) = (cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax);
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let t = (u * a[z] + v * b[z] + w * c[z]) * self.shear.z / det;
        (t > t_min && t < t_max).then(|| (t, [u / det, v / det, w / det]))
    }

    /// Whether the ray meets the box between the two parameters.
    fn meets(&self, bounds: &Bounds, t_min: f64, t_max: f64) -> bool {
        // `max(NaN, x)` is x: a ray in the plane of a slab (0 * inf) is not cut by it.
        let low = (bounds.min - self.origin) * self.inverse;
        let high = (bounds.max - self.origin) * self.inverse;
        let mut near = t_min;
        let mut far = t_max;
        for k in 0..3 {
            if low[k].is_nan() || high[k].is_nan() {
                continue;
            }
            near = near.max(low[k].min(high[k]));
            far = far.min(low[k].max(high[k]));
        }
        // Three roundings on either side [pbrt, §6.8.2].
        near <= far + far.abs() * 8.0 * f64::EPSILON
    }
}

/// The segments from a point to a parallelogram: what lies wholly outside one of its planes meets none of them.
struct Shaft {
    apex: DVec3,
    /// Unit normals, inward: of the four sides, through the apex, and of the far end. A side that is not to be had is 0.
    normals: [DVec3; 5],
    /// Least height of each plane over the apex.
    least: [f64; 5],
}

impl Shaft {
    fn new(apex: DVec3, hull: &[DVec3; 4]) -> Self {
        let arms = hull.map(|corner| corner - apex);
        let middle = arms.iter().sum::<DVec3>() * 0.25;
        // The planes through the apex carry the rounding of its coordinates; so do the triangles.
        let reach =
            hull.iter().fold(apex.abs().max_element(), |far, corner| far.max(corner.abs().max_element()));
        let slack = 256.0 * f64::EPSILON * reach;
        let side = |i: usize| {
            let normal = arms[i].cross(arms[(i + 1) % 4]).normalize_or_zero();
            let inside = normal.dot(middle);
            // Seen edge-on, the light is in all of these planes: they part nothing.
            if inside.abs() <= slack { DVec3::ZERO } else { normal * inside.signum() }
        };
        let far = (hull[1] - hull[0]).cross(hull[3] - hull[0]).normalize_or_zero();
        let far = if far.dot(middle) > 0.0 { -far } else { far };
        let normals = [side(0), side(1), side(2), side(3), far];
        Self { apex, normals, least: [-slack, -slack, -slack, -slack, far.dot(middle) - slack] }
    }

    fn misses_box(&self, bounds: &Bounds) -> bool {
        self.normals.iter().zip(self.least).any(|(normal, least)| {
            // The corner farthest in.
            let corner = DVec3::select(normal.cmpgt(DVec3::ZERO), bounds.max, bounds.min);
            normal.dot(corner - self.apex) < least
        })
    }

    fn misses_points(&self, points: &[DVec3; 3]) -> bool {
        self.normals
            .iter()
            .zip(self.least)
            .any(|(normal, least)| points.iter().all(|point| normal.dot(point - self.apex) < least))
    }
}

impl Bvh {
    /// Builds the hierarchy. O(n log n); the result depends on `mesh` alone.
    #[must_use]
    pub fn new(mesh: &Mesh) -> Self {
        let corners: Vec<[DVec3; 3]> = (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect();
        let boxes: Vec<Bounds> = corners
            .iter()
            .map(|c| {
                let mut bounds = Bounds::EMPTY;
                c.iter().for_each(|&p| bounds.add(p));
                bounds
            })
            .collect();
        let centers = boxes.iter().map(Bounds::center).collect();
        let mut order: Vec<u32> = (0..corners.len() as u32).collect();
        let nodes =
            if order.is_empty() { Vec::new() } else { Build { boxes, centers }.subtree(&mut order, 0, 0) };
        let corners = order.iter().map(|&t| corners[t as usize]).collect();
        Self { nodes, corners, order }
    }

    /// The first triangle along the ray with `t_min < t < t_max`; of hits at the same `t`, the lowest index.
    #[must_use]
    pub fn closest(&self, origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.walk(origin, direction, t_min, t_max, |ray, corners, triangle, limit| {
            // Equal distances are let through, to be decided by index rather than by the order of the walk.
            if let Some((t, weights)) = ray.triangle(corners, t_min, limit.next_up()) {
                let wins = best.is_none_or(|b| t < b.t || (t == b.t && triangle < b.triangle));
                if wins && t < t_max {
                    best = Some(Hit { t, triangle, weights });
                    return Some(t);
                }
            }
            Some(limit)
        });
        best
    }

    /// Whether any triangle lies on the ray with `t_min < t < t_max` that `accept` takes, by its number and corners.
    pub fn any(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
        accept: impl Fn(u32, &[DVec3; 3]) -> bool,
    ) -> bool {
        let mut found = false;
        self.walk(origin, direction, t_min, t_max, |ray, corners, triangle, limit| {
            found = ray.triangle(corners, t_min, t_max).is_some() && accept(triangle, corners);
            (!found).then_some(limit)
        });
        found
    }

    /// Number and corners of a triangle that [`Bvh::in_shaft`] found.
    pub(crate) fn found(&self, place: u32) -> (u32, &[DVec3; 3]) {
        (self.order[place as usize], &self.corners[place as usize])
    }

    /// Collects, into an empty list, all triangles that a segment from `apex` to a point of the parallelogram `hull` can
    /// meet, and some that none meets; false where they are more than `most`.
    pub(crate) fn in_shaft(&self, apex: DVec3, hull: &[DVec3; 4], most: usize, found: &mut Vec<u32>) -> bool {
        let shaft = Shaft::new(apex, hull);
        let mut stack = [0_u32; STACK];
        let mut depth = self.nodes.len().min(1);
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index as usize];
            if shaft.misses_box(&node.bounds) {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.first;
                stack[depth + 1] = index + 1;
                depth += 2;
                continue;
            }
            let leaf = node.first..node.first + node.count;
            found.extend(leaf.filter(|place| !shaft.misses_points(&self.corners[*place as usize])));
            if found.len() > most {
                return false;
            }
        }
        true
    }

    /// Boxes and triangles that a ray through the scene is tested with, on average over all lines that meet it.
    #[must_use]
    pub fn expected_tests(&self) -> f64 {
        let whole = self.nodes.first().map_or(0.0, |root| half_area(&root.bounds));
        if whole == 0.0 {
            return self.corners.len() as f64;
        }
        self.nodes.iter().map(|node| half_area(&node.bounds) / whole * f64::from(node.count + 1)).sum()
    }

    /// Whether any triangle comes nearer to `center` than `distance`.
    #[must_use]
    pub fn any_within(&self, center: DVec3, distance: f64) -> bool {
        let mut stack = vec![0_u32; self.nodes.len().min(1)];
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            let outside = (node.bounds.min - center).max(center - node.bounds.max).max(DVec3::ZERO);
            if outside.max_element() >= distance {
                continue;
            }
            let leaf = node.first as usize..(node.first + node.count) as usize;
            if node.count == 0 {
                stack.extend([index + 1, node.first]);
            } else if self.corners[leaf].iter().any(|c| distance_to_triangle(center, *c) < distance) {
                return true;
            }
        }
        false
    }

    /// Visits leaves near to far; `visit` returns the new upper limit, or `None` to stop.
    fn walk(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
        mut visit: impl FnMut(&Ray, &[DVec3; 3], u32, f64) -> Option<f64>,
    ) {
        if self.nodes.is_empty() {
            return;
        }
        let ray = Ray::new(origin, direction);
        let mut limit = t_max;
        let mut stack = [0_u32; STACK];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index as usize];
            if !ray.meets(&node.bounds, t_min, limit) {
                continue;
            }
            if node.count == 0 {
                let [near, far] = node.children(index, direction[node.axis as usize] >= 0.0);
                stack[depth] = far;
                stack[depth + 1] = near;
                depth += 2;
                continue;
            }
            for k in node.first as usize..(node.first + node.count) as usize {
                match visit(&ray, &self.corners[k], self.order[k], limit) {
                    Some(new_limit) => limit = new_limit,
                    None => return,
                }
            }
        }
    }
}

/// Triangles from which on both halves of a subtree are built at once.
const PARALLEL_TRIANGLES: usize = 4096;

/// Boxes of all triangles, and their middles.
struct Build {
    boxes: Vec<Bounds>,
    centers: Vec<DVec3>,
}

impl Build {
    /// The subtree of the triangles in `order`, which stand from `first` on in the order of leaves: nodes are numbered from its root.
    fn subtree(&self, order: &mut [u32], first: u32, depth: usize) -> Vec<Node> {
        if order.len() < PARALLEL_TRIANGLES {
            let mut nodes = Vec::new();
            self.node(&mut nodes, order, first, depth);
            return nodes;
        }
        let (mut root, split) = self.root(order, first, depth);
        let Some((axis, middle)) = split else { return vec![root] };
        let (left, right) = order.split_at_mut(middle);
        let (left, right) = rayon::join(
            || self.subtree(left, first, depth + 1),
            || self.subtree(right, first + middle as u32, depth + 1),
        );
        let right_child = 1 + left.len() as u32;
        root.become_inner(axis, right_child);
        let mut nodes = Vec::with_capacity(1 + left.len() + right.len());
        nodes.push(root);
        nodes.extend(left.into_iter().map(|node| node.moved(1)));
        nodes.extend(right.into_iter().map(|node| node.moved(right_child)));
        nodes
    }

    /// Appends a subtree to `nodes`, whose numbers it goes on with.
    fn node(&self, nodes: &mut Vec<Node>, order: &mut [u32], first: u32, depth: usize) {
        let index = nodes.len();
        let (root, split) = self.root(order, first, depth);
        nodes.push(root);
        let Some((axis, middle)) = split else { return };
        let (left, right) = order.split_at_mut(middle);
        self.node(nodes, left, first, depth + 1);
        let right_child = nodes.len() as u32;
        nodes[index].become_inner(axis, right_child);
        self.node(nodes, right, first + middle as u32, depth + 1);
    }

    /// The root of a subtree, as if it were a leaf; and if it is to be none, its axis and how many triangles go to the left.
    fn root(&self, order: &mut [u32], first: u32, depth: usize) -> (Node, Option<(usize, usize)>) {
        let bounds = order.iter().fold(Bounds::EMPTY, |b, &t| b.union(self.boxes[t as usize]));
        let root = Node { bounds, first, count: order.len() as u32, axis: 0 };
        // The walk keeps one entry a level and two for the children.
        let is_leaf = order.len() <= LEAF_TRIANGLES || depth + 3 >= STACK;
        (root, if is_leaf { None } else { self.split(order, depth) })
    }

    /// Sorts `order` into two parts; axis and size of the first part.
    fn split(&self, order: &mut [u32], depth: usize) -> Option<(usize, usize)> {
        let mut centers = Bounds::EMPTY;
        order.iter().for_each(|&t| centers.add(self.centers[t as usize]));
        let size = centers.size();
        let widest = (0..3).fold(0, |best, k| if size[k] > size[best] { k } else { best });
        if size[widest] <= 0.0 || !size[widest].is_finite() {
            return None;
        }
        // Deep trees finish with equal halves, which bounds the depth.
        if depth < STACK / 2
            && let Some((axis, at)) = self.best_bin(order, &centers)
        {
            let bin = |t: u32| bin_of(self.centers[t as usize][axis], &centers, axis);
            let mut parts: Vec<u32> = order.iter().copied().filter(|&t| bin(t) <= at).collect();
            let middle = parts.len();
            parts.extend(order.iter().copied().filter(|&t| bin(t) > at));
            if middle > 0 && middle < order.len() {
                order.copy_from_slice(&parts);
                return Some((axis, middle));
            }
        }
        let key = |t: u32| self.centers[t as usize][widest];
        order.sort_unstable_by(|&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
        Some((widest, order.len() / 2))
    }

    fn best_bin(&self, order: &[u32], centers: &Bounds) -> Option<(usize, usize)> {
        let mut best: Option<(f64, usize, usize)> = None;
        for axis in (0..3).filter(|&k| centers.size()[k] > 0.0) {
            let mut bins = [(Bounds::EMPTY, 0_usize); BINS];
            for &t in order {
                let bin = &mut bins[bin_of(self.centers[t as usize][axis], centers, axis)];
                *bin = (bin.0.union(self.boxes[t as usize]), bin.1 + 1);
            }
            let mut right = [0.0; BINS];
            let mut sum = (Bounds::EMPTY, 0);
            for k in (1..BINS).rev() {
                sum = (sum.0.union(bins[k].0), sum.1 + bins[k].1);
                right[k] = half_area(&sum.0) * sum.1 as f64;
            }
            let mut sum = (Bounds::EMPTY, 0);
            for k in 0..BINS - 1 {
                sum = (sum.0.union(bins[k].0), sum.1 + bins[k].1);
                let cost = half_area(&sum.0) * sum.1 as f64 + right[k + 1];
                if sum.1 > 0 && sum.1 < order.len() && best.is_none_or(|b| cost < b.0) {
                    best = Some((cost, axis, k));
                }
            }
        }
        best.map(|(_, axis, k)| (axis, k))
    }
}

fn bin_of(x: f64, centers: &Bounds, axis: usize) -> usize {
    let part = (x - centers.min[axis]) / centers.size()[axis];
    ((part * BINS as f64) as usize).min(BINS - 1)
}

fn half_area(bounds: &Bounds) -> f64 {
    let s = bounds.size();
    if s.x < 0.0 { 0.0 } else { s.x * s.y + s.y * s.z + s.z * s.x }
}
