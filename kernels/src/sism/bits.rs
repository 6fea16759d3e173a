//! Soft shadow kernel for `overlap=bits`: which samples of the light are covered, so that what overlaps hides a part but once.
//!
//! `soft` adds areas: where two occluders hide the same part of the light, it counts twice. Here the light has a number of
//! samples, and a count for each of how many layers lie before it: those before the middle of the light, and from there one
//! more or less for each silhouette that the line from the middle to the sample crosses. That line meets an edge where the
//! sample lies in the wedge that the edge subtends at the middle, and beyond the edge. It is the sum of `soft`, sample by
//! sample; a sample is covered where a count of F or of B is not 0, and no sample is covered twice. Whole bodies need not be
//! told apart.
//!
//! What is left of the error is that silhouettes are those seen from the middle, and that samples are finitely many: about
//! `0.27 n^(-3/4)` of the light, root mean square, along one edge [algorithms, 0, 2.9]. The samples are turned from pixel to pixel.
//!
//! 16 receivers are projected at a time, as in `soft`; for each of them whose light an edge crosses, 16 samples at a time are
//! compared. Counts lie on the stack of the hardware thread.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Stacked, Step, Stopped, Vpu};
use lrbsim_workloads::Outline;

use super::Sums;
use super::cut::{CutSamples, Hidden};
use super::own::{Own, OwnTriangles};
use super::soft::{WHOLE, on_disc, view};
use crate::columns::Columns;
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::grid::{Grid, Sample};
use crate::irregular::primitives::{BACK, EdgeRecord, FRONT, Kind, Primitives};
use crate::irregular::receivers::Receiver;
use crate::irregular::run::{Entry, Runs, Samples, Shade, Split, Walk};
use crate::light::{Horizon, View};
use crate::plane::side;
use crate::samples::LightSamples;
use crate::segment::{Vec2, cross, dot};

/// Groups of 16 samples of the light at most.
pub const GROUPS_MAX: usize = 16;

/// Finds which samples of the light are covered, for every sample in a block that holds edges: the covered part, in fixed
/// point, to [`Sums::coverage`]`[0]`. One task a run.
pub fn cover(
    walk: Walk,
    compared: Compared,
    primitives: &Primitives,
    grid: &Grid,
    runs: &Runs,
    sums: Columns<Sums>,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let own = Own { primitives: *primitives };
    let bits = Bits { walk, compared, own, grid: *grid, splits: runs.splits, sums };
    // SAFETY: each task writes the sums of its own samples: a sample lies in one run.
    runner.run(&unsafe { Step::independent("soft", walk.run_count(), bits) })
}

/// The samples of the light, and what is known of them before edges are compared with them.
#[derive(Clone, Copy)]
pub struct Compared {
    /// The samples of the light.
    pub samples: LightSamples,
    /// Those that triangles hide which the light is cut by; `None` where there are no such triangles.
    pub hidden: Option<Hidden>,
}

/// Finds the covered samples of the light for the samples of a run.
struct Bits {
    walk: Walk,
    compared: Compared,
    own: Own,
    grid: Grid,
    /// Which blocks have layers.
    splits: Columns<Split>,
    sums: Columns<Sums>,
}

/// What covers the light of 16 receivers, as far as their cell's edges have been seen.
struct Covered<V: Vpu> {
    /// The light as the receivers see it, turned.
    view: View<V>,
    /// Layers before the middle of the light: those in F, and 65 536 for each in B.
    layers: V::I32,
    /// The layers before each sample, by receiver and 16 samples; `None` where they are still those before the middle.
    counts: [[Option<Stacked<V::I32>>; GROUPS_MAX]; 16],
    /// The horizons of receivers whose own triangles' planes cut the light, and the lanes of these; see `own`.
    horizon: Option<(V::S32, Crossing<V>)>,
}

/// Edges on the discs of 16 receivers, as samples are compared with them.
pub struct Crossing<V: Vpu> {
    /// Ends of the edges, whose wedges are looked at.
    ends: [Vec2<V>; 2],
    /// A sample at s is beyond the edge where `along x s > offset`.
    along: Vec2<V>,
    offset: V::F32,
    /// What is added to the counts beyond: to that of F, and 65 536 times to that of B.
    pub step: V::I32,
}

