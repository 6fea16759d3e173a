//! Studies on more than one machine: nothing finished is lost and nothing half-written is read, whatever dies.
//!
//! What needs Slurm, or a disk that is full, says aloud that it is skipped where these cannot be had.

#![cfg(unix)]

mod common;

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, SystemTime};

use common::{Folder, lrbsim, names};
use lrbsim::progress::Stopwatch;
use serde_json::Value;

/// A study of `cores` x `hops` points that take a hundredth of a second each, or with `cycle` a fifth.
fn study(name: &str, fidelity: &str, cores: u32, hops: u32) -> String {
    let cores: Vec<u32> = (1..=cores).collect();
    let hops: Vec<u32> = (1..=hops).collect();
    serde_json::json!({"name": name, "base": {"scene": "tiny", "fidelity": fidelity},
        "axes": [{"path": "cores", "values": cores}, {"path": "ring.hop_cycles", "values": hops}],
        "metric": "phases.soft.instructions.total"})
    .to_string()
}

/// Says what is not tested here. Written past the test harness, which keeps what passing tests print to itself.
fn say_aloud(text: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {text}");
}

/// Finished points of a cache with the moments when they were written. Each must be whole, at any time.
fn finished(cache: &Path) -> BTreeMap<String, SystemTime> {
    let mut points = BTreeMap::new();
    for group in cache.read_dir().into_iter().flatten().flatten() {
        for name in names(&group.path()).iter().filter(|name| name.ends_with(".json")) {
            let path = group.path().join(name);
            let text = std::fs::read_to_string(&path).expect("a finished point stays");
            let entry: Value = serde_json::from_str(&text).unwrap_or_else(|_| panic!("{name} is not whole"));
            assert_eq!(format!("{}.json", entry["key"].as_str().expect("a key")), *name);
            let written = path.metadata().and_then(|meta| meta.modified()).expect("the host keeps times");
            points.insert(name.clone(), written);
        }
    }
    points
}

/// Demands that what was finished still is what it was.
#[track_caller]
fn kept(before: &BTreeMap<String, SystemTime>, now: &BTreeMap<String, SystemTime>) {
    for (name, written) in before {
        assert_eq!(now.get(name), Some(written), "{name} was lost, or computed twice");
    }
}

/// The results of a study but for what its hosts were.
fn results(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let of_study = |name: &String| !["host.json", "SHA256SUMS"].contains(&name.as_str());
    let read = |name: String| {
        let bytes = std::fs::read(folder.join(&name)).expect("readable");
        (name, bytes)
    };
    names(folder).into_iter().filter(of_study).map(read).collect()
}

/// The results of a study that ran here, undisturbed.
fn local(file: &str, text: &str) -> BTreeMap<String, Vec<u8>> {
    let folder = Folder::new();
    folder.write(file, text);
    folder.run(&["study", file, "-o", "here"]).ok();
    results(&folder.path("here"))
}

/// The commands that `lrbsim study export` lists.
fn export(folder: &Folder, args: &[&str]) -> Vec<String> {
    let done = folder.run(&[&["study", "export"], args].concat());
    assert_eq!(done.code(), Some(0), "{}", done.stderr());
    assert!(done.stderr().contains("run these commands anywhere"), "{}", done.stderr());
    done.stdout().lines().map(str::to_owned).collect()
}

/// A shell for one line.
fn shell(folder: &Folder, line: &str) -> Command {
    let mut command = Command::new("sh");
    command.current_dir(folder.path("")).args(["-c", line]).env("NO_COLOR", "1");
    command
}

/// How a process ends and what it has said. One that does not end is ended: the test then fails by what it says.
fn wait(child: Child) -> (Option<i32>, String) {
    let (process, (told, heard)) = (child.id(), std::sync::mpsc::channel::<()>());
    std::thread::spawn(move || {
        if heard.recv_timeout(Duration::from_secs(150)) == Err(RecvTimeoutError::Timeout) {
            signal("KILL", process);
        }
    });
    let output = child.wait_with_output().expect("it ends");
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    drop(told);
    (output.status.code(), said.concat())
}

