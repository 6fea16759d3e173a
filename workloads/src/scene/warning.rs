//! What is sound but hardly meant.

use core::fmt;
use std::path::Path;

use super::Scene;
use crate::adjacency::{Adjacency, Aspect, CUT_TRIANGLES_MAX, Stance, stances};
use crate::mesh::ObjectRange;
use crate::obj::LeftOut;

/// Radius of a light, in diagonals of the scene, up to which what cuts it is told apart from the horizon.
const HUGE_DIAGONALS: f64 = 10.0;

/// Something about a scene that its maker should know.
#[derive(Debug, Clone, PartialEq)]
pub enum SceneWarning {
    /// The OBJ file has lines that were not understood.
    LeftOut {
        /// Name of the OBJ file that has the lines.
        file: String,
        /// Word that the lines begin with, the first of them, and their number.
        lines: LeftOut,
    },
    /// The light reaches into more triangles than are looked at one by one: what the others hide of the parts of the light that are
    /// behind them is not known.
    LightTouches {
        /// Number of the triangles.
        triangles: usize,
        /// Distance of the middle of the light from the nearest of those that are not looked at, world units.
        distance: f64,
        /// Radius of the light, world units.
        radius: f64,
        /// Object of that triangle; empty if it has no name.
        object: String,
    },
    /// The light is far larger than the scene, which lies in it: nearly all of it is seen along the horizons of receivers.
    LightHuge {
        /// Radius of the light in diagonals of the scene.
        diagonals: f64,
    },
    /// The light is inside a closed body that the camera is outside of: all that is seen is in its shadow.
    LightEnclosed {
        /// Object of the body; empty if it has no name.
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
            Self::LightTouches { triangles, distance, radius, object } => {
                let of = named(" of ", object);
                write!(
                    f,
                    "the light is cut by {triangles} triangles, and shadows are right for {CUT_TRIANGLES_MAX}: its radius is \
                     {radius:.4} and a triangle{of} {distance:.4} from its middle is one of the others; move the light \
                     or make it smaller"
                )
            }
            Self::LightHuge { diagonals } => write!(
                f,
                "the light holds the whole scene: its radius is {diagonals:.0} of the scene's diagonals, and from {HUGE_DIAGONALS} on \
                 what hides it is not told apart along the horizon; a directional light is a far one"
            ),
            Self::LightEnclosed { object } => write!(
                f,
                "the light is inside a closed body{} and the camera is not: all that is seen is dark; move \
                 the light out of the body",
                named(", ", object)
            ),
        }
    }
}

/// The name of an object after `before`; nothing of one without a name.
fn named(before: &str, object: &str) -> String {
    if object.is_empty() { String::new() } else { format!("{before}`{object}`") }
}

impl Scene {
    /// What should be known before the scene is drawn: lines of its model that were left out, a light that reaches into too
    /// much or is shut in. `adjacency` must be that of the mesh. Looks at every triangle.
    #[must_use]
    pub fn warnings(&self, adjacency: &Adjacency) -> Vec<SceneWarning> {
        // Its name alone: where a file lies does not belong in results.
        let file =
            Path::new(&self.source).file_name().map_or_else(String::new, |name| name.display().to_string());
        let left_out = self
            .left_out
            .iter()
            .map(|lines| SceneWarning::LeftOut { file: file.clone(), lines: lines.clone() });
        let aspect = Aspect::new(&self.light, &self.mesh, adjacency);
        // A light that looks out of a body lights what it looks at.
        let of_light = if aspect.cut.is_empty() { self.enclosed(adjacency) } else { self.touched(&aspect) };
        left_out.chain(of_light).collect()
    }

    /// What is not known of a light that triangles cut: where it is larger than all that is around, and where more do than are
    /// looked at.
    fn touched(&self, aspect: &Aspect) -> Option<SceneWarning> {
        let radius = self.light.radius();
        let diagonals = radius / self.mesh.bounds().diagonal();
        if diagonals > HUGE_DIAGONALS {
            return Some(SceneWarning::LightHuge { diagonals });
        }
        let left = aspect.cut_left?;
        let triangle = left.nearest as usize;
        Some(SceneWarning::LightTouches {
            triangles: aspect.cut.len() + left.triangles,
            distance: self.light.distance_to(self.mesh.corners(triangle)),
            radius,
            object: self.object_of(triangle),
        })
    }

    /// A closed body that the light is in and the camera is not. A room that both are in, or that has an opening, is
    /// none.
    fn enclosed(&self, adjacency: &Adjacency) -> Option<SceneWarning> {
        let about = |place| stances(&self.mesh, adjacency, place);
        let light = about(self.light.center());
        if !light.contains(&Stance::TurnedOver) {
            return None;
        }
        let mut both = light.iter().zip(about(self.camera.eye));
        let triangle =
            both.position(|(light, eye)| (*light, eye) == (Stance::TurnedOver, Stance::AsItRuns))?;
        Some(SceneWarning::LightEnclosed { object: self.object_of(triangle) })
    }

    /// Name of the object that has the triangle; empty if it has none.
    fn object_of(&self, triangle: usize) -> String {
        let holds = |object: &&ObjectRange| (object.first as usize..object.last as usize).contains(&triangle);
        self.mesh.objects.iter().find(holds).map_or_else(String::new, |object| object.name.clone())
    }
}
