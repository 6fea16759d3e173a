//! What changed between two runs, by phase and cause; the parts add up to the whole, to the picosecond.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use lrbsim_machine::Cause;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use crate::run::{ImageError, PhaseReport, RunReport, half_interval};
use crate::sheet::{Cell, Sheet, show_value, signed};

/// Causes that are named beside a phase, at most.
const CAUSES_MAX: usize = 3;

/// What changed from a run A to a run B.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Comparison {
    /// Time of the frame; null unless both runs are timed.
    pub total: Option<Change>,
    /// Time of each phase of either run. Changes add up to that of the total.
    pub phases: Vec<PhaseChange>,
    /// Change of time by cause, over all phases; adds up to that of the total. Picoseconds.
    pub causes_ps: BTreeMap<String, i64>,
    /// What differs between the inputs.
    pub inputs: Vec<Difference>,
    /// What differs between the pictures.
    pub picture: PictureChange,
    /// How errors of the pictures changed; empty unless both runs were judged by a reference.
    pub errors: Vec<ErrorChange>,
}

/// One measure of two pictures' errors.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ErrorChange {
    /// Name of the measure, as below `image.error` in a report.
    pub name: String,
    /// Error of the picture of run A, as a part of the light.
    pub a: f64,
    /// Error of the picture of run B, as a part of the light.
    pub b: f64,
    /// Error in run B less that in run A, as a part of the light.
    pub change: f64,
}

/// Two times and their difference, in picoseconds of simulated time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Change {
    /// Picoseconds in run A.
    pub a_ps: i64,
    /// Picoseconds in run B.
    pub b_ps: i64,
    /// Picoseconds in run B less those in run A.
    pub change_ps: i64,
    /// How far `a_ps` and `b_ps` may be off, with 95 % confidence, where some of them was extrapolated from a sample; 0 where every task was
    /// timed, and of two runs of the same inputs, whose samples are the same. Picoseconds.
    pub half_intervals_ps: [i64; 2],
}

/// What changed in one phase.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct PhaseChange {
    /// Stable name of the phase.
    pub id: String,
    /// Title of the phase for people.
    pub title: String,
    /// Time of the phase in both runs.
    pub time: Change,
    /// Change of its time by cause; adds up to that of the phase. Picoseconds.
    pub causes_ps: BTreeMap<String, i64>,
}

/// One input that differs.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Difference {
    /// Path of the input in the report.
    pub path: String,
    /// Value of the input in run A; null where it is missing.
    pub a: Value,
    /// Value of the input in run B; null where it is missing.
    pub b: Value,
}

/// What differs between two pictures.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum PictureChange {
    /// Bit for bit the same visibility.
    Same,
    /// The pictures differ, and are not there themselves to tell by how much.
    Differs,
    /// The pictures have other sizes.
    OtherSize,
    /// Visibility differs, in steps of 1/255.
    By {
        /// How many pixels differ.
        pixels: u64,
        /// Part of all pixels, in [0, 1].
        part: f64,
        /// Root of the mean square difference over all pixels, in [0, 1].
        rmse: f64,
        /// Greatest difference of a pixel, in [0, 1].
        greatest: f64,
    },
}

impl Change {
    fn new(a_ps: i64, b_ps: i64, half_intervals_ps: [i64; 2]) -> Change {
        Change { a_ps, b_ps, change_ps: b_ps - a_ps, half_intervals_ps }
    }

    /// Change in percent of A, and how far it may be off; `None` when A took no time.
    pub fn percent(&self) -> Option<[f64; 2]> {
        let of_a = |ps: f64| ps / self.a_ps as f64;
        let [a, b] = self.half_intervals_ps.map(|ps| of_a(ps as f64));
        // The change is a ratio, in which what A is off by counts as often as B is longer.
        let a = a * of_a(self.b_ps as f64);
        (self.a_ps > 0).then(|| [100.0 * of_a(self.change_ps as f64), 100.0 * (a * a + b * b).sqrt()])
    }

    /// Whether some of either time was extrapolated from a sample.
    pub fn is_extrapolated(&self) -> bool {
        self.half_intervals_ps != [0, 0]
    }

