//! Table, ball, crate and a thin tilted board on a floor.

use glam::{DMat3, DVec3};

use super::shapes::{Builder, turn_y, turn_z};
use crate::mesh::Mesh;

/// About 600 triangles in a space of 8 x 3 x 8, floor at 0.
pub fn table(detail: u32) -> Mesh {
    let mut b = Builder::new(detail);
    b.object("floor", DMat3::IDENTITY, DVec3::ZERO, |b| {
        b.cuboid(DVec3::new(-4.0, -0.1, -4.0), DVec3::new(4.0, 0.0, 4.0));
    });
    b.object("table", turn_y(0.15), DVec3::ZERO, |b| {
        b.cuboid(DVec3::new(-1.1, 0.95, -0.7), DVec3::new(1.1, 1.03, 0.7));
        for (x, z) in [(-0.95, -0.55), (0.95, -0.55), (-0.95, 0.55), (0.95, 0.55)] {
            b.post(DVec3::new(x, 0.0, z), DVec3::new(x, 0.95, z), 0.07, 0.1);
        }
    });
    b.object("ball", DMat3::IDENTITY, DVec3::new(-0.35, 1.36, 0.05), |b| b.ball(DVec3::ZERO, 0.33, 20));
    b.object("crate", turn_y(0.5), DVec3::new(1.75, 0.0, 0.9), |b| {
        b.cuboid(DVec3::new(-0.35, 0.0, -0.35), DVec3::new(0.35, 0.7, 0.35));
    });
    b.object("board", turn_y(0.4) * turn_z(0.35), DVec3::new(0.55, 1.62, 0.1), |b| {
        b.cuboid(DVec3::new(-0.4, -0.01, -0.25), DVec3::new(0.4, 0.01, 0.25));
    });
    b.finish()
}
