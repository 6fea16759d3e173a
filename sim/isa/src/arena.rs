//! Simulated memory: one flat, bump-allocated range of bytes in lines of 64.
//!
//! Tasks reach it only through a [`Vpu`](crate::vpu::Vpu); between steps the host may read totals, fill inputs and
//! allocate. The range is reserved once and committed by the operating system page by page as it is touched, so memory
//! follows what the scene touches and no array ever moves.
//!
//! No array holds anything before somebody writes it: clearing is work of the machine. Debug builds fill arrays with
//! [`POISON`], so that tests find a kernel that reads what nobody wrote.

use core::fmt;
use core::marker::PhantomData;
use std::sync::atomic::AtomicI32;

use crate::claims::Claims;

/// Bytes in a line of caches and memory.
pub const LINE_BYTES: u64 = 64;

/// Line that holds the task counter of the running step.
pub const TASK_COUNTER_LINE: Line = Line(0);

/// Line that holds the arrival counter of the barrier.
pub const BARRIER_LINE: Line = Line(1);

/// Line that holds the constant pool: constants are few and stay in L1.
pub const CONSTANT_LINE: Line = Line(2);

/// Lines that belong to the runtime; [`Arena::overwritten`] gives out those behind.
pub const RUNTIME_LINES: u32 = 64;

/// First byte that [`Arena::overwritten`] gives out.
const FIRST_FREE_BYTE: u64 = RUNTIME_LINES as u64 * LINE_BYTES;

/// First of the line numbers that stand for stacks. Stacks hold spilled registers, values on their way between lanes
/// and scalars, and what kernels put there, so they have numbers (for caches to hold) but no bytes here. Those of a hardware thread begin
/// `hardware thread * STACK_LINES` behind; see [`StreamLine`](crate::stream::StreamLine).
pub const STACK_BASE_LINE: u32 = 0xf000_0000;

/// Lines of one hardware thread's stack that hold transfers and spills; what kernels put there lies behind them.
pub const STACK_OWN_LINES: u32 = 64;

/// Vectors that a kernel can put on its hardware thread's stack.
pub const STACK_SLOTS: u32 = 256;

/// Lines of one hardware thread's stack.
pub const STACK_LINES: u32 = STACK_OWN_LINES + STACK_SLOTS;

/// What debug builds fill arrays with: a signalling NaN, which no operation returns, and a number far outside of any array.
pub const POISON: u32 = 0x7fad_dead;

/// Bytes reserved (not committed) for an arena where the host gives them.
const RESERVED_BYTES: usize = 64 << 30;

/// No host has larger pages, but for those that it splits.
const PAGE_BYTES_MAX: u64 = 64 << 10;

/// Bytes of address space below which an arena is refused: less is no use.
const RESERVED_BYTES_MIN: usize = 64 << 20;

/// Why an arena cannot hold what it is asked to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArenaError {
    /// The host refuses even the least address space.
    Refused,
    /// An allocation did not fit into the address space that the host gave.
    Full {
        /// Bytes that would be in use had the allocation fit.
        wanted_bytes: u64,
        /// Bytes of address space that the host gave.
        reserved_bytes: u64,
    },
}

impl fmt::Display for ArenaError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ArenaError::Refused => {
                let mib = RESERVED_BYTES_MIN >> 20;
                write!(f, "the host refuses {mib} MiB of address space for the simulated memory")
            }
            ArenaError::Full { wanted_bytes, reserved_bytes } => {
                let (wanted, reserved) = (wanted_bytes.div_ceil(1 << 20), reserved_bytes >> 20);
                write!(
                    f,
                    "the arrays of this frame need {wanted} MiB or more of simulated memory; \
                     the host gives address space for {reserved} MiB"
                )
            }
        }
    }
}

impl std::error::Error for ArenaError {}

/// An address of the simulated memory: a byte offset in the arena.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Addr(pub u64);

impl Addr {
    /// The address `bytes` further on: the constant displacement of an operand, which costs nothing.
    #[inline(always)]
    #[must_use]
    pub const fn plus(self, bytes: u64) -> Addr {
        Addr(self.0 + bytes)
    }

