//! The glTF bridge: a `.tsuya` stream inside a GLB that every viewer shows. See `spec/gltf/TSUYA_materials_appearance.md`.
//!
//! [`export`] makes a GLB of an asset: its mesh, a metallic-roughness material baked from the fitted reflectance, and the stream itself,
//! bound to the material by [`EXTENSION`]. [`GltfDocument`] reads and edits GLB and glTF files as JSON, so that what it does not know
//! survives; [`extract`], [`inject`] and [`strip`] move the stream out of a document and into it.

mod accessor;
mod appearance;
mod binding;
mod document;
mod export;
mod fallback;
mod geometry;
mod levels;
mod look;
#[cfg(feature = "encode")]
mod materials;
mod metallic_roughness;
mod modelled;
mod normal_map;
mod stream;

pub use crate::input::percent_decoded as path_of;
pub use appearance::{Appearance, StreamSource, appearances, bound_materials};
pub use binding::MaterialBinding;
pub use binding::{MeshFit, compare_mesh};
pub use document::{ExternalFiles, GltfDocument, percent_encoded as reference};
pub use export::{ExportOptions, ExportedGltf, StreamPlacement, export};
pub use fallback::{Fallback, bake_fallback};
pub use levels::prefix_lengths;
pub use look::render_fallback;
#[cfg(feature = "encode")]
pub use materials::{UNSTATED, document_materials};
pub use metallic_roughness::equivalent_lobe;
pub use modelled::{export_modelled, metallic_roughness_of};
pub use stream::{ExtractedStream, extract, find_material, has_lost_appearance, inject, sha256, strip};

/// Name of the extension.
pub const EXTENSION: &str = "TSUYA_materials_appearance";
/// Version of the extension that is written, and the latest that is read.
pub const EXTENSION_VERSION: u64 = 1;
/// Media type of a stream.
pub const MIME_TYPE: &str = "model/vnd.tsuya";

#[cfg(test)]
mod tests;
