//! `tsuya make`: objects that were modelled.

use crate::brdf::material::{self as files, Kind, MODEL_FORMAT, Material};
use crate::source::limits;
use crate::values::OutsideArgument;
use crate::{gltf, output, source, surroundings};
use anyhow::{Context, Result};
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use tsuya::brdf::{
    FittedBrdf, FittedMaterial, Microfacets, NamedMaterial, TriangleBinding, decode_binding, decode_materials,
};
use tsuya::container::{self, Container, Metadata, SIGNATURE, SectionCodec, Tag};
use tsuya::input::{Folder, escaped};
use tsuya::relight::JobMaterial;
use tsuya::{Error, brdf, encoder, mesh};

/// Bytes of a material's description, at most.
const MAX_MATERIAL_BYTES: u64 = 16 << 20;

/// Bits of coordinates where nothing is said.
const POSITION_BITS: u8 = 14;
const TEXTURE_BITS: u8 = 16;

/// Makes a file of an object that was modelled, not captured: a mesh and what it is made of.
///
/// All that draws takes the file: render, ar, composite (asset), gltf export; bake adds its visibility.
#[derive(Args)]
#[command(after_help = concat!(
    "Examples:\n",
    "  tsuya make cup.obj --material '{\"model\": \"lambert\", \"diffuse\": 0.4}' -o cup.tsuya\n",
    "  tsuya make lamp.glb --material shade=paper.json --material foot=brass.tsuya -o lamp.tsuya",
))]
pub struct Make {
    /// The mesh (PLY, OBJ, GLB, glTF); or a .tsuya file with a mesh, of which all else stays.
    mesh: PathBuf,
    /// What the object is made of; several times with NAME=, for the triangles that usemtl (OBJ) or a material (glTF) of this name has, or in place of that
    /// material of a .tsuya file; without it for all others. Groups of a .tsuya or glTF file that get none keep their own. A .json file (a material of tsuya render --job, or classical models of tsuya
    /// brdf fit), a .tsuya file with fitted materials, or the text of a job's material: '{"model": "ward", "roughness": 0.2}'.
    #[arg(long, value_name = "[NAME=]MATERIAL")]
    material: Vec<String>,
    /// The .tsuya file to write; - is standard output.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Bits of a coordinate of a mesh that is not coded yet, 8 to 24.
    #[arg(long, value_name = "BITS", default_value_t = POSITION_BITS, value_parser = clap::value_parser!(u8).range(8..=24))]
    position_bits: u8,
    /// Bits of a texture coordinate of OBJ, 4 to 24: anisotropic materials (ward, ashikhmin-shirley) follow them.
    #[arg(long, value_name = "BITS", default_value_t = TEXTURE_BITS, value_parser = clap::value_parser!(u8).range(4..=24))]
    texture_bits: u8,
    #[command(flatten)]
    outside: OutsideArgument,
    /// Overwrites an existing file.
    #[arg(long)]
    force: bool,
    /// Prints figures as JSON.
    #[arg(long)]
    json: bool,
}

/// The mesh that is given materials.
struct Given {
    mesh: mesh::EncodedMesh,
    /// Names of groups; none of a mesh that is one whole.
    groups: Vec<String>,
    /// For each triangle of the coded mesh the place of its group.
    group_of: Vec<u32>,
    /// Its coded texture coordinates.
    coordinates: Option<Vec<u8>>,
    /// The file that it stands in.
    file: Option<Vec<u8>>,
    /// Its own materials.
    own: Vec<NamedMaterial>,
    /// What triangles without a material have, where the format says it.
    unstated: Option<Microfacets>,
}

/// Materials by the groups that take them.
struct Chosen {
    materials: Vec<NamedMaterial>,
    binding: TriangleBinding,
}

impl Make {
    /// Makes a file of a glTF document with its own materials.
    pub fn of_document(mesh: PathBuf, output: PathBuf, outside: OutsideArgument, force: bool) -> Self {
        Make {
            mesh,
            material: Vec::new(),
            output,
            position_bits: POSITION_BITS,
            texture_bits: TEXTURE_BITS,
            outside,
            force,
            json: false,
        }
    }

    pub fn run(self) -> Result<()> {
        output::check_outputs(&[&self.output], &[], self.force)?;
        let bytes = source::read(&self.mesh)?;
        self.make(bytes)
    }

