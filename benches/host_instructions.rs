//! Host instructions for each uop, counted by callgrind: the same number on every run of one build, so that it can be a gate.
//!
//! ```text
//! cargo bench --bench host_instructions
//! ```
//!
//! The bench starts itself under `valgrind --tool=callgrind`, on AVX2, which is what valgrind knows, with the scene `tiny`, once for each
//! phase and stage (see the bench `frame`; `cycle` is left out) and once for each phase without it; differences over the uops are the
//! figures. It fails where one of them is more than 5 % above that in `benches/host_instructions.json`, and names the functions that
//! grew. Other compilers make other code: what another one has counted is shown and not compared. `LRBSIM_UPDATE_GOLDEN=1` writes the file
//! anew.

mod common;

use std::collections::BTreeMap;
use std::process::{Command, ExitCode};

use common::{Error, Meter, PHASES, Stage, input, measure};
use lrbsim_isa::HostSimd;
use serde::{Deserialize, Serialize};

/// Figures that new ones are compared with.
const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/host_instructions.json");

/// How many times what it was a figure may be.
const GROWTH_MAX: f64 = 1.05;

/// Functions are kept whose part of a figure is at least this.
const SHARE_MIN: f64 = 0.01;

/// Functions that are named where a figure has grown.
const NAMED: usize = 5;

/// What is measured under callgrind: `STAGE PHASE FILE`, `none` for the stage of the pass that leaves the phase out.
const UNDER_CALLGRIND: &str = "LRBSIM_BENCH_UNDER_CALLGRIND";

/// All figures, and what compiled the program that they are of.
#[derive(Debug, Serialize, Deserialize)]
struct Figures {
    compiler: String,
    /// By phase and stage: `soft/windowed`.
    of: BTreeMap<String, Figure>,
}

/// Host instructions for each uop.
#[derive(Debug, Serialize, Deserialize)]
struct Figure {
    all: f64,
    /// Those of the functions with most of them.
    functions: BTreeMap<String, f64>,
}

/// What callgrind has counted: uops of the program, and host instructions of its functions.
struct Counted {
    uops: u64,
    functions: BTreeMap<String, u64>,
}

