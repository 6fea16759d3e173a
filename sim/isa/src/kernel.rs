//! Kernels, and the shells that give them host instructions.
//!
//! A kernel is written once, generic over [`Vpu`]. Each back end runs it inside a shell with the host's target features,
//! so that everything inlines; for that, a kernel and all it calls must be `#[inline(always)]`.

use core::ops::Range;

use crate::arena::Arena;
use crate::backend::Backend;
#[cfg(target_arch = "x86_64")]
use crate::emit::Either;
use crate::emit::{Count, OpCounts};
use crate::host::HostSimd;
#[cfg(target_arch = "x86_64")]
use crate::lanes::{Avx2, Avx512};
use crate::lanes::{Lanes, Portable};
use crate::record::{Buffers, Record, Recorded};
use crate::stream::Stream;
use crate::vpu::Vpu;

/// The code of a step: what each of its tasks does.
///
/// Everything a task reads comes out of the arena through `v`, and everything it computes is a value of `v`; fields of
/// the kernel are addresses and sizes, the immediates of its code.
pub trait Kernel: Send + Sync {
    /// Runs task `task`. Implementations are `#[inline(always)]`, see the module.
    fn run<V: Vpu>(&self, v: &mut V, task: V::S32);
}

/// A kernel behind a pointer: every back end of one [`Kernel`].
pub trait AnyKernel: Send + Sync {
    /// Runs `tasks` without timing and counts their operations. `shared` when other host threads run tasks meanwhile.
    fn run(&self, simd: HostSimd, arena: &Arena, tasks: Range<u32>, shared: bool, counts: &mut OpCounts);

    /// Runs one task and appends its uops to `stream`, spills included. `shared` as in [`AnyKernel::run`].
    fn record_shared(&self, simd: HostSimd, arena: &Arena, task: u32, shared: bool, stream: &mut Stream);

    /// Runs one task while no other host thread runs tasks, and appends its uops to `stream`, spills included.
    fn record(&self, simd: HostSimd, arena: &Arena, task: u32, stream: &mut Stream) {
        self.record_shared(simd, arena, task, false, stream);
    }
}

/// Runs `tasks` on the back end of lanes `L` and counts their operations; inlines into the shell of `L`.
#[inline(always)]
fn run_tasks<K: Kernel, L: Lanes>(
    kernel: &K,
    arena: &Arena,
    tasks: Range<u32>,
    shared: bool,
    counts: &mut OpCounts,
) {
    // Counted here, where no store to the arena can reach: host registers, added to once a straight run of the kernel.
    let mut own = OpCounts::default();
    for task in tasks {
        let mut v = Backend::<L, Count<'_>>::new(arena, Count(&mut own), task, shared);
        let task = v.s_imm(task as i32);
        kernel.run(&mut v, task);
    }
    counts.add(&own);
}

/// Records one task on the back end of lanes `L`; inlines into the shell of `L`.
#[inline(always)]
fn record_task<K: Kernel, L: Lanes>(
    kernel: &K,
    arena: &Arena,
    task: u32,
    shared: bool,
    buffers: &mut Buffers,
) -> Recorded {
    let mut v = Backend::<L, Record<'_>>::new(arena, Record::new(buffers), task, shared);
    let task = v.s_imm(task as i32);
    kernel.run(&mut v, task);
    v.emitted().recorded()
}

/// The code of a kernel on lanes that are arrays.
///
/// This is a trait, as [`Shells`] is, so that the compiler sorts the code of a kernel to that of its module, and not all code of all
/// kernels into one unit that one thread compiles.
#[cfg(target_arch = "x86_64")]
trait RunPortable {
    /// Runs one task. It is most of the code that a kernel is, so that there is one copy for counting and recording.
    fn run_portable(&self, v: &mut Backend<'_, Portable, Either<'_>>, task: u32);
}

#[cfg(target_arch = "x86_64")]
impl<K: Kernel> RunPortable for K {
    #[inline(never)]
    fn run_portable(&self, v: &mut Backend<'_, Portable, Either<'_>>, task: u32) {
        let task = v.s_imm(task as i32);
        self.run(v, task);
    }
}

/// As [`run_tasks`], on lanes that are arrays.
#[cfg(target_arch = "x86_64")]
fn run_tasks_portable<K: Kernel>(
    kernel: &K,
    arena: &Arena,
    tasks: Range<u32>,
    shared: bool,
    counts: &mut OpCounts,
) {
    for task in tasks {
        let mut v = Backend::new(arena, Either::Count(Count(&mut *counts)), task, shared);
        kernel.run_portable(&mut v, task);
    }
}

/// As [`record_task`], on lanes that are arrays.
#[cfg(target_arch = "x86_64")]
fn record_task_portable<K: Kernel>(
    kernel: &K,
    arena: &Arena,
    task: u32,
    shared: bool,
    buffers: &mut Buffers,
) -> Recorded {
    let mut v = Backend::new(arena, Either::Record(Record::new(buffers)), task, shared);
    kernel.run_portable(&mut v, task);
    match v.emitted() {
        Either::Record(record) => record.recorded(),
        Either::Count(_) => unreachable!("it records from the beginning"),
    }
}

