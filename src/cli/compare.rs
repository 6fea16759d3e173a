//! `lrbsim compare`.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use lrbsim::BadInput;
use lrbsim::written::{Changes, Results, Written};
use lrbsim_reports::compare::{percent_text, render};
use lrbsim_reports::sheet::{Cell, Sheet};
use lrbsim_reports::table::counted;

use super::Failure;

#[derive(Debug, Args)]
pub(crate) struct CompareArgs {
    /// Results before: the folder of a run or a study, or its report.json or study.json.
    a: PathBuf,

    /// Results after, of the same kind.
    b: PathBuf,

    /// Exit with code 1 when B, or any point of it, takes more than this many percent more time than A; of times that were
    /// extrapolated, when 95 % confidence says so.
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    fail_above: Option<f64>,

    /// Print the comparison as JSON on standard output, and nothing else there.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &CompareArgs, out: &mut impl Write) -> Result<bool, Failure> {
    if args.fail_above.is_some_and(|percent| !percent.is_finite()) {
        return Err(BadInput::new("`--fail-above` must be a finite number of percent, such as 5").into());
    }
    let [a, b] = [&args.a, &args.b].map(|path| Written::load(path));
    let (a, b) = (a?, b?);
    let changes = Changes::between(&a, &b)?;
    let slowdowns = changes.slowdowns_percent();
    if args.fail_above.is_some() && slowdowns.is_none() {
        return Err(BadInput::new("`--fail-above`: nothing is timed in one of the two")
            .with_help("compare runs of a fidelity other than `functional`")
            .into());
    }
    let passed =
        args.fail_above.zip(slowdowns).is_none_or(|(most, [[change, half], _])| change - half <= most);
    if args.json {
        let points: Vec<_> = changes
            .points
            .iter()
            .map(|(values, change)| serde_json::json!({"values": values, "comparison": change}))
            .collect();
        let all = serde_json::json!({"comparison": changes.whole, "points": points, "passed": passed});
        writeln!(out, "{}", serde_json::to_string_pretty(&all).expect("string keys"))?;
        return Ok(passed);
    }
    writeln!(out, "A: {}\nB: {}\n", args.a.display(), args.b.display())?;
    if let Results::Study(study) = &a.results {
        let axes: Vec<String> = study.study.axes.iter().map(|axis| axis.path.clone()).collect();
        writeln!(out, "{}", points_sheet(&axes, &changes).terminal())?;
        if changes.unmatched > 0 {
            writeln!(out, "{} with results on one side only.\n", counted(changes.unmatched as u64, "point"))?;
        }
        writeln!(out, "The sum over these points:\n")?;
    }
    write!(out, "{}", render(&changes.whole))?;
    if let Some((most, [certain, possible])) = args.fail_above.zip(slowdowns) {
        let word = if passed { "passed" } else { "FAILED" };
        let change = percent_text(certain, 2);
        writeln!(out, "\n{word}: the greatest change is {change} %, at most {most:+} % is allowed")?;
        if passed && possible[0] + possible[1] > most {
            let change = percent_text(possible, 2);
            writeln!(
                out,
                "A change of {change} % may be above that: `windowed` tells, or `sampled` with a smaller error."
            )?;
        }
    }
    Ok(passed)
}

fn points_sheet(axes: &[String], changes: &Changes) -> Sheet {
    let mut columns = axes.to_vec();
    columns.extend(["A, ms", "B, ms", "change, %"].map(str::to_owned));
    let extrapolated =
        changes.points.iter().any(|(_, change)| change.total.is_some_and(|total| total.is_extrapolated()));
    if extrapolated {
        columns.push("\u{b1}, %".to_owned());
    }
    let rows = changes.points.iter().map(|(values, change)| {
        let mut row: Vec<Cell> = values.iter().map(Cell::value).collect();
        let total = change.total;
        row.push(Cell::maybe(total.map(|total| total.a_ps as f64 / 1e9)));
        row.push(Cell::maybe(total.map(|total| total.b_ps as f64 / 1e9)));
        let percent = total.and_then(|total| total.percent());
        row.push(Cell::maybe(percent.map(|[change, _]| change)));
        if extrapolated {
            row.push(Cell::maybe(percent.map(|[_, half]| half)));
        }
        row
    });
    Sheet { columns, rows: rows.collect() }
}
