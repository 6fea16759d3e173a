//! A report as terminal text, laid out as Table 2 of Johnson et al. 2009 with the machine's side beside it.

use std::fmt::Write as _;

use lrbsim_machine::{Bounds, Cause};

use crate::run::{ImageError, PhaseReport, RunReport, are_of_paper, half_interval, hit_rate};

/// Columns of text at most, so that a table fits a common terminal.
pub const WIDTH_MAX: usize = 120;

/// Causes of the cycle stack that are named per row, at most.
const CAUSES_MAX: usize = 3;

/// A cause of the cycle stack is named from this part of a phase's core-cycles on.
const CAUSE_PART_MIN: f64 = 0.03;

/// The table of a run, at most [`WIDTH_MAX`] columns wide.
pub fn render(report: &RunReport) -> String {
    let mut text = String::new();
    heading(&mut text, report);
    text.push('\n');

    let timed = report.total.cycles.is_some();
    let is_estimated = report.phases.iter().any(|phase| phase.bounds.is_some());
    let mut rows = vec![header(timed, is_estimated)];
    rows.extend(report.phases.iter().map(|phase| row(phase, timed, are_of_paper(&report.phases))));
    let phase_rows = rows.len();
    rows.extend(totals(report, timed));
    lay_out(&mut text, &rows, phase_rows);

    if are_of_paper(&report.phases) && report.phases.iter().any(|phase| !phase.in_paper_total) {
        text.push_str("\n* not in the paper's total, which leaves out the costs of these phases\n");
    }
    if report.total.ms_interval.is_some() {
        text.push_str(
            "\n\u{b1}: half of the interval in which `windowed` has the time, with 95 % confidence; counters and waits are\nextrapolated too, and have none\n",
        );
    }
    if !timed {
        text.push_str("\nfunctional: nothing is timed\n");
    }
    if is_estimated {
        text.push_str("\nlimited by: what each limit alone would take, in percent of the time; those that are close add up in part\n");
    }
    if let Some(error) = &report.image.error {
        let _ = write!(text, "\n{}\n", error_line(error));
    }
    for warning in &report.warnings {
        let _ = write!(text, "\nwarning: {}\n", warning.message);
    }
    text
}

/// How far the picture is from its reference.
fn error_line(error: &ImageError) -> String {
    format!(
        "error by {} (their own {:.4}): mean {:.4}, rmse {:.4}, p99 {:.3}, max {:.3}, bias {:+.4}, {:.2}% > 0.25",
        counted(error.samples.into(), "ray"),
        error.reference_mean,
        error.mean,
        error.rmse,
        error.p99,
        error.max,
        error.bias,
        error.off_by_quarter * 100.0
    )
}

/// Which scene, machine, algorithm and fidelity.
fn heading(text: &mut String, report: &RunReport) {
    let machine = &report.machine;
    let scene = &report.scene;
    let cores = if machine.cores == 1 { "core" } else { "cores" };
    let _ = write!(
        text,
        "{} on {} ({} {cores} at {} GHz), {}, {}\n{} x {} pixels, {}, {}, {}\n",
        scene.name,
        machine.name,
        machine.cores,
        machine.clock_ghz,
        report.provenance.algorithm,
        report.provenance.fidelity,
        scene.width,
        scene.height,
        counted(scene.receivers, "receiver"),
        counted(scene.triangles, "triangle"),
        counted(scene.silhouette_edges, "silhouette edge")
    );
}

type Row = Vec<String>;

fn header(timed: bool, is_estimated: bool) -> Row {
    let titles: &[&str] = if timed {
        let last = if is_estimated { "limited by" } else { "waits for" };
        &["phase", "ms", "share", "Minstr", "IPC", "lanes", "L1", "L2", last]
    } else {
        &["phase", "Minstr", "lanes"]
    };
    titles.iter().map(|title| (*title).to_owned()).collect()
}

fn row(phase: &PhaseReport, timed: bool, is_of_paper: bool) -> Row {
    let title = format!("{}{}", phase.title, if phase.in_paper_total || !is_of_paper { "" } else { " *" });
    let instructions = millions(phase.instructions.total);
    let lanes = percent(phase.lanes.active_fraction());
    if !timed {
        return vec![title, instructions, lanes];
    }
    vec![
        title,
        time(phase.ms, phase.ms_interval),
        percent_fine(phase.share),
        instructions,
        number(phase.ipc, 2),
        lanes,
        percent(phase.l1d.as_ref().and_then(hit_rate)),
        percent(phase.l2.as_ref().and_then(hit_rate)),
        phase.bounds.map_or_else(|| waits(phase), |bounds| limits(&bounds, phase.cycles)),
    ]
}

