//! `lrbsim run`.

use std::io::{IsTerminal as _, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use lrbsim::choices;
use lrbsim::profile::{self, Looker, Profiler};
use lrbsim::progress::Progress;
use lrbsim::reference::{DEFAULT_CACHE, parse_samples};
use lrbsim::written::replaced_run;
use lrbsim::{
    Algorithm, BadInput, HostOptions, Machine, ReferenceRequest, RunRequest, Setting, frames, inputs,
    results, run_frame,
};
use lrbsim_isa::host::HostSimd;
use lrbsim_machine::Fidelity;
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::table;

use super::Failure;
use super::interrupt::on_interrupt;
use super::progress::Bar;

#[derive(Debug, Args)]
pub(crate) struct RunArgs {
    /// A shipped scene, a scene file (.json) or a model (.obj).
    #[arg(default_value = "saloon-small")]
    scene: PathBuf,

    /// A shipped machine or a machine file (.json).
    #[arg(short, long, default_value = "larrabee-24")]
    machine: PathBuf,

    /// Change one field of the machine, such as cores=8 or l2.capacity_bytes=524288; may be given again.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    settings: Vec<String>,

    /// Shadow algorithm and its options; `--help` lists them.
    #[arg(
        short,
        long,
        value_name = "ALGORITHM[:K=V,…]",
        default_value_t = Algorithm::default().to_string(),
        long_help = choices::algorithm_help()
    )]
    algorithm: String,

    /// Size of the picture in pixels, instead of the scene's.
    #[arg(long, value_name = "WxH")]
    size: Option<String>,

    /// Radius of the light in world units, instead of the scene's.
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    light_radius: Option<f64>,

    /// How much of the machine is modeled; `--help` lists the levels.
    #[arg(
        long,
        value_name = "LEVEL",
        default_value_t = Fidelity::default().to_string(),
        long_help = choices::fidelity_help()
    )]
    fidelity: String,

    /// Host threads, all of the host's if not given; changes no result.
    #[arg(long, value_name = "N")]
    host_threads: Option<usize>,

    /// Host instructions that compute the lanes, the fastest if not given: avx512, avx2 or portable; changes no result.
    #[arg(long, value_name = "LEVEL")]
    host_simd: Option<String>,

    /// Frames to run before the measured one, to warm the caches.
    #[arg(long, value_name = "N", default_value_t = 0)]
    warm_frames: u32,

    /// Run so many frames of a scene that moves, from its time 0 to its time 1.
    #[arg(long, value_name = "N", conflicts_with_all = ["time", "dump"])]
    frames: Option<u32>,

    /// Run the frame at this time of a scene that moves, from 0 to 1.
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    time: Option<f64>,

    /// Judge the picture by so many shadow rays from each receiver, such as 256; adds error.png and reference.png.
    #[arg(long, value_name = "SAMPLES", allow_negative_numbers = true)]
    reference: Option<String>,

    /// Folder where references are kept, beside the finished points of studies.
    #[arg(long, value_name = "DIR", default_value = DEFAULT_CACHE)]
    cache: PathBuf,

    /// Folder for the results [default: out/<scene>-<machine>-<algorithm>, then what else was asked for, as in
    /// out/tiny-larrabee-24-sism-cores=8].
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Write receivers, normals, visibility, light and mesh too.
    #[arg(long)]
    dump: bool,

    /// Tell where the time of the host went, stage by stage, and in the steps by kind of work: kernels, issue, caches, uncore.
    #[arg(long, conflicts_with_all = ["frames", "json"])]
    profile: bool,

    /// Print the report as JSON on standard output, and nothing else there.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &RunArgs, out: &mut impl Write) -> Result<(), Failure> {
    on_interrupt(|| ());
    // Everything that can be wrong is found before the long run.
    let algorithm = Algorithm::from_str(&args.algorithm)?;
    let fidelity = Fidelity::from_str(&args.fidelity).map_err(BadInput::from)?;
    let host = host_options(args)?;
    let machine = Machine::load(&args.machine, &Setting::all(&args.settings)?)?;
    let samples = args.reference.as_deref().map(parse_samples).transpose()?;
    let size = args.size.as_deref().map(parse_size).transpose()?;
    let bar = Bar::new(std::io::stderr().is_terminal());
    let profiler = args.profile.then(|| Profiler::new("scene", &bar));
    let progress: &dyn Progress = profiler.as_ref().map_or(&bar, |profiler| profiler);
    bar.note("loading");
    let name = inputs::scene_name(&args.scene)?;
    let mut scene = inputs::scene_with(&name, &[])?;
    if let Some((width, height)) = size {
        inputs::resize(&mut scene, width, height)?;
    }
    if let Some(radius) = args.light_radius {
        inputs::set_light_radius(&mut scene, radius)?;
    }
    if let Some(time) = args.time {
        scene = inputs::at_time(&scene, time, "`--time`")?;
    }
    let target = match &args.out {
        Some(target) => target.clone(),
        None => results::default_dir(&scene.name, &machine.config.name, &algorithm, &asked(args)),
    };
    let mut files_read = name.files(&scene);
    files_read.extend(inputs::machine_file(&args.machine));
    let mut names = results::names(args.dump, samples.is_some());
    names.extend(args.frames.iter().flat_map(|_| frames::FILES));
    results::spare_inputs(&target, &names, &files_read)?;
    let dir = ResultDir::open(&target)
        .map_err(|error| BadInput::from(error).with_help("`-o` must name a folder that can be written"))?;

    let reference = samples.map(|samples| ReferenceRequest { samples, cache: Some(args.cache.clone()) });
    let warm_frames = args.warm_frames;
    let request = RunRequest { scene, machine, algorithm, fidelity, warm_frames, reference, host };
    if let Some(frames) = args.frames {
        return run_moving(&request, frames, (&target, dir), &bar, args.json, out);
    }
    let looker = args.profile.then(Looker::start).transpose();
    let looker = looker.map_err(|error| BadInput::new(format!("the host gives no thread: {error}")))?;
    let output = run_frame(&request, progress)?;
    let spent = looker.map(Looker::finish);
    progress.part("output");
    bar.finish();

    let replaced = replaced_run(&target, &output.report);
    let paths = results::write(dir, &output, &request.scene, args.dump)?;
    let stages = profiler.map(Profiler::finish);
    if args.json {
        out.write_all(output.report.to_json().as_bytes())?;
        return Ok(());
    }
    writeln!(out, "{}", table::render(&output.report))?;
    writeln!(
        out,
        "{:.2} s on the host, {:.1} million simulated instructions a second",
        output.host.seconds,
        output.host.simulated_instructions_per_second / 1e6
    )?;
    if let Some(stages) = stages {
        writeln!(out, "\n{}", profile::sheet(&stages).terminal())?;
    }
    if let Some(works) = spent.and_then(|spent| profile::work_sheet(&spent)) {
        writeln!(out, "{}", works.terminal())?;
    }
    if let (Some(seconds), Some(found)) = (output.host.reference_seconds, output.host.reference_found) {
        let how = if found { "found in the cache, where it once took" } else { "cast in" };
        writeln!(out, "reference {how} {seconds:.2} s")?;
    }
    tell(&paths, replaced, out)
}

