//! Results that were written earlier: of a run or of a study.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use lrbsim_reports::RunReport;
use lrbsim_reports::compare::{Comparison, PictureChange, compare, inputs, picture_change, shortened, sum};
use lrbsim_reports::fidelity::FidelityReport;
use lrbsim_reports::sheet::show_value;
use lrbsim_reports::stability::StabilityReport;
use lrbsim_reports::study::{StudyFile, StudyReport};
use lrbsim_reports::table3::Table3Report;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::BadInput;
use crate::json;
use crate::{fidelity, stability, table3};

/// The results of a run or of a study, as their file has them.
#[derive(Debug, Clone)]
pub enum Results {
    /// The results of one run.
    Run(Box<RunReport>),
    /// The results of a study.
    Study(Box<StudyReport>),
    /// The results of the study of stability.
    Stability(Box<StabilityReport>),
    /// The results of the study of Table 3.
    Table3(Box<Table3Report>),
    /// The results of the study of fidelity.
    Fidelity(Box<FidelityReport>),
}

/// Results that were written, and the folder where they lie.
#[derive(Debug, Clone)]
pub struct Written {
    /// The results themselves.
    pub results: Results,
    /// The folder where the other files of the results are.
    pub folder: PathBuf,
}

impl Written {
    /// Reads the results at `path`: a folder with `report.json` or `study.json`, or one of these files.
    pub fn load(path: &Path) -> Result<Written, BadInput> {
        let file = if path.is_dir() {
            let names = ["study.json", "report.json", stability::FILE, table3::FILE, fidelity::FILE]
                .map(|name| path.join(name));
            let found: Vec<&PathBuf> = names.iter().filter(|file| file.is_file()).collect();
            match found[..] {
                [file] => file.clone(),
                [] => {
                    return Err(BadInput::new(format!(
                        "`{}` has neither `report.json` nor `study.json`",
                        path.display()
                    ))
                    .with_help(
                        "name a folder that `lrbsim run -o` or `lrbsim study -o` wrote, or such a file",
                    ));
                }
                [first, second, ..] => {
                    let name = |file: &PathBuf| file.file_name().unwrap_or_default().display().to_string();
                    return Err(BadInput::new(format!(
                        "`{}` has both `{}` and `{}`",
                        path.display(),
                        name(second),
                        name(first)
                    ))
                    .with_help("name one of these files"));
                }
            }
        } else {
            path.to_owned()
        };
        let text = json::text(&file)?;
        let shown = file.display().to_string();
        // Which of the two it is, its fields tell.
        let tree: Value = json::read(&shown, &text)?;
        let results = if tree.get("points").is_some() {
            Results::Study(Box::new(read_versioned(&shown, &text)?))
        } else if tree.get("families").is_some() {
            Results::Stability(Box::new(read_versioned(&shown, &text)?))
        } else if tree.get("truths").is_some() {
            Results::Table3(Box::new(read_versioned(&shown, &text)?))
        } else if tree.get("subjects").is_some() {
            Results::Fidelity(Box::new(read_versioned(&shown, &text)?))
        } else {
            Results::Run(Box::new(read_versioned(&shown, &text)?))
        };
        Ok(Written { results, folder: file.parent().unwrap_or(Path::new("")).to_owned() })
    }
}

fn untimed(study: &str) -> BadInput {
    BadInput::new(format!("the study of {study} has no times to compare"))
        .with_help("its JSON is text: `diff` tells what changed")
}

fn read_versioned<T: DeserializeOwned>(shown: &str, text: &str) -> Result<T, BadInput> {
    json::read(shown, text).map_err(|bad: BadInput| {
        bad.with_help(
            "results of another version of lrbsim may have other fields; make them again with this one",
        )
    })
}

/// Says which results of other inputs are in `folder`, before `report` replaces them.
pub fn replaced_run(folder: &Path, report: &RunReport) -> Option<String> {
    let text = json::text(&folder.join("report.json")).ok()?;
    said(folder, json::read("report.json", &text).ok(), |before: &RunReport| {
        let differences = inputs(before, report);
        let said: Vec<String> = differences
            .iter()
            .take(2)
            .map(|one| format!("{} was {}", one.path, shortened(&show_value(&one.a))))
            .collect();
        let more = match differences.len().saturating_sub(said.len()) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        (!said.is_empty()).then(|| format!("of another run ({}{more})", said.join(", ")))
    })
}

/// Says whether results of another study are in `folder`, before `report` replaces them.
pub fn replaced_study(folder: &Path, study: &StudyFile) -> Option<String> {
    /// What is asked of a study of before; its points, which may be many, are only read past.
    #[derive(Deserialize)]
    struct Before {
        study: StudyFile,
    }
    let file = BufReader::new(File::open(folder.join("study.json")).ok()?);
    said(folder, serde_json::from_reader(file).ok(), |before: &Before| {
        (before.study != *study).then(|| "of another study of this name".to_owned())
    })
}

