//! Binning: triangles and silhouette edges to the bins that hold receivers they can shadow, count → scan → fill.
//!
//! Descends the hierarchy 16 at a time: the groups of a face, then the bins of each group that is touched.

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Ordering, Step, Vpu};

use super::Frame;
use super::layout::{CHILDREN, EDGE_WORDS, Layout};
use super::lists::Lists;
use super::touch::{Edge, FaceFrame, Touch, Triangle};
use crate::columns::{lanes_below, take_lane, task_range};
use crate::plane::{BACK, FACES_SHIFT, FRONT, TRIANGLE_WORDS};

/// Triangles or edges of a task.
const TASK: u32 = 64;

/// How many primitives each bin gets.
pub fn count(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let tasks = tasks(layout).iter().sum();
    (layout.bin_lists, frame.scan) = Lists::new(arena, 2 * layout.bin_count, tasks, layout.bin_count);
    step("bin counts", Ordering::Ordered, layout, false)
}

/// The primitives themselves.
pub fn fill(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let total = arena.read_u32(layout.bin_lists.starts.plus(8 * u64::from(layout.bin_count)));
    layout.bin_items = arena.alloc(u64::from(total));
    step("bin lists", Ordering::Independent, layout, true)
}

fn step(name: &'static str, ordering: Ordering, layout: &Layout, fill: bool) -> Step {
    let [triangle_tasks, edge_tasks] = tasks(layout);
    let kernel = Bin { layout: *layout, triangle_tasks, fill };
    Step { name, ordering, tasks: triangle_tasks + edge_tasks, kernel: Box::new(kernel) }
}

/// Tasks of the triangles and of the edges. A point light has no silhouettes.
fn tasks(layout: &Layout) -> [u32; 2] {
    [layout.triangle_count.div_ceil(TASK), layout.silhouette_count.div_ceil(TASK)]
}

struct Bin {
    layout: Layout,
    triangle_tasks: u32,
    fill: bool,
}

impl Kernel for Bin {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let triangle_tasks = v.s_imm(self.triangle_tasks as i32);
        let one = v.s_imm(1);
        let table = layout.bin_lists.table(v, task);
        let first_list = if v.branch(Compare::Less, task, triangle_tasks) {
            let (mut i, end) = task_range(v, task, TASK, layout.triangle_count);
            let words = v.s_imm(TRIANGLE_WORDS as i32);
            let layers = v.s_imm(FRONT | BACK);
            let none = v.s_imm(0);
            while v.branch(Compare::Less, i, end) {
                let index = v.s_mul(i, words);
                let flags = v.s_load(layout.triangle_records.plus(52), index);
                let counted = v.s_and(flags, layers);
                if v.branch(Compare::NotEqual, counted, none) {
                    let shift = v.s_imm(FACES_SHIFT);
                    let faces = v.s_shr(flags, shift);
                    let record = (layout.triangle_records, index);
                    self.descend::<V, Triangle<V>>(v, record, faces, i, table, 0);
                }
                i = v.s_add(i, one);
            }
            0
        } else {
            let task = v.s_sub(task, triangle_tasks);
            let (mut i, end) = task_range(v, task, TASK, layout.silhouette_count);
            let words = v.s_imm(EDGE_WORDS as i32);
            while v.branch(Compare::Less, i, end) {
                let index = v.s_mul(i, words);
                let faces = v.s_load(layout.edge_records.plus(52), index);
                let record = (layout.edge_records, index);
                self.descend::<V, Edge<V>>(v, record, faces, i, table, layout.bin_count);
                i = v.s_add(i, one);
            }
            layout.bin_count
        };
        if !self.fill {
            let first_list = v.s_imm(first_list as i32);
            layout.bin_lists.publish(v, table, first_list);
        }
    }
}

impl Bin {
    /// Adds primitive `number`, whose record is given, to the bins of `faces` (a bit each) that it touches. Their lists
    /// begin at `first_list`, the task's table at `table`.
    #[inline(always)]
    fn descend<V: Vpu, P: Touch<V>>(
        &self,
        v: &mut V,
        (records, index): (Addr, V::S32),
        faces: V::S32,
        number: V::S32,
        table: V::S32,
        first_list: u32,
    ) {
        let layout = &self.layout;
        let none = v.s_imm(0);
        let four = v.s_imm(4);
        let sixteen = v.s_imm(16);
        for grid in &layout.faces[..layout.face_count as usize] {
            let bit = v.s_imm(1 << grid.face);
            let here = v.s_and(faces, bit);
            if v.branch(Compare::Equal, here, none) {
                continue;
            }
            let primitive = P::set_up(v, &layout.light, FaceFrame::new(grid), records, index);
            let mut group = v.s_imm((grid.first_bin / CHILDREN) as i32);
            let end = v.s_imm(((grid.first_bin + grid.bins_padded()) / CHILDREN) as i32);
            while v.branch(Compare::Less, group, end) {
                let (touched, _) = primitive.touch(v, layout.groups, group);
                let own = lanes_below(v, group, end);
                let touched = v.kand(touched, own);
                let mut bits = v.kmov_to_scalar(touched);
                while v.branch(Compare::NotEqual, bits, none) {
                    let lane = take_lane(v, &mut bits);
                    let child = v.s_add(group, lane);
                    let bin = v.s_shl(child, four);
                    let (touched, _) = primitive.touch(v, layout.bins, bin);
                    if v.branch_any(touched) {
                        let at = v.s_add(table, bin);
                        if self.fill {
                            let first_list = v.s_imm(first_list as i32);
                            let list = v.s_add(first_list, bin);
                            let to = layout.bin_lists.place(v, touched, at, list);
                            let number = v.vsplat(number);
                            v.vscatter_i32(touched, layout.bin_items, to, number);
                        } else {
                            layout.bin_lists.add(v, touched, at);
                        }
                    }
                }
                group = v.s_add(group, sixteen);
            }
        }
    }
}
