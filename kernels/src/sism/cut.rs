//! Triangles that the light is cut by: what each hides of it, as the part of it that lies in a polygon.
//!
//! `hard` and `soft` ask what lies between receivers and the middle of the light, and what changes from there to its rim. Of a
//! triangle that reaches into the light, a part lies beyond the light's plane, and parts of the light lie beyond the
//! triangle. Those few are no layers and on no silhouette, see
//! [`Aspect`](lrbsim_workloads::adjacency::Aspect): here each is clipped to what lies between a receiver and the light, and the
//! polygon that is left is projected on the light's plane. Its sides are summed as silhouettes are, with the turn of the polygon about the
//! middle in place of layers [algorithms, 0]. All of it is one receiver's, one triangle's: nothing has to agree with other kernels to
//! the last bit, and neither the side that the middle is on nor a corner beside it makes a difference.
//!
//! Heights over the light's plane and places on it are those about the middle of the light, where they have all their
//! digits: a corner a ten-thousandth of a radius from it is where it is.
//!
//! A step of its own, of which a scene without such triangles has none. Every receiver looks at every one of them: from 60 operations
//! for 16 receivers in its plane to some 2000 where it is clipped and hides something.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Arena, Compare, Kernel, Runner, Step, Stopped, Vpu};
use lrbsim_workloads::{Counting, ShadowInput};

use super::bits::horizon;
use super::own::Own;
use super::soft::{fixed, view};
use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::grid::{Grid, Sample};
use crate::irregular::primitives::{LightConstants, Primitives};
use crate::irregular::receivers::Receiver;
use crate::light::View;
use crate::plane::{Vec3, cross as cross3, dot as dot3, plane_slack, sub};
use crate::record::{Record, Records};
use crate::samples::LightSamples;
use crate::scene::fill;
use crate::segment::{Angle, Vec2, cross, or_nothing};

/// Triangles that a step looks at, at most.
const STEP_TRIANGLES: u32 = 16;

/// A triangle that the light is cut by: one line.
#[repr(C, align(64))]
struct CutRecord {
    /// Its corners, light-centred.
    corners: [[f32; 3]; 3],
    /// Its number, by which receivers on it know it.
    number: u32,
    /// Whether it hides light in both sums, whichever way it runs.
    is_sheet: i32,
}

/// The triangles that the light is cut by.
#[derive(Clone, Copy)]
pub struct CutTriangles {
    records: Records<CutRecord>,
    count: u32,
}

/// What the triangles hide of the light of a sample.
#[repr(C)]
pub struct CutParts {
    /// Parts of the light in F and B, in units of 2^-24.
    pub parts: [i32; 2],
}

/// Which samples of the light the triangles hide from a receiver, by groups of 16.
#[repr(C)]
pub struct CutSamples {
    /// A bit for each sample of the group, and 65 536 times the number of those that are not beyond the receiver's horizon.
    pub groups: [i32; super::bits::GROUPS_MAX],
}

/// What the triangles hide, as composition takes it.
#[derive(Clone, Copy)]
pub enum Hidden {
    /// As areas.
    Parts(Columns<CutParts>),
    /// As so many groups of samples.
    Samples(Columns<CutSamples>, usize),
}

impl CutTriangles {
    /// Copies the triangles into the arena, untimed as the rest of the scene; `None` where the light is cut by none.
    pub fn new(input: &ShadowInput, arena: &mut Arena) -> Option<CutTriangles> {
        if input.cut.is_empty() {
            return None;
        }
        let count = u32::try_from(input.cut.len()).expect("no more than some are listed");
        let records: Records<CutRecord> = Records::overwritten(arena, u64::from(count));
        for (i, triangle) in (0..).zip(&input.cut) {
            for (k, corner) in triangle.corners.iter().enumerate() {
                let bits = input.vertices[*corner as usize].map(f32::to_bits);
                fill(arena, records.host(i, field!(CutRecord.corners[k])), bits.into_iter());
            }
            arena.write_u32(records.host(i, field!(CutRecord.number)), triangle.number);
            let is_sheet = u32::from(triangle.counting == Counting::Sheet);
            arena.write_u32(records.host(i, field!(CutRecord.is_sheet)), is_sheet);
        }
        Some(CutTriangles { records, count })
    }

    /// The triangles in so many parts that no task of one is too long: the first of each, and their number.
    fn steps(self) -> impl Iterator<Item = (u32, u32)> {
        (0..self.count)
            .step_by(STEP_TRIANGLES as usize)
            .map(move |first| (first, STEP_TRIANGLES.min(self.count - first)))
    }