fn main() -> Result<ExitCode, Error> {
    if let Ok(arguments) = std::env::var(UNDER_CALLGRIND) {
        under_callgrind(&arguments)?;
        return Ok(ExitCode::SUCCESS);
    }
    let valgrind = Command::new("valgrind").arg("--version").output();
    if !valgrind.is_ok_and(|run| run.status.success()) || !HostSimd::Avx2.is_available() {
        println!("SKIPPED: host instructions are not counted: there is no valgrind, or the host has no AVX2");
        return Ok(ExitCode::SUCCESS);
    }
    let found = Figures { compiler: compiler()?, of: figures()? };
    if std::env::var_os("LRBSIM_UPDATE_GOLDEN").is_some() {
        std::fs::write(FILE, serde_json::to_string_pretty(&found)? + "\n")?;
        return Ok(ExitCode::SUCCESS);
    }
    let before: Figures = serde_json::from_str(&std::fs::read_to_string(FILE)?)?;
    if before.compiler != found.compiler {
        println!(
            "SKIPPED: figures of {} are not compared with those of {}: `LRBSIM_UPDATE_GOLDEN=1` writes them anew",
            found.compiler, before.compiler
        );
        return Ok(ExitCode::SUCCESS);
    }
    let names: Vec<&String> = before.of.keys().collect();
    if names != found.of.keys().collect::<Vec<_>>() {
        return Err(format!("{FILE} has figures of {names:?}, and others were counted").into());
    }
    let mut has_grown = false;
    for (name, now) in &found.of {
        let before = &before.of[name];
        if now.all > before.all * GROWTH_MAX {
            has_grown = true;
            println!(
                "{name}: {:.1} host instructions a uop, {:.1} before; at most {:.0} % more are allowed. What grew most:",
                now.all,
                before.all,
                100.0 * (GROWTH_MAX - 1.0)
            );
            grown(before, now).iter().for_each(|line| println!("    {line}"));
        }
    }
    Ok(if has_grown { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

/// The functions that have grown most from one figure to the next.
fn grown(before: &Figure, now: &Figure) -> Vec<String> {
    let growth = |(name, count): (&String, &f64)| {
        let before = before.functions.get(name).copied().unwrap_or(0.0);
        (count - before, format!("{:+.2}, to {count:.2}: {name}", count - before))
    };
    let mut all: Vec<(f64, String)> = now.functions.iter().map(growth).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all.into_iter().filter(|(growth, _)| *growth > 0.0).take(NAMED).map(|(_, line)| line).collect()
}

/// The compiler that a program built here comes from.
fn compiler() -> Result<String, Error> {
    let output = Command::new("rustc").arg("--version").output()?;
    Ok(String::from_utf8(output.stdout)?.trim().to_owned())
}

fn figures() -> Result<BTreeMap<String, Figure>, Error> {
    let mut all = BTreeMap::new();
    for phase in PHASES {
        let without = callgrind("none", phase)?;
        for stage in [Stage::Functional, Stage::Emission, Stage::Windowed] {
            let with = callgrind(stage.name(), phase)?;
            let figure = per_uop(&with, &without);
            println!(
                "{phase:6} {:12} {:>12} uops {:>10.2} host instructions/uop",
                stage.name(),
                with.uops,
                figure.all
            );
            all.insert(format!("{phase}/{}", stage.name()), figure);
        }
    }
    Ok(all)
}

/// What the phase that only the first pass has costs for each uop.
fn per_uop(with: &Counted, without: &Counted) -> Figure {
    let each = |name: &String, count: u64| {
        let before = without.functions.get(name).copied().unwrap_or(0);
        (count as f64 - before as f64) / with.uops as f64
    };
    // A function may do less in the pass with the phase: the sum has it too.
    let gone = without.functions.keys().filter(|name| !with.functions.contains_key(*name));
    let all: f64 = with.functions.iter().map(|(name, count)| each(name, *count)).sum::<f64>()
        + gone.map(|name| each(name, 0)).sum::<f64>();
    let functions = with.functions.iter().map(|(name, count)| (name.clone(), each(name, *count)));
    let rounded = |x: f64| (x * 1e3).round() / 1e3;
    Figure {
        all: rounded(all),
        functions: functions
            .filter(|(_, count)| *count >= SHARE_MIN * all)
            .map(|(name, count)| (name, rounded(count)))
            .collect(),
    }
}

/// Runs this bench once under callgrind.
fn callgrind(stage: &str, phase: &str) -> Result<Counted, Error> {
    let file = std::env::temp_dir().join(format!("lrbsim-callgrind-{}-{phase}-{stage}", std::process::id()));
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--compress-strings=no", "--compress-pos=no"])
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(std::env::current_exe()?)
        .env(UNDER_CALLGRIND, format!("{stage} {phase}"))
        .output()?;
    let text = std::fs::read_to_string(&file);
    let _ = std::fs::remove_file(&file);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    let uops = said.split_once("uops ").and_then(|(_, rest)| rest.trim().parse().ok());
    match (text, uops) {
        (Ok(text), Some(uops)) => Ok(Counted { uops, functions: by_function(&text) }),
        _ => Err(String::from_utf8_lossy(&output.stderr).into_owned().into()),
    }
}

/// The other side of [`callgrind`].
fn under_callgrind(arguments: &str) -> Result<(), Error> {
    let (stage, phase) = arguments.split_once(' ').ok_or("STAGE PHASE")?;
    let stage = Stage::ALL.into_iter().find(|known| known.name() == stage);
    let cost = measure(&input("tiny")?, (phase, stage, HostSimd::Avx2), 1.0, &mut Meter::new())?;
    println!("uops {}", cost.uops);
    Ok(())
}

/// The name of a function without the hash at its end, which changes with every build.
fn without_hash(name: &str) -> &str {
    let hash = name.rsplit_once("::h").filter(|(_, hash)| hash.len() == 16);
    hash.map_or(name, |(name, _)| name)
}

/// Own host instructions of each function in a file of callgrind's.
fn by_function(text: &str) -> BTreeMap<String, u64> {
    let mut functions: BTreeMap<String, u64> = BTreeMap::new();
    let (mut function, mut is_call) = (String::new(), false);
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("fn=") {
            function = without_hash(name).to_owned();
        } else if line.starts_with("calls=") {
            // The next line has what the called function took.
            is_call = true;
        } else if line.starts_with(|c: char| c.is_ascii_digit()) {
            let count = line.split_whitespace().nth(1).and_then(|count| count.parse::<u64>().ok());
            if let (false, Some(count)) = (is_call, count) {
                *functions.entry(function.clone()).or_default() += count;
            }
            is_call = false;
        }
    }
    functions
}
