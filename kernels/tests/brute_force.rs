//! Grid, bins, records and wedge test change nothing: the pipeline against brute force on the Vpu, bit for bit.

mod common;

use common::{On, Random, Run, add_triangle, input, power_of_ten, random_scene, shipped, sphere};
use lrbsim_isa::HostSimd;
use lrbsim_kernels::field;
use lrbsim_kernels::irregular::faces::FaceParameters;
use lrbsim_kernels::irregular::primitives::{TriangleBounds, WITHIN};
use lrbsim_kernels::record::Field;
use lrbsim_kernels::sism::Overlap;
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::reference::Occluders;
use lrbsim_workloads::{Light, Mesh, ShadowInput};

/// Runs both and compares the four sums of every receiver.
fn agree(what: &str, input: &ShadowInput) -> Run {
    common::agree(what, input, Overlap::Sum)
}

#[test]
fn tiny_is_the_same() {
    agree("tiny", &shipped("tiny", None).2);
}

#[test]
fn the_small_saloon_is_the_same_at_a_low_resolution() {
    agree("saloon-small", &shipped("saloon-small", Some((96, 72))).2);
}

#[test]
fn the_table_is_the_same() {
    agree("table", &shipped("table", Some((128, 96))).2);
}

#[test]
fn random_scenes_are_the_same_for_lights_of_every_size() {
    for seed in 0..60 {
        let (mesh, receivers) = random_scene(seed, 700);
        for radius in [0.0, 1e-6, 1e-3, 0.02, 0.1, 0.4, 2.0, 10.0] {
            let what = format!("seed {seed}, radius {radius}");
            agree(&what, &input(mesh.clone(), sphere(radius), &receivers));
        }
    }
}

#[test]
fn discs_that_stand_still_are_the_same() {
    for seed in 100..150 {
        let (mesh, receivers) = random_scene(seed, 600);
        for radius in [1e-4, 0.03, 0.3, 1.0, 5.0] {
            let light = Light::Disc { center: DVec3::ZERO, normal: Random(seed).vector(), radius };
            agree(&format!("disc, seed {seed}, radius {radius}"), &input(mesh.clone(), light, &receivers));
        }
    }
}

/// A rectangle or a line about the origin, of about this radius.
fn long_light(random: &mut Random, radius: f64) -> Light {
    let half_u = random.vector().normalize() * radius;
    if random.within(0.0, 1.0) < 0.5 {
        let across = half_u.cross(random.vector()).normalize() * radius;
        // Not always at a right angle, and thin as often as not.
        let half_v = (across + half_u * random.within(-0.5, 0.5)) * power_of_ten(random.within(-2.0, 0.0));
        Light::Rect { center: DVec3::ZERO, half_u, half_v }
    } else {
        Light::Linear { p0: -half_u, p1: half_u }
    }
}

#[test]
fn rectangles_and_lines_are_the_same() {
    for seed in 150..200 {
        let (mesh, receivers) = random_scene(seed, 600);
        for radius in [1e-4, 0.03, 0.3, 1.0, 5.0] {
            let light = long_light(&mut Random(seed), radius);
            let what = format!("seed {seed}, {light:?}");
            let input = input(mesh.clone(), light, &receivers);
            let visible = agree(&what, &input).visibility();
            let truth = Occluders::from_input(&input).visibility(&input);
            let off = |(a, b): (&f32, &f64)| (f64::from(*a) - b).abs() > 2e-3;
            let off = visible.iter().zip(&truth).filter(|pair| off(*pair)).count();
            // Where the plane through light and edge passes within rounding of a receiver.
            assert!(off * 200 <= visible.len(), "{what}: {off} of {} are off", visible.len());
        }
    }
}

#[test]
fn edges_very_near_the_light_are_the_same() {
    for seed in 200..240 {
        let mut random = Random(seed);
        let (mut mesh, receivers) = random_scene(seed, 500);
        let radius = 0.05;
        for _ in 0..20 {
            // From inside the light to a few radii away.
            let near = random.vector().normalize() * radius * random.within(0.3, 4.0);
            let size = random.within(0.02, 1.0);
            add_triangle(&mut mesh, [near, near + random.vector() * size, near + random.vector() * size]);
        }
        agree(&format!("near, seed {seed}"), &input(mesh.clone(), sphere(radius), &receivers));
        let light = Light::Disc { center: DVec3::ZERO, normal: random.vector(), radius };
        agree(&format!("near disc, seed {seed}"), &input(mesh, light, &receivers));
    }
}

#[test]
fn edges_near_a_tiny_light_are_the_same() {
    for seed in 250..290 {
        let mut random = Random(seed);
        let (mut mesh, receivers) = random_scene(seed, 500);
        let radius = power_of_ten(random.within(-6.0, -2.0));
        for _ in 0..30 {
            let near = random.vector().normalize() * radius * power_of_ten(random.within(0.0, 3.0));
            let size = near.length() * random.within(0.1, 4.0);
            add_triangle(&mut mesh, [near, near + random.vector() * size, near + random.vector() * size]);
        }
        agree(&format!("near and tiny, seed {seed}"), &input(mesh.clone(), sphere(radius), &receivers));
        let light = Light::Disc { center: DVec3::ZERO, normal: random.vector(), radius };
        agree(&format!("near and tiny disc, seed {seed}"), &input(mesh, light, &receivers));
    }
}

