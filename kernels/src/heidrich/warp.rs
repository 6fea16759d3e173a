//! Skins as another sample of the light sees them: records for drawing, and the texels that they may cover.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::skins::{LIT, Skins};
use crate::columns::{lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::FACES;
use crate::map::cover::on_face;
use crate::map::layout::{Layout, MapFace, MapSlot};
use crate::map::tiles::{Boxes, middle};
use crate::plane::{Vec3, cross, dot, edge_normal, sub};
use crate::record::{Records, words};
use crate::segment::Vec2;

/// Number of skins that a task handles.
const TASK: u32 = 256;

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
            // What is seen edge-on covers nothing.
            let covers = self.store(v, live, i, corners, lit);
            let mut slot = v.s_imm(0);
            while v.branch(Compare::Less, slot, slots) {
                let face = v.s_load(layout.slots.column(field!(MapSlot.face)), slot);
                // The code of each face knows its axes.
                for number in 0..FACES {
                    let this = v.s_imm(number as i32);
                    if v.branch(Compare::Equal, face, this) {
                        let reach = on_face(v, self.near, number, corners);
                        boxes.store(v, layout, [slot, face], i, covers, reach);
                    }
                }
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

    /// Stores the records of the 16 skins from `i` on; which of them can be seen.
    #[inline(always)]
    fn store<V: Vpu>(
        &self,
        v: &mut V,
        live: V::Mask,
        i: V::S32,
        corners: [Vec3<V>; 3],
        lit: [V::F32; 3],
    ) -> V::Mask {
        let (seen, normals, per_depth) = normals(v, live, corners);
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
        seen
    }
}

/// Normals and reciprocal volumes of 16 skins, as in [`SkinRecord`], and which of these can be seen: not edge-on.
#[inline(always)]
pub fn normals<V: Vpu>(v: &mut V, live: V::Mask, [a, b, c]: [Vec3<V>; 3]) -> (V::Mask, [Vec3<V>; 3], V::F32) {
    let zero = v.vset_f32(0.0);
    // All who share an edge form its normal from the same end, so that between them no texel is left out.
    let [of_a, minus_of_b, of_c] = [edge_normal(v, b, c), edge_normal(v, a, c), edge_normal(v, a, b)];
    let of_b = each!(axis in [0, 1, 2] => v.vsub(zero, minus_of_b[axis]));
    let (ab, ac) = (sub(v, b, a), sub(v, c, a));
    let normal = cross(v, ab, ac);
    let volume = dot(v, a, normal);
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
