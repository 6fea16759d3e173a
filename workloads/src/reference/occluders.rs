//! The `exact` form by brute force.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::hard::{greatest_t, hard_test, is_left, plane_slack};
use super::segment::area_beyond;
use crate::adjacency::{Adjacency, Aspect, Counting, CutTriangle, EdgeWeights, Stance, counts};
use crate::eye::EyeView;
use crate::light::Light;
use crate::mesh::Mesh;
use crate::shadow_input::ShadowInput;

/// Edges are clipped this far in front of the receiver, as a part of its distance from the light.
const CLIP_EPS: f64 = 1e-6;

/// The light seen from one receiver: vertices become positions on the unit disc. [algorithms, §2.5, §2.6]
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    p: DVec3,
    axis: DVec3,
    basis: [DVec3; 2],
    /// Foot of the perpendicular from the receiver on the disc's plane, in the basis.
    foot: DVec2,
    distance: f64,
    radius: f64,
}

impl Projection {
    /// The disc that receiver `p` sees (light at the origin), of `radius` across `normal`; `None`: it faces the
    /// receiver.
    #[must_use]
    pub fn new(p: DVec3, radius: f64, normal: Option<DVec3>) -> Self {
        let axis = match normal {
            None => -p.normalize(),
            Some(n) if n.dot(p) > 0.0 => -n,
            Some(n) => n,
        };
        let (u, v) = axis.any_orthonormal_pair();
        // A disc that faces the receiver has it straight ahead: leave the rounding of that out.
        let foot = if normal.is_some() { DVec2::new(p.dot(u), p.dot(v)) } else { DVec2::ZERO };
        Self { p, axis, basis: [u, v], foot, distance: -p.dot(axis), radius }
    }

    /// Position of `v` on the disc; `v` must lie between receiver and light.
    #[must_use]
    pub fn vertex(&self, v: DVec3) -> DVec2 {
        self.on_disc(v - self.p)
    }

    /// Position of the point at `q` from the receiver.
    fn on_disc(&self, q: DVec3) -> DVec2 {
        let stretch = self.distance / q.dot(self.axis);
        let [u, v] = self.basis;
        (self.foot + DVec2::new(q.dot(u), q.dot(v)) * stretch) / self.radius
    }

    /// Part of the disc beyond the plane through the receiver across `normal`, seen from the middle of the disc.
    fn beyond_plane(&self, normal: DVec3) -> f64 {
        let slope = DVec2::new(normal.dot(self.basis[0]), normal.dot(self.basis[1]));
        let distance = self.p.dot(normal) / (self.radius * slope.length());
        // A plane in which the disc lies, and what is no plane, has no distance.
        if distance.is_nan() || distance.abs() >= 1.0 {
            return 0.0;
        }
        let across = slope.normalize();
        let foot = across * distance;
        area_beyond(foot - across.perp() * 2.0, foot + across.perp() * 2.0)
    }

    /// The edge on the disc, clipped between receiver and light; `None` if nothing is left.
    fn edge(&self, v0: DVec3, v1: DVec3) -> Option<[DVec2; 2]> {
        let (q0, q1) = (v0 - self.p, v1 - self.p);
        let (h0, h1) = (q0.dot(self.axis), q1.dot(self.axis));
        let (low, high) = (CLIP_EPS * self.distance, self.distance);
        // In the plane of a disc that does not turn, but for rounding, the light is a line: no part of it to cover.
        if high <= f64::EPSILON * self.p.length() {
            return None;
        }
        if (h0 <= low && h1 <= low) || (h0 >= high && h1 >= high) {
            return None;
        }
        let clip = |q: DVec3, h: f64| {
            let bound = h.clamp(low, high);
            if bound == h { q } else { q0 + (q1 - q0) * ((bound - h0) / (h1 - h0)) }
        };
        Some([self.on_disc(clip(q0, h0)), self.on_disc(clip(q1, h1))])
    }

