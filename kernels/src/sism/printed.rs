//! The form of the method that is printed: one circle per edge and receiver, on the light's image plane [johnson09, §2.3].
//!
//! ```text
//! images   of each edge on each face that sees receivers: where it begins, which way and how far it runs, how deep it lies
//! soft     of each edge and receiver: q, the point of the edge next to the receiver on the image plane; the radius of the light's
//!          footprint there, R = r (z_p - z_q) / (z_p z_q); the part of that circle beyond the edge
//! ```
//!
//! The paper has one view from the light. Here the view of a receiver is that of its face of the grid: depth is its largest
//! component about the light, and its light the disc of radius r that lies along the face. What the paper leaves open is read as it must
//! be read to be right [algorithms, 2.2, 2.3]: lengths count in R, the sides of an edge are those of `hard`, and the ends of an
//! edge are measured from the foot of the perpendicular, with their signs, and cut to the circle.
//!
//! What it gives up against `exact`: one depth stands for all of an edge, which does harm where a steep edge lies under a large
//! light [algorithms, 2.5]; the footprint is a circle where it ought to be an ellipse, the more the farther a receiver lies off
//! its face's axis, so that penumbras have seams where faces meet [algorithms, 2.6].

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu};

use crate::columns::{Columns, lanes_below, take_lane, task_range};
use crate::expression::{each, int, scalar};
use crate::face::{FACES, turned};
use crate::field;
use crate::irregular::FAR;
use crate::irregular::faces::BinPlace;
use crate::irregular::grid::Grid;
use crate::irregular::primitives::{EdgeRecord, Primitives};
use crate::irregular::run::Samples;
use crate::irregular::touch;
use crate::plane::Vec3;
use crate::record::{Record, Records, words};
use crate::segment::{Angle, chord, on_chord, stretch};

/// Number of edges that a task handles.
const TASK: u32 = 256;

/// Square of the longest image: that of an edge through the middle of the light is left out.
const LENGTH2_MAX: f32 = 1e36;

/// An edge on the image plane of a face: half a line. One that is not in front of the face has no length.
#[repr(C, align(32))]
pub struct Image {
    /// Where the edge begins: the image of the end that lies nearer to the face's axis, whose position is the more exact.
    pub from: [f32; 2],
    /// Direction to the other end, a unit vector.
    pub along: [f32; 2],
    /// Length of the image.
    pub length: f32,
    /// Depth where the edge begins.
    pub depth: f32,
    /// By what part of itself one over that depth grows per unit of length: along a projected edge it is linear [algorithms, 2.2].
    pub slope: f32,
}

/// Images of all edges, and what tells the face of a receiver.
#[derive(Clone, Copy)]
pub struct Printed {
    /// Images of the edges on face 0, then on face 1, and so on; of a face that sees no receivers nobody writes them.
    pub images: Records<Image>,
    /// Edges of each face.
    edge_count: u32,
    /// Where each bin lies.
    bin_places: Columns<BinPlace>,
    /// One over the radius of the light.
    per_radius: f32,
}

/// 16 receivers of one face on its image plane.
pub struct Plane<V: Vpu> {
    place: [V::F32; 2],
    /// Depth of the receivers.
    depth: V::F32,
    /// Depth in radii of the light.
    radii: V::F32,
    /// Number of the first image of their face.
    first_image: V::S32,
}

impl Printed {
    /// Finds the images of all edges on the faces that see receivers.
    pub fn build(primitives: &Primitives, grid: &Grid, runner: &mut Runner<'_>) -> Result<Printed, Stopped> {
        let edge_count = primitives.edge_count;
        let images = Records::overwritten(runner.arena, u64::from(FACES) * u64::from(edge_count));
        let kernel = Images { edges: primitives.edges, edge_count, grid: *grid, images };
        // SAFETY: each task writes the images of its own edges.
        runner.run(&unsafe { Step::independent("edge images", edge_count.div_ceil(TASK), kernel) })?;
        let per_radius = 1.0 / primitives.light.radius;
        Ok(Printed { images, edge_count, bin_places: grid.faces.bin_places, per_radius })
    }

