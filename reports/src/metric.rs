//! Numbers of a report by their path, such as `total.ms` or `phases.soft.l2.misses`.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::run::RunReport;

/// Some numbers of a report by their path: phases are found by their id.
#[derive(Debug, Clone)]
pub struct Numbers(BTreeMap<String, Number>);

#[derive(Debug, Clone, Copy)]
struct Number {
    value: f64,
    /// Half of the interval that the report gives beside the number.
    half_interval: Option<f64>,
}

impl Numbers {
    /// The numbers of a report at `paths`. No others are kept: a study holds those of all of its points at once.
    pub fn of<'a>(report: &RunReport, paths: impl Iterator<Item = &'a str>) -> Numbers {
        let tree = serde_json::to_value(report).expect("a report has string keys");
        let of = |path: &str| {
            let half_interval = half_interval(&tree, path);
            Some((path.to_owned(), Number { value: number(&tree, path)?, half_interval }))
        };
        Numbers(paths.filter_map(of).collect())
    }

    /// The number at `path`; `None` when it was not measured, is not there, or was not asked for.
    pub fn get(&self, path: &str) -> Option<f64> {
        self.0.get(path).map(|number| number.value)
    }

    /// How far the number at `path` may be off, with 95 % confidence; `None` where nothing of it was extrapolated from a sample.
    pub fn half_interval(&self, path: &str) -> Option<f64> {
        self.0.get(path)?.half_interval
    }
}

/// The two paths of a ratio, as in `phases.grid.cycles / scene.receivers`; `None` for a path.
pub fn ratio(path: &str) -> Option<(&str, &str)> {
    path.split_once(" / ")
}

/// The number at `path` of a report as a tree, or the ratio of two.
fn number(tree: &Value, path: &str) -> Option<f64> {
    if let Some((of, by)) = ratio(path) {
        let ratio = number(tree, of)? / number(tree, by)?;
        return ratio.is_finite().then_some(ratio);
    }
    at(tree, path)?.as_f64()
}

/// Half of the interval of the number at `path`, which stands beside it by the name of that and `_interval`.
fn half_interval(tree: &Value, path: &str) -> Option<f64> {
    let interval = at(tree, &format!("{path}_interval"))?;
    let interval = [interval[0].as_f64()?, interval[1].as_f64()?];
    Some(crate::run::half_interval(number(tree, path)?, interval))
}

/// What stands at `path` of a report as a tree.
fn at<'a>(tree: &'a Value, path: &str) -> Option<&'a Value> {
    let mut place = tree;
    for name in path.split('.') {
        place = match place {
            Value::Object(members) => members.get(name)?,
            Value::Array(rows) => rows.iter().find(|row| row["id"] == name)?,
            _ => return None,
        };
    }
    Some(place)
}

/// The measure of a picture's error that tells where the error lies.
pub const MEAN_ERROR: &str = "image.error.mean";

/// The measure of whether a picture is too light or too dark.
pub const BIAS: &str = "image.error.bias";

/// Parts of [`MEAN_ERROR`], with where each lies.
pub const ERROR_PLACES: [(&str, &str); 3] = [
    ("image.error.places.umbra", "umbras"),
    ("image.error.places.penumbra", "penumbras"),
    ("image.error.places.light", "what is lit by all of the light"),
];

/// The title of a path for people, with its unit.
pub fn title(path: &str) -> String {
    if let Some((of, by)) = ratio(path) {
        // No unit: what stands behind a comma would be taken for that of the whole.
        return format!("{} / {}", of.trim_start_matches("phases."), by.trim_start_matches("phases."));
    }
    let last = path.rsplit('.').next().unwrap_or(path);
    let name = path.strip_suffix(last).unwrap_or("").trim_end_matches('.').trim_start_matches("phases.");
    match (name, last) {
        ("total", "ms") => "total, ms".to_owned(),
        ("total", "paper_ms") => "paper's total, ms".to_owned(),
        ("image.error", "mean") => "mean error".to_owned(),
        ("image.error", "rmse" | "bias") => last.to_owned(),
        ("total", "fps" | "paper_fps") => format!("{last}, frames/s"),
        (_, "ms") => format!("{name}, ms"),
        _ => path.trim_start_matches("phases.").to_owned(),
    }
}

/// The unit of what stands at a path, where its title has one.
pub fn unit(path: &str) -> Option<String> {
    Some(title(path).rsplit_once(", ")?.1.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn numbers_are_found_by_path() {
        let known = ["total.ms", "phases.soft.cycles", "phases.soft.l2.misses", "machine.cores"];
        let unknown = ["total.nothing", "phases.none.ms", "total", "scene.name", ""];
        let numbers = Numbers::of(&sample::timed(), known.into_iter().chain(unknown));
        assert_eq!(numbers.get("total.ms"), Some(10.0));
        assert_eq!(numbers.get("phases.soft.cycles"), Some(6e6));
        assert_eq!(numbers.get("phases.soft.l2.misses"), Some(76.0));
        assert_eq!(numbers.get("machine.cores"), Some(24.0));
        let ratios = ["phases.soft.cycles / machine.cores", "machine.cores / phases.none.ms"];
        let by = Numbers::of(&sample::timed(), ratios.into_iter());
        assert_eq!((by.get(ratios[0]), by.get(ratios[1])), (Some(250_000.0), None));
        for path in unknown {
            assert_eq!(numbers.get(path), None, "{path}");
        }
        assert_eq!(numbers.get("total.cycles"), None, "it was not asked for");
    }

    #[test]
    fn what_was_extrapolated_has_half_an_interval() {
        let mut report = sample::timed();
        report.total.ms_interval = Some([8.5, 11.5]);
        let numbers = Numbers::of(&report, ["total.ms", "total.paper_ms", "total.cycles"].into_iter());
        assert_eq!(numbers.half_interval("total.ms"), Some(1.5));
        assert_eq!(
            (numbers.half_interval("total.paper_ms"), numbers.half_interval("total.cycles")),
            (None, None)
        );
    }

    #[test]
    fn titles_have_units() {
        assert_eq!(title("phases.soft.ms"), "soft, ms");
        assert_eq!(title("total.ms"), "total, ms");
        assert_eq!(title("image.error.mean"), "mean error");
        assert_eq!(title("scene.triangles"), "scene.triangles");
        assert_eq!(title("phases.grid.ms / scene.receivers"), "grid.ms / scene.receivers");
    }
}
