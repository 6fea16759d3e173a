//! What host threads are doing, for who asks where the host's time goes.
//!
//! ```text
//! a host thread: doing(Work::Uncore) ─► its place: one byte ─► Watched::now, as often as somebody wants to know
//! ```
//!
//! While nobody watches, [`doing`] costs a load and a branch. What is watched changes no result.

use crossbeam_utils::CachePadded;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering::Relaxed};

/// What a host thread does for a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Work {
    /// The thread runs kernels whose uops nobody asks for.
    Function,
    /// The thread runs kernels, records their uops and counts them.
    Emission,
    /// The thread runs cores: they issue, hit in their L1s, and take what they are answered.
    Issue,
    /// The thread runs cores: they look beyond hits in their L1s, or translate addresses.
    PrivateCaches,
    /// The thread serves requests in rings, directory and memory.
    Uncore,
    /// The thread waits for others.
    Waiting,
    /// The thread runs a step and does none of that: it deals out tasks and cores, reads and sorts, checks laws.
    Other,
}

impl Work {
    /// Number of kinds of work.
    pub const COUNT: usize = 7;

    /// All kinds of work, in the order of their numbers.
    pub const ALL: [Work; Work::COUNT] = [
        Work::Function,
        Work::Emission,
        Work::Issue,
        Work::PrivateCaches,
        Work::Uncore,
        Work::Waiting,
        Work::Other,
    ];

    /// The work in words.
    pub fn title(self) -> &'static str {
        match self {
            Work::Function => "function: kernels run",
            Work::Emission => "emission: kernels run and recorded",
            Work::Issue => "issue, hits in the L1, answers",
            Work::PrivateCaches => "private caches beyond hits",
            Work::Uncore => "uncore",
            Work::Waiting => "waiting for other host threads",
            Work::Other => "all else in steps",
        }
    }
}

/// Host threads that are watched at most; what further ones do is not counted.
const THREADS_MAX: usize = 256;

/// The place of no thread.
const FREE: u8 = u8::MAX;

/// The place of a thread that does none of the work that is told apart; others have the number of their work.
const NONE: u8 = u8::MAX - 1;

static WATCHES: AtomicUsize = AtomicUsize::new(0);
/// A line each: threads that write often must not take lines from one another.
static PLACES: [CachePadded<AtomicU8>; THREADS_MAX] =
    [const { CachePadded::new(AtomicU8::new(FREE)) }; THREADS_MAX];

/// The place of a thread until it ends; `None` where there was none left.
struct Place(Option<&'static AtomicU8>);

impl Place {
    fn claim() -> Place {
        let is_claimed = |place: &AtomicU8| place.compare_exchange(FREE, NONE, Relaxed, Relaxed).is_ok();
        Place(PLACES.iter().map(|place| &**place).find(|place| is_claimed(place)))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        if let Some(place) = self.0 {
            place.store(FREE, Relaxed);
        }
    }
}

thread_local! {
    static PLACE: Place = Place::claim();
}

/// A stretch of work of this thread, which ends with the value; what the thread did before goes on then.
pub struct Doing {
    /// What stood at the thread's place; `None` while nobody watches.
    before: Option<u8>,
    /// The value stays with its thread.
    of_thread: PhantomData<*const ()>,
}

/// Begins a stretch of work.
#[inline(always)]
pub fn doing(work: Work) -> Doing {
    let before = if WATCHES.load(Relaxed) == 0 { None } else { replace(work as u8) };
    Doing { before, of_thread: PhantomData }
}

/// Puts `now` in the place of this thread; returns what stood there.
#[cold]
#[inline(never)]
fn replace(now: u8) -> Option<u8> {
    // No other thread writes to the place: no need to do both at once.
    let replace = |place: &AtomicU8| {
        let before = place.load(Relaxed);
        place.store(now, Relaxed);
        before
    };
    PLACE.try_with(|place| place.0.map(replace)).ok().flatten()
}

impl Drop for Doing {
    #[inline(always)]
    fn drop(&mut self) {
        if let Some(before) = self.before {
            replace(before);
        }
    }
}

/// While it lives, host threads say what they are doing.
pub struct Watched {
    /// Only [`Watched::begin`] makes one.
    only_here: PhantomData<()>,
}

impl Watched {
    /// Has host threads say what they are doing from now on.
    pub fn begin() -> Watched {
        WATCHES.fetch_add(1, Relaxed);
        Watched { only_here: PhantomData }
    }

    /// What host threads are doing at this moment: the work of each that does any.
    pub fn now(&self) -> impl Iterator<Item = Work> {
        PLACES.iter().filter_map(|place| Work::ALL.get(usize::from(place.load(Relaxed))).copied())
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        WATCHES.fetch_sub(1, Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn here() -> Option<u8> {
        PLACE.with(|place| place.0.map(|place| place.load(Relaxed)))
    }

    #[test]
    fn the_innermost_work_counts_and_ends_with_its_value() {
        let watched = Watched::begin();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                assert_eq!(here(), Some(NONE));
                let outer = doing(Work::Issue);
                {
                    let _inner = doing(Work::PrivateCaches);
                    assert_eq!(here(), Some(Work::PrivateCaches as u8));
                    assert!(watched.now().any(|work| work == Work::PrivateCaches));
                }
                assert_eq!(here(), Some(Work::Issue as u8));
                drop(outer);
                assert_eq!(here(), Some(NONE));
            });
        });
    }

    #[test]
    fn numbers_are_places_in_the_list() {
        assert!(Work::ALL.iter().enumerate().all(|(number, work)| *work as usize == number));
    }
}
