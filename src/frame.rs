//! One frame, from a scene and a machine to a report and a picture.

use lrbsim_isa::host::HostSimd;
use lrbsim_isa::{Arena, ArenaError, Phase, Runner, Step, Stopped};
use lrbsim_kernels::method::Shadows;
use lrbsim_machine::fleet::{Failure, StepCost};
use lrbsim_machine::{Fidelity, MachineSpec, Seats, StepReport};
use lrbsim_reports::counters::{Clock, PhaseCosts, phase_reports};
use lrbsim_reports::picture;
use lrbsim_reports::run::{
    ImageError, ImageSummary, Provenance, RunReport, SCHEMA_VERSION, SceneSummary, Total, Warning,
    WarningKind,
};
use lrbsim_reports::{HostReport, picture::NOTHING_HIT};
use lrbsim_workloads::glam::{DVec3, Vec3};
use lrbsim_workloads::{
    Adjacency, EyeView, ImageSize, Pixels, Scene, SceneWarning, ShadowInput, silhouette_edges,
};
use rayon::prelude::*;

use crate::algorithm::Algorithm;
use crate::engine::{Engine, busy_cycles, with_tasks};
use crate::error::BadInput;
use crate::host::{Stopwatch, node, peak_rss_bytes};
use crate::inputs::Machine;
use crate::progress::{Progress, Quiet};
use crate::reference::ReferenceRequest;
use crate::study::said;

/// Version of what the simulator's numbers mean. Raise it whenever the same inputs give other numbers: finished points of
/// an older version are then run again. The test `results_that_change_raise_the_version` reminds of it.
pub const SEMANTICS: u32 = 15;

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
    let RunRequest { machine, fidelity, host, .. } = request;
    let mut prepared = Prepared::new(request, progress)?;

    // The kernels, on the machine.
    let simulation = Stopwatch::start();
    let mut engine = Engine::new(&machine.spec, *fidelity, host.simd, host.threads);
    let mut frame = |input: &mut ShadowInput| -> Result<(Program, Vec<PhaseCosts>), BadInput> {
        let mut phases: Vec<PhaseCosts> = Vec::new();
        let program = run_program(&request.algorithm, input, progress, |phase, step, arena| {
            let cost = engine.run(step, arena, progress)?;
            progress.uops(cost.issued);
            add_cost(&mut phases, (phase, step.name()), cost, engine.core_busy_cycles());
            Ok(())
        })?;
        Ok((program, phases))
    };
    // Each from the start, with every array where it was: only the chip remembers.
    for _ in 0..request.warm_frames {
        frame(&mut prepared.input.clone())?;
    }
    let simulated = frame(&mut prepared.input)?;
    let simulation_seconds = simulation.elapsed().as_secs_f64();

    // What came out.
    progress.part("report");
    let (program, phases) = &simulated;
    let mut finished = Finished::new(request, &prepared, program);
    let clock = HostClock { seconds: watch.elapsed().as_secs_f64(), simulation_seconds };
    finished.judge(request, &prepared, progress)?;
    let (report, host) = finished.on(request, machine, phases, clock);
    Ok(RunOutput { report, host, frame: finished.frame })
}

