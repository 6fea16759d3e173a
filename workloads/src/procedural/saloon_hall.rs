//! The large saloon: a hall with a gallery on columns, a long bar and a chandelier over the lamp.

use core::f64::consts::TAU;

use glam::{DMat3, DVec3};

use super::furnish::{bar_top, barrels, doorway, frame, in_parts, shell, tables_with_chairs};
use super::furniture::{baluster, bar_counter, bottle_shelf, piano, piano_stool, stool, wheel_chandelier};
use super::random::Random;
use super::shapes::{Builder, turn_y, turn_z};
use crate::mesh::Mesh;

/// Half of the hall's length (along x), half of its width (along z), height of its ceiling.
const HALF_X: f64 = 6.5;
const HALF_Z: f64 = 4.5;
const HEIGHT: f64 = 4.6;
/// Top of the gallery's floor, and its front edge; it runs along the wall at -z.
const GALLERY: f64 = 2.7;
const GALLERY_Z: f64 = -2.75;
/// Where the gallery ends and the stairs begin.
const STAIRS_X: f64 = 5.0;

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// The hall: 13 x 4.6 x 9, floor at 0. `seed` decides how chairs, bottles and cards lie.
pub fn saloon_hall(seed: u32, detail: u32) -> Mesh {
    // Everything round is finer than in the small room.
    let mut b = Builder::new(2 * detail);
    let mut random = Random::new(seed);
    let still = DMat3::IDENTITY;
    b.object("shell", still, DVec3::ZERO, |b| shell(b, HALF_X, HALF_Z, HEIGHT));
    b.object("floor", still, DVec3::ZERO, floor);
    b.object("ceiling", turn_z(TAU * 0.5), at(0.0, HEIGHT, 0.0), ceiling);
    b.object("panels", still, DVec3::ZERO, panels);
    b.object("gallery", still, DVec3::ZERO, gallery);
    b.object("stairs", still, DVec3::ZERO, stairs);
    b.object("chandelier", still, at(0.3, 3.45, 0.4), |b| wheel_chandelier(b, HEIGHT - 0.08 - 3.45));

    b.object("bar", still, at(-0.8, 0.0, -2.4), |b| bar_counter(b, 6.0));
    b.object("bar top", still, at(-0.8, 1.1, -2.4), |b| bar_top(b, &mut random));
    for k in 0..4 {
        let x = -3.1 + 1.5 * f64::from(k);
        let turn = turn_y(random.range(0.0, TAU));
        b.object("stool", turn, at(x, 0.0, random.range(-1.76, -1.62)), stool);
    }
    b.object("shelf", still, at(-0.8, 0.0, -4.4), |b| bottle_shelf(b, 5.0, &[0.95, 1.45], &mut random));
    for x in [-2.55, 0.95] {
        b.object("hanging lamp", still, at(x, 1.95, -2.95), |b| hanging_lamp(b, GALLERY - 0.3 - 1.95));
    }

    let tables = [(-2.6, 0.7, 0.6, 3), (2.6, -0.2, 0.62, 3), (-0.5, 2.5, 0.58, 2), (3.1, 2.7, 0.6, 3)];
    tables_with_chairs(&mut b, &tables, 0.1, [0.24, 0.42], &mut random);

    b.object("piano", turn_y(TAU * -0.25), at(HALF_X - 0.42, 0.0, 1.0), piano);
    b.object("piano stool", still, at(HALF_X - 1.15, 0.0, 1.0), piano_stool);
    b.object("door", turn_y(TAU * 0.25), at(HALF_X - 0.1, 0.0, 3.2), doorway);
    barrels(
        &mut b,
        &[(-5.9, 0.0, -3.9), (-5.1, 0.0, -4.0), (-5.5, 0.9, -3.95), (-6.0, 0.0, -3.1)],
        &mut random,
    );
    for (x, z) in [(-5.9, -1.9), (1.1, 1.2)] {
        b.object("spittoon", still, at(x, 0.0, z), spittoon);
    }
    b.object("window", turn_y(TAU * -0.25), at(HALF_X, 1.65, 0.4), window);
    for x in [-2.1, 2.2] {
        b.object("gallery door", still, at(x, GALLERY, -HALF_Z), gallery_door);
    }
    b.finish()
}

/// Trodden planks along x.
fn floor(b: &mut Builder) {
    const PLANKS: u32 = 30;
    b.ground(([-HALF_X, -HALF_Z], [HALF_X, HALF_Z]), [36, 4 * PLANKS], -0.059, |x, z| {
        let part = ((z + HALF_Z) / (2.0 * HALF_Z) * f64::from(PLANKS)).fract();
        let groove = if !(0.1..0.9).contains(&part) { -0.006 } else { 0.0 };
        groove - 0.004 * (1.0 + libm::sin(1.3 * x) * libm::cos(0.9 * z))
    });
}

