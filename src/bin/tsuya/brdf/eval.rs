//! `tsuya brdf eval`: values at directions.

use super::material::read_one;
use crate::{output, source};
use anyhow::Result;
use clap::Args;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tsuya::brdf::Brdf;
use tsuya::{Error, Result as TsuyaResult};

/// Prints a material's BRDF, a row `r,g,b` for each pair of directions.
#[derive(Args)]
pub struct Eval {
    /// A MERL table (.binary), an RGL material (.bsdf) or a fitted material (.tsuya, .json).
    input: PathBuf,
    /// Rows `wi_x,wi_y,wi_z,wo_x,wo_y,wo_z`: the direction to the light and to the viewer, z along the normal, of any length; - is
    /// standard input. A first row of names may say otherwise: other columns, or `theta_i,phi_i,theta_o,phi_o` in degrees, as tsuya brdf
    /// plan --csv writes them. Rows that begin with # are skipped.
    #[arg(long, value_name = "CSV")]
    directions: PathBuf,
    /// Interpolates between the cells of a table.
    #[arg(long)]
    smooth: bool,
    /// Prints a heading, and the directions before the values: a table that tsuya brdf fit takes.
    #[arg(long)]
    with_directions: bool,
    /// Which material, where the file has several.
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
}

impl Eval {
    pub fn run(self) -> Result<()> {
        let directions = read_directions(&self.directions)?;
        let material = read_one(&self.input, self.material.as_deref())?.material;
        let heading = "wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,r,g,b\n";
        let mut text = String::from(if self.with_directions { heading } else { "" });
        for (incoming, outgoing) in directions {
            let [r, g, b] = if self.smooth {
                material.interpolated().evaluate(incoming, outgoing)
            } else {
                material.evaluate(incoming, outgoing)
            };
            if self.with_directions {
                let ([a, b, c], [d, e, f]) = (incoming, outgoing);
                let _ = write!(text, "{a},{b},{c},{d},{e},{f},");
            }
            let _ = writeln!(text, "{r},{g},{b}");
        }
        output::print(&text)
    }
}

/// 256 MiB of text are three million rows.
const MAX_BYTES: u64 = 256 << 20;

fn read_directions(path: &Path) -> Result<Vec<([f64; 3], [f64; 3])>> {
    let bytes = source::read_at_most(path, "file of directions", MAX_BYTES)?;
    let text = std::str::from_utf8(&bytes).map_err(|e| Error::input(path, format!("not UTF-8 text: {e}")))?;
    // A row has twelve bytes at least, a pair of directions 48, in a list that has grown.
    source::access().charge(path, "file of directions", 9 * bytes.len() as u64)?;
    Ok(tsuya::brdf::parse_directions(text, path)?)
}

/// An environment map out of a picture, or the standard one.
pub fn environment(path: Option<&Path>) -> TsuyaResult<tsuya::brdf::PreviewEnvironment> {
    use tsuya::brdf::{PreviewEnvironment, studio_environment};
    Ok(match path {
        Some(path) => PreviewEnvironment::new(&tsuya::image::read_radiance(path, &source::access())?),
        None => PreviewEnvironment::new(&studio_environment()),
    })
}
