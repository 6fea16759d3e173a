//! What is binned and rasterized: triangles, which hide the light as a whole, and edges, which have a penumbra.

use lrbsim_isa::Vpu;
use lrbsim_workloads::{LightShape, ShadowInput};

use super::touch::{self, Touch};
use crate::columns::Columns;
use crate::face::FACES;
use crate::record::Records;

/// Rounding of positions about a receiver, relative to the largest coordinate of receivers, with a factor of eight to spare.
pub(super) const POSITION_SLACK: f32 = 1e-6;

/// A triangle as seen from the light: one line.
#[repr(C, align(64))]
pub struct TriangleRecord {
    /// Normals of the planes through the light and the edges 01, 12, 20, each `low x high` by vertex number.
    pub edge_normals: [[f32; 3]; 3],
    /// Normal of the triangle, away from the light.
    pub normal: [f32; 3],
    /// The triangle's plane, `point . normal` of its points, farther by [`plane_slack`](crate::plane::plane_slack).
    pub plane: f32,
    /// Flags of the three edges: the sign bit is set where the triangle lies right of `low -> high`. Those of the first
    /// also hold [`FRONT`], [`BACK`], [`AWAY`] and [`CUTS`]; those of the second the number of its object, where the program asks
    /// for it.
    pub flags: [i32; 3],
}

/// Flag of a triangle that is a layer of the sum F.
pub const FRONT: i32 = 1;
/// Flag of a triangle that is a layer of the sum B.
pub const BACK: i32 = 2;
/// Flag of a triangle that faces away from the light: the determinant of its corners is positive.
pub const AWAY: i32 = 4;
/// Flag of a triangle whose plane cuts the light: of receivers on it, part of the light lies below the horizon.
pub const CUTS: i32 = 8;

/// What binning reads of a triangle, before it asks for any record: where about the light the triangle can hide something.
///
/// A triangle that is [`WITHIN`] a face has its image there too: no receiver that it shadows lies outside of the rectangle `low..high`
/// or is less deep than `start`, be it by rounding. Nobody writes the image of another.
#[repr(C)]
pub struct TriangleBounds {
    /// A bit for each face on which it can hide something from receivers, by number of the face: none if it hides nothing. With one of
    /// them, [`WITHIN`].
    pub faces: i32,
    /// The lower corner of the image.
    pub low: [f32; 2],
    /// The upper corner of the image.
    pub high: [f32; 2],
    /// Least depth of a receiver that the triangle can shadow.
    pub start: f32,
}

/// Flag of a triangle whose image lies inside of one face.
pub const WITHIN: i32 = 1 << FACES;

/// A triangle with all that it hides of any part of the light: one line.
#[repr(C, align(64))]
pub struct WideTriangle {
    /// Its corners, light-centred, in the order of the vertices' numbers: triangles on one edge have it in one direction.
    pub corners: [[f32; 3]; 3],
    /// Normal of the triangle, away from the middle of the light.
    pub normal: [f32; 3],
    /// The triangle's plane, `point . normal` of its points, farther by `slack`.
    pub plane: f32,
    /// What f32 makes of a point on the plane, see [`plane_slack`](crate::plane::plane_slack).
    pub slack: f32,
    /// Least distance of the triangle from the middle of the light.
    pub nearest: f32,
    /// [`FRONT`], [`BACK`] and [`CUTS`]; the sign bit is set where the determinant of the corners, in their order, is negative.
    pub flags: i32,
}

/// A triangle as it is sorted to bins and cells.
pub trait Layer: Sized + 'static {
    /// What receivers are tested with it.
    type Touch<V: Vpu>: Touch<V, Record = Self>;
}

impl Layer for TriangleRecord {
    type Touch<V: Vpu> = touch::Triangle<V>;
}

impl Layer for WideTriangle {
    type Touch<V: Vpu> = touch::Wide<V>;
}

