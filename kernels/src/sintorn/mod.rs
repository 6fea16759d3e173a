//! Sample-based visibility with an alias-free shadow map (Sintorn et al. 2008): for every receiver, the samples of the light that each
//! triangle hides, as bits.
//!
//! ```text
//! triangles                records of triangles, with all that they hide of any part of the light
//! irregular: grid          receivers into the cells of up to six faces, in cell order
//! irregular: bin, raster   triangles to the cells with receivers from which they hide a part of the light
//! cover                    samples of the light that a triangle hides: one bit each, gathered over all triangles
//! resolve                  parts of the light to the pixels
//! ```
//!
//! No silhouette is looked for and nothing overlaps twice: a sample is hidden or it is not, whatever hides it, from wherever it is
//! seen. What is left of the error is that samples are finitely many. The price is that triangles are as many as they are, and not
//! as few as silhouettes; and that each has its whole penumbra.

pub mod cover;
pub mod triangles;

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values, Word};
use lrbsim_isa::{Phase, Runner, Stopped};
use lrbsim_workloads::ShadowInput;

use crate::clear;
use crate::irregular::bin::Bins;
use crate::irregular::grid::Grid;
use crate::irregular::primitives::{Kind, LightConstants, Primitives};
use crate::irregular::raster::Raster;
use crate::irregular::receivers::Receivers;
use crate::irregular::run::{RunSizes, Runs, Walk};
use crate::method::{Method, Shadows, read};
use crate::record::Records;
use crate::samples::{LightSamples, resolve};
use crate::scene::Scene;
use cover::Cover;

/// Alias-free shadow maps with samples of the light, as a method among others.
pub struct Sintorn;

const TRIANGLES: Phase = Phase { id: "triangles", title: "triangle records", in_paper_total: false };
const GRID: Phase = Phase { id: "grid", title: "data structure construction", in_paper_total: false };
const BIN: Phase = Phase { id: "bin", title: "binning", in_paper_total: false };
const RASTER: Phase = Phase { id: "raster", title: "light-view rasterization", in_paper_total: false };
const COVER: Phase = Phase { id: "cover", title: "hidden samples of the light", in_paper_total: false };

/// Tests of a run, as a power of two: a test is of one triangle and 16 receivers.
const RUN: i32 = 5;

impl Method for Sintorn {
    fn entry(&self) -> Entry {
        Entry {
            name: "sintorn",
            about: "alias-free shadow maps with samples of the light (Sintorn et al. 2008)",
            options: &[OptionSpec {
                name: "samples",
                about: "samples of the light, a bit each",
                values: Values::OneOf(&[
                    Word { name: "64", about: "65 levels of shadow" },
                    Word { name: "128", about: "129 levels" },
                    Word { name: "256", about: "257 levels" },
                    Word { name: "512", about: "513 levels" },
                    Word { name: "1024", about: "1025 levels" },
                ]),
                default: "128",
                tacit: false,
            }],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[TRIANGLES, GRID, BIN, RASTER, COVER]
    }

    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
        let scene = Scene::uncut(input, runner.arena);
        let receivers = Receivers::new(input, runner.arena);
        let light = LightConstants::new(input);
        let choice = options.word("samples") as u32;
        let samples = LightSamples::new(runner.arena, light.shape.outline(), 64 << choice);

        runner.phase(&TRIANGLES);
        let (records, bounds) = triangles::record(&scene, light, runner)?;
        let primitives = Primitives {
            light,
            triangles: records,
            bounds,
            triangle_count: scene.triangle_count,
            edges: Records::default(),
            edge_count: 0,
        };

        runner.phase(&GRID);
        let grid = Grid::build(receivers, &light, runner)?;

        runner.phase(&BIN);
        let bins = Bins::build(&primitives, &grid, runner)?;

        runner.phase(&RASTER);
        let raster = Raster::build(&grid, &bins, runner)?;
        raster.find_cells(&primitives, &grid, runner)?;
        let runs = Runs::build(&grid, &raster, RunSizes([RUN; 2]), runner)?;

        runner.phase(&COVER);
        let [hidden] = clear::zeroed(runner, [u64::from(receivers.count) + 16])?;
        let walk = Walk::new(Kind::Triangles, &grid, &raster, &runs);
        Cover { walk, light, triangles: records, grid, samples, hidden }.run_all(runner)?;
        resolve(receivers, samples.count, hidden, visibility, runner)?;
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges: None })
    }
}
