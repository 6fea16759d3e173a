//! Bad input ends with exit code 2 and one clear message, and leaves nothing behind.

mod common;

use common::Folder;

const SCENE: &str = r#"{
  "mesh": "model.obj",
  "camera": {"eye": [0, 2, 5], "target": [0, 0, 0], "fov_y_degrees": 40},
  "image": {"width": 32, "height": 24},
  "light": {"kind": "sphere", "center": [0, 4, 0], "radius": 0.2}
}
"#;
const TRIANGLE: &str = "v -1 0 -1\nv 1 0 -1\nv 0 0 1\nf 1 2 3\n";

/// The shipped machine with one part of its text replaced.
fn machine_file(folder: &Folder, from: &str, to: &str) {
    let text = lrbsim_machine::builtin_machine("larrabee-24").expect("shipped");
    assert!(text.contains(from), "`{from}` is not in larrabee-24.json");
    folder.write("machine.json", &text.replacen(from, to, 1));
}

/// Runs `scene` with `-o results` and demands a refusal with all of `parts`, without results.
#[track_caller]
fn refused(folder: &Folder, args: &[&str], parts: &[&str]) {
    let before = folder.names();
    let mut all = vec!["run"];
    all.extend(args);
    all.extend(["-o", "results/here"]);
    folder.run(&all).refused(parts);
    assert_eq!(folder.names(), before, "nothing may be left behind");
}

#[test]
fn a_missing_file_is_named() {
    let folder = Folder::new();
    refused(&folder, &["gone.json"], &["cannot read `gone.json`"]);
    refused(&folder, &["gone.obj"], &["cannot read `gone.obj`"]);
    refused(&folder, &["tiny", "-m", "gone.json"], &["cannot read `gone.json`"]);
    folder.write("scene.json", SCENE);
    refused(&folder, &["scene.json"], &["model.obj", "scene.json:2:11"]);
    refused(&folder, &["bunny"], &["the model `bunny.obj` is not in", "LRBSIM_SCENES"]);
}

#[test]
fn an_unknown_name_lists_the_known_ones() {
    let folder = Folder::new();
    refused(&folder, &["salon-small"], &["`salon-small` is no scene", "did you mean `saloon-small`?"]);
    refused(&folder, &["tiny", "-m", "larrabee"], &["`larrabee` is no machine", "larrabee-24"]);
    refused(
        &folder,
        &["tiny", "-a", "sism2"],
        &[
            "`sism2` is no algorithm; it must be `sism`, `hard`, `shadow-map`, `pcss`, `penumbra-map`, `heidrich`, `atty`, `raytrace` or `sintorn`",
        ],
    );
    refused(
        &folder,
        &["tiny", "-a", "sism:form=round"],
        &["`form` of `sism` is `round`; it must be `exact` or `printed`"],
    );
    let nothing = "has no option after its colon; it must be";
    refused(
        &folder,
        &["tiny", "-a", "sism:"],
        &["`sism:`", nothing, "`sism`, or `form=…`, `overlap=…`, `lights=…`, `sums=…` or `angle=…` after it"],
    );
    refused(&folder, &["tiny", "--fidelity", "windowed:"], &["`windowed:`", nothing, "`windowed`"]);
    for text in ["sism:,,", "sism:form=exact,"] {
        refused(
            &folder,
            &["tiny", "-a", text],
            &[
                "a comma without an option",
                "it must be `form=…`, `overlap=…`, `lights=…`, `sums=…` or `angle=…`",
            ],
        );
    }
    for text in ["sism:form", "sism:form="] {
        refused(
            &folder,
            &["tiny", "-a", text],
            &["`form` of `sism` has no value; `form=` must be followed by `exact` or `printed`"],
        );
    }
    refused(&folder, &["tiny", "--fidelity", "exact"], &["`exact` is no fidelity"]);
    refused(&folder, &["tiny", "--host-simd", "mmx"], &["mmx"]);
}

