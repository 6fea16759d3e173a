//! What the work would cost that depends on a frame's light and that the host does untimed, because it takes f64, which the
//! ISA has not: vertices and receivers about the light, scaled by their largest coordinate; and on which side of each closed
//! body the light is.
//!
//! ```text
//! cargo bench --bench untimed
//!
//! largest     each task: the largest coordinate of its points, less the light's place, as sums of two floats
//! scale       one task: the largest of all, and the power of two that brings it below 1
//! center      points less the light's place, scaled and rounded to one float
//! crossings   triangles that a ray from the light meets, by body
//! turn        corners, then faces on edges, of bodies that the ray meets an odd number of times
//! ```
//!
//! The steps run on larrabee-24 at `windowed`, cold; their results are held to what the host made. A word on the command line
//! picks the scenes whose name contains it.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use std::path::Path;

use lrbsim::progress::Quiet;
use lrbsim::{HostOptions, Machine, RunRequest, inputs, run_frame};
use lrbsim_isa::{Addr, Arena, Compare, HostSimd, Kernel, Phase, Runner, Step, StepSource, Vpu, math};
use lrbsim_kernels::columns::{Columns, lanes_below, task_range};
use lrbsim_kernels::scene::{Triangle, Vertex};
use lrbsim_kernels::{clear, field};
use lrbsim_machine::{Chip, Fidelity, MachineConfig, builtin_machine};
use lrbsim_workloads::adjacency::{Aspect, NO_COMPONENT, Stance, stances};
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::{Adjacency, Counting, EyeView, ShadowInput, load_scene};

type Error = Box<dyn std::error::Error>;

const MACHINE: &str = "larrabee-24";
const SCENES: [&str; 4] = ["saloon", "palm", "fern", "street"];
const PHASE: Phase = Phase { id: "untimed", title: "untimed work", in_paper_total: false };

/// Points, triangles or faces of a task.
const TASK: u32 = 1024;

/// A point in the world, each coordinate a sum of two floats.
#[repr(C)]
struct World {
    high: [f32; 3],
    low: [f32; 3],
}

/// A float, and what it lacks of `x`.
fn split(x: f64) -> [f32; 2] {
    [x as f32, (x - f64::from(x as f32)) as f32]
}

/// Points, and where they go.
#[derive(Clone, Copy)]
struct Points {
    world: Columns<World>,
    centered: Columns<Vertex>,
    count: u32,
}

impl Points {
    fn new(arena: &mut Arena, points: &[DVec3]) -> Points {
        let count = points.len() as u32;
        let world = Columns::overwritten(arena, count);
        for (i, point) in (0..count).zip(points) {
            for axis in 0..3 {
                let [high, low] = split(point[axis]).map(f32::to_bits);
                arena.write_u32(world.host(i, field!(World.high[axis])), high);
                arena.write_u32(world.host(i, field!(World.low[axis])), low);
            }
        }
        Points { world, centered: Columns::overwritten(arena, count), count }
    }

    fn tasks(&self) -> u32 {
        self.count.div_ceil(TASK)
    }

    /// Coordinate `axis` of the 16 points from `i` on, less the light's place, rounded to one float.
    #[inline(always)]
    fn about<V: Vpu>(&self, v: &mut V, live: V::Mask, i: V::S32, axis: usize, light: DVec3) -> V::F32 {
        let zero = v.vset_f32(0.0);
        let [light_high, light_low] = split(-light[axis]).map(|x| v.vset_f32(x));
        let high = v.vload_f32_or(zero, live, self.world.column(field!(World.high[axis])), i);
        let low = v.vload_f32_or(zero, live, self.world.column(field!(World.low[axis])), i);
        // The sum of the highs, and exactly what rounding took from it.
        let sum = v.vadd(high, light_high);
        let of_light = v.vsub(sum, high);
        let of_high = v.vsub(sum, of_light);
        let lost_high = v.vsub(high, of_high);
        let lost_light = v.vsub(light_high, of_light);
        let lost = v.vadd(lost_high, lost_light);
        let lows = v.vadd(low, light_low);
        let lost = v.vadd(lost, lows);
        v.vadd(sum, lost)
    }
}

