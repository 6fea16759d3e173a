//! Binning: triangles and silhouette edges to the bins that hold receivers they can shadow, count → scan → fill.
//!
//! Descends the hierarchy 16 at a time: the groups of a face, then the bins of each group that is touched.

use lrbsim_isa::scan::{self, Scan};
use lrbsim_isa::{Addr, Arena, Compare, Kernel, Ordering, Step, Vpu};

use super::Frame;
use super::layout::{CHILDREN, EDGE_WORDS, Layout};
use super::touch::{Edge, FaceFrame, Touch, Triangle};
use crate::columns::{lanes_below, take_lane, task_range};
use crate::plane::{BACK, FACES_SHIFT, FRONT, TRIANGLE_WORDS};

/// Triangles or edges of a task.
const TASK: u32 = 64;

/// How many primitives each bin gets.
pub fn count(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let lists = 2 * u64::from(layout.bin_count);
    layout.bin_ends = arena.alloc(16 + scan::padded(lists)).plus(64);
    frame.scan = Scan::new(arena, layout.bin_ends, lists);
    step("bin counts", Ordering::Independent, layout, false)
}

/// The primitives themselves.
pub fn fill(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let total = arena.read_u32(layout.bin_ends.plus(8 * u64::from(layout.bin_count)));
    layout.bin_lists = arena.alloc(u64::from(total));
    step("bin lists", Ordering::Ordered, layout, true)
}

fn step(name: &'static str, ordering: Ordering, layout: &Layout, fill: bool) -> Step {
    let edges = if layout.is_soft() { layout.silhouette_count } else { 0 };
    let triangle_tasks = layout.triangle_count.div_ceil(TASK);
    let kernel = Bin { layout: *layout, triangle_tasks, edges, fill };
    Step { name, ordering, tasks: triangle_tasks + edges.div_ceil(TASK), kernel: Box::new(kernel) }
}

struct Bin {
    layout: Layout,
    triangle_tasks: u32,
    edges: u32,
    fill: bool,
}

impl Kernel for Bin {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let triangle_tasks = v.s_imm(self.triangle_tasks as i32);
        let one = v.s_imm(1);
        if v.branch(Compare::Less, task, triangle_tasks) {
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
                    self.descend::<V, Triangle<V>>(v, (layout.triangle_records, index), faces, i, 0);
                }
                i = v.s_add(i, one);
            }
        } else {
            let task = v.s_sub(task, triangle_tasks);
            let (mut i, end) = task_range(v, task, TASK, self.edges);
            let words = v.s_imm(EDGE_WORDS as i32);
            while v.branch(Compare::Less, i, end) {
                let index = v.s_mul(i, words);
                let faces = v.s_load(layout.edge_records.plus(52), index);
                let record = (layout.edge_records, index);
                self.descend::<V, Edge<V>>(v, record, faces, i, layout.bin_count);
                i = v.s_add(i, one);
            }
        }
    }
}

impl Bin {
    /// Adds primitive `number`, whose record is given, to the bins of `faces` (a bit each) that it touches, whose lists
    /// begin at `first_list`.
    #[inline(always)]
    fn descend<V: Vpu, P: Touch<V>>(
        &self,
        v: &mut V,
        (records, index): (Addr, V::S32),
        faces: V::S32,
        number: V::S32,
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
                        let lists = layout.bin_ends.plus(4 * u64::from(first_list));
                        self.add(v, touched, lists, bin, number);
                    }
                }
                group = v.s_add(group, sixteen);
            }
        }
    }

    /// Counts the primitive in 16 consecutive lists, or adds it to them.
    #[inline(always)]
    fn add<V: Vpu>(&self, v: &mut V, live: V::Mask, lists: Addr, first: V::S32, number: V::S32) {
        let at = append(v, live, lists, first);
        if self.fill {
            let number = v.vsplat(number);
            v.vscatter_i32(live, self.layout.bin_lists, at, number);
        }
    }
}

/// Adds one to 16 consecutive counters; what they were before.
#[inline(always)]
pub fn append<V: Vpu>(v: &mut V, live: V::Mask, counters: Addr, first: V::S32) -> V::I32 {
    let lane = v.viota();
    let base = v.vsplat(first);
    let counter = v.viadd(base, lane);
    let one = v.vset_i32(1);
    v.vatomic_add_or(lane, live, counters, counter, one)
}
