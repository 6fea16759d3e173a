//! What stops each phase: where its cycles go at the greatest x, and what it gained on the way there.

use lrbsim_machine::Cause;

use super::{Data, Finding};
use crate::metric::title;
use crate::sheet::{Cell, Sheet};
use crate::study::Analysis;
use crate::table::{greatest, label};

pub(super) fn limits(data: &Data, analysis: &Analysis) -> Finding {
    let (x, y) = (data.x(analysis), data.y(analysis));
    let groups = data.groups(&x);
    let columns = ["of", "phase", "part of all, %", "speedup", "ideal", "issues, %", "waits for"];
    let mut sheet = Sheet { columns: columns.map(str::to_owned).to_vec(), rows: Vec::new() };
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for (group, rows) in &groups {
        let at = |row: &&&super::Row| data.number(row, &x).unwrap_or(f64::NAN);
        let mut rows: Vec<&&super::Row> = rows.iter().filter(|row| at(row).is_finite()).collect();
        rows.sort_by(|a, b| at(a).total_cmp(&at(b)));
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { continue };
        (least, most) = (least.min(at(first)), most.max(at(last)));
        let paths = data.with_phases(&y);
        let whole = data.number(last, &paths[0]).unwrap_or(f64::NAN);
        for (id, path) in data.phases.iter().zip(&paths[1..]) {
            let times = [first, last].map(|row| data.number(row, path).filter(|time| *time > 0.0));
            let [Some(before), Some(now)] = times else { continue };
            let stack = Cause::ALL.map(|cause| {
                let cycles = data.number(last, &format!("phases.{id}.cycle_stack.{}", cause.name()));
                (cause, cycles.unwrap_or(0.0) as u64)
            });
            let all: u64 = stack.iter().map(|(_, cycles)| cycles).sum();
            let (issue, waits): (Vec<_>, Vec<_>) =
                stack.into_iter().partition(|(cause, _)| *cause == Cause::Issue);
            let waits = waits.into_iter().map(|(cause, cycles)| (label(cause), cycles));
            sheet.rows.push(vec![
                Cell::Text(group.clone()),
                Cell::Text(id.clone()),
                Cell::Number(100.0 * now / whole),
                Cell::Number(before / now),
                Cell::Number(at(last) / at(first)),
                Cell::maybe((all > 0).then(|| 100.0 * issue[0].1 as f64 / all as f64)),
                Cell::Text(greatest(waits, all)),
            ]);
        }
    }
    let notes = if sheet.rows.is_empty() {
        vec![data.why_nothing(&x, &y)]
    } else {
        vec![format!(
            "Where the cycles of all cores go at the greatest {x}, and how many times as fast each phase is there as at the least; ideal is as many times as {x} is greater. Phases whose own tasks are too few, or of which one is long, wait at their barriers."
        )]
    };
    Finding {
        name: "limits".to_owned(),
        title: format!("What limits each phase at the greatest {}", title(&x)),
        notes,
        sheet,
        plot: None,
    }
}