    /// The address `words` words of 4 bytes further on, as [`Addr::plus`].
    #[inline(always)]
    #[must_use]
    pub const fn plus_words(self, words: u64) -> Addr {
        self.plus(4 * words)
    }

    /// The address `lines` lines further on, as [`Addr::plus`].
    #[inline(always)]
    #[must_use]
    pub const fn plus_lines(self, lines: u64) -> Addr {
        self.plus(LINE_BYTES * lines)
    }

    /// The line that the address lies in.
    #[inline(always)]
    pub const fn line(self) -> Line {
        Line((self.0 / LINE_BYTES) as u32)
    }
}

/// A line number: arena offset / 64.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Line(pub u32);

/// Simulated memory.
///
/// It may move between host threads, but one at a time has it: only [`StepSource`](crate::program::StepSource) shares it,
/// for as long as tasks run that vouch for one another. So a kernel, which many threads share, cannot hold one: what it
/// reads comes through its `Vpu`, and work that nobody times cannot hide in it.
#[derive(Debug)]
pub struct Arena {
    /// Keeps the pages alive; bytes are reached through `base`.
    map: memmap2::MmapMut,
    base: *mut u8,
    reserved_bytes: u64,
    used_bytes: u64,
    /// The first allocation that did not fit.
    full: Option<ArenaError>,
    /// What new arrays are filled with; `None`: what the host's pages hold.
    poison: Option<u32>,
    /// Words written by the tasks of the step that runs.
    claims: Claims,
}

// SAFETY: the bytes are plain data behind a raw pointer that lives as long as the map, and nothing is tied to a thread.
#[expect(unsafe_code, reason = "simulated memory may move between host threads")]
unsafe impl Send for Arena {}

/// Address space, all zero and committed as touched; `None` where the host refuses.
pub(crate) fn map_bytes(bytes: usize) -> Option<memmap2::MmapMut> {
    memmap2::MmapOptions::new().len(bytes).no_reserve_swap().map_anon().ok()
}

impl Default for Arena {
    fn default() -> Self {
        Arena::new()
    }
}

impl Arena {
    /// An empty arena. Reserves address space, commits nothing.
    ///
    /// # Panics
    /// Where [`Arena::reserve`] fails.
    pub fn new() -> Arena {
        match Arena::reserve() {
            Ok(arena) => arena,
            Err(error) => panic!("{error}"),
        }
    }

    /// An empty arena. Reserves address space, commits nothing.
    ///
    /// A host with a limit gives less, down to 64 MiB; a fifth of what it has is left to the rest of the program.
    ///
    /// # Errors
    /// [`ArenaError::Refused`].
    pub fn reserve() -> Result<Arena, ArenaError> {
        let mut bytes = RESERVED_BYTES;
        let mut map = loop {
            let map = map_bytes(bytes);
            let rest = map_bytes(bytes / 4);
            match (map, rest) {
                (Some(map), Some(_)) => break map,
                _ if bytes > RESERVED_BYTES_MIN => bytes /= 2,
                _ => return Err(ArenaError::Refused),
            }
        };
        // Arrays are long and gathers go everywhere in them: fewer page faults, fewer misses of the host's TLB. A host that
        // has no large pages goes on without.
        #[cfg(target_os = "linux")]
        let _ = map.advise(memmap2::Advice::HugePage);
        let base = map.as_mut_ptr();
        Ok(Arena {
            map,
            base,
            reserved_bytes: bytes as u64,
            used_bytes: FIRST_FREE_BYTE,
            full: None,
            poison: cfg!(debug_assertions).then_some(POISON),
            claims: Claims::default(),
        })
    }

    /// From now on new arrays are filled with `word`, in every build: a program must do the same whatever it is.
    pub fn poison_with(&mut self, word: u32) {
        self.poison = Some(word);
    }

    /// Whether all that was allocated fits. To be asked before a task runs: an array that does not fit has no bytes, the
    /// host writes none and reads 0, and no task may touch it.
    ///
    /// # Errors
    /// [`ArenaError::Full`], for the first allocation that did not fit.
    pub fn check(&self) -> Result<(), ArenaError> {
        self.full.map_or(Ok(()), Err)
    }

