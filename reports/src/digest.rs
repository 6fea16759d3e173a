//! What tables, plots and pages of a study are drawn from: far less than its reports, which may be more than fit in memory.

use lrbsim_machine::Cause;

use crate::metric::{BIAS, ERROR_PLACES, MEAN_ERROR, Numbers};
use crate::run::Warning;
use crate::study::{AnalysisKind, StudyPoint, StudyReport};
use crate::table::counted;

/// Points whose whole reports a page holds: a browser shows some megabytes, not hundreds.
const REPORTS_MAX: usize = 256;

/// Numbers of the whole that analyses show of every phase too, and what they are called there.
const PHASE_FIELDS: [(&str, &str); 3] =
    [("ms", "ms"), ("cycles", "cycles"), ("instructions", "instructions.total")];

/// What the number of the whole at `path` is called in a phase; `None` where phases have none that add up to it.
pub(crate) fn phase_field(path: &str) -> Option<&'static str> {
    let field = path.strip_prefix("total.")?;
    PHASE_FIELDS.iter().find(|(of_whole, _)| *of_whole == field).map(|(_, of_phase)| *of_phase)
}

/// A study with what its tables, plots and page show of each point.
#[derive(Debug, Clone)]
pub struct Digest {
    /// The study. Its points have no report, whether they were measured or not, but for the first ones that were.
    pub study: StudyReport,
    /// For each point that was measured the numbers that analyses ask for.
    pub numbers: Vec<Option<Numbers>>,
    /// Ids of the phases that any point has, in program order.
    pub phases: Vec<String>,
    /// How many points have a report that is not kept in `study`.
    pub left_out: usize,
    /// How many points have a report that is.
    kept: usize,
    /// Paths of the numbers that analyses ask for, besides those of phases.
    paths: Vec<String>,
    /// The fields of all phases that analyses ask for.
    fields: Vec<String>,
    /// The first warning of each kind, and how many points carry one of that kind.
    warnings: Vec<(Warning, usize)>,
}

impl Digest {
    /// The digest of a study without its points, which are added.
    pub fn new(head: &StudyReport) -> Digest {
        let study = head.without_points();
        let file = &study.study;
        let mut paths = vec![file.metric.clone()];
        paths.extend(file.columns.iter().cloned());
        paths.extend(file.published.iter().flat_map(|published| published.numbers.keys().cloned()));
        for analysis in file.analysis.iter().map(|entry| entry.options()) {
            paths.extend([analysis.x, analysis.y].into_iter().flatten());
        }
        if paths.iter().any(|path| path == MEAN_ERROR) {
            paths.extend(
                ERROR_PLACES.iter().map(|(path, _)| path).chain([&BIAS]).map(|path| (*path).to_owned()),
            );
        }
        paths.extend(file.axes.iter().filter_map(|axis| axis.measure.clone()));
        let mut fields: Vec<String> =
            paths.iter().filter_map(|path| phase_field(path)).map(str::to_owned).collect();
        if file.analysis.iter().any(|entry| entry.options().kind == AnalysisKind::Limits) {
            fields.extend(Cause::ALL.map(|cause| format!("cycle_stack.{}", cause.name())));
        }
        fields.sort_unstable();
        fields.dedup();
        Digest {
            study,
            numbers: Vec::new(),
            phases: Vec::new(),
            left_out: 0,
            kept: 0,
            paths,
            fields,
            warnings: Vec::new(),
        }
    }

    /// The digest of a study whose reports are in memory.
    pub fn of(study: &StudyReport) -> Digest {
        let mut digest = Digest::new(study);
        study.points.iter().for_each(|point| digest.add(point.clone()));
        digest
    }

    /// Adds the next point.
    pub fn add(&mut self, mut point: StudyPoint) {
        let numbers = point.report.as_ref().map(|report| {
            for (index, warning) in report.warnings.iter().enumerate() {
                if report.warnings[..index].iter().any(|earlier| earlier.kind == warning.kind) {
                    continue;
                }
                match self.warnings.iter_mut().find(|(known, _)| known.kind == warning.kind) {
                    Some((_, points)) => *points += 1,
                    None => self.warnings.push((warning.clone(), 1)),
                }
            }
            for phase in &report.phases {
                if !self.phases.contains(&phase.id) {
                    self.phases.push(phase.id.clone());
                }
            }
            let ids = report.phases.iter().map(|phase| phase.id.as_str());
            let of_phases: Vec<String> = ids
                .flat_map(|id| self.fields.iter().map(move |field| format!("phases.{id}.{field}")))
                .collect();
            Numbers::of(report, self.paths.iter().chain(&of_phases).map(String::as_str))
        });
        if point.report.is_some() {
            if self.kept < REPORTS_MAX {
                self.kept += 1;
            } else {
                point.report = None;
                self.left_out += 1;
            }
        }
        self.numbers.push(numbers);
        self.study.points.push(point);
    }

    /// What makes points suspicious: a line for each kind of warning, with the number of points that carry it.
    pub fn warnings(&self) -> Vec<String> {
        let all = counted(self.study.points.len() as u64, "point");
        let line = |(warning, points): &(Warning, usize)| {
            format!("warning at {points} of {all}: {}", warning.message)
        };
        self.warnings.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::analysis::tests::study;

    #[test]
    fn a_large_study_keeps_the_numbers_of_all_points_and_the_reports_of_the_first() {
        let values: Vec<[Value; 1]> = (0..REPORTS_MAX + 3).map(|value| [json!(value)]).collect();
        let points: Vec<(&[Value], f64)> = values.iter().map(|values| (&values[..], 5.0)).collect();
        let whole = study(&["cores"], &["speedup"], &points);
        let digest = Digest::of(&whole);
        assert_eq!(digest.left_out, 3);
        assert!(digest.study.points[REPORTS_MAX - 1].report.is_some());
        assert!(digest.study.points[REPORTS_MAX].report.is_none());
        let last = digest.numbers.last().and_then(Option::as_ref).expect("it was measured");
        assert_eq!((last.get("total.ms"), last.get("phases.soft.ms")), (Some(5.0), Some(2.5)));
        assert_eq!(last.get("total.cycles"), None, "nobody asks for it");
    }
}
