//! What to make of a study's results: from its JSON alone, without a simulation.

mod exponents;
mod fit;
mod limits;
mod pareto;
mod power_law;
mod published;
mod sensitivity;
mod speedup;
mod table;

#[cfg(test)]
pub(crate) mod tests;

use serde_json::Value;

use crate::digest::{Digest, phase_field};
use crate::metric::Numbers;
use crate::plot::Plot;
use crate::sheet::{Sheet, show_value};
use crate::study::{Analysis, AnalysisKind, StudyFile};

/// What one analysis found.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Stem of the names of the finding's files.
    pub name: String,
    /// What the finding shows, as a heading.
    pub title: String,
    /// What to know when reading the finding, a line each.
    pub notes: Vec<String>,
    /// The numbers of the finding as a table.
    pub sheet: Sheet,
    /// The numbers of the finding as a plot, where there is one.
    pub plot: Option<Plot>,
}

impl Finding {
    /// The files of the finding: its table, and its plot where there is one; names and bytes.
    pub fn files(&self) -> Vec<(String, Vec<u8>)> {
        let Finding { name, sheet, plot, .. } = self;
        let mut files = vec![(format!("{name}.csv"), sheet.csv().into_bytes())];
        if let Some(plot) = plot {
            files.push((format!("{name}.svg"), plot.svg().into_bytes()));
            files.push((format!("{name}.png"), plot.png()));
        }
        files
    }
}

/// A study as one Markdown text: its introduction, and its findings, each behind what is said `about` it.
pub(crate) fn document(
    name: &str,
    introduction: &str,
    findings: &[Finding],
    about: impl Iterator<Item = String>,
) -> String {
    let mut text = format!("# {name}\n{introduction}");
    for (finding, about) in findings.iter().zip(about) {
        text.push_str(&format!("\n## {}\n\n{about}{}", finding.title, finding.sheet.markdown()));
        for note in &finding.notes {
            text.push_str(&format!("\n{note}\n"));
        }
    }
    text
}

/// Paragraphs of a Markdown text.
pub(crate) fn paragraphs(paragraphs: &[String]) -> String {
    paragraphs.iter().map(|paragraph| format!("\n{paragraph}\n")).collect()
}

/// Runs the analyses that a study asks for, the table first.
pub fn findings(digest: &Digest) -> Vec<Finding> {
    let data = Data::of(digest);
    let file = &digest.study.study;
    let mut asked: Vec<Analysis> = file.analysis.iter().map(|entry| entry.options()).collect();
    if !asked.iter().any(|analysis| analysis.kind == AnalysisKind::Table) {
        asked.insert(0, Analysis { kind: AnalysisKind::Table, x: None, y: None, each: None });
    }
    let mut findings: Vec<Finding> = Vec::new();
    for analysis in &asked {
        let mut finding = match analysis.kind {
            AnalysisKind::Table => table::table(digest, &data, analysis),
            AnalysisKind::Speedup => speedup::speedup(&data, analysis),
            AnalysisKind::Limits => limits::limits(&data, analysis),
            AnalysisKind::Exponents => exponents::exponents(&data, &file.axes, analysis),
            AnalysisKind::PowerLaw => power_law::power_law(&data, analysis),
            AnalysisKind::Pareto => pareto::pareto(&data, analysis),
            AnalysisKind::Sensitivity => sensitivity::sensitivity(&data, analysis),
            AnalysisKind::Published => published::published(&data, &file.published),
        };
        // The same analysis twice, with other options, has files of its own.
        let earlier = findings.iter().filter(|other| other.name.starts_with(&finding.name)).count();
        if earlier > 0 {
            finding.name = format!("{}-{}", finding.name, earlier + 1);
        }
        findings.push(finding);
    }
    findings
}

/// All findings as one Markdown text.
pub fn markdown(study: &StudyFile, findings: &[Finding]) -> String {
    let question = if study.question.is_empty() { &[][..] } else { std::slice::from_ref(&study.question) };
    document(&study.name, &paragraphs(question), findings, std::iter::repeat(String::new()))
}

/// The points of a study that have a report, ready to be asked for numbers.
struct Data<'a> {
    axes: Vec<String>,
    metric: String,
    /// Paths of the other numbers that the study asks for.
    columns: &'a [String],
    rows: Vec<Row<'a>>,
    /// Ids of the phases that any point has, in program order.
    phases: &'a [String],
}

struct Row<'a> {
    values: &'a [Value],
    numbers: &'a Numbers,
}

