//! Soft shadow kernel: the signed part of the light's disc beyond each silhouette edge [johnson09, Eq. 3].
//!
//! An edge is projected from the receiver onto the light and cut to it. On a disc, what is measured is the circular sector
//! that the cut edge spans, seen from the middle of the disc, less the triangle between middle and edge. With the layers of
//! `hard`, which count what hides the middle, these parts add up to what is covered [algorithms, 0]: a part is negative where
//! the middle is on the occluder's side of the edge, since a layer was counted there, and positive where it is not.
//!
//! Edges are those that weigh something, counted once for all bodies in F and in B, as layers are in `hard`. Tasks, lanes and
//! loops are those of `hard`: a run of samples, 16 at a time, past all edges listed for their cell.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::Sums;
use super::kept::Kept;
use super::objects::Objects;
use super::printed::{Plane, Printed};
use crate::columns::Columns;
use crate::expression::int;
use crate::field;
use crate::irregular::primitives::{EdgeRecord, Kind, LightConstants, Primitives};
use crate::irregular::run::{Entry, Found, Samples, See, Walk};
use crate::light::View;
use crate::plane::Vec3;
use crate::record::{Record, Records};
use crate::segment::{Angle, Vec2};

/// A whole light in fixed point: sums of 32-bit integers are the same in any order [algorithms, 6.9], and hold 127 lights.
pub const WHOLE: f32 = (1 << 24) as f32;

/// Sums the parts of edges for every sample in a block that holds edges, to [`Sums::coverage`]: one task a run. Where objects
/// are told apart, what all of them cover to the first, in fixed point.
pub fn sum(
    walk: Walk,
    primitives: &Primitives,
    how: How,
    objects: Option<Objects>,
    sums: Columns<Sums>,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let soft = Soft { walk, light: primitives.light, edges: primitives.edges, how, objects, sums };
    // SAFETY: each task writes the sums of its own samples: a sample lies in one run.
    runner.run(&unsafe { Step::independent("soft", walk.run_count(), soft) })
}

/// How parts are found and summed.
#[derive(Clone, Copy, Default)]
pub struct How {
    /// The images of edges, where parts are those of the printed form; `None`: those of the exact one.
    pub printed: Option<Printed>,
    /// How angles are taken.
    pub angle: Angle,
    /// What sums are kept in.
    pub kept: Kept,
}

/// Sums the parts of edges for the samples of a run.
struct Soft {
    walk: Walk,
    light: LightConstants,
    edges: Records<EdgeRecord>,
    how: How,
    /// How objects are told apart; `None` where the parts of all are summed.
    objects: Option<Objects>,
    sums: Columns<Sums>,
}

/// The light as 16 samples see it.
enum Seen<V: Vpu> {
    /// A disc in their own frames.
    Disc(View<V>),
    /// A circle on the image plane of their face, with the images of edges there.
    Circle(Printed, Plane<V>),
}

impl Kernel for Soft {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        self.walk.run(v, task, self);
    }
}

impl Soft {
    /// Adds the part of an edge to the coverage of `samples` in F and B, see [`Kept`].
    #[inline(always)]
    fn add<V: Vpu>(
        &self,
        v: &mut V,
        samples: &Samples<V>,
        light: &Seen<V>,
        entry: &Entry<V>,
        coverage: [V::I32; 2],
    ) -> [V::I32; 2] {
        let number = entry.number(v);
        let How { angle, kept, .. } = self.how;
        let (live, points) = (samples.live, samples.position);
        match light {
            Seen::Disc(view) => {
                let edge = self.edges.record(v, number);
                match part(v, view, live, edge, angle) {
                    Some((live, f)) => add_part(v, live, f, points, edge, kept, coverage),
                    None => coverage,
                }
            }
            Seen::Circle(printed, plane) => match printed.part(v, plane, live, number, angle) {
                Some((live, f)) => {
                    let edge = self.edges.record(v, number);
                    add_part(v, live, f, points, edge, kept, coverage)
                }
                None => coverage,
            },
        }
    }
}

impl See for Soft {
    #[inline(always)]
    fn see<V: Vpu>(&self, v: &mut V, walk: &Walk, samples: &Samples<V>, mut edges: Found<V>) {
        let light = match self.how.printed {
            None => Seen::Disc(view(v, &self.light, samples.position)),
            Some(printed) => Seen::Circle(printed, printed.plane(v, samples)),
        };
        let none = v.vset_i32(0);
        let kept = self.how.kept;
        let mut coverage = [none; 2];

        let Some(objects) = &self.objects else {
            while let Some(entry) = edges.next(v, walk) {
                coverage = self.add(v, samples, &light, &entry, coverage);
            }
            for (k, coverage) in coverage.into_iter().enumerate() {
                let column = self.sums.column(field!(Sums.coverage[k]));
                let coverage = kept.in_fixed_point(v, coverage);
                v.vstore_i32(samples.live, column, samples.first, coverage);
            }
            return;
        };

        // Triangles and edges of the cell side by side, whichever is of the lesser object.
        let mut left = objects.begin(v, samples);
        let mut found = [walk.of_kind(v, Kind::Triangles, samples, &edges), edges];
        let mut next = [None, None];
        loop {
            for kind in Kind::ALL {
                let k = kind as usize;
                if next[k].is_none()
                    && let Some(entry) = found[k].next(v, walk)
                {
                    let object = objects.of(v, kind, &entry);
                    next[k] = Some((entry, object));
                }
            }
            let kind = match &next {
                [None, None] => None,
                [Some(_), None] => Some(Kind::Triangles),
                [Some((_, a)), Some((_, b))] if v.branch(Compare::LessEqual, *a, *b) => Some(Kind::Triangles),
                _ => Some(Kind::Edges),
            };
            let first = kind.and_then(|kind| next[kind as usize].take());
            let object = match &first {
                Some((_, object)) => *object,
                None => v.s_imm(-1),
            };
            if objects.turn_to(v, object, kept, coverage, &mut left) {
                coverage = [none; 2];
            }
            let (Some(kind), Some((entry, _))) = (kind, first) else { break };
            match kind {
                Kind::Triangles => objects.count(v, samples, &entry, &mut left),
                Kind::Edges => coverage = self.add(v, samples, &light, &entry, coverage),
            }
        }
        let covered = objects.covered(v, samples, &left);
        v.vstore_i32(samples.live, self.sums.column(field!(Sums.coverage[0])), samples.first, covered);
    }

