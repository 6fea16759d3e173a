//! Published results: a manifest beside files that a command must make again, byte for byte.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};

use lrbsim_reports::files::write_atomically;
use lrbsim_reports::picture::sha256;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::BadInput;
use crate::frame::SEMANTICS;
use crate::json;

/// Name of the manifest in its folder.
pub const MANIFEST: &str = "manifest.json";

/// Files that are published of what a command leaves: those that are the same on every host.
const PUBLISHED: [&str; 7] =
    ["report.json", "image.png", "frames.json", "study.json", "table.md", "table.csv", "fidelity.json"];

/// Files that are published beside them although they say what a host took: another host leaves others.
const MEASURED: [&str; 2] = ["prices.json", "prices.md"];

/// What was published and how it was made: `manifest.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// The command, as `lrbsim` takes it, without its folders for results.
    pub command: Vec<String>,
    /// Version of the simulator that made the files.
    pub lrbsim_version: String,
    /// Version of what its numbers mean.
    pub semantics: u32,
    /// SHA-256 of files that the command reads, relative to the manifest; shipped scenes, machines and studies are
    /// inside the program.
    #[serde(default)]
    pub inputs: BTreeMap<String, String>,
    /// SHA-256 of the files that it leaves.
    pub outputs: BTreeMap<String, String>,
    /// SHA-256 of files that say what the host took that made them. They are not made again: another host leaves others.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub measured: BTreeMap<String, String>,
}

/// Files by name.
type Files = BTreeMap<String, Vec<u8>>;

/// What became of a published result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verdict {
    /// Files that came out the same.
    pub same: usize,
    /// What did not come out the same, a line each; empty when all is well.
    pub faults: Vec<String>,
}

/// The folders of published results at `path`: itself, or those right below it.
pub fn folders(path: &Path) -> Result<Vec<PathBuf>, BadInput> {
    if path.file_name().is_some_and(|name| name == MANIFEST) {
        return Ok(vec![path.parent().unwrap_or(Path::new("")).to_owned()]);
    }
    if path.join(MANIFEST).is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).map_err(|error| {
        BadInput::unreadable(path, &error).with_help(
            "the published results of lrbsim are in its checkout: run `lrbsim verify` there, or `lrbsim verify DIR` with the folder of others",
        )
    })?;
    let mut found: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.join(MANIFEST).is_file()).collect();
    found.sort();
    if found.is_empty() {
        return Err(BadInput::new(format!("`{}` has no published results", path.display()))
            .with_help(format!("a published result is a folder with a {MANIFEST}; `lrbsim verify DIR --write -- run …` makes one")));
    }
    Ok(found)
}

/// Runs a published result again and compares what comes out.
pub fn verify(folder: &Path) -> Result<Verdict, BadInput> {
    let manifest = read(folder)?;
    let mut faults = Vec::new();
    for (name, hash) in &manifest.inputs {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).map_err(|error| BadInput::unreadable(&path, &error))?;
        if sha256(&bytes) != *hash {
            faults.push(format!("the input {name} is not the one that was published from"));
        }
    }
    for (name, hash) in manifest.outputs.iter().chain(&manifest.measured) {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).map_err(|error| BadInput::unreadable(&path, &error))?;
        if sha256(&bytes) != *hash {
            faults.push(format!("{name} is not the file that the manifest names"));
        }
    }
    let [made, _] = again(folder, &manifest.command)?;
    let mut same = 0;
    for name in manifest.outputs.keys() {
        let before = std::fs::read(folder.join(name)).unwrap_or_default();
        match made.get(name) {
            None => faults.push(format!("{name} is no longer written")),
            Some(now) if *now == before => same += 1,
            Some(now) => faults.push(difference(name, &before, now)),
        }
    }
    if !faults.is_empty() && manifest.semantics != SEMANTICS {
        faults.push(format!(
            "it was published with version {} of the numbers, and this program has {SEMANTICS}: `lrbsim verify --write` publishes it anew",
            manifest.semantics
        ));
    }
    Ok(Verdict { same, faults })
}

/// Runs `command`, or that of the manifest there, and publishes what comes out in `folder`.
pub fn publish(folder: &Path, command: &[String]) -> Result<Verdict, BadInput> {
    let command = if command.is_empty() { read(folder)?.command } else { command.to_vec() };
    let [made, measured] = again(folder, &command)?;
    std::fs::create_dir_all(folder)
        .map_err(|error| BadInput::new(format!("cannot create `{}`: {error}", folder.display())))?;
    for (name, bytes) in made.iter().chain(&measured) {
        write_atomically(&folder.join(name), bytes)?;
    }
    // Files that stand beside the manifest are what the command reads.
    let is_input = |word: &&String| !made.contains_key(*word) && folder.join(word).is_file();
    let hashed =
        |word: &String| std::fs::read(folder.join(word)).ok().map(|bytes| (word.clone(), sha256(&bytes)));
    let manifest = Manifest {
        lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
        semantics: SEMANTICS,
        inputs: command.iter().filter(is_input).filter_map(hashed).collect(),
        outputs: hashes(&made),
        measured: hashes(&measured),
        command,
    };
    let mut text = serde_json::to_string_pretty(&manifest).expect("a manifest has string keys");
    text.push('\n');
    write_atomically(&folder.join(MANIFEST), text.as_bytes())?;
    Ok(Verdict { same: made.len(), faults: Vec::new() })
}

fn hashes(files: &Files) -> BTreeMap<String, String> {
    files.iter().map(|(name, bytes)| (name.clone(), sha256(bytes))).collect()
}

