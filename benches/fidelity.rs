//! What `windowed` gives up for its speed: its error against `cycle` in every phase that takes 5 % of the time, over
//! scenes and numbers of cores: of small scenes many, of the four scenes of the paper a few, in small pictures.
//!
//! ```text
//! cargo bench --bench fidelity
//! ```
//!
//! Many of these phases are short, and a few last as long as their longest task: which core takes it, and what its
//! neighbors do to its lines meanwhile, decides by per cents. So the same is measured for `cycle` against itself with
//! memory one cycle slower: what no model of this chip can be held to. The large scenes leave that out, for their time.
//!
//! A word on the command line runs the scenes whose name contains it.

use lrbsim::inputs;
use lrbsim::progress::Quiet;
use lrbsim::{HostOptions, Machine, RunRequest, run_frame};
use lrbsim_machine::Fidelity;
use lrbsim_reports::run::RunReport;

type Error = Box<dyn std::error::Error>;

/// Numbers of cores.
const CORES: [u32; 17] = [4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30, 32, 40, 48];

/// Numbers of cores for a scene that takes longer.
const CORES_FEW: [u32; 6] = [8, 16, 20, 24, 28, 32];

/// Numbers of cores for the scenes of the paper.
const CORES_PAPER: [u32; 3] = [8, 24, 32];

/// A scene, and how it is measured.
struct Subject {
    scene: &'static str,
    /// Columns and rows of the picture; `None` for those of the scene.
    size: Option<(u32, u32)>,
    cores: &'static [u32],
    /// Whether it is also run with memory one cycle slower.
    is_slowed: bool,
}

/// The paper's scenes are drawn so small that the work per triangle, which no picture makes smaller, is about half of
/// it.
const SUBJECTS: [Subject; 7] = [
    Subject { scene: "tiny", size: None, cores: &CORES, is_slowed: true },
    Subject { scene: "table", size: None, cores: &CORES, is_slowed: true },
    Subject { scene: "saloon-small", size: Some((160, 120)), cores: &CORES_FEW, is_slowed: true },
    Subject { scene: "palm", size: Some((160, 160)), cores: &CORES_PAPER, is_slowed: false },
    Subject { scene: "fern", size: Some((64, 48)), cores: &CORES_PAPER, is_slowed: false },
    Subject { scene: "street", size: Some((80, 60)), cores: &CORES_PAPER, is_slowed: false },
    Subject { scene: "saloon", size: Some((160, 120)), cores: &CORES_PAPER, is_slowed: false },
];

/// A phase counts from this share of the time on.
const SHARE: f64 = 0.05;

/// Relative differences of phases, in per cent, with what they are of.
#[derive(Clone, Default)]
struct Differences(Vec<(f64, String)>);

impl Differences {
    fn add(&mut self, name: &str, of: &RunReport, against: &RunReport) {
        for (phase, exact) in of.phases.iter().zip(&against.phases) {
            let (Some(cycles), Some(exact_cycles)) = (phase.cycles, exact.cycles) else { continue };
            if exact.share.is_some_and(|share| share > SHARE) {
                let difference = 100.0 * (cycles as f64 / exact_cycles as f64 - 1.0);
                self.0.push((difference, format!("{name}, {}", phase.id)));
            }
        }
    }

    /// Prints the figures in one line, and below them the `worst` largest differences.
    fn print(mut self, title: &str, worst: usize) {
        if self.0.is_empty() {
            println!("{title}: no phases");
            return;
        }
        self.0.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let count = self.0.len() as f64;
        let mean = self.0.iter().map(|(difference, _)| difference).sum::<f64>() / count;
        let rms = (self.0.iter().map(|(difference, _)| difference * difference).sum::<f64>() / count).sqrt();
        let of_all = |part: f64| self.0[((1.0 - part) * count) as usize].0.abs();
        println!(
            "{title}: {count} phases, mean {mean:+.2} %, median of sizes {:.2} %, nine in ten below {:.2} %, \
             worst {:.2} %, rms {rms:.2} %",
            of_all(0.5),
            of_all(0.9),
            self.0[0].0.abs()
        );
        for (difference, name) in &self.0[..self.0.len().min(worst)] {
            println!("    {difference:+7.2} %  {name}");
        }
    }
}

fn main() -> Result<(), Error> {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    let chip = Machine::load("larrabee-24", &[])?;
    // One cycle, in nanoseconds, added to both latencies of memory.
    let cycle_ns = 1.0 / chip.config.clock_ghz;
    let memory = &chip.config.memory;
    let slower = [
        format!("memory.latency_ns={}", memory.latency_ns + cycle_ns).parse()?,
        format!("memory.row_hit_latency_ns={}", memory.row_hit_latency_ns + cycle_ns).parse()?,
    ];
    let (mut windowed, mut slowed) = (Differences::default(), Differences::default());
    let mut seconds = [0.0; 2];
    for Subject { scene: scene_name, size, cores, is_slowed } in SUBJECTS {
        if !scene_name.contains(&filter) {
            continue;
        }
        let mut scene = inputs::scene(scene_name)?;
        let mut title = scene_name.to_owned();
        if let Some((width, height)) = size {
            inputs::resize(&mut scene, width, height)?;
            title = format!("{scene_name} at {width} x {height}");
        }
        let mut of_scene = Differences::default();
        for cores in cores {
            let machine = chip.with(&[format!("cores={cores}").parse()?])?;
            let mut request = RunRequest {
                scene: scene.clone(),
                machine: machine.clone(),
                algorithm: "sism:overlap=sum".parse().expect("it is one"),
                fidelity: Fidelity::Cycle,
                warm_frames: 0,
                reference: None,
                host: HostOptions::default(),
            };
            let name = format!("{scene_name} on {cores} cores");
            let cycle = run_frame(&request, &Quiet)?;
            if is_slowed {
                request.machine = machine.with(&slower)?;
                slowed.add(&name, &run_frame(&request, &Quiet)?.report, &cycle.report);
                request.machine = machine;
            }
            request.fidelity = Fidelity::Windowed;
            let fast = run_frame(&request, &Quiet)?;
            of_scene.add(&name, &fast.report, &cycle.report);
            seconds[0] += fast.host.seconds;
            seconds[1] += cycle.host.seconds;
        }
        windowed.0.extend(of_scene.clone().0);
        of_scene.print(&title, 1);
    }
    windowed.print("windowed against cycle", 5);
    slowed.print("cycle with memory one cycle slower, against cycle", 5);
    println!("host seconds of these: windowed {:.1}, cycle {:.1}", seconds[0], seconds[1]);
    Ok(())
}
