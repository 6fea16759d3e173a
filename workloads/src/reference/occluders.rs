//! The `exact` form by brute force.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::hard::{greatest_t, hard_test, is_left, plane_slack};
use super::segment::{area_beyond, line_beyond, square_beyond};
use crate::adjacency::{Adjacency, Aspect, Counting, CutTriangle, EdgeWeights, Stance, counts, objects};
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
            LightShape::Triangle { halves: [u, v] } => {
                // Exchanged where the axis is turned around.
                let (u, v) = if u.cross(v).dot(p) > 0.0 { (v, u) } else { (u, v) };
                (u.cross(v).normalize(), [u, v], dual(u, v))
            }
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
            Outline::Triangle => panic!("no method sums parts of a triangle"),
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

    /// What of a triangle lies between receiver and light, as a polygon of places: it runs to the left where the triangle, as its
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
        polygon.into_iter().map(|(q, _)| self.place(q)).collect()
    }

    /// Part of the light in a polygon, negative where it runs to the right.
    fn part_in(&self, polygon: &[DVec2]) -> f64 {
        let mut part = 0.0;
        for (i, &a) in polygon.iter().enumerate() {
            let b = polygon[(i + 1) % polygon.len()];
            let left = a.perp_dot(b) >= 0.0;
            let beyond = self.part_beyond(a, b);
            part += if left { -beyond } else { beyond };
            // How often it runs around the middle: crossings of the ray towards +x.
            if (a.y <= 0.0) != (b.y <= 0.0) && left == (b.y > a.y) {
                part += if left { 1.0 } else { -1.0 };
            }
        }
        part
    }
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

/// How what several objects hide of the light is put together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObjectRule {
    /// Each hides of what the others leave as much as of the whole, as if they were strewn at random.
    Product,
    /// What hides the most hides what all the others do.
    Max,
}

/// The part of the light beyond the edge between two points in the exact form, unsigned.
fn exact_part(projection: &Projection, v0: DVec3, v1: DVec3) -> f64 {
    projection.edge(v0, v1).map_or(0.0, |[u0, u1]| projection.part_beyond(u0, u1))
}

#[derive(Clone, Copy)]
struct Face {
    /// Number of its object.
    object: u32,
    index: [u32; 3],
    front: i32,
    back: i32,
}

struct Silhouette {
    /// Number of its object.
    object: u32,
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
        made.cut.clone_from(&input.cut);
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
        let objects = objects(triangles.len(), rows.iter().copied());
        let faces: Vec<Face> = triangles
            .iter()
            .zip(counting.iter().zip(&det).zip(&objects))
            .map(|(&index, ((&counting, &det), &object))| {
                let (front, back) = counts(counting, det);
                Face { object, index, front, back }
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
                let object = row.first().map_or(0, |face| objects[(face >> 1) as usize]);
                Silhouette { object, v, weights }
            })
            .filter(|edge| edge.weights.is_silhouette())
            .collect();
        let (cut, middle, shape) = (Vec::new(), DVec3::ZERO, LightShape::Facing);
        Self { vertices, faces, edges, cut, middle, radius: 0.0, shape }
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

    /// The faces that are layers between receiver `p` (light-centred) and the middle of the light.
    fn layer_faces(&self, p: DVec3, own: u32) -> impl Iterator<Item = &Face> {
        let counted = move |id: u32, face: &Face| id != own && (face.front != 0 || face.back != 0);
        self.faces.iter().zip(0_u32..).filter(move |(face, id)| counted(*id, face)).filter_map(
            move |(face, _)| {
                let v = face.index.map(|v| self.vertices[v as usize]);
                let hit = hard_test(v, face.index, p)?;
                (hit.inside && hit.t > 0.0 && hit.t < greatest_t(v)).then_some(face)
            },
        )
    }

    /// Layers in F and B between receiver `p` (light-centred) and the middle of the light, the umbra.
    fn layers(&self, p: DVec3, own: u32) -> EdgeWeights {
        let mut layers = EdgeWeights::default();
        for face in self.layer_faces(p, own) {
            layers.front += face.front;
            layers.back += face.back;
        }
        layers
    }

    /// The sums (F, B) at receiver `p` (light-centred), not clamped, of the faces that keep clear of the light; the triangle `own`
    /// does not shadow it.
    #[must_use]
    pub fn sums(&self, p: DVec3, own: u32) -> (f64, f64) {
        self.sums_of(p, own, exact_part)
    }

    /// [`Occluders::sums`], `part` being what part of the light lies beyond the edge between two points, unsigned.
    pub(super) fn sums_of(
        &self,
        p: DVec3,
        own: u32,
        part: impl Fn(&Projection, DVec3, DVec3) -> f64,
    ) -> (f64, f64) {
        let (mut front, mut back) = (0.0, 0.0);
        self.each_term(p, own, part, |_, in_front, in_back| {
            front += in_front;
            back += in_back;
        });
        (front, back)
    }

