//! Uncompressed video, YUV4MPEG2: a line with size and rate, then for each frame a line and its planes of 8-bit samples (MJPEG tools,
//! `yuv4mpeg(5)`). Frames are read and written one at a time, from and to streams that may never end.
//!
//! Colours are those of ITU-R BT.601, 16 to 235 unless the header says `XCOLORRANGE=FULL`. A sample of colour stands for the block of pixels
//! that it is the only one of; where within the block it was taken is not regarded.

use crate::error::{Error, Result};
use crate::image::Grid;
use crate::input::{FileAccess, quoted};
use crate::metrics::DisplayImage;
use std::io::{BufRead, Read, Write};
use std::path::{Path, PathBuf};

const MAGIC: &str = "YUV4MPEG2";
/// Bytes of a line, and pixels along a side and in all, at most.
const MAX_LINE: u64 = 1024;
const MAX_SIDE: usize = 16384;
const MAX_PIXELS: usize = 1 << 27;
/// Memory that a pixel takes beside its samples: the image before and after, bytes.
const BYTES_A_PIXEL: usize = 6;

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

/// Frame of a stream of YUV4MPEG2: its planes, one after the other.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Y4mFrame {
    /// Parameters of the frame's own line.
    parameters: String,
    planes: Vec<u8>,
}

impl Y4mFrame {
    /// Makes a frame that shows an image of the header's size.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for an image of another size.
    pub fn from_image(header: &Y4mHeader, image: &DisplayImage) -> Result<Self> {
        let mut planes = vec![128; header.frame_bytes()];
        let matrix = YcbcrMatrix::new(header.is_full_range);
        planes[..header.size[0] * header.size[1]].fill(matrix.black);
        let mut frame = Y4mFrame { parameters: String::new(), planes };
        let black = Grid::filled(header.size[0], header.size[1], [0; 3]);
        frame.update(header, &black, image)?;
        Ok(frame)
    }

    /// The image that it shows.
    pub fn to_image(&self, header: &Y4mHeader) -> DisplayImage {
        let ([width, height], matrix) = (header.size, YcbcrMatrix::new(header.is_full_range));
        let mut image = Grid::filled(width, height, [0; 3]);
        let [columns, rows] = header.colour_size();
        let planes = &self.planes;
        crate::parallel::for_each_chunk(&mut image.data, width, |y, row| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let colour = header.colour_at(x, y).map(|at| [planes[at], planes[at + columns * rows]]);
                *pixel = matrix.rgb(planes[y * width + x], colour.unwrap_or([128; 2]));
            }
        });
        image
    }

    /// Shows what `after` differs from `before` in, the image that this frame showed; samples of all else stay.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for images of another size than the header's.
    pub fn update(&mut self, header: &Y4mHeader, before: &DisplayImage, after: &DisplayImage) -> Result<()> {
        let [width, height] = header.size;
        if [[before.width, before.height], [after.width, after.height]] != [header.size; 2] {
            return Err(Error::parameter(format!("an image of another size than the video's {width} x {height}")));
        }
        let matrix = YcbcrMatrix::new(header.is_full_range);
        let ([columns, rows], pixels) = (header.colour_size(), width * height);
        let is_changed = |k: usize| before.data[k] != after.data[k];
        let (luma, colours) = self.planes.split_at_mut(pixels);
        for (k, sample) in luma.iter_mut().enumerate().filter(|(k, _)| is_changed(*k)) {
            *sample = matrix.luma(after.data[k]);
        }
        let Some([across, down]) = header.chroma.block() else { return Ok(()) };
        let (blue, red) = colours.split_at_mut(columns * rows);
        for block in 0..columns * rows {
            let (left, top) = (block % columns * across, block / columns * down);
            let (mut sum, mut count) = ([0.0f32; 2], 0.0);
            let mut any = false;
            for y in top..(top + down).min(height) {
                for k in (left..(left + across).min(width)).map(|x| y * width + x) {
                    count += 1.0;
                    if is_changed(k) {
                        any = true;
                        let (new, old) = (matrix.colour(after.data[k]), matrix.colour(before.data[k]));
                        (0..2).for_each(|c| sum[c] += new[c] - old[c]);
                    }
                }
            }
            if any {
                for (plane, sum) in [&mut *blue, &mut *red].into_iter().zip(sum) {
                    plane[block] = (f32::from(plane[block]) + sum / count).round().clamp(0.0, 255.0) as u8;
                }
            }
        }
        Ok(())
    }
}

