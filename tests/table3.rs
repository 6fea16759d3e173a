//! The study of Table 3: its measures, what it finds, its files, and that it is the same on any host.

mod common;

use common::Folder;
use lrbsim::HostOptions;
use lrbsim::progress::Quiet;
use lrbsim::table3::{Case, Lamp, Table3Request, View, cases, row_names, run_table3};
use lrbsim_kernels::method::METHODS;
use lrbsim_reports::table3::{Quality, Table3Report};

fn run(algorithm: &str, threads: usize) -> Table3Report {
    let host = HostOptions { threads, ..HostOptions::default() };
    let request = Table3Request { algorithms: vec![algorithm.to_owned()], only: None, quick: true, host };
    run_table3(&request, &Quiet).expect("methods of that name")
}

/// The qualities that pictures lack which are made of the truth by `change`.
fn lacking(cases: &[Case], change: impl Fn(&View) -> Vec<f64>) -> Vec<Quality> {
    let figure = |case: &Case| case.figure(&case.views.iter().map(&change).collect::<Vec<_>>());
    let holds = |quality: &Quality| {
        quality.holds(quality.worst(cases.iter().filter(|case| case.quality == *quality).map(figure)))
    };
    Quality::ALL.into_iter().filter(|quality| !holds(quality)).collect()
}

/// A picture whose pixels are means over as much of the floor as a texel covers.
fn blurred(view: &View) -> Vec<f64> {
    let side = view.eye.width as usize;
    let texel = 3.8 / 1024.0;
    let reach = (0.5 * texel / (view.eye.points[1].x - view.eye.points[0].x)).floor() as usize;
    let range = |at: usize| at.saturating_sub(reach)..(at + reach + 1).min(side);
    let pixel = |i: usize| {
        let (xs, ys) = (range(i % side), range(i / side));
        let count = (xs.len() * ys.len()) as f64;
        ys.map(|y| view.truth[y * side..][xs.clone()].iter().sum::<f64>()).sum::<f64>() / count
    };
    (0..side * side).map(pixel).collect()
}

#[test]
fn the_truth_has_every_quality_and_a_picture_with_one_fault_lacks_one() {
    let cases = cases(Lamp::Ball, true);
    let each = |change: fn(usize, f64) -> f64| {
        lacking(&cases, |view| view.truth.iter().enumerate().map(|(i, v)| change(i, *v)).collect())
    };
    assert_eq!(each(|_, v| v), []);
    // Hard borders: where the whole penumbra is dark, and where it is lit.
    let of_edge = |change: fn(f64) -> f64| {
        lacking(&cases, |view| {
            let is_edge = view.scene.name == "edge";
            view.truth.iter().map(|v| if is_edge { change(*v) } else { *v }).collect()
        })
    };
    assert_eq!(of_edge(|v| if v < 0.5 { 0.0 } else { v }), [Quality::InnerPenumbra]);
    assert_eq!(of_edge(|v| if v > 0.5 { 1.0 } else { v }), [Quality::OuterPenumbra]);
    // No penumbra at all, of either shade.
    for shade in [0.0, 1.0] {
        let view = |view: &View| {
            if view.scene.name == "edge" { vec![shade; view.truth.len()] } else { view.truth.clone() }
        };
        assert_eq!(lacking(&cases, view), [Quality::InnerPenumbra, Quality::OuterPenumbra], "{shade}");
    }
    // Bands of a sixteenth, and a speck here and there in full shadow.
    assert_eq!(each(|_, v| (16.0 * v).round() / 16.0), [Quality::NoAliasing]);
    assert_eq!(each(|i, v| if v == 0.0 && i % 7 == 0 { 0.02 } else { v }), [Quality::NoLightLeaks]);
    // A penumbra of another shape is not aliased.
    let bent = |view: &View| {
        let moves = view.scene.name.ends_with("lamp");
        view.truth.iter().map(|v| if moves { v * v * (3.0 - 2.0 * v) } else { *v }).collect()
    };
    assert_eq!(lacking(&cases, bent), []);
    // What a second sheet of the same outline would hide if it were another.
    let product = |view: &View| {
        let is_pair = ["nested", "crossing", "apart", "closing"].contains(&view.scene.name.as_str());
        view.truth.iter().map(|v| if is_pair { v * v } else { *v }).collect()
    };
    assert_eq!(lacking(&cases, product), [Quality::AccurateOverlap]);
    assert_eq!(lacking(&cases, blurred), [Quality::AllFrequencies]);
}

