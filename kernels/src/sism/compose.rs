//! Composition: one clamp of all layers and parts, and visibility to the pixels [johnson09, Eq. 4].

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu};
use lrbsim_workloads::reference::ObjectRule;

use super::cut::{CutParts, CutSamples, Hidden};
use super::own::Own;
use super::soft::WHOLE;
use super::{Overlap, Picture, Sums};
use crate::columns::{Columns, lanes_below, lower, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::grid::{Grid, Sample};
use crate::irregular::receivers::Receiver;
use crate::irregular::run::{Runs, Split};
use crate::irregular::{CHILDREN, SLICES};

/// Number of samples that a task handles.
const TASK: u32 = 1024;

/// Number of keys of a block, as a power of two.
const BLOCK_KEYS_LOG2: i32 = (CHILDREN * SLICES).trailing_zeros() as i32;

/// Composes the visibility of all samples, to the pixels of `picture`.
pub fn compose(
    grid: &Grid,
    runs: &Runs,
    sums: Columns<Sums>,
    apart: Apart,
    overlap: Overlap,
    picture: Picture,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let Apart { own, cut } = apart;
    let compose = Compose { grid: *grid, splits: runs.splits, sums, own, cut, overlap, picture };
    // SAFETY: each task writes the pixels of its own samples: a receiver has a pixel of its own.
    runner.run(&unsafe { Step::independent("compose", grid.receivers.count.div_ceil(TASK), compose) })
}

/// Triangles that sums of layers and edges do not have right.
#[derive(Clone, Copy)]
pub struct Apart {
    /// What takes out own triangles; `None` for a point light, whose sums have no parts.
    pub own: Option<Own>,
    /// What triangles hide that the light is cut by; `None` where there are none.
    pub cut: Option<Hidden>,
}

struct Compose {
    grid: Grid,
    /// Which blocks have sums.
    splits: Columns<Split>,
    sums: Columns<Sums>,
    /// What takes out own triangles; `None` for a point light, whose sums have no parts.
    own: Option<Own>,
    /// What triangles hide that the light is cut by; `None` where there are none.
    cut: Option<Hidden>,
    /// Whether parts are summed here, or have been compared with one another.
    overlap: Overlap,
    picture: Picture,
}

impl Kernel for Compose {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.grid.receivers.count);
        let mut block = self.block_of(v, i);
        // Block by block: most of a picture is lit, and where no run has been there are no sums to be read.
        while v.branch(Compare::Less, i, end) {
            let key = scalar!(v, block << { BLOCK_KEYS_LOG2 });
            let block_end = v.s_load(self.grid.cell_starts(CHILDREN), key);
            let stop = lower(v, block_end, end);
            if v.branch(Compare::Less, i, stop) {
                self.block(v, block, i, stop);
                i = stop;
            }
            block = scalar!(v, block + 1);
        }
    }
}

impl Compose {
    /// What the lights so far make of pixels whose part of this light is `visible`.
    #[inline(always)]
    fn together<V: Vpu>(&self, v: &mut V, live: V::Mask, pixel: V::I32, visible: V::F32) -> V::F32 {
        let Picture { visibility, number, of } = self.picture;
        if of == 1 {
            return visible;
        }
        let zero = v.vset_f32(0.0);
        let before = if number == 0 { zero } else { v.vgather_f32_or(zero, live, visibility, pixel) };
        let part = v.vset_f32(1.0 / of as f32);
        let one = v.vset_f32(1.0);
        let sum = v.vmadd(visible, part, before);
        // Parts that are no powers of two add up to a little more than one.
        v.vmin(sum, one)
    }

    /// The block that sample `sample` lies in, by bisection.
    #[inline(always)]
    fn block_of<V: Vpu>(&self, v: &mut V, sample: V::S32) -> V::S32 {
        let one = v.s_imm(1);
        let mut block = v.s_imm(0);
        let mut left = v.s_imm(self.grid.faces.block_count() as i32);
        // It is one of the `left` blocks from `block` on.
        while v.branch(Compare::Less, one, left) {
            let half = scalar!(v, left >> 1);
            let middle = scalar!(v, block + half);
            let key = scalar!(v, middle << { BLOCK_KEYS_LOG2 });
            let first = v.s_load(self.grid.cell_starts(0), key);
            if v.branch(Compare::LessEqual, first, sample) {
                block = middle;
                left = scalar!(v, left - half);
            } else {
                left = half;
            }
        }
        block
    }

