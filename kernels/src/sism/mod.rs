//! Soft irregular shadow mapping [johnson09, §2], in its exact form [algorithms, 2.5 and 2.6] or as printed.
//!
//! ```text
//! irregular: silhouette   records of triangles, weights and records of edges
//! irregular: grid         receivers into the cells of up to six faces, in cell order
//! irregular: bin          triangles and edges to bins
//! irregular: raster, run  … to records of the blocks and their cells, and samples to runs of equal work
//! hard                    layers between each sample and the light
//! cut                     what triangles hide that the light is cut by: in few scenes there are any
//! bits                    samples of the light that are covered, or in its place, where parts are summed:
//! soft                    signed parts of the light's disc
//! objects                 … of each object by itself, and what all of them hide together
//! compose                 own triangles taken out, one clamp, visibility to the pixels
//! ```

pub mod hard;
pub mod soft;
pub mod compose;
pub mod own;
pub mod objects;
pub mod cut;
pub mod bits;
pub mod printed;
pub mod kept;

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values, Word};
use lrbsim_isa::{Addr, Arena, Phase, Runner, Stopped};
use lrbsim_workloads::reference::ObjectRule;
use lrbsim_workloads::{Light, LightShape, ShadowInput};

use crate::columns::Columns;
use crate::irregular::bin::Bins;
use crate::irregular::grid::Grid;
use crate::irregular::primitives::{Form, Kind, LightConstants, Primitives};
use crate::irregular::raster::Raster;
use crate::irregular::receivers::Receivers;
use crate::irregular::run::{RunSizes, Runs, Walk};
use crate::irregular::silhouette;
use crate::method::{Method, Shadows, read};
use crate::samples::LightSamples;
use crate::scene::{ObjectNumbers, Scene};
use crate::segment::Angle;
use bits::Compared;
use compose::Apart;
use cut::CutTriangles;
use kept::Kept;
use objects::Objects;
use own::Own;
use printed::Printed;
use soft::How;

/// Soft irregular shadow mapping, as a method among others.
pub struct Sism;

const ENTRY: Entry = Entry {
    name: "sism",
    about: "soft irregular shadow mapping (Johnson et al. 2009)",
    options: &[
        OptionSpec {
            name: "form",
            about: "how an edge is seen on the disc of the light",
            values: Values::OneOf(&[
                Word {
                    name: "exact",
                    about: "each vertex along the receiver's own axis: exact for a light that faces the receiver",
                },
                Word {
                    name: "printed",
                    about: "one circle per edge and receiver on the image plane, as in the paper: too narrow off the axis of a face",
                },
            ]),
            default: "exact",
            tacit: false,
        },
        OptionSpec {
            name: "overlap",
            about: "what occluders hide that overlap on the light",
            values: Values::OneOf(&[
                Word { name: "sum", about: "the sum of their parts, as in the paper (C = 0): too dark" },
                Word {
                    name: "product",
                    about: "each object as much of what the others leave as of the whole: right for what is strewn at random",
                },
                Word { name: "max", about: "what the object hides that hides the most: too light" },
                Word { name: "bits:64", about: "what they hide of 64 samples of the light" },
                Word { name: "bits:256", about: "what they hide of 256 samples of the light" },
            ]),
            default: "bits:64",
            tacit: false,
        },
        OptionSpec {
            name: "lights",
            about: "how many smaller lights the light is split into, each with the silhouettes that it sees",
            values: Values::Whole(1, 64),
            default: "1",
            tacit: false,
        },
        OptionSpec {
            name: "sums",
            about: "what the parts of the light are summed in",
            values: Values::OneOf(&[
                Word { name: "fixed", about: "whole numbers of 2^-24 of the light, the same in any order" },
                Word { name: "f32", about: "floats of 32 bits" },
                Word { name: "bf16", about: "floats of 16 bits, 8 of exponent, to the nearest" },
                Word { name: "f16", about: "floats of 16 bits, 5 of exponent, to the nearest" },
                Word { name: "f16-truncating", about: "floats of 16 bits, 5 of exponent, towards 0" },
            ]),
            default: "fixed",
            tacit: true,
        },
        OptionSpec {
            name: "angle",
            about: "how the angle of a part is taken",
            values: Values::OneOf(&[
                Word { name: "atan2", about: "from sine and cosine, right for the shortest edges" },
                Word {
                    name: "acos",
                    about: "from the cosine, as in the paper: tells no angles apart below 3e-4",
                },
            ]),
            default: "atan2",
            tacit: true,
        },
    ],
};

