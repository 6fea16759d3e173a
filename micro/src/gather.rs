//! Gathers of so many distinct lines.

use crate::chase::align;
use crate::threads::{again, start};
use crate::{Prepared, Threads, pass, short};
use lrbsim_isa::kernel::Kernel;
use lrbsim_isa::vpu::Vpu;
use lrbsim_isa::{Addr, Arena};

/// Gathers between two branches.
const UNROLL: u64 = 8;
/// Turns of the loop in the long pass, at least.
const TURNS_MIN: u32 = 256;

/// Gathers of 16 lanes on one thread of core 0. Units: gathers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Gather {
    /// Distinct lines of each gather, 1 to 16.
    pub lines: u32,
    /// Bytes of the table, a power of two: the gathers walk through it and begin again.
    pub table_bytes: u32,
}

impl Gather {
    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        assert!((1..=16).contains(&self.lines) && self.table_bytes.is_power_of_two());
        let placement = Threads::OnCore { core: 0, threads: 1 }.place(&mut arena, cores, |_| 0);
        // Lanes go round the lines; one word of each.
        let lanes: Vec<u32> = (0..16).map(|lane| lane % self.lines * 16).collect();
        let lanes = arena.alloc_u32(&lanes);
        let table = align(&mut arena, 1 << 21);
        // The last gather of a lap reaches past the table.
        arena.alloc_bytes(u64::from(self.table_bytes) + UNROLL * 64 * u64::from(self.lines));
        let words = self.table_bytes / 4;
        let walk = |name, turns: u32| {
            let kernel = Walk {
                starts: placement.table(),
                lanes,
                table,
                gather_bytes: 64 * u64::from(self.lines),
                wrap: words as i32 - 1,
                turns: turns as i32,
            };
            pass(name, placement.tasks, kernel)
        };
        // A gather of one line goes through the table in so many turns, others in fewer: every pass sees all of it.
        let lap = self.table_bytes / (UNROLL as u32 * 64);
        let turns = TURNS_MIN.max(4 * lap);
        let few = short(turns, 1);
        let passes = vec![walk("warm", few), walk("short", few), walk("gather", turns)];
        Prepared { arena, passes, units: UNROLL * u64::from(turns - few) }
    }
}

struct Walk {
    starts: Addr,
    lanes: Addr,
    table: Addr,
    gather_bytes: u64,
    wrap: i32,
    turns: i32,
}

impl Kernel for Walk {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        let Some(mut at) = start(v, self.starts, task) else { return };
        let zero = v.s_imm(0);
        let all = v.mask_all();
        let lanes = v.vload_i32(self.lanes, zero);
        let nothing = v.vset_i32(0);
        let step = v.s_imm((UNROLL * self.gather_bytes / 4) as i32);
        let wrap = v.s_imm(self.wrap);
        let mut left = v.s_imm(self.turns);
        loop {
            let here = v.vsplat(at);
            let index = v.viadd(lanes, here);
            for i in 0..UNROLL {
                v.vgather_i32_or(nothing, all, self.table.plus(i * self.gather_bytes), index);
            }
            at = v.s_add(at, step);
            at = v.s_and(at, wrap);
            if !again(v, &mut left) {
                return;
            }
        }
    }
}