    /// Allocates `bytes` bytes on a line boundary, at least one line, of which nobody asks what they hold. Whether they fit is
    /// said by [`Arena::check`].
    pub fn alloc_bytes(&mut self, bytes: u64) -> Addr {
        let start = self.used_bytes;
        let end =
            bytes.max(1).checked_next_multiple_of(LINE_BYTES).and_then(|bytes| start.checked_add(bytes));
        match end.filter(|end| self.full.is_none() && *end <= self.reserved_bytes) {
            Some(end) => self.used_bytes = end,
            None => {
                let wanted_bytes = start.saturating_add(bytes);
                self.full
                    .get_or_insert(ArenaError::Full { wanted_bytes, reserved_bytes: self.reserved_bytes });
            }
        }
        Addr(start)
    }

    /// Allocates an array of `count` 4-byte words that somebody writes before anybody reads them, on a line boundary, rounded
    /// up to whole lines. Debug builds fill it with [`POISON`]. Whether it fits is said by [`Arena::check`].
    pub fn overwritten(&mut self, count: u64) -> Addr {
        let addr = self.alloc_bytes(count.saturating_mul(4));
        if let (Some(poison), None) = (self.poison, self.full) {
            let words = (self.used_bytes - addr.0) / 4;
            (0..words).for_each(|i| self.write_u32(addr.plus_words(i), poison));
        }
        addr
    }

    /// Allocates an array of 4-byte integers and fills it with `values`.
    pub fn alloc_u32(&mut self, values: &[u32]) -> Addr {
        let addr = self.overwritten(values.len() as u64);
        self.write_u32s(addr, values);
        addr
    }

    /// Allocates an array of floats and fills it with `values`.
    pub fn alloc_f32(&mut self, values: &[f32]) -> Addr {
        let addr = self.overwritten(values.len() as u64);
        for (i, value) in values.iter().enumerate() {
            self.write_u32(addr.plus(4 * i as u64), value.to_bits());
        }
        addr
    }

    /// Gives back all arrays from byte `first` on, which [`Arena::used_bytes`] was before the first of them: those to come lie
    /// where they lay.
    pub fn give_back(&mut self, first: u64) {
        assert!((FIRST_FREE_BYTE..=self.used_bytes).contains(&first), "byte {first} was not given out");
        self.used_bytes = first;
    }

    /// Says that nobody reads the `count` words at `addr` again before somebody writes them: the host may have their pages back. Debug
    /// builds fill them with [`POISON`].
    pub fn discard(&mut self, addr: Addr, count: u64) {
        if self.full.is_some() {
            return;
        }
        if let Some(poison) = self.poison {
            (0..count).for_each(|i| self.write_u32(addr.plus_words(i), poison));
            return;
        }
        // Whole pages of any size that hosts have.
        let first = addr.0.next_multiple_of(PAGE_BYTES_MAX);
        let end = (addr.0 + 4 * count) / PAGE_BYTES_MAX * PAGE_BYTES_MAX;
        assert!(addr.0 + 4 * count <= self.used_bytes, "words behind what was given out");
        if first < end {
            self.give_pages_back(first as usize, (end - first) as usize);
        }
    }

