//! Results of the study of stability: what became of every extreme, and where pictures break.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::Finding;
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, short};
use crate::table::counted;

/// Version of the layout of [`StabilityReport`].
pub const STABILITY_SCHEMA_VERSION: u32 = 1;

/// Share of the receivers that may be off beside brute force: more, and the arithmetic breaks.
pub const OFF_SHARE_MAX: f64 = 1e-3;

/// Mean error beside shadow rays, past twice that of the rays themselves, from which on the method breaks.
pub const RAYS_MEAN_MAX: f64 = 0.03;

/// Least error of a plot: smaller ones, and none, are drawn here.
const LEAST_DRAWN: f64 = 1e-9;

/// Everything that came out of the study: `stability.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StabilityReport {
    /// Version of this layout.
    pub schema_version: u32,
    /// Version of the simulator.
    pub lrbsim_version: String,
    /// Version of what the simulator's numbers mean.
    pub semantics: u32,
    /// Algorithm that drew the pictures, with all of its options.
    pub algorithm: String,
    /// Shadow rays of a receiver.
    pub samples: u32,
    /// The families of points, in each of which one thing is varied.
    pub families: Vec<StabilityFamily>,
}

/// A family of points, in which one thing is varied.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StabilityFamily {
    /// Name of the family, as in the names of its files.
    pub id: String,
    /// The family for people, as a heading.
    pub title: String,
    /// What is varied in the family, with its unit.
    pub axis: String,
    /// What is varied in the family, in a sentence.
    pub varied: String,
    /// What the family asks of the program, in a sentence.
    pub meaning: String,
    /// The points of the family, in order.
    pub points: Vec<StabilityPoint>,
}

/// One point of a family.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StabilityPoint {
    /// Value of what is varied.
    pub x: f64,
    /// What became of the point.
    pub outcome: Outcome,
}

/// What became of a point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The picture was drawn and compared.
    Measured(Box<Measured>),
    /// The program refused the scene, and said this.
    Refused(String),
    /// The program ended with a defect of its own, and said this.
    Failed(String),
}

/// How far one picture is from what is right.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Triangles of the scene.
    pub triangles: u64,
    /// Receivers: pixels that see a surface.
    pub receivers: u64,
    /// Receivers whose visibility is no number or not in [0, 1].
    pub no_part: u64,
    /// Differences to the same method by brute force in 64 bits, of the scene as it was given.
    pub brute_force: Off,
    /// Differences to the same method by brute force in 64 bits, of the 32-bit numbers that kernels get.
    pub rounded: Off,
    /// Differences to shadow rays.
    pub rays: OffRays,
    /// What the program warned of.
    pub warnings: Vec<String>,
}

/// Differences to brute force, in parts of the light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Off {
    /// Receivers that were compared.
    pub receivers: u64,
    /// Largest difference to brute force.
    pub max: f64,
    /// Mean difference to brute force.
    pub mean: f64,
    /// Receivers that are off by more than 0.001.
    pub off: u64,
}

/// Differences to shadow rays, in parts of the light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OffRays {
    /// Receivers that were compared with rays.
    pub receivers: u64,
    /// Receivers that the rays find in shadow or penumbra.
    pub shadowed: u64,
    /// Sum of the differences to the rays, divided by the number of receivers in shadow or penumbra [atty06, §5.2.1].
    pub mean: f64,
    /// Largest difference to the rays.
    pub max: f64,
    /// Share of the receivers in shadow or penumbra in either picture that are off by more than 0.25.
    pub off_by_quarter: f64,
    /// The rays' own mean error, measured as the mean is.
    pub reference_mean: f64,
}

impl Off {
    /// Whether more receivers are off than rounding explains: more than [`OFF_SHARE_MAX`] of them, and more than one.
    fn breaks(&self) -> bool {
        self.off as f64 > OFF_SHARE_MAX * self.receivers as f64 && (self.off > 1 || self.receivers == 1)
    }