    fn add(&mut self, other: Change) {
        let half = |side: usize| together(self.half_intervals_ps[side], other.half_intervals_ps[side]);
        *self = Change::new(self.a_ps + other.a_ps, self.b_ps + other.b_ps, [half(0), half(1)]);
    }
}

/// Half of the interval of a sum of two times whose errors do not depend on one another.
fn together(a_ps: i64, b_ps: i64) -> i64 {
    let [a, b] = [a_ps, b_ps].map(|ps| ps as f64);
    (a * a + b * b).sqrt().round() as i64
}

/// Compares two runs; `picture` is what differs between their pictures.
pub fn compare(a: &RunReport, b: &RunReport, picture: PictureChange) -> Comparison {
    let timed = a.total.cycles.is_some() && b.total.cycles.is_some();
    let times = [a, b].map(phase_times);
    let empty = Times::default();
    let mut ids: Vec<(&str, &str)> = Vec::new();
    for phase in a.phases.iter().chain(&b.phases) {
        if !ids.iter().any(|(id, _)| *id == phase.id) {
            ids.push((&phase.id, &phase.title));
        }
    }
    let mut phases = Vec::new();
    for (id, title) in ids.into_iter().filter(|_| timed) {
        let [a, b] = [0, 1].map(|side: usize| times[side].get(id).unwrap_or(&empty));
        let causes = Cause::ALL
            .iter()
            .enumerate()
            .map(|(i, cause)| (cause.name().to_owned(), b.causes[i] - a.causes[i]));
        phases.push(PhaseChange {
            id: id.to_owned(),
            title: title.to_owned(),
            time: Change::new(a.ps, b.ps, [a.half_interval_ps, b.half_interval_ps]),
            causes_ps: causes.collect(),
        });
    }
    let (causes_ps, errors, inputs) = (BTreeMap::new(), errors(a, b), inputs(a, b));
    if inputs.is_empty() {
        // The same sample, so nothing that its choice adds.
        phases.iter_mut().for_each(|phase: &mut PhaseChange| phase.time.half_intervals_ps = [0, 0]);
    }
    let mut comparison = Comparison { total: None, phases, causes_ps, inputs, picture, errors };
    comparison.add_up(timed);
    comparison
}

/// The sum of several comparisons, without inputs: those of points differ.
pub fn sum(parts: &[Comparison]) -> Comparison {
    let mut phases: Vec<PhaseChange> = Vec::new();
    for part in parts.iter().flat_map(|part| &part.phases) {
        match phases.iter_mut().find(|phase| phase.id == part.id) {
            None => phases.push(part.clone()),
            Some(phase) => {
                phase.time.add(part.time);
                for (cause, ps) in &part.causes_ps {
                    *phase.causes_ps.entry(cause.clone()).or_default() += ps;
                }
            }
        }
    }
    let same = parts.iter().all(|part| part.picture == PictureChange::Same);
    let picture = if same { PictureChange::Same } else { PictureChange::Differs };
    let mut all = Comparison {
        total: None,
        phases,
        causes_ps: BTreeMap::new(),
        inputs: Vec::new(),
        picture,
        // Of another picture at each point: they do not add up.
        errors: Vec::new(),
    };
    all.add_up(parts.iter().any(|part| part.total.is_some()));
    all
}

impl Comparison {
    fn add_up(&mut self, timed: bool) {
        let mut total = Change::default();
        for phase in &self.phases {
            total.add(phase.time);
            for (cause, ps) in &phase.causes_ps {
                *self.causes_ps.entry(cause.clone()).or_default() += ps;
            }
        }
        self.total = timed.then_some(total);
    }
}

/// Picoseconds of a phase.
#[derive(Debug, Default)]
struct Times {
    ps: i64,
    /// Half of the interval, 0 where all of the phase was timed.
    half_interval_ps: i64,
    /// Parts of `ps` by cause, in the order of [`Cause::ALL`].
    causes: [i64; Cause::COUNT],
}

