//! Light-view rasterization: per bin, hierarchical and conservative, to records of (cell, primitive).
//!
//! A record also holds the least depth of a receiver of the cell that the primitive can shadow: the intersection of the
//! wedge with the column of depth slices under the cell [johnson09, §2.5].
//!
//! ```text
//! pieces ─► count ─► scan ─► fill ─► run pieces      a piece is at most 64 primitives of one bin
//! ```

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Ordering, Step, Vpu};

use super::Frame;
use super::layout::{BIN_CELLS, EDGE_WORDS, FACES, Layout, SLICES};
use super::lists::Lists;
use super::touch::{Edge, FaceFrame, Touch, Triangle};
use crate::columns::{Columns, lower, take_lane, task_range};
use crate::plane::TRIANGLE_WORDS;

/// Primitives of a piece, as a power of two.
const PIECE_LOG2: i32 = 6;

/// Lists of a task of the piece steps.
const LISTS: u32 = 16;

/// Blocks of a task of the run steps.
const BLOCKS: u32 = 8;

/// Vector tests of a run of `hard` and of `soft`, as powers of two: about 32 K uops each.
const RUN_LOG2: [i32; 2] = [10, 8];

/// How many pieces the lists of the bins have.
pub fn count_pieces(frame: &mut Frame, _: &mut Arena) -> Step {
    piece_step("raster pieces", Ordering::Independent, &frame.layout, false)
}

/// The pieces themselves.
pub fn fill_pieces(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    layout.raster_task_count = arena.read_u32(layout.raster_counters);
    layout.raster_tasks = Columns::new(arena, 3, layout.raster_task_count);
    piece_step("raster tasks", Ordering::Ordered, layout, true)
}

/// How many records each cell gets.
pub fn count(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    (layout.cell_lists, frame.scan) =
        Lists::new(arena, 2 * layout.cell_count(), layout.raster_task_count, BIN_CELLS);
    raster_step("record counts", Ordering::Ordered, layout, false)
}

/// The records themselves.
pub fn fill(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let total = arena.read_u32(layout.cell_lists.starts.plus(8 * u64::from(layout.cell_count())));
    layout.records = arena.alloc(2 * u64::from(total));
    raster_step("records", Ordering::Independent, layout, true)
}

/// How many runs the samples are split into, for equal work.
pub fn count_runs(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    layout.block_pieces = Columns::new(arena, 2, layout.block_count());
    let layout = *layout;
    Step {
        name: "run counts",
        ordering: Ordering::Independent,
        tasks: layout.block_count().div_ceil(BLOCKS),
        kernel: Box::new(CountRuns { layout }),
    }
}

/// The runs themselves.
pub fn fill_runs(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let total = |kind: u64| arena.read_u32(layout.run_counters.plus(64 * kind));
    let totals = [total(0), total(1)];
    layout.hard_runs = Columns::new(arena, 3, totals[0]);
    layout.soft_runs = Columns::new(arena, 3, totals[1]);
    frame.run_counts = totals;
    let layout = *layout;
    Step {
        name: "runs",
        ordering: Ordering::Ordered,
        tasks: layout.block_count().div_ceil(BLOCKS),
        kernel: Box::new(FillRuns { layout }),
    }
}

fn piece_step(name: &'static str, ordering: Ordering, layout: &Layout, fill: bool) -> Step {
    let tasks = (2 * layout.bin_count).div_ceil(LISTS);
    Step { name, ordering, tasks, kernel: Box::new(Pieces { layout: *layout, fill }) }
}

fn raster_step(name: &'static str, ordering: Ordering, layout: &Layout, fill: bool) -> Step {
    let frames: [FaceFrame; FACES as usize] = layout.faces.map(|grid| FaceFrame::new(&grid));
    let kernel = Raster { layout: *layout, frames, fill };
    Step { name, ordering, tasks: layout.raster_task_count, kernel: Box::new(kernel) }
}

/// Splits the lists of the bins into pieces.
struct Pieces {
    layout: Layout,
    fill: bool,
}

