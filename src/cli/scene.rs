//! `lrbsim scene`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Subcommand;
use lrbsim::{BadInput, inputs, results};
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::table::{counted, grouped};
use lrbsim_workloads::scene::{builtin_names, find_model, model_names};
use lrbsim_workloads::{
    Adjacency, EyeView, Light, Preview, Scene, SceneName, mesh_obj, scene_json, silhouette_edges,
};

use super::Failure;
use super::interrupt::on_interrupt;

/// Width of the picture that the penumbra share of `show` is taken from.
const PREVIEW_WIDTH: u32 = 240;
/// Width of the picture in letters.
const THUMBNAIL_COLUMNS: u32 = 80;

#[derive(Debug, Subcommand)]
pub(crate) enum SceneCommand {
    /// List the shipped scenes, and the views of models that must be found.
    ///
    /// A model is looked up in the folders of LRBSIM_SCENES (configs/scenes/models if that is not set), in their order,
    /// and then beside the scene file; for a shipped view, in the current folder.
    List,
    /// Print what is in a scene, and what it looks like.
    Show {
        /// A shipped scene, a scene file (.json) or a model (.obj).
        scene: PathBuf,
    },
    /// Check a scene file or a model.
    Check {
        /// A scene file (.json), a model (.obj) or a shipped scene.
        scene: PathBuf,
    },
    /// Write a scene as a model and a scene file that give the same picture.
    Export {
        /// A shipped scene, a scene file (.json) or a model (.obj).
        scene: PathBuf,
        /// Folder for NAME.obj and NAME.json [default: out/<scene>].
        #[arg(short, long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

pub(crate) fn run(command: &SceneCommand, out: &mut impl Write) -> Result<(), Failure> {
    match command {
        SceneCommand::List => {
            for name in builtin_names() {
                writeln!(out, "{name:16} {}", summary(&inputs::scene(name)?))?;
            }
            for name in model_names() {
                writeln!(out, "{name:16} {}", model_summary(name)?)?;
            }
        }
        SceneCommand::Show { scene } => {
            let scene = inputs::scene(scene)?;
            show(&scene, out)?;
            super::warn(&scene);
        }
        SceneCommand::Check { scene: name } => {
            let scene = inputs::scene(name)?;
            writeln!(out, "{}: sound: {}", name.display(), summary(&scene))?;
            super::warn(&scene);
        }
        SceneCommand::Export { scene: name, out: dir } => {
            on_interrupt(|| ());
            let name = inputs::scene_name(name)?;
            let scene = inputs::scene_with(&name, &[])?;
            let dir = dir.clone().unwrap_or_else(|| Path::new("out").join(&scene.name));
            for path in export(&scene, &name.files(&scene), &dir)? {
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
    Ok(dir.add()?)
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

/// A view of a model that is not in the binary, without reading it.
fn model_summary(name: &'static str) -> Result<String, BadInput> {
    let file = inputs::scene_file(&SceneName::Shipped(name))?.expect("a shipped view has a scene file");
    let model = file.mesh.to_string();
    let found = match find_model(&model, Path::new("")) {
        Ok(path) => format!("uses {}", path.display()),
        Err(_) => format!("needs {model} (in a folder of LRBSIM_SCENES, or here)"),
    };
    Ok(format!("{found}, {} x {} pixels, {}", file.image.width, file.image.height, light_text(&file.light)))
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
    let preview = Preview::new(scene, PREVIEW_WIDTH);
    let distance = (scene.light.center() - bounds.center()).length();
    writeln!(
        out,
        "light geometry    radius {:.4} as a disc, {:.3} from the scene's middle, {:.2} of its diagonal",
        scene.light.radius(),
        distance,
        distance / bounds.diagonal().max(f64::MIN_POSITIVE)
    )?;
    writeln!(
        out,
        "penumbra          about {:.0} % of the receivers (shadow rays, {} x {} pixels)",
        100.0 * preview.penumbra_share(),
        preview.width,
        preview.height
    )?;
    write!(out, "\n{}", preview.text(THUMBNAIL_COLUMNS))?;
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
        Light::Triangle { p0, p1, p2 } => format!("triangle between {p0}, {p1} and {p2}"),
        Light::Point { center } => format!("point at {center}"),
    }
}