#[test]
fn options_that_do_not_go_together_are_refused() {
    let folder = Folder::new();
    for (option, right) in [("form=printed", "exact"), ("sums=f16", "fixed"), ("angle=acos", "atan2")] {
        let (name, _) = option.split_once('=').expect("an option");
        let said = format!("`{option}` of `sism` sums parts of the light, and `overlap=bits:64` sums none");
        let right = format!("it must be `overlap=sum` or `{name}={right}`");
        let text = format!("sism:{option},overlap=bits:64");
        refused(&folder, &["tiny", "-a", &text], &[&said, &right]);
        // In a study, where each comes from a part of its own.
        let axis = format!(r#"{{"path": "algorithm.{name}", "values": ["{}"]}}"#, &option[name.len() + 1..]);
        let base = r#"{"scene": "tiny", "fidelity": "functional", "algorithm": "sism:overlap=bits:64"}"#;
        folder.write("study.json", &format!(r#"{{"name": "x", "base": {base}, "axes": [{axis}]}}"#));
        folder.run(&["study", "study.json"]).refused(&[&said, &right]);
    }
}

#[test]
fn the_printed_form_of_a_disc_is_refused() {
    let folder = Folder::new();
    folder.write("model.obj", TRIANGLE);
    let sphere = r#""kind": "sphere""#;
    folder.write("scene.json", &SCENE.replace(sphere, r#""kind": "disc", "normal": [0, -1, 0]"#));
    refused(
        &folder,
        &["scene.json", "-a", "sism:form=printed,overlap=sum"],
        &["`form=printed` of `sism` takes a light for a sphere", "it must be `form=exact`"],
    );
    let (whole, line) = (
        r#""kind": "sphere", "center": [0, 4, 0], "radius": 0.2"#,
        r#""kind": "linear", "p0": [-1, 4, 0], "p1": [1, 4, 0]"#,
    );
    folder.write("scene.json", &SCENE.replace(whole, line));
    refused(
        &folder,
        &["scene.json", "-a", "sism:angle=acos,overlap=sum"],
        &["is for discs, and this light is a line"],
    );
}

#[test]
fn a_rectangle_without_two_sides_is_refused_and_one_with_them_is_drawn() {
    let folder = Folder::new();
    folder.write("model.obj", TRIANGLE);
    let sphere = r#""kind": "sphere", "center": [0, 4, 0], "radius": 0.2"#;
    let with = |light: &str| folder.write("scene.json", &SCENE.replace(sphere, light));
    let rect = r#""kind": "rect", "center": [0, 4, 0], "half_u": [1.5, 0, 0], "half_v": "#;
    for half_v in ["[0, 0, 0]", "[3, 0, 0.001]"] {
        with(&format!("{rect}{half_v}"));
        let said = format!("`light.half_v` is {half_v}; it must be across `light.half_u`");
        refused(&folder, &["scene.json"], &[&said, "scene.json:5:"]);
        folder.run(&["scene", "check", "scene.json"]).refused(&[&said]);
    }
    for light in
        [&format!("{rect}[0, 0, 0.05]"), r#""kind": "linear", "p0": [-1.5, 4, 0], "p1": [1.5, 4, 0]"#]
    {
        with(light);
        folder.run(&["run", "scene.json", "--size", "32x24", "--fidelity", "functional"]).ok();
    }
}

#[test]
fn a_slip_in_a_number_is_refused() {
    let folder = Folder::new();
    refused(&folder, &["tiny", "--warm-frames", "100000"], &["100000 warm frames", "at most 1000"]);
    refused(
        &folder,
        &["tiny", "--set", "ring.bytes_per_cycle=63"],
        &["`ring.bytes_per_cycle` is 63; it must be a power of two from 1 to 64"],
    );
}

#[test]
fn a_byte_order_mark_is_no_part_of_a_file() {
    let folder = Folder::new();
    let mark = "\u{feff}";
    folder.write("model.obj", TRIANGLE);
    folder.write("scene.json", &format!("{mark}{SCENE}"));
    let machine = lrbsim_machine::builtin_machine("larrabee-24").expect("shipped");
    folder.write("machine.json", &format!("{mark}{machine}"));
    let base = r#""base": {"scene": "scene.json", "machine": "machine.json", "fidelity": "functional"}"#;
    let text = format!(r#"{mark}{{"name": "x", {base}, "axes": [{{"path": "cores", "values": [1]}}]}}"#);
    folder.write("study.json", &text);
    folder.run(&["study", "study.json"]).ok();
    for name in ["study", "machine", "scene"] {
        folder.write(&format!("{name}.json"), &format!("{mark}{{ x }}"));
    }
    // What is wrong is pointed at where an editor shows it.
    folder.run(&["study", "study.json"]).refused(&["not sound JSON", "study.json:1:3"]);
    refused(&folder, &["scene.json"], &["not sound JSON", "scene.json:1:3"]);
    refused(&folder, &["tiny", "-m", "machine.json"], &["not sound JSON", "machine.json:1:3"]);
    let wide: Vec<u8> = mark.encode_utf16().chain(SCENE.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    std::fs::write(folder.path("scene.json"), wide).expect("the folder can be written");
    refused(&folder, &["scene.json"], &["`scene.json` is UTF-16 text; it must be UTF-8"]);
    std::fs::write(folder.path("scene.json"), b"{\n\"mesh\": \"\xe9\"}").expect("the folder can be written");
    refused(&folder, &["scene.json"], &["`scene.json` is not UTF-8 text: a wrong byte in line 2"]);
}

#[test]
fn broken_json_is_pointed_at() {
    let folder = Folder::new();
    machine_file(&folder, "\"cores\": 24,", "\"cores\": 24");
    refused(
        &folder,
        &["tiny", "-m", "machine.json"],
        &["not sound JSON", "machine.json:5:3", "expected `,` or `}`"],
    );
    folder.write("scene.json", &SCENE[..SCENE.len() / 2]);
    refused(&folder, &["scene.json"], &["not sound JSON", "scene.json:"]);
    folder.write("scene.json", "");
    refused(&folder, &["scene.json"], &["not sound JSON"]);
}

#[test]
fn an_unknown_field_is_pointed_at() {
    let folder = Folder::new();
    machine_file(&folder, "\"cores\": 24,", "\"cores\": 24, \"colour\": 3,");
    refused(
        &folder,
        &["tiny", "-m", "machine.json"],
        &["unknown field `colour`", "`cores`", "machine.json:4:16"],
    );
    folder.write("scene.json", &SCENE.replace("\"radius\"", "\"radios\""));
    refused(&folder, &["scene.json"], &["unknown field `radios`", "expected", "scene.json:5:"]);
}

#[test]
fn a_wrong_type_is_pointed_at() {
    let folder = Folder::new();
    machine_file(&folder, "\"cores\": 24,", "\"cores\": \"many\",");
    refused(&folder, &["tiny", "-m", "machine.json"], &["`cores`", "expected u32", "machine.json:4:12"]);
    folder.write("scene.json", &SCENE.replace("\"width\": 32", "\"width\": 3.5"));
    refused(&folder, &["scene.json"], &["`image.width`", "3.5", "scene.json:4:22"]);
}

#[test]
fn no_cores_are_refused() {
    let folder = Folder::new();
    machine_file(&folder, "\"cores\": 24,", "\"cores\": 0,");
    refused(&folder, &["tiny", "-m", "machine.json"], &["`cores` is 0; it must be", "machine.json:4:12"]);
    refused(&folder, &["tiny", "--set", "cores=0"], &["`cores` is 0; it must be", "--set cores=0"]);
}

#[test]
fn a_cache_without_whole_sets_is_refused() {
    let folder = Folder::new();
    machine_file(&folder, "\"capacity_bytes\": 262144", "\"capacity_bytes\": 262145");
    refused(
        &folder,
        &["tiny", "-m", "machine.json"],
        &["`l2.capacity_bytes` is 262145; it must be a multiple of 512", "machine.json:"],
    );
    refused(&folder, &["tiny", "--set", "l1d.capacity_bytes=1000"], &["`l1d.capacity_bytes` is 1000", "512"]);
}

#[test]
fn a_setting_of_nothing_is_refused() {
    let folder = Folder::new();
    refused(&folder, &["tiny", "--set", "l2.way=4"], &["`l2` has no field `way`", "did you mean `ways`?"]);
    refused(&folder, &["tiny", "--set", "coers=8"], &["no field `coers`", "did you mean `cores`?"]);
    refused(&folder, &["tiny", "--set", "cores=lots"], &["`--set cores=lots`", "expected u32"]);
    refused(&folder, &["tiny", "--set", "cores"], &["has no `=`"]);
    refused(&folder, &["tiny", "--set", "name="], &["`name` is empty; it must be"]);
}

#[test]
fn a_camera_that_is_no_number_is_refused() {
    let folder = Folder::new();
    folder.write("model.obj", TRIANGLE);
    folder.write("scene.json", &SCENE.replace("[0, 2, 5]", "[0, NaN, 5]"));
    refused(&folder, &["scene.json"], &["`NaN` is not a number in JSON", "finite", "scene.json:3:25"]);
    folder.write("scene.json", &SCENE.replace("[0, 2, 5]", "[0, 1e400, 5]"));
    refused(&folder, &["scene.json"], &["number out of range", "scene.json:3:25"]);
    folder.write("scene.json", &SCENE.replace("[0, 2, 5]", "[0, 1e39, 5]"));
    refused(&folder, &["scene.json"], &["`camera.eye`", "must be", "scene.json:3:21"]);
    folder.write("scene.json", &SCENE.replace("[0, 2, 5]", "[0, null, 5]"));
    refused(&folder, &["scene.json"], &["`camera.eye", "null", "scene.json:3:"]);
    folder.write("scene.json", &SCENE.replace("[0, 2, 5]", "[0, 0, 0]"));
    refused(&folder, &["scene.json"], &["`camera.target`", "another point"]);
}

#[test]
fn a_model_without_triangles_is_refused() {
    let folder = Folder::new();
    folder.write("empty.obj", "");
    refused(&folder, &["empty.obj"], &["`empty.obj` has no triangles"]);
    folder.write("model.obj", "v 0 0 0\n");
    folder.write("scene.json", SCENE);
    refused(&folder, &["scene.json"], &["has no triangles"]);
}

#[test]
fn a_model_at_one_point_is_refused() {
    let folder = Folder::new();
    for corners in ["v 1 2 3\nv 1 2 3\nv 1 2 3\n", "v 0 0 0\nv 1e-300 0 0\nv 0 1e-300 0\n"] {
        folder.write("model.obj", &format!("{corners}f 1 2 3\n"));
        refused(
            &folder,
            &["model.obj"],
            &["all vertices of `model.obj` lie at one point", "at least 1e-100"],
        );
        folder.write("scene.json", SCENE);
        refused(&folder, &["scene.json"], &["lie at one point", "scene.json:2:11"]);
    }
}

#[test]
fn a_light_too_large_for_f32_is_refused() {
    let folder = Folder::new();
    let parts = ["`light.radius` is 1e20; it must be at most 1e9 times the scene's diagonal"];
    refused(&folder, &["tiny", "--light-radius", "1e20"], &[parts[0], "`--light-radius`"]);
    folder.write("model.obj", TRIANGLE);
    folder.write("scene.json", &SCENE.replace("0.2", "1e20"));
    refused(&folder, &["scene.json"], &[parts[0], "scene.json:5:"]);
}

#[test]
fn a_result_does_not_replace_an_input() {
    let folder = Folder::new();
    folder.write("mesh.obj", TRIANGLE);
    folder.write("light.json", &SCENE.replace("model", "mesh"));
    let text = lrbsim_machine::builtin_machine("larrabee-24").expect("shipped");
    folder.write("report.json", text);
    let before = folder.names();
    let small = ["--size", "8x8", "--fidelity", "functional"];
    for (scene, more, lost) in [
        ("mesh.obj", &["--dump", "-o", "."][..], "mesh.obj"),
        ("light.json", &["--dump", "-o", "./"], "light.json"),
        ("tiny", &["-m", "report.json", "-o", "."], "report.json"),
    ] {
        let args: Vec<&str> = ["run", scene].into_iter().chain(small).chain(more.iter().copied()).collect();
        folder.run(&args).refused(&[lost, "is an input", "`-o`"]);
        assert_eq!(folder.names(), before);
    }
    folder.run(&["scene", "export", "mesh.obj", "-o", "."]).refused(&["mesh.obj", "is an input"]);
    folder.run(&["scene", "export", "light.json", "-o", "."]).refused(&["light.json", "is an input"]);
    assert_eq!(folder.names(), before);
    assert_eq!(std::fs::read_to_string(folder.path("mesh.obj")).expect("still there"), TRIANGLE);
}

#[test]
fn a_model_with_a_broken_index_is_refused() {
    let folder = Folder::new();
    folder.write("broken.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    refused(&folder, &["broken.obj"], &["broken.obj:4", "9", "1..=3"]);
    folder.write("broken.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n");
    refused(&folder, &["broken.obj"], &["broken.obj:4"]);
    folder.write("broken.obj", "v 0 zero 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    refused(&folder, &["broken.obj"], &["broken.obj:1"]);
}

#[test]
fn an_output_folder_that_cannot_be_written_is_refused_before_the_run() {
    let folder = Folder::new();
    folder.write("file", "not a folder");
    folder.run(&["run", "tiny", "-o", "file"]).refused(&["cannot create", "`file` is a file, not a folder"]);
    folder.run(&["run", "tiny", "-o", "file/below"]).refused(&["cannot create", "file/below"]);
    folder.run(&["scene", "export", "tiny", "-o", "file/below"]).refused(&["cannot create", "file/below"]);
    assert_eq!(folder.names(), ["file"]);
}

#[test]
fn numbers_out_of_range_on_the_command_line_are_refused() {
    let folder = Folder::new();
    refused(&folder, &["tiny", "--size", "640"], &["`--size` is `640`; it must be WIDTHxHEIGHT"]);
    refused(&folder, &["tiny", "--size", "0x10"], &["`--size`", "`image.width` is 0"]);
    refused(&folder, &["tiny", "--light-radius", "-1"], &["`--light-radius`", "-1"]);
    refused(&folder, &["tiny", "--light-radius", "NaN"], &["`--light-radius`", "NaN"]);
    refused(&folder, &["tiny", "--host-threads", "0"], &["`--host-threads` is 0"]);
}

#[test]
fn an_unknown_option_is_refused() {
    let done = Folder::new();
    let done = done.run(&["run", "--frobnicate"]);
    assert!(done.stderr().contains("--frobnicate"), "{}", done.stderr());
}

#[test]
fn checks_tell_sound_from_unsound() {
    let folder = Folder::new();
    machine_file(&folder, "\"cores\": 24,", "\"cores\": 8,");
    assert!(folder.run(&["machine", "check", "machine.json"]).ok().stdout().contains("8 cores"));
    machine_file(&folder, "\"cores\": 24,", "\"cores\": -8,");
    folder.run(&["machine", "check", "machine.json"]).refused(&["`cores`", "-8", "machine.json:4:12"]);
    folder.write("model.obj", TRIANGLE);
    folder.write("scene.json", SCENE);
    assert!(folder.run(&["scene", "check", "scene.json"]).ok().stdout().contains("1 triangle,"));
    folder.write("scene.json", &SCENE.replace("0.2", "-0.2"));
    folder.run(&["scene", "check", "scene.json"]).refused(&["`light.radius` is -0.2", "scene.json:5:"]);
}
