//! `run --reference`: the picture is judged by shadow rays, which are cast once.

mod common;

use common::{Folder, names, request, run};
use lrbsim::{HostOptions, ReferenceRequest, RunRequest};
use lrbsim_machine::Fidelity;
use serde_json::Value;

/// A floor 4 below a light, and what is `between` the two.
fn scene(folder: &Folder, light: &str, between: &str) {
    let floor = "v -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\nf 4 3 2 1\n";
    folder.write("model.obj", &format!("{floor}{between}"));
    folder.write(
        "scene.json",
        &format!(
            r#"{{"mesh": "model.obj", "camera": {{"eye": [0, 1.5, 3], "target": [0, 0, 1], "fov_y_degrees": 40}},
            "image": {{"width": 48, "height": 36}}, "light": {light}}}"#
        ),
    );
}

/// A roof at height 2, from `west` on to the east.
fn roof(west: f64) -> String {
    format!("v {west} 2 -9\nv 9 2 -9\nv 9 2 9\nv {west} 2 9\nf 8 7 6 5\n")
}

const SPHERE: &str = r#"{"kind": "sphere", "center": [0, 4, 0], "radius": 0.5}"#;

/// The error in the report of a functional run of the scene.
fn error(folder: &Folder, samples: &str) -> Value {
    error_of(folder, samples, "sism")
}

/// [`error`] of this algorithm.
fn error_of(folder: &Folder, samples: &str, algorithm: &str) -> Value {
    let args = ["run", "scene.json", "-a", algorithm, "--fidelity", "functional"];
    let args = [&args[..], &["--reference", samples, "--json", "-o", "results"]].concat();
    let report: Value = serde_json::from_str(&folder.run(&args).ok().stdout()).expect("JSON");
    report["image"]["error"].clone()
}

fn number(error: &Value, name: &str) -> f64 {
    error[name].as_f64().unwrap_or_else(|| panic!("`{name}` is no number in {error}"))
}

#[test]
fn where_nothing_or_everything_is_covered_the_error_is_exactly_0() {
    for (between, shadowed) in [(String::new(), 0), (roof(-9.0), 48 * 36)] {
        let folder = Folder::new();
        scene(&folder, SPHERE, &between);
        let error = error(&folder, "16");
        for name in
            ["mean", "rmse", "max", "p99", "bias", "off_by_quarter", "reference_mean", "reference_rmse"]
        {
            assert_eq!(number(&error, name), 0.0, "{name} in {error}");
        }
        assert_eq!(error["shadowed_receivers"], shadowed);
        assert_eq!(error["samples"], 16);
    }
}

