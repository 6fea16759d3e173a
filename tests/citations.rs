//! What files and comments cite is here to be read.

use std::path::{Path, PathBuf};

/// All files below `folder` with this extension.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("the folder exists") {
        let path = entry.expect("readable").path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Numbers of the sections of a page: of `### 2.4 Coherence`, `2.4`.
fn sections(page: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join("docs").join(page)).expect("the page exists");
    let headings = text.lines().filter_map(|line| line.trim_start_matches('#').strip_prefix(' '));
    let numbers = headings.filter_map(|heading| heading.split_whitespace().next());
    numbers.filter(|word| word.starts_with(|c: char| c.is_ascii_digit())).map(number).collect()
}

/// `2.4` of `§2.4,` and `2.` alike.
fn number(word: &str) -> String {
    word.trim_matches(|c: char| !c.is_ascii_digit()).to_owned()
}

#[test]
fn sections_that_machine_files_cite_are_in_the_page() {
    let sections = sections("machine.md");
    let mut cited = 0;
    for path in files(&root().join("configs"), "json") {
        let text = std::fs::read_to_string(&path).expect("readable");
        for (at, _) in text.match_indices("machine.md") {
            assert!(text[..at].ends_with("docs/"), "{}: which machine.md?", path.display());
            let rest = text[at..].strip_prefix("machine.md ").unwrap_or_default();
            let Some(word) =
                rest.split_whitespace().next().filter(|word| word.starts_with(|c: char| c.is_ascii_digit()))
            else {
                continue; // the whole page
            };
            assert!(
                sections.contains(&number(word)),
                "{}: docs/machine.md has no section {word}",
                path.display()
            );
            cited += 1;
        }
    }
    assert!(cited > 100, "{cited}");
}

#[test]
fn sections_that_comments_cite_are_in_the_page() {
    let sections = sections("algorithms.md");
    let mut cited = 0;
    for folder in ["sim", "kernels", "workloads", "src"] {
        for path in files(&root().join(folder), "rs") {
            let text = std::fs::read_to_string(&path).expect("readable");
            for (at, found) in text.match_indices("algorithms, ") {
                // Up to the next key or the end of the citation.
                let rest = &text[at + found.len()..];
                let place = &rest[..rest.find([']', ';']).expect("a citation ends")];
                for word in place.split([',', ' ']).filter(|word| word.contains(|c: char| c.is_ascii_digit()))
                {
                    assert!(
                        sections.contains(&number(word)),
                        "{}: docs/algorithms.md has no section {word}",
                        path.display()
                    );
                    cited += 1;
                }
            }
        }
    }
    assert!(cited > 20, "{cited}");
}
