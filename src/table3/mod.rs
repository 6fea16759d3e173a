//! `study table3`: Table 3 of Johnson et al. 2009, each tick decided by a measurement.
//!
//! ```text
//! scenes ─► cases of each quality, with what is true of them
//!             ├─► methods, functionally ─► figures ─► ticks
//!             └─► the truth itself      ─► figures ─► every tick
//! ```
//!
//! Every method draws the same scenes, under the first of a ball, a rectangle and a line that it takes.

mod scenes;
mod cases;

use std::path::{Path, PathBuf};

use lrbsim_kernels::method::METHODS;
use lrbsim_reports::table3::{TABLE3_SCHEMA_VERSION, Table3Case, Table3Report, Table3Row};
use lrbsim_reports::{base64, page, picture};
use lrbsim_workloads::{Adjacency, ShadowInput};

use crate::algorithm::Algorithm;
use crate::error::BadInput;
use crate::frame::{HostOptions, SEMANTICS, on_host_threads};
use crate::made;
use crate::progress::Progress;

pub use cases::{Case, View};
pub use scenes::{Lamp, cases};

/// Name of the study, as `lrbsim study` takes it.
pub const NAME: &str = "table3";

/// Name of the file of its results.
pub const FILE: &str = "table3.json";

/// Options that are worth a row beside the defaults of their method.
const VARIANTS: [&str; 6] = [
    // As Johnson et al. have it.
    "sism:overlap=sum",
    "pcss:search=64,taps=128",
    "heidrich:samples=5",
    "atty:passes=2",
    "raytrace:rays=256",
    "sintorn:samples=1024",
];

/// What of the study is run, and how.
#[derive(Debug, Clone)]
pub struct Table3Request {
    /// The methods with their options, as `-a` takes them; if there are none, those of [`row_names`].
    pub algorithms: Vec<String>,
    /// Only methods whose names, with options, contain this.
    pub only: Option<String>,
    /// Whether scenes have fewer receivers and shorter motions.
    pub quick: bool,
    /// How the host goes about it; changes no result.
    pub host: HostOptions,
}

/// Names of the rows where none are asked for: every method with its defaults, and then with other options.
pub fn row_names() -> Vec<&'static str> {
    let variants = |name: &'static str| {
        let of = move |variant: &&str| variant.split(':').next() == Some(name);
        std::iter::once(name).chain(VARIANTS.into_iter().filter(of))
    };
    METHODS.iter().flat_map(|method| variants(method.entry().name)).collect()
}

/// Runs the study: every row that was asked for, one after the other.
///
/// # Errors
/// If there is no row of the name that was asked for, if an algorithm is none or draws neither a ball nor a rectangle nor a line, or if the
/// host gives no threads.
pub fn run_table3(request: &Table3Request, progress: &dyn Progress) -> Result<Table3Report, BadInput> {
    let only = request.only.as_deref().unwrap_or_default();
    let all: Vec<String> = match &request.algorithms[..] {
        [] => row_names().into_iter().map(str::to_owned).collect(),
        given => given.to_vec(),
    };
    let names: Vec<&str> = all.iter().map(String::as_str).filter(|name| name.contains(only)).collect();
    if names.is_empty() {
        return Err(BadInput::new(format!(
            "`--only {only}` is in the name of no row of `{NAME}`; it must be in one of: {}",
            all.join(", ")
        )));
    }
    let rows: Vec<(&str, Algorithm, Lamp)> = names
        .into_iter()
        .map(|name| {
            let algorithm: Algorithm = name.parse()?;
            let lamp = Lamp::of(&algorithm).ok_or_else(|| {
                BadInput::new(format!(
                    "`{name}` draws neither a ball nor a rectangle nor a line, the lamps of `{NAME}`"
                ))
            })?;
            Ok((name, algorithm, lamp))
        })
        .collect::<Result<_, BadInput>>()?;
    let mut lamps: Vec<Lamp> = Vec::new();
    for (_, _, lamp) in &rows {
        if !lamps.contains(lamp) {
            lamps.push(*lamp);
        }
    }
    progress.counted(NAME, (lamps.len() + rows.len()) as u32);
    on_host_threads(request.host.threads, || {
        let stages: Vec<(Lamp, Vec<Case>)> = lamps
            .into_iter()
            .map(|lamp| {
                let cases = cases(lamp, request.quick);
                progress.one_done();
                (lamp, cases)
            })
            .collect();
        let truth = |(lamp, cases): &(Lamp, Vec<Case>)| {
            let name = "truth".to_owned();
            row([name.clone(), name], *lamp, cases, |view| Ok(view.truth.clone()))
        };
        let truths = stages.iter().map(truth).collect::<Result<_, BadInput>>()?;
        let rows = rows.iter().map(|(name, algorithm, lamp)| {
            let (_, cases) = stages.iter().find(|stage| stage.0 == *lamp).expect("a stage for each lamp");
            let names = [(*name).to_owned(), algorithm.to_string()];
            let row = row(names, *lamp, cases, |view| drawn(algorithm, view, request.host));
            progress.one_done();
            row
        });
        Ok(Table3Report {
            schema_version: TABLE3_SCHEMA_VERSION,
            lrbsim_version: env!("CARGO_PKG_VERSION").to_owned(),
            semantics: SEMANTICS,
            samples: scenes::SAMPLES,
            truths,
            rows: rows.collect::<Result<_, BadInput>>()?,
        })
    })?
}

/// One row: what `draw` makes of all cases.
fn row(
    [name, algorithm]: [String; 2],
    lamp: Lamp,
    cases: &[Case],
    draw: impl Fn(&View) -> Result<Vec<f64>, BadInput>,
) -> Result<Table3Row, BadInput> {
    let measured = |case: &Case| {
        let drawn: Vec<Vec<f64>> = case.views.iter().map(&draw).collect::<Result<_, BadInput>>()?;
        let first: Vec<f32> = drawn[0].iter().map(|visible| *visible as f32).collect();
        let side = case.views[0].eye.width;
        Ok(Table3Case {
            quality: case.quality,
            case: case.id.clone(),
            figure: case.figure(&drawn),
            picture: base64::encode(&picture::visibility_png(side, side, &first)),
        })
    };
    let cases = cases.iter().map(measured).collect::<Result<_, BadInput>>()?;
    Ok(Table3Row { name, algorithm, light: lamp.name().to_owned(), cases })
}

/// What `algorithm` draws of a view: visibilities of the receivers that are judged.
fn drawn(algorithm: &Algorithm, view: &View, host: HostOptions) -> Result<Vec<f64>, BadInput> {
    let adjacency = Adjacency::new(&view.scene.mesh);
    let input = ShadowInput::of_lights(&view.scene, algorithm.lights(), &adjacency, &view.eye);
    let visibility = made::draw(algorithm, input, host)?.visibility;
    Ok(visibility.into_iter().take(view.truth.len()).map(made::number).collect())
}

/// The files of the study other than its results, all drawn from them: names and bytes.
pub fn drawings(report: &Table3Report) -> Vec<(String, Vec<u8>)> {
    made::drawings("table.md", report.markdown(), &report.findings(), page::of_table3(report))
}

/// Writes the results of the study to `dir`, its JSON last, in place of the results there, and tells their paths.
pub fn write(dir: &Path, report: &Table3Report) -> Result<Vec<PathBuf>, BadInput> {
    made::write(dir, &drawings(report), FILE, &report.to_json())
}
