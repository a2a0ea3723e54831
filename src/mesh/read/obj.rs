//! Wavefront OBJ. Materials are not followed; their names make groups of triangles.

use super::{GroupRuns, MeshFormat, PreciseMesh, charge};
use crate::error::{Error, Result};
use crate::input::FileAccess;
use crate::limits::Reservation;
use std::borrow::Cow;
use std::io::{BufRead, Cursor};
use std::path::Path;

/// Counts the lines that the OBJ parser has taken, since its errors have no line numbers.
struct CountLines<'a> {
    inner: Cursor<&'a [u8]>,
    lines: std::rc::Rc<std::cell::Cell<usize>>,
}

impl std::io::Read for CountLines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.inner.read(buffer)
    }
}

impl BufRead for CountLines<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        // One line at a time, so that the count stands at the line being parsed.
        let rest = self.inner.fill_buf()?;
        let end = rest.iter().position(|&b| b == b'\n').map_or(rest.len(), |n| n + 1);
        Ok(&rest[..end])
    }
    fn consume(&mut self, amount: usize) {
        self.lines.set(self.lines.get() + (amount > 0) as usize);
        self.inner.consume(amount);
    }
}

/// Memory of the parsed text, charged for as long as the parser holds it, and the triangles that come of it: lists that may have grown to twice their need, and tables that
/// find the vertices of each object again.
fn hold_parsed<'a>(path: &Path, bytes: &[u8], access: &'a FileAccess) -> Result<(Reservation<'a>, u64)> {
    let (mut asked, mut triangles) = (0, 0);
    for line in bytes.split(|&b| b == b'\n') {
        let line = line.trim_ascii_start();
        asked += match line {
            [b'v', ..] => 256,
            [b'f', ..] => {
                let corners = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).count() - 1;
                triangles += corners.saturating_sub(2) as u64;
                160 + 128 * corners as u64
            }
            // Each begins a new object.
            [b'o' | b'g' | b'u', ..] => 1024 + 4 * line.len() as u64,
            _ => 0,
        };
    }
    Ok((access.reserve(path, "OBJ file", asked)?, triangles))
}

/// The text as the parser takes it: a backslash at the end of a line and what ends the line become blanks; names in other encodings than UTF-8,
/// which are not used, lose their letters.
fn plain_text(bytes: &[u8]) -> Cow<'_, [u8]> {
    let is_text = std::str::from_utf8(bytes).is_ok();
    let continues = bytes.windows(2).any(|pair| matches!(pair, b"\\\n" | b"\\\r"));
    if is_text && !continues {
        return Cow::Borrowed(bytes);
    }
    let mut text: Vec<u8> = bytes.iter().map(|&byte| if is_text || byte.is_ascii() { byte } else { b'?' }).collect();
    // A comment is not continued: it may end with a path of Windows.
    let (mut starts, mut in_comment) = (true, false);
    for at in 0..text.len() {
        in_comment = if starts {
            text[at..].iter().find(|byte| !matches!(byte, b' ' | b'\t')) == Some(&b'#')
        } else {
            in_comment
        };
        starts = text[at] == b'\n';
        if !in_comment && text[at..].starts_with(b"\\\n") {
            text[at..at + 2].fill(b' ');
        } else if !in_comment && text[at..].starts_with(b"\\\r\n") {
            text[at..at + 3].fill(b' ');
        }
    }
    Cow::Owned(text)
}

/// Parses a text that [`plain_text`] gave; of an error also the line, where it is known.
fn load(
    text: &[u8],
    mut reader: impl BufRead,
) -> std::result::Result<Vec<tobj::Model>, (Option<usize>, tobj::LoadError)> {
    check_references(text).map_err(|(line, e)| (Some(line), e))?;
    let options =
        tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    // Materials are not needed, and a missing .mtl file must not matter.
    let no_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    tobj::load_obj_buf(&mut reader, &options, no_materials).map(|(models, _)| models).map_err(|e| (None, e))
}

/// Refuses faces that name a texture coordinate or a normal before the first one, or beyond all numbers, where the file has any: the parser multiplies such
/// numbers before it compares them, which overflows.
fn check_references(text: &[u8]) -> std::result::Result<(), (usize, tobj::LoadError)> {
    let lines = || text.split(|&b| b == b'\n').map(<[u8]>::trim_ascii_start);
    let kind = |line: &[u8]| match line {
        [b'v', b't', space, ..] if space.is_ascii_whitespace() => Some(0),
        [b'v', b'n', space, ..] if space.is_ascii_whitespace() => Some(1),
        _ => None,
    };
    let mut totals = [0usize; 2];
    lines().filter_map(kind).for_each(|kind| totals[kind] += 1);
    let mut before = [0usize; 2];
    for (number, line) in (1..).zip(lines()) {
        if let Some(kind) = kind(line) {
            before[kind] += 1;
        }
        let [b'f', space, corners @ ..] = line else { continue };
        if !space.is_ascii_whitespace() || corners.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).count() < 3
        {
            continue;
        }
        for corner in corners.split(u8::is_ascii_whitespace) {
            for (kind, index) in corner.split(|&b| b == b'/').skip(1).take(2).enumerate() {
                // Others are small enough for the parser to compare.
                if totals[kind] == 0 || !(index.starts_with(b"-") || index.len() > MAX_DIGITS) {
                    continue;
                }
                let index = std::str::from_utf8(index).ok().and_then(|index| index.parse::<isize>().ok());
                let is_there = |index: isize| match index {
                    ..0 => index.unsigned_abs() <= before[kind],
                    _ => index.unsigned_abs() <= totals[kind],
                };
                if index.is_some_and(|index| !is_there(index)) {
                    let faults = [tobj::LoadError::FaceTexCoordOutOfBounds, tobj::LoadError::FaceNormalOutOfBounds];
                    return Err((number, faults[kind]));
                }
            }
        }
    }
    Ok(())
}