/// The greatest limits, in percent of the time of the phase.
fn limits(bounds: &Bounds, cycles: Option<u64>) -> String {
    greatest(bounds.named().into_iter(), cycles.unwrap_or(0))
}

/// The greatest of named parts of `all`, in percent; equal ones stay in their order.
pub(crate) fn greatest(parts: impl Iterator<Item = (&'static str, u64)>, all: u64) -> String {
    let mut parts: Vec<(&str, f64)> = parts
        .filter(|(_, cycles)| *cycles > 0)
        .map(|(name, cycles)| (name, cycles as f64 / all as f64))
        .filter(|(_, part)| *part >= CAUSE_PART_MIN)
        .collect();
    parts.sort_by(|a, b| b.1.total_cmp(&a.1));
    parts.truncate(CAUSES_MAX);
    let named: Vec<String> =
        parts.iter().map(|(name, part)| format!("{name} {:.0}%", part * 100.0)).collect();
    if named.is_empty() { "-".to_owned() } else { named.join(", ") }
}

/// Milliseconds, and how far they may be off where they were extrapolated: `1.234 ± 0.050`.
fn time(ms: Option<f64>, interval: Option<[f64; 2]>) -> String {
    match interval {
        None => number(ms, 3),
        Some(interval) => format!("{} ± {:.3}", number(ms, 3), half_interval(ms.unwrap_or(0.0), interval)),
    }
}

/// The causes that core-cycles without an instruction were lost to, the greatest first.
fn waits(phase: &PhaseReport) -> String {
    let Some(stack) = &phase.cycle_stack else { return String::new() };
    let causes = stack.iter().filter(|(cause, _)| *cause != Cause::Issue);
    greatest(causes.map(|(cause, cycles)| (label(cause), cycles)), stack.total())
}

/// A cause as people read it.
pub(crate) fn label(cause: Cause) -> &'static str {
    match cause {
        Cause::L1 => "L1",
        Cause::L2 => "L2",
        Cause::Mshr => "MSHR",
        Cause::Tlb => "TLB",
        Cause::GatherLines => "gather lines",
        // Threads without a task wait there too.
        Cause::Barrier => "barrier/idle",
        Cause::Issue
        | Cause::Dependency
        | Cause::Remote
        | Cause::Ring
        | Cause::Memory
        | Cause::Atomic
        | Cause::Queue => cause.name(),
    }
}

fn totals(report: &RunReport, timed: bool) -> Vec<Row> {
    let total = &report.total;
    let instructions = millions(report.phases.iter().map(|phase| phase.instructions.total).sum());
    if !timed {
        return vec![vec!["total".to_owned(), instructions]];
    }
    let line = |title: &str, ms: String, share: &str, instructions: String, fps: Option<f64>| {
        let mut row = vec![title.to_owned(), ms, share.to_owned(), instructions];
        row.extend([const { String::new() }; 4]);
        row.push(fps.map_or(String::new(), |fps| format!("{fps:.1} fps")));
        row
    };
    let paper_instructions =
        report.phases.iter().filter(|phase| phase.in_paper_total).map(|phase| phase.instructions.total).sum();
    let paper_share =
        percent_fine(total.ms.filter(|ms| *ms > 0.0).zip(total.paper_ms).map(|(all, paper)| paper / all));
    let mut lines = vec![line(
        "total",
        time(total.ms, total.ms_interval),
        &percent_fine(Some(1.0)),
        instructions,
        total.fps,
    )];
    if are_of_paper(&report.phases) {
        lines.push(line(
            "paper's total",
            time(total.paper_ms, total.paper_ms_interval),
            &paper_share,
            millions(paper_instructions),
            total.paper_fps,
        ));
    }
    lines
}