/// Runs `each` for the vectors of the points of a task: those of the vertices, then those of the receivers.
macro_rules! for_points {
    ($v:ident, $task:ident, $points:expr, |$of:ident, $live:ident, $i:ident| $each:block) => {
        let first = $v.s_imm($points[0].tasks() as i32);
        let is_first = $v.branch(Compare::Less, $task, first);
        let number = if is_first { $task } else { $v.s_sub($task, first) };
        let $of = &$points[usize::from(!is_first)];
        let (mut $i, end) = task_range($v, number, TASK, $of.count);
        let sixteen = $v.s_imm(16);
        while $v.branch(Compare::Less, $i, end) {
            let $live = lanes_below($v, $i, end);
            $each
            $i = $v.s_add($i, sixteen);
        }
    };
}

struct Largest {
    points: [Points; 2],
    light: DVec3,
    /// The largest coordinate by task.
    of_tasks: Addr,
}

impl Kernel for Largest {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let mut largest = v.vset_f32(0.0);
        for_points!(v, task, self.points, |points, live, i| {
            for axis in 0..3 {
                let x = points.about(v, live, i, axis, self.light);
                let x = v.vabs(x);
                largest = v.vmax_or(largest, live, largest, x);
            }
        });
        let largest = math::reduce_max(v, largest);
        let bit = v.s_imm(1);
        let first = v.kmov_from_scalar(bit);
        v.vstore_f32(first, self.of_tasks, task, largest);
    }
}

struct Scale {
    of_tasks: Addr,
    tasks: u32,
    /// What coordinates are multiplied by.
    factor: Addr,
}

impl Kernel for Scale {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, only: V::S32) {
        let zero = v.vset_f32(0.0);
        let mut largest = zero;
        let (end, sixteen) = (v.s_imm(self.tasks as i32), v.s_imm(16));
        let mut i = only;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let more = v.vload_f32_or(zero, live, self.of_tasks, i);
            largest = v.vmax(largest, more);
            i = v.s_add(i, sixteen);
        }
        let largest = math::reduce_max(v, largest);
        // 2^-k for the k of 2^(k-1) <= largest < 2^k.
        let (exponents, sum) = (v.vset_i32(0x7f80_0000), v.vset_i32(253 << 23));
        let bits = v.bits_of(largest);
        let exponent = v.vand(bits, exponents);
        let factor = v.visub(sum, exponent);
        let bit = v.s_imm(1);
        let first = v.kmov_from_scalar(bit);
        v.vstore_i32(first, self.factor, only, factor);
    }
}

struct Center {
    points: [Points; 2],
    light: DVec3,
    factor: Addr,
}

impl Kernel for Center {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let first = v.s_imm(0);
        let factor = v.vbroadcast_f32(self.factor, first);
        for_points!(v, task, self.points, |points, live, i| {
            for axis in 0..3 {
                let x = points.about(v, live, i, axis, self.light);
                let x = v.vmul(x, factor);
                v.vstore_f32(live, points.centered.column(field!(Vertex.position[axis])), i, x);
            }
        });
    }
}

/// The triangles of a frame and their bodies.
#[derive(Clone, Copy)]
struct Bodies {
    triangles: Columns<Triangle>,
    count: u32,
    /// The closed body of each triangle; [`Bodies::closed`] of those that are of none.
    body: Addr,
    /// Number of bodies.
    closed: u32,
    /// By body: triangles that the ray meets.
    crossings: Addr,
    /// Whether each triangle is turned over.
    turned: Addr,
}

