//! The hierarchy over the samples: rectangle and greatest depth of every cell, block, bin and group.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::faces::{BinPlace, FaceParameters, Faces};
use super::grid::{Sample, cell_starts, depths_of_face};
use super::touch::IMAGE_SLACK;
use super::{CHILDREN, FAR};
use crate::clear::fill_lines;
use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;

/// A rectangle of a face's image plane and what it holds: a cell, a block, a bin or a group.
#[repr(C)]
pub struct Node {
    /// The middle of the rectangle on the image plane.
    pub center: [f32; 2],
    /// Half of the width and of the height of the rectangle.
    pub half: [f32; 2],
    /// Greatest depth of a receiver inside; 0 where there is none.
    pub depth: f32,
    /// The middle of a circle on the image plane that holds what is inside: of a cell one about its samples, of others one about the
    /// rectangle.
    pub middle: [f32; 2],
    /// Radius of that circle, and what positions on the image plane are rounded by.
    pub radius: f32,
    /// One over the greatest depth of a receiver inside; 1e30 where there is none.
    pub per_depth: f32,
    /// Greatest distance from the light of a point of the rectangle on the image plane; -1e30 where no receiver is inside.
    pub reach: f32,
}

/// The hierarchy over the samples: 16 children follow one another, those of parent `i` from `16 i` on.
#[derive(Clone, Copy)]
pub struct Nodes {
    /// Cells of all bins.
    pub cells: Columns<Node>,
    /// Blocks of 16 cells.
    pub blocks: Columns<Node>,
    /// Bins of 16 blocks.
    pub bins: Columns<Node>,
    /// Groups of 16 bins.
    pub groups: Columns<Node>,
}

/// Blocks of a task of `cell depths`: a line of a bin's blocks.
const BLOCKS: u32 = 4;

/// Vectors of samples that `cell depths` asks for ahead: it does little with each.
const AHEAD: u64 = 4;

impl Nodes {
    /// Builds the hierarchy over `samples` from below, whose keys begin at `key_starts`.
    pub(super) fn build(
        faces: &Faces,
        key_starts: Addr,
        samples: Columns<Sample>,
        runner: &mut Runner<'_>,
    ) -> Result<Nodes, Stopped> {
        let group_count = faces.bin_count / CHILDREN;
        let nodes = Nodes {
            cells: Columns::overwritten(runner.arena, faces.cell_count()),
            blocks: Columns::overwritten(runner.arena, faces.block_count()),
            bins: Columns::overwritten(runner.arena, faces.bin_count),
            groups: Columns::overwritten(runner.arena, group_count.next_multiple_of(16) + 16),
        };
        let cells = Cells { faces: *faces, key_starts, samples, cells: nodes.cells };
        // SAFETY: each task writes the cells of its own blocks.
        runner.run(&unsafe { Step::independent("cell depths", faces.block_count() / BLOCKS, cells) })?;
        let bins = Bins { faces: *faces, nodes };
        // SAFETY: each task writes its own bin and the blocks of that.
        runner.run(&unsafe { Step::independent("bin depths", faces.bin_count, bins) })?;
        // SAFETY: each task writes its own group.
        runner.run(&unsafe { Step::independent("group depths", group_count, Groups { nodes }) })?;
        Ok(nodes)
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
    fn load(v: &mut V, faces: &Faces, bin: V::S32, face: V::S32) -> Place<V> {
        let four = v.vset_f32(4.0);
        let low =
            each!(i in [0, 1] => v.vbroadcast_f32(faces.bin_places.column(field!(BinPlace.low[i])), bin));
        let per_cell = each!(i in [0, 1] => {
            v.vbroadcast_f32(faces.parameters.column(field!(FaceParameters.per_cell[i])), face)
        });
        let cell = [v.vrcp(per_cell[0]), v.vrcp(per_cell[1])];
        let block = [v.vmul(cell[0], four), v.vmul(cell[1], four)];
        let lane = v.viota();
        let two = v.vset_i32(2);
        let three = v.vset_i32(3);
        let half = v.vset_f32(0.5);
        let column = int!(v, lane & three);
        let line = int!(v, lane >> two);
        let column = v.vcvt_i32_f32(column);
        let line = v.vcvt_i32_f32(line);
        let child = [v.vadd(column, half), v.vadd(line, half)];
        Place { low, cell, block, child }
    }
}

/// The bits of -0, less as integers than those of any depth; of negative depths the larger number is the deeper one.
const SHALLOWEST: i32 = i32::MIN;

/// Finds rectangles and depths of the cells, from the samples.
struct Cells {
    faces: Faces,
    key_starts: Addr,
    samples: Columns<Sample>,
    cells: Columns<Node>,
}

impl Kernel for Cells {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Cells { faces, key_starts, samples, cells } = self;
        let (mut block, end) = task_range(v, task, BLOCKS, faces.block_count());
        let first_key = scalar!(v, block << 6);
        let end_key = scalar!(v, end << 6);
        let samples_first = v.s_load(*key_starts, first_key);
        let samples_end = v.s_load(*key_starts, end_key);
        // Where there is nothing there is no depth, and nobody asks for a rectangle.
        if v.branch(Compare::Equal, samples_first, samples_end) {
            let first_cell = scalar!(v, block << 4);
            let end_cell = scalar!(v, end << 4);
            let nothing =
                [(field!(Node.depth), 0.0), (field!(Node.per_depth), FAR), (field!(Node.reach), -FAR)];
            for (field, value) in nothing {
                let value = v.vset_f32(value);
                let value = v.bits_of(value);
                fill_lines(v, cells.column(field), first_cell, end_cell, value);
            }
            return;
        }

