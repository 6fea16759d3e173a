//! What the tests of the kernels share: runs on every back end, scenes made of plain parts, the oracles of the project.

#![allow(dead_code, reason = "each test file uses its own part")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use lrbsim_isa::{
    Arena, Compare, HostSimd, Kernel, OpCounts, Phase, Runner, Step, StepSource, Stream, TaskSource, Vpu,
    run_functional,
};
use lrbsim_kernels::columns::{Columns, lanes_below};
use lrbsim_kernels::field;
use lrbsim_kernels::irregular::CHILDREN;
use lrbsim_kernels::irregular::grid::Sample;
use lrbsim_kernels::irregular::primitives::Primitives;
use lrbsim_kernels::irregular::receivers::{Receiver, Receivers};
use lrbsim_kernels::irregular::run::Split;
use lrbsim_kernels::method::Method;
use lrbsim_kernels::record::Field;
use lrbsim_kernels::segment::Angle;
use lrbsim_kernels::sism::kept::Kept;
use lrbsim_kernels::sism::printed::Printed;
use lrbsim_kernels::sism::{self, Arrays, Choices, Overlap, Sums, hard::count_layers, soft};
use lrbsim_workloads::adjacency::prepare;
use lrbsim_workloads::glam::{DVec2, DVec3, Vec3};
use lrbsim_workloads::reference::ErrorMetrics;
use lrbsim_workloads::{Adjacency, Counting, EyeView, Light, Mesh, Scene, ShadowInput, load_scene};
use serde_json::Value;

/// Uops that no task should exceed by much: the machine balances load by tasks.
pub const TASK_UOPS: usize = 64 << 10;

/// The back end that runs something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum On {
    /// Functional, on so many host threads.
    Host(HostSimd, usize),
    /// The recording back end.
    Recording(HostSimd),
}

/// The fastest back end of this host, on two threads.
pub fn on() -> On {
    On::Host(HostSimd::detect(), 2)
}

/// Every back end that this host has; says which it lacks.
pub fn back_ends() -> Vec<On> {
    let mut all = vec![On::Recording(HostSimd::detect())];
    for simd in HostSimd::ALL {
        if simd.is_available() {
            all.push(On::Host(simd, 1));
        } else {
            println!("SKIPPED {simd}: this host lacks it");
        }
    }
    all
}

/// What one step left behind.
#[derive(Debug, Clone, Copy, Default)]
pub struct StepFigures {
    pub tasks: u32,
    pub uops: u64,
    /// Longest stream of a task; recording only.
    pub longest_task: usize,
    /// Most live vectors of a task; recording only.
    pub live_vectors_max: u32,
}

/// Runs a step.
pub fn run_step(step: &Step, arena: &mut Arena, on: On) -> StepFigures {
    let mut figures = StepFigures { tasks: step.tasks(), ..StepFigures::default() };
    match on {
        On::Host(simd, threads) => {
            let counts: OpCounts = run_functional(step, arena, simd, threads);
            figures.uops = counts.total();
        }
        On::Recording(simd) => {
            let mut stream = Stream::default();
            let source = StepSource::new(step, arena, simd, 1);
            for task in 0..step.tasks() {
                source.record(task, &mut stream);
                figures.uops += stream.uops.len() as u64;
                figures.longest_task = figures.longest_task.max(stream.uops.len());
                figures.live_vectors_max = figures.live_vectors_max.max(stream.live_vectors_max);
            }
        }
    }
    figures
}

/// A frame that has been run.
pub struct Run {
    pub arena: Arena,
    pub arrays: Arrays,
    pub steps: BTreeMap<&'static str, StepFigures>,
    pub phases: BTreeMap<&'static str, u64>,
    /// Visibility, one a receiver.
    visibility: Vec<f32>,
}

impl Run {
    /// Runs the whole program of `input`, overlap as in the paper.
    pub fn new(input: &ShadowInput, on: On) -> Run {
        Run::with(input, Overlap::Sum, on)
    }