#[test]
fn on_one_straight_edge_the_picture_is_as_right_as_the_reference_can_tell() {
    for light in [SPHERE, r#"{"kind": "disc", "center": [0, 4, 0], "normal": [0, 1, 0], "radius": 0.5}"#] {
        let folder = Folder::new();
        scene(&folder, light, &roof(0.1));
        // No samples of the light, which have an error of their own.
        let error = error_of(&folder, "256", "sism:overlap=sum");
        let own = number(&error, "reference_rmse");
        assert!(own > 0.0 && number(&error, "rmse") < 1.5 * own, "{light}: {error}");
        assert!(number(&error, "bias").abs() < own, "{light}: {error}");
        assert_eq!(number(&error, "off_by_quarter"), 0.0);
        let places: f64 = ["umbra", "penumbra", "light"].iter().map(|at| number(&error["places"], at)).sum();
        assert!((places - number(&error, "mean")).abs() < 1e-12, "{light}: {error}");
    }
    let folder = Folder::new();
    scene(&folder, r#"{"kind": "point", "center": [0, 4, 0]}"#, &roof(0.1));
    let error = error(&folder, "256");
    assert_eq!((number(&error, "mean"), number(&error, "reference_rmse")), (0.0, 0.0), "{error}");
    assert!(error["shadowed_receivers"].as_u64().expect("a count") > 100);
}

#[test]
fn host_threads_change_nothing() {
    let report = |threads| {
        let host = HostOptions { threads, ..HostOptions::default() };
        let reference = Some(ReferenceRequest { samples: 8, cache: None });
        let request = RunRequest { host, reference, fidelity: Fidelity::Functional, ..request("tiny") };
        run(&request).report.to_json()
    };
    let one = report(1);
    assert!(one.contains("\"reference_rmse\""));
    assert!(report(2) == one && report(5) == one);
}

#[test]
fn the_rays_are_cast_once_and_again_for_another_scene() {
    let folder = Folder::new();
    let found = |args: &[&str]| {
        let mut all = vec!["run", "tiny", "--fidelity", "functional", "--reference", "8", "-o", "results"];
        all.extend(args);
        folder.run(&all).ok();
        let host = std::fs::read_to_string(folder.path("results/host.json")).expect("it was written");
        let host: Value = serde_json::from_str(&host).expect("JSON");
        assert!(host["reference_seconds"].as_f64().expect("seconds") > 0.0);
        (
            host["reference_found"].as_bool().expect("a flag"),
            std::fs::read(folder.path("results/report.json")).expect("written"),
        )
    };
    let first = found(&[]);
    assert!(!first.0);
    assert_eq!(found(&[]), (true, first.1), "the same report from the cache");
    assert!(found(&["-m", "larrabee-32"]).0, "rays do not depend on the machine");
    assert!(!found(&["--light-radius", "0.02"]).0 && !found(&["--size", "40x30"]).0);
    assert!(!found(&["--cache", "elsewhere"]).0);
    let there = names(&folder.path("results"));
    assert!(
        ["reference.png", "error.png"].iter().all(|name| there.contains(&(*name).to_owned())),
        "{there:?}"
    );

    // A run without a reference takes the pictures of the reference away, and has no error.
    folder.run(&["run", "tiny", "--fidelity", "functional", "-o", "results"]).ok();
    assert!(!names(&folder.path("results")).contains(&"error.png".to_owned()));
    let report = std::fs::read_to_string(folder.path("results/report.json")).expect("written");
    assert!(report.contains("\"error\": null"));
}

#[test]
fn the_table_and_a_comparison_tell_of_the_error() {
    let folder = Folder::new();
    for (name, samples) in [("a", "8"), ("b", "32")] {
        let done = folder.run(&["run", "tiny", "--reference", samples, "-o", name]).ok();
        let said = done.stdout();
        assert!(said.contains(&format!("error by {samples} rays (their own 0.")), "{said}");
        assert!(said.contains("reference cast in "), "{said}");
    }
    let said = folder.run(&["compare", "a", "b"]).ok().stdout();
    assert!(said.contains("error of the picture") && said.contains("reference rmse"), "{said}");
    let json: Value =
        serde_json::from_str(&folder.run(&["compare", "a", "b", "--json"]).ok().stdout()).expect("JSON");
    let errors = json["comparison"]["errors"].as_array().expect("a list");
    let own = errors.iter().find(|error| error["name"] == "reference_rmse").expect("it is there");
    assert!(own["change"].as_f64().expect("a number") < 0.0, "four times the rays know more: {own}");
}

#[test]
fn what_cannot_be_judged_is_refused() {
    let folder = Folder::new();
    for text in ["0", "1", "-5", "70000", "99999999999", "many"] {
        folder.run(&["run", "tiny", "--reference", text]).refused(&[
            "`--reference` is ",
            text,
            "from 2 to 65536, such as 256",
        ]);
    }
    folder
        .run(&["run", "saloon-orbit", "--frames", "2", "--reference", "8"])
        .refused(&["`--reference` judges one frame", "`--time T`"]);
    folder
        .run(&["run", "tiny", "--size", "8192x8192", "--reference", "65536"])
        .refused(&["there must be at most", "at most 1024 rays a receiver"]);
    assert!(folder.names().is_empty(), "nothing may be left behind: {:?}", folder.names());
}

#[test]
fn a_study_can_measure_errors() {
    let folder = Folder::new();
    let study = |base: &str, axes: &str| {
        let text = format!(
            r#"{{"name": "errors", "base": {{"scene": "tiny", "fidelity": "functional"{base}}},
            "axes": [{axes}], "metric": "image.error.mean", "analysis": ["table"]}}"#
        );
        folder.write("study.json", &text);
        folder.run(&["study", "study.json", "-j", "2", "-o", "study", "--json"])
    };
    let radii = r#"{"path": "scene.light.radius", "values": [0.02, 0.1]}"#;
    study("", radii).refused(&["no reference is asked for", "\"reference\": 256"]);
    study(r#", "reference": 1"#, radii).refused(&["`reference` is 1", "from 2 to 65536"]);
    let report: Value =
        serde_json::from_str(&study(r#", "reference": 8"#, radii).ok().stdout()).expect("JSON");
    for point in report["points"].as_array().expect("points") {
        assert!(point["report"]["image"]["error"]["mean"].as_f64().expect("a number") > 0.0);
    }
    let rays = r#"{"path": "reference", "values": [8, 16]}"#;
    let report: Value = serde_json::from_str(&study("", rays).ok().stdout()).expect("JSON");
    let samples = |point: usize| report["points"][point]["report"]["image"]["error"]["samples"].clone();
    assert_eq!((samples(0), samples(1)), (Value::from(8), Value::from(16)));
}
