//! `report.html`: one page for a run, a study or a moving scene that needs nothing else, not even a network.
//!
//! The page holds the JSON it was made of, and draws itself from it: whatever it shows stands there, or is a ratio of
//! two numbers that do.

use lrbsim_machine::{MachineConfig, builtin_machine};
use serde::Serialize;
use serde_json::Value;

use crate::analysis::{Finding, findings};
use crate::base64;
use crate::digest::Digest;
use crate::fidelity::PriceList;
use crate::frames::FramesReport;
use crate::host::HostReport;
use crate::picture::{ERROR_COLORS, ERROR_SCALE_END};
use crate::run::RunReport;
use crate::sheet::{Cell, Sheet};
use crate::stability::{COLUMNS, StabilityPoint, StabilityReport};
use crate::table3::{Quality, Table3Report};

const HTML: &str = include_str!("page.html");
const CSS: &str = include_str!("page.css");
const CHARTS: &str = include_str!("charts.js");
const PAGE: &str = include_str!("page.js");

/// A picture for a page.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Picture {
    /// What the picture shows, as its caption.
    pub title: String,
    /// The picture itself as a data URL.
    url: String,
}

impl Picture {
    /// A picture of these bytes (PNG).
    pub fn png(title: &str, bytes: &[u8]) -> Picture {
        Picture { title: title.to_owned(), url: format!("data:image/png;base64,{}", base64::encode(bytes)) }
    }
}

/// Pictures by which a reference judges that of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// The picture as the reference has it.
    pub truth: Picture,
    /// Where the two differ, as [`crate::picture::error_png`] draws it.
    pub difference: Picture,
}

/// The page of a run. Of `pictures`, the one titled `shaded` is compared with those of `judged`.
pub fn of_run(
    report: &RunReport,
    host: Option<&HostReport>,
    pictures: &[Picture],
    judged: Option<&Judged>,
) -> String {
    let title = format!("{} on {}", report.scene.name, report.machine.name);
    let data = serde_json::json!({
        "kind": "run",
        "title": title,
        "report": report,
        "presets": presets([report].into_iter()),
        "host": host,
        "pictures": pictures,
        "judged": judged,
        "scale": {"end": ERROR_SCALE_END, "dark": ERROR_COLORS[0], "light": ERROR_COLORS[1]},
    });
    page(&title, &data)
}

/// The page of a moving scene: all frames, and the report and pictures of the worst.
pub fn of_frames(frames: &FramesReport, worst: &RunReport, all: &[Picture], pictures: &[Picture]) -> String {
    let title = format!("{} on {}, {} frames", frames.scene, frames.machine, frames.frames.len());
    let data = serde_json::json!({
        "kind": "frames",
        "title": title,
        "frames": frames,
        "report": worst,
        "presets": presets([worst].into_iter()),
        "pictures": all,
        "worst": pictures,
    });
    page(&title, &data)
}

/// The page of a study.
pub fn of_study(digest: &Digest) -> String {
    let study = &digest.study;
    let findings: Vec<Value> = findings(digest).iter().map(finding).collect();
    let reports = study.points.iter().filter_map(|point| point.report.as_ref());
    let data = serde_json::json!({
        "kind": "study",
        "title": study.study.name,
        "study": study,
        "left_out": digest.left_out,
        "presets": presets(reports),
        "findings": findings,
    });
    page(&study.study.name, &data)
}

/// The page of a study of stability.
pub fn of_stability(report: &StabilityReport) -> String {
    let about: Vec<Value> = report
        .families
        .iter()
        .map(|family| {
            let verdicts: Vec<&str> = family.points.iter().map(StabilityPoint::verdict).collect();
            serde_json::json!({"varied": family.varied, "meaning": family.meaning, "verdicts": verdicts})
        })
        .collect();
    let more = serde_json::json!({"kind": "stability", "report": report, "about": about, "columns": COLUMNS});
    of_made("How stable the pictures are", &report.introduction(), &report.findings(), more)
}

/// The page of the study of Table 3.
pub fn of_table3(report: &Table3Report) -> String {
    let qualities = Quality::ALL.map(|quality| {
        let holds = |figure: f64| quality.holds(figure);
        let ticks: Vec<Vec<bool>> =
            report.all().map(|row| row.of(quality).map(|case| holds(case.figure)).collect()).collect();
        serde_json::json!({"id": quality, "about": [quality.measured(), quality.limit()], "ticks": ticks})
    });
    let more = serde_json::json!({"kind": "table3", "report": report, "qualities": qualities});
    of_made("Visual qualities, by measurement", &report.introduction(), &report.findings(), more)
}

/// The page of the study of fidelity.
pub fn of_fidelity(list: &PriceList) -> String {
    let more = serde_json::json!({"kind": "fidelity", "report": list.errors, "prices": list.host});
    of_made("What fidelity costs", &list.introduction(), &list.findings(), more)
}

