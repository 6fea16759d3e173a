//! Machines and scenes from names, files and the command line.

mod machine;
mod scene;

use std::path::Path;

pub use machine::{Machine, machine_file};
pub use scene::{at_time, resize, scene, scene_file, scene_name, scene_with, set_light_radius};
pub(crate) use scene::{check_scene, mesh_source};

use crate::error::BadInput;
use crate::settings::distance;

/// Whether `path` is meant as a JSON file and not as a shipped name.
pub(crate) fn looks_like_file(path: &Path) -> bool {
    let is_json = path.extension().is_some_and(|found| found.eq_ignore_ascii_case("json"));
    is_json || path.components().count() > 1 || path.is_file()
}

/// What to say of a `name` that is neither one of the `known` nor a file, with the one that it resembles.
pub(crate) fn unknown_name(name: &Path, what: &str, files: &str, known: &[&str]) -> BadInput {
    let name = &*name.to_string_lossy();
    let message = format!("`{name}` is no {what}; it must be {files} or one of: {}", known.join(", "));
    let bad = BadInput::new(message);
    match known.iter().min_by_key(|candidate| distance(name, candidate)) {
        Some(nearest) if distance(name, nearest) <= name.len().div_ceil(3) => {
            bad.with_help(format!("did you mean `{nearest}`?"))
        }
        _ => bad,
    }
}
