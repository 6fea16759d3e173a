//! Runs a scene through the kernels, functionally, and judges the picture by shadow rays.
//!
//! `cargo run --release -p lrbsim-kernels --example judge -- SCENE [WIDTH HEIGHT RAYS OUT.png]`

use std::path::Path;

use lrbsim_isa::{Arena, Class, HostSimd, OpCounts, Phase, Runner, Step, run_functional};
use lrbsim_kernels::sism;
use lrbsim_workloads::reference::{ErrorMetrics, shadow_rays};
use lrbsim_workloads::{Adjacency, EyeView, ShadowInput, load_scene};

#[expect(clippy::disallowed_methods, reason = "reports host time")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: u32| args.get(i).and_then(|a| a.parse().ok()).unwrap_or(default);
    let name = args.first().map_or("tiny", String::as_str);
    let scene = load_scene(name, Path::new("."))?;
    let (width, height) = (number(1, scene.image.width), number(2, scene.image.height));
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, width, height);
    let input = ShadowInput::new(&scene, &adjacency, &eye);

    println!("{name}: {} triangles, {} receivers", input.triangles.len(), input.receivers.len());
    let mut phases: Vec<(&Phase, u32, OpCounts, f64)> = Vec::new();
    let mut run_step = |phase: &'static Phase, step: &Step, arena: &mut Arena| {
        if phases.last().is_none_or(|(last, ..)| *last != phase) {
            phases.push((phase, 0, OpCounts::default(), 0.0));
        }
        let (_, tasks, counts, seconds) = phases.last_mut().expect("pushed above");
        let start = std::time::Instant::now();
        *tasks += step.tasks();
        counts.add(&run_functional(step, arena, HostSimd::detect(), 1));
        *seconds += start.elapsed().as_secs_f64();
        Ok(())
    };
    let mut arena = Arena::new();
    let arrays =
        sism::run(&mut input.clone(), sism::Overlap::Sum, &mut Runner::new(&mut arena, &mut run_step))?;
    for (phase, tasks, counts, seconds) in &phases {
        let of = |class: Class| counts.class_counts[class as usize];
        println!(
            "{:12} {tasks:6} tasks {:>12} uops {:6.1} M/s  lanes {:.2}  gathers {} scatters {} atomics {}",
            phase.id,
            counts.total(),
            counts.total() as f64 / seconds * 1e-6,
            counts.lanes_active() as f64 / (counts.lanes_active() + counts.lanes_masked) as f64,
            of(Class::Gather),
            of(Class::Scatter),
            of(Class::Atomic) + of(Class::AtomicGather),
        );
    }
    let total: u64 = phases.iter().map(|(_, _, counts, _)| counts.total()).sum();
    let seconds: f64 = phases.iter().map(|(.., seconds)| seconds).sum();
    println!("{total} uops in {seconds:.3} s, {} silhouettes", arrays.primitives.edge_count);

    let visibility = arrays.visibility(&input, &arena);
    let test: Vec<f64> = visibility.iter().map(|&x| f64::from(x)).collect();
    let truth = shadow_rays(&scene.mesh, &scene.light, &eye, number(3, 256));
    println!("{:?}", ErrorMetrics::new(&truth, &test));
    if let Some(path) = args.get(4) {
        // Ours, the rays', and the difference, side by side.
        let mut picture = image::RgbImage::new(3 * width, height);
        for (i, &pixel) in eye.pixels.iter().enumerate() {
            let (x, y) = (pixel % width, pixel / width);
            let shade = 0.35
                + 0.65
                    * f64::from(
                        eye.normals[i]
                            .dot((scene.light.center() - eye.points[i]).normalize().as_vec3())
                            .max(0.0),
                    );
            let gray = |value: f64| image::Rgb([(255.0 * value.clamp(0.0, 1.0)) as u8; 3]);
            picture.put_pixel(x, y, gray(shade * (0.15 + 0.85 * test[i])));
            picture.put_pixel(width + x, y, gray(shade * (0.15 + 0.85 * truth[i])));
            let off = test[i] - truth[i];
            let color = image::Rgb([(255.0 * (-off).max(0.0)) as u8, (255.0 * off.max(0.0)) as u8, 0]);
            picture.put_pixel(2 * width + x, y, color);
        }
        picture.save(path)?;
    }
    Ok(())
}
