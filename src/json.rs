//! JSON input, with the place in the text of whatever is wrong with it.

use std::ops::Range;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::error::BadInput;

/// Where one member of an object or element of an array stands in a text.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Spot {
    /// Path from the root, such as `l2.capacity_bytes` or `light.center[1]`.
    path: String,
    /// The key of a member; the value itself in an array.
    key: Range<usize>,
    value: Range<usize>,
}

/// The places of all members and elements of a JSON text.
#[derive(Debug)]
pub struct Spots(Vec<Spot>);

impl Spots {
    /// Scans `text`, which must be sound JSON: of anything else only a part is found.
    pub fn of(text: &str) -> Spots {
        let mut scanner = Scanner { text: text.as_bytes(), at: 0, spots: Vec::new() };
        let _ = scanner.value("");
        Spots(scanner.spots)
    }

    /// Bytes of the value at `path`; of the nearest value around it when it is not in the text.
    pub fn value(&self, path: &str) -> Option<Range<usize>> {
        self.nearest(path).map(|spot| spot.value.clone())
    }

    /// Bytes of the key at `path`.
    pub fn key(&self, path: &str) -> Option<Range<usize>> {
        self.0.iter().find(|spot| spot.path == path).map(|spot| spot.key.clone())
    }

    fn nearest(&self, path: &str) -> Option<&Spot> {
        let mut path = path;
        loop {
            if let Some(spot) = self.0.iter().find(|spot| spot.path == path) {
                return Some(spot);
            }
            path = &path[..path.rfind(['.', '['])?];
        }
    }

    /// The second of two members of one object with the same name.
    fn twice(&self) -> Option<&Spot> {
        let mut seen = std::collections::BTreeSet::new();
        self.0.iter().find(|spot| !seen.insert(spot.path.as_str()))
    }
}

struct Scanner<'a> {
    text: &'a [u8],
    at: usize,
    spots: Vec<Spot>,
}

impl Scanner<'_> {
    fn space(&mut self) -> Option<u8> {
        while self.text.get(self.at)?.is_ascii_whitespace() {
            self.at += 1;
        }
        Some(self.text[self.at])
    }

    /// Passes one value; its bytes. `None` where the text is not JSON.
    fn value(&mut self, path: &str) -> Option<Range<usize>> {
        let first = self.space()?;
        let start = self.at;
        match first {
            b'{' => self.members(path)?,
            b'[' => self.elements(path)?,
            b'"' => self.string()?,
            _ => {
                while self.text.get(self.at).is_some_and(|byte| !b",]} \t\r\n".contains(byte)) {
                    self.at += 1;
                }
            }
        }
        Some(start..self.at)
    }

    fn members(&mut self, path: &str) -> Option<()> {
        self.at += 1;
        while self.space()? != b'}' {
            let start = self.at;
            self.string()?;
            let key = start..self.at;
            let name: String = serde_json::from_slice(&self.text[key.clone()]).ok()?;
            (self.space()? == b':').then_some(())?;
            self.at += 1;
            let path = if path.is_empty() { name } else { format!("{path}.{name}") };
            let value = self.value(&path)?;
            self.spots.push(Spot { path, key, value });
            if self.space()? == b',' {
                self.at += 1;
            }
        }
        self.at += 1;
        Some(())
    }

    fn elements(&mut self, path: &str) -> Option<()> {
        self.at += 1;
        let mut index = 0;
        while self.space()? != b']' {
            let path = format!("{path}[{index}]");
            let value = self.value(&path)?;
            self.spots.push(Spot { path, key: value.clone(), value });
            index += 1;
            if self.space()? == b',' {
                self.at += 1;
            }
        }
        self.at += 1;
        Some(())
    }

    fn string(&mut self) -> Option<()> {
        (*self.text.get(self.at)? == b'"').then_some(())?;
        self.at += 1;
        while *self.text.get(self.at)? != b'"' {
            self.at += if self.text[self.at] == b'\\' { 2 } else { 1 };
        }
        self.at += 1;
        Some(())
    }
}

