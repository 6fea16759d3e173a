//! Micro-patches: the texels of an occluder map as rectangles parallel to the light, and what their penumbras reach of the soft shadow map.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::geometry::reach;
use crate::columns::{lanes_below, store_first};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::FAR;
use crate::irregular::silhouette::rounding_offset;
use crate::map::layout::Layout;
use crate::map::tiles::{Boxes, Tile, Tiles};
use crate::record::{Records, words};

/// Patches that a task sorts to the tiles of the soft shadow map: each may reach all of them.
const SORT: u32 = 128;

/// How the extent of a penumbra is read from the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// z_O of §3.3 is the depth of the tip of the penumbra.
    Apex,
    /// z_O is the depth of the occluder, as in §5: the rectangle lacks the width of the patch, and what lies beyond it is cut off.
    Occluder,
}

/// A micro-patch.
#[repr(C)]
pub(super) struct Patch {
    /// Where it begins and ends on the image plane, along both axes.
    pub low: [f32; 2],
    pub high: [f32; 2],
    /// Its reciprocal depth.
    pub depth: f32,
    /// What is added to the parts of the light that it hides before they are rounded, in (0, 1).
    pub rounding_offset: f32,
    padding: [u32; 2],
}

/// The patches of one map, and the tiles of the soft shadow map that they reach.
#[derive(Clone, Copy)]
pub(super) struct Patches {
    /// Patches of all squares, by texel, row by row; only those that reach something are written.
    pub records: Records<Patch>,
    /// Logarithm of how many patches a square has room for.
    pub square_log2: u32,
    /// Which of them may reach each tile, in ascending order.
    pub tiles: Tiles,
}

/// The receivers as the light sees them, at the resolution of the soft shadow map.
#[derive(Clone, Copy)]
pub(super) struct Floor {
    /// Where texels of the soft shadow map lie.
    pub layout: Layout,
    /// Reciprocal depths of its texels; 0 where the light sees no receiver.
    pub texels: Addr,
    /// The least reciprocal depth of a texel that shows a receiver, by square; much where none does.
    pub deepest: Addr,
}

impl Floor {
    /// Finds the deepest receivers of the map `texels`.
    pub(super) fn new(layout: Layout, texels: Addr, runner: &mut Runner<'_>) -> Result<Floor, Stopped> {
        let of_tiles = runner.arena.overwritten(u64::from(layout.tile_count()) + 16);
        let deepest = runner.arena.overwritten(u64::from(layout.slot_count) + 16);
        let floor = Floor { layout, texels, deepest };
        // SAFETY: each task writes the word of its own tile.
        let tiles =
            unsafe { Step::independent("deepest of tiles", layout.tile_count(), OfTile { floor, of_tiles }) };
        runner.run(&tiles)?;
        // SAFETY: each task writes the word of its own square.
        runner.run(&unsafe {
            Step::independent("deepest of squares", layout.slot_count, OfSquare { floor, of_tiles })
        })?;
        Ok(floor)
    }
}

/// Finds the deepest receiver of each tile.
struct OfTile {
    floor: Floor,
    of_tiles: Addr,
}

impl Kernel for OfTile {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Floor { layout, texels, .. } = self.floor;
        let tile = Tile::new(v, &layout, task);
        let zero = v.vset_f32(0.0);
        let used = v.vset_i32(layout.used as i32);
        let mut least = v.vset_f32(FAR);
        let side = v.s_imm(1 << layout.tile_log2);
        let mut x = v.s_imm(0);
        while v.branch(Compare::Less, x, side) {
            let columns = tile.columns(v, x);
            let is_used = v.vicmp_lt(columns, used);
            let mut y = v.s_imm(0);
            let mut at = tile.word(v, &layout, x, y);
            while v.branch(Compare::Less, y, side) {
                let depth = v.vload_f32(texels, at);
                let shows = v.vcmp_gt_masked(is_used, depth, zero);
                least = v.vmin_or(least, shows, least, depth);
                at = scalar!(v, at + { 1 << layout.tile_log2 });
                y = scalar!(v, y + 1);
            }
            x = scalar!(v, x + 16);
        }
        let least = math::reduce_min(v, least);
        store_first(v, self.of_tiles, task, least);
    }
}

/// Finds the deepest receiver of each square.
struct OfSquare {
    floor: Floor,
    of_tiles: Addr,
}

impl Kernel for OfSquare {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, slot: V::S32) {
        let tiles = 1 << (2 * self.floor.layout.tiles_log2());
        let mut i = scalar!(v, slot * { tiles });
        let end = scalar!(v, i + { tiles });
        let mut least = v.vset_f32(FAR);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let other = v.vload_f32_or(least, live, self.of_tiles, i);
            least = v.vmin(least, other);
            i = scalar!(v, i + 16);
        }
        let least = math::reduce_min(v, least);
        store_first(v, self.floor.deepest, slot, least);
    }
}

