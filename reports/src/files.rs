//! Result files: staged under a temporary name and renamed, so that nobody ever reads half a file.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use crate::lock::Lock;
use crate::picture::{Hashing, sha256};

/// Why results could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{action} {}: {source}", path.display())]
pub struct FileError {
    /// What was tried: `cannot create`, `cannot write`, …
    pub action: &'static str,
    /// The file or folder that it was tried with.
    pub path: PathBuf,
    /// What the operating system said.
    pub source: io::Error,
}

impl FileError {
    fn new(action: &'static str, path: &Path, source: io::Error) -> FileError {
        FileError { action, path: path.to_owned(), source }
    }
}

/// Shared by whoever has something half written; wanted alone by [`undisturbed`].
static WRITING: RwLock<()> = RwLock::new(());

/// Waits until nothing of this process is half written, and keeps anything from being begun as long as the guard lives:
/// what the handler of an interrupt takes before it ends the process.
pub fn undisturbed() -> RwLockWriteGuard<'static, ()> {
    // A thread that panicked has removed what it had half written.
    WRITING.write().unwrap_or_else(PoisonError::into_inner)
}

fn writing() -> RwLockReadGuard<'static, ()> {
    WRITING.read().unwrap_or_else(PoisonError::into_inner)
}

/// Writes `bytes` to `path`: to a temporary name beside it first, then renamed.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".partial-{}", std::process::id()));
    write_with_temporary(path, &path.with_file_name(name), bytes)
}

/// Writes `bytes` to `path` through `temporary`, a file beside it that only one process writes to at a time: what a
/// killed process left there is written over.
pub fn write_with_temporary(path: &Path, temporary: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let _writing = writing();
    let written = write_whole(temporary, bytes).and_then(|()| fs::rename(temporary, path));
    written.map_err(|error| {
        // The first error is the one to tell; a leftover is removed as well as can be.
        let _ = fs::remove_file(temporary);
        FileError::new("cannot write", path, error)
    })
}

fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = fs::File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// Name of the list of a folder's results: a line a file, its SHA-256 and its name, as `sha256sum` writes and checks
/// them.
pub const LIST: &str = "SHA256SUMS";

/// Names of the results in `folder` with their hashes, by its [`LIST`]; none where there is no list.
pub fn listed(folder: &Path) -> BTreeMap<String, String> {
    let text = fs::read_to_string(folder.join(LIST)).unwrap_or_default();
    let lines = text.lines().filter_map(|line| line.split_once("  "));
    let plain = |name: &str| Path::new(name).file_name().is_some_and(|file| file == name);
    lines.filter(|(_, name)| plain(name)).map(|(hash, name)| (name.to_owned(), hash.to_owned())).collect()
}

/// A folder of results that appear together.
///
/// [`ResultDir::open`] proves at once that the folder can be written, before a long run, and leaves nothing there. The
/// first staged file creates a staging folder inside it, [`ResultDir::replace`] and [`ResultDir::add`] rename the files
/// into place. Dropped without either, it leaves nothing behind. Two processes may write to one folder: the second
/// waits for the first. What a killed one left half is removed by the next. Files that are no results are never
/// touched.
#[derive(Debug)]
pub struct ResultDir {
    target: PathBuf,
    /// Present once something is staged.
    staging: Option<Staging>,
    /// The folders that this value created, innermost first: removed again when nothing is put in place.
    created: Vec<PathBuf>,
    /// What is staged, in order: name and hash.
    staged: Vec<(String, String)>,
}

/// A folder for files that are not in place yet, and the right to put them there.
#[derive(Debug)]
struct Staging {
    folder: PathBuf,
    /// `None` on a file system without locks: two processes at once may then be in each other's way.
    _lock: Option<Lock>,
    _writing: RwLockReadGuard<'static, ()>,
}

/// Begin of the names of staging folders.
const STAGING: &str = ".partial";

impl ResultDir {
    /// Opens `target` for results; it and its parents may be missing, they are created when something is staged.
    pub fn open(target: &Path) -> Result<ResultDir, FileError> {
        let cannot_create = |error| FileError::new("cannot create", target, error);
        let nearest = nearest_existing(target).map_err(cannot_create)?;
        if !nearest.is_dir() {
            let file = nearest.display();
            return Err(cannot_create(io::Error::other(format!("`{file}` is a file, not a folder"))));
        }
        let _writing = writing();
        let probe = nearest.join(format!(".lrbsim-probe-{}", std::process::id()));
        fs::File::create_new(&probe)
            .and_then(|_| fs::remove_file(&probe))
            .map_err(|error| FileError::new("cannot write to", target, error))?;
        Ok(ResultDir { target: target.to_owned(), staging: None, created: Vec::new(), staged: Vec::new() })
    }

