//! From any OBJ text to the plain part of it that tobj reads right.

use std::borrow::Cow;
use std::fmt::Write as _;

use super::{LeftOut, ObjError};

/// Text for tobj, and what its objects are called: object `o 7` is `sections[7]`.
#[derive(Debug, Default)]
pub struct Cleaned {
    pub text: String,
    pub sections: Vec<Section>,
    pub left_out: Vec<LeftOut>,
}

/// A run of faces with the object and the groups that they belong to, as written.
#[derive(Debug, Clone, Default)]
pub struct Section {
    pub object: String,
    pub groups: String,
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

/// How many of each element have been read.
#[derive(Default)]
struct Counts {
    vertices: usize,
    texcoords: usize,
    normals: usize,
}

/// Statements whose arguments are names: text in which `#` and `\` mean nothing.
const NAMES: [&str; 6] = ["o", "g", "usemtl", "mtllib", "usemap", "maplib"];
/// Statements of numbers that are read.
const READ: [&str; 5] = ["v", "vt", "vn", "f", "fo"];
/// Statements that no triangle depends on: points and lines, smoothing, display, and what curves and surfaces consist
/// of.
const UNUSED: [&str; 28] = [
    "vp",
    "p",
    "l",
    "s",
    "mg",
    "cstype",
    "deg",
    "bmat",
    "step",
    "curv",
    "curv2",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "con",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
    "res",
    "csh",
];

/// Checks and rewrites the text in `bytes`; see [`super`].
pub fn clean(bytes: &[u8]) -> Result<Cleaned, Fault> {
    if bytes.starts_with(b"\xfe\xff") || bytes.starts_with(b"\xff\xfe") {
        return Err(fault(1, "a byte order mark of UTF-16", "UTF-8 text"));
    }
    let mut reader = Reader::default();
    let mut lines = bytes.split(|&byte| byte == b'\n').map(decode).zip(1..).peekable();
    while let Some((first, number)) = lines.next() {
        // Join continued lines. A backslash inside a comment continues nothing, one at the end of a name seldom does:
        // folders end in it, and the next line is a statement of its own.
        let mut statement = first.trim().to_owned();
        while statement.ends_with('\\') && !has_comment(&statement) {
            let next = lines.peek().map_or("", |(next, _)| next.trim());
            if NAMES.contains(&keyword(&statement)) && (next.is_empty() || is_statement(next)) {
                break;
            }
            statement.pop();
            statement.push(' ');
            statement.push_str(next);
            lines.next();
        }
        reader.statement(&statement, number)?;
    }
    Ok(reader.out)
}

/// A line as text: UTF-8, or else Latin-1, in which every byte is a letter. A byte order mark, which files that were
/// put together from several have in their middle, is left out.
fn decode(line: &[u8]) -> Cow<'_, str> {
    let line = line.strip_prefix("\u{feff}".as_bytes()).unwrap_or(line);
    match core::str::from_utf8(line) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(line.iter().map(|&byte| char::from(byte)).collect()),
    }
}

fn keyword(statement: &str) -> &str {
    statement.split_whitespace().next().unwrap_or("")
}

/// Whether a line begins as a comment or a statement of the format does.
fn is_statement(line: &str) -> bool {
    let keyword = keyword(line);
    keyword.starts_with('#')
        || [&NAMES[..], &READ[..], &UNUSED[..]].iter().any(|known| known.contains(&keyword))
}

/// Whether a comment ends the statement. A `#` inside a word begins none: `1.#INF` is one word.
fn has_comment(statement: &str) -> bool {
    let names = NAMES.contains(&keyword(statement));
    !names && statement.split_whitespace().any(|word| word.starts_with('#'))
}

/// What has been read so far.
#[derive(Default)]
struct Reader {
    counts: Counts,
    section: Section,
    /// Whether `section` has faces.
    has_faces: bool,
    out: Cleaned,
}

impl Reader {
    fn statement(&mut self, statement: &str, line: usize) -> Result<(), Fault> {
        let keyword = keyword(statement);
        let is_text = keyword.starts_with('#') || NAMES.contains(&keyword);
        // A lone CR is the line end of old systems: all that follows it would be lost in a comment or a name.
        let is_bad = |c: char| c == '\r' || (!is_text && c.is_control() && c != '\t');
        if let Some(bad) = statement.chars().find(|&c| is_bad(c)) {
            return Err(fault(
                line,
                format!("control character U+{:04X}", bad as u32),
                "text, in lines that end in LF or CR LF",
            ));
        }
        let arguments = statement[keyword.len()..].trim();
        let values = || arguments.split_whitespace().take_while(|word| !word.starts_with('#'));
        match keyword {
            "v" => {
                self.counts.vertices += 1;
                vertex(values(), line, &mut self.out.text)?;
            }
            "vt" => self.counts.texcoords += 1,
            "vn" => self.counts.normals += 1,
            // `fo` is how version 2 of the format wrote a face with an outline.
            "f" | "fo" => {
                self.has_faces = true;
                face(values(), line, &self.counts, &mut self.out.text)?;
            }
            "o" => {
                self.section.object = arguments.to_owned();
                // Groups belong to the object before, unless they were named for the faces that follow.
                if self.has_faces {
                    self.section.groups.clear();
                }
                self.begin_section();
            }
            "g" => {
                self.section.groups = arguments.to_owned();
                self.begin_section();
            }
            "" => {}
            _ if keyword.starts_with('#') || UNUSED.contains(&keyword) || NAMES.contains(&keyword) => {}
            _ => self.leave_out(keyword, line),
        }
        Ok(())
    }

    fn begin_section(&mut self) {
        self.has_faces = false;
        writeln!(self.out.text, "o {}", self.out.sections.len()).expect("a String takes everything");
        self.out.sections.push(self.section.clone());
    }

    fn leave_out(&mut self, keyword: &str, line: usize) {
        let left_out = &mut self.out.left_out;
        match left_out.iter_mut().find(|kind| kind.keyword == keyword) {
            Some(kind) => kind.lines += 1,
            None => left_out.push(LeftOut { keyword: keyword.to_owned(), first_line: line, lines: 1 }),
        }
    }
}

/// `x y z`; what follows (w, colors) is left out.
fn vertex<'a>(values: impl Iterator<Item = &'a str>, line: usize, out: &mut String) -> Result<(), Fault> {
    let mut found = 0;
    out.push('v');
    for value in values.take(3) {
        let bad = |expected: &str| fault(line, format!("coordinate `{value}`"), expected);
        let number: f64 = match value.parse() {
            Ok(number) => number,
            Err(_) if is_windows_non_finite(value) => f64::NAN,
            Err(_) => return Err(bad("a decimal number such as -1.5 or 2e-3")),
        };
        // Kernels compute in single precision.
        if !(number as f32).is_finite() {
            return Err(bad("finite and below 3.4e38"));
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

/// `1.#INF`, `-1.#IND` and their like: how old Windows libraries print what is no finite number.
fn is_windows_non_finite(value: &str) -> bool {
    value.trim_start_matches(['+', '-']).starts_with("1.#")
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
