//! What stands in a saloon, in metres. Everything stands on y = 0 about the origin; bodies touch but do not pass
//! through one another, as the soft shadow map counts overlap twice.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::random::Random;
use super::shapes::{Builder, turn_y, turn_z};

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Calls `make` at `count` places around the circle of `radius`, turned to face outward.
fn around(b: &mut Builder, count: u32, radius: f64, y: f64, mut make: impl FnMut(&mut Builder)) {
    for k in 0..count {
        let turn = turn_y(TAU * f64::from(k) / f64::from(count));
        b.object("", turn, turn * at(radius, 0.0, 0.0) + DVec3::Y * y, &mut make);
    }
}

/// Round table, 0.76 high, with a turned column and four feet.
pub fn round_table(b: &mut Builder, radius: f64) {
    for k in 0..4 {
        let out = turn_y(TAU * (0.125 + f64::from(k) * 0.25)) * DVec3::X;
        b.post(out * 0.42 + DVec3::Y * 0.03, out * 0.07 + DVec3::Y * 0.2, 0.05, 0.06);
    }
    b.lathe(12, &[(0.05, 0.06), (0.065, 0.2), (0.045, 0.3), (0.07, 0.45), (0.05, 0.6), (0.1, 0.72)]);
    b.lathe(28, &[(radius - 0.03, 0.72), (radius, 0.735), (radius, 0.755), (radius - 0.012, 0.76)]);
}

/// Chair whose back is towards +z: seat at 0.45, back up to 0.95 with turned spindles.
pub fn chair(b: &mut Builder) {
    for (x, z) in [(-0.18, -0.17), (0.18, -0.17), (-0.18, 0.17), (0.18, 0.17)] {
        b.post(at(x * 1.1, 0.0, z * 1.1), at(x, 0.42, z), 0.03, 0.04);
    }
    for z in [-0.176, 0.176] {
        b.post(at(-0.165, 0.2, z), at(0.165, 0.2, z), 0.022, 0.022);
    }
    b.cuboid(at(-0.22, 0.42, -0.21), at(0.22, 0.455, 0.21));
    for x in [-0.185, 0.185] {
        b.post(at(x, 0.455, 0.185), at(x, 0.88, 0.23), 0.034, 0.03);
    }
    for x in [-0.09, 0.0, 0.09] {
        b.post(at(x, 0.455, 0.185), at(x, 0.86, 0.228), 0.016, 0.014);
    }
    b.cuboid(at(-0.22, 0.88, 0.212), at(0.22, 0.97, 0.245));
}

/// Bar stool, 0.75 high.
pub fn stool(b: &mut Builder) {
    for k in 0..4 {
        let out = turn_y(TAU * (0.125 + f64::from(k) * 0.25)) * DVec3::X;
        b.post(out * 0.21, out * 0.12 + DVec3::Y * 0.7, 0.03, 0.035);
    }
    b.object("", DMat3::IDENTITY, at(0.0, 0.28, 0.0), |b| b.torus(12, 4, 0.135, 0.012));
    b.lathe(14, &[(0.165, 0.7), (0.175, 0.72), (0.16, 0.755)]);
}

/// Low round stool, 0.52 high.
pub fn piano_stool(b: &mut Builder) {
    b.lathe(12, &[(0.16, 0.0), (0.05, 0.05), (0.04, 0.42), (0.17, 0.46), (0.17, 0.52)]);
}

/// Barrel, 0.9 high, hoops as steps of its outline.
pub fn barrel(b: &mut Builder) {
    let lower = [(0.25, 0.0), (0.28, 0.12), (0.3, 0.26), (0.312, 0.265), (0.325, 0.45)];
    let upper = lower.iter().rev().skip(1).map(|&(r, y)| (r, 0.9 - y));
    b.lathe(14, &lower.iter().copied().chain(upper).collect::<Vec<_>>());
}

