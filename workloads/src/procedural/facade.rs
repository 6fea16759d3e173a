//! Fronts of houses, in metres. A front stands in the plane z = 0 from x = 0 on, looking towards +z.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::random::Random;
use super::shapes::{Builder, turn_z};
use super::swept::curve;

/// Height of the ground floor.
pub const GROUND: f64 = 3.5;
/// Height of the storeys above.
pub const STOREY: f64 = 3.0;
/// How far windows lie behind the front.
const REVEAL: f64 = 0.22;
/// Width and height of a window, and of its sill above the floor.
const WINDOW: [f64; 2] = [1.05, 1.7];
const SILL: f64 = 0.75;

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// What is on a house.
#[derive(Debug, Clone, Copy)]
pub struct House {
    pub width: f64,
    /// Storeys above the ground floor.
    pub storeys: u32,
    /// Windows side by side.
    pub windows: u32,
    /// Bit k: storey k + 1 has a long balcony.
    pub balconies: u32,
    pub shutters: bool,
    pub awning: bool,
}

impl House {
    pub fn height(&self) -> f64 {
        GROUND + STOREY * f64::from(self.storeys)
    }
}

/// The house: core, front with openings, roof.
pub fn house(b: &mut Builder, house: &House, random: &mut Random) {
    let (w, h) = (house.width, house.height());
    // The core lies behind the openings as their panes.
    b.cuboid(at(0.0, 0.0, -7.0), at(w, h, -REVEAL));
    shop(b, house);
    let bay = w / f64::from(house.windows);
    for storey in 0..house.storeys {
        let y = GROUND + STOREY * f64::from(storey);
        let has_balcony = house.balconies >> storey & 1 == 1;
        let foot = if has_balcony { 0.08 } else { SILL };
        let head = SILL + WINDOW[1];
        b.cuboid(at(0.0, y, -REVEAL), at(w, y + foot, 0.0));
        b.cuboid(at(0.0, y + head, -REVEAL), at(w, y + STOREY - 0.002, 0.0));
        for k in 0..=house.windows {
            let middle = bay * f64::from(k);
            let half = (bay - WINDOW[0]) * 0.5;
            b.cuboid(
                at((middle - half).max(0.0), y + foot, -REVEAL),
                at((middle + half).min(w), y + head, 0.0),
            );
        }
        // String course between storeys.
        b.cuboid(at(0.0, y - 0.09, 0.0), at(w, y + 0.05, 0.07));
        for k in 0..house.windows {
            let x = bay * (f64::from(k) + 0.5);
            b.object("", DMat3::IDENTITY, at(x, y + foot, 0.0), |b| window(b, head - foot, !has_balcony));
            if house.shutters && !has_balcony {
                shutters(b, at(x, y + SILL, 0.0), random.range(0.0, 1.0) < 0.75);
            }
        }
        if has_balcony {
            b.object("", DMat3::IDENTITY, at(w * 0.5, y, 0.0), |b| balcony(b, w - 1.0));
        }
    }
    b.object("", DMat3::IDENTITY, at(0.0, h, 0.0), |b| roof(b, w));
}

/// Window or door with its frame, glazing bars, hood and, if there is one, a sill; in the middle of its foot.
fn window(b: &mut Builder, height: f64, has_sill: bool) {
    let half = WINDOW[0] * 0.5;
    let (z0, z1) = (-REVEAL, -REVEAL + 0.07);
    b.cuboid(at(-half, 0.0, z0), at(-half + 0.07, height, z1));
    b.cuboid(at(half - 0.07, 0.0, z0), at(half, height, z1));
    b.cuboid(at(-half + 0.07, 0.0, z0), at(half - 0.07, 0.08, z1));
    b.cuboid(at(-half + 0.07, height - 0.07, z0), at(half - 0.07, height, z1));
    b.cuboid(at(-0.03, 0.08, z0), at(0.03, height - 0.07, z1 - 0.01));
    for (x0, x1) in [(-half + 0.07, -0.03), (0.03, half - 0.07)] {
        b.cuboid(at(x0, height * 0.66, z0), at(x1, height * 0.66 + 0.04, z1 - 0.02));
    }
    b.cuboid(at(-half - 0.14, height, 0.0), at(half + 0.14, height + 0.14, 0.1));
    if has_sill {
        b.cuboid(at(-half - 0.1, -0.09, 0.0), at(half + 0.1, 0.0, 0.14));
    }
}