/// For the 16 triangles from `i` on: their corners.
#[inline(always)]
fn corners<V: Vpu>(v: &mut V, bodies: &Bodies, live: V::Mask, i: V::S32) -> [V::I32; 3] {
    let none = v.vset_i32(0);
    let mut corner =
        |k: usize| v.vload_i32_or(none, live, bodies.triangles.column(field!(Triangle.corners[k])), i);
    [corner(0), corner(1), corner(2)]
}

struct Crossings {
    bodies: Bodies,
    vertices: Columns<Vertex>,
}

impl Kernel for Crossings {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Crossings { bodies, vertices } = self;
        let (mut i, end) = task_range(v, task, TASK, bodies.count);
        let (zero, none, one) = (v.vset_f32(0.0), v.vset_i32(0), v.vset_i32(1));
        let near = v.vset_f32(1.0 / (1 << 22) as f32);
        let open = v.vset_i32(bodies.closed as i32);
        let sixteen = v.s_imm(16);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let corners = corners(v, bodies, live, i);
            let mut position = |corner: V::I32, axis: usize| {
                v.vgather_f32_or(zero, live, vertices.column(field!(Vertex.position[axis])), corner)
            };
            let [a, b, c] = corners.map(|k| [position(k, 0), position(k, 1), position(k, 2)]);

            // The ray along z meets the triangle if it runs on one side of all edges; a corner on it counts as right of it.
            let cross = |v: &mut V, p: [V::F32; 3], q: [V::F32; 3]| {
                let left = v.vmul(p[0], q[1]);
                let right = v.vmul(p[1], q[0]);
                v.vsub(left, right)
            };
            let sides = [cross(v, a, b), cross(v, b, c), cross(v, c, a)];
            let mut left = live;
            let mut right = live;
            for side in sides {
                left = v.vcmp_ge_masked(left, side, zero);
                right = v.vcmp_lt_masked(right, side, zero);
            }
            // The depth of the plane there, times twice the area of the image.
            let depth = v.vmul(sides[0], c[2]);
            let depth = v.vmadd(sides[1], a[2], depth);
            let depth = v.vmadd(sides[2], b[2], depth);
            let left = v.vcmp_gt_masked(left, depth, zero);
            let right = v.vcmp_lt_masked(right, depth, zero);
            let crosses = v.kor(left, right);

            // Lights on the triangle, at first by its box.
            let mut on = live;
            let mut reach = zero;
            let mut lows = [zero; 3];
            let mut highs = [zero; 3];
            for axis in 0..3 {
                let low = v.vmin(a[axis], b[axis]);
                lows[axis] = v.vmin(low, c[axis]);
                let high = v.vmax(a[axis], b[axis]);
                highs[axis] = v.vmax(high, c[axis]);
                let size = [v.vabs(lows[axis]), v.vabs(highs[axis])];
                let size = v.vmax(size[0], size[1]);
                reach = v.vmax(reach, size);
            }
            let reach = v.vmul(reach, near);
            let minus_reach = v.vsub(zero, reach);
            for axis in 0..3 {
                on = v.vcmp_le_masked(on, lows[axis], reach);
                on = v.vcmp_ge_masked(on, highs[axis], minus_reach);
            }
            // None in the scenes of this bench but boxes that hold the light: a distance would follow.
            let _ = v.branch_any(on);

            if v.branch_any(crosses) {
                let body = v.vload_i32_or(none, live, bodies.body, i);
                let crosses = v.vicmp_lt_masked(crosses, body, open);
                v.vatomic_add_or(none, crosses, bodies.crossings, body, one);
            }
            i = v.s_add(i, sixteen);
        }
    }
}

struct TurnCorners {
    bodies: Bodies,
}