#[test]
fn far_lights_are_the_same() {
    for seed in 300..330 {
        let mut random = Random(seed);
        let (mesh, receivers) = random_scene(seed, 500);
        let center = random.vector().normalize() * 1e3;
        for radius in [0.0, 1.0, 50.0, 300.0] {
            let light = Light::Sphere { center, radius };
            agree(&format!("far, seed {seed}, radius {radius}"), &input(mesh.clone(), light, &receivers));
        }
    }
}

#[test]
fn many_small_triangles_over_a_fine_grid_are_the_same() {
    for seed in 400..406 {
        let mut random = Random(seed);
        let mut mesh = Mesh::default();
        for _ in 0..600 {
            let center = random.vector() * DVec3::new(1.0, 1.0, 0.3) + DVec3::Z;
            let size = random.within(0.005, 0.08);
            add_triangle(&mut mesh, [(); 3].map(|()| center + random.vector() * size));
        }
        let receivers: Vec<_> = (0..40_000)
            .map(|_| (random.vector() * DVec3::new(3.0, 3.0, 0.2) + DVec3::Z * 2.0, u32::MAX))
            .collect();
        agree(&format!("fine grid, seed {seed}"), &input(mesh, sphere(0.05), &receivers));
    }
}

/// A triangle that is next to nothing, along its sides or as seen from the light, and receivers about where its corners point.
fn needle(random: &mut Random, receiver_count: usize) -> ([DVec3; 3], Vec<(DVec3, u32)>) {
    let first = random.vector().normalize() * random.within(0.5, 2.0);
    // Along the line of sight as often as not, or nearly so.
    let across = random.vector() * power_of_ten(random.within(-4.0, 0.0));
    let along = if random.within(0.0, 1.0) < 0.5 { first + across } else { random.vector() };
    let length = power_of_ten(random.within(-3.0, 0.0));
    let second = first + along.normalize() * length;
    let width = length * power_of_ten(random.within(-6.0, -0.5));
    let third = first.lerp(second, random.within(-0.2, 1.2)) + random.vector() * width;
    let corners = [first, second, third];
    let receivers = (0..receiver_count).map(|_| {
        let start = random.within(0.0, 3.0) as usize;
        let [corner, other] = [start, start + 1 + random.within(0.0, 2.0) as usize].map(|k| corners[k % 3]);
        let past = (corner - other) * power_of_ten(random.within(-7.0, -1.0));
        let aside = random.vector() * (width * power_of_ten(random.within(-6.0, 0.0)));
        ((corner + past + aside) * random.within(1.0, 3.0), u32::MAX)
    });
    (corners, receivers.collect())
}

#[test]
fn needles_are_the_same_past_their_points() {
    for seed in 600..640 {
        let mut random = Random(seed);
        let mut mesh = Mesh::default();
        let mut receivers = Vec::new();
        for _ in 0..60 {
            let (corners, past) = needle(&mut random, 24);
            add_triangle(&mut mesh, corners);
            receivers.extend(past);
        }
        for radius in [0.0, 0.05] {
            agree(
                &format!("needles, seed {seed}, radius {radius}"),
                &input(mesh.clone(), sphere(radius), &receivers),
            );
        }
    }
}

#[test]
fn what_a_triangle_shadows_lies_within_its_bounds() {
    let mut random = Random(11);
    let mut shadowed = 0;
    for number in 0..1500 {
        let (corners, receivers) = needle(&mut random, 256);
        let mut mesh = Mesh::default();
        add_triangle(&mut mesh, corners);
        let input = input(mesh, sphere(0.0), &receivers);
        let mut run = Run::with(&input, Overlap::Sum, On::Host(HostSimd::detect(), 1));
        let bounds = run.arrays.primitives.bounds;
        let faces = run.arena.read_u32(bounds.host(0, field!(TriangleBounds.faces))) as i32;
        if faces < WITHIN {
            continue;
        }
        let face = (faces & (WITHIN - 1)).trailing_zeros() as usize;
        let sign = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
        let read = |field: Field<TriangleBounds, f32>| f64::from(run.arena.read_f32(bounds.host(0, field)));
        let (low, high) = (
            [0, 1].map(|k| read(field!(TriangleBounds.low[k]))),
            [0, 1].map(|k| read(field!(TriangleBounds.high[k]))),
        );
        let start = read(field!(TriangleBounds.start));
        for (pixel, sums) in run.brute_force(On::Host(HostSimd::detect(), 1)) {
            if sums[0] == 0 && sums[1] == 0 {
                continue;
            }
            shadowed += 1;
            let at =
                input.receiver_pixel.iter().position(|of| of == pixel).expect("a receiver has this pixel");
            let p = input.receivers[at].map(f64::from);
            let depth = p[face / 2] * sign;
            assert!(depth >= start, "triangle {number}: depth {depth} is before {start}");
            for k in 0..2 {
                let x = p[(face / 2 + 1 + k) % 3] / depth;
                assert!(
                    low[k] <= x && x <= high[k],
                    "triangle {number}: {x} is not in {}..{}",
                    low[k],
                    high[k]
                );
            }
        }
    }
    assert!(shadowed > 5000, "no more than {shadowed} receivers are shadowed");
}

