//! Lists that many tasks fill, count → scan → fill: the primitives of bins, the records of cells.
//!
//! A task counts in a table of its own and adds it to the lengths of the lists at its end, one atomic for 16 lists; the
//! table keeps what the atomics returned. `fill` then knows the place of everything and needs no atomics: lists that all
//! tasks add to would otherwise wander between the cores at every primitive.

use lrbsim_isa::{Addr, Arena, Compare, Runner, Stopped, Vpu};

use crate::clear::clear_lines;
use crate::expression::{int, scalar};
use crate::scan::{self, Scan};

/// Lists that the tasks of two steps fill: one that counts, one that writes.
#[derive(Debug, Clone, Copy)]
pub struct Lists {
    /// Lengths of the lists while they are counted, then the first item of each; one more than there are lists.
    pub starts: Addr,
    /// Number of lists.
    pub count: u32,
    /// The prefix sum of their lengths.
    scan: Scan,
    /// Tables of the tasks: number of items so far, for each list that a task can add to.
    tables: Addr,
    /// Words of a table, whole vectors.
    words: u32,
}

impl Lists {
    /// Words of the `starts` of `lists` lists.
    pub fn start_words(lists: u32) -> u64 {
        scan::padded(u64::from(lists))
    }

    /// Room for the tables of `tasks` tasks, which add to at most `words` of `lists` lists each, a multiple of 16. `starts` is
    /// zero, and of [`Lists::start_words`] words.
    pub fn new(arena: &mut Arena, starts: Addr, lists: u32, tasks: u32, words: u32) -> Lists {
        let scan = Scan::new(arena, starts, u64::from(lists));
        let tables = arena.overwritten(u64::from(tasks) * u64::from(words));
        Lists { starts, count: lists, scan, tables, words }
    }

    /// Sums the lengths of the lists, once they are counted, to where each begins; how many items all have.
    pub fn sum(&self, runner: &mut Runner<'_>) -> Result<u32, Stopped> {
        self.scan.run(runner)?;
        Ok(runner.arena.read_u32(self.starts.plus_words(u64::from(self.count))))
    }

    /// First word of the table of a task.
    #[inline(always)]
    pub fn table<V: Vpu>(&self, v: &mut V, task: V::S32) -> V::S32 {
        scalar!(v, task * { self.words as i32 })
    }

    /// Clears the table that begins at `at`, before the task counts in it.
    #[inline(always)]
    pub fn clear_table<V: Vpu>(&self, v: &mut V, at: V::S32) {
        let end = scalar!(v, at + { self.words as i32 });
        clear_lines(v, self.tables, at, end);
    }

    /// Adds an item to those of 16 lists that are in `live`, at words `at..` of the task's table; how many items the task put
    /// in each list before.
    #[inline(always)]
    pub fn add<V: Vpu>(&self, v: &mut V, live: V::Mask, at: V::S32) -> V::I32 {
        let one = v.vset_i32(1);
        let before = v.vload_i32(self.tables, at);
        let after = int!(v, before + one);
        v.vstore_i32(live, self.tables, at, after);
        before
    }

    /// Adds an item to those of 16 lists that are in `live`, when lists are filled; the place of the item in each. `at` as in
    /// [`Lists::add`], `list` the number of the first list.
    #[inline(always)]
    pub fn place<V: Vpu>(&self, v: &mut V, live: V::Mask, at: V::S32, list: V::S32) -> V::I32 {
        let in_list = self.add(v, live, at);
        let start = v.vload_i32(self.starts, list);
        int!(v, start + in_list)
    }

    /// Adds an item to one list, at word `at` of the task's table; how many items the task put there before.
    #[inline(always)]
    pub fn add_one<V: Vpu>(&self, v: &mut V, at: V::S32) -> V::S32 {
        let before = v.s_load(self.tables, at);
        let after = scalar!(v, before + 1);
        v.s_store(self.tables, at, after);
        before
    }

    /// Adds an item to list `list`, when lists are filled; its place. `at` as in [`Lists::add_one`].
    #[inline(always)]
    pub fn place_one<V: Vpu>(&self, v: &mut V, at: V::S32, list: V::S32) -> V::S32 {
        let in_list = self.add_one(v, at);
        let start = v.s_load(self.starts, list);
        scalar!(v, start + in_list)
    }

    /// The table of 16 words that begins at `at`: how long lists were before the task added to them, once it has been published.
    #[inline(always)]
    pub fn of_task<V: Vpu>(&self, v: &mut V, at: V::S32) -> V::I32 {
        v.vload_i32(self.tables, at)
    }

    /// Adds `counts` items to 16 lists, from `list` on, and keeps at `at`, the task's table of 16 words, how long those were to which there
    /// are any to add.
    #[inline(always)]
    pub fn publish_counts<V: Vpu>(&self, v: &mut V, at: V::S32, list: V::S32, counts: V::I32) {
        let (none, lane) = (v.vset_i32(0), v.viota());
        self.publish_with(v, [at, list], counts, none, lane);
    }

    /// As [`Lists::publish_counts`], with `none`, 0 in every lane, and `lane`, their numbers, which are the caller's.
    #[inline(always)]
    fn publish_with<V: Vpu>(
        &self,
        v: &mut V,
        [at, list]: [V::S32; 2],
        counts: V::I32,
        none: V::I32,
        lane: V::I32,
    ) {
        let some = v.vicmp_neq(counts, none);
        if v.branch_any(some) {
            let first = v.vsplat(list);
            let lists = int!(v, first + lane);
            let before = v.vatomic_add_or(none, some, self.starts, lists, counts);
            v.vstore_i32(some, self.tables, at, before);
        }
    }

    /// Adds the table that begins at `at` to the lengths of the lists from `list` on, and keeps in it how long they were.
    #[inline(always)]
    pub fn publish<V: Vpu>(&self, v: &mut V, at: V::S32, list: V::S32) {
        let (none, lane) = (v.vset_i32(0), v.viota());
        let end = scalar!(v, at + { self.words as i32 });
        let mut at = at;
        let mut list = list;
        while v.branch(Compare::Less, at, end) {
            let counts = self.of_task(v, at);
            self.publish_with(v, [at, list], counts, none, lane);
            at = scalar!(v, at + 16);
            list = scalar!(v, list + 16);
        }
    }
}