    /// Has `take` see each term of [`Occluders::sums_of`]: the object that it is of, and what it adds to F and to B.
    fn each_term(
        &self,
        p: DVec3,
        own: u32,
        part: impl Fn(&Projection, DVec3, DVec3) -> f64,
        mut take: impl FnMut(u32, f64, f64),
    ) {
        for face in self.layer_faces(p, own) {
            take(face.object, f64::from(face.front), f64::from(face.back));
        }
        // Penumbra: what each silhouette takes from the layers or adds to them.
        if self.radius > 0.0 {
            let projection = Projection::new(p, self.radius, self.shape);
            for edge in &self.edges {
                let [v0, v1] = edge.v.map(|v| self.vertices[v as usize]);
                let area = part(&projection, v0, v1);
                if area != 0.0 {
                    let signed = if is_left(p, v0, v1) { -area } else { area };
                    let weights = edge.weights;
                    take(edge.object, signed * f64::from(weights.front), signed * f64::from(weights.back));
                }
            }
            // The own triangle is no layer, but its edges are among these: it takes away what lies beyond its horizon.
            if let Some(face) = self.faces.get(own as usize) {
                let [a, b, c] = face.index.map(|v| self.vertices[v as usize]);
                let area = projection.beyond_plane((b - a).cross(c - a));
                take(face.object, area * f64::from(face.front), area * f64::from(face.back));
            }
        }
    }

    /// Visible part of the light, in [0, 1], at receiver `p`, where what each object hides of it is put together by `rule`. The faces
    /// that the light is cut by count as one object.
    #[must_use]
    pub fn visibility_by_object(&self, p: DVec3, own: u32, rule: ObjectRule) -> f64 {
        self.by_object(p, own, exact_part, rule)
    }

    /// [`Occluders::visibility_by_object`], `part` being what part of the light lies beyond the edge between two points, unsigned.
    pub(super) fn by_object(
        &self,
        p: DVec3,
        own: u32,
        part: impl Fn(&Projection, DVec3, DVec3) -> f64,
        rule: ObjectRule,
    ) -> f64 {
        let mut sums: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        self.each_term(p, own, part, |object, front, back| {
            let sums = sums.entry(object).or_default();
            sums.0 += front;
            sums.1 += back;
        });
        let hidden = sums.values().map(|sums| covered(*sums, (0.0, 0.0)));
        let hidden = hidden.chain([covered((0.0, 0.0), self.cut_sums(p, own))]);
        let visible = hidden.map(|hidden| 1.0 - hidden);
        match rule {
            ObjectRule::Product => visible.product(),
            ObjectRule::Max => visible.fold(1.0, f64::min),
        }
    }

    /// What the faces that the light is cut by hide of it from receiver `p` (light-centred), in F and B: each for itself, whichever
    /// side of it the middle is on, so that none is negative. The triangle `own` does not shadow it.
    #[must_use]
    pub fn cut_sums(&self, p: DVec3, own: u32) -> (f64, f64) {
        let (mut front, mut back) = (0.0, 0.0);
        if self.cut.is_empty() {
            return (front, back);
        }
        let projection = Projection::new(p, self.radius, self.shape);
        for (polygon, counting) in self.cut_polygons(&projection, own) {
            let area = projection.part_in(&polygon);
            let sheet = counting == Counting::Sheet;
            front += if sheet { area.abs() } else { area.max(0.0) };
            back += if sheet { area.abs() } else { (-area).max(0.0) };
        }
        (front, back)
    }

    /// Faces that the light is cut by, but for the triangle `own`, as polygons of places on the light.
    fn cut_polygons(
        &self,
        projection: &Projection,
        own: u32,
    ) -> impl Iterator<Item = (Vec<DVec2>, Counting)> {
        let others = self.cut.iter().filter(move |face| face.number != own);
        others
            .map(|face| (projection.polygon(face.corners.map(|v| self.vertices[v as usize])), face.counting))
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
        covered(self.sums(p, own), self.cut_sums(p, own))
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
    pub fn visibility_of_view(&self, adjacency: &Adjacency, eye: &EyeView) -> Vec<f64> {
        let own = |t: u32| adjacency.stands_for[t as usize];
        eye.points
            .par_iter()
            .zip(&eye.triangles)
            .map(|(&p, &t)| self.visibility_at(p - self.middle, own(t)))
            .collect()
    }
}

/// Covered part of the light, in [0, 1], that the sums F and B make with `cut`, what the faces hide that it is cut by, see
/// [`Occluders::coverage_at`].
pub(super) fn covered((front, back): (f64, f64), cut: (f64, f64)) -> f64 {
    let apart = (front - back).abs() + cut.0.min(cut.1);
    (front.abs() + cut.0).max(back.abs() + cut.1).max(apart).min(1.0)
}

/// What `of` has for each receiver of `input`, by its place and its triangle.
pub(super) fn of_receivers(input: &ShadowInput, of: impl Fn(DVec3, u32) -> f64 + Sync) -> Vec<f64> {
    let receivers = input.receivers.par_iter().zip(&input.receiver_triangle);
    receivers.map(|(&p, &own)| of(glam::Vec3::from(p).as_dvec3(), own)).collect()
}
