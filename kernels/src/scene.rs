//! The geometry of a frame in the arena: what the host copies there, untimed.

use lrbsim_isa::{Addr, Arena, Vpu};
use lrbsim_workloads::adjacency::objects;
use lrbsim_workloads::{Counting, ShadowInput};

use crate::columns::Columns;
use crate::expression::each;
use crate::field;
use crate::irregular::CHILDREN;
use crate::irregular::primitives::{BACK, FRONT};
use crate::plane::Vec3;

/// A vertex of the scene.
#[repr(C)]
pub struct Vertex {
    /// Where the vertex lies, light-centred.
    pub position: [f32; 3],
}

/// A triangle of the scene.
#[repr(C)]
pub struct Triangle {
    /// Numbers of the vertices that are its corners.
    pub corners: [u32; 3],
    /// Layers of F (bit 0) and B (bit 1) that it is: facing the light in the low half, facing away in the high half.
    pub layers: u32,
}

/// An edge of the scene, of one triangle or more.
#[repr(C)]
pub struct Edge {
    /// Numbers of the vertices that are its ends, the lower first.
    pub ends: [u32; 2],
}

/// A point that a frame is seen from, light-centred: the middle of the light, or another point of it.
#[derive(Clone, Copy, Default)]
pub struct Viewpoint(Option<[f32; 3]>);

impl Viewpoint {
    /// The point at `place`.
    pub fn at(place: [f32; 3]) -> Viewpoint {
        Viewpoint(Some(place))
    }

    /// The vector that leads from `other` to this point.
    pub fn from(self, other: Viewpoint) -> [f32; 3] {
        let [a, b] = [self, other].map(|point| point.0.unwrap_or_default());
        [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
    }

    /// 16 points as seen from here. The middle of the light is where points are seen from anyway, which costs nothing.
    ///
    /// A point that lies here has no direction: it is left where it is seen from the middle.
    #[inline(always)]
    pub fn see<V: Vpu>(self, v: &mut V, live: V::Mask, point: Vec3<V>) -> Vec3<V> {
        let Some(place) = self.0 else { return point };
        let from_here = each!(axis in [0, 1, 2] => {
            let place = v.vset_f32(place[axis]);
            v.vsub(point[axis], place)
        });
        let mut apart = v.mask_none();
        let zero = v.vset_f32(0.0);
        for along in from_here {
            let along = v.vcmp_neq_masked(live, along, zero);
            apart = v.kor(apart, along);
        }
        each!(axis in [0, 1, 2] => v.vblend_f32(apart, from_here[axis], point[axis]))
    }
}

/// Vertices, triangles and edges of a frame.
#[derive(Clone, Copy)]
pub struct Scene {
    /// Where the scene is seen from: [`Scene::positions`] are from there.
    pub viewpoint: Viewpoint,
    /// Vertices, field by field.
    pub vertices: Columns<Vertex>,
    /// Triangles, field by field.
    pub triangles: Columns<Triangle>,
    /// Number of triangles.
    pub triangle_count: u32,
    /// Edges, field by field.
    pub edges: Columns<Edge>,
    /// Number of edges.
    pub edge_count: u32,
    /// First place in `edge_faces` of each edge; one more than there are edges.
    pub edge_first: Addr,
    /// `triangle << 1 | side` of the faces on edges.
    pub edge_faces: Addr,
}

impl Scene {
    /// Copies the geometry of a frame into the arena.
    pub fn new(input: &ShadowInput, arena: &mut Arena) -> Scene {
        let triangle_count = count_of(&input.triangles);
        let edge_count = count_of(&input.edges);

        let vertices: Columns<Vertex> = Columns::overwritten(arena, count_of(&input.vertices));
        for axis in 0..3 {
            let values = input.vertices.iter().map(|p| p[axis].to_bits());
            fill(arena, vertices.column(field!(Vertex.position[axis])), values);
        }
        let triangles: Columns<Triangle> =
            Columns::overwritten(arena, triangle_count.next_multiple_of(CHILDREN));
        for corner in 0..3 {
            let values = input.triangles.iter().map(|t| t[corner]);
            fill(arena, triangles.column(field!(Triangle.corners[corner])), values);
        }
        let layers = input.counting.iter().map(|&rule| layers(rule));
        fill(arena, triangles.column(field!(Triangle.layers)), layers);
        let edges: Columns<Edge> = Columns::overwritten(arena, edge_count);
        for end in 0..2 {
            fill(arena, edges.column(field!(Edge.ends[end])), input.edges.iter().map(|e| e[end]));
        }
        let edge_first = arena.overwritten(u64::from(edge_count) + 17);
        fill(arena, edge_first, input.edge_first.iter().copied());
        let edge_faces = arena.overwritten(input.edge_faces.len() as u64);
        fill(arena, edge_faces, input.edge_faces.iter().copied());
        let viewpoint = Viewpoint::default();
        Scene { viewpoint, vertices, triangles, triangle_count, edges, edge_count, edge_first, edge_faces }
    }

