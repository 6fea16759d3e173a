//! Draws a scene with shadow rays: `preview SCENE OUT.png [WIDTH HEIGHT [RAYS]]`.

use std::path::Path;

use lrbsim_workloads::reference::shadow_rays;
use lrbsim_workloads::{Adjacency, EyeView, ImageSize, load_scene, silhouette_edges};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().collect();
    let [_, scene_arg, out, ..] = args.as_slice() else {
        return Err("usage: preview SCENE OUT.png [WIDTH HEIGHT [RAYS]]".into());
    };
    let number = |k: usize| args.get(k).map(|s| s.parse::<u32>()).transpose();
    let scene = load_scene(scene_arg, Path::new("."))?;
    let size = ImageSize {
        width: number(3)?.unwrap_or(scene.image.width),
        height: number(4)?.unwrap_or(scene.image.height),
    };
    let adjacency = Adjacency::new(&scene.mesh);
    println!(
        "{}: {} triangles, {} silhouette edges, fit {:?}",
        scene.name,
        scene.mesh.triangles.len(),
        silhouette_edges(&scene.mesh, &adjacency, scene.light.center()),
        scene.fit
    );
    println!("{:?}\n{:?}", scene.camera, scene.light);
    let eye = EyeView::render(&scene.mesh, &scene.camera, size.width, size.height);
    let visibility = shadow_rays(&scene.mesh, &scene.light, &eye, number(5)?.unwrap_or(16));
    let penumbra = visibility.iter().filter(|&&v| v > 0.0 && v < 1.0).count();
    println!("{} receivers, {penumbra} in penumbra", eye.points.len());

    let mut picture = image::RgbImage::from_pixel(size.width, size.height, image::Rgb([60, 70, 90]));
    for (i, &pixel) in eye.pixels.iter().enumerate() {
        let to_light = (scene.light.center() - eye.points[i]).normalize();
        let facing = eye.normals[i].as_dvec3().dot(to_light).max(0.0);
        let shade = 0.12 + 0.88 * facing * visibility[i];
        let gray = (shade.powf(1.0 / 2.2) * 255.0) as u8;
        picture.put_pixel(pixel % size.width, pixel / size.width, image::Rgb([gray, gray, gray]));
    }
    picture.save(out)?;
    Ok(())
}
