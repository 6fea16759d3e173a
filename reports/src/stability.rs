//! Results of the study of stability: what became of every extreme, and where pictures break.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::{Finding, document, paragraphs};
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, round, short};
use crate::table::counted;

/// Version of the layout of [`StabilityReport`].
pub const STABILITY_SCHEMA_VERSION: u32 = 2;

/// Share of the receivers that may be off beside brute force: more, and the arithmetic breaks.
pub const OFF_SHARE_MAX: f64 = 1e-3;

/// Mean error beside shadow rays, past twice that of the rays themselves, from which on the method breaks.
pub const RAYS_MEAN_MAX: f64 = 0.03;

/// Least error of a plot: smaller ones, and none, are drawn here.
const LEAST_DRAWN: f64 = 1e-9;

/// What the columns of a family's table hold, for somebody who has not read the papers.
pub const COLUMNS: [(&str, &str); 15] = [
    (
        "verdict",
        "holds, or what breaks, as said above; no shadow: nothing that is seen lies in shadow; refused: the program draws nothing \
         and says why; failed: it ended by a defect of its own",
    ),
    ("triangles", "triangles of the scene"),
    ("receivers", "pixels that see a surface"),
    ("no part of the light", "receivers whose value is no number, or not from 0 to 1"),
    ("brute force: compared", "receivers that brute force computed too: all, or every n-th of many"),
    ("brute force: max", "the largest difference to brute force, in parts of the light"),
    ("brute force: mean", "the mean difference to brute force"),
    (
        "brute force: off by > 0.001, %",
        "the share of these receivers that are further than 0.001 off brute force",
    ),
    (
        "rounded scene: max",
        "the largest difference to brute force of the scene after its numbers were rounded to 32 bits: what is left is the \
         rounding of the drawing itself",
    ),
    ("rays: compared", "receivers that shadow rays were cast from: all, or every n-th of many"),
    (
        "rays: mean",
        "the sum of the differences to the rays, divided by the number of receivers that the rays find in shadow or penumbra",
    ),
    ("rays: max", "the largest difference to the rays"),
    (
        "rays: off by > 0.25, %",
        "the share of the receivers that either picture has in shadow or penumbra that are off by a quarter of the light",
    ),
    (
        "rays' own error",
        "how far the rays themselves may be off, measured as the mean is: by how much two halves of them differ",
    ),
    ("sums: mean", "as `rays: mean`, for the picture that adds up hidden parts, whether they overlap or not"),
];

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
    /// Algorithm that drew the pictures that stand beside shadow rays, with all of its options.
    pub algorithm: String,
    /// Algorithm that drew the pictures that stand beside brute force, which sums hidden parts as this does.
    pub sums: String,
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
    /// Differences of the sums to the same method by brute force in 64 bits, of the scene as it was given.
    pub brute_force: Off,
    /// Differences of the sums to the same method by brute force in 64 bits, of the 32-bit numbers that kernels get.
    pub rounded: Off,
    /// Differences to shadow rays.
    pub rays: OffRays,
    /// Differences of the sums to shadow rays.
    pub rays_of_sums: OffRays,
    /// The picture as PNG in base 64 (RFC 4648, §4); `None` where it is too large to be looked at.
    pub picture: Option<String>,
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
    /// Mean error from which on the method breaks: [`RAYS_MEAN_MAX`], past what the rays themselves may be off by.
    fn mean_max(&self) -> f64 {
        RAYS_MEAN_MAX + 2.0 * self.reference_mean
    }

    fn breaks(&self) -> bool {
        self.mean > self.mean_max()
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

    fn warning(&self) -> Option<&str> {
        self.measured()?.warnings.first().map(String::as_str)
    }

    fn refusal(&self) -> Option<&str> {
        if let Outcome::Refused(why) = &self.outcome { Some(why) } else { None }
    }

    fn failure(&self) -> Option<&str> {
        if let Outcome::Failed(why) = &self.outcome { Some(why) } else { None }
    }

    /// What became of the point, in a word or two.
    pub fn verdict(&self) -> &'static str {
        let is_lit = self.measured().is_some_and(|measured| measured.rays.shadowed == 0);
        match (&self.outcome, self.arithmetic_breaks(), self.method_breaks()) {
            (Outcome::Refused(_), ..) => "refused",
            (Outcome::Failed(_), ..) => "failed",
            (_, true, true) => "both break",
            (_, true, false) => "arithmetic breaks",
            (_, false, true) => "method breaks",
            (_, false, false) if is_lit => "no shadow",
            (_, false, false) => "holds",
        }
    }
}