    /// Finds what the triangles hide of the light of each sample, as areas.
    pub fn parts(
        self,
        light: LightConstants,
        grid: &Grid,
        runner: &mut Runner<'_>,
    ) -> Result<Hidden, Stopped> {
        let parts = Columns::overwritten(runner.arena, grid.receivers.count);
        for (first, count) in self.steps() {
            // Tasks of few triangles take more samples.
            let size = 16 * (STEP_TRIANGLES / count);
            let records = self.records;
            let kernel = Areas { records, first, count, light, grid: *grid, parts, size };
            // SAFETY: each task writes the parts of its own samples.
            runner.run(&unsafe {
                Step::independent("cut triangles", grid.receivers.count.div_ceil(size), kernel)
            })?;
        }
        Ok(Hidden::Parts(parts))
    }

    /// Finds which samples of the light the triangles hide from each receiver.
    pub fn samples(
        self,
        primitives: &Primitives,
        light_samples: LightSamples,
        grid: &Grid,
        runner: &mut Runner<'_>,
    ) -> Result<Hidden, Stopped> {
        let own = Own { primitives: *primitives };
        let groups = light_samples.groups();
        let hidden = Columns::overwritten(runner.arena, grid.receivers.count);
        let steps =
            (0..groups).flat_map(|group| self.steps().map(move |(first, count)| (group, first, count)));
        for (group, first, count) in steps {
            let records = self.records;
            let kernel = Covered { records, first, count, own, light_samples, group, grid: *grid, hidden };
            // SAFETY: each task writes one group of its own samples.
            runner.run(&unsafe {
                Step::independent("cut samples", grid.receivers.count.div_ceil(16), kernel)
            })?;
        }
        Ok(Hidden::Samples(hidden, groups))
    }
}

/// 16 samples of the grid.
struct Seen<V: Vpu> {
    live: V::Mask,
    points: Vec3<V>,
    /// Numbers of their receivers.
    receiver: V::I32,
    /// Numbers of the triangles that they lie on.
    own: V::I32,
}

/// The samples of the grid from `i` on, to `end`.
#[inline(always)]
fn samples_from<V: Vpu>(v: &mut V, grid: &Grid, i: V::S32, end: V::S32) -> Seen<V> {
    let none = v.vset_i32(0);
    let zero = v.vset_f32(0.0);
    let live = lanes_below(v, i, end);
    let points = each!(axis in [0, 1, 2] => {
        v.vload_f32_or(zero, live, grid.samples.column(field!(Sample.position[axis])), i)
    });
    let receiver = v.vload_i32_or(none, live, grid.samples.column(field!(Sample.receiver)), i);
    let triangle = grid.receivers.columns.column(field!(Receiver.triangle));
    let own = v.vgather_i32_or(none, live, triangle, receiver);
    Seen { live, points, receiver, own }
}

/// What of a triangle lies between 16 receivers and the light, as polygons on their discs.
struct Polygon<V: Vpu> {
    /// Its sides, in order, with the lanes that have them: the three of the triangle, each after what joins it to the one before.
    sides: [(V::Mask, Vec2<V>, Vec2<V>); 6],
    /// Number of sides: three where nothing is clipped.
    count: usize,
}

/// The polygon of the triangle of `record`, as the receivers of `seen` have it: none for those on the triangle or in its plane.
#[inline(always)]
fn polygon<V: Vpu>(
    v: &mut V,
    view: &View<V>,
    seen: &Seen<V>,
    record: Record<V, CutRecord>,
) -> Option<Polygon<V>> {
    let corners = each!(k in [0, 1, 2] => record.vec3(v, field!(CutRecord.corners[k])));
    let number = record.number(v, field!(CutRecord.number));

    // Receivers in its plane, as far as f32 can tell, see it edge-on.
    let ab = sub(v, corners[1], corners[0]);
    let ac = sub(v, corners[2], corners[0]);
    let normal = cross3(v, ab, ac);
    let slack = plane_slack(v, corners, normal);
    let offset = dot3(v, corners[0], normal);
    let height = dot3(v, seen.points, normal);
    let height = v.vsub(height, offset);
    let height = v.vabs(height);
    let live = v.vicmp_neq_masked(seen.live, seen.own, number);
    let live = v.vcmp_gt_masked(live, height, slack);
    if !v.branch_any(live) {
        return None;
    }

    let [a, b, c] = each!(k in [0, 1, 2] => view.see_from_middle(v, corners[k]));
    let zero = v.vset_f32(0.0);
    let low = view.lowest_from_middle(v);
    let least = v.vmin(a[2], b[2]);
    let least = v.vmin(least, c[2]);
    let most = v.vmax(a[2], b[2]);
    let most = v.vmax(most, c[2]);
    let inside = v.vcmp_ge(least, low);
    let inside = v.vcmp_le_masked(inside, most, zero);
    let clipped = v.kandn(inside, live);
    if !v.branch_any(clipped) {
        let [a, b, c] = each!(corner in [a, b, c] => view.project_from_middle(v, corner));
        let nothing = (live, a, a);
        let sides = [(live, a, b), (live, b, c), (live, c, a), nothing, nothing, nothing];
        return Some(Polygon { sides, count: 3 });
    }
    let mut parts = [(live, [zero; 2], [zero; 2]); 3];
    for (part, (from, to)) in parts.iter_mut().zip([(a, b), (b, c), (c, a)]) {
        let (mut from, mut to) = (from, to);
        let left = view.clip_from_middle(v, live, &mut from, &mut to);
        let from = view.project_from_middle(v, from);
        let to = view.project_from_middle(v, to);
        *part = (left, from, to);
    }
    // Where a side was clipped away, the plane that clipped it joins the others. There are two sides at least.
    let mut before = each!(axis in [0, 1] => v.vblend_f32(parts[2].0, parts[2].2[axis], parts[1].2[axis]));
    let mut sides = [parts[0]; 6];
    for (k, (left, from, to)) in parts.into_iter().enumerate() {
        sides[2 * k] = (left, before, from);
        sides[2 * k + 1] = (left, from, to);
        before = each!(axis in [0, 1] => v.vblend_f32(left, to[axis], before[axis]));
    }
    Some(Polygon { sides, count: 6 })
}

