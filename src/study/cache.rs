//! Finished points, each in a file named by a hash of everything that determines it; studies share them.
//!
//! ```text
//! CACHE/ab/ab12….json                 a finished point, whole or not there
//! CACHE/ab/ab12….lock                 held while somebody computes it; the system lets go of it when that process dies
//! CACHE/locks/HOST-PID-N.lock         such a file between two points
//! CACHE/ab/ab12….HOST-PID.partial     being written by this process of this host
//! ```
//!
//! What killed processes left beside finished points is removed by who runs these points next.
//!
//! Locks save work and no more: on a file system without locks, or when one outlives its holder, two may compute a point,
//! and each puts the same whole file in place.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard};

use lrbsim_reports::base64;
use lrbsim_reports::files::write_with_temporary;
use lrbsim_reports::picture::{error_rgb, sha256, shaded_rgb, small_png};
use lrbsim_reports::study::PointPictures;
use lrbsim_reports::{HostReport, RunReport};
use lrbsim_workloads::Scene;
use serde::{Deserialize, Serialize};

use crate::error::BadInput;
use crate::frame::{Frame, RunOutput, SEMANTICS, scene_hash};
use crate::host::{PARTIAL, build, node, partial};
use crate::results::safe_name;
use lrbsim_reports::lock::{Lock, is_without_locks};

/// A folder of finished points.
#[derive(Debug, Clone)]
pub struct Cache {
    folder: PathBuf,
    /// Locks that are held for no point at the moment: the next claims take them.
    spare: Arc<Spare>,
}

/// Locks between two points, with the folder of their files.
#[derive(Debug)]
struct Spare {
    folder: PathBuf,
    locks: Mutex<Vec<Lock>>,
    /// How many files were named so far.
    named: AtomicUsize,
}

/// A finished point.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Hash of everything that determines it.
    pub key: String,
    /// SHA-256 of the program that computed the point.
    pub build: String,
    /// What the point cost the host: what is known about the cost of others like it.
    pub host: HostReport,
    /// What was measured at the point, without the sources of the machine's numbers.
    pub report: RunReport,
    /// Small pictures of the point, where they are asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures: Option<PointPictures>,
}

/// What is known of a finished point without its report.
#[derive(Debug, Clone, PartialEq)]
pub struct Finished {
    /// SHA-256 of the program that computed the point.
    pub build: String,
    /// Host seconds that the point took.
    pub seconds: f64,
}

/// The right to compute a point, until it is dropped. Whoever gets it looks the point up once more.
pub struct Claim {
    file: PathBuf,
    /// `None` where there is nothing that locks, or nobody was waited for.
    lock: Option<Lock>,
    spare: Arc<Spare>,
}

/// Everything that determines a point, names included: they stand in its report.
#[derive(Debug, Serialize)]
pub struct Inputs<'a> {
    /// Hash of the machine's numbers.
    #[serde(rename = "machine")]
    pub machine_hash: &'a str,
    /// The scene that is drawn.
    pub scene: &'a SceneId,
    /// Algorithm with its options.
    pub algorithm: &'a str,
    /// How much of the machine is modeled.
    pub fidelity: &'a str,
    /// Frames before the measured one.
    pub warm_frames: u32,
    /// Rays of the reference, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<u32>,
    /// Whether the point keeps pictures.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub pictures: bool,
}

impl Inputs<'_> {
    /// Hash of all inputs and of the version of what numbers mean.
    pub fn key(&self) -> String {
        let mut parts = serde_json::to_value(self).expect("inputs have string keys");
        parts["semantics"] = SEMANTICS.into();
        sha256(parts.to_string().as_bytes())
    }
}

