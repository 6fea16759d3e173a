//! Studies: the same results whatever interrupts them, and nothing run twice.

mod common;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, SystemTime};

use common::{Folder, lrbsim, names};
use lrbsim_reports::study::StudyReport;

/// Eight quick points.
const STUDY: &str = r#"{
  "name": "small",
  "base": {"scene": "tiny"},
  "axes": [
    {"path": "cores", "values": [1, 2, 4, 8]},
    {"path": "l2.capacity_bytes", "values": [131072, 262144]}
  ],
  "analysis": ["table", "speedup", "pareto", "power_law", "sensitivity"]
}
"#;

fn results(folder: &Folder, name: &str) -> StudyReport {
    let text = std::fs::read_to_string(folder.path(name)).expect("the study left its results");
    serde_json::from_str(&text).expect("its own JSON")
}

/// Files of a cache, and when each was written.
fn finished(cache: &Path) -> BTreeMap<String, SystemTime> {
    let mut files = BTreeMap::new();
    if !cache.exists() {
        return files;
    }
    for group in names(cache) {
        for name in names(&cache.join(&group)) {
            if name.ends_with(".json") {
                let meta = std::fs::metadata(cache.join(&group).join(&name)).expect("it is there");
                files.insert(name, meta.modified().expect("the host keeps times"));
            }
        }
    }
    files
}

/// Checks that each point is what `run` with `args` gives for its machine alone, to the last bit.
#[track_caller]
fn points_are_what_run_gives(folder: &Folder, study: &StudyReport, args: &[&str]) {
    for cores in [1, 8] {
        for l2 in [131_072, 262_144] {
            let set = [format!("cores={cores}"), format!("l2.capacity_bytes={l2}")];
            let args = [&["run", "tiny", "--json", "--set", &set[0], "--set", &set[1]], args].concat();
            let ran = folder.run(&args);
            assert_eq!(ran.code(), Some(0), "{}", ran.stderr());
            let report = ran.stdout();
            let mut report: lrbsim_reports::RunReport = serde_json::from_str(&report).expect("a report");
            report.machine.sources.clear();
            let point = study.at(&[cores.into(), l2.into()]).expect("a point of the study");
            assert_eq!(*point, report, "{set:?} {args:?}");
        }
    }
}

/// One functional run serves several machines, at every level but the one at which the machine says what is recorded.
#[test]
fn machines_that_share_a_run_give_what_each_gives_alone() {
    let folder = Folder::new();
    for (jobs, base, args) in [
        ("2", "\"fidelity\": \"functional\"", &["--fidelity", "functional"][..]),
        ("1", "\"fidelity\": \"roofline\"", &["--fidelity", "roofline"]),
        ("3", "\"fidelity\": \"cycle\", \"warm_frames\": 1", &["--fidelity", "cycle", "--warm-frames", "1"]),
        ("2", "\"fidelity\": \"sampled\"", &["--fidelity", "sampled"]),
        ("1", "\"reference\": 16, \"algorithm\": \"pcss\"", &["--reference", "16", "-a", "pcss"]),
    ] {
        let text = STUDY.replace("\"scene\": \"tiny\"", &format!("\"scene\": \"tiny\", {base}"));
        let start = text.find("  \"analysis\"").expect("the last line");
        folder.write("small.json", &format!("{}  \"analysis\": [\"table\"]\n}}", &text[..start]));
        // Of estimates a warning says what they are.
        let ran = folder.run(&["study", "small.json", "-j", jobs]);
        assert_eq!(ran.code(), Some(0), "{}", ran.stderr());
        points_are_what_run_gives(&folder, &results(&folder, "out/study-small/study.json"), args);
    }
}

