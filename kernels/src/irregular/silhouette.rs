//! Silhouette detection: records of the triangles, weights of the edges, records of those that weigh something.
//!
//! The paper leaves its cost out. An edge's weight is the number of counted faces left of it less those right of it, as
//! seen from the light; 0 means that both sides cancel [algorithms, 2.4].

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::primitives::{EdgeRecord, LightConstants, Primitives, TriangleRecord};
use super::touch::faces_of_penumbras;
use super::triangles;
use crate::clear;
use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::plane::{Vec3, dot, edge_normal, sub};
use crate::record::{Records, words};
use crate::scene::{Edge, ObjectNumbers, Scene};

/// Number of triangles or edges that a task handles.
const TASK: u32 = 256;

/// Finds what casts shadows: records of all triangles and, where `light` has a penumbra, of the edges that weigh something.
/// With numbers of their objects, if `objects` are given.
pub fn detect(
    scene: &Scene,
    light: LightConstants,
    objects: Option<ObjectNumbers>,
    runner: &mut Runner<'_>,
) -> Result<Primitives, Stopped> {
    let triangle_count = scene.triangle_count;
    let bounds = Columns::overwritten(runner.arena, triangle_count);
    let triangles = triangles::record(scene, light.radius, objects, Some(bounds), runner)?;
    let (edges, edge_count) = if light.is_soft() {
        silhouettes(scene, light, objects, triangles, runner)?
    } else {
        (Records::default(), 0)
    };
    Ok(Primitives { light, triangles, bounds, triangle_count, edges, edge_count })
}

/// Finds the edges that weigh something: weighs all, lists those, and makes their records. The records, and their number.
fn silhouettes(
    scene: &Scene,
    light: LightConstants,
    objects: Option<ObjectNumbers>,
    triangles: Records<TriangleRecord>,
    runner: &mut Runner<'_>,
) -> Result<(Records<EdgeRecord>, u32), Stopped> {
    let tasks = scene.edge_count.div_ceil(TASK);
    let weights = runner.arena.overwritten(u64::from(scene.edge_count) + 16);
    let [counter, written] = clear::zeroed(runner, [1, 1])?;
    let kernel = Weights { scene: *scene, triangles, weights, counter };
    // SAFETY: each task writes the weights of its own edges and adds to the counter.
    runner.run(&unsafe { Step::independent("edge weights", tasks, kernel) })?;

    let count = runner.arena.read_u32(counter);
    let list = runner.arena.overwritten(u64::from(count) + 16);
    let records = Records::overwritten(runner.arena, u64::from(count + 16));
    let kernel = Select { edge_count: scene.edge_count, weights, list, written };
    runner.run(&Step::ordered("silhouette list", tasks, kernel))?;

    let kernel = EdgeRecords { scene: *scene, weights, list, light, count, objects, records };
    // SAFETY: each task writes the records of its own edges.
    runner.run(&unsafe { Step::independent("edge records", count.div_ceil(TASK), kernel) })?;
    Ok((records, count))
}

/// Finds the weights of edges, and counts those that weigh something.
struct Weights {
    scene: Scene,
    triangles: Records<TriangleRecord>,
    /// The weights, by edge: F in the low half, B in the high half.
    weights: Addr,
    /// Number of edges that weigh something.
    counter: Addr,
}

/// Weights in F and B of the 16 edges from `i` on.
#[inline(always)]
fn edge_weights<V: Vpu>(v: &mut V, of: &Weights, live: V::Mask, i: V::S32) -> [V::I32; 2] {
    let zero = v.vset_i32(0);
    let one = v.vset_i32(1);
    let two = v.vset_i32(2);
    let four = v.vset_i32(4);
    let first = v.vload_i32(of.scene.edge_first, i);
    let end = v.vload_i32(of.scene.edge_first.plus_words(1), i);
    let mut face_at = first;
    let (mut front, mut back) = (zero, zero);
    let mut left_over = v.vicmp_lt_masked(live, face_at, end);
    while v.branch_any(left_over) {
        let face = v.vgather_i32_or(zero, left_over, of.scene.edge_faces, face_at);
        let at = int!(v, (face >> one) << four);
        let flags_of = of.triangles.field(field!(TriangleRecord.flags));
        let flags = v.vgather_i32_or(zero, left_over, flags_of, at);
        // A face away from the light lies left of the edges that it runs along.
        let away = int!(v, flags >> two);
        let left = v.vxor(away, face);
        let left = int!(v, left & one);
        let is_left = v.vicmp_eq_masked(left_over, left, one);
        let is_right = v.kandn(is_left, left_over);
        let in_front = int!(v, flags & one);
        let in_back = int!(v, (flags >> one) & one);
        front = v.viadd_or(front, is_left, front, in_front);
        front = v.visub_or(front, is_right, front, in_front);
        back = v.viadd_or(back, is_left, back, in_back);
        back = v.visub_or(back, is_right, back, in_back);
        face_at = int!(v, face_at + one);
        left_over = v.vicmp_lt_masked(live, face_at, end);
    }
    [front, back]
}

impl Kernel for Weights {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.scene.edge_count);
        let zero = v.vset_i32(0);
        let low_half = v.vset_i32(0xffff);
        let sixteen = v.vset_i32(16);
        let mut count = v.s_imm(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let [front, back] = edge_weights(v, self, live, i);
            let weight = int!(v, (front & low_half) | (back << sixteen));
            v.vstore_i32(live, self.weights, i, weight);
            let weighs = v.vicmp_neq_masked(live, weight, zero);
            let bits = v.kmov_to_scalar(weighs);
            let more = v.s_popcnt(bits);
            count = scalar!(v, count + more);
            i = scalar!(v, i + 16);
        }
        let at = v.s_imm(0);
        v.s_atomic_add(self.counter, at, count);
    }
}

