//! What whole-program tests share: the binary, folders of their own, frames by library call.

#![allow(dead_code, clippy::allow_attributes, reason = "every test file uses a part of this")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use lrbsim::progress::Quiet;
use lrbsim::{Algorithm, HostOptions, Machine, RunOutput, RunRequest, inputs, run_frame};
use lrbsim_machine::Fidelity;

/// A folder of one test, gone when the test is.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Folder {
        Folder(tempfile::tempdir().expect("a temporary folder"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file into the folder.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).expect("the folder can be written");
        path
    }

    /// Runs `lrbsim` in the folder.
    pub fn run(&self, args: &[&str]) -> Done {
        let output = lrbsim().current_dir(self.0.path()).args(args).output().expect("the binary starts");
        Done { output, args: args.join(" ") }
    }

    /// Names of all files and folders in it, sorted.
    pub fn names(&self) -> Vec<String> {
        names(self.0.path())
    }
}

/// Demands that the results in `results`, a folder in `folder`, have these files, and that `report` draws all of them again, byte for byte.
#[track_caller]
pub fn drawn_again(folder: &Folder, results: &str, files: &[&str]) {
    let left = names(&folder.path(results));
    for name in files {
        assert!(left.iter().any(|file| file == name), "{name}: {left:?}");
    }
    let read = |name: &String| std::fs::read(folder.path(results).join(name)).expect("readable");
    let before = left.iter().map(read).collect::<Vec<_>>();
    folder.run(&["report", results]).ok();
    assert_eq!(left.iter().map(read).collect::<Vec<_>>(), before);
}

/// Names of all files and folders in `folder`, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .expect("the folder exists")
        .map(|entry| entry.expect("readable").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// The binary, in plain text whatever terminal the tests run on.
pub fn lrbsim() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lrbsim"));
    command.env("NO_COLOR", "1").env_remove("RUST_BACKTRACE").env_remove("LRBSIM_SCENES");
    command
}

/// A finished command.
pub struct Done {
    output: Output,
    args: String,
}

impl Done {
    pub fn stdout(&self) -> String {
        String::from_utf8_lossy(&self.output.stdout).into_owned()
    }

    pub fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
    }

    pub fn code(&self) -> Option<i32> {
        self.output.status.code()
    }

    /// Demands exit code 0 and silence on standard error.
    #[track_caller]
    pub fn ok(self) -> Done {
        assert_eq!(self.output.status.code(), Some(0), "lrbsim {}: {}", self.args, self.stderr());
        assert_eq!(self.stderr(), "", "lrbsim {}: quiet when piped", self.args);
        self
    }

    /// Demands exit code 2, nothing on standard output, and one message with all of `parts`.
    #[track_caller]
    pub fn refused(self, parts: &[&str]) {
        let message = self.stderr();
        assert_eq!(self.output.status.code(), Some(2), "lrbsim {}: {message}", self.args);
        assert_eq!(self.stdout(), "", "lrbsim {}", self.args);
        assert!(!message.contains("panicked"), "lrbsim {}: {message}", self.args);
        assert_eq!(message.matches('×').count(), 1, "one message: {message}");
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
    }
}

/// A run of `scene` on `larrabee-24`.
pub fn request(scene: &str) -> RunRequest {
    RunRequest {
        scene: inputs::scene(scene).expect("a sound scene"),
        machine: machine(&[]),
        algorithm: Algorithm::default(),
        fidelity: Fidelity::Windowed,
        warm_frames: 0,
        reference: None,
        host: HostOptions::default(),
    }
}

/// `larrabee-24` with changes.
pub fn machine(settings: &[&str]) -> Machine {
    machine_named("larrabee-24", settings)
}

/// A shipped machine with changes.
pub fn machine_named(name: &str, settings: &[&str]) -> Machine {
    let settings: Vec<_> = settings.iter().map(|text| text.parse().expect("PATH=VALUE")).collect();
    Machine::load(name, &settings).expect("a sound machine")
}

pub fn run(request: &RunRequest) -> RunOutput {
    run_frame(request, &Quiet).expect("a sound request")
}
