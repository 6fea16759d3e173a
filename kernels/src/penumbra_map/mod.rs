//! Penumbra maps (Wyman and Hansen 2003): a shadow map, and beside it a map of the outer penumbras that silhouettes throw on what it shows.
//!
//! ```text
//! map: setup, tiles, draw    the shadow map
//! silhouettes                edges that weigh something, and their images on each face
//! penumbra                   texels of a tile: the darkest of all penumbras that silhouettes throw there
//! look                       shadow where the map hides the receiver, else what the penumbra map has
//! ```
//!
//! From a silhouette edge a sheet widens towards the scene as the light's cone does, and so the penumbra that it throws on a surface: at
//! depth z it reaches `L (z - z_v) / z_v` beyond the edge. In the picture from the middle of the light that is `L (1/z_v - 1/z)`, so
//! that a texel asks each edge near to it for the nearest place of its image: cones at the vertices and the sheets between them
//! in one. The paper draws both as polygons and subdivides what is not planar; here every texel has its own cone.
//!
//! What the hard shadow covers stays dark: penumbras are outer ones alone, too dark, and shadows too large by the inner half.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::options::{Entry, OptionSpec, Options, Values, Word};
use lrbsim_isa::{Addr, Compare, Kernel, Phase, Runner, Step, Stopped, Vpu, math};
use lrbsim_workloads::{Light, ShadowInput};

use crate::columns::{lanes_below, task_range};
use crate::expression::{each, int, scalar};
use crate::face::turned;
use crate::field;
use crate::irregular::primitives::{EdgeRecord, LightConstants, Primitives};
use crate::irregular::receivers::{Receiver, Receivers};
use crate::irregular::silhouette;
use crate::map::cover::NEAR;
use crate::map::layout::{Layout, MapFace, MapSlot};
use crate::map::look::{Bias, whole};
use crate::map::options::{BIAS, SIZE, bias, objection_to_other_than, size};
use crate::map::tiles::{Boxes, Tile, Tiles};
use crate::map::{self, DepthMap};
use crate::method::{Method, Shadows, read};
use crate::plane::Vec3;
use crate::record::{Records, words};
use crate::scene::Scene;
use crate::segment::Vec2;

/// Penumbra maps, as a method among others.
pub struct PenumbraMap;

const SILHOUETTE: Phase = Phase { id: "silhouette", title: "silhouette detection", in_paper_total: false };
const PENUMBRA: Phase = Phase { id: "penumbra", title: "penumbra map", in_paper_total: false };
const LOOK: Phase = Phase { id: "look", title: "shadow and penumbra lookup", in_paper_total: false };

/// Number of edges, or of receivers, that a task handles.
const TASK: u32 = 256;

/// Part of the map's side that lies outside of the receivers on each side, for what throws a penumbra on those at its border.
const MARGIN: u32 = 16;

/// How light grows through a penumbra, before it is smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gradient {
    /// By depths in the world [wyman03, Eq. 1].
    Printed,
    /// By the distance from the shadow's border, which is what reciprocal depths give [algorithms, 5.3].
    Linear,
}

impl Method for PenumbraMap {
    fn entry(&self) -> Entry {
        Entry {
            name: "penumbra-map",
            about: "penumbra maps (Wyman and Hansen 2003): outer penumbras alone",
            options: &[
                SIZE,
                OptionSpec {
                    name: "gradient",
                    about: "how light grows through a penumbra, before it is smoothed by Bernstein's cubic",
                    values: Values::OneOf(&[
                        Word {
                            name: "printed",
                            about: "by Eq. 1 of the paper, whose depths in the world bend it",
                        },
                        Word {
                            name: "linear",
                            about: "by the distance from the border of the shadow, as the text says",
                        },
                    ]),
                    default: "printed",
                    tacit: false,
                },
                BIAS,
            ],
        }
    }

