//! Binning: triangles and silhouette edges to the bins that hold receivers they can shadow, count → scan → fill.
//!
//! Most triangles are small: of those whose image lies within a face and spans two bins each way at most, 16 are looked at at once, by the
//! bounds of their images. All others, and all edges, descend the hierarchy one by one against 16 nodes: the groups of a face, then
//! the bins of each group that is touched.
//!
//! An item of a bin is a primitive and the blocks of the bin that it touches, so that rasterization asks for no primitive until it has
//! come to the blocks.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::faces::FaceParameters;
use super::grid::Grid;
use super::nodes::Node;
use super::primitives::{EdgeRecord, Kind, Layer, Primitives, TriangleBounds, WITHIN};
use super::touch::{Edge, SideBySide, Touch};
use crate::clear;
use crate::columns::{Columns, lanes_below, take_lane, task_range};
use crate::expression::{each, int, scalar};
use crate::face::{FACES, FaceFrame};
use crate::field;
use crate::lists::Lists;
use crate::record::Record;

/// Number of primitives that a task handles, by [`Kind`]: an edge descends to more bins than most triangles lie in.
const TASK: [u32; 2] = [64, 16];

/// A primitive in the list of a bin.
#[repr(C)]
pub struct BinItem {
    /// Number of the primitive.
    pub primitive: i32,
    /// A bit for each block of the bin that the primitive can touch.
    pub blocks: i32,
}

/// The primitives of each bin.
#[derive(Clone, Copy)]
pub struct Bins {
    /// Lists of the bins by [`Kind`].
    pub lists: Lists,
    /// What is in these lists.
    pub(super) items: Columns<BinItem>,
}

impl Bins {
    /// Puts the primitives into bins: counts what each bin gets, then writes it.
    pub fn build<T: Layer>(
        primitives: &Primitives<T>,
        grid: &Grid,
        runner: &mut Runner<'_>,
    ) -> Result<Bins, Stopped> {
        let tasks = task_counts(primitives).iter().sum();
        let bin_count = grid.faces.bin_count;
        let [starts] = clear::zeroed(runner, [Lists::start_words(2 * bin_count)])?;
        let lists = Lists::new(runner.arena, starts, 2 * bin_count, tasks, bin_count);
        let scratch = runner.arena.overwritten(u64::from(tasks) * u64::from(SCRATCH));
        let bin = |items| Bin { lists, items, scratch, primitives: *primitives, grid: *grid };
        runner.run(&Step::ordered("bin counts", tasks, bin(None)))?;

        let items = lists.sum(runner)?;
        let items = Columns::overwritten(runner.arena, items);
        // SAFETY: each task writes its own table and scratch, and items to places that it has taken in `bin counts`.
        runner.run(&unsafe { Step::independent("bin lists", tasks, bin(Some(items))) })?;
        Ok(Bins { lists, items })
    }
}

/// Tasks of the triangles and of the edges. A point light has no silhouettes.
fn task_counts<T>(primitives: &Primitives<T>) -> [u32; 2] {
    let counts = [primitives.triangle_count, primitives.edge_count];
    Kind::ALL.map(|kind| counts[kind as usize].div_ceil(TASK[kind as usize]))
}

/// Words in which a task turns two vectors into scalars, lane by lane.
const SCRATCH: u32 = 32;

/// Counts or writes the primitives of the bins.
struct Bin<T> {
    lists: Lists,
    /// Where the lists are written; `None` where they are counted.
    items: Option<Columns<BinItem>>,
    /// [`SCRATCH`] words of each task.
    scratch: Addr,
    primitives: Primitives<T>,
    grid: Grid,
}

/// What a task works in.
struct Own<V: Vpu> {
    /// Where its table begins.
    table: V::S32,
    /// Where its scratch begins.
    scratch: V::S32,
}

