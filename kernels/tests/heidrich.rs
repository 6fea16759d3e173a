//! Soft shadow maps for linear lights: the paper's formulas by the oracles, penumbras of straight edges, and what few samples miss.

mod common;

use common::{
    Lanewise, Random, cases, draw, evaluate, expected, input, number, on, one_of_each_kind, polygons,
    random_scene, run_step, same_on_all_back_ends, shipped, sphere,
};
use lrbsim_isa::{Arena, Phase, Runner, Step, Vpu};
use lrbsim_kernels::field;
use lrbsim_kernels::heidrich::channel::{Interpolation, SkinOnFace, factor};
use lrbsim_kernels::heidrich::skins::Skins;
use lrbsim_kernels::heidrich::warp::normals;
use lrbsim_kernels::heidrich::{self, Heidrich, Sample};
use lrbsim_kernels::map::DepthMap;
use lrbsim_kernels::map::layout::{MapFace, MapSlot};
use lrbsim_kernels::method::Method;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::reference::{ErrorMetrics, Rays, Truth};
use lrbsim_workloads::{Adjacency, Bvh, EyeView, Light, Mesh, Scene, ShadowInput};

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
            assert!(
                (f64::from(depth) / right - 1.0).abs() < 1e-6,
                "{}: depth {depth} for {right}",
                case["id"]
            );
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

/// A floor and what is over it.
fn over(floor: Mesh, occluders: &[Mesh]) -> Mesh {
    let mut mesh = floor;
    occluders.iter().for_each(|occluder| mesh.append(occluder));
    mesh
}