/// Times of the phases by their ids.
fn phase_times(report: &RunReport) -> BTreeMap<&str, Times> {
    let picoseconds = |cycles: u64| (cycles as f64 * 1000.0 / report.machine.clock_ghz).round() as i64;
    let cycles: Vec<u64> = report.phases.iter().map(|phase| phase.cycles.unwrap_or(0)).collect();
    let parts = shared_out(picoseconds(cycles.iter().sum()), &cycles);
    let times = report.phases.iter().zip(parts).map(|(phase, ps)| {
        let half = phase.ms.zip(phase.ms_interval).map_or(0.0, |(ms, interval)| half_interval(ms, interval));
        let half_interval_ps = (half * PS_IN_MS).round() as i64;
        (phase.id.as_str(), Times { ps, half_interval_ps, causes: cause_times(phase, ps) })
    });
    times.collect()
}

fn cause_times(phase: &PhaseReport, ps: i64) -> [i64; Cause::COUNT] {
    let mut cycles = [0; Cause::COUNT];
    if let Some(stack) = &phase.cycle_stack {
        for (cause, count) in stack.iter() {
            cycles[cause as usize] = count;
        }
    }
    shared_out(ps, &cycles).try_into().expect("a part for each cause")
}

/// `whole` in whole parts that stand to each other as `weights` and add up to it: the largest remainders are rounded
/// up.
fn shared_out(whole: i64, weights: &[u64]) -> Vec<i64> {
    let sum: u128 = weights.iter().map(|weight| u128::from(*weight)).sum();
    if sum == 0 {
        return vec![0; weights.len()];
    }
    let exact = |weight: &u64| whole as u128 * u128::from(*weight);
    let mut parts: Vec<i64> = weights.iter().map(|weight| (exact(weight) / sum) as i64).collect();
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by_key(|index| std::cmp::Reverse(exact(&weights[*index]) % sum));
    let missing = whole - parts.iter().sum::<i64>();
    for index in order.into_iter().take(missing as usize) {
        parts[index] += 1;
    }
    parts
}

/// A measure by its name.
type Measure = (&'static str, fn(&ImageError) -> f64);

/// The measures of both pictures' errors; none unless both have them.
fn errors(a: &RunReport, b: &RunReport) -> Vec<ErrorChange> {
    let (Some(a), Some(b)) = (&a.image.error, &b.image.error) else { return Vec::new() };
    let measures: [Measure; 8] = [
        ("mean", |error| error.mean),
        ("rmse", |error| error.rmse),
        ("p99", |error| error.p99),
        ("max", |error| error.max),
        ("bias", |error| error.bias),
        ("off_by_quarter", |error| error.off_by_quarter),
        ("reference_mean", |error| error.reference_mean),
        ("reference_rmse", |error| error.reference_rmse),
    ];
    let change = |(name, of): &Measure| {
        let (a, b) = (of(a), of(b));
        ErrorChange { name: (*name).to_owned(), a, b, change: b - a }
    };
    measures.iter().map(change).collect()
}

/// What is to be said of times of which not all were found at one level, as `inputs` tell.
fn fidelities_differ(inputs: &[Difference]) -> Option<&'static str> {
    let fidelity = inputs.iter().find(|difference| difference.path == "fidelity")?;
    let level = |value: &Value| value.as_str().unwrap_or_default().split(':').next().map(str::to_owned);
    Some(if level(&fidelity.a) == level(&fidelity.b) {
        "\nThe samples differ: a change that is less than its ± may be theirs alone.\n"
    } else {
        "\nThe fidelities differ: a part of the change may be theirs. Run both at one fidelity to tell.\n"
    })
}

/// What differs between the inputs of two runs.
pub fn inputs(a: &RunReport, b: &RunReport) -> Vec<Difference> {
    let tree = |report: &RunReport| {
        let mut machine = report.machine.clone();
        machine.sources.clear();
        let scene = &report.scene;
        serde_json::json!({
            "machine": machine,
            "scene": {"name": scene.name, "triangles": scene.triangles, "width": scene.width, "height": scene.height,
                "light": scene.light, "hash": report.provenance.scene_hash},
            "algorithm": report.provenance.algorithm,
            "fidelity": report.provenance.fidelity,
            "warm_frames": report.provenance.warm_frames,
            "reference": report.image.error.map(|error| error.samples),
            "program": {"lrbsim_version": report.provenance.lrbsim_version, "semantics": report.provenance.semantics},
        })
    };
    let mut differences = Vec::new();
    differing("", &tree(a), &tree(b), &mut differences);
    differences
}

