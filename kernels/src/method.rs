//! Methods: what computes shadows on a simulated machine, and the list of those that there are.

use lrbsim_isa::options::{Entry, Options};
use lrbsim_isa::{Addr, Arena, Phase, Runner, Stopped};
use lrbsim_workloads::{Light, ShadowInput};

/// A way to compute how much of a light each receiver sees.
pub trait Method: Sync {
    /// What users choose the method by: its name, and the options that it takes.
    fn entry(&self) -> Entry;

    /// All phases that the method can have, in order. A program may leave out what a scene does not need.
    fn phases(&self) -> &'static [Phase];

    /// How many lights the light of a frame is to be split into, see [`ShadowInput::others`]: one, unless the method has an
    /// option that asks for more.
    fn lights(&self, _options: &Options) -> u32 {
        1
    }

    /// What the method has against `options`, each of which it takes, together: a sentence for users that says what would be
    /// right.
    fn objection(&self, _options: &Options) -> Option<String> {
        None
    }

    /// What the method with `options` has against a light of this kind: a sentence for users that says what would be right.
    fn objection_to_light(&self, _options: &Options, _light: &Light) -> Option<String> {
        None
    }

    /// The program of one frame: puts `input` into the arena of `runner`, untimed, and hands over its steps. Of `input` the receivers are
    /// gone then but for their pixels, and so may its other lights be: of large pictures the host has no room for two of each.
    ///
    /// # Errors
    /// [`Stopped`] where the runner stops the program.
    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped>;
}

/// What a method found out about a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Shadows {
    /// Visible part of the light in [0, 1], one a receiver, in the order of the input.
    pub visibility: Vec<f32>,
    /// Number of edges that are silhouettes as seen from the light, of each light where it is split; `None` where the method looked for none.
    pub silhouette_edges: Option<u64>,
}

/// What the picture at `visibility` has for the receivers of `input`, in their order.
pub(crate) fn read(visibility: Addr, input: &ShadowInput, arena: &Arena) -> Vec<f32> {
    let at = |pixel: u32| arena.read_f32(visibility.plus_words(u64::from(pixel)));
    input.receiver_pixel.iter().map(at).collect()
}

/// All methods; the first is the one that runs where users name none.
pub static METHODS: [&dyn Method; 9] = [
    &crate::sism::Sism,
    &crate::sism::Hard,
    &crate::shadow_map::ShadowMap,
    &crate::pcss::Pcss,
    &crate::penumbra_map::PenumbraMap,
    &crate::heidrich::Heidrich,
    &crate::atty::Atty,
    &crate::raytrace::Raytrace,
    &crate::sintorn::Sintorn,
];
