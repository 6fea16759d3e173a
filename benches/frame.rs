//! Host speed of the phases that take longest, one host thread: simulated instructions a second, and host instructions
//! for each, at every stage of a timed frame. And what a second host thread gives: whole frames at `windowed`, phase by
//! phase.
//!
//! ```text
//! cargo bench --bench frame
//!
//! functional   computes, counts operations
//! emission     computes and records the streams, which are then dropped
//! windowed     emission, and larrabee-24 at `windowed`
//! cycle        emission, and larrabee-24 at `cycle`: the first tasks of each step only, the rest untimed
//! ```
//!
//! A word on the command line runs what has it in its name: `soft`, `soft/cycle`, `callgrind`,
//! `threads`, `threads/saloon`.
//!
//! Host instructions come from the hardware counter where the host has one that may be read. Elsewhere the bench starts
//! itself under `valgrind --tool=callgrind`: on AVX2, which is what valgrind knows, with the scene `tiny`, once as
//! measured and once without the phase in question; the difference over the uops is the figure.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use lrbsim::progress::{Progress, Stopwatch};
use lrbsim::{HostOptions, Machine, RunRequest, inputs, run_frame};
use lrbsim_isa::program::{StepSource, TaskSource};
use lrbsim_isa::{Arena, HostSimd, OpCounts, Phase, Runner, Step, Stopped, Stream, run_functional};
use lrbsim_kernels::sism;
use lrbsim_machine::{Chip, Fidelity, MachineConfig, builtin_machine};
use lrbsim_workloads::{Adjacency, EyeView, ShadowInput, load_scene};

type Error = Box<dyn std::error::Error>;

const MACHINE: &str = "larrabee-24";
const PHASES: [&str; 3] = ["grid", "raster", "soft"];

/// Scenes of the frames that are run on one and on two host threads, and the size of those that would take minutes.
const THREADED: [(&str, Option<(u32, u32)>); 2] = [("saloon", None), ("fern", Some((160, 120)))];
const HOST_THREADS: [usize; 2] = [1, 2];

/// Seconds that repeated frames on each number of host threads may take, and passes at most.
const THREADED_SECONDS: f64 = 30.0;
const THREADED_PASSES_MAX: usize = 5;

/// Uops that `cycle` times at most: a few seconds.
const CYCLE_UOPS_MAX: u64 = 8_000_000;

/// What is done with the tasks of the phase that is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Functional,
    Emission,
    Windowed,
    Cycle,
}

impl Stage {
    const ALL: [Stage; 4] = [Stage::Functional, Stage::Emission, Stage::Windowed, Stage::Cycle];

    fn name(self) -> &'static str {
        match self {
            Stage::Functional => "functional",
            Stage::Emission => "emission",
            Stage::Windowed => "windowed",
            Stage::Cycle => "cycle",
        }
    }
}

/// What one pass over a phase cost the host.
#[derive(Debug, Clone, Copy, Default)]
struct Cost {
    uops: u64,
    seconds: f64,
    /// `None` where there is no counter.
    instructions: Option<u64>,
}

impl Cost {
    fn add(&mut self, uops: u64, (seconds, instructions): (f64, Option<u64>)) {
        self.uops += uops;
        self.seconds += seconds;
        self.instructions = self.instructions.zip(instructions).map(|(sum, more)| sum + more);
    }
}

/// The clock, and the host's count of instructions if it has one.
struct Meter {
    #[cfg(target_os = "linux")]
    counter: Option<perf_event::Counter>,
}

impl Meter {
    #[cfg(target_os = "linux")]
    fn new() -> Meter {
        let instructions = perf_event::events::Hardware::INSTRUCTIONS;
        let mut counter = perf_event::Builder::new(instructions).build().ok();
        // Some virtual machines give a counter that never counts.
        let counts = counter.as_mut().is_some_and(|counter| {
            counter.enable().is_ok()
                && counter.disable().is_ok()
                && counter.read().is_ok_and(|count| count > 0)
        });
        Meter { counter: counter.filter(|_| counts) }
    }

