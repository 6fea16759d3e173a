//! `lrbsim scene`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Subcommand;
use lrbsim::{BadInput, inputs, results};
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::table::{counted, grouped};
use lrbsim_workloads::scene::builtin_names;
use lrbsim_workloads::{Adjacency, EyeView, Light, Scene, mesh_obj, scene_json, silhouette_edges};

use super::Failure;

#[derive(Debug, Subcommand)]
pub(crate) enum SceneCommand {
    /// List the shipped scenes.
    List,
    /// Print what is in a scene.
    Show {
        /// A shipped scene, a scene file (.json) or a model (.obj).
        scene: String,
    },
    /// Check a scene file or a model.
    Check {
        /// A scene file (.json), a model (.obj) or a shipped scene.
        scene: String,
    },
    /// Write a scene as a model and a scene file that give the same picture.
    Export {
        /// A shipped scene, a scene file (.json) or a model (.obj).
        scene: String,
        /// Folder for NAME.obj and NAME.json [default: out/<scene>].
        #[arg(short, long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

pub(crate) fn run(command: &SceneCommand, out: &mut impl Write) -> Result<(), Failure> {
    match command {
        SceneCommand::List => {
            for name in builtin_names() {
                writeln!(out, "{name:14} {}", summary(&inputs::scene(name)?))?;
            }
        }
        SceneCommand::Show { scene } => show(&inputs::scene(scene)?, out)?,
        SceneCommand::Check { scene: name } => {
            let scene = inputs::scene(name)?;
            writeln!(out, "{name}: sound: {}", summary(&scene))?;
        }
        SceneCommand::Export { scene: name, out: dir } => {
            let scene = inputs::scene(name)?;
            let dir = dir.clone().unwrap_or_else(|| Path::new("out").join(&scene.name));
            for path in export(&scene, &inputs::scene_files(name, &scene), &dir)? {
                writeln!(out, "wrote {}", path.display())?;
            }
        }
    }
    Ok(())
}

fn export(scene: &Scene, files_read: &[PathBuf], dir: &Path) -> Result<Vec<PathBuf>, BadInput> {
    let (model, file) = (format!("{}.obj", scene.name), format!("{}.json", scene.name));
    results::spare_inputs(dir, &[&model, &file], files_read)?;
    let mut dir = ResultDir::open(dir)?;
    dir.stage(&model, mesh_obj(&scene.mesh).as_bytes())?;
    let mut text = scene_json(scene, &model);
    text.push('\n');
    dir.stage(&file, text.as_bytes())?;
    Ok(dir.commit()?)
}

fn summary(scene: &Scene) -> String {
    format!(
        "{}, {} x {} pixels, {}",
        counted(scene.mesh.triangles.len() as u64, "triangle"),
        scene.image.width,
        scene.image.height,
        light_text(&scene.light)
    )
}

fn show(scene: &Scene, out: &mut impl Write) -> Result<(), Failure> {
    let adjacency = Adjacency::new(&scene.mesh);
    let eye = EyeView::render(&scene.mesh, &scene.camera, scene.image.width, scene.image.height);
    let silhouette = silhouette_edges(&scene.mesh, &adjacency, scene.light.center());
    let pixels = u64::from(scene.image.width) * u64::from(scene.image.height);
    let receivers = eye.points.len() as u64;
    let bounds = scene.mesh.bounds();
    let camera = &scene.camera;
    writeln!(out, "scene             {}", scene.name)?;
    writeln!(out, "mesh              {}", scene.source)?;
    writeln!(out, "triangles         {}", grouped(scene.mesh.triangles.len() as u64))?;
    writeln!(out, "vertices          {}", grouped(scene.mesh.positions.len() as u64))?;
    writeln!(out, "edges             {}", grouped(adjacency.edges.len() as u64))?;
    writeln!(out, "silhouette edges  {}", grouped(silhouette as u64))?;
    writeln!(out, "bounds            {} to {}", bounds.min, bounds.max)?;
    writeln!(out, "image             {} x {} pixels", scene.image.width, scene.image.height)?;
    writeln!(out, "receivers         {} of {} pixels", grouped(receivers), grouped(pixels))?;
    writeln!(out, "light             {}", light_text(&scene.light))?;
    writeln!(
        out,
        "camera            from {} to {}, up {}, {} degrees",
        camera.eye, camera.target, camera.up, camera.fov_y_degrees
    )?;
    Ok(())
}

fn light_text(light: &Light) -> String {
    match light {
        Light::Sphere { center, radius } => format!("sphere at {center}, radius {radius}"),
        Light::Disc { center, normal, radius } => {
            format!("disc at {center}, normal {normal}, radius {radius}")
        }
        Light::Rect { center, half_u, half_v } => {
            format!("rectangle at {center}, half sides {half_u} and {half_v}")
        }
        Light::Linear { p0, p1 } => format!("line from {p0} to {p1}"),
        Light::Point { center } => format!("point at {center}"),
    }
}