    fn phases(&self) -> &'static [Phase] {
        &[SILHOUETTE, map::SETUP, map::TILES, map::DRAW, PENUMBRA, LOOK]
    }

    fn objection_to_light(&self, _options: &Options, light: &Light) -> Option<String> {
        objection_to_other_than("ball", "penumbra-map", light)
    }

    fn run(
        &self,
        options: &Options,
        input: &mut ShadowInput,
        runner: &mut Runner<'_>,
    ) -> Result<Shadows, Stopped> {
        let visibility = runner.arena.overwritten(u64::from(input.width * input.height));
        let gradient = [Gradient::Printed, Gradient::Linear][options.word("gradient")];
        let size = size(options);
        let scene = Scene::uncut(input, runner.arena);
        let receivers = Receivers::new(input, runner.arena);

        runner.phase(&SILHOUETTE);
        let primitives = silhouette::detect(&scene, LightConstants::new(input), None, runner)?;

        runner.phase(&map::SETUP);
        let layout = Layout::build(&receivers, size, size / MARGIN, runner)?;
        let map =
            DepthMap::draw_scene(&scene, receivers, primitives.triangles, layout, input.largest, runner)?;

        runner.phase(&PENUMBRA);
        let near = NEAR * input.largest;
        let radius = input.light_radius;
        let boxes = Boxes::new(runner.arena, &layout, primitives.edge_count);
        let images = Images::new(runner, &layout, primitives.edge_count);
        let kernel = Project { primitives, layout, near, radius, boxes, images };
        // SAFETY: each task writes the boxes and the images of its own edges.
        runner.run(&unsafe {
            Step::independent("edge images", primitives.edge_count.div_ceil(TASK), kernel)
        })?;
        let tiles = Tiles::sort(boxes, &layout, ["edge counts", "edge lists"], runner)?;
        let penumbra = runner.arena.overwritten(layout.texel_count());
        let kernel = Draw { map, tiles, images, gradient, radius, penumbra };
        // SAFETY: each task writes the texels of its own tile.
        runner.run(&unsafe { Step::independent("penumbra tiles", layout.tile_count(), kernel) })?;

        runner.phase(&LOOK);
        let kernel = Look { map, bias: bias(options), penumbra, visibility };
        // SAFETY: each task writes the pixels of its own receivers.
        runner.run(&unsafe { Step::independent("look", receivers.count.div_ceil(TASK), kernel) })?;
        let visibility = read(visibility, input, runner.arena);
        Ok(Shadows { visibility, silhouette_edges: Some(u64::from(primitives.edge_count)) })
    }
}

/// The image of an edge on a face, as far as it is ahead of the light.
#[repr(C)]
struct EdgeImage {
    /// Places of its ends on the image plane, and their reciprocal depths.
    ends: [[f32; 3]; 2],
    padding: [u32; 2],
}

/// Images of all edges on all squares.
#[derive(Clone, Copy)]
struct Images {
    records: Records<EdgeImage>,
    /// Edges of a square.
    stride: u32,
}

impl Images {
    fn new(runner: &mut Runner<'_>, layout: &Layout, edges: u32) -> Images {
        let stride = edges + 16;
        let count = u64::from(stride) * u64::from(layout.slot_count);
        Images { records: Records::overwritten(runner.arena, count), stride }
    }
}

/// Finds the images of edges, and the texels that their penumbras may cover.
struct Project {
    primitives: Primitives,
    layout: Layout,
    near: f32,
    radius: f32,
    boxes: Boxes,
    images: Images,
}

impl Kernel for Project {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Project { primitives, layout, boxes, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, primitives.edge_count);
        let lane = v.viota();
        let zero = v.vset_f32(0.0);
        let record_words = v.vset_i32(words::<EdgeRecord>() as i32);
        let slots = v.s_imm(layout.slot_count as i32);
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let first = v.vsplat(i);
            let at = int!(v, (first + lane) * record_words);
            let ends = each!(end in [0, 1] => {
                each!(axis in [0, 1, 2] => {
                    let field = primitives.edges.field(field!(EdgeRecord.ends[end][axis]));
                    v.vgather_f32_or(zero, live, field, at)
                })
            });
            let mut slot = v.s_imm(0);
            while v.branch(Compare::Less, slot, slots) {
                let face = v.s_load(layout.slots.column(field!(MapSlot.face)), slot);
                let ends = turned(v, face, ends);
                let (ahead, images) = self.on_face(v, ends);
                let reach = self.reach(v, face, images);
                let ahead = v.kand(ahead, live);
                boxes.store(v, layout, [slot, face], i, ahead, reach);
                self.store(v, live, slot, i, images);
                slot = scalar!(v, slot + 1);
            }
            i = scalar!(v, i + 16);
        }
    }
}

impl Project {
    /// Images of 16 edges on a face, in whose frame they are: places of their ends and reciprocal depths, as far as they are ahead of the light; the
    /// lanes in which some of an edge is.
    #[inline(always)]
    fn on_face<V: Vpu>(&self, v: &mut V, ends: [Vec3<V>; 2]) -> (V::Mask, [Vec3<V>; 2]) {
        let near = v.vset_f32(self.near);
        let depths = each!(end in [0, 1] => ends[end][2]);
        let ahead = each!(end in [0, 1] => v.vcmp_gt(depths[end], near));
        let any = v.kor(ahead[0], ahead[1]);
        let images = each!(end in [0, 1] => {
            // An end that is behind moves along the edge to the nearest depth.
            let other = 1 - end;
            let along = v.vsub(depths[other], depths[end]);
            let part = v.vsub(near, depths[end]);
            let part = math::div(v, part, along);
            let depth = v.vblend_f32(ahead[end], depths[end], near);
            let inverse = v.vrcp(depth);
            let place = each!(of in [0, 1] => {
                let side = v.vsub(ends[other][of], ends[end][of]);
                let moved = v.vmadd(side, part, ends[end][of]);
                let place = v.vblend_f32(ahead[end], ends[end][of], moved);
                v.vmul(place, inverse)
            });
            [place[0], place[1], inverse]
        });
        (any, images)
    }

