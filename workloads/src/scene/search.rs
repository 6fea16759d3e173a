//! Where models are looked for.
//!
//! A model that a scene file names is looked up in the folders of the environment variable `LRBSIM_SCENES` (separated
//! as in `PATH`), in their order, and then beside the scene file; for a shipped scene, which has no file, in the
//! current folder. Where the variable is not set it stands for `configs/scenes/models`, so that a checkout finds its
//! own models. The first that is there is taken. An absolute path is taken as it is. A model that is a scene by itself
//! is a path first: only what is not there is looked up.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::error::SceneError;

/// Environment variable with folders of models.
pub const SEARCH_VARIABLE: &str = "LRBSIM_SCENES";

/// What the variable stands for where it is not set: the models of a checkout that is the current folder.
const SEARCH_DEFAULT: &str = "configs/scenes/models";

/// Path of the model that a scene file in `beside` calls `model`.
///
/// # Errors
/// [`SceneError::ModelMissing`] if it is in none of the folders.
pub fn find_model(model: &str, beside: &Path) -> Result<PathBuf, SceneError> {
    find_in(Path::new(model), search_path().into_iter().chain([beside.to_owned()]))
}

/// Path of the model `model` that is a scene by itself: this path, or else one in the folders of the variable.
pub(super) fn find_bare_model(model: &Path) -> PathBuf {
    // Of one that is nowhere, the plain path: reading it says what is wrong.
    find_in(model, [PathBuf::new()].into_iter().chain(search_path())).unwrap_or_else(|_| model.to_owned())
}

fn search_path() -> Vec<PathBuf> {
    let variable = std::env::var_os(SEARCH_VARIABLE).unwrap_or_else(|| OsString::from(SEARCH_DEFAULT));
    std::env::split_paths(&variable).filter(|folder| !folder.as_os_str().is_empty()).collect()
}

fn find_in(model: &Path, folders: impl Iterator<Item = PathBuf>) -> Result<PathBuf, SceneError> {
    let mut searched = Vec::new();
    for folder in folders {
        let path = folder.join(model);
        if path.exists() {
            return Ok(path);
        }
        let shown = folder.display().to_string();
        searched.push(if shown.is_empty() { ".".to_owned() } else { shown });
    }
    Err(SceneError::ModelMissing { model: model.display().to_string(), searched: searched.join(", ") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_folder_that_has_the_model_is_taken() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let found = find_in(Path::new("lib.rs"), [root.join("nowhere"), root.join("src")].into_iter());
        assert_eq!(found.expect("it is there"), root.join("src/lib.rs"));
        let both = find_in(Path::new("mod.rs"), [root.join("src/scene"), root.join("src/obj")].into_iter());
        assert_eq!(both.expect("it is in both"), root.join("src/scene/mod.rs"));
    }

    #[test]
    fn a_missing_model_is_named_with_the_folders_searched() {
        let message = find_in(Path::new("duck.obj"), ["one", "two", ""].map(PathBuf::from).into_iter())
            .expect_err("there is none")
            .to_string();
        assert!(message.contains("`duck.obj`") && message.contains("one, two, ."), "{message}");
        assert!(message.contains("LRBSIM_SCENES"), "{message}");
    }
}
