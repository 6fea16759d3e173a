//! What a step asks of any machine: counted once, by way of a part of its tasks.

use super::reuse::{BINS, Distances, NEVER, bin};
use crate::cache::Intent;
use crate::config::MachineSpec;
use crate::core::{Kind, Row, table};
use lrbsim_isa::stream::{Place, Stream};
use lrbsim_isa::uop::Class;

/// Distances, in cycles, from a uop to the first that waits for it, that are told apart; the last stands for farther ones too.
pub(super) const DISTANCES: usize = 16;

/// Bins for the part of all groups that touch a line: bin k is for 1 in 2^k.
pub(super) const PARTS: usize = 16;

/// Lines of a region: of memory that was touched lately or not only this much is told apart.
const REGION_LINES: u32 = 1024;

/// What tasks ask of a machine, summed over those that were recorded, and of a step, scaled to all of its tasks.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    /// Uops of each class.
    pub(super) classes: [f64; Class::COUNT],
    /// Uops that issue beside the one before, on a core that issues two.
    pub(super) pairs: f64,
    /// By class and distance the uops that wait for a result of that class longest, on the nominal machine.
    pub(super) waits: Box<[[f64; DISTANCES]; Class::COUNT]>,
    /// Lines that are handed to the L1.
    pub(super) lines: f64,
    /// Second lines of loads and stores, each of which takes a cycle of its own.
    pub(super) second_lines: f64,
    /// Lines of gathers and scatters.
    pub(super) gather_lines: f64,
    /// Uops that touch memory, by the distance of the farthest of their lines within the group; `NEVER` for those with a line of the arena
    /// that is new to the group.
    pub(super) near_uops: [f64; BINS],
    /// Lines of uops by their distance within the group.
    pub(super) near_lines: [f64; BINS],
    /// Lines that are new to their group, by how many of the groups touch them, in bins of `PARTS`; without those of `contended`.
    pub(super) shared: [f64; PARTS + 1],
    /// Lines that are new to their group, and that some group writes beside others.
    pub(super) contended: f64,
    /// Distinct lines of the step by the volume that was touched since their region was: lines, those of each group counted anew.
    pub(super) far: [f64; BINS],
    /// Distinct lines of the step that it writes.
    pub(super) written: f64,
    /// Lines, new to their group, that streaming stores write first.
    pub(super) streamed: f64,
    /// Locked operations on lines.
    pub(super) locked: f64,
    /// Locked operations on the line that has most of them.
    pub(super) locked_hottest: f64,
    /// Distinct lines of a group.
    pub(super) group_lines: f64,
    /// Groups of the step.
    pub(super) groups: f64,
    /// The volume that was touched by the end of the step.
    pub(super) volume: f64,
}

impl Default for Profile {
    fn default() -> Profile {
        Profile {
            classes: [0.0; Class::COUNT],
            pairs: 0.0,
            waits: Box::new([[0.0; DISTANCES]; Class::COUNT]),
            lines: 0.0,
            second_lines: 0.0,
            gather_lines: 0.0,
            near_uops: [0.0; BINS],
            near_lines: [0.0; BINS],
            shared: [0.0; PARTS + 1],
            contended: 0.0,
            far: [0.0; BINS],
            written: 0.0,
            streamed: 0.0,
            locked: 0.0,
            locked_hottest: 0.0,
            group_lines: 0.0,
            groups: 0.0,
            volume: 0.0,
        }
    }
}

impl Profile {
    /// All uops.
    pub(super) fn uops(&self) -> f64 {
        self.classes.iter().sum()
    }

    /// Uops of a class.
    pub(super) fn count(&self, class: Class) -> f64 {
        self.classes[class as usize]
    }

    /// Multiplies all that adds up over tasks.
    fn scale(&mut self, factor: f64) {
        let waits = self.waits.iter_mut().flatten();
        let single = [
            &mut self.pairs,
            &mut self.lines,
            &mut self.second_lines,
            &mut self.gather_lines,
            &mut self.contended,
            &mut self.streamed,
            &mut self.locked,
        ];
        let bins = self.near_uops.iter_mut().chain(&mut self.near_lines).chain(&mut self.shared);
        self.classes.iter_mut().chain(waits).chain(single).chain(bins).for_each(|sum| *sum *= factor);
    }
}

