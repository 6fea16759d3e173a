//! Skins: where the depth of a map jumps, triangles between texels of the occluder and texels of what lies behind it.
//!
//! ```text
//! sides       texels that a Laplacian of Gaussian finds on the near or on the far side of a jump
//! skin counts, skin lists    triangles of three neighboring texels that have both, count → scan → fill
//! ```
//!
//! All texels of a map are vertices of a mesh, four around a cell and two triangles in each, as for warping a picture
//! [heidrich00, §3.2]. Skins are those of its triangles that join both sides of a jump. They share their corners with what lies around
//! them, so that there are no gaps between them wherever they are seen from.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use crate::expression::{each, int, scalar};
use crate::field;
use crate::map::DepthMap;
use crate::map::layout::{Layout, MapFace};
use crate::map::tiles::Tile;
use crate::scan::{self, Scan};

/// Bit of a texel on the near side of a jump.
pub const NEAR: i32 = 1;
/// Bit of a texel on the far side of a jump.
pub const FAR: i32 = 2;
/// Bit of a texel that is farther than its neighbors are on average: a corner at which all of the light is seen.
pub const LIT: i32 = 4;

/// The skins of a map.
#[derive(Clone, Copy)]
pub struct Skins {
    /// The map in which the depth jumps.
    pub map: DepthMap,
    /// [`NEAR`], [`FAR`] and [`LIT`] of each texel.
    pub sides: Addr,
    /// Number of the triangle of each skin, see [`Skins::place`].
    pub list: Addr,
    /// Number of skins.
    pub count: u32,
}

impl Skins {
    /// Finds the skins of `map`, where its depth jumps by `threshold` of itself or more.
    pub fn find(map: &DepthMap, threshold: f32, runner: &mut Runner<'_>) -> Result<Skins, Stopped> {
        let layout = &map.layout;
        let tiles = layout.tile_count();
        let sides = runner.arena.overwritten(layout.texel_count());
        // SAFETY: each task writes the words of its own tile.
        runner.run(&unsafe { Step::independent("sides", tiles, Sides { map: *map, threshold, sides }) })?;

        let starts = runner.arena.overwritten(scan::padded(u64::from(tiles)));
        let scan = Scan::new(runner.arena, starts, u64::from(tiles));
        let select = |list| Select { layout: *layout, sides, starts, list };
        // SAFETY: each task writes its own word.
        runner.run(&unsafe { Step::independent("skin counts", tiles, select(None)) })?;
        scan.run(runner)?;
        let count = runner.arena.read_u32(starts.plus_words(u64::from(tiles)));
        let list = runner.arena.overwritten(u64::from(count) + 16);
        // SAFETY: each task writes as many words as it has counted in the step before, from the sum of all before it on.
        runner.run(&unsafe { Step::independent("skin lists", tiles, select(Some(list))) })?;
        Ok(Skins { map: *map, sides, list, count })
    }

    /// The square of 16 skins, the first texels of their cells, and which of the two triangles of a cell each is, 0 or 1: `numbers`
    /// from the list.
    #[inline(always)]
    pub fn place<V: Vpu>(&self, v: &mut V, numbers: V::I32) -> (V::I32, [V::I32; 2], V::I32) {
        let one = v.vset_i32(1);
        let size_log2 = v.vset_i32(self.map.layout.size.trailing_zeros() as i32);
        let in_row = v.vset_i32(self.map.layout.size as i32 - 1);
        let half = int!(v, numbers & one);
        let texel = int!(v, numbers >> one);
        let row = int!(v, texel >> size_log2);
        (int!(v, row >> size_log2), [int!(v, texel & in_row), int!(v, row & in_row)], half)
    }
}

/// Numbers of the triangles `half`, 0 or 1, of the 16 cells at `texel`.
#[inline(always)]
fn number<V: Vpu>(v: &mut V, layout: &Layout, slot: V::I32, [x, y]: [V::I32; 2], half: usize) -> V::I32 {
    let size_log2 = v.vset_i32(layout.size.trailing_zeros() as i32);
    let one = v.vset_i32(1);
    let cell = int!(v, ((((slot << size_log2) + y) << size_log2) + x) << one);
    if half == 0 { cell } else { int!(v, cell + one) }
}

/// Finds the sides of the texels of a tile.
struct Sides {
    map: DepthMap,
    threshold: f32,
    sides: Addr,
}

/// Reciprocal depths of 16 texels of a row, and their sums with those of the texels to the left and to the right.
type Row<V> = [<V as Vpu>::F32; 2];

