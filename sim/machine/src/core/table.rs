//! What timing needs to know of a class, one row each.

use crate::cache::Intent;
use crate::config::MachineSpec;
use crate::counters::Cause;
use crate::when::Span;
use lrbsim_isa::uop::Class;

/// What a uop of a class does to its thread and to memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Computes: the result comes after a fixed time.
    Compute,
    /// Ends a run of straight-line code: the thread goes on after a fixed time.
    Branch,
    /// Touches up to two lines, one a cycle.
    Access(Intent),
    /// Touches up to 16 lines at the configured rate.
    Gather(Intent),
    /// Brings lines into the L1, and waits for nothing.
    PrefetchL1,
    /// Brings lines into the L2 only, and waits for nothing.
    PrefetchL2,
    /// Brings up to 16 lines into the L1, and waits for nothing.
    GatherPrefetch,
    /// A locked operation.
    Atomic,
    /// Locked operations on up to 16 lines, handed on at the rate of a gather.
    AtomicGather,
}

impl Kind {
    #[inline(always)]
    pub(crate) fn is_prefetch(self) -> bool {
        matches!(self, Kind::PrefetchL1 | Kind::PrefetchL2 | Kind::GatherPrefetch)
    }

    /// Whether its lines take their turns with those of all gathers of the core.
    #[inline(always)]
    pub(crate) fn is_gather(self) -> bool {
        matches!(self, Kind::Gather(_) | Kind::AtomicGather | Kind::GatherPrefetch)
    }

    /// Whether it works on each of its lines alone.
    #[inline(always)]
    pub(crate) fn locks(self) -> bool {
        matches!(self, Kind::Atomic | Kind::AtomicGather)
    }

    /// Whether it wants to change its lines.
    #[inline(always)]
    pub(crate) fn writes(self) -> bool {
        self.intent() != Intent::Read
    }

    /// What it wants of its lines.
    #[inline(always)]
    pub(crate) fn intent(self) -> Intent {
        match self {
            Kind::Access(intent) | Kind::Gather(intent) => intent,
            Kind::Atomic | Kind::AtomicGather => Intent::Write,
            _ => Intent::Read,
        }
    }
}

/// Uses of issue resources; two uops with one in common do not pair.
pub(super) const PIPE_U: u8 = 1;
pub(super) const LOAD_PORT: u8 = 2;
pub(super) const STORE_PORT: u8 = 4;
const BRANCH_UNIT: u8 = 8;

/// One row, in one word of the host.
///
/// ```text
/// bits  0..32  latency and cause, as a Span
///      32..40  0xff where the last byte of the uop is a distance, 0 where it counts lines
///      40..48  what it uses; bit 7 always
///      48..56  what a uop that pairs with it must not use
///      56..64  place in KINDS
/// ```
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row(u64);

/// What every uop uses: whoever excludes it pairs with none.
const ANYTHING: u8 = 128;

/// Loads have this place in [`KINDS`].
const LOAD: u64 = 2;
/// Stores have this place in [`KINDS`].
const STORE: u64 = 3;
/// Streaming stores have this place in [`KINDS`].
const STREAM_STORE: u64 = 4;
const _: () = assert!(
    matches!(KINDS[LOAD as usize], Kind::Access(Intent::Read))
        && matches!(KINDS[STORE as usize], Kind::Access(Intent::Write))
        && matches!(KINDS[STREAM_STORE as usize], Kind::Access(Intent::Stream))
);

const KINDS: [Kind; 12] = [
    Kind::Compute,
    Kind::Branch,
    Kind::Access(Intent::Read),
    Kind::Access(Intent::Write),
    Kind::Access(Intent::Stream),
    Kind::Gather(Intent::Read),
    Kind::Gather(Intent::Write),
    Kind::PrefetchL1,
    Kind::PrefetchL2,
    Kind::GatherPrefetch,
    Kind::Atomic,
    Kind::AtomicGather,
];

impl Row {
    /// The row of bytes that are no class.
    pub(super) const NONE: Row = Row::new(Span::new(1, Cause::Dependency), 0, PIPE_U, PIPE_U, 0);

