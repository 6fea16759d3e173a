//! Skins as another sample of the light sees them: records for drawing, and the texels that they may cover.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::skins::{LIT, Skins};
use crate::columns::{lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::face::turned;
use crate::field;
use crate::irregular::FAR;
use crate::map::cover::on_face;
use crate::map::layout::{Layout, MapFace, MapSlot};
use crate::map::tiles::{Boxes, middle};
use crate::plane::{Vec3, dot, edge_normal};
use crate::record::{Records, words};
use crate::segment::Vec2;

/// Number of skins that a task handles.
const TASK: u32 = 256;

/// Texels along an axis up to which skins are asked whether they cover the middle of any.
const SMALL: i32 = 3;

/// A skin as seen from the sample that it is drawn for.
#[repr(C)]
pub struct SkinRecord {
    /// Normals of the planes through the sample and the edges across from each corner, inward. Their products with a direction are the
    /// weights of the corners where it meets the skin, but for a factor that all have.
    pub normals: [[f32; 3]; 3],
    /// What makes the sum of these products a reciprocal depth.
    pub per_depth: f32,
    /// The corners: first those of the cell, with the corner between them in the middle.
    pub corners: [[f32; 3]; 3],
    /// What is seen of the light at the corners: nothing at those on the occluder, 0, and all at the others, 1.
    pub lit: [f32; 3],
}

/// Makes the records of `skins` as seen from a sample, whose `layout` tells which texels they may cover. `to_sample` leads from there
/// to the sample that sees the skins.
pub(super) fn warp(
    skins: &Skins,
    to_sample: [f32; 3],
    layout: &Layout,
    near: f32,
    runner: &mut Runner<'_>,
) -> Result<(Records<SkinRecord>, Boxes), Stopped> {
    let records = Records::overwritten(runner.arena, u64::from(skins.count) + 16);
    let boxes = Boxes::new(runner.arena, layout, skins.count);
    let kernel = Warp { skins: *skins, to_sample, layout: *layout, near, records, boxes };
    // SAFETY: each task writes the records and the boxes of its own skins.
    runner.run(&unsafe { Step::independent("warp skins", skins.count.div_ceil(TASK), kernel) })?;
    Ok((records, boxes))
}

/// Makes the records of skins.
struct Warp {
    skins: Skins,
    to_sample: [f32; 3],
    layout: Layout,
    near: f32,
    records: Records<SkinRecord>,
    boxes: Boxes,
}

impl Kernel for Warp {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Warp { skins, layout, boxes, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, skins.count);
        let none = v.vset_i32(0);
        let slots = v.s_imm(layout.slot_count as i32);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let numbers = v.vload_i32_or(none, live, skins.list, i);
            let (corners, lit) = self.corners(v, live, numbers);
            let (seen, normals, per_depth) = normals(v, live, corners);
            self.store(v, live, i, SkinRecordOf { normals, per_depth, corners, lit });
            let mut slot = v.s_imm(0);
            while v.branch(Compare::Less, slot, slots) {
                let face = v.s_load(layout.slots.column(field!(MapSlot.face)), slot);
                let [a, b, c] = corners;
                let [of_a, of_b, of_c] = normals;
                let [a, b, c, of_a, of_b, of_c] = turned(v, face, [a, b, c, of_a, of_b, of_c]);
                let reach = on_face(v, self.near, [a, b, c]);
                let weights = [of_a, of_b, of_c];
                let covers = self.reaches_square(v, face, seen, weights);
                let (covers, ranges) = Boxes::ranges(v, layout, face, covers, reach);
                let covers = self.covers_middles(v, face, covers, ranges, weights);
                boxes.put(v, slot, i, covers, ranges);
                slot = scalar!(v, slot + 1);
            }
            i = scalar!(v, i + 16);
        }
    }
}