impl Kernel for Sides {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.map.layout;
        let side = 1 << layout.tile_log2;
        let tile = Tile::new(v, layout, task);
        let all = v.mask_all();
        let none = v.vset_i32(0);
        let zero = v.vset_f32(0.0);
        let nine = v.vset_f32(9.0);
        // Across a straight jump of 1 three of the eight neighbors differ.
        let threshold = v.vset_f32(3.0 * self.threshold);
        let [near, far, lit] = each!(bit in [NEAR, FAR, LIT] => v.vset_i32(bit));
        let end = v.s_imm(side);
        let mut x = v.s_imm(0);
        while v.branch(Compare::Less, x, end) {
            let columns = tile.columns(v, x);
            let mut y = v.s_imm(0);
            let before = v.s_imm(-1);
            let mut above = self.row(v, &tile, columns, before);
            let mut here = self.row(v, &tile, columns, y);
            let mut to = tile.word(v, layout, x, y);
            while v.branch(Compare::Less, y, end) {
                y = scalar!(v, y + 1);
                let below = self.row(v, &tile, columns, y);
                // The filter has 8 in the middle and -1 around it. On a plane, however steep, it is 0: reciprocal depth is linear there.
                let around = v.vadd(above[1], below[1]);
                let around = v.vadd(around, here[1]);
                let response = v.vmsub(here[0], nine, around);
                let least = v.vmul(here[0], threshold);
                let minus_least = v.vsub(zero, least);
                let is_near = v.vcmp_gt(response, least);
                let is_far = v.vcmp_lt(response, minus_least);
                let is_lit = v.vcmp_lt(response, zero);
                let sides = v.vblend_i32(is_lit, lit, none);
                let sides = v.vor_or(sides, is_near, sides, near);
                let sides = v.vor_or(sides, is_far, sides, far);
                v.vstore_i32(all, self.sides, to, sides);
                to = scalar!(v, to + { side });
                above = here;
                here = below;
            }
            x = scalar!(v, x + 16);
        }
    }
}

impl Sides {
    /// The texels in `columns` of the row `y` of a tile, counted from its first; beyond the border of the square lies what is at
    /// the border.
    #[inline(always)]
    fn row<V: Vpu>(&self, v: &mut V, tile: &Tile<V>, columns: V::I32, y: V::S32) -> Row<V> {
        let layout = &self.map.layout;
        let all = v.mask_all();
        let (none, one) = (v.vset_i32(0), v.vset_i32(1));
        let zero = v.vset_f32(0.0);
        let last = v.vset_i32(layout.size as i32 - 1);
        let row = tile.row(v, y);
        let row = v.vimax(row, none);
        let row = v.vimin(row, last);
        let slot = v.vsplat(tile.slot);
        let left = int!(v, columns - one);
        let left = v.vimax(left, none);
        let right = int!(v, columns + one);
        let right = v.vimin(right, last);
        let farthest = v.vbroadcast_f32(layout.faces.column(field!(MapFace.farthest)), tile.face);
        let [left, middle, right] = each!(column in [left, columns, right] => {
            let word = layout.word(v, slot, [column, row]);
            let depth = v.vgather_f32_or(zero, all, self.map.texels, word);
            v.vmax(depth, farthest)
        });
        let sum = v.vadd(left, middle);
        [middle, v.vadd(sum, right)]
    }
}

/// Counts or writes the skins of a tile.
struct Select {
    layout: Layout,
    sides: Addr,
    /// Number of skins by tile, then the first skin of each.
    starts: Addr,
    /// Where the numbers of skins go; `None` where they are counted.
    list: Option<Addr>,
}

impl Kernel for Select {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let tile = Tile::new(v, layout, task);
        let slot = v.vsplat(tile.slot);
        let both = v.vset_i32(NEAR | FAR);
        let last = v.vset_i32(layout.size as i32 - 1);
        let end = v.s_imm(1 << layout.tile_log2);
        let mut to = if self.list.is_some() { v.s_load(self.starts, task) } else { v.s_imm(0) };
        let mut x = v.s_imm(0);
        while v.branch(Compare::Less, x, end) {
            let columns = tile.columns(v, x);
            // The last column and the last row of a square have no cells.
            let cells = v.vicmp_lt(columns, last);
            let mut y = v.s_imm(0);
            let mut here = self.row(v, &tile, columns, y);
            while v.branch(Compare::Less, y, end) {
                let row = tile.row(v, y);
                y = scalar!(v, y + 1);
                let below = self.row(v, &tile, columns, y);
                let cells = v.vicmp_lt_masked(cells, row, last);
                let ends = v.vor(here[0], below[1]);
                for (half, corner) in [here[1], below[0]].into_iter().enumerate() {
                    let sides = int!(v, (ends | corner) & both);
                    let skins = v.vicmp_eq_masked(cells, sides, both);
                    let bits = v.kmov_to_scalar(skins);
                    if let Some(list) = self.list
                        && v.branch_any(skins)
                    {
                        let numbers = number(v, layout, slot, [columns, row], half);
                        v.vcompress_i32(skins, list, to, numbers);
                    }
                    let more = v.s_popcnt(bits);
                    to = scalar!(v, to + more);
                }
                here = below;
            }
            x = scalar!(v, x + 16);
        }
        if self.list.is_none() {
            v.s_store(self.starts, task, to);
        }
    }
}

impl Select {
    /// Sides of the texels in `columns` of the row `y` of a tile, and of those to the right of them.
    #[inline(always)]
    fn row<V: Vpu>(&self, v: &mut V, tile: &Tile<V>, columns: V::I32, y: V::S32) -> [V::I32; 2] {
        let layout = &self.layout;
        let all = v.mask_all();
        let (none, one) = (v.vset_i32(0), v.vset_i32(1));
        let last = v.vset_i32(layout.size as i32 - 1);
        let row = tile.row(v, y);
        let row = v.vimin(row, last);
        let slot = v.vsplat(tile.slot);
        let right = int!(v, columns + one);
        let right = v.vimin(right, last);
        each!(column in [columns, right] => {
            let word = layout.word(v, slot, [column, row]);
            v.vgather_i32_or(none, all, self.sides, word)
        })
    }
}
