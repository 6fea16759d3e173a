//! What is sound but hardly meant.

use core::fmt;
use std::path::Path;

use super::Scene;
use crate::light::Light;
use crate::obj::LeftOut;

/// Something about a scene that its maker should know.
#[derive(Debug, Clone, PartialEq)]
pub enum SceneWarning {
    /// The OBJ file has lines that were not understood.
    LeftOut {
        /// File that has them.
        file: String,
        /// Word that the lines begin with, the first of them, and their number.
        lines: LeftOut,
    },
    /// The light reaches into a triangle: a part of it is then behind that triangle, or inside a body.
    LightTouches {
        /// Distance of the middle of the light from the triangle, world units.
        distance: f64,
        /// Radius of the light, world units.
        radius: f64,
        /// Object of the triangle; empty if it has no name.
        object: String,
    },
}

impl fmt::Display for SceneWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LeftOut { file, lines: LeftOut { keyword, first_line, lines } } => {
                // A file of another kind can have a word of any length.
                let shown: String = keyword.chars().take(20).collect();
                let count = if *lines == 1 { "a line".to_owned() } else { format!("{lines} lines") };
                write!(
                    f,
                    "{file}:{first_line}: {count} with `{shown}` left out; triangles come from `v` and `f` alone"
                )
            }
            Self::LightTouches { distance, radius, object } => {
                let of = if object.is_empty() { String::new() } else { format!(" of `{object}`") };
                write!(
                    f,
                    "the light touches a triangle{of}: its radius is {radius:.4} and the triangle is {distance:.4} from \
                     its middle; its shadows are right only where it is clear of everything"
                )
            }
        }
    }
}

impl Scene {
    /// What should be known before the scene is drawn: lines of its model that were left out, a light that touches
    /// something. Looks at every triangle.
    #[must_use]
    pub fn warnings(&self) -> Vec<SceneWarning> {
        // Its name alone: where a file lies does not belong in results.
        let file =
            Path::new(&self.source).file_name().map_or_else(String::new, |name| name.display().to_string());
        let left_out = self
            .left_out
            .iter()
            .map(|lines| SceneWarning::LeftOut { file: file.clone(), lines: lines.clone() });
        left_out.chain(self.touched()).collect()
    }

    /// The triangle that is nearest to a light that reaches it.
    fn touched(&self) -> Option<SceneWarning> {
        if matches!(self.light, Light::Rect { .. } | Light::Linear { .. }) {
            return None;
        }
        let radius = self.light.disc_radius();
        let distances = (0..self.mesh.triangles.len()).map(|t| self.light.distance_to(self.mesh.corners(t)));
        let (triangle, distance) = distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        if distance > radius {
            return None;
        }
        let holds = |object: &&crate::mesh::ObjectRange| {
            (object.first as usize..object.last as usize).contains(&triangle)
        };
        let object = self.mesh.objects.iter().find(holds).map_or("", |object| &object.name).to_owned();
        Some(SceneWarning::LightTouches { distance, radius, object })
    }
}
