//! Which texels triangles may cover.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::layout::{Layout, MapSlot};
use super::tiles::Boxes;
use crate::columns::{lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::face::turned;
use crate::field;
use crate::irregular::FAR;
use crate::irregular::primitives::{BACK, FRONT, TriangleRecord};
use crate::plane::Vec3;
use crate::record::{Records, words};
use crate::scene::{Scene, Triangle};
use crate::segment::Vec2;

/// Number of triangles that a task handles.
const TASK: u32 = 256;

/// Nearest depth at which things are looked for, in parts of the largest coordinate: those that reach nearer, or behind the light,
/// are cut there to find the texels that they may cover.
pub const NEAR: f32 = 1e-4;

/// Which triangles a map shows.
#[derive(Clone, Copy)]
pub(crate) enum Shown {
    /// Those that are layers of something: of closed bodies the faces towards the light.
    Layers,
    /// Those whose word at this address has one of these bits.
    Marked(Addr, i32),
}

/// Finds the texels that triangles may cover. `largest`: the largest coordinate of all vertices.
pub(crate) fn triangles(
    scene: &Scene,
    triangles: Records<TriangleRecord>,
    shown: Shown,
    layout: &Layout,
    largest: f32,
    runner: &mut Runner<'_>,
) -> Result<Boxes, Stopped> {
    let boxes = Boxes::new(runner.arena, layout, scene.triangle_count);
    let kernel = Cover { scene: *scene, triangles, shown, layout: *layout, near: NEAR * largest, boxes };
    // SAFETY: each task writes the boxes of its own triangles.
    runner
        .run(&unsafe { Step::independent("triangle boxes", scene.triangle_count.div_ceil(TASK), kernel) })?;
    Ok(boxes)
}

/// Finds the texels that triangles may cover.
struct Cover {
    scene: Scene,
    triangles: Records<TriangleRecord>,
    shown: Shown,
    layout: Layout,
    near: f32,
    boxes: Boxes,
}

impl Kernel for Cover {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Cover { scene, layout, boxes, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, scene.triangle_count);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let record_words = v.vset_i32(words::<TriangleRecord>() as i32);
        let bits = v.vset_i32(match self.shown {
            Shown::Layers => FRONT | BACK,
            Shown::Marked(_, bits) => bits,
        });
        let slots = v.s_imm(layout.slot_count as i32);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let corners =
                each!(k in [0, 1, 2] => v.vload_i32(scene.triangles.column(field!(Triangle.corners[k])), i));
            let corners = each!(k in [0, 1, 2] => scene.positions(v, live, corners[k]));
            // Triangles that are layers of nothing cast no shadow.
            let words = match self.shown {
                Shown::Layers => {
                    let first = v.vsplat(i);
                    let at = int!(v, (first + lane) * record_words);
                    v.vgather_i32_or(none, live, self.triangles.field(field!(TriangleRecord.flags[0])), at)
                }
                Shown::Marked(marks, _) => v.vload_i32(marks, i),
            };
            let shown = int!(v, words & bits);
            let counted = v.vicmp_neq_masked(live, shown, none);
            let mut slot = v.s_imm(0);
            while v.branch(Compare::Less, slot, slots) {
                let face = v.s_load(layout.slots.column(field!(MapSlot.face)), slot);
                let corners = turned(v, face, corners);
                let reach = on_face(v, self.near, corners);
                boxes.store(v, layout, [slot, face], i, counted, reach);
                slot = scalar!(v, slot + 1);
            }
            i = scalar!(v, i + 16);
        }
    }
}

/// What 16 triangles reach of the image plane of a face, in whose frame their corners are: from where and to where along both axes.
///
/// Nearer than `least` they are cut; where all of a triangle is, it reaches from beyond everything to nowhere.
#[inline(always)]
pub fn on_face<V: Vpu>(v: &mut V, least: f32, corners: [Vec3<V>; 3]) -> [Vec2<V>; 2] {
    let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
    let near = v.vset_f32(least);
    let depths = each!(k in [0, 1, 2] => corners[k][2]);
    let ahead = each!(k in [0, 1, 2] => v.vcmp_gt(depths[k], near));
    let inverse = each!(k in [0, 1, 2] => v.vrcp_or(one, ahead[k], depths[k]));
    // Where edges pass the nearest depth, as parts of them.
    let passes = each!(k in [0, 1, 2] => v.kxor(ahead[k], ahead[(k + 1) % 3]));
    let some = v.kor(passes[0], passes[1]);
    let some = v.branch_any(some);
    let parts = each!(k in [0, 1, 2] => {
        let along = v.vsub(depths[(k + 1) % 3], depths[k]);
        let along = v.vrcp_or(zero, passes[k], along);
        let to_near = v.vsub(near, depths[k]);
        v.vmul(to_near, along)
    });
    let (far, minus_far) = (v.vset_f32(FAR), v.vset_f32(-FAR));
    let per_near = v.vset_f32(1.0 / least);
    let [[low_x, high_x], [low_y, high_y]] = each!(of in [0, 1] => {
        let (mut low, mut high) = (far, minus_far);
        for k in 0..3 {
            let place = v.vmul(corners[k][of], inverse[k]);
            low = v.vmin_or(low, ahead[k], low, place);
            high = v.vmax_or(high, ahead[k], high, place);
            if some {
                let side = v.vsub(corners[(k + 1) % 3][of], corners[k][of]);
                let place = v.vmadd(side, parts[k], corners[k][of]);
                let place = v.vmul(place, per_near);
                low = v.vmin_or(low, passes[k], low, place);
                high = v.vmax_or(high, passes[k], high, place);
            }
        }
        [low, high]
    });
    [[low_x, low_y], [high_x, high_y]]
}