    /// Runs the whole program of `input`.
    pub fn with(input: &ShadowInput, choices: impl Into<Choices>, on: On) -> Run {
        let mut arena = Arena::new();
        let (mut steps, mut phases) = (BTreeMap::new(), BTreeMap::new());
        let mut run_step = |phase: &Phase, step: &Step, arena: &mut Arena| {
            let figures = run_step(step, arena, on);
            *phases.entry(phase.id).or_default() += figures.uops;
            steps.insert(step.name(), figures);
            Ok(())
        };
        let mut arrays = sism::run(&mut input.clone(), choices, &mut Runner::new(&mut arena, &mut run_step))
            .expect("nothing stops it");
        let visibility = arrays.visibility(input, &arena);
        // Their places have been discarded: once more, for whoever compares the run with something dumb.
        arrays.grid.receivers = Receivers::new(&mut input.clone(), &mut arena);
        Run { arena, arrays, steps, phases, visibility }
    }

    /// Layers in F and B, coverage in F and B by pixel, as the pipeline left them.
    pub fn sums(&self) -> BTreeMap<u32, [i32; 4]> {
        let Arrays { grid, runs, .. } = &self.arrays;
        let receiver = |i: u32| self.arena.read_u32(grid.samples.host(i, field!(Sample.receiver)));
        let mut sums = sums(&self.arena, &self.arrays, self.arrays.sums, receiver);
        // Samples of blocks where no run has been have none.
        for block in 0..grid.faces.block_count() {
            let start = |cell| self.arena.read_u32(grid.cell_starts(CHILDREN * block + cell));
            for sample in start(0)..start(CHILDREN) {
                let pixel = grid.receivers.columns.host(receiver(sample), field!(Receiver.pixel));
                let sums = sums.get_mut(&self.arena.read_u32(pixel)).expect("a sample has a pixel");
                for kind in [0, 1] {
                    if self.arena.read_u32(runs.splits.host(block, field!(Split.log2[kind]))) == 0 {
                        sums[2 * kind..2 * kind + 2].fill(0);
                    }
                }
            }
        }
        sums
    }

    /// The same by brute force, from the records of this run.
    pub fn brute_force(&mut self, on: On) -> BTreeMap<u32, [i32; 4]> {
        let receivers = self.arrays.grid.receivers;
        let out = Columns::overwritten(&mut self.arena, receivers.count);
        let Arrays { primitives, printed, .. } = self.arrays;
        let kernel = BruteForce { receivers, primitives, printed, out };
        let step = Step::ordered("brute force", receivers.count.div_ceil(16), kernel);
        run_step(&step, &mut self.arena, on);
        sums(&self.arena, &self.arrays, out, |i| i)
    }

    /// Visibility, one a receiver; every one in [0, 1].
    pub fn visibility(&self) -> Vec<f32> {
        let visibility = self.visibility.clone();
        assert!(visibility.iter().all(|x| (0.0..=1.0).contains(x)), "a visibility outside [0, 1]");
        visibility
    }
}

/// Sums by pixel, from columns whose entries are of these receivers.
fn sums(
    arena: &Arena,
    arrays: &Arrays,
    from: Columns<Sums>,
    receiver: impl Fn(u32) -> u32,
) -> BTreeMap<u32, [i32; 4]> {
    let receivers = arrays.grid.receivers;
    (0..receivers.count)
        .map(|i| {
            let pixel = arena.read_u32(receivers.columns.host(receiver(i), field!(Receiver.pixel)));
            let read = |field: Field<Sums, i32>| arena.read_u32(from.host(i, field)) as i32;
            let layers = [0, 1].map(|k| read(field!(Sums.layers[k])));
            let is_soft = arrays.primitives.light.is_soft();
            let coverage = [0, 1].map(|k| if is_soft { read(field!(Sums.coverage[k])) } else { 0 });
            (pixel, [layers[0], layers[1], coverage[0], coverage[1]])
        })
        .collect()
}

