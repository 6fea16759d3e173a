//! Options that methods with a map share, and what those have against lights that take one for a disc.

use lrbsim_isa::options::{OptionSpec, Options, Values, Word};
use lrbsim_workloads::{Light, LightShape};

use super::look::Bias;

/// The option of all methods with a map that says how large it is.
pub const SIZE: OptionSpec = OptionSpec {
    name: "size",
    about: "texels of a side of the map, on each of the faces around the light that see something",
    values: Values::OneOf(&[
        Word { name: "128", about: "128 by 128 texels" },
        Word { name: "256", about: "256 by 256 texels" },
        Word { name: "512", about: "512 by 512 texels" },
        Word { name: "1024", about: "1024 by 1024 texels" },
        Word { name: "2048", about: "2048 by 2048 texels" },
    ]),
    default: "1024",
    tacit: false,
};

/// The option of all methods with a map that says what hides nothing.
pub const BIAS: OptionSpec = OptionSpec {
    name: "bias",
    about: "what a texel must be nearer than to the light, so that surfaces do not shadow themselves",
    values: Values::OneOf(&[
        Word { name: "plane", about: "the plane of the receiver's own triangle at the middle of the texel" },
        Word { name: "constant", about: "the receiver, by 0.5 % of its depth, as first published" },
    ]),
    default: "plane",
    tacit: false,
};

/// Texels of a side of the map that `options` choose.
pub fn size(options: &Options) -> u32 {
    128 << options.word("size")
}

/// The bias that `options` choose.
pub fn bias(options: &Options) -> Bias {
    [Bias::Plane, Bias::Constant][options.word("bias")]
}

/// What `method`, which takes a light for a `disc` of some kind, has against other lights: a sentence for users.
pub fn objection_to_other_than(disc: &str, method: &str, light: &Light) -> Option<String> {
    let shape = light.shape();
    if matches!(shape, LightShape::Facing | LightShape::Disc { .. }) {
        return None;
    }
    Some(format!(
        "`{method}` takes a light for a {disc}, and this one is a {}; it must be a sphere, a disc or a point",
        shape.name()
    ))
}
