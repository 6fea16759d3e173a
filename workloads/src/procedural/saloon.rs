//! A bar room with a balcony, lit by one lamp under a wagon wheel.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::furnish::{bar_top, barrels, doorway, frame, in_parts, shell, tables_with_chairs};
use super::furniture::{
    bar_counter, barrel, bottle_shelf, piano, piano_stool, railing, stool, wheel_chandelier,
};
use super::random::Random;
use super::shapes::{Builder, turn_y, turn_z};
use crate::mesh::Mesh;

/// Half of the room's length, along x.
const HALF_X: f64 = 5.0;
/// Half of the room's width, along z.
const HALF_Z: f64 = 4.0;
/// Height of the ceiling.
const HEIGHT: f64 = 4.0;
/// Top of the balcony's floor.
const BALCONY: f64 = 2.45;
/// Front edge of the balcony, which runs along the wall at -z.
const BALCONY_Z: f64 = -2.55;

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// The room: 10 x 4 x 8, floor at 0. `seed` decides how chairs, bottles and barrels stand.
pub fn saloon(seed: u32, detail: u32) -> Mesh {
    let mut b = Builder::new(detail);
    let mut random = Random::new(seed);
    let still = DMat3::IDENTITY;
    b.object("shell", still, DVec3::ZERO, |b| shell(b, HALF_X, HALF_Z, HEIGHT));
    b.object("floor", still, DVec3::ZERO, floor);
    b.object("wainscot", still, DVec3::ZERO, wainscot);
    b.object("beams", still, DVec3::ZERO, beams);
    b.object("balcony", still, DVec3::ZERO, balcony);
    b.object("stairs", still, DVec3::ZERO, stairs);
    b.object("chandelier", still, at(0.4, 3.05, 0.3), |b| wheel_chandelier(b, HEIGHT - 0.26 - 3.05));

    b.object("bar", still, at(-0.6, 0.0, -2.25), |b| bar_counter(b, 4.6));
    b.object("bar top", still, at(-0.6, 1.1, -2.25), |b| bar_top(b, &mut random));
    for x in [-2.3, -1.4, -0.45, 0.5, 1.3] {
        let turn = turn_y(random.range(0.0, TAU));
        let z = random.range(-1.62, -1.5);
        b.object("stool", turn, at(x, 0.0, z), stool);
    }
    b.object("shelf", still, at(-0.6, 0.0, -3.9), |b| {
        bottle_shelf(b, 4.4, &[0.75, 1.15, 1.55], &mut random);
    });

    let tables = [(-1.9, 0.75, 0.55, 4), (2.2, 0.1, 0.6, 5), (0.2, 2.3, 0.5, 3), (3.4, 2.4, 0.55, 4)];
    tables_with_chairs(&mut b, &tables, 0.12, [0.22, 0.4], &mut random);

    b.object("piano", turn_y(TAU * 0.25), at(-4.6, 0.0, -0.3), piano);
    b.object("piano stool", still, at(-3.95, 0.0, -0.3), piano_stool);
    b.object("door", turn_y(TAU * 0.25), at(HALF_X - 0.06, 0.0, 2.6), doorway);
    barrels(
        &mut b,
        &[(-4.5, 0.0, -3.5), (-3.8, 0.0, -3.55), (-4.15, 0.9, -3.5), (-4.55, 0.0, -2.8)],
        &mut random,
    );
    b.object("barrel", turn_z(TAU * 0.25), at(-3.2, 0.33, 3.2), barrel);
    b.finish()
}

/// Planks along x with narrow joints.
fn floor(b: &mut Builder) {
    const PLANKS: u32 = 26;
    let step = 2.0 * HALF_Z / f64::from(PLANKS);
    for k in 0..PLANKS {
        let z = -HALF_Z + step * f64::from(k);
        // Joints between the lengths of a row, shifted from row to row.
        let joint = -1.7 + 1.7 * f64::from(k % 3);
        for (from, to) in [(-HALF_X, joint - 0.004), (joint + 0.004, HALF_X)] {
            b.cuboid(at(from, -0.06, z + 0.004), at(to, 0.0, z + step - 0.004));
        }
    }
}