    fn share(&self) -> f64 {
        self.off as f64 / self.receivers.max(1) as f64
    }
}

impl OffRays {
    /// Whether the method is off by more than [`RAYS_MEAN_MAX`], past what the rays themselves may be off by.
    fn breaks(&self) -> bool {
        self.mean > RAYS_MEAN_MAX + 2.0 * self.reference_mean
    }
}

impl StabilityPoint {
    fn measured(&self) -> Option<&Measured> {
        match &self.outcome {
            Outcome::Measured(measured) => Some(measured),
            Outcome::Refused(_) | Outcome::Failed(_) => None,
        }
    }

    /// Whether the program is at fault: a crash, no part of the light, or more than rounding off brute force.
    fn arithmetic_breaks(&self) -> bool {
        match &self.outcome {
            Outcome::Measured(measured) => measured.no_part > 0 || measured.brute_force.breaks(),
            Outcome::Refused(_) => false,
            Outcome::Failed(_) => true,
        }
    }

    fn method_breaks(&self) -> bool {
        self.measured().is_some_and(|measured| measured.rays.breaks())
    }

    /// What the program said of the point.
    fn said(&self) -> String {
        match &self.outcome {
            Outcome::Measured(measured) => {
                let warnings = measured.warnings.iter().map(|warning| format!("warns: {warning}"));
                warnings.collect::<Vec<_>>().join("; ")
            }
            Outcome::Refused(why) => format!("refuses: {why}"),
            Outcome::Failed(why) => format!("fails: {why}"),
        }
    }

    fn verdict(&self) -> &'static str {
        match (&self.outcome, self.arithmetic_breaks(), self.method_breaks()) {
            (Outcome::Refused(_), ..) => "refused",
            (Outcome::Failed(_), ..) => "failed",
            (_, true, true) => "both break",
            (_, true, false) => "arithmetic breaks",
            (_, false, true) => "method breaks",
            (_, false, false) => "holds",
        }
    }
}

impl StabilityFamily {
    /// Values at which `breaks` holds, as people read them; `None` if there is none.
    fn breaking(&self, breaks: impl Fn(&StabilityPoint) -> bool) -> Option<String> {
        const SHOWN: usize = 6;
        let at: Vec<String> =
            self.points.iter().filter(|point| breaks(point)).map(|point| label(point.x)).collect();
        match at.len() {
            0 => None,
            all if all == self.points.len() && all > 1 => Some("every point".to_owned()),
            more if more > SHOWN => Some(format!("{} and {} more", at[..SHOWN].join(", "), more - SHOWN)),
            _ => Some(at.join(", ")),
        }
    }

    /// The greatest of a number over the points that have a picture, and where that is.
    fn worst(&self, number: impl Fn(&Measured) -> f64) -> Option<(f64, f64)> {
        let numbers = self.points.iter().filter_map(|point| Some((number(point.measured()?), point.x)));
        numbers.reduce(|worst, next| if next.0 > worst.0 { next } else { worst })
    }

