//! What timing needs to know of a class, one row each.

use crate::Cycle;
use crate::cache::Intent;
use crate::config::MachineSpec;
use lrbsim_isa::uop::Class;

/// What a uop of a class does to its thread and to memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Computes: the result comes after a fixed time.
    Compute,
    /// Ends a run of straight-line code: the thread goes on after a fixed time.
    Branch,
    /// Touches up to two lines, one a cycle.
    Access(Intent),
    /// Touches up to 16 lines at the configured rate.
    Gather(Intent),
    /// Brings lines near and waits for nothing.
    PrefetchL1,
    /// The same, into L2 only.
    PrefetchL2,
    /// The same, up to 16 lines into L1.
    GatherPrefetch,
    /// A locked operation.
    Atomic,
    /// Touches one line of the thread's stack.
    Spill(Intent),
}

/// Uses of issue resources; two uops with one in common do not pair.
pub(super) const PIPE_U: u8 = 1;
pub(super) const LOAD_PORT: u8 = 2;
pub(super) const STORE_PORT: u8 = 4;
const BRANCH_UNIT: u8 = 8;

/// One row, in one word of the host.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    latency: u32,
    /// `0xff` where the last byte of the uop is a distance, 0 where it counts lines.
    pub(super) third_producer: u8,
    pub(super) uses: u8,
    pub(super) kind: Kind,
}

const _: () = assert!(size_of::<Row>() == 8);

impl Row {
    /// Of no uop.
    pub(super) const NONE: Row = Row { latency: 1, third_producer: 0, uses: PIPE_U, kind: Kind::Compute };

    #[inline(always)]
    pub(super) fn latency(self) -> Cycle {
        Cycle::from(self.latency)
    }
}

/// Rows by class byte; the table has a row for every byte, so that looking one up needs no check.
pub(super) fn table(spec: &MachineSpec) -> Box<[Row; 256]> {
    let mut table = Box::new([Row::NONE; 256]);
    for class in Class::ALL {
        table[class as usize] = row(spec, class);
    }
    table
}

fn row(spec: &MachineSpec, class: Class) -> Row {
    use Intent::{Read, Stream, Write};
    use Kind::{Access, Atomic, Branch, Compute, Gather, GatherPrefetch, PrefetchL1, PrefetchL2, Spill};
    let core = &spec.core;
    let hit = spec.l1d.hit_cycles;
    // Latency, uses, kind. Pipe V takes what does not use pipe U: loads, stores, simple ALU, branches, cache control,
    // vector stores [seiler08, §3.2] and mask instructions [forsyth10]. The L1 does one load and one store a cycle
    // [chrysos12].
    let (latency, uses, kind) = match class {
        Class::VectorAlu | Class::VectorCompare => (core.vector_alu, PIPE_U, Compute),
        Class::VectorMul => (core.vector_mul, PIPE_U, Compute),
        Class::VectorFma => (core.vector_fma, PIPE_U, Compute),
        Class::VectorMath => (core.vector_math, PIPE_U, Compute),
        Class::VectorConvert => (core.vector_convert, PIPE_U, Compute),
        Class::VectorShuffle => (core.vector_shuffle, PIPE_U, Compute),
        Class::VectorLoad | Class::VectorBroadcastLoad | Class::ScalarLoad => (hit, LOAD_PORT, Access(Read)),
        Class::VectorStore | Class::ScalarStore => (1, STORE_PORT, Access(Write)),
        Class::VectorStreamStore => (1, STORE_PORT, Access(Stream)),
        Class::VectorExpand => (hit, PIPE_U | LOAD_PORT, Access(Read)),
        Class::VectorCompress => (1, PIPE_U | STORE_PORT, Access(Write)),
        Class::Gather => (hit, PIPE_U | LOAD_PORT, Gather(Read)),
        Class::AtomicGather => (hit, PIPE_U | LOAD_PORT | STORE_PORT, Gather(Write)),
        Class::Scatter | Class::AtomicScatter => (1, PIPE_U | STORE_PORT, Gather(Write)),
        Class::PrefetchL1 => (1, LOAD_PORT, PrefetchL1),
        Class::PrefetchL2 => (1, LOAD_PORT, PrefetchL2),
        Class::GatherPrefetch => (1, PIPE_U | LOAD_PORT, GatherPrefetch),
        Class::Mask => (core.mask, 0, Compute),
        Class::ScalarAlu => (core.scalar_alu, 0, Compute),
        Class::ScalarMul => (core.scalar_mul, PIPE_U, Compute),
        Class::Atomic => (spec.atomic_cycles, PIPE_U | LOAD_PORT | STORE_PORT, Atomic),
        Class::Branch => (core.branch, BRANCH_UNIT, Branch),
        Class::SpillStore => (1, STORE_PORT, Spill(Write)),
        Class::SpillLoad => (hit, LOAD_PORT, Spill(Read)),
    };
    let latency = u32::try_from(latency).expect("validated: a latency is far below 2^32 cycles");
    Row { latency, third_producer: if class.is_memory() { 0 } else { 0xff }, uses, kind }
}
