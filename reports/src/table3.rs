//! Results of the study of Table 3 of Johnson et al. 2009: the visual qualities of each method, decided by measurement.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::{Finding, document, paragraphs};
use crate::plot::{Axis, Lines, Look, Plot, Series};
use crate::sheet::{Cell, Sheet, round};

/// Version of the layout of [`Table3Report`].
pub const TABLE3_SCHEMA_VERSION: u32 = 1;

/// A column of Table 3.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quality {
    /// There is a penumbra inside of the hard shadow.
    InnerPenumbra,
    /// There is a penumbra outside of the hard shadow.
    OuterPenumbra,
    /// What several occluders hide of the light is told where they overlap.
    AccurateOverlap,
    /// No sawtooth, no bands, and no flicker when the light moves.
    NoAliasing,
    /// Full shadow is whole.
    NoLightLeaks,
    /// Fine detail of occluders is in the shadow.
    AllFrequencies,
}

impl Quality {
    /// All qualities, in the order of Table 3.
    pub const ALL: [Quality; 6] = [
        Quality::InnerPenumbra,
        Quality::OuterPenumbra,
        Quality::AccurateOverlap,
        Quality::NoAliasing,
        Quality::NoLightLeaks,
        Quality::AllFrequencies,
    ];

    /// The least and the greatest figure that a method with this quality may have; [`Quality::limit`] says why.
    ///
    /// They were chosen for what an eye notices.
    pub fn limits(self) -> (f64, f64) {
        match self {
            Quality::InnerPenumbra | Quality::OuterPenumbra => (0.5, f64::INFINITY),
            Quality::AccurateOverlap => (0.0, 0.02),
            Quality::NoAliasing => (0.0, 0.005),
            Quality::NoLightLeaks => (0.0, 0.01),
            Quality::AllFrequencies => (0.5, 2.0),
        }
    }

    /// Whether a method with this figure has the quality.
    pub fn holds(self, figure: f64) -> bool {
        let (least, most) = self.limits();
        (least..=most).contains(&figure)
    }

    /// The figure that counts among those of several cases: the farthest from what is right.
    pub fn worst(self, figures: impl Iterator<Item = f64>) -> f64 {
        let off = |figure: f64| match self {
            Quality::InnerPenumbra | Quality::OuterPenumbra => -figure,
            Quality::AccurateOverlap | Quality::NoAliasing | Quality::NoLightLeaks => figure,
            Quality::AllFrequencies => figure.ln().abs(),
        };
        // What is no number, and contrast below 0, is as wrong as can be.
        let off = |figure: f64| if off(figure).is_nan() { f64::INFINITY } else { off(figure) };
        figures.reduce(|worst, next| if off(next) > off(worst) { next } else { worst }).unwrap_or(f64::NAN)
    }

