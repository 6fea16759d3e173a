//! The numeric oracles of the project through the kernels' own code, on every back end.

mod common;

use std::collections::BTreeMap;

use common::{
    Lanewise, On, Run, back_ends, cases, evaluate, input, input_of_prepared, loops, numbers, of_loops,
    oracles, polygons, vec3,
};
use lrbsim_isa::{HostSimd, Vpu, math};
use lrbsim_kernels::field;
use lrbsim_kernels::irregular::primitives::TriangleRecord;
use lrbsim_kernels::irregular::silhouette::rounding_offset;
use lrbsim_kernels::irregular::touch::wedge_start;
use lrbsim_kernels::light::{View, footprint_radius};
use lrbsim_kernels::plane::PLANE_SLACK;
use lrbsim_kernels::record::Field;
use lrbsim_kernels::segment::segment;
use lrbsim_kernels::sism::compose::visible;
use lrbsim_kernels::sism::soft::fixed;
use lrbsim_workloads::glam::{DVec2, DVec3};
use lrbsim_workloads::reference::Projection;
use lrbsim_workloads::{Counting, Light, LightShape, ShadowInput};
use serde_json::Value;

fn f32s<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|x| x as f32)
}

fn tolerance(case: &Value) -> f64 {
    case["tolerance"]["f32"].as_f64().expect("a tolerance")
}

/// Within `tolerance` of the expected value, where there is one; absolute.
fn check(case: &Value, what: &str, found: f64, tolerance: f64) {
    if let Some(expected) = case["expected"][what].as_f64() {
        assert!((found - expected).abs() <= tolerance, "{} {what}: {found}, expected {expected}", case["id"]);
    }
    assert!(found.is_finite(), "{} {what}: {found}", case["id"]);
}

/// F of an edge.
#[derive(Clone)]
struct Segment;

impl Lanewise<4, 1> for Segment {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [x0, y0, x1, y1]: [V::F32; 4]) -> [V::F32; 1] {
        let all = v.mask_all();
        [segment(v, all, [x0, y0], [x1, y1]).1]
    }
}

#[test]
fn segments_agree() {
    let all = cases("segment");
    let ends = |case: &Value| {
        let (a, b) = (numbers(&case["inputs"]["u0"]), numbers(&case["inputs"]["u1"]));
        f32s([a[0], a[1], b[0], b[1]])
    };
    let found = evaluate(&Segment, &all.iter().map(ends).collect::<Vec<_>>());
    for (case, [f]) in all.iter().zip(found) {
        check(case, "F", f64::from(f), tolerance(case));
        // The sign is the predicate's; here that of the oracle.
        if let Some(d) = case["expected"]["d"].as_f64() {
            check(case, "V", f64::from(if d > 0.0 { -f } else { f }), tolerance(case));
        }
    }
}

/// Umbra and penumbra of [`of_loops`], the same on every back end.
fn winding(loops: &[Vec<DVec2>], nudge: DVec2) -> (i32, f64) {
    let input = of_loops(loops, nudge);
    // One vector of samples cannot be split: its edges must fit the longest stream of a task.
    let fits = |on: &On| !matches!(on, On::Recording(_)) || input.edges.len() < 100_000;
    let sums: Vec<_> =
        back_ends().into_iter().filter(fits).map(|on| Run::new(&input, on).sums()[&0]).collect();
    assert!(sums.iter().all(|s| *s == sums[0]), "back ends differ: {sums:?}");
    let [front, back, front_part, back_part] = sums[0];
    (back - front, f64::from(back_part.wrapping_sub(front_part)) / f64::from(1 << 24))
}

#[test]
fn closed_silhouettes_agree() {
    for case in cases("polygon") {
        let loops = loops(&case["inputs"]["loops"]);
        // A vertex exactly on the line of sight has no side. The case asks for the value a millionth of the footprint
        // beside it; in a frame that is what the rounding of the hit point does.
        let at_vertex = loops.iter().flatten().any(|u| *u == DVec2::ZERO);
        let nudge = if at_vertex { DVec2::new(0.7e-6, 0.3e-6) } else { DVec2::ZERO };
        let (umbra, penumbra) = winding(&loops, nudge);
        check(&case, "coverage", f64::from(umbra) + penumbra, tolerance(&case));
        check(&case, "umbra", f64::from(umbra), 0.0);
        check(&case, "penumbra", penumbra, tolerance(&case));
    }
}