/// Bottle about 0.3 high.
pub fn bottle(b: &mut Builder, random: &mut Random) {
    let (r, h) = (random.range(0.032, 0.045), random.range(0.24, 0.32));
    let neck = random.range(0.011, 0.014);
    b.lathe(8, &[(r, 0.0), (r, h * 0.55), (neck, h * 0.74), (neck, h)]);
}

/// Mug with a handle.
pub fn mug(b: &mut Builder) {
    b.lathe(8, &[(0.044, 0.0), (0.04, 0.1), (0.044, 0.12)]);
    b.post(at(0.047, 0.09, 0.0), at(0.08, 0.03, 0.0), 0.014, 0.012);
}

/// Turned baluster of height `h`.
pub fn baluster(b: &mut Builder, h: f64) {
    b.lathe(6, &[(0.03, 0.0), (0.016, h * 0.15), (0.034, h * 0.38), (0.015, h * 0.72), (0.026, h)]);
}

/// Railing from `from` to `to` (its foot line), 0.85 high, balusters every 0.24.
pub fn railing(b: &mut Builder, from: DVec3, to: DVec3) {
    const HEIGHT: f64 = 0.8;
    let count = ((to - from).length() / 0.24).round().max(2.0);
    for k in 1..count as u32 {
        let foot = from + (to - from) * (f64::from(k) / count);
        b.object("", DMat3::IDENTITY, foot, |b| baluster(b, HEIGHT - 0.006));
    }
    let inset = (to - from).normalize() * 0.06;
    let up = DVec3::Y * (HEIGHT + 0.025);
    b.post(from + inset + up, to - inset + up, 0.06, 0.06);
    for end in [from, to] {
        b.block(end + at(0.0, 0.45, 0.0), at(0.1, 0.9, 0.1));
        b.ball(end + at(0.0, 0.955, 0.0), 0.055, 10);
    }
}

/// Wagon wheel with candles, hanging from a rod; the wheel's plane is y = 0, the rod goes up to `rod`.
pub fn wheel_chandelier(b: &mut Builder, rod: f64) {
    b.torus(28, 6, 0.75, 0.035);
    b.lathe(12, &[(0.06, -0.08), (0.1, -0.05), (0.1, 0.05), (0.06, 0.08)]);
    around(b, 8, 0.0, 0.0, |b| b.post(at(0.105, 0.0, 0.0), at(0.712, 0.0, 0.0), 0.035, 0.03));
    around(b, 8, 0.75, 0.036, |b| {
        b.lathe(10, &[(0.025, 0.0), (0.05, 0.012), (0.055, 0.022)]);
        b.object("", DMat3::IDENTITY, at(0.0, 0.022, 0.0), |b| {
            b.lathe(8, &[(0.018, 0.0), (0.018, 0.13), (0.004, 0.15)])
        });
    });
    b.post(at(0.0, 0.082, 0.0), at(0.0, rod, 0.0), 0.02, 0.02);
}

/// Upright piano, 1.4 wide, keys towards +z, with its keys.
pub fn piano(b: &mut Builder) {
    b.cuboid(at(-0.7, 0.0, -0.3), at(0.7, 1.25, -0.02));
    b.cuboid(at(-0.74, 1.25, -0.33), at(0.74, 1.28, 0.01));
    b.cuboid(at(-0.7, 0.6, -0.02), at(0.7, 0.66, 0.26));
    for k in 0..28 {
        let x = -0.63 + f64::from(k) * 0.046;
        b.cuboid(at(x, 0.66, 0.05), at(x + 0.04, 0.682, 0.25));
        if ![2, 6].contains(&(k % 7)) && k < 27 {
            b.cuboid(at(x + 0.032, 0.682, 0.05), at(x + 0.054, 0.698, 0.16));
        }
    }
    for x in [-0.69, 0.65] {
        b.cuboid(at(x, 0.66, 0.0), at(x + 0.04, 0.76, 0.26));
        b.object("", DMat3::IDENTITY, at(x + 0.02, 0.0, 0.21), |b| baluster(b, 0.6));
    }
    b.object("", DMat3::IDENTITY, at(0.0, 0.8, 0.0), |b| b.cuboid(at(-0.25, 0.0, 0.0), at(0.25, 0.28, 0.02)));
}