const fn phase(id: &'static str, title: &'static str, in_paper_total: bool) -> Phase {
    Phase { id, title, in_paper_total }
}

const SILHOUETTE: Phase = phase("silhouette", "silhouette detection", false);
const GRID: Phase = phase("grid", "data structure construction", true);
const BIN: Phase = phase("bin", "binning", false);
const RASTER: Phase = phase("raster", "light-view rasterization", true);
const HARD: Phase = phase("hard", "hard shadow kernel", true);
const SOFT: Phase = phase("soft", "soft shadow kernel", true);
const COMPOSE: Phase = phase("compose", "composition", true);

/// What is written for the option `name`.
fn written(options: &Options, name: &str) -> String {
    options.written().find(|(option, _)| *option == name).map(|(_, value)| value).unwrap_or_default()
}

impl Method for Sism {
    fn entry(&self) -> Entry {
        ENTRY
    }

    /// All phases; `soft` is left out where the light is a point.
    fn phases(&self) -> &'static [Phase] {
        &[SILHOUETTE, GRID, BIN, RASTER, HARD, SOFT, COMPOSE]
    }

    fn lights(&self, options: &Options) -> u32 {
        options.whole("lights")
    }

    /// Samples of the light are compared with edges as the exact form has them; no part is measured and none is summed.
    fn objection(&self, options: &Options) -> Option<String> {
        let Choices { overlap, form, sums, angle } = Choices::of(options);
        overlap.groups()?;
        let other = [
            ("form", form != Form::Exact, "exact"),
            ("sums", sums != Kept::Fixed, "fixed"),
            ("angle", angle != Angle::Atan2, "atan2"),
        ];
        let (name, _, right) = other.into_iter().find(|(_, is_other, _)| *is_other)?;
        Some(format!(
            "`{name}={}` of `sism` sums parts of the light, and `overlap={}` sums none; it must be `overlap=sum` or `{name}={right}`",
            written(options, name),
            written(options, "overlap")
        ))
    }

    fn objection_to_light(&self, options: &Options, light: &Light) -> Option<String> {
        let Choices { form, angle, .. } = Choices::of(options);
        let shape = light.shape();
        if shape == LightShape::Facing {
            return None;
        }
        let kind = shape.name();
        if form == Form::Printed {
            return Some(format!(
                "`form=printed` of `sism` takes a light for a sphere, as the paper does, and this one is a {kind}; it must be `form=exact`"
            ));
        }
        if matches!(shape, LightShape::Triangle { .. }) {
            return Some(format!(
                "`sism` takes parts of spheres, discs, rectangles and lines, and this light is a {kind}; `heidrich`, `sintorn` and `raytrace` draw it"
            ));
        }
        (angle == Angle::Acos && !matches!(shape, LightShape::Disc { .. })).then(|| {
            format!(
                "`angle=acos` of `sism` is for discs, and this light is a {kind}; it must be `angle=atan2`"
            )
        })
    }

    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        let choices = Choices::of(options);
        let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
        let first = runner.arena.used_bytes();
        let mut silhouette_edges = None;
        let others = core::mem::take(&mut input.others);
        let of = 1 + others.len() as u32;
        let mut others = others.into_iter();
        for number in 0..of {
            let mut other;
            let light = if number == 0 {
                &mut *input
            } else {
                other = others.next().expect("as many as were counted");
                &mut other
            };
            // Each where the one before was: nothing but the picture outlives its light.
            runner.arena.give_back(first);
            let picture = Picture { visibility, number, of };
            let scene = Scene::new(light, runner.arena);
            let constants = LightConstants { form: choices.form, ..LightConstants::new(light) };
            let primitives = run_light(light, scene, constants, choices, picture, runner)?.primitives;
            if primitives.light.is_soft() {
                *silhouette_edges.get_or_insert(0) += u64::from(primitives.edge_count);
            }
        }
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges })
    }
}

/// Irregular hard shadows (Johnson et al. 2004), as a method among others: the kernels of [`Sism`] for the middle of the light alone.
pub struct Hard;

