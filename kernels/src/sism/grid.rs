//! Data structure construction: receivers into the cells of a perspective grid, one for each face of the light that
//! sees any; contiguous and cell-ordered, with the greatest depth of every cell, block, bin and group.
//!
//! ```text
//! bounds ─► reduce ─► (host: size of each face's grid) ─► count ─► scan ─► scatter ─► nodes ─► groups
//! ```

use lrbsim_isa::scan::{self, Scan};
use lrbsim_isa::{Addr, Arena, Compare, Kernel, Ordering, Step, Vpu, math};

use super::Frame;
use super::layout::{BIN_CELLS, FACES, FaceGrid, Layout, OWN_TRIANGLE, PIXEL, POSITION, SLICES};
use crate::columns::{Columns, lanes_below, task_range};
use crate::plane::Vec3;

/// Receivers of a task.
const TASK: u32 = 1024;

/// Receivers that a cell should hold: one and a half vectors.
const CELL_RECEIVERS: u32 = 24;

/// Bounds of a face, a vector each: least x, -x, y, -y, z, -z on the image plane, and the count. Negated maxima, so
/// that one minimum serves all.
const BOUNDS: u32 = 7;

/// Words of one face's bounds.
const BOUND_WORDS: u32 = BOUNDS * 16;

/// More than any coordinate: what an empty face's bounds are.
pub(super) const FAR: f32 = 1e30;

/// Rows of the face table.
const ORIGIN_X: u64 = 0;
const ORIGIN_Y: u64 = 1;
pub(super) const PER_CELL_X: u64 = 2;
pub(super) const PER_CELL_Y: u64 = 3;
const LAST_X: u64 = 4;
const LAST_Y: u64 = 5;
const BINS_X: u64 = 6;
const FIRST_BIN: u64 = 7;
const SLICE_DEPTH: u64 = 8;
const ROWS: u64 = 11;

/// A row of the face table: 8 words, by face.
pub(super) const fn row(table: Addr, row: u64) -> Addr {
    table.plus(32 * row)
}

/// Bounds of the receivers of each task, by face.
pub fn bounds(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let tasks = layout.receiver_count.div_ceil(TASK);
    layout.bounds = arena.alloc(u64::from(tasks * FACES * BOUND_WORDS));
    layout.face_bounds = arena.alloc(u64::from(FACES * BOUND_WORDS));
    Step {
        name: "receiver bounds",
        ordering: Ordering::Independent,
        tasks,
        kernel: Box::new(Bounds { layout: *layout }),
    }
}

/// Bounds of all receivers, by face.
pub fn reduce(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    let tables = layout.receiver_count.div_ceil(TASK);
    Step {
        name: "face bounds",
        ordering: Ordering::Independent,
        tasks: FACES,
        kernel: Box::new(Reduce { layout, tables }),
    }
}

/// Sizes the grids, then counts the receivers of each key.
pub fn count(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let mut first_bin = 0;
    layout.face_count = 0;
    for face in 0..FACES {
        if let Some(mut grid) = face_grid(arena, layout.face_bounds, face) {
            grid.first_bin = first_bin;
            first_bin += grid.bins_padded();
            layout.faces[layout.face_count as usize] = grid;
            layout.face_count += 1;
        }
    }
    layout.bin_count = first_bin;
    write_tables(layout, arena);

    let keys = u64::from(layout.cell_count() * SLICES);
    layout.keys = arena.alloc(u64::from(layout.receiver_count) + 16);
    // A zero line first, so that the end of the key before key 0 can be read.
    layout.key_ends = arena.alloc(16 + scan::padded(keys)).plus(64);
    frame.scan = Scan::new(arena, frame.layout.key_ends, keys);
    let layout = frame.layout;
    Step {
        name: "histogram",
        ordering: Ordering::Independent,
        tasks: layout.receiver_count.div_ceil(TASK),
        kernel: Box::new(Count { layout }),
    }
}

/// Receivers to their places.
pub fn scatter(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    layout.samples = Columns::new(arena, 5, layout.receiver_count);
    Step {
        name: "scatter",
        ordering: Ordering::Ordered,
        tasks: layout.receiver_count.div_ceil(TASK),
        kernel: Box::new(Scatter { layout: *layout }),
    }
}