/// Every edge x every receiver and every triangle x every receiver: no grid, no bins, no records, no wedge.
struct BruteForce {
    receivers: Receivers,
    primitives: Primitives,
    printed: Option<Printed>,
    out: Columns<Sums>,
}

impl Kernel for BruteForce {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let BruteForce { receivers, primitives, out, .. } = self;
        let four = v.s_imm(4);
        let one = v.s_imm(1);
        let first = v.s_shl(task, four);
        let end = v.s_imm(receivers.count as i32);
        let live = lanes_below(v, first, end);
        let points = [0, 1, 2]
            .map(|axis| v.vload_f32(receivers.columns.column(field!(Receiver.position[axis])), first));
        let own = v.vload_i32(receivers.columns.column(field!(Receiver.triangle)), first);
        let none = v.vset_i32(0);
        let (mut layers, mut coverage) = ([none; 2], [none; 2]);
        let end = v.s_imm(primitives.triangle_count as i32);
        let mut i = v.s_imm(0);
        while v.branch(Compare::Less, i, end) {
            let triangle = primitives.triangles.record(v, i);
            let number = v.vsplat(i);
            layers = count_layers(v, live, points, own, number, triangle, layers);
            i = v.s_add(i, one);
        }
        if let Some(printed) = &self.printed {
            coverage = printed_sums(v, printed, primitives, live, points);
        } else if primitives.light.is_soft() {
            let view = soft::view(v, &primitives.light, points);
            let end = v.s_imm(primitives.edge_count as i32);
            let mut i = v.s_imm(0);
            while v.branch(Compare::Less, i, end) {
                let edge = primitives.edges.record(v, i);
                coverage = soft::add_edge(v, &view, live, points, edge, coverage);
                i = v.s_add(i, one);
            }
        }
        for i in 0..2 {
            v.vstore_i32(live, out.column(field!(Sums.layers[i])), first, layers[i]);
            v.vstore_i32(live, out.column(field!(Sums.coverage[i])), first, coverage[i]);
        }
    }
}

/// Coverage in F and B in the printed form: every edge on every face.
#[inline(always)]
fn printed_sums<V: Vpu>(
    v: &mut V,
    printed: &Printed,
    primitives: &Primitives,
    live: V::Mask,
    points: [V::F32; 3],
) -> [V::I32; 2] {
    let none = v.vset_i32(0);
    let zero = v.vset_f32(0.0);
    let mut coverage = [none; 2];
    let size = points.map(|x| v.vabs(x));
    let by_y = v.vcmp_gt(size[1], size[0]);
    let larger = v.vmax(size[0], size[1]);
    let by_z = v.vcmp_gt(size[2], larger);
    let not_z = v.kandn(by_z, live);
    let along = [v.kandn(by_y, not_z), v.kand(by_y, not_z), v.kand(by_z, live)];
    for face in 0..6 {
        let axis = face as usize / 2;
        let negative = v.vcmp_lt(points[axis], zero);
        let here = if face % 2 == 0 { v.kandn(negative, along[axis]) } else { v.kand(negative, along[axis]) };
        if !v.branch_any(here) {
            continue;
        }
        let plane = printed.plane_of_face(v, face, points);
        let one = v.s_imm(1);
        let end = v.s_imm(primitives.edge_count as i32);
        let mut i = v.s_imm(0);
        while v.branch(Compare::Less, i, end) {
            if let Some((touched, f)) = printed.part(v, &plane, here, i, Angle::Atan2) {
                let edge = primitives.edges.record(v, i);
                coverage = soft::add_part(v, touched, f, points, edge, Kept::Fixed, coverage);
            }
            i = v.s_add(i, one);
        }
    }
    coverage
}

