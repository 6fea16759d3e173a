//! Conservative tests of one primitive against 16 rectangles of a face at once: which can hold a receiver that the
//! primitive shadows, and from which depth on.
//!
//! The same tests serve groups, bins, blocks and cells. They may say yes too often, never no: a receiver that is left
//! out would have got exactly 0 from the exact kernels. The slacks below cover rounding only; each is relative, or an
//! angle on the image plane, so nothing depends on the scale of the scene.

use lrbsim_isa::{Vpu, math};

use super::FAR;
use super::faces::Faces;
use super::nodes::Node;
use super::primitives::{self, CUTS, EdgeRecord, LightConstants, TriangleRecord, WideTriangle};
use crate::columns::Columns;
use crate::expression::{each, int};
use crate::face::{FACES, FaceFrame, InFrame, flipped};
use crate::field;
use crate::plane;
use crate::record::{Field, Source};

/// Rounding of a dot product of three terms, relative to the sum of their sizes, with a factor of four to spare.
pub(super) const DOT_SLACK: f32 = 1e-6;

/// Rounding of a cross product, relative to the product of the sums of the sizes of its factors, one of which is a difference; twice
/// what it can be.
pub(super) const CROSS_SLACK: f32 = 5e-7;

/// Rounding of a position on the image plane, whose coordinates are at most about 1.
pub(super) const IMAGE_SLACK: f32 = 1e-6;

/// Rounding of a penumbra's half width, relative.
const WIDTH_SLACK: f32 = 1e-5;

/// Part of an edge's least distance below which its points leave the face's image plane.
const CLIP: f32 = 0.2;

/// A light's radius over an edge's least distance up to which points beyond [`CLIP`] cannot touch the face: those points
/// are more than 78 degrees off the axis and receivers at most 55, and sin(23 degrees) = 0.39... of `|v|` is more
/// than the radius.
const NEAR: f32 = 0.39;

/// A linear form on the image plane: `a x + b y + c`.
struct Form<V: Vpu> {
    a: V::F32,
    b: V::F32,
    /// With the slack added.
    c: V::F32,
    /// Sizes of `a` and `b`; `None` where `c` is greater by what the form grows by from the middle of a rectangle to its corner.
    sizes: Option<[V::F32; 2]>,
}

impl<V: Vpu> Form<V> {
    #[inline(always)]
    fn new(v: &mut V, n: [V::F32; 3]) -> Form<V> {
        let slack = v.vset_f32(DOT_SLACK);
        let size = [v.vabs(n[0]), v.vabs(n[1]), v.vabs(n[2])];
        let sum = v.vadd(size[0], size[1]);
        let sum = v.vadd(sum, size[2]);
        let c = v.vmadd(sum, slack, n[2]);
        Form { a: n[0], b: n[1], c, sizes: Some([size[0], size[1]]) }
    }

    /// This form for rectangles that all have the same `half` width and height.
    #[inline(always)]
    fn over(self, v: &mut V, half: [V::F32; 2]) -> Form<V> {
        let Some(sizes) = self.sizes else { return self };
        let c = v.vmadd(sizes[0], half[0], self.c);
        Form { c: v.vmadd(sizes[1], half[1], c), sizes: None, ..self }
    }

    /// The plane through the light and edge `edge` of `triangle`, its inside positive.
    ///
    /// A component is loaded while the one before is turned, with which it pairs.
    #[inline(always)]
    fn inward<S: Source<V, TriangleRecord>>(
        v: &mut V,
        triangle: S,
        in_frame: &InFrame<V, S>,
        edge: usize,
        sign_bit: V::I32,
    ) -> Form<V> {
        let normal = field!(TriangleRecord.edge_normals[edge]);
        let flag = triangle.int(v, field!(TriangleRecord.flags[edge]));
        let a = in_frame.across(v, normal, 0);
        let flip = v.vand(flag, sign_bit);
        let b = in_frame.across(v, normal, 1);
        let a = flipped(v, a, flip);
        let c = in_frame.depth(v, normal);
        let b = flipped(v, b, flip);
        let c = flipped(v, c, flip);
        Form::new(v, [a, b, c])
    }

    /// Greatest value over 16 rectangles.
    #[inline(always)]
    fn max(&self, v: &mut V, r: &Rectangles<V>) -> V::F32 {
        let at = v.vmadd(self.b, r.y, self.c);
        let at = v.vmadd(self.a, r.x, at);
        match (self.sizes, r.half) {
            (Some(sizes), Some(half)) => {
                let at = v.vmadd(sizes[0], half[0], at);
                v.vmadd(sizes[1], half[1], at)
            }
            _ => at,
        }
    }

    /// As [`Form::max`], over the rectangles of `nodes`, which are loaded meanwhile and returned.
    #[inline(always)]
    fn max_of(&self, v: &mut V, nodes: impl NodeSource<V>) -> (V::F32, Rectangles<V>) {
        let y = nodes.load(v, field!(Node.center[1]));
        let greatest = v.vmadd(self.b, y, self.c);
        let x = nodes.load(v, field!(Node.center[0]));
        let greatest = v.vmadd(self.a, x, greatest);
        let Some(sizes) = self.sizes else { return (greatest, Rectangles { x, y, half: None }) };
        let half_x = nodes.load(v, field!(Node.half[0]));
        let greatest = v.vmadd(sizes[0], half_x, greatest);
        let half_y = nodes.load(v, field!(Node.half[1]));
        let greatest = v.vmadd(sizes[1], half_y, greatest);
        (greatest, Rectangles { x, y, half: Some([half_x, half_y]) })
    }
}

