//! The commands around `run`.

mod common;

use std::process::Stdio;

use common::{Folder, lrbsim, names, request, run};
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
    assert!(folder.path("out/box-larrabee-24-sism-size=80x60/image.png").exists());
}

#[cfg(unix)]
#[test]
fn names_of_files_need_not_be_text() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt as _;
    let folder = Folder::new();
    let odd = |name: &[u8]| OsStr::from_bytes(name).to_owned();
    let (model, machine, study) = (odd(b"\xff.obj"), odd(b"\xff-machine.json"), odd(b"\xff-study.json"));
    let write = |name: &OsStr, text: &str| {
        std::fs::write(folder.path("").join(name), text).expect("the folder can be written");
    };
    write(&model, "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n");
    write(&machine, lrbsim_machine::builtin_machine("larrabee-24").expect("shipped"));
    let quick = r#"{"name": "x", "base": {"scene": "tiny", "fidelity": "functional"}"#;
    write(&study, &format!(r#"{quick}, "axes": [{{"path": "cores", "values": [1]}}]}}"#));
    let run = |args: &[&OsStr]| {
        let output = lrbsim().current_dir(folder.path("")).args(args).output().expect("the binary starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let plain = |text: &'static str| OsStr::new(text);
    let fine = (Some(0), String::new());
    assert_eq!(run(&[plain("run"), &model, plain("--size"), plain("8x8"), plain("-m"), &machine]), fine);
    assert_eq!(run(&[plain("study"), &study]), fine);
    assert_eq!(run(&[plain("scene"), plain("check"), &model]), fine);
    assert_eq!(run(&[plain("machine"), plain("check"), &machine]), fine);
    // What must be text is named.
    let (code, message) = run(&[plain("run"), plain("tiny"), plain("--size"), &odd(b"8x\xff")]);
    assert_eq!(code, Some(2));
    assert!(message.contains("not UTF-8 text: `8x\u{fffd}`"), "{message}");
}

/// A ground, and a triangle above it.
const MODEL: &str =
    "v -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nf 4 3 2 1\nv 0 1 0\nv 1 1 0\nv 0 1 1\ng above\nf 5 6 7\n";

#[test]
fn what_is_left_out_of_a_model_is_told() {
    let folder = Folder::new();
    folder.write("model.obj", &format!("{MODEL}F 5 6 7\nF 1 2 3\n"));
    let told = "warning: model.obj:11: 2 lines with `F` left out";
    let done = folder.run(&["scene", "check", "model.obj"]);
    assert_eq!(done.code(), Some(0), "{}", done.stderr());
    assert!(done.stderr().starts_with(told) && done.stderr().lines().count() == 1, "{}", done.stderr());
    // A run tells it with its results.
    let run = ["run", "model.obj", "--size", "8x8", "--fidelity", "functional"];
    assert!(folder.run(&run).ok().stdout().contains(told));
    let report = folder.run(&[&run[..], &["--json"]].concat()).ok().stdout();
    let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(report["warnings"][0]["kind"], "lines_left_out");
    folder.write("model.obj", MODEL);
    assert!(folder.run(&["scene", "check", "model.obj"]).ok().stdout().contains("sound: 3 triangles"));
}

#[test]
fn a_light_that_is_cut_by_too_much_is_told_with_the_radius_that_counts() {
    let folder = Folder::new();
    let run = ["run", "tiny", "--fidelity", "functional", "--light-radius"];
    let printed = folder.run(&[&run[..], &["0.5"]].concat()).ok().stdout();
    assert!(!printed.contains("warning: "), "{printed}");
    let printed = folder.run(&[&run[..], &["3"]].concat()).ok().stdout();
    assert!(
        printed.contains("warning: the light is cut by 80 triangles, and shadows are right for 64: "),
        "{printed}"
    );
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
            "SHA256SUMS",
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
fn a_page_goes_where_it_is_asked_to() {
    let folder = Folder::new();
    folder.run(&["run", "tiny", "--fidelity", "functional", "-o", "d"]).ok();
    folder.run(&["report", "d", "-o", "elsewhere"]).ok();
    assert!(folder.path("elsewhere/report.html").exists() && !folder.path("d/report.html").exists());
    folder.run(&["report", "d"]).ok();
    let [there, here] = ["elsewhere", "d"].map(|name| std::fs::read(folder.path(name).join("report.html")));
    assert_eq!(there.expect("written"), here.expect("written"));
}

#[test]
fn studies_that_have_no_points_are_not_exported() {
    let folder = Folder::new();
    for name in ["fidelity", "stability", "table3"] {
        folder.run(&["study", "export", name]).refused(&["has no points to run one by one", "lrbsim study"]);
    }
}

#[test]
fn results_of_before_do_not_stay_beside_new_ones() {
    let folder = Folder::new();
    let quick = ["run", "saloon-orbit", "--size", "16x12", "--fidelity", "functional", "-o", "d"];
    folder.run(&[&quick[..], &["--frames", "2"]].concat()).ok();
    folder.run(&["report", "d"]).ok();
    assert!(folder.path("d/animation.png").exists() && folder.path("d/report.html").exists());
    let plain = ["SHA256SUMS", "host.json", "image.png", "report.json", "visibility.png"];
    let tiny = ["run", "tiny", "--fidelity", "functional", "-o", "d"];
    folder.run(&[&tiny[..], &["--dump"]].concat()).ok();
    assert!(folder.path("d/visibility.npy").exists() && !folder.path("d/animation.png").exists());
    // What somebody has put there or changed since is theirs.
    folder.write("d/notes.txt", "mine");
    folder.write("d/light.json", "changed");
    folder.run(&tiny).ok();
    let mut kept = [&plain[..], &["light.json", "notes.txt"]].concat();
    kept.sort_unstable();
    assert_eq!(names(&folder.path("d")), kept);
    // A model that an earlier run left is spared when it is read.
    folder.run(&[&tiny[..], &["--dump"]].concat()).ok();
    let again = ["run", "d/mesh.obj", "--size", "8x8", "--fidelity", "functional", "-o", "d"];
    folder.run(&again).refused(&["`d/mesh.obj` is an input, and results here would replace it"]);
}

#[test]
fn a_what_if_does_not_replace_the_baseline() {
    let folder = Folder::new();
    folder.run(&["run", "tiny"]).ok();
    folder.run(&["run", "tiny", "--set", "cores=8", "--size", "32x24"]).ok();
    folder.run(&["run", "tiny", "--fidelity", "functional", "--warm-frames", "1"]).ok();
    let [plain, eight] = ["tiny-larrabee-24-sism", "tiny-larrabee-24-sism-cores=8-size=32x24"];
    let untimed = "tiny-larrabee-24-sism-fidelity=functional-warm-frames=1";
    assert_eq!(names(&folder.path("out")), [plain, eight, untimed]);
    let [plain, eight] = [plain, eight].map(|name| format!("out/{name}"));
    assert!(folder.run(&["compare", &plain, &eight]).ok().stdout().contains("machine.cores"));
}

#[test]
fn a_profile_tells_stages_and_kinds_of_work_apart() {
    let folder = Folder::new();
    let timed =
        folder.run(&["run", "saloon-small", "--size", "160x120", "--profile", "-o", "a"]).ok().stdout();
    for row in ["eye view", "soft shadow kernel", "emission", "issue, hits", "private caches", "uncore"] {
        assert!(timed.contains(row), "`{row}` is not in {timed}");
    }
    assert!(!timed.contains("function:"), "all kernels are recorded: {timed}");
    let untimed = ["run", "saloon-small", "--profile", "--fidelity", "functional", "-o", "b"];
    let untimed = folder.run(&untimed).ok().stdout();
    assert!(untimed.contains("function:") && !untimed.contains("uncore"), "{untimed}");
    // A profile changes no result.
    folder.run(&["run", "saloon-small", "--size", "160x120", "-o", "c"]).ok();
    let report = |of: &str| std::fs::read(folder.path(of)).expect("it was written");
    assert!(report("a/report.json") == report("c/report.json"));
}

#[test]
fn results_of_other_inputs_are_not_replaced_without_a_word() {
    let folder = Folder::new();
    let corners = "v -1 0 -1\nv 1 0 -1\nv 0 0 1\nv 0 1 0\n";
    for (name, faces) in [("a", "f 1 2 3\n"), ("b", "f 1 2 3\nf 1 2 4\n")] {
        std::fs::create_dir(folder.path(name)).expect("the folder can be written");
        folder.write(&format!("{name}/model.obj"), &format!("{corners}{faces}"));
    }
    let run =
        |model: &str| folder.run(&["run", model, "--size", "8x8", "--fidelity", "functional"]).ok().stdout();
    assert!(!run("a/model.obj").contains("replaced"));
    assert!(!run("a/model.obj").contains("replaced"));
    let printed = run("b/model.obj");
    assert!(printed.contains("replaced the results of another run (scene.hash was"), "{printed}");
    assert!(printed.contains("`-o DIR` keeps both"), "{printed}");
    let study = |cores: u32| {
        let base = r#"{"scene": "tiny", "fidelity": "functional"}"#;
        let axes = format!(r#"[{{"path": "cores", "values": [{cores}]}}]"#);
        folder.write("s.json", &format!(r#"{{"name": "s", "base": {base}, "axes": {axes}}}"#));
        folder.run(&["study", "s.json"]).ok().stdout()
    };
    assert!(!study(1).contains("replaced"));
    assert!(!study(1).contains("replaced"));
    assert!(study(2).contains("replaced the results of another study of this name in out/study-s"));
}

#[test]
fn suspicious_results_carry_a_warning() {
    let folder = Folder::new();
    let kinds = |args: &[&str]| -> Vec<String> {
        let all = [&["run"], args, &["--fidelity", "functional", "--json"]].concat();
        let report: serde_json::Value = serde_json::from_str(&folder.run(&all).ok().stdout()).expect("JSON");
        let warnings = report["warnings"].as_array().expect("a list").iter();
        warnings.map(|warning| warning["kind"].as_str().expect("a name").to_owned()).collect()
    };
    assert!(kinds(&["tiny"]).is_empty());
    assert_eq!(kinds(&["tiny", "--light-radius", "1000"]), ["light_in_geometry"]);
    let scene = lrbsim_workloads::builtin_scene("tiny").expect("shipped");
    folder.write("away.json", &scene.replace(r#""target": [0.0, 0.5, -0.3]"#, r#""target": [0.3, 50, 3.7]"#));
    assert_eq!(kinds(&["away.json"]), ["nothing_seen"]);
    let printed = folder.run(&["run", "away.json"]).ok().stdout();
    assert!(printed.contains("warning: the camera sees no surface"), "{printed}");

    let base = r#"{"scene": "away.json", "fidelity": "functional"}"#;
    let axes = r#"[{"path": "scene", "values": ["tiny", "away.json"]}]"#;
    folder.write("s.json", &format!(r#"{{"name": "s", "base": {base}, "axes": {axes}}}"#));
    let done = folder.run(&["study", "s.json"]);
    let warning = "warning at 1 of 2 points: the camera sees no surface";
    assert_eq!(done.code(), Some(0), "{}", done.stderr());
    assert!(done.stderr().starts_with(warning), "{}", done.stderr());
    let table = std::fs::read_to_string(folder.path("out/study-s/table.md")).expect("it was written");
    assert!(done.stdout().contains(warning) && table.contains(warning), "{table}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_leaves_nothing_half() {
    let folder = Folder::new();
    for signal in ["INT", "TERM"] {
        // Long enough that it is not over before the signal comes.
        let mut child = lrbsim()
            .current_dir(folder.path(""))
            .args(["run", "saloon-small", "--fidelity", "cycle", "-o", "w"])
            .stdout(Stdio::null())
            .spawn()
            .expect("the binary starts");
        std::thread::sleep(std::time::Duration::from_millis(500));
        let id = child.id().to_string();
        assert!(
            std::process::Command::new("kill").args(["-s", signal, &id]).status().expect("kill").success()
        );
        assert_eq!(child.wait().expect("it ends").code(), Some(130), "{signal}");
        assert!(folder.names().is_empty(), "{signal}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_verification_leaves_nothing_behind() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("temporary")).expect("the folder can be written");
    std::fs::create_dir(folder.path("p")).expect("the folder can be written");
    let command = r#"["run", "saloon-small", "--fidelity", "cycle"]"#;
    let rest = r#""lrbsim_version": "", "semantics": 0, "outputs": {}"#;
    folder.write("p/manifest.json", &format!(r#"{{"command": {command}, {rest}}}"#));
    let mut child = lrbsim()
        .current_dir(folder.path(""))
        .env("TMPDIR", folder.path("temporary"))
        .args(["verify", "p"])
        .stdout(Stdio::null())
        .spawn()
        .expect("the binary starts");
    while names(&folder.path("temporary")).is_empty() {
        assert!(child.try_wait().expect("it runs").is_none(), "it ended before anything was there");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let killed = std::process::Command::new("kill").args(["-s", "TERM", &child.id().to_string()]).status();
    assert!(killed.expect("`kill` is there").success());
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    assert!(names(&folder.path("temporary")).is_empty());
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

#[test]
fn a_model_by_itself_is_a_path_first_and_looked_up_next() {
    let folder = Folder::new();
    let corners = "v -1 0 -1\nv 1 0 -1\nv 0 0 1\nv 0 1 0\n";
    std::fs::create_dir_all(folder.path("configs/scenes/models")).expect("the folder can be written");
    folder.write("configs/scenes/models/model.obj", &format!("{corners}f 1 2 3\n"));
    std::fs::create_dir(folder.path("mine")).expect("the folder can be written");
    folder.write("mine/model.obj", &format!("{corners}f 1 2 3\nf 1 2 4\n"));
    // All get the same floor.
    let triangles = |search: Option<&str>| -> u32 {
        let mut command = lrbsim();
        command.current_dir(folder.path("")).args(["scene", "check", "model.obj"]);
        search.map(|search| command.env("LRBSIM_SCENES", search));
        let printed = String::from_utf8(command.output().expect("the binary starts").stdout).expect("text");
        let count = printed.strip_prefix("model.obj: sound: ").expect("a sound model");
        count.split(' ').next().expect("a word").parse().expect("a number")
    };
    // A checkout needs no variable.
    let found = triangles(None);
    assert_eq!(triangles(Some("mine")), found + 1);
    folder.write("model.obj", &format!("{corners}f 1 2 3\nf 1 2 4\nf 1 3 4\n"));
    assert_eq!(triangles(Some("mine")), found + 2);
}

#[test]
fn models_of_a_checkout_are_found_by_name() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    for (scene, triangles) in
        [("tavern", "63 403"), ("tavern.obj", "63 4"), ("dinner_table", "8 064"), ("table_blocker", "410")]
    {
        let output = lrbsim().current_dir(root).args(["scene", "check", scene]).output();
        let printed = String::from_utf8(output.expect("the binary starts").stdout).expect("text");
        assert!(printed.contains(&format!("{scene}: sound: {triangles}")), "{printed}");
    }
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
