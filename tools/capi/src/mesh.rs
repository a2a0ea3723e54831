//! Meshes.

use crate::asset::Asset;
use crate::error::{Error, Status};
use crate::{guarded, put};
use tsuya::RenderMesh;

/// Which mesh.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum MeshKind {
    /// The mesh of the capture: positions and triangles.
    Captured = 0,
    /// The finest surface that the file has, with normals, tangents and texture coordinates.
    Drawn = 1,
    /// The mesh of the capture with normals, tangents and texture coordinates, for tsuya_textures(), whose normal map has the rest.
    Textured = 2,
}

/// Vertices and triangles; the memory belongs to the asset.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Mesh {
    /// Vertices.
    pub vertex_count: usize,
    /// Positions, three numbers for each vertex.
    pub positions: *const f32,
    /// Unit normals, three for each vertex; null of TSUYA_MESH_KIND_CAPTURED.
    pub normals: *const f32,
    /// Tangents, four for each vertex: the direction of growing u, and the sign with which normal x tangent points up in the texture; or null.
    pub tangents: *const f32,
    /// Texture coordinates, two for each vertex, v downwards as the rows of textures; or null.
    pub texture_coordinates: *const f32,
    /// Triangles.
    pub triangle_count: usize,
    /// Vertices of each triangle, three, counter-clockwise from outside.
    pub triangles: *const u32,
}

/// A mesh that was made.
pub(crate) enum MeshData {
    Plain,
    Drawn(RenderMesh),
}

impl MeshData {
    fn of_c(&self, plain: &tsuya::Mesh) -> Mesh {
        fn pointer<T, const N: usize>(rows: &[[T; N]]) -> *const T {
            if rows.is_empty() { std::ptr::null() } else { rows.as_ptr().cast() }
        }
        match self {
            MeshData::Plain => Mesh {
                vertex_count: plain.positions.len(),
                positions: pointer(&plain.positions),
                normals: std::ptr::null(),
                tangents: std::ptr::null(),
                texture_coordinates: std::ptr::null(),
                triangle_count: plain.triangles.len(),
                triangles: pointer(&plain.triangles),
            },
            MeshData::Drawn(mesh) => {
                let has_atlas = !mesh.coordinates.is_empty();
                Mesh {
                    vertex_count: mesh.positions.len(),
                    positions: pointer(&mesh.positions),
                    normals: pointer(&mesh.normals),
                    tangents: if has_atlas { pointer(&mesh.tangents) } else { std::ptr::null() },
                    texture_coordinates: pointer(&mesh.coordinates),
                    triangle_count: mesh.triangles.len(),
                    triangles: pointer(&mesh.triangles),
                }
            }
        }
    }
}

/// A mesh of the file; `kind` is a TsuyaMeshKind.
///
/// # Safety
/// `asset` and `error` are null or valid; `mesh` can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tsuya_mesh(asset: *const Asset, kind: u32, mesh: *mut Mesh, error: *mut *mut Error) -> Status {
    let find = || {
        // SAFETY: as the caller says.
        let asset = unsafe { asset.as_ref() }.ok_or_else(Error::null)?;
        let plain = &asset.outline.mesh;
        const CAPTURED: u32 = MeshKind::Captured as u32;
        const DRAWN: u32 = MeshKind::Drawn as u32;
        const TEXTURED: u32 = MeshKind::Textured as u32;
        let found = match kind {
            CAPTURED => asset.captured.get_or_init(|| MeshData::Plain),
            DRAWN => {
                let model = asset.model()?;
                asset.drawn.get_or_init(|| {
                    let charts = model.charts.as_ref();
                    let surface = || RenderMesh::of_surface(&model.mesh, charts?, model.surface.as_ref()?);
                    let atlas = || charts.map(|charts| RenderMesh::with_atlas(&model.mesh, charts));
                    let made = surface().or_else(atlas).unwrap_or_else(|| RenderMesh::without_atlas(&model.mesh));
                    MeshData::Drawn(made)
                })
            }
            TEXTURED => {
                let model = asset.model()?;
                let absent = || Error::new(Status::Absent, "the file has no reflectance, so no texture coordinates");
                let charts = model.charts.as_ref().ok_or_else(absent)?;
                asset.textured.get_or_init(|| MeshData::Drawn(RenderMesh::with_atlas(&model.mesh, charts)))
            }
            _ => return Err(Error::new(Status::Parameter, "there is no mesh of this kind")),
        };
        // SAFETY: as the caller says.
        unsafe { put(mesh, found.of_c(plain)) }
    };
    // SAFETY: as the caller says.
    unsafe { guarded(error, find) }
}