/// The greatest value over rectangles about `middle`, with these halves of width and height, of the form that the product with `normal`
/// is on the image plane.
#[inline(always)]
pub(super) fn greatest_form<V: Vpu>(
    v: &mut V,
    normal: [V::F32; 3],
    middle: [V::F32; 2],
    half: [V::F32; 2],
) -> V::F32 {
    let [x, y] = middle;
    Form::new(v, normal).max(v, &Rectangles { x, y, half: Some(half) })
}

/// A rectangle in each lane.
struct Rectangles<V: Vpu> {
    x: V::F32,
    y: V::F32,
    /// Half of the width and of the height; `None` where the forms have them already, see [`Form::over`].
    half: Option<[V::F32; 2]>,
}

/// Where 16 lanes find what they are told of a node: 16 nodes [`SideBySide`], or [`OneNode`] for all of them.
pub trait NodeSource<V: Vpu>: Copy {
    /// A field of the node.
    fn load(self, v: &mut V, field: Field<Node, f32>) -> V::F32;
}

/// The nodes from `at` on, one in each lane.
pub struct SideBySide<V: Vpu> {
    /// All nodes of their level.
    pub nodes: Columns<Node>,
    /// Number of the first.
    pub at: V::S32,
}

impl<V: Vpu> NodeSource<V> for SideBySide<V> {
    #[inline(always)]
    fn load(self, v: &mut V, field: Field<Node, f32>) -> V::F32 {
        v.vload_f32(self.nodes.column(field), self.at)
    }
}

impl<V: Vpu> Clone for SideBySide<V> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<V: Vpu> Copy for SideBySide<V> {}

/// A node in every lane.
pub struct OneNode<V: Vpu> {
    /// All nodes of its level.
    pub nodes: Columns<Node>,
    /// Number of the node that it is found from.
    pub at: V::S32,
    /// How many nodes it lies behind node `at`: a constant, which costs no uop.
    pub behind: u32,
}

impl<V: Vpu> NodeSource<V> for OneNode<V> {
    #[inline(always)]
    fn load(self, v: &mut V, field: Field<Node, f32>) -> V::F32 {
        v.vbroadcast_f32(self.nodes.column(field).plus_words(u64::from(self.behind)), self.at)
    }
}

impl<V: Vpu> Clone for OneNode<V> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<V: Vpu> Copy for OneNode<V> {}

/// Which rectangles primitives touch, a primitive and a rectangle in each lane, and the least depth of a receiver there that the
/// primitive can shadow.
pub trait Touch<V: Vpu> {
    /// The record that it is set up from.
    type Record;
    /// What a test leaves for [`Touch::most`].
    type Tested;
    /// What [`Touch::start`] asks of all that was tested: the more of it there is, the less deep is the first receiver.
    type Most;
    /// The primitives of `record` in a face's frame.
    fn set_up(v: &mut V, faces: &Faces, frame: &FaceFrame<V>, record: impl Source<V, Self::Record>) -> Self;
    /// These primitives for rectangles that all have the same `half` width and height.
    fn over(self, v: &mut V, half: [V::F32; 2]) -> Self;
    /// Tests the rectangles of `nodes`, or those in the lanes `live`: what lies past the last node is no node.
    fn touch(&self, v: &mut V, nodes: impl NodeSource<V>, live: Option<V::Mask>) -> (V::Mask, Self::Tested);
    /// The most of what tests have left, the last of which is `here` and counts in the lanes it `touched`.
    fn most(v: &mut V, all: Option<Self::Most>, touched: V::Mask, here: Self::Tested) -> Self::Most;
    /// Least depth of a receiver that the primitive can shadow, in the rectangles that `most` is of, if it touches any.
    fn start(&self, v: &mut V, most: Self::Most) -> V::F32;
}

/// The greater of two numbers, or the first, or what is below everything, where the second does not count.
#[inline(always)]
fn more<V: Vpu>(v: &mut V, all: Option<V::F32>, touched: V::Mask, here: V::F32) -> V::F32 {
    let all = match all {
        Some(all) => all,
        None => v.vset_f32(-FAR),
    };
    v.vmax_or(all, touched, all, here)
}

/// A triangle in a face's frame: its three edge planes, turned inward, and its own plane.
pub struct Triangle<V: Vpu> {
    edges: [Form<V>; 3],
    plane: Form<V>,
    distance: V::F32,
}

impl<V: Vpu> Touch<V> for Triangle<V> {
    type Record = TriangleRecord;
    /// The plane's greatest slope over each rectangle.
    type Tested = V::F32;
    type Most = V::F32;

