//! Texels of the map: each task draws a tile, triangle by triangle, 16 texels of a row at a time.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::layout::{Layout, MapFace, MapSlot};
use super::tiles::Tiles;
use crate::clear::clear_lines;
use crate::columns::lower;
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::primitives::TriangleRecord;
use crate::record::{Records, words};

/// Draws all texels: the texels, and the greatest reciprocal depth of each tile.
pub(super) fn draw(
    layout: &Layout,
    triangles: Records<TriangleRecord>,
    tiles: &Tiles,
    runner: &mut Runner<'_>,
) -> Result<(Addr, Addr), Stopped> {
    let texels = runner.arena.overwritten(layout.texel_count());
    let nearest = runner.arena.overwritten(u64::from(layout.tile_count()) + 16);
    let kernel = Draw { layout: *layout, triangles, tiles: *tiles, texels, nearest };
    // SAFETY: each task writes the texels of its own tile, and its word.
    runner.run(&unsafe { Step::independent("draw tiles", layout.tile_count(), kernel) })?;
    Ok((texels, nearest))
}

/// Draws the texels of a tile.
struct Draw {
    layout: Layout,
    triangles: Records<TriangleRecord>,
    tiles: Tiles,
    texels: Addr,
    nearest: Addr,
}

/// A tile that is drawn.
struct Tile<V: Vpu> {
    slot: V::S32,
    /// Its first texel along both axes.
    first: [V::S32; 2],
    /// Its first word among the texels.
    words: V::S32,
    /// Axes of its face: the two of the image plane, and that of the depth.
    axes: [V::S32; 3],
    /// Direction of the depth along its axis: 1 or -1.
    sign: V::F32,
    origin: [V::F32; 2],
    unit: [V::F32; 2],
}

impl Kernel for Draw {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Draw { layout, tiles, texels, .. } = self;
        let (tile_log2, tiles_log2) = (layout.tile_log2 as i32, layout.tiles_log2() as i32);
        let column = scalar!(v, task & { (1 << tiles_log2) - 1 });
        let row = scalar!(v, (task >> { tiles_log2 }) & { (1 << tiles_log2) - 1 });
        let slot = scalar!(v, task >> { 2 * tiles_log2 });
        let first = [scalar!(v, column << { tile_log2 }), scalar!(v, row << { tile_log2 })];
        let begin = scalar!(v, task << { 2 * tile_log2 });
        let end = scalar!(v, begin + { 1 << (2 * tile_log2) });
        clear_lines(v, *texels, begin, end);

        let face = v.s_load(layout.slots.column(field!(MapSlot.face)), slot);
        let depth_axis = scalar!(v, face >> 1);
        let x_axis = next_axis(v, depth_axis);
        let y_axis = next_axis(v, x_axis);
        let negative = scalar!(v, 1 - ((face & 1) << 1));
        let sign = v.vsplat(negative);
        let tile = Tile {
            slot,
            first,
            words: begin,
            axes: [x_axis, y_axis, depth_axis],
            sign: v.vcvt_i32_f32(sign),
            origin: each!(axis in [0, 1] => v.vbroadcast_f32(layout.faces.column(field!(MapFace.origin[axis])), face)),
            unit: each!(axis in [0, 1] => v.vbroadcast_f32(layout.faces.column(field!(MapFace.unit[axis])), face)),
        };
        let mut nearest = v.vset_f32(0.0);
        let [mut item, end] = tiles.items_of(v, layout, slot, row, column);
        while v.branch(Compare::Less, item, end) {
            let number = tiles.triangle(v, item);
            nearest = self.triangle(v, &tile, number, nearest);
            item = scalar!(v, item + 1);
        }
        let nearest = math::reduce_max(v, nearest);
        let only = v.s_imm(1);
        let only = v.kmov_from_scalar(only);
        v.vstore_f32(only, self.nearest, task, nearest);
    }
}

/// The axis after `axis`, in cyclic order.
#[inline(always)]
fn next_axis<V: Vpu>(v: &mut V, axis: V::S32) -> V::S32 {
    let last = v.s_imm(2);
    if v.branch(Compare::Equal, axis, last) { v.s_imm(0) } else { scalar!(v, axis + 1) }
}