    /// Composes samples `first..end` of a block.
    #[inline(always)]
    fn block<V: Vpu>(&self, v: &mut V, block: V::S32, first: V::S32, end: V::S32) {
        let Compose { grid, splits, sums, own, cut, overlap, .. } = self;
        let none = v.vset_i32(0);
        let nothing = v.s_imm(0);
        let [has_layers, has_parts] = each!(kind in [0, 1] => {
            let log2 = v.s_load(splits.column(field!(Split.log2[kind])), block);
            v.branch(Compare::Less, nothing, log2)
        });
        // What is covered has been found out already, layers and own triangles included.
        let is_covered = has_parts && *overlap != Overlap::Sum;
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let mut sum = |field| v.vload_i32_or(none, live, sums.column(field), i);
            let layers = if has_layers && !is_covered {
                each!(k in [0, 1] => sum(field!(Sums.layers[k])))
            } else {
                [none; 2]
            };
            let mut parts = has_parts.then(|| each!(k in [0, 1] => sum(field!(Sums.coverage[k]))));
            let receiver = v.vload_i32_or(none, live, grid.samples.column(field!(Sample.receiver)), i);
            if let (Some(own), false) = (own, is_covered) {
                let triangle = grid.receivers.columns.column(field!(Receiver.triangle));
                let number = v.vgather_i32_or(none, live, triangle, receiver);
                let triangles = own.triangles(v, live, number);
                if v.branch_any(triangles.cut) {
                    let points = each!(axis in [0, 1, 2] => {
                        v.vload_f32(grid.samples.column(field!(Sample.position[axis])), i)
                    });
                    let [front, back] = own.parts(v, points, &triangles);
                    parts = Some(match parts {
                        None => [front, back],
                        Some(parts) => [v.viadd(parts[0], front), v.viadd(parts[1], back)],
                    });
                }
            }
            let cut = match cut {
                Some(cut) if !is_covered => Some(hidden_by_cut(v, cut, live, i)),
                _ => None,
            };
            let visible = match parts {
                Some([covered, _]) if is_covered => {
                    let unit = v.vset_f32(1.0 / WHOLE);
                    let one = v.vset_f32(1.0);
                    let covered = v.vcvt_i32_f32(covered);
                    v.vnmadd(covered, unit, one)
                }
                None if !has_layers && cut.is_none() => v.vset_f32(1.0),
                _ => match (overlap.rule(), cut) {
                    (Some(rule), Some(cut)) => {
                        let by_cut = visible(v, [none; 2], Some(cut), None);
                        let visible = visible(v, layers, parts, None);
                        rule_of_two(v, rule, visible, by_cut)
                    }
                    _ => visible(v, layers, parts, cut),
                },
            };
            let pixel =
                v.vgather_i32_or(none, live, grid.receivers.columns.column(field!(Receiver.pixel)), receiver);
            let visible = self.together(v, live, pixel, visible);
            v.vscatter_f32(live, self.picture.visibility, pixel, visible);
            i = scalar!(v, i + 16);
        }
    }
}

/// What two objects leave of the light, each of which leaves so much.
#[inline(always)]
pub fn rule_of_two<V: Vpu>(v: &mut V, rule: ObjectRule, a: V::F32, b: V::F32) -> V::F32 {
    match rule {
        ObjectRule::Product => v.vmul(a, b),
        ObjectRule::Max => v.vmin(a, b),
    }
}

/// What triangles hide that the light is cut by, in F and B, in fixed point: of the 16 samples from `i` on.
#[inline(always)]
fn hidden_by_cut<V: Vpu>(v: &mut V, cut: &Hidden, live: V::Mask, i: V::S32) -> [V::I32; 2] {
    let none = v.vset_i32(0);
    match *cut {
        Hidden::Parts(parts) => {
            each!(k in [0, 1] => v.vload_i32_or(none, live, parts.column(field!(CutParts.parts[k])), i))
        }
        Hidden::Samples(samples, groups) => {
            let half = v.vset_i32(16);
            let mut count = none;
            for group in 0..groups {
                let word = v.vload_i32_or(none, live, samples.column(field!(CutSamples.groups[group])), i);
                count = int!(v, count + (word >> half));
            }
            let per_sample = v.vset_i32(WHOLE as i32 / (groups as i32 * 16));
            let part = int!(v, count * per_sample);
            [part; 2]
        }
    }
}

/// Visible part of the light, from layers and fixed-point parts in F and B: `1 - min(max(|F|, |B|, |F - B|), 1)`; each with what
/// triangles hide that the light is cut by, `|F| + F'`, `|B| + B'` and `|F - B| + min(F', B')`, which has a sign of its own.
///
/// The sign: a face that has receiver and middle of the light on one side covers part of the light from there, but runs
/// the other way round than seen from the middle, so that its part comes out negative. No layer is between then, and the
/// size of the sum is what it covers: exactly for a sheet, at most for a body. Where F and B differ in sign, they cover
/// different parts: what hides the middle, and faces behind the terminator that hide what lies above it.
#[inline(always)]
pub fn visible<V: Vpu>(
    v: &mut V,
    layers: [V::I32; 2],
    parts: Option<[V::I32; 2]>,
    cut: Option<[V::I32; 2]>,
) -> V::F32 {
    let one = v.vset_f32(1.0);
    let [front, back] = each!(i in [0, 1] => {
        let layers = v.vcvt_i32_f32(layers[i]);
        match parts {
            None => layers,
            Some(parts) => {
                let unit = v.vset_f32(1.0 / WHOLE);
                let part = v.vcvt_i32_f32(parts[i]);
                v.vmadd(part, unit, layers)
            }
        }
    });
    let apart = v.vsub(front, back);
    let mut apart = v.vabs(apart);
    let mut front = v.vabs(front);
    let mut back = v.vabs(back);
    if let Some([in_front, in_back]) = cut {
        let unit = v.vset_f32(1.0 / WHOLE);
        let in_both = v.vimin(in_front, in_back);
        let [in_front, in_back, in_both] =
            each!(part in [in_front, in_back, in_both] => v.vcvt_i32_f32(part));
        front = v.vmadd(in_front, unit, front);
        back = v.vmadd(in_back, unit, back);
        apart = v.vmadd(in_both, unit, apart);
    }
    let covered = v.vmax(front, back);
    let covered = v.vmax(covered, apart);
    let covered = v.vmin(covered, one);
    v.vsub(one, covered)
}
