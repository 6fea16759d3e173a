//! Meshes made by code. The same name, seed and detail give the same bytes on every host.

mod cornell;
mod facade;
mod fern;
mod furnish;
mod furniture;
mod palm;
mod plates;
mod random;
mod saloon;
mod saloon_hall;
mod shapes;
mod street;
mod swept;
mod table;
mod tiny;

#[cfg(test)]
mod tests;

pub use shapes::Builder;

use crate::mesh::Mesh;
use crate::scene::{Procedural, SceneError};

/// Names of the generators.
pub const NAMES: [&str; 9] =
    ["cornell", "fern", "palm", "plates", "saloon", "saloon-hall", "street", "table", "tiny"];

/// Makes the mesh that a scene file asks for.
///
/// # Errors
/// If there is no generator of that name.
pub fn build(request: &Procedural) -> Result<Mesh, SceneError> {
    match request.procedural.as_str() {
        "cornell" => Ok(cornell::cornell()),
        "fern" => Ok(fern::fern(request.seed, request.detail)),
        "palm" => Ok(palm::palm(request.seed, request.detail)),
        "plates" => Ok(plates::plates(request.detail, request.pieces)),
        "saloon" => Ok(saloon::saloon(request.seed, request.detail)),
        "saloon-hall" => Ok(saloon_hall::saloon_hall(request.seed, request.detail)),
        "street" => Ok(street::street(request.seed, request.detail)),
        "table" => Ok(table::table(request.detail)),
        "tiny" => Ok(tiny::tiny(request.detail)),
        other => Err(SceneError::Value {
            at: "mesh.procedural".to_owned(),
            found: format!("`{other}`"),
            expected: format!("one of {}", NAMES.join(", ")),
        }),
    }
}