    /// The same, of the mesh's file as it was read.
    pub fn make(self, bytes: Vec<u8>) -> Result<()> {
        let given = self.read_mesh(bytes)?;
        if given.file.is_none() {
            // A .tsuya file keeps all that it has and may be written in its place; a mesh would be lost.
            output::check_outputs(&[&self.output], &[&self.mesh], self.force)?;
        }
        let chosen = self.choose(&given)?;
        let bytes = match &given.file {
            Some(old) => {
                let sections = [
                    (Tag::MATERIALS, SectionCodec::Own, brdf::encode_materials(&chosen.materials)?),
                    (Tag::BINDING, SectionCodec::Own, brdf::encode_binding(&chosen.binding)?),
                ];
                container::with_sections(old, &sections, limits())?
            }
            None => {
                let mut metadata = Metadata::default();
                metadata.0.insert("title".into(), files::name_of(&self.mesh).into());
                let coordinates = given.coordinates.as_deref();
                encoder::encode_modelled(&given.mesh, &chosen.materials, &chosen.binding, coordinates, &metadata)?
            }
        };
        output::write(&self.output, &bytes, self.force)?;
        // The figures must not get into the file.
        if output::is_stream(&self.output) { Ok(()) } else { self.report(&given, &chosen, bytes.len()) }
    }

    fn read_mesh(&self, bytes: Vec<u8>) -> Result<Given> {
        let name = || source::name(&self.mesh);
        if bytes.starts_with(&SIGNATURE) {
            return read_file(bytes).with_context(name);
        }
        let access = self.outside.access();
        let (raw, groups) = mesh::parse_with_groups(&self.mesh, &bytes, &access)?;
        let is_gltf = bytes.starts_with(b"glTF") || source::has_extension(&self.mesh, "gltf");
        let own = if is_gltf { gltf::own_materials(&self.mesh, &bytes, &access)? } else { Vec::new() };
        output::warn(&access.remarks());
        let triangles = raw.triangles.len();
        let (cleaned, report, order) = mesh::clean_with_order(raw);
        if !report.is_clean() {
            output::warn(&[format!("{}: {report}", name())]);
        }
        let coded = mesh::encode(&cleaned, &mesh::MeshOptions { position_bits: self.position_bits })?;
        let group_of = |&triangle: &u32| groups.of_triangle[order[triangle as usize] as usize];
        let group_of = match groups.names.as_slice() {
            [] => Vec::new(),
            _ => coded.triangle_order.iter().map(group_of).collect(),
        };
        let coordinates = surroundings::read_coordinates(&self.mesh, &access)?;
        // What begins as PLY is no OBJ, whatever it is called.
        let coordinates = match coordinates.filter(|raw| raw.len() == triangles) {
            Some(raw) => {
                let kept: Vec<_> = order.iter().map(|&triangle| raw[triangle as usize]).collect();
                let own = coded.corner_values(&cleaned, &kept);
                Some(mesh::encode_coordinates(&own, &coded.mesh, self.texture_bits)?.0)
            }
            None => None,
        };
        let unstated = is_gltf.then_some(tsuya::gltf::UNSTATED);
        Ok(Given { mesh: coded, groups: groups.names, group_of, coordinates, file: None, own, unstated })
    }

