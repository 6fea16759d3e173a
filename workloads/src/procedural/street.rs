//! A street of old houses under the sun.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::facade::{House, house};
use super::furniture::{chair, round_table};
use super::random::Random;
use super::shapes::{Builder, turn_y};
use super::swept::curve;
use crate::mesh::Mesh;

/// Half of the distance between the fronts.
const HALF: f64 = 6.0;
/// Half of the roadway.
const ROAD: f64 = 3.4;
/// Top of the pavement.
const KERB: f64 = 0.14;
/// Near and far end of the street.
const ENDS: [f64; 2] = [10.0, -30.0];

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Two rows of houses along z, a house across the far end, lamps, wires, trees, a café. `seed` decides how shutters
/// and leaves stand.
pub fn street(seed: u32, detail: u32) -> Mesh {
    let mut b = Builder::new(detail);
    let mut random = Random::new(seed);
    let still = DMat3::IDENTITY;
    b.object("road", still, DVec3::ZERO, road);
    b.object("pavement", still, DVec3::ZERO, pavement);

    // Width, storeys, windows, balconies, shutters, awning.
    let left = [(8.4, 2, 3, 1, 1, 1), (7.6, 3, 3, 2, 1, 0), (9.2, 2, 4, 1, 0, 1), (7.8, 3, 3, 4, 0, 0)];
    let right = [(9.0, 2, 4, 0, 0, 0), (8.0, 3, 3, 0, 0, 1), (7.4, 2, 3, 0, 0, 0), (8.4, 2, 3, 0, 0, 1)];
    for (side, row) in [(-1.0, left), (1.0, right)] {
        let mut z = ENDS[0] - 7.0;
        for (width, storeys, windows, balconies, shutters, awning) in row {
            let front =
                House { width, storeys, windows, balconies, shutters: shutters == 1, awning: awning == 1 };
            // On the right the front runs the other way.
            let start = if side < 0.0 { z } else { z - width };
            b.object("house", turn_y(-side * TAU * 0.25), at(side * HALF, KERB, start), |b| {
                house(b, &front, &mut random);
            });
            z -= width + 0.02;
        }
    }
    let far = House { width: 12.0, storeys: 3, windows: 5, balconies: 2, shutters: false, awning: false };
    b.object("house", still, at(-6.0, 0.0, ENDS[1] + 0.5), |b| house(b, &far, &mut random));

    for k in 0..3 {
        let z = 2.0 - 11.0 * f64::from(k);
        for side in [-1.0, 1.0] {
            let place = at(side * (ROAD + 0.45), KERB, z - if side > 0.0 { 5.5 } else { 0.0 });
            b.object("lamp", still, place, lamp);
            for step in 1..4 {
                let foot = place + at(0.0, 0.0, -2.75 * f64::from(step));
                b.object("bollard", still, foot, bollard);
            }
        }
        wires(&mut b, z - 4.0);
    }
    for (x, z) in [(-4.7, -6.2), (-4.6, -18.4)] {
        b.object("tree", turn_y(z), at(x, KERB, z), |b| tree(b, &mut random));
    }
    for (x, z) in [(-4.7, -0.6), (-4.75, -12.0)] {
        b.object("table", still, at(x, KERB, z), |b| round_table(b, 0.42));
        for k in 0..3 {
            let turn = turn_y(TAU * (f64::from(k) / 3.0) + random.range(-0.3, 0.3));
            b.object("chair", turn, at(x, KERB, z) + turn * at(0.0, 0.0, 0.62), chair);
        }
    }
    for k in 0..4 {
        for side in [-1.0, 1.0] {
            let z = 1.4 - 7.1 * f64::from(k) - if side > 0.0 { 2.2 } else { 0.0 };
            b.object("shrub", still, at(side * (HALF - 0.5), KERB, z), |b| shrub(b, &mut random));
        }
    }
    b.finish()
}

/// Worn paving, higher in the middle.
fn road(b: &mut Builder) {
    b.ground(([-ROAD, ENDS[1]], [ROAD, ENDS[0]]), [56, 222], -0.3, |x, z| {
        let stones = libm::sin(x * TAU / 0.68) * libm::sin(z * TAU / 1.0);
        0.05 - 0.1 * (x / ROAD) * (x / ROAD) + 0.006 * stones
    });
}

/// Slabs on both sides behind a kerb of stones.
fn pavement(b: &mut Builder) {
    for side in [-1.0, 1.0] {
        let span = |x0: f64, x1: f64| (f64::min(side * x0, side * x1), f64::max(side * x0, side * x1));
        for k in 0..20 {
            let z = ENDS[1] + 2.0 * f64::from(k);
            let (x0, x1) = span(ROAD + 0.002, ROAD + 0.22);
            b.cuboid(at(x0, -0.3, z + 0.004), at(x1, KERB, z + 1.996));
        }
        let (x0, x1) = span(ROAD + 0.226, HALF + 0.3);
        b.ground(([x0, ENDS[1]], [x1, ENDS[0]]), [12, 160], -0.3, |x, z| {
            KERB - 0.004 - 0.003 * libm::sin(2.0 * x) * libm::sin(1.1 * z)
        });
    }
}

