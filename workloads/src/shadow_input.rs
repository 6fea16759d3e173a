//! What kernels put into simulated memory.

use glam::DVec3;
use rayon::prelude::*;

use crate::adjacency::{Adjacency, Aspect, Counting, CutTriangle, Stance, is_degenerate};
use crate::eye::EyeView;
use crate::light::{Light, LightShape};
use crate::mesh::Mesh;
use crate::pixels::Pixels;
use crate::scene::Scene;

/// Everything the kernels put into simulated memory: plain data, light at the origin.
///
/// Coordinates are formed in f64 and become f32 last. They are world units over `2^scale_log2`, chosen so that the
/// largest |coordinate| of vertices and receivers is in [0.5, 1): nothing depends on absolute scale.
#[derive(Debug, Clone, PartialEq)]
pub struct ShadowInput {
    /// Columns of the picture.
    pub width: u32,
    /// Rows of the picture.
    pub height: u32,
    /// A coordinate of 1 is `2^scale_log2` world units.
    pub scale_log2: i32,
    /// Largest |coordinate| of vertices and receivers, in [0.5, 1]; 0 where all lie in the light.
    pub largest: f32,
    /// Radius of the light in scaled units, see [`Light::radius`]; 0 for a point light.
    pub light_radius: f32,
    /// Shape of the light in scaled units; its numbers are f32 ones.
    pub light_shape: LightShape,
    /// Vertex positions, light-centred and scaled.
    pub vertices: Vec<[f32; 3]>,
    /// Corners of each triangle. Triangles that must not count (degenerate, there twice, with the light on them, or in `cut`)
    /// have one corner three times, so that every determinant is exactly 0. Closed bodies around the light run inward.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles that the light is cut by.
    pub cut: Vec<CutTriangle>,
    /// Counting rule of each triangle.
    pub counting: Vec<Counting>,
    /// Vertex pairs, `v[0] < v[1]`.
    pub edges: Vec<[u32; 2]>,
    /// Faces of edge `e` are `edge_faces[edge_first[e]..edge_first[e + 1]]`.
    pub edge_first: Vec<u32>,
    /// `triangle << 1 | side`; side 0: the triangle runs `v[0] -> v[1]`.
    pub edge_faces: Vec<u32>,
    /// Receivers, light-centred and scaled.
    pub receivers: Vec<[f32; 3]>,
    /// Triangle each receiver lies on, which does not shadow it.
    pub receiver_triangle: Vec<u32>,
    /// Pixel of each receiver.
    pub receiver_pixel: Pixels,
    /// Where a light is split, the inputs of this frame about its other parts; this one is about the first.
    pub others: Vec<ShadowInput>,
}

impl ShadowInput {
    /// Forms the input of one frame. `adjacency` must be that of `scene.mesh`, `eye` a view of it.
    #[must_use]
    pub fn new(scene: &Scene, adjacency: &Adjacency, eye: &EyeView) -> Self {
        Self::about(&scene.light, &scene.mesh, adjacency, eye)
    }

    /// Forms the input of one frame whose light is split into `count` lights, see [`Light::split`].
    #[must_use]
    pub fn of_lights(scene: &Scene, count: u32, adjacency: &Adjacency, eye: &EyeView) -> Self {
        let parts = scene.light.split(count);
        let mut inputs = parts.iter().map(|light| Self::about(light, &scene.mesh, adjacency, eye));
        let first = inputs.next().expect("a light has a part at least");
        Self { others: inputs.collect(), ..first }
    }

    /// Forms the input of one frame about `light`.
    fn about(light: &Light, mesh: &Mesh, adjacency: &Adjacency, eye: &EyeView) -> Self {
        let Aspect { middle: origin, stance, counting, cut, .. } = Aspect::new(light, mesh, adjacency);
        let largest = mesh
            .positions
            .par_iter()
            .chain(&eye.points)
            .map(|&p| (p - origin).abs().max_element())
            .reduce(|| 0.0, f64::max);
        let scale_log2 = exponent(largest);
        let scaled = |p: DVec3| scale_by_power(p - origin, -scale_log2).as_vec3().to_array();

        let triangles = (0..mesh.triangles.len())
            .map(|t| {
                let counts = adjacency.stands_for[t] as usize == t && !is_degenerate(mesh, t);
                let stance = if counts { stance[t] } else { Stance::LeftOut };
                stance.corners(mesh.triangles[t])
            })
            .collect();
        let turn = |&face: &u32| stance[(face >> 1) as usize].side(face);
        let radius = scale_by_power(DVec3::splat(light.radius()), -scale_log2).x as f32;

        Self {
            width: eye.width,
            height: eye.height,
            scale_log2,
            largest: libm::scalbn(largest, -scale_log2) as f32,
            light_radius: radius,
            light_shape: match light.shape() {
                shape @ (LightShape::Facing | LightShape::Disc { .. }) => shape,
                shape => shape.map(|v| scale_by_power(v, -scale_log2)),
            }
            .map(|v| v.as_vec3().as_dvec3()),
            vertices: mesh.positions.par_iter().map(|&p| scaled(p)).collect(),
            triangles,
            cut,
            counting,
            edges: adjacency.edges.clone(),
            edge_first: adjacency.edge_first.clone(),
            edge_faces: adjacency.edge_faces.iter().map(turn).collect(),
            receivers: eye.points.par_iter().map(|&p| scaled(p)).collect(),
            receiver_triangle: eye.triangles.par_iter().map(|&t| adjacency.stands_for[t as usize]).collect(),
            receiver_pixel: Pixels::new(&eye.pixels),
            others: Vec::new(),
        }
    }
}

/// The k with `2^(k-1) <= x < 2^k`; 0 for 0.
fn exponent(x: f64) -> i32 {
    if x == 0.0 { 0 } else { libm::frexp(x).1 }
}

/// `p * 2^k`, exact unless it underflows.
fn scale_by_power(p: DVec3, k: i32) -> DVec3 {
    // One product with a power that is a normal number is rounded once, as the other is.
    if (-1022..=1023).contains(&k) { p * libm::scalbn(1.0, k) } else { p.map(|x| libm::scalbn(x, k)) }
}
