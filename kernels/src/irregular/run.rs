//! Runs: equal shares of the work that samples and records of cells make together, one a task, and the walk through one.
//!
//! A task owns the samples of its run, so that sums need no atomics and repeat bit for bit. Cell by cell it takes 16
//! samples at a time and walks the records of the block that touch the cell; a record that begins deeper than all 16 is skipped. It
//! leaves sums for each of its samples, those of cells without records included.
//!
//! Where a block has no records of a kind, no run goes there, and nobody writes or reads its sums. A block whose samples and records
//! make too many vector tests is split into a power of two of runs; those of triangles and those of edges are split apart.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::CHILDREN;
use super::faces::BinPlace;
use super::grid::{Grid, Sample, depths_of_face};
use super::primitives::Kind;
use super::raster::{BlockRecord, Raster};
use crate::clear;
use crate::columns::{Columns, lanes_below, lower, sum, take_lane, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::plane::Vec3;
use crate::record::{Records, words};

/// Blocks of a task of the steps that split.
const BLOCKS: u32 = 8;

/// Vectors of samples of a run times the records of their block, by [`Kind`], as powers of two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunSizes(pub [i32; 2]);

/// Into how many runs a block is split.
#[repr(C)]
pub struct Split {
    /// j + 1 for 2^j runs, by [`Kind`]; 0 where there is nothing to do, so that its samples have no sums.
    pub log2: [i32; 2],
}

/// A share of a block's samples: a task of `hard` or of `soft`.
#[repr(C)]
struct Run {
    /// Number of the block.
    block: u32,
    /// Which of the block's 2^j shares.
    share: u32,
    /// j + 1, where the block is split into 2^j runs.
    log2: u32,
}

/// A counter that shares its line with nothing.
#[repr(C, align(64))]
struct Counter {
    count: u32,
}

/// Counters of the runs.
#[repr(C)]
struct RunCounters {
    /// Number of runs of all blocks, by [`Kind`].
    totals: [Counter; 2],
    /// Number of runs that have been written, by [`Kind`].
    written: [Counter; 2],
}

/// The runs of a frame: equal shares of samples times records.
#[derive(Clone, Copy)]
pub struct Runs {
    /// The runs of each [`Kind`].
    runs: [Columns<Run>; 2],
    /// Number of runs by [`Kind`].
    counts: [u32; 2],
    /// How each block is split.
    pub splits: Columns<Split>,
}

impl Runs {
    /// Splits the samples of each block into runs: counts them, then writes them.
    pub fn build(
        grid: &Grid,
        raster: &Raster,
        sizes: RunSizes,
        runner: &mut Runner<'_>,
    ) -> Result<Runs, Stopped> {
        let [counters] = clear::zeroed(runner, [u64::from(words::<RunCounters>())])?;
        let counters: Records<RunCounters> = Records::from_base(counters);
        let block_count = grid.faces.block_count();
        let splits = Columns::overwritten(runner.arena, block_count);
        let tasks = block_count.div_ceil(BLOCKS);
        let count = Count { counters, splits, grid: *grid, raster: *raster, sizes };
        // SAFETY: each task writes the splits of its own blocks and adds to the totals.
        runner.run(&unsafe { Step::independent("run counts", tasks, count) })?;

        let totals = counters.field(field!(RunCounters.totals));
        let counts = [0, 1].map(|kind| runner.arena.read_u32(totals.plus_lines(kind)));
        let runs = counts.map(|count| Columns::overwritten(runner.arena, count));
        runner.run(&Step::ordered("runs", tasks, Fill { counters, splits, runs, block_count }))?;
        Ok(Runs { runs, counts, splits })
    }
}

/// Vectors of samples in each of the 16 cells of a block.
#[inline(always)]
fn cell_vectors<V: Vpu>(v: &mut V, grid: &Grid, first_cell: V::S32) -> V::I32 {
    let all = v.mask_all();
    let none = v.vset_i32(0);
    let two = v.vset_i32(2);
    let four = v.vset_i32(4);
    let fifteen = v.vset_i32(15);
    let lane = v.viota();
    let cell = v.vsplat(first_cell);
    let key = int!(v, (cell + lane) << two);
    let first = v.vgather_i32_or(none, all, grid.cell_starts(0), key);
    let end = v.vgather_i32_or(none, all, grid.cell_starts(1), key);
    int!(v, ((end - first) + fifteen) >> four)
}

/// More vectors of samples, or records, than this are as many: their product fits a word.
const COUNTED_MAX: i32 = 1 << 15;

/// Splits blocks into runs: 2^j of them, j the least with no more than the wished number of vector tests in each.
struct Count {
    counters: Records<RunCounters>,
    splits: Columns<Split>,
    grid: Grid,
    raster: Raster,
    sizes: RunSizes,
}

impl Kernel for Count {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Count { counters, splits, grid, raster, sizes } = self;
        let one = v.s_imm(1);
        let zero = v.s_imm(0);
        let (mut block, end) = task_range(v, task, BLOCKS, grid.faces.block_count());
        let mut totals = [zero; 2];
        while v.branch(Compare::Less, block, end) {
            let first_cell = scalar!(v, block << 4);
            let vectors = cell_vectors(v, grid, first_cell);
            let vector_count = sum(v, vectors);
            let most = v.s_imm(COUNTED_MAX);
            let vectors = lower(v, vector_count, most);
            for kind in Kind::ALL {
                let [first, end] = raster.range(v, kind, block);
                let records = scalar!(v, end - first);
                let records = lower(v, records, most);
                let tests = scalar!(v, vectors * records);
                let mut log2 = zero;
                if v.branch(Compare::Less, zero, tests) {
                    let wished = v.s_imm(1 << sizes.0[kind as usize]);
                    let mut left = tests;
                    let mut vectors_left = vector_count;
                    log2 = one;
                    while v.branch(Compare::Less, wished, left) {
                        if v.branch(Compare::LessEqual, vectors_left, one) {
                            break;
                        }
                        left = scalar!(v, left >> 1);
                        vectors_left = scalar!(v, vectors_left >> 1);
                        log2 = scalar!(v, log2 + 1);
                    }
                    let total = totals[kind as usize];
                    totals[kind as usize] = scalar!(v, total + (1 << (log2 - 1)));
                }
                v.s_store(splits.column(field!(Split.log2[kind as usize])), block, log2);
            }
            block = scalar!(v, block + 1);
        }
        for (kind, total) in totals.into_iter().enumerate() {
            let counter = counters.field(field!(RunCounters.totals[kind]));
            v.s_atomic_add(counter, zero, total);
        }
    }
}

