//! What both saloons share: the room's shell, and furniture in groups.

use core::f64::consts::TAU;

use glam::DVec3;

use super::furniture::{barrel, bottle, chair, mug, round_table, swing_door};
use super::random::Random;
use super::shapes::{Builder, turn_y};

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Begin and end of each of the equal parts, about `about` long, of a wall of this length.
pub fn in_parts(length: f64, about: f64) -> impl Iterator<Item = (f64, f64)> {
    let count = (length / about).round();
    let step = length / count;
    (0..count as u32).map(move |k| f64::from(k) * step).map(move |from| (from, from + step))
}

/// Walls, ceiling and the ground under the floor of a room whose floor is at 0, as slabs that touch along their edges.
pub fn shell(b: &mut Builder, half_x: f64, half_z: f64, height: f64) {
    let (x, z, w) = (half_x, half_z, 0.2);
    b.cuboid(at(-x - w, -0.3, -z - w), at(x + w, -0.06, z + w));
    b.cuboid(at(-x - w, height, -z - w), at(x + w, height + w, z + w));
    b.cuboid(at(-x - w, -0.06, -z - w), at(-x, height, z + w));
    b.cuboid(at(x, -0.06, -z - w), at(x + w, height, z + w));
    b.cuboid(at(-x, -0.06, -z - w), at(x, height, -z));
    b.cuboid(at(-x, -0.06, z), at(x, height, z + w));
}

/// Picture frame on the wall z = 0, from (0, 0) to (`width`, `height`).
pub fn frame(b: &mut Builder, width: f64, height: f64) {
    b.cuboid(at(0.0, 0.0, 0.0), at(width, 0.06, 0.04));
    b.cuboid(at(0.0, height - 0.06, 0.0), at(width, height, 0.04));
    b.cuboid(at(0.0, 0.06, 0.0), at(0.06, height - 0.06, 0.04));
    b.cuboid(at(width - 0.06, 0.06, 0.0), at(width, height - 0.06, 0.04));
    b.cuboid(at(0.06, 0.06, 0.0), at(width - 0.06, height - 0.06, 0.015));
}

/// Doorway in the plane z = 0, its middle at x = 0, with a swing door ajar.
pub fn doorway(b: &mut Builder) {
    b.cuboid(at(-0.85, 0.0, -0.05), at(-0.72, 2.1, 0.05));
    b.cuboid(at(0.72, 0.0, -0.05), at(0.85, 2.1, 0.05));
    b.cuboid(at(-0.9, 2.1, -0.055), at(0.9, 2.25, 0.055));
    swing_door(b, 0.7);
}

/// Barrels that stand at `places`, each turned anyhow.
pub fn barrels(b: &mut Builder, places: &[(f64, f64, f64)], random: &mut Random) {
    for &(x, y, z) in places {
        b.object("barrel", turn_y(random.range(0.0, TAU)), at(x, y, z), barrel);
    }
}

/// Set tables with chairs around them: x, z, radius of the table, number of chairs.
///
/// A chair stands off its even place by up to `shift` of a place, and `gap` from the table's rim.
pub fn tables_with_chairs(
    b: &mut Builder,
    tables: &[(f64, f64, f64, u32)],
    shift: f64,
    gap: [f64; 2],
    random: &mut Random,
) {
    for &(x, z, radius, chairs) in tables {
        b.object("table", turn_y(random.range(0.0, 1.0)), at(x, 0.0, z), |b| round_table(b, radius));
        table_top(b, at(x, 0.76, z), radius, random);
        let first = random.range(0.0, TAU);
        for k in 0..chairs {
            let angle = first + TAU * (f64::from(k) + random.range(-shift, shift)) / f64::from(chairs);
            let turn = turn_y(angle + random.range(-0.2, 0.2));
            let out = turn_y(angle) * at(0.0, 0.0, radius + random.range(gap[0], gap[1]));
            b.object("chair", turn, at(x, 0.0, z) + out, chair);
        }
    }
}

/// Bottles, mugs and a till along the bar.
pub fn bar_top(b: &mut Builder, random: &mut Random) {
    for k in 0..9 {
        let x = -2.1 + 0.5 * f64::from(k) + random.range(-0.1, 0.1);
        let z = random.range(-0.15, 0.2);
        let turn = turn_y(random.range(0.0, TAU));
        if k % 3 == 1 {
            b.object("bottle", turn, at(x, 0.0, z), |b| bottle(b, random));
        } else {
            b.object("mug", turn, at(x, 0.0, z), mug);
        }
    }
    b.object("till", turn_y(0.2), at(2.0, 0.0, -0.1), |b| {
        b.cuboid(at(-0.2, 0.0, -0.15), at(0.2, 0.18, 0.15));
        b.cuboid(at(-0.17, 0.18, -0.13), at(0.17, 0.36, -0.02));
    });
}

/// Mugs, a bottle and cards on a table at `center`.
fn table_top(b: &mut Builder, center: DVec3, radius: f64, random: &mut Random) {
    let first = random.range(0.0, TAU);
    for k in 0..3 {
        let turn = turn_y(first + TAU * f64::from(k) / 3.0);
        b.object("mug", turn, center + turn * at(radius * 0.62, 0.0, 0.0), mug);
        let card = turn_y(first + TAU * (f64::from(k) + random.range(0.3, 0.7)) / 3.0);
        b.object("cards", card, center + card * at(radius * 0.7, 0.0, 0.0), |b| {
            b.cuboid(at(-0.03, 0.0, -0.045), at(0.03, 0.012, 0.045));
        });
    }
    b.object("bottle", turn_y(first), center + turn_y(first + 0.5) * at(0.14, 0.0, 0.0), |b| {
        bottle(b, random)
    });
}
