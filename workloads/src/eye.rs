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

/// Sides of the tiles of pixels whose rays are cast together.
const TILE: u32 = 4;

/// What stands for the triangle of a pixel that sees none.
const NOTHING: u32 = u32::MAX;

impl EyeView {
    /// Casts one ray through each pixel center. Tiles run on all host threads; the result does not depend on them.
    #[must_use]
    pub fn render(mesh: &Mesh, camera: &Camera, width: u32, height: u32) -> Self {
        Self::render_with(&Bvh::new(mesh), mesh, camera, width, height)
    }

    /// Renders the view as [`EyeView::render`] does, with a hierarchy that was built before.
    #[must_use]
    pub fn render_with(bvh: &Bvh, mesh: &Mesh, camera: &Camera, width: u32, height: u32) -> Self {
        let size = ImageSize { width, height };
        let axes = camera.axes(size);
        let count = width as usize * height as usize;
        let mut points = vec![DVec3::ZERO; count];
        let mut normals = vec![Vec3::ZERO; count];
        let mut triangles = vec![NOTHING; count];
        let row_of_tiles = (TILE * width).max(1) as usize;
        let rows = points
            .par_chunks_mut(row_of_tiles)
            .zip(normals.par_chunks_mut(row_of_tiles))
            .zip(triangles.par_chunks_mut(row_of_tiles));
        rows.enumerate().for_each(|(row, ((points, normals), triangles))| {
            let top = row as u32 * TILE;
            for left in (0..width).step_by(TILE as usize) {
                // Beyond the picture, rays are those of its border once more.
                let pixel = |i: usize| {
                    let (x, y) = (left + i as u32 % TILE, top + i as u32 / TILE);
                    (x < width && y < height).then_some((x, y))
                };
                let directions = core::array::from_fn(|i| {
                    let (x, y) = pixel(i).unwrap_or((left, top));
                    axes.direction(size, x, y)
                });
                for (i, hit) in bvh.closest_of_packet(camera.eye, &directions).into_iter().enumerate() {
                    let (Some((x, y)), Some(hit)) = (pixel(i), hit) else { continue };
                    let at = ((y - top) * width + x) as usize;
                    (points[at], normals[at]) = seen(mesh, hit.triangle, hit.weights, directions[i]);
                    triangles[at] = hit.triangle;
                }
            }
        });

        let pixels: Vec<u32> = (0..count as u32).filter(|&at| triangles[at as usize] != NOTHING).collect();
        if pixels.len() < count {
            keep(&mut points, &pixels);
            keep(&mut normals, &pixels);
            keep(&mut triangles, &pixels);
        }
        Self { width, height, points, normals, triangles, pixels }
    }
}

/// Keeps the items of these numbers, which ascend.
fn keep<T: Copy>(items: &mut Vec<T>, numbers: &[u32]) {
    for (to, from) in numbers.iter().enumerate() {
        items[to] = items[*from as usize];
    }
    items.truncate(numbers.len());
    items.shrink_to_fit();
}

/// The point of a triangle that a ray of this direction meets, and the triangle's unit normal, turned to the eye.
fn seen(mesh: &Mesh, triangle: u32, weights: [f64; 3], direction: DVec3) -> (DVec3, Vec3) {
    let [a, b, c] = mesh.corners(triangle as usize);
    // From the first corner, so that a point of a triangle far off the origin stays in its plane.
    let point = a + (b - a) * weights[1] + (c - a) * weights[2];
    let normal = normal_direction([a, b, c]).normalize_or_zero();
    let turned = if normal.dot(direction) > 0.0 { -normal } else { normal };
    (point, turned.as_vec3())
}