/// Runs what `request` asks for on each of `machines` in place of its own, and hands `each` their outputs, in order: the program runs
/// once, for all of them, on no more host threads at once than there are `seats`.
///
/// All that comes out is what [`run_frame`] would give for each, but for what it cost the host: each has its part of the threads that
/// computed, as if all seats were theirs.
///
/// # Errors
/// What is wrong with all of them; what is wrong with one, `each` gets.
pub(crate) fn run_on_machines(
    request: &RunRequest,
    machines: &[Machine],
    seats: &Seats,
    mut each: impl FnMut(Result<RunOutput, BadInput>),
) -> Result<(), BadInput> {
    let watch = Stopwatch::start();
    let progress = &Quiet;
    let seat = seats.take();
    let mut prepared = Prepared::new(request, progress)?;
    let simulation = Stopwatch::start();
    let specs: Vec<MachineSpec> = machines.iter().map(|machine| machine.spec.clone()).collect();
    // Who waits for a seat has none.
    drop(seat);
    let mut steps: Vec<(&'static Phase, &'static str)> = Vec::new();
    let (program, costs) = request.fidelity.on_all(&specs, seats, |machines| {
        let mut frame = |input: &mut ShadowInput| {
            steps.clear();
            machines.frame();
            run_program(&request.algorithm, input, progress, |phase, step, arena| {
                steps.push((phase, step.name()));
                let host = (request.host.simd, 1);
                let is_wanted = with_tasks(step, arena, host, progress, |tasks| machines.run(tasks))?;
                is_wanted.then_some(()).ok_or_else(|| BadInput::new("no machine is left"))
            })
        };
        for _ in 0..request.warm_frames {
            frame(&mut prepared.input.clone())?;
        }
        frame(&mut prepared.input)
    });
    let costs = costs.into_iter().map(|costs| costs.map_err(refused)).collect::<Vec<_>>();
    if costs.iter().all(Result::is_err) {
        costs.into_iter().filter_map(Result::err).for_each(|bad| each(Err(bad)));
        return Ok(());
    }
    let program = program?;
    let _seat = seats.take();
    // Of the threads that computed, each machine has its part.
    let part = seats.count().min(machines.len()) as f64 / machines.len() as f64;
    let simulation_seconds = simulation.elapsed().as_secs_f64() * part;
    let mut finished = Finished::new(request, &prepared, &program);
    let clock = HostClock { seconds: watch.elapsed().as_secs_f64() * part, simulation_seconds };
    finished.judge(request, &prepared, progress)?;
    for (machine, costs) in machines.iter().zip(costs) {
        each(costs.map(|costs| {
            let mut phases = Vec::new();
            for (step, StepCost { report, activity }) in steps.iter().zip(costs) {
                add_cost(&mut phases, *step, report, busy_cycles(&activity));
            }
            let (report, host) = finished.on(request, machine, &phases, clock);
            RunOutput { report, host, frame: finished.frame.clone() }
        }));
    }
    Ok(())
}

/// Why a machine of several has no result, in words.
fn refused(failure: Failure) -> BadInput {
    match failure {
        Failure::Stuck(step, stuck) => BadInput::new(format!("step `{step}`: {stuck}")),
        Failure::Panic(panic) => BadInput::new(format!("the simulator failed: {}", said(panic.as_ref()))),
        Failure::Thread(error) => BadInput::new(format!("the host gives no thread: {error}")).passing(),
    }
}

/// What the eye of a request sees: computed by the host, untimed, as in the paper.
struct Prepared {
    input: ShadowInput,
    /// Cosine between the normal and the direction to the light at each receiver.
    cosine: Vec<f32>,
    warnings: Vec<Warning>,
}

impl Prepared {
    fn new(request: &RunRequest, progress: &dyn Progress) -> Result<Prepared, BadInput> {
        let RunRequest { scene, host, .. } = request;
        check_warm_frames(request.warm_frames)?;
        request.algorithm.check_light(&scene.light)?;
        request.reference.as_ref().map_or(Ok(()), |reference| reference.check(scene))?;
        progress.part("eye view");
        on_host_threads(host.threads, || {
            let (mut eye, adjacency) = rayon::join(|| view(scene), || Adjacency::new(&scene.mesh));
            // Of the view, which takes more memory than anything else on the host, little is kept: it is soon had again.
            let cosine = cosines(scene, &eye);
            eye.normals = Vec::new();
            progress.part("input");
            let input = ShadowInput::of_lights(scene, request.algorithm.lights(), &adjacency, &eye);
            let warnings = warnings(scene, &adjacency, &eye);
            Prepared { input, cosine, warnings }
        })
    }
}

/// What a program drew, which is the same on every machine.
struct Finished<'a> {
    program: &'a Program,
    receivers: usize,
    frame: Frame,
    warnings: Vec<Warning>,
    judged: Option<Judged>,
}

/// How far a picture is from its reference.
struct Judged {
    error: ImageError,
    seconds: f64,
    found: bool,
}

