//! The result of one run in simulated time: `report.json`.

use std::collections::BTreeMap;

use lrbsim_machine::MachineConfig;
use lrbsim_machine::counters::{
    AtomicCounters, Bounds, CacheCounters, CycleStack, DirectoryCounters, MemoryCounters, RingCounters,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::validation::ModelError;

/// Version of the layout of [`RunReport`]; raised when a reader of an older one would misread it.
pub const SCHEMA_VERSION: u32 = 2;

/// Everything one run measured in simulated time; written as `report.json`.
///
/// The same inputs give the same bytes, on any host and any number of host threads. Wall-clock goes into
/// [`HostReport`](crate::host::HostReport) beside it. Under `functional` fidelity nothing is timed: every time, cycle and
/// memory-system field is null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RunReport {
    /// Version of this layout.
    pub schema_version: u32,
    /// What determined the numbers below; quote it next to any of them.
    pub provenance: Provenance,
    /// What was drawn.
    pub scene: SceneSummary,
    /// The effective machine: every default filled in, every `--set` applied.
    pub machine: MachineConfig,
    /// Rows of the timing table, in program order.
    pub phases: Vec<PhaseReport>,
    /// The frame as a whole.
    pub total: Total,
    /// What the picture is, in numbers.
    pub image: ImageSummary,
    /// How far the model is from measured machines.
    pub model_error: ModelError,
    /// What makes the result suspicious; empty where nothing does.
    pub warnings: Vec<Warning>,
}

/// Something that makes a result suspicious.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Warning {
    /// Stable name.
    pub kind: WarningKind,
    /// What is suspicious, and what to do about it.
    pub message: String,
}

/// Kinds of [`Warning`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WarningKind {
    /// No pixel sees a surface.
    NothingSeen,
    /// The light reaches into the geometry.
    LightInGeometry,
    /// The model has lines that were not understood.
    LinesLeftOut,
    /// The method is past a limit of its own.
    MethodLimit,
    /// Times are estimates, and not simulated.
    Estimate,
}

/// What determined the numbers of a report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Version of the program that ran.
    pub lrbsim_version: String,
    /// Version of what its numbers mean: two programs of one version of the numbers give the same report for the same
    /// inputs.
    pub semantics: u32,
    /// SHA-256 of the effective machine as compact JSON.
    pub machine_hash: String,
    /// SHA-256 of the scene: triangles, camera, image size and light.
    pub scene_hash: String,
    /// Shadow algorithm with all of its options, as `-a` takes it.
    pub algorithm: String,
    /// How much of the machine was modeled.
    pub fidelity: String,
    /// Frames simulated before the measured one, to warm the caches.
    pub warm_frames: u32,
    /// Seed of everything random. Nothing in a run is random yet: 0.
    pub seed: u64,
}

/// What was drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneSummary {
    /// Name of the scene.
    pub name: String,
    /// Triangles of the mesh.
    pub triangles: u64,
    /// Edges that are a silhouette as seen from the light's center.
    pub silhouette_edges: u64,
    /// Pixels that see a surface.
    pub receivers: u64,
    /// Width of the picture in pixels.
    pub width: u32,
    /// Height of the picture in pixels.
    pub height: u32,
    /// The light, as in a scene file.
    pub light: serde_json::Value,
}