/// Swing door of two leaves in the plane z = 0, 1.4 wide, slats tilted, one leaf pushed open by `open` radians.
pub fn swing_door(b: &mut Builder, open: f64) {
    for (side, angle) in [(-1.0, 0.12), (1.0, open)] {
        b.object("", turn_y(side * angle), at(side * 0.69, 0.35, 0.0), |b| {
            // Local x runs from the hinge to the middle.
            let span =
                |x0: f64, x1: f64| (f64::min(-side * x0, -side * x1), f64::max(-side * x0, -side * x1));
            let mut bar = |x0: f64, x1: f64, y0: f64, y1: f64| {
                let (low, high) = span(x0, x1);
                b.cuboid(at(low, y0, -0.02), at(high, y1, 0.02));
            };
            bar(0.0, 0.07, 0.0, 1.25);
            bar(0.58, 0.65, 0.0, 1.15);
            bar(0.075, 0.575, 0.0, 0.1);
            bar(0.075, 0.575, 1.05, 1.15);
            for k in 0..9 {
                let y = 0.15 + f64::from(k) * 0.1;
                let (low, high) = span(0.08, 0.57);
                b.hexahedron(core::array::from_fn(|c| {
                    let x = if c & 1 == 1 { high } else { low };
                    let thick = if c >> 1 & 1 == 1 { 0.012 } else { 0.0 };
                    let z = if c >> 2 & 1 == 1 { 0.018 } else { -0.018 };
                    at(x, y + thick - z * 1.8, z)
                }));
            }
        });
    }
}

/// Shelf of bottles, `width` along x, back at z = 0, boards at the given heights.
pub fn bottle_shelf(b: &mut Builder, width: f64, heights: &[f64], random: &mut Random) {
    let (low, top) = (-width * 0.5, heights[heights.len() - 1] + 0.42);
    for x in [low, -0.02, -low - 0.04] {
        b.cuboid(at(x, 0.0, 0.0), at(x + 0.04, top, 0.26));
    }
    b.cuboid(at(low - 0.05, top, 0.0), at(-low + 0.05, top + 0.05, 0.3));
    for &y in heights {
        for (from, to) in [(low + 0.04, -0.02), (0.02, -low - 0.04)] {
            b.cuboid(at(from, y - 0.03, 0.0), at(to, y, 0.25));
            let count = ((to - from) / 0.24) as u32;
            for k in 0..count {
                let x = from + (to - from) * (f64::from(k) + random.range(0.42, 0.58)) / f64::from(count);
                let z = random.range(0.1, 0.16);
                b.object("", turn_y(random.range(0.0, TAU)), at(x, y, z), |b| bottle(b, random));
            }
        }
    }
}

/// Bar of `width` along x: body, top, panels and a foot rail towards +z. Top at 1.1.
pub fn bar_counter(b: &mut Builder, width: f64) {
    let half = width * 0.5;
    b.cuboid(at(-half, 0.0, -0.25), at(half, 1.03, 0.2));
    b.cuboid(at(-half - 0.08, 1.03, -0.32), at(half + 0.08, 1.1, 0.34));
    let panels = (width / 0.55) as u32;
    let step = width / f64::from(panels);
    for k in 0..panels {
        let x = -half + f64::from(k) * step;
        b.cuboid(at(x + 0.06, 0.18, 0.2), at(x + step - 0.06, 0.92, 0.225));
    }
    for k in 0..=4 {
        let x = (-half + 0.1) + (width - 0.2) * f64::from(k) / 4.0;
        b.post(at(x, 0.17, 0.2), at(x, 0.17, 0.355), 0.025, 0.025);
    }
    b.object("", turn_z(TAU * 0.25), at(half, 0.17, 0.38), |b| b.lathe(10, &[(0.022, 0.0), (0.022, width)]));
}
