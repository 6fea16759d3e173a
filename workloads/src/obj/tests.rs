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
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/nasty");
    let text = std::fs::read_to_string(folder.join("manifest.json")).expect("the manifest can be read");
    let cases: Vec<Case> = serde_json::from_str(&text).expect("the manifest is JSON");
    let mut faults = Vec::new();
    for case in &cases {
        let result = read_file(&folder.join(&case.file)).map(|file| file.mesh);
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

/// A ground of two triangles before `rest`.
fn on_a_ground(rest: &str) -> ObjFile {
    let ground = "v -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nf 4 3 2 1\n";
    read_bytes(format!("{ground}{rest}").as_bytes(), "x.obj").expect("this text is good")
}

/// Last corner of the last triangle.
fn last_corner(file: &ObjFile) -> [f64; 3] {
    let corners = file.mesh.corners(file.mesh.triangles.len() - 1);
    corners[2].to_array()
}

const TRIANGLE: &str = "v 0 1 0\nv 1 1 0\nv 0 1 1\n";

#[test]
fn a_name_that_ends_in_a_backslash_does_not_swallow_the_next_statement() {
    for name in ["g parts\\", "usemtl textures\\wood\\", "o \\", "mtllib C:\\models\\"] {
        let file = on_a_ground(&format!("{name}\n{TRIANGLE}{name}\nf 5 6 7\n"));
        assert_eq!(file.mesh.triangles.len(), 3, "{name}");
        assert_eq!((last_corner(&file), file.left_out.len()), ([0.0, 1.0, 1.0], 0), "{name}");
    }
    // A list of groups that goes on does so.
    let file = on_a_ground(&format!("{TRIANGLE}g left \\\nright\nf 5 6 7\n"));
    assert!(file.mesh.objects[1].is_called("right"), "{:?}", file.mesh.objects);
}

#[test]
fn a_byte_order_mark_in_mid_file_hides_nothing() {
    let file = on_a_ground(&format!("\u{feff}{TRIANGLE}f -3 -2 -1\n"));
    assert_eq!((file.mesh.triangles.len(), file.mesh.positions.len()), (3, 7));
    assert_eq!(last_corner(&file), [0.0, 1.0, 1.0]);
}

#[test]
fn lines_that_are_not_understood_are_counted() {
    let file = on_a_ground(&format!("{TRIANGLE}F 5 6 7\nF 5 6 7\nsurf 0 1 0 1 5 6 7\nv0 1 2 3\nfo 5 6 7\n"));
    assert_eq!(file.mesh.triangles.len(), 3);
    let found: Vec<_> =
        file.left_out.iter().map(|kind| (kind.keyword.as_str(), kind.first_line, kind.lines)).collect();
    assert_eq!(found, [("F", 9, 2), ("surf", 11, 1), ("v0", 12, 1)]);
}

#[test]
fn numbers_that_old_windows_libraries_print_for_nan_are_refused_as_nan_is() {
    for value in ["-1.#IND", "1.#INF", "1.#QNAN", "-1.#INF00"] {
        for line in [format!("v {value} 0 0"), format!("v 0 0 {value}")] {
            let message = error_of(&format!("{line}\n"));
            assert!(message.contains(value) && message.contains("finite"), "{message}");
        }
    }
    assert_eq!(last_corner(&on_a_ground(&format!("{TRIANGLE}f 5 6 7 # a comment\n"))), [0.0, 1.0, 1.0]);
}

#[test]
fn bytes_of_comments_and_names_are_taken_as_they_are() {
    let triangle = b"v -2 0 -2\nv 2 0 -2\nv 2 0 2\nf 1 2 3\n";
    let read = |head: &[u8]| read_bytes(&[head, triangle].concat(), "x.obj");
    let file = read(b"# caf\xe9 \0\nusemtl b\xf8den\no T\xfcr\n").expect("text that no triangle depends on");
    assert_eq!(file.mesh.objects[0].name, "T\u{fc}r");
    assert!(read(b"v \xe9 0 0\n").expect_err("no number").to_string().contains("x.obj:1"));
    assert!(read(b"\xff\xfev").expect_err("UTF-16").to_string().contains("UTF-16"));
    // All of a file with the line ends of old systems may stand behind a comment.
    assert!(read(b"# old\rv 0 0 0\rf 1 1 1\n").expect_err("CR alone").to_string().contains("U+000D"));
}

#[test]
fn an_object_is_found_by_its_own_name_and_those_of_its_groups() {
    let text = "o floor\nf 1 2 3\no Lamp\ng legs\nf 1 2 3\ng Lamp body\nf 1 2 3\no last\nf 1 2 3\ng first\no it\nf 1 2 3\n";
    let file = read_bytes(format!("{TRIANGLE}{text}").as_bytes(), "x.obj").expect("this text is good");
    let called = |name: &str| -> Vec<usize> {
        (0..file.mesh.objects.len()).filter(|&k| file.mesh.objects[k].is_called(name)).collect()
    };
    for (name, expected) in [
        ("floor", &[0][..]),
        ("Lamp", &[1, 2]),
        ("legs", &[1]),
        ("body", &[2]),
        ("Lamp body", &[2]),
        ("last", &[3]),
        ("first", &[4]),
        ("it", &[4]),
        ("", &[]),
    ] {
        assert_eq!(called(name), expected, "{name}");
    }
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

/// `outline` from every corner, in both directions.
fn every_way_round(outline: &[[f64; 2]]) -> Vec<Vec<DVec3>> {
    let forwards: Vec<DVec3> = outline.iter().map(|&[x, z]| DVec3::new(x, 0.0, z)).collect();
    let backwards: Vec<DVec3> = forwards.iter().rev().copied().collect();
    let mut ways = Vec::new();
    for mut way in [forwards, backwards] {
        for _ in 0..outline.len() {
            way.rotate_left(1);
            ways.push(way.clone());
        }
    }
    ways
}

#[test]
fn polygons_that_touch_themselves_or_have_spikes_are_covered_exactly() {
    let two_squares = [[0, 0], [2, 0], [2, -2], [4, -2], [4, -4], [2, -4], [2, -2], [0, -2]];
    let with_a_spike = [[0, 0], [4, 0], [4, -2], [6, -2], [4, -2], [4, -4], [0, -4]];
    let with_a_notch_of_no_width = [[0, 0], [4, 0], [4, -2], [1, -2], [4, -2], [4, -4], [0, -4]];
    let with_a_hole_by_a_bridge =
        [[0, 0], [6, 0], [6, 6], [0, 6], [0, 0], [2, 2], [2, 4], [4, 4], [4, 2], [2, 2]];
    let three_squares_at_a_point = [
        [0, 0],
        [1, 0],
        [1, 1],
        [0, 1],
        [0, 0],
        [-1, 0],
        [-1, -1],
        [0, -1],
        [0, 0],
        [0, -2],
        [2, -2],
        [2, 0],
    ];
    let a_corner_on_a_side = [[0, 0], [4, 0], [4, 4], [2, 4], [2, 0], [1, 4], [0, 4]];
    let cases: [(&[[i32; 2]], f64); 6] = [
        (&two_squares, 8.0),
        (&with_a_spike, 16.0),
        (&with_a_notch_of_no_width, 16.0),
        (&with_a_hole_by_a_bridge, 32.0),
        (&three_squares_at_a_point, 6.0),
        (&a_corner_on_a_side, 14.0),
    ];
    for (outline, expected) in cases {
        let outline: Vec<[f64; 2]> = outline.iter().map(|p| p.map(f64::from)).collect();
        for corners in every_way_round(&outline) {
            assert_eq!(triangulate::triangulate(&corners).len(), corners.len() - 2);
            assert!((covered(&corners) - expected).abs() < 1e-12, "{}: {corners:?}", covered(&corners));
        }
    }
}

#[test]
fn a_polygon_gives_the_same_triangles_from_any_corner_and_backwards() {
    for outline in [
        &[[0.0, 0.0], [2.0, 0.1], [2.2, 1.9], [0.1, 2.0]][..],
        &[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [3.0, 1.0], [2.0, 4.0], [1.0, 1.0], [0.0, 4.0]],
    ] {
        let sets: Vec<_> = every_way_round(outline)
            .iter()
            .map(|corners| {
                let mut set: Vec<_> = triangulate::triangulate(corners)
                    .iter()
                    .map(|t| {
                        let mut places = t.map(|k| corners[k].to_array().map(f64::to_bits));
                        places.sort_unstable();
                        places
                    })
                    .collect();
                set.sort_unstable();
                set
            })
            .collect();
        assert!(sets.windows(2).all(|pair| pair[0] == pair[1]));
    }
}

/// This took more than a minute when each corner was searched for among all.
#[test]
fn a_polygon_of_many_corners_that_crosses_itself_is_split_at_once() {
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8)
    };
    let corners: Vec<DVec3> = (0..16_000).map(|_| DVec3::new(random(), 0.0, random())).collect();
    assert_eq!(triangulate::triangulate(&corners).len(), corners.len() - 2);
}

#[test]
fn an_exported_mesh_reads_back_the_same() {
    let mut mesh = crate::procedural::build(&crate::scene::Procedural {
        procedural: "tiny".to_owned(),
        seed: 1,
        detail: 1,
        pieces: 1,
    })
    .expect("tiny exists");
    prepare(&mut mesh);
    let mut back = read_bytes(mesh_obj(&mesh).as_bytes(), "x.obj").expect("our own text is good").mesh;
    prepare(&mut back);
    assert_eq!(back, mesh);
}