/// Aligns columns: the first and the last to the left, numbers to the right; a rule below the header and above the totals.
fn lay_out(text: &mut String, rows: &[Row], phase_rows: usize) {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns)
        .map(|c| rows.iter().filter_map(|row| row.get(c)).map(|s| s.chars().count()).max().unwrap_or(0))
        .collect();
    let width = (widths.iter().sum::<usize>() + 2 * columns.saturating_sub(1)).min(WIDTH_MAX);
    let last_is_text = columns > 3;
    for (index, row) in rows.iter().enumerate() {
        if index == 1 || index == phase_rows {
            text.push_str(&"-".repeat(width));
            text.push('\n');
        }
        let mut line = String::new();
        for (column, cell) in row.iter().enumerate() {
            if column > 0 {
                line.push_str("  ");
            }
            let pad = " ".repeat(widths[column] - cell.chars().count());
            if column == 0 || (last_is_text && column + 1 == columns) {
                line.push_str(cell);
                line.push_str(&pad);
            } else {
                line.push_str(&pad);
                line.push_str(cell);
            }
        }
        // A title of unforeseen length may not break the layout of a terminal.
        text.push_str(&clipped(line.trim_end()));
        text.push('\n');
    }
}

/// `line` in at most [`WIDTH_MAX`] columns, without half a percentage at its end.
fn clipped(line: &str) -> String {
    let mut clipped: String = line.chars().take(WIDTH_MAX).collect();
    if clipped.len() < line.len()
        && let Some(end) = clipped.rfind(", ")
    {
        clipped.truncate(end);
    }
    clipped
}

fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}"))
}

fn percent(part: Option<f64>) -> String {
    part.map_or_else(|| "-".to_owned(), |part| format!("{:.0}%", part * 100.0))
}

fn percent_fine(part: Option<f64>) -> String {
    part.map_or_else(|| "-".to_owned(), |part| format!("{:.1}%", part * 100.0))
}

fn millions(count: u64) -> String {
    format!("{:.2}", count as f64 / 1e6)
}

/// `1234567` as `1 234 567`.
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// `1 triangle`, `1 234 triangles`.
pub fn counted(count: u64, thing: &str) -> String {
    format!("{} {thing}{}", grouped(count), if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{golden, sample};

    #[test]
    fn the_table_of_a_timed_run_does_not_change_unnoticed() {
        golden::check("table.txt", &render(&sample::timed()));
    }

    #[test]
    fn the_table_of_a_functional_run_does_not_change_unnoticed() {
        golden::check("table_functional.txt", &render(&sample::functional()));
    }

    #[test]
    fn a_picture_that_was_judged_has_a_line_of_its_error() {
        let line = "error by 256 rays (their own 0.0032): mean 0.0123, rmse 0.0345, p99 0.210, max 0.512, bias -0.0034, 0.12% > 0.25";
        assert_eq!(render(&sample::judged()), format!("{}\n{line}\n", render(&sample::timed())));
    }

    #[test]
    fn no_line_is_wider_than_a_terminal() {
        let mut report = sample::judged();
        report.image.error.as_mut().expect("judged").samples = 65_536;
        for phase in &mut report.phases {
            phase.ms = Some(123_456.789);
            phase.instructions.total = 99_999_990_000;
            phase.cycle_stack = Some(lrbsim_machine::CycleStack {
                gather_lines: 100,
                dependency: 100,
                barrier: 100,
                ..Default::default()
            });
        }
        for line in render(&report).lines() {
            assert!(line.chars().count() <= WIDTH_MAX, "{line}");
            assert!(!line.contains("gather") || line.ends_with('%'), "{line}");
        }
    }

    #[test]
    fn waiting_for_the_end_of_a_step_is_not_taken_for_the_cost_of_its_barrier() {
        let mut report = sample::timed();
        report.phases[0].cycle_stack =
            Some(lrbsim_machine::CycleStack { issue: 20, barrier: 80, ..Default::default() });
        assert!(render(&report).contains("  barrier/idle 80%\n"));
    }

    #[test]
    fn one_of_a_thing_has_no_plural() {
        assert_eq!(
            [0, 1, 1234].map(|n| counted(n, "triangle")),
            ["0 triangles", "1 triangle", "1 234 triangles"]
        );
    }

    #[test]
    fn an_empty_frame_has_a_table() {
        let mut report = sample::timed();
        report.phases.clear();
        report.total = crate::run::Total::of_phases(&[], 1.0);
        assert!(render(&report).contains("total"));
    }

    #[test]
    fn digits_are_grouped_by_thousands() {
        assert_eq!(
            (grouped(12), grouped(123), grouped(1234), grouped(1_234_567)),
            ("12".to_owned(), "123".to_owned(), "1 234".to_owned(), "1 234 567".to_owned())
        );
    }
}