    #[inline(always)]
    fn set_up(v: &mut V, _: &Faces, frame: &FaceFrame<V>, triangle: impl Source<V, TriangleRecord>) -> Self {
        let sign_bit = v.vset_i32(i32::MIN);
        let in_frame = frame.see(v, triangle);
        let edges = each!(edge in [0, 1, 2] => Form::inward(v, triangle, &in_frame, edge, sign_bit));
        let normal = in_frame.vec3(v, field!(TriangleRecord.normal));
        let plane = Form::new(v, normal);
        let distance = triangle.float(v, field!(TriangleRecord.plane));
        Triangle { edges, plane, distance }
    }

    #[inline(always)]
    fn over(self, v: &mut V, half: [V::F32; 2]) -> Self {
        let [first, second, third] = self.edges;
        let edges = [first.over(v, half), second.over(v, half), third.over(v, half)];
        Triangle { edges, plane: self.plane.over(v, half), distance: self.distance }
    }

    #[inline(always)]
    fn touch(&self, v: &mut V, nodes: impl NodeSource<V>, live: Option<V::Mask>) -> (V::Mask, V::F32) {
        // Some point inside each edge plane.
        let (inside, rectangles) = self.edges[0].max_of(v, nodes);
        let zero = v.vset_f32(0.0);
        let mut touched = match live {
            None => v.vcmp_ge(inside, zero),
            Some(live) => v.vcmp_ge_masked(live, inside, zero),
        };
        for edge in &self.edges[1..] {
            let inside = edge.max(v, &rectangles);
            touched = v.vcmp_ge_masked(touched, inside, zero);
        }
        // The deepest receiver beyond the plane.
        let slope = self.plane.max(v, &rectangles);
        let depth = nodes.load(v, field!(Node.depth));
        let beyond = v.vmul(slope, depth);
        // Where there is no receiver the depth is 0, and less than any distance.
        (v.vcmp_ge_masked(touched, beyond, self.distance), slope)
    }

    #[inline(always)]
    fn most(v: &mut V, all: Option<V::F32>, touched: V::Mask, here: V::F32) -> V::F32 {
        more(v, all, touched, here)
    }

    #[inline(always)]
    fn start(&self, v: &mut V, slope: V::F32) -> V::F32 {
        plane_start(v, self.distance, slope)
    }
}

/// Depth at which receivers of a rectangle come to be beyond a triangle's plane at `distance`, whose greatest slope there is `slope`.
#[inline(always)]
pub(super) fn plane_start<V: Vpu>(v: &mut V, distance: V::F32, slope: V::F32) -> V::F32 {
    let inverse = v.vrcp(slope);
    let less = v.vset_f32(1.0 - DOT_SLACK);
    let start = v.vmul(distance, inverse);
    v.vmul(start, less)
}

/// A triangle in a face's frame, and how wide the penumbra about its image is by depth.
///
/// What hides a part of the light from receiver p is a point v of the triangle with **distance <= r (|p'| / z_v - cos phi |v'| / z_p)**
/// between their images, as for an [`Edge`]. The image lies inside of all three edge planes, so that no receiver is farther from it
/// than it is outside of any of them: what is cut off at the corners by a circle is not cut off here.
pub struct Wide<V: Vpu> {
    /// Edge planes, as distances on the image plane: 0 where the plane does not cut that.
    edges: [Form<V>; 3],
    plane: Form<V>,
    distance: V::F32,
    /// The triangle's plane cuts the light: receivers on both sides of it have parts of the light on the other.
    cuts: V::Mask,
    widths: Widths<V>,
}

impl<V: Vpu> Touch<V> for Wide<V> {
    type Record = WideTriangle;
    /// What is left of the widths, and the plane's greatest slope over each rectangle.
    type Tested = (Left<V>, V::F32);
    /// The widths that are left, and the slope.
    type Most = [V::F32; 2];