/// The grid of one face, from its bounds; `None` if it sees no receiver.
fn face_grid(arena: &Arena, bounds: Addr, face: u32) -> Option<FaceGrid> {
    let at = |bound: u32| bounds.plus(4 * u64::from(face * BOUND_WORDS + 16 * bound));
    let count = arena.read_u32(at(6));
    if count == 0 {
        return None;
    }
    let low = [arena.read_f32(at(0)), arena.read_f32(at(2))];
    let high = [-arena.read_f32(at(1)), -arena.read_f32(at(3))];
    let (near, far) = (arena.read_f32(at(4)), -arena.read_f32(at(5)));

    // Cells about square, on average with the wished number of receivers; bins whole. A little wider than the bounds,
    // so that rounding puts no receiver outside.
    let widen = |low: f32, high: f32| ((high - low) * 1.001).max(1e-6 + 1e-6 * low.abs().max(high.abs()));
    let extent = [widen(low[0], high[0]), widen(low[1], high[1])];
    let bins_wished = (f64::from(count) / f64::from(CELL_RECEIVERS * BIN_CELLS)).max(1.0);
    let aspect = f64::from(extent[0]) / f64::from(extent[1]);
    let across = ((bins_wished * aspect).sqrt().round()).clamp(1.0, bins_wished.ceil());
    let down = (bins_wished / across).round().max(1.0);
    let bins = [across as u32, down as u32];
    let cell = [extent[0] / (16 * bins[0]) as f32, extent[1] / (16 * bins[1]) as f32];
    let origin = [0, 1].map(|i| 0.5 * (low[i] + high[i]) - 0.5 * extent[i]);

    // Slices of equal ratio: cells cubical in a perspective grid [algorithms, 1.3].
    let middle = (near * far).sqrt();
    let slice_depths = [(near * middle).sqrt(), middle, (middle * far).sqrt()];
    Some(FaceGrid { face, origin, cell, bins, first_bin: 0, slice_depths })
}

/// Writes the constants of faces and bins: the descriptors that a driver would set up.
fn write_tables(layout: &mut Layout, arena: &mut Arena) {
    layout.face_table = arena.alloc(8 * ROWS);
    layout.bin_table = Columns::new(arena, 3, layout.bin_count);
    for grid in &layout.faces[..layout.face_count as usize] {
        let mut put = |r: u64, bits: u32| {
            arena.write_u32(row(layout.face_table, r).plus(4 * u64::from(grid.face)), bits)
        };
        put(ORIGIN_X, grid.origin[0].to_bits());
        put(ORIGIN_Y, grid.origin[1].to_bits());
        put(PER_CELL_X, (1.0 / grid.cell[0]).to_bits());
        put(PER_CELL_Y, (1.0 / grid.cell[1]).to_bits());
        put(LAST_X, ((16 * grid.bins[0] - 1) as f32).to_bits());
        put(LAST_Y, ((16 * grid.bins[1] - 1) as f32).to_bits());
        put(BINS_X, grid.bins[0]);
        put(FIRST_BIN, grid.first_bin);
        for (i, depth) in grid.slice_depths.into_iter().enumerate() {
            put(SLICE_DEPTH + i as u64, depth.to_bits());
        }
        for bin in 0..grid.bins_padded() {
            let at = 4 * u64::from(grid.first_bin + bin);
            let corner = [bin % grid.bins[0], bin / grid.bins[0]];
            arena.write_u32(layout.bin_table.column(0).plus(at), grid.face);
            for (i, corner) in corner.into_iter().enumerate() {
                let low = grid.origin[i] + grid.cell[i] * (16 * corner) as f32;
                arena.write_u32(layout.bin_table.column(1 + i as u32).plus(at), low.to_bits());
            }
        }
    }
}

#[inline(always)]
fn load_positions<V: Vpu>(v: &mut V, columns: Columns, live: V::Mask, i: V::S32) -> Vec3<V> {
    let one = v.vset_f32(1.0);
    let mut axis = |a| v.vload_f32_or(one, live, columns.column(POSITION + a), i);
    [axis(0), axis(1), axis(2)]
}

