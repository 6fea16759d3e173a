//! Runs a scene through the kernels, functionally, and judges the picture by shadow rays.
//!
//! `cargo run --release -p lrbsim-kernels --example judge -- SCENE [WIDTH HEIGHT RAYS OUT.png]`

use std::path::Path;

use lrbsim_isa::{Arena, Class, HostSimd, OpCounts, run_functional};
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

    let mut arena = Arena::new();
    let mut program = sism::program(&input, &sism::Options::default(), &mut arena);
    println!("{name}: {} triangles, {} receivers", input.triangles.len(), input.receivers.len());
    let start = std::time::Instant::now();
    let mut total = 0;
    for phase in &program.phases {
        let mut counts = OpCounts::default();
        let phase_start = std::time::Instant::now();
        let mut tasks = 0;
        for make in &phase.steps {
            let step = make(&mut program.state, &mut arena);
            tasks += step.tasks();
            counts.add(&run_functional(&step, &mut arena, HostSimd::detect(), 1));
        }
        total += counts.total();
        let of = |class: Class| counts.class_counts[class as usize];
        println!(
            "{:12} {tasks:6} tasks {:>12} uops {:6.1} M/s  lanes {:.2}  gathers {} scatters {} atomics {}",
            phase.id,
            counts.total(),
            counts.total() as f64 / phase_start.elapsed().as_secs_f64() * 1e-6,
            counts.lanes_active() as f64 / (counts.lanes_active() + counts.lanes_masked) as f64,
            of(Class::Gather),
            of(Class::Scatter),
            of(Class::Atomic) + of(Class::AtomicGather),
        );
    }
    let seconds = start.elapsed().as_secs_f64();
    println!("{total} uops in {seconds:.3} s, {} silhouettes", program.state.silhouette_edges(&arena));

    let visibility = program.state.visibility(&arena);
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
