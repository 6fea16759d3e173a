//! Wavefront OBJ files, read by tobj after they have been cleaned.
//!
//! tobj takes some bad files for good and some good ones for bad; so `clean` checks every statement that matters,
//! with line numbers, and hands on only `o`, `v x y z` and `f i j k …` in their plainest form. Polygons are
//! triangulated here (`triangulate`), as a fan covers the outside of a concave one.

mod clean;
mod triangulate;

#[cfg(test)]
mod tests;

use std::path::Path;

use glam::DVec3;

use crate::mesh::{Mesh, ObjectRange};

/// What is wrong with an OBJ file.
#[derive(Debug, thiserror::Error)]
pub enum ObjError {
    /// The file could not be read.
    #[error("cannot read `{path}`: {source}")]
    Read {
        /// Path of the file.
        path: String,
        /// What the system said of the file.
        source: std::io::Error,
    },
    /// A statement is not sound.
    #[error("{path}:{line}: found {found}; it must be {expected}")]
    Line {
        /// Path of the file.
        path: String,
        /// Line of the file, from 1.
        line: usize,
        /// The text that was found there.
        found: String,
        /// The text that would be right there.
        expected: String,
    },
    /// More vertices or triangles than 32-bit indices can name.
    #[error("`{path}` has {count} {what}; at most 2^31 - 1 can be used")]
    TooLarge {
        /// Path of the file.
        path: String,
        /// How many vertices or triangles there are.
        count: usize,
        /// What there is too much of: `vertices` or `triangles`.
        what: &'static str,
    },
    /// tobj refused text that had been checked.
    #[error("`{path}`: {source}")]
    Tobj {
        /// Path of the file.
        path: String,
        /// What tobj said of the file.
        source: tobj::LoadError,
    },
}

/// What an OBJ file holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObjFile {
    /// The triangles, as the file has them.
    pub mesh: Mesh,
    /// Statements that were not understood, a kind each, in the order of the file.
    pub left_out: Vec<LeftOut>,
}

/// Lines that begin with a word that is no statement known here, or one that makes surfaces which are not drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// The word that the lines begin with.
    pub keyword: String,
    /// The first of the lines, from 1.
    pub first_line: usize,
    /// How many lines begin with the word.
    pub lines: usize,
}

/// Reads the OBJ file at `path`. A file without faces gives a mesh without triangles.
///
/// # Errors
/// If the file cannot be read or is not sound.
pub fn read_file(path: &Path) -> Result<ObjFile, ObjError> {
    let shown = path.display().to_string();
    match std::fs::read(path) {
        Ok(bytes) => read_bytes(&bytes, &shown),
        Err(source) => Err(ObjError::Read { path: shown, source }),
    }
}

/// Reads OBJ text; `path` is for messages only.
///
/// # Errors
/// If the text is not sound.
pub fn read_bytes(bytes: &[u8], path: &str) -> Result<ObjFile, ObjError> {
    let cleaned = clean::clean(bytes).map_err(|fault| fault.at(path))?;
    let options = tobj::LoadOptions { ignore_points: true, ignore_lines: true, ..Default::default() };
    let no_materials = |_: &Path| Err(tobj::LoadError::GenericFailure);
    let (models, _) = tobj::load_obj_buf(&mut cleaned.text.as_bytes(), &options, no_materials)
        .map_err(|source| ObjError::Tobj { path: path.to_owned(), source })?;

    let mut mesh = Mesh::default();
    for model in models {
        let first = mesh.triangles.len();
        append_model(&mut mesh, &model.mesh);
        // The cleaner numbers objects, because tobj trims names and lets a group replace its object.
        let section = model.name.parse::<usize>().ok().and_then(|k| cleaned.sections.get(k));
        let section = section.cloned().unwrap_or_default();
        mesh.objects.push(ObjectRange {
            name: section.object,
            groups: section.groups,
            first: first as u32,
            last: mesh.triangles.len() as u32,
        });
    }
    for (count, what) in [(mesh.positions.len(), "vertices"), (mesh.triangles.len(), "triangles")] {
        if count > i32::MAX as usize {
            return Err(ObjError::TooLarge { path: path.to_owned(), count, what });
        }
    }
    Ok(ObjFile { mesh, left_out: cleaned.left_out })
}

fn append_model(mesh: &mut Mesh, model: &tobj::Mesh) {
    let first_vertex = mesh.positions.len() as u32;
    mesh.positions.extend(model.positions.chunks_exact(3).map(DVec3::from_slice));
    // tobj leaves the arities empty if all faces are triangles.
    let all_triangles = vec![3; if model.face_arities.is_empty() { model.indices.len() / 3 } else { 0 }];
    let mut rest = model.indices.as_slice();
    for &arity in model.face_arities.iter().chain(&all_triangles) {
        let (face, tail) = rest.split_at(arity as usize);
        rest = tail;
        let corners: Vec<DVec3> = face.iter().map(|&v| mesh.positions[(v + first_vertex) as usize]).collect();
        for t in triangulate::triangulate(&corners) {
            mesh.triangles.push(t.map(|k| face[k] + first_vertex));
        }
    }
}
