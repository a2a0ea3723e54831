//! `tsuya bake`: what a mesh's surface sees.

use crate::source::limits;
use crate::values::OutsideArgument;
use crate::{output, progress, source, values};
use anyhow::{Context, Result};
use clap::Args;
use serde_json::json;
use std::path::{Path, PathBuf};
use tsuya::container::{self, Container, ContainerWriter, SIGNATURE, SectionCodec, Tag};
use tsuya::visibility::{BakeOptions, BakedVisibility, bake};
use tsuya::{Error, mesh};

/// Computes the visibility of all directions from every vertex, or more finely, for shadows under any light.
///
/// Takes a mesh (PLY, OBJ, GLB) or a .tsuya file, and writes a .tsuya file that holds the visibility beside the mesh.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya bake vase.tsuya -o vase-shadows.tsuya",
))]
pub struct Bake {
    /// The mesh or the .tsuya file.
    input: PathBuf,
    /// The .tsuya file to write; - is standard output. Without it only the figures are printed.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Directions along a side of their grid, 8 to 128.
    #[arg(long, value_name = "N", default_value_t = 24)]
    resolution: usize,
    /// Terms for each place: of the first group, which serves for broad light, and of the second.
    #[arg(long, value_name = "N,N", default_value = "16,32", value_parser = values::numbers)]
    terms: values::Numbers,
    /// Places on the mesh, at most: its vertices, and where there are fewer, places between them (mesh with large triangles).
    #[arg(long, value_name = "N", default_value_t = 0)]
    places: usize,
    /// Finest step of the stored weights; smaller is better and longer.
    #[arg(long, value_name = "STEP", default_value_t = 0.01)]
    step: f64,
    /// An endless plane below the object blocks light, too. Its upward direction, e.g. 0,1,0.
    #[arg(long, value_name = "X,Y,Z", value_parser = values::triple)]
    ground: Option<[f64; 3]>,
    /// Bits of a coordinate of a mesh that is not coded yet, 8 to 24.
    #[arg(long, value_name = "BITS", default_value_t = 14, value_parser = clap::value_parser!(u8).range(8..=24))]
    position_bits: u8,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

impl Bake {
    pub fn run(self) -> Result<()> {
        let options = self.options()?;
        let outputs: Vec<&Path> = self.output.iter().map(|path| &**path).collect();
        output::check_outputs(&outputs, &[], self.force)?;
        let (old, mesh, mesh_bytes) = read(&self.input, self.position_bits, self.outside)?;
        if old.is_none() {
            // A .tsuya file keeps all that it has and may be written in its place; a mesh would be lost.
            output::check_outputs(&outputs, &[&self.input], self.force)?;
        }
        let baked = {
            let _busy = progress::busy("baking visibility");
            bake(&mesh, &options)?
        };
        if let Some(path) = &self.output {
            let section = (Tag::VISIBILITY, SectionCodec::Own, baked.bytes.clone());
            let bytes = match &old {
                Some(old) => container::with_sections(old, &[section], limits())?,
                None => {
                    let mut writer = ContainerWriter::new(Vec::new())?;
                    writer.write_section(Tag::MESH, SectionCodec::Own, &mesh_bytes)?;
                    writer.write_section(section.0, section.1, &section.2)?;
                    writer.finish()?
                }
            };
            output::write(path, &bytes, self.force)?;
        }
        // The figures must not get into the file.
        if self.output.as_deref().is_some_and(output::is_stream) { Ok(()) } else { self.report(&mesh, &baked) }
    }

    fn options(&self) -> Result<BakeOptions> {
        let wrong =
            || Error::parameter("--terms takes one or two whole numbers, the first 1 to 64, the second 0 to 64");
        let whole = |x: f64| (x.fract() == 0.0 && (0.0..=64.0).contains(&x)).then_some(x as usize);
        let terms = match self.terms.0.as_slice() {
            [first] => [whole(*first), Some(0)],
            [first, second] => [whole(*first), whole(*second)],
            _ => return Err(wrong().into()),
        };
        let [Some(first), Some(second)] = terms else { return Err(wrong().into()) };
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let ground_up = match self.ground {
            Some(up) if length(up) < 1e-9 => return Err(Error::parameter("--ground needs a direction").into()),
            up => up.map(|up| up.map(|x| x / length(up))),
        };
        Ok(BakeOptions {
            size: self.resolution,
            terms: [first, second],
            ground_up,
            weight_step: self.step,
            places: self.places,
        })
    }

    fn report(&self, mesh: &tsuya::Mesh, baked: &BakedVisibility) -> Result<()> {
        let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
        let error = baked.visibility.error();
        let bytes_per_vertex = baked.bytes.len() as f64 / vertices as f64;
        let places = baked.visibility.places().count();
        if self.json {
            return output::print_json(&json!({
                "vertices": vertices,
                "triangles": triangles,
                "places": places,
                "seconds": baked.seconds,
                "terms": baked.visibility.terms(),
                "bytes_per_vertex": bytes_per_vertex,
                "rms_error_rad": error.rms_radians,
                "sign_error": error.wrong_signs,
            }));
        }
        output::tell(&format!(
            "{vertices} vertices, {triangles} triangles, {places} places: {} terms in {:.2} s, {bytes_per_vertex:.1} bytes a vertex\n\
             error of the signed distance {:.2} degrees rms, {:.2} % of directions on the wrong side\n",
            baked.visibility.terms(),
            baked.seconds,
            error.rms_radians.to_degrees(),
            100.0 * error.wrong_signs,
        ))
    }
}

/// The bytes of a .tsuya file, if it is one, the mesh as a decoder has it, and its section.
fn read(path: &Path, position_bits: u8, outside: OutsideArgument) -> Result<(Option<Vec<u8>>, tsuya::Mesh, Vec<u8>)> {
    let bytes = source::read(path)?;
    if bytes.starts_with(&SIGNATURE) {
        let mut file = Container::open_slice(&bytes, limits()).with_context(|| source::name(path))?;
        let section = file.read_section(Tag::MESH).with_context(|| source::name(path))?;
        let mesh = mesh::decode(&section, &file.budget()).with_context(|| source::name(path))?;
        return Ok((Some(bytes), mesh, section));
    }
    let (mesh, cleaned) = mesh::clean(mesh::parse(path, &bytes, &outside.access())?);
    if !cleaned.is_clean() {
        output::warn(&[format!("{}: {cleaned}", source::name(path))]);
    }
    let coded = mesh::encode(&mesh, &mesh::MeshOptions { position_bits })?;
    Ok((None, coded.mesh, coded.bytes))
}