    #[inline(always)]
    fn set_up(v: &mut V, faces: &Faces, frame: &FaceFrame<V>, record: impl Source<V, WideTriangle>) -> Self {
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let in_frame = frame.see(v, record);
        let corners = each!(corner in [0, 1, 2] => in_frame.vec3(v, field!(WideTriangle.corners[corner])));
        let sign_bit = v.vset_i32(i32::MIN);
        let flags = record.int(v, field!(WideTriangle.flags));
        let negative = v.vand(flags, sign_bit);
        let rounded = v.vset_f32(CROSS_SLACK);
        let edges = each!(edge in [0, 1, 2] => {
            let (start, end) = (corners[edge], corners[(edge + 1) % 3]);
            let normal = plane::edge_normal(v, start, end);
            let along = plane::sub(v, end, start);
            let length2 = v.vmul(normal[1], normal[1]);
            let length2 = v.vmadd(normal[0], normal[0], length2);
            let cuts = v.vcmp_gt(length2, zero);
            let per_length = v.vrsqrt(length2);
            let per_length = v.vblend_f32(cuts, per_length, zero);
            // What rounding may make of the product, of an edge that is seen nearly along itself above all.
            let sizes = [sum_of_sizes(v, start), sum_of_sizes(v, along)];
            let slack = v.vmul(sizes[0], sizes[1]);
            let slack = v.vmul(slack, rounded);
            let slack = v.vmul(slack, per_length);
            let per_length = flipped(v, per_length, negative);
            let per_length = in_frame.mirrored(v, per_length);
            let normal = each!(axis in [0, 1, 2] => v.vmul(normal[axis], per_length));
            let form = Form::new(v, normal);
            Form { c: v.vadd(form.c, slack), ..form }
        });
        let normal = in_frame.vec3(v, field!(WideTriangle.normal));
        let plane = Form::new(v, normal);
        let distance = record.float(v, field!(WideTriangle.plane));
        let cut_bit = v.vset_i32(CUTS);
        let none = v.vset_i32(0);
        let cuts = int!(v, flags & cut_bit);
        let cuts = v.vicmp_neq(cuts, none);

        let least = record.float(v, field!(WideTriangle.nearest));
        let clip = v.vset_f32(CLIP);
        let floor = v.vmul(clip, least);
        let depth = v.vmin(corners[0][2], corners[1][2]);
        let depth = v.vmin(depth, corners[2][2]);
        let depth = v.vmax(depth, floor);
        let per_depth = v.vrcp(depth);
        // The image is no nearer to the axis than the planes are.
        let mut outside = zero;
        for edge in &edges {
            let beyond = v.vsub(zero, edge.c);
            outside = v.vmax(outside, beyond);
        }
        let outside2 = v.vmul(outside, outside);
        let radius = faces.bound_radius(v);
        let bound = v.vset_f32(NEAR);
        let bound = v.vmul(bound, least);
        let everywhere = v.vcmp_ge(radius, bound);
        let near = v.vmul(radius, per_depth);
        let cos = Widths::cos(v, radius, least, [zero, one]);
        let far = Widths::far(v, radius, cos, outside2, one);
        let slack = v.vset_f32(IMAGE_SLACK);
        let widths = Widths::new(v, [near, far, slack]).or_everywhere(v, everywhere, zero);
        Wide { edges, plane, distance, cuts, widths }
    }

    #[inline(always)]
    fn over(self, v: &mut V, half: [V::F32; 2]) -> Self {
        let [first, second, third] = self.edges;
        let edges = [first.over(v, half), second.over(v, half), third.over(v, half)];
        Wide { edges, plane: self.plane.over(v, half), ..self }
    }

    #[inline(always)]
    fn touch(&self, v: &mut V, nodes: impl NodeSource<V>, live: Option<V::Mask>) -> (V::Mask, Self::Tested) {
        let (inside, rectangles) = self.edges[0].max_of(v, nodes);
        let zero = v.vset_f32(0.0);
        let beyond = v.vsub(zero, inside);
        let mut outside = v.vmax(zero, beyond);
        for edge in &self.edges[1..] {
            let inside = edge.max(v, &rectangles);
            let beyond = v.vsub(zero, inside);
            outside = v.vmax(outside, beyond);
        }
        let (touched, left) = self.widths.touch(v, nodes, outside, live);

        // The deepest receiver beyond the plane.
        let slope = self.plane.max(v, &rectangles);
        let depth = nodes.load(v, field!(Node.depth));
        let beyond = v.vmul(slope, depth);
        let is_beyond = v.vcmp_ge(beyond, self.distance);
        let is_beyond = v.kor(is_beyond, self.cuts);
        (v.kand(touched, is_beyond), (left, slope))
    }

    #[inline(always)]
    fn most(
        v: &mut V,
        all: Option<[V::F32; 2]>,
        touched: V::Mask,
        (left, slope): Self::Tested,
    ) -> [V::F32; 2] {
        let (all_left, all_slopes) = match all {
            Some([left, slope]) => (Some(left), Some(slope)),
            None => (None, None),
        };
        let left = left.width(v);
        [more(v, all_left, touched, left), more(v, all_slopes, touched, slope)]
    }

    #[inline(always)]
    fn start(&self, v: &mut V, [left, slope]: [V::F32; 2]) -> V::F32 {
        let start = wedge_start(v, self.widths.far, left);
        let plane_start = plane_start(v, self.distance, slope);
        let zero = v.vset_f32(0.0);
        let plane_start = v.vblend_f32(self.cuts, zero, plane_start);
        v.vmax(start, plane_start)
    }
}

/// The sum of the sizes of the components.
#[inline(always)]
pub(super) fn sum_of_sizes<V: Vpu>(v: &mut V, p: [V::F32; 3]) -> V::F32 {
    let [x, y, z] = each!(axis in [0, 1, 2] => v.vabs(p[axis]));
    let sum = v.vadd(x, y);
    v.vadd(sum, z)
}

/// The image of 16 edges, or of one in every lane, on the plane at depth 1 of a face.
pub(crate) struct Image<V: Vpu> {
    /// Edges of which some is in front of the face; the others have no image.
    pub(crate) in_front: V::Mask,
    /// Image of the first end, and of the second.
    pub(crate) from: [V::F32; 2],
    pub(crate) to: [V::F32; 2],
    /// Depth of each end, and one over it.
    pub(crate) depths: [V::F32; 2],
    pub(crate) per_depths: [V::F32; 2],
}