    /// The image plane of `samples`.
    #[inline(always)]
    pub fn plane<V: Vpu>(&self, v: &mut V, samples: &Samples<V>) -> Plane<V> {
        let block = samples.block;
        let bin = scalar!(v, block >> 4);
        let face = v.s_load(self.bin_places.column(field!(BinPlace.face)), bin);
        let axis = scalar!(v, face >> 1);
        // Code for each axis: registers have no numbers.
        let mut number = 0;
        while number < 2 {
            let this = v.s_imm(number as i32);
            if v.branch(Compare::Equal, axis, this) {
                break;
            }
            number += 1;
        }
        let first_image = scalar!(v, face * { self.edge_count as i32 });
        self.plane_along(v, number, samples.position, first_image)
    }

    /// The image plane of receivers at `points` on a face along `axis`.
    #[inline(always)]
    fn plane_along<V: Vpu>(&self, v: &mut V, axis: usize, points: Vec3<V>, first_image: V::S32) -> Plane<V> {
        let depth = v.vabs(points[axis]);
        let per_depth = v.vrcp(depth);
        let place = [(axis + 1) % 3, (axis + 2) % 3];
        let place = [v.vmul(points[place[0]], per_depth), v.vmul(points[place[1]], per_depth)];
        let per_radius = v.vset_f32(self.per_radius);
        let radii = v.vmul(depth, per_radius);
        Plane { place, depth, radii, first_image }
    }

    /// The image plane of receivers at `points`, all of which lie on face `face`.
    #[inline(always)]
    pub fn plane_of_face<V: Vpu>(&self, v: &mut V, face: u32, points: Vec3<V>) -> Plane<V> {
        let first_image = v.s_imm((face * self.edge_count) as i32);
        self.plane_along(v, face as usize / 2, points, first_image)
    }

    /// The signed part that edge `number` makes, but for its sign: that of each receiver's circle beyond the edge; the lanes of
    /// `live` where the edge cuts it. 34 operations where the edge's line misses all circles, 85 for a part.
    #[inline(always)]
    pub fn part<V: Vpu>(
        &self,
        v: &mut V,
        plane: &Plane<V>,
        live: V::Mask,
        number: V::S32,
        angle: Angle,
    ) -> Option<(V::Mask, V::F32)> {
        let first = plane.first_image;
        let number = scalar!(v, first + number);
        let image = self.images.record(v, number);
        part(v, plane, live, image, angle)
    }
}

/// The part of receivers' circles that is beyond an edge's image, see [`Printed::part`].
#[inline(always)]
fn part<V: Vpu>(
    v: &mut V,
    plane: &Plane<V>,
    live: V::Mask,
    image: Record<V, Image>,
    angle: Angle,
) -> Option<(V::Mask, V::F32)> {
    let zero = v.vset_f32(0.0);
    let one = v.vset_f32(1.0);
    let from = each!(axis in [0, 1] => image.float(v, field!(Image.from[axis])));
    let along = each!(axis in [0, 1] => image.float(v, field!(Image.along[axis])));
    let length = image.float(v, field!(Image.length));

    // How far along the edge the foot of the perpendicular lies, and how far off its line the receiver.
    let off = [v.vsub(plane.place[0], from[0]), v.vsub(plane.place[1], from[1])];
    let foot = v.vmul(off[1], along[1]);
    let foot = v.vmadd(off[0], along[0], foot);
    let distance = v.vmul(off[1], along[0]);
    let distance = v.vmsub(off[0], along[1], distance);

    // The point q next to the receiver, and one over the footprint's radius there. Its depth is z / (1 + g), where the edge
    // begins at z; what it is nearer than the receiver comes from differences, so that digits are left near contact
    // [algorithms, 2.2].
    let nearest = v.vmax(foot, zero);
    let nearest = v.vmin(nearest, length);
    let begin = image.float(v, field!(Image.depth));
    let slope = image.float(v, field!(Image.slope));
    let growth = v.vmul(nearest, slope);
    let grown = v.vadd(growth, one);
    let per_grown = v.vrcp(grown);
    let depth = v.vmul(begin, per_grown);
    let between = v.vsub(plane.depth, begin);
    let between = v.vmadd(depth, growth, between);
    let per_between = v.vrcp(between);
    let per_radius = v.vmul(plane.radii, depth);
    let per_radius = v.vmul(per_radius, per_between);

    // Is q in front of the receiver, and does the line cut the circle?
    let live = v.vcmp_gt_masked(live, between, zero);
    let distance = v.vabs(distance);
    let d = v.vmul(distance, per_radius);
    let live = v.vcmp_lt_masked(live, d, one);
    if !v.branch_any(live) {
        return None;
    }

    // The ends of the edge, from the foot of the perpendicular.
    let d2 = v.vmul(d, d);
    let chord = chord(v, d2, [zero, one]);
    let a = v.vnmadd(foot, per_radius, zero);
    let a = on_chord(v, a, chord);
    let left = v.vsub(length, foot);
    let b = v.vmul(left, per_radius);
    let b = on_chord(v, b, chord);
    stretch(v, live, [d, d2], [a, b], angle, zero)
}