    #[cfg(target_os = "linux")]
    #[expect(unsafe_code, reason = "pages whose bytes change to zero are given back to the host")]
    fn give_pages_back(&mut self, offset: usize, bytes: usize) {
        // SAFETY: the map is private and anonymous, and no reference to its bytes lives between steps. A host that refuses keeps them.
        let _ = unsafe { self.map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, offset, bytes) };
    }

    #[cfg(not(target_os = "linux"))]
    fn give_pages_back(&mut self, _offset: usize, _bytes: usize) {}

    /// Bytes that [`Arena::overwritten`] has given out so far, those of the runtime included.
    #[inline(always)]
    pub fn used_bytes(&self) -> u64 {
        self.used_bytes
    }

    /// The bytes as the host sees them between steps.
    fn memory(&self) -> Memory<'_> {
        self.memory_of_task(0)
    }

    /// The bytes as task `task` of the step that runs sees them.
    #[inline(always)]
    pub(crate) fn memory_of_task(&self, task: u32) -> Memory<'_> {
        Memory {
            base: self.base,
            used_bytes: self.used_bytes,
            claims: &self.claims,
            task,
            arena: PhantomData,
        }
    }

    /// From now on tasks of an independent step run, until [`Arena::independent_tasks_end`]: debug builds stop those that
    /// write to one word.
    pub(crate) fn independent_tasks_begin(&mut self) {
        self.claims = Claims::new(self.used_bytes);
    }

    /// The tasks of the independent step have run.
    pub(crate) fn independent_tasks_end(&mut self) {
        self.claims = Claims::default();
    }

    /// Reads one word from the host, between steps.
    pub fn read_u32(&self, addr: Addr) -> u32 {
        if self.full.is_some() {
            return 0;
        }
        u32::from_le_bytes(self.memory().get(addr))
    }

    /// Reads one float from the host, between steps.
    pub fn read_f32(&self, addr: Addr) -> f32 {
        f32::from_bits(self.read_u32(addr))
    }

    /// Reads `count` words from the host, between steps.
    pub fn read_u32s(&self, addr: Addr, count: usize) -> Vec<u32> {
        (0..count as u64).map(|i| self.read_u32(addr.plus(4 * i))).collect()
    }

    /// Reads `count` floats from the host, between steps.
    pub fn read_f32s(&self, addr: Addr, count: usize) -> Vec<f32> {
        (0..count as u64).map(|i| self.read_f32(addr.plus(4 * i))).collect()
    }

    /// Writes one word from the host, between steps.
    pub fn write_u32(&mut self, addr: Addr, value: u32) {
        if self.full.is_some() {
            return;
        }
        self.memory().put(addr, value.to_le_bytes());
    }

    /// Writes words from the host, between steps.
    pub fn write_u32s(&mut self, addr: Addr, values: &[u32]) {
        for (i, value) in values.iter().enumerate() {
            self.write_u32(addr.plus(4 * i as u64), *value);
        }
    }
}

/// The bytes of an arena as a task sees them: by value, since they neither move nor change in number while it runs, so
/// that base and bound can stay in host registers.
#[derive(Clone, Copy)]
pub(crate) struct Memory<'a> {
    base: *mut u8,
    used_bytes: u64,
    claims: &'a Claims,
    /// The task whose writes are claimed.
    task: u32,
    arena: PhantomData<&'a Arena>,
}

impl<'a> Memory<'a> {
    /// Host pointer to `bytes` bytes at `addr`.
    ///
    /// # Panics
    /// When they do not lie inside what was allocated: a kernel computed a wrong address.
    #[inline(always)]
    pub(crate) fn pointer(&self, addr: u64, bytes: u64) -> *mut u8 {
        // One comparison: the lines of the runtime alone are more than any access.
        debug_assert!(bytes <= FIRST_FREE_BYTE);
        if addr > self.used_bytes - bytes {
            out_of_range(addr, bytes, self.used_bytes);
        }
        self.base.wrapping_add(addr as usize)
    }

    /// Host pointer to byte 0, for accesses whose active lanes were checked against [`Memory::used_bytes`].
    #[inline(always)]
    pub(crate) fn base(&self) -> *mut u8 {
        self.base
    }

    /// Bytes that tasks may touch.
    #[inline(always)]
    pub(crate) fn used_bytes(&self) -> u64 {
        self.used_bytes
    }

    /// Debug builds stop the task where another of an independent step has written the word at `addr`.
    #[inline(always)]
    pub(crate) fn claim(&self, addr: u64) {
        self.claims.write(self.task, addr);
    }

