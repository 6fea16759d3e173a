//! Which samples of the light triangles hide: one bit each, gathered over all triangles.
//!
//! A sample s is hidden from receiver p by a triangle if all three planes through p and an edge have s on the side of the third corner,
//! and the triangle's own plane has p and s on different sides. Each of these is a product that is linear on the light: `n . (s - p)`,
//! with `n = (a - p) x (b - a)` for the edge `a -> b`. It needs no clipping, wherever the triangle lies, and two triangles on one edge
//! have the same bits of it.
//!
//! 16 receivers are tested at a time: most triangles miss the whole light, and some hide all of it. For each of the others 16 samples at a
//! time are compared, and their bits gathered on the stack of the hardware thread. A task has 64 samples: where cells have many triangles
//! tasks would else be long, and others wait for them.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Stacked, Step, Stopped, Vpu};
use lrbsim_workloads::Outline;

use crate::columns::sum;
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::grid::{Grid, Sample};
use crate::irregular::primitives::{CUTS, LightConstants, WideTriangle};
use crate::irregular::receivers::Receiver;
use crate::irregular::run::{Entry, Samples, Shade, Walk};
use crate::plane::{Vec3, cross, dot, sub};
use crate::record::Records;
use crate::samples::LightSamples;
use crate::sism::soft::view;

/// Samples of a task, in groups of 16.
const GROUPS: usize = 4;

/// Bits of 16 samples that are all hidden.
const FULL: i32 = 0xffff;

/// How much nearer to an edge's plane than the farthest sample the middle of the light must be, as a part of the square, to have samples on
/// both sides: rounding.
const ROUNDED: f32 = 1.0 + 1e-5;

/// Finds the samples of the light that are hidden from the samples of runs.
pub struct Cover {
    /// The walk through samples and triangles.
    pub walk: Walk,
    /// The light.
    pub light: LightConstants,
    /// The triangles.
    pub triangles: Records<WideTriangle>,
    /// The grid of the samples.
    pub grid: Grid,
    /// The samples of the light.
    pub samples: LightSamples,
    /// Number of those that are hidden, by receiver: zero before.
    pub hidden: Addr,
}

impl Cover {
    /// Finds them for all samples: as many tasks a run as there are times 64 samples of the light.
    pub fn run_all(self, runner: &mut Runner<'_>) -> Result<(), Stopped> {
        let tasks = self.walk.run_count() * self.parts();
        // SAFETY: tasks only add to the counts, and use nothing that the atomics return.
        runner.run(&unsafe { Step::independent("cover", tasks, self) })
    }

    /// Tasks of a run, a power of two.
    fn parts(&self) -> u32 {
        (self.samples.groups() / GROUPS) as u32
    }
}

/// What a task has of a [`Cover`]: some of the samples of the light.
struct Part<'a> {
    cover: &'a Cover,
    /// Its first group of samples.
    first: usize,
}

/// What is hidden of the light of 16 receivers, as far as triangles have been seen.
pub struct Hidden<V: Vpu> {
    /// Numbers of the receivers.
    receiver: V::I32,
    /// Number of the triangle that each receiver lies on, which hides nothing from it.
    own: V::I32,
    /// Vectors from the middle of the light to its places (1, 0) and (0, 1), turned.
    spans: [Vec3<V>; 2],
    /// Receivers from which all of the light is hidden.
    dark: V::Mask,
    /// Bits of the hidden samples, by receiver: sixteen in each of the lowest lanes. `None`: none are.
    bits: [Option<Stacked<V::I32>>; 16],
}

/// A product that is linear on the light, of 16 receivers: at the middle of the light, and what it grows by along both spans. Samples where
/// it is positive may be hidden.
type Linear<V> = [<V as Vpu>::F32; 3];

impl Kernel for Cover {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let parts = self.parts() as i32;
        let run = scalar!(v, task >> { parts.trailing_zeros() as i32 });
        let of_task = scalar!(v, task & { parts - 1 });
        for number in 0..parts {
            let this = v.s_imm(number);
            if v.branch(Compare::Equal, of_task, this) {
                let part = Part { cover: self, first: number as usize * GROUPS };
                self.walk.run(v, run, &part);
                break;
            }
        }
    }
}

