//! What the eye sees: one exact hit point per covered pixel.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::camera::{Camera, ImageSize};
use crate::mesh::{Mesh, normal_direction};

/// Receivers: the points visible through the pixel centers. Covered pixels only, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct EyeView {
    /// Columns of the picture.
    pub width: u32,
    /// Rows of the picture.
    pub height: u32,
    /// Hit points, world space, formed from the corners in f64 (not from a depth buffer).
    pub points: Vec<DVec3>,
    /// Unit geometric normals, turned to the eye.
    pub normals: Vec<Vec3>,
    /// Triangle each point lies on.
    pub triangles: Vec<u32>,
    /// Pixel of each point, `y * width + x`, ascending.
    pub pixels: Vec<u32>,
}

struct Sample {
    pixel: u32,
    point: DVec3,
    normal: Vec3,
    triangle: u32,
}

impl EyeView {
    /// Casts one ray through each pixel center. Rows run on all host threads; the result does not depend on them.
    #[must_use]
    pub fn render(mesh: &Mesh, camera: &Camera, width: u32, height: u32) -> Self {
        Self::render_with(&Bvh::new(mesh), mesh, camera, width, height)
    }

    /// Renders the view as [`EyeView::render`] does, with a hierarchy that was built before.
    #[must_use]
    pub fn render_with(bvh: &Bvh, mesh: &Mesh, camera: &Camera, width: u32, height: u32) -> Self {
        let size = ImageSize { width, height };
        let axes = camera.axes(size);
        let rows: Vec<Vec<Sample>> = (0..height)
            .into_par_iter()
            .map(|y| {
                let cast = |x| {
                    let direction = axes.direction(size, x, y);
                    let hit = bvh.closest(camera.eye, direction, 0.0, f64::INFINITY)?;
                    Some(sample(mesh, hit.triangle, hit.weights, direction, y * width + x))
                };
                (0..width).filter_map(cast).collect()
            })
            .collect();

        let covered = rows.iter().map(Vec::len).sum();
        let mut view = Self {
            width,
            height,
            points: Vec::with_capacity(covered),
            normals: Vec::with_capacity(covered),
            triangles: Vec::with_capacity(covered),
            pixels: Vec::with_capacity(covered),
        };
        for s in rows.into_iter().flatten() {
            view.points.push(s.point);
            view.normals.push(s.normal);
            view.triangles.push(s.triangle);
            view.pixels.push(s.pixel);
        }
        view
    }
}

fn sample(mesh: &Mesh, triangle: u32, weights: [f64; 3], direction: DVec3, pixel: u32) -> Sample {
    let [a, b, c] = mesh.corners(triangle as usize);
    // From the first corner, so that a point of a triangle far off the origin stays in its plane.
    let point = a + (b - a) * weights[1] + (c - a) * weights[2];
    let normal = normal_direction([a, b, c]).normalize_or_zero();
    let turned = if normal.dot(direction) > 0.0 { -normal } else { normal };
    Sample { pixel, point, normal: turned.as_vec3(), triangle }
}