/// A function of `IN` floats to `OUT` floats, 16 cases at a time.
pub trait Lanewise<const IN: usize, const OUT: usize>: Send + Sync + Clone + 'static {
    fn eval<V: Vpu>(&self, v: &mut V, x: [V::F32; IN]) -> [V::F32; OUT];
}

struct Shell<F, const IN: usize, const OUT: usize> {
    function: F,
    from: Columns<[f32; IN]>,
    to: Columns<[f32; OUT]>,
}

impl<const IN: usize, const OUT: usize, F: Lanewise<IN, OUT>> Kernel for Shell<F, IN, OUT> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let four = v.s_imm(4);
        let at = v.s_shl(task, four);
        let all = v.mask_all();
        let x = core::array::from_fn(|c| v.vload_f32(self.from.column(Field::whole().at(c)), at));
        let y = self.function.eval(v, x);
        for (c, y) in y.into_iter().enumerate() {
            v.vstore_f32(all, self.to.column(Field::whole().at(c)), at, y);
        }
    }
}

/// Evaluates `function` for all cases on every back end; they must agree to the last bit.
pub fn evaluate<const IN: usize, const OUT: usize, F: Lanewise<IN, OUT>>(
    function: &F,
    cases: &[[f32; IN]],
) -> Vec<[f32; OUT]> {
    let mut results: Option<Vec<[u32; OUT]>> = None;
    for on in back_ends() {
        let mut arena = Arena::new();
        let count = (cases.len() as u32).next_multiple_of(16);
        let from: Columns<[f32; IN]> = Columns::overwritten(&mut arena, count);
        let to: Columns<[f32; OUT]> = Columns::overwritten(&mut arena, count);
        for (i, case) in cases.iter().enumerate() {
            for (c, x) in case.iter().enumerate() {
                arena.write_u32(from.host(i as u32, Field::whole().at(c)), x.to_bits());
            }
        }
        let kernel = Shell::<F, IN, OUT> { function: function.clone(), from, to };
        let step = Step::ordered("function", count / 16, kernel);
        run_step(&step, &mut arena, on);
        let read =
            |i: usize| core::array::from_fn(|c| arena.read_u32(to.host(i as u32, Field::whole().at(c))));
        let found: Vec<[u32; OUT]> = (0..cases.len()).map(read).collect();
        match &results {
            None => results = Some(found),
            Some(first) => assert_eq!(*first, found, "{on:?} differs"),
        }
    }
    results.unwrap_or_default().into_iter().map(|bits| bits.map(f32::from_bits)).collect()
}

/// A file or folder of what tests read.
pub fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data").join(path)
}

/// A mesh that was made to break things.
pub struct NastyMesh {
    /// Name of its file.
    pub file: String,
    /// Whether it is a valid file.
    pub valid: bool,
    /// The scene that it is; of a file without geometry, the reason why it is none.
    pub scene: Result<Scene, String>,
}

/// All meshes that were made to break things.
pub fn nasty_meshes() -> Vec<NastyMesh> {
    let folder = data("nasty");
    let text = std::fs::read_to_string(folder.join("manifest.json")).expect("the manifest can be read");
    let manifest: Value = serde_json::from_str(&text).expect("the manifest is JSON");
    let mesh = |entry: &Value| {
        let file = entry["file"].as_str().expect("a name").to_owned();
        let scene = load_scene(folder.join(&file), Path::new(".")).map_err(|error| error.to_string());
        NastyMesh { file, valid: entry["valid"] == true, scene }
    };
    manifest.as_array().expect("a list").iter().map(mesh).collect()
}

/// The input `name` of an oracle's case.
pub fn number(case: &Value, name: &str) -> f64 {
    case["inputs"][name].as_f64().unwrap_or_else(|| panic!("{} has no input {name}", case["id"]))
}

/// What an oracle's case expects of `name`.
pub fn expected(case: &Value, name: &str) -> f64 {
    case["expected"][name].as_f64().unwrap_or_else(|| panic!("{} expects no {name}", case["id"]))
}

