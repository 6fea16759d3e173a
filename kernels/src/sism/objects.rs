//! Objects told apart, for `overlap=product` and `overlap=max`: what each hides, and from that what all hide.
//!
//! Layers and parts of one object add up to what it hides of the light, as in `hard` and `soft`; a single part says nothing, since it
//! may be negative. What several objects hide depends on how they lie before the light, which sums do not tell: as much of what
//! the others leave as of the whole, or nothing but what the largest hides [algorithms, 2.9]. An object is what hangs together over
//! edges.
//!
//! The records of each block are sorted by object before their cells are found. Then `soft` has 16 receivers at a time go past the triangles
//! and the edges of the cell side by side, object by object. The layers that `hard` has counted, those of all objects together, are not read here.

#![expect(unsafe_code, reason = "steps declare their tasks independent, each with its reason")]

use lrbsim_isa::{Compare, Kernel, Runner, Step, Stopped, Vpu};
use lrbsim_workloads::reference::ObjectRule;

use super::compose::{rule_of_two, visible};
use super::cut::{CutParts, Hidden};
use super::hard::count_layers;
use super::kept::Kept;
use super::own::Own;
use super::soft::fixed;
use crate::columns::task_range;
use crate::expression::{each, scalar};
use crate::field;
use crate::irregular::grid::{Grid, Sample};
use crate::irregular::primitives::{EdgeRecord, Kind, Primitives, TriangleRecord};
use crate::irregular::raster::{BlockRecord, Raster};
use crate::irregular::receivers::Receiver;
use crate::irregular::run::{Entry, Samples};

/// Blocks of a task of the step that sorts.
const BLOCKS: u32 = 4;

/// How the soft kernel tells objects apart.
#[derive(Clone, Copy)]
pub struct Objects {
    rule: ObjectRule,
    own: Own,
    grid: Grid,
    /// What triangles hide that the light is cut by.
    cut: Option<Hidden>,
}

/// Sorts the records of the blocks by object, before their cells are found.
pub fn sort(
    primitives: &Primitives,
    grid: &Grid,
    raster: &Raster,
    runner: &mut Runner<'_>,
) -> Result<(), Stopped> {
    let blocks = grid.faces.block_count();
    for kind in Kind::ALL {
        let sort = Sort { kind, raster: *raster, primitives: *primitives, blocks };
        // SAFETY: each task moves records within its own lists.
        runner.run(&unsafe { Step::independent("records by object", blocks.div_ceil(BLOCKS), sort) })?;
    }
    Ok(())
}

impl Objects {
    /// Objects told apart by this rule. `cut` is what triangles hide that the light is cut by.
    pub fn new(rule: ObjectRule, primitives: &Primitives, grid: &Grid, cut: Option<Hidden>) -> Objects {
        Objects { rule, own: Own { primitives: *primitives }, grid: *grid, cut }
    }

    /// What 16 samples see of the light before the first object.
    #[inline(always)]
    pub fn begin<V: Vpu>(&self, v: &mut V, samples: &Samples<V>) -> Left<V> {
        let none = v.vset_i32(0);
        let receiver = v.vload_i32(self.grid.samples.column(field!(Sample.receiver)), samples.first);
        let triangles = self.grid.receivers.columns.column(field!(Receiver.triangle));
        let own = v.vgather_i32_or(none, samples.live, triangles, receiver);
        let own_triangles = self.own.triangles(v, samples.live, own);
        let mut horizon = None;
        if v.branch_any(own_triangles.cut) {
            let object = self.own.object(v, &own_triangles);
            let parts = self.own.parts(v, samples.position, &own_triangles);
            horizon = Some(OwnPart { left: own_triangles.cut, object, parts });
        }
        let visible = v.vset_f32(1.0);
        Left { own, horizon, object: v.s_imm(-1), layers: [none; 2], visible }
    }

    /// Number of the object of the primitive of a record.
    #[inline(always)]
    pub fn of<V: Vpu>(&self, v: &mut V, kind: Kind, entry: &Entry<V>) -> V::S32 {
        let number = entry.number(v);
        object_of(v, &self.own.primitives, kind, number)
    }