impl<V: Vpu> Crossing<V> {
    /// The lanes whose `place` is beyond the line of the edge.
    #[inline(always)]
    pub fn beyond(&self, v: &mut V, place: Vec2<V>) -> V::Mask {
        let across = cross2(v, self.along, place);
        v.vcmp_gt(across, self.offset)
    }
}

impl Kernel for Bits {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        self.walk.run(v, task, self);
    }
}

impl Bits {
    /// Layers before the middle of the light, which `hard` counted: none in a block that has no triangles.
    #[inline(always)]
    fn layers<V: Vpu>(&self, v: &mut V, samples: &Samples<V>) -> V::I32 {
        let none = v.vset_i32(0);
        let nothing = v.s_imm(0);
        let log2 = v.s_load(self.splits.column(field!(Split.log2[Kind::Triangles as usize])), samples.block);
        if !v.branch(Compare::Less, nothing, log2) {
            return none;
        }
        let [front, back] = each!(k in [0, 1] => {
            v.vload_i32_or(none, samples.live, self.sums.column(field!(Sums.layers[k])), samples.first)
        });
        together(v, [front, back])
    }

    /// Adds to the counts of the receivers in `live` what the edges in `crossing` change.
    #[inline(always)]
    fn cross<V: Vpu>(&self, v: &mut V, live: V::Mask, crossing: &Crossing<V>, state: &mut Covered<V>) {
        let nothing = v.s_imm(0);
        let zero = v.vset_f32(0.0);
        let bits = v.kmov_to_scalar(live);
        let layers = state.layers;
        for (lane, counts) in state.counts.iter_mut().enumerate() {
            let bit = scalar!(v, bits & { 1 << lane });
            if !v.branch(Compare::NotEqual, bit, nothing) {
                continue;
            }
            // The numbers of one receiver, in every lane.
            let lane_number = v.vset_i32(lane as i32);
            let of = |v: &mut V, x: V::F32| v.vpermute_f32(x, lane_number);
            let along = [of(v, crossing.along[0]), of(v, crossing.along[1])];
            let offset = of(v, crossing.offset);
            let step = v.vpermute(crossing.step, lane_number);
            let [a, b] = crossing.ends;
            let (a, b) = ([of(v, a[0]), of(v, a[1])], [of(v, b[0]), of(v, b[1])]);
            for (group, count) in counts[..self.compared.samples.groups()].iter_mut().enumerate() {
                let place = self.compared.samples.places(v, group);
                let across = cross2(v, along, place);
                let beyond = v.vcmp_gt(across, offset);
                let (a, b) = (cross2(v, a, place), cross2(v, b, place));
                let past_a = v.vcmp_ge(a, zero);
                let past_b = v.vcmp_ge(b, zero);
                let between = v.kxor(past_a, past_b);
                let beyond = v.kand(beyond, between);
                let before = match *count {
                    Some(count) => v.vunstack_i32(count),
                    None => v.vpermute(layers, lane_number),
                };
                let after = v.viadd_or(before, beyond, before, step);
                let slot = (lane * GROUPS_MAX + group) as u32;
                *count = Some(v.vstack_i32(slot, after));
            }
        }
    }
}

impl Shade for Bits {
    type State<V: Vpu> = Covered<V>;

    #[inline(always)]
    fn begin<V: Vpu>(&self, v: &mut V, samples: &Samples<V>) -> Covered<V> {
        let none = v.vset_i32(0);
        let live = samples.live;
        let receivers = self.grid.receivers.columns;
        let receiver =
            v.vload_i32_or(none, live, self.grid.samples.column(field!(Sample.receiver)), samples.first);

        let view = view(v, &self.own.primitives.light, samples.position);
        let [cos, sin] = self.compared.samples.turn(v, receivers, live, receiver);
        let view = view.turned(v, cos, sin);

        let layers = self.layers(v, samples);
        let mut state = Covered { view, layers, counts: [[None; GROUPS_MAX]; 16], horizon: None };

        // Own triangles, whose edges will be among those to come: see `own`.
        let number = v.vgather_i32_or(none, live, receivers.column(field!(Receiver.triangle)), receiver);
        let triangles = self.own.triangles(v, live, number);
        if v.branch_any(triangles.cut) {
            let (cut, crossing) = horizon(v, &self.own, &state.view, &triangles);
            let lanes = v.kmov_to_scalar(cut);
            state.horizon = Some((lanes, crossing));
        }
        state
    }