/// One group of the oracles.
pub fn oracles(name: &str) -> Value {
    let text = std::fs::read_to_string(data("oracles.json")).expect("the oracles can be read");
    let all: Value = serde_json::from_str(&text).expect("oracles are JSON");
    let groups = all["groups"].as_array().expect("groups");
    groups.iter().find(|group| group["name"] == name).expect("the group is there").clone()
}

/// The cases of one group.
pub fn cases(name: &str) -> Vec<Value> {
    oracles(name)["cases"].as_array().expect("cases").clone()
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
}

pub fn vec3(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

/// A mesh of flat polygons, as fans.
pub fn polygons(polygons: &[Vec<DVec3>]) -> Mesh {
    let mut mesh = Mesh::default();
    for polygon in polygons {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(polygon);
        let n = polygon.len() as u32;
        mesh.triangles.extend((1..n - 1).map(|k| [first, first + k, first + k + 1]));
    }
    mesh
}

/// The input of a frame with any receivers: `(position, own triangle)`.
pub fn input(mut mesh: Mesh, light: Light, receivers: &[(DVec3, u32)]) -> ShadowInput {
    prepare(&mut mesh);
    input_of_prepared(mesh, light, receivers)
}

/// As [`input`], with a mesh that is taken as it is.
pub fn input_of_prepared(mesh: Mesh, light: Light, receivers: &[(DVec3, u32)]) -> ShadowInput {
    let adjacency = Adjacency::new(&mesh);
    // Only mesh and light of the scene are looked at.
    let scene = Scene { mesh, light, ..load_scene("tiny", Path::new(".")).expect("tiny is shipped") };
    let count = receivers.len() as u32;
    let width = count.clamp(1, 64);
    let eye = EyeView {
        width,
        height: count.div_ceil(width),
        points: receivers.iter().map(|r| r.0).collect(),
        normals: vec![Vec3::Z; receivers.len()],
        triangles: receivers.iter().map(|r| r.1).collect(),
        pixels: (0..count).collect(),
    };
    // A receiver on no triangle: any number will do for the lookup of what stands for it.
    let on_none: Vec<bool> = receivers.iter().map(|r| r.1 == u32::MAX).collect();
    let eye = EyeView {
        triangles: eye.triangles.iter().map(|&t| if t == u32::MAX { 0 } else { t }).collect(),
        ..eye
    };
    let mut input = ShadowInput::new(&scene, &adjacency, &eye);
    for (own, none) in input.receiver_triangle.iter_mut().zip(on_none) {
        if none {
            *own = u32::MAX;
        }
    }
    input
}

/// The input of a shipped scene, at its own size or another.
pub fn shipped(name: &str, size: Option<(u32, u32)>) -> (Scene, EyeView, ShadowInput) {
    let scene = load_scene(name, Path::new(".")).expect("the scene is shipped");
    let (width, height) = size.unwrap_or((scene.image.width, scene.image.height));
    let eye = EyeView::render(&scene.mesh, &scene.camera, width, height);
    let input = ShadowInput::new(&scene, &Adjacency::new(&scene.mesh), &eye);
    (scene, eye, input)
}

/// Random numbers that are the same everywhere (splitmix64).
pub struct Random(pub u64);

impl Random {
    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// In [low, high).
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Each coordinate in [-1, 1).
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.within(-1.0, 1.0), self.within(-1.0, 1.0), self.within(-1.0, 1.0))
    }
}

/// A cube of half size `half` about `center`.
pub fn add_box(mesh: &mut Mesh, center: DVec3, half: DVec3) {
    let first = mesh.positions.len() as u32;
    for i in 0..8 {
        let sign = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        mesh.positions.push(center + half * DVec3::new(sign(0), sign(1), sign(2)));
    }
    for quad in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        let [a, b, c, d] = quad.map(|i: u32| first + i);
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
}

