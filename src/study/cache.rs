//! Finished points, each in a file named by a hash of everything that determines it; studies share them.
//!
//! ```text
//! CACHE/ab/ab12….json      a finished point, whole or not there
//! CACHE/ab/ab12….lock      held while somebody computes it; the system lets go of it when that process dies
//! CACHE/ab/ab12….partial   being written, by the holder of the lock alone; what a killed one left is written over
//! ```

use std::path::{Path, PathBuf};

use lrbsim_reports::RunReport;
use lrbsim_reports::files::write_with_temporary;
use lrbsim_reports::picture::sha256;
use lrbsim_workloads::Scene;
use serde::{Deserialize, Serialize};

use crate::error::BadInput;
use crate::frame::{SEMANTICS, scene_hash};
use lrbsim_reports::lock::Lock;

/// A folder of finished points.
#[derive(Debug, Clone)]
pub struct Cache(PathBuf);

/// A finished point.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Hash of everything that determines it.
    pub key: String,
    /// Host seconds that the point took: what is known about the cost of others like it.
    pub host_seconds: f64,
    /// What was measured at the point, without the sources of the machine's numbers.
    pub report: RunReport,
}

/// The right to compute a point, until it is dropped. Whoever gets it looks the point up once more.
pub struct Claim {
    file: PathBuf,
    _lock: Lock,
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
    /// A point that was run, under the key of what its report says was run.
    pub fn new(mut report: RunReport, host_seconds: f64) -> Entry {
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
        };
        Entry { key: inputs.key(), host_seconds, report }
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
        Ok(Cache(folder.to_owned()))
    }

    /// The folder of the cache.
    pub fn folder(&self) -> &Path {
        &self.0
    }

    /// The finished point of this key. A file that is not sound counts as none: the point is run again.
    pub fn get(&self, key: &str) -> Option<Entry> {
        let text = std::fs::read_to_string(self.file(key)).ok()?;
        serde_json::from_str(&text).ok().filter(|entry: &Entry| entry.key == key)
    }

    /// Claims a point; `None` while another process or thread computes it.
    pub fn claim(&self, key: &str) -> Result<Option<Claim>, BadInput> {
        let file = self.file(key);
        let cannot = |error: std::io::Error| {
            BadInput::new(format!("cannot write to the cache `{}`: {error}", self.0.display()))
        };
        std::fs::create_dir_all(file.parent().expect("it lies in a folder")).map_err(cannot)?;
        let lock = Lock::try_now(&file.with_extension("lock")).map_err(cannot)?;
        Ok(lock.map(|lock| Claim { file, _lock: lock }))
    }

    fn file(&self, key: &str) -> PathBuf {
        self.0.join(&key[..2]).join(format!("{key}.json"))
    }
}

impl Claim {
    /// Puts the finished point in place.
    pub fn finish(&self, entry: &Entry) -> Result<(), BadInput> {
        let text = serde_json::to_string(entry).expect("an entry has string keys");
        write_with_temporary(&self.file, &self.file.with_extension("partial"), text.as_bytes())?;
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
        let report = run_frame(&request, &Quiet).expect("it runs").report;
        Entry { key: key.to_owned(), host_seconds: 1.5, report }
    }

    #[test]
    fn what_is_finished_is_found_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let cache = Cache::open(folder.path()).expect("writable");
        assert!(cache.get("abc").is_none());
        let claim = cache.claim("abc").expect("writable").expect("free");
        claim.finish(&entry("abc")).expect("writable");
        drop(claim);
        assert_eq!(cache.get("abc").expect("finished").host_seconds, 1.5);
        let names: Vec<_> = std::fs::read_dir(folder.path().join("ab")).expect("there").collect();
        assert_eq!(names.len(), 1, "{names:?}");
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
        assert!(cache.get("abc").is_none());
        std::fs::write(folder.path().join("ab/abc.json"), "{\"key\": \"abc\"").expect("writable");
        assert!(cache.get("abc").is_none());
    }
}