impl StabilityFamily {
    /// Values at which `breaks` holds, as people read them; `None` if there is none.
    fn breaking(&self, breaks: impl Fn(&StabilityPoint) -> bool) -> Option<String> {
        const SHOWN: usize = 6;
        let at: Vec<String> =
            self.points.iter().filter(|point| breaks(point)).map(|point| round(point.x)).collect();
        match at.len() {
            0 => None,
            all if all == self.points.len() && all > 1 => Some("every point".to_owned()),
            more if more > SHOWN => Some(format!("{} and {} more", at[..SHOWN].join(", "), more - SHOWN)),
            _ => Some(at.join(", ")),
        }
    }

    /// The greatest of a number over the points that have a picture, and where that is, as people read it.
    fn worst(&self, number: impl Fn(&Measured) -> f64) -> Option<(f64, String)> {
        let numbers = || self.points.iter().filter_map(|point| Some((number(point.measured()?), point.x)));
        let (greatest, at) = numbers().reduce(|worst, next| if next.0 > worst.0 { next } else { worst })?;
        let everywhere = numbers().count() > 1 && numbers().all(|(number, _)| number == greatest);
        Some((greatest, if everywhere { "at every point".to_owned() } else { format!("at {}", round(at)) }))
    }

    /// What is seen in the family: sentences.
    pub fn seen(&self) -> Vec<String> {
        let drawn: Vec<&Measured> = self.points.iter().filter_map(StabilityPoint::measured).collect();
        let mut seen = Vec::new();
        if let Some((max, at)) = self.worst(|measured| measured.brute_force.max) {
            let receivers: u64 = drawn.iter().map(|measured| measured.brute_force.receivers).sum();
            let off: u64 = drawn.iter().map(|measured| measured.brute_force.off).sum();
            let most = format!("{} of the light ({at})", short(max));
            seen.push(match self.breaking(StabilityPoint::arithmetic_breaks) {
                None if off == 0 => {
                    format!("The arithmetic holds everywhere: no receiver that was compared is off brute force by more than {most}.")
                }
                None => format!(
                    "The arithmetic holds: {off} of {} are off brute force by more than 0.001, at most by {most}, which \
                     rounding at an edge explains.",
                    counted(receivers, "receiver")
                ),
                Some(at) => format!("The arithmetic breaks at {at}: receivers are off brute force by up to {most}."),
            });
        }
        let of_rays = |number: &dyn Fn(&OffRays) -> f64| self.worst(|measured| number(&measured.rays));
        if let (Some((mean, at)), Some((max, max_at))) =
            (of_rays(&|rays| rays.mean), of_rays(&|rays| rays.max))
        {
            let is_outlier = max > 0.5;
            let (mean, max) = (format!("{} ({at})", short(mean)), format!("{} ({max_at})", short(max)));
            seen.push(match self.breaking(StabilityPoint::method_breaks) {
                None if is_outlier => format!(
                    "The method holds: beside shadow rays, its mean error is at most {mean}; but a receiver is off by {max}."
                ),
                None => format!(
                    "The method holds: beside shadow rays, its mean error is at most {mean}, and no receiver that was compared is \
                     off by more than {max}."
                ),
                Some(broken) => format!(
                    "The method breaks at {broken}: beside shadow rays, its mean error reaches {mean}, and a receiver is off by {max}."
                ),
            });
        }
        let sums_break =
            |point: &StabilityPoint| point.measured().is_some_and(|measured| measured.rays_of_sums.breaks());
        if let Some(at) = self.breaking(|point| sums_break(point) && !point.method_breaks()) {
            seen.push(format!(
                "Sums alone are over that limit at {at}, where what hides the lamp overlaps; they are not judged by it."
            ));
        }
        if let Some(at) = self.breaking(|point| point.method_breaks() && point.warning().is_none()) {
            seen.push(format!("It breaks without a warning at {at}."));
        }
        seen.extend(self.said("warns at", StabilityPoint::warning));
        seen.extend(self.said("refuses", StabilityPoint::refusal));
        seen.extend(self.said("fails, by a defect of its own, at", StabilityPoint::failure));
        seen
    }

