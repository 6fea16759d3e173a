//! Hard shadow kernel: how many layers lie between each sample and the middle of the light [johnson09, §2.4; algorithms, 1].
//!
//! A layer is a triangle that hides the middle of the light from a sample. Layers are counted, not merely found: at a sample
//! under two layers both must be crossed by silhouettes before light comes in, and `compose` adds the parts that `soft` finds.
//!
//! There are two counts, F of triangles that face the light and B of those that face away from it, of which `compose` takes the
//! larger: the surface of a body is crossed on both sides or, where it is open, on one. By the rule of its body a triangle is a
//! layer of F, of B, of both or of neither, as flags of its record say.
//!
//! A task is a run: some of the samples of a block of 16 cells. [`Walk`] takes 16 of its samples at a time, one a lane, and all
//! triangles listed for their cell, one after the other in every lane; [`Shade::end`] stores the counts.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Kernel, Runner, Step, Stopped, Vpu};

use super::Sums;
use crate::columns::Columns;
use crate::expression::int;
use crate::field;
use crate::irregular::grid::{Grid, Sample};
use crate::irregular::primitives::{BACK, FRONT, Primitives, TriangleRecord};
use crate::irregular::receivers::Receiver;
use crate::irregular::run::{Entry, Samples, Shade, Walk};
use crate::plane::{Vec3, dot_of};
use crate::record::{Record, Records};

/// Counts the layers of every sample in a block that holds triangles, to [`Sums::layers`]: one task a run.
pub fn count(
    walk: Walk,
    primitives: &Primitives,
    grid: &Grid,
    sums: Columns<Sums>,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let hard = Hard { walk, grid: *grid, triangles: primitives.triangles, sums };
    // SAFETY: each task writes the sums of its own samples: a sample lies in one run.
    runner.run(&unsafe { Step::independent("hard", walk.run_count(), hard) })
}

/// Counts the layers of the samples of a run.
struct Hard {
    walk: Walk,
    grid: Grid,
    triangles: Records<TriangleRecord>,
    sums: Columns<Sums>,
}

/// The layers of 16 samples, as far as their cell's triangles have been seen.
struct Layers<V: Vpu> {
    /// Number of the triangle that each sample lies on, which does not shadow it.
    own: V::I32,
    /// Layers in F and B between each sample and the light.
    layers: [V::I32; 2],
}

impl Kernel for Hard {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        self.walk.run(v, task, self);
    }
}

impl Shade for Hard {
    type State<V: Vpu> = Layers<V>;

    #[inline(always)]
    fn begin<V: Vpu>(&self, v: &mut V, samples: &Samples<V>) -> Layers<V> {
        let none = v.vset_i32(0);
        let receiver = v.vload_i32(self.grid.samples.column(field!(Sample.receiver)), samples.first);
        let triangles = self.grid.receivers.columns.column(field!(Receiver.triangle));
        let own = v.vgather_i32_or(none, samples.live, triangles, receiver);
        Layers { own, layers: [none; 2] }
    }

    #[inline(always)]
    fn add<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &mut Layers<V>, entry: Entry<V>) {
        let number = entry.number(v);
        let in_every_lane = entry.in_every_lane(v);
        let triangle = self.triangles.record(v, number);
        let (live, points) = (samples.live, samples.position);
        state.layers = count_layers(v, live, points, state.own, in_every_lane, triangle, state.layers);
    }

    fn zeros(&self) -> Option<[Addr; 2]> {
        Some([0, 1].map(|k| self.sums.column(field!(Sums.layers[k]))))
    }

    #[inline(always)]
    fn end<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, state: &Layers<V>) {
        for (k, layers) in state.layers.into_iter().enumerate() {
            v.vstore_i32(samples.live, self.sums.column(field!(Sums.layers[k])), samples.first, layers);
        }
    }
}

/// Adds to the layers in F and B of 16 samples those that a triangle makes.
///
/// `number`: the triangle's, in every lane. Other arguments as in [`hidden`].
#[inline(always)]
pub fn count_layers<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    points: Vec3<V>,
    own: V::I32,
    number: V::I32,
    triangle: Record<V, TriangleRecord>,
    layers: [V::I32; 2],
) -> [V::I32; 2] {
    let Some(covered) = hidden(v, live, points, own, number, triangle) else { return layers };
    if !v.branch_any(covered) {
        return layers;
    }
    // The lowest two bits of the first flags: whether the triangle is a layer of F, and of B.
    let flags = triangle.int(v, field!(TriangleRecord.flags[0]));
    let one = v.vset_i32(FRONT);
    let front = int!(v, flags & one);
    let shift = v.vset_i32(BACK.trailing_zeros() as i32);
    let back = int!(v, (flags >> shift) & one);
    [v.viadd_or(layers[0], covered, layers[0], front), v.viadd_or(layers[1], covered, layers[1], back)]
}

/// Points of `live` that a triangle hides from the middle of the light; `None` where all are outside of its edges.
///
/// * `points`: light-centred.
/// * `own`: number of the triangle that each point lies on, which does not shadow it.
/// * `number`: number of this triangle, in every lane.
///
/// Homogeneous test of [algorithms, 1.2]: no division, right for triangles that cross the light's plane. 30 operations
/// for a miss by the edges: 12 broadcast loads, 16 vector operations, a mask test and a branch. 9 more for the plane.
#[inline(always)]
pub fn hidden<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    points: Vec3<V>,
    own: V::I32,
    number: V::I32,
    triangle: Record<V, TriangleRecord>,
) -> Option<V::Mask> {
    // Inside: on the triangle's side of all three edge planes; sign bits of side and flag agree.
    let mut outside = None;
    for edge in 0..3 {
        let side = dot_of(v, points, triangle, field!(TriangleRecord.edge_normals[edge]));
        let side = v.bits_of(side);
        let flag = triangle.int(v, field!(TriangleRecord.flags[edge]));
        let differs = v.vxor(side, flag);
        outside = Some(match outside {
            None => differs,
            Some(before) => v.vor(before, differs),
        });
    }
    let zero = v.vset_i32(0);
    let inside = match outside {
        Some(signs) => v.vicmp_ge_masked(live, signs, zero),
        None => live,
    };
    if !v.branch_any(inside) {
        return None;
    }
    // Beyond the plane, whose normal points away from the light, and not on the triangle itself.
    let depth = dot_of(v, points, triangle, field!(TriangleRecord.normal));
    let plane = triangle.float(v, field!(TriangleRecord.plane));
    let beyond = v.vcmp_gt_masked(inside, depth, plane);
    Some(v.vicmp_neq_masked(beyond, own, number))
}
