//! Study files: read, and checked as far as can be without running anything.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use lrbsim_kernels::method::METHODS;
use lrbsim_machine::Fidelity;
use lrbsim_reports::study::{AnalysisKind, Draw, Sampling, StudyAxis, StudyFile};
use lrbsim_reports::{dictionary, metric};
use serde_json::Value;

use super::points::{self, Point};
use super::recipe::{Fault, Recipe, Refusal};
use crate::error::BadInput;
use crate::inputs::{looks_like_file, unknown_name};
use crate::json::{self, Spots};
use crate::settings::distance;

/// Name and text of each shipped study.
const STUDIES: [(&str, &str); 10] = [
    ("accuracy", include_str!("../../configs/studies/accuracy.json")),
    ("cores", include_str!("../../configs/studies/cores.json")),
    ("orbit", include_str!("../../configs/studies/orbit.json")),
    ("scaling", include_str!("../../configs/studies/scaling.json")),
    ("scaling-memory", include_str!("../../configs/studies/scaling-memory.json")),
    ("table1", include_str!("../../configs/studies/table1.json")),
    ("table2", include_str!("../../configs/studies/table2.json")),
    ("trade", include_str!("../../configs/studies/trade.json")),
    ("trade-panel", include_str!("../../configs/studies/trade-panel.json")),
    ("trade-tube", include_str!("../../configs/studies/trade-tube.json")),
];

/// Points that are run without being asked twice.
pub(super) const POINTS_WITHOUT_YES: u64 = 10_000;

/// Points at most: their list alone would fill the memory.
pub(super) const POINTS_MAX: u64 = 1_000_000;

/// Names of the shipped studies.
pub fn builtin_study_names() -> Vec<&'static str> {
    STUDIES.iter().map(|(name, _)| *name).collect()
}

/// A study that was read and checked.
#[derive(Debug, Clone)]
pub struct Study {
    /// As it was written.
    pub file: StudyFile,
    /// The file it was read from; `None` for a shipped one.
    pub path: Option<PathBuf>,
    pub(super) points: Vec<Point>,
}

impl Study {
    /// Loads a shipped study by name or one from a file. `yes` allows more points than one would start by mistake.
    pub fn load(name: impl AsRef<Path>, yes: bool) -> Result<Study, BadInput> {
        let path = name.as_ref();
        if let Some((name, text)) = STUDIES.iter().find(|(known, _)| Path::new(known) == path) {
            return Study::from_text(&format!("{name}.json"), text, None, yes);
        }
        if !looks_like_file(path) {
            let made = [crate::stability::NAME, crate::table3::NAME, crate::fidelity::NAME];
            let known = [&builtin_study_names()[..], &made].concat();
            return Err(unknown_name(path, "study", "FILE.json", &known));
        }
        let text = json::text(path)?;
        Study::from_text(&path.display().to_string(), &text, Some(path.to_owned()), yes)
    }