/// Finds the images of edges on the faces that see receivers.
struct Images {
    edges: Records<EdgeRecord>,
    edge_count: u32,
    grid: Grid,
    images: Records<Image>,
}

impl Kernel for Images {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.edge_count);
        let seen = self.grid.faces.seen(v);
        let lane = v.viota();
        let zero = v.vset_f32(0.0);
        let record_words = v.vset_i32(words::<EdgeRecord>() as i32);
        let image_words = v.vset_i32(words::<Image>() as i32);
        let nothing = v.s_imm(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let base = v.vsplat(i);
            let number = int!(v, base + lane);
            let at = int!(v, number * record_words);
            let mut gather = |field| v.vgather_f32_or(zero, live, self.edges.field(field), at);
            let [a, b] = each!(end in [0, 1] => {
                each!(axis in [0, 1, 2] => gather(field!(EdgeRecord.ends[end]).at(axis)))
            });
            let least = gather(field!(EdgeRecord.nearest));
            let to = int!(v, number * image_words);
            let mut faces = seen;
            while v.branch(Compare::NotEqual, faces, nothing) {
                let face = take_lane(v, &mut faces);
                let ends = turned(v, face, [a, b]);
                let first = scalar!(v, face * { (self.edge_count * words::<Image>()) as i32 });
                let first = v.vsplat(first);
                let to = int!(v, first + to);
                self.image(v, live, to, ends, least);
            }
            i = scalar!(v, i + 16);
        }
    }
}

impl Images {
    /// Leaves the images of 16 edges between `ends`, in the frame of a face, at words `to`.
    #[inline(always)]
    fn image<V: Vpu>(&self, v: &mut V, live: V::Mask, to: V::I32, [a, b]: [Vec3<V>; 2], least: V::F32) {
        let zero = v.vset_f32(0.0);
        let image = touch::image(v, a, b, least);
        let mut size2 = |p: [V::F32; 2]| {
            let y2 = v.vmul(p[1], p[1]);
            v.vmadd(p[0], p[0], y2)
        };
        let sizes = [size2(image.from), size2(image.to)];
        let swapped = v.vcmp_gt(sizes[0], sizes[1]);
        let mut either = |x, y| [v.vblend_f32(swapped, y, x), v.vblend_f32(swapped, x, y)];
        let [from_x, to_x] = either(image.from[0], image.to[0]);
        let [from_y, to_y] = either(image.from[1], image.to[1]);
        let [from_depth, to_depth] = either(image.depths[0], image.depths[1]);
        let [_, per_to] = either(image.per_depths[0], image.per_depths[1]);

        let along = [v.vsub(to_x, from_x), v.vsub(to_y, from_y)];
        let length2 = v.vmul(along[1], along[1]);
        let length2 = v.vmadd(along[0], along[0], length2);
        let most = v.vset_f32(LENGTH2_MAX);
        let has_length = v.vcmp_gt_masked(image.in_front, length2, zero);
        let has_length = v.vcmp_lt_masked(has_length, length2, most);
        let per_length = v.vrsqrt(length2);
        let length = v.vmul(length2, per_length);
        let nearer = v.vsub(from_depth, to_depth);
        let growth = v.vmul(nearer, per_to);
        let slope = v.vmul(growth, per_length);
        let along = [v.vmul(along[0], per_length), v.vmul(along[1], per_length)];
        let values = [
            (field!(Image.from[0]), from_x),
            (field!(Image.from[1]), from_y),
            (field!(Image.along[0]), along[0]),
            (field!(Image.along[1]), along[1]),
            (field!(Image.length), length),
            (field!(Image.slope), slope),
        ];
        for (field, value) in values {
            let value = v.vblend_f32(has_length, value, zero);
            v.vscatter_f32(live, self.images.field(field), to, value);
        }
        // What has no length is in front of no receiver.
        let far = v.vset_f32(FAR);
        let depth = v.vblend_f32(has_length, from_depth, far);
        v.vscatter_f32(live, self.images.field(field!(Image.depth)), to, depth);
    }
}