#[test]
fn generated_circles_agree() {
    let group = oracles("polygon");
    for case in group["generated"]["cases"].as_array().expect("circles") {
        let n = case["n"].as_u64().expect("a count");
        let points = (0..n)
            .map(|i| {
                let angle = core::f64::consts::TAU * i as f64 / n as f64;
                let at = [0.25 + 0.6 * angle.cos(), 0.1 + 0.6 * angle.sin()];
                DVec2::from(at.map(|x| f64::from(x as f32)))
            })
            .collect();
        let (umbra, penumbra) = winding(&[points], DVec2::ZERO);
        let found = f64::from(umbra) + penumbra;
        let expected = case["coverage"].as_f64().expect("a number");
        println!("{n} edges: off by {:e}", found - expected);
        assert!((found - expected).abs() <= tolerance(case), "{n}: {found}, expected {expected}");
    }
}

#[derive(Clone)]
struct Footprint;

impl Lanewise<3, 1> for Footprint {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [r, z_q, z_p]: [V::F32; 3]) -> [V::F32; 1] {
        [footprint_radius(v, r, z_q, z_p)]
    }
}

#[test]
fn footprint_radii_agree() {
    let all = cases("footprint_radius");
    let of = |case: &Value, what: &str| case["inputs"][what].as_f64().expect("a number");
    let inputs: Vec<_> = all.iter().map(|c| f32s([of(c, "r"), of(c, "z_q"), of(c, "z_p")])).collect();
    for (case, [found]) in all.iter().zip(evaluate(&Footprint, &inputs)) {
        let expected = case["expected"]["R"].as_f64().expect("a number");
        match case["tolerance"]["rel_f32"].as_f64() {
            Some(relative) => check(case, "R", f64::from(found), relative * expected.abs()),
            // Depths that no f32 tells apart: finite, and not of the other sign.
            None => assert!(found.is_finite() && f64::from(found) * expected >= 0.0, "{}", case["id"]),
        }
    }
}

/// |u| of vertex v for receiver p.
#[derive(Clone)]
struct Project(LightShape);

impl Lanewise<7, 1> for Project {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, x: [V::F32; 7]) -> [V::F32; 1] {
        let per_radius = v.vrcp(x[6]);
        let view = View::new(v, &self.0, [x[0], x[1], x[2]], per_radius);
        let seen = view.see(v, [x[3], x[4], x[5]]);
        let u = view.project(v, seen);
        let y2 = v.vmul(u[1], u[1]);
        let squared = v.vmadd(u[0], u[0], y2);
        [math::sqrt(v, squared)]
    }
}

/// What an f32 implementation is to find for |u|: the oracle's value, unless rounding the input already moves it.
fn length_of_rounded(p: [f32; 3], vertex: [f32; 3], radius: f32, shape: LightShape) -> f64 {
    let wide = |x: [f32; 3]| DVec3::from(x.map(f64::from));
    Projection::new(wide(p), f64::from(radius), shape).vertex(wide(vertex)).length()
}

#[test]
fn vertices_land_on_the_disc_where_they_should() {
    let all = cases("vertex_to_light_disc");
    for (shape, what) in
        [(LightShape::Facing, "len_u_facing"), (LightShape::Disc { normal: DVec3::Z }, "u_parallel")]
    {
        let of = |case: &Value| {
            let (p, v) = (vec3(&case["inputs"]["p"]), vec3(&case["inputs"]["v"]));
            f32s([p.x, p.y, p.z, v.x, v.y, v.z, case["inputs"]["r"].as_f64().expect("a radius")])
        };
        let inputs: Vec<_> = all.iter().map(of).collect();
        for ((case, x), [found]) in all.iter().zip(&inputs).zip(evaluate(&Project(shape), &inputs)) {
            let wanted = &case["expected"][what];
            let oracle = wanted.as_f64().unwrap_or_else(|| DVec2::from_slice(&numbers(wanted)).length());
            let rounded = length_of_rounded([x[0], x[1], x[2]], [x[3], x[4], x[5]], x[6], shape);
            let relative = case["tolerance"]["rel_f32"].as_f64().expect("a tolerance");
            // 3.999 under a receiver at 4 is no f32: the height between them is off by 7e-5 before anything is computed.
            let expected = if (rounded - oracle).abs() > 0.5 * relative * oracle { rounded } else { oracle };
            let off = (f64::from(found) - expected).abs() / expected;
            assert!(off <= relative, "{} {what}: {found}, expected {expected}", case["id"]);
        }
    }
}