#[test]
fn exported_commands_compute_a_study_that_is_gathered_as_if_it_ran_here() {
    let text = study("few", "functional", 4, 3);
    let folder = Folder::new();
    folder.write("few.json", &text);
    let commands = export(&folder, &["few.json", "--shards", "3"]);
    assert_eq!(commands.len(), 3);
    // From another folder, and twice: what is done is found.
    for (line, run) in commands.iter().zip([4, 4, 4]).chain([(&commands[0], 0)]) {
        let output = shell(&folder, &format!("cd / && {line}")).output().expect("a shell");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains(&format!("4 points: {run} run, ")), "{said}");
    }
    assert!(export(&folder, &["few.json"]).is_empty(), "no shard misses a point");
    let printed = folder.run(&["study", "few.json", "-o", "there"]).ok().stdout();
    assert!(printed.contains("12 points: 0 run, 12 found"), "{printed}");
    assert_eq!(results(&folder.path("there")), local("few.json", &text));
    let hosts: Value =
        serde_json::from_slice(&std::fs::read(folder.path("there/host.json")).expect("there")).expect("JSON");
    let hosts = hosts["points"].as_array().expect("a row for each point");
    assert!(hosts.len() == 12 && hosts.iter().all(|row| row["host"]["node"] != ""), "{hosts:?}");
}

#[test]
fn a_plan_is_refused_where_it_would_mix_results() {
    let folder = Folder::new();
    folder.write("machine.json", &folder.run(&["machine", "show", "larrabee-24"]).ok().stdout());
    let text = study("mix", "functional", 2, 2).replace("\"tiny\"", "\"tiny\",\"machine\":\"machine.json\"");
    folder.write("mix.json", &text);
    let line = export(&folder, &["mix.json"]).remove(0);
    let plan = folder.path("out").join(&names(&folder.path("out"))[1]);
    let plan = plan.to_str().expect("UTF-8");
    let worker = |args: &[&str]| folder.run(&[&["study-worker", "--plan", plan], args].concat());

    // Another build: the same program with a byte more.
    let program = folder.path("lrbsim");
    std::fs::copy(env!("CARGO_BIN_EXE_lrbsim"), &program).expect("writable");
    let mut file = std::fs::OpenOptions::new().append(true).open(&program).expect("writable");
    file.write_all(b"\n").expect("writable");
    drop(file);
    let line = line.replace(env!("CARGO_BIN_EXE_lrbsim"), program.to_str().expect("UTF-8"));
    let (code, said) = wait(shell(&folder, &line).stderr(Stdio::piped()).spawn().expect("a shell"));
    assert!(code == Some(2) && said.contains("different builds are never mixed"), "{said}");

    worker(&["--shard", "1"]).refused(&["`--shard` is 1", "shards 0 to 0"]);
    worker(&["--shard", "0", "--threads", "0"]).refused(&["`--threads` is 0"]);
    folder.run(&["study", "mix.json", "--shards", "2"]).refused(&["are for a cluster", "--engine slurm"]);
    folder.run(&["study", "export", "mix.json", "--shards", "2"]).refused(&["has 1 shards", "--shards"]);

    // Another machine under the same name.
    let machine = std::fs::read_to_string(folder.path("machine.json")).expect("readable");
    folder.write("machine.json", &machine.replace("\"hit_cycles\": 3", "\"hit_cycles\": 4"));
    worker(&["--shard", "0"]).refused(&["point", "is not the one that was planned", "have changed"]);
    folder.write("machine.json", &machine);

    // An edited plan.
    let written = std::fs::read_to_string(folder.path(plan).join("plan.json")).expect("readable");
    folder.write("copy", &written);
    std::fs::write(format!("{plan}/plan.json"), written.replace("\"tiny\"", "\"table\"")).expect("writable");
    worker(&["--shard", "0"]).refused(&["another hash", "a plan is never edited"]);
    std::fs::write(format!("{plan}/plan.json"), &written[..written.len() / 2]).expect("writable");
    worker(&["--shard", "0"]).refused(&["plan.json", "EOF"]);
    assert!(finished(&folder.path("out/cache")).is_empty(), "nothing was computed");
}