/// Digits of a number of which no small multiple overflows.
const MAX_DIGITS: usize = 9;

pub(super) fn read(path: &Path, bytes: &[u8], access: &FileAccess) -> Result<PreciseMesh> {
    let _copy = access.reserve(path, "OBJ file", bytes.len() as u64)?;
    let text = plain_text(bytes);
    let bytes = &*text;
    let (_parsed, triangles) = hold_parsed(path, bytes, access)?;
    charge(path, access, &PreciseMesh::default(), 0, triangles)?;
    let lines = std::rc::Rc::new(std::cell::Cell::new(0));
    let reader = CountLines { inner: Cursor::new(bytes), lines: lines.clone() };
    let models = load(bytes, reader).map_err(|(line, e)| {
        let line = || format!("line {}", line.unwrap_or(lines.get()));
        Error::input(path, format!("{}: {e}", locate_obj_fault(bytes).unwrap_or_else(line)))
    })?;
    let mut mesh = PreciseMesh::default();
    let vertices = models.iter().map(|model| model.mesh.positions.len() as u64 / 3).sum();
    charge(path, access, &mesh, vertices, 0)?;
    for model in models {
        let offset = mesh.positions.len() as u32;
        mesh.positions.extend(model.mesh.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]]));
        mesh.triangles
            .extend(model.mesh.indices.chunks_exact(3).map(|t| [t[0] + offset, t[1] + offset, t[2] + offset]));
    }
    let (groups, triangles) = groups(bytes);
    if triangles == mesh.triangles.len() {
        mesh.groups = groups;
    }
    if mesh.positions.iter().flatten().any(|c| !c.is_finite()) {
        let place = locate_obj_fault(bytes).unwrap_or_default();
        return Err(Error::input(path, format!("{place}: a vertex is not finite")));
    }
    Ok(mesh)
}

/// The groups that `usemtl` makes, and the number of triangles: the parser keeps the order of the faces, and cuts each into a fan.
fn groups(text: &[u8]) -> (GroupRuns, usize) {
    let (mut groups, mut triangles) = (GroupRuns::default(), 0);
    for line in text.split(|&b| b == b'\n').map(<[u8]>::trim_ascii) {
        let Some(at) = line.iter().position(u8::is_ascii_whitespace) else { continue };
        let (key, rest) = line.split_at(at);
        match key {
            b"usemtl" => {
                let name = String::from_utf8_lossy(rest.trim_ascii());
                let place = groups.place(&name);
                groups.begin(triangles, Some(place));
            }
            b"f" => {
                let corners = rest.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).count();
                triangles += corners.saturating_sub(2);
            }
            _ => {}
        }
    }
    (groups, triangles)
}

/// Texture coordinates of each triangle's corners of an OBJ file, parallel to the triangles that [`super::read`] gives. Empty for other
/// formats and for files without them.
pub fn texture_coordinates(path: impl AsRef<Path>, access: &FileAccess) -> Result<Vec<[[f32; 2]; 3]>> {
    let path = path.as_ref();
    let bytes = access.read_bytes(path, "mesh file", u64::MAX)?;
    if MeshFormat::of(path, &bytes) != Some(MeshFormat::Obj) {
        return Ok(Vec::new());
    }
    let _copy = access.reserve(path, "OBJ file", bytes.len() as u64)?;
    let bytes = plain_text(&bytes);
    let _parsed = hold_parsed(path, &bytes, access)?;
    let Ok(models) = load(&bytes, Cursor::new(&bytes[..])) else {
        return Ok(Vec::new());
    };
    let mut coordinates = Vec::new();
    for mesh in models.into_iter().map(|model| model.mesh) {
        // A corner's own index, or where all its indices are one, that of its vertex.
        let own = mesh.texcoord_indices.len() == mesh.indices.len();
        let indices = if own { &mesh.texcoord_indices } else { &mesh.indices };
        for corners in indices.chunks_exact(3) {
            let at = |k: usize| {
                let first = corners[k] as usize * 2;
                mesh.texcoords.get(first..first + 2).map(|uv| [uv[0] as f32, uv[1] as f32])
            };
            let (Some(a), Some(b), Some(c)) = (at(0), at(1), at(2)) else { return Ok(Vec::new()) };
            coordinates.push([a, b, c]);
        }
    }
    Ok(coordinates)
}

/// The line of the first vertex that is not finite or face corner out of range; for messages only.
fn locate_obj_fault(bytes: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(bytes);
    let total = text.lines().filter(|l| l.trim_start().starts_with("v ")).count() as i64;
    let mut vertices = 0;
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                if words.any(|w| w.parse::<f64>().is_ok_and(|c| !c.is_finite())) {
                    return Some(format!("line {}, vertex {}", number + 1, vertices + 1));
                }
                vertices += 1;
            }
            Some("f") => {
                for corner in words.filter_map(|w| w.split('/').next()?.parse::<i64>().ok()) {
                    let index = if corner < 0 { vertices + corner + 1 } else { corner };
                    if !(1..=total).contains(&index) {
                        return Some(format!("line {}, a face names vertex {corner} of {total}", number + 1));
                    }
                }
            }
            _ => {}
        }
    }
    None
}
