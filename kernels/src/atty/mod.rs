//! Soft shadow maps by micro-patches (Atty et al. 2006): every texel of a shadow map hides a part of a rectangular light from what lies
//! behind it, and a second map adds these parts up.
//!
//! ```text
//! setup     the scene in coordinates of the light; what throws shadows and what they fall on; layout of the maps
//! tiles     triangles, sorted to the tiles of each map
//! draw      receivers at the resolution of the soft shadow map, occluders at that of their own, nearest and farthest faces
//! patches   texels of occluders as rectangles parallel to the light, sorted to the tiles that their penumbras reach
//! blend     parts of the light that patches hide, added up by texel
//! look      receivers look up what is hidden of the light there
//! ```
//!
//! Occluders do not shadow themselves or one another, and receivers throw no shadows: `parts` tells them apart. What only other
//! points of the light than its middle see is missing, all of it behind the nearest faces; a second map of the farthest faces
//! that look away brings most of it back.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values, Word};
use lrbsim_isa::{Addr, Arena, Phase, Runner, Step, Stopped};
use lrbsim_workloads::{Light, LightShape, ShadowInput};

use crate::field;
use crate::irregular::receivers::Receivers;
use crate::irregular::{bounds, triangles};
use crate::map::cover::{self, Shown};
use crate::map::draw::{self, Stays};
use crate::map::layout::{Fit, Layout, MapFace, MapSlot};
use crate::map::tiles::Tiles;
use crate::map::{DRAW, SETUP, TILES};
use crate::method::{Method, Shadows, read};
use crate::scene::{Scene, count_of};
use crate::sism::kept::Kept;
use blend::Blend;
use patch::{Extent, Floor};

pub mod geometry;
mod turned;
mod parts;
mod patch;
mod blend;
mod look;

/// Soft shadow maps by micro-patches, as a method among others.
pub struct Atty;

const PATCHES: Phase = Phase { id: "patches", title: "penumbras of micro-patches", in_paper_total: false };
const BLEND: Phase = Phase { id: "blend", title: "soft shadow map", in_paper_total: false };
const LOOK: Phase = Phase { id: "look", title: "soft shadow lookup", in_paper_total: false };

/// The two faces of the cube around the light that look across it.
const ACROSS: i32 = 0b11 << 4;

/// Tiles of a side of the soft shadow map at most: a patch may reach all of them.
const SOFT_TILES: u32 = 16;

/// Tiles of a side of an occluder map at most.
const OCCLUDER_TILES: u32 = 32;

