//! Machines: shipped or from files, with settings.

use std::path::{Path, PathBuf};

use lrbsim_machine::{MachineConfig, MachineSpec, builtin_machine, builtin_machine_names};

use super::{looks_like_file, unknown_name};
use crate::error::BadInput;
use crate::json::{self, Spots};
use crate::settings::{self, Setting};

/// A machine that was checked.
#[derive(Debug, Clone)]
pub struct Machine {
    /// The effective configuration, every default filled in.
    pub config: MachineConfig,
    /// The configuration in the units of timing.
    pub spec: MachineSpec,
}

impl Machine {
    /// Loads a shipped machine by name or one from a JSON file, and applies `settings` in order.
    pub fn load(name: impl AsRef<Path>, settings: &[Setting]) -> Result<Machine, BadInput> {
        let name = name.as_ref();
        let shown = name.display();
        let (file, text) = match name.to_str().and_then(builtin_machine) {
            Some(text) => (format!("{shown}.json"), text.to_owned()),
            None if looks_like_file(name) => (shown.to_string(), json::text(name)?),
            None => return Err(unknown_name(name, "machine", "FILE.json", builtin_machine_names())),
        };
        Machine::from_text(&file, &text, settings)
    }

    /// This machine with `settings`, in order.
    pub fn with(&self, settings: &[Setting]) -> Result<Machine, BadInput> {
        let config = apply(&self.config, settings)?;
        let spec = config.validate().map_err(|error| BadInput::new(error.to_string()))?;
        Ok(Machine { config, spec })
    }

    /// `machine` with further `settings`, which must name fields and have their types; whether the machine is sound is
    /// not checked.
    pub(crate) fn apply_settings(machine: &Machine, settings: &[Setting]) -> Result<MachineConfig, BadInput> {
        apply(&machine.config, settings)
    }

    /// Reads the machine in the text of `file` and applies `settings` in order.
    pub fn from_text(file: &str, text: &str, settings: &[Setting]) -> Result<Machine, BadInput> {
        let mut config: MachineConfig = json::read(file, text)?;
        if !settings.is_empty() {
            config = apply(&config, settings)?;
        }
        let spec = config.validate().map_err(|error| {
            let mut bad = BadInput::new(error.to_string());
            if let Some(setting) = settings.iter().rfind(|setting| setting.path == error.path) {
                return bad.with_help(format!("it was set by {}", setting.said));
            }
            if let Some(span) = Spots::of(text).value(&error.path) {
                bad = bad.at(file, text, span, format!("must be {}", error.expected));
            }
            bad
        })?;
        Ok(Machine { config, spec })
    }
}

/// `config` with all `settings`; what they set is no longer from the machine's sources.
fn apply(config: &MachineConfig, settings: &[Setting]) -> Result<MachineConfig, BadInput> {
    // Sources say where the file's numbers come from; they are no parameter.
    let mut bare = config.clone();
    let mut sources = std::mem::take(&mut bare.sources);
    let mut tree = serde_json::to_value(bare).expect("a configuration has string keys");
    tree.as_object_mut().expect("a configuration is an object").remove("sources");
    settings::apply(&mut tree, settings, "a machine")?;
    tree["sources"] = serde_json::json!({});
    let mut config: MachineConfig = settings::read_back(tree, settings)?;
    sources.extend(settings.iter().map(|s| (s.path.clone(), "assumed: set for this run".to_owned())));
    config.sources = sources;
    Ok(config)
}

/// The file that the machine `name` was read from.
pub fn machine_file(name: &Path) -> Option<PathBuf> {
    name.to_str().and_then(builtin_machine).is_none().then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(texts: &[&str]) -> Vec<Setting> {
        texts.iter().map(|text| text.parse().expect("PATH=VALUE")).collect()
    }

    fn refusal(texts: &[&str]) -> String {
        let error = Machine::load("larrabee-24", &settings(texts)).expect_err("bad settings");
        format!(
            "{error} {}",
            miette::Diagnostic::help(&error).map(|help| help.to_string()).unwrap_or_default()
        )
    }

    #[test]
    fn every_shipped_machine_is_sound() {
        for name in builtin_machine_names() {
            Machine::load(name, &[]).expect(name);
        }
    }

    #[test]
    fn settings_change_the_machine_and_its_sources() {
        let machine =
            Machine::load("larrabee-24", &settings(&["cores=8", "l2.capacity_bytes=524288", "name=mine"]));
        let machine = machine.expect("sound settings");
        assert_eq!((machine.config.cores, machine.spec.cores), (8, 8));
        assert_eq!(machine.config.name, "mine");
        assert_eq!(machine.config.sources["l2.capacity_bytes"], "assumed: set for this run");
    }

    #[test]
    fn an_unknown_path_lists_the_nearest_fields() {
        let message = refusal(&["l2.capacity_byte=1"]);
        assert!(message.contains("`l2` has no field `capacity_byte`"), "{message}");
        assert!(message.contains("did you mean `capacity_bytes`?"), "{message}");
        assert!(refusal(&["coress=1"]).contains("did you mean `cores`?"));
        assert!(refusal(&["cores.x=1"]).contains("`cores` has no fields"));
        assert!(refusal(&["l2=1"]).contains("l2.ways"));
        assert!(refusal(&["sources.cores=1"]).contains("no field `sources`"));
    }

    #[test]
    fn a_value_of_the_wrong_type_is_refused() {
        assert!(refusal(&["cores=many"]).contains("expected u32"));
        assert!(refusal(&["cores=2.5"]).contains("expected u32"));
        assert!(refusal(&["core.dual_issue=1"]).contains("expected a boolean"));
    }

    #[test]
    fn an_unsound_value_names_the_setting() {
        let message = refusal(&["cores=0"]);
        assert!(
            message.contains("`cores` is 0; it must be") && message.contains("`--set cores=0`"),
            "{message}"
        );
    }

    #[test]
    fn a_name_that_is_nearly_one_is_suggested() {
        let error = Machine::load("larabee-24", &[]).expect_err("no such machine");
        assert_eq!(
            miette::Diagnostic::help(&error).expect("a hint").to_string(),
            "did you mean `larrabee-24`?"
        );
    }
}
