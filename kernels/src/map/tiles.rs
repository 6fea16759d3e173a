//! Triangles to the tiles of a map: the texels that each may cover, then lists, count → scan → fill.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::layout::{Layout, MapFace, MapSlot};
use crate::clear;
use crate::columns::{lanes_below, take_lane, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::primitives::{BACK, FRONT, TriangleRecord};
use crate::irregular::{FACES, FAR};
use crate::lists::Lists;
use crate::plane::Vec3;
use crate::record::{Records, words};
use crate::scene::{Scene, Triangle};

/// Number of triangles that a task handles.
const TASK: u32 = 256;

/// Lists of a row of tiles.
const ROW: u32 = 16;

/// The box of a triangle that covers no texel.
const NONE: i32 = -1;

/// Nearest depth at which triangles are looked for, in parts of the largest coordinate: those that reach nearer, or behind the light,
/// are cut there to find the texels that they may cover.
const NEAR: f32 = 1e-4;

/// The triangles of each tile.
#[derive(Clone, Copy)]
pub struct Tiles {
    /// Lists of the tiles: 16 for each row of tiles of each square.
    lists: Lists,
    /// The numbers of triangles in these lists.
    items: Addr,
    /// Texels that each triangle may cover.
    pub(super) boxes: Boxes,
}

/// Texels that triangles may cover on each square: the first and the last along each axis, in the low and the high half of a word.
#[derive(Clone, Copy)]
pub struct Boxes {
    words: Addr,
    /// Words for the triangles along one axis of one square.
    stride: u32,
}

impl Boxes {
    /// The word of triangle `number` on the square `slot` along `axis`.
    #[inline(always)]
    pub(super) fn at<V: Vpu>(&self, v: &mut V, slot: V::S32, axis: u32, number: V::S32) -> (Addr, V::S32) {
        let index = scalar!(v, (slot * { 2 * self.stride as i32 }) + number);
        (self.words.plus_words(u64::from(axis * self.stride)), index)
    }
}

/// Sorts triangles to tiles. `largest`: the largest coordinate of all vertices.
pub(super) fn sort(
    scene: &Scene,
    triangles: Records<TriangleRecord>,
    layout: &Layout,
    largest: f32,
    runner: &mut Runner<'_>,
) -> Result<Tiles, Stopped> {
    let tasks = scene.triangle_count.div_ceil(TASK);
    let stride = scene.triangle_count + 16;
    let words = runner.arena.overwritten(u64::from(2 * stride) * u64::from(layout.slot_count));
    let boxes = Boxes { words, stride };
    let kernel = Cover { scene: *scene, triangles, layout: *layout, near: NEAR * largest, boxes };
    // SAFETY: each task writes the boxes of its own triangles.
    runner.run(&unsafe { Step::independent("triangle boxes", tasks, kernel) })?;

    let list_count = layout.slot_count * ROW << layout.tiles_log2();
    let [starts] = clear::zeroed(runner, [Lists::start_words(list_count)])?;
    let lists = Lists::new(runner.arena, starts, list_count, tasks, list_count);
    let sort = |items| Sort { lists, items, boxes, layout: *layout, count: scene.triangle_count };
    runner.run(&Step::ordered("tile counts", tasks, sort(None)))?;
    let items = lists.sum(runner)?;
    let items = runner.arena.overwritten(u64::from(items));
    // SAFETY: each task writes its own table, and items to places that it has taken in `tile counts`.
    runner.run(&unsafe { Step::independent("tile lists", tasks, sort(Some(items))) })?;
    Ok(Tiles { lists, items, boxes })
}

impl Tiles {
    /// First item of a tile, and one past the last.
    #[inline(always)]
    pub(super) fn items_of<V: Vpu>(
        &self,
        v: &mut V,
        layout: &Layout,
        slot: V::S32,
        row: V::S32,
        column: V::S32,
    ) -> [V::S32; 2] {
        let list = list(v, layout, slot, row);
        let list = scalar!(v, list + column);
        each!(after in [0, 1] => v.s_load(self.lists.starts.plus_words(after), list))
    }

    /// The triangle that an item stands for.
    #[inline(always)]
    pub(super) fn triangle<V: Vpu>(&self, v: &mut V, item: V::S32) -> V::S32 {
        v.s_load(self.items, item)
    }
}

/// The first list of a row of tiles.
#[inline(always)]
fn list<V: Vpu>(v: &mut V, layout: &Layout, slot: V::S32, row: V::S32) -> V::S32 {
    scalar!(v, ((slot << { layout.tiles_log2() as i32 }) + row) << { ROW.trailing_zeros() as i32 })
}

/// Finds the texels that triangles may cover.
struct Cover {
    scene: Scene,
    triangles: Records<TriangleRecord>,
    layout: Layout,
    near: f32,
    boxes: Boxes,
}

impl Kernel for Cover {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Cover { scene, layout, boxes, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, scene.triangle_count);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let record_words = v.vset_i32(words::<TriangleRecord>() as i32);
        let layer = v.vset_i32(FRONT | BACK);
        let slots = v.s_imm(layout.slot_count as i32);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let corners =
                each!(k in [0, 1, 2] => v.vload_i32(scene.triangles.column(field!(Triangle.corners[k])), i));
            let corners = each!(k in [0, 1, 2] => scene.positions(v, live, corners[k]));
            // Triangles that are layers of nothing cast no shadow.
            let first = v.vsplat(i);
            let at = int!(v, (first + lane) * record_words);
            let flags =
                v.vgather_i32_or(none, live, self.triangles.field(field!(TriangleRecord.flags[0])), at);
            let layers = int!(v, flags & layer);
            let counted = v.vicmp_neq_masked(live, layers, none);
            let mut slot = v.s_imm(0);
            while v.branch(Compare::Less, slot, slots) {
                let face = v.s_load(layout.slots.column(field!(MapSlot.face)), slot);
                // The code of each face knows its axes.
                for number in 0..FACES {
                    let this = v.s_imm(number as i32);
                    if v.branch(Compare::Equal, face, this) {
                        let words = self.on_face(v, number, counted, corners);
                        for (axis, word) in (0..).zip(words) {
                            let (base, at) = boxes.at(v, slot, axis, i);
                            v.vstore_i32(live, base, at, word);
                        }
                    }
                }
                slot = scalar!(v, slot + 1);
            }
            i = scalar!(v, i + 16);
        }
    }
}