/// What rays find at receivers.
fn by_rays(mesh: &Mesh, light: &Light, receivers: &[(DVec3, u32)], count: u32) -> Vec<f32> {
    let (bvh, rays) = (Bvh::new(mesh), Rays::new(light, count));
    receivers.iter().map(|(p, own)| rays.visibility(&bvh, *p, *own, 0.5) as f32).collect()
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
        let input = input(over(floor(depth), &[strip(1.0, -20.0, 0.0)]), line(half), &rows(depth, &across));
        // More samples are more maps: at one depth.
        let some: &[(u32, &str)] = &[(2, "masked"), (2, "printed"), (3, "masked"), (5, "masked")];
        for (samples, skin) in &some[..if rho == 1.0 { 4 } else { 1 }] {
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

/// Figure 8 of the paper, on the right: a triangle by its sides. Behind an edge parallel to one of them, of which nothing or all is
/// seen, what is drawn grows linearly, and what is seen of the triangle with the square.
#[test]
fn a_triangle_is_drawn_as_its_three_sides() {
    let half = 0.2;
    let corner = |x: f64, y: f64| DVec3::new(x * half, y * half, 0.0);
    let light = Light::Triangle { p0: corner(-1.0, -1.0), p1: corner(-1.0, 1.0), p2: corner(1.0, 0.3) };
    // Not 0.5, where the edge goes through samples between corners.
    let parts = [0.05, 0.25, 0.45, 0.75, 0.95];
    // The place in the penumbra of a depth below the edge as large as the light's above it.
    let mut across = parts.map(|g| half * (2.0 * g - 1.0)).to_vec();
    across.extend([-0.3, 0.3]);
    let mut receivers = rows(|_| 2.0, &across);
    // Sides lead along the edge too, and with them its skins: the map must be longer than the rows.
    receivers.extend([-1.5, 1.5].map(|y| (DVec3::new(0.3, y, -2.0), u32::from(y > 0.3))));
    let mesh = over(floor(|_| 2.0), &[strip(1.0, -20.0, 0.0)]);
    let truth = means(&by_rays(&mesh, &light, &receivers, 4096));
    let input = input(mesh, light, &receivers);
    let mut crude = 0.0_f64;
    for samples in [2, 3] {
        let drawn = means(&draw(&Heidrich, &format!("samples={samples}"), &input, on()).visibility);
        for (i, g) in parts.into_iter().enumerate() {
            println!("{samples} samples a side, {g}: {:.4}, by rays {:.4}", drawn[i], truth[i]);
            assert!((truth[i] - g * g).abs() < 0.005, "{g}: {} of the triangle", truth[i]);
            assert!((drawn[i] - g * 2.0 / 3.0).abs() < 0.01, "{samples} samples, {g}: {}", drawn[i]);
            crude = crude.max((drawn[i] - truth[i]).abs());
        }
        assert_eq!(drawn[parts.len()..], [0.0, 1.0, 1.0], "{samples} samples");
    }
    // A third is nearly the whole of the side that is missed just before it is seen.
    assert!((0.25..0.34).contains(&crude), "{crude}");
}

/// A straight edge parallel to light and floor, with all axes in other places: light, floor and edge on each face of the map.
#[test]
fn a_straight_edge_has_the_same_penumbra_on_every_face() {
    // The borders of the map are those of the receivers: the edge lies inside.
    let parts = [0.1, 0.5, 0.9, -0.2, 1.2];
    let across: Vec<f64> = parts.iter().map(|g| 0.2 * (2.0 * g - 1.0)).collect();
    let (mesh, receivers) = (over(floor(|_| 2.0), &[strip(1.0, -20.0, 0.0)]), rows(|_| 2.0, &across));
    for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
        let turn = |p: DVec3| {
            let turned = [DVec3::new(p.z, p.x, p.y), DVec3::new(p.y, p.z, p.x), p][axis];
            // A turn by half around one of the axes of the floor.
            let mut signs = DVec3::splat(sign);
            signs[(axis + 1) % 3] = 1.0;
            turned * signs
        };
        let mut mesh = mesh.clone();
        mesh.positions.iter_mut().for_each(|p| *p = turn(*p));
        let light = Light::Linear { p0: turn(DVec3::X * -0.2), p1: turn(DVec3::X * 0.2) };
        let receivers: Vec<_> = receivers.iter().map(|(p, own)| (turn(*p), *own)).collect();
        let drawn = means(&draw(&Heidrich, "", &input(mesh, light, &receivers), on()).visibility);
        for (g, drawn) in parts.iter().zip(drawn) {
            assert!((drawn - g.clamp(0.0, 1.0)).abs() < 0.01, "axis {axis}, {sign}: {drawn} for {g}");
        }
    }
}

/// Where the floor is not parallel to the light Eq. 1 bends the penumbra, and what is drawn is linear in the picture still.
#[test]
fn on_a_slanted_floor_what_is_drawn_is_linear_and_what_is_right_is_not() {
    let (half, height, slope) = (0.5, 2.0, 0.6);
    let depth = |x: f64| 4.0 + slope * x;
    // About the edge, upward: the light at `y = t`, the receiver at `y = n x + s`.
    let eq1 = [0.0, height, -slope, height - 4.0];
    let [m, t, n, s] = eq1;
    let receiver = |x1: f64| x1 * s / (t - (n - m) * x1);
    let (dark, lit) = (receiver(half), receiver(-half));
    let parts: Vec<f64> = (1..20).map(|k| f64::from(k) * 0.05).collect();
    let across: Vec<f64> = parts.iter().map(|part| dark + (lit - dark) * part).collect();
    let (mesh, receivers) = (over(floor(depth), &[strip(height, -20.0, 0.0)]), rows(depth, &across));
    let truth = means(&by_rays(&mesh, &line(half), &receivers, 1000));
    let drawn = means(&draw(&Heidrich, "", &input(mesh, line(half), &receivers), on()).visibility);
    // The penumbra is seen from the end that is nearer to the lit side.
    let image = |x: f64, depth: f64| (x - half) / depth;
    let ends = [image(0.0, height), image(lit, depth(lit))];
    let mut most: f64 = 0.0;
    for ((x, truth), drawn) in across.iter().zip(truth).zip(drawn) {
        let right = (half - just_seen(eq1, *x)) / (2.0 * half);
        assert!((truth - right).abs() < 0.002, "{x}: {truth} rays for {right}");
        let linear = (image(*x, depth(*x)) - ends[0]) / (ends[1] - ends[0]);
        println!("{x:.3}: {drawn:.4}, linear {linear:.4}, right {right:.4}");
        assert!((drawn - linear).abs() < 0.01, "{x}: {drawn} for {linear}");
        most = most.max((drawn - right).abs());
    }
    println!("at most {most:.4} off");
    assert!(most > 0.03, "{most}");
}

#[test]
fn edges_parallel_to_the_light_throw_no_penumbra() {
    let mesh =
        over(floor(|_| 4.0), &[sheet(2.0, &[(-20.0, -20.0), (20.0, -20.0), (20.0, 0.0), (-20.0, 0.0)])]);
    // A texel is 0.7 / 896 on the floor.
    let beside: Vec<(DVec3, u32)> = [-0.3, -0.1, -0.01, -0.002, 0.002, 0.01, 0.1, 0.3]
        .into_iter()
        .flat_map(|y| (0..64).map(move |k| DVec3::new(f64::from(k) * 0.01 - 0.32, y, -4.0)))
        .map(|p| (p, u32::from(p.y > p.x)))
        .collect();
    for options in ["", "skin=printed", "samples=3"] {
        let drawn = draw(&Heidrich, options, &input(mesh.clone(), line(0.4), &beside), on()).visibility;
        for ((p, _), light) in beside.iter().zip(drawn) {
            assert_eq!(light, if p.y > 0.0 { 1.0 } else { 0.0 }, "{options} at {p}");
        }
    }
}

// ---- what few samples miss

/// A gap through which no end of the light is seen, but much of its middle: two samples make it umbra, with a step where one of them begins
/// to be seen. Figure 6 of the paper. The middle sample tells.
#[test]
fn where_penumbras_overlap_two_samples_draw_a_false_umbra_and_three_do_not() {
    let mesh = over(floor(|_| 4.0), &[strip(2.0, -20.0, -0.125), strip(2.0, 0.125, 20.0)]);
    let across = [0.0, 0.05, 0.1, 0.14, 0.16, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, -0.7];
    let receivers = rows(|_| 4.0, &across);
    let truth = means(&by_rays(&mesh, &line(0.4), &receivers, 800));
    let input = input(mesh, line(0.4), &receivers);
    let [two, three] =
        ["samples=2", "samples=3"].map(|options| means(&draw(&Heidrich, options, &input, on()).visibility));
    for (((x, truth), two), three) in across.iter().zip(truth).zip(two).zip(three) {
        println!("{x}: right {truth:.4}, two samples {two:.4}, three {three:.4}");
        // The end at -0.4 is seen from x > 0.15 on.
        let right = if x.abs() < 0.15 { 0.0 } else { truth };
        assert!((two - right).abs() < 0.01, "{x}, two samples: {two} for {right}");
        assert!((three - truth).abs() < 0.01, "{x}, three samples: {three} for {truth}");
        assert!(x.abs() > 0.15 || truth > 0.5, "{x}: {truth}");
    }
}

#[test]
fn what_hides_only_the_middle_of_the_light_throws_no_shadow_with_two_samples_and_one_with_three() {
    let mesh = over(floor(|_| 4.0), &[strip(2.0, -0.05, 0.05)]);
    // The last two are there for the map, whose borders are those of the receivers.
    let across = [-0.1, 0.0, 0.1, -1.0, 1.0];
    let receivers = rows(|_| 4.0, &across);
    let truth = means(&by_rays(&mesh, &line(0.4), &receivers, 800));
    assert!(truth[..3].iter().all(|truth| (truth - 0.75).abs() < 0.002), "{truth:?}");
    let input = input(mesh, line(0.4), &receivers);
    let drawn = |options: &str| means(&draw(&Heidrich, options, &input, on()).visibility);
    assert_eq!(drawn("samples=2"), [1.0; 5]);
    // Only in the middle all three samples tell: at its sides two see the receiver again.
    let three = drawn("samples=3");
    assert!((three[1] - 0.75).abs() < 0.01, "{three:?}");
    // Skins over what both see are, on one level floor, what each end sees up to the occluder.
    for skin in ["printed", "agreed"] {
        let drawn = drawn(&format!("samples=2,skin={skin}"));
        assert!(drawn[..3].iter().all(|light| (light - 0.75).abs() < 0.01), "{skin}: {drawn:?}");
        assert_eq!(drawn[3..], [1.0; 2], "{skin}");
    }
}

#[test]
fn samples_weigh_what_the_oracles_say_and_without_skins_give_one_level_more_than_there_are() {
    for case in cases("heidrich_weights") {
        let samples = case["inputs"]["N"].as_u64().expect("a number");
        // Nothing jumps by all of its depth here.
        let options = format!("size=512,samples={samples},threshold=1");
        let (end, inner) = (expected(&case, "end"), expected(&case, "inner"));
        // Between the borders of the shadows of two samples there is a level, and one at either end.
        let step = 0.8 / (samples - 1) as f64;
        let across: Vec<f64> = (0..=samples).map(|k| -0.4 + step * (k as f64 - 0.5)).collect();
        let half_plane = over(floor(|_| 4.0), &[strip(2.0, -20.0, 0.0)]);
        let drawn = means(
            &draw(&Heidrich, &options, &input(half_plane, line(0.4), &rows(|_| 4.0, &across)), on())
                .visibility,
        );
        for (k, light) in drawn.into_iter().enumerate() {
            let right = match k as u64 {
                0 => 0.0,
                k if k == samples => 1.0,
                k => end + (k - 1) as f64 * inner,
            };
            assert!((light - right).abs() < 1e-7, "{options}, {k}: {light} for {right}");
        }
        // Through a gap a single one is seen.
        if samples > 2 {
            let gap = over(floor(|_| 4.0), &[strip(2.0, -20.0, -0.02), strip(2.0, 0.02, 20.0)]);
            let at_inner = -(-0.4 + step);
            let drawn = means(
                &draw(&Heidrich, &options, &input(gap, line(0.4), &rows(|_| 4.0, &[at_inner, 0.4])), on())
                    .visibility,
            );
            assert!((drawn[0] - inner).abs() < 1e-7, "{options}: {drawn:?} for {inner}");
            assert!((drawn[1] - end).abs() < 1e-7, "{options}: {drawn:?} for {end}");
        }
    }
}

#[test]
fn lights_that_are_neither_lines_nor_triangles_are_refused_in_words() {
    let options = Heidrich.entry().options("").expect("the method takes these");
    for light in one_of_each_kind(sphere(0.5)) {
        let objection = Heidrich.objection_to_light(&options, &light);
        let takes = matches!(light, Light::Linear { .. } | Light::Triangle { .. });
        assert_eq!(objection.is_none(), takes, "{objection:?}");
        assert!(objection.is_none_or(|words| words.contains("must be linear or a triangle")));
    }
}

// ---- whole scenes

/// A shipped scene under a line in the middle of its light.
fn under_a_line(name: &str, half: DVec3, size: (u32, u32)) -> (Scene, EyeView, ShadowInput) {
    let (scene, eye, _) = shipped(name, Some(size));
    let center = scene.light.center();
    let scene = Scene { light: Light::Linear { p0: center - half, p1: center + half }, ..scene };
    let input = ShadowInput::new(&scene, &Adjacency::new(&scene.mesh), &eye);
    (scene, eye, input)
}

fn error(truth: &[f64], options: &str, input: &ShadowInput) -> ErrorMetrics {
    let drawn: Vec<f64> =
        draw(&Heidrich, options, input, on()).visibility.into_iter().map(f64::from).collect();
    ErrorMetrics::new(truth, &drawn)
}

#[test]
fn skins_are_nearer_to_the_truth_than_the_same_samples_without() {
    // A room of thousands of triangles is in `study trade-tube`.
    for (name, half) in [("table", DVec3::X * 0.4), ("cornell", DVec3::new(0.2, 0.0, 0.1))] {
        let (scene, eye, input) = under_a_line(name, half, (160, 120));
        let truth = Truth::new(&scene.mesh, &scene.light, &eye, 1024, &|| ()).visibility();
        // More samples are more maps: on the smallest scene.
        let all: &[u32] = if name == "table" { &[2, 5] } else { &[2] };
        for samples in all.iter().copied() {
            let with = |more: &str| {
                let metrics = error(&truth, &format!("samples={samples}{more}"), &input);
                println!(
                    "{name}, {samples} samples{more}: mean {:.4} of the shadowed, bias {:.4}, {} of {} off by a quarter",
                    metrics.atty_mae, metrics.bias, metrics.off_by_quarter, metrics.in_question
                );
                metrics.atty_mae
            };
            let masked = with("");
            let without = with(",threshold=1");
            assert!(masked < without, "{name}, {samples}: {masked} with, {without} without");
            // For the figures of docs/methods.md; the other scenes take half a minute.
            if samples == 2 && name == "table" {
                with(",skin=printed");
                with(",skin=agreed");
            }
        }
    }
}

/// Figure 9 of the paper: one blocker, one light, maps of 500 texels there, and 10 uniform rays beside it.
#[test]
fn with_one_blocker_two_samples_are_nearer_to_the_truth_than_ten_rays() {
    let mesh = over(floor(|_| 4.0), &[sheet(2.0, &[(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])]);
    let at = |k: u32| (f64::from(k) + 0.5) / 24.0 - 2.0;
    let receivers: Vec<(DVec3, u32)> = (0..96)
        .flat_map(|y| (0..96).map(move |x| DVec3::new(at(x), at(y), -4.0)))
        .map(|p| (p, u32::from(p.y > p.x)))
        .collect();
    let to_f64 = |values: Vec<f32>| values.into_iter().map(f64::from).collect::<Vec<f64>>();
    let by_rays = |count| to_f64(by_rays(&mesh, &line(0.4), &receivers, count));
    let truth = by_rays(2000);
    let input = input(mesh.clone(), line(0.4), &receivers);
    let ours = error(&truth, "size=512", &input);
    for size in [512, 1024, 2048] {
        let metrics = error(&truth, &format!("size={size}"), &input);
        println!("two samples, {size} texels: mean {:.4} of the shadowed", metrics.atty_mae);
    }
    for count in [2, 6, 10, 50, 200] {
        let rays = ErrorMetrics::new(&truth, &by_rays(count));
        println!("{count} rays: mean {:.4}", rays.atty_mae);
        assert!(count > 10 || ours.atty_mae < rays.atty_mae, "{count} rays: {}", rays.atty_mae);
    }
}

#[test]
fn what_both_ends_see_is_lit_unless_skins_are_as_printed() {
    let (scene, _, input) = under_a_line("table", DVec3::X * 0.4, (160, 120));
    let Light::Linear { p0, p1 } = scene.light else { panic!("the light is a line") };
    let (bvh, all) = (Bvh::new(&scene.mesh), Rays::new(&scene.light, 64));
    let ends = [p0, p1].map(|center| Rays::new(&Light::Point { center }, 1));
    let eye = EyeView::render(&scene.mesh, &scene.camera, 160, 120);
    let [masked, printed] =
        ["", "skin=printed"].map(|options| draw(&Heidrich, options, &input, on()).visibility);
    let (mut seen, mut dark, mut wrong) = (0, 0, 0);
    for (i, (p, own)) in eye.points.iter().zip(&eye.triangles).enumerate() {
        if ends.iter().all(|end| end.visibility(&bvh, *p, *own, 0.0) == 1.0) {
            seen += 1;
            // But for texels of the border.
            dark += usize::from(masked[i] < 1.0);
            wrong += usize::from(printed[i] < 0.9 && all.visibility(&bvh, *p, *own, 0.5) == 1.0);
        }
    }
    println!(
        "{seen} seen by both, {dark} of them not lit; as printed {wrong} that all of the light is seen from are below 0.9"
    );
    assert!(seen > 1000 && dark * 100 < seen, "{dark} of {seen}");
    assert!(wrong > 0);
}

#[test]
fn soft_shadow_maps_are_the_same_on_all_back_ends_and_their_tasks_are_short() {
    let input = under_a_line("tiny", DVec3::new(0.15, 0.0, 0.05), (120, 90)).2;
    same_on_all_back_ends(&Heidrich, "size=256", &input);
    same_on_all_back_ends(&Heidrich, "size=512,samples=3", &input);
    same_on_all_back_ends(
        &Heidrich,
        "size=128,samples=4,skin=printed,interpolation=perspective,bias=constant",
        &input,
    );
}

#[test]
fn a_triangle_is_drawn_the_same_on_all_back_ends_and_nearer_to_the_truth_than_without_skins() {
    let (scene, eye, _) = shipped("table", Some((160, 120)));
    let at = |x: f64, z: f64| scene.light.center() + DVec3::new(x, 0.0, z);
    let scene =
        Scene { light: Light::Triangle { p0: at(-0.4, -0.2), p1: at(0.4, -0.2), p2: at(0.0, 0.4) }, ..scene };
    let truth = Truth::new(&scene.mesh, &scene.light, &eye, 1024, &|| ()).visibility();
    let input = ShadowInput::new(&scene, &Adjacency::new(&scene.mesh), &eye);
    same_on_all_back_ends(&Heidrich, "size=128", &input);
    let [with, without] = ["", "threshold=1"].map(|options| error(&truth, options, &input).atty_mae);
    println!("table under a triangle: mean {with:.4} of the shadowed, without skins {without:.4}");
    assert!(with < 0.8 * without, "{with} with, {without} without");
}

#[test]
fn empty_frames_and_degenerate_lights_give_visibilities() {
    let (scene, eye, input) = under_a_line("tiny", DVec3::X * 0.2, (64, 48));
    let empty = EyeView { points: vec![], normals: vec![], triangles: vec![], pixels: vec![], ..eye.clone() };
    let adjacency = Adjacency::new(&scene.mesh);
    assert!(draw(&Heidrich, "", &ShadowInput::new(&scene, &adjacency, &empty), on()).visibility.is_empty());

    // A line without length is a point, and all its samples are one.
    let center = scene.light.center();
    let point = Scene { light: Light::Linear { p0: center, p1: center }, ..scene.clone() };
    let drawn = draw(&Heidrich, "samples=3", &ShadowInput::new(&point, &adjacency, &eye), on()).visibility;
    assert!(drawn.contains(&0.0) && drawn.contains(&1.0) && drawn.iter().all(|x| *x == 0.0 || *x == 1.0));

    // A line that ends at a receiver, and one that begins behind the floor.
    for p0 in [eye.points[eye.points.len() / 2], center - DVec3::Y * 50.0] {
        let ends = Scene { light: Light::Linear { p0, p1: center }, ..scene.clone() };
        draw(&Heidrich, "size=128", &ShadowInput::new(&ends, &adjacency, &eye), on());
    }
    assert!(!input.receivers.is_empty());
}

// ---- a dumb model

/// A map as the host reads it.
struct HostMap<'a> {
    map: DepthMap,
    arena: &'a Arena,
}

impl HostMap<'_> {
    fn face(&self, slot: u32) -> u32 {
        self.arena.read_u32(self.map.layout.slots.host(slot, field!(MapSlot.face)))
    }

    fn word(&self, slot: u32, x: u32, y: u32) -> u64 {
        let layout = &self.map.layout;
        let (tile, tiles) = (1 << layout.tile_log2, 1 << layout.tiles_log2());
        let number = (slot * tiles + y / tile) * tiles + x / tile;
        u64::from(number * tile * tile + (y % tile) * tile + x % tile)
    }

    /// Reciprocal depth of a texel, no farther than the farthest receiver.
    fn depth(&self, slot: u32, x: u32, y: u32) -> f64 {
        let farthest = self.map.layout.faces.host(self.face(slot), field!(MapFace.farthest));
        let texel = self.arena.read_f32(self.map.texels.plus_words(self.word(slot, x, y)));
        f64::from(texel.max(self.arena.read_f32(farthest)))
    }

    /// Whether texels of a square are no wider than what f32 rounds on the image plane: those about a single receiver.
    fn is_finer_than_f32(&self, slot: u32) -> bool {
        let unit = |axis| {
            self.arena.read_f32(self.map.layout.faces.host(self.face(slot), field!(MapFace.unit[axis])))
        };
        unit(0).min(unit(1)) < 1e-6
    }

    /// Direction of depth 1 to the middle of a texel.
    fn direction(&self, slot: u32, x: u32, y: u32) -> DVec3 {
        let face = self.face(slot);
        let of = |field| f64::from(self.arena.read_f32(self.map.layout.faces.host(face, field)));
        let axis = face as usize / 2;
        let mut direction = DVec3::ZERO;
        direction[axis] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
        direction[(axis + 1) % 3] =
            of(field!(MapFace.origin[0])) + (f64::from(x) + 0.5) * of(field!(MapFace.unit[0]));
        direction[(axis + 2) % 3] =
            of(field!(MapFace.origin[1])) + (f64::from(y) + 0.5) * of(field!(MapFace.unit[1]));
        direction
    }
}