impl Entry {
    /// A point that was run, under the key of what its report says was run; with `pictures`, if asked for.
    pub fn new(output: RunOutput, pictures: bool) -> Entry {
        let RunOutput { mut report, host, frame } = output;
        report.machine.sources.clear();
        let provenance = &report.provenance;
        let scene = SceneId { name: report.scene.name.clone(), hash: provenance.scene_hash.clone() };
        let inputs = Inputs {
            machine_hash: &provenance.machine_hash,
            scene: &scene,
            algorithm: &provenance.algorithm,
            fidelity: &provenance.fidelity,
            warm_frames: provenance.warm_frames,
            reference: report.image.error.map(|error| error.samples),
            pictures,
        };
        let key = inputs.key();
        let pictures = pictures.then(|| small_pictures(&frame));
        Entry { key, build: build().to_owned(), host, report, pictures }
    }
}

/// Pixels of a side of small pictures.
const SMALL: u32 = 320;

/// The pictures of a frame that its point keeps.
fn small_pictures(frame: &Frame) -> PointPictures {
    let (width, height) = (frame.width, frame.height);
    let small = |rgb| base64::encode(&small_png(width, height, rgb, SMALL));
    let of_reference = |truth: &Vec<f32>| small(error_rgb(width, height, &frame.visibility, truth));
    PointPictures {
        shaded: small(shaded_rgb(width, height, &frame.visibility, &frame.cosine)),
        difference: frame.reference.as_ref().map(of_reference),
    }
}

/// What a loaded scene is told from others by.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SceneId {
    name: String,
    hash: String,
}

impl SceneId {
    /// The identity of a scene that was loaded.
    pub fn of(scene: &Scene) -> SceneId {
        SceneId { name: scene.name.clone(), hash: scene_hash(scene) }
    }
}

impl Cache {
    /// The cache in `folder`, which is made when it is not there.
    pub fn open(folder: &Path) -> Result<Cache, BadInput> {
        std::fs::create_dir_all(folder).map_err(|error| {
            BadInput::new(format!("cannot create the cache `{}`: {error}", folder.display()))
                .with_help("`--cache` names another folder")
        })?;
        let spare =
            Spare { folder: folder.join("locks"), locks: Mutex::default(), named: AtomicUsize::new(0) };
        spare.clean();
        Ok(Cache { folder: folder.to_owned(), spare: Arc::new(spare) })
    }

    /// The folder of the cache.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The finished point of this key. A file that is not sound counts as none: the point is run again.
    pub fn get(&self, key: &str) -> Option<Entry> {
        let text = std::fs::read_to_string(self.file(key)).ok()?;
        serde_json::from_str(&text).ok().filter(|entry: &Entry| entry.key == key)
    }

    /// What is known of the finished point of this key without its report, where [`Cache::get`] would find it.
    pub fn peek(&self, key: &str) -> Option<Finished> {
        // The report is read and forgotten: a point counts as finished only where its report can be had too.
        self.get(key).map(|entry| Finished { build: entry.build, seconds: entry.host.seconds })
    }

    /// Opens the folders of these points, upon which a network file system asks its server what is in them now: it may
    /// remember for a minute that a file was missing.
    pub fn freshen(&self, keys: &BTreeSet<&str>) {
        open_anew(&self.folder);
        let groups: BTreeSet<&str> = keys.iter().map(|key| &key[..2]).collect();
        groups.iter().for_each(|group| open_anew(&self.folder.join(group)));
    }

    /// Claims a point; `None` while another process or thread computes it.
    pub fn claim(&self, key: &str) -> Result<Option<Claim>, BadInput> {
        let file = self.place(key)?;
        let spare = self.spare.clone();
        match self.spare.lock_at(&file.with_extension("lock")) {
            Ok(lock) => Ok(lock.map(|lock| Claim { file, lock: Some(lock), spare })),
            Err(error) if is_without_locks(&error) => Ok(Some(Claim { file, lock: None, spare })),
            Err(error) => Err(self.cannot_write(&error)),
        }
    }

    /// Claims a point whoever else may compute it.
    pub fn claim_anyway(&self, key: &str) -> Result<Claim, BadInput> {
        Ok(Claim { file: self.place(key)?, lock: None, spare: self.spare.clone() })
    }