    /// What the program `does` to the points of which it said something, and what it said of the first of them: a sentence.
    fn said(&self, does: &str, what: fn(&StabilityPoint) -> Option<&str>) -> Option<String> {
        let at = self.breaking(|point| what(point).is_some())?;
        let (x, first) = self.points.iter().find_map(|point| Some((point.x, what(point)?)))?;
        let of = if at == round(x) { String::new() } else { format!(" at {}", round(x)) };
        Some(format!("The program {does} {at}; its words{of}: \u{201c}{first}\u{201d}."))
    }

    fn sheet(&self) -> Sheet {
        let columns = [self.axis.as_str()].into_iter().chain(COLUMNS.map(|(name, _)| name));
        let row = |point: &StabilityPoint| {
            let number = |number: &dyn Fn(&Measured) -> f64| Cell::maybe(point.measured().map(number));
            vec![
                Cell::Chosen(point.x),
                Cell::Text(point.verdict().to_owned()),
                number(&|m| m.triangles as f64),
                number(&|m| m.receivers as f64),
                number(&|m| m.no_part as f64),
                number(&|m| m.brute_force.receivers as f64),
                number(&|m| m.brute_force.max),
                number(&|m| m.brute_force.mean),
                number(&|m| 100.0 * m.brute_force.share()),
                number(&|m| m.rounded.max),
                number(&|m| m.rays.receivers as f64),
                number(&|m| m.rays.mean),
                number(&|m| m.rays.max),
                number(&|m| 100.0 * m.rays.off_by_quarter),
                number(&|m| m.rays.reference_mean),
                number(&|m| m.rays_of_sums.mean),
            ]
        };
        Sheet { columns: columns.map(str::to_owned).collect(), rows: self.points.iter().map(row).collect() }
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
        let series = vec![
            series("brute force: max", Look::Line, &|m| m.brute_force.max),
            series("rays: mean", Look::Line, &|m| m.rays.mean),
            series("sums: mean", Look::Line, &|m| m.rays_of_sums.mean),
            series("rays' own error", Look::Dashed, &|m| m.rays.reference_mean),
            series("limit of rays: mean", Look::Dashed, &|m| m.rays.mean_max()),
        ];
        let (mut x, mut y) = (Axis::new(&self.axis, true), Axis::new("parts of the light", true));
        if self.points.iter().any(|point| point.x == 0.0 && point.measured().is_some()) {
            x.named.push((zero, "0".to_owned()));
        }
        if series.iter().flat_map(|series| &series.points).any(|point| point.1 == LEAST_DRAWN) {
            y.named.push((LEAST_DRAWN, format!("\u{2264} {}", round(LEAST_DRAWN))));
        }
        Some(Plot::Lines(Lines { title: format!("{}: error", self.title), x, y, series }))
    }

