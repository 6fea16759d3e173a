//! The hierarchy over the samples: rectangle and greatest depth of every cell, block, bin and group.

use lrbsim_isa::{Arena, Compare, Kernel, Ordering, Step, Vpu, math};

use super::Frame;
use super::bounds::FAR;
use super::grid::{PER_CELL_X, PER_CELL_Y, row};
use super::layout::{
    CENTER_X, CENTER_Y, CHILDREN, DEPTH, HALF_X, HALF_Y, Layout, NODE_COLUMNS, POSITION, REACH, SLICES,
};
use crate::columns::{Columns, lanes_below, task_range};

/// Blocks of a task of `cell depths`: a line of a bin's blocks.
const BLOCKS: u32 = 4;

/// Vectors of samples that `cell depths` asks for ahead: it does little with each.
const AHEAD: u64 = 4;

/// Cells.
pub fn cells(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    layout.cells = Columns::new(arena, NODE_COLUMNS, layout.cell_count());
    layout.blocks = Columns::new(arena, NODE_COLUMNS, layout.block_count());
    layout.bins = Columns::new(arena, NODE_COLUMNS, layout.bin_count);
    layout.groups =
        Columns::new(arena, NODE_COLUMNS, (layout.bin_count / CHILDREN).next_multiple_of(16) + 16);
    Step {
        name: "cell depths",
        ordering: Ordering::Independent,
        tasks: layout.block_count() / BLOCKS,
        kernel: Box::new(Cells { layout: *layout }),
    }
}

/// Blocks and bins.
pub fn bins(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "bin depths",
        ordering: Ordering::Independent,
        tasks: layout.bin_count,
        kernel: Box::new(Bins { layout }),
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

/// Where a bin lies on the image plane.
struct Place<V: Vpu> {
    low: [V::F32; 2],
    cell: [V::F32; 2],
    block: [V::F32; 2],
    /// Columns and lines of 16 children in 4 lines, their centers: 0.5 to 3.5.
    child: [V::F32; 2],
}

impl<V: Vpu> Place<V> {
    #[inline(always)]
    fn load(v: &mut V, layout: &Layout, bin: V::S32, face: V::S32) -> Place<V> {
        let four = v.vset_f32(4.0);
        let low_x = v.vbroadcast_f32(layout.bin_table.column(1), bin);
        let low_y = v.vbroadcast_f32(layout.bin_table.column(2), bin);
        let per_cell_x = v.vbroadcast_f32(row(layout.face_table, PER_CELL_X), face);
        let per_cell_y = v.vbroadcast_f32(row(layout.face_table, PER_CELL_Y), face);
        let cell = [v.vrcp(per_cell_x), v.vrcp(per_cell_y)];
        let block = [v.vmul(cell[0], four), v.vmul(cell[1], four)];
        let lane = v.viota();
        let two = v.vset_i32(2);
        let three = v.vset_i32(3);
        let half = v.vset_f32(0.5);
        let column = v.vand(lane, three);
        let line = v.vsrl(lane, two);
        let column = v.vcvt_i32_f32(column);
        let line = v.vcvt_i32_f32(line);
        let child = [v.vadd(column, half), v.vadd(line, half)];
        Place { low: [low_x, low_y], cell, block, child }
    }
}

/// The bits of -0, less as integers than those of any depth; of negative depths the larger number is the deeper one.
const SHALLOWEST: i32 = i32::MIN;

struct Cells {
    layout: Layout,
}

impl Kernel for Cells {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut block, end) = task_range(v, task, BLOCKS, layout.block_count());
        let one = v.s_imm(1);
        let four = v.s_imm(4);
        let six = v.s_imm(6);
        let fifteen = v.s_imm(15);
        let first = v.s_shl(block, six);
        let after = v.s_shl(end, six);
        let samples_first = v.s_load(layout.key_starts, first);
        let samples_end = v.s_load(layout.key_starts, after);
        // Memory holds 0 where there is nothing: no depth.
        if v.branch(Compare::Equal, samples_first, samples_end) {
            return;
        }

        // The bin's face: which coordinate is its depth.
        let bin = v.s_shr(block, four);
        let face = v.s_load(layout.bin_table.column(0), bin);
        let axis = v.s_shr(face, one);
        let stride = v.s_imm(layout.samples.stride() as i32);
        let depths = v.s_mul(axis, stride);
        let place = Place::load(v, layout, bin, face);
        let in_block = [0, 1].map(|axis: usize| v.vmul(place.child[axis], place.cell[axis]));
        let two = v.vset_i32(2);
        let three = v.vset_i32(3);
        let all = v.mask_all();
        while v.branch(Compare::Less, block, end) {
            let depth = self.cell_depths(v, block, depths);
            let number = v.s_and(block, fifteen);
            let number = v.vsplat(number);
            let corner = [v.vand(number, three), v.vsrl(number, two)];
            let mut center = |axis: usize| {
                let corner = v.vcvt_i32_f32(corner[axis]);
                let corner = v.vmadd(corner, place.block[axis], place.low[axis]);
                v.vadd(corner, in_block[axis])
            };
            let center = [center(0), center(1)];
            let first_cell = v.s_shl(block, four);
            store_nodes(v, all, layout.cells, first_cell, center, place.cell, depth);
            block = v.s_add(block, one);
        }
    }
}

