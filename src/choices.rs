//! What users choose by name, methods and fidelities, as help, schemas and documentation show it: all from their entries.

use lrbsim_isa::options::{Entry, Values};
use lrbsim_kernels::method::{METHODS, Method};
use lrbsim_machine::Fidelity;
use serde_json::{Value, json};

/// Help on `-a`: every shipped method with its options.
pub fn algorithm_help() -> String {
    let entries = METHODS.map(|method| method.entry());
    format!("Shadow algorithm and its options, NAME or NAME:KEY=VALUE,…:\n{}", help(&entries))
}

/// Help on `--fidelity`: every level with its options.
pub fn fidelity_help() -> String {
    format!("How much of the machine is modeled:\n{}", help(&levels()))
}

/// What the levels of modeling say of themselves.
fn levels() -> [Entry; Fidelity::ALL.len()] {
    Fidelity::ALL.map(Fidelity::entry)
}

/// Entries with their options, some lines each.
fn help(entries: &[Entry]) -> String {
    let mut text = String::new();
    for entry in entries {
        text.push_str(&format!("\n  {}: {}\n", entry.name, entry.about));
        for option in entry.options {
            text.push_str(&format!("    {}: {} [default: {}]\n", option.name, option.about, option.default));
            match option.values {
                Values::OneOf(words) => {
                    for word in words {
                        text.push_str(&format!("      {}={}: {}\n", option.name, word.name, word.about));
                    }
                }
                values => text.push_str(&format!("      {values}\n")),
            }
        }
    }
    text
}

/// Narrows the schema of a study to the methods and fidelities that there are.
pub fn narrow_study_schema(schema: &mut Value) {
    let (methods, levels) = (METHODS.map(|method| method.entry()), levels());
    for (field, entries) in [("algorithm", &methods[..]), ("fidelity", &levels[..])] {
        let field = schema.pointer_mut(&format!("/$defs/Base/properties/{field}"));
        let field = field.expect("a study has a base with these");
        field["pattern"] = json!(pattern(entries));
        if let Some(twice) = pattern_of_twice(entries) {
            field["not"] = json!({"pattern": twice});
        }
    }
}

/// A regular expression of the texts that choose one of `entries`, but for the limits of numbers and options that are there
/// twice.
fn pattern(entries: &[Entry]) -> String {
    let of_values = |values: Values| match values {
        Values::OneOf(words) => {
            format!("({})", words.iter().map(|word| word.name).collect::<Vec<_>>().join("|"))
        }
        Values::Whole(..) => "[0-9]+".to_owned(),
        Values::Percent(..) => "[0-9]+%?".to_owned(),
        Values::Number(..) => "[-+.0-9eE]+".to_owned(),
    };
    let of_entry = |entry: &Entry| {
        let options: Vec<String> = entry
            .options
            .iter()
            .map(|option| format!("{}={}", option.name, of_values(option.values)))
            .collect();
        let option = options.join("|");
        if option.is_empty() {
            entry.name.to_owned()
        } else {
            format!("{}(:({option})(,({option}))*)?", entry.name)
        }
    };
    format!("^({})$", entries.iter().map(of_entry).collect::<Vec<_>>().join("|"))
}

/// A regular expression of the texts with an option that is there twice, which a schema has to refuse by itself: one pattern
/// that held every order of options without a repetition would be as long as there are orders. `None` without options.
fn pattern_of_twice(entries: &[Entry]) -> Option<String> {
    let mut names: Vec<&str> =
        entries.iter().flat_map(|entry| entry.options).map(|option| option.name).collect();
    names.sort_unstable();
    names.dedup();
    let twice: Vec<String> = names.iter().map(|name| format!("[:,]{name}=.*,{name}=")).collect();
    (!twice.is_empty()).then(|| twice.join("|"))
}

/// The page of documentation on `methods` and fidelities, as Markdown: `docs/choices.md`.
pub fn page(methods: &[&dyn Method]) -> String {
    let mut text = String::from(
        "# What can be chosen\n\nMethods and fidelities with their options, as `-a`, `--fidelity` and studies take them: `NAME` or `NAME:KEY=VALUE,…`.\nAn option of a method can also be an axis of a study or a part of its `set`, as `algorithm.KEY`.\nWritten from the program's own lists; a test keeps it in step with them.\n\n## Methods (`-a`, `\"algorithm\"`)\n",
    );
    for method in methods {
        let entry = method.entry();
        section(&mut text, &entry);
        text.push_str("\n| Phase | Title | In the paper's total |\n|---|---|---|\n");
        for phase in method.phases() {
            let counted = if phase.in_paper_total { "yes" } else { "no" };
            text.push_str(&format!("| `{}` | {} | {counted} |\n", phase.id, phase.title));
        }
    }
    text.push_str("\n## Fidelities (`--fidelity`, `\"fidelity\"`)\n");
    levels().iter().for_each(|entry| section(&mut text, entry));
    text
}

fn section(text: &mut String, entry: &Entry) {
    text.push_str(&format!("\n### `{}`: {}\n", entry.name, entry.about));
    if entry.options.is_empty() {
        return;
    }
    text.push_str("\n| Option | Values | Default | What it decides |\n|---|---|---|---|\n");
    for option in entry.options {
        let values = match option.values {
            Values::OneOf(words) => {
                let each = words.iter().map(|word| format!("`{}`: {}", word.name, word.about));
                each.collect::<Vec<_>>().join("<br>")
            }
            values => values.to_string(),
        };
        text.push_str(&format!(
            "| `{}` | {values} | `{}` | {} |\n",
            option.name, option.default, option.about
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_written_page_is_this_one() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/choices.md");
        if std::env::var_os("LRBSIM_UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, page(&METHODS)).expect("docs can be written");
        }
        let written = std::fs::read_to_string(&path).expect("docs/choices.md is there");
        assert_eq!(written, page(&METHODS), "run the tests with LRBSIM_UPDATE_GOLDEN=1");
    }

    #[test]
    fn help_names_every_method_level_and_option() {
        let text = algorithm_help() + &fidelity_help();
        for entry in METHODS.map(|method| method.entry()).iter().chain(&levels()) {
            assert!(text.contains(&format!("  {}: ", entry.name)), "{text}");
            for option in entry.options {
                assert!(text.contains(&format!("    {}: ", option.name)), "{text}");
            }
        }
    }

    #[test]
    fn the_pattern_of_a_study_takes_what_users_write() {
        let methods = METHODS.map(|method| method.entry());
        let option = "(form=(exact|printed)|overlap=(sum|product|max|bits:64|bits:256)|lights=[0-9]+|sums=(fixed|f32|bf16|f16|f16-truncating)|angle=(atan2|acos))";
        assert_eq!(pattern(&methods[..1]), format!("^(sism(:{option}(,{option})*)?)$"));
        let twice = "[:,]angle=.*,angle=|[:,]form=.*,form=|[:,]lights=.*,lights=|[:,]overlap=.*,overlap=|[:,]sums=.*,sums=";
        assert_eq!(pattern_of_twice(&methods[..1]).as_deref(), Some(twice));
        let option = "(error=[0-9]+%?|seed=[0-9]+)";
        assert_eq!(
            (pattern(&levels()), pattern_of_twice(&levels())),
            (
                format!("^(functional|roofline|sampled(:{option}(,{option})*)?|windowed|cycle)$"),
                Some("[:,]error=.*,error=|[:,]seed=.*,seed=".to_owned())
            )
        );
    }
}
