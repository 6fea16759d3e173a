//! Soft shadow maps for linear lights (Heidrich, Brabec and Seidel 2000): a shadow map from each of a few samples of a line, and beside it
//! how much of the line is seen.
//!
//! ```text
//! map: setup, tiles, draw    a shadow map from each sample
//! skins                      where its depth jumps: triangles from the occluder to what lies behind it
//! channel                    skins of either neighbor, drawn on what the sample sees: 0 at the occluder, 1 behind it
//! look                       the samples that see a receiver, each with what its channels say
//! ```
//!
//! A receiver that one end of a segment sees and the other does not lies in a penumbra. The rays from the other end along the border of
//! the occluder are a skin; seen from the first end it lies over that penumbra, and as far as the receiver is across it, as much of the
//! segment is seen. N samples are the ends of N - 1 segments of equal weight. Each has two channels, so that what is known of
//! a segment does not mix with what is known of the next one; the paper adds both channels of a sample, which is the same sum.
//!
//! A triangle is taken for its three sides, each as bright as the others, so that the middle of the light stays where it is [heidrich00, §4].
//!
//! What both ends see is taken for lit by all of the segment, and what neither sees for umbra: occluders and gaps that are narrower than a
//! segment are missed.

pub mod skins;
pub mod warp;
pub mod channel;
mod look;

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values, Word};
use lrbsim_isa::{Addr, Phase, Runner, Stopped};
use lrbsim_workloads::glam::DVec3;
use lrbsim_workloads::{Light, LightShape, ShadowInput};

use crate::irregular::receivers::Receivers;
use crate::irregular::triangles;
use crate::map::cover::NEAR;
use crate::map::layout::Layout;
use crate::map::options::{BIAS, SIZE, bias, size};
use crate::map::tiles::Tiles;
use crate::map::{self, DepthMap};
use crate::method::{Method, Shadows, read};
use crate::scene::{Scene, Viewpoint};
use channel::Interpolation;
use look::{Known, Look, Skin};
use skins::Skins;

/// Soft shadow maps for linear lights, as a method among others.
pub struct Heidrich;

const SKINS: Phase = Phase { id: "skins", title: "depth discontinuities", in_paper_total: false };
const CHANNEL: Phase = Phase { id: "channel", title: "visibility channels", in_paper_total: false };
const LOOK: Phase = Phase { id: "look", title: "shadow and visibility lookup", in_paper_total: false };

/// Part of the map's side that lies outside of the receivers on each side, for occluders whose borders shadow those at its border.
const MARGIN: u32 = 16;

/// Number of skins that a task sorts to tiles: those of wide penumbras lie over many.
const SORT_TASK: u32 = 64;