    /// What penumbras of these images reach of the image plane, on what no receiver lies beyond: from where and to where along both
    /// axes.
    #[inline(always)]
    fn reach<V: Vpu>(&self, v: &mut V, face: V::S32, images: [Vec3<V>; 2]) -> [Vec2<V>; 2] {
        let radius = v.vset_f32(self.radius);
        let nearest = v.vmax(images[0][2], images[1][2]);
        let farthest = v.vbroadcast_f32(self.layout.faces.column(field!(MapFace.farthest)), face);
        let width = reach(v, nearest, farthest, radius);
        let zero = v.vset_f32(0.0);
        let width = v.vmax(width, zero);
        let low = each!(axis in [0, 1] => {
            let low = v.vmin(images[0][axis], images[1][axis]);
            v.vsub(low, width)
        });
        let high = each!(axis in [0, 1] => {
            let high = v.vmax(images[0][axis], images[1][axis]);
            v.vadd(high, width)
        });
        [low, high]
    }

    /// Stores the images of the 16 edges from `i` on.
    #[inline(always)]
    fn store<V: Vpu>(&self, v: &mut V, live: V::Mask, slot: V::S32, i: V::S32, images: [Vec3<V>; 2]) {
        let lane = v.viota();
        let record_words = v.vset_i32(words::<EdgeImage>() as i32);
        let first = scalar!(v, (slot * { self.images.stride as i32 }) + i);
        let first = v.vsplat(first);
        let at = int!(v, (first + lane) * record_words);
        for (end, image) in images.into_iter().enumerate() {
            for (axis, x) in image.into_iter().enumerate() {
                let field = self.images.records.field(field!(EdgeImage.ends[end][axis]));
                v.vscatter_f32(live, field, at, x);
            }
        }
    }
}

/// Draws the penumbras of a tile: the darkest stays.
struct Draw {
    map: DepthMap,
    tiles: Tiles,
    images: Images,
    gradient: Gradient,
    radius: f32,
    penumbra: Addr,
}

impl Kernel for Draw {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Draw { map, tiles, penumbra, .. } = self;
        let tile = Tile::new(v, &map.layout, task);
        let all = v.mask_all();
        let lit = v.vset_f32(1.0);
        let [mut word, end] = tile.words;
        while v.branch(Compare::Less, word, end) {
            v.vstore_f32(all, *penumbra, word, lit);
            word = scalar!(v, word + 16);
        }
        let [mut item, end] = tiles.items_of(v, &tile);
        while v.branch(Compare::Less, item, end) {
            let number = tiles.number(v, item);
            self.edge(v, &tile, number);
            item = scalar!(v, item + 1);
        }
    }
}