impl Warp {
    /// Corners of 16 skins as seen from the sample that they are drawn for, and whether all of the light is seen there.
    #[inline(always)]
    fn corners<V: Vpu>(&self, v: &mut V, live: V::Mask, numbers: V::I32) -> ([Vec3<V>; 3], [V::F32; 3]) {
        let map = &self.skins.map;
        let (none, one) = (v.vset_i32(0), v.vset_i32(1));
        let (zero, all_of_it) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let lit_bit = v.vset_i32(LIT);
        let (slot, [x, y], half) = self.skins.place(v, numbers);
        let face = v.vgather_i32_or(none, live, map.layout.slots.column(field!(MapSlot.face)), slot);
        let mut of_face = |field| v.vgather_f32_or(all_of_it, live, map.layout.faces.column(field), face);
        let origin = [of_face(field!(MapFace.origin[0])), of_face(field!(MapFace.origin[1]))];
        let unit = [of_face(field!(MapFace.unit[0])), of_face(field!(MapFace.unit[1]))];
        let farthest = of_face(field!(MapFace.farthest));
        let axes = Orientation::new(v, face);

        // The other corner of the first triangle lies to the right, that of the second below.
        let [right, below] = [int!(v, (x + one) - half), int!(v, y + half)];
        let places = [[x, y], [right, below], [int!(v, x + one), int!(v, y + one)]];
        let corners = each!(k in [0, 1, 2] => {
            let word = map.layout.word(v, slot, places[k]);
            let inverse = v.vgather_f32_or(all_of_it, live, map.texels, word);
            // Where nothing is seen no receiver is hit: nearer than the farthest of them skins need not end.
            let inverse = v.vmax(inverse, farthest);
            let depth = v.vrcp(inverse);
            let place = each!(axis in [0, 1] => middle(v, places[k][axis], unit[axis], origin[axis]));
            let sides = v.vgather_i32_or(none, live, self.skins.sides, word);
            let sides = int!(v, sides & lit_bit);
            let is_lit = v.vicmp_neq(sides, none);
            let lit = v.vblend_f32(is_lit, all_of_it, zero);
            let direction = axes.direction(v, place);
            let corner = each!(axis in [0, 1, 2] => {
                let to_sample = v.vset_f32(self.to_sample[axis]);
                v.vmadd(direction[axis], depth, to_sample)
            });
            (corner, lit)
        });
        (corners.map(|(corner, _)| corner), corners.map(|(_, lit)| lit))
    }

    /// Which of 16 skins are not beside the square of `face` with all of it: boxes of skins that are partly behind the sample are wide.
    /// `weights`: of their corners, on the image plane.
    #[inline(always)]
    fn reaches_square<V: Vpu>(
        &self,
        v: &mut V,
        face: V::S32,
        seen: V::Mask,
        weights: [[V::F32; 3]; 3],
    ) -> V::Mask {
        let half = v.vset_f32(0.5 * self.layout.size as f32);
        let faces = self.layout.faces;
        let halves = each!(axis in [0, 1] => {
            let unit = v.vbroadcast_f32(faces.column(field!(MapFace.unit[axis])), face);
            v.vmul(unit, half)
        });
        let middle = each!(axis in [0, 1] => {
            let origin = v.vbroadcast_f32(faces.column(field!(MapFace.origin[axis])), face);
            v.vadd(origin, halves[axis])
        });
        let mut reaches = seen;
        for weight in weights {
            reaches = meets(v, reaches, weight, middle, halves);
        }
        reaches
    }

