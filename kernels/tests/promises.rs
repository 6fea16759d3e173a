//! What the docs of the inner loops promise to cost.

mod common;

use common::{Lanewise, On, Run, input, polygons, run_step, sphere};
use lrbsim_isa::{Arena, HostSimd, Kernel, Step, Vpu};
use lrbsim_kernels::columns::Columns;
use lrbsim_kernels::field;
use lrbsim_kernels::irregular::primitives::{EdgeRecord, Form, TriangleRecord};
use lrbsim_kernels::irregular::receivers::Receiver;
use lrbsim_kernels::light::View;
use lrbsim_kernels::raytrace::trace::{hit, packet};
use lrbsim_kernels::raytrace::tree::RayTriangle;
use lrbsim_kernels::record::{Field, Records};
use lrbsim_kernels::segment::{Angle, segment};
use lrbsim_kernels::sism::hard::hidden;
use lrbsim_kernels::sism::printed::Printed;
use lrbsim_kernels::sism::soft::add_edge;
use lrbsim_kernels::sism::{Choices, Overlap};
use lrbsim_workloads::LightShape;
use lrbsim_workloads::glam::DVec3;

/// As in the docs of [`segment`], [`hidden`], [`add_edge`], [`hit`] and [`Printed::part`].
const SEGMENT: [u64; 2] = [19, 73];
const HIDDEN: [u64; 2] = [30, 39];
const EDGE: [u64; 2] = [62, 136];
const RAY: u64 = 52;
const PRINTED: [u64; 2] = [34, 85];

/// Uops of one task of `kernel`, spills included.
fn cost(kernel: impl Kernel + 'static, arena: &mut Arena) -> u64 {
    let step = Step::ordered("one", 1, kernel);
    run_step(&step, arena, On::Recording(HostSimd::detect())).uops
}

/// Loads `IN` vectors, and calls the function on them if asked to: the difference is its cost.
struct Once<F, const IN: usize> {
    function: Option<F>,
    from: Columns<[f32; IN]>,
}

impl<const IN: usize, F: Lanewise<IN, 1>> Kernel for Once<F, IN> {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let x = core::array::from_fn(|c| v.vload_f32(self.from.column(Field::whole().at(c)), task));
        if let Some(function) = &self.function {
            function.eval(v, x);
        }
    }
}

/// Cost of `function` for the same values in every lane.
fn cost_of<const IN: usize, F: Lanewise<IN, 1>>(function: F, x: [f32; IN]) -> u64 {
    let mut arena = Arena::new();
    let from: Columns<[f32; IN]> = Columns::overwritten(&mut arena, 16);
    for (c, x) in x.iter().enumerate() {
        for lane in 0..16 {
            arena.write_u32(from.host(lane, Field::whole().at(c)), x.to_bits());
        }
    }
    cost(Once { function: Some(function), from }, &mut arena)
        - cost(Once::<F, IN> { function: None, from }, &mut arena)
}

#[derive(Clone)]
struct Segment;

impl Lanewise<4, 1> for Segment {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, x: [V::F32; 4]) -> [V::F32; 1] {
        let all = v.mask_all();
        [segment(v, all, [x[0], x[1]], [x[2], x[3]]).1]
    }
}

#[test]
fn a_segment_costs_what_its_doc_says() {
    // One uop makes the mask.
    assert_eq!(cost_of(Segment, [-3.0, 2.0, 3.0, 2.0]), SEGMENT[0] + 1, "the line misses the disc");
    assert_eq!(cost_of(Segment, [-3.0, 0.5, 3.0, 0.5]), SEGMENT[1] + 1, "a hit");
}

/// One triangle.
#[derive(Clone)]
struct Hidden(Records<TriangleRecord>);

impl Lanewise<3, 1> for Hidden {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, points: [V::F32; 3]) -> [V::F32; 1] {
        let own = v.bits_of(points[0]);
        let all = v.mask_all();
        let first = v.s_imm(0);
        let covered = hidden(v, all, points, own, own, self.0.at(first)).unwrap_or(all);
        let zero = points[0];
        [v.vblend_f32(covered, zero, zero)]
    }
}

#[test]
fn a_hidden_test_costs_what_its_doc_says() {
    // All normals along x: points at x > 0 are left of all three edges, those at x < 0 right.
    let cost_at = |x: f32| {
        let mut arena = Arena::new();
        arena.poison_with(0);
        let from: Columns<[f32; 3]> = Columns::overwritten(&mut arena, 16);
        let record = Records::overwritten(&mut arena, 1);
        for edge in 0..3 {
            let normal = field!(TriangleRecord.edge_normals[edge][0]);
            arena.write_u32(record.field(normal), 1.0_f32.to_bits());
        }
        arena.write_u32(record.field(field!(TriangleRecord.normal[0])), 1.0_f32.to_bits());
        for lane in 0..16 {
            arena.write_u32(from.host(lane, Field::whole().at(0)), x.to_bits());
        }
        // The mask and the blend at the end are not the test's.
        cost(Once { function: Some(Hidden(record)), from }, &mut arena)
            - cost(Once::<Hidden, 3> { function: None, from }, &mut arena)
            - 2
    };
    assert_eq!(cost_at(-1.0), HIDDEN[0], "a miss by the edges");
    assert_eq!(cost_at(1.0), HIDDEN[1], "a hit");
}

