//! Studies: what to run, and everything that came out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use crate::host::HostReport;
use crate::run::RunReport;

/// Version of the layout of [`StudyReport`].
pub const STUDY_SCHEMA_VERSION: u32 = 1;

/// A study as written in `configs/studies/*.json`: a base run, axes, and what to make of the results.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StudyFile {
    /// Name, as in the default folder of the results.
    pub name: String,
    /// The question, in one sentence.
    #[serde(default)]
    pub question: String,
    /// The run that every point starts from.
    #[serde(default)]
    pub base: Base,
    /// The axes: what is varied.
    pub axes: Vec<StudyAxis>,
    /// Which combinations of the axes are run.
    #[serde(default)]
    pub sampling: Sampling,
    /// Points that are left out: those that agree with one of these in every axis that it names, by one value or a list of values.
    #[serde(default)]
    pub exclude: Vec<BTreeMap<String, Value>>,
    /// The number that is asked for: a path in the report, such as `total.ms` or `phases.soft.cycles`.
    #[serde(default = "total_ms")]
    pub metric: String,
    /// Further columns of the study's table: paths in the report, or ratios of two, as in `phases.grid.cycles / scene.receivers`.
    #[serde(default)]
    pub columns: Vec<String>,
    /// The analyses to make of the results.
    #[serde(default)]
    pub analysis: Vec<AnalysisEntry>,
    /// What others published of some points, for the analysis `published`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub published: Vec<Published>,
}

/// The values that an exclusion or [`Published`] names for an axis: those of a list, or the one that stands alone.
pub fn named(value: &Value) -> &[Value] {
    value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice)
}

/// Whether two values of an axis are one: 24 and 24.0 are.
pub fn same(a: &Value, b: &Value) -> bool {
    a == b || (a.is_number() && a.as_f64() == b.as_f64())
}

/// Numbers that others published of a point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Where the numbers stand.
    pub source: String,
    /// The point that they are of: by axis its value, or a list of values. Of several points that have these they are of each.
    pub point: BTreeMap<String, Value>,
    /// The numbers, by their path in the report.
    pub numbers: BTreeMap<String, f64>,
}

fn total_ms() -> String {
    "total.ms".to_owned()
}

/// The run that every point of a study starts from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Base {
    /// A shipped scene, a scene file or a model; files are looked up beside the study file.
    pub scene: String,
    /// A shipped machine or a machine file.
    pub machine: String,
    /// Shadow algorithm with its options, as `-a` takes it.
    pub algorithm: String,
    /// How much of the machine is modeled.
    pub fidelity: String,
    /// Frames to run before the measured one.
    pub warm_frames: u32,
    /// Shadow rays a receiver that each picture is judged by, as `--reference` takes them; none if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<u32>,
    /// Whether each point keeps small pictures, which the page shows side by side.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub pictures: bool,
    /// Further changes of the base run: paths as in axes.
    pub set: BTreeMap<String, Value>,
}

impl Default for Base {
    fn default() -> Base {
        Base {
            scene: "saloon-small".to_owned(),
            machine: "larrabee-24".to_owned(),
            algorithm: "sism".to_owned(),
            fidelity: "windowed".to_owned(),
            warm_frames: 0,
            reference: None,
            pictures: false,
            set: BTreeMap::new(),
        }
    }
}

/// One thing that is varied: `values`, or for random sampling also a range from `min` to `max`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StudyAxis {
    /// A field of the machine (`cores`, `l2.capacity_bytes`), or one of `scene`, `machine`, `algorithm`, `fidelity`,
    /// `warm_frames`, `time`, `reference`, or a field of the scene (`scene.light.radius`), or an option of the algorithm
    /// (`algorithm.form`), in place of what `algorithm` says of it.
    pub path: String,
    /// Values of the axis, in their order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<Value>,
    /// Other paths that change with this one, each with as many values as `values` has: the height of an image with its width
    /// (`scene.image.height`), or the bandwidth of memory with the number of cores.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub with: BTreeMap<String, Vec<Value>>,
    /// What `exponents` are of in place of the values of the axis: a number of the report that they change in proportion, such as
    /// `scene.triangles` of the fineness of a mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measure: Option<String>,
    /// Least value of the axis's range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Greatest value of the axis's range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
    /// How the values of the axis's range are drawn.
    #[serde(default, skip_serializing_if = "Draw::is_default")]
    pub draw: Draw,
}