        // The bin's face: which coordinate is its depth.
        let bin = scalar!(v, block >> 4);
        let face = v.s_load(faces.bin_places.column(field!(BinPlace.face)), bin);
        let places = Places::of_face(v, *samples, face);
        let place = Place::load(v, faces, bin, face);
        let in_block = each!(axis in [0, 1] => v.vmul(place.child[axis], place.cell[axis]));
        let two = v.vset_i32(2);
        let three = v.vset_i32(3);
        let all = v.mask_all();
        while v.branch(Compare::Less, block, end) {
            let inside = self.inside(v, block, &places);
            let number = scalar!(v, block & 15);
            let number = v.vsplat(number);
            let corner = [int!(v, number & three), int!(v, number >> two)];
            let center = each!(axis in [0, 1] => {
                let corner = v.vcvt_i32_f32(corner[axis]);
                let corner = v.vmadd(corner, place.block[axis], place.low[axis]);
                v.vadd(corner, in_block[axis])
            });
            let first_cell = scalar!(v, block << 4);
            let to = Stored { live: all, nodes: *cells, at: first_cell };
            to.rectangles(v, center, place.cell, inside.depth);
            to.circles(v, inside.low, inside.high);
            block = scalar!(v, block + 1);
        }
    }
}

/// Where the places of samples on their face come from: words from the column of their first coordinate to those of two across the
/// face and that of the depth.
struct Places<V: Vpu> {
    across: [V::S32; 2],
    depth: V::S32,
}

impl<V: Vpu> Places<V> {
    #[inline(always)]
    fn of_face(v: &mut V, samples: Columns<Sample>, face: V::S32) -> Places<V> {
        let depth = depths_of_face(v, samples, face);
        let stride = samples.stride() as i32;
        let past = v.s_imm(3 * stride);
        let mut column = depth;
        let across = each!(_axis in [0, 1] => {
            column = scalar!(v, column + { stride });
            if v.branch(Compare::LessEqual, past, column) {
                column = v.s_imm(0);
            }
            column
        });
        Places { across, depth }
    }
}

/// What samples take up of each of the 16 cells of a block; where there are none the depth is 0.
struct Inside<V: Vpu> {
    /// Greatest depth.
    depth: V::F32,
    /// Least place on the image plane.
    low: [V::F32; 2],
    /// Greatest place.
    high: [V::F32; 2],
}

