//! One simulated instruction in four bytes.
//!
//! ```text
//! ALU classes      byte 0 class │ 1 producer │ 2 producer │ 3 producer
//! memory classes   byte 0 class │ 1 producer │ 2 producer │ 3 number of distinct lines (0..=16)
//! ```
//!
//! A producer is a distance back in the stream of the same task: 1 is the uop just before; 0 stands for no producer and
//! for one more than 254 uops back, whose result has long arrived. Where an operation has more producers than bytes the
//! encoder keeps the youngest, which are the last to arrive.

/// Greatest distance to a producer that a uop can name.
pub const DISTANCE_MAX: u32 = 254;

/// Greatest number of distinct lines that one uop can touch: one a lane.
pub const LINES_MAX: usize = 16;

/// What a uop does, as far as timing is concerned.
///
/// The order is that of the operation table of design.md 3.2; `as u8` is the class byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Class {
    /// Vector add, subtract, min, max, logic, shift, blend: one pass through the vector pipe.
    VectorAlu = 0,
    /// Vector compare to mask.
    VectorCompare,
    /// Vector multiply, float or integer.
    VectorMul,
    /// Vector fused multiply-add.
    VectorFma,
    /// Reciprocal and reciprocal square root: the extended math unit.
    VectorMath,
    /// Convert and round.
    VectorConvert,
    /// Swizzle, permute, register broadcast.
    VectorShuffle,
    /// Vector load of 64 consecutive bytes: one line, two when unaligned.
    VectorLoad,
    /// Load of one element, broadcast to all lanes.
    VectorBroadcastLoad,
    /// Vector store of up to 64 consecutive bytes: one line, two when unaligned.
    VectorStore,
    /// Vector store that writes whole lines without reading them first.
    VectorStreamStore,
    /// Packed load: consecutive elements into the enabled lanes.
    VectorExpand,
    /// Packed store: the enabled lanes to consecutive elements.
    VectorCompress,
    /// Gather, one request a distinct line.
    Gather,
    /// Scatter, one request a distinct line.
    Scatter,
    /// The loads of one round of a vector atomic: gather that takes ownership of its lines.
    AtomicGather,
    /// The stores of one round of a vector atomic: scatter to lines that are owned.
    AtomicScatter,
    /// Prefetch of one line into L1 and L2.
    PrefetchL1,
    /// Prefetch of one line into L2.
    PrefetchL2,
    /// Gathered prefetch into L1, one request a distinct line.
    GatherPrefetch,
    /// Mask logic, mask moves to and from scalar registers, mask test.
    Mask,
    /// Scalar add, subtract, logic, shift, compare, move, bit count.
    ScalarAlu,
    /// Scalar multiply.
    ScalarMul,
    /// Scalar load of 4 bytes.
    ScalarLoad,
    /// Scalar store of 4 bytes.
    ScalarStore,
    /// Locked scalar read-modify-write of 4 bytes.
    Atomic,
    /// Conditional or unconditional branch.
    Branch,
    /// Store of a spilled vector register to the thread's stack.
    SpillStore,
    /// Reload of a spilled vector register from the thread's stack.
    SpillLoad,
}

impl Class {
    /// Number of classes of uops.
    pub const COUNT: usize = 29;

    /// All classes of uops, in the order of their class byte.
    pub const ALL: [Class; Class::COUNT] = [
        Class::VectorAlu,
        Class::VectorCompare,
        Class::VectorMul,
        Class::VectorFma,
        Class::VectorMath,
        Class::VectorConvert,
        Class::VectorShuffle,
        Class::VectorLoad,
        Class::VectorBroadcastLoad,
        Class::VectorStore,
        Class::VectorStreamStore,
        Class::VectorExpand,
        Class::VectorCompress,
        Class::Gather,
        Class::Scatter,
        Class::AtomicGather,
        Class::AtomicScatter,
        Class::PrefetchL1,
        Class::PrefetchL2,
        Class::GatherPrefetch,
        Class::Mask,
        Class::ScalarAlu,
        Class::ScalarMul,
        Class::ScalarLoad,
        Class::ScalarStore,
        Class::Atomic,
        Class::Branch,
        Class::SpillStore,
        Class::SpillLoad,
    ];

    /// Whether the last byte of a uop of this class counts lines, which follow in the side stream.
    #[inline]
    pub const fn is_memory(self) -> bool {
        (self as u8 >= Class::VectorLoad as u8 && self as u8 <= Class::GatherPrefetch as u8)
            || matches!(
                self,
                Class::ScalarLoad | Class::ScalarStore | Class::Atomic | Class::SpillStore | Class::SpillLoad
            )
    }

    /// Whether uops of this class use vector lanes.
    #[inline]
    pub const fn is_vector(self) -> bool {
        !self.is_scalar()
    }