impl Kernel for TurnCorners {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let bodies = &self.bodies;
        let (mut i, end) = task_range(v, task, TASK, bodies.count);
        let (none, one, sixteen) = (v.vset_i32(0), v.vset_i32(1), v.s_imm(16));
        let open = v.vset_i32(bodies.closed as i32);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let body = v.vload_i32_or(none, live, bodies.body, i);
            let closed = v.vicmp_lt_masked(live, body, open);
            let crossings = v.vgather_i32_or(none, closed, bodies.crossings, body);
            let odd = v.vand(crossings, one);
            v.vstore_i32(live, bodies.turned, i, odd);
            let turned = v.vicmp_eq_masked(live, odd, one);
            if v.branch_any(turned) {
                let [_, b, c] = corners(v, bodies, live, i);
                v.vstore_i32(turned, bodies.triangles.column(field!(Triangle.corners[1])), i, c);
                v.vstore_i32(turned, bodies.triangles.column(field!(Triangle.corners[2])), i, b);
            }
            i = v.s_add(i, sixteen);
        }
    }
}

struct TurnFaces {
    bodies: Bodies,
    edge_faces: Addr,
    count: u32,
}

impl Kernel for TurnFaces {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.count);
        let (none, one, sixteen) = (v.vset_i32(0), v.vset_i32(1), v.s_imm(16));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let face = v.vload_i32_or(none, live, self.edge_faces, i);
            let triangle = v.vsrl(face, one);
            let turned = v.vgather_i32_or(none, live, self.bodies.turned, triangle);
            let face = v.vxor(face, turned);
            v.vstore_i32(live, self.edge_faces, i, face);
            i = v.s_add(i, sixteen);
        }
    }
}

/// Cycles of the steps by name.
fn measure(scene_name: &str) -> Result<Vec<(&'static str, u64)>, Error> {
    let scene = load_scene(scene_name, Path::new("."))?;
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height);
    let input = ShadowInput::new(&scene, &adjacency, &eye);
    // About the place that the host takes for the middle: a hair off planes that hold it exactly.
    let light = Aspect::new(&scene.light, &scene.mesh, &adjacency).middle;
    let text = builtin_machine(MACHINE).ok_or("the machine is not shipped")?;
    let spec = serde_json::from_str::<MachineConfig>(text)?.validate()?;
    let mut chip = Chip::new(&spec, Fidelity::Windowed, 1);
    let mut cycles: Vec<(&'static str, u64)> = Vec::new();
    let mut run_step = |_: &Phase, step: &Step, arena: &mut Arena| {
        let report = chip.run_step(&StepSource::new(step, arena, HostSimd::detect(), 1)).expect("it moves");
        match cycles.iter_mut().find(|(name, _)| *name == step.name()) {
            Some((_, sum)) => *sum += report.cycles,
            None => cycles.push((step.name(), report.cycles)),
        }
        Ok(())
    };
    let mut arena = Arena::new();
    let points = [&scene.mesh.positions, &eye.points].map(|points| Points::new(&mut arena, points));
    let count = scene.mesh.triangles.len() as u32;
    let triangles = Columns::overwritten(&mut arena, count);
    for (i, corners) in (0..count).zip(&scene.mesh.triangles) {
        for (k, corner) in corners.iter().enumerate() {
            arena.write_u32(triangles.host(i, field!(Triangle.corners[k])), *corner);
        }
    }
    let is_body =
        |t: usize| adjacency.component[t] != NO_COMPONENT && adjacency.counting[t] == Counting::Closed;
    let closed = adjacency.component.iter().filter(|&&body| body != NO_COMPONENT).max().map_or(0, |b| b + 1);
    let body_of = |t: usize| if is_body(t) { adjacency.component[t] } else { closed };
    let body = arena.alloc_u32(&(0..count as usize).map(body_of).collect::<Vec<_>>());
    let edge_faces = arena.alloc_u32(&adjacency.edge_faces);
    let turned = arena.overwritten(u64::from(count));

    let mut runner = Runner::new(&mut arena, &mut run_step);
    runner.phase(&PHASE);
    let tasks = points[0].tasks() + points[1].tasks();
    let of_tasks = runner.arena.overwritten(u64::from(tasks));
    let factor = runner.arena.overwritten(1);
    // SAFETY: each task writes its own word.
    runner.run(&unsafe { Step::independent("largest", tasks, Largest { points, light, of_tasks }) })?;
    runner.run(&Step::ordered("scale", 1, Scale { of_tasks, tasks, factor }))?;
    // SAFETY: each task writes its own points.
    runner.run(&unsafe { Step::independent("center", tasks, Center { points, light, factor }) })?;

    let [crossings] = clear::zeroed(&mut runner, [u64::from(closed)])?;
    let bodies = Bodies { triangles, count, body, closed, crossings, turned };
    let kernel = Crossings { bodies, vertices: points[0].centered };
    // SAFETY: tasks only add to the crossings.
    runner.run(&unsafe { Step::independent("crossings", count.div_ceil(TASK), kernel) })?;
    // SAFETY: each task writes its own triangles.
    runner.run(&unsafe { Step::independent("turn", count.div_ceil(TASK), TurnCorners { bodies }) })?;
    let face_count = adjacency.edge_faces.len() as u32;
    let kernel = TurnFaces { bodies, edge_faces, count: face_count };
    // SAFETY: each task writes its own faces.
    runner.run(&unsafe { Step::independent("turn", face_count.div_ceil(TASK), kernel) })?;

    // What the host made: to the last bit but one, and near 0 to what two floats hold of a place in the world.
    for (points, made) in points.iter().zip([&input.vertices, &input.receivers]) {
        for (i, made) in (0..).zip(made) {
            for (axis, made) in made.iter().enumerate() {
                let found = arena.read_f32(points.centered.host(i, field!(Vertex.position[axis])));
                let off = (found - made).abs();
                assert!(off <= f32::EPSILON * made.abs() + 1e-12, "{scene_name}: {found} for {made}");
            }
        }
    }
    let stance = stances(&scene.mesh, &adjacency, light);
    for (t, stance) in stance.iter().enumerate() {
        let found = arena.read_u32(turned.plus_words(t as u64)) == 1;
        assert_eq!(found, *stance == Stance::TurnedOver, "{scene_name}: triangle {t}");
    }
    Ok(cycles)
}

