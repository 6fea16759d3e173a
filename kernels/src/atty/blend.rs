//! The soft shadow map: what all patches hide of the light, added up texel by texel.
//!
//! ```text
//! fixed point   tasks take equal shares of all items, whatever tiles these are of, add up a tile in words of their own, and then
//!               those to the map by atomics: sums of whole numbers do not depend on the order
//! floats        patches are added in their order, as a graphics card blends them: a task adds the next few of its tile, step by
//!               step, until the longest list is done
//! ```

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::geometry::{Numbers, reach};
use super::patch::{Extent, Floor, Patch, Patches};
use crate::clear;
use crate::columns::lower;
use crate::expression::{each, int, scalar};
use crate::field;
use crate::map::tiles::Tile;
use crate::sism::kept::Kept;

/// Uops of a task where each of its patches reaches all of its tile.
const TASK_UOPS: u32 = 60_000;

/// Uops that 16 texels take for a patch in fixed point; how many more floats of 16 bits do, and the cut of [`Extent::Occluder`].
const ROW_UOPS: [u32; 3] = [40, 45, 12];

/// All of the light, in fixed point, of which a word holds 127.
///
/// A sum does not come near to that, whatever overlaps: a patch r texels beside a receiver touches its view of the light only if
/// that is 2 r - 1 texels wide there, and so hides no more than a part of 1 / (2 r - 1)^2. There are 8 r such patches, and the sum
/// over all r grows as the logarithm of the map's size.
pub(super) const WHOLE: f32 = (1 << 24) as f32;

/// How patches are added up.
#[derive(Clone, Copy)]
pub(super) struct Blend {
    /// Half of the light's width along both axes.
    pub halves: [f32; 2],
    /// What sums are kept in.
    pub kept: Kept,
    pub extent: Extent,
}

impl Blend {
    /// Adds up the patches; the sums of all texels, in words of the format.
    pub(super) fn run(
        self,
        patches: &Patches,
        floor: &Floor,
        runner: &mut Runner<'_>,
    ) -> Result<Addr, Stopped> {
        let [sums] = clear::zeroed(runner, [floor.layout.texel_count()])?;
        let adder = Adder { blend: self, patches: *patches, floor: *floor };
        let tile_words = 1_u32 << (2 * floor.layout.tile_log2);
        let is_short = matches!(self.kept, Kept::F16 | Kept::F16Truncating);
        let is_cut = self.extent == Extent::Occluder;
        let [row, short, cut] = ROW_UOPS;
        let of_row = row + u32::from(is_short) * short + u32::from(is_cut) * cut;
        // Number of patches that a task adds.
        let share = TASK_UOPS / (of_row * tile_words / 16);
        if self.kept == Kept::Fixed {
            let tasks = patches.tiles.item_count.div_ceil(share);
            let own = runner.arena.overwritten(u64::from(tasks) * u64::from(tile_words));
            // SAFETY: each task writes words of its own, and adds to sums.
            return runner
                .run(&unsafe { Step::independent("blend", tasks, Shares { adder, share, own, sums }) })
                .map(|()| sums);
        }
        let longest = runner.arena.overwritten(16);
        runner.run(&Step::ordered("longest list", 1, Longest { patches: *patches, longest }))?;
        let longest = runner.arena.read_u32(longest);
        for first in (0..longest).step_by(share as usize) {
            // SAFETY: each task writes the sums of its own tile.
            runner.run(&unsafe {
                Step::independent("blend", floor.layout.tile_count(), Turns { adder, first, share, sums })
            })?;
        }
        Ok(sums)
    }
}

/// Finds how many patches the longest of the lists has.
struct Longest {
    patches: Patches,
    longest: Addr,
}

impl Kernel for Longest {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, only: V::S32) {
        let tiles = &self.patches.tiles;
        let end = v.s_imm(tiles.list_count() as i32);
        let mut list = v.s_imm(0);
        let mut longest = list;
        let mut begin = v.s_load(tiles.starts(), list);
        while v.branch(Compare::Less, list, end) {
            let after = v.s_load(tiles.starts().plus_words(1), list);
            let length = scalar!(v, after - begin);
            if v.branch(Compare::Less, longest, length) {
                longest = length;
            }
            begin = after;
            list = scalar!(v, list + 1);
        }
        v.s_store(self.longest, only, longest);
    }
}

/// Adds equal shares of all items.
struct Shares {
    adder: Adder,
    /// Number of items of a task.
    share: u32,
    /// Words for the texels of a tile, by task.
    own: Addr,
    sums: Addr,
}

