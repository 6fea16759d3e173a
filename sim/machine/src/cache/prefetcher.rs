//! The streamer: follows streams of accesses to the L2 and says what to fetch before it is asked for.
//!
//! A stream begins with an L2 miss to a page that none follows [chrysos12]. A second access to the page, near the first,
//! gives it a direction; from then on it runs a fixed number of lines ahead of the last access, to the end of the page.

use crate::config::PrefetcherSpec;

/// One page that is followed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stream {
    page: u32,
    /// Line of the last access.
    last: u32,
    /// 1 up, -1 down, 0 not known yet.
    direction: i32,
    /// The next line to fetch, once the direction is known.
    next: u32,
    /// When it was last accessed, in accesses.
    used: u64,
}

/// The streamer of one core.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Prefetcher {
    spec: Option<PrefetcherSpec>,
    streams: Vec<Stream>,
    accesses: u64,
}

impl Prefetcher {
    /// `None`: follows nothing.
    pub(crate) fn new(spec: Option<&PrefetcherSpec>) -> Prefetcher {
        Prefetcher { spec: spec.cloned(), streams: Vec::new(), accesses: 0 }
    }

    /// Notes an access to the L2. Returns the stream that it belongs to, when there is something to fetch.
    pub(crate) fn observe(&mut self, line: u32, missed: bool) -> Option<usize> {
        let spec = self.spec.as_ref()?;
        self.accesses += 1;
        let page = line / spec.page_lines;
        let Some(index) = self.streams.iter().position(|stream| stream.page == page) else {
            if missed {
                let stream = Stream { page, last: line, direction: 0, next: line, used: self.accesses };
                if self.streams.len() < spec.streams as usize {
                    self.streams.push(stream);
                } else if let Some(oldest) = self.streams.iter_mut().min_by_key(|stream| stream.used) {
                    *oldest = stream;
                }
            }
            return None;
        };
        let stream = &mut self.streams[index];
        stream.used = self.accesses;
        let step = line as i32 - stream.last as i32;
        if step == 0 {
            return None;
        }
        stream.last = line;
        let near = step.unsigned_abs() <= spec.train_lines;
        if near && stream.direction != step.signum() {
            stream.next = line.wrapping_add_signed(step.signum());
        }
        // An access elsewhere ends the stream; what comes after it may begin a new one.
        stream.direction = if near { step.signum() } else { 0 };
        near.then_some(index)
    }

    /// The next line that `stream` wants; [`Prefetcher::advance`] when it is on its way.
    pub(crate) fn wanted(&self, stream: usize) -> Option<u32> {
        let spec = self.spec.as_ref()?;
        let Stream { page, last, direction, next, .. } = self.streams[stream];
        let ahead = (next as i32 - last as i32) * direction;
        (ahead <= spec.lines_ahead as i32 && next / spec.page_lines == page).then_some(next)
    }

    /// The line that `stream` wanted need not be fetched again.
    pub(crate) fn advance(&mut self, stream: usize) {
        let stream = &mut self.streams[stream];
        stream.next = stream.next.wrapping_add_signed(stream.direction);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prefetcher() -> Prefetcher {
        Prefetcher::new(Some(&PrefetcherSpec {
            streams: 2,
            lines_ahead: 4,
            train_lines: 2,
            mshrs_spared: 0,
            page_lines: 64,
        }))
    }

    /// Everything that an access makes it fetch.
    fn fetched(prefetcher: &mut Prefetcher, line: u32) -> Vec<u32> {
        let mut lines = Vec::new();
        if let Some(stream) = prefetcher.observe(line, true) {
            while let Some(line) = prefetcher.wanted(stream) {
                lines.push(line);
                prefetcher.advance(stream);
            }
        }
        lines
    }

    #[test]
    fn two_neighbors_make_a_stream_and_one_line_does_not() {
        let mut prefetcher = prefetcher();
        assert!(fetched(&mut prefetcher, 128).is_empty());
        assert_eq!(fetched(&mut prefetcher, 129), [130, 131, 132, 133]);
        assert_eq!(fetched(&mut prefetcher, 130), [134]);
    }

    #[test]
    fn a_stream_may_run_down_and_ends_at_its_page() {
        let mut prefetcher = prefetcher();
        fetched(&mut prefetcher, 131);
        assert_eq!(fetched(&mut prefetcher, 130), [129, 128]);
    }

    #[test]
    fn distant_accesses_are_no_stream() {
        let mut prefetcher = prefetcher();
        assert!((0..8).all(|i| fetched(&mut prefetcher, 128 + 4 * i).is_empty()));
    }

    #[test]
    fn an_access_elsewhere_in_the_page_ends_a_stream() {
        let mut prefetcher = prefetcher();
        fetched(&mut prefetcher, 128);
        fetched(&mut prefetcher, 129);
        assert!(fetched(&mut prefetcher, 150).is_empty());
        assert_eq!(fetched(&mut prefetcher, 151), [152, 153, 154, 155]);
    }

    #[test]
    fn the_oldest_stream_makes_room() {
        let mut prefetcher = prefetcher();
        for page in [0, 64, 128] {
            fetched(&mut prefetcher, page);
        }
        assert!(
            fetched(&mut prefetcher, 1).is_empty(),
            "page 0 was thrown out, and this miss begins it again"
        );
        assert_eq!(fetched(&mut prefetcher, 129).len(), 4);
    }

    #[test]
    fn without_streams_nothing_is_fetched() {
        let mut none = Prefetcher::new(None);
        assert!((0..9).all(|line| fetched(&mut none, line).is_empty()));
    }
}
