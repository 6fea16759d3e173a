//! Where a host thread records: buffers that grow at branches.

use core::cell::Cell;

use crate::arena::map_bytes;
use crate::lanes::{LANES, Lanes};
use crate::spill;
use crate::stream::{Stream, StreamLine, TASK_UOPS_MAX};
use crate::uop::{DISTANCE_MAX, LINES_MAX};

/// Id of the first uop of a task. More than [`DISTANCE_MAX`], so that id 0, a constant, is always too far back to name.
pub(super) const FIRST_ID: usize = DISTANCE_MAX as usize + 2;

/// Uops that may follow one another without a branch: there is room for as many past every branch.
///
/// Every loop of a kernel whose length the host compiler does not know ends in a branch, so this bounds straight code.
pub(super) const RUN_UOPS_MAX: usize = 4096;

/// Uops that there is room for from the start: what a task is meant to have at most.
pub(super) const IDS_AT_FIRST: usize = 64 << 10;

/// A number above all ids of uops: the first branch past the last place of a task begins again.
pub(super) const ID_LIMIT: usize = TASK_UOPS_MAX + RUN_UOPS_MAX;

/// The memory in which one host thread records its tasks.
///
/// Uops are written without a check each. What makes that sound: the places of a whole run past every branch are there
/// before it begins, and a longer run stops.
#[derive(Debug)]
pub(crate) struct Buffers {
    /// The places for uops; `None` before the first task of the host thread.
    places: Option<Places>,
    /// Uops that places are ever made for: [`TASK_UOPS_MAX`], less in tests.
    pub(super) ids_max: usize,
    /// The highest id of a task that is too long, whose uops are lost; 0 for all others.
    lost: usize,
}

/// Memory for the uops of a task, all zero at first and committed by the operating system as touched.
#[derive(Debug)]
struct Places {
    /// The pages, into which `at` points.
    _map: memmap2::MmapMut,
    at: Pointers,
}

/// Where the arrays of a host thread lie in its [`Places`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Pointers {
    /// The uops of the task, by id.
    pub(super) uops: *mut u32,
    /// The id of the last reader of each vector register by the id of its maker; 0 between tasks.
    pub(super) last_reader: *mut u32,
    /// The lines that the uops touch: room for as many as they can have, and for one vector past the last.
    pub(super) lines: *mut StreamLine,
    /// How many vector registers have their last reader at each id; 0 between tasks.
    pub(super) ends: *mut u8,
    /// The id from which on there is less than the room for a run.
    pub(super) ids_end: usize,
}

impl Places {
    /// Places for `ids_end` ids and a run more; `None` if the host refuses.
    fn new(ids_end: usize) -> Option<Places> {
        let ids = ids_end + RUN_UOPS_MAX;
        let lines = LINES_MAX * ids + LANES;
        let bytes = 4 * (ids + ids + lines) + ids;
        let mut map = map_bytes(bytes)?;
        let uops = map.as_mut_ptr().cast::<u32>();
        let last_reader = uops.wrapping_add(ids);
        let stream_lines = last_reader.wrapping_add(ids).cast::<StreamLine>();
        let ends = stream_lines.wrapping_add(lines).cast();
        Some(Places { _map: map, at: Pointers { uops, last_reader, lines: stream_lines, ends, ids_end } })
    }
}

impl Buffers {
    pub(super) const fn new() -> Buffers {
        Buffers { places: None, ids_max: TASK_UOPS_MAX, lost: 0 }
    }

    /// Runs `record` with this host thread's buffers. A task that panics loses them, so the next one finds clean ones.
    pub(crate) fn with<R>(record: impl FnOnce(&mut Buffers) -> R) -> R {
        thread_local! {
            static BUFFERS: Cell<Option<Box<Buffers>>> = const { Cell::new(None) };
        }
        let mut buffers = BUFFERS.take().unwrap_or_else(|| Box::new(Buffers::new()));
        let result = record(&mut buffers);
        BUFFERS.set(Some(buffers));
        result
    }