    /// Reads the materials and finds the groups that each is for.
    fn choose(&self, given: &Given) -> Result<Chosen> {
        let mut of_group: Vec<Option<NamedMaterial>> = vec![None; given.groups.len()];
        let mut others = None;
        for argument in &self.material {
            let (group, description) = self.split(argument, &given.groups)?;
            let (material, own_name) = self.read_material(description, group)?;
            let twice = |what: &str| Error::parameter(format!("--material comes twice for {what}"));
            match group {
                Some(group) => {
                    let place = given.groups.iter().position(|name| name == group).unwrap_or(0);
                    if of_group[place].replace(NamedMaterial { name: group.to_owned(), material }).is_some() {
                        return Err(twice(&escaped(group)).into());
                    }
                }
                None if others.is_some() => return Err(twice("the whole mesh").into()),
                None => others = Some((own_name, material)),
            }
        }
        // Groups of a file that are not named keep their material, unless there is one for all others.
        if others.is_none() {
            for (group, found) in given.groups.iter().zip(&mut of_group) {
                let held = || given.own.iter().find(|named| named.name == *group).cloned();
                *found = found.take().or_else(held);
            }
            others = given.unstated.map(|material| ("default".into(), FittedMaterial::MetallicRoughness(material)));
        }
        let without: Vec<String> = (given.groups.iter().zip(&of_group))
            .filter(|(_, found)| found.is_none())
            .map(|(group, _)| escaped(group))
            .collect();
        if others.is_none() && given.groups.is_empty() {
            let message = "has no materials of its own: --material MATERIAL gives it one";
            return Err(Error::parameter(format!("{} {message}", source::name(&self.mesh))).into());
        }
        if others.is_none() && !without.is_empty() {
            let message = "gives one of them one, --material MATERIAL all of them";
            return Err(Error::parameter(format!(
                "no material for {}; --material NAME=MATERIAL {message}",
                without.join(", ")
            ))
            .into());
        }
        // What no triangle was bound to stays in a .tsuya file.
        let is_kept = |named: &&NamedMaterial| given.file.is_some() && !given.groups.contains(&named.name);
        let mut materials: Vec<NamedMaterial> = given.own.iter().filter(is_kept).cloned().collect();
        let mut names = Vec::new();
        let mut add = |named: NamedMaterial| -> u16 {
            match materials.iter_mut().find(|known| known.name == named.name) {
                Some(known) => known.material = named.material,
                None => materials.push(named.clone()),
            }
            names.push(named.name);
            names.len() as u16
        };
        let numbers: Vec<Option<u16>> = of_group.into_iter().map(|found| found.map(&mut add)).collect();
        let rest = others.filter(|_| numbers.is_empty() || numbers.contains(&None)).map(|(name, material)| {
            let taken = |name: &str| given.groups.iter().zip(&numbers).any(|(group, n)| n.is_some() && group == name);
            let name = if taken(&name) { format!("{name} (others)") } else { name };
            add(NamedMaterial { name, material })
        });
        if names.len() > usize::from(u16::MAX) {
            return Err(Error::parameter("a mesh has 65535 materials at most").into());
        }
        let number_of = |group: u32| numbers[group as usize].or(rest).unwrap_or(0);
        let of_triangle = match given.group_of.as_slice() {
            [] => vec![rest.unwrap_or(0); given.mesh.mesh.triangles.len()],
            groups => groups.iter().map(|&group| number_of(group)).collect(),
        };
        Ok(Chosen { materials, binding: TriangleBinding { names, of_triangle } })
    }