impl Cover {
    /// The texels that 16 triangles may cover on a face, along both axes.
    #[inline(always)]
    fn on_face<V: Vpu>(&self, v: &mut V, face: u32, counted: V::Mask, corners: [Vec3<V>; 3]) -> [V::I32; 2] {
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let near = v.vset_f32(self.near);
        let last = v.vset_f32((self.layout.size - 1) as f32);
        let axis = face as usize / 2;
        let depths = each!(k in [0, 1, 2] => {
            let along = corners[k][axis];
            if face.is_multiple_of(2) { along } else { v.vsub(zero, along) }
        });
        let ahead = each!(k in [0, 1, 2] => v.vcmp_gt(depths[k], near));
        let inverse = each!(k in [0, 1, 2] => v.vrcp_or(one, ahead[k], depths[k]));
        // Where edges pass the nearest depth, as parts of them.
        let passes = each!(k in [0, 1, 2] => v.kxor(ahead[k], ahead[(k + 1) % 3]));
        let some = v.kor(passes[0], passes[1]);
        let some = v.branch_any(some);
        let parts = each!(k in [0, 1, 2] => {
            let along = v.vsub(depths[(k + 1) % 3], depths[k]);
            let along = v.vrcp_or(zero, passes[k], along);
            let to_near = v.vsub(near, depths[k]);
            v.vmul(to_near, along)
        });
        let number = v.s_imm(face as i32);
        let (far, minus_far) = (v.vset_f32(FAR), v.vset_f32(-FAR));
        let per_near = v.vset_f32(1.0 / self.near);
        let mut covers = counted;
        let ranges = each!(plane_axis in [0, 1] => {
            let origin = v.vbroadcast_f32(self.layout.faces.column(field!(MapFace.origin[plane_axis])), number);
            let per_unit =
                v.vbroadcast_f32(self.layout.faces.column(field!(MapFace.per_unit[plane_axis])), number);
            let of = (axis + 1 + plane_axis) % 3;
            let (mut low, mut high) = (far, minus_far);
            for k in 0..3 {
                let place = v.vmul(corners[k][of], inverse[k]);
                low = v.vmin_or(low, ahead[k], low, place);
                high = v.vmax_or(high, ahead[k], high, place);
                if some {
                    let side = v.vsub(corners[(k + 1) % 3][of], corners[k][of]);
                    let place = v.vmadd(side, parts[k], corners[k][of]);
                    let place = v.vmul(place, per_near);
                    low = v.vmin_or(low, passes[k], low, place);
                    high = v.vmax_or(high, passes[k], high, place);
                }
            }
            let low = v.vsub(low, origin);
            let high = v.vsub(high, origin);
            // A texel more than its middle asks for, on either side: the slack of rounding.
            let low = v.vmsub(low, per_unit, one);
            let high = v.vmul(high, per_unit);
            let starts = v.vcmp_le(low, last);
            let ends = v.vcmp_ge(high, zero);
            covers = v.kand(covers, starts);
            covers = v.kand(covers, ends);
            let low = v.vmax(low, zero);
            let low = v.vmin(low, last);
            let high = v.vmax(high, zero);
            let high = v.vmin(high, last);
            [v.vcvt_f32_i32(low), v.vcvt_f32_i32(high)]
        });
        let half = v.vset_i32(16);
        let none = v.vset_i32(NONE);
        each!(plane_axis in [0, 1] => {
            let [low, high] = ranges[plane_axis];
            let word = int!(v, low | (high << half));
            v.vblend_i32(covers, word, none)
        })
    }
}

