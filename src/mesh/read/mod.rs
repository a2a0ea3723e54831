//! Meshes out of PLY, OBJ and glTF files. Positions and triangles only: tsuya derives everything else from the photographs.

mod gltf;
mod groups;
mod obj;
mod ply;

pub use groups::MeshGroups;
pub(crate) use groups::material_names;
pub use obj::texture_coordinates;

use super::{Mesh, is_within_range};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use groups::GroupRuns;
use std::io::Read;
use std::path::Path;

/// Extensions of the formats that [`read`] supports, lower case.
pub const EXTENSIONS: [&str; 4] = ["ply", "obj", "glb", "gltf"];

/// Format of a mesh file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum MeshFormat {
    Ply,
    Obj,
    /// As a document, or as a binary file.
    Gltf,
}

impl MeshFormat {
    /// The format that a file's content shows, or where it shows none its name.
    fn of(path: &Path, bytes: &[u8]) -> Option<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match &*extension {
            _ if bytes.starts_with(b"ply") => Some(MeshFormat::Ply),
            _ if bytes.starts_with(b"glTF") => Some(MeshFormat::Gltf),
            "gltf" => Some(MeshFormat::Gltf),
            "obj" => Some(MeshFormat::Obj),
            _ => None,
        }
    }
}

/// A mesh as its file has it: positions that single precision may not hold, such as those of a national grid.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct PreciseMesh {
    /// Vertices.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    groups: GroupRuns,
}

impl PreciseMesh {
    /// The mesh in single precision, about another origin.
    pub(crate) fn around(self, origin: [f64; 3]) -> Mesh {
        let single = |p: &[f64; 3]| std::array::from_fn(|k| (p[k] - origin[k]) as f32);
        Mesh { positions: self.positions.iter().map(single).collect(), triangles: self.triangles }
    }
}

/// Reads a triangle mesh. PLY (ASCII or binary, float or double) and OBJ polygons are cut into fans; all triangle primitives of
/// a glTF file's default scene are merged, with their nodes' transforms applied. The result has at least one triangle, finite
/// positions and corner indices inside the vertex list; degenerate triangles are left to [`super::clean`].
///
/// The mesh stays charged to the account of `access`. Errors name the file and the element that is wrong.
pub fn read(path: impl AsRef<Path>, access: &FileAccess) -> Result<Mesh> {
    let path = path.as_ref();
    single(path, read_precise(path, access)?)
}

/// As [`read`], in double precision.
pub(crate) fn read_precise(path: &Path, access: &FileAccess) -> Result<PreciseMesh> {
    let bytes = access.read_bytes(path, "mesh file", u64::MAX)?;
    parse_precise(path, &bytes, access)
}

/// As [`read`], from bytes; `path` names the file in errors and finds what a glTF file refers to.
pub fn parse(path: impl AsRef<Path>, bytes: &[u8], access: &FileAccess) -> Result<Mesh> {
    let path = path.as_ref();
    single(path, parse_precise(path, bytes, access)?)
}

/// As [`parse`], with the groups that the names of materials make: `usemtl` of OBJ, materials of glTF; none of PLY.
pub fn parse_with_groups(path: impl AsRef<Path>, bytes: &[u8], access: &FileAccess) -> Result<(Mesh, MeshGroups)> {
    let path = path.as_ref();
    let mut mesh = parse_precise(path, bytes, access)?;
    let triangles = mesh.triangles.len();
    access.charge(path, "groups of triangles", triangles as u64 * size_of::<u32>() as u64)?;
    let groups = std::mem::take(&mut mesh.groups).groups(triangles);
    Ok((single(path, mesh)?, groups))
}

fn single(path: &Path, mesh: PreciseMesh) -> Result<Mesh> {
    let mesh = mesh.around([0.0; 3]);
    check_range(path, &mesh)?;
    Ok(mesh)
}

/// Checks that a mesh about its origin lies where single precision suffices.
pub(crate) fn check_range(path: &Path, mesh: &Mesh) -> Result<()> {
    match mesh.positions.iter().position(|p| !is_within_range(p)) {
        Some(index) => {
            let [x, y, z] = mesh.positions[index];
            Err(Error::input(path, format!("vertex {index} is too far away: ({x:e}, {y:e}, {z:e}); 1e12 is the limit")))
        }
        None => Ok(()),
    }
}

fn parse_precise(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<PreciseMesh> {
    if bytes.is_empty() {
        return Err(Error::input(path, "the mesh file is empty (0 bytes)"));
    }
    let mesh = match MeshFormat::of(path, bytes) {
        Some(MeshFormat::Ply) => ply::read(path, bytes, access),
        Some(MeshFormat::Gltf) => gltf::read(path, bytes, access),
        Some(MeshFormat::Obj) => obj::read(path, bytes, access),
        None => Err(Error::input(path, "not a mesh that tsuya reads: it should be PLY, OBJ, GLB or glTF")),
    }?;
    check(path, &mesh)?;
    Ok(mesh)
}

/// Whether a file is a PLY without faces or triangle strips, from its header alone.
pub(crate) fn is_point_cloud(path: &Path) -> bool {
    let mut header = Vec::new();
    let read = crate::input::open(path).map(|(file, _)| file.take(1 << 16).read_to_end(&mut header).is_ok());
    let text = String::from_utf8_lossy(&header);
    let Some((header, _)) = text.split_once("end_header").filter(|_| read.unwrap_or(false) && text.starts_with("ply"))
    else {
        return false;
    };
    let counts = header
        .lines()
        .filter_map(|line| line.strip_prefix("element face ").or(line.strip_prefix("element tristrips ")));
    counts.into_iter().all(|count| count.trim() == "0")
}

/// Bytes of a triangle: what the mesh keeps, as much again for growing, and the tables and the copy of cleaning it; and of a vertex, which for a while
/// is there in double precision, too.
const TRIANGLE_BYTES: u64 = 6 * size_of::<[u32; 3]>() as u64;
const VERTEX_BYTES: u64 = 6 * size_of::<[f32; 3]>() as u64 + 2 * size_of::<[f64; 3]>() as u64;

/// Charges vertices and triangles before a mesh is given them. Their number has a limit of its own.
fn charge(path: &Path, access: &FileAccess, mesh: &PreciseMesh, vertices: u64, triangles: u64) -> Result<()> {
    let most = u64::from(access.budget().limits().mesh_elements);
    let totals = [
        ("vertices", vertices.saturating_add(mesh.positions.len() as u64)),
        ("triangles", triangles.saturating_add(mesh.triangles.len() as u64)),
    ];
    for (what, total) in totals {
        if total > most {
            return Err(Error::input(path, format!("the mesh has {total} {what}, {most} at most are read")));
        }
    }
    access.charge(path, "mesh", VERTEX_BYTES * vertices + TRIANGLE_BYTES * triangles)
}

/// Checks the conditions that meshes of all formats must meet.
fn check(path: &Path, mesh: &PreciseMesh) -> Result<()> {
    if let Some(index) = mesh.positions.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
        let [x, y, z] = mesh.positions[index];
        return Err(Error::input(path, format!("vertex {index} is not finite: ({x}, {y}, {z})")));
    }
    let count = mesh.positions.len();
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        if let Some(corner) = triangle.iter().find(|&&v| v as usize >= count) {
            return Err(Error::input(path, format!("triangle {index} names vertex {corner}, the mesh has {count}")));
        }
    }
    if mesh.triangles.is_empty() {
        return Err(Error::input(
            path,
            format!(
                "the mesh has {count} vertices but no triangle; a point cloud can't be used: make a mesh of it by Poisson's method or ball pivoting"
            ),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