/// Milliseconds of a whole frame.
fn frame_ms(scene: &str) -> Result<f64, Error> {
    let request = RunRequest {
        scene: inputs::scene(scene)?,
        machine: Machine::load(MACHINE, &[])?,
        algorithm: "sism:overlap=sum".parse().expect("it is one"),
        fidelity: Fidelity::Windowed,
        warm_frames: 0,
        reference: None,
        host: HostOptions { threads: 1, ..HostOptions::default() },
    };
    run_frame(&request, &Quiet)?.report.total.ms.ok_or_else(|| "no time".into())
}

fn main() -> Result<(), Error> {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    for scene in SCENES.into_iter().filter(|scene| scene.contains(&filter)) {
        let clock_ghz = Machine::load(MACHINE, &[])?.config.clock_ghz;
        let steps = measure(scene)?;
        let ms = |cycles: u64| cycles as f64 / (clock_ghz * 1e6);
        let frame = frame_ms(scene)?;
        println!("{scene}: {frame:.3} ms a frame on {MACHINE}, windowed");
        for (name, cycles) in &steps {
            println!("  {name:10} {:>7.4} ms {:>6.2} %", ms(*cycles), 100.0 * ms(*cycles) / frame);
        }
        let points: u64 = steps[..3].iter().map(|step| step.1).sum();
        let bodies: u64 = steps[3..].iter().map(|step| step.1).sum();
        for (what, cycles) in [("points", points), ("bodies", bodies), ("both", points + bodies)] {
            println!("  {what:10} {:>7.4} ms {:>6.2} %", ms(cycles), 100.0 * ms(cycles) / frame);
        }
    }
    Ok(())
}