/// Boards along the walls up to 1 m, and the rail above them; left out where the door, the bar and the stairs are.
fn wainscot(b: &mut Builder) {
    let boards = |b: &mut Builder, length: f64| {
        for (from, to) in in_parts(length, 0.4) {
            b.cuboid(at(from + 0.01, 0.0, 0.0), at(to - 0.01, 1.0, 0.02));
        }
        b.cuboid(at(0.0, 1.0, 0.0), at(length, 1.07, 0.045));
    };
    b.object("", turn_y(TAU * 0.25), at(-HALF_X, 0.0, HALF_Z - 0.1), |b| boards(b, 3.4));
    b.object("", turn_y(TAU * -0.25), at(HALF_X, 0.0, -0.6), |b| boards(b, 2.2));
    b.object("", turn_y(TAU * 0.5), at(HALF_X - 0.1, 0.0, HALF_Z), |b| boards(b, 2.0 * HALF_X - 0.2));
    // Pictures between rail and ceiling.
    for (z, width) in [(3.0, 0.5), (1.6, 0.8)] {
        b.object("", turn_y(TAU * 0.25), at(-HALF_X, 1.5, z), |b| frame(b, width, width * 1.2));
    }
    b.object("", turn_y(TAU * -0.25), at(HALF_X, 1.55, 0.1), |b| frame(b, 1.0, 0.75));
}

/// Two girders along x under the ceiling, joists across between them and the walls.
fn beams(b: &mut Builder) {
    for z in [BALCONY_Z + 0.1, 0.3, 2.6] {
        b.cuboid(at(-HALF_X, HEIGHT - 0.26, z - 0.11), at(HALF_X, HEIGHT, z + 0.11));
    }
    for k in 0..9 {
        let x = -4.4 + 1.1 * f64::from(k);
        for (from, to) in
            [(-HALF_Z, BALCONY_Z - 0.01), (BALCONY_Z + 0.21, 0.19), (0.41, 2.49), (2.71, HALF_Z)]
        {
            b.cuboid(at(x - 0.05, HEIGHT - 0.14, from), at(x + 0.05, HEIGHT, to));
        }
    }
}

/// Gallery above the bar: joists, boards, posts that carry it, and a railing.
fn balcony(b: &mut Builder) {
    let posts = [-3.4, -0.6, 2.2];
    for k in 0..12 {
        let z = -HALF_Z + (BALCONY_Z + HALF_Z) * f64::from(k) / 12.0;
        b.cuboid(
            at(-HALF_X, BALCONY - 0.05, z + 0.004),
            at(3.2, BALCONY, z + (BALCONY_Z + HALF_Z) / 12.0 - 0.004),
        );
    }
    b.cuboid(at(-HALF_X, BALCONY - 0.25, BALCONY_Z - 0.14), at(3.2, BALCONY - 0.05, BALCONY_Z));
    for k in 0..11 {
        let x = -4.6 + 0.75 * f64::from(k);
        b.cuboid(at(x - 0.04, BALCONY - 0.2, -HALF_Z), at(x + 0.04, BALCONY - 0.05, BALCONY_Z - 0.15));
    }
    for x in posts {
        b.cuboid(at(x - 0.07, 0.0, BALCONY_Z - 0.14), at(x + 0.07, BALCONY - 0.25, BALCONY_Z));
        for side in [-1.0, 1.0] {
            let foot = at(x + side * 0.09, BALCONY - 0.75, BALCONY_Z - 0.07);
            b.post(foot, at(x + side * 0.45, BALCONY - 0.27, BALCONY_Z - 0.07), 0.07, 0.07);
        }
    }
    let rail_z = BALCONY_Z - 0.1;
    let ends = [-HALF_X + 0.06, posts[0], posts[1], posts[2], 3.1];
    for pair in ends.windows(2) {
        let gap = 0.06;
        railing(b, at(pair[0] + gap, BALCONY, rail_z), at(pair[1] - gap, BALCONY, rail_z));
    }
}

/// Flight along the wall at +x, up to the balcony.
fn stairs(b: &mut Builder) {
    const STEPS: u32 = 12;
    let rise = BALCONY / f64::from(STEPS);
    let (start, run) = (-0.75, 0.25);
    for k in 0..STEPS {
        let (y, z) = (rise * f64::from(k + 1), start - run * f64::from(k));
        b.cuboid(at(3.66, y - 0.045, z - run - 0.02), at(HALF_X - 0.05, y, z));
        // Balusters stand on the treads; the rail rises over them.
        b.object("", DMat3::IDENTITY, at(3.75, y, z - run * 0.5), |b| super::furniture::baluster(b, 0.8));
    }
    let (low, high) =
        (at(3.75, rise + 0.83, start - run * 0.5), at(3.75, BALCONY + 0.83, start - run * 11.5));
    b.post(low + (low - high) * 0.03, high, 0.06, 0.06);
    b.block(at(3.75, 0.58, start + 0.1), at(0.12, 1.16, 0.12));
    b.ball(at(3.75, 1.22, start + 0.1), 0.065, 12);
    // Strings, under the treads.
    for x in [3.72, HALF_X - 0.12] {
        let (from, to) = (at(x, 0.0, start - 0.28), at(x, BALCONY - 0.29, start - run * 11.0 - 0.21));
        b.post(from, to, 0.08, 0.08);
    }
}