    /// What is seen in the family: sentences.
    pub fn seen(&self) -> Vec<String> {
        let mut seen = Vec::new();
        let drawn: Vec<&Measured> = self.points.iter().filter_map(StabilityPoint::measured).collect();
        if let Some((max, at)) = self.worst(|measured| measured.brute_force.max) {
            let receivers: u64 = drawn.iter().map(|measured| measured.brute_force.receivers).sum();
            let off: u64 = drawn.iter().map(|measured| measured.brute_force.off).sum();
            seen.push(match self.breaking(StabilityPoint::arithmetic_breaks) {
                None if off == 0 => format!(
                    "The arithmetic holds everywhere: no receiver is off brute force by more than {} of the light (at {}).",
                    short(max),
                    label(at)
                ),
                None => format!(
                    "The arithmetic holds: {off} of {} are off brute force by more than 0.001 of the light, which \
                     rounding at an edge explains.",
                    counted(receivers, "receiver")
                ),
                Some(at) => format!("The arithmetic breaks at {at}: receivers are off brute force by up to {}.", short(max)),
            });
        }
        if let Some((mean, at)) = self.worst(|measured| measured.rays.mean) {
            let least = drawn.iter().map(|measured| measured.rays.mean).fold(f64::INFINITY, f64::min);
            seen.push(match self.breaking(StabilityPoint::method_breaks) {
                None => format!(
                    "Beside shadow rays, the mean error is from {} to {} (at {}).",
                    short(least),
                    short(mean),
                    label(at)
                ),
                Some(broken) => format!(
                    "The method itself breaks at {broken}: beside shadow rays, its mean error is up to {} (at {}).",
                    short(mean),
                    label(at)
                ),
            });
        }
        let warned =
            |point: &StabilityPoint| point.measured().is_some_and(|measured| !measured.warnings.is_empty());
        if let Some(at) = self.breaking(warned) {
            seen.push(format!("The program warns at {at}."));
        }
        let silent = |point: &StabilityPoint| point.method_breaks() && !warned(point);
        if let Some(at) = self.breaking(silent) {
            seen.push(format!("It breaks without a warning at {at}."));
        }
        if let Some(at) = self.breaking(|point| matches!(point.outcome, Outcome::Refused(_))) {
            seen.push(format!("The program refuses {at}."));
        }
        if let Some(at) = self.breaking(|point| matches!(point.outcome, Outcome::Failed(_))) {
            seen.push(format!("The program fails at {at}: a defect."));
        }
        seen
    }

    fn sheet(&self) -> Sheet {
        let columns = [
            self.axis.as_str(),
            "triangles",
            "receivers",
            "not in [0, 1]",
            "brute force: max",
            "brute force: mean",
            "off by > 0.001, %",
            "32-bit input: max",
            "rays: mean",
            "rays: max",
            "off by > 0.25, %",
            "rays' own error",
            "verdict",
            "the program says",
        ];
        let row = |point: &StabilityPoint| {
            let measured = point.measured();
            let cell = |number: &dyn Fn(&Measured) -> f64| Cell::maybe(measured.map(number));
            let said = match point.said() {
                said if said.is_empty() => Cell::Missing,
                said => Cell::Text(said),
            };
            vec![
                Cell::Number(point.x),
                cell(&|m| m.triangles as f64),
                cell(&|m| m.receivers as f64),
                cell(&|m| m.no_part as f64),
                cell(&|m| m.brute_force.max),
                cell(&|m| m.brute_force.mean),
                cell(&|m| 100.0 * m.brute_force.share()),
                cell(&|m| m.rounded.max),
                cell(&|m| m.rays.mean),
                cell(&|m| m.rays.max),
                cell(&|m| 100.0 * m.rays.off_by_quarter),
                cell(&|m| m.rays.reference_mean),
                Cell::Text(point.verdict().to_owned()),
                said,
            ]
        };
        Sheet { columns: columns.map(str::to_owned).to_vec(), rows: self.points.iter().map(row).collect() }
    }

    /// Error against the extreme, both logarithmic; a value of 0 is drawn a decade below the least other.
    fn plot(&self) -> Option<Plot> {
        let positive = self.points.iter().map(|point| point.x).filter(|x| *x > 0.0);
        let zero = positive.reduce(f64::min)? / 10.0;
        let series = |name: &str, look, number: &dyn Fn(&Measured) -> f64| {
            let mut points: Vec<(f64, f64)> = self
                .points
                .iter()
                .filter_map(|point| Some((point.x.max(zero), number(point.measured()?).max(LEAST_DRAWN))))
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Series { name: name.to_owned(), look, points }
        };
        let axis = |label: &str| Axis { label: label.to_owned(), log: true };
        Some(Plot::Lines(Lines {
            title: format!("{}: error", self.title),
            x: axis(&self.axis),
            y: axis("parts of the light"),
            series: vec![
                series("brute force, max", Look::Line, &|m| m.brute_force.max),
                series("brute force, mean", Look::Line, &|m| m.brute_force.mean),
                series("rays, mean", Look::Line, &|m| m.rays.mean),
                series("error of the rays", Look::Dashed, &|m| m.rays.reference_mean),
            ],
        }))
    }

