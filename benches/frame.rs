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
//! A word on the command line runs what has it in its name: `soft`, `soft/cycle`, `threads`, `threads/saloon`.
//!
//! Host instructions come from the hardware counter where the host has one that may be read; elsewhere the bench
//! `host_instructions` has them.

mod common;

use std::collections::BTreeMap;
use std::sync::Mutex;

use common::{Error, MACHINE, Meter, PHASES, Stage, input, measure};
use lrbsim::progress::{Progress, Stopwatch};
use lrbsim::{HostOptions, Machine, RunRequest, inputs, run_frame};
use lrbsim_isa::HostSimd;
use lrbsim_machine::Fidelity;

/// Scenes of the frames that are run on one and on two host threads, and the size of those that would take minutes.
const THREADED: [(&str, Option<(u32, u32)>); 2] = [("saloon", None), ("fern", Some((160, 120)))];
const HOST_THREADS: [usize; 2] = [1, 2];

/// Seconds that repeated frames on each number of host threads may take, and passes at most.
const THREADED_SECONDS: f64 = 30.0;
const THREADED_PASSES_MAX: usize = 5;

/// Uops that `cycle` times at most: a few seconds.
const CYCLE_UOPS_MAX: u64 = 8_000_000;

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
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let simd = HostSimd::detect();
    let (mut meter, mut is_counted) = (Meter::new(), true);
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
                None => {
                    println!();
                    is_counted = false;
                }
            }
        }
    }
    for (scene, size) in THREADED {
        if format!("threads/{scene}").contains(&filter) {
            host_threads(scene, size)?;
        }
    }
    if !is_counted {
        println!(
            "host instructions: no hardware counter here; `cargo bench --bench host_instructions` counts them"
        );
    }
    Ok(())
}
