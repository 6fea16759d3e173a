//! Which task of an independent step wrote which word: how debug builds catch a step that is none.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// The claim of an addition: any task may add to a word that tasks add to.
const ADDED: u32 = u32::MAX;

/// Words that are claimed in one piece of memory: methods have thousands of short steps over hundreds of megabytes.
const PAGE_WORDS: usize = 4096;

/// For each word of a page the task that wrote it, plus one; 0 for none, `ADDED` for any that added to it.
type Page = Box<[AtomicU32]>;

/// The pages of the arena, each made when its first word is written. Empty in builds without debug assertions and while no
/// independent step runs: then nothing is claimed.
#[derive(Debug, Default)]
pub(crate) struct Claims {
    pages: Vec<OnceLock<Page>>,
}

impl Claims {
    /// No word of `used_bytes` is claimed.
    pub(crate) fn new(used_bytes: u64) -> Claims {
        let count = if cfg!(debug_assertions) { (used_bytes as usize / 4).div_ceil(PAGE_WORDS) } else { 0 };
        Claims { pages: std::iter::repeat_with(OnceLock::new).take(count).collect() }
    }

    /// Task `task` writes the word at `addr`.
    ///
    /// # Panics
    /// In debug builds, where another task has written it or one has added to it.
    #[inline(always)]
    pub(crate) fn write(&self, task: u32, addr: u64) {
        if cfg!(debug_assertions) {
            self.claim(task + 1, addr);
        }
    }

    /// A task adds to the word at `addr`.
    ///
    /// # Panics
    /// In debug builds, where a task has written it.
    #[inline(always)]
    pub(crate) fn add(&self, addr: u64) {
        if cfg!(debug_assertions) {
            self.claim(ADDED, addr);
        }
    }

    fn claim(&self, by: u32, addr: u64) {
        let word = (addr / 4) as usize;
        let Some(page) = self.pages.get(word / PAGE_WORDS) else { return };
        let page = page.get_or_init(|| (0..PAGE_WORDS).map(|_| AtomicU32::new(0)).collect());
        let before = page[word % PAGE_WORDS].swap(by, Relaxed);
        if before != 0 && before != by {
            let name = |by| match by {
                ADDED => "a task that adds".to_owned(),
                task => format!("task {}", task - 1),
            };
            panic!(
                "the word at {addr:#x} is written by {} and by {} of a step that is declared independent",
                name(before),
                name(by)
            );
        }
    }
}
