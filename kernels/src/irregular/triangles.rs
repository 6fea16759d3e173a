//! Records of the triangles: what is asked of a triangle as seen from the middle of the light, each once for all who ask.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::CHILDREN;
use super::primitives::{AWAY, CUTS, FACES_SHIFT, TriangleRecord};
use super::touch::faces_of_triangles;
use crate::columns::{lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::plane::{Vec3, cross, dot, edge_normal, plane_slack, sub};
use crate::record::{Records, words};
use crate::scene::{ObjectNumbers, Scene, Triangle};

/// Number of triangles that a task handles.
const TASK: u32 = 256;

/// Makes the records of all triangles, for a light of this radius; with numbers of their objects, if `objects` are given.
pub fn record(
    scene: &Scene,
    radius: f32,
    objects: Option<ObjectNumbers>,
    runner: &mut Runner<'_>,
) -> Result<Records<TriangleRecord>, Stopped> {
    let count = scene.triangle_count;
    let records = Records::overwritten(runner.arena, u64::from(count.next_multiple_of(CHILDREN)));
    let kernel = TriangleRecords { scene: *scene, radius, objects, records };
    // SAFETY: each task writes the records of its own triangles.
    runner.run(&unsafe { Step::independent("triangle records", count.div_ceil(TASK), kernel) })?;
    Ok(records)
}

/// Makes the records of triangles.
struct TriangleRecords {
    scene: Scene,
    /// Radius of the light.
    radius: f32,
    /// Numbers of objects, where they go with the records.
    objects: Option<ObjectNumbers>,
    records: Records<TriangleRecord>,
}

impl Kernel for TriangleRecords {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let TriangleRecords { scene, radius, objects, records } = self;
        let (mut i, end) = task_range(v, task, TASK, scene.triangle_count);
        let lane = v.viota();
        let words = v.vset_i32(words::<TriangleRecord>() as i32);
        let zero = v.vset_f32(0.0);
        let sign_bit = v.vset_i32(i32::MIN);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let corners =
                each!(k in [0, 1, 2] => v.vload_i32(scene.triangles.column(field!(Triangle.corners[k])), i));
            let counted = v.vload_i32(scene.triangles.column(field!(Triangle.layers)), i);
            let [a, b, c] = each!(k in [0, 1, 2] => scene.positions(v, live, corners[k]));

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
            let layers = layers(v, counted, away, toward);

            let cuts = cuts(v, normal, det, *radius);
            let cut_bit = v.vset_i32(CUTS);
            let layers = v.vor_or(layers, cuts, layers, cut_bit);

            // Edge planes by vertex number: the same bits from both triangles on an edge.
            let base = v.vsplat(i);
            let at = int!(v, (base + lane) * words);
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
                    let field = field!(TriangleRecord.edge_normals[edge][axis]);
                    v.vscatter_f32(live, records.field(field), at, x);
                }
                let flag = if edge == 0 { layers } else { v.vset_i32(0) };
                flags[edge] = v.vor_or(flag, right, flag, sign_bit);
            }
            // Faces that it can shadow, so that binning skips the others.
            let faces = faces_of_triangles(v, inward);
            let shift = v.vset_i32(FACES_SHIFT);
            let first = flags[0];
            flags[0] = int!(v, first | (faces << shift));
            if let Some(objects) = objects {
                let object = v.vload_i32(objects.triangles, i);
                let second = flags[1];
                flags[1] = int!(v, second | object);
            }
            for (edge, flag) in flags.into_iter().enumerate() {
                v.vscatter_i32(live, records.field(field!(TriangleRecord.flags[edge])), at, flag);
            }
            for (axis, x) in outward.into_iter().enumerate() {
                v.vscatter_f32(live, records.field(field!(TriangleRecord.normal[axis])), at, x);
            }
            v.vscatter_f32(live, records.field(field!(TriangleRecord.plane)), at, plane);
            i = scalar!(v, i + 16);
        }
    }
}

/// Triangles whose plane comes nearer to the middle of the light than its `radius`, or by rounding seems not to. `det`: the product of
/// their points with their `normal`.
#[inline(always)]
pub(crate) fn cuts<V: Vpu>(v: &mut V, normal: Vec3<V>, det: V::F32, radius: f32) -> V::Mask {
    let reach = v.vset_f32(radius * 1.001);
    let reach = v.vmul(reach, reach);
    let length2 = dot(v, normal, normal);
    let reach = v.vmul(reach, length2);
    let det2 = v.vmul(det, det);
    v.vcmp_lt(det2, reach)
}

/// Layers of triangles in F and B, and [`AWAY`] for those that face away; 0 for those edge-on.
#[inline(always)]
pub(crate) fn layers<V: Vpu>(v: &mut V, counted: V::I32, away: V::Mask, toward: V::Mask) -> V::I32 {
    let none = v.vset_i32(0);
    let both = v.vset_i32(3);
    let half = v.vset_i32(16);
    let away_bit = v.vset_i32(AWAY);
    let when_toward = v.vand_or(none, toward, counted, both);
    let when_away = int!(v, (counted >> half) | away_bit);
    v.vblend_i32(away, when_away, when_toward)
}
