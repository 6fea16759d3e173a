//! Records of triangles with all that they hide of any part of the light.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu, math};

use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::field;
use crate::irregular::primitives::{BACK, CUTS, FRONT, LightConstants, TriangleBounds, WideTriangle};
use crate::irregular::silhouette::least_distance2;
use crate::irregular::touch::faces_of_penumbras;
use crate::irregular::triangles::{cuts, layers};
use crate::irregular::{CHILDREN, FAR};
use crate::plane::{Vec3, cross, dot, plane_slack, sub};
use crate::record::{Records, words};
use crate::scene::{Scene, Triangle};

/// Number of triangles that a task handles.
const TASK: u32 = 256;

/// Makes the records and bounds of all triangles for `light`, none of which lies within a face: what it hides has a penumbra.
pub(super) fn record(
    scene: &Scene,
    light: LightConstants,
    runner: &mut Runner<'_>,
) -> Result<(Records<WideTriangle>, Columns<TriangleBounds>), Stopped> {
    let count = scene.triangle_count;
    let records = Records::overwritten(runner.arena, u64::from(count.next_multiple_of(CHILDREN)));
    let bounds = Columns::overwritten(runner.arena, count);
    let kernel = WideTriangles { scene: *scene, light, records, bounds };
    // SAFETY: each task writes the records of its own triangles.
    runner.run(&unsafe { Step::independent("triangle records", count.div_ceil(TASK), kernel) })?;
    Ok((records, bounds))
}

/// Makes the records of triangles.
struct WideTriangles {
    scene: Scene,
    light: LightConstants,
    records: Records<WideTriangle>,
    bounds: Columns<TriangleBounds>,
}

impl Kernel for WideTriangles {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let WideTriangles { scene, light, records, bounds } = self;
        let (mut i, end) = task_range(v, task, TASK, scene.triangle_count);
        let lane = v.viota();
        let words = v.vset_i32(words::<WideTriangle>() as i32);
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let sign_bit = v.vset_i32(i32::MIN);
        let counted_or_cut = v.vset_i32(FRONT | BACK | CUTS);
        let none = v.vset_i32(0);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let numbers =
                each!(k in [0, 1, 2] => v.vload_i32(scene.triangles.column(field!(Triangle.corners[k])), i));
            let counted = v.vload_i32(scene.triangles.column(field!(Triangle.layers)), i);
            let corners = each!(k in [0, 1, 2] => scene.positions(v, live, numbers[k]));

            // Plane: normal away from the middle of the light.
            let [a, b, c] = corners;
            let ab = sub(v, b, a);
            let ac = sub(v, c, a);
            let normal = cross(v, ab, ac);
            let det = dot(v, a, normal);
            let away = v.vcmp_gt(det, zero);
            let toward = v.vcmp_lt(det, zero);
            let outward = each!(axis in [0, 1, 2] => v.vsub_or(normal[axis], toward, zero, normal[axis]));
            let distance = v.vabs(det);
            let slack = plane_slack(v, corners, normal);
            let plane = v.vadd(distance, slack);
            let layers = layers(v, counted, away, toward);
            let cuts = cuts(v, normal, det, light.radius);
            let cut_bit = v.vset_i32(CUTS);
            let flags = v.vor_or(layers, cuts, layers, cut_bit);

            // Corners by number. Each exchange of two of them turns the sign of their determinant.
            let (mut numbers, mut corners) = (numbers, corners);
            let mut negative = toward;
            for (low, high) in [(0, 1), (1, 2), (0, 1)] {
                let swapped = v.vicmp_gt(numbers[low], numbers[high]);
                negative = v.kxor(negative, swapped);
                (numbers[low], numbers[high]) = (
                    v.vblend_i32(swapped, numbers[high], numbers[low]),
                    v.vblend_i32(swapped, numbers[low], numbers[high]),
                );
                let (start, end) = (corners[low], corners[high]);
                corners[low] = each!(axis in [0, 1, 2] => v.vblend_f32(swapped, end[axis], start[axis]));
                corners[high] = each!(axis in [0, 1, 2] => v.vblend_f32(swapped, start[axis], end[axis]));
            }
            let nearest = nearest(v, corners, outward, distance, negative, [zero, one]);
            let faces = faces_of_penumbras(v, light, corners);
            let hides = int!(v, flags & counted_or_cut);
            let hides = v.vicmp_neq(hides, none);
            let faces = v.vblend_i32(hides, faces, none);
            v.vstore_i32(live, bounds.column(field!(TriangleBounds.faces)), i, faces);
            let flags = v.vor_or(flags, negative, flags, sign_bit);

            let base = v.vsplat(i);
            let at = int!(v, (base + lane) * words);
            let [first, second, third] = corners;
            let vectors = [
                (field!(WideTriangle.corners[0]), first),
                (field!(WideTriangle.corners[1]), second),
                (field!(WideTriangle.corners[2]), third),
                (field!(WideTriangle.normal), outward),
            ];
            for (field, value) in vectors {
                for (axis, x) in value.into_iter().enumerate() {
                    v.vscatter_f32(live, records.field(field.at(axis)), at, x);
                }
            }
            v.vscatter_f32(live, records.field(field!(WideTriangle.plane)), at, plane);
            v.vscatter_f32(live, records.field(field!(WideTriangle.slack)), at, slack);
            v.vscatter_f32(live, records.field(field!(WideTriangle.nearest)), at, nearest);
            v.vscatter_i32(live, records.field(field!(WideTriangle.flags)), at, flags);
            i = scalar!(v, i + 16);
        }
    }
}

/// Least distance of triangles from the middle of the light, less what rounding may make of it: that of an edge or, where the foot
/// of the perpendicular lies inside, that of the plane. `distance` is that of the plane times the length of `normal`.
#[inline(always)]
fn nearest<V: Vpu>(
    v: &mut V,
    corners: [Vec3<V>; 3],
    normal: Vec3<V>,
    distance: V::F32,
    negative: V::Mask,
    [zero, one]: [V::F32; 2],
) -> V::F32 {
    let [a, b, c] = corners;
    let mut least2 = v.vset_f32(FAR);
    let mut inside = v.mask_all();
    for (start, end) in [(a, b), (b, c), (c, a)] {
        let of_edge = least_distance2(v, start, end, [zero, one]);
        least2 = v.vmin(least2, of_edge);
        let side = cross(v, start, end);
        let side = dot(v, side, normal);
        let right = v.vcmp_le(side, zero);
        let left = v.vcmp_ge(side, zero);
        // On the side of the edge on which the third corner is, or on the edge.
        let differs = v.kxor(negative, right);
        let on = v.kand(left, right);
        let here = v.knot(differs);
        let here = v.kor(here, on);
        inside = v.kand(inside, here);
    }
    let length2 = dot(v, normal, normal);
    let inside = v.vcmp_gt_masked(inside, length2, zero);
    let of_plane = v.vmul(distance, distance);
    let of_plane = math::div(v, of_plane, length2);
    let least2 = v.vmin_or(least2, inside, least2, of_plane);
    let least = math::sqrt(v, least2);
    let less = v.vset_f32(1.0 - 1e-6);
    v.vmul(least, less)
}
