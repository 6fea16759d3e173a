//! The commands around `run`.

mod common;

use std::process::Stdio;

use common::{Folder, lrbsim, request, run};
use lrbsim::{RunRequest, inputs};
use lrbsim_machine::Fidelity;

#[test]
fn an_exported_scene_gives_the_same_picture() {
    let folder = Folder::new();
    for name in ["tiny", "cornell", "table"] {
        let printed = folder.run(&["scene", "export", name, "-o", "exported"]).ok().stdout();
        assert!(
            printed.contains(&format!("{name}.json")) && printed.contains(&format!("{name}.obj")),
            "{printed}"
        );

        let file = folder.path(&format!("exported/{name}.json"));
        let scene =
            inputs::scene(file.to_str().expect("a plain path")).expect("what is exported can be read");
        let functional = |scene| RunRequest { fidelity: Fidelity::Functional, scene, ..request("tiny") };
        let read_back = run(&functional(scene)).report;
        let shipped = run(&functional(inputs::scene(name).expect("shipped"))).report;
        assert_eq!(read_back, shipped, "{name}");
    }
}

#[test]
fn a_shown_machine_can_be_used_as_a_file() {
    let folder = Folder::new();
    let text = folder.run(&["machine", "show", "larrabee-24", "--set", "cores=7"]).ok().stdout();
    folder.write("seven.json", &text);
    assert_eq!(folder.run(&["machine", "show", "seven.json"]).ok().stdout(), text);
    assert!(folder.run(&["machine", "check", "seven.json"]).ok().stdout().contains("7 cores"));
}

#[test]
fn lists_name_what_is_shipped() {
    let folder = Folder::new();
    let machines = folder.run(&["machine", "list"]).ok().stdout();
    for name in ["larrabee-24", "larrabee-32", "ideal"] {
        assert!(machines.lines().any(|line| line.starts_with(name)), "{machines}");
    }
    let scenes = folder.run(&["scene", "list"]).ok().stdout();
    for name in ["palm", "fern", "street", "saloon", "saloon-small", "tiny", "table", "cornell"] {
        assert!(scenes.lines().any(|line| line.starts_with(name)), "{scenes}");
    }
    let bunny = scenes.lines().find(|line| line.starts_with("bunny")).expect("views of models are listed");
    assert!(bunny.contains("needs bunny.obj") && bunny.contains("LRBSIM_SCENES"), "{bunny}");
    let shown = folder.run(&["scene", "show", "tiny"]).ok().stdout();
    for part in ["triangles", "silhouette edges", "receivers", "light", "penumbra", "camera"] {
        assert!(shown.contains(part), "{shown}");
    }
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let mut child = lrbsim()
        .args(["machine", "show", "larrabee-24"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("it ends");
    assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &b""[..]));
}

#[test]
fn a_model_needs_no_further_options() {
    let folder = Folder::new();
    let box_faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";
    let corners = "v 0 0 0\nv 0 0 1\nv 0 1 0\nv 0 1 1\nv 1 0 0\nv 1 0 1\nv 1 1 0\nv 1 1 1\n";
    folder.write("box.obj", &format!("{corners}{box_faces}"));
    let table = folder.run(&["run", "box.obj", "--size", "80x60"]).ok().stdout();
    assert!(table.contains("80 x 60 pixels"), "{table}");
    assert!(folder.path("out/box-larrabee-24-sism/image.png").exists());
}

/// A ground, and a triangle above it.
const MODEL: &str =
    "v -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nf 4 3 2 1\nv 0 1 0\nv 1 1 0\nv 0 1 1\ng above\nf 5 6 7\n";

#[test]
fn what_is_left_out_of_a_model_is_told() {
    let folder = Folder::new();
    folder.write("model.obj", &format!("{MODEL}F 5 6 7\nF 1 2 3\n"));
    let told = "warning: model.obj:11: 2 lines with `F` left out";
    for args in [
        &["scene", "check", "model.obj"][..],
        &["run", "model.obj", "--size", "8x8", "--fidelity", "functional"],
        &["run", "model.obj", "--size", "8x8", "--fidelity", "functional", "--json"],
    ] {
        let done = folder.run(args);
        assert_eq!(done.code(), Some(0), "{}", done.stderr());
        assert!(done.stderr().starts_with(told) && done.stderr().lines().count() == 1, "{}", done.stderr());
        assert!(!done.stdout().contains("warning"), "{}", done.stdout());
    }
    folder.write("model.obj", MODEL);
    assert!(folder.run(&["scene", "check", "model.obj"]).ok().stdout().contains("sound: 3 triangles"));
}