    /// Stages one file; `name` may not contain a separator.
    pub fn stage(&mut self, name: &str, bytes: &[u8]) -> Result<(), FileError> {
        self.stage_with(name, |file| file.write_all(bytes))
    }

    /// Stages one file that `write` writes bit by bit: it need not be in memory as a whole.
    pub fn stage_with(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), FileError> {
        let path = self.staging()?.join(name);
        let staged = || {
            let mut out = Hashing::new(io::BufWriter::new(fs::File::create(&path)?));
            write(&mut out)?;
            let (out, hash) = out.end();
            out.into_inner()?.sync_all()?;
            Ok(hash)
        };
        let hash =
            staged().map_err(|error| FileError::new("cannot write", &self.target.join(name), error))?;
        self.staged.push((name.to_owned(), hash));
        Ok(())
    }

    /// Has the file that was staged first put in place after all others.
    pub fn first_goes_last(&mut self) {
        if !self.staged.is_empty() {
            self.staged.rotate_left(1);
        }
    }

    /// The staging folder, created when it is first asked for.
    fn staging(&mut self) -> Result<PathBuf, FileError> {
        if let Some(staging) = &self.staging {
            return Ok(staging.folder.clone());
        }
        let writing = writing();
        // Noted first, so that a failure half way removes what was created.
        self.created = self
            .target
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists())
            .map(Path::to_owned)
            .collect();
        fs::create_dir_all(&self.target)
            .map_err(|error| FileError::new("cannot create", &self.target, error))?;
        let cannot_write = |error| FileError::new("cannot write to", &self.target, error);
        let lock = Lock::wait(&self.target.join(".lock")).map_err(cannot_write)?;
        // Only who holds the lock has such a folder: what is there, a killed process left.
        for entry in fs::read_dir(&self.target).map_err(cannot_write)?.flatten() {
            if entry.file_name().to_string_lossy().starts_with(STAGING) {
                fs::remove_dir_all(entry.path()).map_err(cannot_write)?;
            }
        }
        let folder = self.target.join(STAGING);
        fs::create_dir(&folder).map_err(cannot_write)?;
        self.staging = Some(Staging { folder: folder.clone(), _lock: lock, _writing: writing });
        Ok(folder)
    }

    /// Moves all staged files into place, in the order they were staged, and tells their paths. Results that were there
    /// before and are not staged go, but for those that somebody has changed since.
    pub fn replace(self) -> Result<Vec<PathBuf>, FileError> {
        for (name, hash) in listed(&self.target) {
            let path = self.target.join(&name);
            let stale = !self.staged.iter().any(|(staged, _)| *staged == name);
            if stale && fs::read(&path).is_ok_and(|bytes| sha256(&bytes) == hash) {
                fs::remove_file(&path).map_err(|error| FileError::new("cannot remove", &path, error))?;
            }
        }
        self.put_in_place(Some(BTreeMap::new()))
    }

    /// Moves all staged files into place beside what is there, and tells their paths. Where results have a list, it
    /// names these files too.
    pub fn add(self) -> Result<Vec<PathBuf>, FileError> {
        let list = self.target.join(LIST).is_file().then(|| listed(&self.target));
        self.put_in_place(list)
    }

    /// Moves all staged files into place, and adds them to `list` if there is to be one.
    fn put_in_place(mut self, list: Option<BTreeMap<String, String>>) -> Result<Vec<PathBuf>, FileError> {
        let staging = self.staging()?;
        let place = |name: &str| {
            let to = self.target.join(name);
            fs::rename(staging.join(name), &to)
                .map_err(|error| FileError::new("cannot write", &to, error))?;
            Ok(to)
        };
        if let Some(mut list) = list {
            list.extend(self.staged.iter().cloned());
            let text: String = list.iter().map(|(name, hash)| format!("{hash}  {name}\n")).collect();
            write_whole(&staging.join(LIST), text.as_bytes())
                .map_err(|error| FileError::new("cannot write", &self.target.join(LIST), error))?;
            // The list first: a process that is killed on the way has then named all that it left.
            place(LIST)?;
        }
        let paths = self.staged.iter().map(|(name, _)| place(name)).collect::<Result<_, _>>()?;
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
        if let Some(staging) = self.staging.take() {
            let _ = fs::remove_dir_all(&staging.folder);
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
    fn files_put_in_place_appear_and_nothing_else_but_their_list() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let target = root.path().join("a/b");
        let mut dir = ResultDir::open(&target).expect("writable");
        dir.stage("one", b"1").expect("writable");
        dir.stage("two", b"2").expect("writable");
        assert_eq!(dir.replace().expect("renamed"), [target.join("one"), target.join("two")]);
        assert_eq!(listing(&target), [LIST, "one", "two"]);
    }

    #[test]
    fn files_of_other_names_stay() {
        let root = tempfile::tempdir().expect("a temporary folder");
        for name in ["light.json", "mesh.obj"] {
            fs::write(root.path().join(name), b"old").expect("writable");
        }
        let mut dir = ResultDir::open(root.path()).expect("writable");
        dir.stage("one", b"1").expect("writable");
        dir.replace().expect("renamed");
        assert_eq!(listing(root.path()), [LIST, "light.json", "mesh.obj", "one"]);
    }

    fn put(folder: &Path, names: &[&str], place: fn(ResultDir) -> Result<Vec<PathBuf>, FileError>) {
        let mut dir = ResultDir::open(folder).expect("writable");
        for name in names {
            dir.stage(name, name.as_bytes()).expect("writable");
        }
        place(dir).expect("renamed");
    }

    #[test]
    fn results_of_before_go_unless_they_were_changed() {
        let root = tempfile::tempdir().expect("a temporary folder");
        put(root.path(), &["one", "two", "three"], ResultDir::replace);
        put(root.path(), &["page"], ResultDir::add);
        assert_eq!(listing(root.path()), [LIST, "one", "page", "three", "two"]);
        fs::write(root.path().join("two"), b"by hand").expect("writable");
        fs::write(root.path().join("four"), b"of somebody").expect("writable");
        put(root.path(), &["one"], ResultDir::replace);
        assert_eq!(listing(root.path()), [LIST, "four", "one", "two"]);
        assert_eq!(listed(root.path()).into_keys().collect::<Vec<_>>(), ["one"]);
    }

    #[test]
    fn a_list_that_names_other_folders_removes_nothing_there() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let inner = root.path().join("inner");
        fs::create_dir(&inner).expect("writable");
        fs::write(root.path().join("mine"), b"mine").expect("writable");
        fs::write(inner.join(LIST), format!("{}  ../mine\n", sha256(b"mine"))).expect("writable");
        put(&inner, &["one"], ResultDir::replace);
        assert_eq!(listing(root.path()), ["inner", "mine"]);
    }

    #[test]
    fn what_a_killed_process_left_half_is_removed_by_the_next() {
        let root = tempfile::tempdir().expect("a temporary folder");
        for name in [".partial", ".partial-17-0"] {
            fs::create_dir(root.path().join(name)).expect("writable");
            fs::write(root.path().join(name).join("one"), b"ha").expect("writable");
        }
        fs::write(root.path().join(".lock"), b"").expect("writable");
        put(root.path(), &["one"], ResultDir::replace);
        assert_eq!(listing(root.path()), [LIST, "one"]);
    }

    #[test]
    fn an_interrupt_waits_for_what_is_half_written() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let mut dir = ResultDir::open(root.path()).expect("writable");
        dir.stage("one", b"1").expect("writable");
        std::thread::scope(|scope| {
            let handler = scope.spawn(|| {
                let _guard = undisturbed();
                listing(root.path())
            });
            std::thread::sleep(std::time::Duration::from_millis(50));
            assert!(!handler.is_finished());
            dir.replace().expect("renamed");
            assert_eq!(handler.join().expect("it ends"), [LIST, "one"]);
        });
    }

    #[test]
    fn an_open_folder_holds_nothing_that_an_interrupt_could_leave() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let _here = ResultDir::open(root.path()).expect("writable");
        let _below = ResultDir::open(&root.path().join("a/b")).expect("writable");
        assert!(listing(root.path()).is_empty());
    }

    #[test]
    fn not_put_in_place_nothing_stays() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let mut dir = ResultDir::open(&root.path().join("a/b")).expect("writable");
        dir.stage("one", b"1").expect("writable");
        drop(dir);
        assert!(listing(root.path()).is_empty());
    }

    #[test]
    fn not_put_in_place_older_results_stay() {
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