    /// What of a triangle lies between receiver and light, as a polygon on the disc: it runs to the left where the triangle, as its
    /// corners run, is entered on the way from the light to the receiver. Empty where none of it does, and for a receiver that
    /// lies in the triangle's plane, but for rounding.
    fn polygon(&self, corners: [DVec3; 3]) -> Vec<DVec2> {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let side = (self.p - corners[0]).dot(normal);
        if self.distance <= f64::EPSILON * self.p.length() || side.abs() <= plane_slack(corners) {
            return Vec::new();
        }
        // Heights over the plane of the light count from there, so that they keep their digits near it.
        let mut polygon: Vec<(DVec3, f64)> = corners.map(|v| (v - self.p, v.dot(self.axis))).to_vec();
        let low = (CLIP_EPS - 1.0) * self.distance;
        for (bound, sign) in [(low, 1.0), (0.0, -1.0)] {
            let inside = |height: f64| (height - bound) * sign >= 0.0;
            let mut clipped = Vec::new();
            for (i, &(q, height)) in polygon.iter().enumerate() {
                let (next, next_height) = polygon[(i + 1) % polygon.len()];
                if inside(height) {
                    clipped.push((q, height));
                }
                if inside(height) != inside(next_height) {
                    clipped.push((q + (next - q) * ((bound - height) / (next_height - height)), bound));
                }
            }
            polygon = clipped;
        }
        polygon.into_iter().map(|(q, _)| self.on_disc(q)).collect()
    }
}

/// Part of the unit disc in a polygon, negative where it runs to the right.
fn area_in(polygon: &[DVec2]) -> f64 {
    let mut area = 0.0;
    for (i, &a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let left = a.perp_dot(b) >= 0.0;
        area += if left { -area_beyond(a, b) } else { area_beyond(a, b) };
        // How often it runs around the middle: crossings of the ray towards +x.
        if (a.y <= 0.0) != (b.y <= 0.0) && left == (b.y > a.y) {
            area += if left { 1.0 } else { -1.0 };
        }
    }
    area
}

/// Whether a convex polygon holds a place.
fn holds(polygon: &[DVec2], place: DVec2) -> bool {
    let side = |i: usize| {
        let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        (b - a).perp_dot(place - a)
    };
    let sides = || (0..polygon.len()).map(side);
    !polygon.is_empty() && (sides().all(|x| x >= 0.0) || sides().all(|x| x <= 0.0))
}

#[derive(Clone, Copy)]
struct Face {
    index: [u32; 3],
    front: i32,
    back: i32,
}

struct Silhouette {
    v: [u32; 2],
    weights: EdgeWeights,
}

/// All that casts shadows, about a light at the origin, in f64.
pub struct Occluders {
    vertices: Vec<DVec3>,
    /// All faces, by number; those that are no layer have no weight.
    faces: Vec<Face>,
    edges: Vec<Silhouette>,
    /// Faces that the light is cut by, which are no layers and on no edge.
    cut: Vec<CutTriangle>,
    /// What is taken for the middle of the light, in the world; the origin for occluders made of a kernel's input.
    middle: DVec3,
    radius: f64,
    normal: Option<DVec3>,
}

impl Occluders {
    /// The occluders made of the very numbers that kernels get: differences to a kernel are then its rounding, or its
    /// faults.
    #[must_use]
    pub fn from_input(input: &ShadowInput) -> Self {
        let vertices: Vec<DVec3> = input.vertices.iter().map(|&v| glam::Vec3::from(v).as_dvec3()).collect();
        let row =
            |e: usize| &input.edge_faces[input.edge_first[e] as usize..input.edge_first[e + 1] as usize];
        let rows: Vec<&[u32]> = (0..input.edges.len()).map(row).collect();
        let mut made = Self::make(vertices, &input.triangles, &input.counting, &input.edges, &rows);
        made.cut.clone_from(&input.cut);
        made.radius = f64::from(input.light_radius);
        made.normal = input.light_normal.map(|n| glam::Vec3::from(n).as_dvec3().normalize());
        made
    }

    /// The occluders made of a prepared mesh, without rounding to f32.
    #[must_use]
    pub fn from_mesh(mesh: &Mesh, adjacency: &Adjacency, light: &Light) -> Self {
        let Aspect { middle, stance, counting, cut, .. } = Aspect::new(light, mesh, adjacency);
        let triangles: Vec<[u32; 3]> = (0..mesh.triangles.len())
            .map(|t| {
                let counts = adjacency.component[t] != crate::adjacency::NO_COMPONENT;
                let stance = if counts { stance[t] } else { Stance::LeftOut };
                stance.corners(mesh.triangles[t])
            })
            .collect();
        let turned: Vec<u32> =
            adjacency.edge_faces.iter().map(|&face| stance[(face >> 1) as usize].side(face)).collect();
        let row = |e: usize| &turned[adjacency.edge_first[e] as usize..adjacency.edge_first[e + 1] as usize];
        let rows: Vec<&[u32]> = (0..adjacency.edges.len()).map(row).collect();
        let vertices = mesh.positions.iter().map(|&p| p - middle).collect();
        let mut made = Self::make(vertices, &triangles, &counting, &adjacency.edges, &rows);
        made.cut = cut;
        made.middle = middle;
        made.radius = light.disc_radius();
        made.normal = light.disc_normal();
        made
    }

