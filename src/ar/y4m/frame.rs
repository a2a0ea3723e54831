//! Frames of YUV4MPEG2, and the images that they show.

use super::Y4mHeader;
use crate::error::{Error, Result};
use crate::image::Grid;
use crate::metrics::DisplayImage;

/// Frame of a stream of YUV4MPEG2: its planes, one after the other.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Y4mFrame {
    /// Parameters of the frame's own line.
    pub(super) parameters: String,
    pub(super) planes: Vec<u8>,
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
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for a header of frames of another size.
    pub fn to_image(&self, header: &Y4mHeader) -> Result<DisplayImage> {
        self.check(header)?;
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
        Ok(image)
    }

    fn check(&self, header: &Y4mHeader) -> Result<()> {
        let (found, needed) = (self.planes.len(), header.frame_bytes());
        let message = || Error::parameter(format!("a frame of {found} bytes where the video's have {needed}"));
        if found == needed { Ok(()) } else { Err(message()) }
    }

    /// Shows what `after` differs from `before` in, the image that this frame showed; samples of all else stay.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] for images or a header of another size.
    pub fn update(&mut self, header: &Y4mHeader, before: &DisplayImage, after: &DisplayImage) -> Result<()> {
        self.check(header)?;
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