/// Corners of all skins as another sample sees them, and how much of the light is seen there.
type HostSkin = [(DVec3, f64); 3];

/// The skins of a map, found in f64, as seen from where the vector `to_sample` leads to the map's sample; checks those that
/// the kernels have found.
fn skins(skins: &Skins, threshold: f64, to_sample: DVec3, arena: &Arena) -> Vec<HostSkin> {
    let map = HostMap { map: skins.map, arena };
    let layout = &skins.map.layout;
    let last = layout.size - 1;
    let mut found = Vec::new();
    for slot in 0..layout.slot_count {
        let side = |x: u32, y: u32| {
            let near = |x: u32, y: u32| {
                let at = |a: u32, by: i32| a.saturating_add_signed(by).min(last);
                (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (at(x, dx), at(y, dy))))
            };
            let here = map.depth(slot, x, y);
            let response = 9.0 * here - near(x, y).map(|(x, y)| map.depth(slot, x, y)).sum::<f64>();
            let part = response / (3.0 * here);
            let kernels = arena.read_u32(skins.sides.plus_words(map.word(slot, x, y)));
            let right = [part > threshold, part < -threshold, part < 0.0];
            let rounded = part.abs() < 1e-5 || (part.abs() - threshold).abs() < 1e-5;
            let found = [1, 2, 4].map(|bit| kernels & bit != 0);
            assert!(found == right || rounded, "{x} {y}: {found:?}, but the filter has {part}");
            found
        };
        let sides: Vec<[bool; 3]> =
            (0..=last).flat_map(|y| (0..=last).map(move |x| (x, y))).map(|(x, y)| side(x, y)).collect();
        let corner = |x: u32, y: u32| {
            let at = map.direction(slot, x, y) / map.depth(slot, x, y) + to_sample;
            (at, f64::from(u8::from(sides[(y * layout.size + x) as usize][2])))
        };
        for (x, y) in (0..last).flat_map(|y| (0..last).map(move |x| (x, y))) {
            for (dx, dy) in [(1, 0), (0, 1)] {
                let three = [(x, y), (x + dx, y + dy), (x + 1, y + 1)];
                let has = |k: usize| three.iter().any(|(x, y)| sides[(y * layout.size + x) as usize][k]);
                if has(0) && has(1) {
                    found.push(three.map(|(x, y)| corner(x, y)));
                }
            }
        }
    }
    assert_eq!(found.len(), skins.count as usize);
    found
}