impl Draw {
    /// Draws triangle `number` on a tile; the greatest reciprocal depth of each lane so far.
    #[inline(always)]
    fn triangle<V: Vpu>(&self, v: &mut V, tile: &Tile<V>, number: V::S32, mut nearest: V::F32) -> V::F32 {
        let Draw { layout, triangles, tiles, texels, .. } = self;
        let side = 1 << layout.tile_log2;
        // The texels of the tile that the triangle may cover, from the tile's first on.
        let nothing = v.s_imm(0);
        let ranges = each!(axis in [0, 1] => {
            let (base, at) = tiles.boxes.at(v, tile.slot, axis as u32, number);
            let word = v.s_load(base, at);
            let first = tile.first[axis];
            let low = scalar!(v, (word & 0xffff) - first);
            let low = if v.branch(Compare::Less, low, nothing) { nothing } else { low };
            let high = scalar!(v, (word >> 16) - first);
            let last = v.s_imm(side - 1);
            [low, lower(v, high, last)]
        });

        // Edge planes and reciprocal depth, linear on the image plane: `of x`, `of y`, and a constant.
        let record = scalar!(v, number * { words::<TriangleRecord>() as i32 });
        let at = each!(k in [0, 1, 2] => {
            let axis = tile.axes[k];
            scalar!(v, record + axis)
        });
        let edges = each!(edge in [0, 1, 2] => {
            let base = triangles.field(field!(TriangleRecord.edge_normals[edge][0]));
            let [x, y, depth] = each!(k in [0, 1, 2] => v.vbroadcast_f32(base, at[k]));
            [x, y, v.vmul(depth, tile.sign)]
        });
        let flags = each!(edge in [0, 1, 2] => {
            v.vbroadcast_i32(triangles.field(field!(TriangleRecord.flags[edge])), record)
        });
        let plane = v.vbroadcast_f32(triangles.field(field!(TriangleRecord.plane)), record);
        let per_plane = v.vrcp(plane);
        let base = triangles.field(field!(TriangleRecord.normal[0]));
        let [x, y, depth] = each!(k in [0, 1, 2] => v.vbroadcast_f32(base, at[k]));
        let depth = v.vmul(depth, tile.sign);
        let depths = each!(of in [x, y, depth] => v.vmul(of, per_plane));

        let lane = v.viota();
        let half = v.vset_f32(0.5);
        let one = v.vset_i32(1);
        let [[low_x, last_x], [low_y, last_y]] = ranges;
        let mut x = scalar!(v, (low_x >> 4) << 4);
        while v.branch(Compare::LessEqual, x, last_x) {
            let first = tile.first[0];
            let texel = scalar!(v, first + x);
            let texel = v.vsplat(texel);
            let texel = int!(v, texel + lane);
            let place_x = middle(v, texel, half, tile.unit[0], tile.origin[0]);
            let edges_at_x = each!(edge in [0, 1, 2] => v.vmadd(edges[edge][0], place_x, edges[edge][2]));
            let depth_at_x = v.vmadd(depths[0], place_x, depths[2]);
            let first = tile.first[1];
            let texel = scalar!(v, first + low_y);
            let mut texel = v.vsplat(texel);
            let words = tile.words;
            let mut to = scalar!(v, (words + x) + (low_y << { layout.tile_log2 as i32 }));
            let mut y = low_y;
            while v.branch(Compare::LessEqual, y, last_y) {
                let place_y = middle(v, texel, half, tile.unit[1], tile.origin[1]);
                let [a, b, c] = each!(edge in [0, 1, 2] => {
                    let distance = v.vmadd(edges[edge][1], place_y, edges_at_x[edge]);
                    let side = v.bits_of(distance);
                    v.vxor(side, flags[edge])
                });
                let outside = int!(v, (a | b) | c);
                let zero = v.vset_i32(0);
                let inside = v.vicmp_ge(outside, zero);
                if v.branch_any(inside) {
                    let depth = v.vmadd(depths[1], place_y, depth_at_x);
                    let before = v.vload_f32(*texels, to);
                    let after = v.vmax(before, depth);
                    v.vstore_f32(inside, *texels, to, after);
                    nearest = v.vmax_or(nearest, inside, nearest, depth);
                }
                texel = int!(v, texel + one);
                to = scalar!(v, to + { side });
                y = scalar!(v, y + 1);
            }
            x = scalar!(v, x + 16);
        }
        nearest
    }
}

/// Where the middles of texels lie on the image plane, along one axis.
#[inline(always)]
pub(super) fn middle<V: Vpu>(v: &mut V, texel: V::I32, half: V::F32, unit: V::F32, origin: V::F32) -> V::F32 {
    let texel = v.vcvt_i32_f32(texel);
    let texel = v.vadd(texel, half);
    v.vmadd(texel, unit, origin)
}