impl StudyAxis {
    /// What is set where the axis has this value: its path, and the paths that change with it. The base's own value, if it is none of the
    /// axis, leaves these as they are.
    pub fn settings<'a>(&'a self, value: &'a Value) -> impl Iterator<Item = (&'a str, &'a Value)> {
        let number = self.values.iter().position(|other| same(other, value));
        let with =
            self.with.iter().filter_map(move |(path, values)| Some((path.as_str(), values.get(number?)?)));
        std::iter::once((self.path.as_str(), value)).chain(with)
    }
}

/// How values of a range are drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Draw {
    /// Values are drawn evenly; whole numbers where the path takes nothing else, such as `cores`.
    #[default]
    Linear,
    /// Values are drawn evenly in the logarithm; whole numbers where the path takes nothing else.
    Log,
    /// Whole numbers are drawn, evenly.
    Integer,
    /// Powers of two are drawn, evenly in the exponent.
    PowerOfTwo,
}

impl Draw {
    fn is_default(&self) -> bool {
        *self == Draw::Linear
    }
}

/// Which combinations of the axes are run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Sampling {
    /// Every combination is run; the last axis varies fastest.
    #[default]
    Grid,
    /// The first values of all axes are run, then the second ones: axes have as many values each.
    List,
    /// The base is run, and every value of one axis at a time.
    OneAtATime,
    /// Values drawn at random, with a seed, are run.
    Random {
        /// How many points are drawn.
        points: u32,
        /// Seed of the random choices: the same seed draws the same points.
        seed: u64,
    },
}

/// An analysis: its name, or its name with options.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "an analysis is one of \"table\", \"speedup\", \"power_law\", \"limits\", \"exponents\", \"pareto\", \"sensitivity\", \"published\", or {\"kind\": one of these, \"x\": PATH, \"y\": PATH}"
)]
pub enum AnalysisEntry {
    /// An analysis with its usual options.
    Name(AnalysisKind),
    /// An analysis with options of its own.
    Options(Analysis),
}

/// An analysis with its options.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Analysis {
    /// Which analysis it is.
    pub kind: AnalysisKind,
    /// What the analysis is drawn over: an axis or a path in the report. The first axis of numbers if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub x: Option<String>,
    /// What the analysis measures: a path in the report. The study's metric if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub y: Option<String>,
    /// An axis for each of whose values the front of a `pareto` analysis is drawn by itself: points of two scenes do not beat each
    /// other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub each: Option<String>,
}

/// An analysis that can be made of the results of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AnalysisKind {
    /// Every point with its numbers.
    Table,
    /// How many times as fast each point is as the first, and how much of that was to be had.
    Speedup,
    /// The exponent of a power law through the points, with its confidence interval.
    PowerLaw,
    /// What the cycles of each phase go to at the greatest x, beside how many times as fast it is there as at the least.
    Limits,
    /// The exponents of each axis of numbers, the others as they are, for the whole and each phase, with their confidence intervals.
    Exponents,
    /// The points that no other beats in both numbers.
    Pareto,
    /// What each axis does, the greatest first.
    Sensitivity,
    /// What was measured beside what others published, see [`StudyFile::published`].
    Published,
}

impl AnalysisEntry {
    /// The analysis with its options.
    pub fn options(&self) -> Analysis {
        match self {
            AnalysisEntry::Name(kind) => Analysis { kind: *kind, x: None, y: None, each: None },
            AnalysisEntry::Options(analysis) => analysis.clone(),
        }
    }
}

/// Everything that came out of a study: `study.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StudyReport {
    /// Version of this layout.
    pub schema_version: u32,
    /// Version of the simulator.
    pub lrbsim_version: String,
    /// Version of what the simulator's numbers mean: raised when the same inputs give other numbers.
    pub semantics: u32,
    /// The study as it was written.
    pub study: StudyFile,
    /// The points of the study, in its order.
    pub points: Vec<StudyPoint>,
}