    /// Whether uops of this class are scalar, mask, branch or single-line cache-control instructions.
    #[inline]
    pub const fn is_scalar(self) -> bool {
        matches!(
            self,
            Class::PrefetchL1
                | Class::PrefetchL2
                | Class::Mask
                | Class::ScalarAlu
                | Class::ScalarMul
                | Class::ScalarLoad
                | Class::ScalarStore
                | Class::Atomic
                | Class::Branch
        )
    }

    /// Whether uops of this class make a vector register, of which a hardware thread has 32.
    #[inline]
    pub const fn defines_vector(self) -> bool {
        matches!(
            self,
            Class::VectorAlu
                | Class::VectorMul
                | Class::VectorFma
                | Class::VectorMath
                | Class::VectorConvert
                | Class::VectorShuffle
                | Class::VectorLoad
                | Class::VectorBroadcastLoad
                | Class::VectorExpand
                | Class::Gather
                | Class::AtomicGather
        )
    }

    /// The class whose byte is `byte`.
    ///
    /// # Panics
    /// When no class has that byte: the stream was not written by an encoder.
    #[inline]
    pub const fn from_byte(byte: u8) -> Class {
        Class::ALL[byte as usize]
    }

    /// Name of the class, as it stands in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Class::VectorAlu => "vector_alu",
            Class::VectorCompare => "vector_compare",
            Class::VectorMul => "vector_mul",
            Class::VectorFma => "vector_fma",
            Class::VectorMath => "vector_math",
            Class::VectorConvert => "vector_convert",
            Class::VectorShuffle => "vector_shuffle",
            Class::VectorLoad => "vector_load",
            Class::VectorBroadcastLoad => "vector_broadcast_load",
            Class::VectorStore => "vector_store",
            Class::VectorStreamStore => "vector_stream_store",
            Class::VectorExpand => "vector_expand",
            Class::VectorCompress => "vector_compress",
            Class::Gather => "gather",
            Class::Scatter => "scatter",
            Class::AtomicGather => "atomic_gather",
            Class::AtomicScatter => "atomic_scatter",
            Class::PrefetchL1 => "prefetch_l1",
            Class::PrefetchL2 => "prefetch_l2",
            Class::GatherPrefetch => "gather_prefetch",
            Class::Mask => "mask",
            Class::ScalarAlu => "scalar_alu",
            Class::ScalarMul => "scalar_mul",
            Class::ScalarLoad => "scalar_load",
            Class::ScalarStore => "scalar_store",
            Class::Atomic => "atomic",
            Class::Branch => "branch",
            Class::SpillStore => "spill_store",
            Class::SpillLoad => "spill_load",
        }
    }
}

/// One simulated instruction: class and producers, see the module's picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(transparent)]
pub struct Uop(pub u32);

impl Uop {
    /// A uop of an ALU class with up to three producers (distances, 0 for none).
    #[inline(always)]
    pub const fn alu(class: Class, a: u8, b: u8, c: u8) -> Uop {
        Uop(class as u32 | (a as u32) << 8 | (b as u32) << 16 | (c as u32) << 24)
    }

    /// A uop of a memory class with up to two producers and `lines` entries in the side stream.
    #[inline(always)]
    pub const fn memory(class: Class, a: u8, b: u8, lines: u8) -> Uop {
        Uop::alu(class, a, b, lines)
    }

    /// The class of the uop: what it does.
    #[inline(always)]
    pub const fn class(self) -> Class {
        Class::from_byte(self.0 as u8)
    }

    /// Distances from the uop to its producers; the third is 0 for a memory class.
    #[inline(always)]
    pub const fn producers(self) -> [u8; 3] {
        let third = if self.class().is_memory() { 0 } else { (self.0 >> 24) as u8 };
        [(self.0 >> 8) as u8, (self.0 >> 16) as u8, third]
    }

    /// Number of entries in the side stream that belong to this uop.
    #[inline(always)]
    pub const fn lines(self) -> usize {
        if self.class().is_memory() { (self.0 >> 24) as usize } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_class_survives_its_byte() {
        for (byte, class) in Class::ALL.into_iter().enumerate() {
            assert_eq!(class as usize, byte);
            assert_eq!(Class::from_byte(byte as u8), class);
        }
    }

    #[test]
    fn a_uop_gives_back_what_was_put_in() {
        let uop = Uop::alu(Class::VectorFma, 1, 2, 254);
        assert_eq!((uop.class(), uop.producers(), uop.lines()), (Class::VectorFma, [1, 2, 254], 0));
        let uop = Uop::memory(Class::Gather, 3, 0, 16);
        assert_eq!((uop.class(), uop.producers(), uop.lines()), (Class::Gather, [3, 0, 0], 16));
    }
}
