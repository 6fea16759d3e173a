//! One frame, from a scene and a machine to a report and a picture.

use lrbsim_isa::host::HostSimd;
use lrbsim_isa::{Arena, ArenaError, Phase, Runner, Step, Stopped};
use lrbsim_kernels::method::Shadows;
use lrbsim_machine::Fidelity;
use lrbsim_reports::counters::{Clock, PhaseCosts, phase_reports};
use lrbsim_reports::picture;
use lrbsim_reports::run::{
    ImageSummary, Provenance, RunReport, SCHEMA_VERSION, SceneSummary, Total, Warning, WarningKind,
};
use lrbsim_reports::{HostReport, picture::NOTHING_HIT};
use lrbsim_workloads::glam::{DVec3, Vec3};
use lrbsim_workloads::{Adjacency, EyeView, ImageSize, Scene, SceneWarning, ShadowInput, silhouette_edges};
use rayon::prelude::*;

use crate::algorithm::Algorithm;
use crate::engine::Engine;
use crate::error::BadInput;
use crate::host::{Stopwatch, node, peak_rss_bytes};
use crate::inputs::Machine;
use crate::progress::Progress;
use crate::reference::ReferenceRequest;

/// Version of what the simulator's numbers mean. Raise it whenever the same inputs give other numbers: finished points of
/// an older version are then run again. The test `results_that_change_raise_the_version` reminds of it.
pub const SEMANTICS: u32 = 11;

/// Frames at most before the measured one: the caches are as warm as they get after a few.
const WARM_FRAMES_MAX: u32 = 1000;

/// Everything that determines a run.
#[derive(Debug, Clone)]
pub struct RunRequest {
    /// What is drawn.
    pub scene: Scene,
    /// What draws it.
    pub machine: Machine,
    /// How.
    pub algorithm: Algorithm,
    /// How much of the machine is modeled.
    pub fidelity: Fidelity,
    /// Frames run before the measured one, to warm the caches.
    pub warm_frames: u32,
    /// The reference that the picture is judged by; `None`: it is not.
    pub reference: Option<ReferenceRequest>,
    /// How the host goes about it; changes no result.
    pub host: HostOptions,
}

/// How the host goes about a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostOptions {
    /// Threads at most, at least 1.
    pub threads: usize,
    /// Host instructions that compute the lanes.
    pub simd: HostSimd,
}

impl Default for HostOptions {
    fn default() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, |threads| threads.get());
        HostOptions { threads, simd: HostSimd::detect() }
    }
}

/// What came out of a run.
#[derive(Debug, Clone)]
pub struct RunOutput {
    /// The result in simulated time.
    pub report: RunReport,
    /// What it cost the host.
    pub host: HostReport,
    /// The pixels.
    pub frame: Frame,
}

/// A frame per pixel: row-major from the top left, NaN where nothing was hit.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Part of the light that is seen, in [0, 1].
    pub visibility: Vec<f32>,
    /// Part of the light that is seen by the reference, where one was asked for.
    pub reference: Option<Vec<f32>>,
    /// Cosine between the normal and the direction to the light's center.
    pub cosine: Vec<f32>,
}

/// Runs one frame, or `warm_frames` and then the one that is measured.
pub fn run_frame(request: &RunRequest, progress: &dyn Progress) -> Result<RunOutput, BadInput> {
    let watch = Stopwatch::start();
    let RunRequest { scene, machine, fidelity, host, .. } = request;
    check_warm_frames(request.warm_frames)?;
    request.algorithm.check_light(&scene.light)?;
    request.reference.as_ref().map_or(Ok(()), |reference| reference.check(scene))?;

    // What the eye sees: on the host, untimed, as in the paper.
    progress.part("eye view");
    let (input, cosine, mut warnings) = on_host_threads(host.threads, || {
        let (mut eye, adjacency) = rayon::join(|| view(scene), || Adjacency::new(&scene.mesh));
        // Of the view, which takes more memory than anything else on the host, little is kept: it is soon had again.
        let cosine = cosines(scene, &eye);
        eye.normals = Vec::new();
        progress.part("input");
        let input = ShadowInput::of_lights(scene, request.algorithm.lights(), &adjacency, &eye);
        let warnings = warnings(scene, &adjacency, &eye);
        (input, cosine, warnings)
    })?;

    // The kernels, on the machine.
    let simulation = Stopwatch::start();
    let mut engine = Engine::new(&machine.spec, *fidelity, host.simd, host.threads);
    let mut simulated = simulate(&request.algorithm, &input, &mut engine, progress)?;
    for _ in 0..request.warm_frames {
        // Again from the start, with every array where it was: only the chip remembers.
        simulated = simulate(&request.algorithm, &input, &mut engine, progress)?;
    }
    let simulation_seconds = simulation.elapsed().as_secs_f64();

    // What came out.
    progress.part("report");
    let of_method = |message: &String| Warning { kind: WarningKind::MethodLimit, message: message.clone() };
    warnings.extend(simulated.warnings.iter().map(of_method));
    let visibility = &simulated.shadows.visibility;
    let wrong = visibility.iter().find(|visible| !(0.0..=1.0).contains(*visible));
    assert!(wrong.is_none(), "`{}` leaves a visibility of {wrong:?}", request.algorithm);
    let mut frame = Frame::new(scene.image, &input.receiver_pixel, &cosine, visibility);
    let receivers = input.receivers.len();
    let mut report = report(request, receivers, &simulated, &frame, warnings);
    let seconds = watch.elapsed().as_secs_f64();

    // How right it is: by the host, untimed.
    let mut reference_cost = None;
    if let Some(asked) = &request.reference {
        let reference = on_host_threads(host.threads, || asked.run(scene, receivers, progress))??;
        report.image.error = Some(reference.judge(asked.samples, visibility));
        let truth: Vec<f32> = reference.truth.visibility().iter().map(|visible| *visible as f32).collect();
        frame.reference = Some(frame.spread(&input.receiver_pixel, &truth));
        reference_cost = Some((reference.seconds, reference.found));
    }
    let instructions: u64 = report.phases.iter().map(|phase| phase.instructions.total).sum();
    let host = HostReport {
        node: node(),
        seconds,
        reference_seconds: reference_cost.map(|(seconds, _)| seconds),
        reference_found: reference_cost.map(|(_, found)| found),
        simulated_instructions_per_second: (instructions * (1 + u64::from(request.warm_frames))) as f64
            / simulation_seconds.max(1e-9),
        peak_rss_bytes: peak_rss_bytes(),
        host_threads: u32::try_from(host.threads).unwrap_or(u32::MAX),
        host_simd: host.simd.to_string(),
    };
    Ok(RunOutput { report, host, frame })
}

