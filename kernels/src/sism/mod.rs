//! Soft irregular shadow mapping [johnson09, §2], in its exact form [algorithms, 2.5 and 2.6].
//!
//! ```text
//! silhouette              records of triangles, weights and records of edges
//! irregular: grid         receivers into the cells of up to six faces, in cell order
//! irregular: bin          triangles and edges to bins
//! irregular: raster, run  … to (cell, primitive) records, and samples to runs of equal work
//! hard                    layers between each sample and the light
//! soft                    signed parts of the light's disc
//! compose                 one clamp, visibility to the pixels
//! ```

pub mod silhouette;
pub mod hard;
pub mod soft;
pub mod compose;

use lrbsim_isa::program::MakeStep;
use lrbsim_isa::{Addr, Arena, Phase, Program};
use lrbsim_workloads::ShadowInput;

use crate::columns::Columns;
use crate::irregular::bin::{self, Bins};
use crate::irregular::grid::{self, Grid};
use crate::irregular::primitives::Primitives;
use crate::irregular::raster::{self, Raster};
use crate::irregular::receivers::Receivers;
use crate::irregular::run::{self, Runs};
use crate::irregular::{bounds, nodes};
use crate::scene::Scene;
use silhouette::Silhouettes;

/// How the penumbra is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Form {
    /// Each vertex normalised along the receiver's own axis: exact for a light that faces the receiver.
    #[default]
    Exact,
}

/// Options of the method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// How the penumbra is computed.
    pub form: Form,
}

/// What covers the light of a sample: F of the faces towards the light, B of those away from it.
#[repr(C)]
pub struct Sums {
    /// Layers in F and B between the sample and the light.
    pub layers: [i32; 2],
    /// Parts of the light in F and B beyond silhouette edges, in units of 2^-24.
    pub coverage: [i32; 2],
}

/// What the host knows of a frame while its program runs: addresses and sizes, by the phase that fills them.
pub struct Frame {
    /// The geometry, copied in before the first phase.
    pub scene: Scene,
    /// Weights and list of the silhouette edges; filled by `silhouette`.
    pub silhouettes: Silhouettes,
    /// Records of triangles and silhouette edges; filled by `silhouette`.
    pub primitives: Primitives,
    /// Receivers and their cells; filled by `grid`, the receivers before it.
    pub grid: Grid,
    /// The primitives of each bin; filled by `bin`.
    pub bins: Bins,
    /// The records of each cell; filled by `raster`.
    pub raster: Raster,
    /// The tasks of `hard` and `soft`; filled by `raster`.
    pub runs: Runs,
    /// Sums of each sample, field by field; filled by `hard` and `soft`.
    pub sums: Columns<Sums>,
    /// Visible part of the light by pixel; filled by `compose`.
    pub visibility: Addr,
    /// Pixel of each receiver, in the order of the input.
    pixels: Vec<u32>,
}

impl Frame {
    /// Copies the input into `arena`, untimed, and makes room for what does not depend on results.
    fn new(input: &ShadowInput, arena: &mut Arena) -> Frame {
        let scene = Scene::new(input, arena);
        let grid = Grid::new(Receivers::new(input, arena));
        Frame {
            scene,
            grid,
            primitives: Primitives::new(input, scene.triangle_count, arena),
            silhouettes: Silhouettes::new(&scene, arena),
            bins: Bins::default(),
            raster: Raster::new(arena),
            runs: Runs::new(arena),
            sums: Columns::default(),
            visibility: arena.alloc(u64::from(input.width * input.height)),
            pixels: input.receiver_pixel.clone(),
        }
    }

    /// Visible part of the light in [0, 1], one a receiver, in the order of the input.
    pub fn visibility(&self, arena: &Arena) -> Vec<f32> {
        let at = |&pixel: &u32| arena.read_f32(self.visibility.plus_words(u64::from(pixel)));
        self.pixels.iter().map(at).collect()
    }

    /// Edges that weigh something as seen from the light; 0 where the light is a point and none were looked for.
    pub fn silhouette_edges(&self, _: &Arena) -> u64 {
        u64::from(self.primitives.edge_count)
    }
}

