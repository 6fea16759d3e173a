//! `compare` explains a change, and `verify` finds one.

mod common;

use common::Folder;
use serde_json::Value;

/// Runs `tiny` with changes into a folder of this name.
fn run(folder: &Folder, name: &str, options: &[&str]) {
    let mut args = vec!["run", "tiny", "-o", name];
    args.extend(options);
    folder.run(&args).ok();
}

fn ps(value: &Value) -> i64 {
    value.as_i64().expect("whole picoseconds")
}

/// The parts of a comparison add up to its whole, and the whole is that of the reports.
#[track_caller]
fn adds_up(comparison: &Value) {
    let total = ps(&comparison["total"]["change_ps"]);
    let sum = |causes: &Value| causes.as_object().expect("causes").values().map(ps).sum::<i64>();
    assert_eq!(sum(&comparison["causes_ps"]), total);
    let phases = comparison["phases"].as_array().expect("phases");
    assert_eq!(phases.iter().map(|phase| ps(&phase["time"]["change_ps"])).sum::<i64>(), total);
    for phase in phases {
        assert_eq!(sum(&phase["causes_ps"]), ps(&phase["time"]["change_ps"]), "{phase}");
    }
}

#[test]
fn more_cores_and_a_smaller_cache_are_explained() {
    let folder = Folder::new();
    run(&folder, "24", &[]);
    run(&folder, "48", &["--set", "cores=48"]);
    run(&folder, "half", &["--set", "l2.capacity_bytes=131072"]);
    for (name, path, after) in [("48", "machine.cores", 48), ("half", "machine.l2.capacity_bytes", 131_072)] {
        let text = folder.run(&["compare", "24", name, "--json"]).ok().stdout();
        let all: Value = serde_json::from_str(&text).expect("JSON");
        adds_up(&all["comparison"]);
        let inputs = all["comparison"]["inputs"].as_array().expect("inputs");
        assert_eq!((inputs.len(), &inputs[0]["path"], &inputs[0]["b"]), (1, &path.into(), &after.into()));
        let report: Value =
            serde_json::from_slice(&std::fs::read(folder.path("24/report.json")).expect("written"))
                .expect("JSON");
        let cycles = report["total"]["cycles"].as_i64().expect("timed");
        assert_eq!(ps(&all["comparison"]["total"]["a_ps"]), cycles * 1000, "at 1 GHz");
        let text = folder.run(&["compare", "24", &format!("{name}/report.json")]).ok().stdout();
        for part in ["soft shadow kernel", "total", "what cores did", "The pictures are the same", path] {
            assert!(text.contains(part), "`{part}` is not in {text}");
        }
    }
}

#[test]
fn a_slowdown_fails_where_it_is_asked_to() {
    let folder = Folder::new();
    run(&folder, "a", &[]);
    run(&folder, "b", &["--set", "cores=2"]);
    assert_eq!(folder.run(&["compare", "a", "b"]).code(), Some(0));
    assert_eq!(folder.run(&["compare", "a", "b", "--fail-above", "5"]).code(), Some(1));
    assert_eq!(folder.run(&["compare", "b", "a", "--fail-above", "5"]).code(), Some(0));
    assert_eq!(folder.run(&["compare", "a", "a", "--fail-above", "0"]).code(), Some(0));
}

#[test]
fn a_slowdown_that_may_be_none_does_not_fail() {
    let folder = Folder::new();
    run(&folder, "a", &[]);
    run(&folder, "b", &["--set", "cores=2"]);
    let certain = folder.run(&["compare", "a", "b", "--fail-above", "5"]);
    assert_eq!(certain.code(), Some(1));
    let mut report: Value =
        serde_json::from_slice(&std::fs::read(folder.path("b/report.json")).expect("written")).expect("JSON");
    report["phases"][0]["ms_interval"] = serde_json::json!([0.0, 1e4]);
    folder.write("b/report.json", &report.to_string());
    let text = folder.run(&["compare", "a", "b", "--fail-above", "5"]).ok().stdout();
    assert!(text.contains("passed") && text.contains("may be above that"), "{text}");
}