/// Face of each point, by its largest component (the first of equal ones), and its image there: x, y, depth.
#[inline(always)]
fn project<V: Vpu>(v: &mut V, p: Vec3<V>) -> (V::I32, V::F32, V::F32, V::F32) {
    let zero = v.vset_f32(0.0);
    let size = [v.vabs(p[0]), v.vabs(p[1]), v.vabs(p[2])];
    // Largest component: y beats x, z beats both, only if strictly larger.
    let by_y = v.vcmp_gt(size[1], size[0]);
    let larger = v.vmax(size[0], size[1]);
    let by_z = v.vcmp_gt(size[2], larger);
    let depth = v.vblend_f32(by_z, size[2], larger);
    let along = v.vblend_f32(by_y, p[1], p[0]);
    let along = v.vblend_f32(by_z, p[2], along);
    // The other two, in cyclic order.
    let x = v.vblend_f32(by_y, p[2], p[1]);
    let x = v.vblend_f32(by_z, p[0], x);
    let y = v.vblend_f32(by_y, p[0], p[2]);
    let y = v.vblend_f32(by_z, p[1], y);
    let x = math::div(v, x, depth);
    let y = math::div(v, y, depth);
    // Face number: twice the axis, plus one for the negative half.
    let axis_x = v.vset_i32(0);
    let axis_y = v.vset_i32(2);
    let axis_z = v.vset_i32(4);
    let one = v.vset_i32(1);
    let face = v.vblend_i32(by_y, axis_y, axis_x);
    let face = v.vblend_i32(by_z, axis_z, face);
    let negative = v.vcmp_lt(along, zero);
    let face = v.viadd_or(face, negative, face, one);
    (face, x, y, depth)
}

struct Bounds {
    layout: Layout,
}

impl Kernel for Bounds {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let words = v.s_imm((FACES * BOUND_WORDS) as i32);
        let table = v.s_mul(task, words);
        let all = v.mask_all();
        let zero = v.vset_f32(0.0);
        let one = v.vset_i32(1);
        let far = v.vset_f32(FAR);
        let none = v.vset_i32(0);
        for face in 0..FACES {
            for bound in 0..BOUNDS {
                let to = layout.bounds.plus(4 * u64::from(face * BOUND_WORDS + 16 * bound));
                if bound < 6 {
                    v.vstore_f32(all, to, table, far);
                } else {
                    v.vstore_i32(all, to, table, none);
                }
            }
        }
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, layout.receivers, live, i);
            let (face, x, y, depth) = project(v, p);
            let minus = [v.vsub(zero, x), v.vsub(zero, y), v.vsub(zero, depth)];
            let values = [x, minus[0], y, minus[1], depth, minus[2]];
            for f in 0..FACES {
                let number = v.vset_i32(f as i32);
                let here = v.vicmp_eq_masked(live, face, number);
                if !v.branch_any(here) {
                    continue;
                }
                let table_of = layout.bounds.plus(4 * u64::from(f * BOUND_WORDS));
                for (bound, value) in values.into_iter().enumerate() {
                    let at = table_of.plus(64 * bound as u64);
                    let least = v.vload_f32(at, table);
                    let least = v.vmin_or(least, here, least, value);
                    v.vstore_f32(all, at, table, least);
                }
                let at = table_of.plus(64 * 6);
                let count = v.vload_i32(at, table);
                let count = v.viadd_or(count, here, count, one);
                v.vstore_i32(all, at, table, count);
            }
            i = v.s_add(i, step);
        }
    }
}

struct Reduce {
    layout: Layout,
    tables: u32,
}

impl Kernel for Reduce {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let words = v.s_imm(BOUND_WORDS as i32);
        let from = v.s_mul(task, words);
        let step = v.s_imm((FACES * BOUND_WORDS) as i32);
        let end = v.s_imm((self.tables * FACES * BOUND_WORDS) as i32);
        let all = v.mask_all();
        let far = v.vset_f32(FAR);
        let mut least = [far; 6];
        let mut count = v.vset_i32(0);
        let mut i = from;
        while v.branch(Compare::Less, i, end) {
            for (bound, value) in least.iter_mut().enumerate() {
                let other = v.vload_f32(self.layout.bounds.plus(64 * bound as u64), i);
                *value = v.vmin(*value, other);
            }
            let other = v.vload_i32(self.layout.bounds.plus(64 * 6), i);
            count = v.viadd(count, other);
            i = v.s_add(i, step);
        }
        for (bound, value) in least.into_iter().enumerate() {
            let value = math::reduce_min(v, value);
            v.vstore_f32(all, self.layout.face_bounds.plus(64 * bound as u64), from, value);
        }
        // The sum of 16 counts, by doubling.
        let lane = v.viota();
        for distance in [1, 2, 4, 8] {
            let distance = v.vset_i32(distance);
            let other = v.vxor(lane, distance);
            let other = v.vpermute(count, other);
            count = v.viadd(count, other);
        }
        v.vstore_i32(all, self.layout.face_bounds.plus(64 * 6), from, count);
    }
}

