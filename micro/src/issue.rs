//! Throughput of arithmetic on registers.

use crate::threads::{again, start};
use crate::{Prepared, Threads, pass, short};
use lrbsim_isa::kernel::Kernel;
use lrbsim_isa::vpu::Vpu;
use lrbsim_isa::{Addr, Arena};

/// Instructions of a chain between two branches.
const UNROLL: u32 = 64;
/// Turns of the loop in the long pass.
const TURNS: u32 = 256;

/// The instruction that a chain is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Operation {
    /// A chain of multiplications.
    Multiply,
    /// A chain of fused multiply-adds.
    MultiplyAdd,
}

/// Chains of dependent vector instructions. Units: instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Issue {
    /// The instruction that the chains are made of.
    pub operation: Operation,
    /// Chains of a thread that do not depend on one another, 1 to 4.
    pub chains: u32,
    /// The threads that compute.
    pub threads: Threads,
}

impl Issue {
    pub(crate) fn prepare(&self, mut arena: Arena, cores: u32) -> Prepared {
        assert!((1..=4).contains(&self.chains), "{} chains", self.chains);
        let placement = self.threads.place(&mut arena, cores, |_| 0);
        let chain = |name, turns: u32| {
            let (operation, chains) = (self.operation, self.chains as usize);
            pass(
                name,
                placement.tasks,
                Chain { table: placement.table(), operation, chains, turns: turns as i32 },
            )
        };
        let few = short(TURNS, 1);
        Prepared {
            passes: vec![chain("warm", 1), chain("short", few), chain("chains", TURNS)],
            units: u64::from(self.chains * UNROLL * (TURNS - few)) * u64::from(self.threads.count()),
            arena,
        }
    }
}

struct Chain {
    table: Addr,
    operation: Operation,
    chains: usize,
    turns: i32,
}

impl Kernel for Chain {
    #[inline(always)]
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32) {
        if start(v, self.table, task).is_none() {
            return;
        }
        let factor = v.vset_f32(0.5);
        let mut sums = [factor; 4];
        let mut left = v.s_imm(self.turns);
        loop {
            for _ in 0..UNROLL {
                for sum in &mut sums[..self.chains] {
                    *sum = match self.operation {
                        Operation::Multiply => v.vmul(*sum, factor),
                        Operation::MultiplyAdd => v.vmadd(*sum, factor, factor),
                    };
                }
            }
            if !again(v, &mut left) {
                return;
            }
        }
    }
}