/// Cast-iron lamp post with two arms and globes.
fn lamp(b: &mut Builder) {
    b.lathe(
        18,
        &[
            (0.19, 0.0),
            (0.19, 0.1),
            (0.15, 0.16),
            (0.12, 0.5),
            (0.15, 0.62),
            (0.09, 0.72),
            (0.065, 1.0),
            (0.055, 2.2),
            (0.08, 2.3),
            (0.055, 2.4),
            (0.045, 3.6),
            (0.075, 3.7),
            (0.04, 3.8),
            (0.03, 4.0),
            (0.006, 4.15),
        ],
    );
    for side in [-1.0, 1.0] {
        let arm = curve(14, |t| {
            at(
                side * (0.045 + 0.5 * libm::sin(t * 1.6)),
                3.35 - 0.16 * libm::sin(t * TAU * 0.5) + 0.1 * t,
                0.0,
            )
        });
        b.tube(&arm, 8, |_| 0.02);
        b.object("", DMat3::IDENTITY, at(side * 0.54, 3.47, 0.0), |b| {
            b.lathe(16, &[(0.03, 0.0), (0.1, 0.04), (0.11, 0.06)]);
        });
        b.ball(at(side * 0.54, 3.7, 0.0), 0.17, 24);
    }
}

fn bollard(b: &mut Builder) {
    b.lathe(
        16,
        &[
            (0.12, 0.0),
            (0.12, 0.05),
            (0.09, 0.1),
            (0.075, 0.7),
            (0.1, 0.74),
            (0.1, 0.78),
            (0.07, 0.84),
            (0.02, 0.88),
        ],
    );
}

/// Wires across the street that sag, with flags on one of them and a lamp on the other.
fn wires(b: &mut Builder, z: f64) {
    for (k, shift) in [(0, 0.0), (1, 1.7)] {
        let (height, sag) = (7.6 + 0.5 * f64::from(k), 0.6);
        let line = |t: f64| at(HALF * (2.0 * t - 1.0), height - sag * 4.0 * t * (1.0 - t), z + shift);
        b.object("wire", DMat3::IDENTITY, DVec3::ZERO, |b| b.tube(&curve(28, line), 6, |_| 0.012));
        if k == 0 {
            b.object("flags", DMat3::IDENTITY, DVec3::ZERO, |b| {
                for flag in 1..16 {
                    let top = line(f64::from(flag) / 16.0) - at(0.0, 0.02, 0.0);
                    b.hexahedron(core::array::from_fn(|c| {
                        let side = if c & 1 == 1 { 1.0 } else { -1.0 };
                        let (y, half) = if c >> 1 & 1 == 1 { (0.0, 0.19) } else { (-0.42, 0.012) };
                        top + at(side * half, y, if c >> 2 & 1 == 1 { 0.006 } else { -0.006 })
                    }));
                }
            });
        } else {
            b.object("street light", DMat3::IDENTITY, line(0.5) - at(0.0, 0.55, 0.0), |b| {
                b.lathe(24, &[(0.02, -0.12), (0.09, -0.1), (0.13, -0.02), (0.135, 0.0)]);
                b.lathe(
                    24,
                    &[(0.26, 0.001), (0.25, 0.03), (0.12, 0.1), (0.05, 0.2), (0.012, 0.24), (0.01, 0.53)],
                );
            });
        }
    }
}

/// A young tree in an iron ring.
fn tree(b: &mut Builder, random: &mut Random) {
    b.torus(24, 6, 0.5, 0.03);
    let trunk = |t: f64| at(0.12 * libm::sin(3.0 * t), 3.4 * t, 0.08 * libm::sin(5.0 * t));
    b.tube(&curve(12, trunk), 12, |t| 0.1 - 0.05 * t);
    for k in 0..14 {
        let t = 0.55 + 0.45 * f64::from(k) / 14.0;
        let turn = turn_y(2.4 * f64::from(k));
        let long = random.range(1.0, 1.4) * (1.45 - 0.8 * t);
        b.object("", turn, trunk(t), |b| {
            let branch =
                |s: f64| at(0.06 + long * s, long * (0.75 * s - 0.15 * s * s), 0.06 * libm::sin(5.0 * s));
            b.tube(&curve(6, branch), 6, |s| 0.026 - 0.02 * s);
            for leaf in 0..13 {
                let s = 0.25 + 0.75 * f64::from(leaf) / 12.0;
                let outward = turn_y(random.range(0.0, TAU)) * at(1.0, random.range(-0.6, 0.7), 0.0);
                let foot = branch(s) + outward * 0.03;
                let size = random.range(0.17, 0.26);
                let path = curve(3, |u| foot + outward * (size * u) - at(0.0, 0.25 * size * u * u, 0.0));
                b.leaf(&path, 6, 0.2, |u| 0.6 * size * libm::sin(TAU * 0.5 * (0.12 + 0.76 * u)));
            }
        });
    }
}

/// Clipped box in a pot.
fn shrub(b: &mut Builder, random: &mut Random) {
    b.lathe(
        28,
        &[(0.2, 0.0), (0.22, 0.02), (0.28, 0.44), (0.31, 0.45), (0.31, 0.52), (0.27, 0.52), (0.25, 0.47)],
    );
    b.pebble(at(0.0, 0.92, 0.0), at(0.8, 0.88, 0.8), 36, 0.03, random);
}
