//! Numbers of a report by their path, such as `total.ms` or `phases.soft.l2.misses`.

use serde_json::Value;

use crate::run::RunReport;

/// A report as a tree whose numbers have paths: phases are found by their id.
#[derive(Debug, Clone)]
pub struct Numbers(Value);

impl Numbers {
    /// The numbers of a report.
    pub fn of(report: &RunReport) -> Numbers {
        Numbers(serde_json::to_value(report).expect("a report has string keys"))
    }

    /// The number at `path`; `None` when it was not measured or is not there.
    pub fn get(&self, path: &str) -> Option<f64> {
        let mut place = &self.0;
        for name in path.split('.') {
            place = match place {
                Value::Object(members) => members.get(name)?,
                Value::Array(rows) => rows.iter().find(|row| row["id"] == name)?,
                _ => return None,
            };
        }
        place.as_f64()
    }
}

/// The title of a path for people, with its unit.
pub fn title(path: &str) -> String {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn numbers_are_found_by_path() {
        let numbers = Numbers::of(&sample::timed());
        assert_eq!(numbers.get("total.ms"), Some(10.0));
        assert_eq!(numbers.get("phases.soft.cycles"), Some(6e6));
        assert_eq!(numbers.get("phases.soft.l2.misses"), Some(76.0));
        assert_eq!(numbers.get("machine.cores"), Some(24.0));
        for path in ["total.nothing", "phases.none.ms", "total", "scene.name", ""] {
            assert_eq!(numbers.get(path), None, "{path}");
        }
    }

    #[test]
    fn titles_have_units() {
        assert_eq!(title("phases.soft.ms"), "soft, ms");
        assert_eq!(title("total.ms"), "total, ms");
        assert_eq!(title("image.error.mean"), "mean error");
        assert_eq!(title("scene.triangles"), "scene.triangles");
    }
}