#[test]
fn points_of_another_build_are_run_again_and_failures_are_results() {
    let folder = Folder::new();
    folder.write("small.json", &study("small", "functional", 2, 2));
    folder.run(&["study", "small.json"]).ok();
    assert!(export(&folder, &["small.json"]).is_empty(), "points of the same build count");
    let cache = folder.path("out/cache");
    let before = finished(&cache);
    for name in before.keys() {
        let path = cache.join(&name[..2]).join(name);
        let mut entry: Value =
            serde_json::from_slice(&std::fs::read(&path).expect("readable")).expect("JSON");
        entry["build"] = "0".repeat(64).into();
        std::fs::write(&path, entry.to_string()).expect("writable");
    }
    let line = export(&folder, &["small.json"]).remove(0);
    let said = shell(&folder, &line).output().expect("a shell").stdout;
    let said = String::from_utf8_lossy(&said);
    assert!(said.contains("4 points: 4 run, 0 found"), "{said}");

    // A failure that a worker recorded is not tried again by workers.
    let out = folder.path("out");
    let plan = names(&out).into_iter().find(|name| name.starts_with("plan-")).expect("a plan");
    let key = before.keys().next().expect("a point").trim_end_matches(".json").to_owned();
    std::fs::remove_file(cache.join(&key[..2]).join(format!("{key}.json"))).expect("there");
    let failure = serde_json::json!({"key": key, "node": "n1", "error": "made up"}).to_string();
    std::fs::write(out.join(plan).join("failed").join(format!("{key}.json")), failure).expect("writable");
    assert!(export(&folder, &["small.json"]).is_empty());
    let said = shell(&folder, &line).output().expect("a shell").stdout;
    let said = String::from_utf8_lossy(&said);
    assert!(said.contains("4 points: 0 run, 3 found, 1 failed"), "{said}");
}

#[test]
fn a_worker_that_is_told_to_end_leaves_with_75() {
    let folder = Folder::new();
    folder.write("long.json", &study("long", "cycle", 10, 20));
    let line = export(&folder, &["long.json", "--shards", "1"]).remove(0);
    let child = shell(&folder, &format!("exec {line}")).stderr(Stdio::piped()).spawn().expect("a shell");
    let cache = folder.path("out/cache");
    until("a point is finished", || !finished(&cache).is_empty());
    signal("TERM", child.id());
    let (code, said) = wait(child);
    assert!(code == Some(75) && said.contains("stopped by a signal"), "{code:?}: {said}");
}

#[test]
fn a_worker_that_is_killed_fifty_times_loses_nothing() {
    let folder = Folder::new();
    let text = study("killed", "functional", 20, 12).replace("\"tiny\"", "\"tiny\",\"warm_frames\":2");
    folder.write("killed.json", &text);
    let line = export(&folder, &["killed.json", "--shards", "1"]).remove(0);
    let cache = folder.path("out/cache");
    let start = || shell(&folder, &format!("exec {line}")).stderr(Stdio::null()).spawn().expect("a shell");
    let end = |mut child: Child| {
        child.kill().expect("it can be killed");
        child.wait().expect("it ends");
    };
    // How long a worker takes to its first point, on this host.
    let watch = Stopwatch::start();
    let child = start();
    until("a point is finished", || !finished(&cache).is_empty());
    let first = watch.elapsed();
    end(child);
    let mut before = finished(&cache);
    let mut seed = 18_u64;
    for _ in 0..50 {
        // Knuth's MMIX generator: moments that differ, the same ones every time.
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let child = start();
        std::thread::sleep(first.mul_f64(1.4 * (seed >> 11) as f64 / (1_u64 << 53) as f64));
        end(child);
        let now = finished(&cache);
        kept(&before, &now);
        before = now;
    }
    let done = shell(&folder, &line).output().expect("a shell");
    assert!(done.status.success());
    let now = finished(&cache);
    kept(&before, &now);
    assert_eq!(now.len(), 240);
    let printed = folder.run(&["study", "killed.json", "-o", "there"]).ok().stdout();
    assert!(printed.contains("240 points: 0 run, 240 found"), "{printed}");
    assert_eq!(results(&folder.path("there")), local("killed.json", &text));
    for group in names(&cache) {
        assert!(
            names(&cache.join(&group)).iter().all(|name| name.ends_with(".json")),
            "something half is left"
        );
    }
}

