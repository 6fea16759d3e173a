//! The `exact` form by brute force.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::hard::{greatest_t, hard_test, is_left};
use super::segment::{area_beyond, line_beyond, square_beyond};
use crate::adjacency::{Adjacency, Counting, EdgeWeights, Stance, counts, stances};
use crate::eye::EyeView;
use crate::light::{Light, LightShape, Outline, dual};
use crate::mesh::Mesh;
use crate::shadow_input::ShadowInput;

/// Edges are clipped this far in front of the receiver, as a part of its distance from the light.
const CLIP_EPS: f64 = 1e-6;

/// The light seen from one receiver: vertices become places on it. [algorithms, §2.5, §2.6]
///
/// Places on a disc are in radii, those on a rectangle in its half sides; on a line the first number is in half lines, and the
/// second says how far beside it a place is.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    p: DVec3,
    /// Direction across the light's plane, away from the receiver.
    axis: DVec3,
    /// The vectors in the light's plane that are 1 long in places.
    units: [DVec3; 2],
    /// The vectors whose products with a point of the light's plane are its place.
    along: [DVec3; 2],
    /// Place of the foot of the perpendicular from the receiver on the light's plane.
    foot: DVec2,
    distance: f64,
    outline: Outline,
}

impl Projection {
    /// What receiver `p` sees of the light of `shape` about the origin; `radius` is that of a disc.
    #[must_use]
    pub fn new(p: DVec3, radius: f64, shape: LightShape) -> Self {
        let away = |normal: DVec3| if normal.dot(p) > 0.0 { -normal } else { normal };
        let disc = |axis: DVec3| {
            let (u, v) = axis.any_orthonormal_pair();
            (axis, [u * radius, v * radius], [u / radius, v / radius])
        };
        let (axis, units, along) = match shape {
            LightShape::Facing => disc(-p.normalize()),
            LightShape::Disc { normal } => disc(away(normal)),
            LightShape::Rect { halves: [u, v] } => {
                // Turned around with the axis: from either side, left of an edge is left of it.
                let v = if u.cross(v).dot(p) > 0.0 { -v } else { v };
                (u.cross(v).normalize(), [u, v], dual(u, v))
            }
            LightShape::Line { half } => {
                let beside = p - half * (p.dot(half) / half.length_squared());
                let axis = -beside.normalize_or(half.any_orthonormal_vector());
                let aside = axis.cross(half);
                let per_square = half.length_squared().recip();
                (axis, [half, aside], [half * per_square, aside * per_square])
            }
        };
        // A disc that faces the receiver has it straight ahead: leave the rounding of that out.
        let foot = match shape {
            LightShape::Facing => DVec2::ZERO,
            LightShape::Line { .. } => DVec2::new(p.dot(along[0]), 0.0),
            _ => DVec2::from(along.map(|along| p.dot(along))),
        };
        Self { p, axis, units, along, foot, distance: -p.dot(axis), outline: shape.outline() }
    }

    /// Place of `v` on the light; `v` must lie between receiver and light.
    #[must_use]
    pub fn vertex(&self, v: DVec3) -> DVec2 {
        self.place(v - self.p)
    }

    /// Place of the point at `q` from the receiver.
    fn place(&self, q: DVec3) -> DVec2 {
        let stretch = self.distance / q.dot(self.axis);
        self.foot + DVec2::from(self.along.map(|along| q.dot(along))) * stretch
    }

    /// Part of the light beyond the edge `u0 u1`, inside the wedge that the edge subtends at the light's middle.
    fn part_beyond(&self, u0: DVec2, u1: DVec2) -> f64 {
        match self.outline {
            Outline::Disc => area_beyond(u0, u1),
            Outline::Square => square_beyond(u0, u1),
            Outline::Line => line_beyond(u0, u1),
        }
    }

    /// What `normal` makes of places: those on the plane across it through the receiver have with this a product of the second.
    fn slope(&self, normal: DVec3) -> (DVec2, f64) {
        (DVec2::from(self.units.map(|unit| unit.dot(normal))), self.p.dot(normal))
    }

