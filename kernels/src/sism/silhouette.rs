//! Silhouette detection: records of the triangles, weights of the edges, records of those that weigh something.
//!
//! The paper leaves its cost out. An edge's weight is the number of counted faces left of it less those right of it, as
//! seen from the light; 0 means that both sides cancel [algorithms, 2.4].

use lrbsim_isa::{Arena, Compare, Kernel, Ordering, Step, Vpu, math};

use super::Frame;
use super::layout::{EDGE_WORDS, Layout};
use super::soft::rounding_offset;
use super::touch::{faces_of_edges, faces_of_triangles};
use crate::columns::{lanes_below, task_range};
use crate::plane::{AWAY, FACES_SHIFT, TRIANGLE_WORDS, Vec3, cross, dot, edge_normal, plane_slack, sub};

/// Triangles or edges of a task.
const TASK: u32 = 256;

/// Records of all triangles.
pub fn triangles(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "triangle records",
        ordering: Ordering::Independent,
        tasks: layout.triangle_count.div_ceil(TASK),
        kernel: Box::new(Triangles { layout }),
    }
}

/// Weights of all edges, and how many weigh something.
pub fn weights(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "edge weights",
        ordering: Ordering::Independent,
        tasks: layout.edge_count.div_ceil(TASK),
        kernel: Box::new(Weights { layout }),
    }
}

/// The edges that weigh something, packed.
pub fn select(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    layout.silhouette_count = arena.read_u32(layout.silhouette_counter);
    layout.silhouettes = arena.alloc(u64::from(layout.silhouette_count) + 16);
    layout.edge_records = arena.alloc(u64::from(layout.silhouette_count + 16) * u64::from(EDGE_WORDS));
    // A line of its own: the total stays.
    layout.silhouette_counter = arena.alloc(1);
    Step {
        name: "silhouette list",
        ordering: Ordering::Ordered,
        tasks: layout.edge_count.div_ceil(TASK),
        kernel: Box::new(Select { layout: *layout }),
    }
}

/// Records of the silhouette edges.
pub fn records(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "edge records",
        ordering: Ordering::Independent,
        tasks: layout.silhouette_count.div_ceil(TASK),
        kernel: Box::new(Records { layout }),
    }
}

/// Positions of 16 vertices.
#[inline(always)]
fn positions<V: Vpu>(v: &mut V, layout: &Layout, live: V::Mask, vertex: V::I32) -> Vec3<V> {
    let zero = v.vset_f32(0.0);
    let mut axis = |column| v.vgather_f32_or(zero, live, layout.vertices.column(column), vertex);
    [axis(0), axis(1), axis(2)]
}

struct Triangles {
    layout: Layout,
}