/// Writes the runs of blocks that are split.
struct Fill {
    counters: Records<RunCounters>,
    splits: Columns<Split>,
    /// Where the runs of each [`Kind`] are written.
    runs: [Columns<Run>; 2],
    block_count: u32,
}

impl Kernel for Fill {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let zero = v.s_imm(0);
        let (first, end) = task_range(v, task, BLOCKS, self.block_count);
        for (kind, columns) in self.runs.into_iter().enumerate() {
            let splits = self.splits.column(field!(Split.log2[kind]));
            // Count, take room with one atomic, fill.
            let mut total = zero;
            let mut block = first;
            while v.branch(Compare::Less, block, end) {
                let log2 = v.s_load(splits, block);
                if v.branch(Compare::Less, zero, log2) {
                    total = scalar!(v, total + (1 << (log2 - 1)));
                }
                block = scalar!(v, block + 1);
            }
            if !v.branch(Compare::Less, zero, total) {
                continue;
            }
            let written = self.counters.field(field!(RunCounters.written[kind]));
            let mut at = v.s_atomic_add(written, zero, total);
            let mut block = first;
            while v.branch(Compare::Less, block, end) {
                let log2 = v.s_load(splits, block);
                if v.branch(Compare::Less, zero, log2) {
                    let count = scalar!(v, 1 << (log2 - 1));
                    let mut share = zero;
                    while v.branch(Compare::Less, share, count) {
                        v.s_store(columns.column(field!(Run.block)), at, block);
                        v.s_store(columns.column(field!(Run.share)), at, share);
                        v.s_store(columns.column(field!(Run.log2)), at, log2);
                        at = scalar!(v, at + 1);
                        share = scalar!(v, share + 1);
                    }
                }
                block = scalar!(v, block + 1);
            }
        }
    }
}

/// 16 samples of one cell.
pub struct Samples<V: Vpu> {
    /// Lanes that hold a sample.
    pub live: V::Mask,
    /// Number of the sample in lane 0.
    pub first: V::S32,
    /// Number of their block.
    pub block: V::S32,
    /// Which of the 16 cells of the block is theirs.
    pub cell: i32,
    /// Where the samples lie, light-centred.
    pub position: Vec3<V>,
}

/// What a kernel does with samples and the records of their cell.
pub trait See {
    /// Looks at `samples` and at the records of their cell that `found` finds.
    fn see<V: Vpu>(&self, v: &mut V, walk: &Walk, samples: &Samples<V>, found: Found<V>);

    /// Where zeros are left for the samples of cells without primitives; `None`: these are looked at like all others.
    fn zeros(&self) -> Option<[Addr; 2]>;
}