struct Count {
    layout: Layout,
}

impl Kernel for Count {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let one = v.vset_i32(1);
        let none = v.vset_i32(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, layout.receivers, live, i);
            let key = key(v, layout, live, p);
            v.vstore_i32(live, layout.keys, i, key);
            v.vatomic_add_or(none, live, layout.key_ends, key, one);
            i = v.s_add(i, step);
        }
    }
}

/// `cell << 2 | slice` of each point.
#[inline(always)]
fn key<V: Vpu>(v: &mut V, layout: &Layout, live: V::Mask, p: Vec3<V>) -> V::I32 {
    let (face, x, y, depth) = project(v, p);
    let zero = v.vset_f32(0.0);
    let none = v.vset_i32(0);
    let table = layout.face_table;
    let mut place = |x: V::F32, origin: u64, per_cell: u64, last: u64| {
        let origin = v.vgather_f32_or(zero, live, row(table, origin), face);
        let per_cell = v.vgather_f32_or(zero, live, row(table, per_cell), face);
        let last = v.vgather_f32_or(zero, live, row(table, last), face);
        let from = v.vsub(x, origin);
        let cell = v.vmul(from, per_cell);
        let cell = v.vmax(cell, zero);
        let cell = v.vmin(cell, last);
        v.vcvt_f32_i32(cell)
    };
    let cx = place(x, ORIGIN_X, PER_CELL_X, LAST_X);
    let cy = place(y, ORIGIN_Y, PER_CELL_Y, LAST_Y);
    let bins_x = v.vgather_i32_or(none, live, row(table, BINS_X), face);
    let first_bin = v.vgather_i32_or(none, live, row(table, FIRST_BIN), face);

    // Bin, block in the bin, cell in the block: two bits of each coordinate a level.
    let two = v.vset_i32(2);
    let three = v.vset_i32(3);
    let four = v.vset_i32(4);
    let bin_x = v.vsrl(cx, four);
    let bin_y = v.vsrl(cy, four);
    let rows = v.vimul(bin_y, bins_x);
    let bin = v.viadd(rows, bin_x);
    let mut number = v.viadd(bin, first_bin);
    for level in [2, 0] {
        let shift = v.vset_i32(level);
        for c in [cy, cx] {
            let digit = v.vsrl(c, shift);
            let digit = v.vand(digit, three);
            let up = v.vsll(number, two);
            number = v.vor(up, digit);
        }
    }
    // Slice.
    let one = v.vset_i32(1);
    let mut slice = none;
    for i in 0..u64::from(SLICES) - 1 {
        let bound = v.vgather_f32_or(zero, live, row(table, SLICE_DEPTH + i), face);
        let past = v.vcmp_gt(depth, bound);
        slice = v.viadd_or(slice, past, slice, one);
    }
    let up = v.vsll(number, two);
    v.vor(up, slice)
}

struct Scatter {
    layout: Layout,
}

impl Kernel for Scatter {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let one = v.vset_i32(1);
        let none = v.vset_i32(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let key = v.vload_i32_or(none, live, layout.keys, i);
            // Each key's start moves to its end.
            let to = v.vatomic_add_or(none, live, layout.key_ends, key, one);
            for column in [POSITION, POSITION + 1, POSITION + 2, OWN_TRIANGLE, PIXEL] {
                let value = v.vload_i32_or(none, live, layout.receivers.column(column), i);
                v.vscatter_i32(live, layout.samples.column(column), to, value);
            }
            i = v.s_add(i, step);
        }
    }
}