/// A pair of shutters with slats beside a window.
fn shutters(b: &mut Builder, foot: DVec3, folded: bool) {
    let (leaf, height) = (WINDOW[0] * 0.42, WINDOW[1]);
    for side in [-1.0, 1.0] {
        let hinge = foot + at(side * WINDOW[0] * 0.5, 0.0, 0.02);
        let turn = if folded { 0.06 } else { 0.9 };
        b.object("", super::shapes::turn_y(-side * turn), hinge, |b| {
            let mut bar = |x0: f64, x1: f64, y0: f64, y1: f64, z1: f64| {
                let (a, c) = (side * (x0 + 0.02), side * (x1 + 0.02));
                b.cuboid(at(a.min(c), y0, 0.0), at(a.max(c), y1, z1));
            };
            bar(0.0, 0.06, 0.0, height, 0.04);
            bar(leaf - 0.06, leaf, 0.0, height, 0.04);
            for y in [0.0, height * 0.5 - 0.04, height - 0.08] {
                bar(0.06, leaf - 0.06, y, y + 0.08, 0.035);
            }
            for k in 0..4 {
                let y = 0.13 + f64::from(k) * 0.165;
                bar(0.06, leaf - 0.06, y, y + 0.1, 0.025);
                bar(0.06, leaf - 0.06, y + height * 0.5 - 0.04, y + height * 0.5 + 0.06, 0.025);
            }
        });
    }
}

/// A slab on consoles with a railing of turned balusters; `width` wide, about the middle.
fn balcony(b: &mut Builder, width: f64) {
    const DEPTH: f64 = 0.95;
    let half = width * 0.5;
    b.cuboid(at(-half, -0.1, 0.07), at(half, 0.06, DEPTH));
    let consoles = (width / 1.3).round().max(1.0);
    for k in 0..=consoles as u32 {
        let x = -half + 0.12 + (width - 0.24) * f64::from(k) / consoles;
        b.hexahedron(core::array::from_fn(|c| {
            let side = if c & 1 == 1 { 0.08 } else { -0.08 };
            let (y, out) = if c >> 1 & 1 == 1 { (-0.1, 0.75) } else { (-0.55, 0.18) };
            at(x + side, y, if c >> 2 & 1 == 1 { out } else { 0.071 })
        }));
    }
    let rail = |b: &mut Builder, from: DVec3, to: DVec3| {
        let count = ((to - from).length() / 0.24).round();
        for k in 1..count as u32 {
            b.object("", DMat3::IDENTITY, from + (to - from) * (f64::from(k) / count), baluster);
        }
        let inset = (to - from).normalize() * 0.05;
        b.post(from + inset + at(0.0, 0.97, 0.0), to - inset + at(0.0, 0.97, 0.0), 0.09, 0.09);
    };
    let (left, right) = (at(-half + 0.08, 0.06, DEPTH - 0.09), at(half - 0.08, 0.06, DEPTH - 0.09));
    rail(b, left, right);
    for corner in [left, right] {
        rail(b, at(corner.x, 0.06, 0.04), corner);
        b.block(corner + at(0.0, 0.5, 0.0), at(0.1, 1.0, 0.1));
        b.ball(corner + at(0.0, 1.062, 0.0), 0.06, 12);
    }
}