#[test]
fn a_full_disk_stops_a_worker_and_spoils_nothing() {
    let folder = Folder::new();
    let text = study("full", "functional", 6, 4);
    folder.write("full.json", &text);
    let line = export(&folder, &["full.json", "--cache", "small", "--shards", "1"]).remove(0);
    // In a name space of its own, so that nobody else sees the mount and it ends with the shell.
    let script = format!(
        "mount -t tmpfs -o size=160k none small || exit 99
         {line}; echo code $?
         cp -r small first
         mount -o remount,size=64m small || exit 99
         {line}; echo code $?
         cp -r small second"
    );
    let run = |args: &[&str]| {
        let mut unshare = Command::new("unshare");
        unshare.current_dir(folder.path("")).args(args).args(["sh", "-c", &script]);
        unshare.output().ok().filter(|output| !matches!(output.status.code(), Some(99) | Some(1)))
    };
    // As root, or as whoever may be root of a name space of his own.
    let Some(output) = run(&["--mount"]).or_else(|| run(&["--user", "--map-root-user", "--mount"])) else {
        return say_aloud(
            "no small file system can be mounted here, so that no disk is full (mount, unshare)",
        );
    };
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let codes: Vec<&str> = said[0].lines().filter(|line| line.starts_with("code")).collect();
    assert_eq!(codes, ["code 75", "code 0"], "{said:?}");
    assert!(said[1].contains("No space left on device"), "{said:?}");
    let (first, second) = (finished(&folder.path("first")), finished(&folder.path("second")));
    assert!((1..24).contains(&first.len()), "{} points fit", first.len());
    assert_eq!(second.len(), 24);
    assert!(
        said[0].contains(&format!("24 points: {} run, {} found", 24 - first.len(), first.len())),
        "{said:?}"
    );
    for group in names(&folder.path("second")) {
        let left = names(&folder.path("second").join(&group));
        assert!(left.iter().all(|name| name.ends_with(".json")), "something half is left: {left:?}");
    }
    folder.run(&["study", "full.json", "--cache", "second", "-o", "there"]).ok();
    assert_eq!(results(&folder.path("there")), local("full.json", &text));
}

