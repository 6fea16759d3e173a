//! Methods with a regular shadow map: the map against a dumb model, shadows against those without a map.

mod common;

use common::{
    Random, draw, half_plane, input, on, polygons, random_scene, run_step, same_on_all_back_ends, shipped,
    sphere,
};
use lrbsim_isa::{Arena, Phase, Runner, Step};
use lrbsim_kernels::field;
use lrbsim_kernels::map::DepthMap;
use lrbsim_kernels::map::layout::{MapFace, MapSlot};
use lrbsim_kernels::pcss::Pcss;
use lrbsim_kernels::shadow_map::ShadowMap;
use lrbsim_kernels::sism::Sism;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::{Light, ShadowInput};

/// The map of `input`, and the arena that it is in.
fn map(input: &ShadowInput, size: u32) -> (DepthMap, Arena) {
    let mut arena = Arena::new();
    let mut run = |_: &Phase, step: &Step, arena: &mut Arena| {
        run_step(step, arena, on());
        Ok(())
    };
    let map = DepthMap::draw(&mut input.clone(), size, 2, &mut Runner::new(&mut arena, &mut run))
        .expect("nothing stops it");
    (map, arena)
}

/// A triangle in some direction.
struct Hit {
    /// Reciprocal depth there.
    inverse: f64,
    /// How far inside of it the direction is, as an angle.
    inside: f64,
    /// What the slack of its plane may make of the depth.
    slack: f64,
}

/// The triangles in `direction` or next to it.
fn hits(input: &ShadowInput, direction: DVec3) -> impl Iterator<Item = Hit> {
    input.triangles.iter().zip(&input.counting).filter_map(move |(triangle, rule)| {
        let [a, b, c] = triangle.map(|v| DVec3::from(input.vertices[v as usize].map(f64::from)));
        let normal = (b - a).cross(c - a);
        let distance = a.dot(normal);
        let counts = match rule {
            lrbsim_workloads::Counting::Closed => distance < 0.0,
            _ => distance != 0.0,
        };
        // Inside of all three planes through the light and an edge; each by the angle that it is off.
        let planes = [a.cross(b), b.cross(c), c.cross(a)].map(|n| n.normalize_or_zero() * distance.signum());
        let sides = planes.map(|n| n.dot(direction) / direction.length());
        let least = sides.iter().copied().fold(f64::INFINITY, f64::min);
        let terms = [a, b, c].map(|corner| corner.abs().dot(normal.abs())).into_iter().fold(0.0, f64::max);
        let along = normal.dot(direction);
        let hit = Hit { inverse: along / distance, inside: least, slack: 2e-6 * terms / along.abs() };
        (counts && least > -1e-4).then_some(hit)
    })
}

#[test]
fn every_texel_has_the_nearest_triangle() {
    // Tiles of 16 texels a side, and of 64.
    let maps = (0..12).map(|seed| (seed, 128)).chain([(12, 512), (13, 2048)]);
    let (mut compared, mut covered) = (0, 0);
    for (seed, size) in maps {
        let (mesh, receivers) = random_scene(seed, 300);
        let input = input(mesh, sphere(0.0), &receivers);
        let (map, arena) = map(&input, size);
        let layout = map.layout;
        let (tile, tiles) = (1 << layout.tile_log2, 1 << layout.tiles_log2());
        for slot in 0..layout.slot_count {
            let face = arena.read_u32(layout.slots.host(slot, field!(MapSlot.face)));
            let axis = face as usize / 2;
            let of = |field| f64::from(arena.read_f32(layout.faces.host(face, field)));
            // Every third texel of every fifth row, or as many of larger maps: all tiles, and all places in them.
            let step = |texels: usize| (texels * size as usize / 128) | 1;
            let row = |y| (0..size).step_by(step(3)).map(move |x| (x, y));
            for (x, y) in (0..size).step_by(step(5)).flat_map(row) {
                let mut direction = DVec3::ZERO;
                direction[axis] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
                direction[(axis + 1) % 3] =
                    of(field!(MapFace.origin[0])) + (f64::from(x) + 0.5) * of(field!(MapFace.unit[0]));
                direction[(axis + 2) % 3] =
                    of(field!(MapFace.origin[1])) + (f64::from(y) + 0.5) * of(field!(MapFace.unit[1]));
                let in_tile = (y % tile) * tile + x % tile;
                let number = (slot * tiles + y / tile) * tiles + x / tile;
                let word = number * tile * tile + in_tile;
                let ours = f64::from(arena.read_f32(map.texels.plus_words(u64::from(word))));
                let all: Vec<Hit> = hits(&input, direction).collect();
                if all.iter().any(|hit| hit.inside.abs() < 1e-5) {
                    continue;
                }
                let inside = all.iter().filter(|hit| hit.inside > 0.0);
                let nearest =
                    inside.max_by(|a, b| a.inverse.total_cmp(&b.inverse)).filter(|hit| hit.inverse > 0.0);
                let is_right = nearest.map_or(ours == 0.0, |hit| {
                    (ours - hit.inverse).abs() <= 1e-5 * hit.inverse
                        || (1.0 / ours - 1.0 / hit.inverse).abs() < hit.slack
                });
                let nearest = nearest.map_or(0.0, |hit| hit.inverse);
                assert!(is_right, "seed {seed}, face {face}, texel {x} {y}: {ours}, not {nearest}");
                compared += 1;
                covered += usize::from(nearest > 0.0);
            }
        }
    }
    assert!(compared > 50_000 && covered > 10_000, "{covered} of {compared}");
}