    #[cfg(not(target_os = "linux"))]
    fn new() -> Meter {
        Meter {}
    }

    fn has_counter(&self) -> bool {
        #[cfg(target_os = "linux")]
        return self.counter.is_some();
        #[cfg(not(target_os = "linux"))]
        return false;
    }

    /// Runs `work`; its seconds and host instructions.
    #[expect(
        clippy::disallowed_methods,
        reason = "a benchmark reads the clock; no simulated result depends on it"
    )]
    fn measure(&mut self, work: impl FnOnce()) -> (f64, Option<u64>) {
        #[cfg(target_os = "linux")]
        if let Some(counter) = &mut self.counter {
            let begun = counter.reset().and_then(|()| counter.enable());
            let start = std::time::Instant::now();
            work();
            let seconds = start.elapsed().as_secs_f64();
            let count = begun.and_then(|()| counter.disable()).and_then(|()| counter.read());
            return (seconds, count.ok());
        }
        let start = std::time::Instant::now();
        work();
        (start.elapsed().as_secs_f64(), None)
    }
}

/// The first tasks of a step, and the uops they were recorded as.
struct FirstTasks<'a> {
    inner: StepSource<'a>,
    tasks: u32,
    uops: AtomicU64,
}

impl TaskSource for FirstTasks<'_> {
    fn name(&self) -> &str {
        self.inner.name()
    }

    fn tasks(&self) -> u32 {
        self.tasks
    }

    fn is_ordered(&self) -> bool {
        self.inner.is_ordered()
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        self.inner.record(task, stream);
        self.uops.fetch_add(stream.uops.len() as u64, Relaxed);
    }

    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
        self.inner.skip(tasks, counts);
    }
}

/// Takes a frame up to `phase` functionally and measures that phase at `stage`, or not at all.
///
/// `of_tasks`: the part of the tasks of each step that is measured.
fn measure(
    input: &ShadowInput,
    (phase, stage, simd): (&str, Option<Stage>, HostSimd),
    of_tasks: f64,
    meter: &mut Meter,
) -> Result<Cost, Error> {
    let text = builtin_machine(MACHINE).ok_or("the machine is not shipped")?;
    let spec = serde_json::from_str::<MachineConfig>(text)?.validate()?;
    // Both always, so that they are no part of a difference.
    let mut chips = [Chip::new(&spec, Fidelity::Windowed, 1), Chip::new(&spec, Fidelity::Cycle, 1)];
    let mut cost = Cost { instructions: Some(0), ..Cost::default() };
    let mut stream = Stream::default();
    let mut has_phase = false;
    let mut run_step = |at: &'static Phase, step: &Step, arena: &mut Arena| {
        if at.id != phase && has_phase {
            return Err(Stopped);
        }
        has_phase |= at.id == phase;
        let Some(stage) = stage.filter(|_| has_phase) else {
            if has_phase {
                return Err(Stopped);
            }
            run_functional(step, arena, simd, 1);
            return Ok(());
        };
        let tasks = (f64::from(step.tasks()) * of_tasks).ceil() as u32;
        let inner = StepSource::new(step, arena, simd, 1);
        let source = FirstTasks { inner, tasks, uops: AtomicU64::new(0) };
        let mut counts = OpCounts::default();
        let spent = meter.measure(|| match stage {
            Stage::Functional => source.inner.skip(0..tasks, &mut counts),
            Stage::Emission => (0..tasks).for_each(|task| source.record(task, &mut stream)),
            Stage::Windowed => drop(chips[0].run_step(&source)),
            Stage::Cycle => drop(chips[1].run_step(&source)),
        });
        cost.add(source.uops.load(Relaxed) + counts.total(), spent);
        source.inner.skip(tasks..step.tasks(), &mut counts);
        Ok(())
    };
    // Stopped after the phase, unless it is the last.
    let _ = sism::run(input, sism::Overlap::Sum, &mut Runner::new(&mut Arena::new(), &mut run_step));
    if has_phase {
        return Ok(cost);
    }
    Err(format!("this frame has no phase `{phase}`").into())
}