/// The image of the edge from `a` to `b`, in a face's frame, which comes as near as `least` to the light. What lies off the axis
/// so far that its depth is less than [`CLIP`] of that is cut away.
#[inline(always)]
pub(crate) fn image<V: Vpu>(v: &mut V, mut a: [V::F32; 3], mut b: [V::F32; 3], least: V::F32) -> Image<V> {
    // Clip to what the image plane can hold.
    let clip = v.vset_f32(CLIP);
    let floor = v.vmul(clip, least);
    let a_below = v.vcmp_lt(a[2], floor);
    let b_below = v.vcmp_lt(b[2], floor);
    let none = v.kand(a_below, b_below);
    let in_front = v.knot(none);
    let rise = v.vsub(b[2], a[2]);
    let up = v.vsub(floor, a[2]);
    let t = math::div(v, up, rise);
    for i in 0..2 {
        let span = v.vsub(b[i], a[i]);
        let from = a[i];
        let cut = v.vmadd(span, t, from);
        a[i] = v.vblend_f32(a_below, cut, a[i]);
        b[i] = v.vblend_f32(b_below, cut, b[i]);
    }
    a[2] = v.vmax(a[2], floor);
    b[2] = v.vmax(b[2], floor);

    // Its image.
    let per_a = v.vrcp(a[2]);
    let per_b = v.vrcp(b[2]);
    let from = [v.vmul(a[0], per_a), v.vmul(a[1], per_a)];
    let to = [v.vmul(b[0], per_b), v.vmul(b[1], per_b)];
    Image { in_front, from, to, depths: [a[2], b[2]], per_depths: [per_a, per_b] }
}

/// A silhouette edge in a face's frame: its image, and the half width of its penumbra by depth [algorithms, 2.7].
///
/// Point v touches the penumbra of receiver p only if sin phi <= r (1/|v| - cos phi/|p|). With images v' and p' on the
/// plane at distance 1, |v' x p'| = |v'| |p'| sin phi, and |v| = z_v |v'|, |p| = z_p |p'|, hence
/// **|v' x p'| <= r (|p'| / z_v - cos phi |v'| / z_p)**. The product is their distance on the image plane or more: the more, the farther
/// they lie off the axis and around it from each other, as discs that face receivers have ellipses for images.
///
/// For a disc that lies along the face, [`Form::Printed`](primitives::Form), the footprint on the image plane is a circle, and
/// **distance <= r (1 / z_v - 1 / z_p)**, the quad of [johnson09, §2.2].
pub struct Edge<V: Vpu> {
    from: [V::F32; 2],
    along: [V::F32; 2],
    measure: Measure<V>,
    widths: Widths<V>,
}

/// How the distance of a place from an edge is measured on the image plane.
enum Measure<V: Vpu> {
    /// The measure is the distance; what stands here is one over the square of the edge's length.
    Distance(V::F32),
    /// The measure is the size of the product v' x p', see [`Edge`].
    Product {
        /// Square of the edge's length.
        length2: V::F32,
        /// Greatest |v'|: what the product grows by, at most, for each unit that a place moves.
        growth: V::F32,
    },
}

impl<V: Vpu> Touch<V> for Edge<V> {
    type Record = EdgeRecord;
    type Tested = Left<V>;
    /// The width that is left.
    type Most = V::F32;

    #[inline(always)]
    fn set_up(v: &mut V, faces: &Faces, frame: &FaceFrame<V>, record: impl Source<V, EdgeRecord>) -> Self {
        let zero = v.vset_f32(0.0);
        let one = v.vset_f32(1.0);
        let in_frame = frame.see(v, record);
        let a = in_frame.vec3(v, field!(EdgeRecord.ends[0]));
        let b = in_frame.vec3(v, field!(EdgeRecord.ends[1]));
        let least = record.float(v, field!(EdgeRecord.nearest));
        let radius = faces.bound_radius(v);
        let near = v.vset_f32(NEAR);
        let bound = v.vmul(near, least);
        let everywhere = v.vcmp_ge(radius, bound);

        let Image { in_front, from, to, per_depths: [per_a, per_b], .. } = image(v, a, b, least);
        let along = [v.vsub(to[0], from[0]), v.vsub(to[1], from[1])];
        let length2 = v.vmul(along[1], along[1]);
        let length2 = v.vmadd(along[0], along[0], length2);
        let has_length = v.vcmp_gt(length2, zero);
        let per_length2 = v.vrcp(length2);
        let per_length2 = v.vblend_f32(has_length, per_length2, zero);

        let per_depth = v.vmax(per_a, per_b);
        let near = v.vmul(radius, per_depth);
        let slack = v.vset_f32(IMAGE_SLACK);
        // Ends that lie far off the face round by their own size.
        let mut farthest = one;
        for x in [from[0], from[1], to[0], to[1]] {
            let size = v.vabs(x);
            farthest = v.vmax(farthest, size);
        }
        let slack = v.vmul(farthest, slack);
        if faces.form == primitives::Form::Printed {
            let less = v.vset_f32(1.0 - WIDTH_SLACK);
            let far = v.vmul(radius, less);
            let widths = Widths { is_flat: true, ..Widths::new(v, [near, far, slack]) };
            let measure = Measure::Distance(per_length2);
            return Edge { from, along, measure, widths: widths.unless_behind(v, in_front) };
        }

        // A product rounds by the sizes of both its factors.
        let slack = v.vmul(farthest, slack);
        let [of_from, of_to] = each!(end in [from, to] => {
            let y2 = v.vmadd(end[1], end[1], one);
            v.vmadd(end[0], end[0], y2)
        });
        let growth = v.vmax(of_from, of_to);
        let growth = math::sqrt(v, growth);
        let cos = Widths::cos(v, radius, least, [zero, one]);
        let origin = [v.vsub(zero, from[0]), v.vsub(zero, from[1])];
        let origin_distance2 = distance2(v, origin, along, per_length2, [zero, one]);
        let far = Widths::far(v, radius, cos, origin_distance2, one);
        let widths = Widths::new(v, [near, far, slack]).unless_behind(v, in_front);
        let measure = Measure::Product { length2, growth };
        Edge { from, along, measure, widths: widths.or_everywhere(v, everywhere, zero) }
    }