    #[inline(always)]
    fn add<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &mut Covered<V>, entry: Entry<V>) {
        let number = entry.number(v);
        let edge = self.own.primitives.edges.record(v, number);
        let (live, [a, b]) = on_disc(v, &state.view, samples.live, edge);
        // Does the edge come to the disc at all: nearer than a radius, and not past the chord of its line?
        let e = [v.vsub(b[0], a[0]), v.vsub(b[1], a[1])];
        let zero = v.vset_f32(0.0);
        let length2 = dot(v, e, e);
        let reach2 = match state.view.outline {
            Outline::Disc | Outline::Line => length2,
            Outline::Square | Outline::Triangle => {
                let reach2 = v.vset_f32(state.view.outline.reach2());
                v.vmul(length2, reach2)
            }
        };
        let across = cross(v, a, b);
        let across2 = v.vmul(across, across);
        let chord2 = v.vsub(reach2, across2);
        let live = v.vcmp_gt_masked(live, chord2, zero);
        if !v.branch_any(live) {
            return;
        }
        let [starts_past, ends_before] = each!(end in [(a, true), (b, false)] => {
            let (place, is_start) = end;
            let along = dot(v, place, e);
            let along2 = v.vmul(along, along);
            let far = v.vcmp_ge_masked(live, along2, chord2);
            if is_start { v.vcmp_gt_masked(far, along, zero) } else { v.vcmp_lt_masked(far, along, zero) }
        });
        let misses = v.kor(starts_past, ends_before);
        let live = v.kandn(misses, live);
        if !v.branch_any(live) {
            return;
        }

        // A layer less where the middle is on the occluder's side of the edge, one more where it is not.
        let none = v.vset_i32(0);
        let normal = edge.vec3(v, field!(EdgeRecord.normal));
        let side = side(v, samples.position, normal);
        let left = v.vicmp_ge(side, none);
        let front = edge.int(v, field!(EdgeRecord.weights[0]));
        let back = edge.int(v, field!(EdgeRecord.weights[1]));
        let step = together(v, [front, back]);
        let step = v.visub_or(step, left, none, step);
        // Seen along the axis, what is left of the edge from the light is right of it on the disc.
        let right = v.knot(left);
        let crossing = crossing(v, [a, b], right, step);
        self.cross(v, live, &crossing, state);
    }

    /// Without silhouettes all of the light is as its middle, or as the horizon has it.
    fn zeros(&self) -> Option<[Addr; 2]> {
        None
    }

    #[inline(always)]
    fn end<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &Covered<V>) {
        // Where no silhouette crosses the light, all of it is as its middle.
        let none = v.vset_i32(0);
        let whole = v.vset_i32(WHOLE as i32);
        let hidden = v.vicmp_neq(state.layers, none);
        let mut covered = v.vblend_i32(hidden, whole, none);
        let per_sample =
            (WHOLE as i32 / (self.compared.samples.groups() as i32 * 16)).trailing_zeros() as i32;
        let nothing = v.s_imm(0);
        for (lane, counts) in state.counts.iter().enumerate() {
            // Whether a receiver has counts on the stack, one bit says, which the thread keeps.
            let bit = v.s_imm(i32::from(counts[0].is_some()));
            let has_counts = v.branch(Compare::NotEqual, bit, nothing);
            let horizon = state.horizon.as_ref().and_then(|(lanes, crossing)| {
                let lanes = *lanes;
                let bit = scalar!(v, lanes & { 1 << lane });
                v.branch(Compare::NotEqual, bit, nothing).then_some(crossing)
            });
            if !has_counts && horizon.is_none() && self.compared.hidden.is_none() {
                continue;
            }
            let lane_number = v.vset_i32(lane as i32);
            #[expect(
                clippy::manual_map,
                reason = "a closure is not compiled for the host's vector instructions"
            )]
            let horizon = match horizon {
                None => None,
                Some(Crossing { along, offset, step, .. }) => Some((
                    [v.vpermute_f32(along[0], lane_number), v.vpermute_f32(along[1], lane_number)],
                    v.vpermute_f32(*offset, lane_number),
                    v.vpermute(*step, lane_number),
                )),
            };
            let mut number = v.s_imm(0);
            for (group, count) in counts[..self.compared.samples.groups()].iter().enumerate() {
                let mut count = match *count {
                    Some(count) => v.vunstack_i32(count),
                    None => v.vpermute(state.layers, lane_number),
                };
                if let Some((along, offset, step)) = horizon {
                    let place = self.compared.samples.places(v, group);
                    let across = cross2(v, along, place);
                    let beyond = v.vcmp_gt(across, offset);
                    count = v.viadd_or(count, beyond, count, step);
                }
                let mut hidden = v.vicmp_neq(count, none);
                if let Some(Hidden::Samples(samples_hidden, _)) = self.compared.hidden {
                    let first = samples.first;
                    let sample = scalar!(v, first + { lane as i32 });
                    let by_cut = v.s_load(samples_hidden.column(field!(CutSamples.groups[group])), sample);
                    let by_cut = v.kmov_from_scalar(by_cut);
                    hidden = v.kor(hidden, by_cut);
                }
                let bits = v.kmov_to_scalar(hidden);
                let more = v.s_popcnt(bits);
                number = scalar!(v, number + more);
            }
            let part = scalar!(v, number << { per_sample });
            let part = v.vsplat(part);
            let bit = v.s_imm(1 << lane);
            let only = v.kmov_from_scalar(bit);
            covered = v.vblend_i32(only, part, covered);
        }
        v.vstore_i32(samples.live, self.sums.column(field!(Sums.coverage[0])), samples.first, covered);
    }
}

