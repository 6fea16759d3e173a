//! Light-view rasterization: per bin, hierarchical and conservative, to records of (cell, primitive).
//!
//! A record also holds the least depth of a receiver of the cell that the primitive can shadow: the intersection of the
//! wedge with the column of depth slices under the cell [johnson09, §2.5].
//!
//! ```text
//! pieces ─► count ─► scan ─► fill          a piece is at most 64 primitives of one bin
//! ```

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::bin::Bins;
use super::faces::BinPlace;
use super::grid::Grid;
use super::primitives::{Layer, Primitives};
use super::touch::{Edge, FaceFrame, Touch};
use super::{BIN_CELLS, FACES};
use crate::clear;
use crate::columns::{Columns, lower, take_lane, task_range};
use crate::expression::{int, scalar};
use crate::field;
use crate::lists::Lists;
use crate::record::{Records, words};

/// Primitives of a piece, as a power of two.
const PIECE_LOG2: i32 = 6;

/// Lists of a task of the piece steps.
const LISTS: u32 = 16;

/// A primitive that can shadow samples of a cell.
#[repr(C)]
pub struct CellRecord {
    /// Number of the primitive.
    pub primitive: i32,
    /// Least depth of a receiver that it can shadow there.
    pub start: f32,
}

/// Part of a bin's list: a task of the raster steps.
#[repr(C)]
struct Piece {
    /// The list that it is part of.
    list: u32,
    /// Its first item.
    first: u32,
    /// One past its last item.
    end: u32,
}

/// Counters of the pieces: one line.
#[repr(C, align(64))]
struct PieceCounters {
    /// Number of pieces of all lists.
    total: u32,
    /// Number of pieces that have been written.
    written: u32,
}

/// The records of each cell.
#[derive(Clone, Copy)]
pub struct Raster {
    /// Lists of the cells by [`Kind`](super::primitives::Kind).
    pub lists: Lists,
    /// The records in these lists.
    pub records: Records<CellRecord>,
}

impl Raster {
    /// Rasters the primitives of the bins: counts the records of each cell, then writes them.
    pub fn build<T: Layer>(
        primitives: &Primitives<T>,
        grid: &Grid,
        bins: &Bins,
        runner: &mut Runner<'_>,
    ) -> Result<Raster, Stopped> {
        let list_count = 2 * grid.faces.cell_count();
        let zeroed = [u64::from(words::<PieceCounters>()), Lists::start_words(list_count)];
        let [counters, starts] = clear::zeroed(runner, zeroed)?;
        let (pieces, piece_count) = pieces(grid, bins, Records::from_base(counters), runner)?;
        let lists = Lists::new(runner.arena, starts, list_count, piece_count, BIN_CELLS);
        let rasterize = |records| Rasterize {
            pieces,
            lists,
            records,
            items: bins.items,
            primitives: *primitives,
            grid: *grid,
        };
        runner.run(&Step::ordered("record counts", piece_count, rasterize(None)))?;

        let records = lists.sum(runner)?;
        let records = Records::overwritten(runner.arena, u64::from(records));
        // SAFETY: each task writes its own table, and records to places that it has taken in `record counts`.
        runner.run(&unsafe { Step::independent("records", piece_count, rasterize(Some(records))) })?;
        Ok(Raster { lists, records })
    }
}

/// Cuts the lists of the bins into pieces: counts them, then writes them. The pieces, and their number. `counters` are zero.
fn pieces(
    grid: &Grid,
    bins: &Bins,
    counters: Records<PieceCounters>,
    runner: &mut Runner<'_>,
) -> Result<(Columns<Piece>, u32), Stopped> {
    let list_count = 2 * grid.faces.bin_count;
    let cut = |pieces| Pieces { counters, pieces, list_starts: bins.lists.starts, list_count };
    let tasks = list_count.div_ceil(LISTS);
    // SAFETY: tasks only add to the counter.
    runner.run(&unsafe { Step::independent("raster pieces", tasks, cut(None)) })?;

    let count = runner.arena.read_u32(counters.field(field!(PieceCounters.total)));
    let pieces = Columns::overwritten(runner.arena, count);
    runner.run(&Step::ordered("raster tasks", tasks, cut(Some(pieces))))?;
    Ok((pieces, count))
}

/// Counts or writes the pieces of the lists of the bins.
struct Pieces {
    counters: Records<PieceCounters>,
    /// Where pieces are written; `None` where they are counted.
    pieces: Option<Columns<Piece>>,
    list_starts: Addr,
    list_count: u32,
}