impl Method for Atty {
    fn entry(&self) -> Entry {
        Entry {
            name: "atty",
            about: "soft shadow maps by micro-patches (Atty et al. 2006): rectangular lights alone",
            options: &[
                OptionSpec {
                    name: "size",
                    about: "texels of a side of the occluder map, on each side of the light",
                    values: Values::Whole(16, 1024),
                    default: "256",
                    tacit: false,
                },
                OptionSpec {
                    name: "ssm",
                    about: "texels of a side of the soft shadow map",
                    values: Values::Whole(16, 512),
                    default: "256",
                    tacit: false,
                },
                OptionSpec {
                    name: "passes",
                    about: "occluder maps; of two the darker counts",
                    values: Values::OneOf(&[
                        Word { name: "1", about: "one, of the nearest faces" },
                        Word { name: "2", about: "one more, of the farthest faces that look away" },
                    ]),
                    default: "1",
                    tacit: false,
                },
                OptionSpec {
                    name: "blend",
                    about: "what the sums of hidden parts are kept in",
                    values: Values::OneOf(&[
                        Word { name: "fixed", about: "whole numbers of 2^-24 of the light" },
                        Word { name: "f32", about: "floats of 32 bits" },
                        Word { name: "f16", about: "floats of 16 bits, 5 of exponent, to the nearest" },
                        Word {
                            name: "f16-truncating",
                            about: "floats of 16 bits, 5 of exponent, towards 0, as in the paper",
                        },
                    ]),
                    default: "fixed",
                    tacit: false,
                },
                OptionSpec {
                    name: "extent",
                    about: "which depth z_O is in the paper's formula for the penumbra of a patch",
                    values: Values::OneOf(&[
                        Word { name: "apex", about: "that of the penumbra's tip" },
                        Word {
                            name: "occluder",
                            about: "that of the patch, by the same letter elsewhere in the paper: penumbras are cut off",
                        },
                    ]),
                    default: "apex",
                    tacit: false,
                },
                OptionSpec {
                    name: "tangent",
                    about: "tangent of the half angle of the widest map; receivers outside of it are lit",
                    values: Values::Number(0.125, 16.0),
                    default: "2",
                    tacit: false,
                },
                OptionSpec {
                    name: "margin",
                    about: "how much of the receivers' width the occluder map reaches beyond them on every side",
                    values: Values::Number(0.0, 1.0),
                    default: "0.0625",
                    tacit: false,
                },
                OptionSpec {
                    name: "receivers",
                    about: "least diagonal of an object that is a receiver, in diagonals of the scene; all others are occluders",
                    values: Values::Number(0.0, 1.0),
                    default: "0.5",
                    tacit: false,
                },
            ],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[SETUP, TILES, DRAW, PATCHES, BLEND, LOOK]
    }

    fn objection_to_light(&self, _options: &Options, light: &Light) -> Option<String> {
        let shape = light.shape();
        if matches!(shape, LightShape::Rect { .. }) {
            return None;
        }
        Some(format!(
            "`atty` projects patches on a rectangle, and this light is a {}; it must be a rectangle, as \
             `\"kind\": \"rect\"` is",
            shape.name()
        ))
    }

    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
        let (size, soft_size) = (options.whole("size"), options.whole("ssm"));
        let passes = options.word("passes") + 1;
        let kept = [Kept::Fixed, Kept::F32, Kept::F16, Kept::F16Truncating][options.word("blend")];
        let extent = [Extent::Apex, Extent::Occluder][options.word("extent")];
        let scene = Scene::uncut(input, runner.arena);
        let receivers = Receivers::new(input, runner.arena);
        let parts = parts::parts(input, &scene, options.number("receivers"), runner.arena);
        let frame = turned::Frame::new(&input.light_shape, input.largest, options.number("tangent"));

        runner.phase(&SETUP);
        turned::turn(&frame, (&scene, count_of(&input.vertices)), &receivers, parts, runner)?;
        let records = triangles::record(&scene, 0.0, None, None, runner)?;
        let marks = parts::mark(&scene, records, parts, runner)?;
        let bounds = bounds::find(&receivers, runner)?;
        // The outermost receivers lie in the middles of the outermost texels of the soft shadow map.
        let soft = Fit {
            size: soft_size,
            inside: (soft_size - 1) as f32,
            margin: 0.5,
            wider: 1.0,
            faces: ACROSS,
            tiles: SOFT_TILES,
        };
        let soft = Layout::fit(bounds, soft, runner)?;
        // Occluders have the same square, and some more of it around.
        let wider = 1.0 + 2.0 * options.number("margin");
        let inside = f64::from(size) * f64::from(soft_size - 1) / (f64::from(soft_size) * wider);
        let occluders = Fit {
            size,
            inside: inside as f32,
            margin: (0.5 * (f64::from(size) - inside)) as f32,
            wider: 1.0,
            faces: ACROSS,
            tiles: OCCLUDER_TILES,
        };
        let occluders = Layout::fit(bounds, occluders, runner)?;

        let draw = |layout: &Layout, mark: i32, stays: Stays, runner: &mut Runner<'_>| {
            runner.phase(&TILES);
            let shown = Shown::Marked(marks, mark);
            let boxes = cover::triangles(&scene, records, shown, layout, input.largest, runner)?;
            let tiles = Tiles::sort(boxes, layout, ["tile counts", "tile lists"], runner)?;
            runner.phase(&DRAW);
            draw::draw(layout, records, &tiles, stays, runner)
        };
        let (texels, _) = draw(&soft, parts::FLOOR, Stays::Nearest, runner)?;
        let floor = Floor::new(soft, texels, runner)?;

