//! Soft shadow maps for linear lights: the paper's formulas by the oracles, penumbras of straight edges, and what few samples miss.

mod common;

use common::{
    Lanewise, On, add_box, add_triangle, cases, data, draw, evaluate, input, polygons, same_on_all_back_ends,
    shipped, sphere,
};
use lrbsim_isa::{HostSimd, Vpu};
use lrbsim_kernels::heidrich::Heidrich;
use lrbsim_kernels::heidrich::channel::{Interpolation, SkinOnFace, factor};
use lrbsim_kernels::heidrich::warp::normals;
use lrbsim_kernels::method::Method;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::reference::{ErrorMetrics, Truth};
use lrbsim_workloads::{Adjacency, EyeView, Light, Mesh, ShadowInput, load_scene};
use serde_json::Value;

fn on() -> On {
    On::Host(HostSimd::detect(), 2)
}

fn number(case: &Value, name: &str) -> f64 {
    case["inputs"][name].as_f64().expect("a number")
}

fn expected(case: &Value, name: &str) -> f64 {
    case["expected"][name].as_f64().expect("a number")
}

// ---- formulas

/// The skin from an edge at depth 1 to what lies behind it at depth 1 + rho, in the picture of a sample that sees it spread out: what is seen of
/// the light at the part g of its width.
#[derive(Clone)]
struct Across(Interpolation);

impl Lanewise<2, 3> for Across {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [g, rho]: [V::F32; 2]) -> [V::F32; 3] {
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let all = v.mask_all();
        let deep = v.vadd(one, rho);
        let mut at = |x: f32, y: f32, depth: V::F32| {
            let place = [v.vset_f32(x), v.vset_f32(y)];
            [v.vmul(place[0], depth), v.vmul(place[1], depth), depth]
        };
        // On the image plane of the face +z: two corners on the occluder at x = 0, one behind it at x = -0.5.
        let corners = [at(0.0, -1.0, one), at(0.0, 1.0, one), at(-0.5, 0.125, deep)];
        let (_, weights, per_depth) = normals(v, all, corners);
        let factors = corners.map(|corner| factor(v, self.0, corner[2], 1e-6));
        let skin = SkinOnFace { weights, per_depth, factors, lit: [zero, zero, factors[2]] };
        let [x, y] = [v.vset_f32(-0.5), v.vset_f32(0.125)];
        let [x, y] = [v.vmul(x, g), v.vmul(y, g)];
        let at_x = skin.at_x(v, x);
        let (weights, inside) = skin.at_y(v, at_x, y);
        let depth = skin.depth(v, weights);
        let inside = v.vblend_f32(inside, one, zero);
        [skin.light(v, weights), v.vrcp(depth), inside]
    }
}

#[test]
fn skins_are_interpolated_as_the_oracles_say() {
    let all = cases("heidrich_skin");
    let inputs: Vec<[f32; 2]> =
        all.iter().map(|case| [number(case, "g") as f32, number(case, "rho") as f32]).collect();
    let affine = evaluate(&Across(Interpolation::Affine), &inputs);
    let perspective = evaluate(&Across(Interpolation::Perspective), &inputs);
    for ((case, affine), perspective) in all.iter().zip(affine).zip(perspective) {
        for (name, [light, depth, inside]) in [("affine", affine), ("perspective", perspective)] {
            let right = expected(case, name);
            assert!((f64::from(light) - right).abs() < 1e-6, "{} {name}: {light} for {right}", case["id"]);
            // Reciprocal depth is linear on the image plane.
            let (g, rho) = (number(case, "g"), number(case, "rho"));
            let right = 1.0 / (1.0 - g + g / (1.0 + rho));
            assert!((f64::from(depth) / right - 1.0).abs() < 1e-6, "{}: depth {depth} for {right}", case["id"]);
            // At the very ends it is rounding that decides.
            assert!(inside == 1.0 || g == 0.0 || g == 1.0, "{}", case["id"]);
        }
    }
}

/// Eq. 1: the point of the light `y = m x + t` that is just seen past the origin from `x2` on the receiver `y = n x + s`.
fn just_seen([m, t, n, s]: [f64; 4], x2: f64) -> f64 {
    x2 * t / ((n - m) * x2 + s)
}

#[test]
fn equation_1_agrees() {
    for case in cases("heidrich_eq1") {
        let x1 = just_seen(["m", "t", "n", "s"].map(|name| number(&case, name)), number(&case, "x2"));
        assert!((x1 / expected(&case, "x1") - 1.0).abs() < 1e-12, "{}", case["id"]);
    }
}