    #[inline(always)]
    fn over(self, _: &mut V, _: [V::F32; 2]) -> Self {
        self
    }

    /// The distance of what a node holds is that of the middle of its circle less the radius, at least.
    #[inline(always)]
    fn touch(&self, v: &mut V, nodes: impl NodeSource<V>, live: Option<V::Mask>) -> (V::Mask, Left<V>) {
        let middle_x = nodes.load(v, field!(Node.middle[0]));
        let x = v.vsub(middle_x, self.from[0]);
        let middle_y = nodes.load(v, field!(Node.middle[1]));
        let y = v.vsub(middle_y, self.from[1]);
        let zero = v.vset_f32(0.0);
        let one = v.vset_f32(1.0);
        let (distance2, growth) = match self.measure {
            Measure::Distance(per_length2) => {
                (distance2(v, [x, y], self.along, per_length2, [zero, one]), None)
            }
            Measure::Product { length2, growth } => {
                let place = [middle_x, middle_y];
                (product2(v, [x, y], place, self.from, (self.along, length2), [zero, one]), Some(growth))
            }
        };
        let per_distance = v.vrsqrt(distance2);
        let radius = nodes.load(v, field!(Node.radius));
        let distance = v.vmul(distance2, per_distance);
        let distance = match growth {
            None => v.vsub(distance, radius),
            Some(growth) => v.vnmadd(growth, radius, distance),
        };
        // The greater of a NaN and 0 is 0: a middle on the edge itself.
        let distance = v.vmax(distance, zero);
        self.widths.touch(v, nodes, distance, live)
    }

    #[inline(always)]
    fn most(v: &mut V, all: Option<V::F32>, touched: V::Mask, here: Left<V>) -> V::F32 {
        let here = here.width(v);
        more(v, all, touched, here)
    }

    #[inline(always)]
    fn start(&self, v: &mut V, left: V::F32) -> V::F32 {
        wedge_start(v, self.widths.far, left)
    }
}

/// Half widths of the penumbra about the image of a primitive, on the plane at depth 1.
struct Widths<V: Vpu> {
    /// `r / z_v`, for the least depth of the primitive; infinite for one so close to the light that it is taken to touch everything.
    near: V::F32,
    /// `r cos phi |v'|`, for the least of each; 0 for one that touches everything.
    far: V::F32,
    /// Rounding of positions on the image plane; -[`FAR`] for what is behind the face.
    slack: V::F32,
    /// Widths are those of discs along the face and not of discs that face the receivers.
    is_flat: bool,
}

/// What is left of the half width of a penumbra at a rectangle: that at infinite depth, and how far off the rectangle is.
pub struct Left<V: Vpu> {
    widest: V::F32,
    distance: V::F32,
}

impl<V: Vpu> Left<V> {
    /// Half width of the penumbra at infinite depth, less the distance.
    #[inline(always)]
    fn width(self, v: &mut V) -> V::F32 {
        v.vsub(self.widest, self.distance)
    }
}

impl<V: Vpu> Widths<V> {
    /// Widths of discs that face the receivers. `near` gets its rounding here.
    #[inline(always)]
    fn new(v: &mut V, [near, far, slack]: [V::F32; 3]) -> Widths<V> {
        let more = v.vset_f32(1.0 + WIDTH_SLACK);
        let near = v.vmul(near, more);
        Widths { near, far, slack, is_flat: false }
    }

    /// These widths, but less than nothing unless the primitive is `in_front` of the face.
    #[inline(always)]
    fn unless_behind(self, v: &mut V, in_front: V::Mask) -> Widths<V> {
        let none = v.vset_f32(-FAR);
        Widths { slack: v.vblend_f32(in_front, self.slack, none), ..self }
    }

    /// These widths, but wider than anything where the primitive touches `everywhere`, be it behind the face. The constant 0 is the caller's.
    #[inline(always)]
    fn or_everywhere(self, v: &mut V, everywhere: V::Mask, zero: V::F32) -> Widths<V> {
        let all = v.vset_f32(f32::INFINITY);
        let near = v.vblend_f32(everywhere, all, self.near);
        let far = v.vblend_f32(everywhere, zero, self.far);
        Widths { near, far, ..self }
    }

