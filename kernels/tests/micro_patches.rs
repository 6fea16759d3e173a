//! Soft shadow maps by micro-patches: the paper's formulas by the oracles, the reference curve, a model in f64.

mod common;

use common::{Lanewise, On, cases, draw, evaluate, input, polygons};
use lrbsim_isa::{HostSimd, Vpu};
use lrbsim_kernels::micro_patches::{MicroPatches, geometry};
use lrbsim_workloads::glam::{DVec2, DVec3};
use lrbsim_workloads::reference::ErrorMetrics;
use lrbsim_workloads::{Light, Mesh, ShadowInput};
use serde_json::Value;

fn on() -> On {
    On::Host(HostSimd::detect(), 2)
}

fn number(value: &Value, name: &str) -> f64 {
    value[name].as_f64().unwrap_or_else(|| panic!("`{name}` is no number"))
}

/// The penumbra's rectangle along one axis, on the image plane.
#[derive(Clone)]
struct Rectangle;

impl Lanewise<5, 2> for Rectangle {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [light, x0, x1, patch, receiver]: [V::F32; 5]) -> [V::F32; 2] {
        let (patch, receiver) = (v.vrcp(patch), v.vrcp(receiver));
        let half = v.vset_f32(0.5);
        let half = v.vmul(light, half);
        let (low, high) = (v.vmul(x0, patch), v.vmul(x1, patch));
        let reach = geometry::reach(v, patch, receiver, half);
        [v.vsub(low, reach), v.vadd(high, reach)]
    }
}

#[test]
fn rectangles_of_penumbras_agree() {
    let all = cases("atty_rect");
    let of = |case: &Value| ["L", "x0", "x1", "z_P", "z_R"].map(|name| number(&case["inputs"], name));
    let inputs: Vec<[f32; 5]> = all.iter().map(|case| of(case).map(|x| x as f32)).collect();
    for (case, [low, high]) in all.iter().zip(evaluate(&Rectangle, &inputs)) {
        let [light, x0, x1, patch, receiver] = of(case);
        let relative = number(&case["tolerance"], "rel_f32");
        let check = |what: &str, found: f64, scale: f64| {
            let expected = number(&case["expected"], what);
            assert!((found - expected).abs() <= relative * scale, "{} {what}: {found}", case["id"]);
        };
        // On the receiver's plane; a middle of 0 is as exact as its ends.
        let (low, high) = (f64::from(low) * receiver, f64::from(high) * receiver);
        check("centre", 0.5 * (low + high), low.abs().max(high.abs()));
        check("width", high - low, number(&case["expected"], "width"));
        let apex = geometry::apex(light, x1 - x0, patch);
        check("apex_z", apex, apex);
    }
}

/// A patch on the light, along one axis: where it begins and ends, and the part between.
#[derive(Clone)]
struct Reprojection;

impl Lanewise<6, 3> for Reprojection {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [light, x0, x1, patch, x, receiver]: [V::F32; 6]) -> [V::F32; 3] {
        let (patch, receiver) = (v.vrcp(patch), v.vrcp(receiver));
        let per_place = geometry::per_place(v, patch, receiver);
        let per_light = v.vrcp(light);
        let per_place = v.vmul(per_place, per_light);
        let place = v.vmul(x, receiver);
        let ends = [x0, x1].map(|edge| {
            let edge = v.vmul(edge, patch);
            let from = v.vsub(edge, place);
            geometry::reprojected(v, from, per_place)
        });
        [ends[0], ends[1], geometry::between(v, ends[0], ends[1])]
    }
}

#[test]
fn reprojections_agree() {
    let all = cases("atty_reprojection");
    let of = |case: &Value| ["L", "x0", "x1", "z_P", "x", "z_R"].map(|name| number(&case["inputs"], name) as f32);
    let found = evaluate(&Reprojection, &all.iter().map(of).collect::<Vec<_>>());
    for (case, found) in all.iter().zip(found) {
        let most = number(&case["tolerance"], "f32");
        for (what, found) in ["a", "b", "fraction"].into_iter().zip(found) {
            // A patch behind the receiver has no place on the light.
            let Some(expected) = case["expected"][what].as_f64() else { continue };
            let off = (f64::from(found) - expected).abs();
            // Places far outside of the light are as exact as they are large.
            assert!(off <= most * expected.abs().max(1.0), "{} {what}: {found}", case["id"]);
        }
    }
}

#[test]
fn what_neighbors_overlap_by_agrees() {
    for case in cases("atty_overlap") {
        let [depth, step, receiver, light, x] =
            ["z_O", "dh", "z_R", "L", "x"].map(|name| number(&case["inputs"], name));
        let relative = number(&case["tolerance"], "rel_f64");
        for (what, found) in [
            ("overlap", geometry::overlap(depth, step, receiver, x)),
            ("x_max", geometry::overlap_from(depth, receiver, light)),
            ("bound", geometry::overlap_bound(depth, step, receiver, light)),
        ] {
            let expected = number(&case["expected"], what);
            assert!((found - expected).abs() <= relative * expected, "{} {what}: {found}", case["id"]);
        }
    }
}

#[test]
fn the_threshold_of_equation_4_agrees() {
    for case in cases("atty_fp16_threshold") {
        let [depth, receiver, tangent, texels, light] =
            ["z_O", "z_R", "tan_alpha", "N", "L"].map(|name| number(&case["inputs"], name));
        let width =
            geometry::patch_width(2.0 * tangent / texels, 1.0 / depth, 1.0 / receiver, light);
        let expected = number(&case["expected"], "patch_width");
        assert!((width - expected).abs() <= 1e-12 * expected, "{}: {width}", case["id"]);
        assert_eq!(Some(width > geometry::F16_WIDTH), case["expected"]["safe"].as_bool(), "{}", case["id"]);
    }
}

