//! What methods with a regular shadow map share: a picture of the scene from the middle of the light, or from another point of it, of one
//! reciprocal depth a texel (Williams 1978).
//!
//! ```text
//! receivers ─► bounds ─► layout    a square of texels for each of six faces around the light that sees receivers
//!                          │
//! triangles ─► cover ─► tiles      lists of the triangles that may cover texels of a tile
//!                          │
//!                         draw     texels of a tile, 16 side by side, the nearest triangle stays
//!                          │
//!                         look     what a texel says of a receiver
//! ```
//!
//! A tile has 16 to 64 texels a side: they lie one after the other and stay in the L2 of the core that draws them, and
//! no two tasks write one texel. Reciprocal depth is linear on the image plane, so that nothing is divided for a texel;
//! farther than everything is 0.

pub mod layout;
pub mod cover;
pub mod tiles;
pub mod draw;
pub mod look;
pub mod options;

use lrbsim_isa::{Addr, Phase, Runner, Stopped};
use lrbsim_workloads::ShadowInput;

use crate::irregular::primitives::TriangleRecord;
use crate::irregular::receivers::Receivers;
use crate::irregular::triangles;
use crate::record::Records;
use crate::scene::Scene;
use cover::Shown;
use draw::Stays;
use layout::Layout;
use tiles::Tiles;

/// The phase in which triangles get their records and the map its layout.
pub const SETUP: Phase =
    Phase { id: "setup", title: "triangle records and map layout", in_paper_total: false };
/// The phase in which triangles are sorted to the tiles of the map.
pub const TILES: Phase = Phase { id: "tiles", title: "binning to tiles", in_paper_total: false };
/// The phase in which the map is drawn.
pub const DRAW: Phase = Phase { id: "draw", title: "shadow map", in_paper_total: false };

/// A shadow map with all that is looked up in it.
#[derive(Clone, Copy)]
pub struct DepthMap {
    /// Where texels lie.
    pub layout: Layout,
    /// Reciprocal depth of the texels, tile by tile; 0 where the light sees nothing.
    pub texels: Addr,
    /// Greatest reciprocal depth of each tile: what is nearest to the light.
    pub nearest: Addr,
    /// Records of the triangles.
    pub triangles: Records<TriangleRecord>,
    /// Number of triangles.
    pub triangle_count: u32,
    /// The receivers that the map is laid out for, and where they and the map are seen from.
    pub receivers: Receivers,
}

impl DepthMap {
    /// Draws the map of a frame: `size` texels a side, a power of two from 128 on, of which `margin` on every side lie outside of
    /// the bounds of all receivers.
    pub fn draw(
        input: &mut ShadowInput,
        size: u32,
        margin: u32,
        runner: &mut Runner<'_>,
    ) -> Result<DepthMap, Stopped> {
        let scene = Scene::uncut(input, runner.arena);
        let receivers = Receivers::new(input, runner.arena);

        runner.phase(&SETUP);
        let triangles = triangles::record(&scene, 0.0, None, None, runner)?;
        let layout = Layout::build(&receivers, size, margin, runner)?;
        DepthMap::draw_scene(&scene, receivers, triangles, layout, input.largest, runner)
    }

    /// Draws the map of triangles that have their records, from where `scene` and `receivers` are seen. `largest`: the largest coordinate.
    pub fn draw_scene(
        scene: &Scene,
        receivers: Receivers,
        triangles: Records<TriangleRecord>,
        layout: Layout,
        largest: f32,
        runner: &mut Runner<'_>,
    ) -> Result<DepthMap, Stopped> {
        runner.phase(&TILES);
        let boxes = cover::triangles(scene, triangles, Shown::Layers, &layout, largest, runner)?;
        let tiles = Tiles::sort(boxes, &layout, ["tile counts", "tile lists"], runner)?;

        runner.phase(&DRAW);
        let (texels, nearest) = draw::draw(&layout, triangles, &tiles, Stays::Nearest, runner)?;
        let triangle_count = scene.triangle_count;
        Ok(DepthMap { layout, texels, nearest, triangles, triangle_count, receivers })
    }
}
