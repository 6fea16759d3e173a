//! Which task of an independent step wrote which word: how debug builds catch a step that is none.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// The claim of an addition: any task may add to a word that tasks add to.
const ADDED: u32 = u32::MAX;

/// For each word of the arena the task that wrote it, plus one; 0 for none, `ADDED` for any that added to it. Empty in
/// builds without debug assertions and while no independent step runs: then nothing is claimed.
#[derive(Debug, Default)]
pub(crate) struct Claims {
    words: Vec<AtomicU32>,
}

impl Claims {
    /// No word of `used_bytes` is claimed.
    pub(crate) fn new(used_bytes: u64) -> Claims {
        let count = if cfg!(debug_assertions) { (used_bytes / 4) as usize } else { 0 };
        Claims { words: std::iter::repeat_with(AtomicU32::default).take(count).collect() }
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
        let Some(word) = self.words.get((addr / 4) as usize) else { return };
        let before = word.swap(by, Relaxed);
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
