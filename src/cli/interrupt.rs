//! What an interrupt does: Ctrl-C, or a request to end.

use lrbsim_reports::files::undisturbed;

/// Exit code of an interrupted command, as shells have it for Ctrl-C.
const INTERRUPTED: i32 = 130;

/// On an interrupt, does `last` and ends the process with nothing half written: what is being written is finished
/// first.
pub(crate) fn on_interrupt(last: impl FnMut() + Send + 'static) {
    on_interrupt_exit(INTERRUPTED, last);
}

/// On an interrupt, does `last` and ends the process as [`on_interrupt`] does, with exit code `code`.
pub(crate) fn on_interrupt_exit(code: i32, mut last: impl FnMut() + Send + 'static) {
    let handler = move || {
        last();
        let _nothing_begins = undisturbed();
        std::process::exit(code);
    };
    // Without a handler an interrupt still ends the process; what it leaves half, the next results there remove.
    let _ = ctrlc::set_handler(handler);
}