impl Method for Hard {
    fn entry(&self) -> Entry {
        Entry {
            name: "hard",
            about: "hard shadows by an irregular shadow map (Johnson et al. 2004), the light as a point",
            options: &[],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[SILHOUETTE, GRID, BIN, RASTER, HARD, COMPOSE]
    }

    fn run(
        &self,
        _options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
        let scene = Scene::uncut(input, runner.arena);
        let light = LightConstants {
            shape: LightShape::Facing,
            radius: 0.0,
            bound_radius: 0.0,
            ..LightConstants::new(input)
        };
        let picture = Picture { visibility, number: 0, of: 1 };
        run_light(input, scene, light, Choices::from(Overlap::Sum), picture, runner)?;
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges: None })
    }
}

/// What there is to choose of the program of a light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Choices {
    /// What occluders hide that overlap on the light.
    pub overlap: Overlap,
    /// How an edge is seen on the disc of the light.
    pub form: Form,
    /// What parts of the light are summed in.
    pub sums: Kept,
    /// How the angle of a part is taken.
    pub angle: Angle,
}

impl Choices {
    /// What `options` of the method choose.
    fn of(options: &Options) -> Choices {
        use Kept::{Bf16, F16, F16Truncating, F32, Fixed};
        Choices {
            overlap: Overlap::ALL[options.word("overlap")],
            form: [Form::Exact, Form::Printed][options.word("form")],
            sums: [Fixed, F32, Bf16, F16, F16Truncating][options.word("sums")],
            angle: [Angle::Atan2, Angle::Acos][options.word("angle")],
        }
    }
}

/// All else as it is where users choose nothing.
impl From<Overlap> for Choices {
    fn from(overlap: Overlap) -> Choices {
        Choices { overlap, ..Choices::default() }
    }
}

/// What occluders hide that overlap on the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overlap {
    /// The sum of their parts [johnson09, Eq. 5 with C = 0].
    Sum,
    /// Each object as much of what the others leave as of the whole [algorithms, 2.9].
    Product,
    /// What the object hides that hides the most.
    Max,
    /// What they hide of 64 samples of the light: the cheapest that is off by less than 0.03 in all of six models, see
    /// docs/accuracy.md.
    #[default]
    Bits64,
    /// What they hide of 256 samples of the light.
    Bits256,
}

impl Overlap {
    /// All ways, in the order of the option's words.
    pub const ALL: [Overlap; 5] =
        [Overlap::Sum, Overlap::Product, Overlap::Max, Overlap::Bits64, Overlap::Bits256];

    /// How objects are put together; `None` where they are not told apart.
    pub(crate) fn rule(self) -> Option<ObjectRule> {
        match self {
            Overlap::Product => Some(ObjectRule::Product),
            Overlap::Max => Some(ObjectRule::Max),
            Overlap::Sum | Overlap::Bits64 | Overlap::Bits256 => None,
        }
    }

    /// Groups of 16 samples of the light that are compared; `None` where parts are summed.
    fn groups(self) -> Option<usize> {
        match self {
            Overlap::Sum | Overlap::Product | Overlap::Max => None,
            Overlap::Bits64 => Some(4),
            Overlap::Bits256 => Some(16),
        }
    }

    /// Sizes of the runs: about 32 K uops each, with more for each test where samples are compared.
    fn run_sizes(self) -> RunSizes {
        RunSizes(match self {
            Overlap::Sum => [12, 9],
            Overlap::Product | Overlap::Max => [12, 8],
            Overlap::Bits64 => [12, 7],
            Overlap::Bits256 => [12, 5],
        })
    }
}

/// What covers the light of a sample: F of the faces towards the light, B of those away from it.
#[repr(C)]
pub struct Sums {
    /// Layers in F and B between the sample and the light.
    pub layers: [i32; 2],
    /// Parts of the light in F and B beyond silhouette edges, in units of 2^-24; where samples of the light are compared or objects
    /// told apart, the covered part of it, layers included, in the first.
    pub coverage: [i32; 2],
}

/// Where the program of a frame left its results.
pub struct Arrays {
    /// Records of triangles and silhouette edges.
    pub primitives: Primitives,
    /// Receivers and their cells.
    pub grid: Grid,
    /// Images of the edges, where the program had need of them.
    pub printed: Option<Printed>,
    /// Which blocks have sums.
    pub runs: Runs,
    /// Sums of each sample, field by field; of samples whose block has none nobody writes them.
    pub sums: Columns<Sums>,
    /// Visible part of the light by pixel.
    pub visibility: Addr,
}

