use std::path::Path;

use glam::DVec3;

use super::*;
use crate::obj;

fn prepared(text: &str) -> (Mesh, Adjacency) {
    let mut mesh = obj::read_bytes(text.as_bytes(), "test").expect("good text").mesh;
    prepare(&mut mesh);
    let adjacency = Adjacency::new(&mesh);
    (mesh, adjacency)
}

const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n";
const SIDES: [&str; 6] =
    ["f 1 4 3 2\n", "f 5 6 7 8\n", "f 1 2 6 5\n", "f 3 4 8 7\n", "f 2 3 7 6\n", "f 1 5 8 4\n"];

#[test]
fn a_cube_is_closed_an_open_box_a_shell_and_a_card_a_sheet() {
    let rule = |sides: &[&str]| {
        let (_, adjacency) = prepared(&(CUBE.to_owned() + &sides.concat()));
        assert!(adjacency.counting.windows(2).all(|w| w[0] == w[1]));
        adjacency.counting[0]
    };
    assert_eq!(rule(&SIDES), Counting::Closed);
    assert_eq!(rule(&SIDES[..5]), Counting::Shell);
    assert_eq!(rule(&SIDES[..1]), Counting::Sheet);
}

#[test]
fn a_cube_shows_four_silhouette_edges_to_a_light_before_one_side_and_six_to_one_before_a_corner() {
    let (mesh, adjacency) = prepared(&(CUBE.to_owned() + &SIDES.concat()));
    assert_eq!(adjacency.edges.len(), 18);
    assert_eq!(silhouette_edges(&mesh, &adjacency, DVec3::new(0.4, 0.6, 5.0)), 4);
    assert_eq!(silhouette_edges(&mesh, &adjacency, DVec3::new(5.0, 5.0, 5.0)), 6);
}

#[test]
fn a_light_inside_a_closed_body_sees_no_silhouette_and_all_of_its_faces() {
    let (mesh, adjacency) = prepared(&(CUBE.to_owned() + &SIDES.concat()));
    let light = DVec3::new(0.5, 0.4, 0.6);
    assert!(light_inside(&mesh, &adjacency, light).iter().all(|&inside| inside));
    assert_eq!(silhouette_edges(&mesh, &adjacency, light), 0);
    assert!(light_inside(&mesh, &adjacency, DVec3::splat(1.5)).iter().all(|&inside| !inside));
}

#[test]
fn weights_of_a_sheet_do_not_depend_on_which_way_it_runs() {
    for face in ["f 1 2 3\n", "f 3 2 1\n"] {
        let (mesh, adjacency) = prepared(&(CUBE.to_owned() + face));
        let weights = edge_weights(&mesh, &adjacency, DVec3::new(0.3, 0.3, 5.0));
        assert!(weights.iter().all(|w| w.front.abs() == 1 && w.front == w.back));
    }
}

#[test]
fn a_triangle_that_is_there_twice_counts_once() {
    let (_, adjacency) = prepared(&(CUBE.to_owned() + "f 1 2 3\nf 2 3 1\nf 3 2 1\n"));
    assert_eq!(adjacency.stands_for, [0, 0, 0]);
    assert_eq!(adjacency.edge_faces.len(), 3);
}

#[test]
fn preparing_twice_changes_nothing() {
    for sides in [&SIDES[..], &SIDES[..5]] {
        let (mesh, _) = prepared(&(CUBE.to_owned() + &sides.concat()));
        let mut again = mesh.clone();
        prepare(&mut again);
        assert_eq!(again, mesh);
    }
}

/// File, rule of all its triangles (or `None`: not all the same), vertices after welding.
const NASTY: [(&str, Option<Counting>, usize); 10] = [
    ("duplicate_vertices", Some(Counting::Closed), 8),
    ("near_duplicate_vertices", Some(Counting::Closed), 8),
    ("inside_out_cube", Some(Counting::Closed), 8),
    ("mixed_winding_cube", Some(Counting::Closed), 8),
    ("edge_shared_by_cubes", Some(Counting::Closed), 14),
    ("bowtie_vertex", Some(Counting::Closed), 7),
    // Welded where it passes through itself, it falls into parts that are closed.
    ("klein_bottle", Some(Counting::Closed), 264),
    ("mobius_strip", Some(Counting::Sheet), 96),
    // Nearer than the weld distance: one plate, which casts the same shadow as two.
    ("parallel_plates_1e-6", Some(Counting::Sheet), 4),
    ("mixed_scales", None, 12),
];

#[test]
fn nasty_topologies_get_the_right_rule() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/nasty");
    for (name, rule, vertices) in NASTY {
        let mut mesh = obj::read_file(&folder.join(format!("{name}.obj"))).expect(name).mesh;
        prepare(&mut mesh);
        let adjacency = Adjacency::new(&mesh);
        assert_eq!(mesh.positions.len(), vertices, "{name}");
        if let Some(rule) = rule {
            assert!(adjacency.counting.iter().all(|&c| c == rule), "{name}: {:?}", adjacency.counting);
        }
    }
}
