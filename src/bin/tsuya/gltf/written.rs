//! Documents as files: a GLB, or for a name that ends with `.gltf` JSON with its buffer beside it, as `.bin`.

use crate::output;
use crate::source::has_extension;
use anyhow::Result;
use std::path::{Path, PathBuf};
use tsuya::Error;
use tsuya::gltf::{GltfDocument, reference};

/// Where a document goes.
pub struct DocumentFiles {
    document: PathBuf,
    /// Place and reference of the buffer, where it has a file of its own.
    buffer: Option<(PathBuf, String)>,
}

impl DocumentFiles {
    /// Those of a name; `is_glb` says what the document is now.
    pub fn of(path: &Path, is_glb: bool) -> tsuya::Result<Self> {
        if !is_glb && has_extension(path, "glb") {
            let message = "a .gltf document stays one, with its buffers where they are: give the output a name that ends with .gltf";
            return Err(Error::parameter(format!("{}: {message}", path.display())));
        }
        let mut buffer = None;
        if is_glb && has_extension(path, "gltf") {
            let beside = path.with_extension("bin");
            let name = beside.file_name().and_then(|name| name.to_str()).map(reference);
            let message =
                || format!("{}: a document refers to its buffer by name, which has to be Unicode", path.display());
            buffer = Some((beside.clone(), name.ok_or_else(|| Error::parameter(message()))?));
        }
        Ok(DocumentFiles { document: path.to_owned(), buffer })
    }

    /// All of them.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        [Some(&self.document), self.buffer.as_ref().map(|(path, _)| path)].into_iter().flatten().map(|path| &**path)
    }

    /// Writes the document; returns its bytes, those of the buffer counted.
    pub fn add(&self, files: &mut output::Files, mut document: GltfDocument) -> Result<usize> {
        let mut bytes = 0;
        if let Some((path, reference)) = &self.buffer
            && let Some(buffer) = document.take_buffer(reference)?
        {
            files.add(path, &buffer)?;
            bytes += buffer.len();
        }
        let content = document.to_bytes()?;
        files.add(&self.document, &content)?;
        Ok(bytes + content.len())
    }
}