impl Draw {
    /// Draws the penumbra of edge `number` on a tile.
    #[inline(always)]
    fn edge<V: Vpu>(&self, v: &mut V, tile: &Tile<V>, number: V::S32) {
        let Draw { map, tiles, images, penumbra, .. } = self;
        let (zero, unit) = (v.vset_f32(0.0), v.vset_f32(1.0));
        let radius = v.vset_f32(self.radius);
        let slot = tile.slot;
        let record = scalar!(v, (slot * { images.stride as i32 }) + number);
        let image = images.records.record(v, record);
        let a = image.vec3(v, field!(EdgeImage.ends[0]));
        let b = image.vec3(v, field!(EdgeImage.ends[1]));
        let along = each!(axis in [0, 1, 2] => v.vsub(b[axis], a[axis]));
        let length2 = v.vmul(along[1], along[1]);
        let length2 = v.vmadd(along[0], along[0], length2);
        let has_length = v.vcmp_gt(length2, zero);
        let per_length2 = v.vrcp_or(zero, has_length, length2);

        let [[low_x, last_x], [low_y, last_y]] = tiles.range(v, tile, number);
        let one = v.vset_i32(1);
        let mut x = scalar!(v, (low_x >> 4) << 4);
        while v.branch(Compare::LessEqual, x, last_x) {
            let columns = tile.columns(v, x);
            let place_x = tile.middle(v, 0, columns);
            let from_x = v.vsub(place_x, a[0]);
            let part_x = v.vmul(from_x, along[0]);
            let mut row = tile.row(v, low_y);
            let mut to = tile.word(v, &map.layout, x, low_y);
            let mut y = low_y;
            while v.branch(Compare::LessEqual, y, last_y) {
                // The place of the edge's image that is nearest, and how far it is.
                let place_y = tile.middle(v, 1, row);
                let from_y = v.vsub(place_y, a[1]);
                let part = v.vmadd(from_y, along[1], part_x);
                let part = v.vmul(part, per_length2);
                let part = v.vmax(part, zero);
                let part = v.vmin(part, unit);
                let aside_x = v.vnmadd(part, along[0], from_x);
                let aside_y = v.vnmadd(part, along[1], from_y);
                let aside2 = v.vmul(aside_y, aside_y);
                let aside2 = v.vmadd(aside_x, aside_x, aside2);
                let edge_inverse = v.vmadd(part, along[2], a[2]);
                // The cone there reaches the surface of the texel as wide as the depths say.
                let inverse = v.vload_f32(map.texels, to);
                let between = v.vsub(edge_inverse, inverse);
                let width = reach(v, edge_inverse, inverse, radius);
                let width2 = v.vmul(width, width);
                let inside = v.vcmp_lt(aside2, width2);
                let inside = v.vcmp_gt_masked(inside, between, zero);
                let inside = v.vcmp_gt_masked(inside, inverse, zero);
                if v.branch_any(inside) {
                    let aside = math::sqrt(v, aside2);
                    let linear = math::div(v, aside, width);
                    let light = match self.gradient {
                        Gradient::Linear => linear,
                        Gradient::Printed => by_depths(v, linear, edge_inverse, inverse),
                    };
                    let light = smooth(v, light);
                    let before = v.vload_f32(*penumbra, to);
                    let after = v.vmin(before, light);
                    v.vstore_f32(inside, *penumbra, to, after);
                }
                row = int!(v, row + one);
                to = scalar!(v, to + { 1 << map.layout.tile_log2 });
                y = scalar!(v, y + 1);
            }
            x = scalar!(v, x + 16);
        }
    }
}

/// How far a penumbra reaches beyond an edge on the image plane, from the reciprocal depths of the edge and of the surface that
/// it falls on: times the depth of that, `L (z - z_v) / z_v` [wyman03, §3].
#[inline(always)]
pub fn reach<V: Vpu>(v: &mut V, edge: V::F32, surface: V::F32, radius: V::F32) -> V::F32 {
    let between = v.vsub(edge, surface);
    v.vmul(between, radius)
}

/// The gradient of Eq. 1, `(z_F - z_v) / (z_P - z_v)`, from `linear`, the same of reciprocal depths, and the reciprocal depths of
/// the edge and of the surface behind it [algorithms, 5.3].
#[inline(always)]
pub fn by_depths<V: Vpu>(v: &mut V, linear: V::F32, edge: V::F32, surface: V::F32) -> V::F32 {
    // Between the surface's and the edge's reciprocal depth lies that of the cone.
    let between = v.vsub(edge, surface);
    let cone = v.vnmadd(linear, between, edge);
    let over = v.vmul(linear, surface);
    math::div(v, over, cone)
}

/// Bernstein's cubic, `3 t^2 - 2 t^3` (Parker et al. 1998).
#[inline(always)]
pub fn smooth<V: Vpu>(v: &mut V, t: V::F32) -> V::F32 {
    let (two, three) = (v.vset_f32(2.0), v.vset_f32(3.0));
    let slope = v.vnmadd(two, t, three);
    let squared = v.vmul(t, t);
    v.vmul(squared, slope)
}

/// Looks receivers up in both maps.
struct Look {
    map: DepthMap,
    bias: Bias,
    penumbra: Addr,
    /// Visible part of the light by pixel.
    visibility: Addr,
}

impl Kernel for Look {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Look { map, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, map.receivers.count);
        let (zero, one) = (v.vset_f32(0.0), v.vset_f32(1.0));
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let places = map.places(v, live, i, self.bias);
            let texel = places.texels(v, places.place);
            let texel = whole(v, texel);
            let (_, hides) = map.look(v, live, &places, texel);
            let (_, word) = map.word(v, &places, texel);
            let light = v.vgather_f32_or(one, live, self.penumbra, word);
            let visible = v.vblend_f32(hides, zero, light);
            let pixel = v.vload_i32(map.receivers.columns.column(field!(Receiver.pixel)), i);
            v.vscatter_f32(live, self.visibility, pixel, visible);
            i = scalar!(v, i + 16);
        }
    }
}