    /// Copies the geometry of a frame into the arena for a method to which triangles that the light is cut by are as any others.
    pub fn uncut(input: &ShadowInput, arena: &mut Arena) -> Scene {
        let scene = Scene::new(input, arena);
        for cut in &input.cut {
            for (corner, vertex) in cut.corners.into_iter().enumerate() {
                arena.write_u32(scene.triangles.host(cut.number, field!(Triangle.corners[corner])), vertex);
            }
        }
        scene
    }

    /// This scene as it is seen from `viewpoint`.
    pub fn seen_from(self, viewpoint: Viewpoint) -> Scene {
        Scene { viewpoint, ..self }
    }

    /// Positions of 16 vertices, from the viewpoint.
    #[inline(always)]
    pub fn positions<V: Vpu>(&self, v: &mut V, live: V::Mask, vertex: V::I32) -> Vec3<V> {
        let zero = v.vset_f32(0.0);
        let point = each!(axis in [0, 1, 2] => {
            let column = self.vertices.column(field!(Vertex.position[axis]));
            v.vgather_f32_or(zero, live, column, vertex)
        });
        self.viewpoint.see(v, live, point)
    }
}

/// The objects that triangles and edges of the scene belong to, word by word.
#[derive(Clone, Copy)]
pub struct ObjectNumbers {
    /// Number of the object of each triangle.
    pub triangles: Addr,
    /// Number of the object of each edge.
    pub edges: Addr,
}

impl ObjectNumbers {
    /// Copies the numbers into the arena, untimed as the rest of the scene.
    pub fn new(input: &ShadowInput, arena: &mut Arena) -> ObjectNumbers {
        let of_triangles = objects_of_triangles(input);
        let of_edge = |row: &[u32]| row.first().map_or(0, |face| of_triangles[(face >> 1) as usize]);
        let triangles = arena.overwritten(of_triangles.len() as u64 + 16);
        let edges = arena.overwritten(input.edges.len() as u64 + 16);
        fill(arena, triangles, of_triangles.iter().copied());
        fill(arena, edges, faces_of_edges(input).map(of_edge));
        ObjectNumbers { triangles, edges }
    }
}

/// Faces on each edge of the scene, as [`ShadowInput::edge_faces`] has them.
fn faces_of_edges(input: &ShadowInput) -> impl Iterator<Item = &[u32]> {
    let starts = &input.edge_first;
    (0..input.edges.len()).map(|e| &input.edge_faces[starts[e] as usize..starts[e + 1] as usize])
}

/// Number of the object of each triangle: what hangs together over edges.
pub(crate) fn objects_of_triangles(input: &ShadowInput) -> Vec<u32> {
    objects(input.triangles.len(), faces_of_edges(input))
}

/// Layers of a triangle in F and B as in [`Triangle::layers`].
fn layers(rule: Counting) -> u32 {
    let (toward, away) = match rule {
        Counting::Closed => (FRONT | BACK, 0),
        Counting::Shell => (FRONT, BACK),
        Counting::Sheet => (FRONT | BACK, FRONT | BACK),
    };
    (toward | away << 16) as u32
}

/// Number of `items`; more than the arena holds where it does not fit.
pub(crate) fn count_of<T>(items: &[T]) -> u32 {
    u32::try_from(items.len()).unwrap_or(u32::MAX)
}

/// Writes `values` to consecutive words.
pub(crate) fn fill(arena: &mut Arena, to: Addr, values: impl Iterator<Item = u32>) {
    for (i, value) in values.enumerate() {
        arena.write_u32(to.plus_words(i as u64), value);
    }
}
