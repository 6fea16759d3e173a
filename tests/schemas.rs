//! Schemas, made from the types, against every file that is shipped and every file that is written.

mod common;

use std::path::{Path, PathBuf};

use common::Folder;
use serde_json::Value;

/// A schema, and what of JSON Schema the types of this program make use of.
struct Schema(Value);

/// The schema that `lrbsim schema` prints.
fn schema(folder: &Folder, format: &str) -> Schema {
    let text = folder.run(&["schema", format]).ok().stdout();
    Schema(serde_json::from_str(&text).expect("a schema is JSON"))
}

impl Schema {
    /// What is wrong with `value`, each with its place.
    fn errors(&self, value: &Value) -> Vec<String> {
        let mut errors = Vec::new();
        self.check(&self.0, value, "", &mut errors);
        errors
    }

    fn holds(&self, schema: &Value, value: &Value) -> bool {
        let mut errors = Vec::new();
        self.check(schema, value, "", &mut errors);
        errors.is_empty()
    }

    fn check(&self, schema: &Value, value: &Value, at: &str, errors: &mut Vec<String>) {
        let rules = match schema {
            Value::Bool(true) => return,
            Value::Object(rules) => rules,
            _ => return errors.push(format!("`{at}` may not be there")),
        };
        for (rule, wanted) in rules {
            let list = || wanted.as_array().expect("a list of schemas").iter();
            let number = || wanted.as_f64().expect("a bound");
            let holds = match rule.as_str() {
                "$schema" | "$defs" | "title" | "description" | "default" | "format" => true,
                "$ref" => {
                    let name = wanted.as_str().expect("a name").trim_start_matches('#');
                    self.check(self.0.pointer(name).expect("it is defined"), value, at, errors);
                    true
                }
                "type" => match wanted {
                    Value::Array(types) => types.iter().any(|name| is_of_type(value, name)),
                    name => is_of_type(value, name),
                },
                "const" => value == wanted,
                "enum" => list().any(|allowed| allowed == value),
                "anyOf" => list().any(|part| self.holds(part, value)),
                "not" => !self.holds(wanted, value),
                "oneOf" => list().filter(|part| self.holds(part, value)).count() == 1,
                "minimum" => value.as_f64().is_none_or(|value| value >= number()),
                "maximum" => value.as_f64().is_none_or(|value| value <= number()),
                "pattern" => value.as_str().is_none_or(|text| {
                    let pattern = regex::Regex::new(wanted.as_str().expect("a pattern"));
                    pattern.expect("a sound pattern").is_match(text)
                }),
                "minItems" => value.as_array().is_none_or(|items| items.len() as f64 >= number()),
                "maxItems" => value.as_array().is_none_or(|items| items.len() as f64 <= number()),
                "required" => value.as_object().is_none_or(|fields| {
                    list().all(|name| fields.contains_key(name.as_str().expect("a name")))
                }),
                "items" => {
                    for (index, item) in value.as_array().into_iter().flatten().enumerate() {
                        self.check(wanted, item, &format!("{at}[{index}]"), errors);
                    }
                    true
                }
                "properties" => {
                    for (name, field) in wanted.as_object().expect("fields") {
                        if let Some(value) = value.get(name) {
                            self.check(field, value, &format!("{at}.{name}"), errors);
                        }
                    }
                    true
                }
                "additionalProperties" => {
                    let known = rules.get("properties").and_then(Value::as_object);
                    for (name, value) in value.as_object().into_iter().flatten() {
                        if known.is_none_or(|known| !known.contains_key(name)) {
                            self.check(wanted, value, &format!("{at}.{name}"), errors);
                        }
                    }
                    true
                }
                other => panic!("this test does not know the rule `{other}`"),
            };
            if !holds {
                errors.push(format!("`{at}` breaks `{rule}`: {wanted}"));
            }
        }
    }
}

fn is_of_type(value: &Value, name: &Value) -> bool {
    match name.as_str().expect("a name") {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("no type: {other}"),
    }
}

