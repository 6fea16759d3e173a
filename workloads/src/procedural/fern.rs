//! A fern in a pot, before a wall.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::random::Random;
use super::shapes::{Builder, turn_y};
use super::swept::curve;
use crate::mesh::Mesh;

/// Triangles of the paper's scene, at detail 1; pebbles fill up what the rest leaves.
const TRIANGLES: usize = 212_000;
/// Fronds of the plant.
const FRONDS: u32 = 20;
/// Pairs of leaflets on a frond.
const PAIRS: u32 = 15;
/// Height of the pot's rim.
const RIM: f64 = 0.42;

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// A terrace of 4 x 3.4 with a wall behind it. `seed` decides how leaves and pebbles lie.
pub fn fern(seed: u32, detail: u32) -> Mesh {
    let mut b = Builder::new(detail);
    let mut random = Random::new(seed);
    let still = DMat3::IDENTITY;
    b.object("terrace", still, DVec3::ZERO, terrace);
    b.object("wall", still, at(0.0, 0.0, -0.6), wall);
    b.object("pot", still, at(0.0, 0.002, 0.0), pot);
    b.object("fern", still, at(0.0, RIM - 0.03, 0.0), |b| plant(b, &mut random));
    b.object("can", turn_y(0.9), at(0.95, 0.002, 0.42), watering_can);
    // Pebbles in a strip along the wall: row by row with gaps, so that none lies in another.
    let (step, mut k) = (0.2, 0);
    while b.triangles() + 528 <= TRIANGLES {
        let (column, row) = (k % 19, k / 19);
        let x = -1.86 + step * (f64::from(column) + random.range(-0.3, 0.3));
        let z = -0.54 + step * (f64::from(row) + random.range(0.0, 0.5));
        let size = at(random.range(0.05, 0.066), random.range(0.03, 0.045), random.range(0.05, 0.066));
        b.object("pebble", turn_y(random.range(0.0, TAU)), at(x, 0.5 * size.y + 0.001, z), |b| {
            b.pebble(DVec3::ZERO, size, 24, 0.07, &mut random);
        });
        k += 1;
    }
    b.finish()
}

/// Flagstones, worn hollow, on a bed.
fn terrace(b: &mut Builder) {
    b.cuboid(at(-2.1, -0.2, -1.4), at(2.1, -0.07, 2.6));
    let (step, gap) = (0.52, 0.012);
    for row in 0..6 {
        for column in 0..8 {
            let x = -2.08 + step * f64::from(column);
            let z = -0.58 + step * f64::from(row);
            b.cuboid(at(x + gap, -0.069, z + gap), at(x + step - gap, 0.0, z + step - gap));
        }
    }
}

/// Courses of stones with their faces in the plane z = 0, standing on the bed behind the terrace.
fn wall(b: &mut Builder) {
    let height = 0.24;
    for course in 0..7 {
        let y = -0.069 + height * f64::from(course);
        let shift = if course % 2 == 0 { 0.0 } else { -0.26 };
        for k in 0..9 {
            let x0 = (-2.1 + shift + 0.52 * f64::from(k)).max(-2.1) + 0.004;
            let x1 = (-2.1 + shift + 0.52 * f64::from(k + 1)).min(2.1) - 0.004;
            if x1 > x0 {
                b.cuboid(at(x0, y + 0.003, -0.3), at(x1, y + height - 0.003, 0.0));
            }
        }
    }
    b.cuboid(at(-2.14, -0.069 + 7.0 * height, -0.34), at(2.14, 1.7, 0.04));
}

/// A thrown pot with a rolled rim, filled with earth.
fn pot(b: &mut Builder) {
    let outside = [(0.15, 0.0), (0.165, 0.004), (0.175, 0.02), (0.2, 0.12), (0.222, 0.24), (0.235, 0.33)];
    let rim = [(0.236, 0.34), (0.26, 0.345), (0.266, 0.36), (0.266, 0.395), (0.262, 0.412), (0.25, RIM)];
    let earth = [(0.238, 0.416), (0.232, 0.4), (0.23, 0.375), (0.15, 0.39), (0.06, 0.4)];
    let profile: Vec<_> = outside.iter().chain(&rim).chain(&earth).copied().collect();
    b.lathe(72, &profile);
}

/// A tin can for water with spout and handle.
fn watering_can(b: &mut Builder) {
    b.lathe(
        48,
        &[
            (0.13, 0.0),
            (0.134, 0.012),
            (0.12, 0.02),
            (0.115, 0.2),
            (0.12, 0.21),
            (0.118, 0.225),
            (0.07, 0.235),
        ],
    );
    let spout = curve(10, |t| at(0.13 + 0.2 * t, 0.06 + 0.24 * t * (0.6 + 0.4 * t), 0.0));
    b.tube(&spout, 16, |t| 0.026 - 0.011 * t);
    let handle = curve(20, |t| {
        let angle = 0.15 + 2.6 * t;
        at(-0.04 - 0.11 * libm::sin(angle) - 0.03, 0.15 - 0.11 * libm::cos(angle), 0.0)
    });
    b.tube(&handle, 10, |_| 0.009);
}

/// Fronds in a spiral about the middle, the inner ones steeper.
fn plant(b: &mut Builder, random: &mut Random) {
    for k in 0..FRONDS {
        let part = f64::from(k) / f64::from(FRONDS);
        let turn = turn_y(f64::from(k) * 2.399_963 + random.range(-0.15, 0.15));
        let (length, steep) = (random.range(0.62, 0.78) * (0.8 + 0.3 * part), 2.3 - 1.6 * part);
        b.object("", turn, turn * at(0.03 + 0.09 * part, 0.0, 0.0), |b| frond(b, length, steep, random));
    }
}

/// A frond from the origin towards +x; `steep` is the slope of its foot. It bends over and hangs.
fn frond(b: &mut Builder, length: f64, steep: f64, random: &mut Random) {
    let sway = random.range(-0.12, 0.12);
    let rib = |t: f64| {
        let over = t * t;
        at(
            length * t * (0.5 + 0.38 * t / (0.5 + steep)),
            length * (steep * t - (0.42 + 0.55 * steep) * over),
            length * sway * over,
        )
    };
    b.tube(&curve(24, rib), 12, |t| 0.0052 - 0.004 * t);
    for k in 0..PAIRS {
        let t = 0.16 + 0.83 * (f64::from(k) + 0.5) / f64::from(PAIRS);
        let along = (rib(t + 0.01) - rib(t)).normalize();
        let across = DVec3::Y.cross(along).normalize();
        let up = along.cross(across);
        let long = length * 0.2 * libm::sin(TAU * 0.5 * (0.2 + 0.77 * t));
        for side in [-1.0, 1.0] {
            let (sweep, droop) = (0.28 + random.range(-0.08, 0.08), 0.3 + random.range(-0.1, 0.1));
            let foot = rib(t) + across * (side * (0.0058 - 0.004 * t)) + along * (0.008 * side);
            let path = curve(7, |s| {
                foot + (across * side + along * sweep * (0.6 + 0.8 * s)) * (long * s)
                    - up * (long * droop * s * s)
            });
            b.leaf(&path, 26, 0.14, |s| {
                0.26 * long.min(0.11)
                    * libm::sin(TAU * 0.5 * (0.2 + 0.72 * s))
                    * if s < 0.01 { 0.5 } else { 1.0 }
            });
        }
    }
}