impl Cells {
    /// What the samples of the 16 cells of a block take up.
    #[inline(always)]
    fn inside<V: Vpu>(&self, v: &mut V, block: V::S32, places: &Places<V>) -> Inside<V> {
        let column = self.samples.column(field!(Sample.position));
        let first_key = scalar!(v, block << 6);
        let shallowest = v.vset_i32(SHALLOWEST);
        let zero = v.vset_f32(0.0);
        let far = v.vset_f32(FAR);
        let minus_far = v.vset_f32(-FAR);
        let mut inside = Inside { depth: zero, low: [zero; 2], high: [zero; 2] };
        let mut sample = v.s_load(cell_starts(self.key_starts, 0), first_key);
        for cell in 0..CHILDREN {
            let end = v.s_load(cell_starts(self.key_starts, cell + 1), first_key);
            if !v.branch(Compare::Less, sample, end) {
                continue;
            }
            let mut deepest = shallowest;
            let mut low = [far; 2];
            let mut high = [minus_far; 2];
            while v.branch(Compare::Less, sample, end) {
                let live = lanes_below(v, sample, end);
                let at = v.s_add(sample, places.depth);
                v.prefetch_l1(column.plus_lines(AHEAD), at);
                let z = v.vload_i32_or(shallowest, live, column, at);
                deepest = v.vimax(deepest, z);
                let depth = v.from_bits(z);
                let depth = v.vabs(depth);
                let per_depth = v.vrcp(depth);
                for axis in 0..2 {
                    let at = v.s_add(sample, places.across[axis]);
                    v.prefetch_l1(column.plus_lines(AHEAD), at);
                    let x = v.vload_f32_or(zero, live, column, at);
                    let x = v.vmul(x, per_depth);
                    low[axis] = v.vmin_or(low[axis], live, low[axis], x);
                    high[axis] = v.vmax_or(high[axis], live, high[axis], x);
                }
                sample = scalar!(v, sample + 16);
            }
            sample = end;
            let deepest = v.from_bits(deepest);
            let deepest = v.vabs(deepest);
            let deepest = math::reduce_max(v, deepest);
            let lane = v.s_imm(1 << cell);
            let here = v.kmov_from_scalar(lane);
            inside.depth = v.vblend_f32(here, deepest, inside.depth);
            for axis in 0..2 {
                let least = math::reduce_min(v, low[axis]);
                inside.low[axis] = v.vblend_f32(here, least, inside.low[axis]);
                let greatest = math::reduce_max(v, high[axis]);
                inside.high[axis] = v.vblend_f32(here, greatest, inside.high[axis]);
            }
        }
        inside
    }
}

/// Finds rectangles and depths of blocks and bins, from the cells.
struct Bins {
    faces: Faces,
    nodes: Nodes,
}

impl Kernel for Bins {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, bin: V::S32) {
        let nodes = &self.nodes;
        let all = v.mask_all();
        let first_block = scalar!(v, bin << 4);
        let first_cell = scalar!(v, first_block << 4);
        let depths = nodes.cells.column(field!(Node.depth));
        for block in 0..CHILDREN {
            v.prefetch_l1(depths.plus_lines(u64::from(block)), first_cell);
        }
        let face = v.s_load(self.faces.bin_places.column(field!(BinPlace.face)), bin);
        let place = Place::load(v, &self.faces, bin, face);

        // Blocks.
        let mut depth = v.vset_f32(0.0);
        for block in 0..CHILDREN {
            let of_cells = v.vload_f32(depths.plus_lines(u64::from(block)), first_cell);
            let deepest = math::reduce_max(v, of_cells);
            let lane = v.s_imm(1 << block);
            let here = v.kmov_from_scalar(lane);
            depth = v.vblend_f32(here, deepest, depth);
        }
        let center = each!(axis in [0, 1] => {
            let in_bin = v.vmul(place.child[axis], place.block[axis]);
            v.vadd(place.low[axis], in_bin)
        });
        Stored { live: all, nodes: nodes.blocks, at: first_block }.all(v, center, place.block, depth);

        // The bin itself.
        let bit = v.s_imm(1);
        let first = v.kmov_from_scalar(bit);
        let deepest = math::reduce_max(v, depth);
        let four = v.vset_f32(4.0);
        let half = v.vset_f32(0.5);
        let size = [v.vmul(place.block[0], four), v.vmul(place.block[1], four)];
        let x = v.vmadd(size[0], half, place.low[0]);
        let y = v.vmadd(size[1], half, place.low[1]);
        Stored { live: first, nodes: nodes.bins, at: bin }.all(v, [x, y], size, deepest);
    }
}

/// Where up to 16 nodes are stored: side by side from node `at` on, those of the lanes `live`.
struct Stored<V: Vpu> {
    live: V::Mask,
    nodes: Columns<Node>,
    at: V::S32,
}

