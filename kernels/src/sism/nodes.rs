//! The hierarchy over the samples: rectangle and greatest depth of every cell, block, bin and group.

use lrbsim_isa::{Addr, Arena, Kernel, Ordering, Step, Vpu, math};

use super::Frame;
use super::grid::{FAR, PER_CELL_X, PER_CELL_Y, row};
use super::layout::{
    CENTER_X, CENTER_Y, CHILDREN, DEPTH, HALF_X, HALF_Y, Layout, NODE_COLUMNS, POSITION, REACH, SLICES,
};
use crate::columns::Columns;

/// Cells, blocks and bins.
pub fn nodes(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    layout.cells = Columns::new(arena, NODE_COLUMNS, layout.cell_count());
    layout.blocks = Columns::new(arena, NODE_COLUMNS, layout.block_count());
    layout.bins = Columns::new(arena, NODE_COLUMNS, layout.bin_count);
    layout.groups =
        Columns::new(arena, NODE_COLUMNS, (layout.bin_count / CHILDREN).next_multiple_of(16) + 16);
    Step {
        name: "cell depths",
        ordering: Ordering::Independent,
        tasks: layout.bin_count,
        kernel: Box::new(Nodes { layout: *layout }),
    }
}

/// Groups of bins.
pub fn groups(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "group depths",
        ordering: Ordering::Independent,
        tasks: layout.bin_count / CHILDREN,
        kernel: Box::new(Groups { layout }),
    }
}

struct Nodes {
    layout: Layout,
}

impl Kernel for Nodes {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let all = v.mask_all();
        let zero = v.vset_f32(0.0);
        let half = v.vset_f32(0.5);
        let four = v.vset_f32(4.0);
        let one = v.vset_i32(1);
        let two = v.vset_i32(2);
        let three = v.vset_i32(3);
        let lane = v.viota();
        let column = v.vand(lane, three);
        let line = v.vsrl(lane, two);
        let column = v.vcvt_i32_f32(column);
        let line = v.vcvt_i32_f32(line);
        let column = v.vadd(column, half);
        let line = v.vadd(line, half);

        // The bin's face: which coordinate is its depth, where it lies, how large its cells are.
        let face = v.s_load(layout.bin_table.column(0), task);
        let s_one = v.s_imm(1);
        let axis = v.s_shr(face, s_one);
        let stride = v.s_imm(layout.samples.stride() as i32);
        let depths = v.s_mul(axis, stride);
        let depths = v.vsplat(depths);
        let low_x = v.vbroadcast_f32(layout.bin_table.column(1), task);
        let low_y = v.vbroadcast_f32(layout.bin_table.column(2), task);
        let per_cell_x = v.vbroadcast_f32(row(layout.face_table, PER_CELL_X), face);
        let per_cell_y = v.vbroadcast_f32(row(layout.face_table, PER_CELL_Y), face);
        let cell_x = v.vrcp(per_cell_x);
        let cell_y = v.vrcp(per_cell_y);
        let block_x = v.vmul(cell_x, four);
        let block_y = v.vmul(cell_y, four);

        // Blocks: 16 a bin, a lane each; their depths come from their cells below.
        let s_four = v.s_imm(4);
        let sixteen = v.s_imm(16);
        let first_block = v.s_mul(task, sixteen);
        let block_column = v.vmul(column, block_x);
        let block_line = v.vmul(line, block_y);
        let block_center_x = v.vadd(low_x, block_column);
        let block_center_y = v.vadd(low_y, block_line);
        let mut block_depth = zero;
        let cell_column = v.vmul(column, cell_x);
        let cell_line = v.vmul(line, cell_y);
        for block in 0..CHILDREN {
            let number = v.s_imm(block as i32);
            let block_number = v.s_add(first_block, number);
            let first_cell = v.s_shl(block_number, s_four);
            // Sample range of each cell: its last slice's end, from the end of the cell before.
            let cell = v.vsplat(first_cell);
            let cell = v.viadd(cell, lane);
            let key = v.vsll(cell, two);
            let before = Addr(layout.key_ends.0 - 4);
            let mut at = v.vgather_i32_or(lane, all, before, key);
            let end = v.vgather_i32_or(lane, all, before.plus(4 * u64::from(SLICES)), key);
            // Greatest depth of 16 cells at once.
            let mut depth = zero;
            let mut left = v.vicmp_lt(at, end);
            while v.branch_any(left) {
                let sample = v.viadd(at, depths);
                let z = v.vgather_f32_or(zero, left, layout.samples.column(POSITION), sample);
                let z = v.vabs(z);
                depth = v.vmax_or(depth, left, depth, z);
                at = v.viadd(at, one);
                left = v.vicmp_lt_masked(left, at, end);
            }
            let lane_of_block = v.s_imm(1 << block);
            let here = v.kmov_from_scalar(lane_of_block);
            let deepest = math::reduce_max(v, depth);
            block_depth = v.vblend_f32(here, deepest, block_depth);
            // Rectangles.
            let corner_x = v.vset_f32((block % 4) as f32);
            let corner_y = v.vset_f32((block / 4) as f32);
            let x = v.vmadd(corner_x, block_x, low_x);
            let x = v.vadd(x, cell_column);
            let y = v.vmadd(corner_y, block_y, low_y);
            let y = v.vadd(y, cell_line);
            store_nodes(v, all, layout.cells, first_cell, [x, y], [cell_x, cell_y], depth);
        }
        let block_size = [block_x, block_y];
        store_nodes(
            v,
            all,
            layout.blocks,
            first_block,
            [block_center_x, block_center_y],
            block_size,
            block_depth,
        );

