//! Moving scenes.

mod common;

use common::Folder;
use lrbsim_reports::frames::FramesReport;

/// `tiny` with a light that moves and an object that turns.
fn moving(folder: &Folder) {
    let text = lrbsim_workloads::builtin_scene("tiny").expect("shipped");
    let end = text.rfind('}').expect("an object");
    let motion = r#""motion": {"light": {"path": [[0, 0, 0], [1, 0, 0]]}}"#;
    folder.write("moving.json", &format!("{}, {motion}}}", &text[..end]));
}

#[test]
fn every_frame_is_the_run_at_its_time() {
    let folder = Folder::new();
    moving(&folder);
    let printed = folder.run(&["run", "moving.json", "--frames", "3", "-o", "all"]).ok().stdout();
    assert!(printed.contains("The worst frame"), "{printed}");
    let frames: FramesReport =
        serde_json::from_slice(&std::fs::read(folder.path("all/frames.json")).expect("written"))
            .expect("JSON");
    for (index, time) in ["0", "0.5", "1"].into_iter().enumerate() {
        let text = folder.run(&["run", "moving.json", "--time", time, "--json", "-o", "one"]).ok().stdout();
        let report: lrbsim_reports::RunReport = serde_json::from_str(&text).expect("JSON");
        assert_eq!(
            (report.image.sha256, report.total.cycles),
            (frames.frames[index].sha256.clone(), frames.frames[index].cycles)
        );
        if index == frames.worst_frame {
            assert_eq!(std::fs::read_to_string(folder.path("all/report.json")).expect("written"), text);
        }
    }
    let worst = frames.frames.iter().map(|frame| frame.cycles).max().expect("frames");
    assert_eq!(frames.frames[frames.worst_frame].cycles, worst);
    assert_ne!(frames.frames[0].sha256, frames.frames[2].sha256, "the light has moved");
    for name in ["animation.png", "frames.csv", "frames.svg", "frames.png", "report.html", "image.png"] {
        assert!(folder.path("all").join(name).is_file(), "{name}");
    }
    let again = std::fs::read(folder.path("all/report.html")).expect("written");
    folder.run(&["report", "all"]).ok();
    let picture = std::fs::read(folder.path("all/image.png")).expect("a picture");
    folder.write("all/image.png", "no picture");
    folder.run(&["report", "all"]).refused(&["all/image.png is not a PNG file"]);
    std::fs::write(folder.path("all/image.png"), picture).expect("it can be put back");
    assert!(std::fs::read(folder.path("all/report.html")).expect("written").len() >= again.len() / 2);
}

#[test]
fn a_study_varies_the_time() {
    let folder = Folder::new();
    moving(&folder);
    folder.write("times.json", r#"{"name": "times", "base": {"scene": "moving.json"}, "axes": [{"path": "time", "values": [0, 1]}]}"#);
    let printed = folder.run(&["study", "times.json"]).ok().stdout();
    assert!(printed.contains("2 points: 2 run"), "{printed}");
}

#[test]
fn what_cannot_move_is_refused() {
    let folder = Folder::new();
    moving(&folder);
    folder.run(&["run", "tiny", "--frames", "2"]).refused(&["nothing moves in `tiny`", "saloon-orbit"]);
    folder.run(&["run", "tiny", "--time", "0.5"]).refused(&["nothing moves in `tiny`"]);
    folder
        .run(&["run", "moving.json", "--time", "1.5"])
        .refused(&["the time is 1.5; it must be from 0 to 1"]);
    folder
        .run(&["run", "moving.json", "--frames", "0"])
        .refused(&["`--frames` is 0; it must be from 1 to 1000"]);
    let text = std::fs::read_to_string(folder.path("moving.json")).expect("written");
    folder.write("bad.json", &text.replace("[[0, 0, 0], [1, 0, 0]]", "[[0, 0, 0]]"));
    folder.run(&["run", "bad.json"]).refused(&["`motion.light.path`", "two or more", "bad.json:"]);
    folder.write(
        "time.json",
        r#"{"name": "t", "base": {"scene": "moving.json"}, "axes": [{"path": "time", "values": [2]}]}"#,
    );
    folder.run(&["study", "time.json"]).refused(&["`time` must be a number from 0 to 1", "time.json:1:"]);
}