fn read(folder: &Path) -> Result<Manifest, BadInput> {
    let path = folder.join(MANIFEST);
    let text = json::text(&path)?;
    json::read(&path.display().to_string(), &text)
}

/// What a command leaves that is published: files that are the same on every host, and those that are not. It runs beside the manifest, with results and cache of its own.
fn again(folder: &Path, command: &[String]) -> Result<[Files; 2], BadInput> {
    let name = command.first().map(String::as_str);
    if !matches!(name, Some("run" | "study")) {
        let found = command.join(" ");
        return Err(BadInput::new(format!("the command is `{found}`; it must begin with `run` or `study`")));
    }
    if command.iter().any(|word| ["-o", "--out", "--cache", "--json"].contains(&word.as_str())) {
        return Err(BadInput::new("the command names folders for its results, or `--json`")
            .with_help("leave them out: results are compared with those beside the manifest"));
    }
    let failed =
        |error: std::io::Error| BadInput::new(format!("cannot run `lrbsim {}`: {error}", command.join(" ")));
    let place = Place::new().map_err(failed)?;
    let program = std::env::current_exe().map_err(failed)?;
    let mut process = Command::new(program);
    process.args(command).arg("-o").arg(place.0.join("results"));
    if name == Some("study") {
        process.arg("--cache").arg(place.0.join("cache"));
    }
    if folder.is_dir() {
        process.current_dir(folder);
    }
    let (status, said) = place.run(&mut process).map_err(failed)?;
    if !status.success() {
        return Err(BadInput::new(format!("`lrbsim {}` failed:\n{}", command.join(" "), said.trim())));
    }
    let left = |names: &[&str]| {
        let file =
            |name: &&str| Some(((*name).to_owned(), std::fs::read(place.0.join("results").join(name)).ok()?));
        names.iter().filter_map(file).collect()
    };
    Ok([left(&PUBLISHED), left(&MEASURED)])
}

/// What must not outlive this process: a temporary folder, and the command that writes to it.
struct Held {
    folder: PathBuf,
    command: Option<Child>,
}

impl Drop for Held {
    fn drop(&mut self) {
        if let Some(command) = &mut self.command {
            // It may have ended by itself.
            let _ = command.kill();
            let _ = command.wait();
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

static HELD: Mutex<Option<Held>> = Mutex::new(None);

fn held() -> MutexGuard<'static, Option<Held>> {
    // A thread that panicked has left something that can still be removed.
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends the command that runs and removes what it wrote, for the handler of an interrupt: no other command begins after
/// it.
pub fn abandon() {
    let mut held = held();
    drop(held.take());
    std::mem::forget(held);
}

/// A temporary folder for one command; both are gone when it is dropped.
struct Place(PathBuf);

impl Place {
    fn new() -> std::io::Result<Place> {
        let mut held = held();
        for number in 0_u32.. {
            let folder = std::env::temp_dir().join(format!("lrbsim-verify-{}-{number}", std::process::id()));
            match std::fs::create_dir(&folder) {
                Ok(()) => {
                    *held = Some(Held { folder: folder.clone(), command: None });
                    return Ok(Place(folder));
                }
                Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
        unreachable!("a folder does not hold 2^32 of them")
    }

    /// Runs `process` to its end: how it ended, and what it said on standard error.
    fn run(&self, process: &mut Command) -> std::io::Result<(ExitStatus, String)> {
        process.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut errors = {
            // Held while it starts: an interrupt finds it.
            let mut held = held();
            let held = held.as_mut().expect("this place is held");
            let command = held.command.insert(process.spawn()?);
            command.stderr.take().expect("it is piped")
        };
        let mut said = Vec::new();
        errors.read_to_end(&mut said)?;
        let command = held().as_mut().and_then(|held| held.command.take());
        let status = command.expect("an interrupt lets go of nothing that it took").wait()?;
        Ok((status, String::from_utf8_lossy(&said).into_owned()))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        drop(held().take());
    }
}

/// Where two files differ first: in JSON by its path, otherwise by its byte.
fn difference(name: &str, before: &[u8], now: &[u8]) -> String {
    let tree = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).ok();
    if let (Some(a), Some(b)) = (tree(before), tree(now))
        && let Some((path, a, b)) = first_difference("", &a, &b)
    {
        return format!("{name}: `{path}` was {a} and is {b}");
    }
    let byte = before.iter().zip(now).take_while(|(a, b)| a == b).count();
    format!("{name}: differs from byte {byte} on ({} bytes before, {} now)", before.len(), now.len())
}

fn first_difference(path: &str, a: &Value, b: &Value) -> Option<(String, String, String)> {
    match (a, b) {
        _ if a == b => None,
        (Value::Object(left), Value::Object(right)) => left.keys().chain(right.keys()).find_map(|key| {
            let inside = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            first_difference(
                &inside,
                left.get(key).unwrap_or(&Value::Null),
                right.get(key).unwrap_or(&Value::Null),
            )
        }),
        (Value::Array(left), Value::Array(right)) if left.len() == right.len() => left
            .iter()
            .zip(right)
            .enumerate()
            .find_map(|(index, (a, b))| first_difference(&format!("{path}[{index}]"), a, b)),
        _ => Some((path.to_owned(), a.to_string(), b.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_difference_is_named() {
        let text = difference("x.json", br#"{"a": 1, "b": [1, 2]}"#, br#"{"a": 1, "b": [1, 3]}"#);
        assert_eq!(text, "x.json: `b[1]` was 2 and is 3");
        assert_eq!(difference("x", b"abc", b"abd!"), "x: differs from byte 2 on (3 bytes before, 4 now)");
    }
}
