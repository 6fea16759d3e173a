//! What `sampled` gives up for its speed: its error against `windowed`, and whether the intervals that it states hold what is true,
//! over scenes, machines and seeds.
//!
//! ```text
//! cargo bench --bench sampled             # 160 cases: small pictures, machines of 4 to 24 cores; a word is part of the scene's name
//! cargo bench --bench sampled -- whole    # three scenes of the paper as they are, one seed each: minutes
//! ```

use lrbsim::progress::Quiet;
use lrbsim::{HostOptions, Machine, RunRequest, inputs, run_frame};
use lrbsim_machine::{Fidelity, Sampling};
use lrbsim_reports::run::RunReport;

type Error = Box<dyn std::error::Error>;

/// Scenes and the sizes of their pictures: so many tasks that most are left out.
const SCENES: [(&str, u32, u32); 8] = [
    ("saloon-small", 160, 120),
    ("palm", 160, 160),
    ("saloon-small", 320, 240),
    ("cornell", 320, 240),
    ("table", 320, 240),
    ("palm", 320, 320),
    ("street", 200, 150),
    ("saloon", 320, 240),
];

/// What of the machine is another.
const MACHINES: [&[&str]; 5] =
    [&["cores=4"], &["cores=8"], &["cores=8", "memory.bandwidth_gb_per_s=8"], &["cores=12"], &["cores=24"]];

const SEEDS: u32 = 4;

/// Half of an interval with 95 % confidence, in standard deviations.
const NORMAL_95: f64 = 1.96;

/// A phase counts from this share of the time on.
const SHARE: f64 = 0.1;

/// Times with their intervals beside what is true.
#[derive(Default)]
struct Held {
    count: u32,
    held: u32,
    worst: (f64, String),
    squares: f64,
    /// How many have intervals, and the sum of the squares of their errors, each as a multiple of the standard deviation stated.
    stated: (u32, f64),
}

impl Held {
    fn add(&mut self, name: &str, ms: f64, interval: Option<[f64; 2]>, exact: f64) {
        let [least, most] = interval.unwrap_or([ms; 2]);
        let error = ms / exact - 1.0;
        self.count += 1;
        let holds = (least..=most).contains(&exact);
        self.held += u32::from(holds);
        if !holds && interval.is_some() {
            println!(
                "{name}: {:+.2} %, of an interval of ± {:.2} %",
                100.0 * (ms / exact - 1.0),
                50.0 * (most - least) / exact
            );
        }
        self.squares += error * error;
        if most > ms {
            let deviations = NORMAL_95 * (exact - ms) / (most - ms);
            self.stated = (self.stated.0 + 1, self.stated.1 + deviations * deviations);
        }
        if error.abs() > self.worst.0.abs() {
            self.worst = (error, name.to_owned());
        }
    }

    fn print(&self, what: &str) {
        let rms = (self.squares / f64::from(self.count.max(1))).sqrt();
        println!(
            "{what}: {} of {} in their intervals, rms {:.2} % or {:.2} of what is stated, worst {:+.2} % ({})",
            self.held,
            self.count,
            100.0 * rms,
            (self.stated.1 / f64::from(self.stated.0.max(1))).sqrt(),
            100.0 * self.worst.0,
            self.worst.1
        );
    }
}

/// Adds the times of `sampled` to what is known of frames and of phases that matter.
fn add(name: &str, sampled: &RunReport, exact: &RunReport, [frames, phases, small]: &mut [Held; 3]) {
    let ms = |report: &RunReport| report.total.ms.expect("timed");
    frames.add(name, ms(sampled), sampled.total.ms_interval, ms(exact));
    for (phase, exact) in sampled.phases.iter().zip(&exact.phases) {
        let (ms, exact_ms) = (phase.ms.expect("timed"), exact.ms.expect("timed"));
        let of = if exact.share.is_some_and(|share| share > SHARE) { &mut *phases } else { &mut *small };
        of.add(&format!("{name}, {}", phase.id), ms, phase.ms_interval, exact_ms);
    }
}

fn main() -> Result<(), Error> {
    let is_whole = std::env::args().any(|argument| argument == "whole");
    let chip = Machine::load("larrabee-24", &[])?;
    let mut held = [Held::default(), Held::default(), Held::default()];
    let request = |scene, machine, fidelity| RunRequest {
        scene,
        machine,
        algorithm: "sism".parse().expect("it is one"),
        fidelity,
        warm_frames: 0,
        reference: None,
        host: HostOptions::default(),
    };
    let sampled = |seed| Fidelity::Sampled(Sampling { seed, ..Sampling::DEFAULT });
    // Seconds in the kernels and the model: what scene, eye view and pictures take is the same.
    let seconds = |output: &lrbsim::RunOutput| {
        let instructions: u64 = output.report.phases.iter().map(|phase| phase.instructions.total).sum();
        instructions as f64 / output.host.simulated_instructions_per_second
    };
    if is_whole {
        for name in ["saloon", "street", "fern"] {
            let scene = inputs::scene(name)?;
            let exact = run_frame(&request(scene.clone(), chip.clone(), Fidelity::Windowed), &Quiet)?;
            let untimed = run_frame(&request(scene.clone(), chip.clone(), Fidelity::Functional), &Quiet)?;
            let ranked = run_frame(&request(scene.clone(), chip.clone(), Fidelity::Roofline), &Quiet)?;
            let fast = run_frame(&request(scene, chip.clone(), sampled(0)), &Quiet)?;
            let mut of_scene = [Held::default(), Held::default(), Held::default()];
            add(name, &fast.report, &exact.report, &mut of_scene);
            let [of_windowed, of_sampled] = [&exact, &fast].map(seconds);
            println!(
                "{name}: windowed {of_windowed:.1} s, sampled {of_sampled:.1} s, {:.1} times",
                of_windowed / of_sampled
            );
            for held in of_scene.iter().zip(["  frame", "  phases of more than a tenth", "  other phases"]) {
                held.0.print(held.1);
            }
            println!("  functional {:.1} s, roofline {:.1} s", seconds(&untimed), seconds(&ranked));
            let mut of_scene = [Held::default(), Held::default(), Held::default()];
            add(name, &ranked.report, &exact.report, &mut of_scene);
            of_scene[0].print("  roofline, frame");
            of_scene[1].print("  roofline, phases of more than a tenth");
        }
        return Ok(());
    }
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    for (name, width, height) in SCENES.into_iter().filter(|(name, ..)| name.contains(&filter)) {
        let mut scene = inputs::scene(name)?;
        inputs::resize(&mut scene, width, height)?;
        for set in MACHINES {
            let settings = set.iter().map(|setting| setting.parse()).collect::<Result<Vec<_>, _>>()?;
            let machine = chip.with(&settings)?;
            let exact = run_frame(&request(scene.clone(), machine.clone(), Fidelity::Windowed), &Quiet)?;
            for seed in 0..SEEDS {
                let fast = run_frame(&request(scene.clone(), machine.clone(), sampled(seed)), &Quiet)?;
                let case = format!("{name} with {}, seed {seed}", set.join(", "));
                add(&case, &fast.report, &exact.report, &mut held);
            }
        }
    }
    let [frames, phases, small] = &held;
    frames.print("frames");
    phases.print("phases of more than a tenth");
    small.print("other phases");
    Ok(())
}