/// Weights of BT.601 (equations of ITU-R BT.601-7, section 2.5.1), scaled to the range of the samples.
struct YcbcrMatrix {
    black: u8,
    /// Codes of luma and of colour over those of red, green, blue.
    luma_scale: f32,
    colour_scale: f32,
}

/// Shares of red, green and blue in luma.
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

impl YcbcrMatrix {
    fn new(is_full_range: bool) -> Self {
        match is_full_range {
            true => YcbcrMatrix { black: 0, luma_scale: 1.0, colour_scale: 1.0 },
            false => YcbcrMatrix { black: 16, luma_scale: 219.0 / 255.0, colour_scale: 224.0 / 255.0 },
        }
    }

    #[inline]
    fn rgb(&self, luma: u8, [blue, red]: [u8; 2]) -> [u8; 3] {
        let y = (f32::from(luma) - f32::from(self.black)) / self.luma_scale;
        let [u, v] = [blue, red].map(|c| (f32::from(c) - 128.0) / self.colour_scale);
        let [r, _, b] = LUMA;
        let (from_red, from_blue) = (2.0 * (1.0 - r) * v, 2.0 * (1.0 - b) * u);
        let green = y - (r * from_red + b * from_blue) / LUMA[1];
        // Rounded by adding a half; the conversion clamps.
        [y + from_red, green, y + from_blue].map(|c| (c + 0.5) as u8)
    }

    #[inline]
    fn luma(&self, rgb: [u8; 3]) -> u8 {
        let y: f32 = (0..3).map(|c| LUMA[c] * f32::from(rgb[c])).sum();
        (f32::from(self.black) + self.luma_scale * y + 0.5) as u8
    }

    /// Blue and red less luma, in codes.
    #[inline]
    fn colour(&self, rgb: [u8; 3]) -> [f32; 2] {
        let y: f32 = (0..3).map(|c| LUMA[c] * f32::from(rgb[c])).sum();
        let [r, _, b] = rgb.map(f32::from);
        [0.5 * (b - y) / (1.0 - LUMA[2]), 0.5 * (r - y) / (1.0 - LUMA[0])].map(|c| c * self.colour_scale)
    }
}

/// Reads a stream of YUV4MPEG2 frame by frame.
pub struct Y4mReader<R> {
    stream: R,
    path: PathBuf,
    header: Y4mHeader,
    frames: usize,
}

impl<R: BufRead> Y4mReader<R> {
    /// Reads the header; errors name `path`. Memory of a frame is charged to `access` for good.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] for no such stream, [`Error::InputMemory`] for frames that are too large.
    pub fn new(mut stream: R, path: &Path, access: &FileAccess) -> Result<Self> {
        let line = read_line(&mut stream, path, "the header")?.unwrap_or_default();
        let header = Y4mHeader::parse(&line, path)?;
        let pixels = header.size[0] * header.size[1];
        access.charge(path, "video frame", (header.frame_bytes() + BYTES_A_PIXEL * pixels) as u64)?;
        Ok(Y4mReader { stream, path: path.to_owned(), header, frames: 0 })
    }

    /// The stream's header.
    pub fn header(&self) -> &Y4mHeader {
        &self.header
    }

    /// Reads the next frame into `frame`; `false` at the end of the stream. Nothing is read beyond the frame but what the stream buffers.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] where the stream ends within a frame, or goes on with something else.
    pub fn read_frame(&mut self, frame: &mut Y4mFrame) -> Result<bool> {
        let number = self.frames;
        let Some(line) = read_line(&mut self.stream, &self.path, &format!("frame {number}"))? else { return Ok(false) };
        let Some(parameters) = line.strip_prefix("FRAME").filter(|rest| rest.is_empty() || rest.starts_with(' '))
        else {
            let message = format!("frame {number} begins with {}, not with FRAME", quoted(&line));
            return Err(Error::input(&self.path, message));
        };
        parameters.clone_into(&mut frame.parameters);
        let bytes = self.header.frame_bytes();
        frame.planes.clear();
        // Grows with what comes; later frames find the memory there.
        let read = (&mut self.stream).take(bytes as u64).read_to_end(&mut frame.planes);
        let got = read.map_err(|e| Error::io(&self.path, e))?;
        if got < bytes {
            let message = format!("frame {number}: the stream ends after {got} of its {bytes} bytes");
            return Err(Error::input(&self.path, message));
        }
        self.frames += 1;
        Ok(true)
    }
}