impl<V: Vpu> Stored<V> {
    /// Stores the nodes of rectangles with circles about them; `size` is the whole width and height.
    #[inline(always)]
    fn all(&self, v: &mut V, center: [V::F32; 2], size: [V::F32; 2], depth: V::F32) {
        self.rectangles(v, center, size, depth);
        let half = v.vset_f32(0.5);
        let half = [v.vmul(size[0], half), v.vmul(size[1], half)];
        let low = [v.vsub(center[0], half[0]), v.vsub(center[1], half[1])];
        let high = [v.vadd(center[0], half[0]), v.vadd(center[1], half[1])];
        self.circles(v, low, high);
    }

    /// Stores circles about rectangles, by the corners of these.
    #[inline(always)]
    fn circles(&self, v: &mut V, low: [V::F32; 2], high: [V::F32; 2]) {
        let Stored { live, nodes, at } = *self;
        let half = v.vset_f32(0.5);
        // Wider by a rounding or two, as rectangles are.
        let wider = v.vset_f32(0.500_01);
        let mut radius2 = v.vset_f32(0.0);
        for axis in 0..2 {
            let sum = v.vadd(low[axis], high[axis]);
            let middle = v.vmul(sum, half);
            v.vstore_f32(live, nodes.column(field!(Node.middle[axis])), at, middle);
            let size = v.vsub(high[axis], low[axis]);
            let size = v.vmul(size, wider);
            radius2 = v.vmadd(size, size, radius2);
        }
        // Two roundings of places: what is asked for lies as far off as they are rounded, and so does what is stored.
        let slack = v.vset_f32(2.0 * IMAGE_SLACK);
        let radius = math::sqrt(v, radius2);
        let radius = v.vadd(radius, slack);
        v.vstore_f32(live, nodes.column(field!(Node.radius)), at, radius);
    }

    /// Stores rectangles with what a [`Node`] has but for its circle; `size` is the whole width and height.
    #[inline(always)]
    fn rectangles(&self, v: &mut V, center: [V::F32; 2], size: [V::F32; 2], depth: V::F32) {
        let Stored { live, nodes, at } = *self;
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
        let zero = v.vset_f32(0.0);
        let far = v.vset_f32(FAR);
        let minus_far = v.vset_f32(-FAR);
        let some = v.vcmp_gt(depth, zero);
        let per_depth = v.vrcp(depth);
        let per_depth = v.vblend_f32(some, per_depth, far);
        let reach = v.vblend_f32(some, reach, minus_far);
        let mut store = |field, value| v.vstore_f32(live, nodes.column(field), at, value);
        store(field!(Node.center[0]), center[0]);
        store(field!(Node.center[1]), center[1]);
        store(field!(Node.half[0]), half_x);
        store(field!(Node.half[1]), half_y);
        store(field!(Node.depth), depth);
        store(field!(Node.per_depth), per_depth);
        store(field!(Node.reach), reach);
    }
}

/// Finds rectangles and depths of the groups, from the bins.
struct Groups {
    nodes: Nodes,
}

impl Kernel for Groups {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, group: V::S32) {
        let bins = self.nodes.bins;
        let first_bin = scalar!(v, group << 4);
        let zero = v.vset_f32(0.0);
        let far = v.vset_f32(FAR);
        let half = v.vset_f32(0.5);
        let depth = v.vload_f32(bins.column(field!(Node.depth)), first_bin);
        let used = v.vcmp_gt(depth, zero);
        let deepest = math::reduce_max(v, depth);
        let [(x, size_x), (y, size_y)] = each!(axis in [0, 1] => {
            let c = v.vload_f32(bins.column(field!(Node.center[axis])), first_bin);
            let h = v.vload_f32(bins.column(field!(Node.half[axis])), first_bin);
            let low = v.vsub_or(far, used, c, h);
            let low = math::reduce_min(v, low);
            let minus_far = v.vsub(zero, far);
            let high = v.vadd_or(minus_far, used, c, h);
            let high = math::reduce_max(v, high);
            let sum = v.vadd(low, high);
            let middle = v.vmul(sum, half);
            let size = v.vsub(high, low);
            (middle, size)
        });
        let bit = v.s_imm(1);
        let first = v.kmov_from_scalar(bit);
        let to = Stored { live: first, nodes: self.nodes.groups, at: group };
        to.all(v, [x, y], [size_x, size_y], deepest);
    }
}