/// A line of the arena that a group has touched: its number, and whether the group writes it.
type Touched = (u32, bool);

/// Reads the streams of recorded tasks. What it remembers from step to step is when memory was touched.
pub(super) struct Reader {
    rows: Box<[Row; 256]>,
    distances: Distances,
    profile: Profile,
    /// What the groups of the step have touched, each line once a group.
    touched: Vec<Touched>,
    /// What this group has touched, in any order, lines more than once.
    group: Vec<Touched>,
    /// Lines of locked operations of the step, each with the number of the group.
    locked: Vec<(u32, u32)>,
    /// Groups of the step that were read, and their distinct lines.
    groups: u32,
    group_lines: u64,
    /// By region the volume that had been touched when it last was, plus one; 0: never.
    regions: Vec<u64>,
    /// Lines that all groups so far have touched, those of each counted anew.
    volume: u64,
}

impl Reader {
    /// A reader for which `nominal` says how long results take where it matters in which order they come.
    pub(super) fn new(nominal: &MachineSpec) -> Reader {
        Reader {
            rows: table(nominal),
            distances: Distances::default(),
            profile: Profile::default(),
            touched: Vec::new(),
            group: Vec::new(),
            locked: Vec::new(),
            groups: 0,
            group_lines: 0,
            regions: Vec::new(),
            volume: 0,
        }
    }

    /// Reads the tasks of a group, which one thread runs one after the other.
    pub(super) fn read(&mut self, streams: &[Stream]) {
        self.distances.clear();
        self.group.clear();
        for stream in streams {
            self.walk(stream);
        }
        self.group.sort_unstable();
        // Of each line the last entry, which says whether any was a write.
        let lines = self.group.chunk_by(|a, b| a.0 == b.0).map(|same| same[same.len() - 1]);
        self.touched.extend(lines);
        self.groups += 1;
        self.group_lines += self.distances.distinct();
    }

    /// Uops in program order on a thread that is alone, all of whose lines are in the L1.
    fn walk(&mut self, stream: &Stream) {
        // By uop, modulo the distances that there are: cycle of issue, cycle of the result, class.
        let mut past = [(0_u64, 0_u64, 0_u8); 256];
        let mut lines = stream.lines.iter();
        // The cycle of the last issue, whether a second may join it there, and when the next may be otherwise.
        let (mut cycle, mut open, mut next) = (0_u64, None::<Row>, 1_u64);
        for (place, uop) in stream.uops.iter().enumerate() {
            let [class, first, second, third] = uop.to_le_bytes();
            let row = self.rows[class as usize];
            let third_producer = third & row.third_producer() as u8;
            let mut wait = None::<(u64, u64, u8)>;
            for distance in [first, second, third_producer] {
                if distance > 0 && usize::from(distance) <= place {
                    let producer = past[(place - usize::from(distance)) % 256];
                    if wait.is_none_or(|longest| producer.1 > longest.1) {
                        wait = Some(producer);
                    }
                }
            }
            // What is not ready beside the uop before does not pair with it, and is then no later than it would be alone.
            let ready = wait.map_or(0, |(_, ready, _)| ready);
            let fits = open.is_some_and(|before| before.pairs_with(row)) && next == cycle + 1;
            let joins = fits && ready <= cycle;
            let free = if joins { cycle } else { next };
            if let Some((issued, _, of)) = wait {
                // A thread sleeps through locked operations: nobody waits for their results.
                if !self.rows[of as usize].kind().locks() {
                    let distance = free.saturating_sub(issued) as usize;
                    self.profile.waits[of as usize][distance.min(DISTANCES - 1)] += 1.0;
                }
            }
            let at = free.max(ready);
            self.profile.classes[class as usize] += 1.0;
            if joins {
                self.profile.pairs += 1.0;
                open = None;
            } else {
                open = Some(row);
            }
            cycle = at;
            next = at + 1;
            let mut last = at;
            if row.is_branch() {
                next = at + row.latency().cycles();
            } else if !row.is_compute() {
                let count = usize::from(third);
                self.access(row.kind(), count, &mut lines);
                // One line a cycle; the result comes with the last.
                last = at + (count as u64).saturating_sub(1);
                next = last + if row.kind().locks() { row.latency().cycles() } else { 1 };
            }
            past[place % 256] = (last, last + row.latency().cycles(), class);
        }
    }

