//! Composition: one clamp of all layers and parts, and visibility to the pixels [johnson09, Eq. 4].

use lrbsim_isa::{Arena, Compare, Kernel, Ordering, Step, Vpu};

use super::Frame;
use super::hard::LAYERS;
use super::layout::{Layout, PIXEL, RECEIVER};
use super::soft::{COVERAGE, WHOLE};
use crate::columns::{lanes_below, task_range};

/// Samples of a task.
const TASK: u32 = 1024;

/// Composes all samples.
pub fn compose(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "compose",
        ordering: Ordering::Independent,
        tasks: layout.receiver_count.div_ceil(TASK),
        kernel: Box::new(Compose { layout }),
    }
}

struct Compose {
    layout: Layout,
}

impl Kernel for Compose {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let none = v.vset_i32(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let mut sum = |column| v.vload_i32_or(none, live, layout.sums.column(column), i);
            let layers = [sum(LAYERS), sum(LAYERS + 1)];
            let parts = layout.is_soft().then(|| [sum(COVERAGE), sum(COVERAGE + 1)]);
            let visible = visible(v, layers, parts);
            let receiver = v.vload_i32_or(none, live, layout.samples.column(RECEIVER), i);
            let pixel = v.vgather_i32_or(none, live, layout.receivers.column(PIXEL), receiver);
            v.vscatter_f32(live, layout.visibility, pixel, visible);
            i = v.s_add(i, step);
        }
    }
}

/// Visible part of the light, from layers and fixed-point parts in F and B: `1 - min(max(|F|, |B|), 1)`.
///
/// The sign: a face that has receiver and middle of the light on one side covers part of the light from there, but runs
/// the other way round than seen from the middle, so that its part comes out negative. No layer is between then, and the
/// size of the sum is what it covers: exactly for a sheet, at most for a body.
#[inline(always)]
pub fn visible<V: Vpu>(v: &mut V, layers: [V::I32; 2], parts: Option<[V::I32; 2]>) -> V::F32 {
    let one = v.vset_f32(1.0);
    let mut coverage = |i: usize| {
        let layers = v.vcvt_i32_f32(layers[i]);
        match parts {
            None => layers,
            Some(parts) => {
                let unit = v.vset_f32(1.0 / WHOLE);
                let part = v.vcvt_i32_f32(parts[i]);
                v.vmadd(part, unit, layers)
            }
        }
    };
    let (front, back) = (coverage(0), coverage(1));
    let front = v.vabs(front);
    let back = v.vabs(back);
    let covered = v.vmax(front, back);
    let covered = v.vmin(covered, one);
    v.vsub(one, covered)
}