impl Kernel for Shares {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Shares { adder, own, .. } = self;
        let tiles = &adder.patches.tiles;
        let layout = &adder.floor.layout;
        let mut item = scalar!(v, task * { self.share as i32 });
        let end = scalar!(v, item + { self.share as i32 });
        let count = v.s_imm(tiles.item_count as i32);
        let end = lower(v, end, count);
        let own_first = scalar!(v, task << { 2 * layout.tile_log2 as i32 });
        let own_end = scalar!(v, own_first + { 1 << (2 * layout.tile_log2) });
        clear::clear_lines(v, *own, own_first, own_end);
        let mut list = self.list_of(v, item);
        while v.branch(Compare::Less, item, end) {
            // The next list that has items.
            let mut list_end = v.s_load(tiles.starts().plus_words(1), list);
            while v.branch(Compare::LessEqual, list_end, item) {
                list = scalar!(v, list + 1);
                list_end = v.s_load(tiles.starts().plus_words(1), list);
            }
            let until = lower(v, list_end, end);
            let number = tiles.tile_of(v, list);
            let tile = Tile::new(v, layout, number);
            let [tile_first, _] = tile.words;
            let to_own = scalar!(v, own_first - tile_first);
            while v.branch(Compare::Less, item, until) {
                adder.add(v, &tile, item, *own, to_own);
                item = scalar!(v, item + 1);
            }
            self.hand_over(v, own_first, tile_first);
        }
    }
}

impl Shares {
    /// The list that holds an item: the last that does not begin after it.
    #[inline(always)]
    fn list_of<V: Vpu>(&self, v: &mut V, item: V::S32) -> V::S32 {
        let tiles = &self.adder.patches.tiles;
        let mut low = v.s_imm(0);
        let mut high = v.s_imm(tiles.list_count() as i32);
        let one = v.s_imm(1);
        let mut left = scalar!(v, high - low);
        while v.branch(Compare::Less, one, left) {
            let middle = scalar!(v, (low + high) >> 1);
            let start = v.s_load(tiles.starts(), middle);
            if v.branch(Compare::LessEqual, start, item) {
                low = middle;
            } else {
                high = middle;
            }
            left = scalar!(v, high - low);
        }
        low
    }

    /// Adds the own words of the task to those of the tile, and clears them.
    #[inline(always)]
    fn hand_over<V: Vpu>(&self, v: &mut V, own_first: V::S32, tile_first: V::S32) {
        let Shares { adder, own, sums, .. } = self;
        let none = v.vset_i32(0);
        let all = v.mask_all();
        let lane = v.viota();
        let mut from = own_first;
        let end = scalar!(v, from + { 1 << (2 * adder.floor.layout.tile_log2) });
        let mut to = tile_first;
        while v.branch(Compare::Less, from, end) {
            let sum = v.vload_i32(*own, from);
            let some = v.vicmp_neq(sum, none);
            if v.branch_any(some) {
                let at = v.vsplat(to);
                let at = int!(v, at + lane);
                v.vatomic_add_or(none, some, *sums, at, sum);
                v.vstore_i32(all, *own, from, none);
            }
            from = scalar!(v, from + 16);
            to = scalar!(v, to + 16);
        }
    }
}

/// Adds some patches of each tile, from the one of number `first` in its list on.
struct Turns {
    adder: Adder,
    first: u32,
    /// Number of items of a task.
    share: u32,
    sums: Addr,
}

impl Kernel for Turns {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let tiles = &self.adder.patches.tiles;
        let tile = Tile::new(v, &self.adder.floor.layout, task);
        let [begin, end] = tiles.items_of(v, &tile);
        let mut item = scalar!(v, begin + { self.first as i32 });
        let until = scalar!(v, item + { self.share as i32 });
        let until = lower(v, until, end);
        let nothing = v.s_imm(0);
        while v.branch(Compare::Less, item, until) {
            self.adder.add(v, &tile, item, self.sums, nothing);
            item = scalar!(v, item + 1);
        }
    }
}

/// What adds a patch to the sums of a tile.
#[derive(Clone, Copy)]
struct Adder {
    blend: Blend,
    patches: Patches,
    floor: Floor,
}

