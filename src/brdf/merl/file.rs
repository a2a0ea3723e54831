//! Reading and writing `.binary` files, in blocks.

use super::{MERL_CELLS, MERL_SCALES, MerlTable, PHI_D_BINS, THETA_D_BINS, THETA_H_BINS};
use crate::input::{FileAccess, open};
use crate::{Error, Result};
use byteorder::{BigEndian, ByteOrder, LittleEndian, WriteBytesExt};
use std::io::{BufWriter, Read, Write};
use std::path::Path;

const COUNTS: [u32; 3] = [THETA_H_BINS as u32, THETA_D_BINS as u32, PHI_D_BINS as u32];
/// Bytes of a file.
const FILE_BYTES: u64 = 12 + 8 * 3 * MERL_CELLS as u64;
const BLOCK_BYTES: usize = 1 << 16;
/// Bytes of a table in memory: three floats a cell, in a list that has grown to their number.
const MEMORY_BYTES: u64 = 2 * 12 * MERL_CELLS as u64;

impl MerlTable {
    /// Reads a file. The table stays charged; errors name the file.
    pub fn read(path: impl AsRef<Path>, access: &FileAccess) -> Result<Self> {
        let path = path.as_ref();
        let (file, size) = open(path)?;
        access.charge(path, "MERL table", MEMORY_BYTES)?;
        Self::read_sized(file, path, Some(size))
    }

    /// Reads a stream to its end; `path` is how errors call it.
    pub fn read_from(reader: impl Read, path: impl AsRef<Path>) -> Result<Self> {
        Self::read_sized(reader, path.as_ref(), None)
    }

    fn read_sized(mut reader: impl Read, path: &Path, size: Option<u64>) -> Result<Self> {
        let mut header = [0; 12];
        let got = fill(&mut reader, &mut header, path)?;
        if got < header.len() {
            return Err(wrong(path, format!("a MERL table has {FILE_BYTES} bytes, this file has {got}")));
        }
        check_header(&header, path)?;
        if let Some(size) = size.filter(|&size| size != FILE_BYTES) {
            let how = if size < FILE_BYTES { "is cut off" } else { "goes on after its end" };
            let message =
                format!("the table {how}: {size} bytes, {FILE_BYTES} expected; fetch or convert the file again");
            return Err(wrong(path, message));
        }
        let mut cells = Vec::new();
        let mut block = vec![0; BLOCK_BYTES];
        let mut odd = UnusualCells::default();
        for (plane, scale) in MERL_SCALES.into_iter().enumerate() {
            let mut at = 0;
            while at < MERL_CELLS {
                let wanted = (8 * (MERL_CELLS - at)).min(BLOCK_BYTES);
                let got = fill(&mut reader, &mut block[..wanted], path)?;
                if got < wanted {
                    let place = 12 + 8 * (plane * MERL_CELLS + at) + got;
                    let message = format!("the table is cut off: it ends at byte {place} of {FILE_BYTES}");
                    return Err(wrong(path, message));
                }
                if plane == 0 {
                    // Grows with the bytes received.
                    cells.resize(at + wanted / 8, [0.0; 3]);
                }
                for (cell, bytes) in cells[at..].iter_mut().zip(block[..wanted].chunks_exact(8)) {
                    let stored = LittleEndian::read_f64(bytes);
                    odd.count(stored);
                    cell[plane] = (stored * scale) as f32;
                }
                at += wanted / 8;
            }
        }
        if fill(&mut reader, &mut block[..1], path)? > 0 {
            return Err(wrong(path, format!("the table goes on after its end, byte {FILE_BYTES}")));
        }
        odd.check(path)?;
        let table = MerlTable::from_cells(cells).ok_or_else(|| wrong(path, "wrong number of cells".into()))?;
        if table.valid_count() == 0 {
            return Err(wrong(path, "no cell of the table is valid: every value is negative or not a number".into()));
        }
        Ok(table)
    }

    /// Writes the table as a file's bytes. Cells that are not valid get -1.
    pub fn write_to(&self, writer: impl Write) -> std::io::Result<()> {
        let mut writer = BufWriter::with_capacity(BLOCK_BYTES, writer);
        for count in COUNTS {
            writer.write_u32::<LittleEndian>(count)?;
        }
        for (plane, scale) in MERL_SCALES.into_iter().enumerate() {
            for cell in &self.cells {
                let value = cell[plane];
                let stored = if value.is_nan() { -1.0 } else { value as f64 / scale };
                writer.write_f64::<LittleEndian>(stored)?;
            }
        }
        writer.flush()
    }
}

/// Values that no table has, a sign of a damaged file.
#[derive(Default)]
struct UnusualCells {
    not_numbers: u64,
    beyond: u64,
}

impl UnusualCells {
    fn count(&mut self, stored: f64) {
        let magnitude = stored.abs();
        self.not_numbers += u64::from(!stored.is_finite());
        // Bytes in the wrong order make numbers of any magnitude.
        self.beyond += u64::from((magnitude > 1e12) | ((magnitude < 1e-30) & (magnitude > 0.0)));
    }
    fn check(&self, path: &Path) -> Result<()> {
        let most = MERL_CELLS as u64 / 4;
        if self.not_numbers > most {
            let message = format!(
                "{} of the {} values are not finite numbers: the table is damaged",
                self.not_numbers,
                3 * MERL_CELLS
            );
            return Err(wrong(path, message));
        }
        if self.beyond > most {
            let message = format!(
                "{} of the {} values have impossible magnitudes: doubles must be little-endian (or the table is damaged)",
                self.beyond,
                3 * MERL_CELLS
            );
            return Err(wrong(path, message));
        }
        Ok(())
    }
}

fn check_header(header: &[u8; 12], path: &Path) -> Result<()> {
    let counts = [0, 4, 8].map(|at| LittleEndian::read_u32(&header[at..]));
    if counts == COUNTS {
        return Ok(());
    }
    if [0, 4, 8].map(|at| BigEndian::read_u32(&header[at..])) == COUNTS {
        let message = "the header is big-endian (bytes in the wrong order); a MERL table is little-endian: swap the bytes of \
                       its three 4-byte counts and of its 8-byte values";
        return Err(wrong(path, message.into()));
    }
    let [h, d, p] = counts;
    let message = format!(
        "not a MERL table of an isotropic material: its header says {h} x {d} x {p} cells, 90 x 90 x 180 expected"
    );
    Err(wrong(path, message))
}

/// Reads until the buffer is full or the input ends.
fn fill(reader: &mut impl Read, buffer: &mut [u8], path: &Path) -> Result<usize> {
    let mut got = 0;
    while got < buffer.len() {
        match reader.read(&mut buffer[got..]) {
            Ok(0) => break,
            Ok(count) => got += count,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(Error::io(path, e)),
        }
    }
    Ok(got)
}

fn wrong(path: &Path, message: String) -> Error {
    Error::input(path, message)
}