impl Cells {
    /// Greatest depth in each of the 16 cells of a block; the depths of samples begin `depths` words after their positions.
    #[inline(always)]
    fn cell_depths<V: Vpu>(&self, v: &mut V, block: V::S32, depths: V::S32) -> V::F32 {
        let layout = &self.layout;
        let of_cell = |cell: u32| layout.key_starts.plus(4 * u64::from(cell * SLICES));
        let column = layout.samples.column(POSITION);
        let six = v.s_imm(6);
        let step = v.s_imm(16);
        let first_key = v.s_shl(block, six);
        let shallowest = v.vset_i32(SHALLOWEST);
        let mut depth = v.vset_f32(0.0);
        let sample = v.s_load(of_cell(0), first_key);
        let mut sample = v.s_add(sample, depths);
        for cell in 0..CHILDREN {
            let end = v.s_load(of_cell(cell + 1), first_key);
            let end = v.s_add(end, depths);
            if !v.branch(Compare::Less, sample, end) {
                continue;
            }
            let mut deepest = shallowest;
            while v.branch(Compare::Less, sample, end) {
                let live = lanes_below(v, sample, end);
                v.prefetch_l1(column.plus(64 * AHEAD), sample);
                let z = v.vload_i32_or(shallowest, live, column, sample);
                deepest = v.vimax(deepest, z);
                sample = v.s_add(sample, step);
            }
            sample = end;
            let deepest = v.from_bits(deepest);
            let deepest = v.vabs(deepest);
            let deepest = math::reduce_max(v, deepest);
            let lane = v.s_imm(1 << cell);
            let here = v.kmov_from_scalar(lane);
            depth = v.vblend_f32(here, deepest, depth);
        }
        depth
    }
}

struct Bins {
    layout: Layout,
}

impl Kernel for Bins {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let all = v.mask_all();
        let s_four = v.s_imm(4);
        let first_block = v.s_shl(task, s_four);
        let first_cell = v.s_shl(first_block, s_four);
        let depths = layout.cells.column(DEPTH);
        for block in 0..CHILDREN {
            v.prefetch_l1(depths.plus(64 * u64::from(block)), first_cell);
        }
        let face = v.s_load(layout.bin_table.column(0), task);
        let place = Place::load(v, layout, task, face);

        // Blocks.
        let mut depth = v.vset_f32(0.0);
        for block in 0..CHILDREN {
            let of_cells = v.vload_f32(depths.plus(64 * u64::from(block)), first_cell);
            let deepest = math::reduce_max(v, of_cells);
            let lane = v.s_imm(1 << block);
            let here = v.kmov_from_scalar(lane);
            depth = v.vblend_f32(here, deepest, depth);
        }
        let mut center = |axis: usize| {
            let in_bin = v.vmul(place.child[axis], place.block[axis]);
            v.vadd(place.low[axis], in_bin)
        };
        let center = [center(0), center(1)];
        store_nodes(v, all, layout.blocks, first_block, center, place.block, depth);

        // The bin itself.
        let bit = v.s_imm(1);
        let first = v.kmov_from_scalar(bit);
        let deepest = math::reduce_max(v, depth);
        let four = v.vset_f32(4.0);
        let half = v.vset_f32(0.5);
        let size = [v.vmul(place.block[0], four), v.vmul(place.block[1], four)];
        let x = v.vmadd(size[0], half, place.low[0]);
        let y = v.vmadd(size[1], half, place.low[1]);
        store_nodes(v, first, layout.bins, task, [x, y], size, deepest);
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