impl Method for Heidrich {
    fn entry(&self) -> Entry {
        Entry {
            name: "heidrich",
            about: "soft shadow maps for linear lights (Heidrich et al. 2000)",
            options: &[
                SIZE,
                OptionSpec {
                    name: "samples",
                    about: "samples of a line, evenly from end to end, or of each side of a triangle; each has a map of its own",
                    values: Values::Whole(2, 16),
                    default: "2",
                    tacit: false,
                },
                OptionSpec {
                    name: "threshold",
                    about: "by what part of itself the depth of a map must jump between texels to throw a penumbra",
                    values: Values::Number(0.0001, 1.0),
                    default: "0.01",
                    tacit: false,
                },
                OptionSpec {
                    name: "interpolation",
                    about: "how visibility grows across a penumbra",
                    values: Values::OneOf(&[
                        Word { name: "affine", about: "linearly in the picture that the sample has of it" },
                        Word {
                            name: "perspective",
                            about: "linearly in space, as rasterizers do: too dark the farther the surface is behind the edge",
                        },
                    ]),
                    default: "affine",
                    tacit: false,
                },
                OptionSpec {
                    name: "skin",
                    about: "where penumbras are",
                    values: Values::OneOf(&[
                        Word {
                            name: "masked",
                            about: "where one of two neighboring samples sees the receiver",
                        },
                        Word {
                            name: "agreed",
                            about: "there, and where both see it behind borders of occluders that each of them has",
                        },
                        Word {
                            name: "printed",
                            about: "wherever a sample sees the receiver behind the border of an occluder, as published",
                        },
                    ]),
                    default: "masked",
                    tacit: false,
                },
                BIAS,
            ],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[map::SETUP, map::TILES, map::DRAW, SKINS, CHANNEL, LOOK]
    }

    fn objection_to_light(&self, _options: &Options, light: &Light) -> Option<String> {
        let shape = light.shape();
        if matches!(shape, LightShape::Line { .. } | LightShape::Triangle { .. }) {
            return None;
        }
        Some(format!(
            "`heidrich` takes samples along a line or the sides of a triangle, and this light is a {}; it must be linear or a triangle",
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
        let samples = draw(options, input, runner)?;

        runner.phase(&LOOK);
        let known = Known::new(runner.arena, input.receiver_pixel.len() as u64);
        let is_closed = is_closed(input);
        let segments = segments(samples.len(), is_closed).count() as u32;
        // Around a triangle the first sample is the last one too.
        let around = samples.iter().chain(&samples[..usize::from(is_closed)]);
        for (number, sample) in around.enumerate() {
            let [before, after] = sample.channels;
            let look = Look {
                map: sample.skins.map,
                bias: bias(options),
                skin: [Skin::Masked, Skin::Agreed, Skin::Printed][options.word("skin")],
                channels: [before.filter(|_| number > 0), after.filter(|_| number < segments as usize)],
                is_second: number == 1,
                known,
                segments,
                visibility,
            };
            look.run(runner)?;
        }
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges: None })
    }
}

/// Draws the maps of all samples of the light, and their channels.
pub fn draw(
    options: &Options,
    input: &mut ShadowInput,
    runner: &mut Runner<'_>,
) -> Result<Vec<Sample>, Stopped> {
    let frame = Frame {
        scene: Scene::uncut(input, runner.arena),
        receivers: Receivers::new(input, runner.arena),
        size: size(options),
        largest: input.largest + input.light_radius,
        threshold: options.number("threshold") as f32,
        interpolation: [Interpolation::Affine, Interpolation::Perspective][options.word("interpolation")],
    };
    let mut samples = Vec::new();
    for viewpoint in viewpoints(input, options.whole("samples")) {
        samples.push(frame.sample(viewpoint, runner)?);
    }
    runner.phase(&CHANNEL);
    for [first, second] in segments(samples.len(), is_closed(input)) {
        samples[first].channels[1] = Some(frame.channel(&samples[first], &samples[second], runner)?);
        samples[second].channels[0] = Some(frame.channel(&samples[second], &samples[first], runner)?);
    }
    Ok(samples)
}

/// Points of the light from which maps are drawn, evenly from end to end or around a triangle; `count` on each side, ends included.
fn viewpoints(input: &ShadowInput, count: u32) -> Vec<Viewpoint> {
    let part = |i: u32| f64::from(i) / f64::from(count - 1);
    let places: Vec<DVec3> = match input.light_shape {
        LightShape::Line { half } => (0..count).map(|i| half * (2.0 * part(i) - 1.0)).collect(),
        LightShape::Triangle { halves: [a, b] } => {
            let first = (a + b) * (-2.0 / 3.0);
            let corners = [first, first + a * 2.0, first + b * 2.0];
            // The last of a side is the first of the next one.
            let side = |k: usize| (0..count - 1).map(move |i| corners[k].lerp(corners[(k + 1) % 3], part(i)));
            (0..3).flat_map(side).collect()
        }
        _ => panic!("the light is a line or a triangle: others are refused"),
    };
    places.into_iter().map(|place| Viewpoint::at(place.as_vec3().to_array())).collect()
}

/// Whether the samples of the light go around it, so that the last is followed by the first.
fn is_closed(input: &ShadowInput) -> bool {
    matches!(input.light_shape, LightShape::Triangle { .. })
}

/// The numbers of the samples at both ends of each segment, in the order of the samples.
fn segments(samples: usize, is_closed: bool) -> impl Iterator<Item = [usize; 2]> {
    let count = samples - usize::from(!is_closed);
    (0..count).map(move |first| [first, (first + 1) % samples])
}

/// What all samples have together.
struct Frame {
    scene: Scene,
    receivers: Receivers,
    /// Texels of a side of each map.
    size: u32,
    /// No coordinate about a sample is larger.
    largest: f32,
    /// Jumps of the depth, as parts of it, that are none yet.
    threshold: f32,
    interpolation: Interpolation,
}

/// What a sample of the light sees.
pub struct Sample {
    /// Where it lies.
    pub viewpoint: Viewpoint,
    /// Where the depth of its map jumps, and the map.
    pub skins: Skins,
    /// How much is seen of the segment before it and of the one after it, by texel, or more than 1 where no skin tells; `None` where
    /// a line ends.
    pub channels: [Option<Addr>; 2],
}

impl Frame {
    /// Draws the map from `viewpoint`, and finds its skins.
    fn sample(&self, viewpoint: Viewpoint, runner: &mut Runner<'_>) -> Result<Sample, Stopped> {
        let scene = self.scene.seen_from(viewpoint);
        let receivers = self.receivers.seen_from(viewpoint);
        runner.phase(&map::SETUP);
        let triangles = triangles::record(&scene, 0.0, None, None, runner)?;
        let layout = Layout::build(&receivers, self.size, self.size / MARGIN, runner)?;
        let map = DepthMap::draw_scene(&scene, receivers, triangles, layout, self.largest, runner)?;

        runner.phase(&SKINS);
        let skins = Skins::find(&map, self.threshold, runner)?;
        Ok(Sample { viewpoint, skins, channels: [None; 2] })
    }

    /// Draws the channel of what is seen from `sample` and may be hidden from its neighbor `other`.
    fn channel(&self, sample: &Sample, other: &Sample, runner: &mut Runner<'_>) -> Result<Addr, Stopped> {
        let map = &sample.skins.map;
        let near = NEAR * self.largest;
        let to_other = other.viewpoint.from(sample.viewpoint);
        let (records, boxes) = warp::warp(&other.skins, to_other, &map.layout, near, runner)?;
        let tiles =
            Tiles::sort(boxes.in_tasks_of(SORT_TASK), &map.layout, ["skin boxes", "skin tiles"], runner)?;
        channel::draw(map, records, &tiles, self.interpolation, near, runner)
    }
}
