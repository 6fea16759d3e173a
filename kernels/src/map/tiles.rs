//! What covers texels, sorted to the tiles of a map: lists of the tiles, count → scan → fill.
//!
//! Things are triangles, or whatever else a method draws: all that is known of them is which texels they may cover.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::layout::{Layout, MapFace, MapSlot};
use crate::clear;
use crate::columns::{higher, lanes_below, lower, take_lane, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::lists::Lists;
use crate::segment::Vec2;

/// Number of things that a task handles, unless a method says otherwise.
const TASK: u32 = 256;

/// Lists that are looked at together, those of 16 tiles of a row.
const GROUP: u32 = 16;

/// Groups of a row of tiles.
#[inline(always)]
const fn groups(layout: &Layout) -> u32 {
    (1_u32 << layout.tiles_log2()).div_ceil(GROUP)
}

/// The box of a thing that covers no texel.
const NONE: i32 = -1;

/// What covers each tile.
#[derive(Clone, Copy)]
pub struct Tiles {
    layout: Layout,
    /// Lists of the tiles: whole groups of 16 for each row of tiles of each square.
    lists: Lists,
    /// The numbers of things in these lists, each in ascending order.
    items: Addr,
    /// Number of items of all lists.
    pub item_count: u32,
    /// Texels that each thing may cover.
    boxes: Boxes,
}

/// Texels that things may cover on each square: the first and the last along each axis, in the low and the high half of a word.
#[derive(Clone, Copy)]
pub struct Boxes {
    words: Addr,
    /// Words for the things along one axis of one square.
    stride: u32,
    /// Number of things.
    count: u32,
    /// Number of things that a task sorts.
    task: u32,
}

impl Boxes {
    /// Room for the boxes of `count` things on all squares of `layout`.
    pub fn new(arena: &mut Arena, layout: &Layout, count: u32) -> Boxes {
        let stride = count + 16;
        let words = arena.overwritten(u64::from(2 * stride) * u64::from(layout.slot_count));
        Boxes { words, stride, count, task: TASK }
    }

    /// These boxes, sorted `task` at a time: fewer where each thing covers many tiles.
    pub(crate) fn in_tasks_of(self, task: u32) -> Boxes {
        Boxes { task, ..self }
    }

    /// The word of thing `number` on the square `slot` along `axis`.
    #[inline(always)]
    fn at<V: Vpu>(&self, v: &mut V, slot: V::S32, axis: usize, number: V::S32) -> (Addr, V::S32) {
        let index = scalar!(v, (slot * { 2 * self.stride as i32 }) + number);
        (self.words.plus_words(axis as u64 * u64::from(self.stride)), index)
    }

    /// Stores the boxes of the 16 things from `number` on, on the square `slot` of `face`: those in `covers` reach from `low` to
    /// `high` on the image plane along both axes, and cover nothing where that lies beside the square.
    #[inline(always)]
    pub fn store<V: Vpu>(
        &self,
        v: &mut V,
        layout: &Layout,
        [slot, face]: [V::S32; 2],
        number: V::S32,
        covers: V::Mask,
        reach: [Vec2<V>; 2],
    ) {
        let (covers, ranges) = Boxes::ranges(v, layout, face, covers, reach);
        self.put(v, slot, number, covers, ranges);
    }

    /// The texels that 16 things may cover on the square of `face`, the first and the last along each axis: those in `covers` reach from
    /// `low` to `high` on the image plane. Which of them do not lie beside the square.
    #[inline(always)]
    pub fn ranges<V: Vpu>(
        v: &mut V,
        layout: &Layout,
        face: V::S32,
        covers: V::Mask,
        [low, high]: [Vec2<V>; 2],
    ) -> (V::Mask, [[V::I32; 2]; 2]) {
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let last = v.vset_f32((layout.used - 1) as f32);
        let mut covers = covers;
        let ranges = each!(axis in [0, 1] => {
            let origin = v.vbroadcast_f32(layout.faces.column(field!(MapFace.origin[axis])), face);
            let per_unit = v.vbroadcast_f32(layout.faces.column(field!(MapFace.per_unit[axis])), face);
            let [low, high] = each!(place in [low[axis], high[axis]] => {
                let from = v.vsub(place, origin);
                v.vmul(from, per_unit)
            });
            // Half a texel more than middles ask for, on either side, and what rounding moves where texels are tiny.
            let slack = v.vbroadcast_f32(layout.faces.column(field!(MapFace.slack[axis])), face);
            let low = v.vsub(low, one);
            let low = v.vsub(low, slack);
            let high = v.vadd(high, slack);
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
        (covers, ranges)
    }

    /// Stores the boxes of the 16 things from `number` on, on the square `slot`: those in `covers` may cover these texels, the others
    /// none.
    #[inline(always)]
    pub fn put<V: Vpu>(
        &self,
        v: &mut V,
        slot: V::S32,
        number: V::S32,
        covers: V::Mask,
        ranges: [[V::I32; 2]; 2],
    ) {
        let half = v.vset_i32(16);
        let none = v.vset_i32(NONE);
        let all = v.mask_all();
        for (axis, [low, high]) in ranges.into_iter().enumerate() {
            let word = int!(v, low | (high << half));
            let word = v.vblend_i32(covers, word, none);
            let (base, at) = self.at(v, slot, axis, number);
            v.vstore_i32(all, base, at, word);
        }
    }
}

/// Names of the steps that sort.
pub type Names = [&'static str; 2];

impl Tiles {
    /// Sorts the things of `boxes` to tiles. `names`: of the steps that count and that write.
    pub fn sort(
        boxes: Boxes,
        layout: &Layout,
        names: Names,
        runner: &mut Runner<'_>,
    ) -> Result<Tiles, Stopped> {
        let tasks = boxes.count.div_ceil(boxes.task);
        let list_count = (layout.slot_count * groups(layout) * GROUP) << layout.tiles_log2();
        let [starts] = clear::zeroed(runner, [Lists::start_words(list_count)])?;
        let lists = Lists::new(runner.arena, starts, list_count, tasks, list_count);
        let sort = |items| Sort { lists, items, boxes, layout: *layout };
        runner.run(&Step::ordered(names[0], tasks, sort(None)))?;
        let item_count = lists.sum(runner)?;
        let items = runner.arena.overwritten(u64::from(item_count));
        // SAFETY: each task writes its own table, and items to places that it has taken in the step before.
        runner.run(&unsafe { Step::independent(names[1], tasks, sort(Some(items))) })?;
        Ok(Tiles { layout: *layout, lists, items, item_count, boxes })
    }

    /// First item of a tile, and one past the last.
    #[inline(always)]
    pub fn items_of<V: Vpu>(&self, v: &mut V, tile: &Tile<V>) -> [V::S32; 2] {
        let list = list(v, &self.layout, tile.slot, tile.place[1]);
        let column = tile.place[0];
        let list = scalar!(v, list + column);
        each!(after in [0, 1] => v.s_load(self.lists.starts.plus_words(after), list))
    }

    /// Where the items of all lists begin, by list.
    pub(crate) fn starts(&self) -> Addr {
        self.lists.starts
    }

    /// Number of lists: one for each tile, and empty ones that fill groups.
    pub(crate) fn list_count(&self) -> u32 {
        self.lists.count
    }

    /// Number of the tile whose list is `list`, one that has items.
    #[inline(always)]
    pub(crate) fn tile_of<V: Vpu>(&self, v: &mut V, list: V::S32) -> V::S32 {
        let in_row = (groups(&self.layout) * GROUP) as i32;
        let row = scalar!(v, list >> { in_row.trailing_zeros() as i32 });
        let column = scalar!(v, list & { in_row - 1 });
        scalar!(v, (row << { self.layout.tiles_log2() as i32 }) + column)
    }

    /// The things that the 16 items from `item` on stand for, and which of them may cover texels of the rows `first..=last` of a tile,
    /// counted from its first.
    #[inline(always)]
    pub fn in_rows<V: Vpu>(
        &self,
        v: &mut V,
        tile: &Tile<V>,
        live: V::Mask,
        item: V::S32,
        [first, last]: [V::S32; 2],
    ) -> (V::Mask, V::I32) {
        let none = v.vset_i32(0);
        let start = v.s_imm(0);
        let numbers = v.vload_i32_or(none, live, self.items, item);
        let (base, at) = self.boxes.at(v, tile.slot, 1, start);
        let at = v.vsplat(at);
        let at = int!(v, at + numbers);
        let words = v.vgather_i32_or(none, live, base, at);
        let (half, low_half) = (v.vset_i32(16), v.vset_i32(0xffff));
        let [low, high] = [int!(v, words & low_half), int!(v, words >> half)];
        let [first, last] = [tile.row(v, first), tile.row(v, last)];
        let begins = v.vicmp_ge_masked(live, last, low);
        (v.vicmp_ge_masked(begins, high, first), numbers)
    }

    /// The thing that an item stands for.
    #[inline(always)]
    pub fn number<V: Vpu>(&self, v: &mut V, item: V::S32) -> V::S32 {
        v.s_load(self.items, item)
    }

    /// The texels of a tile that thing `number` may cover, from the tile's first on: the first and the last along both axes.
    #[inline(always)]
    pub fn range<V: Vpu>(&self, v: &mut V, tile: &Tile<V>, number: V::S32) -> [[V::S32; 2]; 2] {
        let nothing = v.s_imm(0);
        let last = v.s_imm((1 << self.layout.tile_log2) - 1);
        each!(axis in [0, 1] => {
            let (base, at) = self.boxes.at(v, tile.slot, axis, number);
            let word = v.s_load(base, at);
            let first = tile.first[axis];
            let low = scalar!(v, (word & 0xffff) - first);
            let high = scalar!(v, (word >> 16) - first);
            [higher(v, low, nothing), lower(v, high, last)]
        })
    }
}

/// A tile of a map.
pub struct Tile<V: Vpu> {
    /// Number of its square.
    pub slot: V::S32,
    /// The face whose square it is.
    pub face: V::S32,
    /// Its column and row in the square.
    place: [V::S32; 2],
    /// Its first texel along both axes.
    first: [V::S32; 2],
    /// Its first word among the texels, and one past its last.
    pub words: [V::S32; 2],
    /// Where texel 0 of the square begins on the image plane, along both axes.
    origin: Vec2<V>,
    /// Width of a texel there.
    unit: Vec2<V>,
}

impl<V: Vpu> Tile<V> {
    /// Tile `number` of all.
    #[inline(always)]
    pub fn new(v: &mut V, layout: &Layout, number: V::S32) -> Tile<V> {
        let (tile_log2, tiles_log2) = (layout.tile_log2 as i32, layout.tiles_log2() as i32);
        let column = scalar!(v, number & { (1 << tiles_log2) - 1 });
        let row = scalar!(v, (number >> { tiles_log2 }) & { (1 << tiles_log2) - 1 });
        let slot = scalar!(v, number >> { 2 * tiles_log2 });
        let begin = scalar!(v, number << { 2 * tile_log2 });
        let end = scalar!(v, begin + { 1 << (2 * tile_log2) });
        let face = v.s_load(layout.slots.column(field!(MapSlot.face)), slot);
        Tile {
            slot,
            face,
            place: [column, row],
            first: [scalar!(v, column << { tile_log2 }), scalar!(v, row << { tile_log2 })],
            words: [begin, end],
            origin: each!(axis in [0, 1] => v.vbroadcast_f32(layout.faces.column(field!(MapFace.origin[axis])), face)),
            unit: each!(axis in [0, 1] => v.vbroadcast_f32(layout.faces.column(field!(MapFace.unit[axis])), face)),
        }
    }

    /// Number of the texel at (x, y), which are counted from the tile's first, among those of its square, row by row.
    #[inline(always)]
    pub(crate) fn number_of(&self, v: &mut V, layout: &Layout, x: V::S32, y: V::S32) -> V::S32 {
        let [first_x, first_y] = self.first;
        scalar!(v, ((first_y + y) << { layout.size.trailing_zeros() as i32 }) + (first_x + x))
    }

    /// Where `texels` begin on the image plane along `axis`; the next one begins where one ends, to the last bit.
    #[inline(always)]
    pub(crate) fn edge(&self, v: &mut V, axis: usize, texels: V::I32) -> V::F32 {
        let texels = v.vcvt_i32_f32(texels);
        self.place(v, axis, texels)
    }

    /// Numbers along the first axis of the 16 texels from `x` on, which is counted from the tile's first.
    #[inline(always)]
    pub fn columns(&self, v: &mut V, x: V::S32) -> V::I32 {
        let lane = v.viota();
        let first = self.first[0];
        let texel = scalar!(v, first + x);
        let texel = v.vsplat(texel);
        int!(v, texel + lane)
    }

    /// Number along the second axis of the texels at `y`, which is counted from the tile's first.
    #[inline(always)]
    pub fn row(&self, v: &mut V, y: V::S32) -> V::I32 {
        let first = self.first[1];
        let texel = scalar!(v, first + y);
        v.vsplat(texel)
    }

    /// Where places on the image plane lie among the columns of the square: a column begins at its number.
    #[inline(always)]
    pub fn column_of(&self, v: &mut V, place: V::F32, per_unit: V::F32) -> V::F32 {
        let from = v.vsub(place, self.origin[0]);
        v.vmul(from, per_unit)
    }

    /// Where the middles of `texels` lie on the image plane along `axis`.
    #[inline(always)]
    pub fn middle(&self, v: &mut V, axis: usize, texels: V::I32) -> V::F32 {
        middle(v, texels, self.unit[axis], self.origin[axis])
    }

    /// The place on the image plane along `axis` that lies `texels` from where texel 0 of the square begins.
    #[inline(always)]
    pub(crate) fn place(&self, v: &mut V, axis: usize, texels: V::F32) -> V::F32 {
        v.vmadd(texels, self.unit[axis], self.origin[axis])
    }

    /// Where its columns begin and end among those of the square.
    #[inline(always)]
    pub fn columns_reach(&self, v: &mut V, layout: &Layout) -> Vec2<V> {
        let first = self.first[0];
        let end = scalar!(v, first + { 1 << layout.tile_log2 });
        each!(column in [first, end] => {
            let column = v.vsplat(column);
            v.vcvt_i32_f32(column)
        })
    }

    /// The word of the texel at (x, y), which are counted from the tile's first.
    #[inline(always)]
    pub fn word(&self, v: &mut V, layout: &Layout, x: V::S32, y: V::S32) -> V::S32 {
        let begin = self.words[0];
        scalar!(v, (begin + x) + (y << { layout.tile_log2 as i32 }))
    }
}

/// Where the middles of texels lie on the image plane, along one axis.
#[inline(always)]
pub fn middle<V: Vpu>(v: &mut V, texel: V::I32, unit: V::F32, origin: V::F32) -> V::F32 {
    let half = v.vset_f32(0.5);
    let texel = v.vcvt_i32_f32(texel);
    let texel = v.vadd(texel, half);
    v.vmadd(texel, unit, origin)
}

/// The first list of a row of tiles.
#[inline(always)]
fn list<V: Vpu>(v: &mut V, layout: &Layout, slot: V::S32, row: V::S32) -> V::S32 {
    let lists = (groups(layout) * GROUP).trailing_zeros() as i32;
    scalar!(v, ((slot << { layout.tiles_log2() as i32 }) + row) << { lists })
}

/// Counts or writes what covers the tiles.
struct Sort {
    lists: Lists,
    /// Where the lists are written; `None` where they are counted.
    items: Option<Addr>,
    boxes: Boxes,
    layout: Layout,
}

impl Kernel for Sort {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Sort { lists, items, boxes, layout } = self;
        let (first, end) = task_range(v, task, boxes.task, boxes.count);
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
                    let mut row = scalar!(v, (rows & 0xffff) >> { tile_log2 });
                    let last_row = scalar!(v, rows >> { 16 + tile_log2 });
                    while v.branch(Compare::LessEqual, row, last_row) {
                        let first_list = list(v, layout, slot, row);
                        for group in 0..groups(layout) as i32 {
                            let touched = scalar!(v, (bits >> { 16 * group }) & 0xffff);
                            if !v.branch(Compare::NotEqual, touched, nothing) {
                                continue;
                            }
                            let touched = v.kmov_from_scalar(touched);
                            let list = scalar!(v, first_list + { 16 * group });
                            let at = scalar!(v, table + list);
                            if let Some(items) = *items {
                                let to = lists.place(v, touched, at, list);
                                let number = v.vsplat(number);
                                v.vscatter_i32(touched, items, to, number);
                            } else {
                                lists.add(v, touched, at);
                            }
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