    /// The quality in a word, as heads of columns and names of files have it.
    pub fn id(self) -> &'static str {
        match self {
            Quality::InnerPenumbra => "inner",
            Quality::OuterPenumbra => "outer",
            Quality::AccurateOverlap => "overlap",
            Quality::NoAliasing => "aliasing",
            Quality::NoLightLeaks => "leaks",
            Quality::AllFrequencies => "frequencies",
        }
    }

    /// The quality for people, as the paper calls it.
    pub fn title(self) -> &'static str {
        match self {
            Quality::InnerPenumbra => "Inner penumbra",
            Quality::OuterPenumbra => "Outer penumbra",
            Quality::AccurateOverlap => "Accurate overlap",
            Quality::NoAliasing => "No aliasing",
            Quality::NoLightLeaks => "No light leaks",
            Quality::AllFrequencies => "All frequencies",
        }
    }

    /// The limits as people read them.
    fn bounds(self) -> String {
        match self.limits() {
            (least, f64::INFINITY) => format!("\u{2265} {}", round(least)),
            (0.0, most) => format!("\u{2264} {}", round(most)),
            (least, most) => format!("{} to {}", round(least), round(most)),
        }
    }

    /// How the quality is measured: sentences.
    pub fn measured(self) -> &'static str {
        match self {
            Quality::InnerPenumbra => {
                "The straight edge of a level sheet over a floor. Of the receivers that the sheet hides from the middle of the lamp, \
                 and that see some of it: how far what the method draws is from all lit and from all dark, whichever is nearer, summed and divided by the \
                 same of the truth. All lit, all dark and a hard border have 0; above 1, the penumbra is too wide or too even."
            }
            Quality::OuterPenumbra => {
                "The straight edge of a level sheet over a floor. The same of the receivers that see the middle of the lamp but not all of it."
            }
            Quality::AccurateOverlap => {
                "Two level sheets, one over the other. What they hide of the lamp is nested, crosses, lies apart, or meets where \
                 a gap closes. The figure is the mean error of the receivers from which each of both sheets alone hides a part of the lamp."
            }
            Quality::NoAliasing => {
                "The straight edge of a sheet, and a lamp that moves slantwise to all axes, so that the shadow goes half a texel of a map of \
                 1024 a side in each step; receivers stay. The figure is the root mean square, over receivers in the penumbra, of what changes \
                 in a step of all that is drawn beyond a smooth profile, which is a line fitted to what is drawn where the truth is within \
                 1/32: what saws, bands and flickers changes, and a penumbra of a wrong shape is no aliasing. A large lamp whose penumbra is 67 of these \
                 texels wide, and a small one with 5. A border narrower than 1/16 of the true penumbra is two bands, and so aliased."
            }
            Quality::NoLightLeaks => {
                "A round body of 6240 triangles, a slanted sheet, two sheets that meet at a seam where only one has corners, and \
                 a block that stands on the floor, up to where it stands; the sheet and the seam also near by, with receivers closer than the texels of a map \
                 of 1024. The figure is the greatest visibility found where all is truly dark \
                 within half of the widest penumbra around: nearer to its border, a shadow that is only a little too small is no leak."
            }
            Quality::AllFrequencies => {
                "Gratings of bars, as far apart as they are wide, under a lamp so small that all of them show; their shadows are from 8 \
                 texels of a map of 1024 a side down to half of one wide. The figure is the contrast of the picture, its standard \
                 deviation, divided by the true one. Detail that is there in a wrong place counts as aliasing, and not here."
            }
        }
    }

    /// Why the limits are what they are: a sentence.
    pub fn limit(self) -> &'static str {
        match self {
            Quality::InnerPenumbra | Quality::OuterPenumbra => {
                "The paper asks whether there is a penumbra at all: with less than half of its shades it is nearer to a hard border."
            }
            Quality::AccurateOverlap => {
                "In the middle of a penumbra 0.02 of the lamp is 4 % of what is seen: an eye with nothing beside to compare with hardly \
                 notices less where shades are smooth."
            }
            Quality::NoAliasing => {
                "In the middle of a penumbra 0.005 of the lamp is 1 % of what is seen, the least difference of neighbors, or from one moment to \
                 the next, that an eye takes in."
            }
            Quality::NoLightLeaks => {
                "A shadow is lit by its surroundings, in these pictures by 0.1 where the lamp gives 0.7: 0.01 of the lamp is then a speck \
                 7 % lighter than what is around."
            }
            Quality::AllFrequencies => "Half of the contrast, or twice as much, is another texture.",
        }
    }
}

/// Everything that came out of the study: `table3.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Table3Report {
    /// Version of this layout.
    pub schema_version: u32,
    /// Version of the simulator.
    pub lrbsim_version: String,
    /// Version of what the simulator's numbers mean.
    pub semantics: u32,
    /// Shadow rays of a receiver, where these are the truth.
    pub samples: u32,
    /// The truth under each kind of light, measured as methods are.
    pub truths: Vec<Table3Row>,
    /// The methods, each under the first of a ball, a rectangle and a line that it draws.
    pub rows: Vec<Table3Row>,
}

/// One method, measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Table3Row {
    /// The algorithm with the options that were asked for, as `-a` takes it.
    pub name: String,
    /// The algorithm with all of its options.
    pub algorithm: String,
    /// Kind of the light.
    pub light: String,
    /// What was measured, quality by quality.
    pub cases: Vec<Table3Case>,
}

