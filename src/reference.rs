//! The reference that a picture is judged by: shadow rays from every receiver, cast once and then found in a cache.
//!
//! ```text
//! CACHE/ab/ab12….rays      what the rays found, whole or not there; beside the finished points of studies
//! CACHE/ab/ab12….lock      held while somebody casts them
//! ```

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use lrbsim_reports::files::write_with_temporary;
use lrbsim_reports::lock::Lock;
use lrbsim_reports::picture::sha256;
use lrbsim_reports::run::{ErrorPlaces, ImageError};
use lrbsim_workloads::Scene;
use lrbsim_workloads::reference::{ErrorMetrics, Truth};
use serde::{Deserialize, Serialize};

use crate::error::BadInput;
use crate::frame::{scene_hash, view};
use crate::host::{Stopwatch, partial};
use crate::progress::Progress;

/// Version of what the rays of a reference find. Raise it whenever the same scene gives other numbers: references of an older
/// version are then cast again.
pub const REFERENCE_VERSION: u32 = 1;

/// Folder of finished points and of references, where no other is named.
pub const DEFAULT_CACHE: &str = "out/cache";

/// Rays of a receiver that may be asked for: with fewer, there are no two halves to tell the error from.
const SAMPLES: RangeInclusive<u32> = 2..=65_536;

/// Rays of a picture at most: some hours of a large host.
const RAYS_MAX: u64 = 1 << 36;

/// A reference that is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReferenceRequest {
    /// Shadow rays of each receiver.
    pub samples: u32,
    /// Folder where references are kept; `None`: it is computed, and not kept.
    pub cache: Option<PathBuf>,
}

/// A reference, and what it cost.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    pub truth: Truth,
    /// Host seconds that casting it took, now or when it was put into the cache.
    pub seconds: f64,
    /// Whether it was found in the cache.
    pub found: bool,
}

/// Head of a file of the cache; the numbers of hidden rays follow, and the SHA-256 of all before it.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    key: String,
    receivers: usize,
    seconds: f64,
}

/// Refuses a number of rays that is a slip; `asked` is who asks for it.
pub(crate) fn check_samples(samples: u64, asked: &str) -> Result<u32, BadInput> {
    u32::try_from(samples).ok().filter(|samples| SAMPLES.contains(samples)).ok_or_else(|| {
        BadInput::new(format!(
            "{asked} is {samples}; it must be a number of shadow rays a receiver from {} to {}, such as 256",
            SAMPLES.start(),
            SAMPLES.end()
        ))
    })
}

/// The number of rays that `--reference` was given.
pub fn parse_samples(text: &str) -> Result<u32, BadInput> {
    let asked = "`--reference`";
    match text.parse() {
        Ok(samples) => check_samples(samples, asked),
        Err(_) => Err(BadInput::new(format!(
            "{asked} is `{text}`; it must be a number of shadow rays a receiver from {} to {}, such as 256",
            SAMPLES.start(),
            SAMPLES.end()
        ))),
    }
}