fn input(scene: &str) -> Result<ShadowInput, Error> {
    let scene = load_scene(scene, Path::new("."))?;
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height);
    Ok(ShadowInput::new(&scene, &adjacency, &eye))
}

/// The part of a pass under callgrind: `STAGE PHASE`, `none` for the pass that leaves the phase out.
const UNDER_CALLGRIND: &str = "LRBSIM_BENCH_UNDER_CALLGRIND";

/// Runs this bench once under callgrind; the uops that it measured and all host instructions of the process.
fn callgrind(stage: &str, phase: &str) -> Result<(u64, u64), Error> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(std::env::current_exe()?)
        .env(UNDER_CALLGRIND, format!("{stage} {phase}"))
        .output()?;
    let number_after = |text: &[u8], label: &str| -> Option<u64> {
        let text = String::from_utf8_lossy(text).into_owned();
        let (_, rest) = text.split_once(label)?;
        rest.trim_start_matches([' ', ':']).split_whitespace().next()?.parse().ok()
    };
    number_after(&output.stdout, "uops")
        .zip(number_after(&output.stderr, "Collected"))
        .ok_or_else(|| String::from_utf8_lossy(&output.stderr).into_owned().into())
}

/// The other side of [`callgrind`].
fn under_callgrind(arguments: &str) -> Result<(), Error> {
    let (stage, phase) = arguments.split_once(' ').ok_or("STAGE PHASE")?;
    let stage = Stage::ALL.into_iter().find(|known| known.name() == stage);
    let cost = measure(&input("tiny")?, (phase, stage, HostSimd::Avx2), 1.0, &mut Meter::new())?;
    println!("uops {}", cost.uops);
    Ok(())
}

fn host_instructions_by_callgrind(phases: &[&str]) -> Result<(), Error> {
    println!("host instructions: no hardware counter here; callgrind, avx2 lanes, scene tiny, whole phase");
    for phase in phases {
        let (_, without) = callgrind("none", phase)?;
        for stage in Stage::ALL {
            let (uops, with) = callgrind(stage.name(), phase)?;
            let each = with.saturating_sub(without) as f64 / uops as f64;
            println!("{phase:6} {:12} {uops:>12} uops {each:>10.1} host instructions/uop", stage.name());
        }
    }
    Ok(())
}

/// Adds up the seconds of the host in the steps of each phase, without what lies between the steps.
#[derive(Default)]
struct PhaseClock(Mutex<Running>);

#[derive(Default)]
struct Running {
    /// Title of the phase, and when its step began.
    step: Option<(String, Stopwatch)>,
    seconds: BTreeMap<String, f64>,
}

impl Progress for PhaseClock {
    fn step(&self, title: &str, _tasks: u32) {
        self.0.lock().expect("nobody panics with it").step = Some((title.to_owned(), Stopwatch::start()));
    }

    fn uops(&self, _uops: u64) {
        let mut running = self.0.lock().expect("nobody panics with it");
        if let Some((title, watch)) = running.step.take() {
            *running.seconds.entry(title).or_default() += watch.elapsed().as_secs_f64();
        }
    }
}

/// Seconds of the host by id of phase, and of the whole frame as `frame`.
fn seconds_of_frame(request: &RunRequest) -> Result<BTreeMap<String, f64>, Error> {
    let clock = PhaseClock::default();
    let output = run_frame(request, &clock)?;
    let running = clock.0.into_inner()?;
    let by_id = output.report.phases.iter().filter_map(|phase| {
        let seconds = running.seconds.get(&phase.title)?;
        Some((phase.id.clone(), *seconds))
    });
    Ok(by_id.chain([("frame".to_owned(), output.host.seconds)]).collect())
}