/// Part of the light in a polygon, negative where it runs to the right.
#[inline(always)]
fn part_in<V: Vpu>(v: &mut V, view: &View<V>, polygon: &Polygon<V>) -> V::F32 {
    let zero = v.vset_f32(0.0);
    let one = v.vset_f32(1.0);
    let mut area = zero;
    for &(live, from, to) in &polygon.sides[..polygon.count] {
        // The part beyond the side is missing where the middle is left of it, and too much where it is right.
        let part = view.part_beyond(v, live, from, to, Angle::Atan2);
        let (cuts, part) = or_nothing(v, part);
        let turn = cross(v, from, to);
        let left = v.vcmp_ge(turn, zero);
        let less = v.kand(left, cuts);
        let more = v.kandn(left, cuts);
        area = v.vsub_or(area, less, area, part);
        area = v.vadd_or(area, more, area, part);
        // How often the polygon runs around the middle: crossings of the ray towards +x.
        let from_below = v.vcmp_le(from[1], zero);
        let to_below = v.vcmp_le(to[1], zero);
        let crosses = v.kxor(from_below, to_below);
        let crosses = v.kand(crosses, live);
        let rises = v.vcmp_gt(to[1], from[1]);
        let differs = v.kxor(left, rises);
        let around = v.kandn(differs, crosses);
        let up = v.kand(around, left);
        let down = v.kandn(left, around);
        area = v.vadd_or(area, up, area, one);
        area = v.vsub_or(area, down, area, one);
    }
    area
}

/// Finds the areas that are hidden.
struct Areas {
    records: Records<CutRecord>,
    /// First triangle that is looked at.
    first: u32,
    /// Number of triangles that are looked at.
    count: u32,
    light: LightConstants,
    grid: Grid,
    parts: Columns<CutParts>,
    /// Samples of a task.
    size: u32,
}

impl Kernel for Areas {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, self.size, self.grid.receivers.count);
        let none = v.vset_i32(0);
        let zero = v.vset_f32(0.0);
        let one = v.vset_f32(1.0);
        while v.branch(Compare::Less, i, end) {
            let seen = samples_from(v, &self.grid, i, end);
            let view = view(v, &self.light, seen.points);
            let mut parts = [none; 2];
            if self.first > 0 {
                parts = each!(k in [0, 1] => {
                    v.vload_i32_or(none, seen.live, self.parts.column(field!(CutParts.parts[k])), i)
                });
            }
            let mut number = v.s_imm(self.first as i32);
            let end = v.s_imm((self.first + self.count) as i32);
            while v.branch(Compare::Less, number, end) {
                let record = self.records.record(v, number);
                number = scalar!(v, number + 1);
                let Some(polygon) = polygon(v, &view, &seen, record) else { continue };
                let area = part_in(v, &view, &polygon);
                let size = v.vabs(area);
                let size = v.vmin(size, one);
                let part = fixed(v, size, zero);
                // A sheet hides in both sums; the surface of a body in F where the light comes to it from outside, and in B where
                // from inside.
                let is_sheet = record.int(v, field!(CutRecord.is_sheet));
                let is_sheet = v.vicmp_neq(is_sheet, none);
                let entered = v.vcmp_gt(area, zero);
                let entered = v.kor(entered, is_sheet);
                let left = v.vcmp_lt(area, zero);
                let left = v.kor(left, is_sheet);
                parts[0] = v.viadd_or(parts[0], entered, parts[0], part);
                parts[1] = v.viadd_or(parts[1], left, parts[1], part);
            }
            for (k, part) in parts.into_iter().enumerate() {
                v.vstore_i32(seen.live, self.parts.column(field!(CutParts.parts[k])), i, part);
            }
            i = scalar!(v, i + 16);
        }
    }
}