        let blend = Blend { halves: frame.halves, kept, extent };
        let mut sums = Vec::with_capacity(passes);
        let mut nearest = Vec::with_capacity(passes);
        for (mark, stays) in
            [(parts::NEAREST, Stays::Nearest), (parts::FARTHEST, Stays::Farthest)].into_iter().take(passes)
        {
            let (texels, nearest_of_tiles) = draw(&occluders, mark, stays, runner)?;
            runner.phase(&PATCHES);
            let patches = patch::patches((&occluders, texels), &floor, frame.halves, extent, runner)?;
            runner.phase(&BLEND);
            sums.push(blend.run(&patches, &floor, runner)?);
            nearest.push(nearest_of_tiles);
        }
        let count = u32::try_from(soft.texel_count()).unwrap_or(u32::MAX);
        let hidden = runner.arena.overwritten(soft.texel_count());
        let kernel = look::Finish { sums: [sums[0], sums[passes - 1]], kept, count, hidden };
        // SAFETY: each task writes its own texels.
        runner.run(&unsafe { Step::independent("finish", count.div_ceil(look::TASK), kernel) })?;

        runner.phase(&LOOK);
        let kernel = look::Look { receivers, layout: soft, hidden, visibility };
        // SAFETY: each task writes the pixels of its own receivers.
        runner.run(&unsafe { Step::independent("look", receivers.count.div_ceil(look::TASK), kernel) })?;
        if matches!(kept, Kept::F16 | Kept::F16Truncating) {
            let warning = warning(&occluders, &floor, &nearest, frame.halves, runner.arena);
            runner.warnings.extend(warning);
        }
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges: None })
    }
}

/// What to say where patches hide so little of the light that floats of 16 bits lose them [atty06, Eq. 4]: of no use to the frame, and
/// so found on the host, untimed.
///
/// Looked at are what is nearest to the light and the deepest receiver, on either side of it: no patch hides less.
fn warning(
    layout: &Layout,
    floor: &Floor,
    nearest: &[Addr],
    halves: [f32; 2],
    arena: &Arena,
) -> Option<String> {
    let tiles = 1_u64 << (2 * layout.tiles_log2());
    let width_of = |slot: u32| {
        let of_tile = |tile| {
            let at = |of_tiles: &Addr| arena.read_f32(of_tiles.plus_words(u64::from(slot) * tiles + tile));
            nearest.iter().map(at).fold(0.0, f32::max)
        };
        let patch = f64::from((0..tiles).map(of_tile).fold(0.0, f32::max));
        let deepest = f64::from(arena.read_f32(floor.deepest.plus_words(u64::from(slot))));
        let face = arena.read_u32(layout.slots.host(slot, field!(MapSlot.face)));
        let along = |axis: usize| {
            let texel = f64::from(arena.read_f32(layout.faces.host(face, field!(MapFace.unit[axis]))));
            geometry::patch_width(texel, patch, deepest, 2.0 * f64::from(halves[axis]))
        };
        (patch > deepest).then(|| along(0).min(along(1)))
    };
    let least = (0..layout.slot_count).filter_map(width_of).fold(f64::INFINITY, f64::min);
    (least <= geometry::F16_WIDTH).then(|| {
        format!(
            "a patch of the occluder map hides down to 1/{:.0} of the light's width, and floats of 16 bits lose parts of the \
             light below 1/{:.0}: shadows come out too light; take `blend=fixed`, or a smaller `size`",
            1.0 / least,
            1.0 / geometry::F16_WIDTH
        )
    })
}