    /// Where objects are told apart, a cell without silhouettes has all of the light as its middle, or as the horizon has it.
    fn zeros(&self) -> Option<[Addr; 2]> {
        match self.objects {
            None => Some([0, 1].map(|k| self.sums.column(field!(Sums.coverage[k])))),
            Some(_) => None,
        }
    }
}

/// The light as 16 samples see it.
#[inline(always)]
pub fn view<V: Vpu>(v: &mut V, light: &LightConstants, points: Vec3<V>) -> View<V> {
    let per_radius = v.vset_f32(1.0 / light.radius);
    View::new(v, &light.shape, points, per_radius)
}

/// Adds to the coverage in F and B of 16 samples, in fixed point, the signed part that an edge makes in the exact form.
///
/// The side of the middle of the light is told by the plane through light and edge, the one that bounds the triangles of `hard`
/// there, bit by bit: a receiver on one side of it sees the middle on that side of the edge. 62 operations where the edges miss all
/// discs, 136 for a part that needs no clipping.
#[inline(always)]
pub fn add_edge<V: Vpu>(
    v: &mut V,
    view: &View<V>,
    live: V::Mask,
    points: Vec3<V>,
    edge: Record<V, EdgeRecord>,
    coverage: [V::I32; 2],
) -> [V::I32; 2] {
    match part(v, view, live, edge, Angle::Atan2) {
        Some((live, f)) => add_part(v, live, f, points, edge, Kept::Fixed, coverage),
        None => coverage,
    }
}

/// The part of the light beyond an edge, in the exact form, and the lanes of `live` where the edge cuts the light; `None` where it does in
/// none.
#[inline(always)]
fn part<V: Vpu>(
    v: &mut V,
    view: &View<V>,
    live: V::Mask,
    edge: Record<V, EdgeRecord>,
    angle: Angle,
) -> Option<(V::Mask, V::F32)> {
    let (live, [u0, u1]) = on_disc(v, view, live, edge);
    view.part_beyond(v, live, u0, u1, angle)
}

/// Adds part `f` to the coverage in F and B of the samples in `live`, with the sign that `edge` gives it there.
#[inline(always)]
pub fn add_part<V: Vpu>(
    v: &mut V,
    live: V::Mask,
    f: V::F32,
    points: Vec3<V>,
    edge: Record<V, EdgeRecord>,
    kept: Kept,
    coverage: [V::I32; 2],
) -> [V::I32; 2] {
    if kept != Kept::Fixed {
        return kept.add(v, live, f, points, edge, coverage);
    }
    // A weight counts faces left of the edge less those right of it: what covers the side that the middle is on is subtracted. Loads pair with
    // what stands between them.
    let normal = |axis: usize| field!(EdgeRecord.normal[axis]);
    let z = edge.float(v, normal(2));
    let of_z = v.vmul(points[2], z);
    let offset = edge.float(v, field!(EdgeRecord.rounding_offset));
    let fixed = fixed(v, f, offset);
    let y = edge.float(v, normal(1));
    let of_yz = v.vmadd(points[1], y, of_z);
    let x = edge.float(v, normal(0));
    let side = v.vmadd(points[0], x, of_yz);
    let none = v.vset_i32(0);
    let side = v.bits_of(side);
    let left = v.vicmp_ge(side, none);
    let front = edge.int(v, field!(EdgeRecord.weights[0]));
    let signed = v.visub_or(fixed, left, none, fixed);
    let back = edge.int(v, field!(EdgeRecord.weights[1]));
    let front = int!(v, front * signed);
    let back = int!(v, back * signed);
    [v.viadd_or(coverage[0], live, coverage[0], front), v.viadd_or(coverage[1], live, coverage[1], back)]
}

/// What of an edge lies between receiver and light, as its ends on the disc, in radii; the lanes of `live` where some does.
#[inline(always)]
pub fn on_disc<V: Vpu>(
    v: &mut V,
    view: &View<V>,
    live: V::Mask,
    edge: Record<V, EdgeRecord>,
) -> (V::Mask, [Vec2<V>; 2]) {
    let ends = view.see_ends(v, edge, [field!(EdgeRecord.ends[0]), field!(EdgeRecord.ends[1])]);
    view.place(v, live, ends)
}

/// Part `f` of the disc in fixed point, rounded after `offset` is added, see [`rounding_offset`](crate::irregular::silhouette::rounding_offset).
#[inline(always)]
pub fn fixed<V: Vpu>(v: &mut V, f: V::F32, offset: V::F32) -> V::I32 {
    let whole = v.vset_f32(WHOLE);
    let scaled = v.vmadd(f, whole, offset);
    let rounded = v.vround(scaled);
    v.vcvt_f32_i32(rounded)
}