/// One row of the timing table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PhaseReport {
    /// Stable name.
    pub id: String,
    /// Title for people.
    pub title: String,
    /// Whether the published totals of Johnson et al. 2009 contain this phase.
    pub in_paper_total: bool,
    /// Steps, each ended by a global barrier.
    pub steps: u64,
    /// Tasks of all steps.
    pub tasks: u64,
    /// Simulated cycles from the first task to the last barrier.
    pub cycles: Option<u64>,
    /// `cycles` in milliseconds at the machine's clock.
    pub ms: Option<f64>,
    /// Between these milliseconds `ms` lies with 95 % confidence, where it was extrapolated from a sample; null where every
    /// task was timed.
    #[serde(default)]
    pub ms_interval: Option<[f64; 2]>,
    /// Part of the frame's cycles, in [0, 1].
    pub share: Option<f64>,
    /// Simulated instructions.
    pub instructions: Instructions,
    /// Instructions per cycle and core, over all cores of the machine.
    pub ipc: Option<f64>,
    /// Lane-slots of vector instructions.
    pub lanes: Lanes,
    /// Core-cycles in which two instructions issued.
    pub paired_core_cycles: Option<u64>,
    /// Cycles in which each core issued, by core; they add up to the `issue` of the cycle stack.
    #[serde(default)]
    pub core_busy_cycles: Option<Vec<u64>>,
    /// Core-cycles by what they were spent on; they add up to `cycles` times the number of cores.
    pub cycle_stack: Option<CycleStack>,
    /// What each limit of the machine alone would take, where the time was estimated from them (`roofline`); not there where it was
    /// simulated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Bounds>,
    /// First-level data caches of all cores.
    pub l1d: Option<CacheCounters>,
    /// Second-level caches of all cores.
    pub l2: Option<CacheCounters>,
    /// The ring or rings.
    pub ring: Option<RingCounters>,
    /// The coherence directory, all slices together.
    pub directory: Option<DirectoryCounters>,
    /// The memory controllers.
    pub memory: Option<MemoryCounters>,
    /// Locked operations.
    pub atomics: Option<AtomicCounters>,
    /// The steps of the phase, in order.
    #[serde(default)]
    pub by_step: Vec<StepRow>,
}

/// One step of a phase: tasks of one kind, ended by a global barrier.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StepRow {
    /// Name of the step; a phase may have several of one name.
    pub name: String,
    /// Tasks of the step.
    pub tasks: u64,
    /// Simulated instructions of the step.
    pub instructions: u64,
    /// Simulated cycles from the first task to the end of the barrier.
    pub cycles: Option<u64>,
    /// `cycles` in milliseconds at the machine's clock.
    pub ms: Option<f64>,
    /// Core-cycles by what they were spent on; they add up to `cycles` times the number of cores.
    pub cycle_stack: Option<CycleStack>,
}

/// Simulated instructions by kind. The kinds exclude each other and add up to `total`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Instructions {
    /// All of them.
    pub total: u64,
    /// Vector instructions that are none of the kinds below.
    pub vector: u64,
    /// Gathers.
    pub gather: u64,
    /// Scatters.
    pub scatter: u64,
    /// Atomic instructions, scalar and vector.
    pub atomic: u64,
    /// Scalar arithmetic, loads and stores.
    pub scalar: u64,
    /// Mask instructions.
    pub mask: u64,
    /// Branches.
    pub branch: u64,
    /// Prefetches, gathered ones included.
    pub prefetch: u64,
    /// Stores and reloads of spilled vector registers.
    pub spill: u64,
    /// The same instructions by class of the ISA layer; classes that do not occur are left out.
    pub by_class: BTreeMap<String, u64>,
}

/// Lane-slots: 16 for each vector instruction.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lanes {
    /// Slots that did work.
    pub active: u64,
    /// Slots that were masked off.
    pub masked: u64,
}

/// The frame as a whole. `paper_*` count only the phases that the published totals contain; a method that has none of them has no
/// such numbers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Total {
    /// Simulated cycles of all phases.
    pub cycles: Option<u64>,
    /// Milliseconds of all phases.
    pub ms: Option<f64>,
    /// Between these milliseconds `ms` lies with 95 % confidence, where some of it was extrapolated from a sample; null where
    /// every task was timed.
    #[serde(default)]
    pub ms_interval: Option<[f64; 2]>,
    /// Frames per second, were the frame nothing but these phases.
    pub fps: Option<f64>,
    /// Milliseconds of the phases that the published totals contain.
    pub paper_ms: Option<f64>,
    /// Between these milliseconds `paper_ms` lies with 95 % confidence, as `ms_interval` says of `ms`.
    #[serde(default)]
    pub paper_ms_interval: Option<[f64; 2]>,
    /// Frames per second of those.
    pub paper_fps: Option<f64>,
    /// Simulated instructions of all phases; 0 in reports of programs that did not tell.
    #[serde(default)]
    pub instructions: u64,
}