    /// The lines of one uop.
    fn access<'s>(
        &mut self,
        kind: Kind,
        count: usize,
        lines: &mut impl Iterator<Item = &'s lrbsim_isa::stream::StreamLine>,
    ) {
        let mut farthest = 0;
        for line in lines.take(count) {
            let distance = self.distances.access(line.bits());
            let mut bin = bin(distance.unwrap_or(0));
            if let Place::Arena(number) = line.place() {
                let writes = kind.writes();
                if distance.is_none() || writes {
                    self.group.push((number, writes));
                }
                if distance.is_none() {
                    bin = NEVER;
                    self.profile.streamed += f64::from(u8::from(kind.intent() == Intent::Stream));
                }
                if kind.locks() {
                    self.locked.push((number, self.groups));
                }
            }
            self.profile.lines += 1.0;
            self.profile.near_lines[bin] += 1.0;
            farthest = farthest.max(bin);
        }
        if kind.is_gather() {
            self.profile.gather_lines += count as f64;
        } else {
            self.profile.second_lines += count.saturating_sub(1) as f64;
        }
        if count > 0 && !kind.is_prefetch() {
            self.profile.near_uops[farthest] += 1.0;
        }
    }

    /// The profile of a step of `groups` groups with `uops` uops, spills left out, as those that were read tell it.
    pub(super) fn finish(&mut self, groups: u32, uops: u64) -> Profile {
        let mut profile = std::mem::take(&mut self.profile);
        let spills = profile.count(Class::SpillStore) + profile.count(Class::SpillLoad);
        let factor = uops as f64 / (profile.uops() - spills).max(1.0);
        let read = std::mem::take(&mut self.groups);
        profile.groups = f64::from(groups);
        profile.group_lines = std::mem::take(&mut self.group_lines) as f64 / f64::from(read.max(1));

        let mut regions: Vec<(usize, f64)> = Vec::new();
        self.touched.sort_unstable();
        for same in self.touched.chunk_by(|a, b| a.0 == b.0) {
            let count = same.len() as f64;
            let writers = same.iter().filter(|touched| touched.1).count();
            if same.len() > 1 && writers > 0 {
                profile.contended += count;
            } else {
                // One of all groups that were read is as good as none beside it.
                let is_alone = same.len() == 1 && read > 1;
                let bin = if is_alone { PARTS } else { (read / same.len() as u32).ilog2() as usize };
                profile.shared[bin.min(PARTS)] += count;
            }
            // What a part of the groups touches alone, others touch as many more of; what several touch is seen nearly whole.
            let lines = if same.len() == 1 { factor } else { 1.0 };
            profile.written += if writers > 0 { lines } else { 0.0 };
            let region = (same[0].0 / REGION_LINES) as usize;
            match regions.last_mut() {
                Some((last, sum)) if *last == region => *sum += lines,
                _ => regions.push((region, lines)),
            }
        }
        // A region is touched in the middle of a step, as far as it is known when.
        let volume = (self.touched.len() as f64 * factor) as u64;
        let middle = self.volume + volume / 2;
        self.touched.clear();
        for (region, lines) in &regions {
            if *region >= self.regions.len() {
                self.regions.resize(region + 1, 0);
            }
            let last = std::mem::replace(&mut self.regions[*region], middle + 1);
            let bin = if last == 0 { NEVER } else { bin(middle - (last - 1)) };
            profile.far[bin] += lines;
        }
        self.volume += volume;
        profile.volume = self.volume as f64;

        self.locked.sort_unstable();
        profile.locked = self.locked.len() as f64;
        let operations = |same: &[(u32, u32)]| {
            // What one group alone locks, others do not lock more often.
            let is_shared = same[0].1 != same[same.len() - 1].1;
            same.len() as f64 * if is_shared { factor } else { 1.0 }
        };
        let by_line = self.locked.chunk_by(|a, b| a.0 == b.0);
        profile.locked_hottest = by_line.map(operations).fold(0.0, f64::max);
        self.locked.clear();
        profile.scale(factor);
        profile
    }
}
