//! `study fidelity`: what each level of modeling costs, and how far its times are off.
//!
//! ```text
//! subjects: scenes of the paper, microbenchmarks ─► every level, one after the other ─► seconds of the host
//!                                                                                  └─► times beside those of `cycle`
//! ```

use std::path::{Path, PathBuf};

use lrbsim_isa::Step;
use lrbsim_machine::{Fidelity, Sampling};
use lrbsim_micro::{Arrays, Bench, Extent, Prefetch, Store, Stream, Threads};
use lrbsim_reports::fidelity::{
    FIDELITY_SCHEMA_VERSION, FidelityLevel, FidelityReport, FidelitySeconds, FidelitySubject,
    PRICES_SCHEMA_VERSION, PriceList, SHARE_MIN,
};
use lrbsim_reports::page;
use lrbsim_reports::run::RunReport;

use crate::engine::Engine;
use crate::error::BadInput;
use crate::frame::{HostOptions, RunRequest, SEMANTICS, run_frame};
use crate::host::Stopwatch;
use crate::inputs::{self, Machine};
use crate::json;
use crate::made;
use crate::progress::{Progress, Quiet};

/// Name of the study, as `lrbsim study` takes it.
pub const NAME: &str = "fidelity";

/// Name of the file of its results.
pub const FILE: &str = "fidelity.json";

/// Name of the file of what it took of the host.
pub const PRICES_FILE: &str = "prices.json";

/// The machine that is simulated.
const MACHINE: &str = "larrabee-24";

/// The scenes of the paper in pictures so small that the most exact level ends in minutes.
const SCENES: [(&str, u32, u32); 4] =
    [("palm", 320, 320), ("saloon", 320, 240), ("street", 160, 120), ("fern", 80, 60)];

/// A small scene in place of those of the paper, to try the study out.
const QUICK: [(&str, u32, u32); 1] = [("tiny", 40, 30)];

/// Errors, in per cent, that `sampled` is asked for.
const SAMPLED_PERCENT: [u32; 3] = [10, 5, 2];

/// What of the study is run, and how.
#[derive(Debug, Clone)]
pub struct FidelityRequest {
    /// Only subjects whose names contain this.
    pub only: Option<String>,
    /// Whether one small scene stands for those of the paper.
    pub quick: bool,
    /// How the host goes about it; changes no time of the machine.
    pub host: HostOptions,
}

/// What is run at every level.
enum Subject {
    /// A frame of a shipped scene, so many pixels wide and high.
    Scene(&'static str, u32, u32),
    /// A microbenchmark, with what it does.
    Micro(&'static str, &'static str, Bench),
}

/// A phase with its cycles; `None` where there is no time.
type Timed = (String, Option<u64>);

/// What came out of one level, and what the host did for it.
struct Ran {
    phases: Vec<Timed>,
    instructions: u64,
    seconds: f64,
}

/// The levels, from the cheapest to the reference.
fn levels() -> Vec<Fidelity> {
    let sampled = |error_percent| Fidelity::Sampled(Sampling { error_percent, ..Sampling::DEFAULT });
    let mut levels = vec![Fidelity::Functional, Fidelity::Roofline];
    levels.extend(SAMPLED_PERCENT.map(sampled));
    levels.extend([Fidelity::Windowed, Fidelity::Cycle]);
    levels
}

fn subjects(quick: bool) -> Vec<Subject> {
    let lines = if quick { 64 } else { 2048 };
    let triad = Stream {
        reads: 2,
        store: Store::Streaming,
        prefetch: Prefetch::Both { l2_ahead: 64, l1_ahead: 8 },
        arrays: Arrays::Split { bytes: 32 << 20 },
        threads: Threads::Spread(24),
        extent: Extent::Onward { warm_lines: 64, lines },
    };
    let laps = |lines| Stream {
        store: Store::InPlace,
        prefetch: Prefetch::No,
        arrays: Arrays::Split { bytes: 0 },
        threads: Threads::Spread(96),
        extent: Extent::Laps { lines, laps: if quick { 64 } else { 128 } },
        ..triad
    };
    let scenes = if quick { &QUICK[..] } else { &SCENES[..] };
    let mut subjects: Vec<Subject> =
        scenes.iter().map(|(name, width, height)| Subject::Scene(name, *width, *height)).collect();
    subjects.push(Subject::Micro(
        "triad",
        "Two arrays read and a third written, far beyond the caches, by a thread a core",
        Bench::Stream(triad),
    ));
    subjects.push(Subject::Micro(
        "laps",
        "Two arrays read and one of them written, in three quarters of the L1, by four threads a core",
        Bench::Stream(laps(48)),
    ));
    if !quick {
        subjects.push(Subject::Micro(
            "full-laps",
            "The same in all of the L1, to the last line",
            Bench::Stream(laps(64)),
        ));
    }
    subjects
}

impl Subject {
    fn name(&self) -> &'static str {
        match self {
            Subject::Scene(name, ..) | Subject::Micro(name, ..) => name,
        }
    }

