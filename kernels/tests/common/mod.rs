//! What the tests of the kernels share: runs on every back end, scenes made of plain parts, the oracles of the project.

#![allow(dead_code, reason = "each test file uses its own part")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use lrbsim_isa::host::run_functional;
use lrbsim_isa::{Arena, Compare, HostSimd, Kernel, OpCounts, Ordering, Step, Stream, Vpu};
use lrbsim_kernels::columns::{Columns, lanes_below};
use lrbsim_kernels::plane::TRIANGLE_WORDS;
use lrbsim_kernels::sism::layout::{EDGE_WORDS, Layout, OWN_TRIANGLE, PIXEL, POSITION, RECEIVER};
use lrbsim_kernels::sism::{self, Frame, hard::count_layers, soft};
use lrbsim_workloads::adjacency::prepare;
use lrbsim_workloads::glam::{DVec3, Vec3};
use lrbsim_workloads::{Adjacency, EyeView, Light, Mesh, Scene, ShadowInput, load_scene};
use serde_json::Value;

/// The back end that runs something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum On {
    /// Functional, on so many host threads.
    Host(HostSimd, usize),
    /// The recording back end.
    Recording(HostSimd),
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
pub fn run_step(step: &Step, arena: &Arena, on: On) -> StepFigures {
    let mut figures = StepFigures { tasks: step.tasks, ..StepFigures::default() };
    match on {
        On::Host(simd, threads) => {
            let counts: OpCounts = run_functional(step, arena, simd, threads);
            figures.uops = counts.total();
        }
        On::Recording(simd) => {
            let mut stream = Stream::default();
            for task in 0..step.tasks {
                stream.clear();
                step.kernel.record(simd, arena, task, &mut stream);
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
    pub frame: Frame,
    pub steps: BTreeMap<&'static str, StepFigures>,
    pub phases: BTreeMap<&'static str, u64>,
}

impl Run {
    /// Runs the whole program of `input`.
    pub fn new(input: &ShadowInput, on: On) -> Run {
        let mut arena = Arena::new();
        let mut program = sism::program(input, &sism::Options::default(), &mut arena);
        let (mut steps, mut phases) = (BTreeMap::new(), BTreeMap::new());
        for phase in &program.phases {
            for make in &phase.steps {
                let step = make(&mut program.state, &mut arena);
                let figures = run_step(&step, &arena, on);
                *phases.entry(phase.id).or_default() += figures.uops;
                steps.insert(step.name, figures);
            }
        }
        assert_eq!(arena.host_reads_in_task(), 0, "a task read the arena past the Vpu");
        Run { arena, frame: program.state, steps, phases }
    }

    /// Layers in F and B, coverage in F and B by pixel, as the pipeline left them.
    pub fn sums(&self) -> BTreeMap<u32, [i32; 4]> {
        let layout = &self.frame.layout;
        let receiver = |i: u64| u64::from(self.arena.read_u32(layout.samples.column(RECEIVER).plus(4 * i)));
        sums(&self.arena, layout, layout.sums, receiver)
    }

    /// The same by brute force, from the records of this run.
    pub fn brute_force(&mut self, on: On) -> BTreeMap<u32, [i32; 4]> {
        let layout = self.frame.layout;
        let out = Columns::new(&mut self.arena, 4, layout.receiver_count);
        let step = Step {
            name: "brute force",
            ordering: Ordering::Independent,
            tasks: layout.receiver_count.div_ceil(16),
            kernel: Box::new(BruteForce { layout, out }),
        };
        run_step(&step, &self.arena, on);
        sums(&self.arena, &layout, out, |i| i)
    }

    /// Visibility, one a receiver; every one in [0, 1].
    pub fn visibility(&self) -> Vec<f32> {
        let visibility = self.frame.visibility(&self.arena);
        assert!(visibility.iter().all(|x| (0.0..=1.0).contains(x)), "a visibility outside [0, 1]");
        visibility
    }
}

/// Sums by pixel, from columns whose entries are of these receivers.
fn sums(
    arena: &Arena,
    layout: &Layout,
    from: Columns,
    receiver: impl Fn(u64) -> u64,
) -> BTreeMap<u32, [i32; 4]> {
    let columns = if layout.is_soft() { 4 } else { 2 };
    (0..u64::from(layout.receiver_count))
        .map(|i| {
            let pixel = arena.read_u32(layout.receivers.column(PIXEL).plus(4 * receiver(i)));
            let mut all = [0; 4];
            for (c, sum) in all.iter_mut().enumerate().take(columns) {
                *sum = arena.read_u32(from.column(c as u32).plus(4 * i)) as i32;
            }
            (pixel, all)
        })
        .collect()
}

/// Every edge x every receiver and every triangle x every receiver: no grid, no bins, no records, no wedge.
struct BruteForce {
    layout: Layout,
    out: Columns,
}

impl Kernel for BruteForce {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let layout = &self.layout;
        let four = v.s_imm(4);
        let one = v.s_imm(1);
        let first = v.s_shl(task, four);
        let end = v.s_imm(layout.receiver_count as i32);
        let live = lanes_below(v, first, end);
        let mut axis = |a| v.vload_f32(layout.receivers.column(POSITION + a), first);
        let points = [axis(0), axis(1), axis(2)];
        let own = v.vload_i32(layout.receivers.column(OWN_TRIANGLE), first);
        let none = v.vset_i32(0);
        let (mut layers, mut coverage) = ([none; 2], [none; 2]);
        let words = v.s_imm(TRIANGLE_WORDS as i32);
        let end = v.s_imm(layout.triangle_count as i32);
        let mut i = v.s_imm(0);
        while v.branch(Compare::Less, i, end) {
            let index = v.s_mul(i, words);
            let number = v.vsplat(i);
            layers = count_layers(v, live, points, own, number, (layout.triangle_records, index), layers);
            i = v.s_add(i, one);
        }
        if layout.is_soft() {
            let view = soft::view(v, layout, points);
            let words = v.s_imm(EDGE_WORDS as i32);
            let end = v.s_imm(layout.silhouette_count as i32);
            let mut i = v.s_imm(0);
            while v.branch(Compare::Less, i, end) {
                let index = v.s_mul(i, words);
                coverage = soft::add_edge(v, &view, live, points, (layout.edge_records, index), coverage);
                i = v.s_add(i, one);
            }
        }
        for (c, sum) in layers.into_iter().chain(coverage).enumerate() {
            v.vstore_i32(live, self.out.column(c as u32), first, sum);
        }
    }
}

/// A function of `IN` floats to `OUT` floats, 16 cases at a time.
pub trait Lanewise<const IN: usize, const OUT: usize>: Send + Sync + Clone + 'static {
    fn eval<V: Vpu>(&self, v: &mut V, x: [V::F32; IN]) -> [V::F32; OUT];
}

struct Shell<F, const IN: usize, const OUT: usize> {
    function: F,
    from: Columns,
    to: Columns,
}

impl<const IN: usize, const OUT: usize, F: Lanewise<IN, OUT>> Kernel for Shell<F, IN, OUT> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let four = v.s_imm(4);
        let at = v.s_shl(task, four);
        let all = v.mask_all();
        let x = core::array::from_fn(|c| v.vload_f32(self.from.column(c as u32), at));
        let y = self.function.eval(v, x);
        for (c, y) in y.into_iter().enumerate() {
            v.vstore_f32(all, self.to.column(c as u32), at, y);
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
        let from = Columns::new(&mut arena, IN as u32, count);
        let to = Columns::new(&mut arena, OUT as u32, count);
        for (i, case) in cases.iter().enumerate() {
            for (c, x) in case.iter().enumerate() {
                arena.write_u32(from.column(c as u32).plus(4 * i as u64), x.to_bits());
            }
        }
        let kernel = Box::new(Shell::<F, IN, OUT> { function: function.clone(), from, to });
        let step = Step { name: "function", ordering: Ordering::Independent, tasks: count / 16, kernel };
        run_step(&step, &arena, on);
        let read =
            |i: usize| core::array::from_fn(|c| arena.read_u32(to.column(c as u32).plus(4 * i as u64)));
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
    let width = count.min(64);
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