/// Leaves that differ, in the order of their names.
fn differing(path: &str, a: &Value, b: &Value, found: &mut Vec<Difference>) {
    if let (Value::Object(left), Value::Object(right)) = (a, b) {
        let names: std::collections::BTreeSet<&String> = left.keys().chain(right.keys()).collect();
        for name in names {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            differing(
                &path,
                left.get(name).unwrap_or(&Value::Null),
                right.get(name).unwrap_or(&Value::Null),
                found,
            );
        }
    } else if a != b {
        found.push(Difference { path: path.to_owned(), a: a.clone(), b: b.clone() });
    }
}

/// What differs between two pictures of visibility (PNG, 8 bits gray); `None` when they cannot be read.
pub fn picture_change(a: &[u8], b: &[u8]) -> Option<PictureChange> {
    let [a, b] = [a, b].map(|bytes| image::load_from_memory(bytes).ok().map(|picture| picture.to_luma8()));
    let (a, b) = (a?, b?);
    if a.dimensions() != b.dimensions() {
        return Some(PictureChange::OtherSize);
    }
    let (mut pixels, mut squares, mut greatest) = (0, 0_u64, 0);
    for (left, right) in a.as_raw().iter().zip(b.as_raw()) {
        let by = left.abs_diff(*right);
        pixels += u64::from(by > 0);
        squares += u64::from(by).pow(2);
        greatest = greatest.max(by);
    }
    let all = a.as_raw().len() as f64;
    Some(PictureChange::By {
        pixels,
        part: pixels as f64 / all,
        rmse: (squares as f64 / all).sqrt() / 255.0,
        greatest: f64::from(greatest) / 255.0,
    })
}

const PS_IN_MS: f64 = 1e9;

fn signed_ms(ps: i64) -> String {
    signed(ps as f64 / PS_IN_MS, 3)
}

/// A change in percent as people read it, with how far it may be off where that is not nothing: `+1.2 ± 0.3`.
pub fn percent_text([change, half]: [f64; 2], decimals: usize) -> String {
    let change = signed(change, decimals);
    if half > 0.0 { format!("{change} \u{b1} {half:.decimals$}") } else { change }
}

/// The comparison as terminal text.
pub fn render(comparison: &Comparison) -> String {
    let mut text = String::new();
    match &comparison.total {
        None => text.push_str("Nothing is timed in one of the two.\n"),
        Some(total) => {
            text.push_str(&phase_sheet(comparison, total).terminal());
            text.push('\n');
            text.push_str(&cause_sheet(comparison, total).terminal());
            if total.is_extrapolated() {
                text.push_str("\n\u{b1}: how far the change may be off, with 95 % confidence, as parts of the times were extrapolated\n");
            }
        }
    }
    let _ = match &comparison.picture {
        PictureChange::Same => writeln!(text, "\nThe pictures are the same, bit for bit."),
        PictureChange::Differs => writeln!(text, "\nThe pictures differ."),
        PictureChange::OtherSize => writeln!(text, "\nThe pictures have other sizes."),
        PictureChange::By { pixels, part, rmse, greatest } => writeln!(
            text,
            "\nThe pictures differ in {pixels} pixels ({:.2}%): visibility by {rmse:.4} (root mean square), at most {greatest:.3}.",
            part * 100.0
        ),
    };
    if !comparison.errors.is_empty() {
        let _ = write!(text, "\n{}", error_sheet(&comparison.errors).terminal());
    }
    if comparison.inputs.is_empty() {
        return text;
    }
    if comparison.inputs.iter().any(|difference| difference.path.starts_with("program.")) {
        text.push_str(
            "\nThe programs differ: a part of the change may be theirs. Run both with one program to tell.\n",
        );
    }
    if comparison.total.is_some() {
        text.push_str(fidelities_differ(&comparison.inputs).unwrap_or_default());
    }
    let rows = comparison.inputs.iter().map(|difference| {
        let cell = |value: &Value| Cell::Text(shortened(&show_value(value)));
        vec![Cell::Text(difference.path.clone()), cell(&difference.a), cell(&difference.b)]
    });
    let sheet = Sheet { columns: ["input", "A", "B"].map(str::to_owned).to_vec(), rows: rows.collect() };
    let _ = write!(text, "\n{}", sheet.terminal());
    text
}