impl<'a> Data<'a> {
    fn of(digest: &'a Digest) -> Data<'a> {
        let Digest { study, numbers, phases, .. } = digest;
        let rows = study.points.iter().zip(numbers);
        let rows = rows
            .filter_map(|(point, numbers)| Some(Row { values: &point.values, numbers: numbers.as_ref()? }));
        let axes = study.study.axes.iter().map(|axis| axis.path.clone()).collect();
        let columns = &study.study.columns;
        Data { axes, metric: study.study.metric.clone(), columns, rows: rows.collect(), phases }
    }

    /// The axis or number that an analysis is drawn over.
    fn x(&self, analysis: &Analysis) -> String {
        let numeric = |axis: &&String| self.rows.iter().all(|row| self.number(row, axis).is_some());
        let first = || self.axes.iter().find(numeric).or(self.axes.first()).cloned().unwrap_or_default();
        analysis.x.clone().unwrap_or_else(first)
    }

    /// The number that an analysis measures.
    fn y(&self, analysis: &Analysis) -> String {
        analysis.y.clone().unwrap_or_else(|| self.metric.clone())
    }

    /// Value of an axis, or a number of the report.
    fn number(&self, row: &Row, path: &str) -> Option<f64> {
        match self.axes.iter().position(|axis| axis == path) {
            Some(axis) => row.values[axis].as_f64(),
            None => row.numbers.get(path),
        }
    }

    /// `y`, and where it is a time of the whole frame, the same of every phase.
    fn with_phases(&self, y: &str) -> Vec<String> {
        let mut all = vec![y.to_owned()];
        if let Some(field) = phase_field(y) {
            all.extend(self.phases.iter().map(|id| format!("phases.{id}.{field}")));
        }
        all
    }

    /// What is analyzed besides `y`: the phases, where one group leaves room for them.
    fn parts(&self, y: &str, groups: usize) -> Vec<String> {
        if groups == 1 { self.with_phases(y) } else { vec![y.to_owned()] }
    }

    /// The rows in groups that differ in nothing but the axis `x`, with a name for each group; all in one where `x` is
    /// no axis but something that was measured.
    fn groups(&self, x: &str) -> Vec<(String, Vec<&Row<'a>>)> {
        let measured = !self.axes.iter().any(|axis| axis == x);
        let others: Vec<usize> =
            (0..self.axes.len()).filter(|axis| !measured && self.axes[*axis] != x).collect();
        let rest = |row: &Row<'a>| others.iter().map(|axis| &row.values[*axis]).collect::<Vec<&Value>>();
        let groups = grouped(self.rows.iter().map(|row| (rest(row), row)));
        let name = |values: &[&Value]| {
            let parts = others.iter().zip(values);
            let parts: Vec<String> =
                parts.map(|(axis, value)| format!("{} {}", self.axes[*axis], show_value(value))).collect();
            parts.join(", ")
        };
        groups.into_iter().map(|(values, rows)| (name(&values), rows)).collect()
    }

    /// Why an analysis of `y` over `x` has no row.
    fn why_nothing(&self, x: &str, y: &str) -> String {
        let any = |path: &str| self.rows.iter().any(|row| self.number(row, path).is_some());
        if self.rows.is_empty() {
            "Nothing is shown: no point has a result.".to_owned()
        } else if !any(x) {
            format!(
                "Nothing is shown: the values of {x} are names, and this analysis is over numbers; `x` can name another axis."
            )
        } else if !any(y) {
            format!("Nothing is shown: no point has a number {y}; functional runs have no times.")
        } else {
            format!("Nothing is shown: too few points have both {x} and {y}, above 0.")
        }
    }

    /// Finite points of one group, by rising x.
    fn points(&self, rows: &[&Row], x: &str, y: &str) -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> =
            rows.iter().filter_map(|row| Some((self.number(row, x)?, self.number(row, y)?))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    }
}

/// Items by their keys, keys and items in the order in which they come.
fn grouped<K: PartialEq, T>(items: impl Iterator<Item = (K, T)>) -> Vec<(K, Vec<T>)> {
    let mut groups: Vec<(K, Vec<T>)> = Vec::new();
    for (key, item) in items {
        match groups.iter_mut().find(|(other, _)| *other == key) {
            Some((_, group)) => group.push(item),
            None => groups.push((key, vec![item])),
        }
    }
    groups
}

/// Series are named by what they measure or, where there are several groups, by their group.
fn named(what: &str, group: &str) -> String {
    if group.is_empty() { what.to_owned() } else { group.to_owned() }
}