impl Kernel for Triangles {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, TASK, layout.triangle_count);
        let step = v.s_imm(16);
        let lane = v.viota();
        let words = v.vset_i32(TRIANGLE_WORDS as i32);
        let zero = v.vset_f32(0.0);
        let sign_bit = v.vset_i32(i32::MIN);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let mut corner = |column| v.vload_i32(layout.triangles.column(column), i);
            let corners = [corner(0), corner(1), corner(2), corner(3)];
            let a = positions(v, layout, live, corners[0]);
            let b = positions(v, layout, live, corners[1]);
            let c = positions(v, layout, live, corners[2]);

            // Plane: normal away from the light, so that its determinant is positive.
            let ab = sub(v, b, a);
            let ac = sub(v, c, a);
            let normal = cross(v, ab, ac);
            let det = dot(v, a, normal);
            let away = v.vcmp_gt(det, zero);
            let toward = v.vcmp_lt(det, zero);
            let mut outward = |x: V::F32| v.vsub_or(x, toward, zero, x);
            let outward = [outward(normal[0]), outward(normal[1]), outward(normal[2])];
            let distance = v.vabs(det);
            let slack = plane_slack(v, [a, b, c], normal);
            let plane = v.vadd(distance, slack);

            // Layers by the facing; none for a triangle that is edge-on to the light.
            let layers = layers(v, corners[3], away, toward);

            // Edge planes by vertex number: the same bits from both triangles on an edge.
            let base = v.vsplat(i);
            let number = v.viadd(base, lane);
            let at = v.vimul(number, words);
            let pairs = [(0, 1, a, b), (1, 2, b, c), (2, 0, c, a)];
            let mut inward = [[zero; 3]; 3];
            let mut flags = [layers; 3];
            for (edge, (from, to, start, end)) in pairs.into_iter().enumerate() {
                let swapped = v.vicmp_gt(corners[from], corners[to]);
                let mut low = start;
                let mut high = end;
                for axis in 0..3 {
                    low[axis] = v.vblend_f32(swapped, end[axis], start[axis]);
                    high[axis] = v.vblend_f32(swapped, start[axis], end[axis]);
                }
                let plane_normal = edge_normal(v, low, high);
                // Right of low -> high: towards the light and in order, or away and swapped.
                let right = v.kxor(toward, swapped);
                for (axis, x) in plane_normal.into_iter().enumerate() {
                    inward[edge][axis] = v.vsub_or(x, right, zero, x);
                    let word = 12 * edge as u64 + 4 * axis as u64;
                    v.vscatter_f32(live, layout.triangle_records.plus(word), at, x);
                }
                let flag = if edge == 0 { layers } else { v.vset_i32(0) };
                flags[edge] = v.vor_or(flag, right, flag, sign_bit);
            }
            // Faces that it can shadow, so that binning skips the others.
            let faces = faces_of_triangles(v, inward);
            let shift = v.vset_i32(FACES_SHIFT);
            let faces = v.vsll(faces, shift);
            flags[0] = v.vor(flags[0], faces);
            for (edge, flag) in flags.into_iter().enumerate() {
                v.vscatter_i32(live, layout.triangle_records.plus(52 + 4 * edge as u64), at, flag);
            }
            for (axis, x) in outward.into_iter().enumerate() {
                v.vscatter_f32(live, layout.triangle_records.plus(36 + 4 * axis as u64), at, x);
            }
            v.vscatter_f32(live, layout.triangle_records.plus(48), at, plane);
            i = v.s_add(i, step);
        }
    }
}

/// Layers of triangles in F and B, and [`AWAY`] for those that face away; 0 for those edge-on.
#[inline(always)]
fn layers<V: Vpu>(v: &mut V, counted: V::I32, away: V::Mask, toward: V::Mask) -> V::I32 {
    let none = v.vset_i32(0);
    let both = v.vset_i32(3);
    let half = v.vset_i32(16);
    let away_bit = v.vset_i32(AWAY);
    let when_toward = v.vand_or(none, toward, counted, both);
    let high = v.vsrl(counted, half);
    let when_away = v.vor(high, away_bit);
    v.vblend_i32(away, when_away, when_toward)
}

/// Weights in F and B of 16 edges.
#[inline(always)]
fn edge_weight<V: Vpu>(v: &mut V, layout: &Layout, live: V::Mask, i: V::S32) -> [V::I32; 2] {
    let zero = v.vset_i32(0);
    let one = v.vset_i32(1);
    let two = v.vset_i32(2);
    let four = v.vset_i32(4);
    let first = v.vload_i32(layout.edge_first, i);
    let end = v.vload_i32(layout.edge_first.plus(4), i);
    let mut face_at = first;
    let (mut front, mut back) = (zero, zero);
    let mut left_over = v.vicmp_lt_masked(live, face_at, end);
    while v.branch_any(left_over) {
        let face = v.vgather_i32_or(zero, left_over, layout.edge_faces, face_at);
        let triangle = v.vsrl(face, one);
        let at = v.vsll(triangle, four);
        let flags = v.vgather_i32_or(zero, left_over, layout.triangle_records.plus(52), at);
        // A face away from the light lies left of the edges that it runs along.
        let away = v.vsrl(flags, two);
        let left = v.vxor(away, face);
        let left = v.vand(left, one);
        let is_left = v.vicmp_eq_masked(left_over, left, one);
        let is_right = v.kandn(is_left, left_over);
        let in_front = v.vand(flags, one);
        let in_back = v.vsrl(flags, one);
        let in_back = v.vand(in_back, one);
        front = v.viadd_or(front, is_left, front, in_front);
        front = v.visub_or(front, is_right, front, in_front);
        back = v.viadd_or(back, is_left, back, in_back);
        back = v.visub_or(back, is_right, back, in_back);
        face_at = v.viadd(face_at, one);
        left_over = v.vicmp_lt_masked(live, face_at, end);
    }
    [front, back]
}

struct Weights {
    layout: Layout,
}