/// A hash or an object in the width of a column.
pub fn shortened(text: &str) -> String {
    if text.chars().count() <= 40 {
        return text.to_owned();
    }
    text.chars().take(37).chain("...".chars()).collect()
}

fn phase_sheet(comparison: &Comparison, total: &Change) -> Sheet {
    let columns = ["phase", "A, ms", "B, ms", "change, ms", "change, %", "mostly"].map(str::to_owned);
    let row = |title: &str, time: &Change, causes: &BTreeMap<String, i64>| {
        let mut greatest: Vec<(&String, i64)> = causes.iter().map(|(cause, ps)| (cause, *ps)).collect();
        greatest.retain(|(_, ps)| ps.abs() as f64 >= 0.05 * time.change_ps.abs() as f64 && *ps != 0);
        greatest.sort_by_key(|(_, ps)| std::cmp::Reverse(ps.abs()));
        let causes: Vec<String> = greatest
            .iter()
            .take(CAUSES_MAX)
            .map(|(cause, ps)| format!("{} {}", cause_label(cause), signed_ms(*ps)))
            .collect();
        let percent = time.percent().map_or_else(|| "-".to_owned(), |change| percent_text(change, 1));
        vec![
            Cell::Text(title.to_owned()),
            Cell::Text(format!("{:9.3}", time.a_ps as f64 / PS_IN_MS)),
            Cell::Text(format!("{:9.3}", time.b_ps as f64 / PS_IN_MS)),
            Cell::Text(format!("{:>10}", signed_ms(time.change_ps))),
            Cell::Text(format!("{percent:>9}")),
            Cell::Text(causes.join(", ")),
        ]
    };
    let mut rows: Vec<_> =
        comparison.phases.iter().map(|phase| row(&phase.title, &phase.time, &phase.causes_ps)).collect();
    rows.push(row("total", total, &comparison.causes_ps));
    Sheet { columns: columns.to_vec(), rows }
}

fn cause_sheet(comparison: &Comparison, total: &Change) -> Sheet {
    let columns = ["what cores did", "change, ms"].map(str::to_owned).to_vec();
    let row = |name: String, ps: i64| vec![Cell::Text(name), Cell::Text(format!("{:>10}", signed_ms(ps)))];
    // In the order of stacks.
    let mut rows: Vec<_> = Cause::ALL
        .iter()
        .filter_map(|cause| Some((cause.name(), *comparison.causes_ps.get(cause.name())?)))
        .filter(|(_, ps)| *ps != 0)
        .map(|(cause, ps)| row(cause_label(cause), ps))
        .collect();
    rows.push(row("total".to_owned(), total.change_ps));
    Sheet { columns, rows }
}

/// Errors in parts of the light, with what changed.
fn error_sheet(errors: &[ErrorChange]) -> Sheet {
    let columns = ["error of the picture", "A", "B", "change"].map(str::to_owned).to_vec();
    let rows = errors.iter().map(|error| {
        vec![
            Cell::Text(error.name.replace('_', " ")),
            Cell::Text(format!("{:+.5}", error.a)),
            Cell::Text(format!("{:+.5}", error.b)),
            Cell::Text(format!("{:+.5}", error.change)),
        ]
    });
    Sheet { columns, rows: rows.collect() }
}