impl Kernel for Pieces {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let one = v.s_imm(1);
        let zero = v.s_imm(0);
        let full = v.s_imm(1 << PIECE_LOG2);
        let round_up = v.s_imm((1 << PIECE_LOG2) - 1);
        let log2 = v.s_imm(PIECE_LOG2);
        let (mut list, end) = task_range(v, task, LISTS, 2 * layout.bin_count);
        let starts = layout.bin_lists.starts;
        while v.branch(Compare::Less, list, end) {
            let mut first = v.s_load(starts, list);
            let last = v.s_load(starts.plus(4), list);
            let items = v.s_sub(last, first);
            let pieces = v.s_add(items, round_up);
            let pieces = v.s_shr(pieces, log2);
            if v.branch(Compare::Less, zero, pieces) {
                if self.fill {
                    let mut at = v.s_atomic_add(layout.raster_counters.plus(4), zero, pieces);
                    while v.branch(Compare::Less, first, last) {
                        let next = v.s_add(first, full);
                        let piece_end = lower(v, next, last);
                        v.s_store(layout.raster_tasks.column(0), at, list);
                        v.s_store(layout.raster_tasks.column(1), at, first);
                        v.s_store(layout.raster_tasks.column(2), at, piece_end);
                        first = next;
                        at = v.s_add(at, one);
                    }
                } else {
                    v.s_atomic_add(layout.raster_counters, zero, pieces);
                }
            }
            list = v.s_add(list, one);
        }
    }
}

struct Raster {
    layout: Layout,
    frames: [FaceFrame; FACES as usize],
    fill: bool,
}

impl Kernel for Raster {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let list = v.s_load(layout.raster_tasks.column(0), task);
        let first = v.s_load(layout.raster_tasks.column(1), task);
        let end = v.s_load(layout.raster_tasks.column(2), task);
        let bins = v.s_imm(layout.bin_count as i32);
        let of_triangles = v.branch(Compare::Less, list, bins);
        let bin = if of_triangles { list } else { v.s_sub(list, bins) };
        let face = v.s_load(layout.bin_table.column(0), bin);
        let eight = v.s_imm(8);
        let cell_list = v.s_shl(list, eight);
        let table = layout.cell_lists.table(v, task);
        for (i, grid) in layout.faces[..layout.face_count as usize].iter().enumerate() {
            let number = v.s_imm(grid.face as i32);
            if v.branch(Compare::Equal, face, number) {
                let frame = self.frames[i];
                if of_triangles {
                    let records = (layout.triangle_records, TRIANGLE_WORDS);
                    self.piece::<V, Triangle<V>>(v, frame, records, bin, first, end, (table, cell_list));
                } else {
                    let records = (layout.edge_records, EDGE_WORDS);
                    self.piece::<V, Edge<V>>(v, frame, records, bin, first, end, (table, cell_list));
                }
                break;
            }
        }
        if !self.fill {
            layout.cell_lists.publish(v, table, cell_list);
        }
    }
}

impl Raster {
    /// Rasters primitives `first..end` of the bin lists over the blocks and cells of `bin`, which begin at `table` in the
    /// task's table and at `cell_list` in the lists of the cells.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "one call site; the arguments are the piece")]
    fn piece<V: Vpu, P: Touch<V>>(
        &self,
        v: &mut V,
        frame: FaceFrame,
        (records, words): (Addr, u32),
        bin: V::S32,
        first: V::S32,
        end: V::S32,
        (table, cell_list): (V::S32, V::S32),
    ) {
        let layout = &self.layout;
        let one = v.s_imm(1);
        let none = v.s_imm(0);
        let four = v.s_imm(4);
        let words = v.s_imm(words as i32);
        let first_block = v.s_shl(bin, four);
        let first_cell = v.s_shl(first_block, four);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let number = v.s_load(layout.bin_items, i);
            let index = v.s_mul(number, words);
            let primitive = P::set_up(v, &layout.light, frame, records, index);
            let (touched, _) = primitive.touch(v, layout.blocks, first_block);
            let mut bits = v.kmov_to_scalar(touched);
            while v.branch(Compare::NotEqual, bits, none) {
                let lane = take_lane(v, &mut bits);
                let in_bin = v.s_shl(lane, four);
                let cell = v.s_add(first_cell, in_bin);
                let (touched, start) = primitive.touch(v, layout.cells, cell);
                if v.branch_any(touched) {
                    let at = v.s_add(table, in_bin);
                    if self.fill {
                        let list = v.s_add(cell_list, in_bin);
                        let to = layout.cell_lists.place(v, touched, at, list);
                        let pair = v.viadd(to, to);
                        let number = v.vsplat(number);
                        v.vscatter_i32(touched, layout.records, pair, number);
                        v.vscatter_f32(touched, layout.records.plus(4), pair, start);
                    } else {
                        layout.cell_lists.add(v, touched, at);
                    }
                }
            }
            i = v.s_add(i, one);
        }
    }
}

/// Vectors of samples, and records of a kind, of the 16 cells of a block.
#[inline(always)]
pub fn cell_vectors<V: Vpu>(v: &mut V, layout: &Layout, first_cell: V::S32) -> V::I32 {
    let all = v.mask_all();
    let none = v.vset_i32(0);
    let two = v.vset_i32(2);
    let four = v.vset_i32(4);
    let fifteen = v.vset_i32(15);
    let lane = v.viota();
    let cell = v.vsplat(first_cell);
    let cell = v.viadd(cell, lane);
    let key = v.vsll(cell, two);
    let first = v.vgather_i32_or(none, all, layout.key_starts, key);
    let end = v.vgather_i32_or(none, all, layout.key_starts.plus(4 * u64::from(SLICES)), key);
    let samples = v.visub(end, first);
    let samples = v.viadd(samples, fifteen);
    v.vsrl(samples, four)
}

