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

/// A study of `cores` x `lamps` points that take a hundredth of a second each, or with `cycle` a fifth. With one number of cores no two are
/// served by one functional run: each ends by itself.
fn study(name: &str, fidelity: &str, cores: u32, lamps: u32) -> String {
    let cores: Vec<u32> = (1..=cores).collect();
    let radii: Vec<f64> = (1..=lamps).map(|lamp| 0.2 + f64::from(lamp) / 1000.0).collect();
    serde_json::json!({"name": name, "base": {"scene": "tiny", "fidelity": fidelity},
        "axes": [{"path": "cores", "values": cores}, {"path": "scene.light.radius", "values": radii}],
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

/// How many finished points a cache has.
fn count(cache: &Path) -> usize {
    let groups = cache.read_dir().into_iter().flatten().flatten();
    let files = groups.flat_map(|group| group.path().read_dir().into_iter().flatten().flatten());
    files.filter(|file| file.path().extension().is_some_and(|end| end == "json")).count()
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
    let lines: Vec<String> = done.stdout().lines().map(str::to_owned).collect();
    let told = if lines.is_empty() { "no point is missing" } else { "run these commands anywhere" };
    assert!(done.stderr().contains(told), "{}", done.stderr());
    lines
}

/// The folder of the only plan in `folder`.
#[track_caller]
fn plan_of(folder: &Folder) -> PathBuf {
    let out = folder.path("out");
    let plans: Vec<String> = names(&out).into_iter().filter(|name| name.starts_with("plan-")).collect();
    assert_eq!(plans.len(), 1, "{plans:?}");
    out.join(&plans[0])
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
    let plan = plan_of(&folder);
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
    folder
        .run(&["study", "export", "mix.json", "--shards", "2"])
        .refused(&["`--shards` is 2", "has 1 shard"]);

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

    // Shards that leave a point out, have one twice, or one that is not there.
    let (begin, _) = written.split_once("\"points\":[").expect("a shard");
    for points in ["0,1,2", "0,1,2,3,3", "0,1,2,4", ""] {
        let edited = format!("{begin}\"points\":[{points}]}}]}}");
        std::fs::write(format!("{plan}/plan.json"), edited).expect("writable");
        worker(&["--shard", "0"]).refused(&["`shards` must have each point that can be run once"]);
        folder.run(&["study", "export", "mix.json"]).refused(&["`shards` must have each point"]);
    }
    let (begin, _) = written.split_once("\"shards\":").expect("shards");
    std::fs::write(format!("{plan}/plan.json"), format!("{begin}\"shards\":[]}}")).expect("writable");
    worker(&["--shard", "0"]).refused(&["`shards` must have each point that can be run once"]);
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
    // A study on one machine takes what it finds, and tells of it.
    let gathered = || folder.run(&["study", "small.json"]).stderr();
    assert!(!gathered().contains("builds of lrbsim"));
    let name = before.keys().next().expect("a point");
    let path = cache.join(&name[..2]).join(name);
    let text = std::fs::read_to_string(&path).expect("readable");
    let mut entry: Value = serde_json::from_str(&text).expect("JSON");
    entry["build"] = "0".repeat(64).into();
    std::fs::write(&path, entry.to_string()).expect("writable");
    assert!(gathered().contains("its points were run by 2 builds of lrbsim"), "{}", gathered());
    std::fs::write(&path, text).expect("writable");

    // A failure that a worker recorded is not tried again by workers.
    let key = before.keys().next().expect("a point").trim_end_matches(".json").to_owned();
    std::fs::remove_file(cache.join(&key[..2]).join(format!("{key}.json"))).expect("there");
    let failure = serde_json::json!({"key": key, "node": "n1", "error": "made up"}).to_string();
    std::fs::write(plan_of(&folder).join("failed").join(format!("{key}.json")), failure).expect("writable");
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
fn a_worker_whose_log_cannot_be_written_goes_on_and_hears_signals() {
    if !Path::new("/dev/full").exists() {
        return say_aloud("there is no /dev/full here, so that no log is full");
    }
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 4, 3));
    // A log on a full disk, a tally on one, and somebody who reads a line and goes.
    for (cache, end) in
        [("a", "2>/dev/full"), ("b", ">/dev/full"), ("c", ">/dev/full 2>&1"), ("d", "2>&1 | head -1")]
    {
        let line = export(&folder, &["few.json", "--cache", cache]).remove(0);
        let script = format!("{} {end}", line.replace("--threads 1", "--threads 2"));
        let (code, said) = wait(shell(&folder, &script).stdout(Stdio::null()).spawn().expect("a shell"));
        assert_eq!((code, finished(&folder.path(cache)).len()), (Some(0), 12), "{end}: {said}");
    }
    folder.write("long.json", &study("long", "cycle", 10, 20));
    let line = export(&folder, &["long.json", "--cache", "long", "--shards", "1"]).remove(0);
    let child = shell(&folder, &format!("exec {line} 2>/dev/full")).spawn().expect("a shell");
    until("a point is finished", || count(&folder.path("long")) > 0);
    signal("TERM", child.id());
    assert_eq!(wait(child).0, Some(75));
}

#[test]
fn a_point_whose_report_is_of_another_layout_is_run_again() {
    let folder = Folder::new();
    folder.write("small.json", &study("small", "functional", 2, 2));
    folder.run(&["study", "small.json"]).ok();
    let cache = folder.path("out/cache");
    let name = finished(&cache).into_keys().next().expect("a point");
    let path = cache.join(&name[..2]).join(&name);
    let sound = std::fs::read_to_string(&path).expect("readable");
    let mut entry: Value = serde_json::from_str(&sound).expect("JSON");
    entry["report"]["a field of tomorrow"] = 1.into();
    std::fs::write(&path, entry.to_string()).expect("writable");
    let printed = folder.run(&["study", "small.json"]).ok().stdout();
    assert!(printed.contains("4 points: 1 run, 3 found"), "{printed}");
    assert!(!std::fs::read_to_string(&path).expect("readable").contains("tomorrow"));
    entry["report"].as_object_mut().expect("an object").remove("core_cycles");
    std::fs::write(&path, entry.to_string()).expect("writable");
    assert_eq!(export(&folder, &["small.json"]).len(), 1, "a worker computes it");
}

#[test]
fn commands_survive_a_folder_with_blanks_and_quotes() {
    let parent = Folder::new();
    let folder = parent.path("it's \"here\" $HOME");
    std::fs::create_dir(&folder).expect("writable");
    std::fs::write(folder.join("big.json"), study("big", "functional", 4, 3)).expect("writable");
    let run = |args: &[&str]| {
        let output = lrbsim().current_dir(&folder).args(args).output().expect("the binary starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    std::fs::write(folder.join("todo"), run(&["study", "export", "big.json", "--shards", "3"]))
        .expect("writable");
    // The line for this machine, as the guide has it.
    let guide = include_str!("../docs/cluster.md");
    let line = guide.lines().find(|line| line.contains("| xargs")).expect("a line with xargs");
    let output = Command::new("sh").current_dir(&folder).args(["-c", line]).output().expect("a shell");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = run(&["study", "big.json"]);
    assert!(printed.contains("12 points: 0 run, 12 found"), "{printed}");
}

#[test]
fn the_same_number_of_shards_is_the_same_plan_where_there_are_fewer_points() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    for _ in 0..2 {
        assert_eq!(export(&folder, &["few.json", "--shards", "100"]).len(), 4);
    }
}

#[test]
fn a_file_system_without_locks_has_studies_too() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    folder.write(
        "nolock.c",
        "#include <errno.h>\nint flock(int file, int what) { errno = ENOLCK; return -1; }\n",
    );
    let made = shell(&folder, "cc -shared -fPIC -o nolock.so nolock.c").output();
    if !made.is_ok_and(|output| output.status.success()) {
        return say_aloud("no `cc` is here, so that no file system without locks is played");
    }
    let preload = folder.path("nolock.so");
    let run = |mut command: Command| {
        let output = command.env("LD_PRELOAD", &preload).output().expect("it starts");
        let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        assert!(output.status.success(), "{said:?}");
        said
    };
    let start = |args: &[&str]| {
        let mut command = lrbsim();
        command.current_dir(folder.path("")).args(args);
        run(command)
    };
    let [line, _] = start(&["study", "export", "few.json"]);
    let [printed, _] = run(shell(&folder, &line));
    assert!(printed.contains("4 points: 4 run"), "{printed}");
    let [printed, _] = start(&["study", "few.json"]);
    assert!(printed.contains("4 points: 0 run, 4 found"), "{printed}");
    let left = shell(&folder, "find out -name '*.lock'").output().expect("a shell").stdout;
    assert_eq!(String::from_utf8_lossy(&left), "");
}

/// Commands of Slurm that are scripts: what a real one would do only on a bad day. They run in the folder of the study.
fn play(folder: &Folder, changed: &[(&str, &str)]) {
    let usual = [
        ("sinfo", "[ -z \"$SINFO_FORMAT\" ] || exit 9; echo 0/4/0/4"),
        ("scontrol", "echo 'MaxArraySize = 1001'"),
        ("scancel", ""),
        // Asked for its names, it shows the queue; NAME is the last of them.
        (
            "squeue",
            "[ -z \"$SQUEUE_STATES$SQUEUE_FORMAT\" ] || exit 9; for arg; do case $arg in --name=*) name=${arg##*[=,]};; esac; done; [ ! -f queue ] || sed \"s/NAME/$name/\" queue",
        ),
        // The one shard is done before the job has its number.
        (
            "sbatch",
            "[ \"$SBATCH_ERROR$SBATCH_ARRAY_INX$SBATCH_PARTITION\" = \"$KEPT\" ] || exit 9; cat > script; SLURM_ARRAY_TASK_ID=0 sh script > said 2>&1; echo 7",
        ),
    ];
    std::fs::create_dir_all(folder.path("bin")).expect("writable");
    for (name, text) in usual.iter().chain(changed) {
        let path = folder.write(&format!("bin/{name}"), &format!("#!/bin/sh\n{text}\n"));
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("ours");
    }
}

/// `lrbsim study` with the commands of [`play`].
fn played(folder: &Folder, args: &[&str]) -> Command {
    let mut command = lrbsim();
    let path = std::env::var("PATH").unwrap_or_default();
    command.current_dir(folder.path("")).env("PATH", format!("{}:{path}", folder.path("bin").display()));
    command.args([&["study"], args, &["--engine", "slurm"]].concat());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

#[test]
fn results_of_held_tasks_are_found() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    folder.write("queue.held", "7|0|PENDING|NAME|launch failed requeued held\n");
    play(
        &folder,
        &[(
            "sbatch",
            "cat > script; cp queue.held queue; SLURM_ARRAY_TASK_ID=0 sh script > said 2>&1; echo 7",
        )],
    );
    let (code, said) = wait(played(&folder, &["few.json"]).spawn().expect("it starts"));
    assert!(code == Some(0) && said.contains("submitted 1 task as job 7"), "{said}");
    assert!(said.contains("4 points: 0 run, 4 found") || said.contains("4 points: 4 run"), "{said}");
}

#[test]
fn held_tasks_without_results_end_the_wait() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    folder.write("queue.held", "7|0|PENDING|NAME|JobHeldUser\n");
    play(&folder, &[("sbatch", "cat > script; cp queue.held queue; echo 7")]);
    let (code, said) = wait(played(&folder, &["few.json"]).spawn().expect("it starts"));
    assert_eq!(code, Some(1), "{said}");
    for part in ["held: 7_[0], JobHeldUser", "4 points missing, and nothing computes", "`scontrol release 7`"]
    {
        assert!(said.contains(part), "`{part}` is not in {said}");
    }
}

/// A task that runs computes, though its job was held after it began.
#[test]
fn a_task_that_runs_is_not_held() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    folder.write("queue.held", "7|0|RUNNING|NAME|JobHeldAdmin\n");
    play(
        &folder,
        &[(
            "sbatch",
            "cat > script; cp queue.held queue; { sleep 3; SLURM_ARRAY_TASK_ID=0 sh script; rm queue; } > said 2>&1 & echo 7",
        )],
    );
    let (code, said) = wait(played(&folder, &["few.json"]).spawn().expect("it starts"));
    assert!(code == Some(0) && !said.contains("held"), "{said}");
}