/// Pressed tin, in squares with ribs between them. Made face up; it is hung upside down.
fn ceiling(b: &mut Builder) {
    b.ground(([-HALF_X, -HALF_Z], [HALF_X, HALF_Z]), [80, 56], 0.001, |x, z| {
        // Four cells to a square, the first one its rib.
        let on_rib =
            |v: f64, half: f64, squares: f64| ((v + half) / (2.0 * half) * squares + 0.05).fract() < 0.1;
        if on_rib(x, HALF_X, 20.0) || on_rib(z, HALF_Z, 14.0) { 0.064 } else { 0.05 }
    });
}

/// Panels along the walls up to 1 m with a rail above them, and pictures.
fn panels(b: &mut Builder) {
    let row = |b: &mut Builder, length: f64| {
        for (from, to) in in_parts(length, 1.05) {
            b.cuboid(at(from + 0.05, 0.15, 0.0), at(to - 0.05, 0.95, 0.025));
        }
        b.cuboid(at(0.0, 0.0, 0.0), at(length, 0.12, 0.04));
        b.cuboid(at(0.0, 1.0, 0.0), at(length, 1.07, 0.05));
    };
    b.object("", turn_y(TAU * 0.25), at(-HALF_X, 0.0, HALF_Z - 0.1), |b| row(b, 6.5));
    b.object("", turn_y(TAU * -0.25), at(HALF_X, 0.0, -0.9), |b| row(b, 3.1));
    for (z, width) in [(3.2, 0.6), (1.7, 0.95), (-0.2, 0.7)] {
        b.object("", turn_y(TAU * 0.25), at(-HALF_X, 1.6, z), |b| frame(b, width, width * 1.2));
    }
}

/// Gallery along the back wall: floor on a girder and turned columns, joists below, a railing.
fn gallery(b: &mut Builder) {
    b.cuboid(at(-HALF_X + 0.001, GALLERY - 0.06, -HALF_Z + 0.001), at(STAIRS_X, GALLERY, GALLERY_Z + 0.04));
    b.cuboid(at(-HALF_X + 0.001, GALLERY - 0.3, GALLERY_Z - 0.2), at(STAIRS_X, GALLERY - 0.061, GALLERY_Z));
    for k in 0..13 {
        let x = -6.1 + 0.9 * f64::from(k);
        b.cuboid(
            at(x - 0.05, GALLERY - 0.22, -HALF_Z + 0.001),
            at(x + 0.05, GALLERY - 0.061, GALLERY_Z - 0.201),
        );
    }
    let columns = [-4.3, -0.8, 2.7];
    for x in columns {
        b.object("", DMat3::IDENTITY, at(x, 0.0, GALLERY_Z - 0.1), |b| {
            b.cuboid(at(-0.12, 0.0, -0.12), at(0.12, 0.12, 0.12));
            b.lathe(
                14,
                &[
                    (0.1, 0.121),
                    (0.105, 0.16),
                    (0.085, 0.22),
                    (0.075, 0.6),
                    (0.09, 0.68),
                    (0.08, 0.76),
                    (0.082, 1.3),
                    (0.076, 1.9),
                    (0.066, 2.05),
                    (0.085, 2.12),
                    (0.07, 2.17),
                    (0.11, 2.27),
                ],
            );
            b.cuboid(at(-0.13, 2.271, -0.1), at(0.13, GALLERY - 0.301, 0.1));
        });
    }
    let ends = [-HALF_X + 0.08, columns[0], columns[1], columns[2], STAIRS_X - 0.1];
    for pair in ends.windows(2) {
        let foot = |x: f64| at(x, GALLERY, GALLERY_Z - 0.1);
        rail(b, foot(pair[0]), foot(pair[1]));
    }
}

/// Railing along x from `from` to `to`, its foot line; posts at the right end of each.
fn rail(b: &mut Builder, from: DVec3, to: DVec3) {
    let count = ((to - from).length() / 0.4).round();
    for k in 1..count as u32 {
        b.object("", DMat3::IDENTITY, from + (to - from) * (f64::from(k) / count), |b| baluster(b, 0.8));
    }
    b.cuboid(from + at(0.06, 0.8, -0.035), to + at(-0.06, 0.86, 0.035));
    b.block(to + at(0.0, 0.45, 0.0), at(0.11, 0.9, 0.11));
    b.ball(to + at(0.0, 0.962, 0.0), 0.06, 10);
}