impl Arrays {
    /// Visible part of the light in [0, 1], one a receiver, in the order of the input.
    pub fn visibility(&self, input: &ShadowInput, arena: &Arena) -> Vec<f32> {
        read(self.visibility, input, arena)
    }
}

/// The picture that lights add to, one after the other.
#[derive(Debug, Clone, Copy)]
pub struct Picture {
    /// Visible part of the light by pixel.
    pub visibility: Addr,
    /// Number of the light that adds to it; the first begins it.
    pub number: u32,
    /// Number of lights.
    pub of: u32,
}

/// The program of one frame with one light, which takes the receivers of `input` along.
pub fn run(
    input: &mut ShadowInput,
    choices: impl Into<Choices>,
    runner: &mut Runner<'_>,
) -> Result<Arrays, Stopped> {
    let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
    let choices = choices.into();
    let scene = Scene::new(input, runner.arena);
    let light = LightConstants { form: choices.form, ..LightConstants::new(input) };
    run_light(input, scene, light, choices, Picture { visibility, number: 0, of: 1 }, runner)
}

/// The program of one light, whose geometry is in the arena. Puts the rest of the input there, untimed; all else are its steps.
///
/// A point light has neither silhouettes nor a soft phase.
fn run_light(
    input: &mut ShadowInput,
    scene: Scene,
    light: LightConstants,
    choices: Choices,
    picture: Picture,
    runner: &mut Runner<'_>,
) -> Result<Arrays, Stopped> {
    let Choices { overlap, form, sums: kept, angle } = choices;
    let receivers = Receivers::new(input, runner.arena);
    let cut = CutTriangles::new(input, runner.arena);
    let objects = match overlap.rule() {
        Some(_) if light.is_soft() => Some(ObjectNumbers::new(input, runner.arena)),
        _ => None,
    };

    runner.phase(&SILHOUETTE);
    let primitives = silhouette::detect(&scene, light, objects, runner)?;

    runner.phase(&GRID);
    let grid = Grid::build(receivers, &light, runner)?;

    runner.phase(&BIN);
    let printed = match form {
        Form::Printed if light.is_soft() => Some(Printed::build(&primitives, &grid, runner)?),
        _ => None,
    };
    let bins = Bins::build(&primitives, &grid, runner)?;

    runner.phase(&RASTER);
    let raster = Raster::build(&grid, &bins, runner)?;
    if objects.is_some() {
        objects::sort(&primitives, &grid, &raster, runner)?;
    }
    raster.find_cells(&primitives, &grid, runner)?;
    let runs = Runs::build(&grid, &raster, overlap.run_sizes(), runner)?;

    runner.phase(&HARD);
    let sums = Columns::overwritten(runner.arena, receivers.count);
    hard::count(Walk::new(Kind::Triangles, &grid, &raster, &runs), &primitives, &grid, sums, runner)?;

    let own = light.is_soft().then_some(Own { primitives });
    let mut hidden = None;
    if light.is_soft() {
        runner.phase(&SOFT);
        let walk = Walk::new(Kind::Edges, &grid, &raster, &runs);
        match overlap.groups() {
            None => {
                hidden = cut.map(|cut| cut.parts(light, &grid, runner)).transpose()?;
                let objects = overlap.rule().map(|rule| Objects::new(rule, &primitives, &grid, hidden));
                soft::sum(walk, &primitives, How { printed, angle, kept }, objects, sums, runner)?;
            }
            Some(groups) => {
                let samples = LightSamples::new(runner.arena, light.shape.outline(), 16 * groups as u32);
                hidden = cut.map(|cut| cut.samples(&primitives, samples, &grid, runner)).transpose()?;
                let compared = Compared { samples, hidden };
                bits::cover(walk, compared, &primitives, &grid, &runs, sums, runner)?;
            }
        }
    }

    runner.phase(&COMPOSE);
    compose::compose(&grid, &runs, sums, Apart { own, cut: hidden }, overlap, picture, runner)?;
    Ok(Arrays { primitives, grid, printed, runs, sums, visibility: picture.visibility })
}