    /// Reads the study in the text of a file.
    pub fn from_text(shown: &str, text: &str, path: Option<PathBuf>, yes: bool) -> Result<Study, BadInput> {
        let file: StudyFile = json::read(shown, text)?;
        let spots = Spots::of(text);
        let at = |bad: BadInput, place: &str, label: &str| match spots.value(place) {
            Some(span) => bad.at(shown, text, span, label.to_owned()),
            None => bad,
        };
        if file.name.is_empty() || file.name.contains(['/', '\\']) || file.name.starts_with('.') {
            let bad = BadInput::new(format!(
                "`name` is `{}`; it must be a name for a folder, without `/` and not beginning with a dot",
                file.name
            ));
            return Err(at(bad, "name", "this name"));
        }
        check_axes(&file, &at)?;

        // How many, before the list of them is made.
        let count = points::count(&file);
        if count > POINTS_MAX || (count > POINTS_WITHOUT_YES && !yes) {
            let bad = BadInput::new(format!("the study has {count} points"));
            let help = if count > POINTS_MAX {
                format!(
                    "at most {POINTS_MAX} can be run: take values away, or use `\"sampling\": {{\"random\": …}}`"
                )
            } else {
                format!(
                    "more than {POINTS_WITHOUT_YES} are run only with `--yes`; `\"sampling\": {{\"random\": …}}` takes a part of a grid"
                )
            };
            return Err(at(bad.with_help(help), "axes", "these axes"));
        }

        // Every part that is named is tried once: a wrong path or type is found here, with its place.
        let folder = path.as_deref().and_then(Path::parent).unwrap_or(Path::new("")).to_owned();
        let base = Recipe::of_base(&file.base, &folder).map_err(|bad| at(bad, "base", "this base"))?;
        base.try_names().map_err(|bad| at(bad, "base", "this base"))?;
        if !file.axes.iter().any(|axis| axis.path == "scene") {
            base.try_scene().map_err(|bad| at(bad, "base", "this base"))?;
        }
        let mut whole = Vec::new();
        for (index, axis) in file.axes.iter().enumerate() {
            let (takes_whole, tried) = try_axis(&base, axis);
            whole.push(takes_whole);
            tried.map_err(|(number, (bad, fault))| {
                let (place, label) = match (fault, axis.values.is_empty()) {
                    (Fault::Path, _) => (format!("axes[{index}].path"), "no such path"),
                    (Fault::Value, true) => (format!("axes[{index}]"), "this range"),
                    (Fault::Value, false) => (format!("axes[{index}].values[{number}]"), "this value"),
                };
                at(bad, &place, label)
            })?;
            try_with(&base, axis).map_err(|(path, number, (bad, _))| {
                at(bad, &format!("axes[{index}].with.{path}[{number}]"), "this value")
            })?;
            if takes_whole && points::holds_no_whole(axis) {
                let what = if axis.draw == Draw::PowerOfTwo { "power of two" } else { "whole number" };
                let bad = BadInput::new(format!("the axis `{}` has no {what} in its range", axis.path));
                return Err(at(bad, &format!("axes[{index}]"), "this range"));
            }
        }
        for (index, excluded) in file.exclude.iter().enumerate() {
            check_named(&file, excluded, &format!("exclude[{index}]"), &at)?;
        }
        for (index, published) in file.published.iter().enumerate() {
            check_named(&file, &published.point, &format!("published[{index}].point"), &at)?;
        }
        check_numbers(&file, &at)?;
        if let Sampling::Random { points: 0, .. } = file.sampling {
            let bad = BadInput::new("`points` is 0; it must be at least 1");
            return Err(at(bad, "sampling.random.points", "no points"));
        }
        let points = points::expand(&file, &base, &whole)?;
        if points.is_empty() {
            return Err(at(
                BadInput::new("all points of the study are excluded"),
                "exclude",
                "these exclusions",
            ));
        }
        Ok(Study { file, path, points })
    }

    /// Points of the study.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// A study has at least one point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

/// Number of a value of an axis, and why it is refused.
type Misfit = (usize, Refusal);

/// Whether all that is drawn for `axis` must be whole, and whether the base takes its values: all of them, or the ends of
/// its range. Numbers are drawn whole where nothing else is taken, as for `cores`.
fn try_axis(base: &Recipe, axis: &StudyAxis) -> (bool, Result<(), Misfit>) {
    let try_all = |whole: bool| -> Result<(), Misfit> {
        for (number, value) in points::examples(axis, whole).iter().enumerate() {
            let mut recipe = base.clone();
            let mut tried = recipe.set(&axis.path, value);
            if axis.path == "scene" {
                tried = tried.and_then(|()| recipe.try_scene().map_err(|bad| (bad, Fault::Value)));
            }
            tried.map_err(|refusal| (number, refusal))?;
        }
        Ok(())
    };
    let drawn_whole = matches!(axis.draw, Draw::Integer | Draw::PowerOfTwo);
    let tried = try_all(drawn_whole);
    if drawn_whole || !axis.values.is_empty() || tried.is_ok() {
        return (drawn_whole, tried);
    }
    match try_all(true) {
        Ok(()) => (true, Ok(())),
        // Neither is taken: the range is at fault, and not the kind of its numbers.
        misfit => (false, misfit),
    }
}

/// Whether the base takes what changes with the values of `axis`; else the path, the number of its value, and why not.
fn try_with<'a>(base: &Recipe, axis: &'a StudyAxis) -> Result<(), (&'a str, usize, Refusal)> {
    for (number, value) in axis.values.iter().enumerate() {
        let mut recipe = base.clone();
        for (path, value) in axis.settings(value) {
            let path = axis.with.get_key_value(path).map_or(axis.path.as_str(), |(path, _)| path);
            recipe.set(path, value).map_err(|refusal| (path, number, refusal))?;
        }
    }
    Ok(())
}