/// Refuses a number of warm frames that is a slip.
pub(crate) fn check_warm_frames(frames: u32) -> Result<(), BadInput> {
    if frames <= WARM_FRAMES_MAX {
        return Ok(());
    }
    Err(BadInput::new(format!("{frames} warm frames; there must be at most {WARM_FRAMES_MAX}"))
        .with_help("the caches are as warm as they get after a few"))
}

/// Runs `work`, and what it runs in parallel, on at most `threads` host threads.
pub(crate) fn on_host_threads<T: Send>(
    threads: usize,
    work: impl FnOnce() -> T + Send,
) -> Result<T, BadInput> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool
        .map_err(|error| BadInput::new(format!("the host gives no {threads} threads: {error}")).passing())?;
    Ok(pool.install(work))
}

/// What a program left behind.
struct Simulated {
    phases: Vec<PhaseCosts>,
    shadows: Shadows,
    /// What the method has against its own result.
    warnings: Vec<String>,
}

/// Runs the program of a frame in an arena of its own.
fn simulate(
    algorithm: &Algorithm,
    input: &ShadowInput,
    engine: &mut Engine,
    progress: &dyn Progress,
) -> Result<Simulated, BadInput> {
    let mut arena = Arena::reserve().map_err(no_memory)?;
    let mut phases: Vec<PhaseCosts> = Vec::new();
    let mut refusal = None;
    let mut run_step = |phase: &'static Phase, step: &Step, arena: &mut Arena| {
        debug_assert!(algorithm.phases().contains(phase), "`{}` is no phase that studies may name", phase.id);
        let cost = arena.check().map_err(no_memory).and_then(|()| {
            progress.step(phase.title, step.tasks());
            engine.run(step, arena, progress)
        });
        let cost = cost.map_err(|bad| {
            refusal = Some(bad);
            Stopped
        })?;
        progress.uops(cost.issued);
        // A program may come back to a phase, as for each light of several.
        let row = phases.iter().position(|row| row.phase == phase).unwrap_or_else(|| {
            phases.push(PhaseCosts { phase, steps: Vec::new(), core_busy_cycles: None });
            phases.len() - 1
        });
        let last = &mut phases[row];
        last.steps.push((step.name(), cost));
        if let Some(busy) = engine.core_busy_cycles() {
            let sums = last.core_busy_cycles.get_or_insert_with(|| vec![0; busy.len()]);
            sums.iter_mut().zip(busy).for_each(|(sum, cycles)| *sum += cycles);
        }
        Ok(())
    };
    let mut runner = Runner::new(&mut arena, &mut run_step);
    let shadows = algorithm.run(input, &mut runner);
    let warnings = runner.warnings;
    match (shadows, refusal) {
        (Ok(shadows), None) => Ok(Simulated { phases, shadows, warnings }),
        (_, Some(refusal)) => Err(refusal),
        (Err(stopped), None) => Err(BadInput::new(stopped.to_string())),
    }
}

/// A host that is too small for the frame.
pub(crate) fn no_memory(error: ArenaError) -> BadInput {
    BadInput::new(error.to_string()).passing().with_help(
        "a smaller image or mesh needs less; so does a host that limits the address space less (`ulimit -v`)",
    )
}