impl ReferenceRequest {
    /// Refuses what would take days.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), BadInput> {
        check_samples(self.samples.into(), "the reference")?;
        let pixels = u64::from(scene.image.width) * u64::from(scene.image.height);
        if pixels * u64::from(self.samples) <= RAYS_MAX {
            return Ok(());
        }
        Err(BadInput::new(format!(
            "a reference of {} rays a receiver has {} rays; there must be at most {RAYS_MAX}",
            self.samples,
            pixels * u64::from(self.samples)
        ))
        .with_help(format!(
            "at this size of the picture, at most {} rays a receiver",
            RAYS_MAX / pixels.max(1)
        )))
    }

    /// Everything that determines the reference of `scene`, as a hash.
    fn key(&self, scene: &Scene) -> String {
        let inputs = serde_json::json!({
            "reference": REFERENCE_VERSION,
            "scene": scene_hash(scene),
            "samples": self.samples,
        });
        sha256(inputs.to_string().as_bytes())
    }

    /// The reference of `scene`, whose view has so many `receivers`: from the cache, or cast by all threads of the pool.
    pub(crate) fn run(
        &self,
        scene: &Scene,
        receivers: usize,
        progress: &dyn Progress,
    ) -> Result<Reference, BadInput> {
        progress.part("reference");
        let Some(folder) = &self.cache else { return Ok(self.cast(scene, progress)) };
        let key = self.key(scene);
        let file = folder.join(&key[..2]).join(format!("{key}.rays"));
        let find = || {
            let (hidden, seconds) = read(&file, &key, receivers)?;
            let truth = Truth::from_hidden(&scene.light, self.samples, hidden)?;
            Some(Reference { truth, seconds, found: true })
        };
        if let Some(found) = find() {
            return Ok(found);
        }
        let cannot = |error: std::io::Error| {
            BadInput::new(format!("cannot write to the cache `{}`: {error}", folder.display()))
                .with_help("`--cache` names another folder")
                .passing()
        };
        std::fs::create_dir_all(file.parent().expect("it lies in a folder")).map_err(cannot)?;
        let lock = Lock::wait(&file.with_extension("lock")).map_err(cannot)?;
        // Whoever held the lock before may have cast it.
        if let Some(found) = find() {
            return Ok(found);
        }
        let made = self.cast(scene, progress);
        let bytes = written(&key, made.truth.hidden(), made.seconds);
        // Who holds the lock is alone with the usual name; what a killed one left there is written over.
        let temporary = lock.as_ref().map_or_else(|| partial(&file), |_| file.with_extension("partial"));
        write_with_temporary(&file, &temporary, &bytes)?;
        Ok(made)
    }

    fn cast(&self, scene: &Scene, progress: &dyn Progress) -> Reference {
        let watch = Stopwatch::start();
        let eye = view(scene);
        progress.counted("reference", u32::try_from(Truth::parts(eye.points.len())).unwrap_or(u32::MAX));
        let truth = Truth::new(&scene.mesh, &scene.light, &eye, self.samples, &|| progress.one_done());
        Reference { truth, seconds: watch.elapsed().as_secs_f64(), found: false }
    }
}

impl Reference {
    /// How far `visibility`, by receiver, is from the reference of `samples` rays.
    pub fn judge(&self, samples: u32, visibility: &[f32]) -> ImageError {
        let test: Vec<f64> = visibility.iter().map(|v| f64::from(*v)).collect();
        let metrics = ErrorMetrics::new(&self.truth.visibility(), &test);
        // The measures of the reference's own error are over the same receivers.
        let doubt = self.truth.doubt();
        let sum: f64 = doubt.iter().sum();
        let squares: f64 = doubt.iter().map(|x| x * x).sum();
        let part = |sum: f64, count: usize| if count == 0 { 0.0 } else { sum / count as f64 };
        let [umbra, penumbra, light] = metrics.places;
        let error = ImageError {
            samples,
            shadowed_receivers: metrics.shadowed as u64,
            receivers_in_question: metrics.in_question as u64,
            mean: metrics.atty_mae,
            rmse: metrics.rmse,
            max: metrics.max,
            p99: metrics.p99,
            off_by_quarter: part(metrics.off_by_quarter as f64, metrics.in_question),
            bias: metrics.bias,
            places: Some(ErrorPlaces { umbra, penumbra, light }),
            reference_mean: part(sum, metrics.shadowed),
            reference_rmse: part(squares, metrics.in_question).sqrt(),
        };
        let numbers = [error.mean, error.rmse, error.max, error.p99, error.bias, error.reference_rmse];
        assert!(numbers.iter().all(|x| x.is_finite()), "an error is no number: {error:?}");
        error
    }
}