/// Waits until something is so.
#[track_caller]
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    for _ in 0..1200 {
        if is_so() {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("a minute has passed, and still not: {what}");
}

fn signal(name: &str, process: u32) {
    let sent = Command::new("kill").args([&format!("-{name}"), &process.to_string()]).status();
    assert!(sent.expect("`kill` is there").success());
}

/// A cluster of two nodes on this host, gone when it is dropped.
struct Cluster {
    folder: tempfile::TempDir,
}

impl Cluster {
    /// Starts the cluster; `None`, said aloud, where Slurm cannot be had.
    fn start() -> Option<Cluster> {
        let path = format!("{}:/usr/sbin:/sbin", std::env::var("PATH").unwrap_or_default());
        let is_there = |name: &str| std::env::split_paths(&path).any(|folder| folder.join(name).is_file());
        let programs = ["slurmctld", "slurmd", "munged", "sbatch", "squeue", "scontrol", "ps"];
        let missing: Vec<&str> = programs.into_iter().filter(|name| !is_there(name)).collect();
        if !missing.is_empty() {
            say_aloud(&format!(
                "no cluster is started, for want of {}; `apt-get install slurmctld slurmd slurm-client munge procps` brings them",
                missing.join(", ")
            ));
            return None;
        }
        // Names of sockets are short.
        let folder = tempfile::Builder::new().prefix("slb").tempdir_in("/tmp").expect("a temporary folder");
        let cluster = Cluster { folder };
        let (done, said) = cluster.control(&["up"]);
        assert!(done, "the cluster does not start: {said}");
        Some(cluster)
    }

    /// Commands of `slurm-loopback.sh`: whether they succeeded, and what they said.
    fn control(&self, args: &[&str]) -> (bool, String) {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/slurm-loopback.sh");
        let port = 20_000 + std::process::id() % 10_000 * 4;
        // To a file: daemons would keep a pipe open.
        let said = self.folder.path().join("said");
        let output = std::fs::File::create(&said).expect("writable");
        let mut command = Command::new("bash");
        command.arg(script).args(args).stdin(Stdio::null());
        command.stdout(output.try_clone().expect("a file")).stderr(output);
        command.env("SLB_DIR", self.folder.path()).env("SLB_NODES", "2").env("SLB_CPUS", "2");
        let status = command.env("SLB_PORT", port.to_string()).status().expect("bash is there");
        (status.success(), std::fs::read_to_string(said).unwrap_or_default())
    }

    fn slurm(&self, program: &str, args: &[&str]) -> String {
        let mut command = Command::new(program);
        let output = command.args(args).env("SLURM_CONF", self.conf()).output().expect("Slurm is there");
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    fn conf(&self) -> PathBuf {
        self.folder.path().join("slurm.conf")
    }

    /// Starts `lrbsim study` of a file on the cluster, in `folder`.
    fn submit(&self, folder: &Folder, file: &str) -> Child {
        let mut command = lrbsim();
        command.current_dir(folder.path("")).args(["study", file, "--engine", "slurm", "-o", "there"]);
        command.args(["--sbatch-arg=--partition=main"]);
        if !folder.path("out").exists() {
            command.args(["--shards", "8"]);
        }
        command.env("SLURM_CONF", self.conf()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().expect("the binary starts")
    }

    /// What an administrator does after his controller has forgotten things, while a submitter waits for its end. Tasks
    /// that it takes to be running and that are not, it finds out about after minutes: these are ended.
    fn repair(&self, submitter: Child) -> (Option<i32>, String) {
        std::thread::scope(|scope| {
            let submitter = scope.spawn(|| wait(submitter));
            let watch = Stopwatch::start();
            while !submitter.is_finished() {
                std::thread::sleep(Duration::from_millis(500));
                if watch.elapsed() > Duration::from_secs(40) {
                    self.slurm("scancel", &["--me"]);
                }
                let drained = self.slurm("sinfo", &["-h", "-N", "-t", "drain", "-o", "%N"]);
                for node in drained.lines() {
                    self.slurm("scontrol", &["update", &format!("nodename={}", node.trim()), "state=resume"]);
                }
                let queue = self.slurm("squeue", &["-h", "-r", "-o", "%A|%r"]);
                for (task, _) in queue
                    .lines()
                    .filter_map(|line| line.split_once('|'))
                    .filter(|task| task.1.contains("held"))
                {
                    self.slurm("scontrol", &["release", task]);
                }
            }
            submitter.join().expect("it is waited for")
        })
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.control(&["down"]);
    }
}

/// How often the logs of a plan say that a point was computed, by point.
fn computed(folder: &Folder) -> BTreeMap<String, usize> {
    let out = folder.path("out");
    let plan = names(&out).into_iter().find(|name| name.starts_with("plan-")).expect("a plan");
    let logs = out.join(plan).join("log");
    let mut points = BTreeMap::new();
    for name in names(&logs) {
        let text = std::fs::read_to_string(logs.join(name)).expect("readable");
        for line in text.lines().filter_map(|line| line.strip_prefix("point ")?.split_once(" took")) {
            *points.entry(line.0.to_owned()).or_default() += 1;
        }
    }
    points
}

/// Demands 40 points as from a local run, on the cluster's nodes, and none of them computed twice.
#[track_caller]
fn as_here(folder: &Folder, here: &BTreeMap<String, Vec<u8>>, before: &BTreeMap<String, SystemTime>) {
    assert_eq!(results(&folder.path("there")), *here);
    let now = finished(&folder.path("out/cache"));
    assert_eq!(now.len(), 40);
    kept(before, &now);
    let hosts = std::fs::read_to_string(folder.path("there/host.json")).expect("there");
    let hosts: Value = serde_json::from_str(&hosts).expect("JSON");
    let rows = hosts["points"].as_array().expect("a row for each point");
    assert!(
        rows.len() == 40
            && rows.iter().all(|row| ["n1", "n2"].iter().any(|node| row["host"]["node"] == *node))
    );
    // A task that is killed between a result and its line in the log leaves no line: at most one for each CPU that died.
    let computed = computed(folder);
    assert!(computed.values().all(|times| *times == 1), "computed twice: {computed:?}");
    assert!((38..=40).contains(&computed.len()), "{computed:?}");
}

#[test]
fn a_cluster_loses_a_node_and_its_submitter_and_then_its_controller() {
    let Some(cluster) = Cluster::start() else { return };
    let text = study("forty", "cycle", 10, 4);
    let here = local("forty.json", &text);
    let new = || {
        let folder = Folder::new();
        folder.write("forty.json", &text);
        folder
    };

    // A node dies midway, and the submitter. The same command goes on.
    let folder = new();
    let cache = folder.path("out/cache");
    let mut submitter = cluster.submit(&folder, "forty.json");
    until("some points are finished", || finished(&cache).len() >= 6);
    cluster.control(&["crash", "2"]);
    submitter.kill().expect("it can be killed");
    submitter.wait().expect("it ends");
    let before = finished(&cache);
    assert!(before.len() < 40, "they died midway");
    let (code, said) = wait(cluster.submit(&folder, "forty.json"));
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("tasks of an earlier call are still queued"), "{said}");
    as_here(&folder, &here, &before);

    // Once more: nothing is missing, and nothing is submitted.
    let (code, said) = wait(cluster.submit(&folder, "forty.json"));
    assert!(code == Some(0) && !said.contains("submitted"), "{said}");
    assert!(said.contains("40 points: 0 run, 40 found"), "{said}");
    as_here(&folder, &here, &finished(&cache));

    // The controller dies midway and comes back. What it has forgotten is the administrator's to mend; results are there.
    cluster.control(&["revive", "2"]);
    let folder = new();
    let cache = folder.path("out/cache");
    let submitter = cluster.submit(&folder, "forty.json");
    until("some points are finished", || finished(&cache).len() >= 6);
    let controller = std::fs::read_to_string(cluster.folder.path().join("ctld.pid")).expect("it runs");
    signal("KILL", controller.trim().parse().expect("a process"));
    let before = finished(&cache);
    std::thread::sleep(Duration::from_secs(2));
    cluster.control(&["ctld-start"]);
    let mut repaired = cluster.repair(submitter);
    for _ in 0..3 {
        if repaired.0 == Some(0) {
            break;
        }
        let said = &repaired.1;
        assert_eq!(repaired.0, Some(1), "{said}");
        assert!(said.contains("points are missing, and nothing computes them"), "{said}");
        repaired = cluster.repair(cluster.submit(&folder, "forty.json"));
    }
    let (code, said) = repaired;
    assert_eq!(code, Some(0), "{said}");
    as_here(&folder, &here, &before);

    // One who leaves is told how to come back; tasks that somebody ends are named with what they said last.
    let folder = new();
    let cache = folder.path("out/cache");
    let submitter = cluster.submit(&folder, "forty.json");
    until("some points are finished", || finished(&cache).len() >= 2);
    signal("INT", submitter.id());
    let (code, said) = wait(submitter);
    assert_eq!(code, Some(130), "{said}");
    for part in [
        "submitted 8 tasks as job",
        "of 40 points finished; tasks go on",
        "lrbsim study forty.json -o there --engine slurm",
    ] {
        assert!(said.contains(part), "`{part}` is not in {said}");
    }
    let submitter = cluster.submit(&folder, "forty.json");
    std::thread::sleep(Duration::from_millis(500));
    cluster.slurm("scancel", &["--me"]);
    let (code, said) = wait(submitter);
    assert_eq!(code, Some(1), "{said}");
    for part in [
        "has ended and misses",
        "ends with:",
        "stopped by a signal",
        "the same command submits what is missing",
    ] {
        assert!(said.contains(part), "`{part}` is not in {said}");
    }
    assert!(!folder.path("there/study.json").exists(), "a study that misses points has no results");
}
