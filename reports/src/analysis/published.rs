//! What was measured beside what others published of the same points.

use super::{Data, Finding};
use crate::metric::{title, unit};
use crate::plot::{Bar, Bars, Plot};
use crate::sheet::{Cell, Sheet, show_value};
use crate::study::{Published, named, same};

pub(super) fn published(data: &Data, published: &[Published]) -> Finding {
    let mut columns = data.axes.clone();
    columns.extend(["number", "measured", "published", "ratio"].map(str::to_owned));
    let (mut rows, mut bars, mut sources) = (Vec::new(), Vec::new(), Vec::new());
    // Of numbers of several units the bars are those of the first: more is better in one and worse in another.
    let mut drawn = None;
    for Published { source, point, numbers } in published {
        if !sources.contains(source) {
            sources.push(source.clone());
        }
        let is_it = |values: &[serde_json::Value]| {
            data.axes.iter().zip(values).all(|(axis, value)| {
                point.get(axis).is_none_or(|of_axis| named(of_axis).iter().any(|one| same(one, value)))
            })
        };
        for row in data.rows.iter().filter(|row| is_it(row.values)) {
            for (path, theirs) in numbers {
                let ours = row.numbers.get(path);
                let ratio = ours.map(|ours| ours / theirs).filter(|ratio| ratio.is_finite());
                let mut cells: Vec<Cell> = row.values.iter().map(Cell::value).collect();
                cells.push(Cell::Text(title(path)));
                cells.extend([Cell::maybe(ours), Cell::Number(*theirs), Cell::maybe(ratio)]);
                rows.push(cells);
                let names: Vec<String> = row.values.iter().map(show_value).collect();
                let name = format!("{}: {}", names.join(", "), title(path));
                let Some(to) = ratio else { continue };
                if drawn.get_or_insert_with(|| unit(path)) == &unit(path) {
                    bars.push(Bar { name, from: 0.0, to });
                }
            }
        }
    }
    let mut notes = vec![format!("Published: {}.", sources.join("; "))];
    if rows.is_empty() {
        notes = vec![
            "Nothing is shown: no point that has a result is one of those that `published` names.".to_owned(),
        ];
    }
    let of = drawn.flatten().map_or(String::new(), |unit| format!(", of {unit}"));
    let label = format!("measured / published{of}");
    Finding {
        name: "published".to_owned(),
        title: "Beside what was published".to_owned(),
        notes,
        sheet: Sheet { columns, rows },
        plot: (!bars.is_empty()).then(|| Plot::Bars(Bars { title: label.clone(), label, bars })),
    }
}
