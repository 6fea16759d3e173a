//! Records of the triangles: what is asked of a triangle as seen from the middle of the light, each once for all who ask.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu};

use super::primitives::{AWAY, BACK, CUTS, FRONT, TriangleBounds, TriangleRecord, WITHIN};
use super::touch::{
    CROSS_SLACK, DOT_SLACK, IMAGE_SLACK, faces_of_triangles, greatest_form, plane_start, sum_of_sizes,
};
use super::{CHILDREN, FAR};
use crate::columns::{Columns, lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::face::{Constants, OwnFaces};
use crate::field;
use crate::plane::{Vec3, cross, dot, edge_normal, plane_slack, sub};
use crate::record::{Gathered, Records, Source, words};
use crate::scene::{ObjectNumbers, Scene, Triangle};

/// Number of triangles that a task handles.
const TASK: u32 = 256;

/// How much wider than a triangle's image its bounds are made at most. A triangle that would ask for more, such as one that is seen
/// nearly edge-on, is within no face.
const WIDER_MAX: f32 = 1e-2;

/// Makes the records of all triangles, for a light of this radius; with numbers of their objects, if `objects` are given, and with
/// their bounds, if there is room for these.
pub fn record(
    scene: &Scene,
    radius: f32,
    objects: Option<ObjectNumbers>,
    bounds: Option<Columns<TriangleBounds>>,
    runner: &mut Runner<'_>,
) -> Result<Records<TriangleRecord>, Stopped> {
    let count = scene.triangle_count;
    let records = Records::overwritten(runner.arena, u64::from(count.next_multiple_of(CHILDREN)));
    let kernel = TriangleRecords { scene: *scene, radius, objects, records, bounds };
    // SAFETY: each task writes the records of its own triangles.
    runner.run(&unsafe { Step::independent("triangle records", count.div_ceil(TASK), kernel) })?;
    if let Some(bounds) = bounds {
        let kernel = Within { scene: *scene, records, bounds };
        // SAFETY: each task writes the bounds of its own triangles.
        runner.run(&unsafe { Step::independent("triangle bounds", count.div_ceil(TASK), kernel) })?;
    }
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
    /// Bounds of the triangles, for methods that bin them.
    bounds: Option<Columns<TriangleBounds>>,
}

impl Kernel for TriangleRecords {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let TriangleRecords { scene, radius, objects, records, bounds } = self;
        let (mut i, end) = task_range(v, task, TASK, scene.triangle_count);
        let lane = v.viota();
        let words = v.vset_i32(words::<TriangleRecord>() as i32);
        let zero = v.vset_f32(0.0);
        let none = v.vset_i32(0);
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
            if let Some(bounds) = bounds {
                // Faces that it can shadow, so that binning skips the others.
                let faces = faces_of_triangles(v, inward);
                let hides = v.vset_i32(FRONT | BACK);
                let hides = v.vand(layers, hides);
                let hides = v.vicmp_neq(hides, none);
                let faces = v.vblend_i32(hides, faces, none);
                v.vstore_i32(live, bounds.column(field!(TriangleBounds.faces)), i, faces);
            }
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

/// Finds the triangles that lie within a face, and their bounds there. A step of its own: both it and that of the records fill the
/// registers.
///
/// Receivers are shadowed by what lies between three planes, as they are rounded. Each is off its edge by a part of how long the
/// edge is beside its image, and what lies between two of them reaches past their corner the farther, the sharper that is.
/// Both together are what bounds are wider by: of the longest edge, as long as it is on the image, over the area of the image.
struct Within {
    scene: Scene,
    records: Records<TriangleRecord>,
    bounds: Columns<TriangleBounds>,
}

impl Kernel for Within {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.scene.triangle_count);
        while v.branch(Compare::Less, i, end) {
            self.find(v, i, end);
            i = scalar!(v, i + 16);
        }
    }
}

