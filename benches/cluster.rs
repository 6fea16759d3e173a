//! What a study on more than one machine costs besides its points: plan, claims and results of 10 000 points of about a
//! millisecond each, and the memory of who plans and gathers.
//!
//! ```text
//! cargo bench --bench cluster            10 000 points
//! cargo bench --bench cluster -- 500     as many as are named
//! ```
//!
//! Every process of the study runs here, one after the other, without a cluster; then, where Slurm can be had, once more on
//! one that this host plays, for the memory of who submits and watches. Ends with an error where the overhead is more than
//! 5 ms a point, or the submitter takes more than 500 MiB.

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
    let program = env!("CARGO_BIN_EXE_lrbsim");
    let mut export = Command::new(program);
    let plan = cost(
        export.args(["study", "export", "quick.json", "--yes"]).current_dir(folder.path()),
        std::fs::File::create(&list)?.into(),
    )?;
    println!("plan     {:7.1} s  {:6.0} MiB", plan.seconds, plan.peak_mib);
    let mut overhead = plan.seconds;
    for line in std::fs::read_to_string(&list)?.lines() {
        let worker = cost(Command::new("sh").args(["-c", &format!("exec {line}")]), Stdio::null())?;
        println!("worker   {:7.1} s  {:6.0} MiB", worker.seconds, worker.peak_mib);
        overhead += worker.seconds;
    }
    // All points are there: the submitter looks for each of them, asks no cluster, and gathers.
    let submit = ["study", "quick.json", "--engine", "slurm", "--yes"];
    let gather = cost(Command::new(program).args(submit).current_dir(folder.path()), Stdio::null())?;
    println!("gather   {:7.1} s  {:6.0} MiB", gather.seconds, gather.peak_mib);
    overhead += gather.seconds;

    let hosts = std::fs::File::open(folder.path().join("out/study-quick/host.json"))?;
    let hosts: Value = serde_json::from_reader(std::io::BufReader::new(hosts))?;
    let rows = hosts["points"].as_array().ok_or("no rows")?;
    assert_eq!(rows.len() as f64, count, "every point has a result");
    let inside: f64 = rows.iter().filter_map(|row| row["host"]["seconds"].as_f64()).sum();
    let per_point = (overhead - inside) / count * 1e3;
    println!("{count} points of {:.2} ms: {per_point:.2} ms overhead a point", inside / count * 1e3);
    let mut peak_mib = plan.peak_mib.max(gather.peak_mib);
    if let Some(cluster) = Cluster::start() {
        std::fs::remove_dir_all(folder.path().join("out"))?;
        let mut command = Command::new(program);
        command
            .args(submit)
            .current_dir(folder.path())
            .env("SLURM_CONF", cluster.0.path().join("slurm.conf"));
        let watch = cost(&mut command, Stdio::null())?;
        println!("cluster  {:7.1} s  {:6.0} MiB of the submitter", watch.seconds, watch.peak_mib);
        peak_mib = peak_mib.max(watch.peak_mib);
    } else {
        println!("no cluster starts here: who submits and watches is not measured");
    }
    if per_point > OVERHEAD_MS_MAX {
        return Err(format!("the overhead is more than {OVERHEAD_MS_MAX} ms a point").into());
    }
    if peak_mib > SUBMITTER_MIB_MAX {
        return Err(format!("the submitter takes more than {SUBMITTER_MIB_MAX} MiB").into());
    }
    Ok(())
}

/// A cluster that this host plays, by the script of the tests; gone when it is dropped.
struct Cluster(tempfile::TempDir);

impl Cluster {
    /// Starts the cluster; `None` where Slurm cannot be had.
    fn start() -> Option<Cluster> {
        // Names of sockets are short.
        let cluster = Cluster(tempfile::Builder::new().prefix("slb").tempdir_in("/tmp").ok()?);
        cluster.control("up").then_some(cluster)
    }

    fn control(&self, what: &str) -> bool {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/slurm-loopback.sh");
        let mut bash = Command::new("bash");
        bash.arg(script).arg(what).env("SLB_DIR", self.0.path()).env("SLB_NODES", "2");
        bash.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        bash.status().is_ok_and(|status| status.success())
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.control("down");
    }
}

/// What a command costs, with what it prints in `printed`.
fn cost(command: &mut Command, printed: Stdio) -> Result<Cost, Error> {
    let watch = Stopwatch::start();
    let mut child = command.stdout(printed).stderr(Stdio::null()).spawn()?;
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
        return Err(format!("{command:?} failed: {ended}").into());
    }
    Ok(Cost { seconds: watch.elapsed().as_secs_f64(), peak_mib })
}