    /// Where the arrays lie for a task that has begun.
    #[inline(always)]
    pub(super) fn pointers(&self) -> Pointers {
        self.places.as_ref().expect("a task begins only where it has places").at
    }

    /// Has places for a task of the usual length; `false` if the host refuses.
    pub(crate) fn prepare(&mut self) -> bool {
        if self.places.is_none() {
            self.places = Places::new(IDS_AT_FIRST);
        }
        self.places.is_some()
    }

    /// More places for a task that has come to the end of them; where it goes on.
    ///
    /// A task that is too long still runs to its end, for what it does to the arena: it records over what it recorded.
    #[cold]
    #[inline(never)]
    #[expect(unsafe_code, reason = "copies between raw buffers")]
    pub(super) fn more(&mut self, at: At) -> At {
        let old = self.pointers();
        let ids_end = 2 * old.ids_end;
        let more = if ids_end > self.ids_max { None } else { Places::new(ids_end) };
        let Some(places) = more else {
            self.lost = self.lost.max(at.next);
            return At { next: FIRST_ID, lines: 0 };
        };
        let new = places.at;
        // SAFETY: as many ids and lines as the task recorded have places in both, which do not overlap.
        unsafe {
            new.uops.copy_from_nonoverlapping(old.uops, at.next);
            new.last_reader.copy_from_nonoverlapping(old.last_reader, at.next.max(self.lost));
            new.lines.copy_from_nonoverlapping(old.lines, at.lines);
        }
        self.places = Some(places);
        at
    }

    /// Appends what a task left here to `stream`, spills included, and makes them ready for the next task.
    #[inline(always)]
    #[expect(unsafe_code, reason = "the filled part of the buffers as slices")]
    pub(crate) fn finish<L: Lanes>(&mut self, Recorded { at, lane_slots }: Recorded, stream: &mut Stream) {
        let pointers = self.pointers();
        let ids = at.next.max(self.lost);
        // SAFETY: all bytes were zero from the start; every id and line of the task has its place; the four do not
        // overlap, and `&mut self` is the only way to them.
        let (uops, last_reader, ends, lines) = unsafe {
            (
                core::slice::from_raw_parts(pointers.uops, ids),
                core::slice::from_raw_parts_mut(pointers.last_reader, ids),
                core::slice::from_raw_parts_mut(pointers.ends, ids),
                core::slice::from_raw_parts(pointers.lines, at.lines),
            )
        };
        if self.lost > 0 {
            last_reader.fill(0);
            self.lost = 0;
            stream.cut_short = true;
            return;
        }
        stream.uops.extend_from_slice(&uops[FIRST_ID..]);
        stream.lines.extend_from_slice(lines);
        let slots = LANES as u64;
        let lanes_masked = slots * lane_slots.masked_uops - lane_slots.masked_lanes_active;
        stream.lanes_masked += lanes_masked;
        stream.lanes_active += slots * lane_slots.vector_uops - lanes_masked;
        let pressure = spill::pressure::<L>(last_reader, ends, FIRST_ID);
        stream.live_vectors_max = stream.live_vectors_max.max(pressure.live_max);
        spill::charge(stream, pressure.spills);
    }
}

/// How far a task that is recorded has come.
#[derive(Debug, Clone, Copy)]
pub(super) struct At {
    /// The id of the uop to come.
    pub(super) next: usize,
    /// Number of lines that its uops have touched so far.
    pub(super) lines: usize,
}

/// How much a task has recorded: what [`Buffers::finish`] makes a stream of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Recorded {
    pub(super) at: At,
    pub(super) lane_slots: LaneSlots,
}

/// What the lane-slots of a task are counted from.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LaneSlots {
    /// Number of vector uops, 16 lane-slots each.
    pub(super) vector_uops: u64,
    /// Number of vector uops under a mask.
    pub(super) masked_uops: u64,
    /// Number of lanes of uops under a mask that did work.
    pub(super) masked_lanes_active: u64,
}