/// One frame on each of [`HOST_THREADS`]: seconds of the phases, and how many times faster the last is than the first.
fn host_threads(scene_name: &str, size: Option<(u32, u32)>) -> Result<(), Error> {
    let mut scene = inputs::scene(scene_name)?;
    if let Some((width, height)) = size {
        inputs::resize(&mut scene, width, height)?;
    }
    let (width, height) = (scene.image.width, scene.image.height);
    let mut request = RunRequest {
        scene,
        machine: Machine::load(MACHINE, &[])?,
        algorithm: "sism:overlap=sum".parse().expect("it is one"),
        fidelity: Fidelity::Windowed,
        warm_frames: 0,
        reference: None,
        host: HostOptions::default(),
    };
    // Turn and turn about, so that what else runs on the host meets all alike; of each phase the best.
    let mut best = HOST_THREADS.map(|_| BTreeMap::<String, f64>::new());
    let (mut pass, mut passes) = (0, 1);
    while pass < passes {
        for (threads, best) in HOST_THREADS.into_iter().zip(&mut best) {
            request.host.threads = threads;
            let seconds = seconds_of_frame(&request)?;
            if pass == 0 && threads == 1 {
                passes = ((THREADED_SECONDS / seconds["frame"]) as usize).clamp(1, THREADED_PASSES_MAX);
            }
            for (id, seconds) in seconds {
                best.entry(id).and_modify(|least| *least = least.min(seconds)).or_insert(seconds);
            }
        }
        pass += 1;
    }
    println!("host threads: scene {scene_name} at {width} x {height}, {MACHINE}, windowed, best of {passes}");
    for id in PHASES.into_iter().chain(["frame"]) {
        let [one, two] = [&best[0], &best[1]].map(|seconds| seconds.get(id).copied().unwrap_or(f64::NAN));
        let [few, many] = HOST_THREADS;
        println!(
            "{id:6} {few} thread {one:>8.3} s   {many} threads {two:>8.3} s   {:>5.2} times as fast",
            one / two
        );
    }
    Ok(())
}

fn main() -> Result<(), Error> {
    if let Ok(arguments) = std::env::var(UNDER_CALLGRIND) {
        return under_callgrind(&arguments);
    }
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let simd = HostSimd::detect();
    let mut meter = Meter::new();
    let input = input("saloon-small")?;
    println!("speed: scene saloon-small, {MACHINE}, {simd} lanes, one host thread, wall clock");
    for phase in PHASES {
        let stages = || Stage::ALL.into_iter().filter(|s| format!("{phase}/{}", s.name()).contains(&filter));
        if stages().next().is_none() {
            continue;
        }
        let all = measure(&input, (phase, Some(Stage::Functional), simd), 1.0, &mut meter)?;
        for stage in stages() {
            // The best of several where they are short: everything else that runs on the host only ever adds time.
            let (of_tasks, passes) = match stage {
                Stage::Functional | Stage::Emission | Stage::Windowed => (1.0, 5),
                Stage::Cycle => ((CYCLE_UOPS_MAX as f64 / all.uops as f64).min(1.0), 1),
            };
            let mut best = measure(&input, (phase, Some(stage), simd), of_tasks, &mut meter)?;
            for _ in 1..passes {
                let cost = measure(&input, (phase, Some(stage), simd), of_tasks, &mut meter)?;
                best = if cost.seconds < best.seconds { cost } else { best };
            }
            let speed = best.uops as f64 / best.seconds * 1e-6;
            print!("{phase:6} {:12} {:>12} uops {speed:>10.1} M/s", stage.name(), best.uops);
            match best.instructions {
                Some(count) => {
                    println!(" {:>10.1} host instructions/uop (counter)", count as f64 / best.uops as f64);
                }
                None => println!(),
            }
        }
    }
    for (scene, size) in THREADED {
        if format!("threads/{scene}").contains(&filter) {
            host_threads(scene, size)?;
        }
    }
    let phases: Vec<&str> =
        PHASES.into_iter().filter(|phase| format!("callgrind/{phase}").contains(&filter)).collect();
    if !meter.has_counter() && !phases.is_empty() {
        let avx2 = HostSimd::Avx2.is_available();
        let valgrind =
            Command::new("valgrind").arg("--version").output().is_ok_and(|run| run.status.success());
        if avx2 && valgrind {
            host_instructions_by_callgrind(&phases)?;
        } else {
            println!("host instructions: not measured: no hardware counters, no valgrind");
        }
    }
    Ok(())
}
