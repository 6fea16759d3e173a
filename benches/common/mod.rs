//! What benches of host speed share: one phase of a frame, at every stage of its simulation.

use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use lrbsim_isa::program::{StepSource, TaskSource};
use lrbsim_isa::{Arena, HostSimd, OpCounts, Phase, Runner, Step, Stopped, Stream, run_functional};
use lrbsim_kernels::sism;
use lrbsim_machine::{Chip, Fidelity, MachineConfig, builtin_machine};
use lrbsim_workloads::{Adjacency, EyeView, ShadowInput, load_scene};

/// Anything that can go wrong in a bench.
pub type Error = Box<dyn std::error::Error>;

/// The machine that times.
pub const MACHINE: &str = "larrabee-24";

/// The phases that take longest.
pub const PHASES: [&str; 3] = ["grid", "raster", "soft"];

/// What is done with the tasks of the phase that is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    Functional,
    Emission,
    Windowed,
    Cycle,
}

impl Stage {
    /// All stages, each with the one before in it.
    pub const ALL: [Stage; 4] = [Stage::Functional, Stage::Emission, Stage::Windowed, Stage::Cycle];

    /// What the stage is called in tables.
    pub fn name(self) -> &'static str {
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
pub struct Cost {
    /// Uops that were measured.
    pub uops: u64,
    /// Wall-clock of the host.
    pub seconds: f64,
    /// Instructions of the host; `None` where there is no counter.
    pub instructions: Option<u64>,
}

impl Cost {
    fn add(&mut self, uops: u64, (seconds, instructions): (f64, Option<u64>)) {
        self.uops += uops;
        self.seconds += seconds;
        self.instructions = self.instructions.zip(instructions).map(|(sum, more)| sum + more);
    }
}

/// The clock, and the host's count of instructions if it has one.
pub struct Meter {
    #[cfg(target_os = "linux")]
    counter: Option<perf_event::Counter>,
}

impl Meter {
    /// A clock, with the counter if it counts.
    #[cfg(target_os = "linux")]
    pub fn new() -> Meter {
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

    /// A clock, with the counter if it counts.
    #[cfg(not(target_os = "linux"))]
    pub fn new() -> Meter {
        Meter {}
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
pub fn measure(
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
    let _ =
        sism::run(&mut input.clone(), sism::Overlap::Sum, &mut Runner::new(&mut Arena::new(), &mut run_step));
    if has_phase {
        return Ok(cost);
    }
    Err(format!("this frame has no phase `{phase}`").into())
}

/// What kernels are given of a shipped scene.
pub fn input(scene: &str) -> Result<ShadowInput, Error> {
    let scene = load_scene(scene, Path::new("."))?;
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height);
    Ok(ShadowInput::new(&scene, &adjacency, &eye))
}
