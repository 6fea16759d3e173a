//! What a run cost the host: `host.json`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Wall-clock and memory of one run, apart from [`RunReport`](crate::RunReport) because they differ from run to run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HostReport {
    /// Name of the host that ran, or of the node of a cluster.
    pub node: String,
    /// Seconds from the loaded scene to the last simulated cycle, eye view included, reference not.
    pub seconds: f64,
    /// Seconds that casting the reference's shadow rays took, or once took where they were found in the cache; null where
    /// none was asked for.
    #[serde(default)]
    pub reference_seconds: Option<f64>,
    /// Whether the reference was found in the cache; null where none was asked for.
    #[serde(default)]
    pub reference_found: Option<bool>,
    /// Simulated instructions per second of the simulation alone.
    pub simulated_instructions_per_second: f64,
    /// Greatest resident memory of the process; null where the host does not tell.
    pub peak_rss_bytes: Option<u64>,
    /// Host threads that the run was allowed to use.
    pub host_threads: u32,
    /// Host instructions that computed the lanes.
    pub host_simd: String,
}

impl HostReport {
    /// The bytes of `host.json`.
    pub fn to_json(&self) -> String {
        let mut text =
            serde_json::to_string_pretty(self).expect("a report has string keys and no foreign types");
        text.push('\n');
        text
    }
}