#[test]
fn a_study_leaves_tables_plots_and_its_results() {
    let folder = Folder::new();
    folder.write("small.json", STUDY);
    let printed = folder.run(&["study", "small.json"]).ok().stdout();
    assert!(printed.contains("8 points: 8 run, 0 found in out/cache, 0 failed"), "{printed}");
    let left = names(&folder.path("out/study-small"));
    for stem in ["table", "speedup", "pareto", "power_law", "sensitivity"] {
        for ending in ["csv", "svg", "png"] {
            assert!(left.contains(&format!("{stem}.{ending}")), "{stem}.{ending}: {left:?}");
        }
    }
    assert!(left.contains(&"table.md".to_owned()) && left.contains(&"study.json".to_owned()), "{left:?}");
    assert!(left.iter().all(|name| !name.starts_with('.')), "nothing half: {left:?}");

    let study = results(&folder, "out/study-small/study.json");
    let one = study.at(&[1.into(), 262144.into()]).expect("a point of the study");
    assert_eq!(one.machine.cores, 1);
    points_are_what_run_gives(&folder, &study, &[]);

    // Again: nothing is run, and the results are the same bytes.
    let read = |name: &str| std::fs::read(folder.path(&format!("out/study-small/{name}"))).expect("readable");
    let before: Vec<Vec<u8>> = left.iter().map(|name| read(name)).collect();
    let printed = folder.run(&["study", "small.json", "-j", "1"]).ok().stdout();
    assert!(printed.contains("8 points: 0 run, 8 found in out/cache, 0 failed"), "{printed}");
    assert_eq!(left.iter().map(|name| read(name)).collect::<Vec<_>>(), before);
}

#[test]
fn a_study_that_is_killed_goes_on_where_it_was() {
    let folder = Folder::new();
    // As many points as ten kills leave unfinished on a quiet host.
    let cycle = STUDY
        .replace("\"scene\": \"tiny\"", "\"scene\": \"tiny\", \"fidelity\": \"cycle\"")
        .replace("[1, 2, 4, 8]", "[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16]");
    folder.write("small.json", &cycle);
    let cache = folder.path("out/cache");
    let mut kept: BTreeMap<String, SystemTime> = BTreeMap::new();
    // Ten moments that differ, drawn once and for all: from the start of the process to the end of the study.
    for milliseconds in [3_u64, 390, 41, 170, 260, 90, 530, 12, 330, 210] {
        let mut child = lrbsim()
            .current_dir(folder.path(""))
            .args(["study", "small.json", "-j", "1"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary starts");
        std::thread::sleep(Duration::from_millis(milliseconds));
        child.kill().expect("it can be killed");
        child.wait().expect("it ends");
        let now = finished(&cache);
        for (name, time) in &kept {
            assert_eq!(now.get(name), Some(time), "{name} was computed twice");
        }
        kept = now;
    }
    let printed = folder.run(&["study", "small.json", "--json"]).ok().stdout();
    let now = finished(&cache);
    assert_eq!(now.len(), 32);
    assert!(kept.iter().all(|(name, time)| now.get(name) == Some(time)));

    // No broken file, and the results of a study that nobody killed.
    for group in names(&cache) {
        for name in names(&cache.join(&group)) {
            assert!(name.ends_with(".json"), "{name} is left");
        }
    }
    assert!(names(&folder.path("out/study-small")).iter().all(|name| !name.starts_with('.')));
    let undisturbed = Folder::new();
    undisturbed.write("small.json", &cycle);
    assert_eq!(undisturbed.run(&["study", "small.json", "--json"]).ok().stdout(), printed);
}

#[cfg(unix)]
#[test]
fn an_interrupted_study_says_how_to_go_on() {
    let folder = Folder::new();
    // Long enough to be interrupted: its dear point is run first.
    folder.write("long.json", &STUDY.replace("\"tiny\"", "\"saloon-small\", \"fidelity\": \"cycle\""));
    let child = lrbsim()
        .current_dir(folder.path(""))
        .args(["study", "long.json", "-j", "1", "--cache", "kept"])
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    std::thread::sleep(Duration::from_millis(1500));
    let killed = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(killed.expect("`kill` is there").success());
    let output = child.wait_with_output().expect("it ends");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(130), "{message}");
    for part in [
        "stopped with ",
        " of 8 points finished",
        "kept in kept",
        "`lrbsim study long.json -j 1 --cache kept` goes on",
    ] {
        assert!(message.contains(part), "`{part}` is not in {message}");
    }
}

#[test]
fn two_studies_at_once_share_their_points() {
    let folder = Folder::new();
    folder.write("small.json", STUDY);
    let start = |out: &str| {
        lrbsim()
            .current_dir(folder.path(""))
            .args(["study", "small.json", "-j", "2", "-o", out])
            .stdout(Stdio::piped())
            .spawn()
            .expect("the binary starts")
    };
    let both = [start("a"), start("b")].map(|child| child.wait_with_output().expect("it ends"));
    let run: u32 = both
        .iter()
        .map(|output| {
            assert_eq!(output.status.code(), Some(0));
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            let line = text.lines().find(|line| line.starts_with("8 points: ")).expect("a summary");
            let run = line["8 points: ".len()..].split(' ').next().expect("a number");
            run.parse::<u32>().expect("a number")
        })
        .sum();
    assert_eq!(run, 8, "each point once, by one or the other");
    assert_eq!(results(&folder, "a/study.json"), results(&folder, "b/study.json"));
}

#[test]
fn a_failing_point_is_recorded_and_the_others_go_on() {
    let folder = Folder::new();
    // 100 ways are no cache, beside any other value.
    folder.write(
        "some.json",
        &STUDY.replace("l2.capacity_bytes", "l2.ways").replace("131072, 262144", "8, 100"),
    );
    let done = folder.run(&["study", "some.json"]);
    assert_eq!(done.code(), Some(1), "{}", done.stderr());
    assert!(done.stdout().contains("8 points: 4 run, 0 found in out/cache, 4 failed"), "{}", done.stdout());
    let study = results(&folder, "out/study-small/study.json");
    for point in &study.points {
        assert_eq!(point.report.is_some(), point.values[1] == 8);
        let error = point.error.clone().unwrap_or_default();
        assert_eq!(error.contains("`l2.ways` is 100"), point.values[1] == 100, "{error}");
    }
}

#[test]
fn points_of_scenes_and_algorithms_are_varied_too() {
    let folder = Folder::new();
    folder.write(
        "mixed.json",
        r#"{"name": "mixed", "base": {"scene": "tiny", "fidelity": "functional"}, "metric": "image.mean_visibility",
            "axes": [{"path": "scene.light.radius", "values": [0, 0.2]}, {"path": "scene.image.width", "values": [16, 32]}]}"#,
    );
    folder.run(&["study", "mixed.json"]).ok();
    let study = results(&folder, "out/study-mixed/study.json");
    let soft = study.at(&[0.2.into(), 32.into()]).expect("a point");
    let hard = study.at(&[0.into(), 32.into()]).expect("a point");
    assert_eq!((soft.scene.width, hard.image.penumbra_receivers), (32, 0));
    assert!(soft.image.penumbra_receivers > 0);
}