/// Seconds of the host.
#[derive(Clone, Copy)]
struct HostClock {
    seconds: f64,
    simulation_seconds: f64,
}

impl<'a> Finished<'a> {
    fn new(request: &RunRequest, prepared: &Prepared, program: &'a Program) -> Finished<'a> {
        let of_method =
            |message: &String| Warning { kind: WarningKind::MethodLimit, message: message.clone() };
        let mut warnings = prepared.warnings.clone();
        warnings.extend(program.warnings.iter().map(of_method));
        let visibility = &program.shadows.visibility;
        let wrong = visibility.iter().find(|visible| !(0.0..=1.0).contains(*visible));
        assert!(wrong.is_none(), "`{}` leaves a visibility of {wrong:?}", request.algorithm);
        let Prepared { input, cosine, .. } = prepared;
        let frame = Frame::new(request.scene.image, &input.receiver_pixel, cosine, visibility);
        Finished { program, receivers: input.receiver_pixel.len(), frame, warnings, judged: None }
    }

    /// Judges the picture, where that is asked for: by the host, untimed.
    fn judge(
        &mut self,
        request: &RunRequest,
        prepared: &Prepared,
        progress: &dyn Progress,
    ) -> Result<(), BadInput> {
        let Some(asked) = &request.reference else { return Ok(()) };
        let (scene, threads) = (&request.scene, request.host.threads);
        let reference = on_host_threads(threads, || asked.run(scene, self.receivers, progress))??;
        let error = reference.judge(asked.samples, &self.program.shadows.visibility);
        let truth: Vec<f32> = reference.truth.visibility().iter().map(|visible| *visible as f32).collect();
        self.frame.reference = Some(self.frame.spread(&prepared.input.receiver_pixel, &truth));
        self.judged = Some(Judged { error, seconds: reference.seconds, found: reference.found });
        Ok(())
    }

    /// The reports of a machine on which the phases cost this.
    fn on(
        &self,
        request: &RunRequest,
        machine: &Machine,
        phases: &[PhaseCosts],
        clock: HostClock,
    ) -> (RunReport, HostReport) {
        let RunRequest { host, warm_frames, .. } = request;
        let mut report = report(request, machine, self, phases);
        report.image.error = self.judged.as_ref().map(|judged| judged.error);
        let instructions: u64 = report.phases.iter().map(|phase| phase.instructions.total).sum();
        let host = HostReport {
            node: node(),
            seconds: clock.seconds,
            reference_seconds: self.judged.as_ref().map(|judged| judged.seconds),
            reference_found: self.judged.as_ref().map(|judged| judged.found),
            simulated_instructions_per_second: (instructions * (1 + u64::from(*warm_frames))) as f64
                / clock.simulation_seconds.max(1e-9),
            peak_rss_bytes: peak_rss_bytes(),
            host_threads: u32::try_from(host.threads).unwrap_or(u32::MAX),
            host_simd: host.simd.to_string(),
        };
        (report, host)
    }
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
struct Program {
    shadows: Shadows,
    /// What the method has against its own result.
    warnings: Vec<String>,
}

/// Runs the program of a frame in an arena of its own, its steps by `run_step`.
fn run_program(
    algorithm: &Algorithm,
    input: &mut ShadowInput,
    progress: &dyn Progress,
    mut run_step: impl FnMut(&'static Phase, &Step, &mut Arena) -> Result<(), BadInput>,
) -> Result<Program, BadInput> {
    let mut arena = Arena::reserve().map_err(no_memory)?;
    let mut refusal = None;
    let mut run_step = |phase: &'static Phase, step: &Step, arena: &mut Arena| {
        debug_assert!(algorithm.phases().contains(phase), "`{}` is no phase that studies may name", phase.id);
        let done = arena.check().map_err(no_memory).and_then(|()| {
            progress.step(phase.title, step.tasks());
            run_step(phase, step, arena)
        });
        done.map_err(|bad| {
            refusal = Some(bad);
            Stopped
        })
    };
    let mut runner = Runner::new(&mut arena, &mut run_step);
    let shadows = algorithm.run(input, &mut runner);
    let warnings = runner.warnings;
    match (shadows, refusal) {
        (Ok(shadows), None) => Ok(Program { shadows, warnings }),
        (_, Some(refusal)) => Err(refusal),
        (Err(stopped), None) => Err(BadInput::new(stopped.to_string())),
    }
}

/// Adds what a step of a phase cost to the row of the phase. A program may come back to one, as for each light of several.
fn add_cost(
    phases: &mut Vec<PhaseCosts>,
    (phase, step): (&'static Phase, &'static str),
    cost: StepReport,
    busy_cycles: Option<Vec<u64>>,
) {
    let row = phases.iter().position(|row| row.phase == phase).unwrap_or_else(|| {
        phases.push(PhaseCosts { phase, steps: Vec::new(), core_busy_cycles: None });
        phases.len() - 1
    });
    let row = &mut phases[row];
    row.steps.push((step, cost));
    if let Some(busy) = busy_cycles {
        let sums = row.core_busy_cycles.get_or_insert_with(|| vec![0; busy.len()]);
        sums.iter_mut().zip(busy).for_each(|(sum, cycles)| *sum += cycles);
    }
}

/// A host that is too small for the frame.
pub(crate) fn no_memory(error: ArenaError) -> BadInput {
    BadInput::new(error.to_string()).passing().with_help(
        "a smaller image or mesh needs less; so does a host that limits the address space less (`ulimit -v`)",
    )
}

fn report(request: &RunRequest, machine: &Machine, finished: &Finished, phases: &[PhaseCosts]) -> RunReport {
    let RunRequest { scene, fidelity, .. } = request;
    let Finished { program, receivers, frame, warnings, .. } = finished;
    let timed = fidelity.is_timed();
    // Kernels that look for no silhouettes, as for a point light, count none; the scene still has them.
    let silhouette_edges = program.shadows.silhouette_edges.unwrap_or_else(|| {
        silhouette_edges(&scene.mesh, &Adjacency::new(&scene.mesh), scene.light.center()) as u64
    });
    let clock = Clock { clock_ghz: machine.config.clock_ghz, cores: machine.config.cores };
    let phases = phase_reports(phases, timed.then_some(clock));
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
            receivers: *receivers as u64,
            width: frame.width,
            height: frame.height,
            light: serde_json::to_value(scene.light).expect("a light has string keys"),
        },
        machine: machine.config.clone(),
        total: Total::of_phases(&phases, clock.clock_ghz),
        phases,
        image: ImageSummary::of(&frame.visibility),
        model_error: crate::validate::model_error(),
        warnings: warnings.iter().cloned().chain(estimated(*fidelity)).collect(),
    }
}

