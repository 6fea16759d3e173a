//! Distribution ray tracing (Cook et al. 1984): from every receiver to random points of the light, and the part of the rays that arrive.
//!
//! ```text
//! triangles ─► order: centers ─► Morton codes ─► sort      along a curve through the scene
//!                                                 │
//!                              tree: leaves ─► levels      a linear bounding volume hierarchy (Lauterbach et al. 2009)
//!                                                 │
//! receivers ──────────────────────────────────► trace      packets of 16 rays through the tree
//!                                                 │
//!                                              resolve     parts of the light to the pixels
//! ```
//!
//! The tree is that of the frame: it is built on the machine, in its time. Of all methods this one alone has no error but that of
//! finitely many rays.

pub mod order;
pub mod tree;
pub mod trace;

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values};
use lrbsim_isa::{Phase, Runner, Stopped};
use lrbsim_workloads::ShadowInput;

use crate::irregular::primitives::LightConstants;
use crate::irregular::receivers::Receivers;
use crate::method::{Method, Shadows, read};
use crate::scene::Scene;
use trace::Rays;
use tree::Tree;

/// Distribution ray tracing, as a method among others.
pub struct Raytrace;

const SORT: Phase = Phase { id: "sort", title: "triangles along a curve", in_paper_total: false };
const TREE: Phase = Phase { id: "tree", title: "tree construction", in_paper_total: false };
const TRACE: Phase = Phase { id: "trace", title: "shadow rays", in_paper_total: false };

impl Method for Raytrace {
    fn entry(&self) -> Entry {
        Entry {
            name: "raytrace",
            about: "distribution ray tracing (Cook et al. 1984) with a tree that is built anew in each frame",
            options: &[OptionSpec {
                name: "rays",
                about: "shadow rays of each pixel",
                values: Values::Whole(1, 1024),
                default: "16",
                tacit: false,
            }],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[SORT, TREE, TRACE]
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
        // A point is hit by any ray.
        let count = if light.is_soft() { options.whole("rays") } else { 1 };
        let rays = Rays::new(runner.arena, &light, count);

        runner.phase(&SORT);
        let order = order::along_curve(&scene, runner)?;

        runner.phase(&TREE);
        let tree = Tree::build(&scene, order, input.largest, runner)?;

        runner.phase(&TRACE);
        trace::trace(&tree, receivers, rays, visibility, runner)?;
        Ok(Shadows { visibility: read(visibility, input, runner.arena), silhouette_edges: None })
    }
}