/// The page of a study that is no product of axes; `data` is what its kind has beside what all have.
fn of_made(title: &str, introduction: &[String], findings: &[Finding], mut data: Value) -> String {
    data["title"] = title.into();
    data["introduction"] = introduction.into();
    data["findings"] = findings.iter().map(finding).collect();
    page(title, &data)
}

/// A finding as the page takes it.
fn finding(finding: &Finding) -> Value {
    serde_json::json!({
        "name": finding.name,
        "title": finding.title,
        "notes": finding.notes,
        "sheet": sheet(&finding.sheet),
        "svg": finding.plot.as_ref().map(|plot| plot.svg_without_font()),
    })
}

/// A sheet as the page takes it: numbers stay numbers, so that they sort as such.
fn sheet(sheet: &Sheet) -> Value {
    let cell = |cell: &Cell| match cell {
        Cell::Text(text) => Value::from(text.as_str()),
        Cell::Number(number) => Value::from(*number),
        Cell::Chosen(number) => serde_json::json!({"value": number, "show": cell.shown()}),
        Cell::Missing => Value::Null,
    };
    let rows: Vec<Vec<Value>> = sheet.rows.iter().map(|row| row.iter().map(cell).collect()).collect();
    serde_json::json!({"columns": sheet.columns, "rows": rows})
}

/// The shipped machines that these were made from, by name, to tell what differs.
fn presets<'a>(reports: impl Iterator<Item = &'a RunReport>) -> Value {
    let mut presets = serde_json::Map::new();
    for report in reports {
        let name = &report.machine.name;
        if let Some(text) = builtin_machine(name)
            && !presets.contains_key(name)
        {
            let preset: MachineConfig = serde_json::from_str(text).expect("what is shipped can be read");
            presets.insert(name.clone(), serde_json::to_value(preset).expect("string keys"));
        }
    }
    Value::Object(presets)
}

/// Puts the page together.
fn page(title: &str, data: &Value) -> String {
    // Text of the data may hold anything; in this form it can end no script and open no comment.
    let data = data
        .to_string()
        .replace('<', "\\u003c")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029");
    let title = title.replace('&', "&amp;").replace('<', "&lt;");
    // In this order, no part can be mistaken for the place of another: the data come last.
    HTML.replace("{{title}}", &title)
        .replace("{{css}}", CSS)
        .replace("{{charts}}", CHARTS)
        .replace("{{page}}", PAGE)
        .replace("{{data}}", &data)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    #[test]
    fn a_page_needs_no_network_and_holds_its_report() {
        let report = sample::timed();
        let html = of_run(&report, None, &[Picture::png("picture", b"not really")], None);
        let plain = html.replace("http://www.w3.org/2000/svg", "");
        assert!(!plain.contains("http://") && !plain.contains("https://") && !plain.contains("{{"));
        let start = html.find("id=\"data\">").expect("the data") + "id=\"data\">".len();
        let end = start + html[start..].find("</script>").expect("its end");
        let data: Value = serde_json::from_str(&html[start..end]).expect("sound JSON");
        let held: RunReport = serde_json::from_value(data["report"].clone()).expect("the report");
        assert_eq!(held, report);
        assert_eq!(data["presets"]["larrabee-24"]["cores"], 24);
    }

    #[test]
    fn the_page_knows_every_cause_by_its_name_and_a_color_of_its_own() {
        let list = |name: &str| -> Vec<String> {
            let (_, rest) = CHARTS.split_once(&format!("const {name} = ")).expect("a list of the page");
            serde_json::from_str(rest.split_once(';').expect("its end").0).expect("strings")
        };
        assert_eq!(list("CAUSES"), lrbsim_machine::Cause::ALL.map(lrbsim_machine::Cause::name));
        let mut colors = list("COLORS");
        colors.sort_unstable();
        colors.dedup();
        assert_eq!(colors.len(), lrbsim_machine::Cause::COUNT);
    }

    #[test]
    fn names_cannot_end_the_script() {
        let mut report = sample::timed();
        report.scene.name = "</script><script>alert(1)</script>{{data}}".to_owned();
        let html = of_run(&report, None, &[], None);
        assert!(!html.contains("<script>alert"), "a name became a script");
    }

    #[test]
    fn a_page_of_a_study_has_its_findings() {
        let study = crate::analysis::tests::study(
            &["cores"],
            &["speedup"],
            &[(&[Value::from(1)], 8.0), (&[Value::from(2)], 5.0)],
        );
        let html = of_study(&Digest::of(&study));
        assert!(html.contains("\"name\":\"speedup\"") && html.contains("\\u003csvg"));
    }
}