/// Text of a JSON file, without the byte order mark that some editors put first.
pub fn text(path: &Path) -> Result<String, BadInput> {
    let bytes = std::fs::read(path).map_err(|error| BadInput::unreadable(path, &error))?;
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(BadInput::new(format!("`{}` is UTF-16 text; it must be UTF-8", path.display()))
            .with_help("editors name the encoding where they save a file"));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        BadInput::new(format!("`{}` is not UTF-8 text: a wrong byte in line {line}", path.display()))
    })?;
    Ok(text.to_owned())
}

/// Reads a `T` from the text of `file`; every error points into the text.
pub fn read<T: DeserializeOwned>(file: &str, text: &str) -> Result<T, BadInput> {
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let path = error.path().to_string();
        explain(file, text, &path, error.inner())
    })?;
    deserializer.end().map_err(|error| explain(file, text, ".", &error))?;
    if let Some(spot) = Spots::of(text).twice() {
        let message = format!("`{}` is there twice", spot.path);
        return Err(BadInput::new(message).at(file, text, spot.key.clone(), "remove one of them"));
    }
    Ok(value)
}

/// An error of serde_json as a message of ours. `path` is `.` for the root.
fn explain(file: &str, text: &str, path: &str, error: &serde_json::Error) -> BadInput {
    let said = without_position(&error.to_string());
    let offset = offset_of(text, error.line(), error.column());
    if !error.is_data() {
        let span = token_at(text, offset);
        let found = &text[span.clone()];
        if ["NaN", "nan", "Infinity", "inf", "-Infinity", "-inf", "-NaN"].contains(&found) {
            return BadInput::new(format!("`{found}` is not a number in JSON")).at(
                file,
                text,
                span,
                "must be a finite number",
            );
        }
        return BadInput::new(format!("not sound JSON: {said}")).at(file, text, span, said);
    }

    let spots = Spots::of(text);
    // Point at the value of a wrong type, at the key of an unknown field, at the object that lacks one.
    let unknown = said.strip_prefix("unknown field `").and_then(|rest| rest.split('`').next());
    let span = match unknown {
        Some(name) => {
            let inside = if path == "." { name.to_owned() } else { format!("{path}.{name}") };
            spots.key(path).filter(|_| path.ends_with(name)).or_else(|| spots.key(&inside))
        }
        None => spots.value(path),
    };
    let span = span.unwrap_or_else(|| token_at(text, offset));
    let place = if path == "." || unknown.is_some() { String::new() } else { format!("`{path}`: ") };
    BadInput::new(format!("{place}{said}")).at(file, text, span, short_label(&said))
}

/// What a label says beside the source: not the whole list of possible fields.
fn short_label(said: &str) -> String {
    said.split(", expected").next().unwrap_or(said).to_owned()
}

/// serde_json appends ` at line L column C`; the report shows both.
pub fn without_position(message: &str) -> String {
    match message.rfind(" at line ") {
        Some(end) => message[..end].to_owned(),
        None => message.to_owned(),
    }
}

/// Byte of a line and column, both from 1; columns count bytes.
fn offset_of(text: &str, line: usize, column: usize) -> usize {
    let start = text.split_inclusive('\n').take(line.saturating_sub(1)).map(str::len).sum::<usize>();
    let mut offset = (start + column.saturating_sub(1)).min(text.len());
    while !text.is_char_boundary(offset) {
        offset -= 1;
    }
    offset
}