/// What one case of a quality came out as.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Table3Case {
    /// The quality that the case is of.
    pub quality: Quality,
    /// Name of the case; of a grating the width of its bars' shadows in texels.
    pub case: String,
    /// What was measured, see [`Quality::measured`].
    pub figure: f64,
    /// Visibility of the receivers as PNG in base 64 (RFC 4648, §4), the first picture of the case.
    pub picture: String,
}

/// A row of Table 3 as it was published.
struct Published {
    /// Whose method it is.
    paper: &'static str,
    /// The row of ours that is to be like it.
    name: &'static str,
    /// The ticks, in the order of [`Quality::ALL`].
    ticks: [bool; 6],
    /// What is to be known of the row beside its ticks: a sentence, or nothing.
    remark: &'static str,
}

/// The published rows of methods that are here [johnson09, Table 3].
const PUBLISHED: [Published; 3] = [
    Published {
        paper: "Johnson et al. 2009",
        name: "sism:overlap=sum",
        ticks: [true, true, false, true, true, true],
        remark: "",
    },
    Published {
        paper: "Fernando 2005",
        name: "pcss",
        ticks: [true, true, true, false, true, true],
        remark: " These ticks of the paper were taken from its text and not checked against the printed page.",
    },
    Published {
        paper: "Wyman and Hansen 2003",
        name: "penumbra-map",
        ticks: [false, true, false, false, true, true],
        remark: "",
    },
];

const TICK: &str = "\u{2713}";
const CROSS: &str = "\u{2717}";

impl Table3Row {
    /// The cases of one quality.
    pub(crate) fn of(&self, quality: Quality) -> impl Iterator<Item = &Table3Case> {
        self.cases.iter().filter(move |case| case.quality == quality)
    }

    /// The figure that decides on a quality: that of its worst case.
    pub fn figure(&self, quality: Quality) -> f64 {
        quality.worst(self.of(quality).map(|case| case.figure))
    }

    /// Which qualities the method has, in the order of [`Quality::ALL`].
    pub fn ticks(&self) -> [bool; 6] {
        Quality::ALL.map(|quality| quality.holds(self.figure(quality)))
    }
}

/// A figure as the table has it: short, but never so that it seems to be on the other side of a limit.
fn shown(quality: Quality, figure: f64) -> String {
    let digits = match figure {
        0.0 => return "0".to_owned(),
        small if (0.0..0.0005).contains(&small) => return "< 0.001".to_owned(),
        small if small < 0.1 => 3,
        _ => 2,
    };
    let as_held = |text: &String| text.parse().is_ok_and(|read| quality.holds(read) == quality.holds(figure));
    (digits..9).map(|digits| format!("{figure:.digits$}")).find(as_held).unwrap_or_else(|| figure.to_string())
}