/// What a kernel does with samples and the primitives that can shadow them, one after the other.
pub trait Shade {
    /// What it keeps of 16 samples from their first primitive to the last.
    type State<V: Vpu>;

    /// What is known of `samples` before the first primitive.
    fn begin<V: Vpu>(&self, v: &mut V, samples: &Samples<V>) -> Self::State<V>;

    /// Takes one primitive into account that can shadow one of `samples`.
    fn add<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &mut Self::State<V>, entry: Entry<V>);

    /// See [`See::zeros`].
    fn zeros(&self) -> Option<[Addr; 2]>;

    /// Stores what it has found out about `samples` after their last primitive, or without any.
    fn end<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &Self::State<V>);
}

/// One primitive after the other that begins no deeper than the deepest of the samples.
impl<S: Shade> See for S {
    #[inline(always)]
    fn see<V: Vpu>(&self, v: &mut V, walk: &Walk, samples: &Samples<V>, mut found: Found<V>) {
        let mut state = self.begin(v, samples);
        while let Some(entry) = found.next(v, walk) {
            self.add(v, samples, &mut state, entry);
        }
        self.end(v, samples, &state);
    }

    #[inline(always)]
    fn zeros(&self) -> Option<[Addr; 2]> {
        Shade::zeros(self)
    }
}

/// A record that has been found.
pub struct Entry<V: Vpu> {
    raster: Raster,
    at: V::S32,
}

impl<V: Vpu> Entry<V> {
    /// Number of its primitive.
    #[inline(always)]
    pub fn number(&self, v: &mut V) -> V::S32 {
        self.raster.primitive(v, self.at)
    }

    /// Number of its primitive, in every lane.
    #[inline(always)]
    pub fn in_every_lane(&self, v: &mut V) -> V::I32 {
        v.vbroadcast_i32(self.raster.records.column(field!(BlockRecord.primitive)), self.at)
    }
}

/// The records of a block that touch a cell and begin no deeper than 16 samples of it, one after the other.
pub struct Found<V: Vpu> {
    /// Depth of the deepest of the samples, in every lane.
    deepest: V::F32,
    /// The group that is looked at next, by its first record, and one past the last record of the block.
    next: V::S32,
    end: V::S32,
    /// Where the bits of the cell are in the next group.
    cell: V::S32,
    /// Those left of the group before.
    bits: V::S32,
}

impl<V: Vpu> Found<V> {
    /// The next record, if there is any left.
    #[inline(always)]
    pub fn next(&mut self, v: &mut V, walk: &Walk) -> Option<Entry<V>> {
        let nothing = v.s_imm(0);
        let records = walk.raster.records;
        loop {
            if v.branch(Compare::NotEqual, self.bits, nothing) {
                let lane = take_lane(v, &mut self.bits);
                let next = self.next;
                let at = scalar!(v, (next - 16) + lane);
                return Some(Entry { raster: walk.raster, at });
            }
            let at = self.next;
            if !v.branch(Compare::Less, at, self.end) {
                return None;
            }
            let bits = v.s_load(records.column(field!(BlockRecord.cells)), self.cell);
            let cell = self.cell;
            self.cell = scalar!(v, cell + 16);
            self.next = scalar!(v, at + 16);
            if v.branch(Compare::NotEqual, bits, nothing) {
                let starts = v.vload_f32(records.column(field!(BlockRecord.start)), at);
                let reached = v.vcmp_le(starts, self.deepest);
                let reached = v.kmov_to_scalar(reached);
                self.bits = scalar!(v, bits & reached);
            }
        }
    }
}

/// Walks the runs of one kind of primitives: 16 samples of a cell at a time, past all records of the cell.
#[derive(Clone, Copy)]
pub struct Walk {
    runs: Columns<Run>,
    run_count: u32,
    grid: Grid,
    raster: Raster,
    kind: Kind,
}

impl Walk {
    /// The walk through the records of `kind`.
    pub fn new(kind: Kind, grid: &Grid, raster: &Raster, runs: &Runs) -> Walk {
        let k = kind as usize;
        Walk { runs: runs.runs[k], run_count: runs.counts[k], grid: *grid, raster: *raster, kind }
    }

    /// Number of runs that there are to walk: tasks of the step that does.
    pub fn run_count(&self) -> u32 {
        self.run_count
    }

