//! `tsuya brdf eval`: values at directions.

use super::material::read_one;
use crate::output;
use anyhow::Result;
use clap::Args;
use std::fmt::Write;
use std::io::Read;
use std::path::{Path, PathBuf};
use tsuya::brdf::Brdf;
use tsuya::{Error, Result as TsuyaResult};

/// Prints a material's BRDF, a row `r,g,b` for each pair of directions.
#[derive(Args)]
pub struct Eval {
    /// A MERL table (.binary), an RGL material (.bsdf) or a fitted material (.tsuya, .json).
    input: PathBuf,
    /// Rows `wi_x,wi_y,wi_z,wo_x,wo_y,wo_z`: the direction to the light and to the viewer, z along the normal, of any length; - is
    /// standard input. A first row that begins with a letter and rows that begin with # are skipped.
    #[arg(long, value_name = "CSV")]
    directions: PathBuf,
    /// Interpolates between the cells of a table.
    #[arg(long)]
    smooth: bool,
    /// Which material, where the file has several.
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
}

impl Eval {
    pub fn run(self) -> Result<()> {
        let directions = read_directions(&self.directions)?;
        let material = read_one(&self.input, self.material.as_deref())?.material;
        let mut text = String::new();
        for (incoming, outgoing) in directions {
            let [r, g, b] = if self.smooth {
                material.smooth().evaluate(incoming, outgoing)
            } else {
                material.evaluate(incoming, outgoing)
            };
            let _ = writeln!(text, "{r},{g},{b}");
        }
        output::say(&text)
    }
}

/// 256 MiB of text are three million rows.
const MOST_BYTES: u64 = 256 << 20;

fn read_directions(path: &Path) -> Result<Vec<([f64; 3], [f64; 3])>> {
    let mut text = String::new();
    let failed = |e| Error::io(path, e);
    let read =
        |reader: &mut dyn Read, text: &mut String| reader.take(MOST_BYTES + 1).read_to_string(text).map_err(failed);
    let size = if output::is_stream(path) {
        read(&mut std::io::stdin().lock(), &mut text)?
    } else {
        read(&mut std::fs::File::open(path).map_err(failed)?, &mut text)?
    };
    if size as u64 > MOST_BYTES {
        return Err(Error::Limits { what: "file of directions", asked: size as u64, allowed: MOST_BYTES }.into());
    }
    Ok(tsuya::brdf::directions::parse(&text, path)?)
}

/// An environment map out of a picture, or the standard one.
pub fn environment(path: Option<&Path>) -> TsuyaResult<tsuya::brdf::sphere::Environment> {
    use tsuya::brdf::sphere::{Environment, studio};
    Ok(match path {
        Some(path) => Environment::new(&tsuya::capture::read_radiance(path)?),
        None => Environment::new(&studio()),
    })
}