/// Depth of the floor that shadows fall on, and the tangent of the half angle of the map that holds it.
const FLOOR: f64 = 4.0;
const TANGENT: f64 = 0.42;

/// Texels of a side of the soft shadow map.
const TEXELS: u32 = 128;

/// A square light of width `width` about the origin, which shines along z.
fn square(width: f64) -> Light {
    Light::Rect { center: DVec3::ZERO, half_u: DVec3::X * (0.5 * width), half_v: DVec3::Y * (0.5 * width) }
}

/// The floor with `occluder` over it, and a receiver in the middle of each texel of the soft shadow map.
fn over_floor(mut occluder: Mesh, light: Light) -> (ShadowInput, Vec<DVec3>) {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let floor = polygons(&[corners.map(|(x, y)| DVec3::new(x * 6.0, y * 6.0, FLOOR)).to_vec()]);
    let first = occluder.positions.len() as u32;
    occluder.positions.extend(&floor.positions);
    occluder.triangles.extend(floor.triangles.iter().map(|t| t.map(|v| v + first)));
    let middle = |i: u32| TANGENT * FLOOR * (f64::from(2 * i + 1) / f64::from(TEXELS) - 1.0);
    let points: Vec<DVec3> = (0..TEXELS * TEXELS)
        .map(|i| DVec3::new(middle(i % TEXELS), middle(i / TEXELS), FLOOR))
        .collect();
    let receivers: Vec<(DVec3, u32)> = points.iter().map(|&p| (p, u32::MAX)).collect();
    (input(occluder, light, &receivers), points)
}

/// A ball as many small triangles.
fn ball(center: DVec3, radius: f64, rings: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let sectors = 2 * rings;
    let at = |ring: u32, sector: u32| {
        let (down, around) = (
            core::f64::consts::PI * f64::from(ring) / f64::from(rings),
            core::f64::consts::TAU * f64::from(sector % sectors) / f64::from(sectors),
        );
        DVec3::new(down.sin() * around.cos(), down.sin() * around.sin(), down.cos())
    };
    for ring in 0..=rings {
        mesh.positions.extend((0..sectors).map(|sector| center + at(ring, sector) * radius));
    }
    let number = |ring: u32, sector: u32| ring * sectors + sector % sectors;
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b] = [number(ring, sector), number(ring, sector + 1)];
            let [c, d] = [number(ring + 1, sector + 1), number(ring + 1, sector)];
            if ring > 0 {
                mesh.triangles.push([a, c, b]);
            }
            if ring + 1 < rings {
                mesh.triangles.push([a, d, c]);
            }
        }
    }
    mesh
}

/// Visible part of a light of width `width`, by 32 by 32 rays that `hides` stops some of: from a point, in a direction.
fn truth(points: &[DVec3], width: f64, hides: impl Fn(DVec3, DVec3) -> bool) -> Vec<f64> {
    let place = |i: u32| width * ((f64::from(i) + 0.5) / 32.0 - 0.5);
    let lights: Vec<DVec3> = (0..1024).map(|i| DVec2::new(place(i % 32), place(i / 32)).extend(0.0)).collect();
    let visible = |p: &DVec3| {
        let hidden = lights.iter().filter(|light| hides(*p, **light - *p)).count();
        1.0 - hidden as f64 / 1024.0
    };
    points.iter().map(visible).collect()
}

/// Draws with these options; the error in Atty's metric beside `truth`.
fn error(options: &str, input: &ShadowInput, truth: &[f64]) -> f64 {
    let drawn: Vec<f64> =
        draw(&MicroPatches, options, input, on()).visibility.into_iter().map(f64::from).collect();
    ErrorMetrics::new(truth, &drawn).atty_mae
}

#[test]
fn the_reference_curve_comes_out_within_15_percent() {
    let (center, radius) = (DVec3::new(0.0, 0.0, 2.2), 0.6);
    // By width of the light: map, one pass, two passes [algorithms, 4.7].
    let curve = [
        (0.1, [(32, 0.042, 0.038), (64, 0.018, 0.015), (128, 0.0086, 0.0064), (200, 0.0071, 0.0047), (256, 0.0065, 0.0041), (512, 0.0062, 0.0040)]),
        (0.4, [(32, 0.043, 0.032), (64, 0.036, 0.023), (128, 0.034, 0.022), (200, 0.034, 0.021), (256, 0.034, 0.021), (512, 0.034, 0.021)]),
        (0.8, [(32, 0.064, 0.045), (64, 0.062, 0.039), (128, 0.061, 0.039), (200, 0.061, 0.038), (256, 0.061, 0.038), (512, 0.061, 0.038)]),
    ];
    for (width, cells) in curve {
        let (input, points) = over_floor(ball(center, radius, 96), square(width));
        let truth = truth(&points, width, |p, along| {
            let to = center - p;
            let t = to.dot(along) / along.length_squared();
            (along * t - to).length() < radius
        });
        for (size, one, two) in cells {
            for (passes, expected) in [(1, one), (2, two)] {
                let options = format!("size={size},ssm={TEXELS},passes={passes},margin=0");
                let found = error(&options, &input, &truth);
                println!("L {width} map {size} passes {passes}: {found:.4}, {expected} ({:+.1} %)", 100.0 * (found / expected - 1.0));
                assert!((found - expected).abs() <= 0.15 * expected, "L {width}, {size}, {passes}: {found}, {expected}");
            }
        }
    }
}