/// Packs the edges that weigh something into a list.
struct Select {
    edge_count: u32,
    /// The weights, by edge.
    weights: Addr,
    /// Numbers of the edges that weigh something.
    list: Addr,
    /// Number of edges that have been written to the list.
    written: Addr,
}

impl Kernel for Select {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (first, end) = task_range(v, task, TASK, self.edge_count);
        let zero = v.vset_i32(0);
        let lane = v.viota();
        // Count, take room for all with one atomic, fill.
        let mut count = v.s_imm(0);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let weight = v.vload_i32_or(zero, live, self.weights, i);
            let weighs = v.vicmp_neq(weight, zero);
            let bits = v.kmov_to_scalar(weighs);
            let more = v.s_popcnt(bits);
            count = scalar!(v, count + more);
            i = scalar!(v, i + 16);
        }
        let at = v.s_imm(0);
        let mut to = v.s_atomic_add(self.written, at, count);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let weight = v.vload_i32_or(zero, live, self.weights, i);
            let weighs = v.vicmp_neq(weight, zero);
            let base = v.vsplat(i);
            let edge = int!(v, base + lane);
            v.vcompress_i32(weighs, self.list, to, edge);
            let bits = v.kmov_to_scalar(weighs);
            let more = v.s_popcnt(bits);
            to = scalar!(v, to + more);
            i = scalar!(v, i + 16);
        }
    }
}

/// Makes the records of the edges that weigh something.
struct EdgeRecords {
    scene: Scene,
    /// The weights, by edge.
    weights: Addr,
    /// Numbers of the edges that weigh something.
    list: Addr,
    light: LightConstants,
    /// Number of silhouette edges.
    count: u32,
    /// Numbers of objects, where they go with the records.
    objects: Option<ObjectNumbers>,
    records: Records<EdgeRecord>,
}

impl Kernel for EdgeRecords {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let EdgeRecords { scene, records, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, self.count);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let sixteen = v.vset_i32(16);
        let words = v.vset_i32(words::<EdgeRecord>() as i32);
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let edge = v.vload_i32_or(none, live, self.list, i);
            let [low, high] = each!(end in [0, 1] => {
                v.vgather_i32_or(none, live, scene.edges.column(field!(Edge.ends[end])), edge)
            });
            let weight = v.vgather_i32_or(none, live, self.weights, edge);
            let a = scene.positions(v, live, low);
            let b = scene.positions(v, live, high);
            let normal = edge_normal(v, a, b);
            let least2 = least_distance2(v, a, b, [zero, one]);
            let least = math::sqrt(v, least2);

            let front = int!(v, weight << sixteen);
            let front = v.vsra(front, sixteen);
            let behind = v.vsra(weight, sixteen);

            let base = v.vsplat(i);
            let number = int!(v, base + lane);
            let at = int!(v, number * words);
            let ends = each!(end in [0, 1] => field!(EdgeRecord.ends[end]));
            for (field, value) in [(ends[0], a), (ends[1], b), (field!(EdgeRecord.normal), normal)] {
                for (axis, x) in value.into_iter().enumerate() {
                    v.vscatter_f32(live, records.field(field.at(axis)), at, x);
                }
            }
            v.vscatter_i32(live, records.field(field!(EdgeRecord.weights[0])), at, front);
            v.vscatter_i32(live, records.field(field!(EdgeRecord.weights[1])), at, behind);
            v.vscatter_f32(live, records.field(field!(EdgeRecord.nearest)), at, least);
            let offset = rounding_offset(v, number);
            v.vscatter_f32(live, records.field(field!(EdgeRecord.rounding_offset)), at, offset);
            let faces = faces_of_penumbras(v, &self.light, [a, b]);
            v.vscatter_i32(live, records.field(field!(EdgeRecord.faces)), at, faces);
            if let Some(objects) = self.objects {
                let object = v.vgather_i32_or(none, live, objects.edges, edge);
                v.vscatter_i32(live, records.field(field!(EdgeRecord.object)), at, object);
            }
            i = scalar!(v, i + 16);
        }
    }
}

/// Least square distance of edges `a -> b` from the light: that of the foot of the perpendicular, where it lies on the edge. The
/// constants 0 and 1 are the caller's.
#[inline(always)]
pub(crate) fn least_distance2<V: Vpu>(v: &mut V, a: Vec3<V>, b: Vec3<V>, [zero, one]: [V::F32; 2]) -> V::F32 {
    let along = sub(v, b, a);
    let length2 = dot(v, along, along);
    let back = dot(v, a, along);
    let back = v.vsub(zero, back);
    let foot = math::div(v, back, length2);
    let foot = v.vmax(foot, zero);
    let foot = v.vmin(foot, one);
    let nearest = each!(axis in [0, 1, 2] => v.vmadd(along[axis], foot, a[axis]));
    dot(v, nearest, nearest)
}

/// What edge `number` adds before it rounds, in (-1/2, 1/2): multiples of the golden ratio modulo 1, which lie as evenly as can be.
///
/// Ten thousand equal terms (the edges of a regular body) would else all round the same way, and their sum be off by
/// 1e-4 of the light [algorithms, 6.9]. A part of 0 stays 0, since the offset is less than a half.
#[inline(always)]
pub fn rounding_offset<V: Vpu>(v: &mut V, number: V::I32) -> V::F32 {
    let golden = v.vset_i32(0x9e37_79b9_u32 as i32);
    let turned = int!(v, number * golden);
    let turned = v.vcvt_i32_f32(turned);
    // Below 2^-32, so that the greatest stays below a half.
    let unit = v.vset_f32(0.999_999 / 4_294_967_296.0);
    v.vmul(turned, unit)
}