impl<T: Layer> Kernel for Bin<T> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let primitives = &self.primitives;
        let seen = self.grid.faces.seen(v);
        // Edges first: what takes long is best begun early.
        let edge_tasks = v.s_imm(task_counts(primitives)[Kind::Edges as usize] as i32);
        let table = self.lists.table(v, task);
        let scratch = scalar!(v, task * { SCRATCH as i32 });
        let own = Own { table, scratch };
        if self.items.is_none() {
            self.lists.clear_table(v, table);
        }
        let kind = if v.branch(Compare::LessEqual, edge_tasks, task) {
            let task = scalar!(v, task - edge_tasks);
            let (mut i, end) = task_range(v, task, TASK[Kind::Triangles as usize], primitives.triangle_count);
            while v.branch(Compare::Less, i, end) {
                self.triangles(v, seen, &own, i, end);
                i = scalar!(v, i + 16);
            }
            Kind::Triangles
        } else {
            let (mut i, end) = task_range(v, task, TASK[Kind::Edges as usize], primitives.edge_count);
            while v.branch(Compare::Less, i, end) {
                let edge = primitives.edges.record(v, i);
                let faces = edge.scalar(v, field!(EdgeRecord.faces));
                let faces = scalar!(v, faces & seen);
                self.descend::<V, Edge<V>>(v, edge, faces, i, table, Kind::Edges);
                i = scalar!(v, i + 1);
            }
            Kind::Edges
        };
        if self.items.is_none() {
            let first_list = self.first_list(v, kind);
            self.lists.publish(v, table, first_list);
        }
    }
}

impl<T> Bin<T> {
    /// The list of bin 0 for primitives of `kind`.
    #[inline(always)]
    fn first_list<V: Vpu>(&self, v: &mut V, kind: Kind) -> V::S32 {
        v.s_imm(kind.first_list(self.grid.faces.bin_count) as i32)
    }

    /// Counts a primitive of the bin in the task's table, or writes it to the bin's list with what `blocks` gives.
    #[inline(always)]
    fn put<V: Vpu>(&self, v: &mut V, table: V::S32, kind: Kind, bin: V::S32, number: V::S32, blocks: V::S32) {
        let at = scalar!(v, table + bin);
        let Some(items) = self.items else {
            self.lists.add_one(v, at);
            return;
        };
        let first_list = self.first_list(v, kind);
        let list = scalar!(v, first_list + bin);
        let to = self.lists.place_one(v, at, list);
        v.s_store(items.column(field!(BinItem.primitive)), to, number);
        v.s_store(items.column(field!(BinItem.blocks)), to, blocks);
    }

    /// Descends the hierarchy of each of `faces` with one primitive, and counts or writes it where it comes down.
    #[inline(always)]
    fn descend<V: Vpu, P: Touch<V>>(
        &self,
        v: &mut V,
        record: Record<V, P::Record>,
        faces: V::S32,
        number: V::S32,
        table: V::S32,
        kind: Kind,
    ) {
        let nodes = &self.grid.nodes;
        let none = v.s_imm(0);
        let mut faces = faces;
        while v.branch(Compare::NotEqual, faces, none) {
            let face = take_lane(v, &mut faces);
            let frame = FaceFrame::new(v, face);
            let primitive = P::set_up(v, &self.grid.faces, &frame, record);
            let [mut group, end] = self.grid.faces.groups(v, face);
            while v.branch(Compare::Less, group, end) {
                let own = lanes_below(v, group, end);
                let at = SideBySide { nodes: nodes.groups, at: group };
                let (touched, _) = primitive.touch(v, at, Some(own));
                let mut groups = v.kmov_to_scalar(touched);
                while v.branch(Compare::NotEqual, groups, none) {
                    let lane = take_lane(v, &mut groups);
                    let first_bin = scalar!(v, (group + lane) << 4);
                    let (touched, _) =
                        primitive.touch(v, SideBySide { nodes: nodes.bins, at: first_bin }, None);
                    if self.items.is_none() {
                        let at = scalar!(v, table + first_bin);
                        self.lists.add(v, touched, at);
                        continue;
                    }
                    let mut bins = v.kmov_to_scalar(touched);
                    while v.branch(Compare::NotEqual, bins, none) {
                        let lane = take_lane(v, &mut bins);
                        let bin = scalar!(v, first_bin + lane);
                        let first_block = scalar!(v, bin << 4);
                        let blocks = SideBySide { nodes: nodes.blocks, at: first_block };
                        let (touched, _) = primitive.touch(v, blocks, None);
                        let blocks = v.kmov_to_scalar(touched);
                        self.put(v, table, kind, bin, number, blocks);
                    }
                }
                group = scalar!(v, group + 16);
            }
        }
    }
}