#[test]
fn equation_1_is_as_far_from_linear_as_the_oracles_say() {
    for case in cases("heidrich_nonlinearity") {
        let [m, t, n, a, b] = ["m", "t", "n", "a", "b"].map(|name| number(&case, name));
        // Eq. 1 turned around, for the ends of the penumbra; where the receiver stands changes the size alone.
        let line = [m, t, n, -1.0];
        let receiver = |x1: f64| -x1 / (t - (n - m) * x1);
        let ends = [receiver(a), receiver(b)];
        let deviation = |k: u32| {
            let part = f64::from(k) / 4096.0;
            let seen = (just_seen(line, ends[0] + (ends[1] - ends[0]) * part) - a) / (b - a);
            (seen - part).abs()
        };
        let most = (1..4096).map(deviation).fold(0.0, f64::max);
        let right = expected(&case, "max_dev");
        assert!((most - right).abs() < 1e-6, "{}: {most} for {right}", case["id"]);
    }
}

// ---- straight edges

/// A line along x through the origin, of this half length.
fn line(half: f64) -> Light {
    Light::Linear { p0: DVec3::X * -half, p1: DVec3::X * half }
}

/// A floor at the depth that `depth` gives for each x, from x = -40 to 40; everything lies below the light, at negative z.
fn floor(depth: impl Fn(f64) -> f64) -> Mesh {
    let at = |x: f64, y: f64| DVec3::new(x, y, -depth(x));
    polygons(&[vec![at(-40.0, -40.0), at(40.0, -40.0), at(40.0, 40.0), at(-40.0, 40.0)]])
}

/// The polygon of these corners at a depth.
fn sheet(depth: f64, corners: &[(f64, f64)]) -> Mesh {
    polygons(&[corners.iter().map(|&(x, y)| DVec3::new(x, y, -depth)).collect()])
}

/// The strip from `low` to `high` along x at a depth, long along y.
fn strip(depth: f64, low: f64, high: f64) -> Mesh {
    sheet(depth, &[(low, -20.0), (high, -20.0), (high, 20.0), (low, 20.0)])
}

/// Receivers on a floor of two triangles, which come first in the mesh: 64 along y for each x.
fn rows(depth: impl Fn(f64) -> f64, across: &[f64]) -> Vec<(DVec3, u32)> {
    let place = |x: f64, k: u32| DVec3::new(x, f64::from(k) * 0.01 - 0.32, -depth(x));
    // The second triangle lies left of the diagonal.
    let own = |p: DVec3| (p, u32::from(p.y > p.x));
    across.iter().flat_map(|&x| (0..64).map(move |k| own(place(x, k)))).collect()
}

fn frame(floor: Mesh, occluders: &[Mesh], light: Light, receivers: &[(DVec3, u32)]) -> ShadowInput {
    let mut mesh = floor;
    occluders.iter().for_each(|occluder| mesh.append(occluder));
    input(mesh, light, receivers)
}

/// Means of the 64 receivers of each row.
fn means(drawn: &[f32]) -> Vec<f64> {
    drawn.chunks(64).map(|row| row.iter().map(|x| f64::from(*x)).sum::<f64>() / row.len() as f64).collect()
}

/// A half plane at depth 1 over a floor at depth 1 + rho: what is seen of a light parallel to both is linear across the penumbra, and so is what
/// is drawn, if it is drawn linearly in the picture.
#[test]
fn a_straight_edge_has_a_linear_penumbra_where_light_and_floor_are_parallel() {
    let half = 0.2;
    let parts = [0.05, 0.25, 0.5, 0.75, 0.95];
    for rho in [0.25, 1.0, 4.0] {
        let depth = |_| 1.0 + rho;
        let across: Vec<f64> =
            parts.iter().chain(&[-0.2, 1.2]).map(|g| rho * half * (2.0 * g - 1.0)).collect();
        let input = frame(floor(depth), &[strip(1.0, -20.0, 0.0)], line(half), &rows(depth, &across));
        for (samples, skin) in [(2, "masked"), (2, "printed"), (3, "masked"), (3, "printed"), (5, "masked")] {
            let options = format!("samples={samples},skin={skin}");
            let drawn = means(&draw(&Heidrich, &options, &input, on()).visibility);
            for (g, drawn) in parts.iter().zip(&drawn) {
                println!("rho {rho}, {options}, {g}: {drawn:.4}");
                // A texel is 1/400 of the penumbra or less, and skins begin and end up to one from the border of the occluder.
                assert!((drawn - g).abs() < 0.01, "rho {rho}, {options}: {drawn} for {g}");
            }
            assert_eq!(drawn[parts.len()..], [0.0, 1.0], "rho {rho}, {options}");
        }
        let drawn = means(&draw(&Heidrich, "interpolation=perspective", &input, on()).visibility);
        for (g, drawn) in parts.iter().zip(&drawn) {
            let right = g / (1.0 + rho * (1.0 - g));
            println!("rho {rho}, perspective, {g}: {drawn:.4} for {right:.4}");
            assert!((drawn - right).abs() < 0.015, "rho {rho}, perspective, {g}: {drawn} for {right}");
        }
    }
}
