use std::path::Path;

use super::*;
use crate::adjacency::prepare;
use crate::export::mesh_obj;

#[derive(serde::Deserialize)]
struct Case {
    file: String,
    valid: bool,
    expected_triangles: Option<usize>,
}

#[test]
fn every_nasty_file_is_read_or_refused_as_its_manifest_says() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes/nasty");
    let Ok(text) = std::fs::read_to_string(folder.join("manifest.json")) else {
        println!("SKIPPED: {} is not here", folder.display());
        return;
    };
    let cases: Vec<Case> = serde_json::from_str(&text).expect("the manifest is JSON");
    let mut faults = Vec::new();
    for case in &cases {
        let result = read_file(&folder.join(&case.file));
        match (&result, case.valid) {
            (Ok(mesh), true) if Some(mesh.triangles.len()) == case.expected_triangles => {
                let mut prepared = mesh.clone();
                prepare(&mut prepared);
                assert_eq!(prepared.triangles.len(), mesh.triangles.len(), "{}", case.file);
            }
            (Err(error), false) => assert!(error.to_string().contains(&case.file), "{error}"),
            _ => faults.push(format!(
                "{}: valid {}, {:?} triangles, got {:?}",
                case.file,
                case.valid,
                case.expected_triangles,
                result.map(|m| m.triangles.len()).map_err(|e| e.to_string())
            )),
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
    assert_eq!(cases.len(), 97);
}

fn error_of(text: &str) -> String {
    read_bytes(text.as_bytes(), "x.obj").expect_err("this text is bad").to_string()
}

#[test]
fn errors_name_the_place_what_was_found_and_what_would_be_right() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let message = error_of(&format!("{triangle}f 1 2 4\n"));
    assert!(message.contains("x.obj:4") && message.contains("`4`") && message.contains("1..=3"), "{message}");
    let message = error_of(&format!("{triangle}f 1 2\n"));
    assert!(message.contains("2 corners") && message.contains("three or more"), "{message}");
    assert!(error_of("v 0 nan 0\n").contains("finite"));
    assert!(error_of("v 0 1e39 0\n").contains("3.4e38"));
}

fn covered(corners: &[DVec3]) -> f64 {
    triangulate::triangulate(corners)
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|k| corners[k]);
            (b - a).cross(c - a).length() * 0.5
        })
        .sum()
}

#[test]
fn concave_polygons_are_covered_exactly_in_any_plane() {
    // A comb of four teeth, with collinear corners along its back.
    let mut outline = vec![];
    for k in 0..=8 {
        outline.push((f64::from(k), 0.0));
    }
    for k in (0..=8).rev() {
        outline.push((f64::from(k), if k % 2 == 0 { 1.0 } else { 3.0 }));
    }
    for turn in [glam::DMat3::IDENTITY, glam::DMat3::from_rotation_x(1.1), glam::DMat3::from_rotation_y(-2.0)]
    {
        let corners: Vec<DVec3> = outline.iter().map(|&(x, y)| turn * DVec3::new(x, y, 0.0)).collect();
        assert_eq!(triangulate::triangulate(&corners).len(), corners.len() - 2);
        assert!((covered(&corners) - 16.0).abs() < 1e-12);
    }
}

#[test]
fn an_exported_mesh_reads_back_the_same() {
    let mut mesh = crate::procedural::build(&crate::scene::Procedural {
        procedural: "tiny".to_owned(),
        seed: 1,
        detail: 1,
    })
    .expect("tiny exists");
    prepare(&mut mesh);
    let mut back = read_bytes(mesh_obj(&mesh).as_bytes(), "x.obj").expect("our own text is good");
    prepare(&mut back);
    assert_eq!(back, mesh);
}