#[test]
fn a_submission_that_is_refused_binds_nobody_and_memory_is_said_one_way() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    play(&folder, &[("sbatch", "echo \"$@\" > asked; echo no such option >&2; exit 1")]);
    let asked = || std::fs::read_to_string(folder.path("asked")).expect("it was asked");
    let (code, said) = wait(played(&folder, &["few.json", "--shards", "1"]).spawn().expect("it starts"));
    assert!(code == Some(2) && said.contains("no such option"), "{said}");
    assert!(asked().contains("--mem="), "{}", asked());
    let more = ["few.json", "--shards", "2", "--sbatch-arg=--mem-per-cpu=100"];
    let (code, said) = wait(played(&folder, &more).spawn().expect("it starts"));
    assert!(code == Some(2) && said.contains("no such option"), "{said}");
    assert!(!asked().contains("--mem=") && asked().contains("--mem-per-cpu=100"), "{}", asked());
}

#[test]
fn a_study_is_not_cut_while_slurm_does_not_answer() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    let refused = |said: &str| {
        let (code, text) = wait(played(&folder, &["few.json"]).spawn().expect("it starts"));
        assert!(code == Some(2) && text.contains(said), "{text}");
        assert!(!folder.path("out").exists(), "something was written");
    };
    for broken in ["sinfo", "scontrol"] {
        play(&folder, &[(broken, "echo no controller >&2; exit 1")]);
        refused("Slurm does not say how large the cluster is: `");
    }
    play(&folder, &[("sinfo", "echo 0/0/0/0")]);
    refused("shows no CPU");
    play(&folder, &[]);
    let mut command = played(&folder, &["few.json", "--sbatch-arg=--job-name=mine"]);
    let (code, text) = wait(command.spawn().expect("it starts"));
    assert!(
        code == Some(2) && text.contains("decides on `--job-name`") && !folder.path("out").exists(),
        "{text}"
    );

    let mut command = played(&folder, &["few.json"]);
    let (code, text) = wait(command.env("PATH", folder.path("out")).spawn().expect("it starts"));
    assert!(
        code == Some(2) && text.contains("is not on the path; where a site keeps Slurm in a module"),
        "{text}"
    );
}