/// What the picture is, in numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageSummary {
    /// SHA-256 of the visibility values: height x width little-endian f32, NaN 0x7fc00000 where nothing was hit.
    pub sha256: String,
    /// Mean visibility of the light over all receivers, in [0, 1]; null when there are none.
    pub mean_visibility: Option<f64>,
    /// Receivers that see a part of the light: visibility strictly between 0 and 1.
    pub penumbra_receivers: u64,
    /// How far the picture is from the truth; null unless a reference was asked for.
    #[serde(default)]
    pub error: Option<ImageError>,
}

/// How far the visibility of a picture is from a reference by shadow rays, all in parts of the light.
///
/// A receiver is *shadowed* if the reference has it in shadow or penumbra, and *in question* if the reference or the picture
/// has: the others are lit in both, and of these a picture may have any number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImageError {
    /// Shadow rays of a receiver that were asked for; a light without extent takes one.
    pub samples: u32,
    /// Receivers that the reference has in shadow or penumbra: visibility below 1.
    pub shadowed_receivers: u64,
    /// Receivers that the reference or the picture has in shadow or penumbra.
    pub receivers_in_question: u64,
    /// Error measure of Atty et al. 2006, §5.2.1: the sum of |picture - reference| over all receivers, divided by the number
    /// of shadowed ones; 0 without shadow.
    pub mean: f64,
    /// Root of the mean of (picture - reference)² over the receivers in question.
    pub rmse: f64,
    /// Greatest |picture - reference| of any receiver.
    pub max: f64,
    /// 99 % of the receivers in question have no greater |picture - reference|.
    pub p99: f64,
    /// Part of the receivers in question whose |picture - reference| is above 0.25.
    pub off_by_quarter: f64,
    /// Sum of picture - reference over all receivers, divided by the number of shadowed ones: above 0, the picture is too
    /// light. Its size is that of `mean` where all errors have one sign.
    pub bias: f64,
    /// Where what is off lies; `None` in results of builds that did not tell.
    #[serde(default)]
    pub places: Option<ErrorPlaces>,
    /// The reference's own error in the measure of `mean`, estimated: half of what two halves of its rays, which do not
    /// depend on one another, differ by.
    pub reference_mean: f64,
    /// The reference's own error in the measure of `rmse`, estimated from the same two halves.
    pub reference_rmse: f64,
}

/// Where the error of a picture lies: parts of `image.error.mean`, which they add up to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ErrorPlaces {
    /// Part of `image.error.mean` that is of receivers which see nothing of the light by the reference: the picture lets light in.
    pub umbra: f64,
    /// Part of `image.error.mean` that is of receivers which see some of the light by the reference.
    pub penumbra: f64,
    /// Part of `image.error.mean` that is of receivers which see all of the light by the reference: the picture darkens them.
    pub light: f64,
}

impl RunReport {
    /// The bytes of `report.json`: indented, fields in the order above, a line break at the end.
    pub fn to_json(&self) -> String {
        let mut text =
            serde_json::to_string_pretty(self).expect("a report has string keys and no foreign types");
        text.push('\n');
        text
    }
}

impl Lanes {
    /// Part of the lane-slots that did work, in [0, 1]; `None` without vector instructions.
    pub fn active_fraction(&self) -> Option<f64> {
        ratio(self.active, self.active + self.masked)
    }
}

/// Whether these are phases of the paper's method, so that its total of them means something.
pub(crate) fn are_of_paper(phases: &[PhaseReport]) -> bool {
    phases.iter().any(|phase| phase.in_paper_total)
}

