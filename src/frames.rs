//! A moving scene: every frame is a run of its own, on a chip as cold or warm as that of a single frame.

use lrbsim_reports::animation::animated_png;
use lrbsim_reports::files::ResultDir;
use lrbsim_reports::frames::{FRAMES_SCHEMA_VERSION, FrameSummary, FramesReport};
use lrbsim_reports::page::{self, Picture};
use lrbsim_reports::picture;

use crate::error::BadInput;
use crate::frame::{RunOutput, RunRequest, run_frame};
use crate::inputs::at_time;
use crate::progress::Progress;

/// Frames at most: their pictures are kept until the animation is written.
const FRAMES_MAX: u32 = 1000;

/// Names of the files that a moving scene leaves besides those of its worst frame.
pub const FILES: [&str; 6] =
    ["animation.png", "frames.csv", "frames.svg", "frames.png", "report.html", "frames.json"];

/// What came out of a moving scene.
#[derive(Debug)]
pub struct FramesOutput {
    /// The frames of the scene in numbers.
    pub report: FramesReport,
    /// The frame that took the longest.
    pub worst: RunOutput,
    /// All frames, one after the other, as an animated PNG.
    pub animation: Vec<u8>,
}

/// Runs `frames` frames of a moving scene, at equally spaced times from 0 to 1.
pub fn run_frames(
    request: &RunRequest,
    frames: u32,
    progress: &dyn Progress,
) -> Result<FramesOutput, BadInput> {
    if !(1..=FRAMES_MAX).contains(&frames) {
        return Err(BadInput::new(format!("`--frames` is {frames}; it must be from 1 to {FRAMES_MAX}")));
    }
    if request.reference.is_some() {
        return Err(BadInput::new("`--reference` judges one frame, and `--frames` asks for several")
            .with_help("`--time T` instead of `--frames` judges the frame at that time, from 0 to 1"));
    }
    let times: Vec<f64> = (0..frames).map(|i| f64::from(i) / f64::from((frames - 1).max(1))).collect();
    // A view that cannot be had is found before the long run.
    for time in &times {
        at_time(&request.scene, *time, "`--frames`")?;
    }
    let mut summaries: Vec<FrameSummary> = Vec::new();
    let mut pictures = Vec::new();
    let mut worst: Option<(usize, RunOutput)> = None;
    for (index, time) in times.iter().enumerate() {
        let request = RunRequest { scene: at_time(&request.scene, *time, "`--frames`")?, ..request.clone() };
        let output = run_frame(&request, progress)?;
        let frame = &output.frame;
        pictures.push(picture::shaded_rgb(frame.width, frame.height, &frame.visibility, &frame.cosine));
        let summary = FrameSummary::of(*time, &output.report);
        if worst.as_ref().is_none_or(|(worst, _)| summary.cost() > summaries[*worst].cost()) {
            worst = Some((index, output));
        }
        summaries.push(summary);
    }
    let (worst_frame, worst) = worst.expect("there is a frame");
    let report = FramesReport {
        schema_version: FRAMES_SCHEMA_VERSION,
        scene: worst.report.scene.name.clone(),
        machine: worst.report.machine.name.clone(),
        algorithm: worst.report.provenance.algorithm.clone(),
        fidelity: worst.report.provenance.fidelity.clone(),
        worst_frame,
        frames: summaries,
    };
    let animation = animated_png(worst.frame.width, worst.frame.height, &pictures);
    Ok(FramesOutput { report, worst, animation })
}

/// Stages what a moving scene leaves besides the files of its worst frame; `frames.json` last.
pub fn stage(dir: &mut ResultDir, output: &FramesOutput) -> Result<(), BadInput> {
    dir.stage("animation.png", &output.animation)?;
    for (name, bytes) in drawings(&output.report) {
        dir.stage(&name, &bytes)?;
    }
    let frame = &output.worst.frame;
    let (width, height) = (frame.width, frame.height);
    let worst = picture::shaded_png(width, height, &frame.visibility, &frame.cosine);
    let html = page::of_frames(
        &output.report,
        &output.worst.report,
        &[Picture::png("all frames", &output.animation)],
        &[Picture::png("the worst frame", &worst)],
    );
    dir.stage("report.html", html.as_bytes())?;
    dir.stage("frames.json", output.report.to_json().as_bytes())?;
    Ok(())
}

/// Table and plot of the frames.
pub fn drawings(report: &FramesReport) -> Vec<(String, Vec<u8>)> {
    let mut files = vec![("frames.csv".to_owned(), report.sheet().csv().into_bytes())];
    if let Some(plot) = report.plot() {
        files.push(("frames.svg".to_owned(), plot.svg().into_bytes()));
        files.push(("frames.png".to_owned(), plot.png()));
    }
    files
}
