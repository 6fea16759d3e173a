//! From any OBJ text to the plain part of it that tobj reads right.

use std::fmt::Write as _;

use super::ObjError;

/// Text for tobj, and the names of its objects: object `o 7` is called `names[7]`.
#[derive(Debug, Default)]
pub struct Cleaned {
    pub text: String,
    pub names: Vec<String>,
}

/// A bad statement, not yet tied to a file.
#[derive(Debug)]
pub struct Fault {
    line: usize,
    found: String,
    expected: String,
}

impl Fault {
    pub fn at(self, path: &str) -> ObjError {
        ObjError::Line { path: path.to_owned(), line: self.line, found: self.found, expected: self.expected }
    }
}

fn fault(line: usize, found: impl Into<String>, expected: impl Into<String>) -> Fault {
    Fault { line, found: found.into(), expected: expected.into() }
}

/// The bytes as UTF-8, without a byte order mark.
pub fn decode(bytes: &[u8]) -> Result<&str, Fault> {
    let text = core::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        fault(line, format!("byte {:#04x}", bytes[error.valid_up_to()]), "UTF-8 text")
    })?;
    Ok(text.strip_prefix('\u{feff}').unwrap_or(text))
}

/// How many of each element have been read.
#[derive(Default)]
struct Counts {
    vertices: usize,
    texcoords: usize,
    normals: usize,
}

/// Checks and rewrites `text`; see [`super`].
pub fn clean(text: &str) -> Result<Cleaned, Fault> {
    let mut out = Cleaned::default();
    let mut counts = Counts::default();
    let mut joined = String::new();
    let mut lines = text.lines().zip(1..);
    while let Some((first, number)) = lines.next() {
        // Join continued lines. A backslash inside a comment continues nothing.
        let mut statement = first.trim_end();
        if statement.ends_with('\\') && !statement.contains('#') {
            joined.clear();
            let mut part = statement;
            while let Some(head) = part.strip_suffix('\\') {
                joined.push_str(head);
                joined.push(' ');
                part = lines.next().map_or("", |(next, _)| next.trim_end());
            }
            joined.push_str(part);
            statement = &joined;
        }
        one_statement(statement, number, &mut counts, &mut out)?;
    }
    Ok(out)
}

fn one_statement(statement: &str, line: usize, counts: &mut Counts, out: &mut Cleaned) -> Result<(), Fault> {
    let statement = statement.trim();
    let keyword = statement.split_whitespace().next().unwrap_or("");
    if keyword.starts_with('#') {
        return Ok(());
    }
    if let Some(bad) = statement.chars().find(|c| c.is_control() && *c != '\t') {
        return Err(fault(
            line,
            format!("control character U+{:04X}", bad as u32),
            "text, in lines that end in LF or CR LF",
        ));
    }
    let arguments = &statement[keyword.len()..];
    let values = || arguments.split('#').next().unwrap_or("").split_whitespace();
    match keyword {
        "v" => {
            counts.vertices += 1;
            vertex(values(), line, &mut out.text)
        }
        "vt" => {
            counts.texcoords += 1;
            Ok(())
        }
        "vn" => {
            counts.normals += 1;
            Ok(())
        }
        "f" => face(values(), line, counts, &mut out.text),
        "o" | "g" => {
            writeln!(out.text, "o {}", out.names.len()).expect("a String takes everything");
            out.names.push(arguments.trim().to_owned());
            Ok(())
        }
        // Materials, smoothing, points, lines, free-form surfaces, and words that nobody knows: no triangles.
        _ => Ok(()),
    }
}

/// `x y z`; what follows (w, colors) is left out.
fn vertex<'a>(values: impl Iterator<Item = &'a str>, line: usize, out: &mut String) -> Result<(), Fault> {
    let mut found = 0;
    out.push('v');
    for value in values.take(3) {
        let number: f64 = value.parse().map_err(|_| {
            fault(line, format!("coordinate `{value}`"), "a decimal number such as -1.5 or 2e-3")
        })?;
        // Kernels compute in single precision.
        if !(number as f32).is_finite() {
            return Err(fault(line, format!("coordinate `{value}`"), "finite and below 3.4e38"));
        }
        out.push(' ');
        out.push_str(value);
        found += 1;
    }
    out.push('\n');
    if found < 3 {
        return Err(fault(line, format!("a vertex with {found} coordinates"), "a vertex with three"));
    }
    Ok(())
}

/// Three corners or more, `v`, `v/vt`, `v//vn` or `v/vt/vn`; only `v` is kept, counted from 1.
fn face<'a>(
    values: impl Iterator<Item = &'a str>,
    line: usize,
    counts: &Counts,
    out: &mut String,
) -> Result<(), Fault> {
    let mut corners = 0;
    out.push('f');
    for corner in values {
        let mut parts = corner.split('/');
        let vertex = index(parts.next().unwrap_or(""), "vertex", counts.vertices, line)?;
        let texcoord = parts.next().unwrap_or("");
        let normal = parts.next().unwrap_or("");
        if !texcoord.is_empty() {
            index(texcoord, "texture coordinate", counts.texcoords, line)?;
        }
        // Some exporters write v/vt/vn and no normals at all; nothing is lost. But v//vn is there for its normal.
        if !normal.is_empty() && (counts.normals > 0 || texcoord.is_empty()) {
            index(normal, "normal", counts.normals, line)?;
        }
        if parts.next().is_some() {
            return Err(fault(line, format!("corner `{corner}`"), "v, v/vt, v//vn or v/vt/vn"));
        }
        write!(out, " {vertex}").expect("a String takes everything");
        corners += 1;
    }
    out.push('\n');
    if corners < 3 {
        return Err(fault(line, format!("a face with {corners} corners"), "a face with three or more"));
    }
    Ok(())
}

/// An index from 1, or from the end if negative, of an element that has been read.
fn index(text: &str, what: &str, count: usize, line: usize) -> Result<usize, Fault> {
    let bad = || {
        let range = match count {
            0 => format!("the index of a {what}, of which none has been read yet"),
            _ => format!("the index of a {what} in 1..={count} or -{count}..=-1"),
        };
        fault(line, format!("{what} `{text}`"), range)
    };
    let number: i64 = text.parse().map_err(|_| bad())?;
    let from_one = if number < 0 { number.checked_add_unsigned(count as u64 + 1) } else { Some(number) };
    match from_one {
        Some(i) if i >= 1 && i as u64 <= count as u64 => Ok(i as usize),
        _ => Err(bad()),
    }
}
