//! Every number of a report: its path, its unit and one sentence, from the types themselves.

use schemars::schema_for;
use serde_json::{Map, Value};

use crate::run::RunReport;

/// One number of a report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Path, with `[]` for every element of a list.
    pub path: String,
    /// Unit; `1` for parts and ratios.
    pub unit: &'static str,
    /// What the number measures, in a sentence.
    pub meaning: String,
}

/// Units by the last name of a path; the first that fits. `*` stands for anything.
const UNITS: [(&str, &str); 40] = [
    ("*_percent", "%"),
    ("*_overhead", "1"),
    ("*cycle_stack.*", "core-cycles"),
    ("*bounds.*", "cycles"),
    ("*core_busy_cycles[]", "cycles"),
    ("*paired_core_cycles", "core-cycles"),
    ("*instructions.*", "instructions"),
    ("*lanes.*", "lane-slots"),
    ("*.wait_cycles", "cycles"),
    ("*cycles", "cycles"),
    ("*_ns", "ns"),
    ("*.ms", "ms"),
    ("*_ms", "ms"),
    ("*ms_interval[]", "ms"),
    ("*fps", "frames/s"),
    ("*share", "1"),
    ("*ipc", "instructions/(cycle core)"),
    ("*bytes_per_cycle", "bytes/cycle"),
    ("*bytes", "bytes"),
    ("*slot_hops", "link-slots"),
    ("*latency_cycles.*", "cycles"),
    ("*_lines_per_cycle", "lines/cycle"),
    ("*bandwidth_gb_per_s", "10⁹ bytes/s"),
    ("*clock_ghz", "GHz"),
    ("*mean_visibility", "1"),
    ("*penumbra_receivers", "receivers"),
    ("*receivers", "receivers"),
    ("image.error.receivers_in_question", "receivers"),
    ("image.error.samples", "rays"),
    ("*image.error.*", "1"),
    ("*width", "pixels"),
    ("*height", "pixels"),
    ("*triangles", "triangles"),
    ("*silhouette_edges", "edges"),
    ("*warm_frames", "frames"),
    ("*steps", "steps"),
    ("*tasks*", "tasks"),
    ("*reads", "lines"),
    ("*writes", "lines"),
    ("*", "count"),
];

/// Every number of a report, in alphabetical order.
pub fn entries() -> Vec<Entry> {
    let schema = schema_for!(RunReport);
    let root = schema.as_value();
    let empty = Map::new();
    let definitions = root.get("$defs").and_then(Value::as_object).unwrap_or(&empty);
    let mut entries = Vec::new();
    walk("", root, "", definitions, &mut entries);
    entries
}

/// The paths under which a report with phases of these `ids` may have a number, as [`crate::metric::Numbers`] finds
/// them; a last name of `*` stands for any.
pub fn paths(ids: &[&str]) -> Vec<String> {
    let all = entries().into_iter().flat_map(|entry| of_phases(entry, ids));
    all.filter(|path| !path.contains("[]")).collect()
}

/// Whether a report with phases of these `ids` has at `path` a list of numbers, and so not one that could be asked for.
pub fn is_list(path: &str, ids: &[&str]) -> bool {
    let list = format!("{path}[]");
    entries().into_iter().flat_map(|entry| of_phases(entry, ids)).any(|path| path == list)
}

/// The path of `entry` in a report with phases of these `ids`: of a number of phases, one for each.
fn of_phases(entry: Entry, ids: &[&str]) -> Vec<String> {
    match entry.path.strip_prefix("phases[].") {
        Some(rest) => ids.iter().map(|id| format!("phases.{id}.{rest}")).collect(),
        None => vec![entry.path],
    }
}

/// Collects the numbers below `schema`; `said` is what the field that holds it says.
fn walk(path: &str, schema: &Value, said: &str, definitions: &Map<String, Value>, entries: &mut Vec<Entry>) {
    let own = schema.get("description").and_then(Value::as_str).unwrap_or(said);
    if let Some(name) = schema.get("$ref").and_then(Value::as_str) {
        let name = name.trim_start_matches("#/$defs/");
        return walk(path, definitions.get(name).unwrap_or(&Value::Null), own, definitions, entries);
    }
    // What may be null is one of several.
    for part in ["anyOf", "oneOf"].iter().filter_map(|key| schema.get(*key)?.as_array()).flatten() {
        if part.get("type") != Some(&Value::from("null")) {
            walk(path, part, own, definitions, entries);
        }
    }
    if let Some(properties) = schema.get("properties").and_then(Value::as_object) {
        for (name, field) in properties {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            walk(&path, field, "", definitions, entries);
        }
    } else if let Some(items) = schema.get("items") {
        walk(&format!("{path}[]"), items, own, definitions, entries);
    } else if let Some(values) = schema.get("additionalProperties").filter(|values| values.is_object()) {
        walk(&format!("{path}.*"), values, own, definitions, entries);
    } else if is_number(schema) && path != "schema_version" {
        // Text of several sentences is kept whole, on one line.
        let meaning = own.split_whitespace().collect::<Vec<_>>().join(" ");
        entries.push(Entry { path: path.to_owned(), unit: unit(path), meaning });
    }
}