/// Ids of the phases, in order; `soft` is left out where the light is a point.
pub const PHASES: [&str; 7] = ["silhouette", "grid", "bin", "raster", "hard", "soft", "compose"];

const TRIANGLES: [MakeStep<Frame>; 1] = [|f, _| silhouette::triangles(&f.scene, &f.primitives)];

const SILHOUETTES: [MakeStep<Frame>; 3] = [
    |f, _| silhouette::weights(&f.scene, &f.silhouettes, &f.primitives),
    |f, arena| silhouette::select(&f.scene, &mut f.silhouettes, &mut f.primitives, arena),
    |f, _| silhouette::records(&f.scene, &f.silhouettes, &f.primitives),
];

const GRID: [MakeStep<Frame>; 10] = [
    |f, arena| bounds::of_tasks(&mut f.grid, arena),
    |f, _| bounds::of_faces(&f.grid),
    |f, arena| grid::count(&mut f.grid, arena),
    |f, _| f.grid.scan.blocks(),
    |f, _| f.grid.scan.totals(),
    |f, _| f.grid.scan.offsets(),
    |f, arena| grid::scatter(&mut f.grid, arena),
    |f, arena| nodes::cells(&mut f.grid, arena),
    |f, _| nodes::bins(&f.grid),
    |f, _| nodes::groups(&f.grid),
];

const BIN: [MakeStep<Frame>; 5] = [
    |f, arena| bin::count(&mut f.bins, &f.primitives, &f.grid, arena),
    |f, _| f.bins.lists.scan.blocks(),
    |f, _| f.bins.lists.scan.totals(),
    |f, _| f.bins.lists.scan.offsets(),
    |f, arena| bin::fill(&mut f.bins, &f.primitives, &f.grid, arena),
];

const RASTER: [MakeStep<Frame>; 9] = [
    |f, _| raster::count_pieces(&f.raster, &f.bins, &f.grid),
    |f, arena| raster::fill_pieces(&mut f.raster, &f.bins, &f.grid, arena),
    |f, arena| raster::count(&mut f.raster, &f.bins, &f.primitives, &f.grid, arena),
    |f, _| f.raster.lists.scan.blocks(),
    |f, _| f.raster.lists.scan.totals(),
    |f, _| f.raster.lists.scan.offsets(),
    |f, arena| raster::fill(&mut f.raster, &f.bins, &f.primitives, &f.grid, arena),
    |f, arena| run::count(&mut f.runs, &f.raster, &f.grid, arena),
    |f, arena| run::fill(&mut f.runs, &f.grid, arena),
];

const HARD: [MakeStep<Frame>; 1] = [hard::count];
const SOFT: [MakeStep<Frame>; 1] = [|f, _| soft::sum(f)];
const COMPOSE: [MakeStep<Frame>; 1] = [|f, _| compose::compose(f)];

/// The program of one frame. Copies the input into `arena`, untimed; all else are its steps.
///
/// A point light has neither silhouettes nor a soft phase.
pub fn program(input: &ShadowInput, options: &Options, arena: &mut Arena) -> Program<Frame> {
    let Form::Exact = options.form;
    let frame = Frame::new(input, arena);
    let soft = frame.primitives.light.is_soft();
    let phase = |id, title, in_paper_total, steps: &[MakeStep<Frame>]| {
        debug_assert!(PHASES.contains(&id), "`{id}` is no id that studies may name");
        Phase { id, title, in_paper_total, steps: steps.to_vec() }
    };
    let mut silhouette = phase("silhouette", "silhouette detection", false, &TRIANGLES);
    if soft {
        silhouette.steps.extend(SILHOUETTES);
    }
    let mut phases = vec![
        silhouette,
        phase("grid", "data structure construction", true, &GRID),
        phase("bin", "binning", false, &BIN),
        phase("raster", "light-view rasterization", true, &RASTER),
        phase("hard", "hard shadow kernel", true, &HARD),
    ];
    if soft {
        phases.push(phase("soft", "soft shadow kernel", true, &SOFT));
    }
    phases.push(phase("compose", "composition", true, &COMPOSE));
    Program { state: frame, phases }
}