#[test]
fn one_receiver_is_the_same() {
    for seed in 500..540 {
        let (mesh, receivers) = random_scene(seed, 40);
        for receiver in receivers.iter().take(8) {
            agree(&format!("one receiver, seed {seed}"), &input(mesh.clone(), sphere(0.1), &[*receiver]));
        }
    }
}

#[test]
fn receivers_on_the_borders_of_cells_are_the_same() {
    let mut random = Random(7);
    let mut mesh = Mesh::default();
    for _ in 0..40 {
        let center = random.vector() * 0.3 + DVec3::Z * 0.4;
        add_triangle(&mut mesh, [(); 3].map(|()| center + random.vector() * 0.1));
    }
    let receivers: Vec<_> = (0..20_000)
        .map(|_| (DVec3::new(random.within(-0.7, 0.7), random.within(-0.7, 0.7), 0.75), u32::MAX))
        .collect();
    let mut input = input(mesh, sphere(0.05), &receivers);
    let run = agree("before", &input);
    // Move three of four receivers to where cells meet, all on one depth that is a power of two.
    let parameters = run.arrays.grid.faces.parameters;
    let read = |field: Field<FaceParameters, f32>| run.arena.read_f32(parameters.host(4, field));
    let origin = [0, 1].map(|axis| read(field!(FaceParameters.origin[axis])));
    let cell = [0, 1].map(|axis| 1.0 / read(field!(FaceParameters.per_cell[axis])));
    let last_cell = [0, 1].map(|axis| read(field!(FaceParameters.last_cell[axis])));
    for (i, p) in input.receivers.iter_mut().enumerate() {
        let old = *p;
        *p = [0.5 * old[0] / old[2], 0.5 * old[1] / old[2], 0.5];
        if i % 4 != 0 {
            let border = |axis: usize| {
                let number = ((p[axis] / 0.5 - origin[axis]) / cell[axis]).round();
                let inner = number.clamp(1.0, last_cell[axis]);
                0.5 * (origin[axis] + cell[axis] * inner)
            };
            let on = [border(0), border(1)];
            match i % 3 {
                0 => p[0] = on[0],
                1 => p[1] = on[1],
                _ => (p[0], p[1]) = (on[0], on[1]),
            }
        }
    }
    agree("borders", &input);
}

#[test]
fn receivers_where_faces_meet_are_the_same() {
    for seed in 600..620 {
        let (mesh, mut receivers) = random_scene(seed, 600);
        for (i, (p, _)) in receivers.iter_mut().enumerate() {
            // Two or three components of one size.
            let size = p.abs().max_element();
            let sign = p.signum();
            match i % 4 {
                0 => p.x = sign.x * p.y.abs(),
                1 => p.z = sign.z * size,
                2 => *p = sign * size,
                _ => {}
            }
        }
        agree(&format!("seams, seed {seed}"), &input(mesh, sphere(0.15), &receivers));
    }
}

#[test]
fn nothing_depends_on_the_scale() {
    for seed in 700..712 {
        let (mesh, receivers) = random_scene(seed, 400);
        let plain = input(mesh.clone(), sphere(0.1), &receivers);
        let run = agree("scale 1", &plain);
        // World units: the input is the same.
        for scale in [1.0 / 1024.0, 1024.0] {
            let mut scaled = mesh.clone();
            scaled.positions.iter_mut().for_each(|p| *p *= scale);
            let moved: Vec<_> = receivers.iter().map(|&(p, own)| (p * scale, own)).collect();
            let other = input(scaled, sphere(0.1 * scale), &moved);
            assert_eq!(run.visibility(), Run::new(&other, On::Host(HostSimd::detect(), 1)).visibility());
        }
        // The kernels themselves: a power of two changes no bit.
        for scale in [1.0 / 1024.0_f32, 1024.0] {
            let mut scaled = plain.clone();
            scaled.light_radius *= scale;
            scaled.largest *= scale;
            scaled.vertices.iter_mut().chain(&mut scaled.receivers).flatten().for_each(|x| *x *= scale);
            let other = agree(&format!("scale {scale}, seed {seed}"), &scaled);
            assert_eq!(run.visibility(), other.visibility(), "scale {scale}, seed {seed}");
        }
        // Others only round.
        for scale in [1e-3, 1e3] {
            let mut scaled = mesh.clone();
            scaled.positions.iter_mut().for_each(|p| *p *= scale);
            let moved: Vec<_> = receivers.iter().map(|&(p, own)| (p * scale, own)).collect();
            agree(&format!("scale {scale}"), &input(scaled, sphere(0.1 * scale), &moved));
        }
    }
}