/// What skins make of a direction behind which the surface has a reciprocal depth: the darkest, and how far rounding may be off; `None` where
/// rounding decides which there are.
fn darkest(
    skins: &[HostSkin],
    direction: DVec3,
    axis: usize,
    surface: f64,
    affine: bool,
) -> Option<(f64, f64)> {
    let mut least = (2.0, 0.0);
    for skin in skins {
        let [a, b, c] = skin.map(|(p, _)| p);
        let volume = a.dot((b - a).cross(c - a));
        let weights = [(b, c), (c, a), (a, b)].map(|(s, e)| {
            let slack = 2e-6 * s.length() * e.length() * direction.length();
            (s.cross(e - s).dot(direction) * volume.signum(), slack)
        });
        if weights.iter().any(|(weight, slack)| *weight < -slack) {
            continue;
        }
        // Nearly edge-on rounding decides whether a skin is seen, and from which side.
        if volume.abs() < 2e-6 * a.length() * b.length() * c.length() {
            return None;
        }
        let sum: f64 = weights.iter().map(|(weight, _)| weight).sum();
        let depth = sum / volume.abs();
        let factor = |p: DVec3| if affine { (p[axis] * direction[axis].signum()).max(1e-4) } else { 1.0 };
        let under: f64 = weights.iter().zip(skin).map(|((weight, _), (p, _))| weight * factor(*p)).sum();
        let over: f64 =
            weights.iter().zip(skin).map(|((weight, _), (p, lit))| weight * factor(*p) * lit).sum();
        let off: f64 = weights.iter().zip(skin).map(|((_, slack), (p, _))| slack * factor(*p)).sum();
        let slack: f64 = weights.iter().map(|(_, slack)| slack / sum).sum();
        // Nearer than where kernels cut what they bin.
        if depth > 5e3 {
            return None;
        }
        if depth < surface * (1.0 - slack - 1e-5) {
            continue;
        }
        if depth < surface * (1.0 + slack + 1e-5) || weights.iter().any(|(weight, slack)| *weight < *slack) {
            return None;
        }
        if over / under < least.0 {
            least = (over / under, off / under);
        }
    }
    Some(least)
}