/// Finds which of a group of samples of the light are hidden.
struct Covered {
    records: Records<CutRecord>,
    /// First triangle that is looked at.
    first: u32,
    /// Number of triangles that are looked at.
    count: u32,
    /// The light, and the triangles that receivers lie on.
    own: Own,
    light_samples: LightSamples,
    /// Number of the group.
    group: usize,
    grid: Grid,
    hidden: Columns<CutSamples>,
}

impl Kernel for Covered {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (i, end) = task_range(v, task, 16, self.grid.receivers.count);
        let none = v.vset_i32(0);
        let zero = v.vset_f32(0.0);
        let seen = samples_from(v, &self.grid, i, end);
        let view = view(v, &self.own.primitives.light, seen.points);
        let [cos, sin] = self.light_samples.turn(v, self.grid.receivers.columns, seen.live, seen.receiver);
        let view = view.turned(v, cos, sin);
        let column = self.hidden.column(field!(CutSamples.groups[self.group]));
        let mut hidden = none;
        if self.first > 0 {
            let low_half = v.vset_i32(0xffff);
            let before = v.vload_i32_or(none, seen.live, column, i);
            hidden = v.vand(before, low_half);
        }
        let mut number = v.s_imm(self.first as i32);
        let end = v.s_imm((self.first + self.count) as i32);
        while v.branch(Compare::Less, number, end) {
            let record = self.records.record(v, number);
            number = scalar!(v, number + 1);
            let Some(mut polygon) = polygon(v, &view, &seen, record) else { continue };
            let area = part_in(v, &view, &polygon);
            let covers = v.vcmp_neq(area, zero);
            let covers = v.kand(covers, seen.live);
            if !v.branch_any(covers) {
                continue;
            }
            // Of each side the normal that points inward, and how far along it the side is; a side that is not there holds
            // everything.
            let right = v.vcmp_lt(area, zero);
            for (live, from, to) in &mut polygon.sides[..polygon.count] {
                let e = [v.vsub(to[0], from[0]), v.vsub(to[1], from[1])];
                let offset = cross(v, *to, *from);
                let turned = each!(x in [e[0], e[1], offset] => v.vsub_or(x, right, zero, x));
                let [x, y, offset] = each!(k in [0, 1, 2] => v.vblend_f32(*live, turned[k], zero));
                (*from, *to) = ([x, y], [offset, zero]);
            }
            for sample in 0..16 {
                let number = v.s_imm((self.group * 16 + sample) as i32);
                let place = self.light_samples.place(v, number);
                let mut inside = covers;
                for (_, along, [offset, _]) in &polygon.sides[..polygon.count] {
                    let right = v.vmul(along[1], place[0]);
                    let across = v.vmsub(along[0], place[1], right);
                    inside = v.vcmp_ge_masked(inside, across, *offset);
                }
                let bit = v.vset_i32(1 << sample);
                hidden = v.vor_or(hidden, inside, hidden, bit);
            }
        }
        // Their number, by halves of halves, but for those that the receiver's own plane has from it: composition adds what lies
        // beyond that.
        let mut bits = hidden;
        let triangles = self.own.triangles(v, seen.live, seen.own);
        if v.branch_any(triangles.cut) {
            let (cut, horizon) = horizon(v, &self.own, &view, &triangles);
            let counted = v.vicmp_neq(horizon.step, none);
            let cut = v.kand(cut, counted);
            for sample in 0..16 {
                let number = v.s_imm((self.group * 16 + sample) as i32);
                let place = self.light_samples.place(v, number);
                let beyond = horizon.beyond(v, place);
                let beyond = v.kand(beyond, cut);
                let others = v.vset_i32(!(1 << sample));
                bits = v.vand_or(bits, beyond, bits, others);
            }
        }
        for (shift, mask) in [(1, 0x5555), (2, 0x3333), (4, 0x0f0f), (8, 0x00ff)] {
            let shift = v.vset_i32(shift);
            let mask = v.vset_i32(mask);
            bits = int!(v, (bits & mask) + ((bits >> shift) & mask));
        }
        let half = v.vset_i32(16);
        let hidden = int!(v, hidden | (bits << half));
        v.vstore_i32(seen.live, column, i, hidden);
    }
}
