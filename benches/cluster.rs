//! What a study on more than one machine costs besides its points: plan, claims and results of 10 000 points of about a
//! millisecond each, and the memory of who plans and gathers.
//!
//! ```text
//! cargo bench --bench cluster            10 000 points
//! cargo bench --bench cluster -- 500     as many as are named
//! ```
//!
//! Every process of the study runs here, one after the other; only the cluster is left out. Ends with an error where the
//! overhead is more than 5 ms a point, or the submitter takes more than 500 MiB.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use lrbsim::progress::Stopwatch;
use serde_json::{Value, json};

type Error = Box<dyn std::error::Error>;

const POINTS: u32 = 10_000;
const OVERHEAD_MS_MAX: f64 = 5.0;
const SUBMITTER_MIB_MAX: f64 = 500.0;

/// What a process took.
struct Cost {
    seconds: f64,
    peak_mib: f64,
}

fn main() -> Result<(), Error> {
    let number = std::env::args().skip(1).find_map(|word| word.parse().ok());
    let points: u32 = number.unwrap_or(POINTS);
    let folder = tempfile::tempdir()?;
    let rates: Vec<u32> = (10..10 + points.div_ceil(100)).collect();
    let latencies: Vec<u32> = (40..140).collect();
    let study = json!({
        "name": "quick",
        "base": {"scene": "tiny", "fidelity": "functional", "set": {"scene.image.width": 8, "scene.image.height": 8}},
        "axes": [{"path": "memory.bandwidth_gb_per_s", "values": rates}, {"path": "memory.latency_ns", "values": latencies}],
        "metric": "phases.soft.instructions.total",
    });
    std::fs::write(folder.path().join("quick.json"), study.to_string())?;
    let count = f64::from(points.div_ceil(100) * 100);

    let list = folder.path().join("commands");
    let plan = lrbsim(folder.path(), &["study", "export", "quick.json", "--yes"], Some(&list))?;
    println!("plan     {:7.1} s  {:6.0} MiB", plan.seconds, plan.peak_mib);
    let mut overhead = plan.seconds;
    for line in std::fs::read_to_string(&list)?.lines() {
        let words: Vec<&str> = line.split(' ').skip(1).collect();
        let worker = lrbsim(folder.path(), &words, None)?;
        println!("worker   {:7.1} s  {:6.0} MiB", worker.seconds, worker.peak_mib);
        overhead += worker.seconds;
    }
    // All points are there: the submitter looks for each of them, asks no cluster, and gathers.
    let gather = lrbsim(folder.path(), &["study", "quick.json", "--engine", "slurm", "--yes"], None)?;
    println!("gather   {:7.1} s  {:6.0} MiB", gather.seconds, gather.peak_mib);
    overhead += gather.seconds;

    let hosts = std::fs::File::open(folder.path().join("out/study-quick/host.json"))?;
    let hosts: Value = serde_json::from_reader(std::io::BufReader::new(hosts))?;
    let rows = hosts["points"].as_array().ok_or("no rows")?;
    assert_eq!(rows.len() as f64, count, "every point has a result");
    let inside: f64 = rows.iter().filter_map(|row| row["host"]["seconds"].as_f64()).sum();
    let per_point = (overhead - inside) / count * 1e3;
    println!("{count} points of {:.2} ms: {per_point:.2} ms overhead a point", inside / count * 1e3);
    if per_point > OVERHEAD_MS_MAX {
        return Err(format!("the overhead is more than {OVERHEAD_MS_MAX} ms a point").into());
    }
    if plan.peak_mib.max(gather.peak_mib) > SUBMITTER_MIB_MAX {
        return Err(format!("the submitter takes more than {SUBMITTER_MIB_MAX} MiB").into());
    }
    Ok(())
}

/// Runs `lrbsim` in `folder`, with what it prints in a file or nowhere.
fn lrbsim(folder: &Path, args: &[&str], printed: Option<&Path>) -> Result<Cost, Error> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lrbsim"));
    command.current_dir(folder).args(args).stderr(Stdio::null());
    command.stdout(match printed {
        Some(path) => std::fs::File::create(path)?.into(),
        None => Stdio::null(),
    });
    let watch = Stopwatch::start();
    let mut child = command.spawn()?;
    let status = format!("/proc/{}/status", child.id());
    let mut peak_mib = 0.0_f64;
    // The peak only grows, so that the last look before the end has it.
    let ended = loop {
        if let Some(ended) = child.try_wait()? {
            break ended;
        }
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok());
        peak_mib = peak_mib.max(kib.unwrap_or(0.0) / 1024.0);
        std::thread::sleep(Duration::from_millis(10));
    };
    if !ended.success() {
        return Err(format!("`lrbsim {}` failed: {ended}", args.join(" ")).into());
    }
    Ok(Cost { seconds: watch.elapsed().as_secs_f64(), peak_mib })
}