/// One triangle, and rays along z that pass it or not.
#[derive(Clone)]
struct Ray(Records<RayTriangle>);

impl Lanewise<3, 1> for Ray {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [x, y, z]: [V::F32; 3]) -> [V::F32; 1] {
        let all = v.mask_all();
        let first = v.s_imm(0);
        let own = v.bits_of(x);
        let packet = packet(v, [x, y, z], [x, x, x], own);
        let hits = hit(v, all, &packet, self.0.at(first));
        [v.vblend_f32(hits, x, x)]
    }
}

/// What a packet is made of, and no triangle.
#[derive(Clone)]
struct NoRay;

impl Lanewise<3, 1> for NoRay {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, [x, y, z]: [V::F32; 3]) -> [V::F32; 1] {
        let own = v.bits_of(x);
        packet(v, [x, y, z], [x, x, x], own);
        [x]
    }
}

#[test]
fn a_ray_against_a_triangle_costs_what_its_doc_says() {
    let mut arena = Arena::new();
    arena.poison_with(0);
    let from: Columns<[f32; 3]> = Columns::overwritten(&mut arena, 16);
    let record = Records::overwritten(&mut arena, 1);
    // The mask and the blend at the end are not the test's.
    let with = cost(Once { function: Some(Ray(record)), from }, &mut arena);
    let without = cost(Once { function: Some(NoRay), from }, &mut arena);
    assert_eq!(with - without - 2, RAY);
}

#[derive(Clone)]
struct AddEdge {
    edges: Records<EdgeRecord>,
    add: bool,
}

impl Lanewise<3, 1> for AddEdge {
    #[inline(always)]
    fn eval<V: Vpu>(&self, v: &mut V, points: [V::F32; 3]) -> [V::F32; 1] {
        let one = v.vset_f32(1.0);
        let view = View::new(v, &LightShape::Facing, points, one);
        let all = v.mask_all();
        let none = v.vset_i32(0);
        let first = v.s_imm(0);
        if self.add {
            add_edge(v, &view, all, points, self.edges.at(first), [none; 2]);
        }
        [one]
    }
}

#[test]
fn an_edge_costs_what_its_doc_says() {
    let cost_of_edge = |y: f32| {
        let mut arena = Arena::new();
        arena.poison_with(0);
        let from: Columns<[f32; 3]> = Columns::overwritten(&mut arena, 16);
        for lane in 0..16 {
            arena.write_u32(from.host(lane, Field::whole().at(2)), 2.0_f32.to_bits());
        }
        let ends = [-1.0, y, 1.0, 1.0, y, 1.0].map(f32::to_bits);
        let edges: Records<EdgeRecord> = Records::overwritten(&mut arena, 1);
        arena.write_u32s(edges.field(field!(EdgeRecord.ends)), &ends);
        let mut run = |add| cost(Once { function: Some(AddEdge { edges, add }), from }, &mut arena);
        run(true) - run(false)
    };
    assert_eq!(cost_of_edge(5.0), EDGE[0], "the edge's line misses the disc");
    assert_eq!(cost_of_edge(0.1), EDGE[1], "a hit");
}

/// One edge of the printed form, for receivers on the face along z.
struct PrintedPart {
    printed: Printed,
    /// Number of the edge; `None`: nothing is done.
    edge: Option<i32>,
    receivers: Columns<Receiver>,
}

impl Kernel for PrintedPart {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let points =
            [0, 1, 2].map(|axis| v.vload_f32(self.receivers.column(field!(Receiver.position[axis])), task));
        let all = v.mask_all();
        let plane = self.printed.plane_of_face(v, 4, points);
        if let Some(edge) = self.edge {
            let edge = v.s_imm(edge);
            self.printed.part(v, &plane, all, edge, Angle::Atan2);
        }
    }
}

#[test]
fn a_part_of_the_printed_form_costs_what_its_doc_says() {
    // One edge passes the circles of all receivers, of radius 1/2 on the image plane; the lines of the others pass far off.
    let corners = [(-9.0, 0.1), (9.0, 0.1), (0.0, 9.0)].map(|(x, y)| DVec3::new(x, y, 1.0));
    let receivers = [(DVec3::new(0.0, 0.0, 2.0), u32::MAX); 16];
    let input = input(polygons(&[corners.to_vec()]), sphere(1.0), &receivers);
    let choices = Choices { form: Form::Printed, ..Overlap::Sum.into() };
    let mut run = Run::with(&input, choices, On::Host(HostSimd::detect(), 1));
    let printed = run.arrays.printed.expect("the form has images");
    let receivers = run.arrays.grid.receivers.columns;
    let mut cost_of = |edge| cost(PrintedPart { printed, edge, receivers }, &mut run.arena);
    let nothing = cost_of(None);
    let mut costs = [0, 1, 2].map(|edge| cost_of(Some(edge)) - nothing);
    costs.sort_unstable();
    assert_eq!(costs, [PRINTED[0], PRINTED[0], PRINTED[1]]);
}
