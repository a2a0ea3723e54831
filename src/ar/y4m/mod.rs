//! Uncompressed video, YUV4MPEG2: a line with size and rate, then for each frame a line and its planes of 8-bit samples (MJPEG tools,
//! `yuv4mpeg(5)`). Frames are read and written one at a time, from and to streams that may never end.
//!
//! Colours are those of ITU-R BT.601, 16 to 235 unless the header says `XCOLORRANGE=FULL`. A sample of colour stands for the block of pixels
//! that it is the only one of; where within the block it was taken is not regarded.

mod frame;
mod stream;
#[cfg(test)]
mod tests;

pub use frame::Y4mFrame;
pub use stream::{Y4mReader, Y4mWriter};

use crate::error::{Error, Result};
use crate::input::quoted;
use std::path::Path;

const MAGIC: &str = "YUV4MPEG2";
/// Pixels along a side and in all, at most.
const MAX_SIDE: usize = 16384;
const MAX_PIXELS: usize = 1 << 27;

/// Samples of colour in a frame of YUV4MPEG2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Y4mChroma {
    /// None.
    Mono,
    /// One for two by two pixels: `420`, `420jpeg`, `420mpeg2`, `420paldv`.
    TwoByTwo,
    /// One for two pixels of a row: `422`.
    TwoByOne,
    /// One for each pixel: `444`.
    Each,
}

impl Y4mChroma {
    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "mono" => Y4mChroma::Mono,
            "420" | "420jpeg" | "420mpeg2" | "420paldv" => Y4mChroma::TwoByTwo,
            "422" => Y4mChroma::TwoByOne,
            "444" => Y4mChroma::Each,
            _ => return None,
        })
    }

    /// Pixels along the sides of a sample's block; `None` without colours.
    fn block(self) -> Option<[usize; 2]> {
        match self {
            Y4mChroma::Mono => None,
            Y4mChroma::TwoByTwo => Some([2, 2]),
            Y4mChroma::TwoByOne => Some([2, 1]),
            Y4mChroma::Each => Some([1, 1]),
        }
    }
}

/// First line of a stream of YUV4MPEG2.
#[derive(Debug, Clone, PartialEq)]
pub struct Y4mHeader {
    size: [usize; 2],
    rate: Option<[u32; 2]>,
    chroma: Y4mChroma,
    is_full_range: bool,
    /// Parameters that are handed on as they are: interlacing, shape of the pixels, samples of colour, extensions.
    others: Vec<String>,
}

impl Y4mHeader {
    /// Makes a header for frames with a sample of colour for each pixel; the rate is a fraction of frames a second.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a size of 0 or more than 16384 pixels a side or 2^27 in all, or a rate with a 0 in it.
    pub fn new(size: [usize; 2], rate: [u32; 2]) -> Result<Self> {
        if !is_size(size) || rate.contains(&0) {
            let ([width, height], [a, b]) = (size, rate);
            return Err(Error::parameter(format!(
                "no video has {width} x {height} pixels and {a}/{b} frames a second"
            )));
        }
        let others = ["Ip", "A1:1", "C444", "XCOLORRANGE=LIMITED"].map(String::from).to_vec();
        Ok(Y4mHeader { size, rate: Some(rate), chroma: Y4mChroma::Each, is_full_range: false, others })
    }