    /// Walks run `run` and has `kernel` see all of it.
    #[inline(always)]
    pub fn run<V: Vpu>(&self, v: &mut V, run: V::S32, kernel: &impl See) {
        let Walk { grid, raster, .. } = self;
        let zero = v.s_imm(0);
        let block = v.s_load(self.runs.column(field!(Run.block)), run);
        let share = v.s_load(self.runs.column(field!(Run.share)), run);
        let log2 = v.s_load(self.runs.column(field!(Run.log2)), run);
        let log2 = scalar!(v, log2 - 1);

        // This run's vectors of the block: first..end of count.
        let first_cell = scalar!(v, block << 4);
        let vectors = cell_vectors(v, grid, first_cell);
        let count = sum(v, vectors);
        let first = scalar!(v, (share * count) >> log2);
        let end = scalar!(v, ((share + 1) * count) >> log2);

        // The face, for the depth of the samples.
        let bin = scalar!(v, first_cell >> 8);
        let face = v.s_load(grid.faces.bin_places.column(field!(BinPlace.face)), bin);
        let depths = depths_of_face(v, grid.samples, face);
        let [record_first, record_end] = raster.range(v, self.kind, block);

        let mut seen = zero;
        for number in 0..CHILDREN as i32 {
            let cell = scalar!(v, first_cell + { number });
            let key = scalar!(v, cell << 2);
            let sample_first = v.s_load(grid.cell_starts(0), key);
            let sample_end = v.s_load(grid.cell_starts(1), key);
            let in_cell = scalar!(v, ((sample_end - sample_first) + 15) >> 4);
            let cell_first = seen;
            seen = scalar!(v, seen + in_cell);
            // Does the run reach this cell?
            if v.branch(Compare::LessEqual, seen, first) {
                continue;
            }
            if v.branch(Compare::LessEqual, end, cell_first) {
                break;
            }
            // This run's samples of the cell.
            let from = if v.branch(Compare::Less, cell_first, first) { first } else { cell_first };
            let to = lower(v, seen, end);
            let from = scalar!(v, from - cell_first);
            let to = scalar!(v, to - cell_first);
            let from = scalar!(v, from << 4);
            let to = scalar!(v, to << 4);
            let mut i = scalar!(v, sample_first + from);
            let stop = scalar!(v, sample_first + to);
            let stop = lower(v, stop, sample_end);
            // The first group with a record that touches the cell.
            let mut group = record_first;
            let mut bits_at = scalar!(v, group + { number });
            let mut touched = false;
            while v.branch(Compare::Less, group, record_end) {
                let bits = v.s_load(raster.records.column(field!(BlockRecord.cells)), bits_at);
                if v.branch(Compare::NotEqual, bits, zero) {
                    touched = true;
                    break;
                }
                group = scalar!(v, group + 16);
                bits_at = scalar!(v, bits_at + 16);
            }
            if let Some(zeros) = kernel.zeros()
                && !touched
            {
                Walk::nothing(v, zeros, i, stop);
                continue;
            }
            while v.branch(Compare::Less, i, stop) {
                let live = lanes_below(v, i, stop);
                // Past the last sample of all there is nothing to load.
                let none = v.vset_f32(0.0);
                let position = each!(axis in [0, 1, 2] => {
                    v.vload_f32_or(none, live, grid.samples.column(field!(Sample.position[axis])), i)
                });
                let samples = Samples { live, first: i, block, cell: number, position };
                let deepest = self.deepest(v, &samples, depths);
                let found = Found { deepest, next: group, end: record_end, cell: bits_at, bits: zero };
                kernel.see(v, self, &samples, found);
                i = scalar!(v, i + 16);
            }
        }
    }

    /// Leaves zeros for samples `first..end`, of a cell without records.
    #[inline(always)]
    fn nothing<V: Vpu>(v: &mut V, zeros: [Addr; 2], first: V::S32, end: V::S32) {
        let none = v.vset_i32(0);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            for zeros in zeros {
                v.vstore_i32(live, zeros, i, none);
            }
            i = scalar!(v, i + 16);
        }
    }

    /// Depth of the deepest of `samples`, in every lane. Depths begin `depths` words after the positions.
    #[inline(always)]
    fn deepest<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, depths: V::S32) -> V::F32 {
        let none = v.vset_f32(0.0);
        let first = samples.first;
        let at = scalar!(v, depths + first);
        let depth = v.vload_f32_or(none, samples.live, self.grid.samples.column(field!(Sample.position)), at);
        let depth = v.vabs(depth);
        math::reduce_max(v, depth)
    }

    /// The records of `kind`, another than the one that is walked, that touch the cell of `samples` and are `found` to begin no deeper.
    #[inline(always)]
    pub fn of_kind<V: Vpu>(&self, v: &mut V, kind: Kind, samples: &Samples<V>, found: &Found<V>) -> Found<V> {
        let [next, end] = self.raster.range(v, kind, samples.block);
        let cell = scalar!(v, next + { samples.cell });
        Found { deepest: found.deepest, next, end, cell, bits: v.s_imm(0) }
    }
}
