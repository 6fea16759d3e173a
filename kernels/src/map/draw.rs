//! Texels of the map: each task draws a tile, triangle by triangle, 16 texels of a row at a time.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::layout::Layout;
use super::tiles::{Tile, Tiles};
use crate::clear::clear_lines;
use crate::columns::store_first;
use crate::expression::{each, int, scalar};
use crate::face::FaceFrame;
use crate::field;
use crate::irregular::primitives::TriangleRecord;
use crate::record::Records;

/// Which of the triangles on a texel stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stays {
    /// The one that is nearest to the light.
    Nearest,
    /// The one that is farthest from it.
    Farthest,
}

/// Draws all texels: the texels, and the greatest reciprocal depth of anything on each tile.
pub(crate) fn draw(
    layout: &Layout,
    triangles: Records<TriangleRecord>,
    tiles: &Tiles,
    stays: Stays,
    runner: &mut Runner<'_>,
) -> Result<(Addr, Addr), Stopped> {
    let texels = runner.arena.overwritten(layout.texel_count());
    let nearest = runner.arena.overwritten(u64::from(layout.tile_count()) + 16);
    let kernel = Draw { layout: *layout, triangles, tiles: *tiles, stays, texels, nearest };
    // SAFETY: each task writes the texels of its own tile, and its word.
    runner.run(&unsafe { Step::independent("draw tiles", layout.tile_count(), kernel) })?;
    Ok((texels, nearest))
}

/// Draws the texels of a tile.
struct Draw {
    layout: Layout,
    triangles: Records<TriangleRecord>,
    tiles: Tiles,
    stays: Stays,
    texels: Addr,
    nearest: Addr,
}

impl Kernel for Draw {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Draw { layout, tiles, texels, .. } = self;
        let tile = Tile::new(v, layout, task);
        let [begin, end] = tile.words;
        clear_lines(v, *texels, begin, end);

        let frame = FaceFrame::new(v, tile.face);
        let mut nearest = v.vset_f32(0.0);
        let [mut item, end] = tiles.items_of(v, &tile);
        while v.branch(Compare::Less, item, end) {
            let number = tiles.number(v, item);
            nearest = self.triangle(v, &tile, &frame, number, nearest);
            item = scalar!(v, item + 1);
        }
        let nearest = math::reduce_max(v, nearest);
        store_first(v, self.nearest, task, nearest);
    }
}

impl Draw {
    /// Draws triangle `number` on a tile; the greatest reciprocal depth of each lane so far.
    #[inline(always)]
    fn triangle<V: Vpu>(
        &self,
        v: &mut V,
        tile: &Tile<V>,
        frame: &FaceFrame<V>,
        number: V::S32,
        mut nearest: V::F32,
    ) -> V::F32 {
        let Draw { layout, triangles, tiles, texels, .. } = self;
        let side = 1 << layout.tile_log2;
        let [[low_x, last_x], [low_y, last_y]] = tiles.range(v, tile, number);

        // Edge planes and reciprocal depth, linear on the image plane: `of x`, `of y`, and a constant.
        let record = triangles.record(v, number);
        let in_frame = frame.see(v, record);
        let edges = each!(edge in [0, 1, 2] => in_frame.vec3(v, field!(TriangleRecord.edge_normals[edge])));
        let flags = each!(edge in [0, 1, 2] => record.int(v, field!(TriangleRecord.flags[edge])));
        let plane = record.float(v, field!(TriangleRecord.plane));
        let per_plane = v.vrcp(plane);
        let normal = in_frame.vec3(v, field!(TriangleRecord.normal));
        let depths = each!(axis in [0, 1, 2] => v.vmul(normal[axis], per_plane));

        let one = v.vset_i32(1);
        let mut x = scalar!(v, (low_x >> 4) << 4);
        while v.branch(Compare::LessEqual, x, last_x) {
            let columns = tile.columns(v, x);
            let place_x = tile.middle(v, 0, columns);
            let edges_at_x = each!(edge in [0, 1, 2] => v.vmadd(edges[edge][0], place_x, edges[edge][2]));
            let depth_at_x = v.vmadd(depths[0], place_x, depths[2]);
            let mut row = tile.row(v, low_y);
            let mut to = tile.word(v, layout, x, low_y);
            let mut y = low_y;
            while v.branch(Compare::LessEqual, y, last_y) {
                let place_y = tile.middle(v, 1, row);
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
                    let after = match self.stays {
                        Stays::Nearest => v.vmax(before, depth),
                        Stays::Farthest => {
                            let nothing = v.vset_f32(0.0);
                            let holds = v.vcmp_neq(before, nothing);
                            v.vmin_or(depth, holds, before, depth)
                        }
                    };
                    v.vstore_f32(inside, *texels, to, after);
                    nearest = v.vmax_or(nearest, inside, nearest, depth);
                }
                row = int!(v, row + one);
                to = scalar!(v, to + { side });
                y = scalar!(v, y + 1);
            }
            x = scalar!(v, x + 16);
        }
        nearest
    }
}
