//! The files of a run.

use std::path::{Path, PathBuf};

use lrbsim_reports::files::{ResultDir, listed};
use lrbsim_reports::picture::NOTHING_HIT;
use lrbsim_reports::{npy, picture};
use lrbsim_workloads::glam::Vec3;
use lrbsim_workloads::{EyeView, Scene, light_json, mesh_obj};

use crate::algorithm::Algorithm;
use crate::error::BadInput;
use crate::frame::{RunOutput, on_host_threads, view};

/// The files that every run writes.
const FILES: [&str; 4] = ["image.png", "visibility.png", "host.json", "report.json"];

/// The files that a dump adds to those of a run.
const DUMPS: [&str; 5] = ["receivers.npy", "normals.npy", "visibility.npy", "light.json", "mesh.obj"];

/// The files that a reference adds to those of a run.
const JUDGED: [&str; 2] = ["reference.png", "error.png"];

/// Names of the files that a run writes, with or without its dump and its reference.
pub fn names(dump: bool, reference: bool) -> Vec<&'static str> {
    let extra = [(dump, &DUMPS[..]), (reference, &JUDGED[..])].into_iter().filter(|(asked, _)| *asked);
    FILES.into_iter().chain(extra.flat_map(|(_, names)| names.iter().copied())).collect()
}

/// Refuses to write files called `names` to `dir` if one of them, or of the results there that would go, was read.
pub fn spare_inputs<N: AsRef<Path>>(dir: &Path, names: &[N], inputs: &[PathBuf]) -> Result<(), BadInput> {
    // A file that does not exist has no canonical path, and cannot be lost.
    let read: Vec<PathBuf> = inputs.iter().filter_map(|path| path.canonicalize().ok()).collect();
    let there = listed(dir);
    let names = names.iter().map(AsRef::as_ref).chain(there.keys().map(Path::new));
    for path in names.map(|name| dir.join(name)) {
        if path.canonicalize().is_ok_and(|path| read.contains(&path)) {
            return Err(BadInput::new(format!(
                "`{}` is an input, and results here would replace it",
                path.display()
            ))
            .with_help("name another folder with `-o`"));
        }
    }
    Ok(())
}

/// Default folder of a run: `out/<scene>-<machine>-<algorithm>`, and after it whatever else was `asked` for, such as
/// `cores=8`: runs that differ can then be compared.
pub fn default_dir(scene: &str, machine: &str, algorithm: &Algorithm, asked: &[String]) -> PathBuf {
    let plain = format!("{scene}-{machine}-{}", algorithm.name());
    let mut name = asked.iter().fold(plain.clone(), |name, asked| format!("{name}-{asked}"));
    if name.len() > NAME_BYTES_MAX {
        name = format!("{plain}-{}", &picture::sha256(asked.join("-").as_bytes())[..16]);
    }
    Path::new("out").join(safe_name(&name))
}

/// Bytes of the name of a folder at most: systems allow 255.
const NAME_BYTES_MAX: usize = 200;

/// `name` as a file may be called: names come from files and may hold anything.
pub fn safe_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_.=,".contains(c) { c } else { '_' }).collect()
}

/// Puts all files of a run in place, `report.json` last, and tells their paths.
pub fn write(
    mut dir: ResultDir,
    output: &RunOutput,
    scene: &Scene,
    dump: bool,
) -> Result<Vec<PathBuf>, BadInput> {
    stage(&mut dir, output, scene, dump)?;
    Ok(dir.replace()?)
}

/// Stages all files of a run, `report.json` last.
pub fn stage(dir: &mut ResultDir, output: &RunOutput, scene: &Scene, dump: bool) -> Result<(), BadInput> {
    let frame = &output.frame;
    let (width, height) = (frame.width, frame.height);
    dir.stage("image.png", &picture::shaded_png(width, height, &frame.visibility, &frame.cosine))?;
    dir.stage("visibility.png", &picture::visibility_png(width, height, &frame.visibility))?;
    if let Some(reference) = &frame.reference {
        dir.stage("reference.png", &picture::shaded_png(width, height, reference, &frame.cosine))?;
        dir.stage("error.png", &picture::error_png(width, height, &frame.visibility, reference))?;
    }
    if dump {
        let shape = [height as usize, width as usize];
        let vectors = [shape[0], shape[1], 3];
        let eye = on_host_threads(output.host.host_threads as usize, || view(scene))?;
        let points = eye.points.iter().map(|point| point.as_vec3());
        dir.stage("receivers.npy", &npy::f32_array(&vectors, &spread(&eye, points)))?;
        dir.stage("normals.npy", &npy::f32_array(&vectors, &spread(&eye, eye.normals.iter().copied())))?;
        dir.stage("visibility.npy", &npy::f32_array(&shape, &frame.visibility))?;
        dir.stage("light.json", light_json(&scene.light).as_bytes())?;
        dir.stage("mesh.obj", mesh_obj(&scene.mesh).as_bytes())?;
    }
    dir.stage("host.json", output.host.to_json().as_bytes())?;
    dir.stage("report.json", output.report.to_json().as_bytes())?;
    Ok(())
}

/// A vector for each pixel, x, y, z, from one for each receiver.
fn spread(eye: &EyeView, of_receivers: impl Iterator<Item = Vec3>) -> Vec<f32> {
    let mut of_pixels = vec![NOTHING_HIT; 3 * eye.width as usize * eye.height as usize];
    for (pixel, vector) in eye.pixels.iter().zip(of_receivers) {
        of_pixels[3 * *pixel as usize..][..3].copy_from_slice(&vector.to_array());
    }
    of_pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_named_after_what_ran() {
        let name = |scene: &str, machine: &str, asked: &[&str]| {
            let asked: Vec<String> = asked.iter().map(|text| (*text).to_owned()).collect();
            default_dir(scene, machine, &Algorithm::default(), &asked)
        };
        assert_eq!(name("tiny", "ideal", &[]), Path::new("out/tiny-ideal-sism"));
        assert_eq!(name("../a b", "x/y", &[]), Path::new("out/.._a_b-x_y-sism"));
        assert_eq!(name("a", "b", &["cores=8", "size=8x8"]), Path::new("out/a-b-sism-cores=8-size=8x8"));
        let long = "x".repeat(300);
        let short = name("a", "b", &[&long]);
        assert_eq!(short.as_os_str().len(), "out/a-b-sism-".len() + 16);
        assert_ne!(short, name("a", "b", &[&long, "cores=8"]));
    }
}
