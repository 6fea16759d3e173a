//! Scenes inside the binary.

/// Name and text of each shipped scene, in alphabetical order.
const SCENES: [(&str, &str); 12] = [
    ("cornell", include_str!("../../../configs/scenes/cornell.json")),
    ("fern", include_str!("../../../configs/scenes/fern.json")),
    ("palm", include_str!("../../../configs/scenes/palm.json")),
    ("plates", include_str!("../../../configs/scenes/plates.json")),
    ("saloon", include_str!("../../../configs/scenes/saloon.json")),
    ("saloon-orbit", include_str!("../../../configs/scenes/saloon-orbit.json")),
    ("saloon-panel", include_str!("../../../configs/scenes/saloon-panel.json")),
    ("saloon-small", include_str!("../../../configs/scenes/saloon-small.json")),
    ("saloon-tube", include_str!("../../../configs/scenes/saloon-tube.json")),
    ("street", include_str!("../../../configs/scenes/street.json")),
    ("table", include_str!("../../../configs/scenes/table.json")),
    ("tiny", include_str!("../../../configs/scenes/tiny.json")),
];

/// Views of models that are not in the binary: name, text.
const MODELS: [(&str, &str); 16] = [
    ("apartment", include_str!("../../../configs/scenes/models/apartment.json")),
    ("bridge_garden", include_str!("../../../configs/scenes/models/bridge_garden.json")),
    ("bunny", include_str!("../../../configs/scenes/models/bunny.json")),
    ("cornell_box", include_str!("../../../configs/scenes/models/cornell_box.json")),
    ("country_kitchen", include_str!("../../../configs/scenes/models/country_kitchen.json")),
    ("dinner_table", include_str!("../../../configs/scenes/models/dinner_table.json")),
    ("dragon", include_str!("../../../configs/scenes/models/dragon.json")),
    ("fern_bed", include_str!("../../../configs/scenes/models/fern_bed.json")),
    ("japanese_temple", include_str!("../../../configs/scenes/models/japanese_temple.json")),
    ("linz_old_town", include_str!("../../../configs/scenes/models/linz_old_town.json")),
    ("oak_tree", include_str!("../../../configs/scenes/models/oak_tree.json")),
    ("palm_grove", include_str!("../../../configs/scenes/models/palm_grove.json")),
    ("street_city", include_str!("../../../configs/scenes/models/street_city.json")),
    ("table_blocker", include_str!("../../../configs/scenes/models/table_blocker.json")),
    ("tavern", include_str!("../../../configs/scenes/models/tavern.json")),
    ("teapot", include_str!("../../../configs/scenes/models/teapot.json")),
];

/// Text of the shipped scene `name`, one of [`builtin_names`] or [`model_names`].
#[must_use]
pub fn builtin_scene(name: &str) -> Option<&'static str> {
    SCENES.iter().chain(&MODELS).find(|(n, _)| *n == name).map(|(_, text)| *text)
}

/// Names of the shipped scenes that need nothing else.
#[must_use]
pub fn builtin_names() -> Vec<&'static str> {
    SCENES.iter().map(|(name, _)| *name).collect()
}

/// Names of the shipped scenes whose model must be found: see [`super::search`].
#[must_use]
pub fn model_names() -> Vec<&'static str> {
    MODELS.iter().map(|(name, _)| *name).collect()
}