/// An edge as seen from the light: one line.
#[repr(C, align(64))]
pub struct EdgeRecord {
    /// Its ends, the one with the lower vertex number first, light-centred.
    pub ends: [[f32; 3]; 2],
    /// Normal of the plane through the light and the edge, `low x high`.
    pub normal: [f32; 3],
    /// Weights in F and B: counted faces left of the edge less those right of it [algorithms, 2.4].
    pub weights: [i32; 2],
    /// Least distance of the edge from the light.
    pub nearest: f32,
    /// What is added to its part of the light before that is rounded, in (-1/2, 1/2).
    pub rounding_offset: f32,
    /// A bit for each face on which it can have a penumbra.
    pub faces: i32,
    /// Number of its object, where the program asks for it.
    pub object: i32,
}

/// How an edge is seen on the light's disc, and so which receivers it can touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// Each vertex along the receiver's own axis: exact for a disc that faces the receiver [algorithms, 2.5, 2.6].
    #[default]
    Exact,
    /// One circle per edge and receiver, on the image plane of the receiver's face [johnson09, §2.3].
    Printed,
}

/// The light, as constants of the kernels' code.
#[derive(Debug, Clone, Copy)]
pub struct LightConstants {
    /// Its shape; one that is not a disc has its size here too.
    pub shape: LightShape,
    /// Radius of the ball about its middle that holds it, 0 for a point.
    pub radius: f32,
    /// Radius for the bound of a penumbra: larger for a light that does not face the receivers. Rounding comes on top, see
    /// [`LightConstants::rounded_radius`].
    pub bound_radius: f32,
    /// Largest coordinate of vertices and receivers.
    pub largest: f32,
    /// How edges are seen on its disc.
    pub form: Form,
}

impl LightConstants {
    /// The light of a frame.
    pub fn new(input: &ShadowInput) -> LightConstants {
        let shape = input.light_shape;
        // A light that stands still lies in the ball of its radius; the line from p to v meets that ball only if
        // sin phi (1 - r/|p|) <= r (1/|v| - cos phi/|p|), and |p| > |v| > 2.5 r wherever the bound is used.
        let bound_radius =
            if shape == LightShape::Facing { input.light_radius } else { input.light_radius * (5.0 / 3.0) };
        LightConstants {
            shape,
            radius: input.light_radius,
            bound_radius,
            largest: input.largest,
            form: Form::Exact,
        }
    }

    /// The bound of a penumbra's radius before the receivers have been looked at: as if one were as far as anything.
    ///
    /// The receiver is subtracted from the ends of an edge: they are rounded by its distance from the light, which for ends
    /// near the light is as if the light were larger.
    pub fn rounded_radius(&self) -> f32 {
        self.bound_radius + POSITION_SLACK * self.largest
    }

    /// Whether the light has a penumbra at all.
    pub fn is_soft(&self) -> bool {
        self.radius > 0.0
    }
}

/// The primitives of a frame: made by its method, before they are binned.
pub struct Primitives<T = TriangleRecord> {
    /// The light that they are seen from.
    pub light: LightConstants,
    /// Records of the triangles.
    pub triangles: Records<T>,
    /// Bounds of the triangles.
    pub bounds: Columns<TriangleBounds>,
    /// Number of triangles.
    pub triangle_count: u32,
    /// Records of the edges that have a penumbra.
    pub edges: Records<EdgeRecord>,
    /// Number of these edges.
    pub edge_count: u32,
}

impl<T> Clone for Primitives<T> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Primitives<T> {}

/// The two kinds of primitives, whose lists lie one behind the other: triangles of all bins, then edges of all bins; so of
/// the cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Triangles: layers between receiver and light.
    Triangles = 0,
    /// Edges: parts of the light.
    Edges = 1,
}

impl Kind {
    /// Both kinds, in the order of their lists.
    pub const ALL: [Kind; 2] = [Kind::Triangles, Kind::Edges];

    /// The first list of this kind, where each kind has `lists`.
    #[inline(always)]
    pub const fn first_list(self, lists: u32) -> u32 {
        self as u32 * lists
    }
}