/// A turned baluster, 0.92 high.
fn baluster(b: &mut Builder) {
    b.lathe(10, &[(0.04, 0.0), (0.022, 0.1), (0.046, 0.3), (0.03, 0.52), (0.02, 0.8), (0.036, 0.92)]);
}

/// Ground floor: plinth, piers, shop windows, a door with steps, a sign, maybe an awning.
fn shop(b: &mut Builder, house: &House) {
    let (w, head) = (house.width, 2.75);
    let bay = w / f64::from(house.windows);
    b.cuboid(at(0.0, head, -REVEAL), at(w, GROUND - 0.002, 0.0));
    for k in 0..=house.windows {
        let x = bay * f64::from(k);
        let half = 0.26;
        b.cuboid(at((x - half).max(0.0), 0.0, -REVEAL), at((x + half).min(w), head, 0.0));
        let (x0, x1) = ((x - half - 0.03).max(0.02), (x + half + 0.03).min(w - 0.02));
        b.cuboid(at(x0, 0.0, 0.0), at(x1, 0.5, 0.05));
        b.cuboid(at(x0, head - 0.2, 0.0), at(x1, head, 0.06));
    }
    for k in 0..house.windows {
        let (x0, x1) = (bay * f64::from(k) + 0.26, bay * f64::from(k + 1) - 0.26);
        let z = -REVEAL + 0.06;
        if k == house.windows / 2 {
            // Door with two panels, a light above it, and a step.
            let middle = (x0 + x1) * 0.5;
            b.cuboid(at(x0, 0.14, -REVEAL), at(x1, 2.2, z - 0.02));
            for (a, c) in [(x0 + 0.12, middle - 0.06), (middle + 0.06, x1 - 0.12)] {
                b.cuboid(at(a, 0.3, z - 0.02), at(c, 0.95, z + 0.01));
                b.cuboid(at(a, 1.1, z - 0.02), at(c, 2.05, z + 0.01));
            }
            b.cuboid(at(x0, 2.2, -REVEAL), at(x1, 2.3, z + 0.03));
            b.cuboid(at(x0 + 0.02, 0.0, -REVEAL), at(x1 - 0.02, 0.14, 0.3));
        } else {
            b.cuboid(at(x0, 0.0, -REVEAL), at(x1, 0.55, -0.04));
            for part in [0.0, 0.5, 1.0] {
                let x = x0 + (x1 - x0 - 0.06) * part;
                b.cuboid(at(x, 0.55, -REVEAL), at(x + 0.06, head, z));
            }
            b.cuboid(at(x0 - 0.04, 0.55, -0.04), at(x1 + 0.04, 0.61, 0.09));
        }
    }
    // Sign board, and letters on it.
    b.cuboid(at(0.6, head + 0.13, 0.0), at(w - 0.6, head + 0.6, 0.06));
    let letters = (w / 0.62) as u32 - 3;
    for k in 0..letters {
        let x = 1.0 + (w - 2.4) * f64::from(k) / f64::from(letters - 1);
        b.cuboid(at(x, head + 0.22, 0.06), at(x + 0.08, head + 0.51, 0.09));
        if k % 3 != 1 {
            b.cuboid(at(x + 0.08, head + 0.43, 0.06), at(x + 0.26, head + 0.51, 0.09));
        }
        if k % 2 == 0 {
            b.cuboid(at(x + 0.08, head + 0.22, 0.06), at(x + 0.26, head + 0.3, 0.09));
        }
    }
    if house.awning {
        b.object("", DMat3::IDENTITY, at(w * 0.5, head - 0.02, 0.07), |b| awning(b, w - 1.2));
    } else {
        b.object("", DMat3::IDENTITY, at(w - 0.35, GROUND - 0.3, 0.0), hanging_sign);
    }
}

