//! A moving scene, frame by frame: `frames.json`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::run::{RunReport, half_interval};
use crate::sheet::{Cell, Sheet};

/// Version of the layout of [`FramesReport`].
pub const FRAMES_SCHEMA_VERSION: u32 = 1;

/// What was measured of every frame of a moving scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FramesReport {
    /// Version of this layout.
    pub schema_version: u32,
    /// Name of the scene.
    pub scene: String,
    /// Name of the machine.
    pub machine: String,
    /// Shadow algorithm with all of its options.
    pub algorithm: String,
    /// How much of the machine was modeled.
    pub fidelity: String,
    /// The frame that took the most cycles, or the most instructions where nothing is timed; report.json is its report.
    pub worst_frame: usize,
    /// The frames, in their order.
    pub frames: Vec<FrameSummary>,
}

/// One frame of a moving scene in numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameSummary {
    /// Time in the scene, from 0 to 1.
    pub time: f64,
    /// Simulated cycles of the frame.
    pub cycles: Option<u64>,
    /// Simulated milliseconds of the frame.
    pub ms: Option<f64>,
    /// Between these milliseconds `ms` lies with 95 % confidence, where some of it was extrapolated from a sample; null where
    /// every task was timed.
    #[serde(default)]
    pub ms_interval: Option<[f64; 2]>,
    /// Simulated instructions of the frame.
    pub instructions: u64,
    /// Milliseconds of each phase, in program order.
    pub phases: Vec<FramePhase>,
    /// Mean visibility of the light, in [0, 1].
    pub mean_visibility: Option<f64>,
    /// SHA-256 of the visibility values.
    pub sha256: String,
}

/// One phase of a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FramePhase {
    /// Stable name of the phase.
    pub id: String,
    /// Simulated milliseconds of the phase.
    pub ms: Option<f64>,
    /// Between these milliseconds `ms` lies with 95 % confidence, as `ms_interval` of the frame says of its time.
    #[serde(default)]
    pub ms_interval: Option<[f64; 2]>,
}

impl FrameSummary {
    /// The summary of a frame's report.
    pub fn of(time: f64, report: &RunReport) -> FrameSummary {
        FrameSummary {
            time,
            cycles: report.total.cycles,
            ms: report.total.ms,
            ms_interval: report.total.ms_interval,
            instructions: report.total.instructions,
            phases: report
                .phases
                .iter()
                .map(|phase| FramePhase {
                    id: phase.id.clone(),
                    ms: phase.ms,
                    ms_interval: phase.ms_interval,
                })
                .collect(),
            mean_visibility: report.image.mean_visibility,
            sha256: report.image.sha256.clone(),
        }
    }

    /// What the worst frame has the most of.
    pub fn cost(&self) -> u64 {
        self.cycles.unwrap_or(self.instructions)
    }
}

impl FramesReport {
    /// The bytes of `frames.json`.
    pub fn to_json(&self) -> String {
        let mut text = serde_json::to_string_pretty(self).expect("a report has string keys");
        text.push('\n');
        text
    }

    /// A row for each frame; how far its time may be off stands beside it where some was extrapolated.
    pub fn sheet(&self) -> Sheet {
        let ids = self.frames.first().map(|frame| frame.phases.as_slice()).unwrap_or_default();
        let is_extrapolated = self.frames.iter().any(|frame| frame.ms_interval.is_some());
        let mut columns = ["frame", "time", "total, ms"].map(str::to_owned).to_vec();
        columns.extend(is_extrapolated.then(|| "±, ms".to_owned()));
        columns.extend(ids.iter().map(|phase| format!("{}, ms", phase.id)));
        columns.push("mean visibility".to_owned());
        let rows = self.frames.iter().enumerate().map(|(index, frame)| {
            let mut row = vec![Cell::Number(index as f64), Cell::Number(frame.time), Cell::maybe(frame.ms)];
            let half = frame.ms.zip(frame.ms_interval).map(|(ms, interval)| half_interval(ms, interval));
            row.extend(is_extrapolated.then(|| Cell::maybe(half)));
            row.extend(ids.iter().map(|id| {
                Cell::maybe(frame.phases.iter().find(|phase| phase.id == id.id).and_then(|phase| phase.ms))
            }));
            row.push(Cell::maybe(frame.mean_visibility));
            row
        });
        Sheet { columns, rows: rows.collect() }
    }

    /// Time of each frame, whole and by phase; `None` when nothing is timed.
    pub fn plot(&self) -> Option<Plot> {
        let series = |name: &str, ms: &dyn Fn(&FrameSummary) -> Option<f64>| {
            let points = self.frames.iter().enumerate();
            let points: Vec<(f64, f64)> =
                points.filter_map(|(i, frame)| Some((i as f64, ms(frame)?))).collect();
            Series { name: name.to_owned(), look: Look::Line, points }
        };
        let mut all = vec![series("total", &|frame| frame.ms)];
        for phase in &self.frames.first()?.phases {
            let of = |frame: &FrameSummary| frame.phases.iter().find(|other| other.id == phase.id)?.ms;
            all.push(series(&phase.id, &of));
        }
        if all[0].points.is_empty() {
            return None;
        }
        Some(Plot::Lines(Lines {
            title: format!("{} on {}", self.scene, self.machine),
            x: Axis::new("frame", false),
            y: Axis::new("ms", false),
            series: all,
        }))
    }
}