/// Points that are `named` by values of axes, at `place`, must be some that there can be: all else is a slip of the pen. Of one at a time, the
/// base has values too.
fn check_named(
    file: &StudyFile,
    named: &BTreeMap<String, Value>,
    place: &str,
    at: &dyn Fn(BadInput, &str, &str) -> BadInput,
) -> Result<(), BadInput> {
    if let Some(path) = named.keys().find(|path| !file.axes.iter().any(|axis| axis.path == **path)) {
        let axes: Vec<&str> = file.axes.iter().map(|axis| axis.path.as_str()).collect();
        let bad = BadInput::new(format!("`{place}` names `{path}`, which is no axis"))
            .with_help(format!("axes: {}", axes.join(", ")));
        return Err(at(bad, place, "no such axis"));
    }
    let listed = |path: &str, value: &Value| {
        file.sampling == Sampling::OneAtATime
            || file.axes.iter().filter(|axis| axis.path == path).any(|axis| {
                axis.values.is_empty() || axis.values.iter().any(|other| points::same(other, value))
            })
    };
    for (path, values) in named {
        let values = points::named(values);
        if let Some(value) = values.iter().find(|value| !listed(path, value)) {
            let bad =
                BadInput::new(format!("`{place}` names {value}, which is no value of the axis `{path}`"));
            return Err(at(bad, &format!("{place}.{path}"), "no such value"));
        }
    }
    Ok(())
}

/// What is measured, shown and drawn has to be in reports: found out here and not after hours.
fn check_numbers(file: &StudyFile, at: &dyn Fn(BadInput, &str, &str) -> BadInput) -> Result<(), BadInput> {
    let ids: Vec<&str> = METHODS.iter().flat_map(|method| method.phases()).map(|phase| phase.id).collect();
    let known = dictionary::paths(&ids);
    let judged = file.base.reference.is_some()
        || file.base.set.contains_key("reference")
        || file.axes.iter().any(|axis| axis.path == "reference");
    let check_one = |path: &str, place: &str, also: &[String]| {
        let fits = |known: &String| match known.strip_suffix('*') {
            Some(group) => {
                path.strip_prefix(group).is_some_and(|name| !name.is_empty() && !name.contains('.'))
            }
            None => known == path,
        };
        if known.iter().chain(also).any(fits) {
            if path.starts_with("image.error.") && !judged {
                let bad = BadInput::new(format!(
                    "`{path}` is an error by a reference, and no reference is asked for"
                ))
                .with_help(
                    "`\"reference\": 256` in the base judges each picture by 256 shadow rays a receiver",
                );
                return Err(at(bad, place, "never measured"));
            }
            return Ok(());
        }
        let where_from = "`lrbsim schema counters` lists them; phases by id, such as `phases.soft.ms`";
        if dictionary::is_list(path, &ids) {
            let bad = BadInput::new(format!("`{path}` is a list of numbers; it must be one number"));
            return Err(at(bad.with_help(where_from), place, "not one number"));
        }
        let bad = BadInput::new(format!("`{path}` is no number of a report"));
        let nearest = known.iter().chain(also).min_by_key(|known| distance(path, known));
        let help = match nearest.filter(|nearest| distance(path, nearest) <= path.len().div_ceil(3)) {
            Some(nearest) => format!("did you mean `{nearest}`? {where_from}"),
            None => where_from.to_owned(),
        };
        Err(at(bad.with_help(help), place, "no such number"))
    };
    let check = |path: &str, place: &str, also: &[String]| match metric::ratio(path) {
        Some((of, by)) => check_one(of, place, &[]).and_then(|()| check_one(by, place, &[])),
        None => check_one(path, place, also),
    };
    check(&file.metric, "metric", &[])?;
    for (index, published) in file.published.iter().enumerate() {
        for path in published.numbers.keys() {
            check(path, &format!("published[{index}].numbers.{path}"), &[])?;
        }
    }
    for (index, axis) in file.axes.iter().enumerate() {
        axis.measure.iter().try_for_each(|path| check(path, &format!("axes[{index}].measure"), &[]))?;
    }
    for (index, column) in file.columns.iter().enumerate() {
        check(column, &format!("columns[{index}]"), &[])?;
    }
    let axes: Vec<String> = file.axes.iter().map(|axis| axis.path.clone()).collect();
    let untimed =
        file.base.fidelity == Fidelity::Functional.to_string() && !axes.iter().any(|axis| axis == "fidelity");
    for (index, entry) in file.analysis.iter().enumerate() {
        let analysis = entry.options();
        if let Some(x) = &analysis.x {
            check(x, &format!("analysis[{index}].x"), &axes)?;
        }
        if let Some(y) = &analysis.y {
            check(y, &format!("analysis[{index}].y"), &[])?;
        }
        let measured = match analysis.kind {
            AnalysisKind::Table => None,
            AnalysisKind::Published => file
                .published
                .iter()
                .flat_map(|published| published.numbers.keys())
                .find(|path| is_timed(path)),
            _ => Some(analysis.y.as_ref().unwrap_or(&file.metric)),
        };
        if let Some(measured) = measured
            && untimed
            && is_timed(measured)
        {
            let bad = BadInput::new(format!("`{measured}` is what this analysis is of, and functional runs have no times"))
                .with_help("take another fidelity, or `\"metric\": \"phases.soft.instructions.total\"` or another number without time");
            return Err(at(bad, &format!("analysis[{index}]"), "nothing to analyze"));
        }
    }
    Ok(())
}