impl Within {
    /// Leaves the bounds of triangles `i..i + 16` below `end`.
    #[inline(always)]
    fn find<V: Vpu>(&self, v: &mut V, i: V::S32, end: V::S32) {
        let Within { scene, records, bounds } = self;
        let constants = &Constants::new(v);
        let live = lanes_below(v, i, end);
        let none = v.vset_i32(0);
        let faces = v.vload_i32_or(none, live, bounds.column(field!(TriangleBounds.faces)), i);
        let hides = v.vicmp_neq(faces, none);
        if !v.branch_any(hides) {
            return;
        }
        let numbers =
            each!(k in [0, 1, 2] => v.vload_i32(scene.triangles.column(field!(Triangle.corners[k])), i));
        let corners = each!(k in [0, 1, 2] => scene.positions(v, live, numbers[k]));
        let (zero, one) = (constants.zero, constants.one);
        let face = OwnFaces::of(v, constants, corners[0]);
        let seen = each!(k in [0, 1, 2] => face.turn(v, zero, corners[k]));
        let nearest = v.vmin(seen[0][2], seen[1][2]);
        let nearest = v.vmin(nearest, seen[2][2]);
        let within = v.vcmp_gt(nearest, zero);
        let images = each!(k in [0, 1, 2] => {
            let per_depth = v.vrcp(seen[k][2]);
            [v.vmul(seen[k][0], per_depth), v.vmul(seen[k][1], per_depth)]
        });

        // The longest edge, the longest image of any, and the area that the images enclose.
        let mut longest = zero;
        let mut longest2 = zero;
        let sides = each!(side in [(0, 1), (1, 2), (2, 0)] => {
            let (from, to) = side;
            let along = sub(v, seen[to], seen[from]);
            let size = sum_of_sizes(v, along);
            longest = v.vmax(longest, size);
            let image = [v.vsub(images[to][0], images[from][0]), v.vsub(images[to][1], images[from][1])];
            let length2 = v.vmul(image[1], image[1]);
            let length2 = v.vmadd(image[0], image[0], length2);
            longest2 = v.vmax(longest2, length2);
            image
        });
        let area = v.vmul(sides[0][1], sides[1][0]);
        let area = v.vmsub(sides[0][0], sides[1][1], area);
        let area = v.vabs(area);
        let [[low_x, high_x], [low_y, high_y]] = each!(axis in [0, 1] => {
            let low = v.vmin(images[0][axis], images[1][axis]);
            let low = v.vmin(low, images[2][axis]);
            let high = v.vmax(images[0][axis], images[1][axis]);
            [low, v.vmax(high, images[2][axis])]
        });
        let [reach_x, reach_y] = each!(span in [(low_x, high_x), (low_y, high_y)] => {
            let (below, above) = (v.vabs(span.0), v.vabs(span.1));
            v.vmax(below, above)
        });
        let reach = v.vadd(reach_x, reach_y);
        let reach = v.vadd(reach, one);

        let per_longest = v.vrsqrt(longest2);
        let length = v.vmul(longest2, per_longest);
        let per_nearest = v.vrcp(nearest);
        let of_edge = v.vmul(longest, per_nearest);
        let of_edge = v.vmul(of_edge, reach);
        let crossed = v.vset_f32(CROSS_SLACK);
        let of_edge = v.vmul(of_edge, crossed);
        let dotted = v.vset_f32(DOT_SLACK);
        let of_image = v.vmul(length, dotted);
        let slack = v.vadd(of_edge, of_image);
        let slack = v.vmul(slack, reach);
        let twice = v.vadd(length, length);
        let slack = v.vmul(slack, twice);
        let per_area = v.vrcp(area);
        let slack = v.vmul(slack, per_area);
        // A NaN is not less than anything.
        let most = v.vset_f32(WIDER_MAX);
        let within = v.vcmp_lt_masked(within, slack, most);
        let least = v.vset_f32(2.0 * IMAGE_SLACK);
        let slack = v.vadd(slack, least);
        let farthest = v.vmax(reach_x, reach_y);
        let farthest = v.vadd(farthest, slack);
        let within = v.vcmp_lt_masked(within, farthest, one);

        let half = v.vset_f32(0.5);
        let [of_x, of_y] = each!(span in [(0, low_x, high_x), (1, low_y, high_y)] => {
            let (axis, low, high) = span;
            let low = v.vsub(low, slack);
            let high = v.vadd(high, slack);
            v.vstore_f32(live, bounds.column(field!(TriangleBounds.low[axis])), i, low);
            v.vstore_f32(live, bounds.column(field!(TriangleBounds.high[axis])), i, high);
            let sum = v.vadd(low, high);
            let extent = v.vsub(high, low);
            // Half a slack wider, which covers what the middle is rounded by.
            let extent = v.vadd(extent, slack);
            (v.vmul(sum, half), v.vmul(extent, half))
        });
        let base = v.vsplat(i);
        let lane = v.viota();
        let number = int!(v, base + lane);
        let record = Gathered::new(v, *records, live, number);
        let normal = record.vec3(v, field!(TriangleRecord.normal));
        let plane = record.float(v, field!(TriangleRecord.plane));
        let normal = face.turn(v, zero, normal);
        let slope = greatest_form(v, normal, [of_x.0, of_y.0], [of_x.1, of_y.1]);
        let start = plane_start(v, plane, slope);
        let reached = v.vcmp_gt(slope, zero);
        let far = v.vset_f32(FAR);
        let start = v.vblend_f32(reached, start, far);
        // Of what holds no receiver the depth is 0, and that reaches nothing.
        let least = v.vset_f32(1.0 / FAR);
        let start = v.vmax(start, least);
        v.vstore_f32(live, bounds.column(field!(TriangleBounds.start)), i, start);
        let own = v.vsll(constants.whole[1], face.number);
        let flag = v.vset_i32(WITHIN);
        let within = v.kand(within, hides);
        let faces = v.vor_or(faces, within, own, flag);
        v.vstore_i32(live, bounds.column(field!(TriangleBounds.faces)), i, faces);
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
