//! What studies share whose scenes are made for them: parts of scenes, how pictures are drawn, how results are written.

mod parts;

use std::path::{Path, PathBuf};

use lrbsim_isa::{Arena, Runner, Step, run_functional};
use lrbsim_kernels::method::Shadows;
use lrbsim_reports::analysis::Finding;
use lrbsim_reports::files::ResultDir;
use lrbsim_workloads::scene::Procedural;
use lrbsim_workloads::{
    Camera, ImageSize, Light, Mesh, MeshSource, Scene, SceneError, SceneFile, ShadowInput,
};

use crate::algorithm::Algorithm;
use crate::error::BadInput;
use crate::frame::{HostOptions, no_memory};

pub(crate) use parts::{Parts, turned};

/// The scene `id` of a study.
///
/// # Errors
/// If the program refuses it.
pub(crate) fn scene(
    study: &str,
    id: &str,
    mesh: Mesh,
    light: Light,
    (camera, image): (Camera, ImageSize),
) -> Result<Scene, SceneError> {
    let source = Procedural { procedural: format!("{study} {id}"), seed: 1, detail: 1, pieces: 1 };
    let file = SceneFile { mesh: MeshSource::Procedural(source), camera, image, light, motion: None };
    Scene::new(id, &file, mesh)
}

/// The picture of `input`, run functionally: nothing is timed.
pub(crate) fn draw(
    algorithm: &Algorithm,
    mut input: ShadowInput,
    host: HostOptions,
) -> Result<Shadows, BadInput> {
    let mut arena = Arena::reserve().map_err(no_memory)?;
    let mut run_step = |_: &'static lrbsim_isa::Phase, step: &Step, arena: &mut Arena| {
        run_functional(step, arena, host.simd, host.threads);
        Ok(())
    };
    let shadows = algorithm.run(&mut input, &mut Runner::new(&mut arena, &mut run_step));
    arena.check().map_err(no_memory)?;
    shadows.map_err(|stopped| BadInput::new(stopped.to_string()))
}

/// A visibility as it is judged. One that is no number is off by a whole light or more: it must neither hide in a sum nor spoil it.
pub(crate) fn number(visible: f32) -> f64 {
    if visible.is_finite() { f64::from(visible) } else { 2.0 }
}

/// The files of a study other than its results, all drawn from them: names and bytes. Its text is called `name`.
pub(crate) fn drawings(
    name: &str,
    markdown: String,
    findings: &[Finding],
    page: String,
) -> Vec<(String, Vec<u8>)> {
    let mut files = vec![(name.to_owned(), markdown.into_bytes())];
    files.extend(findings.iter().flat_map(Finding::files));
    files.push(("report.html".to_owned(), page.into_bytes()));
    files
}

/// Writes the results of a study to `dir`, its JSON last, in place of the results there, and tells their paths.
pub(crate) fn write(
    dir: &Path,
    drawings: &[(String, Vec<u8>)],
    file: &str,
    json: &str,
) -> Result<Vec<PathBuf>, BadInput> {
    let mut dir = ResultDir::open(dir)?;
    for (name, bytes) in drawings {
        dir.stage(name, bytes)?;
    }
    dir.stage(file, json.as_bytes())?;
    Ok(dir.replace()?)
}