impl Adder {
    /// Adds what the patch of an item hides, seen from the receivers of a tile, to words at `to`, whose number is that of the texel
    /// in the map and `offset` more.
    #[inline(always)]
    fn add<V: Vpu>(&self, v: &mut V, tile: &Tile<V>, item: V::S32, to: Addr, offset: V::S32) {
        let Adder { blend, patches, floor } = self;
        let Floor { layout, texels, deepest } = floor;
        let number = patches.tiles.number(v, item);
        let slot = tile.slot;
        let record = scalar!(v, (slot << { patches.square_log2 as i32 }) + number);
        let patch = patches.records.record(v, record);
        let low = each!(axis in [0, 1] => patch.float(v, field!(Patch.low[axis])));
        let high = each!(axis in [0, 1] => patch.float(v, field!(Patch.high[axis])));
        let depth = patch.float(v, field!(Patch.depth));
        let rounding_offset = patch.float(v, field!(Patch.rounding_offset));
        let farthest = v.vbroadcast_f32(*deepest, slot);
        let per_width = each!(axis in [0, 1] => v.vset_f32(0.5 / blend.halves[axis]));
        let whole = v.vset_f32(WHOLE);
        let (half, one) = (v.vset_f32(0.5), v.vset_f32(1.0));
        let numbers = Numbers::new(v);
        let all = v.mask_all();

        let [[low_x, last_x], [low_y, last_y]] = patches.tiles.range(v, tile, number);
        let mut x = scalar!(v, (low_x >> 4) << 4);
        while v.branch(Compare::LessEqual, x, last_x) {
            let columns = tile.columns(v, x);
            let place_x = tile.middle(v, 0, columns);
            let in_x = self.in_rectangle(v, 0, [low[0], high[0]], place_x, depth, farthest);
            let from_x = [v.vsub(low[0], place_x), v.vsub(high[0], place_x)];
            let row = tile.row(v, low_y);
            let row = v.vcvt_i32_f32(row);
            let mut middle = v.vadd(row, half);
            let mut at = tile.word(v, layout, x, low_y);
            let mut to_at = scalar!(v, at + offset);
            let mut y = low_y;
            while v.branch(Compare::LessEqual, y, last_y) {
                let place_y = tile.place(v, 1, middle);
                let from_y = [v.vsub(low[1], place_y), v.vsub(high[1], place_y)];
                // Where the map shows no receiver, it is taken to be as deep as the deepest.
                let receiver = v.vload_f32(*texels, at);
                let receiver = v.vmax(receiver, farthest);
                // The patch on the light.
                let per_place = numbers.per_place(v, depth, receiver);
                let [part_x, part_y] = each!(axis in [0, 1] => {
                    let per_place = v.vmul(per_place, per_width[axis]);
                    let from = [from_x, from_y][axis];
                    let [a, b] = each!(end in [0, 1] => numbers.reprojected(v, from[end], per_place));
                    numbers.between(v, a, b)
                });
                let mut part = v.vmul(part_x, part_y);
                if let Some(in_x) = in_x {
                    let in_y = self.in_rectangle(v, 1, [low[1], high[1]], place_y, depth, farthest);
                    let inside = in_y.map_or(in_x, |in_y| v.kand(in_x, in_y));
                    let zero = v.vset_f32(0.0);
                    part = v.vblend_f32(inside, part, zero);
                }
                // What is hidden there already.
                match blend.kept {
                    Kept::Fixed => {
                        let part = v.vmadd(part, whole, rounding_offset);
                        let part = v.vcvt_f32_i32(part);
                        let sum = v.vload_i32(to, to_at);
                        let sum = int!(v, sum + part);
                        v.vstore_i32(all, to, to_at, sum);
                    }
                    kept => {
                        let part = kept.rounded(v, part);
                        let sum = v.vload_f32(to, to_at);
                        let sum = kept.sum(v, sum, part);
                        v.vstore_f32(all, to, to_at, sum);
                    }
                }
                middle = v.vadd(middle, one);
                at = scalar!(v, at + { 1 << layout.tile_log2 });
                to_at = scalar!(v, to_at + { 1 << layout.tile_log2 });
                y = scalar!(v, y + 1);
            }
            x = scalar!(v, x + 16);
        }
    }

    /// The places that lie in the penumbra's rectangle along an axis, as [`Extent::Occluder`] has it; `None` where the rectangle holds
    /// all that the patch hides something from.
    #[inline(always)]
    fn in_rectangle<V: Vpu>(
        &self,
        v: &mut V,
        axis: usize,
        [low, high]: [V::F32; 2],
        place: V::F32,
        depth: V::F32,
        farthest: V::F32,
    ) -> Option<V::Mask> {
        if self.blend.extent == Extent::Apex {
            return None;
        }
        let (half, of_light) = (v.vset_f32(0.5), v.vset_f32(self.blend.halves[axis]));
        let middle = v.vadd(low, high);
        let middle = v.vmul(middle, half);
        let from = v.vsub(place, middle);
        let from = v.vabs(from);
        let reach = reach(v, depth, farthest, of_light);
        Some(v.vcmp_le(from, reach))
    }
}