pub fn add_triangle(mesh: &mut Mesh, corners: [DVec3; 3]) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(corners);
    mesh.triangles.push([first, first + 1, first + 2]);
}

/// Triangles and boxes of all sizes about the light, receivers in all directions, some on the triangles.
pub fn random_scene(seed: u64, receivers: usize) -> (Mesh, Vec<(DVec3, u32)>) {
    let mut random = Random(seed);
    let mut mesh = Mesh::default();
    for _ in 0..8 + (random.unit() * 24.0) as u32 {
        let center = random.vector();
        let size = power_of_ten(random.within(-2.5, 0.3));
        match (random.unit() * 4.0) as u32 {
            0 => add_box(&mut mesh, center, size * DVec3::new(random.unit(), random.unit(), random.unit())),
            // Through the light's plane, whichever way the faces lie.
            1 => add_triangle(
                &mut mesh,
                [center, -center * random.unit() + random.vector() * 0.1, random.vector()],
            ),
            _ => add_triangle(&mut mesh, [(); 3].map(|()| center + random.vector() * size)),
        }
    }
    let points = (0..receivers)
        .map(|_| {
            let on = (random.unit() * mesh.triangles.len() as f64) as u32;
            if random.unit() < 0.5 {
                let [a, b, c] = mesh.triangles[on as usize].map(|v| mesh.positions[v as usize]);
                let (mut s, mut t) = (random.unit(), random.unit());
                if s + t > 1.0 {
                    (s, t) = (1.0 - s, 1.0 - t);
                }
                (a + (b - a) * s + (c - a) * t, on)
            } else {
                (random.vector() * random.within(0.2, 2.0), u32::MAX)
            }
        })
        .filter(|(p, _)| p.length() > 1e-3)
        .collect();
    (mesh, points)
}

/// Whether a ray from a receiver to `target`, light-centred, hits a triangle, in f64; `None` where it passes a border too closely to
/// tell. Triangles that the light is cut by are as any others.
pub fn ray_hits(input: &ShadowInput, receiver: usize, target: DVec3) -> Option<bool> {
    let p = DVec3::from(input.receivers[receiver].map(f64::from));
    let own = input.receiver_triangle[receiver];
    let mut triangles = input.triangles.clone();
    for cut in &input.cut {
        triangles[cut.number as usize] = cut.corners;
    }
    let mut doubtful = false;
    for (number, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| DVec3::from(input.vertices[v as usize].map(f64::from)));
        let normal = (b - a).cross(c - a);
        if number as u32 == own || normal == DVec3::ZERO {
            continue;
        }
        let t = (a - p).dot(normal) / (target - p).dot(normal);
        let at = p + (target - p) * t;
        let inside = [(a, b), (b, c), (c, a)]
            .map(|(s, e)| (e - s).cross(at - s).dot(normal) / normal.length_squared());
        let least = inside.into_iter().fold(f64::INFINITY, f64::min);
        if least.abs() < 1e-4 && (-0.1..1.1).contains(&t)
            || t.abs() < 1e-4 && least > -0.1
            || (t - 1.0).abs() < 1e-4
        {
            doubtful = true;
        } else if least > 0.0 && (0.0..1.0).contains(&t) {
            return Some(true);
        }
    }
    (!doubtful).then_some(false)
}

/// `scene` under a point in the middle of its light.
pub fn under_a_point(scene: &Scene, eye: &EyeView) -> ShadowInput {
    let scene = Scene { light: Light::Point { center: scene.light.center() }, ..scene.clone() };
    ShadowInput::new(&scene, &Adjacency::new(&scene.mesh), eye)
}

/// The samples of the light at a pixel: turned as the kernel turns them.
pub fn turned(places: &[DVec2], turns: &[DVec2], pixel: u32) -> Vec<DVec2> {
    let turn = turns[(pixel.wrapping_mul(0x9e37_79b9) >> 28) as usize];
    places.iter().map(|place| turn.rotate(*place)).collect()
}