fn read(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

#[track_caller]
fn holds(schema: &Schema, path: &Path) {
    let errors = schema.errors(&read(path));
    assert!(errors.is_empty(), "{}: {errors:?}", path.display());
}

/// JSON files in a folder of the checkout, folders below it included.
fn shipped(folder: &str) -> Vec<PathBuf> {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("it is shipped") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "json") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

#[test]
fn every_shipped_file_keeps_its_schema() {
    let folder = Folder::new();
    for (format, place, least) in
        [("machine", "configs/machines", 3), ("scene", "configs/scenes", 20), ("study", "configs/studies", 2)]
    {
        let (schema, files) = (schema(&folder, format), shipped(place));
        assert!(files.len() >= least, "{place}: {files:?}");
        files.iter().for_each(|file| holds(&schema, file));
    }
    for path in shipped("reports/published") {
        match path.file_name().and_then(|name| name.to_str()) {
            Some("report.json") => holds(&schema(&folder, "report"), &path),
            Some("study.json") => holds(&schema(&folder, "study-report"), &path),
            Some("frames.json") => holds(&schema(&folder, "frames"), &path),
            Some("fidelity.json") => holds(&schema(&folder, "fidelity"), &path),
            Some("prices.json") => holds(&schema(&folder, "prices"), &path),
            _ => {}
        }
    }
}

#[test]
fn every_written_file_keeps_its_schema() {
    let folder = Folder::new();
    folder.run(&["run", "tiny", "-o", "timed"]).ok();
    folder.run(&["run", "tiny", "-o", "untimed", "--fidelity", "functional"]).ok();
    folder.write(
        "s.json",
        r#"{"name": "s", "base": {"scene": "tiny"}, "axes": [{"path": "l2.ways", "values": [8, 100]}]}"#,
    );
    assert_eq!(folder.run(&["study", "s.json", "-o", "study"]).code(), Some(1), "one point fails");
    // With a point that is refused.
    folder.run(&["study", "stability", "--only", "scale", "-o", "stability"]).ok();
    folder.run(&["study", "table3", "--quick", "--only", "hard", "-o", "table3"]).ok();
    folder.run(&["study", "fidelity", "--quick", "--only", "tiny", "-o", "fidelity"]).ok();
    for (format, file) in [
        ("fidelity", "fidelity/fidelity.json"),
        ("prices", "fidelity/prices.json"),
        ("report", "timed/report.json"),
        ("report", "untimed/report.json"),
        ("host", "timed/host.json"),
        ("study", "s.json"),
        ("study-report", "study/study.json"),
        ("stability", "stability/stability.json"),
        ("table3", "table3/table3.json"),
    ] {
        holds(&schema(&folder, format), &folder.path(file));
    }
}

#[test]
fn a_schema_refuses_what_the_program_refuses() {
    let folder = Folder::new();
    let machine = read(&shipped("configs/machines")[0]);
    let study = read(&shipped("configs/studies")[0]);
    let scene = read(&shipped("configs/scenes")[0]);
    for (format, sound) in [("machine", machine), ("study", study), ("scene", scene)] {
        let schema = schema(&folder, format);
        let mut unknown = sound.clone();
        unknown["colour"] = Value::from("red");
        assert!(!schema.errors(&unknown).is_empty(), "{format}: an unknown field");
        for field in sound.as_object().expect("an object").keys() {
            let mut wrong = sound.clone();
            wrong[field] = Value::from(vec![Value::Bool(true)]);
            assert!(!schema.errors(&wrong).is_empty(), "{format}: `{field}` of a wrong type");
        }
    }
}

#[test]
fn a_schema_and_the_program_agree_on_algorithms_and_fidelities() {
    let folder = Folder::new();
    let schema = schema(&folder, "study");
    for (field, text, sound) in [
        ("algorithm", "sism", true),
        ("algorithm", "sism:form=exact", true),
        ("algorithm", "sism:form=exact,form=exact", false),
        ("algorithm", "sism:form=exact,", false),
        ("algorithm", "sism:form", false),
        ("algorithm", "sism:", false),
        ("fidelity", "windowed", true),
        ("fidelity", "windowed:", false),
    ] {
        let mut study = serde_json::json!({"name": "x", "axes": [{"path": "cores", "values": [1]}]});
        study["base"] = serde_json::json!({"scene": "tiny", field: text});
        assert_eq!(schema.errors(&study).is_empty(), sound, "the schema on {text}");
        let parsed = match field {
            "algorithm" => text.parse::<lrbsim::Algorithm>().is_ok(),
            _ => text.parse::<lrbsim_machine::Fidelity>().is_ok(),
        };
        assert_eq!(parsed, sound, "the program on {text}");
    }
}