    /// Debug builds stop the task where one of an independent step has written the word at `addr`, to which this adds.
    #[inline(always)]
    pub(crate) fn claim_addition(&self, addr: u64) {
        self.claims.add(addr);
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the one place where the host reads simulated memory")]
    pub(crate) fn get<const N: usize>(&self, addr: Addr) -> [u8; N] {
        let from = self.pointer(addr.0, N as u64);
        // SAFETY: `pointer` checked the range; the contract of independent steps excludes a concurrent writer.
        unsafe { from.cast::<[u8; N]>().read_unaligned() }
    }

    #[inline(always)]
    #[expect(unsafe_code, reason = "the one place where simulated memory is written")]
    pub(crate) fn put<const N: usize>(&self, addr: Addr, value: [u8; N]) {
        let to = self.pointer(addr.0, N as u64);
        // SAFETY: `pointer` checked the range; the contract of independent steps excludes concurrent access.
        unsafe { to.cast::<[u8; N]>().write_unaligned(value) }
    }

    /// The word at `addr` as a host atomic, for adds from several host threads.
    #[inline(always)]
    #[expect(unsafe_code, reason = "adds of independent tasks meet in the same word")]
    pub(crate) fn atomic(&self, addr: Addr) -> &'a AtomicI32 {
        assert!(addr.0.is_multiple_of(4), "atomic at {:#x}, which is not a multiple of 4", addr.0);
        let word = self.pointer(addr.0, 4).cast::<i32>();
        // SAFETY: in range (checked), aligned (checked; the map is page-aligned), alive as long as the arena.
        unsafe { AtomicI32::from_ptr(word) }
    }
}

/// Stops a task whose kernel computed a wrong address. Takes all by value: what a call sees in place would live in host
/// memory.
#[cold]
#[inline(never)]
pub(crate) fn out_of_range(addr: u64, bytes: u64, used_bytes: u64) -> ! {
    panic!("access to {bytes} bytes at {addr:#x}, past the {used_bytes:#x} bytes of the arena")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn allocations_start_on_lines_and_do_not_overlap() {
        let mut arena = Arena::new();
        let a = arena.overwritten(1);
        let b = arena.overwritten(17);
        let c = arena.overwritten(1);
        assert_eq!((a.0 % 64, b.0 - a.0, c.0 - b.0), (0, 64, 128));
    }

    #[test]
    fn an_array_holds_poison_before_it_is_written() {
        let mut arena = Arena::new();
        let of_build = arena.overwritten(17);
        arena.poison_with(5);
        let of_test = arena.overwritten(1);
        // Whole lines, so that nothing hides behind the end.
        let expected = if cfg!(debug_assertions) { POISON } else { 0 };
        assert_eq!(arena.read_u32s(of_build, 32), [expected; 32]);
        assert_eq!(arena.read_u32s(of_test, 16), [5; 16]);
        assert!(f32::from_bits(POISON).is_nan());
    }

    #[test]
    fn what_is_discarded_takes_nothing_else_with_it() {
        for poison in [Some(POISON), None] {
            let mut arena = Arena { poison, ..Arena::new() };
            let values: Vec<u32> = (0..100_001).collect();
            let [before, gone, behind] = [0; 3].map(|_| arena.alloc_u32(&values));
            arena.discard(gone, values.len() as u64);
            for kept in [before, behind] {
                assert!(arena.read_u32s(kept, values.len()) == values, "{poison:?}");
            }
            if poison.is_some() {
                assert!(arena.read_u32s(gone, values.len()).iter().all(|word| *word == POISON));
            }
            arena.write_u32s(gone, &values);
            assert!(arena.read_u32s(gone, values.len()) == values, "{poison:?}");
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let mut arena = Arena::new();
        let addr = arena.alloc_f32(&[1.5, -2.0]);
        assert_eq!(arena.read_f32s(addr, 2), [1.5, -2.0]);
    }

    #[test]
    #[should_panic(expected = "past the")]
    fn an_access_past_the_end_is_caught() {
        let arena = Arena::new();
        arena.read_u32(Addr(1 << 20));
    }

    #[test]
    fn an_array_that_does_not_fit_is_told_and_has_no_bytes() {
        let mut arena = Arena::new();
        let before = arena.alloc_u32(&[5]);
        assert_eq!(arena.check(), Ok(()));
        for bytes in [u64::MAX, 1 << 40] {
            let none = arena.alloc_bytes(bytes);
            arena.write_u32(none, 7);
            assert_eq!((arena.read_u32(none), arena.read_u32(before)), (0, 0));
        }
        let Err(ArenaError::Full { wanted_bytes, reserved_bytes }) = arena.check() else {
            panic!("it does not fit")
        };
        assert_eq!((wanted_bytes, reserved_bytes), (u64::MAX, arena.reserved_bytes));
    }
}