        // The bin itself.
        let bit = v.s_imm(1);
        let first = v.kmov_from_scalar(bit);
        let deepest = math::reduce_max(v, block_depth);
        let size_x = v.vmul(block_x, four);
        let size_y = v.vmul(block_y, four);
        let x = v.vmadd(size_x, half, low_x);
        let y = v.vmadd(size_y, half, low_y);
        store_nodes(v, first, layout.bins, task, [x, y], [size_x, size_y], deepest);
    }
}

/// Stores up to 16 rectangles with their depths and reach; `size` is the whole width and height.
#[inline(always)]
fn store_nodes<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    nodes: Columns,
    at: V::S32,
    center: [V::F32; 2],
    size: [V::F32; 2],
    depth: V::F32,
) {
    let one = v.vset_f32(1.0);
    // Wider by a rounding or two, so that what was put inside by its key is inside.
    let half = v.vset_f32(0.500_01);
    let half_x = v.vmul(size[0], half);
    let half_y = v.vmul(size[1], half);
    let corner_x = v.vabs(center[0]);
    let corner_x = v.vadd(corner_x, half_x);
    let corner_y = v.vabs(center[1]);
    let corner_y = v.vadd(corner_y, half_y);
    let reach2 = v.vmadd(corner_x, corner_x, one);
    let reach2 = v.vmadd(corner_y, corner_y, reach2);
    let reach = math::sqrt(v, reach2);
    v.vstore_f32(live, nodes.column(CENTER_X), at, center[0]);
    v.vstore_f32(live, nodes.column(CENTER_Y), at, center[1]);
    v.vstore_f32(live, nodes.column(HALF_X), at, half_x);
    v.vstore_f32(live, nodes.column(HALF_Y), at, half_y);
    v.vstore_f32(live, nodes.column(DEPTH), at, depth);
    v.vstore_f32(live, nodes.column(REACH), at, reach);
}

struct Groups {
    layout: Layout,
}

impl Kernel for Groups {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let four = v.s_imm(4);
        let first_bin = v.s_shl(task, four);
        let zero = v.vset_f32(0.0);
        let far = v.vset_f32(FAR);
        let half = v.vset_f32(0.5);
        let depth = v.vload_f32(layout.bins.column(DEPTH), first_bin);
        let used = v.vcmp_gt(depth, zero);
        let deepest = math::reduce_max(v, depth);
        let mut span = |center: u32, half_size: u32| {
            let c = v.vload_f32(layout.bins.column(center), first_bin);
            let h = v.vload_f32(layout.bins.column(half_size), first_bin);
            let low = v.vsub_or(far, used, c, h);
            let low = math::reduce_min(v, low);
            let minus_far = v.vsub(zero, far);
            let high = v.vadd_or(minus_far, used, c, h);
            let high = math::reduce_max(v, high);
            let sum = v.vadd(low, high);
            let middle = v.vmul(sum, half);
            let size = v.vsub(high, low);
            (middle, size)
        };
        let (x, size_x) = span(CENTER_X, HALF_X);
        let (y, size_y) = span(CENTER_Y, HALF_Y);
        let bit = v.s_imm(1);
        let first = v.kmov_from_scalar(bit);
        store_nodes(v, first, layout.groups, task, [x, y], [size_x, size_y], deepest);
    }
}