#[test]
fn channels_of_random_scenes_are_those_of_a_dumb_model() {
    let (mut compared, mut covered, mut doubtful) = (0, 0, 0);
    for seed in 0..8 {
        let (mesh, receivers) = random_scene(seed, 300);
        let mut random = Random(seed ^ 77);
        let half = random.vector() * 0.3;
        let input = input(mesh, Light::Linear { p0: -half, p1: half }, &receivers);
        let affine = seed % 2 == 0;
        let interpolation = if affine { "affine" } else { "perspective" };
        let options = format!("size=128,threshold=0.05,interpolation={interpolation}");
        let options = Heidrich.entry().options(&options).expect("the method takes these");
        let mut arena = Arena::new();
        let mut run = |_: &Phase, step: &Step, arena: &mut Arena| {
            run_step(step, arena, on());
            Ok(())
        };
        let samples = heidrich::draw(&options, &mut input.clone(), &mut Runner::new(&mut arena, &mut run))
            .expect("nothing stops it");
        for [i, j] in [[0, 1], [1, 0]] {
            let [own, other]: [&Sample; 2] = [&samples[i], &samples[j]];
            let to_other = DVec3::from(other.viewpoint.from(own.viewpoint).map(f64::from));
            let all = skins(&other.skins, 0.05, to_other, &arena);
            let map = HostMap { map: own.skins.map, arena: &arena };
            let channel = own.channels[1 - i].expect("a segment has two channels");
            for slot in 0..map.map.layout.slot_count {
                if map.is_finer_than_f32(slot) {
                    continue;
                }
                for (x, y) in (0..128).step_by(7).flat_map(|y| (0..128).step_by(5).map(move |x| (x, y))) {
                    let word = map.word(slot, x, y);
                    let surface = f64::from(arena.read_f32(map.map.texels.plus_words(word)));
                    let axis = map.face(slot) as usize / 2;
                    let ours = f64::from(arena.read_f32(channel.plus_words(word)));
                    let direction = map.direction(slot, x, y);
                    let Some((right, off)) = darkest(&all, direction, axis, surface, affine) else {
                        doubtful += 1;
                        continue;
                    };
                    assert!(
                        (ours - right).abs() < 2.0 * off + 1e-5,
                        "seed {seed}, {i}, {slot} {x} {y}: {ours} for {right}; at {direction}, surface {surface}, off {off}, to {to_other}"
                    );
                    compared += 1;
                    covered += usize::from(right < 1.5);
                }
            }
        }
    }
    println!("{compared} compared, {covered} of them under skins, {doubtful} in doubt");
    assert!(compared > 20_000 && covered > 2000 && doubtful * 5 < compared);
}