/// Flight along the wall at +x, up to the gallery.
fn stairs(b: &mut Builder) {
    const STEPS: u32 = 13;
    let rise = GALLERY / f64::from(STEPS);
    let (start, run, x) = (-0.9, 0.26, STAIRS_X + 0.02);
    for k in 0..STEPS {
        let (y, z) = (rise * f64::from(k + 1), start - run * f64::from(k));
        b.cuboid(at(x, y - 0.045, z - run - 0.02), at(HALF_X - 0.05, y, z));
        b.object("", DMat3::IDENTITY, at(x + 0.08, y, z - run * 0.5), |b| baluster(b, 0.8));
    }
    let top = start - run * (f64::from(STEPS) - 0.5);
    let (low, high) = (at(x + 0.08, rise + 0.83, start - run * 0.5), at(x + 0.08, GALLERY + 0.83, top));
    b.post(low + (low - high) * 0.03, high, 0.06, 0.06);
    b.block(at(x + 0.08, 0.6, start + 0.1), at(0.13, 1.2, 0.13));
    b.ball(at(x + 0.08, 1.27, start + 0.1), 0.07, 10);
    for side in [x + 0.05, HALF_X - 0.12] {
        let foot = at(side, 0.0, start - 0.3);
        b.post(foot, at(side, GALLERY - 0.31, start - run * 12.0 - 0.21), 0.08, 0.08);
    }
}

/// Oil lamp under the gallery; its base is at y = 0, its rod goes up to `rod`.
fn hanging_lamp(b: &mut Builder, rod: f64) {
    b.lathe(14, &[(0.03, -0.02), (0.075, 0.0), (0.09, 0.04), (0.075, 0.08), (0.03, 0.1)]);
    b.lathe(14, &[(0.035, 0.101), (0.06, 0.15), (0.058, 0.19), (0.03, 0.24), (0.028, 0.3)]);
    b.lathe(20, &[(0.19, 0.301), (0.16, 0.36), (0.08, 0.42), (0.03, 0.43)]);
    b.tube(&[at(0.0, 0.431, 0.0), at(0.0, rod, 0.0)], 5, |_| 0.008);
}

fn spittoon(b: &mut Builder) {
    b.lathe(
        18,
        &[
            (0.1, 0.0),
            (0.12, 0.015),
            (0.15, 0.06),
            (0.155, 0.1),
            (0.13, 0.15),
            (0.08, 0.185),
            (0.075, 0.2),
            (0.11, 0.235),
            (0.16, 0.25),
        ],
    );
}

/// Window with curtains drawn aside, its sill at y = 0; z = 0 is the wall.
fn window(b: &mut Builder) {
    frame(b, 1.0, 1.6);
    b.tube(&[at(-0.35, 1.72, 0.12), at(1.35, 1.72, 0.12)], 8, |_| 0.018);
    for (x0, x1) in [(-0.3, 0.3), (0.7, 1.3)] {
        curtain(b, x0, x1);
    }
}

/// Cloth in folds from the rod down, gathered at half height.
fn curtain(b: &mut Builder, x0: f64, x1: f64) {
    let n = b.sides(22);
    let row = |t: f64| {
        // The square of a sine, by the double angle.
        let gather = 1.0 - 0.225 * (1.0 - libm::cos(t * TAU));
        let outside = if x0 < 0.0 { x0 } else { x1 };
        let point = |k: u32, back: f64| {
            let s = f64::from(k) / f64::from(n);
            let x = outside + (x0 + (x1 - x0) * s - outside) * gather;
            at(x, 1.69 - 1.72 * t, 0.12 - back + 0.025 * libm::sin(s * TAU * 3.0))
        };
        (0..=n).map(|k| point(k, 0.0)).chain((0..=n).rev().map(|k| point(k, 0.012))).collect::<Vec<_>>()
    };
    let rows: Vec<_> = (0..=12).map(|k| row(f64::from(k) / 12.0)).collect();
    let middle = |row: &[DVec3]| row.iter().sum::<DVec3>() / row.len() as f64;
    b.loft(middle(&rows[0]), &rows, middle(&rows[12]));
}

/// Door on the gallery with its knob.
fn gallery_door(b: &mut Builder) {
    frame(b, 0.9, 1.75);
    b.cuboid(at(0.16, 0.95, 0.015), at(0.74, 1.6, 0.03));
    b.cuboid(at(0.16, 0.15, 0.015), at(0.74, 0.8, 0.03));
    b.ball(at(0.79, 0.87, 0.05), 0.03, 8);
}
