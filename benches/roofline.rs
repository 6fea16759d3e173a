//! Whether `roofline` puts machines in the order in which `windowed` does: rank correlation by phase, over machines drawn at random.
//!
//! ```text
//! cargo bench --bench roofline              # 40 machines, saloon-small at 200 by 150 pixels: half a minute
//! cargo bench --bench roofline -- 7 street  # those of another seed, on another scene
//! ```

use lrbsim::progress::Quiet;
use lrbsim::study::SplitMix;
use lrbsim::{HostOptions, Machine, RunRequest, Setting, inputs, run_frame};
use lrbsim_machine::Fidelity;
use lrbsim_reports::run::RunReport;

type Error = Box<dyn std::error::Error>;

/// Machines that are compared.
const MACHINES: usize = 40;

/// Draws by lot.
struct Random(SplitMix);

impl Random {
    /// A number between, in equal parts for each octave.
    fn octaves(&mut self, least: f64, most: f64) -> f64 {
        least * (most / least).powf(self.0.unit())
    }

    fn whole(&mut self, least: f64, most: f64) -> String {
        format!("{:.0}", self.octaves(least, most))
    }

    fn one_of(&mut self, values: &[&str]) -> String {
        values[(self.0.unit() * values.len() as f64) as usize].to_owned()
    }
}

/// A machine of which all that is likely to matter is drawn, each by itself.
fn draw(random: &mut Random) -> Vec<String> {
    let vector = random.whole(2.0, 8.0);
    let mut set = vec![
        format!("cores={}", random.whole(4.0, 64.0)),
        format!("threads_per_core={}", random.one_of(&["2", "3", "4"])),
        format!("core.dual_issue={}", random.one_of(&["true", "true", "false"])),
        format!("core.gather_lines_per_cycle={}", random.one_of(&["0.25", "0.5", "1.0", "2.0"])),
        format!("core.l1_accesses_per_cycle={}", random.one_of(&["1", "2"])),
        format!("core.latency_cycles.branch={}", random.whole(1.0, 5.0)),
        format!("l1d.capacity_bytes={}", random.one_of(&["16384", "32768", "65536"])),
        format!("l1d.mshrs={}", random.one_of(&["4", "8", "16"])),
        format!("l1d.hit_cycles={}", random.whole(2.0, 5.0)),
        format!("l2.capacity_bytes={}", random.one_of(&["65536", "131072", "262144", "524288"])),
        format!("l2.hit_cycles={}", random.whole(12.0, 40.0)),
        format!("ring.bytes_per_cycle={}", random.one_of(&["16", "32", "64"])),
        format!("ring.hop_cycles={}", random.one_of(&["1", "2"])),
        format!("directory.lookup_cycles={}", random.whole(10.0, 60.0)),
        format!("memory.controllers={}", random.one_of(&["2", "4", "8"])),
        format!("memory.bandwidth_gb_per_s={:.1}", random.octaves(10.0, 200.0)),
        format!("atomic.latency_cycles={}", random.whole(3.0, 20.0)),
    ];
    for class in ["alu", "mul", "fma", "math", "convert", "shuffle"] {
        set.push(format!("core.latency_cycles.vector_{class}={vector}"));
    }
    set
}

/// Spearman's rank correlation; ties count as half of either order.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let ranks = |values: &[f64]| -> Vec<f64> {
        let rank = |value: &f64| {
            let below = values.iter().filter(|other| *other < value).count();
            let equal = values.iter().filter(|other| *other == value).count();
            below as f64 + equal as f64 / 2.0
        };
        values.iter().map(rank).collect()
    };
    let (a, b) = (ranks(a), ranks(b));
    let mean = a.len() as f64 / 2.0;
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>();
    product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt()
}

fn main() -> Result<(), Error> {
    let given: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let seed: u64 = given.first().map_or(Ok(15), |seed| seed.parse())?;
    let name = given.get(1).map_or("saloon-small", String::as_str);
    let mut scene = inputs::scene(name)?;
    inputs::resize(&mut scene, 200, 150)?;
    let chip = Machine::load("larrabee-24", &[])?;
    let mut random = Random(SplitMix(seed));
    let mut reports: Vec<[RunReport; 2]> = Vec::new();
    for _ in 0..MACHINES {
        let set = draw(&mut random).iter().map(|text| text.parse()).collect::<Result<Vec<Setting>, _>>()?;
        let machine = chip.with(&set)?;
        let run = |fidelity| {
            let request = RunRequest {
                scene: scene.clone(),
                machine: machine.clone(),
                algorithm: "sism".parse().expect("it is one"),
                fidelity,
                warm_frames: 0,
                reference: None,
                host: HostOptions::default(),
            };
            run_frame(&request, &Quiet).map(|output| output.report)
        };
        reports.push([run(Fidelity::Roofline)?, run(Fidelity::Windowed)?]);
    }
    println!("{MACHINES} machines of seed {seed}, {name}");
    println!("{:12} {:>8} {:>10} {:>10} {:>10}  limits", "phase", "rank", "mean", "least", "most");
    for phase in 0..reports[0][0].phases.len() {
        let ms = |level: usize| -> Vec<f64> {
            reports.iter().map(|pair| pair[level].phases[phase].ms.expect("timed")).collect()
        };
        let (found, exact) = (ms(0), ms(1));
        let off: Vec<f64> = found.iter().zip(&exact).map(|(found, exact)| found / exact - 1.0).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let mut limits: Vec<&str> = reports
            .iter()
            .filter_map(|pair| pair[0].phases[phase].bounds.and_then(|bounds| bounds.greatest()))
            .collect();
        limits.sort_unstable();
        let counted: Vec<String> =
            limits.chunk_by(|a, b| a == b).map(|same| format!("{} {}", same[0], same.len())).collect();
        println!(
            "{:12} {:8.3} {:+9.1} % {:+8.1} % {:+8.1} %  {}",
            reports[0][0].phases[phase].id,
            rank_correlation(&found, &exact),
            100.0 * mean,
            100.0 * off.iter().copied().fold(f64::INFINITY, f64::min),
            100.0 * off.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            counted.join(", ")
        );
    }
    Ok(())
}