#[test]
fn the_hard_test_agrees() {
    for case in cases("hard") {
        let corners: Vec<DVec3> = case["inputs"]["v"].as_array().expect("corners").iter().map(vec3).collect();
        let p = vec3(&case["inputs"]["p"]);
        // Corners in the order given: a sheet counts both facings. Radius 0 runs no soft phase. A second receiver far
        // out on the same ray tells whether the ray meets the triangle.
        let light = Light::Point { center: DVec3::ZERO };
        let mesh = polygons(&[corners]);
        let mut input = input_of_prepared(mesh, light, &[(p, u32::MAX), (p * 1024.0, u32::MAX)]);
        input.counting.fill(Counting::Sheet);
        let found: Vec<_> = back_ends()
            .into_iter()
            .map(|on| {
                let mut run = Run::new(&input, on);
                let sums = run.sums();
                assert_eq!(sums, run.brute_force(on), "{}", case["id"]);
                (sums[&0][0] == 1, sums[&1][0] == 1)
            })
            .collect();
        assert!(found.iter().all(|f| *f == found[0]), "{}: back ends differ", case["id"]);
        let t = case["expected"]["t"].as_f64();
        if let Some(occluded) = case["expected"]["occluded"].as_bool() {
            assert_eq!(found[0].0, occluded, "{} occluded", case["id"]);
        }
        if let (Some(inside), Some(t)) = (case["expected"]["inside"].as_bool(), t) {
            assert_eq!(found[0].1, inside && t > 0.0, "{} inside", case["id"]);
        }
        if let Some(t) = t {
            let record = plane_of_record(&input);
            let slack = slack_of_record(&input, &record);
            let receiver = DVec3::from(input.receivers[0].map(f64::from));
            let found = (record[3] - slack) / receiver.dot(DVec3::new(record[0], record[1], record[2]));
            let relative = case["tolerance"]["t_rel_f32"].as_f64().expect("a tolerance");
            assert!((found - t).abs() <= relative * t.abs(), "{} t: {found}, expected {t}", case["id"]);
        }
    }
}

/// Normal and distance of the first triangle's record.
fn plane_of_record(input: &ShadowInput) -> [f64; 4] {
    let run = Run::new(input, On::Host(HostSimd::detect(), 1));
    let read = |field: Field<TriangleRecord, f32>| {
        f64::from(run.arena.read_f32(run.arrays.primitives.triangles.field(field)))
    };
    let [x, y, z] = [0, 1, 2].map(|axis| read(field!(TriangleRecord.normal[axis])));
    [x, y, z, read(field!(TriangleRecord.plane))]
}

/// How much farther than the first triangle's plane its record puts it.
fn slack_of_record(input: &ShadowInput, record: &[f64; 4]) -> f64 {
    let terms = |corner: u32| -> f64 {
        input.vertices[corner as usize].iter().zip(record).map(|(&x, n)| (f64::from(x) * n).abs()).sum()
    };
    f64::from(PLANE_SLACK) * input.triangles[0].map(terms).into_iter().fold(0.0, f64::max)
}

/// One term as the soft kernel puts it in fixed point, as edge `number`.
#[derive(Clone)]
struct Fixed;

impl Lanewise<2, 1> for Fixed {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [f, number]: [V::F32; 2]) -> [V::F32; 1] {
        let number = v.vcvt_f32_i32(number);
        let offset = rounding_offset(v, number);
        let bits = fixed(v, f, offset);
        [v.vcvt_i32_f32(bits)]
    }
}

/// Visibility from layers and parts in fixed point.
#[derive(Clone)]
struct Visible;

impl Lanewise<4, 1> for Visible {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, x: [V::F32; 4]) -> [V::F32; 1] {
        let i = x.map(|x| v.vcvt_f32_i32(x));
        [visible(v, [i[0], i[1]], Some([i[2], i[3]]), None)]
    }
}

#[test]
fn compositions_agree() {
    for case in cases("composition") {
        let layers = numbers(&case["inputs"]["umbra"]).iter().sum::<f64>() as i32;
        let penumbra = &case["inputs"]["penumbra"];
        let terms = match penumbra["repeat"].as_f64() {
            Some(term) => vec![term; penumbra["times"].as_u64().expect("a count") as usize],
            None => numbers(penumbra),
        };
        let inputs: Vec<[f32; 2]> =
            terms.iter().enumerate().map(|(i, t)| [t.abs() as f32, i as f32]).collect();
        let parts = evaluate(&Fixed, &inputs);
        let sum: i32 =
            parts.iter().zip(&terms).map(|([x], t)| if *t < 0.0 { -*x as i32 } else { *x as i32 }).sum();
        // As F and as B: the greater counts.
        for x in [[layers, 0, sum, 0], [0, layers, 0, sum]] {
            let x = x.map(|x| x as f32);
            check(&case, "V", f64::from(evaluate(&Visible, &[x])[0][0]), tolerance(&case));
        }
    }
}

/// Depth at which a wedge begins: half widths by depth, distance.
#[derive(Clone)]
struct Wedge;

impl Lanewise<3, 1> for Wedge {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [radius, z_min, distance]: [V::F32; 3]) -> [V::F32; 1] {
        let widest = math::div(v, radius, z_min);
        let left = v.vsub(widest, distance);
        [wedge_start(v, radius, left)]
    }
}