fn is_number(schema: &Value) -> bool {
    let number = |kind: &Value| kind == "integer" || kind == "number";
    match schema.get("type") {
        Some(Value::Array(kinds)) => kinds.iter().any(number),
        Some(kind) => number(kind),
        None => false,
    }
}

fn unit(path: &str) -> &'static str {
    let fits = |pattern: &str| match (pattern.strip_prefix('*'), pattern.strip_suffix('*')) {
        (Some(""), _) => true,
        (Some(middle), Some(_)) => path.contains(middle.trim_end_matches('*')),
        (Some(end), None) => path.ends_with(end),
        (None, _) => path == pattern,
    };
    UNITS.iter().find(|(pattern, _)| fits(pattern)).map_or("count", |(_, unit)| unit)
}

/// The dictionary as Markdown: `docs/counters.md`.
pub fn markdown() -> String {
    let mut text = String::from(
        "# Numbers of a report\n\nEvery number in `report.json`, by its path; `[]` stands for each element of a list. Written by `lrbsim schema\ncounters`; a test keeps it in step with the types.\n\n| Path | Unit | Meaning |\n|---|---|---|\n",
    );
    for Entry { path, unit, meaning } in entries() {
        text.push_str(&format!("| `{path}` | {unit} | {} |\n", meaning.replace('|', "\\|")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(path: &str) -> Entry {
        entries().into_iter().find(|entry| entry.path == path).unwrap_or_else(|| panic!("{path} is missing"))
    }

    #[test]
    fn counters_have_units_and_sentences() {
        assert_eq!(entry("phases[].cycle_stack.memory").unit, "core-cycles");
        assert_eq!(entry("phases[].ms").unit, "ms");
        assert_eq!(entry("image.error.samples").unit, "rays");
        assert_eq!(entry("image.error.mean").unit, "1");
        assert_eq!(entry("image.error.shadowed_receivers").unit, "receivers");
        assert_eq!(entry("total.paper_ms").unit, "ms");
        assert_eq!(entry("phases[].ms_interval[]").unit, "ms");
        assert_eq!(entry("total.ms_interval[]").unit, "ms");
        assert_eq!(entry("machine.prefetcher.streams").unit, "count");
        assert_eq!(entry("phases[].l1d.hits").unit, "count");
        assert_eq!(entry("phases[].ring.bytes").unit, "bytes");
        assert_eq!(entry("phases[].core_busy_cycles[]").unit, "cycles");
        assert_eq!(entry("machine.core.latency_cycles.vector_fma").unit, "cycles");
        for entry in entries() {
            assert!(entry.meaning.ends_with(['.', ':']) || entry.meaning.contains(". "), "{entry:?}");
        }
    }

    #[test]
    fn lists_are_told_from_numbers() {
        let lists = ["phases.soft.ms_interval", "total.ms_interval", "phases.soft.core_busy_cycles"];
        assert!(lists.iter().all(|path| is_list(path, &["soft"])));
        assert!(!is_list("phases.soft.ms", &["soft"]) && !is_list("phases.hard.ms_interval", &["soft"]));
    }

    #[test]
    fn every_number_of_a_real_report_is_in_the_dictionary() {
        fn numbers(path: &str, value: &Value, known: &[Entry]) {
            let inside =
                |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
            match value {
                Value::Object(fields) => {
                    for (name, value) in fields {
                        let star = format!("{path}.*");
                        let path =
                            if known.iter().any(|entry| entry.path == star) { star } else { inside(name) };
                        numbers(&path, value, known);
                    }
                }
                Value::Array(list) => {
                    list.iter().for_each(|value| numbers(&format!("{path}[]"), value, known))
                }
                Value::Number(_) if path != "schema_version" => {
                    assert!(known.iter().any(|entry| entry.path == path), "{path}");
                }
                _ => {}
            }
        }
        let mut report = serde_json::to_value(crate::sample::judged()).expect("string keys");
        // The light is as scenes have it, see their schema.
        report["scene"]["light"] = Value::Null;
        numbers("", &report, &entries());
    }

    #[test]
    fn the_written_dictionary_is_this_one() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/counters.md");
        if std::env::var_os("LRBSIM_UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, markdown()).expect("docs can be written");
        }
        let written = std::fs::read_to_string(&path).expect("docs/counters.md is there");
        assert_eq!(written, markdown(), "run the tests with LRBSIM_UPDATE_GOLDEN=1");
    }
}