fn report(
    request: &RunRequest,
    receivers: usize,
    simulated: &Simulated,
    frame: &Frame,
    warnings: Vec<Warning>,
) -> RunReport {
    let RunRequest { scene, machine, fidelity, .. } = request;
    let timed = fidelity.is_timed();
    // Kernels that look for no silhouettes, as for a point light, count none; the scene still has them.
    let silhouette_edges = simulated.shadows.silhouette_edges.unwrap_or_else(|| {
        silhouette_edges(&scene.mesh, &Adjacency::new(&scene.mesh), scene.light.center()) as u64
    });
    let clock = Clock { clock_ghz: machine.config.clock_ghz, cores: machine.config.cores };
    let phases = phase_reports(&simulated.phases, timed.then_some(clock));
    RunReport {
        schema_version: SCHEMA_VERSION,
        provenance: Provenance {
            lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
            semantics: SEMANTICS,
            machine_hash: machine_hash(machine),
            scene_hash: scene_hash(scene),
            algorithm: request.algorithm.to_string(),
            fidelity: fidelity.to_string(),
            warm_frames: request.warm_frames,
            seed: 0,
        },
        scene: SceneSummary {
            name: scene.name.clone(),
            triangles: scene.mesh.triangles.len() as u64,
            silhouette_edges,
            receivers: receivers as u64,
            width: frame.width,
            height: frame.height,
            light: serde_json::to_value(scene.light).expect("a light has string keys"),
        },
        machine: machine.config.clone(),
        total: Total::of_phases(&phases, clock.clock_ghz),
        phases,
        image: ImageSummary::of(&frame.visibility),
        model_error: crate::validate::model_error(),
        warnings,
    }
}

/// What makes the result of a frame suspicious.
fn warnings(scene: &Scene, adjacency: &Adjacency, eye: &EyeView) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if eye.points.is_empty() {
        warnings.push(Warning {
            kind: WarningKind::NothingSeen,
            message:
                "the camera sees no surface, so that nothing is shadowed: turn `camera.target` to the model; \
                      `lrbsim scene show` shows the view"
                    .to_owned(),
        });
    }
    warnings.extend(scene.warnings(adjacency).iter().map(|warning| Warning {
        kind: match warning {
            SceneWarning::LeftOut { .. } => WarningKind::LinesLeftOut,
            SceneWarning::LightTouches { .. }
            | SceneWarning::LightHuge { .. }
            | SceneWarning::LightEnclosed { .. } => WarningKind::LightInGeometry,
        },
        message: warning.to_string(),
    }));
    warnings
}

/// Names a machine by every number that timing depends on; where the numbers are from does not matter.
pub(crate) fn machine_hash(machine: &Machine) -> String {
    let mut config = machine.config.clone();
    config.sources.clear();
    picture::sha256(serde_json::to_string(&config).expect("a configuration has string keys").as_bytes())
}

/// Names a scene by what is in it: triangles, camera, picture size and light.
pub(crate) fn scene_hash(scene: &Scene) -> String {
    let view = serde_json::json!({"camera": scene.camera, "image": scene.image, "light": scene.light});
    let mut bytes = view.to_string().into_bytes();
    bytes.extend(scene.mesh.positions.iter().flat_map(|p| p.to_array()).flat_map(f64::to_le_bytes));
    bytes.extend(scene.mesh.triangles.iter().flatten().flat_map(|vertex| vertex.to_le_bytes()));
    picture::sha256(&bytes)
}

impl Frame {
    /// Spreads the values of the receivers at `pixels` over a picture of this size.
    pub(crate) fn new(size: ImageSize, pixels: &[u32], cosine: &[f32], visibility: &[f32]) -> Frame {
        assert_eq!(visibility.len(), pixels.len(), "one visibility a receiver");
        let ImageSize { width, height } = size;
        let frame = Frame { width, height, visibility: Vec::new(), reference: None, cosine: Vec::new() };
        Frame { visibility: frame.spread(pixels, visibility), cosine: frame.spread(pixels, cosine), ..frame }
    }

    /// A value for each pixel from one for each receiver.
    fn spread(&self, pixels: &[u32], of_receivers: &[f32]) -> Vec<f32> {
        let mut of_pixels = vec![NOTHING_HIT; self.width as usize * self.height as usize];
        for (pixel, value) in pixels.iter().zip(of_receivers) {
            of_pixels[*pixel as usize] = *value;
        }
        of_pixels
    }
}

/// What the camera of a scene sees.
pub(crate) fn view(scene: &Scene) -> EyeView {
    EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height)
}

/// Cosine between the normal and the direction to the light's center at each receiver.
pub(crate) fn cosines(scene: &Scene, eye: &EyeView) -> Vec<f32> {
    let light = scene.light.center();
    let cosine = |(normal, point): (&Vec3, &DVec3)| normal.dot((light - point).normalize_or_zero().as_vec3());
    eye.normals.par_iter().zip(&eye.points).map(cosine).collect()
}
