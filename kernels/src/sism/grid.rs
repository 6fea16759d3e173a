//! Data structure construction: receivers into the cells of a perspective grid, one for each face of the light that
//! sees any; contiguous and cell-ordered, with the greatest depth of every cell, block, bin and group.
//!
//! ```text
//! bounds ─► reduce ─► (host: size of each face's grid) ─► count ─► scan ─► scatter ─► cells ─► bins ─► groups
//! ```

use crate::scan::{self, Scan};
use lrbsim_isa::{Addr, Arena, Ordering, Step, Vpu, math};

use super::Frame;
use super::bounds::BOUNDS;
use super::layout::{BIN_CELLS, FACES, FaceGrid, Layout, POSITION, SAMPLE_COLUMNS, SLICES};
use super::streaks::{self, Count, STREAKS_TASK, Scatter};
use crate::columns::Columns;
use crate::plane::Vec3;

/// Receivers that a cell should hold: one and a half vectors.
const CELL_RECEIVERS: u32 = 24;

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
    layout.key_starts = arena.alloc(scan::padded(keys));
    frame.scan = Scan::new(arena, layout.key_starts, keys);
    let streaks = layout.receiver_tasks() * STREAKS_TASK;
    layout.streaks = Columns::new(arena, streaks::COLUMNS, streaks);
    layout.streak_totals = arena.alloc(u64::from(layout.receiver_tasks()));
    layout.streak_lanes = arena.alloc(u64::from(layout.receiver_count.div_ceil(16)));
    Step {
        name: "histogram",
        ordering: Ordering::Ordered,
        tasks: layout.receiver_tasks(),
        kernel: Box::new(Count(*layout)),
    }
}

/// Receivers to their places.
pub fn scatter(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    layout.samples = Columns::new(arena, SAMPLE_COLUMNS, layout.receiver_count);
    Step {
        name: "scatter",
        ordering: Ordering::Independent,
        tasks: layout.receiver_tasks(),
        kernel: Box::new(Scatter(*layout)),
    }
}

/// The grid of one face, from its bounds; `None` if it sees no receiver.
fn face_grid(arena: &Arena, bounds: Addr, face: u32) -> Option<FaceGrid> {
    let at = |bound: u32| bounds.plus(4 * u64::from(16 * face + bound));
    let count = arena.read_u32(at(BOUNDS));
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

/// Constants that the kernels of this phase keep in registers.
pub(super) struct Constants<V: Vpu> {
    pub(super) zero: V::F32,
    pub(super) one: V::F32,
    /// 0 to 5: the faces, and small numbers.
    pub(super) whole: [V::I32; FACES as usize],
}

impl<V: Vpu> Constants<V> {
    #[inline(always)]
    pub(super) fn new(v: &mut V) -> Constants<V> {
        Constants {
            zero: v.vset_f32(0.0),
            one: v.vset_f32(1.0),
            whole: [0, 1, 2, 3, 4, 5].map(|i| v.vset_i32(i)),
        }
    }
}

/// Positions of the receivers of one vector; asks for those of the next.
#[inline(always)]
pub(super) fn load_positions<V: Vpu>(
    v: &mut V,
    constants: &Constants<V>,
    columns: Columns,
    live: V::Mask,
    i: V::S32,
) -> Vec3<V> {
    let mut p = [constants.one; 3];
    for (a, x) in (0..).zip(&mut p) {
        let column = columns.column(POSITION + a);
        v.prefetch_l1(column.plus(64), i);
        *x = v.vload_f32_or(constants.one, live, column, i);
    }
    p
}

/// Face of each point, by its largest component (the first of equal ones), and its image there: x, y, depth.
#[inline(always)]
pub(super) fn project<V: Vpu>(
    v: &mut V,
    constants: &Constants<V>,
    p: Vec3<V>,
) -> (V::I32, V::F32, V::F32, V::F32) {
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
    let whole = &constants.whole;
    let face = v.vblend_i32(by_y, whole[2], whole[0]);
    let face = v.vblend_i32(by_z, whole[4], face);
    let negative = v.vcmp_lt(along, constants.zero);
    let face = v.viadd_or(face, negative, face, whole[1]);
    (face, x, y, depth)
}

/// Cell of each point along one axis of its face's grid; `rows` of the face table: origin, cells per unit, last cell.
#[inline(always)]
fn place<V: Vpu>(v: &mut V, live: V::Mask, x: V::F32, face: V::I32, rows: [Addr; 3], zero: V::F32) -> V::I32 {
    let origin = v.vgather_f32_or(zero, live, rows[0], face);
    let per_cell = v.vgather_f32_or(zero, live, rows[1], face);
    let last = v.vgather_f32_or(zero, live, rows[2], face);
    let from = v.vsub(x, origin);
    let cell = v.vmul(from, per_cell);
    let cell = v.vmax(cell, zero);
    let cell = v.vmin(cell, last);
    v.vcvt_f32_i32(cell)
}

/// `cell << 2 | slice` of each point.
#[inline(always)]
pub(super) fn key<V: Vpu>(
    v: &mut V,
    constants: &Constants<V>,
    layout: &Layout,
    live: V::Mask,
    p: Vec3<V>,
) -> V::I32 {
    let (face, x, y, depth) = project(v, constants, p);
    let zero = constants.zero;
    let [none, one, two, three, four, _] = constants.whole;
    let table = layout.face_table;
    let cx = place(v, live, x, face, [ORIGIN_X, PER_CELL_X, LAST_X].map(|r| row(table, r)), zero);
    let cy = place(v, live, y, face, [ORIGIN_Y, PER_CELL_Y, LAST_Y].map(|r| row(table, r)), zero);
    let bins_x = v.vgather_i32_or(none, live, row(table, BINS_X), face);
    let first_bin = v.vgather_i32_or(none, live, row(table, FIRST_BIN), face);

    // Bin, block in the bin, cell in the block: two bits of each coordinate a level.
    let bin_x = v.vsrl(cx, four);
    let bin_y = v.vsrl(cy, four);
    let rows = v.vimul(bin_y, bins_x);
    let bin = v.viadd(rows, bin_x);
    let mut number = v.viadd(bin, first_bin);
    let block = [v.vsrl(cy, two), v.vsrl(cx, two)];
    for c in [block[0], block[1], cy, cx] {
        let digit = v.vand(c, three);
        let up = v.vsll(number, two);
        number = v.vor(up, digit);
    }
    // Slice.
    let mut slice = none;
    for i in 0..u64::from(SLICES) - 1 {
        let bound = v.vgather_f32_or(zero, live, row(table, SLICE_DEPTH + i), face);
        let past = v.vcmp_gt(depth, bound);
        slice = v.viadd_or(slice, past, slice, one);
    }
    let up = v.vsll(number, two);
    v.vor(up, slice)
}