impl Shade for Part<'_> {
    type State<V: Vpu> = Hidden<V>;

    #[inline(always)]
    fn begin<V: Vpu>(&self, v: &mut V, samples: &Samples<V>) -> Hidden<V> {
        let none = v.vset_i32(0);
        let live = samples.live;
        let receivers = self.cover.grid.receivers.columns;
        let receiver = v.vload_i32_or(
            none,
            live,
            self.cover.grid.samples.column(field!(Sample.receiver)),
            samples.first,
        );
        let own = v.vgather_i32_or(none, live, receivers.column(field!(Receiver.triangle)), receiver);
        let spans = if self.cover.light.is_soft() {
            let [cos, sin] = self.cover.samples.turn(v, receivers, live, receiver);
            let view = view(v, &self.cover.light, samples.position);
            let view = view.turned(v, cos, sin);
            view.spans(v, self.cover.light.radius)
        } else {
            [[v.vset_f32(0.0); 3]; 2]
        };
        Hidden { receiver, own, spans, dark: v.mask_none(), bits: [None; 16] }
    }

    #[inline(always)]
    fn add<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &mut Hidden<V>, entry: Entry<V>) {
        let live = v.kandn(state.dark, samples.live);
        if !v.branch_any(live) {
            return;
        }
        let number = entry.number(v);
        let in_every_lane = entry.in_every_lane(v);
        let others = v.vicmp_neq_masked(live, state.own, in_every_lane);
        let triangle = self.cover.triangles.record(v, number);
        let zero = v.vset_f32(0.0);

        // Receivers that are not on the triangle's plane. Those beyond it see the triangle before the middle of the light, and before all
        // of the light unless the plane cuts that.
        let normal = triangle.vec3(v, field!(WideTriangle.normal));
        let plane = triangle.float(v, field!(WideTriangle.plane));
        let along = dot(v, samples.position, normal);
        let beyond = v.vcmp_gt_masked(others, along, plane);
        let flags = triangle.scalar(v, field!(WideTriangle.flags));
        let cut = scalar!(v, flags & { CUTS });
        let nothing = v.s_imm(0);
        let is_cut = v.branch(Compare::NotEqual, cut, nothing);
        let mut live = beyond;
        let mut across = None;
        if is_cut {
            let slack = triangle.float(v, field!(WideTriangle.slack));
            let distance = v.vsub(plane, slack);
            let nearer = v.vsub(distance, slack);
            let before = v.vcmp_lt_masked(others, along, nearer);
            live = v.kor(beyond, before);
            // Samples on the other side of the plane than the receiver.
            let rises = each!(span in [0, 1] => dot(v, state.spans[span], normal));
            let [of_s, of_t] = each!(k in [0, 1] => v.vsub_or(rises[k], beyond, zero, rises[k]));
            let minus = v.vsub(zero, distance);
            let middle = v.vblend_f32(beyond, distance, minus);
            across = Some(([middle, of_s, of_t], before));
        }
        if !v.branch_any(live) {
            return;
        }

        // Planes through the receiver and the edges, the lower vertex first; positive on the side of the third corner.
        let corners = each!(corner in [0, 1, 2] => triangle.vec3(v, field!(WideTriangle.corners[corner])));
        let seen = each!(corner in [0, 1] => sub(v, corners[corner], samples.position));
        let sign_bit = v.vset_i32(i32::MIN);
        let flags = triangle.int(v, field!(WideTriangle.flags));
        let turned = v.vand(flags, sign_bit);
        let turned = match across {
            None => turned,
            // Seen from the other side.
            Some((_, before)) => v.vxor_or(turned, before, turned, sign_bit),
        };
        let forward = v.vxor(turned, sign_bit);
        let edges = each!(edge in [(0, 1, forward), (1, 2, forward), (0, 2, turned)] => {
            let (low, high, flip) = edge;
            // As `edge_normal` has it: the side of a small triangle keeps its digits.
            let side = sub(v, corners[high], corners[low]);
            let normal = cross(v, seen[low], side);
            let normal = each!(axis in [0, 1, 2] => {
                let bits = v.bits_of(normal[axis]);
                let bits = v.vxor(bits, flip);
                v.from_bits(bits)
            });
            let toward = dot(v, samples.position, normal);
            let at_middle = v.vsub(zero, toward);
            [at_middle, dot(v, state.spans[0], normal), dot(v, state.spans[1], normal)]
        });
        let (mut some, mut all) = (live, live);
        for edge in &edges {
            self.sides(v, edge, &mut some, &mut all);
        }
        if let Some((across, _)) = &across {
            self.sides(v, across, &mut some, &mut all);
        }
        state.dark = v.kor(state.dark, all);
        let partly = v.kandn(all, some);
        if v.branch_any(partly) {
            self.compare(v, partly, &edges, across.as_ref().map(|(across, _)| across), state);
        }
    }

    /// Samples of cells without triangles see all of the light: their counts are zero as it is.
    fn zeros(&self) -> Option<[Addr; 2]> {
        None
    }

    #[inline(always)]
    fn end<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &Hidden<V>) {
        let none = v.vset_i32(0);
        let whole = v.vset_i32(16 * GROUPS as i32);
        let mut count = none;
        let nothing = v.s_imm(0);
        for (lane, bits) in state.bits.iter().enumerate() {
            // Whether a receiver has bits on the stack, one bit says, which the thread keeps.
            let bit = v.s_imm(i32::from(bits.is_some()));
            if !v.branch(Compare::NotEqual, bit, nothing) {
                continue;
            }
            let Some(bits) = *bits else { continue };
            let bits = v.vunstack_i32(bits);
            let number = ones(v, bits);
            let number = sum(v, number);
            let number = v.vsplat(number);
            let bit = v.s_imm(1 << lane);
            let only = v.kmov_from_scalar(bit);
            count = v.vblend_i32(only, number, count);
        }
        let count = v.vblend_i32(state.dark, whole, count);
        let some = v.vicmp_gt_masked(samples.live, count, none);
        v.vatomic_add_or(none, some, self.cover.hidden, state.receiver, count);
    }
}

