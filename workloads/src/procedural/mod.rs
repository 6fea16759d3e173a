//! Meshes made by code. The same name, seed and detail give the same bytes on every host.

mod cornell;
mod furniture;
mod random;
mod saloon;
mod shapes;
mod table;
mod tiny;

#[cfg(test)]
mod tests;

pub use shapes::Builder;

use crate::mesh::Mesh;
use crate::scene::{Procedural, SceneError};

/// Names of the generators.
pub const NAMES: [&str; 4] = ["cornell", "saloon", "table", "tiny"];

/// Makes the mesh that a scene file asks for.
///
/// # Errors
/// If there is no generator of that name.
pub fn build(request: &Procedural) -> Result<Mesh, SceneError> {
    match request.procedural.as_str() {
        "cornell" => Ok(cornell::cornell()),
        "saloon" => Ok(saloon::saloon(request.seed, request.detail)),
        "table" => Ok(table::table(request.detail)),
        "tiny" => Ok(tiny::tiny(request.detail)),
        other => Err(SceneError::Value {
            at: "mesh.procedural".to_owned(),
            found: format!("`{other}`"),
            expected: format!("one of {}", NAMES.join(", ")),
        }),
    }
}