impl Kernel for Pieces {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let zero = v.s_imm(0);
        let (mut list, end) = task_range(v, task, LISTS, self.list_count);
        while v.branch(Compare::Less, list, end) {
            let mut first = v.s_load(self.list_starts, list);
            let last = v.s_load(self.list_starts.plus_words(1), list);
            let pieces = scalar!(v, ((last - first) + { (1 << PIECE_LOG2) - 1 }) >> { PIECE_LOG2 });
            if v.branch(Compare::Less, zero, pieces) {
                if let Some(columns) = self.pieces {
                    let written = self.counters.field(field!(PieceCounters.written));
                    let mut at = v.s_atomic_add(written, zero, pieces);
                    while v.branch(Compare::Less, first, last) {
                        let next = scalar!(v, first + { 1 << PIECE_LOG2 });
                        let piece_end = lower(v, next, last);
                        v.s_store(columns.column(field!(Piece.list)), at, list);
                        v.s_store(columns.column(field!(Piece.first)), at, first);
                        v.s_store(columns.column(field!(Piece.end)), at, piece_end);
                        first = next;
                        at = scalar!(v, at + 1);
                    }
                } else {
                    v.s_atomic_add(self.counters.field(field!(PieceCounters.total)), zero, pieces);
                }
            }
            list = scalar!(v, list + 1);
        }
    }
}

/// Counts or writes the records of the cells.
struct Rasterize<T> {
    pieces: Columns<Piece>,
    lists: Lists,
    /// Where records are written; `None` where they are counted.
    records: Option<Records<CellRecord>>,
    /// The items of the lists of the bins: numbers of primitives.
    items: Addr,
    primitives: Primitives<T>,
    grid: Grid,
}

impl<T: Layer> Kernel for Rasterize<T> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Rasterize { pieces, lists, primitives, grid, .. } = self;
        let list = v.s_load(pieces.column(field!(Piece.list)), task);
        let first = v.s_load(pieces.column(field!(Piece.first)), task);
        let end = v.s_load(pieces.column(field!(Piece.end)), task);
        let bins = v.s_imm(grid.faces.bin_count as i32);
        let of_triangles = v.branch(Compare::Less, list, bins);
        let bin = if of_triangles { list } else { scalar!(v, list - bins) };
        let face = v.s_load(grid.faces.bin_places.column(field!(BinPlace.face)), bin);
        let first_list = scalar!(v, list << { BIN_CELLS.trailing_zeros() as i32 });
        let table = lists.table(v, task);
        if self.records.is_none() {
            lists.clear_table(v, table);
        }
        let piece = PieceOf { bin, first, end, table, first_list };
        for face_number in 0..FACES {
            let number = v.s_imm(face_number as i32);
            if v.branch(Compare::Equal, face, number) {
                let frame = FaceFrame::new(face_number);
                if of_triangles {
                    self.piece::<V, T::Touch<V>>(v, frame, primitives.triangles, piece);
                } else {
                    self.piece::<V, Edge<V>>(v, frame, primitives.edges, piece);
                }
                break;
            }
        }
        if self.records.is_none() {
            lists.publish(v, table, first_list);
        }
    }
}

/// What a task knows of its piece.
struct PieceOf<V: Vpu> {
    bin: V::S32,
    /// Its items `first..end` in the lists of the bins.
    first: V::S32,
    end: V::S32,
    /// Where the task's table begins.
    table: V::S32,
    /// The list of the bin's first cell.
    first_list: V::S32,
}

impl<T> Rasterize<T> {
    /// Rasters the primitives of a piece over the blocks and cells of its bin.
    #[inline(always)]
    fn piece<V: Vpu, P: Touch<V>>(
        &self,
        v: &mut V,
        frame: FaceFrame,
        records: Records<P::Record>,
        piece: PieceOf<V>,
    ) {
        let PieceOf { bin, first, end, table, first_list } = piece;
        let Rasterize { lists, .. } = self;
        let nodes = &self.grid.nodes;
        let none = v.s_imm(0);
        let first_block = scalar!(v, bin << 4);
        let first_cell = scalar!(v, first_block << 4);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let number = v.s_load(self.items, i);
            let record = records.record(v, number);
            let primitive = P::set_up(v, &self.grid.faces, frame, record);
            let (touched, _) = primitive.touch(v, nodes.blocks, first_block, None);
            let mut blocks = v.kmov_to_scalar(touched);
            while v.branch(Compare::NotEqual, blocks, none) {
                let lane = take_lane(v, &mut blocks);
                let in_bin = scalar!(v, lane << 4);
                let cell = scalar!(v, first_cell + in_bin);
                let (touched, tested) = primitive.touch(v, nodes.cells, cell, None);
                if v.branch_any(touched) {
                    let at = scalar!(v, table + in_bin);
                    if let Some(records) = self.records {
                        let start = primitive.start(v, tested);
                        let list = scalar!(v, first_list + in_bin);
                        let to = lists.place(v, touched, at, list);
                        let word = int!(v, to + to);
                        let number = v.vsplat(number);
                        v.vscatter_i32(touched, records.field(field!(CellRecord.primitive)), word, number);
                        v.vscatter_f32(touched, records.field(field!(CellRecord.start)), word, start);
                    } else {
                        lists.add(v, touched, at);
                    }
                }
            }
            i = scalar!(v, i + 1);
        }
    }
}