#[test]
fn a_map_of_many_texels_casts_the_hard_shadow_but_for_its_border() {
    for name in ["tiny", "saloon-small"] {
        let (mut scene, eye, _) = shipped(name, Some((160, 120)));
        scene.light = Light::Point { center: scene.light.center() };
        let adjacency = lrbsim_workloads::Adjacency::new(&scene.mesh);
        let input = ShadowInput::new(&scene, &adjacency, &eye);
        let hard = draw(&Sism, "", &input, on()).visibility;
        let mut last = usize::MAX;
        for size in [128, 512, 2048] {
            let ours = draw(&ShadowMap, &format!("size={size},filter=1"), &input, on()).visibility;
            let off = ours.iter().zip(&hard).filter(|(a, b)| a != b).count();
            println!("{name} {size}: {off} of {}", hard.len());
            assert!(off < last, "{name} {size}: {off}, {last} with fewer texels");
            last = off;
        }
        assert!(last * 100 < hard.len(), "{name}: {last} of {}", hard.len());
    }
}

/// A level floor of 4 by 4 under a light, and receivers all over it.
fn floor(light: Light) -> ShadowInput {
    let corners = [(-2.0, -2.0), (-2.0, 2.0), (2.0, 2.0), (2.0, -2.0)].map(|(x, z)| DVec3::new(x, 0.0, z));
    let mut random = Random(3);
    let receivers: Vec<(DVec3, u32)> = (0..2000)
        .map(|_| (random.within(-1.99, 1.99), random.within(-1.99, 1.99)))
        .map(|(x, z)| (DVec3::new(x, 0.0, z), u32::from(x > z)))
        .collect();
    input(polygons(&[corners.to_vec()]), light, &receivers)
}

#[test]
fn a_plane_does_not_shadow_itself_however_grazing_the_light_and_coarse_the_map() {
    for height in [3.0, 0.3, 0.03] {
        let center = DVec3::new(2.5, height, 0.4);
        for (method, options) in [
            (&ShadowMap as &dyn lrbsim_kernels::method::Method, "size=128,filter=7"),
            (&ShadowMap, "size=1024,filter=1"),
            (&Pcss, "size=128"),
        ] {
            let visible =
                draw(method, options, &floor(Light::Sphere { center, radius: 0.1 }), on()).visibility;
            let dark = visible.iter().filter(|x| **x < 1.0).count();
            assert_eq!(dark, 0, "{options} at {height}");
        }
    }
    // The constant part is too little for a light that grazes the floor: that is what the other way is for.
    let light = Light::Point { center: DVec3::new(2.5, 0.03, 0.4) };
    let visible = draw(&ShadowMap, "size=128,filter=1,bias=constant", &floor(light), on()).visibility;
    assert!(visible.contains(&0.0));
}

#[test]
fn pcss_has_the_penumbra_of_a_straight_edge() {
    // Visible part of a disc behind a straight edge, by the distance of the edge from its middle, in radii.
    let profile = |d: f64| 0.5 + (d * (1.0 - d * d).sqrt() + d.asin()) / core::f64::consts::PI;
    let places = [-0.9, -0.5, -0.25, 0.0, 0.25, 0.5, 0.9];
    let across: Vec<f64> = places.iter().map(|d| d * 0.2).chain([-0.3, 0.3]).collect();
    let drawn = draw(&Pcss, "size=2048,search=64,taps=256", &half_plane(&across), on()).visibility;
    let mean = |k: usize| drawn[64 * k..64 * (k + 1)].iter().map(|x| f64::from(*x)).sum::<f64>() / 64.0;
    for (k, d) in places.into_iter().enumerate() {
        println!("{d}: {} for {}", mean(k), profile(d));
        assert!((mean(k) - profile(d)).abs() < 0.02, "{d}: {} for {}", mean(k), profile(d));
    }
    assert_eq!([mean(places.len()), mean(places.len() + 1)], [0.0, 1.0]);
}

#[test]
fn a_filter_of_a_shadow_map_is_as_wide_as_it_says() {
    let across: Vec<f64> = (0..201).map(|k| f64::from(k) * 0.002 - 0.2).collect();
    let input = half_plane(&across);
    for (filter, levels) in [(1, 2), (4, 5), (8, 9)] {
        let drawn = draw(&ShadowMap, &format!("size=128,filter={filter}"), &input, on()).visibility;
        let mut seen: Vec<u32> = drawn.iter().map(|x| (x * filter as f32).round() as u32).collect();
        seen.sort_unstable();
        seen.dedup();
        // The edge is along the texels: a row of the filter after the other passes it.
        assert_eq!(seen.len(), levels, "{filter}: {seen:?}");
    }
}

#[test]
fn maps_are_the_same_on_all_back_ends_and_their_tasks_are_short() {
    let input = shipped("tiny", Some((120, 90))).2;
    same_on_all_back_ends(&ShadowMap, "size=256", &input);
    same_on_all_back_ends(&ShadowMap, "size=128,bias=constant,filter=3", &input);
    same_on_all_back_ends(&Pcss, "size=256", &input);
}