pub fn power_of_ten(exponent: f64) -> f64 {
    10.0_f64.powf(exponent)
}

pub fn sphere(radius: f64) -> Light {
    Light::Sphere { center: DVec3::ZERO, radius }
}

/// `light`, and a disc, a rectangle, a line and a triangle of its size in its place.
pub fn one_of_each_kind(light: Light) -> [Light; 5] {
    let (center, radius) = (light.center(), light.radius());
    let (half_u, half_v) = (DVec3::new(1.0, 0.2, 0.1) * radius, DVec3::new(0.1, 0.0, 0.5) * radius);
    [
        light,
        Light::Disc { center, normal: DVec3::new(0.2, 1.0, 0.1), radius },
        Light::Rect { center, half_u, half_v },
        Light::Linear { p0: center - half_u, p1: center + half_u },
        Light::Triangle {
            p0: center - half_u - half_v,
            p1: center + half_u - half_v,
            p2: center + half_v * 2.0,
        },
    ]
}

/// The loops of points in an oracle's list of lists.
pub fn loops(value: &Value) -> Vec<Vec<DVec2>> {
    let points = |points: &Value| {
        points.as_array().expect("points").iter().map(|p| DVec2::from_slice(&numbers(p))).collect()
    };
    value.as_array().expect("loops").iter().map(points).collect()
}

/// A frame in which the one receiver sees loops `loops`, given in radii of the light, on the light's disc.
///
/// Occluder in the plane z = 1, receiver at z = 2, radius 1. Fans of concave loops overlap themselves: counted as shells,
/// the faces that look at the light give F, those that look away B, and the winding number is the difference.
pub fn of_loops(loops: &[Vec<DVec2>], nudge: DVec2) -> ShadowInput {
    let corners: Vec<Vec<DVec3>> =
        loops.iter().map(|points| points.iter().map(|u| (*u * 0.5).extend(1.0)).collect()).collect();
    let light = Light::Sphere { center: DVec3::ZERO, radius: 1.0 };
    let mut input = input_of_prepared(polygons(&corners), light, &[(nudge.extend(2.0), u32::MAX)]);
    input.counting.fill(Counting::Shell);
    input
}

/// Runs the kernels; every receiver must have the sums that all its edges and triangles give, bit by bit.
pub fn agree(what: &str, input: &ShadowInput, choices: impl Into<Choices>) -> Run {
    let on = On::Host(HostSimd::detect(), 2);
    let mut run = Run::with(input, choices, on);
    run.visibility();
    let (pipeline, brute) = (run.sums(), run.brute_force(on));
    assert_eq!(pipeline.len(), input.receivers.len(), "{what}: every receiver has its sums");
    let different: Vec<_> = brute.iter().filter(|(pixel, sums)| pipeline[*pixel] != **sums).collect();
    if let Some((pixel, sums)) = different.first() {
        let at = input.receiver_pixel.iter().position(|of| of == **pixel).expect("a receiver");
        panic!(
            "{what}: {} of {} receivers differ; pixel {pixel} at {:?} (radius {}) has {:?}, brute force {sums:?}",
            different.len(),
            brute.len(),
            input.receivers[at],
            input.light_radius,
            pipeline[*pixel],
        );
    }
    run
}

/// Only rounding parts the kernels from `truth` in f64: next to none of the receivers is off by more than 1e-3, and the mean is
/// below 1e-5.
pub fn only_rounding(name: &str, truth: &[f64], kernels: &[f32]) {
    let kernels: Vec<f64> = kernels.iter().copied().map(f64::from).collect();
    let off = truth.iter().zip(&kernels).filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
    let metrics = ErrorMetrics::new(truth, &kernels);
    println!("{name}: {off} of {} receivers off by more than 1e-3; {metrics:?}", truth.len());
    // A receiver within rounding of a triangle's edge or plane may fall to either side.
    assert!(off * 2000 <= truth.len(), "{name}: {off} of {}", truth.len());
    assert!(metrics.mean < 1e-5, "{name}: {metrics:?}");
}

