//! Light-view rasterization: the primitives of each block, and of each which cells it touches, conservatively.
//!
//! A record is a primitive in the list of a block. It also holds the least depth of a receiver that the primitive can shadow in the cells
//! that it touches: the intersection of the wedge with the columns of depth slices under them [johnson09, §2.5]. Records lie in groups of
//! 16, which belong to one list each: a group has for each cell of its block a bit for each of its records, so that who walks
//! the records of a cell asks once for 16 of them.
//!
//! ```text
//! pieces ─► count ─► scan ─► fill ─► cells    a piece is at most 64 primitives of one bin
//! ```

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::bin::{BinItem, Bins};
use super::faces::BinPlace;
use super::grid::Grid;
use super::nodes::Node;
use super::primitives::{Kind, Layer, Primitives, TriangleBounds, WITHIN};
use super::touch::{Edge, NodeSource, OneNode, Touch};
use super::{CHILDREN, FAR};
use crate::clear;
use crate::columns::{Columns, lanes_below, lower, task_range};
use crate::expression::{each, int, scalar};
use crate::face::FaceFrame;
use crate::field;
use crate::lists::Lists;
use crate::record::{Field, Gathered, Records, words};

/// Primitives of a piece, as a power of two.
const PIECE_LOG2: i32 = 6;

/// Lists of a task of the piece steps.
const LISTS: u32 = 16;

/// Parts of a list, as a power of two: part i has every second group from group i on.
const PARTS_LOG2: i32 = 1;

/// Quarters of all blocks, as a power of two. Blocks are whole bins of 16.
const QUARTERS_LOG2: i32 = 2;

/// Cells in a line of a block.
const LINE: u32 = 4;

/// A primitive in the list of a block.
#[repr(C)]
pub struct BlockRecord {
    /// Number of the primitive.
    pub primitive: i32,
    /// Least depth of a receiver that it can shadow in the block.
    pub start: f32,
    /// Not of this record but of its group: word `i` of 16 is of cell `i` of the block, a bit for each record of the group that
    /// touches it.
    pub cells: i32,
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

/// The records of each block.
#[derive(Clone, Copy)]
pub struct Raster {
    /// Lists of the blocks by [`Kind`].
    lists: Lists,
    /// The records in these lists, where [`Raster::range`] has them.
    pub records: Columns<BlockRecord>,
}

impl Raster {
    /// Puts the primitives of the bins into the lists of their blocks: counts the records of each block, then writes their primitives.
    /// [`Raster::find_cells`] finds the rest.
    pub fn build(grid: &Grid, bins: &Bins, runner: &mut Runner<'_>) -> Result<Raster, Stopped> {
        let list_count = Kind::ALL.len() as u32 * grid.faces.block_count();
        let zeroed = [u64::from(words::<PieceCounters>()), Lists::start_words(list_count)];
        let [counters, starts] = clear::zeroed(runner, zeroed)?;
        let (pieces, piece_count) = pieces(grid, bins, Records::from_base(counters), runner)?;
        let lists = Lists::new(runner.arena, starts, list_count, piece_count, CHILDREN);
        let distribute = |records| Distribute { pieces, lists, records, items: bins.items };
        runner.run(&Step::ordered("record counts", piece_count, distribute(None)))?;

        let records = lists.sum(runner)?;
        // Each list begins a group, see `range`.
        let records = Columns::overwritten(runner.arena, records + CHILDREN * (list_count + 1));
        // SAFETY: each task reads its own table, and writes records to places that it has taken in `record counts`.
        runner.run(&unsafe { Step::independent("records", piece_count, distribute(Some(records))) })?;
        Ok(Raster { lists, records })
    }

    /// Finds which cells each record touches, and from which depth on.
    pub fn find_cells<T: Layer>(
        &self,
        primitives: &Primitives<T>,
        grid: &Grid,
        runner: &mut Runner<'_>,
    ) -> Result<(), Stopped> {
        let cells = Cells { raster: *self, primitives: *primitives, grid: *grid };
        // SAFETY: each task writes the records of its own part of a list.
        runner.run(&unsafe { Step::independent("record cells", self.lists.count << PARTS_LOG2, cells) })
    }

    /// Where the records of `kind` of a block begin, the first of a group, and one past the last of them.
    ///
    /// List i of records that begin at s, were there no groups, begins with group s / 16 + i: the lists before it take no more.
    #[inline(always)]
    pub fn range<V: Vpu>(&self, v: &mut V, kind: Kind, block: V::S32) -> [V::S32; 2] {
        let first_list = v.s_imm(kind.first_list(self.block_count()) as i32);
        let list = scalar!(v, first_list + block);
        let start = v.s_load(self.lists.starts, list);
        let end = v.s_load(self.lists.starts.plus_words(1), list);
        let first = scalar!(v, ((start >> 4) + list) << 4);
        [first, scalar!(v, first + (end - start))]
    }