#[test]
fn bounds_of_the_penumbra_agree() {
    let all = cases("penumbra_bounds");
    let of = |case: &Value, what: &str| case["inputs"][what].as_f64().expect("a number");
    for case in &all {
        let [r, z_min, far, length] = ["r", "z_min", "Z", "length"].map(|what| of(case, what));
        let relative = case["tolerance"]["rel_f32"].as_f64().expect("a tolerance");
        let close = |what: &str, found: f64| {
            let expected = case["expected"][what].as_f64().expect("a number");
            check(case, what, found, relative * expected.abs());
        };
        let width = f64::from(evaluate(&Footprint, &[f32s([r, z_min, far])])[0][0]);
        close("half_width", width);
        close("quad_area", (length + 2.0 * width) * 2.0 * width);
        close("exponent", (length + 4.0 * width) / (length + 2.0 * width));

        let start = f64::from(evaluate(&Wedge, &[f32s([r, z_min, of(case, "delta")])])[0][0]);
        match case["expected"]["z_start"].as_f64() {
            Some(_) => close("z_start", start),
            None => assert!(start > 1e20, "{}: no depth is touched, found {start}", case["id"]),
        }

        // So far inside its image, along the radius, an occluder just touches the disc that faces the receiver. The facing
        // form does not know where the view's axis is: turn the receiver onto it, where f32 keeps the digits.
        let factor = case["expected"]["off_axis_factor"].as_f64().expect("a number");
        let (sin, cos) = of(case, "b_deg").to_radians().sin_cos();
        let image = sin / cos - factor * width;
        let vertex = DVec2::new(image, 1.0) * z_min;
        let across = vertex.x * cos - vertex.y * sin;
        let along = vertex.x * sin + vertex.y * cos;
        let rim =
            evaluate(&Project(LightShape::Facing), &[f32s([0.0, 0.0, far / cos, across, 0.0, along, r])])[0]
                [0];
        assert!((f64::from(rim) - 1.0).abs() <= relative, "{} off_axis_factor: |u| = {rim}", case["id"]);
    }
}

#[test]
fn single_receivers_of_whole_frames_agree() {
    for case in cases("scene3d") {
        let inputs = &case["inputs"];
        let (center, p) = (vec3(&inputs["light"]), vec3(&inputs["p"]));
        let radius = inputs["r"].as_f64().expect("a radius");
        let corners: Vec<Vec<DVec3>> = inputs["polygons"]
            .as_array()
            .expect("polygons")
            .iter()
            .map(|polygon| polygon.as_array().expect("corners").iter().map(vec3).collect())
            .collect();
        let lights = [
            ("coverage_facing", "per_polygon_facing", Light::Sphere { center, radius }),
            ("coverage_parallel", "per_polygon_parallel", Light::Disc { center, normal: DVec3::Z, radius }),
        ];
        for (what, each, light) in lights {
            let covered = |polygon: &[Vec<DVec3>]| {
                let input = input(polygons(polygon), light, &[(p, u32::MAX)]);
                let on = On::Host(HostSimd::detect(), 1);
                let mut run = Run::new(&input, on);
                assert_eq!(run.sums(), run.brute_force(on), "{}", case["id"]);
                let found: BTreeMap<u32, usize> = back_ends()
                    .into_iter()
                    .map(|on| (Run::new(&input, on).visibility()[0].to_bits(), 0))
                    .collect();
                assert_eq!(found.len(), 1, "{}: back ends differ", case["id"]);
                1.0 - f64::from(f32::from_bits(*found.keys().next().expect("one")))
            };
            check(&case, what, covered(&corners), tolerance(&case));
            if let Some(all) = case["expected"][each].as_array() {
                for (one, expected) in corners.iter().zip(all) {
                    let (found, expected) =
                        (covered(std::slice::from_ref(one)), expected.as_f64().expect("a number"));
                    assert!((found - expected).abs() <= tolerance(&case), "{} {each}: {found}", case["id"]);
                }
            }
            if what == "coverage_parallel" {
                check(&case, "sum_clamped_parallel", covered(&corners), tolerance(&case));
            }
        }
    }
}

#[test]
fn a_program_without_receivers_or_triangles_runs() {
    let light = Light::Sphere { center: DVec3::ZERO, radius: 0.1 };
    let mut empty = input(polygons(&[vec![DVec3::X, DVec3::Y, DVec3::Z]]), light, &[(DVec3::ONE, u32::MAX)]);
    empty.receivers.clear();
    empty.receiver_triangle.clear();
    empty.receiver_pixel.clear();
    assert!(Run::new(&empty, On::Host(HostSimd::detect(), 1)).visibility().is_empty());
}
