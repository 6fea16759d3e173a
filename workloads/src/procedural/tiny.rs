//! The smallest scene that has everything: a floor, two boxes and a post around a lamp.

use glam::{DMat3, DVec3};

use super::shapes::{Builder, turn_y};
use crate::mesh::Mesh;

/// About a hundred triangles; the lamp of `configs/scenes/tiny.json` hangs between the bodies.
pub fn tiny(detail: u32) -> Mesh {
    let mut b = Builder::new(detail);
    b.object("floor", DMat3::IDENTITY, DVec3::ZERO, |b| {
        b.cuboid(DVec3::new(-2.0, -0.1, -2.0), DVec3::new(2.0, 0.0, 2.0));
    });
    b.object("wall", DMat3::IDENTITY, DVec3::ZERO, |b| {
        b.cuboid(DVec3::new(-2.0, 0.001, -2.1), DVec3::new(2.0, 2.0, -2.0));
    });
    b.object("crate", turn_y(0.5), DVec3::new(-0.9, 0.01, -0.5), |b| {
        b.cuboid(DVec3::new(-0.3, 0.0, -0.3), DVec3::new(0.3, 0.6, 0.3));
    });
    b.object("brick", turn_y(-0.3), DVec3::new(0.9, 0.01, -0.9), |b| {
        b.cuboid(DVec3::new(-0.15, 0.0, -0.25), DVec3::new(0.15, 1.0, 0.25));
    });
    b.object("post", DMat3::IDENTITY, DVec3::new(0.5, 0.01, 0.6), |b| {
        b.lathe(8, &[(0.16, 0.0), (0.12, 0.75)]);
    });
    b.finish()
}
