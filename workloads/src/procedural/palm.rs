//! A few palms on a beach.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::random::Random;
use super::shapes::{Builder, turn_y, turn_z};
use super::swept::curve;
use crate::mesh::Mesh;

/// Triangles of the paper's scene, at detail 1; grass fills up what the rest leaves.
const TRIANGLES: usize = 44_000;
/// Half of the beach's side.
const HALF: f64 = 14.0;

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Height of the sand.
fn sand(x: f64, z: f64) -> f64 {
    0.22 * libm::sin(0.35 * x + 0.6) * libm::cos(0.3 * z)
        + 0.1 * libm::sin(0.8 * z + 0.25 * x)
        + 0.03 * libm::sin(1.9 * x - 1.1 * z)
}

/// Four palms, rocks, agaves and grass on dunes of 28 x 28. `seed` decides where leaves and stones are.
pub fn palm(seed: u32, detail: u32) -> Mesh {
    let mut b = Builder::new(detail);
    let mut random = Random::new(seed);
    let still = DMat3::IDENTITY;
    b.object("beach", still, DVec3::ZERO, |b| b.ground(([-HALF; 2], [HALF; 2]), [48, 48], -1.2, sand));

    for (x, z, height, lean, towards) in
        [(0.6, 0.3, 6.6, 1.5, 0.4), (-2.9, -2.2, 7.4, 1.7, 2.1), (3.9, -4.0, 5.6, 1.2, -0.9)]
    {
        b.object("palm", turn_y(towards), at(x, sand(x, z), z), |b| tree(b, height, lean, &mut random));
    }
    for (x, z, size) in
        [(-4.6, 3.2, 1.1), (-5.5, 2.7, 0.7), (5.0, 1.2, 0.9), (5.7, 1.9, 0.55), (1.6, -6.6, 1.5)]
            .into_iter()
            .chain([
                (-1.9, 3.9, 0.35),
                (-2.4, 4.3, 0.22),
                (2.9, 4.4, 0.3),
                (0.3, -6.1, 0.8),
                (-7.6, -3.1, 1.0),
            ])
    {
        let extent = at(size * random.range(1.1, 1.5), size * 0.8, size * random.range(0.9, 1.3));
        b.object("rock", turn_y(random.range(0.0, TAU)), at(x, sand(x, z) + size * 0.22, z), |b| {
            b.pebble(DVec3::ZERO, extent, 18, 0.15, &mut random);
        });
    }
    for (x, z, size) in
        [(2.7, 2.3, 0.9), (-2.2, 1.5, 0.7), (-6.3, 0.3, 1.0), (4.6, -1.2, 0.8), (-0.6, -4.3, 1.0)]
    {
        b.object("agave", turn_y(random.range(0.0, TAU)), at(x, sand(x, z) + 0.02, z), |b| {
            agave(b, size, &mut random);
        });
    }
    for (x, z) in [(1.5, 1.7), (1.05, 2.1), (-2.6, -0.9)] {
        b.object("coconut", turn_y(random.range(0.0, TAU)), at(x, sand(x, z) + 0.1, z), |b| {
            b.ball(DVec3::ZERO, 0.12, 12);
        });
    }
    while b.triangles() + 200 <= TRIANGLES {
        let (angle, out) = (random.range(0.0, TAU), HALF * 0.85 * random.range(0.02, 1.0).sqrt());
        let (x, z) = (out * libm::cos(angle), out * libm::sin(angle));
        b.object("grass", DMat3::IDENTITY, at(x, sand(x, z) - 0.01, z), |b| tuft(b, &mut random));
    }
    b.finish()
}