impl<T: Layer> Bin<T> {
    /// Counts or writes the triangles `i..i + 16` below `end`.
    #[inline(always)]
    fn triangles<V: Vpu>(&self, v: &mut V, seen: V::S32, own: &Own<V>, i: V::S32, end: V::S32) {
        let bounds = self.primitives.bounds;
        let none = v.vset_i32(0);
        let live = lanes_below(v, i, end);
        let faces = v.vload_i32_or(none, live, bounds.column(field!(TriangleBounds.faces)), i);
        let seen_or_within = scalar!(v, seen + { WITHIN });
        let kept = v.vsplat(seen_or_within);
        let faces = int!(v, faces & kept);
        let flag = v.vset_i32(WITHIN);
        let within = v.vicmp_gt(faces, flag);
        // What is within no face that receivers see has the flag alone.
        let elsewhere = v.vicmp_eq(faces, flag);
        let some = v.vicmp_neq(faces, none);
        let near = v.kor(within, elsewhere);
        let mut others = v.kandn(near, some);
        if v.branch_any(within) {
            let wide = self.within(v, within, faces, own, i);
            others = v.kor(others, wide);
        }

        let nothing = v.s_imm(0);
        let mut left = v.kmov_to_scalar(others);
        while v.branch(Compare::NotEqual, left, nothing) {
            let lane = take_lane(v, &mut left);
            let number = scalar!(v, i + lane);
            let faces = v.s_load(bounds.column(field!(TriangleBounds.faces)), number);
            let faces = scalar!(v, faces & seen);
            let triangle = self.primitives.triangles.record(v, number);
            self.descend::<V, T::Touch<V>>(v, triangle, faces, number, own.table, Kind::Triangles);
        }
    }

    /// Counts or writes those of the 16 triangles from `i` on, of `faces`, that are `within` a face, but for those that span more than two
    /// bins either way: the lanes of these.
    #[inline(always)]
    fn within<V: Vpu>(&self, v: &mut V, within: V::Mask, faces: V::I32, own: &Own<V>, i: V::S32) -> V::Mask {
        let bounds = self.primitives.bounds;
        let start = v.vload_f32(bounds.column(field!(TriangleBounds.start)), i);
        let low = each!(axis in [0, 1] => v.vload_f32(bounds.column(field!(TriangleBounds.low[axis])), i));
        let high = each!(axis in [0, 1] => v.vload_f32(bounds.column(field!(TriangleBounds.high[axis])), i));
        let mut wide = v.mask_none();
        let zero = v.vset_f32(0.0);
        let one = v.vset_f32(1.0);
        let four = v.vset_i32(4);
        let whole = v.vset_i32(1);
        let two = v.vset_i32(2);
        let none = v.vset_i32(0);
        for face in 0..FACES {
            let bit = v.vset_i32(1 << face);
            let bit = int!(v, faces & bit);
            let here = v.vicmp_neq_masked(within, bit, none);
            if !v.branch_any(here) {
                continue;
            }
            let number = v.s_imm(face as i32);
            let parameters = self.grid.faces.parameters;

            // Cells from the first to the last in each direction: as receivers are put into them, whose places it is compared with.
            let mut touched = here;
            let spans = each!(axis in [0, 1] => {
                let origin = v.vbroadcast_f32(parameters.column(field!(FaceParameters.origin[axis])), number);
                let per_cell = v.vbroadcast_f32(parameters.column(field!(FaceParameters.per_cell[axis])), number);
                let last = v.vbroadcast_f32(parameters.column(field!(FaceParameters.last_cell[axis])), number);
                let first = v.vsub(low[axis], origin);
                let first = v.vmul(first, per_cell);
                let end = v.vsub(high[axis], origin);
                let end = v.vmul(end, per_cell);
                touched = v.vcmp_ge_masked(touched, end, zero);
                let past = v.vadd(last, one);
                touched = v.vcmp_le_masked(touched, first, past);
                let first = v.vmax(first, zero);
                let first = v.vmin(first, last);
                let end = v.vmin(end, last);
                [v.vcvt_f32_i32(first), v.vcvt_f32_i32(end)]
            });
            let bins = each!(axis in [0, 1] => {
                let [first, last] = spans[axis];
                [int!(v, first >> four), int!(v, last >> four)]
            });
            let mut small = touched;
            for [first, last] in bins {
                let across = int!(v, last - first);
                small = v.vicmp_lt_masked(small, across, two);
            }
            let large = v.kandn(small, touched);
            wide = v.kor(wide, large);
            let bins_x = v.vbroadcast_i32(parameters.column(field!(FaceParameters.bins_x)), number);
            let first_bin = v.vbroadcast_i32(parameters.column(field!(FaceParameters.first_bin)), number);

            // The bin of the first cell, and those next to it.
            for (right, down) in [(false, false), (true, false), (false, true), (true, true)] {
                let mut here = small;
                let [x, y] = each!(step in [(0, right), (1, down)] => {
                    let (axis, steps): (usize, bool) = step;
                    let [first, last] = bins[axis];
                    if steps {
                        here = v.vicmp_lt_masked(here, first, last);
                        int!(v, first + whole)
                    } else {
                        first
                    }
                });
                if (right || down) && !v.branch_any(here) {
                    continue;
                }
                let bin = int!(v, ((y * bins_x) + x) + first_bin);
                // Is one of its receivers so deep?
                let deepest =
                    v.vgather_f32_or(zero, here, self.grid.nodes.bins.column(field!(Node.depth)), bin);
                let here = v.vcmp_le_masked(here, start, deepest);
                let all = v.mask_all();
                v.vstore_i32(all, self.scratch, own.scratch, bin);
                if self.items.is_some() {
                    let blocks = blocks(v, spans, [x, y]);
                    v.vstore_i32(all, self.scratch.plus_lines(1), own.scratch, blocks);
                }
                self.put_all(v, here, own, i);
            }
        }
        wide
    }

