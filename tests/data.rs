//! What tests read is all here: a file that is lost or changed fails a test instead of letting one pass without it.

use std::collections::BTreeMap;
use std::path::Path;

use lrbsim_reports::picture::sha256;

/// Adds the files below `folder` with their hashes, by their path from `root`.
fn add(found: &mut BTreeMap<String, String>, root: &Path, folder: &Path) {
    for entry in std::fs::read_dir(folder).expect("the folder exists") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            add(found, root, &path);
        } else {
            let name = path.strip_prefix(root).expect("it lies below").display().to_string();
            found.insert(name, sha256(&std::fs::read(&path).expect("readable")));
        }
    }
}

#[test]
fn the_data_of_tests_are_what_their_list_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let mut found = BTreeMap::new();
    add(&mut found, &root, &root);
    found.remove("SHA256SUMS").expect("the list is there");
    let list = std::fs::read_to_string(root.join("SHA256SUMS")).expect("text");
    let listed: BTreeMap<String, String> = list
        .lines()
        .map(|line| line.split_once("  ").expect("a hash and a name, as `sha256sum` writes them"))
        .map(|(hash, name)| (name.to_owned(), hash.to_owned()))
        .collect();
    let differ: Vec<&String> =
        listed.keys().chain(found.keys()).filter(|name| listed.get(*name) != found.get(*name)).collect();
    assert!(
        differ.is_empty(),
        "lost, changed or not listed: {differ:?}; once that is meant: cd tests/data && \
         find . -type f ! -name SHA256SUMS -printf '%P\\n' | LC_ALL=C sort | xargs sha256sum > SHA256SUMS"
    );
}