/// The bytes of a file of the cache.
fn written(key: &str, hidden: &[[u32; 2]], seconds: f64) -> Vec<u8> {
    let head = Head { key: key.to_owned(), receivers: hidden.len(), seconds };
    let mut bytes = serde_json::to_vec(&head).expect("a head has string keys");
    bytes.push(b'\n');
    bytes.extend(hidden.iter().flatten().flat_map(|count| count.to_le_bytes()));
    let hash = sha256(&bytes);
    bytes.extend(hash.as_bytes());
    bytes
}

/// What a file of the cache holds; `None` unless it is sound and of this key, so that the rays are cast again.
fn read(file: &Path, key: &str, receivers: usize) -> Option<(Vec<[u32; 2]>, f64)> {
    let bytes = std::fs::read(file).ok()?;
    let (bytes, hash) = bytes.split_at_checked(bytes.len().checked_sub(64)?)?;
    let end = bytes.iter().position(|byte| *byte == b'\n')?;
    let (head, counts) = (&bytes[..end], &bytes[end + 1..]);
    let head: Head = serde_json::from_slice(head).ok()?;
    let sound = head.key == key
        && head.receivers == receivers
        && counts.len() == 8 * receivers
        && sha256(bytes).as_bytes() == hash;
    let count = |four: &[u8]| u32::from_le_bytes(four.try_into().expect("four bytes"));
    let pairs = counts.chunks_exact(8).map(|pair| [count(&pair[..4]), count(&pair[4..])]);
    sound.then(|| (pairs.collect(), head.seconds))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Quiet;

    fn scene() -> Scene {
        let mut scene = crate::inputs::scene("tiny").expect("shipped");
        crate::inputs::resize(&mut scene, 32, 24).expect("a sound size");
        scene
    }

    #[test]
    fn a_reference_is_cast_once_for_each_scene_and_number_of_rays() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let ask = |scene: &Scene, samples| {
            let request = ReferenceRequest { samples, cache: Some(folder.path().to_owned()) };
            request.run(scene, view(scene).points.len(), &Quiet).expect("writable")
        };
        let scene = scene();
        let first = ask(&scene, 16);
        let again = ask(&scene, 16);
        assert!(!first.found && again.found);
        assert_eq!((&again.truth, again.seconds), (&first.truth, first.seconds));
        assert!(!ask(&scene, 18).found, "another number of rays");
        let mut moved = scene.clone();
        crate::inputs::set_light_radius(&mut moved, 0.01).expect("a sound radius");
        assert!(!ask(&moved, 16).found, "another light");
        assert!(ask(&scene, 16).found && ask(&moved, 16).found);
    }

    #[test]
    fn a_broken_file_is_cast_again() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let scene = scene();
        let request = ReferenceRequest { samples: 8, cache: Some(folder.path().to_owned()) };
        let ask = || request.run(&scene, view(&scene).points.len(), &Quiet).expect("writable");
        let first = ask();
        let key = request.key(&scene);
        let file = folder.path().join(&key[..2]).join(format!("{key}.rays"));
        let sound = std::fs::read(&file).expect("it was written");
        let mut flipped = sound.clone();
        flipped[sound.len() / 2] ^= 1;
        for broken in [&sound[..sound.len() - 9], b"", &flipped, b"{\"key\": 1}\n"] {
            std::fs::write(&file, broken).expect("writable");
            let again = ask();
            assert!(!again.found && again.truth == first.truth);
        }
        assert_eq!(
            std::fs::read_dir(file.parent().expect("a folder")).expect("there").count(),
            1,
            "no leftovers"
        );
    }

    #[test]
    fn numbers_of_rays_that_are_slips_are_refused() {
        for text in ["0", "1", "65537", "4294967296", "-3", "many", "1.5", ""] {
            let said = parse_samples(text).expect_err(text).to_string();
            assert!(said.contains("from 2 to 65536"), "{said}");
        }
        assert_eq!(parse_samples("256").expect("sound"), 256);
        let mut large = scene();
        crate::inputs::resize(&mut large, 8192, 8192).expect("a sound size");
        let request = ReferenceRequest { samples: 65_536, cache: None };
        assert!(request.check(&large).is_err() && request.check(&scene()).is_ok());
    }
}