impl Kernel for Weights {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, TASK, layout.edge_count);
        let step = v.s_imm(16);
        let zero = v.vset_i32(0);
        let low_half = v.vset_i32(0xffff);
        let sixteen = v.vset_i32(16);
        let mut count = v.s_imm(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let [front, back] = edge_weight(v, layout, live, i);
            let low = v.vand(front, low_half);
            let high = v.vsll(back, sixteen);
            let weight = v.vor(low, high);
            v.vstore_i32(live, layout.edge_weights, i, weight);
            let weighs = v.vicmp_neq_masked(live, weight, zero);
            let bits = v.kmov_to_scalar(weighs);
            let more = v.s_popcnt(bits);
            count = v.s_add(count, more);
            i = v.s_add(i, step);
        }
        let at = v.s_imm(0);
        v.s_atomic_add(layout.silhouette_counter, at, count);
    }
}

struct Select {
    layout: Layout,
}

impl Kernel for Select {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (first, end) = task_range(v, task, TASK, layout.edge_count);
        let step = v.s_imm(16);
        let zero = v.vset_i32(0);
        let lane = v.viota();
        // Count, take room for all with one atomic, fill.
        let mut count = v.s_imm(0);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let weight = v.vload_i32_or(zero, live, layout.edge_weights, i);
            let weighs = v.vicmp_neq(weight, zero);
            let bits = v.kmov_to_scalar(weighs);
            let more = v.s_popcnt(bits);
            count = v.s_add(count, more);
            i = v.s_add(i, step);
        }
        let at = v.s_imm(0);
        let mut to = v.s_atomic_add(layout.silhouette_counter, at, count);
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let weight = v.vload_i32_or(zero, live, layout.edge_weights, i);
            let weighs = v.vicmp_neq(weight, zero);
            let base = v.vsplat(i);
            let edge = v.viadd(base, lane);
            v.vcompress_i32(weighs, layout.silhouettes, to, edge);
            let bits = v.kmov_to_scalar(weighs);
            let more = v.s_popcnt(bits);
            to = v.s_add(to, more);
            i = v.s_add(i, step);
        }
    }
}

struct Records {
    layout: Layout,
}

impl Kernel for Records {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, TASK, layout.silhouette_count);
        let step = v.s_imm(16);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let sixteen = v.vset_i32(16);
        let words = v.vset_i32(EDGE_WORDS as i32);
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let edge = v.vload_i32_or(none, live, layout.silhouettes, i);
            let low = v.vgather_i32_or(none, live, layout.edges.column(0), edge);
            let high = v.vgather_i32_or(none, live, layout.edges.column(1), edge);
            let weight = v.vgather_i32_or(none, live, layout.edge_weights, edge);
            let a = positions(v, layout, live, low);
            let b = positions(v, layout, live, high);
            let normal = edge_normal(v, a, b);
            // Least distance from the light: the foot of the perpendicular, where it lies on the edge.
            let along = sub(v, b, a);
            let length2 = dot(v, along, along);
            let back = dot(v, a, along);
            let back = v.vsub(zero, back);
            let foot = math::div(v, back, length2);
            let foot = v.vmax(foot, zero);
            let foot = v.vmin(foot, one);
            let mut near = |axis: usize| v.vmadd(along[axis], foot, a[axis]);
            let nearest = [near(0), near(1), near(2)];
            let least2 = dot(v, nearest, nearest);
            let least = math::sqrt(v, least2);

            let front = v.vsll(weight, sixteen);
            let front = v.vsra(front, sixteen);
            let behind = v.vsra(weight, sixteen);

            let base = v.vsplat(i);
            let number = v.viadd(base, lane);
            let at = v.vimul(number, words);
            let values = [a[0], a[1], a[2], b[0], b[1], b[2], normal[0], normal[1], normal[2]];
            for (word, value) in values.into_iter().enumerate() {
                v.vscatter_f32(live, layout.edge_records.plus(4 * word as u64), at, value);
            }
            v.vscatter_i32(live, layout.edge_records.plus(36), at, front);
            v.vscatter_i32(live, layout.edge_records.plus(40), at, behind);
            v.vscatter_f32(live, layout.edge_records.plus(44), at, least);
            let offset = rounding_offset(v, number);
            v.vscatter_f32(live, layout.edge_records.plus(48), at, offset);
            let faces = faces_of_edges(v, &layout.light, a, b);
            v.vscatter_i32(live, layout.edge_records.plus(52), at, faces);
            i = v.s_add(i, step);
        }
    }
}
