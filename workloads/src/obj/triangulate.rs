//! Polygons to triangles.

use glam::{DVec2, DVec3};

/// No ear was to be found this often: what is left of the polygon crosses itself so much that no order of clipping is
/// better than another.
const EARLESS_ROUNDS_MAX: usize = 64;

/// Splits a polygon into exactly `n - 2` triangles, given as corner numbers, wound as the polygon is.
///
/// Ears are clipped in the polygon's own plane (its Newell normal), so concave polygons are covered and nothing
/// beside them is; corners that touch one another and spikes of no width do no harm. Polygons that cross themselves
/// still give `n - 2`, and repeated or straight corners may give some without area. Convex polygons give a fan.
///
/// The polygon is walked from its least corner to the lesser neighbor of that: a copy of it that is written from
/// another corner, or backwards, gives the same triangles, and so is known as a copy. Cost: O(n), O(n²) concave.
pub fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    let n = corners.len();
    if n <= 3 {
        return (2..n).map(|_| [0, 1, 2]).collect();
    }
    let less = |a: usize, b: usize| corners[a].to_array() < corners[b].to_array();
    let least = (1..n).fold(0, |least, k| if less(k, least) { k } else { least });
    let backwards = less((least + n - 1) % n, (least + 1) % n);
    let step = if backwards { n - 1 } else { 1 };
    let order: Vec<usize> = (0..n).map(|k| (least + k * step) % n).collect();

    let walked: Vec<DVec3> = order.iter().map(|&k| corners[k]).collect();
    let points = flatten(&walked);
    let triangles = if is_convex(&points) { fan(&(0..n).collect::<Vec<_>>()) } else { clip_ears(&points) };
    let as_given = |[a, b, c]: [usize; 3]| if backwards { [a, c, b] } else { [a, b, c] };
    triangles.into_iter().map(|t| as_given(t.map(|k| order[k]))).collect()
}

fn fan(corners: &[usize]) -> Vec<[usize; 3]> {
    corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]).collect()
}

/// Corners in the plane of the polygon, counter-clockwise, largest coordinate about 1.
fn flatten(corners: &[DVec3]) -> Vec<DVec2> {
    let scale = corners.iter().map(|&p| (p - corners[0]).abs().max_element()).fold(0.0, f64::max);
    if scale == 0.0 {
        return vec![DVec2::ZERO; corners.len()];
    }
    let local: Vec<DVec3> = corners.iter().map(|&p| (p - corners[0]) / scale).collect();
    let next = local.iter().cycle().skip(1);
    let normal: DVec3 = local.iter().zip(next).map(|(a, b)| a.cross(*b)).sum();
    // Dropping the largest axis of the normal is an affine picture of the polygon, free of rounding.
    let axis = (0..3).fold(0, |best, k| if normal[k].abs() > normal[best].abs() { k } else { best });
    let (x, y) =
        if normal[axis] < 0.0 { ((axis + 2) % 3, (axis + 1) % 3) } else { ((axis + 1) % 3, (axis + 2) % 3) };
    local.iter().map(|p| DVec2::new(p[x], p[y])).collect()
}

/// Twice the signed area of `a b c`.
fn area(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// All turns to the left, all fan triangles counter-clockwise.
fn is_convex(points: &[DVec2]) -> bool {
    let n = points.len();
    (0..n).all(|k| area(points[k], points[(k + 1) % n], points[(k + 2) % n]) > 0.0)
        && (1..n - 1).all(|k| area(points[0], points[k], points[k + 1]) > 0.0)
}

fn clip_ears(points: &[DVec2]) -> Vec<[usize; 3]> {
    let mut ring = Ring { points, left: (0..points.len()).collect(), triangles: Vec::new() };
    ring.clip_all_spikes();
    // Corners that are known to be no ear. They may become one when what is in their way is gone.
    let mut blocked = vec![false; points.len()];
    let (mut k, mut tried, mut clipped, mut earless_rounds) = (0, 0, false, 0);
    while ring.left.len() > 3 && earless_rounds < EARLESS_ROUNDS_MAX {
        k %= ring.left.len();
        if blocked[ring.left[k]] || !ring.is_ear(k) {
            blocked[ring.left[k]] = true;
            (k, tried) = (k + 1, tried + 1);
            if tried < ring.left.len() {
                continue;
            }
            blocked.fill(false);
            if core::mem::replace(&mut clipped, false) {
                tried = 0;
                continue;
            }
            // No ear at all: not a simple polygon. A corner without area does no harm; else any will do.
            earless_rounds += 1;
            k = (0..ring.left.len()).find(|&k| ring.area_at(k) == 0.0).unwrap_or(0);
        }
        // Going on beyond the new edge spreads the triangles instead of making one long fan.
        k = ring.clip(k);
        (tried, clipped) = (0, true);
        for neighbor in [ring.before(k), k] {
            blocked[ring.left[neighbor]] = false;
        }
    }
    ring.triangles.extend(fan(&ring.left));
    ring.triangles
}

/// What is left of a polygon, in order.
struct Ring<'a> {
    points: &'a [DVec2],
    left: Vec<usize>,
    triangles: Vec<[usize; 3]>,
}