impl Total {
    /// Adds up the phases of a frame at `clock_ghz`.
    pub fn of_phases(phases: &[PhaseReport], clock_ghz: f64) -> Total {
        // One phase without time means that nothing was timed.
        let cycles = |paper: bool| -> Option<u64> {
            phases.iter().filter(|phase| phase.in_paper_total || !paper).map(|phase| phase.cycles).sum()
        };
        let ms = |cycles: Option<u64>| cycles.map(|cycles| milliseconds(cycles, clock_ghz));
        let fps = |ms: Option<f64>| ms.filter(|ms| *ms > 0.0).map(|ms| 1e3 / ms);
        let all = cycles(false);
        let paper = if all.is_some() && are_of_paper(phases) { cycles(true) } else { None };
        Total {
            cycles: all,
            ms: ms(all),
            ms_interval: ms(all).and_then(|ms| interval_of_sum(ms, phases.iter())),
            fps: fps(ms(all)),
            paper_ms: ms(paper),
            paper_ms_interval: ms(paper)
                .and_then(|ms| interval_of_sum(ms, phases.iter().filter(|phase| phase.in_paper_total))),
            paper_fps: fps(ms(paper)),
            instructions: phases.iter().map(|phase| phase.instructions.total).sum(),
        }
    }
}

/// How far a number may be off of which this is the interval. Its lower end is cut at 0, its upper is not.
pub fn half_interval(number: f64, interval: [f64; 2]) -> f64 {
    interval[1] - number
}

/// The interval of `ms`, the sum of the times of `phases`, whose errors do not depend on one another; `None` where none of
/// them has an interval.
fn interval_of_sum<'a>(ms: f64, phases: impl Iterator<Item = &'a PhaseReport>) -> Option<[f64; 2]> {
    let halves = phases.filter_map(|phase| Some(half_interval(phase.ms?, phase.ms_interval?)));
    let half = halves.map(|half| half * half).sum::<f64>().sqrt();
    (half > 0.0).then(|| [(ms - half).max(0.0), ms + half])
}

impl ImageSummary {
    /// Numbers of a picture from its visibility values, NaN where nothing was hit.
    pub fn of(visibility: &[f32]) -> ImageSummary {
        let (mut sum, mut receivers, mut penumbra_receivers) = (0.0_f64, 0_u64, 0);
        for value in visibility.iter().filter(|value| !value.is_nan()) {
            sum += f64::from(*value);
            receivers += 1;
            penumbra_receivers += u64::from(*value > 0.0 && *value < 1.0);
        }
        ImageSummary {
            sha256: crate::picture::sha256_of_visibility(visibility),
            mean_visibility: (receivers > 0).then(|| sum / receivers as f64),
            penumbra_receivers,
            error: None,
        }
    }
}

/// Hits per access, in [0, 1]; `None` when there was no access. A merged miss is no hit.
pub fn hit_rate(cache: &CacheCounters) -> Option<f64> {
    ratio(cache.hits, cache.accesses)
}

/// Simulated milliseconds of `cycles` at `clock_ghz`.
pub fn milliseconds(cycles: u64, clock_ghz: f64) -> f64 {
    cycles as f64 / (clock_ghz * 1e6)
}

/// `part / whole`; `None` when the whole is 0.
pub fn ratio(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{golden, sample};

    #[test]
    fn a_report_survives_its_json() {
        let report = sample::timed();
        assert_eq!(serde_json::from_str::<RunReport>(&report.to_json()).expect("own JSON"), report);
    }

    #[test]
    fn the_bytes_of_a_report_do_not_change_unnoticed() {
        golden::check("report.json", &sample::timed().to_json());
    }

    #[test]
    fn without_times_every_total_but_that_of_instructions_is_null() {
        let report = sample::functional();
        let instructions = report.phases.iter().map(|phase| phase.instructions.total).sum();
        assert_eq!(report.total, Total { instructions, ..Total::default() });
        assert!(report.to_json().contains("\"paper_fps\": null"));
    }

    #[test]
    fn the_paper_total_leaves_out_what_the_paper_leaves_out() {
        let total = sample::timed().total;
        assert_eq!((total.cycles, total.ms, total.paper_ms), (Some(10_000_000), Some(10.0), Some(9.5)));
        assert_eq!(total.fps, Some(100.0));
    }

    #[test]
    fn image_numbers_leave_out_the_background() {
        let image = ImageSummary::of(&[0.0, 1.0, 0.5, f32::NAN]);
        assert_eq!((image.mean_visibility, image.penumbra_receivers), (Some(0.5), 1));
        assert_eq!(ImageSummary::of(&[f32::NAN]).mean_visibility, None);
    }
}
