//! `tsuya brdf convert`: any material as a MERL table.

use super::material::{Kind, read_one};
use crate::{output, progress};
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use tsuya::Error;

/// Converts a material to a MERL table (.binary). `tsuya brdf fit` makes fitted forms of tables.
#[derive(Args)]
pub struct Convert {
    /// A MERL table (.binary), an RGL material (.bsdf) or a fitted material (.json).
    input: PathBuf,
    /// The table.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Which material, where the file has several.
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
}

impl Convert {
    pub fn run(self) -> Result<()> {
        output::check_free(&self.output, self.force)?;
        if !output::is_stream(&self.output) && Kind::of(&self.output)? != Kind::Merl {
            let message = "a converted table's name ends with .binary; for fitted forms there is tsuya brdf fit";
            return Err(Error::parameter(format!("{}: {message}", self.output.display())).into());
        }
        let busy = progress::busy("converting");
        let table = read_one(&self.input, self.material.as_deref())?.material.into_table();
        let mut bytes = Vec::new();
        table.write_to(&mut bytes).map_err(|e| Error::io(&self.output, e))?;
        drop(busy);
        output::write(&self.output, &bytes, self.force)
    }
}
