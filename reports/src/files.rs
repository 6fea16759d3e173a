//! Result files: staged under a temporary name and renamed, so that nobody ever reads half a file.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Why results could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{action} {}: {source}", path.display())]
pub struct FileError {
    /// What was tried: `cannot create`, `cannot write`, …
    pub action: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// What the operating system said.
    pub source: io::Error,
}

impl FileError {
    fn new(action: &'static str, path: &Path, source: io::Error) -> FileError {
        FileError { action, path: path.to_owned(), source }
    }
}

/// Writes `bytes` to `path`: to a temporary name beside it first, then renamed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".partial-{}", std::process::id()));
    let temporary = path.with_file_name(name);
    let written = write_whole(&temporary, bytes).and_then(|()| fs::rename(&temporary, path));
    written.map_err(|error| {
        // The first error is the one to tell; a leftover is removed as well as can be.
        let _ = fs::remove_file(&temporary);
        FileError::new("cannot write", path, error)
    })
}

/// Writes `bytes` to `path` through `temporary`, a file beside it that only one process writes to at a time: what a killed
/// process left there is written over.
pub fn write_with_temporary(path: &Path, temporary: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let written = write_whole(temporary, bytes).and_then(|()| fs::rename(temporary, path));
    written.map_err(|error| {
        let _ = fs::remove_file(temporary);
        FileError::new("cannot write", path, error)
    })
}

fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// A folder of results that appear together.
///
/// [`ResultDir::open`] proves at once that the folder can be written, before a long run, and leaves nothing there. The first
/// staged file creates a staging folder inside it and [`ResultDir::commit`] renames the files into place. Dropped without
/// `commit`, it leaves nothing behind. Files of other names are never touched.
#[derive(Debug)]
pub struct ResultDir {
    target: PathBuf,
    /// Present once something is staged.
    staging: Option<PathBuf>,
    /// The folders that this value created, innermost first: removed again when nothing is committed.
    created: Vec<PathBuf>,
    names: Vec<String>,
}

impl ResultDir {
    /// Opens `target` for results; it and its parents may be missing, they are created when something is staged.
    pub fn open(target: &Path) -> Result<ResultDir, FileError> {
        let cannot_create = |error| FileError::new("cannot create", target, error);
        let nearest = nearest_existing(target).map_err(cannot_create)?;
        if !nearest.is_dir() {
            let file = nearest.display();
            return Err(cannot_create(io::Error::other(format!("`{file}` is a file, not a folder"))));
        }
        let probe = nearest.join(format!(".lrbsim-probe-{}", std::process::id()));
        fs::File::create_new(&probe)
            .and_then(|_| fs::remove_file(&probe))
            .map_err(|error| FileError::new("cannot write to", target, error))?;
        Ok(ResultDir { target: target.to_owned(), staging: None, created: Vec::new(), names: Vec::new() })
    }

    /// Stages one file; `name` may not contain a separator.
    pub fn stage(&mut self, name: &str, bytes: &[u8]) -> Result<(), FileError> {
        let path = self.staging()?.join(name);
        write_whole(&path, bytes)
            .map_err(|error| FileError::new("cannot write", &self.target.join(name), error))?;
        self.names.push(name.to_owned());
        Ok(())
    }

    /// The staging folder, created when it is first asked for.
    fn staging(&mut self) -> Result<PathBuf, FileError> {
        if let Some(staging) = &self.staging {
            return Ok(staging.clone());
        }
        // Noted first, so that a failure half way removes what was created.
        self.created = self
            .target
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists())
            .map(Path::to_owned)
            .collect();
        fs::create_dir_all(&self.target)
            .map_err(|error| FileError::new("cannot create", &self.target, error))?;
        // A killed process of the same id may have left such a folder; it is not this one's to remove.
        let staging = (0_u32..)
            .map(|n| self.target.join(format!(".partial-{}-{n}", std::process::id())))
            .find(|folder| !folder.exists())
            .expect("a folder does not hold 2^32 of them");
        fs::create_dir(&staging).map_err(|error| FileError::new("cannot write to", &self.target, error))?;
        self.staging = Some(staging.clone());
        Ok(staging)
    }

    /// Moves all staged files into place, in the order they were staged, and tells their paths.
    pub fn commit(mut self) -> Result<Vec<PathBuf>, FileError> {
        let mut paths = Vec::new();
        for name in &self.names {
            let from = self.staging.as_deref().expect("what is named was staged").join(name);
            let to = self.target.join(name);
            fs::rename(from, &to).map_err(|error| FileError::new("cannot write", &to, error))?;
            paths.push(to);
        }
        self.created.clear();
        Ok(paths)
    }
}