    fn about(&self) -> String {
        match self {
            Subject::Scene(_, width, height) => format!("{width} by {height} pixels, `sism`"),
            Subject::Micro(_, about, _) => (*about).to_owned(),
        }
    }

    fn run(&self, machine: &Machine, level: Fidelity, host: HostOptions) -> Result<Ran, BadInput> {
        match self {
            Subject::Scene(name, width, height) => {
                let mut scene = inputs::scene(name)?;
                inputs::resize(&mut scene, *width, *height)?;
                let request = RunRequest {
                    scene,
                    machine: machine.clone(),
                    algorithm: "sism".parse()?,
                    fidelity: level,
                    warm_frames: 0,
                    reference: None,
                    host,
                };
                let output = run_frame(&request, &Quiet)?;
                let RunReport { phases, .. } = output.report;
                let instructions: u64 = phases.iter().map(|phase| phase.instructions.total).sum();
                Ok(Ran {
                    phases: phases.into_iter().map(|phase| (phase.id, phase.cycles)).collect(),
                    instructions,
                    seconds: instructions as f64 / output.host.simulated_instructions_per_second,
                })
            }
            Subject::Micro(_, _, bench) => {
                let mut prepared = bench.prepare(machine.config.cores);
                let mut engine = Engine::new(&machine.spec, level, host.simd, host.threads);
                let watch = Stopwatch::start();
                let mut pass = |step: &Step| engine.run(step, &mut prepared.arena, &Quiet);
                let passes = prepared.passes.iter().map(&mut pass).collect::<Result<Vec<_>, _>>()?;
                let seconds = watch.elapsed().as_secs_f64();
                // The last pass is a longer one of the one before.
                let last = passes.len() - 1;
                let cycles = passes[last].cycles.saturating_sub(passes[last - 1].cycles);
                let instructions = passes.iter().map(|report| report.issued).sum();
                Ok(Ran {
                    phases: vec![("steady".to_owned(), level.is_timed().then_some(cycles))],
                    instructions,
                    seconds,
                })
            }
        }
    }
}

impl Ran {
    fn cycles(&self) -> Option<u64> {
        self.phases.iter().map(|(_, cycles)| *cycles).sum()
    }

    /// This as a level whose times are compared with those of `exact`.
    fn beside(&self, level: Fidelity, exact: &Ran) -> FidelityLevel {
        let whole = exact.cycles().unwrap_or(0) as f64;
        let off = |found: u64, exact: u64| found as f64 / exact.max(1) as f64 - 1.0;
        let of_phase = |(found, exact): (&Timed, &Timed)| {
            let (cycles, exact) = (found.1?, exact.1?);
            (exact as f64 >= SHARE_MIN * whole).then(|| (off(cycles, exact), found.0.clone()))
        };
        let phases = self.phases.iter().zip(&exact.phases).filter_map(of_phase);
        let worst = phases.reduce(|worst, next| if next.0.abs() > worst.0.abs() { next } else { worst });
        FidelityLevel {
            level: level.to_string(),
            error: self.cycles().zip(exact.cycles()).map(|(found, exact)| off(found, exact)),
            phase_error: worst.as_ref().map(|(error, _)| *error),
            phase: worst.filter(|(error, _)| *error != 0.0).map(|(_, id)| id),
        }
    }
}