impl Ring<'_> {
    fn before(&self, k: usize) -> usize {
        (k + self.left.len() - 1) % self.left.len()
    }

    fn after(&self, k: usize) -> usize {
        (k + 1) % self.left.len()
    }

    fn point(&self, k: usize) -> DVec2 {
        self.points[self.left[k]]
    }

    /// The corner at `k` between its neighbors.
    fn corners_at(&self, k: usize) -> [DVec2; 3] {
        [self.point(self.before(k)), self.point(k), self.point(self.after(k))]
    }

    fn area_at(&self, k: usize) -> f64 {
        let [a, b, c] = self.corners_at(k);
        area(a, b, c)
    }

    /// Cuts the corner at `k` off, and spikes that this leaves; where the corner after it now is.
    fn clip(&mut self, k: usize) -> usize {
        let mut next = self.cut(k);
        while self.left.len() > 3
            && let Some(spike) = [self.before(next), next].into_iter().find(|&k| self.is_spike(k))
        {
            next = self.cut(spike);
        }
        next
    }

    fn cut(&mut self, k: usize) -> usize {
        self.triangles.push([self.left[self.before(k)], self.left[k], self.left[self.after(k)]]);
        self.left.remove(k);
        k % self.left.len()
    }

    fn clip_all_spikes(&mut self) {
        let (mut k, mut tried) = (0, 0);
        while self.left.len() > 3 && tried < self.left.len() {
            if self.is_spike(k) {
                // Of the corners that were tried, only the one before has a new neighbor.
                let next = self.cut(k);
                (k, tried) = (self.before(next), tried.saturating_sub(1));
            } else {
                (k, tried) = (self.after(k), tried + 1);
            }
        }
    }

    /// A corner where the outline goes back the way it came, or does not go on: it bounds nothing.
    fn is_spike(&self, k: usize) -> bool {
        let [a, b, c] = self.corners_at(k);
        area(a, b, c) == 0.0 && (b - a).dot(c - b) <= 0.0
    }

    /// A corner to the left, with nothing of the outline inside its triangle and no corner on its new edge.
    fn is_ear(&self, k: usize) -> bool {
        let [a, b, c] = self.corners_at(k);
        if area(a, b, c) <= 0.0 {
            return false;
        }
        let tip = [self.before(k), k, self.after(k)];
        (0..self.left.len()).filter(|other| !tip.contains(other)).all(|other| {
            let p = self.point(other);
            let sides = [area(a, b, p), area(b, c, p), area(c, a, p)];
            if sides.iter().any(|&side| side < 0.0) {
                return true;
            }
            // On its rim, a corner is in the way if the outline goes on into the ear from there.
            let goes_in = |q: DVec2| {
                let of_q = [area(a, b, q), area(b, c, q), area(c, a, q)];
                sides.iter().zip(of_q).all(|(&of_p, of_q)| of_p > 0.0 || of_q > 0.0)
            };
            let on_new_edge = sides[2] == 0.0 && p != a && p != c;
            !(on_new_edge
                || goes_in(self.point(self.before(other)))
                || goes_in(self.point(self.after(other))))
        })
    }
}