/// `path`, or the nearest folder or file above it that exists.
fn nearest_existing(path: &Path) -> io::Result<&Path> {
    for place in path.ancestors().filter(|place| !place.as_os_str().is_empty()) {
        match place.symlink_metadata() {
            Ok(_) => return Ok(place),
            Err(error) if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(Path::new("."))
}

impl Drop for ResultDir {
    fn drop(&mut self) {
        // Best effort: an error here would hide the one that led here.
        if let Some(staging) = &self.staging {
            let _ = fs::remove_dir_all(staging);
        }
        for folder in &self.created {
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listing(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .expect("the folder exists")
            .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn committed_files_appear_and_nothing_else() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let target = root.path().join("a/b");
        let mut dir = ResultDir::open(&target).expect("writable");
        dir.stage("one", b"1").expect("writable");
        dir.stage("two", b"2").expect("writable");
        assert_eq!(dir.commit().expect("renamed"), [target.join("one"), target.join("two")]);
        assert_eq!(listing(&target), ["one", "two"]);
    }

    #[test]
    fn files_of_other_names_stay() {
        let root = tempfile::tempdir().expect("a temporary folder");
        for name in ["light.json", "mesh.obj"] {
            fs::write(root.path().join(name), b"old").expect("writable");
        }
        let mut dir = ResultDir::open(root.path()).expect("writable");
        dir.stage("one", b"1").expect("writable");
        dir.commit().expect("renamed");
        assert_eq!(listing(root.path()), ["light.json", "mesh.obj", "one"]);
    }

    #[test]
    fn an_open_folder_holds_nothing_that_an_interrupt_could_leave() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let _here = ResultDir::open(root.path()).expect("writable");
        let _below = ResultDir::open(&root.path().join("a/b")).expect("writable");
        assert!(listing(root.path()).is_empty());
    }

    #[test]
    fn without_commit_nothing_stays() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let mut dir = ResultDir::open(&root.path().join("a/b")).expect("writable");
        dir.stage("one", b"1").expect("writable");
        drop(dir);
        assert!(listing(root.path()).is_empty());
    }

    #[test]
    fn without_commit_older_results_stay() {
        let root = tempfile::tempdir().expect("a temporary folder");
        fs::write(root.path().join("one"), b"old").expect("writable");
        let mut dir = ResultDir::open(root.path()).expect("writable");
        dir.stage("one", b"new").expect("writable");
        drop(dir);
        assert_eq!(fs::read(root.path().join("one")).expect("readable"), b"old");
        assert_eq!(listing(root.path()), ["one"]);
    }

    #[test]
    fn a_folder_below_a_file_is_refused_when_it_is_opened() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let file = root.path().join("file");
        fs::write(&file, b"").expect("writable");
        let error = ResultDir::open(&file.join("out")).expect_err("a file has no folders");
        assert!(error.to_string().starts_with("cannot create"), "{error}");
        assert!(error.to_string().ends_with("file` is a file, not a folder"), "{error}");
    }

    #[test]
    fn a_file_is_replaced_whole_and_no_temporary_name_stays() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let path = root.path().join("x.json");
        write_atomically(&path, b"first and longer").expect("writable");
        write_atomically(&path, b"second").expect("writable");
        assert_eq!(fs::read(&path).expect("readable"), b"second");
        assert_eq!(listing(root.path()), ["x.json"]);
    }
}