#[test]
fn a_point_that_may_be_slower_is_told_beside_one_that_is_as_fast() {
    let folder = Folder::new();
    let study = r#"{"name": "s", "base": {"scene": "tiny"}, "axes": [{"path": "cores", "values": [2, 4]}]}"#;
    folder.write("s.json", study);
    folder.run(&["study", "s.json", "-o", "a"]).ok();
    let path = folder.path("a/study.json");
    let mut after: Value = serde_json::from_slice(&std::fs::read(path).expect("written")).expect("JSON");
    let ms = after["points"][1]["report"]["total"]["ms"].as_f64().expect("timed");
    after["points"][1]["report"]["phases"][0]["ms_interval"] = serde_json::json!([0.0, ms]);
    // What is extrapolated is no run of the same inputs.
    after["points"][1]["report"]["provenance"]["fidelity"] = "sampled:error=5%".into();
    folder.write("b.json", &after.to_string());
    let text = folder.run(&["compare", "a", "b.json", "--fail-above", "2"]).ok().stdout();
    for part in ["the greatest change is 0.00 %", "A change of 0.00 \u{b1} ", "may be above that"] {
        assert!(text.contains(part), "`{part}` is not in {text}");
    }
}

#[test]
fn pictures_that_differ_are_measured() {
    let folder = Folder::new();
    run(&folder, "a", &[]);
    run(&folder, "b", &["--light-radius", "0.5"]);
    run(&folder, "c", &["--size", "32x32"]);
    let text = folder.run(&["compare", "a", "b", "--json"]).ok().stdout();
    let all: Value = serde_json::from_str(&text).expect("JSON");
    let picture = &all["comparison"]["picture"];
    assert_eq!(picture["kind"], "by");
    assert!(
        picture["pixels"].as_u64().expect("a count") > 0 && picture["rmse"].as_f64().expect("a number") > 0.0
    );
    assert!(folder.run(&["compare", "a", "c"]).ok().stdout().contains("other sizes"));
}

#[test]
fn studies_are_compared_point_by_point() {
    let folder = Folder::new();
    let study =
        r#"{"name": "s", "base": {"scene": "tiny"}, "axes": [{"path": "cores", "values": [1, 2, 4]}]}"#;
    folder.write("a.json", study);
    folder.write(
        "b.json",
        &study
            .replace("\"tiny\"", "\"tiny\", \"set\": {\"l2.capacity_bytes\": 131072}")
            .replace("1, 2, 4", "2, 4, 8"),
    );
    folder.run(&["study", "a.json", "-o", "a"]).ok();
    folder.run(&["study", "b.json", "-o", "b"]).ok();
    let text = folder.run(&["compare", "a", "b", "--json"]).ok().stdout();
    let all: Value = serde_json::from_str(&text).expect("JSON");
    let points = all["points"].as_array().expect("points");
    assert_eq!(points.len(), 2);
    points.iter().for_each(|point| adds_up(&point["comparison"]));
    adds_up(&all["comparison"]);
    assert_eq!(all["comparison"]["inputs"][0]["path"], "machine.l2.capacity_bytes");
    let text = folder.run(&["compare", "a", "b"]).ok().stdout();
    assert!(text.contains("2 points with results on one side only"), "{text}");
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = Folder::new();
    run(&folder, "a", &[]);
    run(&folder, "untimed", &["--fidelity", "functional"]);
    std::fs::create_dir(folder.path("empty")).expect("writable");
    folder.run(&["compare", "a", "gone"]).refused(&["cannot read `gone`"]);
    folder
        .run(&["compare", "a", "empty"])
        .refused(&["neither `report.json` nor `study.json`", "lrbsim run -o"]);
    folder.write("a/study.json", "{}");
    folder.run(&["compare", "a", "a"]).refused(&["both `report.json` and `study.json`"]);
    std::fs::remove_file(folder.path("a/study.json")).expect("it is there");
    folder.write("broken.json", "{\"points\": 3}");
    folder.run(&["compare", "a", "broken.json"]).refused(&["broken.json:1:"]);
    folder.run(&["compare", "a", "untimed", "--fail-above", "1"]).refused(&["nothing is timed"]);
    assert!(folder.run(&["compare", "a", "untimed"]).ok().stdout().contains("Nothing is timed"));
    folder.run(&["compare", "a", "a", "--fail-above", "nan"]).refused(&["must be a finite number"]);
}

