//! What `windowed` gives up for its speed: its error against `cycle` in every phase that takes 5 % of the time, over scenes
//! and numbers of cores.
//!
//! ```text
//! cargo bench --bench fidelity
//! ```
//!
//! Many of these phases are short, and a few last as long as their longest task: which core takes it, and what its
//! neighbors do to its lines meanwhile, decides by per cents. So the same is measured for `cycle` against itself with
//! memory one cycle slower: what no model of this chip can be held to.

use lrbsim::inputs;
use lrbsim::progress::Quiet;
use lrbsim::{Algorithm, HostOptions, Machine, RunRequest, run_frame};
use lrbsim_machine::Fidelity;
use lrbsim_reports::run::RunReport;

type Error = Box<dyn std::error::Error>;

/// Numbers of cores.
const CORES: [u32; 17] = [4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30, 32, 40, 48];

/// Numbers of cores for the scene that takes longest.
const CORES_FEW: [u32; 6] = [8, 16, 20, 24, 28, 32];

/// Scenes, and the size that the largest is drawn with.
const SCENES: [&str; 3] = ["tiny", "table", "saloon-small"];
const SIZE: (u32, u32) = (160, 120);

/// A phase counts from this share of the time on.
const SHARE: f64 = 0.05;

/// Relative differences of phases, in per cent, with what they are of.
#[derive(Default)]
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

    fn print(mut self, title: &str) {
        self.0.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let count = self.0.len() as f64;
        let mean = self.0.iter().map(|(difference, _)| difference).sum::<f64>() / count;
        let rms = (self.0.iter().map(|(difference, _)| difference * difference).sum::<f64>() / count).sqrt();
        let of_all = |part: f64| self.0[((1.0 - part) * count) as usize].0.abs();
        println!(
            "{title}: {count} phases, mean {mean:+.2} %, median of sizes {:.2} %, nine in ten below {:.2} %, rms {rms:.2} %",
            of_all(0.5),
            of_all(0.9)
        );
        for (difference, name) in &self.0[..self.0.len().min(5)] {
            println!("    {difference:+7.2} %  {name}");
        }
    }
}

fn main() -> Result<(), Error> {
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
    for scene_name in SCENES {
        let mut scene = inputs::scene(scene_name)?;
        let mut numbers_of_cores = &CORES[..];
        if scene_name == "saloon-small" {
            inputs::resize(&mut scene, SIZE.0, SIZE.1)?;
            numbers_of_cores = &CORES_FEW;
        }
        for cores in numbers_of_cores {
            let machine = chip.with(&[format!("cores={cores}").parse()?])?;
            let mut request = RunRequest {
                scene: scene.clone(),
                machine: machine.clone(),
                algorithm: Algorithm::Sism,
                fidelity: Fidelity::Cycle,
                warm_frames: 0,
                host: HostOptions::default(),
            };
            let cycle = run_frame(&request, &Quiet)?;
            request.machine = machine.with(&slower)?;
            let perturbed = run_frame(&request, &Quiet)?;
            (request.machine, request.fidelity) = (machine, Fidelity::Windowed);
            let fast = run_frame(&request, &Quiet)?;
            let name = format!("{scene_name} on {cores} cores");
            windowed.add(&name, &fast.report, &cycle.report);
            slowed.add(&name, &perturbed.report, &cycle.report);
            seconds[0] += fast.host.seconds;
            seconds[1] += cycle.host.seconds;
        }
    }
    windowed.print("windowed against cycle");
    slowed.print("cycle with memory one cycle slower, against cycle");
    println!("host seconds: windowed {:.1}, cycle {:.1}", seconds[0], seconds[1]);
    Ok(())
}
