//! What receivers see in the soft shadow map.

use lrbsim_isa::{Addr, Compare, Kernel, Vpu};

use super::blend::WHOLE;
use crate::columns::{lanes_below, task_range};
use crate::expression::{each, scalar};
use crate::face::{Constants, project};
use crate::field;
use crate::irregular::faces::load_positions;
use crate::irregular::receivers::{Receiver, Receivers};
use crate::map::layout::{Layout, MapFace};
use crate::map::look::whole;
use crate::sism::kept::Kept;

/// Number of texels, or of receivers, that a task handles.
pub(super) const TASK: u32 = 1024;

/// The first of the faces that maps look along: those across the light.
const FIRST_FACE: usize = 4;

/// Makes what is hidden of the light, from sums that may have gone beyond all of it; of two maps the greater.
pub(super) struct Finish {
    /// Sums of the first map, and of the second where there is one.
    pub sums: [Addr; 2],
    pub kept: Kept,
    /// Number of texels.
    pub count: u32,
    /// Hidden part of the light, by texel.
    pub hidden: Addr,
}

impl Kernel for Finish {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let (mut i, end) = task_range(v, task, TASK, self.count);
        let one = v.vset_f32(1.0);
        let all = v.mask_all();
        while v.branch(Compare::Less, i, end) {
            let mut most = v.vset_f32(0.0);
            for sums in &self.sums[..if self.sums[0] == self.sums[1] { 1 } else { 2 }] {
                let sum = if self.kept == Kept::Fixed {
                    let sum = v.vload_i32(*sums, i);
                    let sum = v.vcvt_i32_f32(sum);
                    let unit = v.vset_f32(1.0 / WHOLE);
                    v.vmul(sum, unit)
                } else {
                    v.vload_f32(*sums, i)
                };
                most = v.vmax(most, sum);
            }
            let hidden = v.vmin(most, one);
            v.vstore_f32(all, self.hidden, i, hidden);
            i = scalar!(v, i + 16);
        }
    }
}

/// Looks up receivers: each between the middles of four texels. What no map sees is lit.
pub(super) struct Look {
    pub receivers: Receivers,
    pub layout: Layout,
    pub hidden: Addr,
    /// Visible part of the light by pixel.
    pub visibility: Addr,
}

impl Kernel for Look {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Look { receivers, layout, .. } = self;
        let (mut i, end) = task_range(v, task, TASK, receivers.count);
        let constants = Constants::new(v);
        let (zero, one) = (constants.zero, constants.one);
        let [none, one_more, ..] = constants.whole;
        let half = v.vset_f32(0.5);
        let last = v.vset_i32(layout.used as i32 - 1);
        let faces = layout.faces;
        while v.branch(Compare::Less, i, end) {
            let live = lanes_below(v, i, end);
            let p = load_positions(v, &constants, receivers, live, i);
            let (face, x, y, _) = project(v, &constants, p);
            let seen = v.vicmp_ge_masked(live, face, constants.whole[FIRST_FACE]);
            let slot = v.vgather_i32_or(none, seen, faces.column(field!(MapFace.slot)), face);
            let middles = each!(axis in [0, 1] => {
                let origin = v.vgather_f32_or(zero, seen, faces.column(field!(MapFace.origin[axis])), face);
                let per_unit = v.vgather_f32_or(zero, seen, faces.column(field!(MapFace.per_unit[axis])), face);
                let from = v.vsub([x, y][axis], origin);
                v.vmsub(from, per_unit, half)
            });
            let first = whole(v, middles);
            // How far between the middles of two texels.
            let parts = each!(axis in [0, 1] => {
                let begin = v.vcvt_i32_f32(first[axis]);
                v.vsub(middles[axis], begin)
            });
            let columns = each!(more in [0, 1] => {
                let texel = if more == 0 { first[0] } else { v.viadd(first[0], one_more) };
                let texel = v.vimax(texel, none);
                v.vimin(texel, last)
            });
            let rows = each!(more in [0, 1] => {
                let texel = if more == 0 { first[1] } else { v.viadd(first[1], one_more) };
                let texel = v.vimax(texel, none);
                v.vimin(texel, last)
            });
            let of_rows = each!(row in [rows[0], rows[1]] => {
                let [left, right] = each!(column in [columns[0], columns[1]] => {
                    let word = layout.word(v, slot, [column, row]);
                    v.vgather_f32_or(zero, seen, self.hidden, word)
                });
                let step = v.vsub(right, left);
                v.vmadd(step, parts[0], left)
            });
            let step = v.vsub(of_rows[1], of_rows[0]);
            let hidden = v.vmadd(step, parts[1], of_rows[0]);
            let visible = v.vsub(one, hidden);
            let visible = v.vmax(visible, zero);
            let visible = v.vmin(visible, one);
            let visible = v.vblend_f32(seen, visible, one);
            let pixel = v.vload_i32(receivers.columns.column(field!(Receiver.pixel)), i);
            v.vscatter_f32(live, self.visibility, pixel, visible);
            i = scalar!(v, i + 16);
        }
    }
}
