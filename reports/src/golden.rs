//! Golden files: what a writer wrote when somebody last looked at it.

use std::path::Path;

/// Compares `text` with `src/golden/NAME`; with `LRBSIM_UPDATE_GOLDEN` set, writes the file instead.
pub(crate) fn check(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/golden").join(name);
    if std::env::var_os("LRBSIM_UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, text).expect("the folder of golden files can be written");
    }
    let golden = std::fs::read_to_string(&path).expect("the golden file exists");
    assert_eq!(text, golden, "{name} changed; if that is right, run the tests with LRBSIM_UPDATE_GOLDEN=1");
}