/// What is to be known of times that are estimates.
fn estimated(fidelity: Fidelity) -> Option<Warning> {
    let message = "times are estimates from what limits each step: they rank machines and say what holds them back, and differ from simulated ones \
                   by tens of per cent; prefetcher, TLBs, ways of caches, rows and error correction of memory make no difference to them";
    (fidelity == Fidelity::Roofline)
        .then(|| Warning { kind: WarningKind::Estimate, message: message.to_owned() })
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
    pub(crate) fn new(size: ImageSize, pixels: &Pixels, cosine: &[f32], visibility: &[f32]) -> Frame {
        assert_eq!(visibility.len(), pixels.len(), "one visibility a receiver");
        let ImageSize { width, height } = size;
        let frame = Frame { width, height, visibility: Vec::new(), reference: None, cosine: Vec::new() };
        Frame { visibility: frame.spread(pixels, visibility), cosine: frame.spread(pixels, cosine), ..frame }
    }

    /// A value for each pixel from one for each receiver.
    fn spread(&self, pixels: &Pixels, of_receivers: &[f32]) -> Vec<f32> {
        let mut of_pixels = vec![NOTHING_HIT; self.width as usize * self.height as usize];
        for (pixel, value) in pixels.iter().zip(of_receivers) {
            of_pixels[pixel as usize] = *value;
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