/// A line without its end; `None` at the end of the stream.
fn read_line(stream: &mut impl BufRead, path: &Path, what: &str) -> Result<Option<String>> {
    let mut line = Vec::new();
    let read = stream.take(MAX_LINE).read_until(b'\n', &mut line);
    read.map_err(|e| Error::io(path, e))?;
    if line.is_empty() {
        return Ok(None);
    }
    if line.pop() != Some(b'\n') {
        let message = format!("{what}: no line of up to {MAX_LINE} bytes; is it YUV4MPEG2, and whole?");
        return Err(Error::input(path, message));
    }
    let line = String::from_utf8(line).map_err(|_| Error::input(path, format!("{what}: its line is no text")))?;
    Ok(Some(line))
}

/// Writes a stream of YUV4MPEG2 frame by frame.
pub struct Y4mWriter<W> {
    stream: W,
    path: PathBuf,
}

impl<W: Write> Y4mWriter<W> {
    /// Writes the header; errors name `path`.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if the stream takes no more.
    pub fn new(mut stream: W, path: &Path, header: &Y4mHeader) -> Result<Self> {
        stream.write_all(header.line().as_bytes()).map_err(|e| Error::io(path, e))?;
        Ok(Y4mWriter { stream, path: path.to_owned() })
    }

    /// Writes a frame and flushes it.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if the stream takes no more; of kind [`std::io::ErrorKind::BrokenPipe`] if nobody reads it any longer.
    pub fn write_frame(&mut self, frame: &Y4mFrame) -> Result<()> {
        let line = format!("FRAME{}\n", frame.parameters);
        let written = self.stream.write_all(line.as_bytes()).and_then(|()| self.stream.write_all(&frame.planes));
        written.and_then(|()| self.stream.flush()).map_err(|e| Error::io(&self.path, e))
    }