#[test]
fn a_published_result_is_verified_and_a_change_is_found() {
    let folder = Folder::new();
    let command = ["verify", "p/one", "--write", "--", "run", "tiny", "--set", "cores=3"];
    assert!(folder.run(&command).ok().stdout().contains("published"));
    assert!(folder.run(&["verify", "p"]).ok().stdout().contains("the same, 2 files"));

    // Another number in the published file, or another command.
    let text = std::fs::read_to_string(folder.path("p/one/report.json")).expect("published");
    folder.write("p/one/report.json", &text.replacen("\"cores\": 3", "\"cores\": 4", 1));
    let done = folder.run(&["verify", "p/one/manifest.json"]);
    assert_eq!(done.code(), Some(1));
    assert!(done.stdout().contains("not the file that the manifest names"), "{}", done.stdout());
    assert!(done.stdout().contains("`machine.cores` was 4 and is 3"), "{}", done.stdout());

    // What a host took is published too, and is not the same the next time.
    let command = ["verify", "p/host", "--write", "--", "study", "fidelity", "--quick", "--only", "triad"];
    folder.run(&command).ok();
    assert!(folder.run(&["verify", "p/host"]).ok().stdout().contains("the same, 1 files"));
    folder.write("p/host/prices.json", "{}");
    let done = folder.run(&["verify", "p/host"]);
    assert_eq!(done.code(), Some(1));
    assert!(
        done.stdout().contains("prices.json is not the file that the manifest names"),
        "{}",
        done.stdout()
    );

    folder.run(&["verify", "nowhere"]).refused(&["cannot read `nowhere`", "lrbsim verify DIR"]);
    let outside = Folder::new();
    outside
        .run(&["verify"])
        .refused(&["cannot read `reports/published`", "checkout: run `lrbsim verify` there"]);
    folder.run(&["verify", "."]).refused(&["no published results", "lrbsim verify DIR --write"]);
    folder
        .run(&["verify", "p/two", "--write", "--", "scene", "list"])
        .refused(&["must begin with `run` or `study`"]);
    folder
        .run(&["verify", "p/two", "--write", "--", "run", "-o", "x"])
        .refused(&["names folders for its results"]);
}

#[test]
fn numbers_of_the_readme_are_published_ones() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut readme = std::fs::read_to_string(root.join("README.md")).expect("it is there");
    let report =
        std::fs::read(root.join("reports/published/saloon-small/report.json")).expect("it is published");
    let report: lrbsim_reports::RunReport = serde_json::from_slice(&report).expect("its own JSON");
    let table = lrbsim_reports::table::render(&report);
    if std::env::var_os("LRBSIM_UPDATE_GOLDEN").is_some() {
        let start = readme.find("the table that `lrbsim run` prints").expect("the table has its sentence");
        let start =
            start + readme[start..].find("```text\n").expect("the table is fenced") + "```text\n".len();
        let end = start + readme[start..].find("```").expect("the fence is closed");
        readme.replace_range(start..end, &table);
        std::fs::write(root.join("README.md"), &readme).expect("the checkout can be written");
    }
    assert!(
        readme.contains(&table),
        "the table of README.md is not the published one; run the tests with LRBSIM_UPDATE_GOLDEN=1:\n{table}"
    );
}
