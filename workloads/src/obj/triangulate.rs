//! Polygons to triangles.

use glam::{DVec2, DVec3};

/// Splits a polygon into exactly `n - 2` triangles, given as corner numbers, wound as the polygon is.
///
/// Ears are clipped in the polygon's own plane (its Newell normal), so concave polygons are covered and nothing
/// beside them is. Polygons that are no such thing (self-crossing, repeated or collinear corners) still give
/// `n - 2`, some of them without area. Convex polygons give a fan from the first corner. Cost: O(n), O(n²) concave.
pub fn triangulate(corners: &[DVec3]) -> Vec<[usize; 3]> {
    let n = corners.len();
    let fan = || (1..n.saturating_sub(1)).map(|k| [0, k, k + 1]).collect();
    if n <= 3 {
        return fan();
    }
    let points = flatten(corners);
    if is_convex(&points) { fan() } else { clip_ears(&points) }
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
    let mut left: Vec<usize> = (0..points.len()).collect();
    let mut triangles = Vec::with_capacity(points.len() - 2);
    let mut start = 0;
    while left.len() > 3 {
        let n = left.len();
        let tip = (0..n)
            .map(|k| (start + k) % n)
            .find(|&k| is_ear(points, &left, k))
            // No ear: not a simple polygon. A corner without area does no harm; else any will do.
            .or_else(|| (0..n).find(|&k| area_at(points, &left, k) == 0.0))
            .unwrap_or(0);
        triangles.push(triangle_at(&left, tip));
        left.remove(tip);
        // Go on beyond the new edge, which spreads the triangles instead of making one long fan.
        start = tip % left.len();
    }
    triangles.push([left[0], left[1], left[2]]);
    triangles
}

fn triangle_at(left: &[usize], k: usize) -> [usize; 3] {
    let n = left.len();
    [left[(k + n - 1) % n], left[k], left[(k + 1) % n]]
}

fn area_at(points: &[DVec2], left: &[usize], k: usize) -> f64 {
    let [a, b, c] = triangle_at(left, k).map(|i| points[i]);
    area(a, b, c)
}

/// A corner to the left, with no other corner inside its triangle or on its new edge.
fn is_ear(points: &[DVec2], left: &[usize], k: usize) -> bool {
    if area_at(points, left, k) <= 0.0 {
        return false;
    }
    let tip = triangle_at(left, k);
    let [a, b, c] = tip.map(|i| points[i]);
    left.iter().filter(|i| !tip.contains(i)).map(|&i| points[i]).all(|p| {
        // Corners at the same place as one of the three touch the ear, they do not block it.
        let same = p == a || p == b || p == c;
        same || area(a, b, p) < 0.0 || area(b, c, p) < 0.0 || area(c, a, p) < 0.0
    })
}
