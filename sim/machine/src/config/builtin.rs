//! The machines that are shipped inside the binary.

use super::MachineConfig;

const MACHINES: [(&str, &str); 4] = [
    ("larrabee-24", include_str!("../../../../configs/machines/larrabee-24.json")),
    ("larrabee-32", include_str!("../../../../configs/machines/larrabee-32.json")),
    ("knc-5110p", include_str!("../../../../configs/machines/knc-5110p.json")),
    ("ideal", include_str!("../../../../configs/machines/ideal.json")),
];

/// Text of the shipped machine `name`: JSON of a [`MachineConfig`](super::MachineConfig).
pub fn builtin_machine(name: &str) -> Option<&'static str> {
    MACHINES.iter().find(|(key, _)| *key == name).map(|(_, text)| *text)
}

/// The shipped machine `name`, which there is.
pub(crate) fn shipped(name: &str) -> MachineConfig {
    let text = builtin_machine(name).expect("a shipped machine");
    serde_json::from_str(text).expect("shipped machines are sound")
}

/// Names of the shipped machines, the default first.
pub fn builtin_machine_names() -> &'static [&'static str] {
    const NAMES: [&str; MACHINES.len()] = [MACHINES[0].0, MACHINES[1].0, MACHINES[2].0, MACHINES[3].0];
    &NAMES
}