/// Two small numbers in one word, 0 where both are: that of F, and that of B 65 536 times.
#[inline(always)]
fn together<V: Vpu>(v: &mut V, [front, back]: [V::I32; 2]) -> V::I32 {
    let half = v.vset_i32(16);
    int!(v, front + (back << half))
}

/// How samples are compared with the horizons of receivers on `triangles`: beyond is where the middle of the light is not. First,
/// the lanes whose horizon cuts the light.
#[inline(always)]
pub fn horizon<V: Vpu>(
    v: &mut V,
    own: &Own,
    view: &View<V>,
    triangles: &OwnTriangles<V>,
) -> (V::Mask, Crossing<V>) {
    let none = v.vset_i32(0);
    let zero = v.vset_f32(0.0);
    let one = v.vset_i32(1);
    let Horizon { cuts, places, offset } = own.horizon(v, view, triangles);
    let weights = each!(layer in [FRONT, BACK] => {
        let counted = own.counted(v, triangles, layer);
        v.vblend_i32(counted, one, none)
    });
    let step = together(v, weights);
    let left = v.vcmp_gt(offset, zero);
    (cuts, crossing(v, places, left, step))
}

/// How samples are compared with edges `a -> b` on the disc: those are beyond that do not lie where the middle does. `left`:
/// the lanes in which the middle is left of the edge, seen from the receiver.
#[inline(always)]
fn crossing<V: Vpu>(v: &mut V, [a, b]: [Vec2<V>; 2], left: V::Mask, step: V::I32) -> Crossing<V> {
    let zero = v.vset_f32(0.0);
    let e = [v.vsub(b[0], a[0]), v.vsub(b[1], a[1])];
    // Left of the edge is where `e x s` is greater than `e x a`; turned around where the middle is.
    let offset = cross(v, b, a);
    let mut turned = |x: V::F32| v.vsub_or(x, left, zero, x);
    let along = [turned(e[0]), turned(e[1])];
    let offset = turned(offset);
    Crossing { ends: [a, b], along, offset, step }
}

/// The product `a x b` of vectors in the plane of the light, where nothing is lost that matters: of samples, which lie on the disc.
#[inline(always)]
fn cross2<V: Vpu>(v: &mut V, a: Vec2<V>, b: Vec2<V>) -> V::F32 {
    let right = v.vmul(a[1], b[0]);
    v.vmsub(a[0], b[1], right)
}