#[test]
fn every_method_has_a_row_and_a_lamp_that_it_draws() {
    for method in METHODS {
        assert!(row_names().contains(&method.entry().name), "{}", method.entry().name);
    }
    let lamp = |name: &str| Lamp::of(&name.parse().expect("an algorithm"));
    assert!(row_names().into_iter().all(|name| lamp(name).is_some()));
    assert_eq!(
        [lamp("sism"), lamp("atty"), lamp("heidrich")],
        [Lamp::Ball, Lamp::Rectangle, Lamp::Line].map(Some)
    );
}

#[test]
fn methods_have_the_qualities_that_they_must_and_those_of_the_paper_theirs() {
    // The others take a minute where arrays are filled with poison.
    for (name, wanted) in [
        ("sism:overlap=sum", "110111"),
        ("penumbra-map", "010011"),
        // A border without width is two bands; the truth has neither.
        ("hard", "000011"),
        ("raytrace:rays=256", "111.11"),
        ("sintorn", "111.11"),
        ("sintorn:samples=1024", "111111"),
    ] {
        let report = run(name, 2);
        assert_eq!(report.truths[0].ticks(), [true; 6], "{}", report.markdown());
        let [row] = &report.rows[..] else { panic!("{} rows", report.rows.len()) };
        let figures = Quality::ALL.map(|quality| row.figure(quality));
        for (tick, wanted) in row.ticks().into_iter().zip(wanted.chars()) {
            assert!(wanted == '.' || tick == (wanted == '1'), "{name}: {figures:?}, not {wanted}");
        }
        assert!(report.differences().iter().all(|text| text.contains("has the ticks")), "{name}");
    }
}

#[test]
fn any_number_of_host_threads_gives_the_same_bytes() {
    assert_eq!(run("hard", 1).to_json(), run("hard", 3).to_json());
}

#[test]
fn the_study_leaves_a_table_and_a_page_that_can_be_drawn_again() {
    let folder = Folder::new();
    let printed = folder.run(&["study", "table3", "--quick", "--only", "hard", "-o", "out"]).ok().stdout();
    assert!(printed.contains("Visual qualities") && printed.contains("1 method, 0 failed"), "{printed}");
    let files = ["qualities.csv", "frequencies.svg", "table.md", "report.html", "table3.json"];
    common::drawn_again(&folder, "out", &files);
    folder.run(&["compare", "out", "out"]).refused(&["no times to compare"]);
}

#[test]
fn what_is_no_method_or_no_study_of_this_kind_is_refused() {
    let folder = Folder::new();
    folder.run(&["study", "table3", "--only", "xyz"]).refused(&["no row of `table3`", "sism:overlap=sum"]);
    folder.run(&["study", "table3", "-a", "pcs"]).refused(&["`pcs` is no algorithm", "`pcss`"]);
    folder.run(&["study", "cores", "-a", "pcss"]).refused(&["`-a` is for `lrbsim study table3` alone"]);
    folder.run(&["study", "stability", "-a", "pcss"]).refused(&["`-a` is for `lrbsim study table3` alone"]);
    folder.run(&["study", "cores", "--quick"]).refused(&["`--quick` is for", "`fidelity` alone"]);
    folder.run(&["study", "table3", "--engine", "slurm"]).refused(&["`table3`", "this machine alone"]);
}
