//! Files of published figures.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::error::BadInput;
use crate::json;

/// Published figures that a machine should reproduce.
#[derive(Debug, Clone, Deserialize)]
pub struct Targets {
    /// Parts that figures were taken on.
    pub parts: BTreeMap<String, Part>,
    /// Ids of figures that have to be met.
    pub must_pass: Vec<String>,
    /// The published figures.
    pub targets: Vec<Target>,
}

/// A part, as far as it differs from its siblings.
#[derive(Debug, Clone, Deserialize)]
pub struct Part {
    /// Cores of the part.
    pub cores: Option<u32>,
    /// Core clock of the part, GHz.
    pub core_ghz: Option<f64>,
    /// Peak bandwidth of the memory, 10⁹ bytes a second.
    pub memory_gb_per_s: Option<f64>,
}

/// One published figure.
#[derive(Debug, Clone, Deserialize)]
pub struct Target {
    /// Stable name: family, variant, parameters.
    pub id: String,
    /// Unit of the figure and its range.
    pub unit: String,
    /// The figure that was published.
    pub value: f64,
    /// Lowest figure that is acceptable.
    pub low: f64,
    /// Highest figure that is acceptable.
    pub high: f64,
    /// How far to trust it: `high`, `medium` or `low`.
    pub confidence: String,
    /// The part that it was taken on.
    pub part: String,
}

const SHIPPED: &str = include_str!("../../configs/targets/knc_measured.json");

impl Targets {
    /// The shipped figures: Knights Corner as it was measured.
    pub fn shipped() -> Targets {
        Targets::from_text("knc_measured.json", SHIPPED).expect("shipped targets are sound")
    }

    /// Reads the figures in a file.
    pub fn load(file: &Path) -> Result<Targets, BadInput> {
        Targets::from_text(&file.display().to_string(), &json::text(file)?)
    }

    fn from_text(file: &str, text: &str) -> Result<Targets, BadInput> {
        let targets: Targets = json::read(file, text)?;
        let spots = json::Spots::of(text);
        let bad = |path: String, message: String, label: &str| {
            let span = spots.value(&path).unwrap_or(0..0);
            BadInput::new(message).at(file, text, span, label)
        };
        if targets.targets.is_empty() {
            return Err(bad("targets".to_owned(), "`targets` is empty".to_owned(), "must have a row"));
        }
        for (i, target) in targets.targets.iter().enumerate() {
            let at = |field: &str| format!("targets[{i}].{field}");
            let id = &target.id;
            if !(target.low <= target.value && target.value <= target.high) {
                let message = format!(
                    "`{id}`: {} is not within {} and {}; it must be",
                    target.value, target.low, target.high
                );
                return Err(bad(at("value"), message, "must be from low to high"));
            }
            if !targets.parts.contains_key(&target.part) && target.part != "any" {
                let message = format!("`{id}`: `{}` is no part; it must be `any` or in `parts`", target.part);
                return Err(bad(at("part"), message, "no such part"));
            }
            if targets.targets[..i].iter().any(|earlier| earlier.id == *id) {
                return Err(bad(at("id"), format!("`{id}` is there twice; ids must differ"), "again"));
            }
        }
        for (i, id) in targets.must_pass.iter().enumerate() {
            if !targets.targets.iter().any(|target| target.id == *id) {
                let message = format!("`must_pass` names `{id}`, which is no target; it must be one");
                return Err(bad(format!("must_pass[{i}]"), message, "no such target"));
            }
        }
        Ok(targets)
    }

    /// Id of the first row.
    pub(super) fn first_id(&self) -> &str {
        self.targets.first().map_or("", |target| target.id.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(rows: &str, must_pass: &str) -> String {
        let text = format!(r#"{{"parts": {{}}, "must_pass": [{must_pass}], "targets": [{rows}]}}"#);
        Targets::from_text("t.json", &text).expect_err("unsound").to_string()
    }

    const ROW: &str = r#"{"id": "lat.l1", "unit": "cycle", "value": 3, "low": 2, "high": 4, "confidence": "high",
        "part": "any"}"#;

    #[test]
    fn unsound_files_are_refused() {
        assert!(refusal("", "").contains("empty"));
        assert!(
            refusal(&ROW.replace("\"value\": 3", "\"value\": 5"), "").contains("5 is not within 2 and 4")
        );
        assert!(refusal(&ROW.replace("any", "knl"), "").contains("`knl` is no part"));
        assert!(refusal(&format!("{ROW}, {ROW}"), "").contains("twice"));
        assert!(refusal(ROW, "\"lat.l9\"").contains("`lat.l9`"));
    }

    #[test]
    fn the_shipped_file_has_all_its_rows() {
        let targets = Targets::shipped();
        assert_eq!((targets.targets.len(), targets.must_pass.len()), (267, 30));
    }
}