    /// Least cos phi of a primitive that comes as near as `least` to the light. The constants 0 and 1 are the caller's.
    #[inline(always)]
    fn cos(v: &mut V, radius: V::F32, least: V::F32, [zero, one]: [V::F32; 2]) -> V::F32 {
        let per_least = v.vrcp(least);
        let sin = v.vmul(radius, per_least);
        let cos2 = v.vnmadd(sin, sin, one);
        let cos2 = v.vmax(cos2, zero);
        math::sqrt(v, cos2)
    }

    /// [`Widths::far`] of an image whose square distance from the axis is `distance2` or more. The constant 1 is the caller's.
    #[inline(always)]
    fn far(v: &mut V, radius: V::F32, cos: V::F32, distance2: V::F32, one: V::F32) -> V::F32 {
        let reach2 = v.vadd(distance2, one);
        let reach = math::sqrt(v, reach2);
        let far = v.vmul(radius, cos);
        let far = v.vmul(far, reach);
        let less = v.vset_f32(1.0 - WIDTH_SLACK);
        v.vmul(far, less)
    }

    /// Rectangles that the penumbra touches, `distance` or more from the image, and what is left of it there.
    ///
    /// Receivers in a rectangle are at most [`Node::reach`] times their depth from the light. Where there are none it is far below 0,
    /// and one over their depth far above: no width is left.
    #[inline(always)]
    fn touch(
        &self,
        v: &mut V,
        nodes: impl NodeSource<V>,
        distance: V::F32,
        live: Option<V::Mask>,
    ) -> (V::Mask, Left<V>) {
        // Half width of the penumbra at the deepest receiver, at most.
        let widest = if self.is_flat {
            v.vadd(self.near, self.slack)
        } else {
            let reach = nodes.load(v, field!(Node.reach));
            v.vmadd(self.near, reach, self.slack)
        };
        let per_depth = nodes.load(v, field!(Node.per_depth));
        let width = v.vnmadd(self.far, per_depth, widest);
        let touched = match live {
            None => v.vcmp_le(distance, width),
            Some(live) => v.vcmp_le_masked(live, distance, width),
        };
        (touched, Left { widest, distance })
    }
}

/// Wedge test: the least depth of a receiver in a column that a penumbra touches, `far_width / left`, where `left` is the half width at
/// infinite depth less the distance of the column [algorithms, 2.7]. Farther than any receiver where `left` is not
/// positive.
#[inline(always)]
pub fn wedge_start<V: Vpu>(v: &mut V, far_width: V::F32, left: V::F32) -> V::F32 {
    let zero = v.vset_f32(0.0);
    let far = v.vset_f32(FAR);
    let per_left = v.vrcp(left);
    let start = v.vmul(far_width, per_left);
    let reached = v.vcmp_gt(left, zero);
    v.vblend_f32(reached, start, far)
}

/// Faces that can hold a receiver inside the three edge planes of 16 triangles, a bit each by number of the face.
///
/// `inward`: normals of the edge planes, turned inward. Receivers of a face have no coordinate larger than their depth:
/// the test is that of [`Triangle`] for the whole face, all six at once.
#[inline(always)]
pub fn faces_of_triangles<V: Vpu>(v: &mut V, inward: [[V::F32; 3]; 3]) -> V::I32 {
    let slack = v.vset_f32(-DOT_SLACK);
    let mut touched = [v.mask_all(); FACES as usize];
    for normal in inward {
        let size = [v.vabs(normal[0]), v.vabs(normal[1]), v.vabs(normal[2])];
        let sum = v.vadd(size[0], size[1]);
        let sum = v.vadd(sum, size[2]);
        let least = v.vmul(sum, slack);
        for axis in 0..3 {
            let across = v.vsub(sum, size[axis]);
            let ahead = v.vadd(across, normal[axis]);
            let behind = v.vsub(across, normal[axis]);
            touched[2 * axis] = v.vcmp_ge_masked(touched[2 * axis], ahead, least);
            touched[2 * axis + 1] = v.vcmp_ge_masked(touched[2 * axis + 1], behind, least);
        }
    }
    face_bits(v, touched)
}

