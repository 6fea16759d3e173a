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