    /// Parses a header's line, without its end.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] of `path`, [`Error::Unsupported`] for samples of colour of other kinds than those of [`Y4mChroma`].
    pub fn parse(line: &str, path: &Path) -> Result<Self> {
        let fault = |message: String| Error::input(path, message);
        let mut words = line.split(' ');
        if words.next() != Some(MAGIC) {
            return Err(fault(format!("no YUV4MPEG2 stream: it begins with {}", quoted(line))));
        }
        let (mut size, mut rate, mut chroma, mut is_full_range) = ([None; 2], None, None, false);
        let mut others = Vec::new();
        for word in words.filter(|word| !word.is_empty()) {
            let mut letters = word.chars();
            let (kind, value) = (letters.next(), letters.as_str());
            let wrong = |what: &str| fault(format!("{what} {} in its header", quoted(word)));
            match kind {
                Some(side @ ('W' | 'H')) => {
                    let number = value.parse().map_err(|_| wrong("no number of pixels:"))?;
                    if size[usize::from(side == 'H')].replace(number).is_some() {
                        return Err(wrong("a second"));
                    }
                }
                Some('F') => {
                    let parts = value.split_once(':').and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?]));
                    let parts: [u32; 2] = parts.ok_or_else(|| wrong("no rate of frames:"))?;
                    // 0:0 is a rate that is not known.
                    rate = (!parts.contains(&0)).then_some(parts);
                }
                Some('C') => {
                    let known = Y4mChroma::from_name(value).ok_or_else(|| {
                        let known = "420jpeg, 420mpeg2, 420paldv, 422, 444 and mono of 8 bits";
                        Error::Unsupported(format!(
                            "{}: samples of colour {}; known: {known}",
                            path.display(),
                            quoted(value)
                        ))
                    })?;
                    if chroma.replace(known).is_some() {
                        return Err(wrong("a second"));
                    }
                    others.push(word.to_owned());
                }
                Some('X') => {
                    is_full_range |= value == "COLORRANGE=FULL";
                    others.push(word.to_owned());
                }
                Some('I' | 'A') => others.push(word.to_owned()),
                _ => return Err(wrong("unknown parameter")),
            }
        }
        let [Some(width), Some(height)] = size else {
            return Err(fault("its header has no width or no height".into()));
        };
        if !is_size([width, height]) {
            return Err(fault(format!(
                "frames of {width} x {height} pixels; 1 to {MAX_SIDE} a side and {MAX_PIXELS} in all are read"
            )));
        }
        // What the format's first version had.
        let chroma = chroma.unwrap_or(Y4mChroma::TwoByTwo);
        Ok(Y4mHeader { size: [width, height], rate, chroma, is_full_range, others })
    }

    /// Width and height.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Frames a second, as a fraction; `None` where the stream does not say.
    pub fn rate(&self) -> Option<[u32; 2]> {
        self.rate
    }

    /// Samples of colour.
    pub fn chroma(&self) -> Y4mChroma {
        self.chroma
    }

    /// Returns the header with another rate.
    pub fn with_rate(&self, rate: [u32; 2]) -> Self {
        Y4mHeader { rate: Some(rate), ..self.clone() }
    }

    /// The line that says so, with its end.
    fn line(&self) -> String {
        let [width, height] = self.size;
        let [a, b] = self.rate.unwrap_or([0, 0]);
        let others: String = self.others.iter().map(|word| format!(" {word}")).collect();
        format!("{MAGIC} W{width} H{height} F{a}:{b}{others}\n")
    }

    /// Width and height of a plane of colour.
    fn colour_size(&self) -> [usize; 2] {
        let [width, height] = self.size;
        self.chroma.block().map_or([0; 2], |[across, down]| [width.div_ceil(across), height.div_ceil(down)])
    }

    /// Bytes of a frame's planes.
    pub fn frame_bytes(&self) -> usize {
        let ([width, height], [columns, rows]) = (self.size, self.colour_size());
        width * height + 2 * columns * rows
    }

    /// Offset of the sample of the first colour that belongs to a pixel.
    fn colour_at(&self, x: usize, y: usize) -> Option<usize> {
        let [across, down] = self.chroma.block()?;
        Some(self.size[0] * self.size[1] + y / down * self.colour_size()[0] + x / across)
    }
}

fn is_size([width, height]: [usize; 2]) -> bool {
    let sides = 1..=MAX_SIDE;
    sides.contains(&width) && sides.contains(&height) && width * height <= MAX_PIXELS
}