    /// A latency is far below 2^28 cycles.
    const fn new(latency: Span, third_producer: u8, uses: u8, excludes: u8, kind: usize) -> Row {
        let bytes =
            (kind as u32) << 24 | (excludes as u32) << 16 | (uses as u32) << 8 | third_producer as u32;
        Row((bytes as u64) << 32 | latency.bits())
    }

    /// The latency of the result of a computation, or of an access to one line that hits the L1.
    #[inline(always)]
    pub(crate) fn latency(self) -> Span {
        Span::from_bits(self.0 & 0xffff_ffff)
    }

    /// What the last byte of a uop is taken with to give a distance.
    #[inline(always)]
    pub(crate) fn third_producer(self) -> u32 {
        (self.0 >> 32) as u32 & 0xff
    }

    /// Whether `second` may issue in the same cycle, behind this one.
    #[inline(always)]
    pub(crate) fn pairs_with(self, second: Row) -> bool {
        self.0 >> 8 & second.0 & 0xff << 40 == 0
    }

    #[inline(always)]
    pub(crate) fn kind(self) -> Kind {
        KINDS[(self.0 >> 56) as usize]
    }

    #[inline(always)]
    pub(crate) fn is_compute(self) -> bool {
        self.0 >> 56 == 0
    }

    #[inline(always)]
    pub(crate) fn is_branch(self) -> bool {
        self.0 >> 56 == 1
    }

    /// What a load or a store wants of its lines.
    #[inline(always)]
    pub(super) fn loads_or_stores(self) -> Option<Intent> {
        // Not by way of the table: the most frequent question of all.
        match self.0 >> 56 {
            LOAD => Some(Intent::Read),
            STORE => Some(Intent::Write),
            STREAM_STORE => Some(Intent::Stream),
            _ => None,
        }
    }
}

/// Rows by class byte; the table has a row for every byte, so that looking one up needs no check.
pub(crate) fn table(spec: &MachineSpec) -> Box<[Row; 256]> {
    let mut table = Box::new([Row::NONE; 256]);
    for class in Class::ALL {
        table[class as usize] = row(spec, class);
    }
    table
}

fn row(spec: &MachineSpec, class: Class) -> Row {
    use Intent::{Read, Stream, Write};
    use Kind::{
        Access, Atomic, AtomicGather, Branch, Compute, Gather, GatherPrefetch, PrefetchL1, PrefetchL2,
    };
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
        Class::AtomicGather => (hit, PIPE_U | LOAD_PORT | STORE_PORT, AtomicGather),
        Class::Scatter | Class::AtomicScatter => (1, PIPE_U | STORE_PORT, Gather(Write)),
        Class::PrefetchL1 => (1, LOAD_PORT, PrefetchL1),
        Class::PrefetchL2 => (1, LOAD_PORT, PrefetchL2),
        Class::GatherPrefetch => (1, PIPE_U | LOAD_PORT, GatherPrefetch),
        Class::Mask => (core.mask, 0, Compute),
        Class::ScalarAlu => (core.scalar_alu, 0, Compute),
        Class::ScalarMul => (core.scalar_mul, PIPE_U, Compute),
        Class::Atomic => (spec.atomic_cycles, PIPE_U | LOAD_PORT | STORE_PORT, Atomic),
        Class::Branch => (core.branch, BRANCH_UNIT, Branch),
        Class::SpillStore => (1, STORE_PORT, Access(Write)),
        Class::SpillLoad => (hit, LOAD_PORT, Access(Read)),
    };
    debug_assert!(latency < 1 << 28, "validated");
    let latency = Span::new(latency, if class.is_memory() { Cause::L1 } else { Cause::Dependency });
    let third_producer = if class.is_memory() { 0 } else { 0xff };
    // Behind a branch, and on a core of one pipe, nothing pairs.
    let alone = kind == Branch || !core.dual_issue;
    let excludes = if alone { uses | ANYTHING } else { uses };
    let place = KINDS.iter().position(|known| *known == kind).expect("every kind has its place");
    Row::new(latency, third_producer, uses | ANYTHING, excludes, place)
}
