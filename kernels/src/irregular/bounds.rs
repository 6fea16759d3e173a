//! Bounds of the receivers on the image plane of each face: of each task's receivers, then of all.
//!
//! ```text
//! receiver bounds   each task: bounds of its own receivers, lane by lane, then by face
//! face bounds       each task: bounds of one face, from those of all tasks
//! ```

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use super::FAR;
use super::faces::load_positions;
use super::receivers::Receivers;
use crate::columns::{lanes_below, task_range};
use crate::expression::scalar;
use crate::face::{Constants, FACES, project};
use crate::field;
use crate::record::{Records, words};

/// Number of bounds of a face: least x, -x, y, -y, depth, -depth on its image plane. Maxima are negated, so that one minimum
/// serves all.
const BOUNDS: usize = 6;

/// Bounds of some receivers on one face: one line.
#[repr(C, align(64))]
pub(crate) struct FaceBounds {
    /// Least x, -x, y, -y, depth, -depth.
    pub(crate) least: [f32; BOUNDS],
    /// Number of receivers; where it is 0 nobody has written bounds.
    pub(crate) count: i32,
}

/// Bounds of 16 receivers a face, lane by lane: where a task works.
#[repr(C)]
struct LaneBounds {
    least: [[[f32; 16]; BOUNDS]; FACES as usize],
}

/// Line bounds of faces that a task of `face bounds` asks for ahead.
const AHEAD: u64 = 8;

/// Finds the bounds of all receivers, by face.
pub(crate) fn find(receivers: &Receivers, runner: &mut Runner<'_>) -> Result<Records<FaceBounds>, Stopped> {
    let tasks = receivers.tasks();
    let of_lanes = Records::overwritten(runner.arena, u64::from(tasks));
    let of_tasks = Records::overwritten(runner.arena, u64::from(FACES * tasks));
    let of_faces = Records::overwritten(runner.arena, u64::from(FACES));
    // SAFETY: each task writes its own table of lanes and, of each face, its own line.
    runner.run(&unsafe {
        Step::independent("receiver bounds", tasks, TaskBounds { receivers: *receivers, of_lanes, of_tasks })
    })?;
    // SAFETY: each task writes the line of its own face, and reads the bounds of tasks only.
    runner
        .run(&unsafe { Step::independent("face bounds", FACES, AllBounds { tasks, of_tasks, of_faces }) })?;
    Ok(of_faces)
}

/// Finds the bounds of the receivers of each task, by face.
struct TaskBounds {
    receivers: Receivers,
    /// Bounds lane by lane, by task.
    of_lanes: Records<LaneBounds>,
    /// Bounds by face and task.
    of_tasks: Records<FaceBounds>,
}

impl Kernel for TaskBounds {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, Receivers::TASK, self.receivers.count);
        let table = scalar!(v, task * { words::<LaneBounds>() as i32 });
        let all = v.mask_all();
        let constants = Constants::new(v);
        let zero = constants.zero;
        let far = v.vset_f32(FAR);
        let none = v.s_imm(0);
        let mut counts = [none; FACES as usize];
        let of_lanes = |face: usize, bound: usize| self.of_lanes.field(field!(LaneBounds.least[face][bound]));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, &constants, &self.receivers, live, i);
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
                    let at = of_lanes(f, bound);
                    let least = if is_new { far } else { v.vload_f32(at, table) };
                    let least = v.vmin_or(least, here, least, value);
                    v.vstore_f32(all, at, table, least);
                }
                let bits = v.kmov_to_scalar(here);
                let more = v.s_popcnt(bits);
                let before = *count;
                *count = scalar!(v, before + more);
            }
            i = scalar!(v, i + 16);
        }

        // The least of 16 lanes, one line a face.
        let to = scalar!(v, task * { words::<FaceBounds>() as i32 });
        for (f, count) in counts.into_iter().enumerate() {
            let of_task = self.of_tasks.host(f as u32 * self.receivers.tasks(), field!(FaceBounds.least));
            v.s_store(of_task.plus(field!(FaceBounds.count).offset_bytes()), to, count);
            if !v.branch(Compare::Less, none, count) {
                continue;
            }
            for bound in 0..BOUNDS {
                let least = v.vload_f32(of_lanes(f, bound), table);
                let least = math::reduce_min(v, least);
                let bit = v.s_imm(1 << bound);
                let lane = v.kmov_from_scalar(bit);
                v.vstore_f32(lane, of_task, to, least);
            }
        }
    }
}

/// Finds the bounds of all receivers, by face.
struct AllBounds {
    tasks: u32,
    of_tasks: Records<FaceBounds>,
    of_faces: Records<FaceBounds>,
}

impl Kernel for AllBounds {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, face: V::S32) {
        let line = words::<FaceBounds>() as i32;
        let AllBounds { of_tasks, of_faces, .. } = self;
        let none = v.s_imm(0);
        let all = v.mask_all();
        let mut i = scalar!(v, face * { line * self.tasks as i32 });
        let end = scalar!(v, i + { line * self.tasks as i32 });
        let mut least = v.vset_f32(FAR);
        let mut count = none;
        while v.branch(Compare::Less, i, end) {
            v.prefetch_l1(of_tasks.field(field!(FaceBounds.least)).plus_lines(AHEAD), i);
            let more = v.s_load(of_tasks.field(field!(FaceBounds.count)), i);
            if v.branch(Compare::Less, none, more) {
                let other = v.vload_f32(of_tasks.field(field!(FaceBounds.least)), i);
                least = v.vmin(least, other);
                count = scalar!(v, count + more);
            }
            i = scalar!(v, i + { line });
        }
        let to = scalar!(v, face * { line });
        v.vstore_f32(all, of_faces.field(field!(FaceBounds.least)), to, least);
        v.s_store(of_faces.field(field!(FaceBounds.count)), to, count);
    }
}
