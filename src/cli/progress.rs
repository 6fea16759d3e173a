//! The progress bar: on a terminal only, and gone when the run is done.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lrbsim::progress::{Progress, Stopwatch};

/// Bar on standard error.
pub(crate) struct Bar {
    bar: ProgressBar,
    /// Instructions simulated so far, for the rate.
    uops: AtomicU64,
    /// Whether the running step told of its tasks one by one.
    watched: AtomicBool,
    watch: Stopwatch,
}

impl Bar {
    /// A bar that is drawn when `visible`.
    pub(crate) fn new(visible: bool) -> Bar {
        let bar = on_standard_error(visible);
        Bar { bar, uops: AtomicU64::new(0), watched: AtomicBool::new(false), watch: Stopwatch::start() }
    }

    /// A part without a length begins.
    pub(crate) fn note(&self, what: &str) {
        self.bar.set_style(style("{spinner} {prefix}"));
        self.bar.set_prefix(what.to_owned());
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn add(&self, uops: u64) {
        let uops = self.uops.fetch_add(uops, Relaxed) + uops;
        let rate = uops as f64 / self.watch.elapsed().as_secs_f64().max(1e-3) / 1e6;
        self.bar.set_message(format!("{rate:.0} M instructions/s"));
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Bar {
    fn part(&self, what: &str) {
        self.note(what);
    }

    fn counted(&self, what: &str, count: u32) {
        self.bar.set_style(style("{prefix} {wide_bar} {percent}% {eta} left"));
        self.bar.set_prefix(what.to_owned());
        self.bar.reset();
        self.bar.set_length(u64::from(count));
    }

    fn one_done(&self) {
        self.bar.inc(1);
    }

    fn step(&self, title: &str, tasks: u32) {
        self.watched.store(false, Relaxed);
        self.bar.set_style(style("{prefix} {wide_bar} {percent}% {msg} {eta} left"));
        self.bar.set_prefix(title.to_owned());
        self.bar.reset();
        self.bar.set_length(u64::from(tasks));
    }

    fn task(&self, uops: u64) {
        self.watched.store(true, Relaxed);
        self.bar.inc(1);
        self.uops.fetch_add(uops, Relaxed);
        // A message costs an allocation: not for each of a million tasks.
        if self.bar.position().is_multiple_of(64) {
            self.add(0);
        }
    }

    fn skipped(&self, tasks: u32) {
        self.bar.inc(u64::from(tasks));
    }

    fn uops(&self, uops: u64) {
        if !self.watched.load(Relaxed) {
            self.add(uops);
        }
    }
}

/// A bar on standard error that is drawn when `visible`.
pub(super) fn on_standard_error(visible: bool) -> ProgressBar {
    if !visible {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr_with_hz(10));
    bar.enable_steady_tick(Duration::from_millis(100));
    bar
}

pub(super) fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the template is a constant")
}