#[test]
fn what_sbatch_says_that_is_no_job_is_an_error() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    for said in ["true", "echo Submitted batch job 7"] {
        play(&folder, &[("sbatch", said)]);
        let (code, text) = wait(played(&folder, &["few.json"]).spawn().expect("it starts"));
        assert!(code == Some(2) && text.contains("which is no number of a job"), "{text}");
        assert!(text.contains("fewer `--shards`"), "{text}");
    }
}

#[test]
fn variables_of_the_user_change_no_answer_of_slurm() {
    let folder = Folder::new();
    folder.write("few.json", &study("few", "functional", 2, 2));
    play(&folder, &[]);
    let mut command = played(&folder, &["few.json"]);
    for (name, value) in [("SQUEUE_STATES", "FAILED"), ("SQUEUE_FORMAT", "%i"), ("SINFO_FORMAT", "%n")] {
        command.env(name, value);
    }
    command
        .env("SBATCH_ERROR", "/dev/null")
        .env("SBATCH_ARRAY_INX", "5")
        .env("SBATCH_PARTITION", "main")
        .env("KEPT", "main");
    let (code, said) = wait(command.spawn().expect("it starts"));
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn slurm_is_asked_only_where_it_is_needed_and_somebody_who_leaves_can_come_back() {
    let folder = Folder::new();
    let file = "it's few.json";
    folder.write(file, &study("few", "functional", 2, 2));
    play(&folder, &[("sinfo", "exec sleep 5")]);
    let child =
        played(&folder, &[file, "--yes", "--shards", "2", "-o", "to there"]).spawn().expect("it starts");
    std::thread::sleep(Duration::from_millis(3800));
    signal("INT", child.id());
    let (code, said) = wait(child);
    assert_eq!(code, Some(130), "{said}");
    let again = r"`lrbsim study 'it'\''s few.json' --yes --shards 2 -o 'to there' --engine slurm` goes on";
    assert!(said.contains("asking Slurm") && said.contains(again), "{said}");
    assert!(!said.contains("tasks go on"), "nothing was submitted: {said}");

    // Tasks of another build are in the queue.
    play(
        &folder,
        &[("squeue", "case $* in *000000000000*) echo '3|0|RUNNING|lrbsim-000000000000|None';; esac")],
    );
    std::fs::create_dir_all(folder.path("out/plan-few-000000000000")).expect("writable");
    let (code, said) = wait(played(&folder, &[file, "--shards", "1"]).spawn().expect("it starts"));
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("1 task of another plan of this study"), "{said}");
    assert!(said.contains("`scancel --me --name=lrbsim-000000000000`"), "{said}");

    // All points are there.
    for name in ["sinfo", "scontrol", "squeue", "sbatch"] {
        play(&folder, &[(name, "touch asked; exit 1")]);
    }
    let (code, said) = wait(played(&folder, &[file]).spawn().expect("it starts"));
    assert!(code == Some(0) && !folder.path("asked").exists(), "{said}");
}