    fn finding(&self) -> Finding {
        Finding {
            name: self.id.clone(),
            title: self.title.clone(),
            notes: self.seen(),
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
             scenes get extreme: in each family of scenes below, one thing goes from the plain to the absurd. Under each \
             picture stand its value and the verdict on that scene."
                .to_owned(),
            "Unless a family says otherwise, the scene is a level floor of 4 by 4 with a block on it and a slanted sheet over it, and \
             the lamp is a ball of radius 0.25 above. A size of the scene is the side of the floor; its diagonal is 1.45 sizes. \
             Pictures are shaded: full shadow is dark gray, and where nothing is seen is blue-gray."
                .to_owned(),
            "The method is soft irregular shadow mapping (Johnson et al. 2009), drawn in 32-bit numbers. From the middle of the lamp \
             it finds the outlines of all things, and for each pixel which part of the lamp, as that pixel sees it, lies behind each \
             outline. So it can be wrong where other parts of the lamp see other outlines than the middle does: where the lamp \
             is large beside its distance to what hides it. Triangles that cut the lamp itself are an exception: what each of them \
             hides is found for every pixel by itself."
                .to_owned(),
            format!(
                "Every scene is drawn twice. Once hidden parts of the lamp are added up even where they overlap, and the picture is \
                 compared with brute force, which adds up the same with every edge for every pixel and in 64-bit numbers: \
                 differences are rounding, or faults of the program. Once, as users get it by default, 64 points of the lamp are \
                 each found hidden or not, and the picture is compared with {} shadow rays from each pixel, which find what is \
                 really seen of the lamp: differences are what the method leaves out, and that 64 points are few. Where nothing \
                 overlaps, sums are the better of the two. All errors are in parts of the light. Only the second kind is shown \
                 below: that the arithmetic breaks is a verdict on the first, that the method breaks one on the picture shown.",
                self.samples
            ),
            format!(
                "The arithmetic is said to break where more than {} % of the receivers (pixels that see a surface) are off \
                 brute force by more than 0.001, or where any value is no number or not from 0 to 1. The method is said to \
                 break where its mean error beside the rays, over receivers in shadow or penumbra, is more than {limit} + 2 x \
                 the rays' own error: {} where that is 0.002.",
                round(100.0 * OFF_SHARE_MAX),
                round(RAYS_MEAN_MAX + 2.0 * 0.002),
                limit = round(RAYS_MEAN_MAX),
            ),
            format!(
                "In the plots, `brute force: max` is the largest difference of the sums to brute force; `rays: mean` and `sums: mean` are \
                 the mean errors of the default and of the sums beside the rays; `rays' own error` is how far these may be off \
                 themselves; above the `limit of rays: mean` the method is said to break. Both axes are logarithmic; a value of 0 \
                 stands at the left end, and errors below {}, where there are any, at the bottom.",
                round(LEAST_DRAWN)
            ),
            format!(
                "In the program's words, the sums are `{}` and the default is `{}`.",
                self.sums, self.algorithm
            ),
        ]
    }

    /// Which families break, and at which values: sentences.
    fn summary(&self) -> Vec<String> {
        let broken: Vec<&StabilityFamily> = self
            .families
            .iter()
            .filter(|family| {
                family.points.iter().any(|point| point.arithmetic_breaks() || point.method_breaks())
            })
            .collect();
        let hold = self.families.len() - broken.len();
        let mut sentences =
            vec![format!("{hold} of {} families hold at every value that is drawn.", self.families.len())];
        for family in broken {
            type Breaks = fn(&StabilityPoint) -> bool;
            let kinds: [(&str, Breaks); 2] = [
                ("the arithmetic breaks", StabilityPoint::arithmetic_breaks),
                ("the method breaks", StabilityPoint::method_breaks),
            ];
            let at = kinds
                .into_iter()
                .filter_map(|(what, breaks)| Some(format!("{what} at {}", family.breaking(breaks)?)));
            sentences.push(format!("{}: {}.", family.title, at.collect::<Vec<_>>().join("; ")));
        }
        sentences
            .push("The numbers are the worst of each family; values are of what is varied in it.".to_owned());
        sentences
    }

