//! Changes to a machine or a scene by the path of a field, from the command line or from a study.

use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::BadInput;

/// A change of one field.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Path from the root, such as `l2.capacity_bytes`; elements of a list have their number, as in `light.center.1`.
    pub path: String,
    /// The new value of the field.
    pub value: Value,
    /// Who asked for the change, for messages: `--set cores=8`.
    pub said: String,
}

impl std::str::FromStr for Setting {
    type Err = BadInput;

    fn from_str(text: &str) -> Result<Setting, BadInput> {
        let Some((path, value)) = text.split_once('=') else {
            return Err(BadInput::new(format!(
                "`--set {text}` has no `=`; it must be PATH=VALUE, such as cores=8"
            )));
        };
        // What is not JSON is a string: names need no quotes.
        let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
        Ok(Setting { path: path.trim().to_owned(), value, said: format!("`--set {text}`") })
    }
}

impl Setting {
    /// The changes that `--set` was given, in order.
    pub fn all(texts: &[String]) -> Result<Vec<Setting>, BadInput> {
        texts.iter().map(|text| text.parse()).collect()
    }
}

/// Makes all changes to `tree`, in order; `root` is what the tree is, for messages.
pub fn apply(tree: &mut Value, settings: &[Setting], root: &str) -> Result<(), BadInput> {
    for setting in settings {
        *leaf(tree, setting, root)? = setting.value.clone();
    }
    Ok(())
}

/// Reads a changed tree; a value of a wrong type names who set it.
pub fn read_back<T: DeserializeOwned>(tree: Value, settings: &[Setting]) -> Result<T, BadInput> {
    serde_path_to_error::deserialize(tree).map_err(|error| {
        let path = error.path().to_string().replace('[', ".").replace(']', "");
        let about = |setting: &&Setting| path.starts_with(&setting.path) || setting.path.starts_with(&path);
        match settings.iter().rev().find(about).or(settings.last()) {
            Some(setting) => BadInput::new(format!("{}: {}", setting.said, error.inner())),
            None => BadInput::new(format!("`{path}`: {}", error.inner())),
        }
    })
}

/// The number, flag, name or list that `setting` changes.
fn leaf<'a>(tree: &'a mut Value, setting: &Setting, root: &str) -> Result<&'a mut Value, BadInput> {
    let said = &setting.said;
    let mut place = tree;
    let mut parent = String::new();
    for name in setting.path.split('.') {
        let at = if parent.is_empty() { root.to_owned() } else { format!("`{parent}`") };
        let known: Vec<String> = match &*place {
            Value::Object(members) => members.keys().cloned().collect(),
            Value::Array(list) => (0..list.len()).map(|index| index.to_string()).collect(),
            _ => return Err(BadInput::new(format!("{said}: {at} has no fields"))),
        };
        if !known.iter().any(|key| key == name) {
            return Err(BadInput::new(format!("{said}: {at} has no field `{name}`"))
                .with_help(nearest_first(name, "fields", &known)));
        }
        place = match place {
            Value::Array(list) => &mut list[name.parse::<usize>().expect("it is one of the known numbers")],
            members => &mut members[name],
        };
        parent = if parent.is_empty() { name.to_owned() } else { format!("{parent}.{name}") };
    }
    if let Value::Object(members) = place {
        let fields: Vec<String> = members.keys().map(|key| format!("{}.{key}", setting.path)).collect();
        return Err(BadInput::new(format!("{said} names a group of fields, not one"))
            .with_help(format!("fields: {}", fields.join(", "))));
    }
    Ok(place)
}

/// The valid names, which are `kind`, those most like `name` first.
pub fn nearest_first(name: &str, kind: &str, known: &[String]) -> String {
    let mut names: Vec<&String> = known.iter().collect();
    names.sort_by_cached_key(|candidate| distance(name, candidate));
    match names.first() {
        Some(nearest) if distance(name, nearest) <= name.len().div_ceil(3).max(1) => {
            let rest: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
            format!("did you mean `{nearest}`? {kind}: {}", rest.join(", "))
        }
        _ => format!("{kind}: {}", known.join(", ")),
    }
}

/// Least number of bytes put in, left out, replaced or exchanged with their neighbor that make `b` of `a`, where no byte is
/// touched twice: slips of a typist.
pub fn distance(a: &str, b: &str) -> usize {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    // Row i is of the first i bytes of `a`; a row needs the two before it.
    let mut rows: [Vec<usize>; 3] = [Vec::new(), Vec::new(), (0..=b.len()).collect()];
    for i in 1..=a.len() {
        rows.rotate_left(1);
        let [before, above, row] = &mut rows;
        row.clear();
        row.push(i);
        for j in 1..=b.len() {
            let replaced = above[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let exchanged = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
            let least = replaced.min(above[j] + 1).min(row[j - 1] + 1);
            row.push(if exchanged { least.min(before[j - 2] + 1) } else { least });
        }
    }
    rows[2][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_changes() {
        assert_eq!((distance("cores", "cores"), distance("cors", "cores"), distance("abc", "")), (0, 1, 3));
        assert_eq!((distance("", "abc"), distance("kitten", "sitting")), (3, 3));
    }

    #[test]
    fn exchanged_letters_are_one_slip() {
        assert_eq!((distance("coers", "cores"), distance("coers", "core")), (1, 2));
    }
}