/// A cause as people read it.
fn cause_label(cause: &str) -> String {
    match cause {
        "l1" => "L1".to_owned(),
        "l2" => "L2".to_owned(),
        "mshr" => "MSHR".to_owned(),
        "tlb" => "TLB".to_owned(),
        "barrier" => "barrier/idle".to_owned(),
        other => other.replace('_', " "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;

    fn slower() -> RunReport {
        let mut report = sample::timed();
        report.machine.cores = 48;
        report.machine.clock_ghz = 1.1;
        for (index, phase) in report.phases.iter_mut().enumerate() {
            let stack = phase.cycle_stack.as_mut().expect("timed");
            stack.memory = stack.memory * 3 + index as u64;
            stack.barrier += 7;
            phase.cycles = phase.cycles.map(|cycles| cycles * 3 / 2 + 1);
        }
        report.total.cycles = report.phases.iter().map(|phase| phase.cycles).sum();
        report
    }

    #[test]
    fn the_parts_add_up_to_the_whole_exactly() {
        let comparison = compare(&sample::timed(), &slower(), PictureChange::Same);
        let total = comparison.total.expect("both are timed");
        assert_eq!(comparison.phases.iter().map(|phase| phase.time.change_ps).sum::<i64>(), total.change_ps);
        assert_eq!(comparison.causes_ps.values().sum::<i64>(), total.change_ps);
        for phase in &comparison.phases {
            assert_eq!(phase.causes_ps.values().sum::<i64>(), phase.time.change_ps, "{}", phase.id);
        }
        assert_eq!(total.a_ps, 10_000_000_000);
    }

    #[test]
    fn a_run_does_not_differ_from_itself() {
        let comparison = compare(&sample::timed(), &sample::timed(), PictureChange::Same);
        assert_eq!(comparison.total.expect("timed").change_ps, 0);
        assert!(comparison.causes_ps.values().all(|ps| *ps == 0) && comparison.inputs.is_empty());
    }

    #[test]
    fn intervals_of_both_sides_make_that_of_the_change() {
        let (mut a, mut b) = (sample::timed(), sample::timed());
        let widen = |phase: &mut PhaseReport, half: f64| {
            phase.ms_interval = phase.ms.map(|ms| [(ms - half).max(0.0), ms + half]);
        };
        widen(&mut a.phases[0], 0.3);
        widen(&mut b.phases[0], 0.4);
        widen(&mut b.phases[2], 1.2);
        // A run that has the same inputs has the same errors.
        assert_eq!(compare(&b, &b, PictureChange::Same).total.expect("timed").half_intervals_ps, [0, 0]);
        b.provenance.fidelity = "sampled:error=5%,seed=2".to_owned();
        let comparison = compare(&a, &b, PictureChange::Same);
        assert_eq!(comparison.phases[0].time.half_intervals_ps, [300_000_000, 400_000_000]);
        let total = comparison.total.expect("timed");
        assert_eq!((total.change_ps, total.half_intervals_ps[0]), (0, 300_000_000));
        let [change, half] = total.percent().expect("it took time");
        assert!(change == 0.0 && (half - 13.0).abs() < 1e-6, "{half}");
        assert!(render(&comparison).contains("0.0 \u{b1} 13.0"), "{}", render(&comparison));
        let timed = compare(&sample::timed(), &sample::timed(), PictureChange::Same);
        assert!(!render(&timed).contains('\u{b1}'));
    }

    #[test]
    fn a_phase_that_only_one_has_counts_whole() {
        let mut without = sample::timed();
        without.phases.remove(2);
        without.total.cycles = Some(4_000_000);
        let comparison = compare(&sample::timed(), &without, PictureChange::Same);
        assert_eq!(comparison.phases[2].time.change_ps, -6_000_000_000);
        assert_eq!(comparison.total.expect("timed").change_ps, -6_000_000_000);
    }

    #[test]
    fn errors_are_compared_where_both_have_them() {
        let (a, mut b) = (sample::judged(), sample::judged());
        b.image.error.as_mut().expect("judged").mean = 0.0023;
        let comparison = compare(&a, &b, PictureChange::Differs);
        let mean = &comparison.errors[0];
        assert_eq!((mean.name.as_str(), mean.a, mean.b), ("mean", 0.0123, 0.0023));
        assert!((mean.change + 0.01).abs() < 1e-15);
        assert!(render(&comparison).contains("error of the picture"), "{}", render(&comparison));
        let one = compare(&sample::timed(), &b, PictureChange::Differs);
        assert!(one.errors.is_empty() && one.inputs[0].path == "reference", "{:?}", one.inputs);
    }

    #[test]
    fn inputs_that_differ_are_named() {
        let paths: Vec<String> = compare(&sample::timed(), &slower(), PictureChange::Same)
            .inputs
            .into_iter()
            .map(|difference| difference.path)
            .collect();
        assert_eq!(paths, ["machine.clock_ghz", "machine.cores"]);
    }

    #[test]
    fn programs_that_differ_are_told() {
        let mut newer = sample::timed();
        newer.provenance.semantics += 1;
        let comparison = compare(&sample::timed(), &newer, PictureChange::Same);
        assert_eq!(comparison.inputs.len(), 1);
        assert_eq!(comparison.inputs[0].path, "program.semantics");
        assert!(render(&comparison).contains("The programs differ"));
        let same = compare(&newer, &newer, PictureChange::Same);
        assert!(!render(&same).contains("The programs differ"));
    }

    #[test]
    fn fidelities_that_differ_are_told() {
        let mut cheaper = sample::timed();
        cheaper.provenance.fidelity = "roofline".to_owned();
        let comparison = compare(&sample::timed(), &cheaper, PictureChange::Same);
        assert!(render(&comparison).contains("The fidelities differ"), "{}", render(&comparison));
        let same = compare(&cheaper, &cheaper, PictureChange::Same);
        assert!(!render(&same).contains("The fidelities differ"));
        // Two samples are of one level.
        let [a, b] = ["sampled:error=5%", "sampled:error=5%,seed=2"].map(|fidelity| {
            let mut report = sample::timed();
            report.provenance.fidelity = fidelity.to_owned();
            report
        });
        let text = render(&compare(&a, &b, PictureChange::Same));
        assert!(text.contains("The samples differ") && !text.contains("The fidelities differ"), "{text}");
    }

    #[test]
    fn untimed_runs_have_no_change_of_time() {
        let comparison = compare(&sample::functional(), &sample::timed(), PictureChange::Same);
        assert_eq!((comparison.total, comparison.phases.len()), (None, 0));
        assert!(render(&comparison).contains("Nothing is timed"));
    }

    #[test]
    fn shares_add_up_and_keep_their_proportions() {
        assert_eq!(shared_out(10, &[1, 1, 1]), [4, 3, 3]);
        assert_eq!(shared_out(10, &[0, 5, 0]), [0, 10, 0]);
        assert_eq!(shared_out(10, &[0, 0]), [0, 0]);
        let parts = shared_out(123_456_789_012_345, &[u64::MAX / 3, 1, u64::MAX / 7]);
        assert_eq!(parts.iter().sum::<i64>(), 123_456_789_012_345);
    }

    #[test]
    fn sums_of_points_add_up_too() {
        let one = compare(&sample::timed(), &slower(), PictureChange::Same);
        let both = sum(&[one.clone(), one.clone()]);
        let change = one.total.expect("timed").change_ps;
        assert_eq!(both.total.expect("timed").change_ps, 2 * change);
        assert_eq!(both.causes_ps.values().sum::<i64>(), 2 * change);
    }

    #[test]
    fn pictures_differ_by_what_they_differ() {
        let picture = |values: &[f32]| crate::picture::visibility_png(2, 1, values);
        let change = picture_change(&picture(&[0.0, 1.0]), &picture(&[0.0, 0.0])).expect("two pictures");
        assert_eq!(change, PictureChange::By { pixels: 1, part: 0.5, rmse: 0.5_f64.sqrt(), greatest: 1.0 });
        let other = crate::picture::visibility_png(1, 1, &[0.0]);
        assert_eq!(picture_change(&picture(&[0.0, 1.0]), &other), Some(PictureChange::OtherSize));
        assert_eq!(picture_change(b"no", &other), None);
    }
}