    /// Where each family breaks, and then each family.
    pub fn findings(&self) -> Vec<Finding> {
        let columns = [
            "family",
            "brute force: max",
            "rays: mean",
            "arithmetic breaks at",
            "method breaks at",
            "warned at",
            "refused at",
        ];
        let row = |family: &StabilityFamily| {
            let at = |breaks: &dyn Fn(&StabilityPoint) -> bool| {
                Cell::Text(family.breaking(breaks).unwrap_or_else(|| "nowhere".to_owned()))
            };
            vec![
                Cell::Text(family.title.clone()),
                Cell::maybe(family.worst(|m| m.brute_force.max).map(|worst| worst.0)),
                Cell::maybe(family.worst(|m| m.rays.mean).map(|worst| worst.0)),
                at(&StabilityPoint::arithmetic_breaks),
                at(&StabilityPoint::method_breaks),
                at(&|point| point.warning().is_some()),
                at(&|point| point.refusal().is_some()),
            ]
        };
        let sheet = Sheet {
            columns: columns.map(str::to_owned).to_vec(),
            rows: self.families.iter().map(row).collect(),
        };
        let whole = Finding {
            name: "breaks".to_owned(),
            title: "Where it breaks".to_owned(),
            notes: self.summary(),
            sheet,
            plot: None,
        };
        std::iter::once(whole).chain(self.families.iter().map(StabilityFamily::finding)).collect()
    }

    /// The study as one Markdown text.
    pub fn markdown(&self) -> String {
        let columns = COLUMNS.iter().map(|(name, meaning)| format!("* {name}: {meaning}\n"));
        let introduction = paragraphs(&self.introduction()) + "\n" + &columns.collect::<String>();
        let about = std::iter::once(String::new())
            .chain(self.families.iter().map(|family| format!("{} {}\n\n", family.varied, family.meaning)));
        document("stability", &introduction, &self.findings(), about)
    }

    /// Points with a picture or without, and how many of them failed.
    pub fn count(&self) -> (usize, usize) {
        let points = || self.families.iter().flat_map(|family| &family.points);
        let failed = points().filter(|point| matches!(point.outcome, Outcome::Failed(_))).count();
        (points().count(), failed)
    }
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
            rays_of_sums: rays,
            picture: None,
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
            sums: "sism:overlap=sum".to_owned(),
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
            seen.contains("arithmetic breaks at 1e6:") && seen.contains("method breaks at 1e7:"),
            "{seen}"
        );
        assert!(seen.contains("refuses 1e9; its words: \u{201c}too large\u{201d}"), "{seen}");
        assert!(seen.contains("without a warning at 1e7"), "{seen}");
        assert_eq!(report.count(), (5, 0));
    }

    #[test]
    fn every_column_is_explained_and_every_row_has_a_cell_for_it() {
        let sheet = report(vec![point(1.0, 0, 0.0)]).families[0].sheet();
        assert_eq!(sheet.columns.len(), sheet.rows[0].len());
        assert!(sheet.columns[1..].iter().zip(COLUMNS).all(|(column, (name, _))| column == name));
    }

    #[test]
    fn a_report_is_read_as_it_was_written_and_drawn_without_zeros() {
        let report = report(vec![point(0.0, 0, 0.0), point(1.0, 0, 0.0)]);
        let read: StabilityReport = serde_json::from_str(&report.to_json()).expect("own JSON");
        assert_eq!(read, report);
        let plot = report.findings()[1].plot.clone().expect("a plot").svg_without_font();
        assert!(!plot.contains("NaN"));
        // 0 has its name at a place that a logarithm has for it, on both axes.
        assert!(plot.contains("\n0\n") && plot.contains("\u{2264} 1e-9"), "{plot}");
        assert!(report.markdown().contains("All is larger. Nothing may change."));
    }
}