impl Table3Report {
    /// The bytes of `table3.json`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report has string keys and finite numbers") + "\n"
    }

    /// What the study is about, for somebody who reads of it for the first time: paragraphs.
    pub fn introduction(&self) -> Vec<String> {
        vec![
            "Table 3 of Johnson et al. 2009 says of shadow methods by ticks which visual qualities they have. Here each tick is decided \
             by a measurement on small scenes that are made for it: a lamp 3 over a floor of 4 by 4, with something between."
                .to_owned(),
            format!(
                "A cell holds the figure that was measured, and a tick if it is within the limits at the head of the column. Without a tick, the first \
                 three columns mean a picture that is plausible but wrong, the others something that disturbs. Each method is judged under the first \
                 of a ball, a rectangle and a line that it draws, all of one size. What is true, closed forms and {} shadow rays in 64-bit \
                 numbers tell; measured as a method is, the truth has every tick.",
                self.samples
            ),
            "Receivers lie in a window of the floor; four more at its corners make maps as large as for a picture of \
             all of it. Maps have their default sizes."
                .to_owned(),
        ]
    }

    /// The truths and the methods.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Table3Row> {
        self.truths.iter().chain(&self.rows)
    }

    /// The table itself: figures with ticks, published rows below those of ours that they are of.
    fn table(&self) -> Finding {
        let columns = ["method".to_owned(), "lamp".to_owned()].into_iter();
        let heads = Quality::ALL.map(|quality| format!("{} {}", quality.id(), quality.bounds()));
        let mut rows = Vec::new();
        for row in &self.rows {
            let cells = Quality::ALL.iter().zip(row.ticks()).map(|(quality, tick)| {
                Cell::Text(format!(
                    "{} {}",
                    if tick { TICK } else { CROSS },
                    shown(*quality, row.figure(*quality))
                ))
            });
            let names = [Cell::Text(row.name.clone()), Cell::Text(row.light.clone())];
            rows.push(names.into_iter().chain(cells).collect());
            for published in PUBLISHED.iter().filter(|published| published.name == row.name) {
                let cells = published.ticks.map(|tick| Cell::Text(if tick { TICK } else { "" }.to_owned()));
                let names = [format!("{}, published", published.paper), String::new()].map(Cell::Text);
                rows.push(names.into_iter().chain(cells).collect());
            }
        }
        Finding {
            name: "qualities".to_owned(),
            title: "Visual qualities".to_owned(),
            notes: self.differences(),
            sheet: Sheet { columns: columns.chain(heads).collect(), rows },
            plot: None,
        }
    }

    /// Where ours differs from what was published: sentences.
    pub fn differences(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for Published { paper, name, ticks, remark } in PUBLISHED {
            let Some(row) = self.rows.iter().find(|row| row.name == name) else { continue };
            let differ: Vec<String> = Quality::ALL
                .iter()
                .zip(row.ticks().iter().zip(ticks))
                .filter(|(_, (ours, published))| **ours != *published)
                .map(|(quality, (_, published))| {
                    let has = if published { "ticked there" } else { "not ticked there" };
                    let figure = shown(*quality, row.figure(*quality));
                    format!("{} is {has} and {figure} here.", quality.title())
                })
                .collect();
            notes.push(match &differ[..] {
                [] => format!("`{name}` has the ticks that {paper} has in the paper.{remark}"),
                differ => format!("`{name}` beside {paper} in the paper: {}{remark}", differ.join(" ")),
            });
        }
        notes
    }

    /// One quality: the figures of its cases.
    fn finding(&self, quality: Quality) -> Finding {
        let cases = |row: &Table3Row| row.of(quality).map(|case| case.case.clone()).collect::<Vec<String>>();
        let names = self.all().next().map(cases).unwrap_or_default();
        let columns = ["method", "lamp"].map(str::to_owned).into_iter().chain(names.iter().cloned());
        let row = |row: &Table3Row| {
            let figures = row.of(quality).map(|case| Cell::Number(case.figure));
            let names = [&row.name, &row.light].map(|text| Cell::Text(text.clone()));
            names.into_iter().chain(figures).collect()
        };
        let sheet = Sheet { columns: columns.collect(), rows: self.all().map(row).collect() };
        let numbers: Option<Vec<f64>> = names.iter().map(|name| name.parse().ok()).collect();
        let plot = numbers.map(|widths| {
            let series = |row: &Table3Row| Series {
                name: row.name.clone(),
                look: Look::Line,
                points: widths.iter().copied().zip(row.of(quality).map(|case| case.figure)).collect(),
            };
            let (least, most) = quality.limits();
            let limit = |name: &str, at: f64| Series {
                name: name.to_owned(),
                look: Look::Dashed,
                points: widths.iter().map(|width| (*width, at)).collect(),
            };
            Plot::Lines(Lines {
                title: format!("{}: contrast beside the true one", quality.title()),
                x: Axis::new("width of a bar's shadow, texels", true),
                y: Axis::new("contrast", false),
                series: self
                    .rows
                    .iter()
                    .map(series)
                    .chain([limit("least", least), limit("most", most)])
                    .collect(),
            })
        });
        Finding {
            name: quality.id().to_owned(),
            title: quality.title().to_owned(),
            notes: Vec::new(),
            sheet,
            plot,
        }
    }

    /// The table, and then each quality.
    pub fn findings(&self) -> Vec<Finding> {
        std::iter::once(self.table()).chain(Quality::ALL.map(|quality| self.finding(quality))).collect()
    }

    /// The study as one Markdown text.
    pub fn markdown(&self) -> String {
        let about = Quality::ALL.map(|quality| format!("{} {}\n\n", quality.measured(), quality.limit()));
        let about = std::iter::once(String::new()).chain(about);
        document("table3", &paragraphs(&self.introduction()), &self.findings(), about)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(figures: [f64; 6]) -> Table3Report {
        let case = |(quality, figure): (Quality, f64)| Table3Case {
            quality,
            case: "1".to_owned(),
            figure,
            picture: String::new(),
        };
        let row = |name: &str, figures: [f64; 6]| Table3Row {
            name: name.to_owned(),
            algorithm: name.to_owned(),
            light: "ball".to_owned(),
            cases: Quality::ALL.into_iter().zip(figures).map(case).collect(),
        };
        Table3Report {
            schema_version: TABLE3_SCHEMA_VERSION,
            lrbsim_version: String::new(),
            semantics: 1,
            samples: 16,
            truths: vec![row("truth", [1.0, 1.0, 0.0, 0.0, 0.0, 1.0])],
            rows: vec![row("sism:overlap=sum", figures)],
        }
    }

    #[test]
    fn ticks_are_what_the_limits_say_and_the_paper_stands_beside() {
        let report = report([0.5, 0.49, 0.03, 0.0004, 0.0, 2.1]);
        assert_eq!(report.truths[0].ticks(), [true; 6]);
        assert_eq!(report.rows[0].ticks(), [true, false, false, true, true, false]);
        let text = report.markdown();
        assert!(
            text.contains(
                "| sism:overlap=sum | ball | ✓ 0.50 | ✗ 0.49 | ✗ 0.030 | ✓ < 0.001 | ✓ 0 | ✗ 2.10 |"
            ),
            "{text}"
        );
        assert!(text.contains("| Johnson et al. 2009, published |  | ✓ | ✓ |  | ✓ | ✓ | ✓ |"), "{text}");
        assert!(text.contains("Outer penumbra is ticked there and 0.49 here."), "{text}");
        let read: Table3Report = serde_json::from_str(&report.to_json()).expect("own JSON");
        assert_eq!(read, report);
    }

    #[test]
    fn the_worst_figure_is_the_farthest_from_right() {
        let worst = |quality: Quality| quality.worst([0.4, 1.1, 2.2].into_iter());
        assert_eq!(Quality::ALL.map(worst), [0.4, 0.4, 2.2, 2.2, 2.2, 0.4]);
        assert!(Quality::AllFrequencies.worst([1.1, 0.0].into_iter()) == 0.0);
        assert!(Quality::ALL.iter().all(|quality| !quality.holds(quality.worst([].into_iter()))));
        // What is no number never counts as right, wherever it stands.
        for figures in [[1.0, f64::NAN], [f64::NAN, 1.0]] {
            assert!(Quality::ALL.iter().all(|quality| !quality.holds(quality.worst(figures.into_iter()))));
        }
        assert_eq!(Quality::AllFrequencies.worst([1.1, -0.5].into_iter()), -0.5);
    }

    #[test]
    fn a_figure_is_never_shown_on_the_other_side_of_its_limit() {
        for (quality, figure, text) in [
            (Quality::InnerPenumbra, 0.4996, "0.4996"),
            (Quality::AccurateOverlap, 0.0204, "0.0204"),
            (Quality::AccurateOverlap, 0.0196, "0.020"),
            (Quality::NoAliasing, 0.00004, "< 0.001"),
            (Quality::OuterPenumbra, -0.25, "-0.250"),
            (Quality::NoLightLeaks, 2.0, "2.00"),
            (Quality::NoLightLeaks, f64::NAN, "NaN"),
        ] {
            assert_eq!(shown(quality, figure), text);
        }
    }
}