    /// The group that an argument names, if any, and the material.
    fn split<'a>(&self, argument: &'a str, groups: &[String]) -> Result<(Option<&'a str>, &'a str)> {
        if is_text(argument) || Path::new(argument).is_file() {
            return Ok((None, argument));
        }
        let named =
            |group: &String| argument.strip_prefix(group.as_str())?.strip_prefix('=').map(|rest| (group.len(), rest));
        if let Some((length, rest)) = groups.iter().filter_map(named).max_by_key(|(length, _)| *length) {
            return Ok((Some(&argument[..length]), rest));
        }
        let Some((name, _)) = argument.split_once('=') else { return Ok((None, argument)) };
        let known: Vec<String> = groups.iter().map(|name| escaped(name)).collect();
        let mesh = source::name(&self.mesh);
        Err(Error::parameter(match known.as_slice() {
            [] => format!(
                "{mesh} has no groups: --material takes a material for the whole mesh, without {}=",
                escaped(name)
            ),
            _ => format!("{mesh} has no group {}; it has {}", escaped(name), known.join(", ")),
        })
        .into())
    }

    /// A material and what it is called; of several in a file that of a group's name.
    fn read_material(&self, description: &str, group: Option<&str>) -> Result<(FittedMaterial, String)> {
        if is_text(description) {
            let job: JobMaterial =
                serde_json::from_str(description).map_err(|e| Error::parameter(format!("--material: {e}")))?;
            let (material, name) = job.fitted(&Folder::new("", "--material", true), limits())?;
            let name = name.unwrap_or_else(|| job.model.clone());
            return Ok((material, name));
        }
        let path = Path::new(description);
        if source::has_extension(path, "json") {
            let bytes = source::read_at_most(path, "material", MAX_MATERIAL_BYTES)?;
            let wrong = |e: serde_json::Error| Error::input(path, e.to_string());
            let value: serde_json::Value = serde_json::from_slice(&bytes).map_err(wrong)?;
            if value["format"].as_str() != Some(MODEL_FORMAT) {
                let job: JobMaterial = serde_json::from_slice(&bytes).map_err(wrong)?;
                let (material, _) =
                    job.fitted(&self.outside.folder(path), limits()).with_context(|| source::name(path))?;
                return Ok((material, files::name_of(path)));
            }
        }
        if !matches!(Kind::of(path)?, Kind::Models | Kind::Tsuya) {
            let message = "measured values are no material yet; tsuya brdf fit makes one of them";
            return Err(Error::parameter(format!("{}: {message}", path.display())).into());
        }
        let mut all = files::read_all(path)?;
        let names = || all.iter().map(|named| escaped(&named.name)).collect::<Vec<_>>().join(", ");
        let place = match group.and_then(|group| all.iter().position(|named| named.name == group)) {
            Some(place) => place,
            None if all.len() == 1 => 0,
            None => {
                let message = "a material of the file by its name: --material '{\"model\": \"fitted\", \"file\": FILE, \"name\": NAME}'";
                return Err(Error::parameter(format!("{} has {}; {message}", path.display(), names())).into());
            }
        };
        let named = all.swap_remove(place);
        match named.material {
            Material::Fitted(FittedBrdf::Coded(material)) => Ok((material, named.name)),
            Material::Fitted(FittedBrdf::Classical(model)) => Ok((FittedMaterial::Classical(model), named.name)),
            Material::Merl(_) | Material::Rgl(_) => {
                Err(Error::input(path, "a table of measured values is no fitted material").into())
            }
        }
    }

    fn report(&self, given: &Given, chosen: &Chosen, bytes: usize) -> Result<()> {
        let Chosen { materials, binding } = chosen;
        let (vertices, triangles) = (given.mesh.mesh.positions.len(), given.mesh.mesh.triangles.len());
        let form = |name: &String| materials.iter().find(|m| m.name == *name).map_or("", |named| named.material.form());
        let bound = || binding.names.iter().zip(binding.counts());
        if self.json {
            let bound: Vec<_> =
                bound().map(|(name, count)| json!({"name": name, "form": form(name), "triangles": count})).collect();
            return output::print_json(
                &json!({"bytes": bytes, "vertices": vertices, "triangles": triangles, "materials": bound}),
            );
        }
        let mut text = format!("{vertices} vertices, {triangles} triangles, {bytes} bytes\n");
        for (name, count) in bound() {
            let _ = writeln!(text, "{}: {}, {count} triangles", output::line(name), form(name));
        }
        output::tell(&text)
    }
}

/// Whether an argument is the text of a material itself.
fn is_text(argument: &str) -> bool {
    argument.trim_start().starts_with('{')
}

/// The mesh of a .tsuya file with the groups that its binding makes.
fn read_file(bytes: Vec<u8>) -> tsuya::Result<Given> {
    let mut file = Container::open_slice(&bytes, limits())?;
    let budget = file.budget();
    let section = file.read_section(Tag::MESH)?;
    let mesh = mesh::decode(&section, &budget)?;
    let materials = match file.read_optional(Tag::MATERIALS)? {
        Some(section) => decode_materials(&section, &budget)?,
        None => Vec::new(),
    };
    let binding = match file.read_optional(Tag::BINDING)? {
        Some(section) => decode_binding(&section, mesh.triangles.len(), &materials, &budget)?,
        None => TriangleBinding::default(),
    };
    let is_whole = binding.of_triangle.iter().all(|&bound| bound > 0);
    let (groups, group_of) = match is_whole {
        true => (binding.names, binding.of_triangle.iter().map(|&bound| u32::from(bound) - 1).collect()),
        false => (Vec::new(), Vec::new()),
    };
    let mesh = mesh::EncodedMesh { bytes: section, mesh, ..Default::default() };
    drop(file);
    let file = Some(bytes);
    Ok(Given { mesh, groups, group_of, coordinates: None, file, own: materials, unstated: None })
}