    /// Which of 16 skins cover the middle of a texel, as far as they are asked: those that may cover more than [`SMALL`] texels along an
    /// axis are not. Skins from a square of finer texels are many, and most of them lie between the middles.
    #[inline(always)]
    fn covers_middles<V: Vpu>(
        &self,
        v: &mut V,
        face: V::S32,
        covers: V::Mask,
        ranges: [[V::I32; 2]; 2],
        weights: [[V::F32; 3]; 3],
    ) -> V::Mask {
        let (one, small) = (v.vset_i32(1), v.vset_i32(SMALL));
        let mut asked = covers;
        for [first, last] in ranges {
            let more = int!(v, last - first);
            asked = v.vicmp_lt_masked(asked, more, small);
        }
        if !v.branch_any(asked) {
            return covers;
        }
        let faces = self.layout.faces;
        let origin =
            each!(axis in [0, 1] => v.vbroadcast_f32(faces.column(field!(MapFace.origin[axis])), face));
        let unit = each!(axis in [0, 1] => v.vbroadcast_f32(faces.column(field!(MapFace.unit[axis])), face));
        let [[first_x, last_x], [first_y, last_y]] = ranges;
        let mut found = v.kandn(asked, covers);
        let end = v.s_imm(SMALL);
        let mut texel_x = first_x;
        let mut x = v.s_imm(0);
        while v.branch(Compare::Less, x, end) {
            let place_x = middle(v, texel_x, unit[0], origin[0]);
            let at_x = each!(k in [0, 1, 2] => at_x(v, weights[k], place_x));
            let after = int!(v, last_x + one);
            let in_columns = v.vicmp_lt_masked(asked, texel_x, after);
            let mut texel_y = first_y;
            let mut y = v.s_imm(0);
            while v.branch(Compare::Less, y, end) {
                let place_y = middle(v, texel_y, unit[1], origin[1]);
                let after = int!(v, last_y + one);
                let mut inside = v.vicmp_lt_masked(in_columns, texel_y, after);
                let zero = v.vset_f32(0.0);
                for k in 0..3 {
                    let weight = at_y(v, weights[k], at_x[k], place_y);
                    inside = v.vcmp_ge_masked(inside, weight, zero);
                }
                found = v.kor(found, inside);
                texel_y = int!(v, texel_y + one);
                y = scalar!(v, y + 1);
            }
            texel_x = int!(v, texel_x + one);
            x = scalar!(v, x + 1);
        }
        v.kand(found, covers)
    }

    /// Stores the records of the 16 skins from `i` on.
    #[inline(always)]
    fn store<V: Vpu>(&self, v: &mut V, live: V::Mask, i: V::S32, of: SkinRecordOf<V>) {
        let SkinRecordOf { normals, per_depth, corners, lit } = of;
        let lane = v.viota();
        let record_words = v.vset_i32(words::<SkinRecord>() as i32);
        let first = v.vsplat(i);
        let at = int!(v, (first + lane) * record_words);
        for (k, normal) in normals.into_iter().enumerate() {
            for (axis, x) in normal.into_iter().enumerate() {
                v.vscatter_f32(live, self.records.field(field!(SkinRecord.normals[k][axis])), at, x);
            }
        }
        v.vscatter_f32(live, self.records.field(field!(SkinRecord.per_depth)), at, per_depth);
        for k in 0..3 {
            for (axis, x) in corners[k].into_iter().enumerate() {
                v.vscatter_f32(live, self.records.field(field!(SkinRecord.corners[k][axis])), at, x);
            }
            v.vscatter_f32(live, self.records.field(field!(SkinRecord.lit[k])), at, lit[k]);
        }
    }
}

/// The weight of a corner at places of this x, to which that of their y is still to be added. All who ask get the same bits.
#[inline(always)]
pub fn at_x<V: Vpu>(v: &mut V, weight: [V::F32; 3], x: V::F32) -> V::F32 {
    v.vmadd(weight[0], x, weight[2])
}

/// The weight of a corner at places of this y, from [`at_x`].
#[inline(always)]
pub fn at_y<V: Vpu>(v: &mut V, weight: [V::F32; 3], at_x: V::F32, y: V::F32) -> V::F32 {
    v.vmadd(weight[1], y, at_x)
}

/// The fields of 16 records.
struct SkinRecordOf<V: Vpu> {
    normals: [Vec3<V>; 3],
    per_depth: V::F32,
    corners: [Vec3<V>; 3],
    lit: [V::F32; 3],
}

