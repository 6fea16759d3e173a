//! Occluders and receivers: what throws shadows and what they fall on, told apart by the size of objects.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Arena, Compare, Kernel, Runner, Step, Stopped, Vpu};
use lrbsim_workloads::ShadowInput;
use lrbsim_workloads::glam::Vec3;

use crate::columns::{lanes_below, task_range};
use crate::expression::{int, scalar};
use crate::field;
use crate::irregular::primitives::{AWAY, BACK, FRONT, TriangleRecord};
use crate::record::{Records, words};
use crate::scene::{Scene, Triangle, fill, objects_of_triangles};

/// What a triangle of a receiver has for its part in the scene.
pub(super) const RECEIVER: i32 = 0;
/// What a triangle of an occluder has.
pub(super) const OCCLUDER: i32 = 1;

/// Mark of a triangle that the map of receivers shows.
pub(super) const FLOOR: i32 = 1;
/// Mark of a triangle that the map of occluders' nearest faces shows.
pub(super) const NEAREST: i32 = 2;
/// Mark of a triangle that the map of occluders' farthest faces shows.
pub(super) const FARTHEST: i32 = 4;

/// Number of triangles that a task marks.
const TASK: u32 = 1024;

/// The part that each triangle has in the scene, word by word: untimed as the rest of the scene, since it depends on nothing but the
/// model, and the paper's artists did it by hand.
///
/// An object, all that hangs together over edges, is a receiver if the diagonal of its box is at least `least` of that of the scene's.
pub(super) fn parts(input: &ShadowInput, scene: &Scene, least: f64, arena: &mut Arena) -> Addr {
    let of_triangles = objects_of_triangles(input);
    let count = of_triangles.iter().max().map_or(0, |last| *last as usize + 1);
    let nothing = [Vec3::INFINITY, Vec3::NEG_INFINITY];
    let grown = |[low, high]: [Vec3; 2], p: Vec3| [low.min(p), high.max(p)];
    let mut boxes = vec![nothing; count];
    for (t, object) in of_triangles.iter().enumerate() {
        for corner in 0..3 {
            // As the arena has them: with the corners of triangles that the light is cut by.
            let vertex = arena.read_u32(scene.triangles.host(t as u32, field!(Triangle.corners[corner])));
            let of_object = &mut boxes[*object as usize];
            *of_object = grown(*of_object, Vec3::from(input.vertices[vertex as usize]));
        }
    }
    let whole = boxes.iter().fold(nothing, |all, [low, high]| grown(grown(all, *low), *high));
    let diagonal = |[low, high]: [Vec3; 2]| f64::from((high - low).length());
    let least = least * diagonal(whole);
    let part = |object: &u32| {
        if diagonal(boxes[*object as usize]) >= least { RECEIVER as u32 } else { OCCLUDER as u32 }
    };
    let words = arena.overwritten(of_triangles.len() as u64 + 16);
    fill(arena, words, of_triangles.iter().map(part));
    words
}

/// Marks which maps show each triangle, word by word.
///
/// The map of receivers and the first of occluders show what is a layer: of closed bodies the faces towards the light. The
/// second of occluders shows their faces away from it. What is no closed body has no back, and is in both.
pub(super) fn mark(
    scene: &Scene,
    triangles: Records<TriangleRecord>,
    parts: Addr,
    runner: &mut Runner<'_>,
) -> Result<Addr, Stopped> {
    let marks = runner.arena.overwritten(u64::from(scene.triangle_count) + 16);
    let kernel = Mark { scene: *scene, triangles, parts, marks };
    // SAFETY: each task writes the words of its own triangles.
    runner
        .run(&unsafe { Step::independent("triangle marks", scene.triangle_count.div_ceil(TASK), kernel) })?;
    Ok(marks)
}

/// Marks which maps show triangles.
struct Mark {
    scene: Scene,
    triangles: Records<TriangleRecord>,
    parts: Addr,
    marks: Addr,
}

impl Kernel for Mark {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.scene.triangle_count);
        let lane = v.viota();
        let none = v.vset_i32(0);
        let record_words = v.vset_i32(words::<TriangleRecord>() as i32);
        let (layer, away) = (v.vset_i32(FRONT | BACK), v.vset_i32(AWAY));
        let half = v.vset_i32(16);
        let occluder = v.vset_i32(OCCLUDER);
        let (floor, nearest, farthest) = (v.vset_i32(FLOOR), v.vset_i32(NEAREST), v.vset_i32(FARTHEST));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let first = v.vsplat(i);
            let at = int!(v, (first + lane) * record_words);
            let flags =
                v.vgather_i32_or(none, live, self.triangles.field(field!(TriangleRecord.flags[0])), at);
            let counted = v.vload_i32_or(none, live, self.scene.triangles.column(field!(Triangle.layers)), i);
            let part = v.vload_i32_or(none, live, self.parts, i);
            let occludes = v.vicmp_eq_masked(live, part, occluder);

            let layers = int!(v, flags & layer);
            let is_layer = v.vicmp_neq_masked(live, layers, none);
            let shown = v.vblend_i32(occludes, nearest, floor);
            let shown = v.vblend_i32(is_layer, shown, none);
            let turned_away = int!(v, flags & away);
            let turned_away = v.vicmp_neq_masked(occludes, turned_away, none);
            let when_away = int!(v, counted >> half);
            let open = v.vicmp_neq_masked(occludes, when_away, none);
            let open = v.kand(open, is_layer);
            let behind = v.kor(turned_away, open);
            let marks = v.vor_or(shown, behind, shown, farthest);
            v.vstore_i32(live, self.marks, i, marks);
            i = scalar!(v, i + 16);
        }
    }
}
