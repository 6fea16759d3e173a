//! Hand-written and synthetic streams, for tests.

use lrbsim_isa::program::TaskSource;
use lrbsim_isa::stream::{Stream, StreamLine};
use lrbsim_isa::uop::{Class, Uop};
use lrbsim_isa::{Line, OpCounts};
use std::ops::Range;

/// A stream under construction.
#[derive(Debug, Clone, Default)]
pub(crate) struct Builder {
    stream: Stream,
}

impl Builder {
    /// A uop that touches no memory.
    pub(crate) fn alu(mut self, class: Class, producers: [u8; 3]) -> Builder {
        let [a, b, c] = producers;
        self.stream.uops.push(Uop::alu(class, a, b, c).0);
        self
    }

    /// A uop that touches `lines` of the arena.
    pub(crate) fn memory(mut self, class: Class, producer: u8, lines: &[u32]) -> Builder {
        self.stream.uops.push(Uop::memory(class, producer, 0, lines.len() as u8).0);
        self.stream.lines.extend(lines.iter().map(|line| StreamLine::arena(Line(*line))));
        self
    }

    /// A uop that touches slot `slot` of the stack of the thread that runs it.
    pub(crate) fn on_stack(mut self, class: Class, producer: u8, slot: u32) -> Builder {
        self.stream.uops.push(Uop::memory(class, producer, 0, 1).0);
        self.stream.lines.push(StreamLine::stack(slot));
        self
    }

    /// `count` times the same.
    pub(crate) fn repeat(mut self, count: usize, mut one: impl FnMut(Builder, usize) -> Builder) -> Builder {
        for i in 0..count {
            self = one(self, i);
        }
        self
    }

    pub(crate) fn build(self) -> Stream {
        self.stream
    }
}

/// Tasks whose streams are made by a function of their number.
pub(crate) struct Tasks<F> {
    pub(crate) count: u32,
    pub(crate) make: F,
}

impl<F: Fn(u32) -> Stream + Sync> TaskSource for Tasks<F> {
    fn name(&self) -> &str {
        "synthetic"
    }

    fn tasks(&self) -> u32 {
        self.count
    }

    fn is_ordered(&self) -> bool {
        false
    }

    fn record(&self, task: u32, stream: &mut Stream) {
        *stream = (self.make)(task);
    }

    fn skip(&self, tasks: Range<u32>, counts: &mut OpCounts) {
        for task in tasks {
            let stream = (self.make)(task);
            counts.class_counts.iter_mut().zip(stream.count_classes()).for_each(|(sum, count)| *sum += count);
        }
    }
}

/// Tasks that each have the same stream.
pub(crate) fn same(count: u32, stream: Stream) -> Tasks<impl Fn(u32) -> Stream> {
    Tasks { count, make: move |_| stream.clone() }
}

/// A small generator of numbers: xorshift.
#[derive(Debug, Clone)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: u32) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (((self.0 >> 32) * u64::from(end)) >> 32) as u32
    }
}

/// Kinds of synthetic step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mix {
    /// Multiply-adds on vectors from a small working set.
    AluHeavy,
    /// Reads two arrays and writes a third, with prefetch.
    Streaming,
    /// Gathers from a table larger than the L2.
    RandomGather,
    /// Gathers from a table that fits in the L2, and scatters.
    NearGather,
    /// Histogram by locked operations on shared lines.
    Atomics,
    /// All of these, as in a soft-shadow kernel.
    Kernel,
}

impl Mix {
    pub(crate) const ALL: [Mix; 6] =
        [Mix::AluHeavy, Mix::Streaming, Mix::RandomGather, Mix::NearGather, Mix::Atomics, Mix::Kernel];

    /// The stream of task `task`, of about `uops` uops.
    pub(crate) fn stream(self, task: u32, uops: usize) -> Stream {
        let mut random = Random::new(u64::from(task) + 1);
        let mut b = Builder::default();
        let mut i = 0;
        while b.stream.uops.len() < uops {
            b = self.turn(b, task, i, &mut random);
            i += 1;
        }
        b.build()
    }

    /// One turn of the task's loop.
    fn turn(self, b: Builder, task: u32, i: u32, random: &mut Random) -> Builder {
        let b = match self {
            Mix::AluHeavy => b
                .memory(Class::VectorBroadcastLoad, 0, &[64 + random.below(256)])
                .repeat(8, |b, _| b.alu(Class::VectorFma, [2, 1, 0]))
                .alu(Class::VectorCompare, [1, 0, 0])
                .alu(Class::Mask, [1, 0, 0]),
            Mix::Streaming => {
                let at = 10_000 + task * 4096 + i;
                b.memory(Class::PrefetchL1, 0, &[at + 8])
                    .memory(Class::VectorLoad, 0, &[at])
                    .memory(Class::VectorLoad, 0, &[at + 2_000_000])
                    .alu(Class::VectorFma, [1, 2, 0])
                    .alu(Class::VectorAlu, [1, 0, 0])
                    .memory(Class::VectorStreamStore, 1, &[at + 4_000_000])
            }
            Mix::RandomGather | Mix::NearGather => {
                let near = self == Mix::NearGather;
                let (base, size) =
                    if near { (100_000 + task % 24 * 2_000, 2_000) } else { (1_000_000, 60_000) };
                let mut lines: Vec<u32> =
                    (0..1 + random.below(8)).map(|_| base + random.below(size)).collect();
                lines.sort_unstable();
                lines.dedup();
                let b = b
                    .memory(Class::VectorLoad, 0, &[500_000 + task * 64 + i / 16])
                    .alu(Class::VectorAlu, [1, 0, 0])
                    .memory(Class::Gather, 1, &lines)
                    .repeat(6, |b, _| b.alu(Class::VectorMul, [1, 2, 0]));
                if near { b.memory(Class::Scatter, 1, &lines) } else { b }
            }
            Mix::Atomics => b
                .memory(Class::ScalarLoad, 0, &[700_000 + task * 8 + i / 64])
                .repeat(12, |b, _| b.alu(Class::VectorAlu, [2, 0, 0]))
                .repeat(20, |b, _| b.alu(Class::ScalarAlu, [1, 0, 0]))
                .memory(Class::Atomic, 1, &[800_000 + random.below(300)]),
            Mix::Kernel => {
                let at = 2_000_000 + task * 300 + i / 4;
                b.memory(Class::VectorLoad, 0, &[at])
                    .repeat(12, |b, k| {
                        b.memory(Class::VectorBroadcastLoad, 0, &[3_000_000 + random.below(400)])
                            .alu(Class::VectorFma, [1, 3, 0])
                            .alu(Class::VectorFma, [1, 2, 4])
                            .alu(if k % 3 == 0 { Class::VectorCompare } else { Class::VectorAlu }, [1, 0, 0])
                    })
                    .alu(Class::Mask, [1, 0, 0])
                    .alu(Class::VectorMath, [2, 0, 0])
                    .memory(
                        Class::Gather,
                        1,
                        &[3_100_000 + random.below(30_000), 3_200_000 + random.below(300)],
                    )
                    .alu(Class::VectorFma, [1, 2, 3])
                    .memory(Class::VectorStore, 1, &[at + 1_000_000])
            }
        };
        b.alu(Class::ScalarAlu, [0, 0, 0]).alu(Class::Branch, [1, 0, 0])
    }
}