/// The word around a byte, or the one character that stands there.
fn token_at(text: &str, offset: usize) -> Range<usize> {
    let word = |c: char| c.is_alphanumeric() || "+-._".contains(c);
    let end = text[offset..].find(|c| !word(c)).map_or(text.len(), |length| offset + length);
    let start = text[..offset]
        .rfind(|c| !word(c))
        .map_or(0, |at| at + text[at..].chars().next().map_or(1, char::len_utf8));
    if start < end {
        return start..end;
    }
    let length = text[offset..].chars().next().map_or(0, char::len_utf8);
    offset..offset + length
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only read")]
    struct Outer {
        a: u32,
        inner: Inner,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(dead_code, reason = "only read")]
    struct Inner {
        b: Vec<f64>,
    }

    /// Message, and the text that is pointed at.
    fn complaint(text: &str) -> (String, String) {
        use miette::Diagnostic as _;
        let error = read::<Outer>("x.json", text).expect_err("bad input");
        let label = error.labels().expect("a place").next().expect("one place");
        (error.to_string(), text[label.offset()..label.offset() + label.len()].to_owned())
    }

    #[test]
    fn places_are_found_by_path() {
        let text = r#"{ "a": {"b\"": [1, {"c": -2.5e3}]}, "d": "x,]" }"#;
        let spots = Spots::of(text);
        let at = |path: &str| spots.value(path).map(|range| &text[range]);
        assert_eq!(at("a.b\"[1].c"), Some("-2.5e3"));
        assert_eq!(at("a.b\"[0]"), Some("1"));
        assert_eq!(at("d"), Some("\"x,]\""));
        assert_eq!(at("d.not.there"), Some("\"x,]\""));
        assert_eq!(at("nowhere"), None);
    }

    #[test]
    fn a_wrong_type_is_pointed_at() {
        let (message, at) = complaint(r#"{"a": 1, "inner": {"b": [1, "two"]}}"#);
        assert_eq!(message, "`inner.b[1]`: invalid type: string \"two\", expected f64");
        assert_eq!(at, "\"two\"");
    }

    #[test]
    fn an_unknown_field_is_pointed_at() {
        let (message, at) = complaint(r#"{"a": 1, "inner": {"b": [], "c": 3}}"#);
        assert_eq!((message.as_str(), at.as_str()), ("unknown field `c`, expected `b`", "\"c\""));
        assert_eq!(complaint(r#"{"a": 1, "z": {}}"#).1, "\"z\"");
    }

    #[test]
    fn a_missing_field_points_at_its_object() {
        let (message, at) = complaint(r#"{"a": 1, "inner": {}}"#);
        assert_eq!((message.as_str(), at.as_str()), ("`inner`: missing field `b`", "{}"));
    }

    #[test]
    fn broken_json_is_pointed_at() {
        assert_eq!(complaint("{\"a\": 1,\n \"inner\" {}}").1, "{");
        assert!(complaint("{\"a\": 1").0.starts_with("not sound JSON"));
        assert!(complaint("").0.starts_with("not sound JSON"));
        assert!(complaint("{\"a\": 1, \"inner\": {\"b\": []}} x").0.starts_with("not sound JSON"));
    }

    #[test]
    fn a_number_that_is_none_is_named() {
        let (message, at) = complaint("{\"a\": 1, \"inner\": {\"b\": [NaN]}}");
        assert_eq!((message.as_str(), at.as_str()), ("`NaN` is not a number in JSON", "NaN"));
    }

    #[test]
    fn a_member_that_is_there_twice_is_pointed_at() {
        assert!(read::<serde_json::Value>("x", r#"{"a": 1, "a": 2}"#).is_err());
    }

    #[test]
    fn no_text_makes_it_panic() {
        let sound = "{\"a\": 1, \"inner\": {\"b\": [1, \"\u{e9}\\\"\"]}}";
        for (end, _) in sound.char_indices() {
            let _ = read::<Outer>("x", &sound[..end]);
            let _ = Spots::of(&sound[..end]);
            let _ = read::<Outer>("x", &sound[end..]);
            let _ = read::<Outer>("x", &format!("{}\u{e9}{}", &sound[..end], &sound[end..]));
        }
    }
}
