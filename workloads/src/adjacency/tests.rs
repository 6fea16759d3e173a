use std::path::Path;

use glam::DVec3;

use super::*;
use crate::obj;
use crate::reference::Occluders;

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
    assert!(stances(&mesh, &adjacency, light).iter().all(|&stance| stance == Stance::TurnedOver));
    assert_eq!(silhouette_edges(&mesh, &adjacency, light), 0);
    let outside = stances(&mesh, &adjacency, DVec3::splat(1.5));
    assert!(outside.iter().all(|&stance| stance == Stance::AsItRuns));
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
fn faces_that_are_there_twice_count_once_however_they_are_split() {
    let count = |text: &str| {
        let (mesh, adjacency) = prepared(text);
        let counted = (0..mesh.triangles.len()).filter(|&t| adjacency.stands_for[t] as usize == t).count();
        (mesh.triangles.len(), counted)
    };
    let quad = "v 0 0 0\nv 2 0 0\nv 2 0 2\nv 0 0 2\n";
    let halves = ["f 1 2 3\nf 1 3 4\n", "f 1 2 4\nf 2 3 4\n", "f 4 2 1\nf 4 3 2\n"];
    assert_eq!(count(&format!("{quad}{}{}{}", halves[0], halves[1], halves[2])), (6, 2));
    // Of six corners, as a fan from one of them and from another.
    let hexagon = "v 2 0 0\nv 1 0 2\nv -1 0 2\nv -2 0 0\nv -1 0 -2\nv 1 0 -2\n";
    let fan = |k: usize| -> String {
        (1..5).map(|i| format!("f {} {} {}\n", k + 1, (k + i) % 6 + 1, (k + i + 1) % 6 + 1)).collect()
    };
    assert_eq!(count(&format!("{hexagon}{}{}", fan(0), fan(3))), (8, 4));
    // Two ways to split what is not flat are two surfaces, and so are two flat faces that share an edge.
    let warped = quad.replacen("v 2 0 2", "v 2 1 2", 1);
    assert_eq!(count(&format!("{warped}{}{}", halves[0], halves[1])), (4, 4));
    assert_eq!(count(&format!("{quad}v 4 0 0\nv 4 0 2\n{}f 2 5 6\nf 2 6 3\n", halves[0])), (4, 4));
}

#[test]
fn a_box_that_is_exported_for_both_sides_casts_the_shadow_of_one() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/cases/faces-written-twice");
    let visibility = |name: &str| {
        let scene = crate::load_scene(name, &folder).expect("sound");
        let adjacency = Adjacency::new(&scene.mesh);
        let eye = crate::EyeView::render(&scene.mesh, &scene.camera, 64, 48);
        Occluders::from_mesh(&scene.mesh, &adjacency, &scene.light).visibility_of_view(&adjacency, &eye)
    };
    let one = visibility("one_box.json");
    for name in ["both_sides_quads_dcba.json", "same_winding_bcda.json"] {
        // Edges are summed in another order.
        let off = visibility(name).iter().zip(&one).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-12, "{name}: {off}");
    }
}

/// Turned so that rounding puts the light to either side of the faces on which it lies.
#[test]
fn a_light_on_a_closed_body_is_as_one_a_little_off_it() {
    for turn in [glam::DMat3::IDENTITY, glam::DMat3::from_rotation_x(0.7) * glam::DMat3::from_rotation_z(1.9)]
    {
        let (mut mesh, adjacency) = prepared(&(CUBE.to_owned() + &SIDES.concat()));
        mesh.positions.iter_mut().for_each(|p| *p = turn * (*p * 3.0 - DVec3::splat(1.1)));
        for (on, out) in [
            // A face, a diagonal of it, an edge, a corner.
            ([0.3, 1.0, 0.4], [0.0, 1.0, 0.0]),
            ([0.5, 0.5, 0.0], [0.0, 0.0, -1.0]),
            ([0.0, 0.0, 0.6], [-1.0, -1.0, 0.0]),
            ([1.0, 1.0, 1.0], [1.0, 1.0, 1.0]),
        ] {
            let place = |p: [f64; 3]| turn * (DVec3::from(p) * 3.0 - DVec3::splat(1.1));
            let away = turn * DVec3::from(out) * 1e-4;
            let lit = |center: DVec3| -> Vec<bool> {
                let light = crate::Light::Point { center };
                let occluders = Occluders::from_mesh(&mesh, &adjacency, &light);
                let receiver = |k: u32| {
                    let spread = |n: u32| (f64::from(k * n % 997) / 997.0 - 0.5) * 40.0;
                    DVec3::new(spread(1), spread(31), spread(419))
                };
                let is_lit = |k: u32| occluders.visibility_at(receiver(k) - center, u32::MAX) > 0.5;
                (0..997).map(is_lit).collect()
            };
            let (found, expected) = (lit(place(on)), lit(place(on) + away));
            let different = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
            let shares = [&found, &expected].map(|all| all.iter().filter(|&&is_lit| is_lit).count());
            assert!(different <= 5 && shares[1] > 300, "{on:?}: {different} differ, {shares:?} are lit");
        }
    }
}

/// It lies on an edge of a box, and rounding had it see no face of the box at all: 2042 of 2373 receivers were lit.
#[test]
fn a_light_exactly_on_an_edge_of_a_box_casts_its_shadow() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/cases/light-exactly-on-a-face");
    let scene = crate::load_scene("on_155.json", &folder).expect("sound");
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = crate::EyeView::render(&scene.mesh, &scene.camera, 80, 60);
    let lit = |shift: DVec3| {
        let light = crate::Light::Point { center: scene.light.center() + shift };
        let occluders = Occluders::from_mesh(&scene.mesh, &adjacency, &light);
        let visible = occluders.visibility_of_view(&adjacency, &eye);
        // Whether the light reaches a surface that it grazes, or that faces away from it, is not the point.
        let faces = |i: usize| {
            let to_light = (scene.light.center() - eye.points[i]).normalize();
            to_light.dot(eye.normals[i].as_dvec3()) > 1e-3
        };
        (0..visible.len()).filter(|&i| visible[i] > 0.5 && faces(i)).count()
    };
    let (on, beside) = (lit(DVec3::ZERO), lit(DVec3::new(-1e-4, 1e-4, 0.0)));
    assert!(on.abs_diff(beside) < 10 && on < 700, "{on} lit, {beside} from a little off the edge");
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
