//! The frame in the coordinates of its light: x and y along the sides, z across it, so that the light is a rectangle in the plane z = 0
//! and maps from its middle have the axes of its sides.
//!
//! z is scaled by the tangent of the half angle of the widest map: the faces of the cube around the light that look along z are
//! then the two frustums of that angle, one on either side of the light. A parallelogram is a rectangle in slanted coordinates,
//! which parts of parallel planes do not notice.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Addr, Compare, Kernel, Runner, Step, Stopped, Vpu};
use lrbsim_workloads::LightShape;
use lrbsim_workloads::glam::DVec3;

use super::parts::OCCLUDER;
use crate::columns::{lanes_below, task_range};
use crate::expression::{each, scalar};
use crate::field;
use crate::irregular::receivers::{Receiver, Receivers};
use crate::plane::{Vec3, dot};
use crate::scene::{Scene, Vertex};

/// Number of vertices, or of receivers, that a task turns.
const TASK: u32 = 1024;

/// Least half width of a light, in parts of the greatest coordinate: narrower ones throw hard shadows in f32 as this does, and
/// what is divided by its width stays finite.
const HALF_MIN: f64 = 1.0 / (1_u64 << 40) as f64;

/// The light in its own coordinates, constants of the kernels' code.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    /// What a point is multiplied with for each of its coordinates.
    axes: [[f32; 3]; 3],
    /// Half of the light's width along x and along y.
    pub halves: [f32; 2],
}

impl Frame {
    /// The frame of a rectangle, with maps of half angles up to that of this tangent. All other shapes are refused before.
    pub fn new(shape: &LightShape, largest: f32, tangent: f64) -> Frame {
        let least = HALF_MIN * f64::from(largest).max(f64::from(f32::MIN_POSITIVE));
        let given = match shape {
            LightShape::Rect { halves } => *halves,
            _ => [DVec3::ZERO; 2],
        };
        let area = given[0].cross(given[1]);
        // A light whose sides f32 has rounded to nothing has no directions of its own.
        let [a, b] = if area == DVec3::ZERO { [DVec3::X, DVec3::Y].map(|axis| axis * least) } else { given };
        let across = a.cross(b);
        let per_square = across.length_squared().recip();
        let axes = [
            b.cross(across) * (a.length() * per_square),
            across.cross(a) * (b.length() * per_square),
            across.normalize() * tangent,
        ];
        Frame {
            axes: axes.map(|axis| axis.as_vec3().to_array()),
            halves: [a, b].map(|half| (half.length().max(least) as f32).max(f32::MIN_POSITIVE)),
        }
    }

    /// A point in these coordinates.
    #[inline(always)]
    fn turn<V: Vpu>(&self, v: &mut V, point: Vec3<V>) -> Vec3<V> {
        each!(axis in [0, 1, 2] => {
            let along = each!(k in [0, 1, 2] => v.vset_f32(self.axes[axis][k]));
            dot(v, along, point)
        })
    }
}

/// Turns the `vertices` first vertices of `scene`, and the receivers, where they are. Receivers on triangles whose word at `parts` is
/// [`OCCLUDER`] are put beside the light, where no map sees them.
pub(super) fn turn(
    frame: &Frame,
    (scene, vertices): (&Scene, u32),
    receivers: &Receivers,
    parts: Addr,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let kernel = Vertices { frame: *frame, scene: *scene, count: vertices };
    // SAFETY: each task reads and writes its own vertices.
    runner.run(&unsafe { Step::independent("turn vertices", vertices.div_ceil(TASK), kernel) })?;
    let kernel = Points { frame: *frame, receivers: *receivers, triangles: scene.triangle_count, parts };
    // SAFETY: each task reads and writes its own receivers.
    runner.run(&unsafe { Step::independent("turn receivers", receivers.count.div_ceil(TASK), kernel) })
}

/// Turns vertices.
struct Vertices {
    frame: Frame,
    scene: Scene,
    count: u32,
}

impl Kernel for Vertices {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.count);
        let zero = v.vset_f32(0.0);
        let columns = each!(axis in [0, 1, 2] => self.scene.vertices.column(field!(Vertex.position[axis])));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let point = each!(axis in [0, 1, 2] => v.vload_f32_or(zero, live, columns[axis], i));
            let turned = self.frame.turn(v, point);
            for (column, x) in columns.into_iter().zip(turned) {
                v.vstore_f32(live, column, i, x);
            }
            i = scalar!(v, i + 16);
        }
    }
}

/// Turns receivers.
struct Points {
    frame: Frame,
    receivers: Receivers,
    /// Number of triangles; a receiver with another number lies on none.
    triangles: u32,
    parts: Addr,
}

impl Kernel for Points {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let columns = self.receivers.columns;
        let (mut i, end) = task_range(v, task, TASK, self.receivers.count);
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let none = v.vset_i32(0);
        let occluder = v.vset_i32(OCCLUDER);
        let triangles = v.vset_i32(self.triangles as i32);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let own = v.vload_i32(columns.column(field!(Receiver.triangle)), i);
            let on = v.vucmp_lt_masked(live, own, triangles);
            let part = v.vgather_i32_or(none, on, self.parts, own);
            let on_occluder = v.vicmp_eq_masked(on, part, occluder);
            let columns = each!(axis in [0, 1, 2] => columns.column(field!(Receiver.position[axis])));
            let point = each!(axis in [0, 1, 2] => v.vload_f32_or(zero, live, columns[axis], i));
            let turned = self.frame.turn(v, point);
            let beside = [one, zero, zero];
            for (axis, column) in columns.into_iter().enumerate() {
                let x = v.vblend_f32(on_occluder, beside[axis], turned[axis]);
                v.vstore_f32(live, column, i, x);
            }
            i = scalar!(v, i + 16);
        }
    }
}