/// A frame that a method has drawn.
pub struct Drawn {
    /// Visibility, one a receiver.
    pub visibility: Vec<f32>,
    pub steps: BTreeMap<&'static str, StepFigures>,
}

/// Options of `method` that make its map small, if it has one.
pub fn options_with_small_map(method: &dyn Method) -> &'static str {
    let has_map = method.entry().options.iter().any(|option| option.name == "size");
    if has_map { "size=128" } else { "" }
}

/// `light`, or in its place the first of another kind that `method` draws.
pub fn light_for(method: &dyn Method, light: Light) -> Light {
    let options = method.entry().options("").expect("options have defaults");
    let all = [light].into_iter().chain(one_of_each_kind(light));
    all.into_iter()
        .find(|light| method.objection_to_light(&options, light).is_none())
        .expect("a method draws some light")
}

/// Runs `method` with the options that `options` gives.
pub fn draw(method: &dyn Method, options: &str, input: &ShadowInput, on: On) -> Drawn {
    let mut steps = BTreeMap::new();
    let mut run_step = |phase: &Phase, step: &Step, arena: &mut Arena| {
        assert!(method.phases().iter().any(|listed| listed.id == phase.id), "{} is not listed", phase.id);
        steps.insert(step.name(), run_step(step, arena, on));
        Ok(())
    };
    let options = method.entry().options(options).expect("the method takes these");
    let mut arena = Arena::new();
    let shadows = method.run(&options, &mut input.clone(), &mut Runner::new(&mut arena, &mut run_step));
    let visibility = shadows.expect("nothing stops it").visibility;
    assert_eq!(visibility.len(), input.receivers.len());
    assert!(visibility.iter().all(|x| (0.0..=1.0).contains(x)), "a visibility outside [0, 1]");
    Drawn { visibility, steps }
}

/// All back ends give the picture that the first of them gives, whose tasks are short.
pub fn same_on_all_back_ends(method: &dyn Method, options: &str, input: &ShadowInput) {
    let mut all = back_ends();
    all.push(On::Host(HostSimd::detect(), 2));
    let first = draw(method, options, input, all[0]);
    for (step, figures) in &first.steps {
        println!("{step:18} {:>6} tasks, longest {:>6} uops", figures.tasks, figures.longest_task);
        assert!(figures.longest_task < TASK_UOPS, "{step}: a task of {} uops", figures.longest_task);
    }
    let bits = |drawn: &Drawn| drawn.visibility.iter().map(|x| x.to_bits()).collect::<Vec<u32>>();
    for &on in &all[1..] {
        assert!(bits(&draw(method, options, input, on)) == bits(&first), "{on:?} gives another picture");
    }
}

/// A half plane at depth 2 over a floor at depth 4, under a light of radius 0.2: the penumbra on the floor is 0.4 wide, and its
/// profile that of a disc behind a straight edge.
pub fn half_plane(across: &[f64]) -> ShadowInput {
    let mut mesh = Mesh::default();
    let at = |x: f64, y: f64| DVec3::new(x, y, -2.0);
    add_triangle(&mut mesh, [at(0.0, -9.0), at(0.0, 9.0), at(-9.0, 0.0)]);
    add_triangle(
        &mut mesh,
        [(-40.0, -40.0), (40.0, -40.0), (0.0, 60.0)].map(|(x, y)| DVec3::new(x, y, -4.0)),
    );
    let receivers: Vec<(DVec3, u32)> = across
        .iter()
        .flat_map(|&x| (0..64).map(move |k| (DVec3::new(x, f64::from(k) * 0.01 - 0.32, -4.0), 1)))
        .collect();
    input(mesh, sphere(0.2), &receivers)
}
