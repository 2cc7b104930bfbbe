//! The flags that every bench has.

use std::path::PathBuf;

use serde::Serialize;
use sightline_cli::output;

/// Where the figures go, and whether the whole bench runs.
#[derive(Clone, Debug, clap::Args)]
pub struct BenchFlags {
    /// Write the figures to a JSON file.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Passed by `cargo bench`. Without it, and unless told otherwise, little is measured, to show
    /// that the bench works.
    #[arg(long, hide = true)]
    pub bench: bool,
}

impl BenchFlags {
    /// Writes the figures to the file that `--json` names, if it names one.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, figures: &impl Serialize) -> anyhow::Result<()> {
        output::write_json(self.json.as_deref(), figures)
    }
}