/// What is said of the results `before` in `folder`, where they can be read; `differs` says what they are of, where that is
/// not the same.
fn said<T>(folder: &Path, before: Option<T>, differs: impl Fn(&T) -> Option<String>) -> Option<String> {
    let what = match before {
        Some(before) => differs(&before)?,
        None => "of another version of lrbsim".to_owned(),
    };
    Some(format!("replaced the results {what} in {}; `-o DIR` keeps both", folder.display()))
}

/// What changed between two results.
#[derive(Debug, Clone, PartialEq)]
pub struct Changes {
    /// The whole: of a study, the sum over the points that both have.
    pub whole: Comparison,
    /// The values of each point that both of two studies have, and what changed there.
    pub points: Vec<(Vec<Value>, Comparison)>,
    /// How many points only one of two studies has, or failed in one.
    pub unmatched: usize,
}

impl Changes {
    /// Compares two results of a kind.
    pub fn between(a: &Written, b: &Written) -> Result<Changes, BadInput> {
        match (&a.results, &b.results) {
            (Results::Run(run_a), Results::Run(run_b)) => {
                let picture = picture_between(run_a, run_b, Some((&a.folder, &b.folder)));
                Ok(Changes { whole: compare(run_a, run_b, picture), points: Vec::new(), unmatched: 0 })
            }
            (Results::Study(a), Results::Study(b)) => of_studies(a, b),
            (Results::Stability(_), _) | (_, Results::Stability(_)) => Err(untimed("stability")),
            (Results::Table3(_), _) | (_, Results::Table3(_)) => Err(untimed("Table 3")),
            (Results::Fidelity(_), _) | (_, Results::Fidelity(_)) => Err(untimed("fidelity")),
            _ => Err(BadInput::new("one is a run and the other a study").with_help("compare two of a kind")),
        }
    }

    /// Two slowdowns, of the whole or of any point, in percent, each with how far it may be off: that of which most is certain, and that
    /// which may be the greatest; `None` where nothing is timed.
    pub fn slowdowns_percent(&self) -> Option<[[f64; 2]; 2]> {
        let greatest = |sign: f64| {
            let end = |[change, half]: [f64; 2]| change + sign * half;
            let all = std::iter::once(&self.whole).chain(self.points.iter().map(|(_, point)| point));
            all.filter_map(|part| part.total.and_then(|total| total.percent()))
                .reduce(|most, other| if end(other) > end(most) { other } else { most })
        };
        Some([greatest(-1.0)?, greatest(1.0)?])
    }
}

fn of_studies(a: &StudyReport, b: &StudyReport) -> Result<Changes, BadInput> {
    let axes = |study: &StudyReport| -> Vec<String> {
        study.study.axes.iter().map(|axis| axis.path.clone()).collect()
    };
    if axes(a) != axes(b) {
        return Err(BadInput::new(format!(
            "the studies have other axes: {} and {}",
            axes(a).join(", "),
            axes(b).join(", ")
        ))
        .with_help("compare studies over the same axes"));
    }
    let mut points = Vec::new();
    let mut unmatched = 0;
    for point in &a.points {
        match (&point.report, b.at(&point.values)) {
            (Some(left), Some(right)) => {
                let picture = picture_between(left, right, None);
                points.push((point.values.clone(), compare(left, right, picture)));
            }
            _ => unmatched += 1,
        }
    }
    unmatched +=
        b.points.iter().filter(|point| !a.points.iter().any(|other| other.values == point.values)).count();
    if points.is_empty() {
        return Err(BadInput::new("the studies have no point in common"));
    }
    let parts: Vec<Comparison> = points.iter().map(|(_, part)| part.clone()).collect();
    let mut whole = sum(&parts);
    // What differs in every point alike is what the studies differ in.
    whole.inputs = parts[0].inputs.clone();
    whole.inputs.retain(|difference| parts.iter().all(|part| part.inputs.contains(difference)));
    Ok(Changes { whole, points, unmatched })
}

/// What differs between two pictures: by their hashes, and by the pictures themselves where there are any.
fn picture_between(a: &RunReport, b: &RunReport, folders: Option<(&Path, &Path)>) -> PictureChange {
    let size = |report: &RunReport| (report.scene.width, report.scene.height);
    if size(a) != size(b) {
        return PictureChange::OtherSize;
    }
    if a.image.sha256 == b.image.sha256 {
        return PictureChange::Same;
    }
    let read = |folder: &Path| std::fs::read(folder.join("visibility.png")).ok();
    folders.and_then(|(a, b)| picture_change(&read(a)?, &read(b)?)).unwrap_or(PictureChange::Differs)
}
