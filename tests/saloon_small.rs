//! The default run, end to end, through the binary.

mod common;

use common::{Folder, names};
use lrbsim_reports::{HostReport, RunReport};

#[test]
fn the_default_run_prints_the_table_and_writes_report_and_picture() {
    let folder = Folder::new();
    let done = folder.run(&["run"]).ok();
    let dir = folder.path("out/saloon-small-larrabee-24-sism");

    // The table: every phase, the totals, where the files are.
    let table = done.stdout();
    for part in [
        "saloon-small on larrabee-24 (24 cores at 1 GHz)",
        "silhouette detection *",
        "data structure construction",
        "hard shadow kernel",
        "soft shadow kernel",
        "waits for",
        "paper's total",
        "fps",
        "report.json",
        "image.png",
    ] {
        assert!(table.contains(part), "`{part}` is not in:\n{table}");
    }
    for line in table.lines().filter(|line| !line.starts_with("wrote")) {
        assert!(line.chars().count() <= 120, "{line}");
    }

    // The files, whole and nothing else.
    assert_eq!(names(&dir), ["SHA256SUMS", "host.json", "image.png", "report.json", "visibility.png"]);
    let read = |name: &str| std::fs::read_to_string(dir.join(name)).expect("written");
    let report: RunReport = serde_json::from_str(&read("report.json")).expect("a sound report");
    let host: HostReport = serde_json::from_str(&read("host.json")).expect("a sound report");
    assert!(host.seconds > 0.0 && host.simulated_instructions_per_second > 0.0, "{host:?}");
    let ids: Vec<&str> = report.phases.iter().map(|phase| phase.id.as_str()).collect();
    assert_eq!(ids, ["silhouette", "grid", "bin", "raster", "hard", "soft", "compose"]);
    let outside: Vec<&str> =
        report.phases.iter().filter(|phase| !phase.in_paper_total).map(|phase| phase.id.as_str()).collect();
    assert_eq!(outside, ["silhouette", "bin"]);
    let shares: f64 = report.phases.iter().filter_map(|phase| phase.share).sum();
    assert!((shares - 1.0).abs() < 1e-12, "shares add up to {shares}");
    assert!(report.total.paper_ms < report.total.ms);

    // The scene is the size that was promised, and the picture has light, shadow and penumbra.
    let scene = &report.scene;
    assert!(scene.width >= 640 && scene.height >= 480);
    assert!(scene.triangles >= 10_000 && scene.silhouette_edges >= 1_500, "{scene:?}");
    let mean = report.image.mean_visibility.expect("receivers");
    assert!((0.2..0.95).contains(&mean), "mean visibility {mean}");
    let penumbra = report.image.penumbra_receivers as f64 / scene.receivers as f64;
    assert!(penumbra > 0.05, "only {penumbra} of the receivers in penumbra");
    let picture = image::open(dir.join("image.png")).expect("a PNG");
    assert_eq!((picture.width(), picture.height()), (scene.width, scene.height));
}

#[test]
fn the_json_option_prints_the_report_and_nothing_else() {
    let folder = Folder::new();
    let args = ["run", "tiny", "--json", "--dump", "-o", "r", "--size", "40x30", "--light-radius", "0.3"];
    let printed = folder.run(&args).ok().stdout();
    let written = std::fs::read_to_string(folder.path("r/report.json")).expect("written");
    assert_eq!(printed, written);
    let report: RunReport = serde_json::from_str(&printed).expect("a sound report");
    assert_eq!((report.scene.width, report.scene.height), (40, 30));
    assert_eq!(report.scene.light["radius"], 0.3);
    assert_eq!(
        names(&folder.path("r")),
        [
            "SHA256SUMS",
            "host.json",
            "image.png",
            "light.json",
            "mesh.obj",
            "normals.npy",
            "receivers.npy",
            "report.json",
            "visibility.npy",
            "visibility.png"
        ]
    );
    let npy = std::fs::read(folder.path("r/visibility.npy")).expect("written");
    assert!(npy.starts_with(b"\x93NUMPY") && npy.len() == 128 + 40 * 30 * 4);
    let hash = lrbsim_reports::picture::sha256(&npy[128..]);
    assert_eq!(hash, report.image.sha256, "the hash is that of the dumped values");
}

#[test]
fn without_a_radius_no_soft_phase_costs_anything() {
    let folder = Folder::new();
    let printed = folder.run(&["run", "tiny", "--json", "--light-radius", "0"]).ok().stdout();
    let report: RunReport = serde_json::from_str(&printed).expect("a sound report");
    assert_eq!(report.image.penumbra_receivers, 0);
    let soft = report.phases.iter().find(|phase| phase.id == "soft");
    assert!(soft.is_none_or(|phase| phase.instructions.total == 0), "{soft:?}");
}

#[test]
fn a_functional_run_has_no_times() {
    let folder = Folder::new();
    let printed = folder.run(&["run", "tiny", "--json", "--fidelity", "functional"]).ok().stdout();
    let report: serde_json::Value = serde_json::from_str(&printed).expect("JSON");
    for field in ["cycles", "ms", "fps", "paper_ms", "paper_fps"] {
        assert!(report["total"][field].is_null(), "{field}");
    }
    for phase in report["phases"].as_array().expect("phases") {
        for field in ["cycles", "ms", "share", "ipc", "cycle_stack", "l1d", "l2", "ring", "memory"] {
            assert!(phase[field].is_null(), "{field}");
        }
        assert!(phase["instructions"]["total"].is_u64());
    }
}