    /// Counts or writes those of the 16 triangles from `i` on that are `here`, whose bins and blocks are in the task's scratch.
    #[inline(always)]
    fn put_all<V: Vpu>(&self, v: &mut V, here: V::Mask, own: &Own<V>, i: V::S32) {
        let nothing = v.s_imm(0);
        let mut left = v.kmov_to_scalar(here);
        while v.branch(Compare::NotEqual, left, nothing) {
            let lane = take_lane(v, &mut left);
            let at = own.scratch;
            let at = scalar!(v, at + lane);
            let bin = v.s_load(self.scratch, at);
            let number = scalar!(v, i + lane);
            let blocks = match self.items {
                Some(_) => v.s_load(self.scratch.plus_lines(1), at),
                None => nothing,
            };
            self.put(v, own.table, Kind::Triangles, bin, number, blocks);
        }
    }
}

/// The blocks of a bin that cells from the first to the last in each direction lie in, a bit each; of 16 bins, by the column and the line
/// of each.
#[inline(always)]
fn blocks<V: Vpu>(v: &mut V, spans: [[V::I32; 2]; 2], bin: [V::I32; 2]) -> V::I32 {
    let none = v.vset_i32(0);
    let four = v.vset_i32(4);
    let last_cell = v.vset_i32(15);
    let one = v.vset_i32(1);
    let two = v.vset_i32(2);
    let [across, down] = each!(axis in [0, 1] => {
        let [first, last] = spans[axis];
        let column = bin[axis];
        let origin = int!(v, column << four);
        let first = int!(v, first - origin);
        let first = v.vimax(first, none);
        let last = int!(v, last - origin);
        let last = v.vimin(last, last_cell);
        [int!(v, first >> two), int!(v, last >> two)]
    });
    // Bits of a line of blocks, in all lines, and bits of all blocks of the lines.
    let every_line = v.vset_i32(0x1111);
    let [first, last] = across;
    let columns = int!(v, ((two << last) - (one << first)) * every_line);
    let [first, last] = down;
    let past_line = v.vset_i32(16);
    let lines = int!(v, (past_line << (last << two)) - (one << (first << two)));
    int!(v, columns & lines)
}