/// Lanes of `live` in which the weight of a corner, which is linear on the image plane, is 0 or more somewhere on the rectangle about
/// `middle` that reaches as far as `halves`.
#[inline(always)]
fn meets<V: Vpu>(v: &mut V, live: V::Mask, weight: [V::F32; 3], middle: Vec2<V>, halves: Vec2<V>) -> V::Mask {
    let zero = v.vset_f32(0.0);
    let mut most = weight[2];
    for axis in 0..2 {
        let slope = v.vabs(weight[axis]);
        most = v.vmadd(weight[axis], middle[axis], most);
        most = v.vmadd(slope, halves[axis], most);
    }
    v.vcmp_ge_masked(live, most, zero)
}

/// Normals and reciprocal volumes of 16 skins, as in [`SkinRecord`], and which of these can be seen: not edge-on.
#[inline(always)]
pub fn normals<V: Vpu>(v: &mut V, live: V::Mask, [a, b, c]: [Vec3<V>; 3]) -> (V::Mask, [Vec3<V>; 3], V::F32) {
    let zero = v.vset_f32(0.0);
    // All who share an edge form its normal from the same end, so that between them no texel is left out.
    let [of_a, minus_of_b, of_c] = [edge_normal(v, b, c), edge_normal(v, a, c), edge_normal(v, a, b)];
    let of_b = each!(axis in [0, 1, 2] => v.vsub(zero, minus_of_b[axis]));
    // Skins are slivers, and most of them nearly edge-on: of the products of a corner and the normal across from it, which are all the
    // volume, the one with the smallest terms has the most digits. It is that across from the edge of one texel.
    let mut volume = zero;
    let mut least = v.vset_f32(FAR);
    for (corner, normal) in [(a, of_a), (b, of_b), (c, of_c)] {
        let product = dot(v, corner, normal);
        let sizes = each!(of in [corner, normal] => each!(axis in [0, 1, 2] => v.vabs(of[axis])));
        let size = dot(v, sizes[0], sizes[1]);
        let smaller = v.vcmp_lt(size, least);
        volume = v.vblend_f32(smaller, product, volume);
        least = v.vmin(size, least);
    }
    let turned = v.vcmp_lt(volume, zero);
    let size = v.vabs(volume);
    let seen = v.vcmp_gt_masked(live, size, zero);
    let per_depth = v.vrcp_or(zero, seen, size);
    let inward = each!(normal in [of_a, of_b, of_c] => {
        each!(axis in [0, 1, 2] => v.vsub_or(normal[axis], turned, zero, normal[axis]))
    });
    (seen, inward, per_depth)
}

/// Which axes the faces of 16 things have.
struct Orientation<V: Vpu> {
    /// Lanes in which the depth is along x, y, z.
    depth: [V::Mask; 3],
    /// Direction of the depth along its axis: 1 or -1.
    sign: V::F32,
}

impl<V: Vpu> Orientation<V> {
    #[inline(always)]
    fn new(v: &mut V, face: V::I32) -> Orientation<V> {
        let (none, one) = (v.vset_i32(0), v.vset_i32(1));
        let (plus, minus) = (v.vset_f32(1.0), v.vset_f32(-1.0));
        let axis = int!(v, face >> one);
        let negative = int!(v, face & one);
        let negative = v.vicmp_neq(negative, none);
        let depth = each!(number in [0, 1, 2] => {
            let number = v.vset_i32(number);
            v.vicmp_eq(axis, number)
        });
        Orientation { depth, sign: v.vblend_f32(negative, minus, plus) }
    }

    /// The direction of depth 1 that leads to a place on the image plane.
    #[inline(always)]
    fn direction(&self, v: &mut V, [x, y]: Vec2<V>) -> Vec3<V> {
        // The axes of the image plane follow that of the depth in cyclic order.
        each!(axis in [0, 1, 2] => {
            let along = v.vblend_f32(self.depth[(axis + 2) % 3], x, y);
            v.vblend_f32(self.depth[axis], self.sign, along)
        })
    }
}