    /// Removes what killed processes left beside the finished points of these keys. Best effort: it is in nobody's way.
    pub fn tidy(&self, keys: &BTreeSet<&str>) {
        let groups: BTreeSet<&str> = keys.iter().map(|key| &key[..2]).collect();
        for group in groups {
            for entry in std::fs::read_dir(self.folder.join(group)).into_iter().flatten().flatten() {
                let name = entry.file_name();
                let name = name.to_string_lossy();
                let Some((key, extension)) = name.split_once('.').filter(|(key, _)| keys.contains(key))
                else {
                    continue;
                };
                if extension == "lock" {
                    // Whoever gets it is alone with it; dropped, its file goes.
                    drop(Lock::try_now(&entry.path()));
                } else if extension.ends_with(PARTIAL) && self.file(key).is_file() {
                    let _ = std::fs::remove_file(entry.path());
                }
            }
        }
    }

    /// The file of a point, in a folder that is there.
    fn place(&self, key: &str) -> Result<PathBuf, BadInput> {
        let file = self.file(key);
        let folder = file.parent().expect("it lies in a folder");
        std::fs::create_dir_all(folder).map_err(|error| self.cannot_write(&error))?;
        Ok(file)
    }

    fn cannot_write(&self, error: &io::Error) -> BadInput {
        BadInput::new(format!("cannot write to the cache `{}`: {error}", self.folder.display()))
    }

    fn file(&self, key: &str) -> PathBuf {
        self.folder.join(&key[..2]).join(format!("{key}.json"))
    }
}

/// Opens a folder and reads its first name.
pub fn open_anew(folder: &Path) {
    let _ = std::fs::read_dir(folder).map(|mut entries| entries.next());
}

impl Spare {
    /// The lock at `path`, with a file that is there already if possible; `None` while somebody else holds it.
    fn lock_at(&self, path: &Path) -> io::Result<Option<Lock>> {
        let Some(mut lock) = self.locks().pop() else { return Lock::try_now(path) };
        match lock.move_to(path) {
            Ok(true) => Ok(Some(lock)),
            Ok(false) => {
                self.locks().push(lock);
                Ok(None)
            }
            // There are file systems without links.
            Err(_) => Lock::try_now(path),
        }
    }

    /// Keeps a lock for the next claim. Without a place for it, its file goes.
    fn keep(&self, mut lock: Lock) {
        let number = self.named.fetch_add(1, Relaxed);
        let path = self.folder.join(format!("{}-{}-{number}.lock", safe_name(&node()), std::process::id()));
        if std::fs::create_dir_all(&self.folder).and_then(|()| lock.rest_at(&path)).is_ok() {
            self.locks().push(lock);
        }
    }

    /// Removes the files that killed processes left, and the folder if that was all there was. Best effort.
    fn clean(&self) {
        for entry in std::fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            // Whoever gets the lock of a file of this kind is alone with it; dropped, it goes.
            drop(Lock::try_now(&entry.path()));
        }
        let _ = std::fs::remove_dir(&self.folder);
    }

    fn locks(&self) -> MutexGuard<'_, Vec<Lock>> {
        self.locks.lock().expect("nobody panics with the locks in hand")
    }
}

impl Drop for Spare {
    fn drop(&mut self) {
        self.locks().clear();
        let _ = std::fs::remove_dir(&self.folder);
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        if let Some(lock) = self.lock.take() {
            self.spare.keep(lock);
        }
    }
}