/// Counts or writes the triangles of the tiles.
struct Sort {
    lists: Lists,
    /// Where the lists are written; `None` where they are counted.
    items: Option<Addr>,
    boxes: Boxes,
    layout: Layout,
    /// Number of triangles.
    count: u32,
}

impl Kernel for Sort {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Sort { lists, items, boxes, layout, count } = self;
        let (first, end) = task_range(v, task, TASK, *count);
        let table = lists.table(v, task);
        if items.is_none() {
            lists.clear_table(v, table);
        }
        let nothing = v.s_imm(0);
        let none = v.vset_i32(NONE);
        let tile_log2 = layout.tile_log2 as i32;
        let slots = v.s_imm(layout.slot_count as i32);
        let mut slot = nothing;
        while v.branch(Compare::Less, slot, slots) {
            let mut i = first;
            while v.branch(Compare::Less, i, end) {
                let live = lanes_below(v, i, end);
                let (base, at) = boxes.at(v, slot, 0, i);
                let columns = v.vload_i32(base, at);
                let covers = v.vicmp_neq_masked(live, columns, none);
                let mut covering = v.kmov_to_scalar(covers);
                while v.branch(Compare::NotEqual, covering, nothing) {
                    let lane = take_lane(v, &mut covering);
                    let number = scalar!(v, i + lane);
                    let [columns, rows] = each!(axis in [0, 1] => {
                        let (base, at) = boxes.at(v, slot, axis, number);
                        v.s_load(base, at)
                    });
                    // The tiles of a row from the first to the last, as a mask.
                    let first_column = scalar!(v, (columns & 0xffff) >> { tile_log2 });
                    let last_column = scalar!(v, columns >> { 16 + tile_log2 });
                    let bits = scalar!(v, (2 << last_column) - (1 << first_column));
                    let touched = v.kmov_from_scalar(bits);
                    let mut row = scalar!(v, (rows & 0xffff) >> { tile_log2 });
                    let last_row = scalar!(v, rows >> { 16 + tile_log2 });
                    while v.branch(Compare::LessEqual, row, last_row) {
                        let list = list(v, layout, slot, row);
                        let at = scalar!(v, table + list);
                        if let Some(items) = *items {
                            let to = lists.place(v, touched, at, list);
                            let number = v.vsplat(number);
                            v.vscatter_i32(touched, items, to, number);
                        } else {
                            lists.add(v, touched, at);
                        }
                        row = scalar!(v, row + 1);
                    }
                }
                i = scalar!(v, i + 16);
            }
            slot = scalar!(v, slot + 1);
        }
        if items.is_none() {
            lists.publish(v, table, nothing);
        }
    }
}
