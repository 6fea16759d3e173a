//! One silhouette edge against the unit light disc.

use glam::DVec2;

/// `a * d - b * c`, right to the last bits however much cancels (Kahan).
fn product_difference(a: f64, d: f64, b: f64, c: f64) -> f64 {
    let bc = b * c;
    let error = libm::fma(-b, c, bc);
    libm::fma(a, d, -bc) + error
}

/// Area of the unit disc beyond the edge `u0 u1`, inside the wedge that the edge subtends at the center.
///
/// As a part of the disc's area, in [0, 1/2]; unsigned. Finite for all finite input. [algorithms, §2.3]
#[must_use]
pub fn area_beyond(u0: DVec2, u1: DVec2) -> f64 {
    let e = u1 - u0;
    let length = libm::hypot(e.x, e.y);
    if length == 0.0 {
        return 0.0;
    }
    let d = product_difference(u0.x, u1.y, u0.y, u1.x).abs() / length;
    if d >= 1.0 {
        return 0.0;
    }
    // Positions along the edge from the foot of the perpendicular; from the nearer end point, which cancels less.
    let half_chord = ((1.0 - d) * (1.0 + d)).sqrt();
    let (t0, t1) = if u0.length_squared() <= u1.length_squared() {
        let t0 = u0.dot(e) / length;
        (t0, t0 + length)
    } else {
        let t1 = u1.dot(e) / length;
        (t1 - length, t1)
    };
    let a = t0.clamp(-half_chord, half_chord);
    let b = t1.clamp(-half_chord, half_chord);
    if a >= b {
        return 0.0;
    }
    let theta = libm::atan2(d * (b - a), d * d + a * b);
    (theta - d * (b - a)) / core::f64::consts::TAU
}

/// Part of the square of all places from -1 to 1 beyond the edge `u0 u1`, inside the wedge that the edge subtends at its middle.
///
/// In [0, 1/2]; unsigned. What of the edge lies in the square is cut out: its wedge's part of the square, less the triangle
/// between it and the middle.
#[must_use]
pub fn square_beyond(u0: DVec2, u1: DVec2) -> f64 {
    let e = u1 - u0;
    let c = product_difference(u0.x, u1.y, u0.y, u1.x);
    let (mut enter, mut leave) = (0.0, 1.0);
    let (mut a, mut b) = (u0, u1);
    for axis in 0..2 {
        let (from, along, across) = (u0[axis], e[axis], e[1 - axis]);
        if along == 0.0 {
            if from.abs() >= 1.0 {
                return 0.0;
            }
            continue;
        }
        // Where the line meets a side, from its distance to the middle: its ends may be far out.
        let side = 1.0_f64.copysign(along);
        let on = |side: f64| {
            let turned = if axis == 0 { -c } else { c };
            let other = ((side * across + turned) / along).clamp(-1.0, 1.0);
            if axis == 0 { DVec2::new(side, other) } else { DVec2::new(other, side) }
        };
        let (first, last) = ((-side - from) / along, (side - from) / along);
        if first > enter {
            (enter, a) = (first, on(-side));
        }
        if last < leave {
            (leave, b) = (last, on(side));
        }
    }
    if enter >= leave {
        return 0.0;
    }
    let (Some(from), Some(to)) = (around_square(a), around_square(b)) else { return 0.0 };
    let around = (to - from).abs();
    let wedge = around.min(4.0 - around);
    0.25 * (wedge - 0.5 * product_difference(a.x, b.y, a.y, b.x).abs()).max(0.0)
}

/// Area of the square of all places from -1 to 1 between the x axis and the direction of `u`, counterclockwise, in
/// [-1/2, 7/2]; none has the middle.
fn around_square(u: DVec2) -> Option<f64> {
    match u {
        DVec2::ZERO => None,
        u if u.y.abs() <= u.x.abs() => Some(if u.x > 0.0 { 0.0 } else { 2.0 } + 0.5 * (u.y / u.x)),
        u => Some(if u.y > 0.0 { 1.0 } else { 3.0 } - 0.5 * (u.x / u.y)),
    }
}

/// Part of the line from (-1, 0) to (1, 0) beyond the edge `u0 u1`, seen from its middle, in [0, 1/2]: 0 where the edge does
/// not cross it.
#[must_use]
pub fn line_beyond(u0: DVec2, u1: DVec2) -> f64 {
    if (u0.y >= 0.0) == (u1.y >= 0.0) {
        return 0.0;
    }
    let place = product_difference(u0.x, u1.y, u0.y, u1.x) / (u1.y - u0.y);
    0.5 * (1.0 - place.abs()).max(0.0)
}
