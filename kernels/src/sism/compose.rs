//! Composition: one clamp of all layers and parts, and visibility to the pixels [johnson09, Eq. 4].

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::Sums;
use super::soft::WHOLE;
use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, scalar};
use crate::field;
use crate::irregular::grid::{Grid, Sample};
use crate::irregular::receivers::Receiver;

/// Number of samples that a task handles.
const TASK: u32 = 1024;

/// Composes the visibility of all samples, to the pixels at `visibility`.
pub fn compose(
    grid: &Grid,
    sums: Columns<Sums>,
    is_soft: bool,
    visibility: Addr,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let compose = Compose { grid: *grid, sums, is_soft, visibility };
    // SAFETY: each task writes the pixels of its own samples: a receiver has a pixel of its own.
    runner.run(&unsafe { Step::independent("compose", grid.receivers.count.div_ceil(TASK), compose) })
}

struct Compose {
    grid: Grid,
    sums: Columns<Sums>,
    is_soft: bool,
    visibility: Addr,
}

impl Kernel for Compose {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Compose { grid, sums, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, grid.receivers.count);
        let none = v.vset_i32(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let mut sum = |field| v.vload_i32_or(none, live, sums.column(field), i);
            let layers = each!(i in [0, 1] => sum(field!(Sums.layers[i])));
            let parts = self.is_soft.then(|| each!(i in [0, 1] => sum(field!(Sums.coverage[i]))));
            let visible = visible(v, layers, parts);
            let receiver = v.vload_i32_or(none, live, grid.samples.column(field!(Sample.receiver)), i);
            let pixel =
                v.vgather_i32_or(none, live, grid.receivers.columns.column(field!(Receiver.pixel)), receiver);
            v.vscatter_f32(live, self.visibility, pixel, visible);
            i = scalar!(v, i + 16);
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