#[test]
fn a_light_that_touches_something_is_told_with_the_radius_that_counts() {
    let folder = Folder::new();
    let run = ["run", "tiny", "--fidelity", "functional", "--light-radius"];
    folder.run(&[&run[..], &["0.05"]].concat()).ok();
    let done = folder.run(&[&run[..], &["3"]].concat());
    assert_eq!(done.code(), Some(0), "{}", done.stderr());
    assert!(done.stderr().starts_with("warning: the light touches a triangle of `"), "{}", done.stderr());
}

#[test]
fn an_object_moves_by_its_own_name_though_a_group_follows_it() {
    let folder = Folder::new();
    folder.write("model.obj", &MODEL.replace("g above", "o Lamp\ng legs"));
    let scene = lrbsim_workloads::builtin_scene("tiny").expect("shipped");
    let end = scene.rfind('}').expect("an object");
    let scene = scene[..end].replace(r#"{"procedural": "tiny"}"#, r#""model.obj""#);
    for name in ["Lamp", "legs"] {
        let motion =
            format!(r#", "motion": {{"objects": {{"{name}": {{"path": [[0, 0, 0], [1, 0, 0]]}}}}}}}}"#);
        folder.write("scene.json", &format!("{scene}{motion}"));
        folder.run(&["run", "scene.json", "--time", "1", "--fidelity", "functional"]).ok();
    }
}

#[test]
fn a_run_keeps_files_that_it_does_not_write() {
    let folder = Folder::new();
    let kept = ["light.json", "mesh.obj", "receivers.npy"];
    for name in kept {
        folder.write(name, "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n");
    }
    folder.run(&["run", "mesh.obj", "--size", "8x8", "--fidelity", "functional", "-o", "."]).ok();
    assert_eq!(
        folder.names(),
        [
            "host.json",
            "image.png",
            "light.json",
            "mesh.obj",
            "receivers.npy",
            "report.json",
            "visibility.png"
        ]
    );
}

#[test]
fn models_are_looked_up_in_the_search_path_first() {
    let folder = Folder::new();
    let scene = lrbsim_workloads::builtin_scene("tiny").expect("shipped");
    folder.write("scene.json", &scene.replace(r#"{"procedural": "tiny"}"#, r#""model.obj""#));
    let corners = "v -1 0 -1\nv 1 0 -1\nv 0 0 1\nv 0 1 0\n";
    folder.write("model.obj", &format!("{corners}f 1 2 3\n"));
    std::fs::create_dir(folder.path("models")).expect("the folder can be written");
    folder.write("models/model.obj", &format!("{corners}f 1 2 3\nf 1 2 4\n"));
    let triangles = |search: &str| {
        let mut command = lrbsim();
        command.current_dir(folder.path("")).args(["scene", "check", "scene.json"]);
        let output = command.env("LRBSIM_SCENES", search).output().expect("the binary starts");
        String::from_utf8(output.stdout).expect("text")
    };
    assert!(triangles("models").contains("2 triangles"));
    assert!(triangles("nowhere").contains("1 triangle"));
}

/// Fields that an object may have and those it must have, by the schema of a file format.
fn fields_of_schema(folder: &Folder, format: &str) -> (Vec<String>, Vec<String>) {
    let text = folder.run(&["schema", format]).ok().stdout();
    let schema: serde_json::Value = serde_json::from_str(&text).expect("a schema is JSON");
    assert_eq!(schema["additionalProperties"], false, "{format}: unknown fields are errors");
    let properties = schema["properties"].as_object().expect("an object").keys().cloned().collect();
    let required = schema["required"].as_array().expect("a list");
    (properties, required.iter().map(|name| name.as_str().expect("a name").to_owned()).collect())
}

#[test]
fn schemas_describe_what_is_read_and_written() {
    let folder = Folder::new();
    let report = folder.run(&["run", "tiny", "--json", "--fidelity", "functional"]).ok().stdout();
    let machine = lrbsim_machine::builtin_machine("larrabee-24").expect("shipped");
    let scene = lrbsim_workloads::builtin_scene("tiny").expect("shipped");
    for (format, text) in [("report", report.as_str()), ("machine", machine), ("scene", scene)] {
        let (may, must) = fields_of_schema(&folder, format);
        let file: serde_json::Value = serde_json::from_str(text).expect("JSON");
        let file = file.as_object().expect("an object");
        assert!(file.keys().all(|field| may.contains(field)), "{format}: {may:?}");
        assert!(must.iter().all(|field| file.contains_key(field)), "{format}: {must:?}");
    }
}
