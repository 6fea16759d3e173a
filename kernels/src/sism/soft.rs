//! Soft shadow kernel: the signed part of the light's disc beyond each silhouette edge [johnson09, Eq. 3].

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Ordering, Step, Vpu};

use super::Frame;
use super::layout::{EDGE_WORDS, Layout};
use super::run::{PerVector, Samples, walk};
use crate::light::View;
use crate::plane::{Vec3, broadcast3, side};
use crate::segment::segment;

/// Column of [`Layout::sums`] with the coverage in F; that in B follows.
pub const COVERAGE: u32 = 2;

/// A whole light in fixed point: sums of 32-bit integers are the same in any order [algorithms, 6.9].
pub const WHOLE: f32 = (1 << 24) as f32;

/// Sums the edges' parts for every sample.
pub fn sum(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "soft",
        ordering: Ordering::Independent,
        tasks: frame.run_counts[1],
        kernel: Box::new(Soft { layout }),
    }
}

struct Soft {
    layout: Layout,
}

impl Kernel for Soft {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        walk(v, &self.layout, self.layout.soft_runs, 1, task, self);
    }
}

impl PerVector for Soft {
    #[inline(always)]
    fn vector<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, records: (V::S32, V::S32), depth: V::S32) {
        let layout = &self.layout;
        let two = v.s_imm(2);
        let words = v.s_imm(EDGE_WORDS as i32);
        let view = view(v, layout, samples.position);
        let none = v.vset_i32(0);
        let mut coverage = [none; 2];
        let (mut record, end) = records;
        while v.branch(Compare::Less, record, end) {
            let start = v.s_load(layout.records.plus(4), record);
            if v.branch(Compare::LessEqual, start, depth) {
                let edge = v.s_load(layout.records, record);
                let index = v.s_mul(edge, words);
                let at = (layout.edge_records, index);
                coverage = add_edge(v, &view, samples.live, samples.position, at, coverage);
            }
            record = v.s_add(record, two);
        }
        for (i, coverage) in coverage.into_iter().enumerate() {
            let column = layout.sums.column(COVERAGE + i as u32);
            v.vstore_i32(samples.live, column, samples.first, coverage);
        }
    }
}

/// The light as 16 samples see it.
#[inline(always)]
pub fn view<V: Vpu>(v: &mut V, layout: &Layout, points: Vec3<V>) -> View<V> {
    let per_radius = v.vset_f32(1.0 / layout.light.radius);
    View::new(v, layout.light.disc, points, per_radius)
}

/// Adds to the coverage in F and B the signed part that the edge of record `at` makes for 16 samples.
///
/// The sign comes from the same predicate as the umbra: negative where the centre is on the occluder's side.
/// 66 operations where all lines miss the disc, 157 for a part that needs no clipping.
#[inline(always)]
pub fn add_edge<V: Vpu>(
    v: &mut V,
    view: &View<V>,
    live: V::Mask,
    points: Vec3<V>,
    at: (Addr, V::S32),
    coverage: [V::I32; 2],
) -> [V::I32; 2] {
    let a = broadcast3(v, at.0, at.1);
    let b = broadcast3(v, at.0.plus(12), at.1);
    let mut a = view.see(v, a);
    let mut b = view.see(v, b);
    let live = view.clip(v, live, &mut a, &mut b);
    let u0 = view.project(v, a);
    let u1 = view.project(v, b);
    let (live, f) = segment(v, live, u0, u1);
    if !v.branch_any(live) {
        return coverage;
    }
    let offset = v.vbroadcast_f32(at.0.plus(48), at.1);
    let fixed = fixed(v, f, offset);

    // Weight counts faces on the left: -F for those on whose side the centre is, +F for the others.
    let normal = broadcast3(v, at.0.plus(24), at.1);
    let side = side(v, points, normal);
    let none = v.vset_i32(0);
    let left = v.vicmp_ge(side, none);
    let signed = v.visub_or(fixed, left, none, fixed);
    let front = v.vbroadcast_i32(at.0.plus(36), at.1);
    let back = v.vbroadcast_i32(at.0.plus(40), at.1);
    let front = v.vimul(front, signed);
    let back = v.vimul(back, signed);
    [v.viadd_or(coverage[0], live, coverage[0], front), v.viadd_or(coverage[1], live, coverage[1], back)]
}

/// Part `f` of the disc in fixed point, rounded after `offset` is added, see [`rounding_offset`].
#[inline(always)]
pub fn fixed<V: Vpu>(v: &mut V, f: V::F32, offset: V::F32) -> V::I32 {
    let whole = v.vset_f32(WHOLE);
    let scaled = v.vmadd(f, whole, offset);
    let rounded = v.vround(scaled);
    v.vcvt_f32_i32(rounded)
}

/// What edge `number` adds before it rounds, in (-1/2, 1/2): multiples of the golden ratio, as even as can be.
///
/// Ten thousand equal terms (the edges of a regular body) would else all round the same way, and their sum be off by
/// 1e-4 of the light [algorithms, 6.9]. A part of 0 stays 0.
#[inline(always)]
pub fn rounding_offset<V: Vpu>(v: &mut V, number: V::I32) -> V::F32 {
    let golden = v.vset_i32(0x9e37_79b9_u32 as i32);
    let turned = v.vimul(number, golden);
    let turned = v.vcvt_i32_f32(turned);
    // Below 2^-32, so that the greatest stays below a half.
    let unit = v.vset_f32(0.999_999 / 4_294_967_296.0);
    v.vmul(turned, unit)
}