/// One point of a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StudyPoint {
    /// A value for each axis.
    pub values: Vec<Value>,
    /// Hash of everything that determines the point; empty if that could not be found out.
    pub key: String,
    /// Why the point has no report.
    pub error: Option<String>,
    /// What was measured at the point; the sources of the machine's numbers are left out.
    pub report: Option<RunReport>,
    /// Small pictures of the point, where the study asks for them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures: Option<PointPictures>,
}

/// Small pictures of a point, each a PNG in base 64 (RFC 4648, §4).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointPictures {
    /// The frame as a viewer sees it.
    pub shaded: String,
    /// Where it differs from the reference, as [`crate::picture::error_png`] draws it; `None` where there is none.
    pub difference: Option<String>,
}

/// What a study cost the hosts that ran it: `host.json` beside `study.json`, which it is no part of.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StudyHosts {
    /// The points that have a report, in the order of the study.
    pub points: Vec<PointHost>,
}

/// What one point of a study cost the host that ran it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PointHost {
    /// Hash of everything that determines the point, as in `study.json`.
    pub key: String,
    /// SHA-256 of the program that ran the point.
    pub build: String,
    /// What the run of the point cost.
    pub host: HostReport,
}

impl StudyHosts {
    /// How many programs have run the points.
    #[must_use]
    pub fn builds(&self) -> usize {
        self.points.iter().map(|point| &point.build).collect::<BTreeSet<_>>().len()
    }

    /// The bytes of `host.json`: a point a line.
    pub fn to_json(&self) -> String {
        let line = |point| serde_json::to_string(point).expect("a point has string keys");
        let points: Vec<String> = self.points.iter().map(|point| format!("\n    {}", line(point))).collect();
        format!("{{\n  \"points\": [{}\n  ]\n}}\n", points.join(","))
    }
}

impl StudyReport {
    /// The study with none of its points.
    pub fn without_points(&self) -> StudyReport {
        StudyReport {
            schema_version: self.schema_version,
            lrbsim_version: self.lrbsim_version.clone(),
            semantics: self.semantics,
            study: self.study.clone(),
            points: Vec::new(),
        }
    }

    /// The bytes of `study.json`: a point a line.
    pub fn to_json(&self) -> String {
        let mut bytes = Vec::new();
        let mut writer = StudyWriter::begin(&mut bytes, self).expect("memory can be written");
        self.points.iter().try_for_each(|point| writer.point(point)).expect("memory can be written");
        writer.end().expect("memory can be written");
        String::from_utf8(bytes).expect("JSON is UTF-8")
    }

    /// The report of the point with `values`.
    pub fn at(&self, values: &[Value]) -> Option<&RunReport> {
        self.points.iter().find(|point| point.values == values)?.report.as_ref()
    }
}

/// Writes `study.json` point by point: a study may have more of them than fit in memory.
#[derive(Debug)]
pub struct StudyWriter<W> {
    out: W,
    /// What stands between the last point that was written and the next.
    gap: &'static str,
    /// What follows the points.
    tail: String,
}

impl<W: Write> StudyWriter<W> {
    /// Begins with everything of `study` but its points.
    pub fn begin(mut out: W, study: &StudyReport) -> io::Result<StudyWriter<W>> {
        let head = study.without_points();
        let text = serde_json::to_string_pretty(&head).expect("a study has string keys");
        let (head, tail) = text.rsplit_once("[]").expect("the points come last, and were taken out");
        write!(out, "{head}[")?;
        Ok(StudyWriter { out, gap: "", tail: tail.to_owned() })
    }

    /// Writes the next point, on a line.
    pub fn point(&mut self, point: &StudyPoint) -> io::Result<()> {
        write!(self.out, "{}\n    ", self.gap)?;
        self.gap = ",";
        serde_json::to_writer(&mut self.out, point).map_err(io::Error::from)
    }

    /// Writes what follows the points.
    pub fn end(mut self) -> io::Result<()> {
        writeln!(self.out, "\n  ]{}", self.tail)?;
        self.out.flush()
    }
}