    /// Number of blocks, each of which has a list of each kind.
    fn block_count(&self) -> u32 {
        self.lists.count / Kind::ALL.len() as u32
    }

    /// Number of the primitive of record `at`.
    #[inline(always)]
    pub fn primitive<V: Vpu>(&self, v: &mut V, at: V::S32) -> V::S32 {
        v.s_load(self.records.column(field!(BlockRecord.primitive)), at)
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

/// Counts or writes the primitives of the blocks.
struct Distribute {
    pieces: Columns<Piece>,
    lists: Lists,
    /// Where primitives are written; `None` where they are counted.
    records: Option<Columns<BlockRecord>>,
    /// What is in the lists of the bins.
    items: Columns<BinItem>,
}

impl Kernel for Distribute {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Distribute { pieces, lists, .. } = self;
        let list = v.s_load(pieces.column(field!(Piece.list)), task);
        let mut i = v.s_load(pieces.column(field!(Piece.first)), task);
        let end = v.s_load(pieces.column(field!(Piece.end)), task);
        // Bins and blocks are numbered alike for both kinds: 16 lists of blocks for a list of a bin.
        let first_list = scalar!(v, list << 4);
        let table = lists.table(v, task);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let one = v.vset_i32(1);
        let own = int!(v, one << lane);
        let blocks = self.items.column(field!(BinItem.blocks));
        let Some(records) = self.records else {
            let mut counts = none;
            while v.branch(Compare::Less, i, end) {
                let bits = v.vbroadcast_i32(blocks, i);
                let bits = v.vand(bits, own);
                let touched = v.vicmp_neq(bits, none);
                counts = v.viadd_or(counts, touched, counts, one);
                i = scalar!(v, i + 1);
            }
            lists.publish_counts(v, table, first_list, counts);
            return;
        };
        let start = v.vload_i32(lists.starts, first_list);
        let four = v.vset_i32(4);
        let number = v.vsplat(first_list);
        let before = lists.of_task(v, table);
        let mut to = int!(v, (((start >> four) + (number + lane)) << four) + before);
        while v.branch(Compare::Less, i, end) {
            let bits = v.vbroadcast_i32(blocks, i);
            let bits = v.vand(bits, own);
            let number = v.vbroadcast_i32(self.items.column(field!(BinItem.primitive)), i);
            let touched = v.vicmp_neq(bits, none);
            v.vscatter_i32(touched, records.column(field!(BlockRecord.primitive)), to, number);
            to = v.viadd_or(to, touched, to, one);
            i = scalar!(v, i + 1);
        }
    }
}

/// Finds the cells that the records of blocks touch, a task for each part of a list: few blocks of a frame have most of its records.
struct Cells<T> {
    raster: Raster,
    primitives: Primitives<T>,
    grid: Grid,
}

impl<T: Layer> Kernel for Cells<T> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let blocks = self.raster.block_count();
        let of_triangles = v.s_imm((blocks << PARTS_LOG2) as i32);
        if v.branch(Compare::Less, task, of_triangles) {
            self.part::<V, T::Touch<V>>(v, Kind::Triangles, self.primitives.triangles, task);
        } else {
            let task = scalar!(v, task - of_triangles);
            self.part::<V, Edge<V>>(v, Kind::Edges, self.primitives.edges, task);
        }
    }
}

/// Where in one direction the middles of cells lie that 16 primitives can touch; `None`: anywhere.
struct Span<V: Vpu>(Option<[V::F32; 2]>);

impl<V: Vpu> Span<V> {
    /// Lanes of `live` whose span holds this coordinate of a node.
    #[inline(always)]
    fn reaches(&self, v: &mut V, live: V::Mask, node: OneNode<V>, center: Field<Node, f32>) -> V::Mask {
        let Some([low, high]) = self.0 else { return live };
        let center = node.load(v, center);
        let past = v.vcmp_le_masked(live, low, center);
        v.vcmp_ge_masked(past, high, center)
    }
}

impl<T> Cells<T> {
    /// Finds the cells of part `number` of the lists of a kind.
    ///
    /// Parts that follow one another, which a thread may get together, are of blocks from the four quarters of all: neighbors have lists of
    /// like lengths.
    #[inline(always)]
    fn part<V: Vpu, P: Touch<V>>(&self, v: &mut V, kind: Kind, records: Records<P::Record>, number: V::S32) {
        let quarter_blocks = (self.raster.block_count() >> QUARTERS_LOG2) as i32;
        let part = scalar!(v, number & { (1 << PARTS_LOG2) - 1 });
        // Of each part the quarters come in turn, from another on: every number has a part and a block of its own.
        let turn = scalar!(v, (number >> { PARTS_LOG2 }) + (part << 1));
        let quarter = scalar!(v, turn & { (1 << QUARTERS_LOG2) - 1 });
        let block = scalar!(v, (quarter * { quarter_blocks }) + (number >> { PARTS_LOG2 + QUARTERS_LOG2 }));
        let [first, end] = self.raster.range(v, kind, block);
        let first = scalar!(v, first + (part << 4));
        if v.branch(Compare::LessEqual, end, first) {
            return;
        }
        let bin = scalar!(v, block >> 4);
        let face = v.s_load(self.grid.faces.bin_places.column(field!(BinPlace.face)), bin);
        let frame = FaceFrame::new(v, face);
        self.records::<V, P>(v, &frame, (kind, records), block, [first, end]);
    }

