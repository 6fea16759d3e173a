//! Bounds of the receivers on the image plane of each face: of each task's receivers, then of all.

use lrbsim_isa::{Arena, Compare, Kernel, Ordering, Step, Vpu, math};

use super::Frame;
use super::grid::{Constants, load_positions, project};
use super::layout::{FACES, Layout, RECEIVERS_TASK};
use crate::columns::{lanes_below, task_range};

/// Bounds of a face: least x, -x, y, -y, z, -z on the image plane. Negated maxima, so that one minimum serves all. The
/// number of receivers is the word behind them; where it is 0 there are no bounds.
pub(super) const BOUNDS: u32 = 6;

/// More than any coordinate.
pub(super) const FAR: f32 = 1e30;

/// Tables of tasks that a task of `face bounds` asks for ahead.
const AHEAD: u64 = 8;

/// Bounds of the receivers of each task, by face.
pub fn bounds(frame: &mut Frame, arena: &mut Arena) -> Step {
    let layout = &mut frame.layout;
    let tasks = layout.receiver_tasks();
    layout.lane_bounds = arena.alloc(16 * u64::from(tasks * FACES * BOUNDS));
    layout.task_bounds = arena.alloc(16 * u64::from(FACES * tasks));
    layout.face_bounds = arena.alloc(16 * u64::from(FACES));
    Step {
        name: "receiver bounds",
        ordering: Ordering::Independent,
        tasks,
        kernel: Box::new(TaskBounds { layout: *layout }),
    }
}

/// Bounds of all receivers, by face.
pub fn reduce(frame: &mut Frame, _: &mut Arena) -> Step {
    let layout = frame.layout;
    Step {
        name: "face bounds",
        ordering: Ordering::Independent,
        tasks: FACES,
        kernel: Box::new(FaceBounds { layout }),
    }
}

struct TaskBounds {
    layout: Layout,
}

impl Kernel for TaskBounds {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let (mut i, end) = task_range(v, task, RECEIVERS_TASK, layout.receiver_count);
        let step = v.s_imm(16);
        let words = v.s_imm((16 * FACES * BOUNDS) as i32);
        let table = v.s_mul(task, words);
        let all = v.mask_all();
        let constants = Constants::new(v);
        let zero = constants.zero;
        let far = v.vset_f32(FAR);
        let none = v.s_imm(0);
        let mut counts = [none; FACES as usize];
        let of_face = |face: usize| layout.lane_bounds.plus(64 * face as u64 * u64::from(BOUNDS));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, &constants, layout.receivers, live, i);
            let (face, x, y, depth) = project(v, &constants, p);
            let minus = [v.vsub(zero, x), v.vsub(zero, y), v.vsub(zero, depth)];
            let values = [x, minus[0], y, minus[1], depth, minus[2]];
            for (f, count) in counts.iter_mut().enumerate() {
                let here = v.vicmp_eq_masked(live, face, constants.whole[f]);
                if !v.branch_any(here) {
                    continue;
                }
                // The table holds nothing before its first receivers: faces that are not seen cost nothing.
                let is_new = v.branch(Compare::Equal, *count, none);
                for (bound, value) in values.into_iter().enumerate() {
                    let at = of_face(f).plus(64 * bound as u64);
                    let least = if is_new { far } else { v.vload_f32(at, table) };
                    let least = v.vmin_or(least, here, least, value);
                    v.vstore_f32(all, at, table, least);
                }
                let bits = v.kmov_to_scalar(here);
                let more = v.s_popcnt(bits);
                *count = v.s_add(*count, more);
            }
            i = v.s_add(i, step);
        }

        // The least of 16 lanes, one line a face.
        let to = v.s_mul(task, step);
        for (f, count) in counts.into_iter().enumerate() {
            if !v.branch(Compare::Less, none, count) {
                continue;
            }
            let bounds = layout.task_bounds.plus(64 * f as u64 * u64::from(layout.receiver_tasks()));
            for bound in 0..BOUNDS {
                let least = v.vload_f32(of_face(f).plus(64 * u64::from(bound)), table);
                let least = math::reduce_min(v, least);
                let bit = v.s_imm(1 << bound);
                let lane = v.kmov_from_scalar(bit);
                v.vstore_f32(lane, bounds, to, least);
            }
            v.s_store(bounds.plus(4 * u64::from(BOUNDS)), to, count);
        }
    }
}

struct FaceBounds {
    layout: Layout,
}

impl Kernel for FaceBounds {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let step = v.s_imm(16);
        let words = v.s_imm((16 * layout.receiver_tasks()) as i32);
        let none = v.s_imm(0);
        let all = v.mask_all();
        let mut i = v.s_mul(task, words);
        let end = v.s_add(i, words);
        let mut least = v.vset_f32(FAR);
        let mut count = none;
        let bounds = layout.task_bounds;
        while v.branch(Compare::Less, i, end) {
            v.prefetch_l1(bounds.plus(64 * AHEAD), i);
            let more = v.s_load(bounds.plus(4 * u64::from(BOUNDS)), i);
            if v.branch(Compare::Less, none, more) {
                let other = v.vload_f32(bounds, i);
                least = v.vmin(least, other);
                count = v.s_add(count, more);
            }
            i = v.s_add(i, step);
        }
        let to = v.s_mul(task, step);
        v.vstore_f32(all, layout.face_bounds, to, least);
        v.s_store(layout.face_bounds.plus(4 * u64::from(BOUNDS)), to, count);
    }
}
