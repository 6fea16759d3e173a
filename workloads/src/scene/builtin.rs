//! Scenes inside the binary.

/// Name and text of each shipped scene, in alphabetical order.
const SCENES: [(&str, &str); 4] = [
    ("cornell", include_str!("../../../configs/scenes/cornell.json")),
    ("saloon-small", include_str!("../../../configs/scenes/saloon-small.json")),
    ("table", include_str!("../../../configs/scenes/table.json")),
    ("tiny", include_str!("../../../configs/scenes/tiny.json")),
];

/// Text of the shipped scene `name`.
#[must_use]
pub fn builtin_scene(name: &str) -> Option<&'static str> {
    SCENES.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

/// Names of the shipped scenes.
#[must_use]
pub fn builtin_names() -> Vec<&'static str> {
    SCENES.iter().map(|(name, _)| *name).collect()
}
