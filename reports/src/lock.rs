//! Locks between processes: a file that the system lets go of when its holder dies, however it dies.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// A held lock. Its file is there only while somebody holds or waits for it.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    /// Waits for the lock at `path`.
    pub fn wait(path: &Path) -> io::Result<Lock> {
        loop {
            let file = File::create(path)?;
            file.lock()?;
            if let Some(lock) = Lock::confirmed(file, path) {
                return Ok(lock);
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
                Err(TryLockError::Error(error)) => return Err(error),
            }
            if let Some(lock) = Lock::confirmed(file, path) {
                return Ok(Some(lock));
            }
        }
    }

    /// The lock, if `file` is still the one that `path` names: an earlier holder may have removed it meanwhile.
    fn confirmed(file: File, path: &Path) -> Option<Lock> {
        same_file(&file, path).then(|| Lock { path: path.to_owned(), _file: file })
    }
}

#[cfg(unix)]
fn same_file(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |meta: io::Result<std::fs::Metadata>| meta.ok().map(|meta| (meta.dev(), meta.ino()));
    identity(file.metadata()) == identity(std::fs::metadata(path))
}

#[cfg(not(unix))]
fn same_file(_file: &File, _path: &Path) -> bool {
    // An open file cannot be removed there.
    true
}

impl Drop for Lock {
    fn drop(&mut self) {
        // While the lock is still held: whoever waits for this file finds that it has no name any more, and asks again.
        let _ = std::fs::remove_file(&self.path);
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
    fn many_that_wait_hold_it_one_after_the_other() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("lock");
        let inside = AtomicU32::new(0);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..200 {
                        let _lock = Lock::wait(&path).expect("writable");
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0, "two at once");
                        inside.fetch_sub(1, Ordering::SeqCst);
                    }
                });
            }
        });
        assert!(!path.exists());
    }
}