#[test]
fn a_worker_that_is_killed_fifty_times_loses_nothing() {
    let folder = Folder::new();
    let text = study("killed", "functional", 1, 240).replace("\"tiny\"", "\"tiny\",\"warm_frames\":2");
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
    let mut fruitful = 0;
    for kill in 0..50 {
        // Knuth's MMIX generator: moments that differ, the same ones every time.
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let part = (seed >> 11) as f64 / (1_u64 << 53) as f64;
        let mut child = start();
        // At any time until it is at work, or, every other time, while it certainly is.
        let watch = Stopwatch::start();
        let (least, most) = if kill % 2 == 0 { (0, first.mul_f64(1.4 * part)) } else { (1, Duration::ZERO) };
        until("it is its turn to die", || {
            let new = count(&cache) - before.len();
            new >= least && watch.elapsed() >= most || new > 2
        });
        std::thread::sleep(Duration::from_secs_f64(0.02 * part));
        assert!(child.try_wait().expect("ours").is_none(), "kill {kill} came too late");
        end(child);
        let now = finished(&cache);
        kept(&before, &now);
        fruitful += usize::from(now.len() > before.len());
        before = now;
    }
    assert!(fruitful >= 25 && before.len() < 240, "{fruitful} got on, {} points", before.len());
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
    std::fs::create_dir(folder.path("small")).expect("writable");
    // In a name space of its own, so that nobody else sees the mount and it ends with the shell. Plan, logs and cache are on
    // the small disk.
    let script = format!(
        "mount -t tmpfs -o size=320k none small && cp full.json small && cd small || exit 99
         cat /dev/zero > fill 2>/dev/null
         {lrbsim} study export full.json --shards 1 2>&1; echo code $?
         rm -r fill out
         {lrbsim} study export full.json --shards 1 > ../todo || exit 98
         log=$(echo out/plan-*/log)/1_0.out
         sh ../todo 2>&1; echo code $?
         sh ../todo >> $log 2>&1; echo code $?
         cat /dev/zero > fill 2>/dev/null
         sh ../todo >> $log 2>&1; echo code $?
         cp -r out/cache ../first
         mount -o remount,size=64m . || exit 99
         sh ../todo >> $log 2>&1; echo code $?
         cat $log
         cp -r out/cache ../second",
        lrbsim = env!("CARGO_BIN_EXE_lrbsim")
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
    assert_eq!(codes, ["code 2", "code 75", "code 75", "code 75", "code 0"], "{said:?}");
    assert_eq!(said[0].matches("No space left on device").count().min(2), 2, "{said:?}");
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
    for _ in 0..6000 {
        if is_so() {
            return;
        }
        std::thread::sleep(Duration::from_millis(10));
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
        // Below those that the system hands out.
        let port = 20_000 + std::process::id() % 3_000 * 4;
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
        command.args(["--shards", "8"]);
        // To a file: a test reads what was said so far.
        let said = std::fs::File::create(folder.path("said")).expect("writable");
        command.stdout(said.try_clone().expect("a file")).stderr(said);
        // What users have in their profiles.
        command.env("SQUEUE_STATES", "FAILED").env("SQUEUE_FORMAT", "%i").env("SINFO_FORMAT", "%n");
        command.env("SLURM_CONF", self.conf()).spawn().expect("the binary starts")
    }

    /// What an administrator does after his controller has forgotten things, while a submitter waits for its end. Tasks
    /// that it takes to be running and that are not, it finds out about after minutes: these are ended.
    fn repair(&self, folder: &Folder, submitter: Child) -> (Option<i32>, String) {
        std::thread::scope(|scope| {
            let submitter = scope.spawn(|| wait_for(submitter, folder));
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

/// How a submitter in `folder` ends, and what it has said.
fn wait_for(submitter: Child, folder: &Folder) -> (Option<i32>, String) {
    (wait(submitter).0, said_in(folder))
}

/// What a submitter in `folder` has said so far.
fn said_in(folder: &Folder) -> String {
    std::fs::read_to_string(folder.path("said")).unwrap_or_default()
}

/// How often the logs of a plan say that a point was computed, by point.
fn computed(folder: &Folder) -> BTreeMap<String, usize> {
    let logs = plan_of(folder).join("log");
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
    let text = study("forty", "cycle", 1, 40);
    let new = || {
        let folder = Folder::new();
        folder.write("forty.json", &text);
        folder
    };

    // A node dies midway, and the submitter. The same command goes on.
    let folder = new();
    let cache = folder.path("out/cache");
    let mut submitter = cluster.submit(&folder, "forty.json");
    until("some points are finished", || count(&cache) >= 6);
    let (done, said) = cluster.control(&["crash", "2"]);
    let jobs = said.split_once("jobs on it:").map(|(_, jobs)| jobs.trim()).unwrap_or_default();
    assert!(done && !jobs.is_empty(), "the node dies with tasks: {said}");
    submitter.kill().expect("it can be killed");
    submitter.wait().expect("it ends");
    let before = finished(&cache);
    assert!(before.len() < 40, "they died midway");
    // While Slurm takes its time to notice.
    let here = std::thread::spawn({
        let text = text.clone();
        move || local("forty.json", &text)
    });
    let (code, said) = wait_for(cluster.submit(&folder, "forty.json"), &folder);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("of an earlier call still queued"), "{said}");
    let here = here.join().expect("it runs here");
    let node = cluster.slurm("sinfo", &["--noheader", "--nodes=n2", "--format=%T"]);
    assert!(node.starts_with("down"), "the node is lost: {node}");
    let known = cluster.slurm("scontrol", &["show", "job"]);
    assert!(known.contains("Restarts=1"), "a task was queued again: {known}");
    as_here(&folder, &here, &before);

    // Once more: nothing is missing, and nothing is submitted.
    let (code, said) = wait_for(cluster.submit(&folder, "forty.json"), &folder);
    assert!(code == Some(0) && !said.contains("submitted"), "{said}");
    assert!(said.contains("40 points: 0 run, 40 found"), "{said}");
    as_here(&folder, &here, &finished(&cache));

    // The controller dies midway and comes back. What it has forgotten is the administrator's to mend; results are there.
    let (done, said) = cluster.control(&["revive", "2"]);
    assert!(done, "the node comes back: {said}");
    until("the node is used again", || {
        cluster.slurm("sinfo", &["--noheader", "--nodes=n2", "--format=%T"]).starts_with("idle")
    });
    let folder = new();
    let cache = folder.path("out/cache");
    let submitter = cluster.submit(&folder, "forty.json");
    until("some points are finished", || count(&cache) >= 6);
    let controller = std::fs::read_to_string(cluster.folder.path().join("ctld.pid")).expect("it runs");
    signal("KILL", controller.trim().parse().expect("a process"));
    let before = finished(&cache);
    until("the submitter notices", || said_in(&folder).contains("Slurm does not answer, waiting"));
    let (done, said) = cluster.control(&["ctld-start"]);
    assert!(done, "the controller comes back: {said}");
    let mut repaired = cluster.repair(&folder, submitter);
    assert!(repaired.1.contains("Slurm answers again"), "{}", repaired.1);
    for _ in 0..3 {
        if repaired.0 == Some(0) {
            break;
        }
        let said = &repaired.1;
        assert_eq!(repaired.0, Some(1), "{said}");
        assert!(said.contains("missing, and nothing computes what is missing"), "{said}");
        repaired = cluster.repair(&folder, cluster.submit(&folder, "forty.json"));
    }
    let (code, said) = repaired;
    assert_eq!(code, Some(0), "{said}");
    as_here(&folder, &here, &before);

    // One who leaves is told how to come back; tasks that somebody ends are named with what they said last.
    let folder = Folder::new();
    folder.write("many.json", &study("many", "cycle", 1, 300));
    let cache = folder.path("out/cache");
    let submitter = cluster.submit(&folder, "many.json");
    until("some points are finished", || count(&cache) >= 2);
    // As the guide has it for those who want fewer tasks at once.
    let said = said_in(&folder);
    let job = said.split_once("as job ").and_then(|(_, rest)| rest.split_once(',')).expect("a job").0;
    cluster.slurm("scontrol", &["update", &format!("jobid={job}"), "arraytaskthrottle=3"]);
    assert!(cluster.slurm("scontrol", &["show", "job"]).contains("ArrayTaskThrottle=3"));
    signal("INT", submitter.id());
    let (code, said) = wait_for(submitter, &folder);
    assert_eq!(code, Some(130), "{said}");
    for part in [
        "submitted 8 tasks as job",
        "of 300 points finished; tasks go on",
        "lrbsim study many.json --engine slurm -o there --sbatch-arg=--partition=main --shards 8",
    ] {
        assert!(said.contains(part), "`{part}` is not in {said}");
    }
    let submitter = cluster.submit(&folder, "many.json");
    until("the submitter waits", || said_in(&folder).contains("of an earlier call still queued"));
    cluster.slurm("scancel", &["--me"]);
    let (code, said) = wait_for(submitter, &folder);
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