/// A palm that leans towards +x, its foot at the origin.
fn tree(b: &mut Builder, height: f64, lean: f64, random: &mut Random) {
    let trunk = |t: f64| {
        at(lean * t * t, height * t * (1.0 - 0.06 * t) - 0.15 * (1.0 - t), 0.12 * libm::sin(t * 4.0))
    };
    // Scars of old fronds: rings a little wider than the stem between them.
    let rings = 44;
    b.tube(&curve(rings, trunk), 12, |t| {
        let scar = if ((t * f64::from(rings)).round() as u32).is_multiple_of(2) { 1.0 } else { 0.86 };
        (0.17 + 0.14 * libm::exp(-t * 14.0) - 0.05 * t) * scar
    });
    let top = trunk(1.0);
    for k in 0..5 {
        let out = turn_y(TAU * f64::from(k) / 5.0) * at(0.21, -0.2 - 0.05 * f64::from(k % 2), 0.0);
        b.ball(top + out, 0.11, 10);
    }
    let fronds = 12;
    for k in 0..fronds {
        let turn = turn_y(
            TAU * f64::from(k) / f64::from(fronds) * 3.0 + random.range(-0.12, 0.12) + f64::from(k) * 0.14,
        );
        // The inner fronds rise, the outer ones hang.
        let rise = 1.15 - 1.5 * f64::from(k) / f64::from(fronds) + random.range(-0.1, 0.1);
        let length = random.range(2.5, 3.1);
        b.object("", turn, top, |b| frond(b, length, rise, random));
    }
}

/// A feathered leaf from the origin towards +x: a midrib that starts at the slope `rise` and bends down, leaflets on
/// both sides.
fn frond(b: &mut Builder, length: f64, rise: f64, random: &mut Random) {
    let rib = |t: f64| {
        let out = length * t * (1.0 - 0.16 * t);
        at(0.1 + out, length * (rise * 0.62 * t - 0.62 * t * t), 0.0)
    };
    b.tube(&curve(10, rib), 5, |t| 0.032 - 0.027 * t);
    let pairs = 18;
    for k in 0..pairs {
        let t = 0.14 + 0.85 * (f64::from(k) + 0.5) / f64::from(pairs);
        let along = (rib(t + 0.01) - rib(t)).normalize();
        let long = length * (0.1 + 0.24 * libm::sin(TAU * 0.5 * (0.12 + 0.8 * t)));
        for side in [-1.0, 1.0] {
            let across = at(0.0, 0.0, side);
            let up = along.cross(DVec3::Z) * -1.0;
            let sweep = 0.55 + 0.5 * t + random.range(-0.06, 0.06);
            let droop = random.range(0.3, 0.45);
            let foot = rib(t) + across * (0.036 - 0.027 * t);
            let path = curve(3, |s| {
                foot + (across + along * sweep).normalize() * (long * s) - up.abs() * (long * droop * s * s)
            });
            b.leaf(&path, 4, 0.24, |s| 0.075 * libm::sin(TAU * 0.5 * (0.18 + 0.78 * s)));
        }
    }
}

/// A rosette of thick pointed leaves.
fn agave(b: &mut Builder, size: f64, random: &mut Random) {
    for k in 0..14 {
        let turn = turn_y(f64::from(k) * 2.4 + random.range(-0.1, 0.1));
        let rise = 0.25 + 1.1 * f64::from(k) / 14.0;
        b.object("", turn * turn_z(rise), DVec3::ZERO, |b| {
            let path = curve(6, |t| at(size * (0.09 + 0.85 * t), size * (0.16 * t * t - 0.1 * t), 0.0));
            b.leaf(&path, 6, 0.25, |t| size * 0.17 * libm::sin(TAU * 0.5 * (0.25 + 0.7 * t)));
        });
    }
}

/// A few blades of grass.
fn tuft(b: &mut Builder, random: &mut Random) {
    for k in 0..5 {
        let turn = turn_y(TAU * f64::from(k) / 5.0 + random.range(-0.4, 0.4));
        let (tall, bend) = (random.range(0.2, 0.5), random.range(0.1, 0.3));
        b.object("", turn, DVec3::ZERO, |b| {
            let path = curve(5, |t| at(0.02 + bend * t * t, tall * t * (1.0 - 0.25 * t), 0.0));
            b.leaf(&path, 4, 0.2, |t| 0.028 * (1.0 - t) + 0.006);
        });
    }
}