impl Claim {
    /// Puts the finished point in place.
    pub fn finish(&self, entry: &Entry) -> Result<(), BadInput> {
        let text = serde_json::to_string(entry).expect("an entry has string keys");
        let written = write_with_temporary(&self.file, &partial(&self.file), text.as_bytes());
        // Somebody else may have put the same file in place meanwhile, and tidied up.
        if let Err(error) = written {
            let is_there = error.source.kind() == io::ErrorKind::NotFound && self.file.is_file();
            return if is_there { Ok(()) } else { Err(error.into()) };
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HostOptions, Machine, RunRequest, progress::Quiet, run_frame};

    fn entry(key: &str) -> Entry {
        let request = RunRequest {
            scene: crate::inputs::scene("tiny").expect("shipped"),
            machine: Machine::load("larrabee-24", &[]).expect("shipped"),
            algorithm: crate::Algorithm::default(),
            fidelity: lrbsim_machine::Fidelity::Functional,
            warm_frames: 0,
            reference: None,
            host: HostOptions::default(),
        };
        let mut entry = Entry::new(run_frame(&request, &Quiet).expect("it runs"), false);
        entry.key = key.to_owned();
        entry.host.seconds = 1.5;
        entry
    }

    #[test]
    fn what_is_finished_is_found_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cache = Cache::open(folder.path()).expect("writable");
        assert!(cache.get("abc").is_none());
        let claim = cache.claim("abc").expect("writable").expect("free");
        claim.finish(&entry("abc")).expect("writable");
        drop(claim);
        let found = cache.get("abc").expect("finished");
        assert_eq!((found.host.seconds, found.build.len()), (1.5, 64));
        assert_eq!(cache.peek("abc"), Some(Finished { build: found.build, seconds: 1.5 }));
        let names: Vec<_> = std::fs::read_dir(folder.path().join("ab")).expect("there").collect();
        assert_eq!(names.len(), 1, "{names:?}");
    }

    #[test]
    fn what_killed_processes_left_beside_finished_points_goes() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cache = Cache::open(folder.path()).expect("writable");
        let claim = cache.claim("abc").expect("writable").expect("free");
        let names =
            ["abc.a-1.partial", "abc.lock", "abe.a-1.partial", "abe.lock", "abd.a-1.partial", "abd.lock"];
        let left = names.map(|name| folder.path().join("ab").join(name));
        left.iter().for_each(|file| std::fs::write(file, "{\"key\"").expect("writable"));
        claim.finish(&entry("abc")).expect("writable");
        drop(claim);
        let held = cache.claim("abe").expect("writable").expect("free");
        cache.tidy(&["abc", "abe"].into());
        let there = left.map(|file| file.exists());
        assert_eq!(there, [false, false, true, true, true, true], "what is held or of others stays");
        drop(held);
    }

    #[test]
    fn a_twin_that_does_not_wait_puts_the_same_point_in_place() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cache = Cache::open(folder.path()).expect("writable");
        let claim = cache.claim("abc").expect("writable").expect("free");
        let twin = cache.claim_anyway("abc").expect("writable");
        twin.finish(&entry("abc")).expect("writable");
        claim.finish(&entry("abc")).expect("writable");
        assert!(cache.get("abc").is_some());
    }

    #[test]
    fn a_point_is_claimed_once_until_it_is_let_go() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cache = Cache::open(folder.path()).expect("writable");
        let claim = cache.claim("abc").expect("writable").expect("free");
        assert!(cache.claim("abc").expect("writable").is_none());
        drop(claim);
        assert!(cache.claim("abc").expect("writable").is_some());
    }

    #[test]
    fn a_broken_or_foreign_file_counts_as_none() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cache = Cache::open(folder.path()).expect("writable");
        let claim = cache.claim("abc").expect("writable").expect("free");
        claim.finish(&entry("another")).expect("writable");
        assert!(cache.get("abc").is_none() && cache.peek("abc").is_none());
        let text = serde_json::to_string(&entry("abc")).expect("string keys");
        for bytes in [1, 10, text.len() / 2, text.len() - 1] {
            std::fs::write(folder.path().join("ab/abc.json"), &text[..bytes]).expect("writable");
            assert!(cache.get("abc").is_none() && cache.peek("abc").is_none(), "{bytes} bytes of it");
        }
        let mut other: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        other["report"]["a field of tomorrow"] = 1.into();
        std::fs::write(folder.path().join("ab/abc.json"), other.to_string()).expect("writable");
        assert!(cache.get("abc").is_none() && cache.peek("abc").is_none(), "a report of another layout");
    }
}