    fn finding(&self) -> Finding {
        let mut notes = self.seen();
        if self.points.iter().any(|point| point.x == 0.0) {
            notes.push("In the plot, 0 stands at the left end.".to_owned());
        }
        Finding {
            name: self.id.clone(),
            title: self.title.clone(),
            notes,
            sheet: self.sheet(),
            plot: self.plot(),
        }
    }
}

impl StabilityReport {
    /// The bytes of `stability.json`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report has string keys and finite numbers") + "\n"
    }

    /// What the study is about, for somebody who reads of it for the first time: paragraphs.
    pub fn introduction(&self) -> Vec<String> {
        vec![
            "A picture of soft shadows says for every pixel what part of the lamp is seen from there: 1 in the light, 0 in \
             full shadow, in between in the penumbra. This page shows how far the pictures of lrbsim can be trusted where \
             scenes get extreme: in each family of scenes below, one thing goes from the plain to the absurd."
                .to_owned(),
            format!(
                "Every picture is compared twice. Brute force computes what {} computes, with every edge for every pixel and \
                 in 64-bit numbers: differences to it are rounding, or faults of the program. Shadow rays, {} from each \
                 pixel, find what is really seen of the lamp: differences to them are what the method leaves out, such as \
                 shadows that overlap. All errors are in parts of the light.",
                self.algorithm, self.samples
            ),
            format!(
                "The arithmetic is said to break where more than {} % of the receivers (pixels that see a surface) are off \
                 brute force by more than 0.001, or where any value is no number or not from 0 to 1. The method is said to \
                 break where its mean error beside the rays, over receivers in shadow or penumbra, is more than {} past \
                 twice the rays' own error. Where there are many receivers, every so-manyth is compared.",
                label(100.0 * OFF_SHARE_MAX),
                label(RAYS_MEAN_MAX)
            ),
        ]
    }

    /// Where each family breaks, and then each family.
    pub fn findings(&self) -> Vec<Finding> {
        let columns = [
            "family",
            "points",
            "from",
            "to",
            "brute force: max",
            "rays: mean",
            "arithmetic breaks at",
            "method breaks at",
            "warned at",
            "refused at",
        ];
        let row = |family: &StabilityFamily| {
            let xs = || family.points.iter().map(|point| point.x);
            let at = |breaks: &dyn Fn(&StabilityPoint) -> bool| {
                Cell::Text(family.breaking(breaks).unwrap_or_else(|| "nowhere".to_owned()))
            };
            vec![
                Cell::Text(family.title.clone()),
                Cell::Number(family.points.len() as f64),
                Cell::maybe(xs().reduce(f64::min)),
                Cell::maybe(xs().reduce(f64::max)),
                Cell::maybe(family.worst(|m| m.brute_force.max).map(|worst| worst.0)),
                Cell::maybe(family.worst(|m| m.rays.mean).map(|worst| worst.0)),
                at(&StabilityPoint::arithmetic_breaks),
                at(&StabilityPoint::method_breaks),
                at(&|point| point.measured().is_some_and(|m| !m.warnings.is_empty())),
                at(&|point| matches!(point.outcome, Outcome::Refused(_))),
            ]
        };
        let sheet = Sheet {
            columns: columns.map(str::to_owned).to_vec(),
            rows: self.families.iter().map(row).collect(),
        };
        let whole = Finding {
            name: "breaks".to_owned(),
            title: "Where it breaks".to_owned(),
            notes: Vec::new(),
            sheet,
            plot: None,
        };
        std::iter::once(whole).chain(self.families.iter().map(StabilityFamily::finding)).collect()
    }

    /// The study as one Markdown text.
    pub fn markdown(&self) -> String {
        let mut text = String::from("# stability\n");
        for paragraph in self.introduction() {
            text.push_str(&format!("\n{paragraph}\n"));
        }
        let about = std::iter::once(String::new())
            .chain(self.families.iter().map(|family| format!("{} {}\n\n", family.varied, family.meaning)));
        for (finding, about) in self.findings().iter().zip(about) {
            text.push_str(&format!("\n## {}\n\n{about}{}", finding.title, finding.sheet.markdown()));
            for note in &finding.notes {
                text.push_str(&format!("\n{note}\n"));
            }
        }
        text
    }

    /// Points with a picture or without, and how many of them failed.
    pub fn count(&self) -> (usize, usize) {
        let points = || self.families.iter().flat_map(|family| &family.points);
        let failed = points().filter(|point| matches!(point.outcome, Outcome::Failed(_))).count();
        (points().count(), failed)
    }
}