/// Says what was written, and what it was written over.
fn tell(paths: &[PathBuf], replaced: Option<String>, out: &mut impl Write) -> Result<(), Failure> {
    for path in paths {
        writeln!(out, "wrote {}", path.display())?;
    }
    if let Some(replaced) = replaced {
        writeln!(out, "{replaced}")?;
    }
    Ok(())
}

/// What was asked for besides scene, machine and algorithm, as it stands in the default name of the folder.
fn asked(args: &RunArgs) -> Vec<String> {
    let mut asked = args.settings.clone();
    let mut option = |name: &str, value: Option<String>| {
        asked.extend(value.map(|value| format!("{name}={value}")));
    };
    option("size", args.size.clone());
    option("light-radius", args.light_radius.map(|radius| radius.to_string()));
    option("fidelity", (args.fidelity != Fidelity::default().to_string()).then(|| args.fidelity.clone()));
    option("warm-frames", (args.warm_frames > 0).then(|| args.warm_frames.to_string()));
    option("frames", args.frames.map(|frames| frames.to_string()));
    option("reference", args.reference.clone());
    option("time", args.time.map(|time| time.to_string()));
    asked
}

/// Runs a moving scene and tells of its frames.
fn run_moving(
    request: &RunRequest,
    count: u32,
    (target, mut dir): (&Path, ResultDir),
    bar: &Bar,
    json: bool,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let output = frames::run_frames(request, count, bar)?;
    bar.finish();
    if !json {
        super::warn(&request.scene);
    }
    results::stage(&mut dir, &output.worst, &request.scene, false)?;
    frames::stage(&mut dir, &output)?;
    let replaced = replaced_run(target, &output.worst.report);
    let paths = dir.replace().map_err(BadInput::from)?;
    let report = &output.report;
    if json {
        out.write_all(report.to_json().as_bytes())?;
        return Ok(());
    }
    writeln!(out, "{}", report.sheet().terminal())?;
    let which = if output.worst.report.total.ms.is_some() { "The worst frame" } else { "A frame, untimed" };
    writeln!(out, "{which}, {}:\n\n{}", report.worst_frame, table::render(&output.worst.report))?;
    tell(&paths, replaced, out)
}

fn host_options(args: &RunArgs) -> Result<HostOptions, BadInput> {
    let mut host = HostOptions::default();
    if let Some(threads) = args.host_threads {
        if !(1..=1024).contains(&threads) {
            return Err(BadInput::new(format!("`--host-threads` is {threads}; it must be from 1 to 1024")));
        }
        host.threads = threads;
    }
    if let Some(text) = &args.host_simd {
        host.simd =
            HostSimd::from_str(text).map_err(|error| BadInput::new(format!("`--host-simd`: {error}")))?;
        if !host.simd.is_available() {
            let have: Vec<String> =
                HostSimd::ALL.iter().filter(|simd| simd.is_available()).map(HostSimd::to_string).collect();
            return Err(BadInput::new(format!(
                "`--host-simd {text}`: this host has only {}",
                have.join(", ")
            )));
        }
    }
    Ok(host)
}

/// `640x480` as two numbers; their range is the scene's to check.
fn parse_size(text: &str) -> Result<(u32, u32), BadInput> {
    text.split_once(['x', 'X'])
        .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)))
        .ok_or_else(|| {
            BadInput::new(format!("`--size` is `{text}`; it must be WIDTHxHEIGHT, such as 640x480"))
        })
}
