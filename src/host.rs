//! The host: what a run costs it, its name, and the program that runs there.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use cpu_time::ProcessTime;
use lrbsim_reports::picture::sha256_of_reader;

use crate::results::safe_name;

/// A running stopwatch: the one place where the program looks at a clock.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts a stopwatch.
    #[expect(
        clippy::disallowed_methods,
        reason = "host time is reported beside the results, never inside them"
    )]
    pub fn start() -> Stopwatch {
        Stopwatch(Instant::now())
    }

    /// Time since the stopwatch was started.
    pub fn elapsed(&self) -> Duration {
        self.0.elapsed()
    }
}

/// A running count of the processor time of all threads of this process.
#[derive(Debug, Clone, Copy)]
pub struct CpuWatch(ProcessTime);

impl CpuWatch {
    /// Starts a count.
    pub fn start() -> CpuWatch {
        CpuWatch(ProcessTime::now())
    }

    /// Processor time since the count was started.
    pub fn elapsed(&self) -> Duration {
        self.0.elapsed()
    }
}

/// Name of this host.
pub fn node() -> String {
    gethostname::gethostname().to_string_lossy().into_owned()
}

/// Last extension of files that are being written.
pub const PARTIAL: &str = "partial";

/// A name beside `file` that no other process writes to, on this host or another.
pub fn partial(file: &Path) -> PathBuf {
    file.with_extension(format!("{}-{}.{PARTIAL}", safe_name(&node()), std::process::id()))
}

/// SHA-256 of the program that runs here, in hexadecimal: two builds that differ in anything have other hashes. Empty where
/// the host does not show the program its own file.
pub fn build() -> &'static str {
    static BUILD: OnceLock<String> = OnceLock::new();
    BUILD.get_or_init(|| {
        // Linux keeps the file that runs, whatever has taken its name since.
        let running = std::fs::File::open("/proc/self/exe");
        let file = running.or_else(|_| std::fs::File::open(std::env::current_exe()?));
        file.and_then(sha256_of_reader).unwrap_or_default()
    })
}

/// Greatest resident memory of this process so far; `None` where the host does not tell.
pub fn peak_rss_bytes() -> Option<u64> {
    bytes_of(&std::fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// Bytes in the line of `text` that begins with `label`, as the files of `/proc` give them: in kB.
pub fn bytes_of(text: &str, label: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(label))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_found_in_a_status_file() {
        assert_eq!(bytes_of("Name:\tx\nVmHWM:\t  2048 kB\nVmRSS:\t 1 kB\n", "VmHWM:"), Some(2 << 20));
        assert_eq!(bytes_of("Name:\tx\n", "VmHWM:"), None);
    }
}