/// Sum of 16 integers, as a scalar.
#[inline(always)]
pub fn sum<V: Vpu>(v: &mut V, mut a: V::I32) -> V::S32 {
    let lane = v.viota();
    for distance in [1, 2, 4, 8] {
        let distance = v.vset_i32(distance);
        let other = v.vxor(lane, distance);
        let other = v.vpermute(a, other);
        a = v.viadd(a, other);
    }
    v.vextract(a, 0)
}

/// Splits blocks into runs: 2^j of them, j the least with no more than the wished number of vector tests in each.
struct CountRuns {
    layout: Layout,
}

impl Kernel for CountRuns {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let one = v.s_imm(1);
        let zero = v.s_imm(0);
        let four = v.s_imm(4);
        let (mut block, end) = task_range(v, task, BLOCKS, layout.block_count());
        let mut totals = [zero; 2];
        while v.branch(Compare::Less, block, end) {
            let first_cell = v.s_shl(block, four);
            let vectors = cell_vectors(v, layout, first_cell);
            let vector_count = sum(v, vectors);
            for kind in 0..2u32 {
                let starts = layout.cell_lists.starts.plus(4 * u64::from(kind * layout.cell_count()));
                let record_first = v.vload_i32(starts, first_cell);
                let record_end = v.vload_i32(starts.plus(4), first_cell);
                let records = v.visub(record_end, record_first);
                let tests = v.vimul(vectors, records);
                let tests = sum(v, tests);
                // j + 1, or 0 where there is nothing to do.
                let mut log2 = zero;
                if v.branch(Compare::Less, zero, tests) {
                    let wished = v.s_imm(1 << RUN_LOG2[kind as usize]);
                    let mut left = tests;
                    let mut vectors_left = vector_count;
                    log2 = one;
                    while v.branch(Compare::Less, wished, left) {
                        if v.branch(Compare::LessEqual, vectors_left, one) {
                            break;
                        }
                        left = v.s_shr(left, one);
                        vectors_left = v.s_shr(vectors_left, one);
                        log2 = v.s_add(log2, one);
                    }
                    let runs = runs_of(v, log2);
                    totals[kind as usize] = v.s_add(totals[kind as usize], runs);
                }
                v.s_store(layout.block_pieces.column(kind), block, log2);
            }
            block = v.s_add(block, one);
        }
        for kind in 0..2 {
            v.s_atomic_add(layout.run_counters.plus(64 * kind), zero, totals[kind as usize]);
        }
    }
}

/// `2^(log2 - 1)`.
#[inline(always)]
fn runs_of<V: Vpu>(v: &mut V, log2: V::S32) -> V::S32 {
    let one = v.s_imm(1);
    let j = v.s_sub(log2, one);
    v.s_shl(one, j)
}

struct FillRuns {
    layout: Layout,
}

impl Kernel for FillRuns {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let one = v.s_imm(1);
        let zero = v.s_imm(0);
        let (first, end) = task_range(v, task, BLOCKS, layout.block_count());
        for kind in 0..2u32 {
            let runs = if kind == 0 { layout.hard_runs } else { layout.soft_runs };
            let pieces = layout.block_pieces.column(kind);
            // Count, take room with one atomic, fill.
            let mut total = zero;
            let mut block = first;
            while v.branch(Compare::Less, block, end) {
                let log2 = v.s_load(pieces, block);
                if v.branch(Compare::Less, zero, log2) {
                    let more = runs_of(v, log2);
                    total = v.s_add(total, more);
                }
                block = v.s_add(block, one);
            }
            if !v.branch(Compare::Less, zero, total) {
                continue;
            }
            let counter = layout.run_counters.plus(128 + 64 * u64::from(kind));
            let mut at = v.s_atomic_add(counter, zero, total);
            let mut block = first;
            while v.branch(Compare::Less, block, end) {
                let log2 = v.s_load(pieces, block);
                if v.branch(Compare::Less, zero, log2) {
                    let count = runs_of(v, log2);
                    let mut piece = zero;
                    while v.branch(Compare::Less, piece, count) {
                        v.s_store(runs.column(0), at, block);
                        v.s_store(runs.column(1), at, piece);
                        v.s_store(runs.column(2), at, log2);
                        at = v.s_add(at, one);
                        piece = v.s_add(piece, one);
                    }
                }
                block = v.s_add(block, one);
            }
        }
    }
}