    /// Part of the light beyond the plane through the receiver across `normal`, seen from the light's middle.
    fn beyond_plane(&self, normal: DVec3) -> f64 {
        let (slope, offset) = self.slope(normal);
        let distance = offset / slope.length();
        // A plane in which the light lies, and what is no plane, has no distance.
        if distance.is_nan() || distance.abs() >= 2.0 {
            return 0.0;
        }
        let across = slope.normalize();
        let foot = across * distance;
        self.part_beyond(foot - across.perp() * 2.0, foot + across.perp() * 2.0)
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
        Some([self.place(clip(q0, h0)), self.place(clip(q1, h1))])
    }
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
    pub(super) radius: f64,
    shape: LightShape,
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
        made.radius = f64::from(input.light_radius);
        made.shape = match input.light_shape {
            LightShape::Disc { normal } => LightShape::Disc { normal: normal.normalize() },
            shape => shape,
        };
        made
    }

    /// The occluders made of a prepared mesh, without rounding to f32.
    #[must_use]
    pub fn from_mesh(mesh: &Mesh, adjacency: &Adjacency, light: &Light) -> Self {
        let center = light.center();
        let stance = stances(mesh, adjacency, center);
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
        let vertices = mesh.positions.iter().map(|&p| p - center).collect();
        let mut made = Self::make(vertices, &triangles, &adjacency.counting, &adjacency.edges, &rows);
        made.radius = light.radius();
        made.shape = light.shape();
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
        Self { vertices, faces, edges, radius: 0.0, shape: LightShape::Facing }
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

    /// The sums (F, B) at receiver `p` (light-centred), not clamped; the triangle `own` does not shadow it.
    #[must_use]
    pub fn sums(&self, p: DVec3, own: u32) -> (f64, f64) {
        self.sums_of(p, own, |projection, v0, v1| {
            projection.edge(v0, v1).map_or(0.0, |[u0, u1]| projection.part_beyond(u0, u1))
        })
    }

    /// [`Occluders::sums`], `part` being what part of the light lies beyond the edge between two points, unsigned.
    pub(super) fn sums_of(
        &self,
        p: DVec3,
        own: u32,
        part: impl Fn(&Projection, DVec3, DVec3) -> f64,
    ) -> (f64, f64) {
        let layers = self.layers(p, own);
        let (mut front, mut back) = (f64::from(layers.front), f64::from(layers.back));
        // Penumbra: what each silhouette takes from the layers or adds to them.
        if self.radius > 0.0 {
            let projection = Projection::new(p, self.radius, self.shape);
            for edge in &self.edges {
                let [v0, v1] = edge.v.map(|v| self.vertices[v as usize]);
                let area = part(&projection, v0, v1);
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

    /// How many of some samples of the light, places on what receiver `p` sees of it, are covered: those before which there is a
    /// layer of F or of B. Counts each by itself: layers before the middle of the light, and from there one more or less at each
    /// silhouette that the way to the sample crosses.
    #[must_use]
    pub fn covered_samples(&self, p: DVec3, own: u32, places: &[DVec2]) -> usize {
        let middle = self.layers(p, own);
        let mut counts = vec![middle; places.len()];
        let projection = Projection::new(p, self.radius, self.shape);
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
            let (slope, offset) = projection.slope(normal);
            for (place, count) in places.iter().zip(&mut counts) {
                if (offset - slope.dot(*place)) * offset < 0.0 {
                    count.front += face.front;
                    count.back += face.back;
                }
            }
        }
        counts.iter().filter(|count| count.is_silhouette()).count()
    }

    /// Covered part of the light, in [0, 1], at receiver `p`: `min(max(|F|, |B|, |F - B|), 1)`.
    ///
    /// A sum is negative where the receiver and the middle of the light lie on one side of a face that covers part of
    /// the light: from the receiver the face runs the other way round. Its size is what it covers; where the other sum is
    /// positive, something else covers that.
    #[must_use]
    pub fn coverage_at(&self, p: DVec3, own: u32) -> f64 {
        covered(self.sums(p, own))
    }

    /// Visible part of the light, in [0, 1], at receiver `p`.
    #[must_use]
    pub fn visibility_at(&self, p: DVec3, own: u32) -> f64 {
        1.0 - self.coverage_at(p, own)
    }

    /// Visibility of each receiver of `input`, which these occluders were made from.
    #[must_use]
    pub fn visibility(&self, input: &ShadowInput) -> Vec<f64> {
        of_receivers(input, |p, own| self.visibility_at(p, own))
    }

    /// Visibility of each receiver of a view of the mesh, in f64 throughout.
    #[must_use]
    pub fn visibility_of_view(&self, adjacency: &Adjacency, light: &Light, eye: &EyeView) -> Vec<f64> {
        let center = light.center();
        let own = |t: u32| adjacency.stands_for[t as usize];
        eye.points
            .par_iter()
            .zip(&eye.triangles)
            .map(|(&p, &t)| self.visibility_at(p - center, own(t)))
            .collect()
    }
}

/// Covered part of the light, in [0, 1], that the sums F and B make, see [`Occluders::coverage_at`].
pub(super) fn covered((front, back): (f64, f64)) -> f64 {
    front.abs().max(back.abs()).max((front - back).abs()).min(1.0)
}

/// What `of` has for each receiver of `input`, by its place and its triangle.
pub(super) fn of_receivers(input: &ShadowInput, of: impl Fn(DVec3, u32) -> f64 + Sync) -> Vec<f64> {
    let receivers = input.receivers.par_iter().zip(&input.receiver_triangle);
    receivers.map(|(&p, &own)| of(glam::Vec3::from(p).as_dvec3(), own)).collect()
}