impl Part<'_> {
    /// Takes from `some` the receivers for which `linear` is negative on all of the light, and from `all` those for which it is on some of it.
    #[inline(always)]
    fn sides<V: Vpu>(&self, v: &mut V, linear: &Linear<V>, some: &mut V::Mask, all: &mut V::Mask) {
        let [middle, of_s, of_t] = *linear;
        let reach2 = v.vmul(of_s, of_s);
        let reach2 = match self.cover.light.shape.outline() {
            Outline::Line => reach2,
            Outline::Disc | Outline::Square | Outline::Triangle => v.vmadd(of_t, of_t, reach2),
        };
        let more = v.vset_f32(ROUNDED * self.cover.light.shape.outline().reach2());
        let reach2 = v.vmul(reach2, more);
        let size = v.vabs(middle);
        let signed2 = v.vmul(middle, size);
        *all = v.vcmp_gt_masked(*all, signed2, reach2);
        let zero = v.vset_f32(0.0);
        let least = v.vsub(zero, reach2);
        *some = v.vcmp_ge_masked(*some, signed2, least);
    }

    /// Compares the samples of the receivers in `live` with the planes of a triangle.
    #[inline(always)]
    fn compare<V: Vpu>(
        &self,
        v: &mut V,
        live: V::Mask,
        edges: &[Linear<V>; 3],
        across: Option<&Linear<V>>,
        state: &mut Hidden<V>,
    ) {
        let nothing = v.s_imm(0);
        let none = v.vset_i32(0);
        let lanes = v.kmov_to_scalar(live);
        let full = v.vset_i32(FULL);
        let words = v.s_imm((1 << GROUPS) - 1);
        let words = v.kmov_from_scalar(words);
        for (lane, bits) in state.bits.iter_mut().enumerate() {
            let bit = scalar!(v, lanes & { 1 << lane });
            if !v.branch(Compare::NotEqual, bit, nothing) {
                continue;
            }
            // The numbers of one receiver, in every lane.
            let lane_number = v.vset_i32(lane as i32);
            let edges = each!(edge in [0, 1, 2] => each!(k in [0, 1, 2] => v.vpermute_f32(edges[edge][k], lane_number)));
            #[expect(
                clippy::manual_map,
                reason = "a closure is not compiled for the host's vector instructions"
            )]
            let across = match across {
                None => None,
                Some(across) => Some(each!(k in [0, 1, 2] => v.vpermute_f32(across[k], lane_number))),
            };
            let mut after = match *bits {
                Some(bits) => v.vunstack_i32(bits),
                None => none,
            };
            for group in 0..GROUPS {
                let [x, y] = self.cover.samples.places(v, self.first + group);
                let mut outside = none;
                for [middle, of_s, of_t] in edges.into_iter().chain(across) {
                    let at = v.vmadd(of_s, x, middle);
                    let at = v.vmadd(of_t, y, at);
                    let at = v.bits_of(at);
                    outside = v.vor(outside, at);
                }
                let inside = v.vicmp_ge(outside, none);
                let inside = v.kmov_to_scalar(inside);
                let inside = v.vsplat(inside);
                let word = v.s_imm(1 << group);
                let word = v.kmov_from_scalar(word);
                after = v.vor_or(after, word, after, inside);
            }
            *bits = Some(v.vstack_i32(lane as u32, after));
            // A receiver that sees none of the samples is done.
            let sees = v.vicmp_neq_masked(words, after, full);
            if !v.branch_any(sees) {
                let bit = v.s_imm(1 << lane);
                let only = v.kmov_from_scalar(bit);
                state.dark = v.kor(state.dark, only);
            }
        }
    }
}

/// How many of the lower 16 bits of each lane are set.
#[inline(always)]
fn ones<V: Vpu>(v: &mut V, bits: V::I32) -> V::I32 {
    let mut sums = bits;
    // Neighbors are added: bits, then pairs, fours and eights of them.
    for (shift, kept) in [(1, 0x5555), (2, 0x3333), (4, 0x0f0f), (8, 0x00ff)] {
        let kept = v.vset_i32(kept);
        let shift = v.vset_i32(shift);
        sums = int!(v, (sums & kept) + ((sums >> shift) & kept));
    }
    sums
}