/// Whether the number at `path` is null where nothing is timed.
fn is_timed(path: &str) -> bool {
    if let Some((of, by)) = metric::ratio(path) {
        return is_timed(of) || is_timed(by);
    }
    match path.split('.').collect::<Vec<_>>()[..] {
        ["total", "instructions"] => false,
        ["total", ..] => true,
        ["phases", _, part, ..] => !["steps", "tasks", "instructions", "lanes"].contains(&part),
        _ => false,
    }
}

/// Axes have values, or a range where ranges are drawn from; each path once; lists are of one length.
fn check_axes(file: &StudyFile, at: &dyn Fn(BadInput, &str, &str) -> BadInput) -> Result<(), BadInput> {
    if file.axes.is_empty() {
        return Err(at(
            BadInput::new("the study has no axes")
                .with_help("`axes` must have at least one: {\"path\": …, \"values\": […]}"),
            "axes",
            "no axes",
        ));
    }
    let random = matches!(file.sampling, Sampling::Random { .. });
    // A list takes one value of each axis at a time, so that one may come again beside another.
    let is_list = file.sampling == Sampling::List;
    for (index, axis) in file.axes.iter().enumerate() {
        let place = format!("axes[{index}]");
        let path = &axis.path;
        if file.axes[..index].iter().any(|other| other.path == *path) {
            let bad = BadInput::new(format!("the axis `{path}` is there twice"))
                .with_help("put all values in one axis");
            return Err(at(bad, &format!("{place}.path"), "there already"));
        }
        for (path, values) in &axis.with {
            let place = format!("{place}.with.{path}");
            let others =
                file.axes.iter().enumerate().map(|(other, axis)| {
                    *path == axis.path || (other != index && axis.with.contains_key(path))
                });
            if others.into_iter().any(|is_there| is_there) {
                let bad = BadInput::new(format!(
                    "`{path}` changes with the axis `{}`, and with another too",
                    axis.path
                ));
                return Err(at(bad.with_help("a path is set once in a point"), &place, "there already"));
            }
            if values.len() != axis.values.len() {
                let bad = BadInput::new(format!(
                    "`{path}` has {} values, and the axis `{}`, with which it changes, has {}",
                    values.len(),
                    axis.path,
                    axis.values.len()
                ));
                return Err(at(
                    bad.with_help("give one for each value of the axis"),
                    &place,
                    "another length",
                ));
            }
        }
        for (number, value) in axis.values.iter().enumerate() {
            if axis.values[..number].iter().any(|earlier| points::same(earlier, value)) && !is_list {
                let bad = BadInput::new(format!("the axis `{path}` has the value {value} twice"))
                    .with_help("remove one of them: a point is run once");
                return Err(at(bad, &format!("{place}.values[{number}]"), "there already"));
            }
        }
        match (axis.values.is_empty(), axis.min, axis.max) {
            (false, None, None) => {}
            (false, _, _) => {
                let bad = BadInput::new(format!("the axis `{path}` has values and a range"))
                    .with_help("keep one of them");
                return Err(at(bad, &place, "this axis"));
            }
            (true, Some(min), Some(max)) if random => {
                let positive = matches!(axis.draw, Draw::Log | Draw::PowerOfTwo);
                if min > max || (positive && min <= 0.0) {
                    let right = if positive { "0 < `min` <= `max`" } else { "`min` <= `max`" };
                    let bad = BadInput::new(format!(
                        "the axis `{path}` goes from {min} to {max}; it must be {right}"
                    ));
                    return Err(at(bad, &place, "this range"));
                }
            }
            (true, None, None) => {
                let bad = BadInput::new(format!("the axis `{path}` has no values")).with_help(
                    "`values` must have at least one; random sampling can also draw from `min` to `max`",
                );
                return Err(at(bad, &place, "no values"));
            }
            (true, _, _) => {
                let bad = BadInput::new(format!("the axis `{path}` has a range, which can only be drawn from at random"))
                    .with_help("give `values`, or both `min` and `max` and `\"sampling\": {\"random\": {\"points\": N, \"seed\": S}}`");
                return Err(at(bad, &place, "this range"));
            }
        }
    }
    if file.sampling == Sampling::List
        && let Some((index, axis)) =
            file.axes.iter().enumerate().find(|(_, axis)| axis.values.len() != file.axes[0].values.len())
    {
        let bad = BadInput::new(format!(
            "the axis `{}` has {} values and `{}` has {}; a list takes as many from each",
            axis.path,
            axis.values.len(),
            file.axes[0].path,
            file.axes[0].values.len()
        ));
        return Err(at(bad, &format!("axes[{index}].values"), "another length"));
    }
    Ok(())
}
