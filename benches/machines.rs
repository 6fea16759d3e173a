//! What one functional run for many machines saves: a study over eight machines against a run of each, on the same host threads.
//!
//! ```text
//! cargo bench --bench machines                         # saloon-small, windowed, two threads
//! cargo bench --bench machines -- saloon-small cycle 4 # scene, fidelity, threads
//! ```
//!
//! Ends with an error where a report differs.

use lrbsim::progress::{Quiet, Stopwatch};
use lrbsim::study::{Options, Study, run_study};
use lrbsim::{HostOptions, Machine, RunRequest, Setting, inputs, run_frame};
use lrbsim_reports::study::StudyReport;
use rayon::prelude::*;
use serde_json::{Value, json};

type Error = Box<dyn std::error::Error>;

/// Numbers of cores and bytes of the L2.
const MACHINES: ([u32; 4], [u64; 2]) = ([8, 16, 24, 32], [131_072, 262_144]);

fn main() -> Result<(), Error> {
    let given: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let word = |place: usize, default: &'static str| given.get(place).map_or(default, String::as_str);
    let (name, fidelity) = (word(0, "saloon-small"), word(1, "windowed"));
    let threads: usize = word(2, "2").parse()?;
    let folder = tempfile::tempdir()?;
    let study = json!({
        "name": "eight", "base": {"scene": name, "fidelity": fidelity},
        "axes": [{"path": "cores", "values": MACHINES.0}, {"path": "l2.capacity_bytes", "values": MACHINES.1}],
    });
    let study = Study::from_text("eight.json", &study.to_string(), None, false)?;
    let options = Options { cache: folder.path().to_owned(), jobs: threads };
    let watch = Stopwatch::start();
    let output = run_study(&study, &options, &Quiet)?;
    let together = watch.elapsed().as_secs_f64();
    let out = folder.path().join("out");
    output.write(&out)?;
    let study: StudyReport = serde_json::from_slice(&std::fs::read(out.join("study.json"))?)?;
    println!("{name}, {fidelity}, {threads} threads: eight machines by one study {together:.2} s");

    let chip = Machine::load("larrabee-24", &[])?;
    let request = |cores: u32, l2: u64, host: HostOptions| -> Result<RunRequest, Error> {
        let set: [Setting; 2] =
            [format!("cores={cores}").parse()?, format!("l2.capacity_bytes={l2}").parse()?];
        Ok(RunRequest {
            scene: inputs::scene(name)?,
            machine: chip.with(&set)?,
            algorithm: "sism".parse().expect("it is one"),
            fidelity: fidelity.parse()?,
            warm_frames: 0,
            reference: None,
            host,
        })
    };
    for (how, at_once) in [("one after the other", 1), ("as many at once as there are threads", threads)] {
        let host = HostOptions { threads: threads / at_once, ..HostOptions::default() };
        let mut requests = Vec::new();
        for cores in MACHINES.0 {
            for l2 in MACHINES.1 {
                requests.push((cores, l2, request(cores, l2, host)?));
            }
        }
        let pool = rayon::ThreadPoolBuilder::new().num_threads(at_once).build()?;
        let watch = Stopwatch::start();
        let run = |(cores, l2, request): &(u32, u64, RunRequest)| {
            let ran = run_frame(request, &Quiet).map(|output| output.report);
            ran.map(|report| ([Value::from(*cores), Value::from(*l2)], report))
        };
        let reports =
            pool.install(|| requests.par_iter().with_max_len(1).map(run).collect::<Result<Vec<_>, _>>())?;
        let apart = watch.elapsed().as_secs_f64();
        println!("  {how}: {apart:.2} s, {:.2} times as long", apart / together);
        for (values, mut report) in reports {
            report.machine.sources.clear();
            if study.at(&values) != Some(&report) {
                return Err(format!("{values:?} differs").into());
            }
        }
    }
    Ok(())
}
