//! The Cornell box: a room open to the front, two blocks.

use glam::{DMat3, DVec3};

use super::shapes::{Builder, turn_y};
use crate::mesh::Mesh;

/// Room of 2 x 2 x 2 about (0, 1, 0), walls as thick slabs, proportions as measured at Cornell.
pub fn cornell() -> Mesh {
    let mut b = Builder::new(1);
    let mut slab = |name: &str, min: [f64; 3], max: [f64; 3]| {
        b.object(name, DMat3::IDENTITY, DVec3::ZERO, |b| b.cuboid(min.into(), max.into()));
    };
    slab("floor", [-1.1, -0.1, -1.1], [1.1, 0.0, 1.0]);
    slab("ceiling", [-1.1, 2.0, -1.1], [1.1, 2.1, 1.0]);
    slab("back wall", [-1.1, 0.0, -1.1], [1.1, 2.0, -1.0]);
    slab("left wall", [-1.1, 0.0, -1.0], [-1.0, 2.0, 1.0]);
    slab("right wall", [1.0, 0.0, -1.0], [1.1, 2.0, 1.0]);
    b.object("short block", turn_y(-0.3), DVec3::new(0.33, 0.0, 0.35), |b| {
        b.cuboid(DVec3::new(-0.3, 0.0, -0.3), DVec3::new(0.3, 0.6, 0.3));
    });
    b.object("tall block", turn_y(0.32), DVec3::new(-0.35, 0.0, -0.3), |b| {
        b.cuboid(DVec3::new(-0.3, 0.0, -0.3), DVec3::new(0.3, 1.2, 0.3));
    });
    b.finish()
}
