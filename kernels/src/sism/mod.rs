//! Soft irregular shadow mapping [johnson09, §2], in its exact form [algorithms, 2.5 and 2.6].
//!
//! ```text
//! silhouette  records of triangles, weights and records of edges
//! grid        receivers into the cells of up to six faces, in cell order
//! bin         triangles and edges to bins
//! raster      … to (cell, primitive) records, and samples to runs of equal work
//! hard        layers between each sample and the light
//! soft        signed parts of the light's disc
//! compose     one clamp, visibility to the pixels
//! ```

pub mod layout;
pub mod silhouette;
mod bounds;
pub mod grid;
mod streaks;
mod nodes;
pub mod touch;
pub mod lists;
pub mod bin;
pub mod raster;
mod run;
pub mod hard;
pub mod soft;
pub mod compose;

use crate::scan::Scan;
use lrbsim_isa::{Arena, Phase, Program, Step};
use lrbsim_workloads::ShadowInput;

use layout::Layout;

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

/// What the host knows of a frame while its program runs.
pub struct Frame {
    /// Addresses and sizes.
    pub layout: Layout,
    /// Pixel of each receiver, in the order of the input.
    pixels: Vec<u32>,
    /// The prefix sum that is under way.
    scan: Scan,
    /// Runs of `hard` and of `soft`.
    run_counts: [u32; 2],
}

impl Frame {
    /// Visible part of the light in [0, 1], one a receiver, in the order of the input.
    pub fn visibility(&self, arena: &Arena) -> Vec<f32> {
        let at = |&pixel: &u32| arena.read_f32(self.layout.visibility.plus(4 * u64::from(pixel)));
        self.pixels.iter().map(at).collect()
    }

    /// Edges that weigh something as seen from the light; 0 where the light is a point and none were looked for.
    pub fn silhouette_edges(&self, _: &Arena) -> u64 {
        u64::from(self.layout.silhouette_count)
    }
}

fn scan_blocks(frame: &mut Frame, _: &mut Arena) -> Step {
    frame.scan.blocks()
}

fn scan_totals(frame: &mut Frame, _: &mut Arena) -> Step {
    frame.scan.totals()
}

fn scan_offsets(frame: &mut Frame, _: &mut Arena) -> Step {
    frame.scan.offsets()
}

/// Ids of the phases, in order; `soft` is left out where the light is a point.
pub const PHASES: [&str; 7] = ["silhouette", "grid", "bin", "raster", "hard", "soft", "compose"];

/// The program of one frame. Copies the input into `arena`, untimed; all else are its steps.
///
/// A point light has neither silhouettes nor a soft phase.
pub fn program(input: &ShadowInput, options: &Options, arena: &mut Arena) -> Program<Frame> {
    let Form::Exact = options.form;
    let layout = Layout::new(input, arena);
    let soft = layout.is_soft();
    let frame =
        Frame { layout, pixels: input.receiver_pixel.clone(), scan: Scan::default(), run_counts: [0; 2] };
    let mut silhouette: Vec<lrbsim_isa::program::MakeStep<Frame>> = vec![silhouette::triangles];
    if soft {
        silhouette.extend([
            silhouette::weights as lrbsim_isa::program::MakeStep<Frame>,
            silhouette::select,
            silhouette::records,
        ]);
    }
    let phase = |id, title, in_paper_total, steps| {
        debug_assert!(PHASES.contains(&id), "`{id}` is no id that studies may name");
        Phase { id, title, in_paper_total, steps }
    };
    let mut phases = vec![
        phase("silhouette", "silhouette detection", false, silhouette),
        phase(
            "grid",
            "data structure construction",
            true,
            vec![
                bounds::bounds,
                bounds::reduce,
                grid::count,
                scan_blocks,
                scan_totals,
                scan_offsets,
                grid::scatter,
                nodes::cells,
                nodes::bins,
                nodes::groups,
            ],
        ),
        phase("bin", "binning", false, vec![bin::count, scan_blocks, scan_totals, scan_offsets, bin::fill]),
        phase(
            "raster",
            "light-view rasterization",
            true,
            vec![
                raster::count_pieces,
                raster::fill_pieces,
                raster::count,
                scan_blocks,
                scan_totals,
                scan_offsets,
                raster::fill,
                raster::count_runs,
                raster::fill_runs,
            ],
        ),
        phase("hard", "hard shadow kernel", true, vec![hard::count]),
    ];
    if soft {
        phases.push(phase("soft", "soft shadow kernel", true, vec![soft::sum]));
    }
    phases.push(phase("compose", "composition", true, vec![compose::compose]));
    Program { state: frame, phases }
}