/// Cloth that hangs in folds from the front, on two rods.
fn awning(b: &mut Builder, width: f64) {
    let (n, folds) = (b.sides(72), 9.0);
    let strip = |row: u32| {
        let t = f64::from(row) / 8.0;
        let edge = |k: u32, below: f64| {
            let x = -width * 0.5 + width * f64::from(k) / f64::from(n);
            let wave = (0.01 + 0.035 * t) * libm::cos(TAU * folds * f64::from(k) / f64::from(n));
            at(x, -0.62 * t - 0.12 * t * t + wave - below, 0.02 + 1.25 * t)
        };
        (0..=n).map(|k| edge(k, 0.0)).chain((0..=n).rev().map(|k| edge(k, 0.025))).collect::<Vec<_>>()
    };
    let rows: Vec<_> = (0..=8).map(strip).collect();
    let middle = |row: &[DVec3]| row.iter().sum::<DVec3>() / row.len() as f64;
    b.loft(middle(&rows[0]), &rows, middle(&rows[8]));
    for side in [-0.5, 0.5] {
        let x = (width - 0.3) * side;
        b.tube(&[at(x, -0.75, 0.01), at(x, -0.83, 1.2)], 8, |_| 0.018);
    }
}

/// A round board on a bracket across the pavement.
fn hanging_sign(b: &mut Builder) {
    b.tube(&[at(0.0, 0.0, 0.0), at(0.0, 0.0, 0.95)], 10, |_| 0.018);
    b.tube(
        &curve(14, |t| at(0.0, -0.32 * (1.0 - t) * (1.0 - 0.3 * t) - 0.02, 0.02 + 0.6 * t * (0.6 + 0.4 * t))),
        8,
        |_| 0.011,
    );
    for z in [0.42, 0.78] {
        b.tube(&[at(0.0, -0.02, z), at(0.0, -0.13, z)], 6, |_| 0.008);
    }
    b.object("", turn_z(TAU * 0.25), at(0.0, -0.43, 0.6), |b| {
        b.lathe(28, &[(0.29, -0.03), (0.31, -0.022), (0.31, 0.022), (0.29, 0.03)]);
    });
}

/// Cornice on dentils, a tiled slope, a dormer and a chimney.
fn roof(b: &mut Builder, w: f64) {
    b.cuboid(at(0.0, -0.02, 0.0), at(w, 0.12, 0.12));
    let dentils = (w / 0.44) as u32;
    for k in 0..dentils {
        let x = w * (f64::from(k) + 0.5) / f64::from(dentils);
        b.cuboid(at(x - 0.07, 0.12, 0.0), at(x + 0.07, 0.32, 0.28));
    }
    b.cuboid(at(0.0, 0.32, -0.3), at(w, 0.48, 0.42));
    let slope = |x: f64, t: f64| at(x, 2.3 * t, -0.3 - 3.2 * t);
    // The slope's own body, then rolls of tiles that lie on it.
    b.hexahedron(core::array::from_fn(|c| {
        let x = if c & 1 == 1 { w } else { 0.0 };
        match (c >> 1 & 1, c >> 2 & 1) {
            (0, 0) => at(x, 0.001, -7.0),
            (0, _) => at(x, 0.001, -0.301),
            (_, 0) => at(x, 2.3, -7.0),
            _ => slope(x, 1.0),
        }
    }));
    let rolls = (w / 0.4) as u32;
    for k in 0..rolls {
        let x = w * (f64::from(k) + 0.5) / f64::from(rolls);
        let lift = at(0.0, 0.075, 0.05);
        b.tube(&[slope(x, 0.16) + lift, slope(x, 0.98) + lift], 10, |_| 0.075);
    }
    b.cuboid(at(w * 0.72, 2.31, -4.6), at(w * 0.72 + 0.9, 3.4, -4.0));
    for k in 0..2 {
        b.object("", DMat3::IDENTITY, at(w * 0.72 + 0.25 + 0.4 * f64::from(k), 3.401, -4.3), |b| {
            b.lathe(14, &[(0.13, 0.0), (0.11, 0.06), (0.09, 0.4), (0.12, 0.44)]);
        });
    }
}