/// A value of what is varied, as people read it: no row of zeros.
fn label(x: f64) -> String {
    if x != 0.0 && !(1e-3..1e5).contains(&x.abs()) { format!("{x:e}") } else { x.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f64, off: u64, rays: f64) -> StabilityPoint {
        let brute_force = Off { receivers: 1000, max: off as f64 * 0.1, mean: 0.0, off };
        let rays = OffRays {
            receivers: 1000,
            shadowed: 100,
            mean: rays,
            max: rays,
            off_by_quarter: 0.0,
            reference_mean: 0.001,
        };
        let measured = Measured {
            triangles: 2,
            receivers: 1000,
            no_part: 0,
            brute_force,
            rounded: brute_force,
            rays,
            warnings: Vec::new(),
        };
        StabilityPoint { x, outcome: Outcome::Measured(Box::new(measured)) }
    }

    fn report(points: Vec<StabilityPoint>) -> StabilityReport {
        let family = StabilityFamily {
            id: "scale".to_owned(),
            title: "Scale".to_owned(),
            axis: "scale".to_owned(),
            varied: "All is larger.".to_owned(),
            meaning: "Nothing may change.".to_owned(),
            points,
        };
        StabilityReport {
            schema_version: STABILITY_SCHEMA_VERSION,
            lrbsim_version: String::new(),
            semantics: 1,
            algorithm: "sism".to_owned(),
            samples: 256,
            families: vec![family],
        }
    }

    #[test]
    fn a_family_breaks_where_its_points_do() {
        let refused = StabilityPoint { x: 1e9, outcome: Outcome::Refused("too large".to_owned()) };
        let report = report(vec![
            point(0.0, 0, 0.01),
            point(1.0, 1, 0.02),
            point(1e6, 2, 0.031),
            point(1e7, 0, 0.04),
            refused,
        ]);
        let verdicts: Vec<_> = report.families[0].points.iter().map(StabilityPoint::verdict).collect();
        assert_eq!(verdicts, ["holds", "holds", "arithmetic breaks", "method breaks", "refused"]);
        let seen = report.families[0].seen().join(" ");
        assert!(
            seen.contains("arithmetic breaks at 1e6:") && seen.contains("method itself breaks at 1e7:"),
            "{seen}"
        );
        assert!(seen.contains("refuses 1e9") && seen.contains("without a warning at 1e7"), "{seen}");
        assert_eq!(report.count(), (5, 0));
    }

    #[test]
    fn a_report_is_read_as_it_was_written_and_drawn_without_zeros() {
        let report = report(vec![point(0.0, 0, 0.0), point(1.0, 0, 0.0)]);
        let read: StabilityReport = serde_json::from_str(&report.to_json()).expect("own JSON");
        assert_eq!(read, report);
        let plot = report.findings()[1].plot.clone().expect("a plot");
        assert!(!plot.svg_without_font().contains("NaN"));
        assert!(report.markdown().contains("All is larger. Nothing may change."));
    }
}