    /// Counts the layers that a triangle makes.
    #[inline(always)]
    pub fn count<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, entry: &Entry<V>, left: &mut Left<V>) {
        let number = entry.number(v);
        let in_every_lane = entry.in_every_lane(v);
        let triangle = self.own.primitives.triangles.record(v, number);
        let (live, points) = (samples.live, samples.position);
        left.layers = count_layers(v, live, points, left.own, in_every_lane, triangle, left.layers);
    }

    /// Goes on to `object`, or to none below 0: what the one before it hides, whose `coverage` is given, is put together with the
    /// others. Whether it was another.
    #[inline(always)]
    pub fn turn_to<V: Vpu>(
        &self,
        v: &mut V,
        object: V::S32,
        kept: Kept,
        coverage: [V::I32; 2],
        left: &mut Left<V>,
    ) -> bool {
        let before = left.object;
        if !v.branch(Compare::NotEqual, before, object) {
            return false;
        }
        let nothing = v.s_imm(0);
        if v.branch(Compare::LessEqual, nothing, before) {
            let mut parts = each!(k in [0, 1] => kept.in_fixed_point(v, coverage[k]));
            if let Some(horizon) = &mut left.horizon {
                let number = v.vsplat(before);
                let here = v.vicmp_eq_masked(horizon.left, horizon.object, number);
                parts = each!(k in [0, 1] => v.viadd_or(parts[k], here, parts[k], horizon.parts[k]));
                horizon.left = v.kandn(here, horizon.left);
            }
            let by_this = visible(v, left.layers, Some(parts), None);
            left.visible = rule_of_two(v, self.rule, left.visible, by_this);
        }
        let none = v.vset_i32(0);
        left.object = object;
        left.layers = [none; 2];
        true
    }

    /// The covered part of the light, in fixed point, after the last object: with those of which nothing but the own triangle comes
    /// to the light, and what cuts the light.
    #[inline(always)]
    pub fn covered<V: Vpu>(&self, v: &mut V, samples: &Samples<V>, left: &Left<V>) -> V::I32 {
        let none = v.vset_i32(0);
        let mut others = [None, None];
        if let Some(horizon) = &left.horizon
            && v.branch_any(horizon.left)
        {
            others[0] = Some(each!(k in [0, 1] => v.vblend_i32(horizon.left, horizon.parts[k], none)));
        }
        if let Some(Hidden::Parts(parts)) = self.cut {
            others[1] = Some(each!(k in [0, 1] => {
                v.vload_i32_or(none, samples.live, parts.column(field!(CutParts.parts[k])), samples.first)
            }));
        }
        let mut seen = left.visible;
        for parts in others.into_iter().flatten() {
            let by_these = visible(v, [none; 2], Some(parts), None);
            seen = rule_of_two(v, self.rule, seen, by_these);
        }
        let zero = v.vset_f32(0.0);
        let one = v.vset_f32(1.0);
        let covered = v.vsub(one, seen);
        fixed(v, covered, zero)
    }
}

/// What the objects that 16 samples have seen leave of the light.
pub struct Left<V: Vpu> {
    /// Number of the triangle that each sample lies on, which does not shadow it.
    own: V::I32,
    /// What own triangles take out of the sums of their objects; `None` where the planes of none cut the light.
    horizon: Option<OwnPart<V>>,
    /// The object that is being looked at; none at first.
    object: V::S32,
    /// Its layers in F and B.
    layers: [V::I32; 2],
    /// What the objects before it leave of the light.
    visible: V::F32,
}

/// What own triangles take out of the sums of their objects.
struct OwnPart<V: Vpu> {
    /// Lanes in which that is to be done yet.
    left: V::Mask,
    /// The objects.
    object: V::I32,
    /// Parts in F and B, in fixed point.
    parts: [V::I32; 2],
}

/// Number of the object of primitive `number`.
#[inline(always)]
fn object_of<V: Vpu>(v: &mut V, primitives: &Primitives, kind: Kind, number: V::S32) -> V::S32 {
    match kind {
        Kind::Triangles => {
            let triangle = primitives.triangles.record(v, number);
            let flags = triangle.scalar(v, field!(TriangleRecord.flags[1]));
            scalar!(v, flags & { i32::MAX })
        }
        Kind::Edges => {
            let edge = primitives.edges.record(v, number);
            edge.scalar(v, field!(EdgeRecord.object))
        }
    }
}

/// Sorts the records of each block by object: those that are in order, as most are, are only looked at.
struct Sort {
    kind: Kind,
    raster: Raster,
    primitives: Primitives,
    blocks: u32,
}

impl Kernel for Sort {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut block, last) = task_range(v, task, BLOCKS, self.blocks);
        while v.branch(Compare::Less, block, last) {
            let [first, end] = self.raster.range(v, self.kind, block);
            self.list(v, first, end);
            block = scalar!(v, block + 1);
        }
    }
}

impl Sort {
    /// The object of record `at`.
    #[inline(always)]
    fn object<V: Vpu>(&self, v: &mut V, at: V::S32) -> V::S32 {
        let number = self.raster.primitive(v, at);
        object_of(v, &self.primitives, self.kind, number)
    }

    /// Sorts records `first..end`: by insertion, at distances that halve [shell59, hibbard63].
    #[inline(always)]
    fn list<V: Vpu>(&self, v: &mut V, first: V::S32, end: V::S32) {
        let one = v.s_imm(1);
        let mut before = v.s_imm(0);
        let mut in_order = true;
        let mut i = first;
        while v.branch(Compare::Less, i, end) {
            let object = self.object(v, i);
            if v.branch(Compare::Less, object, before) {
                in_order = false;
                break;
            }
            before = object;
            i = scalar!(v, i + 1);
        }
        if in_order {
            return;
        }
        let count = scalar!(v, end - first);
        let mut gap = one;
        while v.branch(Compare::Less, gap, count) {
            gap = scalar!(v, (gap + gap) + 1);
        }
        let numbers = self.raster.records.column(field!(BlockRecord.primitive));
        while v.branch(Compare::Less, one, gap) {
            gap = scalar!(v, gap >> 1);
            let mut i = scalar!(v, first + gap);
            while v.branch(Compare::Less, i, end) {
                let moved = v.s_load(numbers, i);
                let object = object_of(v, &self.primitives, self.kind, moved);
                let mut to = i;
                let least = scalar!(v, first + gap);
                while v.branch(Compare::LessEqual, least, to) {
                    let other = scalar!(v, to - gap);
                    let there = v.s_load(numbers, other);
                    let object_there = object_of(v, &self.primitives, self.kind, there);
                    if v.branch(Compare::LessEqual, object_there, object) {
                        break;
                    }
                    v.s_store(numbers, to, there);
                    to = other;
                }
                v.s_store(numbers, to, moved);
                i = scalar!(v, i + 1);
            }
        }
    }
}