/// A kernel inside functions with target features.
///
/// # Safety
/// The host must have the [`HostSimd`] of the name.
#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "functions with target features may only run on hosts that have them")]
trait Shells {
    unsafe fn run_avx512(&self, arena: &Arena, tasks: Range<u32>, shared: bool, out: &mut OpCounts);
    unsafe fn run_avx2(&self, arena: &Arena, tasks: Range<u32>, shared: bool, out: &mut OpCounts);
    unsafe fn record_avx512(&self, arena: &Arena, task: u32, shared: bool, buffers: &mut Buffers)
    -> Recorded;
    unsafe fn record_avx2(&self, arena: &Arena, task: u32, shared: bool, buffers: &mut Buffers) -> Recorded;
}

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "functions with target features may only run on hosts that have them")]
impl<K: Kernel> Shells for K {
    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512dq,avx512cd,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn run_avx512(&self, arena: &Arena, tasks: Range<u32>, shared: bool, out: &mut OpCounts) {
        run_tasks::<K, Avx512>(self, arena, tasks, shared, out);
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn run_avx2(&self, arena: &Arena, tasks: Range<u32>, shared: bool, out: &mut OpCounts) {
        run_tasks::<K, Avx2>(self, arena, tasks, shared, out);
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512dq,avx512cd,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn record_avx512(
        &self,
        arena: &Arena,
        task: u32,
        shared: bool,
        buffers: &mut Buffers,
    ) -> Recorded {
        record_task::<K, Avx512>(self, arena, task, shared, buffers)
    }

    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn record_avx2(&self, arena: &Arena, task: u32, shared: bool, buffers: &mut Buffers) -> Recorded {
        record_task::<K, Avx2>(self, arena, task, shared, buffers)
    }
}

/// # Safety
/// The host must have [`HostSimd::Avx512`].
#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "functions with target features may only run on hosts that have them")]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512dq,avx512cd,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn finish_avx512(buffers: &mut Buffers, recorded: Recorded, out: &mut Stream) {
    buffers.finish::<Avx512>(recorded, out);
}

/// # Safety
/// The host must have [`HostSimd::Avx2`].
#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "functions with target features may only run on hosts that have them")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn finish_avx2(buffers: &mut Buffers, recorded: Recorded, out: &mut Stream) {
    buffers.finish::<Avx2>(recorded, out);
}

impl<K: Kernel> AnyKernel for K {
    #[expect(unsafe_code, reason = "calls into functions with target features")]
    fn run(&self, simd: HostSimd, arena: &Arena, tasks: Range<u32>, shared: bool, counts: &mut OpCounts) {
        assert!(simd.is_available(), "this host has no {simd}");
        match simd {
            // SAFETY: the host has it, asserted above.
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx512 => unsafe { self.run_avx512(arena, tasks, shared, counts) },
            // SAFETY: the host has it, asserted above.
            #[cfg(target_arch = "x86_64")]
            HostSimd::Avx2 => unsafe { self.run_avx2(arena, tasks, shared, counts) },
            #[cfg(target_arch = "x86_64")]
            HostSimd::Portable => run_tasks_portable(self, arena, tasks, shared, counts),
            #[cfg(not(target_arch = "x86_64"))]
            _ => run_tasks::<K, Portable>(self, arena, tasks, shared, counts),
        }
    }

    #[expect(unsafe_code, reason = "calls into functions with target features")]
    fn record_shared(&self, simd: HostSimd, arena: &Arena, task: u32, shared: bool, stream: &mut Stream) {
        assert!(simd.is_available(), "this host has no {simd}");
        let recorded = Buffers::with(|buffers| {
            if !buffers.prepare() {
                return false;
            }
            match simd {
                // SAFETY: the host has it, asserted above.
                #[cfg(target_arch = "x86_64")]
                HostSimd::Avx512 => unsafe {
                    let recorded = self.record_avx512(arena, task, shared, buffers);
                    finish_avx512(buffers, recorded, stream);
                },
                // SAFETY: the host has it, asserted above.
                #[cfg(target_arch = "x86_64")]
                HostSimd::Avx2 => unsafe {
                    let recorded = self.record_avx2(arena, task, shared, buffers);
                    finish_avx2(buffers, recorded, stream);
                },
                _ => {
                    #[cfg(target_arch = "x86_64")]
                    let recorded = record_task_portable(self, arena, task, shared, buffers);
                    #[cfg(not(target_arch = "x86_64"))]
                    let recorded = record_task::<K, Portable>(self, arena, task, shared, buffers);
                    buffers.finish::<Portable>(recorded, stream);
                }
            }
            true
        });
        if !recorded {
            // No stream; but later tasks rely on what this one does to the arena.
            stream.cut_short = true;
            AnyKernel::run(self, simd, arena, task..task + 1, shared, &mut OpCounts::default());
        }
    }
}