/// Faces that can hold a receiver whose penumbra an edge or a triangle touches, a bit each by number of the face; 16 of them, by
/// their `N` corners.
///
/// A face lies on one side of each of four planes through the light, `depth +- x >= 0` and `depth +- y >= 0`; no point of
/// the light is beyond such a plane by more than its radius. Hence no point between the light and a receiver of the face
/// is either, and what has all its corners farther out touches none of them.
#[inline(always)]
pub fn faces_of_penumbras<V: Vpu, const N: usize>(
    v: &mut V,
    light: &LightConstants,
    corners: [[V::F32; 3]; N],
) -> V::I32 {
    // Of the sums below, which are sqrt 2 times a distance; wider by their rounding.
    let reach = v.vset_f32(-light.rounded_radius() * (core::f32::consts::SQRT_2 * (1.0 + WIDTH_SLACK)));
    let slack = v.vset_f32(-DOT_SLACK);
    let mut sizes = [slack; N];
    for (size, corner) in sizes.iter_mut().zip(corners) {
        *size = largest(v, corner);
    }
    let size = greatest(v, sizes);
    let reach = v.vmadd(size, slack, reach);
    let zero = v.vset_f32(0.0);
    let mut minus = corners;
    for x in minus.iter_mut().flatten() {
        *x = v.vsub(zero, *x);
    }
    let mut touched = [v.mask_none(); FACES as usize];
    for axis in 0..3 {
        for (face, corners) in [(2 * axis, &corners), (2 * axis + 1, &minus)] {
            let mut here = v.mask_all();
            for other in [(axis + 1) % 3, (axis + 2) % 3] {
                let mut sums = [zero; N];
                for (sum, p) in sums.iter_mut().zip(corners) {
                    *sum = v.vadd(p[axis], p[other]);
                }
                let farthest = greatest(v, sums);
                here = v.vcmp_ge_masked(here, farthest, reach);
                let mut differences = [zero; N];
                for (difference, p) in differences.iter_mut().zip(corners) {
                    *difference = v.vsub(p[axis], p[other]);
                }
                let farthest = greatest(v, differences);
                here = v.vcmp_ge_masked(here, farthest, reach);
            }
            touched[face] = here;
        }
    }
    face_bits(v, touched)
}

/// The greatest of some numbers, lane by lane.
#[inline(always)]
fn greatest<V: Vpu, const N: usize>(v: &mut V, numbers: [V::F32; N]) -> V::F32 {
    let mut greatest = numbers[0];
    for number in &numbers[1..] {
        greatest = v.vmax(greatest, *number);
    }
    greatest
}

/// The largest component.
#[inline(always)]
fn largest<V: Vpu>(v: &mut V, p: [V::F32; 3]) -> V::F32 {
    let size = [v.vabs(p[0]), v.vabs(p[1]), v.vabs(p[2])];
    let yz = v.vmax(size[1], size[2]);
    v.vmax(size[0], yz)
}

/// Masks by face as bits by lane.
#[inline(always)]
fn face_bits<V: Vpu>(v: &mut V, touched: [V::Mask; FACES as usize]) -> V::I32 {
    let mut bits = v.vset_i32(0);
    for (face, touched) in touched.into_iter().enumerate() {
        let bit = v.vset_i32(1 << face);
        bits = v.vor_or(bits, touched, bits, bit);
    }
    bits
}

/// Squared distance of 16 points from an edge's image, both taken from where the image begins: it runs `along`. The constants 0 and 1 are the
/// caller's.
#[inline(always)]
fn distance2<V: Vpu>(
    v: &mut V,
    p: [V::F32; 2],
    along: [V::F32; 2],
    per_length2: V::F32,
    [zero, one]: [V::F32; 2],
) -> V::F32 {
    let t = v.vmul(p[1], along[1]);
    let t = v.vmadd(p[0], along[0], t);
    let t = v.vmul(t, per_length2);
    let t = v.vmax(t, zero);
    let t = v.vmin(t, one);
    let x = v.vnmadd(t, along[0], p[0]);
    let y = v.vnmadd(t, along[1], p[1]);
    let y2 = v.vmul(y, y);
    v.vmadd(x, x, y2)
}

/// Least square of the product v' x p' of 16 places with the points of an edge's image, see [`Edge`]. The image runs `along` from `from` on,
/// whose square length is `length2`; `p` leads from there to the `place`. The constants 0 and 1 are the caller's.
///
/// The product is linear along the edge: a line in space, whose distance from the origin this is.
#[inline(always)]
fn product2<V: Vpu>(
    v: &mut V,
    p: [V::F32; 2],
    place: [V::F32; 2],
    from: [V::F32; 2],
    (along, length2): ([V::F32; 2], V::F32),
    [zero, one]: [V::F32; 2],
) -> V::F32 {
    // Components at the beginning are -p_y, p_x and `around`; along the edge they grow by along_y, -along_x and `growth`.
    let around = v.vmul(from[1], p[0]);
    let around = v.vmsub(from[0], p[1], around);
    let growth = v.vmul(along[1], place[0]);
    let growth = v.vmsub(along[0], place[1], growth);
    let t = v.vmul(p[1], along[1]);
    let t = v.vmadd(p[0], along[0], t);
    let t = v.vnmadd(around, growth, t);
    let length2 = v.vmadd(growth, growth, length2);
    let per_length2 = v.vrcp(length2);
    let t = v.vmul(t, per_length2);
    // The greater of a NaN and 0 is 0: an edge that is seen along itself.
    let t = v.vmax(t, zero);
    let t = v.vmin(t, one);
    let x = v.vnmadd(t, along[0], p[0]);
    let y = v.vnmadd(t, along[1], p[1]);
    let z = v.vmadd(t, growth, around);
    let z2 = v.vmul(z, z);
    let yz2 = v.vmadd(y, y, z2);
    v.vmadd(x, x, yz2)
}