#[test]
fn an_option_of_the_algorithm_is_an_axis_too() {
    let folder = Folder::new();
    // In place of what the base says of it, and known as a part of the base.
    let base = r#"{"scene": "tiny", "algorithm": "sism:form=exact", "fidelity": "functional"}"#;
    let axes = r#"[{"path": "algorithm.form", "values": ["exact"]}, {"path": "cores", "values": [1]}]"#;
    let text = format!(r#"{{"name": "form", "base": {base}, "axes": {axes}, "sampling": "one_at_a_time"}}"#);
    folder.write("form.json", &text);
    folder.run(&["study", "form.json"]).ok();
    let study = results(&folder, "out/study-form/study.json");
    let one = study.at(&["exact".into(), 1.into()]).expect("a point");
    assert_eq!(
        (study.points.len(), one.provenance.algorithm.as_str()),
        (2, "sism:form=exact,overlap=bits:64,lights=1")
    );
}

#[test]
fn an_analysis_of_nothing_says_why() {
    let folder = Folder::new();
    let axes = r#"[{"path": "fidelity", "values": ["functional", "windowed"]}]"#;
    let analyses = r#"["speedup", "power_law", "pareto", "sensitivity"]"#;
    let text =
        format!(r#"{{"name": "x", "base": {{"scene": "tiny"}}, "axes": {axes}, "analysis": {analyses}}}"#);
    folder.write("x.json", &text);
    let printed = folder.run(&["study", "x.json"]).ok().stdout();
    assert_eq!(printed.matches("Nothing is shown: the values of fidelity are names").count(), 3, "{printed}");
    assert!(
        printed.contains("Nothing is shown: no two points that have total.ms above 0 differ"),
        "{printed}"
    );
}

/// A study of `tiny` with one part of its text replaced; it must be refused with all of `parts`.
#[track_caller]
fn refused(from: &str, to: &str, parts: &[&str]) {
    let folder = Folder::new();
    assert!(STUDY.contains(from));
    folder.write("small.json", &STUDY.replacen(from, to, 1));
    folder.run(&["study", "small.json"]).refused(parts);
    assert_eq!(folder.names(), ["small.json"], "nothing may be left behind");
}

#[test]
fn bad_studies_are_refused_with_place_and_remedy() {
    refused(
        "l2.capacity_bytes",
        "l2.capacity_byte",
        &["no field `capacity_byte`", "did you mean `capacity_bytes`?", "small.json:6:14"],
    );
    refused("\"cores\"", "\"coress\"", &["`coress` is no path", "did you mean `cores`?", "small.json:5:14"]);
    refused(
        "\"cores\"",
        "\"scene.light.radios\"",
        &["no field `radios`", "did you mean `radius`?", "small.json:5:14"],
    );
    refused(
        "\"cores\"",
        "\"algorithm.from\"",
        &[
            "the algorithm `sism` has no option `from`",
            "did you mean `form`? options: form",
            "small.json:5:14",
        ],
    );
    refused(
        "\"cores\"",
        "\"fidelity.x\"",
        &["`fidelity` has no fields", "a path by itself", "small.json:5:14"],
    );
    refused("\"cores\"", "\"machine.cores\"", &["`machine` has no fields", "`cores`", "small.json:5:14"]);
    refused("[1, 2, 4, 8]", "[]", &["the axis `cores` has no values", "at least one", "small.json:5:5"]);
    refused("[1, 2, 4, 8]", "[1, \"many\"]", &["`cores` = \"many\"", "expected u32", "small.json:5:37"]);
    refused("\"tiny\"", "3", &["`base.scene`", "expected a string", "small.json:3:21"]);
    refused("\"pareto\"", "\"paretto\"", &["an analysis is one of", "\"pareto\"", "small.json:8:"]);
    refused("\"tiny\"", "\"tinny\"", &["`tinny` is no scene", "did you mean `tiny`?", "small.json:3:11"]);
    refused("\"axes\"", "\"axis\"", &["unknown field `axis`", "`axes`"]);
    refused(
        "\"analysis\": [\"table\"",
        "\"columns\": [\"total.fps\", \"phases.sotf.ms\"], \"analysis\": [\"table\"",
        &["`phases.sotf.ms` is no number of a report", "did you mean `phases.soft.ms`?", "small.json:8:28"],
    );
    refused(
        "\"axes\"",
        "\"metric\": \"total.ms / scene.triangels\", \"axes\"",
        &["`scene.triangels` is no number of a report", "did you mean `scene.triangles`?", "small.json:4:13"],
    );
    let published = |point: &str, path: &str| {
        format!(
            r#""published": [{{"source": "a paper", "point": {point}, "numbers": {{"{path}": 1}}}}], "axes""#
        )
    };
    refused(
        "\"axes\"",
        &published("{\"core\": 1}", "total.ms"),
        &["`published[0].point` names `core`, which is no axis", "axes: cores"],
    );
    refused(
        "\"axes\"",
        &published("{\"cores\": 3}", "total.ms"),
        &["`published[0].point` names 3, which is no value of the axis `cores`"],
    );
    refused(
        "\"axes\"",
        &published("{\"cores\": 1}", "totl.ms"),
        &["`totl.ms` is no number of a report", "did you mean `total.ms`?"],
    );
    refused(
        "\"axes\"",
        "\"metric\": \"totl.ms\", \"axes\"",
        &["`totl.ms` is no number of a report", "did you mean `total.ms`?", "small.json:4:13"],
    );
    refused(
        "\"axes\"",
        "\"metric\": \"phases.soft.ms_interval\", \"axes\"",
        &["`phases.soft.ms_interval` is a list of numbers; it must be one number", "small.json:4:13"],
    );
    refused(
        "\"pareto\"",
        "{\"kind\": \"pareto\", \"x\": \"core\", \"y\": \"total.ms\"}",
        &["`core` is no number of a report", "did you mean `cores`?", "small.json:8:"],
    );
    refused(
        "\"analysis\"",
        "\"sampling\": {\"random\": {\"points\": 0, \"seed\": 1}}, \"analysis\"",
        &["`points` is 0; it must be at least 1", "small.json:8:"],
    );
    refused(
        "\"scene\": \"tiny\"",
        "\"machine\": \"larabee-24\"",
        &["`larabee-24` is no machine", "did you mean"],
    );
    refused(
        "\"analysis\"",
        "\"exclude\": [{\"core\": 1}], \"analysis\"",
        &["`core`, which is no axis", "axes: cores"],
    );
    refused(
        "\"analysis\"",
        "\"exclude\": [{\"cores\": [1, 3]}], \"analysis\"",
        &["`exclude[0]` names 3, which is no value of the axis `cores`", "small.json:8:"],
    );
}

#[test]
fn a_million_points_are_asked_for_twice() {
    let values: Vec<String> = (1..=1000).map(|value| value.to_string()).collect();
    let many = format!("[{}]", values.join(", "));
    let folder = Folder::new();
    let study = STUDY.replace("[1, 2, 4, 8]", &many).replace("[131072, 262144]", &many);
    folder.write("large.json", &study);
    folder.run(&["study", "large.json"]).refused(&["the study has 1000000 points", "`--yes`", "random"]);
    let third = format!("{{\"path\": \"l2.ways\", \"values\": {many}}},\n    {{\"path\": \"cores\"");
    folder.write("huge.json", &study.replace("{\"path\": \"cores\"", &third));
    folder.run(&["study", "huge.json", "--yes"]).refused(&["1000000000 points", "at most 1000000"]);
}

#[test]
fn analyses_of_before_do_not_stay_beside_new_ones() {
    let folder = Folder::new();
    folder.write("a.json", STUDY);
    folder.run(&["study", "a.json"]).ok();
    assert!(folder.path("out/study-small/speedup.csv").exists());
    folder.write(
        "b.json",
        &STUDY.replace(r#"["table", "speedup", "pareto", "power_law", "sensitivity"]"#, r#"["table"]"#),
    );
    folder.run(&["study", "b.json"]).ok();
    assert_eq!(
        names(&folder.path("out/study-small")),
        [
            "SHA256SUMS",
            "host.json",
            "report.html",
            "study.json",
            "table.csv",
            "table.md",
            "table.png",
            "table.svg"
        ]
    );
}

#[test]
fn ranges_of_whole_numbers_are_drawn_whole() {
    let folder = Folder::new();
    let study = |axis: &str| {
        let base = r#"{"scene": "tiny", "fidelity": "functional", "set": {"scene.image.height": 8}}"#;
        let sampling = r#"{"random": {"points": 6, "seed": 7}}"#;
        let text = format!(r#"{{"name": "r", "base": {base}, "axes": [{axis}], "sampling": {sampling}}}"#);
        folder.write("study.json", &text);
        folder.run(&["study", "study.json"])
    };
    let drawn = || -> Vec<serde_json::Value> {
        results(&folder, "out/study-r/study.json")
            .points
            .iter()
            .map(|point| point.values[0].clone())
            .collect()
    };
    for draw in ["", r#", "draw": "log""#] {
        for (path, min, max) in [("cores", 1.0, 64.0), ("scene.image.width", 1.5, 16.5)] {
            study(&format!(r#"{{"path": "{path}", "min": {min}, "max": {max}{draw}}}"#)).ok();
            for value in drawn() {
                assert!(value.as_u64().is_some_and(|n| (min..=max).contains(&(n as f64))), "{path}: {value}");
            }
        }
    }
    study(r#"{"path": "clock_ghz", "min": 1, "max": 2}"#).ok();
    assert!(drawn().iter().all(|value| value.is_f64() && value.as_f64().is_some_and(|n| n.fract() != 0.0)));
    study(r#"{"path": "cores", "min": 1.2, "max": 1.8}"#).refused(&["has no whole number in its range"]);
    study(r#"{"path": "l2.ways", "min": 5, "max": 7, "draw": "power_of_two"}"#)
        .refused(&["has no power of two in its range"]);
}

#[test]
fn what_cannot_be_meant_is_refused() {
    let folder = Folder::new();
    let study = |name: &str, base: &str, axes: &str, analysis: &str| {
        let text =
            format!(r#"{{"name": "{name}", "base": {base}, "axes": [{axes}], "analysis": ["{analysis}"]}}"#);
        folder.write("study.json", &text);
        folder.run(&["study", "study.json"])
    };
    let (tiny, cores) = (r#"{"scene": "tiny"}"#, r#"{"path": "cores", "values": [1, 2]}"#);
    for name in ["a/../b", "", ".hidden"] {
        study(name, tiny, cores, "table").refused(&["it must be a name for a folder", "study.json:1:10"]);
    }
    study("x", tiny, r#"{"path": "cores", "values": [1, 1.0]}"#, "table")
        .refused(&["the axis `cores` has the value 1.0 twice", "study.json:1:"]);
    let untimed = r#"{"scene": "tiny", "fidelity": "functional"}"#;
    study("x", untimed, cores, "speedup").refused(&["functional runs have no times"]);
    let many = r#"{"scene": "tiny", "warm_frames": 100000}"#;
    study("x", many, cores, "table").refused(&["100000 warm frames; there must be at most 1000"]);
    let ring = r#"{"path": "ring.bytes_per_cycle", "values": [63]}"#;
    assert_eq!(study("x", tiny, ring, "table").code(), Some(1));
    // The scene that a study does not name is said.
    let printed = study("x", r#"{"fidelity": "functional"}"#, r#"{"path": "cores", "values": [1]}"#, "table")
        .ok()
        .stdout();
    let method = "soft irregular shadow mapping (Johnson et al. 2009), form=exact,overlap=bits:64,lights=1";
    assert!(
        printed.starts_with(&format!("Study x: saloon-small on larrabee-24, {method}, functional\n")),
        "{printed}"
    );
    assert!(printed.contains("\n1 point: 1 run,"), "{printed}");
}

#[test]
fn unknown_studies_and_options_are_refused() {
    let folder = Folder::new();
    folder.run(&["study", "core"]).refused(&["`core` is no study", "did you mean `cores`?"]);
    folder.run(&["study", "cores", "-j", "0"]).refused(&["`--jobs` is 0; it must be from 1 to 1024"]);
    folder.run(&["study", "cores", "--sbatch-arg=--time=5"]).refused(&["are for a cluster"]);
    folder.run(&["study", "export", "cores", "--shards", "0"]).refused(&["`--shards` is 0"]);
    folder.write("file", "");
    folder.run(&["study", "cores", "--cache", "file"]).refused(&["cannot create the cache"]);
    folder.run(&["study", "cores", "-o", "file"]).refused(&["cannot create file"]);
}

#[test]
fn every_shipped_study_is_sound() {
    for name in lrbsim::study::builtin_study_names() {
        let study = lrbsim::study::Study::load(name, false).expect(name);
        assert_eq!(study.file.name, name);
        assert!(study.len() >= 2 && !study.file.question.is_empty(), "{name}");
    }
    // Those that are files are planned, whose options are known then; some models are not in the checkout.
    let folder = Folder::new();
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/studies");
    for name in names(&files) {
        if ["accuracy-models.json", "accuracy-printed.json"].contains(&name.as_str()) {
            continue;
        }
        let path = files.join(&name);
        let path = path.to_str().expect("UTF-8");
        let study = lrbsim::study::Study::load(path, false).expect(path);
        assert!(study.len() >= 2 && !study.file.question.is_empty(), "{name}");
        assert_eq!(folder.run(&["study", "export", path]).code(), Some(0), "{name}");
    }
}

#[test]
fn other_paths_change_with_an_axis() {
    let folder = Folder::new();
    let axes = |with: &str| {
        format!(
            r#"{{"name": "w", "base": {{"scene": "tiny"}}, "axes": [{{"path": "cores", "values": [2, 4], "with": {{{with}}}}}]}}"#
        )
    };
    folder.write("w.json", &axes(r#""memory.bandwidth_gb_per_s": [4, 8], "scene.image.width": [16, 32]"#));
    folder.run(&["study", "w.json", "-o", "w"]).ok();
    let study = results(&folder, "w/study.json");
    for (cores, bandwidth, width) in [(2, 4, 16), (4, 8, 32)] {
        let point = study.at(&[cores.into()]).expect("a point of the study");
        let size = format!("{width}x{}", point.scene.height);
        let set = [format!("cores={cores}"), format!("memory.bandwidth_gb_per_s={bandwidth}")];
        let text = folder
            .run(&["run", "tiny", "--json", "--size", &size, "--set", &set[0], "--set", &set[1]])
            .ok()
            .stdout();
        let mut report: lrbsim_reports::RunReport = serde_json::from_str(&text).expect("a report");
        report.machine.sources.clear();
        assert_eq!(*point, report, "{set:?} {size}");
    }
    for (with, said) in [
        (r#""l2.ways": [8]"#, "`l2.ways` has 1 values"),
        (r#""cores": [1, 2]"#, "and with another too"),
        (r#""l2.way": [8, 8]"#, "l2.way"),
        (r#""l2.ways": [8, "many"]"#, "w.json:1:"),
    ] {
        folder.write("w.json", &axes(with));
        folder.run(&["study", "w.json"]).refused(&[said, "w.json:1:"]);
    }
}