    /// Flushes the stream and hands it back.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if that fails.
    pub fn finish(mut self) -> Result<W> {
        self.stream.flush().map_err(|e| Error::io(&self.path, e))?;
        Ok(self.stream)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Y4mHeader> {
        Y4mHeader::parse(line, Path::new("-"))
    }

    fn reader(bytes: &[u8]) -> Result<Y4mReader<&[u8]>> {
        Y4mReader::new(bytes, Path::new("-"), &FileAccess::default())
    }

    /// A stream of one frame with a gradient, and that frame.
    fn stream(chroma: &str, [width, height]: [usize; 2]) -> (Vec<u8>, usize) {
        let mut bytes = format!("YUV4MPEG2 W{width} H{height} F30000:1001 Ip A1:1 C{chroma} XYSCSS=ANY\n").into_bytes();
        let header = parse(std::str::from_utf8(&bytes).unwrap().trim_end()).unwrap();
        bytes.extend(b"FRAME Ip\n");
        bytes.extend((0..header.frame_bytes()).map(|k| (40 + k * 7 % 170) as u8));
        (bytes, header.frame_bytes())
    }

    #[test]
    fn streams_come_back_and_only_changes_are_written() {
        for (chroma, bytes) in
            [("420jpeg", 35 + 24), ("420mpeg2", 59), ("420paldv", 59), ("422", 35 + 40), ("444", 105), ("mono", 35)]
        {
            let (stream, length) = stream(chroma, [7, 5]);
            assert_eq!(length, bytes, "{chroma}");
            let mut reader = reader(&stream).unwrap();
            let header = reader.header().clone();
            assert_eq!((header.size(), header.rate()), ([7, 5], Some([30000, 1001])));
            let mut frame = Y4mFrame::default();
            assert!(reader.read_frame(&mut frame).unwrap());
            let before = frame.to_image(&header);
            let mut writer = Y4mWriter::new(Vec::new(), Path::new("-"), &header).unwrap();
            let mut same = frame.clone();
            same.update(&header, &before, &before).unwrap();
            writer.write_frame(&same).unwrap();
            assert_eq!(writer.finish().unwrap(), stream, "{chroma}");
            // One pixel: its luma, and the sample of each colour that it shares.
            let mut after = before.clone();
            *after.value_at_mut(6, 4) = [200, 60, 90];
            let mut changed = frame.clone();
            changed.update(&header, &before, &after).unwrap();
            let count = changed.planes.iter().zip(&frame.planes).filter(|(a, b)| a != b).count();
            let expected = if chroma == "mono" { 1 } else { 3 };
            assert_eq!(count, expected, "{chroma}");
            assert!(!reader.read_frame(&mut frame).unwrap());
        }
    }

    #[test]
    fn colours_are_those_of_bt601() {
        for (header, tolerance) in [
            (Y4mHeader::new([4, 1], [25, 1]).unwrap(), 2),
            (parse("YUV4MPEG2 W4 H1 F25:1 C444 XCOLORRANGE=FULL").unwrap(), 1),
        ] {
            let image =
                Grid { width: 4, height: 1, data: vec![[255, 255, 255], [255, 0, 0], [10, 200, 30], [0, 0, 0]] };
            let frame = Y4mFrame::from_image(&header, &image).unwrap();
            let back = frame.to_image(&header);
            for (a, b) in back.data.iter().zip(&image.data) {
                assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= tolerance), "{a:?} {b:?}");
            }
            let white = if header.is_full_range { [255, 128, 128] } else { [235, 128, 128] };
            assert_eq!([0, 4, 8].map(|at| frame.planes[at]), white);
        }
        // Red of BT.601 within 16 to 235: Y 81, Cb 90, Cr 240.
        let red = Grid { width: 1, height: 1, data: vec![[255, 0, 0]] };
        let frame = Y4mFrame::from_image(&Y4mHeader::new([1, 1], [25, 1]).unwrap(), &red).unwrap();
        assert_eq!(frame.planes, [81, 90, 240]);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let fault = |line: &str| parse(line).unwrap_err().to_string();
        for (line, said) in [
            ("RIFF", "no YUV4MPEG2 stream"),
            ("YUV4MPEG2 W4 H4 F25:1 C420p10", "not supported: -: samples of colour \"420p10\""),
            ("YUV4MPEG2 W4 H4 F25:1 C444alpha", "444alpha"),
            ("YUV4MPEG2 W4 H4 F25:1 C411", "411"),
            ("YUV4MPEG2 W4 F25:1", "no height"),
            ("YUV4MPEG2 W0 H4 F25:1", "0 x 4"),
            ("YUV4MPEG2 W4 H99999 F25:1", "4 x 99999"),
            ("YUV4MPEG2 W16384 H16384", "16384 x 16384"),
            ("YUV4MPEG2 W4 W4 H4", "a second \"W4\""),
            ("YUV4MPEG2 W-4 H4", "no number of pixels"),
            ("YUV4MPEG2 W4 H4 F25", "no rate"),
            ("YUV4MPEG2 W4 H4 Q7", "unknown parameter \"Q7\""),
        ] {
            assert!(fault(line).contains(said), "{line}: {}", fault(line));
        }
        assert_eq!(parse("YUV4MPEG2 W4 H4 F0:0").unwrap().rate(), None);
        let (whole, _) = stream("420jpeg", [7, 5]);
        let ends = |length: usize| {
            let mut reader = reader(&whole[..length])?;
            let mut frame = Y4mFrame::default();
            while reader.read_frame(&mut frame)? {}
            Ok::<_, Error>(())
        };
        let header = whole.iter().position(|&b| b == b'\n').unwrap() + 1;
        for length in (0..whole.len()).filter(|&length| length != header) {
            let said = ends(length).unwrap_err().to_string();
            assert!(said.starts_with("-: "), "{length}: {said}");
        }
        assert!(ends(header).is_ok() && ends(whole.len()).is_ok());
        assert!(
            ends(whole.len() - 1)
                .unwrap_err()
                .to_string()
                .contains("frame 0: the stream ends after 58 of its 59 bytes")
        );
        let odd = [&whole[..], b"FRAMES\n"].concat();
        let mut reader = reader(&odd).unwrap();
        assert!(reader.read_frame(&mut Y4mFrame::default()).unwrap());
        let said = reader.read_frame(&mut Y4mFrame::default()).unwrap_err().to_string();
        assert!(said.contains("frame 1 begins with \"FRAMES\""), "{said}");
        let limits = crate::limits::Limits { memory_bytes: 1000, ..Default::default() };
        let small = Y4mReader::new(&b"YUV4MPEG2 W1000 H1000\n"[..], Path::new("-"), &FileAccess::new(limits));
        assert!(small.err().unwrap().to_string().contains("memory_bytes"));
        assert!(reader_of_nothing().contains("no YUV4MPEG2 stream"));
    }

    fn reader_of_nothing() -> String {
        reader(b"").err().unwrap().to_string()
    }
}