/// Runs the study: every subject at every level, one after the other.
///
/// # Errors
/// If there is no subject of the name that was asked for, or if the host has no memory for one.
pub fn run_fidelity(request: &FidelityRequest, progress: &dyn Progress) -> Result<PriceList, BadInput> {
    let only = request.only.as_deref().unwrap_or_default();
    let all = subjects(request.quick);
    let names: Vec<&str> = all.iter().map(Subject::name).collect();
    let wanted: Vec<&Subject> = all.iter().filter(|subject| subject.name().contains(only)).collect();
    if wanted.is_empty() {
        return Err(BadInput::new(format!(
            "`--only {only}` is in the name of no subject of `{NAME}`; it must be in one of: {}",
            names.join(", ")
        )));
    }
    let machine = Machine::load(MACHINE, &[])?;
    let levels = levels();
    progress.counted(NAME, (wanted.len() * levels.len()) as u32);
    let (mut subjects, mut seconds) = (Vec::new(), Vec::new());
    for subject in wanted {
        let mut ran = Vec::new();
        for level in &levels {
            ran.push(subject.run(&machine, *level, request.host)?);
            progress.one_done();
        }
        let exact = &ran[ran.len() - 1];
        seconds.push(ran.iter().map(|ran| ran.seconds).collect());
        subjects.push(FidelitySubject {
            name: subject.name().to_owned(),
            about: subject.about(),
            instructions: exact.instructions,
            levels: ran.iter().zip(&levels).map(|(ran, level)| ran.beside(*level, exact)).collect(),
        });
    }
    let errors = FidelityReport {
        schema_version: FIDELITY_SCHEMA_VERSION,
        lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
        semantics: SEMANTICS,
        machine: MACHINE.to_owned(),
        reference: Fidelity::Cycle.to_string(),
        subjects,
    };
    let host = FidelitySeconds {
        schema_version: PRICES_SCHEMA_VERSION,
        errors: errors.sha256(),
        subjects: errors.subjects.iter().map(|subject| subject.name.clone()).collect(),
        levels: levels.iter().map(Fidelity::to_string).collect(),
        host_threads: u32::try_from(request.host.threads).unwrap_or(u32::MAX),
        seconds,
    };
    Ok(PriceList { errors, host })
}

/// The price list whose errors were written to `folder`, with the seconds that lie beside them.
///
/// # Errors
/// If there are no seconds, or not those of these errors.
pub fn beside(folder: &Path, errors: FidelityReport) -> Result<PriceList, BadInput> {
    let path = folder.join(PRICES_FILE);
    let both = format!("`lrbsim study {NAME}` makes both");
    let host = json::text(&path)
        .and_then(|text| json::read(&path.display().to_string(), &text))
        .map_err(|bad| bad.with_help(format!("{both} `{FILE}` and `{PRICES_FILE}`")))?;
    PriceList::new(errors, host).ok_or_else(|| {
        BadInput::new(format!("`{}` is of another study than the `{FILE}` beside it", path.display()))
            .with_help(both)
    })
}

/// The files of the study that are drawn from its results: names and bytes. All of them show seconds, which no two hosts have in common.
pub fn drawings(list: &PriceList) -> Vec<(String, Vec<u8>)> {
    made::drawings("prices.md", list.markdown(), &list.findings(), page::of_fidelity(list))
}

/// Writes the results of the study to `dir`, its JSON last, in place of the results there, and tells their paths.
pub fn write(dir: &Path, list: &PriceList) -> Result<Vec<PathBuf>, BadInput> {
    let mut files = drawings(list);
    files.push((PRICES_FILE.to_owned(), list.host.to_json().into_bytes()));
    made::write(dir, &files, FILE, &list.errors.to_json())
}
