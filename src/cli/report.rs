//! `lrbsim report`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use lrbsim::BadInput;
use lrbsim::written::{Results, Written};
use lrbsim::{fidelity, frames, stability, study, table3};
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::frames::FramesReport;
use lrbsim_reports::page::{self, Judged, Picture};
use lrbsim_reports::{Digest, HostReport, RunReport, table};

use super::Failure;
use super::interrupt::on_interrupt;

#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// The folder of a run or a study.
    dir: PathBuf,

    /// Where the page is written instead of into that folder.
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(args: &ReportArgs, out: &mut impl Write) -> Result<(), Failure> {
    on_interrupt(|| ());
    let written = Written::load(&args.dir)?;
    let folder = &written.folder;
    let target = args.out.as_ref().unwrap_or(folder);
    let files = match &written.results {
        Results::Run(report) => {
            let moving = moving(folder).filter(|moving| {
                // Frames of an earlier run in this folder are not those of this report.
                moving.frames.get(moving.worst_frame).is_some_and(|worst| worst.sha256 == report.image.sha256)
            });
            if let Some(moving) = moving {
                let all = pictures(folder, &[("all frames", "animation.png")])?;
                let worst = pictures(
                    folder,
                    &[("the worst frame", "image.png"), ("visibility of the light", "visibility.png")],
                )?;
                let html = page::of_frames(&moving, report, &all, &worst);
                let mut files = frames::drawings(&moving);
                files.push(("report.html".to_owned(), html.into_bytes()));
                return write(target, &files, out);
            }
            let pictures =
                pictures(folder, &[("shaded", "image.png"), ("visibility of the light", "visibility.png")])?;
            let html =
                page::of_run(report, host(folder).as_ref(), &pictures, judged(report, folder)?.as_ref());
            vec![
                ("report.html".to_owned(), html.into_bytes()),
                ("table.txt".to_owned(), table::render(report).into_bytes()),
            ]
        }
        Results::Study(report) => study::drawings(&Digest::of(report)),
        Results::Stability(report) => stability::drawings(report),
        Results::Table3(report) => table3::drawings(report),
        Results::Fidelity(report) => fidelity::drawings(&fidelity::beside(folder, (**report).clone())?),
    };
    write(target, &files, out)
}

fn write(folder: &Path, files: &[(String, Vec<u8>)], out: &mut impl Write) -> Result<(), Failure> {
    let mut dir = ResultDir::open(folder).map_err(BadInput::from)?;
    for (name, bytes) in files {
        dir.stage(name, bytes).map_err(BadInput::from)?;
    }
    for path in dir.add().map_err(BadInput::from)? {
        writeln!(out, "wrote {}", path.display())?;
    }
    Ok(())
}

/// The pictures of the reference that the report is judged by.
fn judged(report: &RunReport, folder: &Path) -> Result<Option<Judged>, BadInput> {
    if report.image.error.is_none() {
        return Ok(None);
    }
    let found = pictures(folder, &[("truth", "reference.png"), ("difference", "error.png")])?;
    Ok(<[Picture; 2]>::try_from(found).ok().map(|[truth, difference]| Judged { truth, difference }))
}

/// The frames of a moving scene whose worst frame the report is of.
fn moving(folder: &Path) -> Option<FramesReport> {
    serde_json::from_str(&std::fs::read_to_string(folder.join("frames.json")).ok()?).ok()
}

/// The pictures that are there.
fn pictures(folder: &Path, names: &[(&str, &str)]) -> Result<Vec<Picture>, BadInput> {
    let mut pictures = Vec::new();
    for (title, name) in names {
        let path = folder.join(name);
        let Ok(bytes) = std::fs::read(&path) else { continue };
        if !bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
            return Err(BadInput::new(format!("{} is not a PNG file", path.display()))
                .with_help("run the frame again, or take the file away: the page does without it"));
        }
        pictures.push(Picture::png(title, &bytes));
    }
    Ok(pictures)
}

/// What the run cost the host, if that is there: it is beside the results, not one of them.
fn host(folder: &Path) -> Option<HostReport> {
    serde_json::from_str(&std::fs::read_to_string(folder.join("host.json")).ok()?).ok()
}