    fn make(
        vertices: Vec<DVec3>,
        triangles: &[[u32; 3]],
        counting: &[Counting],
        edges: &[[u32; 2]],
        rows: &[&[u32]],
    ) -> Self {
        let det: Vec<f64> = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| vertices[v as usize]);
                a.dot((b - a).cross(c - a))
            })
            .collect();
        let faces = triangles
            .iter()
            .zip(counting.iter().zip(&det))
            .map(|(&index, (&counting, &det))| {
                let (front, back) = counts(counting, det);
                Face { index, front, back }
            })
            .collect();
        let edges = edges
            .iter()
            .zip(rows)
            .map(|(&v, row)| {
                let mut weights = EdgeWeights::default();
                for &face in *row {
                    let t = (face >> 1) as usize;
                    weights.add(counting[t], det[t], face & 1);
                }
                Silhouette { v, weights }
            })
            .filter(|edge| edge.weights.is_silhouette())
            .collect();
        Self { vertices, faces, edges, cut: Vec::new(), middle: DVec3::ZERO, radius: 0.0, normal: None }
    }

    /// What is taken for the middle of the light, in the world: the origin of receivers.
    #[must_use]
    pub fn middle(&self) -> DVec3 {
        self.middle
    }

    /// Edges with a weight other than 0.
    #[must_use]
    pub fn silhouette_edges(&self) -> usize {
        self.edges.len()
    }

    /// Layers in F and B between receiver `p` (light-centred) and the middle of the light, the umbra.
    fn layers(&self, p: DVec3, own: u32) -> EdgeWeights {
        let mut layers = EdgeWeights::default();
        for (face, id) in self.faces.iter().zip(0_u32..) {
            if id == own || (face.front == 0 && face.back == 0) {
                continue;
            }
            let v = face.index.map(|v| self.vertices[v as usize]);
            if let Some(hit) = hard_test(v, face.index, p)
                && hit.inside
                && hit.t > 0.0
                && hit.t < greatest_t(v)
            {
                layers.front += face.front;
                layers.back += face.back;
            }
        }
        layers
    }

    /// The sums (F, B) at receiver `p` (light-centred), not clamped, of the faces that keep clear of the light; the triangle `own`
    /// does not shadow it.
    #[must_use]
    pub fn sums(&self, p: DVec3, own: u32) -> (f64, f64) {
        let layers = self.layers(p, own);
        let (mut front, mut back) = (f64::from(layers.front), f64::from(layers.back));
        // Penumbra: what each silhouette takes from the layers or adds to them.
        if self.radius > 0.0 {
            let projection = Projection::new(p, self.radius, self.normal);
            for edge in &self.edges {
                let [v0, v1] = edge.v.map(|v| self.vertices[v as usize]);
                let Some([u0, u1]) = projection.edge(v0, v1) else { continue };
                let area = area_beyond(u0, u1);
                if area != 0.0 {
                    let signed = if is_left(p, v0, v1) { -area } else { area };
                    front += signed * f64::from(edge.weights.front);
                    back += signed * f64::from(edge.weights.back);
                }
            }
            // The own triangle is no layer, but its edges are among these: it takes away what lies beyond its horizon.
            if let Some(face) = self.faces.get(own as usize) {
                let [a, b, c] = face.index.map(|v| self.vertices[v as usize]);
                let area = projection.beyond_plane((b - a).cross(c - a));
                front += area * f64::from(face.front);
                back += area * f64::from(face.back);
            }
        }
        (front, back)
    }

    /// What the faces that the light is cut by hide of it from receiver `p` (light-centred), in F and B: each for itself, whichever
    /// side of it the middle is on, so that none is negative. The triangle `own` does not shadow it.
    #[must_use]
    pub fn cut_sums(&self, p: DVec3, own: u32) -> (f64, f64) {
        let (mut front, mut back) = (0.0, 0.0);
        if self.cut.is_empty() {
            return (front, back);
        }
        for (polygon, counting) in self.cut_polygons(&Projection::new(p, self.radius, self.normal), own) {
            let area = area_in(&polygon);
            let sheet = counting == Counting::Sheet;
            front += if sheet { area.abs() } else { area.max(0.0) };
            back += if sheet { area.abs() } else { (-area).max(0.0) };
        }
        (front, back)
    }

    /// Faces that the light is cut by, but for the triangle `own`, as polygons on the disc.
    fn cut_polygons(
        &self,
        projection: &Projection,
        own: u32,
    ) -> impl Iterator<Item = (Vec<DVec2>, Counting)> {
        let others = self.cut.iter().filter(move |face| face.number != own);
        others
            .map(|face| (projection.polygon(face.corners.map(|v| self.vertices[v as usize])), face.counting))
    }

    /// How many of some samples of the light, on the unit disc that receiver `p` sees, are covered: those before which there
    /// is a layer of F or of B. Counts each by itself: layers before the middle of the light, and from there one more or
    /// less at each silhouette that the way to the sample crosses.
    #[must_use]
    pub fn covered_samples(&self, p: DVec3, own: u32, places: &[DVec2]) -> usize {
        let middle = self.layers(p, own);
        let mut counts = vec![middle; places.len()];
        let projection = Projection::new(p, self.radius, self.normal);
        for edge in &self.edges {
            let [v0, v1] = edge.v.map(|v| self.vertices[v as usize]);
            let Some([a, b]) = projection.edge(v0, v1) else { continue };
            let left = is_left(p, v0, v1);
            let step = if left { -1 } else { 1 };
            for (place, count) in places.iter().zip(&mut counts) {
                let between = (a.perp_dot(*place) >= 0.0) != (b.perp_dot(*place) >= 0.0);
                let is_left_on_disc = (b - a).perp_dot(*place - a) > 0.0;
                if between && is_left_on_disc == left {
                    count.front += step * edge.weights.front;
                    count.back += step * edge.weights.back;
                }
            }
        }
        if let Some(face) = self.faces.get(own as usize) {
            let [a, b, c] = face.index.map(|v| self.vertices[v as usize]);
            let normal = (b - a).cross(c - a);
            let slope = DVec2::from(projection.basis.map(|side| normal.dot(side))) * self.radius;
            let middle = -p.dot(normal);
            for (place, count) in places.iter().zip(&mut counts) {
                if (middle + slope.dot(*place)) * middle < 0.0 {
                    count.front += face.front;
                    count.back += face.back;
                }
            }
        }
        let cut: Vec<_> = self.cut_polygons(&projection, own).map(|(polygon, _)| polygon).collect();
        let is_cut = |place: &DVec2| cut.iter().any(|polygon| holds(polygon, *place));
        places.iter().zip(&counts).filter(|(place, count)| count.is_silhouette() || is_cut(place)).count()
    }

    /// Covered part of the light, in [0, 1], at receiver `p`: `min(max(|F|, |B|, |F - B|), 1)`, each with what the faces that the
    /// light is cut by hide: `|F| + F'`, `|B| + B'`, `|F - B| + min(F', B')`.
    ///
    /// A sum is negative where the receiver and the middle of the light lie on one side of a face that covers part of
    /// the light: from the receiver the face runs the other way round. Its size is what it covers; where the other sum is
    /// positive, something else covers that.
    #[must_use]
    pub fn coverage_at(&self, p: DVec3, own: u32) -> f64 {
        let (front, back) = self.sums(p, own);
        let cut = self.cut_sums(p, own);
        let apart = (front - back).abs() + cut.0.min(cut.1);
        (front.abs() + cut.0).max(back.abs() + cut.1).max(apart).min(1.0)
    }

    /// Visible part of the light, in [0, 1], at receiver `p`.
    #[must_use]
    pub fn visibility_at(&self, p: DVec3, own: u32) -> f64 {
        1.0 - self.coverage_at(p, own)
    }

    /// Visibility of each receiver of `input`, which these occluders were made from.
    #[must_use]
    pub fn visibility(&self, input: &ShadowInput) -> Vec<f64> {
        input
            .receivers
            .par_iter()
            .zip(&input.receiver_triangle)
            .map(|(&p, &own)| self.visibility_at(glam::Vec3::from(p).as_dvec3(), own))
            .collect()
    }

    /// Visibility of each receiver of a view of the mesh, in f64 throughout.
    #[must_use]
    pub fn visibility_of_view(&self, adjacency: &Adjacency, eye: &EyeView) -> Vec<f64> {
        let own = |t: u32| adjacency.stands_for[t as usize];
        eye.points
            .par_iter()
            .zip(&eye.triangles)
            .map(|(&p, &t)| self.visibility_at(p - self.middle, own(t)))
            .collect()
    }
}