    /// What the bounds of the images of 16 primitives span in each direction, wider by half a cell.
    #[inline(always)]
    fn spans<V: Vpu>(
        &self,
        v: &mut V,
        kind: Kind,
        live: V::Mask,
        numbers: V::I32,
        half: [V::F32; 2],
    ) -> (Span<V>, Span<V>) {
        if kind == Kind::Edges {
            return (Span(None), Span(None));
        }
        let bounds = self.primitives.bounds;
        let none = v.vset_i32(0);
        let far = v.vset_f32(FAR);
        let minus_far = v.vset_f32(-FAR);
        let flag = v.vset_i32(WITHIN);
        let faces = v.vgather_i32_or(none, live, bounds.column(field!(TriangleBounds.faces)), numbers);
        let within = v.vicmp_ge_masked(live, faces, flag);
        let [across, down] = each!(axis in [0, 1] => {
            let low = bounds.column(field!(TriangleBounds.low[axis]));
            let low = v.vgather_f32_or(minus_far, within, low, numbers);
            let high = bounds.column(field!(TriangleBounds.high[axis]));
            let high = v.vgather_f32_or(far, within, high, numbers);
            Span(Some([v.vsub(low, half[axis]), v.vadd(high, half[axis])]))
        });
        (across, down)
    }

    /// Finds the cells of the records of a part, 16 at a time, from its first up to the end of the list.
    #[inline(always)]
    fn records<V: Vpu, P: Touch<V>>(
        &self,
        v: &mut V,
        frame: &FaceFrame<V>,
        (kind, records): (Kind, Records<P::Record>),
        block: V::S32,
        [first, end]: [V::S32; 2],
    ) {
        let columns = self.raster.records;
        let nodes = self.grid.nodes.cells;
        let first_cell = scalar!(v, block << 4);
        let zero = v.vset_f32(0.0);
        let none = v.vset_i32(0);
        let nothing = v.s_imm(0);
        let cells = v.s_imm(CHILDREN as i32);
        let all = v.mask_all();
        let depths = v.vload_f32(nodes.column(field!(Node.depth)), first_cell);
        let used = v.vcmp_gt(depths, zero);
        let used = v.kmov_to_scalar(used);
        // A block that bounds of images reach into and no receiver lies in.
        if v.branch(Compare::Equal, used, nothing) {
            return;
        }
        // All cells are of one size.
        let half = {
            let of_x = v.vbroadcast_f32(nodes.column(field!(Node.half[0])), first_cell);
            [of_x, v.vbroadcast_f32(nodes.column(field!(Node.half[1])), first_cell)]
        };
        let mut at = first;
        while v.branch(Compare::Less, at, end) {
            let live = lanes_below(v, at, end);
            let numbers = v.vload_i32_or(none, live, columns.column(field!(BlockRecord.primitive)), at);
            let gathered = Gathered::new(v, records, live, numbers);
            let primitives = P::set_up(v, &self.grid.faces, frame, gathered);
            let primitives = primitives.over(v, half);
            let (across, down) = self.spans(v, kind, live, numbers, half);
            let columns_of = each!(column in [0, 1, 2, 3] => {
                let cell = OneNode { nodes, at: first_cell, behind: column };
                across.reaches(v, live, cell, field!(Node.center[0]))
            });
            let mut most = None;
            // Line by line of cells: the code of all 16 would be long.
            let mut line = nothing;
            while v.branch(Compare::Less, line, cells) {
                let cell = scalar!(v, first_cell + line);
                let word = scalar!(v, at + line);
                let first = OneNode { nodes, at: cell, behind: 0 };
                let in_line = down.reaches(v, live, first, field!(Node.center[1]));
                for (column, of_column) in columns_of.into_iter().enumerate() {
                    let cell = OneNode { nodes, at: cell, behind: column as u32 };
                    let here = v.kand(of_column, in_line);
                    let (touched, tested) = primitives.touch(v, cell, Some(here));
                    let bits = v.kmov_to_scalar(touched);
                    let words = columns.column(field!(BlockRecord.cells));
                    v.s_store(words.plus_words(column as u64), word, bits);
                    most = Some(P::most(v, most, touched, tested));
                }
                line = scalar!(v, line + { LINE as i32 });
            }
            if let Some(most) = most {
                let start = primitives.start(v, most);
                v.vstore_f32(all, columns.column(field!(BlockRecord.start)), at, start);
            }
            at = scalar!(v, at + { 16 << PARTS_LOG2 });
        }
    }
}