/// Makes the patches of an occluder map, and sorts them to the tiles that their penumbras reach on `floor`.
pub(super) fn patches(
    (layout, texels): (&Layout, Addr),
    floor: &Floor,
    halves: [f32; 2],
    extent: Extent,
    runner: &mut Runner<'_>,
) -> Result<Patches, Stopped> {
    let square_log2 = 2 * layout.size.trailing_zeros();
    let count = 1 << square_log2;
    let records = Records::overwritten(runner.arena, u64::from(count) * u64::from(layout.slot_count));
    let boxes = Boxes::new(runner.arena, &floor.layout, count).in_tasks_of(SORT);
    let kernel = MakePatches { layout: *layout, texels, floor: *floor, halves, extent, records, boxes };
    // SAFETY: each task writes the patches and the boxes of the texels of its own tile.
    runner.run(&unsafe { Step::independent("atty", layout.tile_count(), kernel) })?;
    let tiles = Tiles::sort(boxes, &floor.layout, ["patch counts", "patch lists"], runner)?;
    Ok(Patches { records, square_log2, tiles })
}

/// Makes the patches of the texels of a tile.
struct MakePatches {
    layout: Layout,
    texels: Addr,
    floor: Floor,
    halves: [f32; 2],
    extent: Extent,
    records: Records<Patch>,
    boxes: Boxes,
}

impl Kernel for MakePatches {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let MakePatches { layout, texels, floor, records, boxes, .. } = self;
        let tile = Tile::new(v, layout, task);
        let farthest = v.vbroadcast_f32(floor.deepest, tile.slot);
        let lane = v.viota();
        let one = v.vset_i32(1);
        let half = v.vset_f32(0.5);
        let record_words = v.vset_i32(words::<Patch>() as i32);
        let used = v.vset_i32(layout.used as i32);
        let halves = each!(axis in [0, 1] => v.vset_f32(self.halves[axis]));
        let slot = tile.slot;
        let square = scalar!(v, slot << { 2 * layout.size.trailing_zeros() as i32 });
        let side = v.s_imm(1 << layout.tile_log2);
        let mut x = v.s_imm(0);
        while v.branch(Compare::Less, x, side) {
            let columns = tile.columns(v, x);
            let is_used = v.vicmp_lt(columns, used);
            let after = int!(v, columns + one);
            let (low_x, high_x) = (tile.edge(v, 0, columns), tile.edge(v, 0, after));
            let mut y = v.s_imm(0);
            while v.branch(Compare::Less, y, side) {
                let at = tile.word(v, layout, x, y);
                let depth = v.vload_f32(*texels, at);
                let row = tile.row(v, y);
                let is_used = v.vicmp_lt_masked(is_used, row, used);
                // What nothing lies behind throws no shadow.
                let throws = v.vcmp_gt_masked(is_used, depth, farthest);
                let after = int!(v, row + one);
                let low = [low_x, tile.edge(v, 1, row)];
                let high = [high_x, tile.edge(v, 1, after)];
                let box_of = each!(axis in [0, 1] => {
                    let reach = reach(v, depth, farthest, halves[axis]);
                    match self.extent {
                        Extent::Apex => [v.vsub(low[axis], reach), v.vadd(high[axis], reach)],
                        Extent::Occluder => {
                            let middle = v.vadd(low[axis], high[axis]);
                            let middle = v.vmul(middle, half);
                            [v.vsub(middle, reach), v.vadd(middle, reach)]
                        }
                    }
                });
                let number = tile.number_of(v, layout, x, y);
                let reaches = each!(end in [0, 1] => [box_of[0][end], box_of[1][end]]);
                boxes.store(v, &floor.layout, [tile.slot, tile.face], number, throws, reaches);
                if v.branch_any(throws) {
                    let first = v.vsplat(number);
                    let numbers = int!(v, first + lane);
                    let offset = rounding_offset(v, numbers);
                    let offset = v.vadd(offset, half);
                    let record = scalar!(v, square + number);
                    let record = v.vsplat(record);
                    let at = int!(v, (record + lane) * record_words);
                    for axis in 0..2 {
                        v.vscatter_f32(throws, records.field(field!(Patch.low[axis])), at, low[axis]);
                        v.vscatter_f32(throws, records.field(field!(Patch.high[axis])), at, high[axis]);
                    }
                    v.vscatter_f32(throws, records.field(field!(Patch.depth)), at, depth);
                    v.vscatter_f32(throws, records.field(field!(Patch.rounding_offset)), at, offset);
                }
                y = scalar!(v, y + 1);
            }
            x = scalar!(v, x + 16);
        }
    }
}
