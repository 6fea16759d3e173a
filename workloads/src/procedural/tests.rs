use std::collections::BTreeMap;

use super::*;
use crate::adjacency::{Adjacency, prepare};

fn request(name: &str, seed: u32, detail: u32) -> Procedural {
    Procedural { procedural: name.to_owned(), seed, detail, pieces: 1 }
}

#[test]
fn generators_give_the_same_mesh_twice_and_finer_ones_with_detail() {
    for name in NAMES {
        let mesh = build(&request(name, 1, 1)).expect(name);
        assert_eq!(mesh, build(&request(name, 1, 1)).expect(name));
        assert!(build(&request(name, 1, 2)).expect(name).triangles.len() >= mesh.triangles.len());
        let mut objects = mesh.objects.iter();
        let mut last = 0;
        assert!(
            objects.all(|o| core::mem::replace(&mut last, o.last) == o.first),
            "{name}: gaps between objects"
        );
        assert_eq!(last as usize, mesh.triangles.len());
    }
}

#[test]
fn another_seed_moves_the_chairs() {
    assert_ne!(
        build(&request("saloon", 1, 1)).expect("there"),
        build(&request("saloon", 2, 1)).expect("there")
    );
}

#[test]
fn preparing_keeps_every_triangle() {
    for name in NAMES {
        let mut mesh = build(&request(name, 1, 1)).expect(name);
        let before = mesh.triangles.len();
        prepare(&mut mesh);
        assert_eq!(mesh.triangles.len(), before);
        assert!((0..before).all(|t| !crate::adjacency::is_degenerate(&mesh, t)), "{name}");
    }
}

#[test]
fn bodies_of_generators_are_wound_outward() {
    for name in NAMES {
        let mut mesh = build(&request(name, 1, 1)).expect(name);
        prepare(&mut mesh);
        let adjacency = Adjacency::new(&mesh);
        // Six times the volume of each body, about its first corner.
        let mut volumes = BTreeMap::new();
        for (t, body) in adjacency.component.iter().enumerate() {
            let [a, b, c] = mesh.corners(t);
            let (first, volume) = volumes.entry(body).or_insert((a, 0.0));
            *volume += (a - *first).dot((b - *first).cross(c - *first));
        }
        let inward = volumes.values().filter(|(_, volume)| *volume <= 0.0).count();
        assert_eq!(inward, 0, "{name}: of {} bodies", volumes.len());
    }
}

#[test]
fn plates_have_the_triangles_and_edges_that_were_asked_for() {
    for (detail, pieces) in [(1, 1), (1, 16), (2, 4), (4, 8)] {
        let mut mesh =
            build(&Procedural { pieces, ..request("plates", 1, detail) }).expect("a divisor of 16");
        prepare(&mut mesh);
        let triangles = 12 + 1024 * detail * detail + 128 * pieces * (8 + detail);
        assert_eq!(mesh.triangles.len() as u32, triangles, "{detail} {pieces}");
        // A body for each piece, and the floor.
        let adjacency = Adjacency::new(&mesh);
        let bodies = adjacency.component.iter().max().expect("triangles") + 1;
        assert_eq!(bodies, 1 + pieces * pieces);
    }
}
