//! Binning: triangles and silhouette edges to the bins that hold receivers they can shadow, count → scan → fill.
//!
//! Descends the hierarchy 16 at a time: the groups of a face, then the bins of each group that is touched.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::FACES;
use super::grid::Grid;
use super::primitives::{EdgeRecord, FACES_SHIFT, Kind, Layer, Primitives};
use super::touch::{Edge, FaceFrame, Touch};
use crate::clear;
use crate::columns::{lanes_below, take_lane, task_range};
use crate::expression::scalar;
use crate::field;
use crate::lists::Lists;
use crate::record::Record;

/// Number of triangles or edges that a task handles.
const TASK: u32 = 64;

/// The primitives of each bin.
#[derive(Clone, Copy)]
pub struct Bins {
    /// Lists of the bins by [`Kind`].
    pub lists: Lists,
    /// The numbers of primitives in these lists.
    pub(super) items: Addr,
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
        let bin = |items| Bin { lists, items, primitives: *primitives, grid: *grid };
        runner.run(&Step::ordered("bin counts", tasks, bin(None)))?;

        let items = lists.sum(runner)?;
        let items = runner.arena.overwritten(u64::from(items));
        // SAFETY: each task writes its own table, and items to places that it has taken in `bin counts`.
        runner.run(&unsafe { Step::independent("bin lists", tasks, bin(Some(items))) })?;
        Ok(Bins { lists, items })
    }
}

/// Tasks of the triangles and of the edges. A point light has no silhouettes.
fn task_counts<T>(primitives: &Primitives<T>) -> [u32; 2] {
    [primitives.triangle_count.div_ceil(TASK), primitives.edge_count.div_ceil(TASK)]
}

/// Counts or writes the primitives of the bins.
struct Bin<T> {
    lists: Lists,
    /// Where the lists are written; `None` where they are counted.
    items: Option<Addr>,
    primitives: Primitives<T>,
    grid: Grid,
}

impl<T: Layer> Kernel for Bin<T> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let primitives = &self.primitives;
        let seen = self.grid.faces.seen(v);
        let triangle_tasks = v.s_imm(task_counts(primitives)[Kind::Triangles as usize] as i32);
        let table = self.lists.table(v, task);
        if self.items.is_none() {
            self.lists.clear_table(v, table);
        }
        let kind = if v.branch(Compare::Less, task, triangle_tasks) {
            let (mut i, end) = task_range(v, task, TASK, primitives.triangle_count);
            let none = v.s_imm(0);
            while v.branch(Compare::Less, i, end) {
                let triangle = primitives.triangles.record(v, i);
                let flags = triangle.scalar(v, T::flags());
                let layers = scalar!(v, flags & { T::COUNTED });
                if v.branch(Compare::NotEqual, layers, none) {
                    let faces = scalar!(v, (flags >> { FACES_SHIFT }) & seen);
                    self.descend::<V, T::Touch<V>>(v, triangle, faces, i, table, Kind::Triangles);
                }
                i = scalar!(v, i + 1);
            }
            Kind::Triangles
        } else {
            let task = scalar!(v, task - triangle_tasks);
            let (mut i, end) = task_range(v, task, TASK, primitives.edge_count);
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

    /// Adds primitive `number`, whose record is given, to the bins of `faces` (a bit each) that it touches. The task's table
    /// begins at `table`.
    ///
    /// The code of each face knows its axes and nothing else of it.
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
        let Bin { lists, items, .. } = self;
        let nodes = &self.grid.nodes;
        let none = v.s_imm(0);
        for face in 0..FACES {
            let here = scalar!(v, faces & { 1 << face });
            if v.branch(Compare::Equal, here, none) {
                continue;
            }
            let primitive = P::set_up(v, &self.grid.faces, FaceFrame::new(face), record);
            let [mut group, end] = self.grid.faces.groups(v, face);
            while v.branch(Compare::Less, group, end) {
                let own = lanes_below(v, group, end);
                let (touched, _) = primitive.touch(v, nodes.groups, group, Some(own));
                let mut groups = v.kmov_to_scalar(touched);
                while v.branch(Compare::NotEqual, groups, none) {
                    let lane = take_lane(v, &mut groups);
                    let first_bin = scalar!(v, (group + lane) << 4);
                    let (touched, _) = primitive.touch(v, nodes.bins, first_bin, None);
                    if v.branch_any(touched) {
                        let at = scalar!(v, table + first_bin);
                        if let Some(items) = *items {
                            let first_list = self.first_list(v, kind);
                            let list = scalar!(v, first_list + first_bin);
                            let to = lists.place(v, touched, at, list);
                            let number = v.vsplat(number);
                            v.vscatter_i32(touched, items, to, number);
                        } else {
                            lists.add(v, touched, at);
                        }
                    }
                }
                group = scalar!(v, group + 16);
            }
        }
    }
}
