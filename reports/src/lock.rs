//! Locks between processes: a file that the system lets go of when its holder dies, however it dies.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// A held lock. Its file is there only while somebody holds or waits for it.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    /// Waits for the lock at `path`; `None` on a file system without locks.
    pub fn wait(path: &Path) -> io::Result<Option<Lock>> {
        loop {
            let file = File::create(path)?;
            match file.lock() {
                Ok(()) => {}
                Err(error) if is_without_locks(&error) => {
                    // Nobody would remove it.
                    let _ = fs::remove_file(path);
                    return Ok(None);
                }
                Err(error) => return Err(error),
            }
            if let Some(lock) = Lock::confirmed(file, path) {
                return Ok(Some(lock));
            }
        }
    }

    /// The lock at `path`; `None` while somebody else holds it.
    pub fn try_now(path: &Path) -> io::Result<Option<Lock>> {
        loop {
            let file = File::create(path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(error)) => {
                    // Nobody holds a lock where there are none, and nobody would remove its file.
                    if is_without_locks(&error) {
                        let _ = fs::remove_file(path);
                    }
                    return Err(error);
                }
            }
            if let Some(lock) = Lock::confirmed(file, path) {
                return Ok(Some(lock));
            }
        }
    }

    /// Takes the lock at `path` with the file of this one, which lets go of its own path: `false`, and nothing is changed,
    /// while somebody else holds it. Many locks one after the other need no new file each, which is dear to some file
    /// systems.
    pub fn move_to(&mut self, path: &Path) -> io::Result<bool> {
        loop {
            match fs::hard_link(&self.path, path) {
                Ok(()) => {
                    fs::remove_file(&self.path)?;
                    path.clone_into(&mut self.path);
                    return Ok(true);
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
            // Whoever left it there holds it, or has died, or has just let go of it.
            let file = match File::options().write(true).open(path) {
                Ok(file) => file,
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                Err(error) => return Err(error),
            };
            match file.try_lock() {
                Ok(()) => drop(Lock::confirmed(file, path)),
                Err(TryLockError::WouldBlock) => return Ok(false),
                Err(TryLockError::Error(error)) => return Err(error),
            }
        }
    }

    /// Lets go of the path of the lock, and keeps its file as `path`, which nobody else uses.
    pub fn rest_at(&mut self, path: &Path) -> io::Result<()> {
        fs::rename(&self.path, path)?;
        path.clone_into(&mut self.path);
        Ok(())
    }

    /// The lock, if `file` is still the one that `path` names: an earlier holder may have removed it meanwhile.
    fn confirmed(file: File, path: &Path) -> Option<Lock> {
        same_file(&file, path).then(|| Lock { path: path.to_owned(), _file: file })
    }
}

/// Whether the file system refuses every lock.
pub fn is_without_locks(error: &io::Error) -> bool {
    /// What Linux says where a network file system has no server of locks.
    const ENOLCK: i32 = 37;
    error.kind() == io::ErrorKind::Unsupported || error.raw_os_error() == Some(ENOLCK)
}

#[cfg(unix)]
fn same_file(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |meta: io::Result<fs::Metadata>| meta.ok().map(|meta| (meta.dev(), meta.ino()));
    identity(file.metadata()) == identity(fs::metadata(path))
}

#[cfg(not(unix))]
fn same_file(_file: &File, _path: &Path) -> bool {
    // An open file cannot be removed there.
    true
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While the lock is still held: whoever waits for this file finds that it has no name any more, and asks again.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    #[test]
    fn a_lock_is_held_by_one_and_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("lock");
        let held = Lock::try_now(&path).expect("writable").expect("free");
        assert!(Lock::try_now(&path).expect("writable").is_none());
        drop(held);
        assert!(!path.exists());
        assert!(Lock::try_now(&path).expect("writable").is_some());
    }

    #[test]
    fn a_lock_moves_only_to_where_nobody_is() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [a, b, rest] = ["a", "b", "rest"].map(|name| folder.path().join(name));
        let mut lock = Lock::try_now(&a).expect("writable").expect("free");
        let other = Lock::try_now(&b).expect("writable").expect("free");
        assert!(!lock.move_to(&b).expect("writable") && a.exists());
        drop(other);
        // What somebody left who has died.
        File::create(&b).expect("writable");
        assert!(lock.move_to(&b).expect("writable") && b.exists() && !a.exists());
        assert!(Lock::try_now(&b).expect("writable").is_none());
        lock.rest_at(&rest).expect("writable");
        assert!(Lock::try_now(&b).expect("writable").is_some());
        drop(lock);
        assert!(folder.path().read_dir().expect("there").next().is_none(), "nothing is left");
    }

    #[test]
    fn many_that_wait_hold_it_one_after_the_other() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("lock");
        let inside = AtomicU32::new(0);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        let _lock = Lock::wait(&path).expect("writable").expect("locks are had here");
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0, "two at once");
                        inside.fetch_sub(1, Ordering::SeqCst);
                    }
                });
            }
        });
        assert!(!path.exists());
    }
}
