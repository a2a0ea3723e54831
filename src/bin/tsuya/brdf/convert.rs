//! `tsuya brdf convert`: any material as a MERL table, or fitted.

use super::fit::{Forms, write_fitted};
use super::material::{Kind, Material, Named, read_all, read_one};
use crate::{output, progress};
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;
use tsuya::Error;

/// Converts materials: to a MERL table, or to a file of fitted ones. `tsuya brdf fit` does the latter and tells the error.
#[derive(Args)]
pub struct Convert {
    /// A MERL table (.binary), an RGL material (.bsdf) or fitted materials (.tsuya, .json).
    input: PathBuf,
    /// A MERL table (.binary), or fitted materials (.tsuya, .json).
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Which material, where the file has several.
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
    #[command(flatten)]
    forms: Forms,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
}

impl Convert {
    pub fn run(self) -> Result<()> {
        output::check_outputs(&[&self.output], &[&self.input], self.force)?;
        // A table may go to standard output.
        let kind = if output::is_stream(&self.output) { Kind::Merl } else { Kind::of(&self.output)? };
        let busy = progress::busy("converting");
        let bytes = match kind {
            Kind::Merl => {
                let table = read_one(&self.input, self.material.as_deref())?.material.into_table();
                let mut bytes = Vec::new();
                table.write_to(&mut bytes).map_err(|e| Error::io(&self.output, e))?;
                bytes
            }
            Kind::Models | Kind::Tsuya => {
                let chosen = match &self.material {
                    Some(name) => vec![read_one(&self.input, Some(name))?],
                    None => read_all(&self.input)?,
                };
                let form = self.forms.of(Some(&self.output))?;
                let mut fitted = Vec::new();
                for Named { name, material } in chosen {
                    let same = match material {
                        Material::Fitted(fitted) if self.forms.is_default() => fitted,
                        other => tsuya::brdf::fit_table(&other.into_table(), form, &self.forms.settings())?,
                    };
                    fitted.push((name, same));
                }
                write_fitted(&self.output, fitted)?
            }
            Kind::Measured => {
                let message = "tables of measured values are read, not written; a MERL table's name ends with .binary";
                return Err(Error::Unsupported(format!("{}: {message}", self.output.display())).into());
            }
            Kind::Rgl => {
                let message = "RGL materials (.bsdf) are read, not written; a table's name ends with .binary";
                return Err(Error::Unsupported(format!("{}: {message}", self.output.display())).into());
            }
        };
        drop(busy);
        output::write(&self.output, &bytes, self.force)
    }
}
