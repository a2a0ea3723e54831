//! Frames of a camera in memory, and the display's curve as tables.

use crate::error::{Error, Result};
use crate::image::read::{ColorSpace, read_display_image, read_radiance_image};
use crate::image::{Grid, ImageOrientation, Mask, RgbImage, from_srgb, to_srgb};
use crate::input::FileAccess;
use crate::metrics::{DisplayImage, to_display};
use std::path::Path;

/// A camera's image, which an object is put into: 8 bits, sRGB, or linear radiance. Pixels that nothing is put over stay as they are.
#[derive(Debug, Clone, PartialEq)]
pub enum Plate {
    /// 8-bit sRGB values.
    Display(DisplayImage),
    /// Linear; 1 is white.
    Linear(RgbImage),
}

impl Plate {
    /// Width and height.
    pub fn size(&self) -> [usize; 2] {
        match self {
            Plate::Display(picture) => [picture.width, picture.height],
            Plate::Linear(image) => [image.width, image.height],
        }
    }

    /// Reads a photograph: PNG, JPEG and TIFF of 8 bits are taken as they are, others (EXR, HDR, 16 bits) as linear radiance. It is turned as its
    /// orientation says.
    pub fn read(path: &Path, access: &FileAccess) -> Result<Self> {
        Ok(Plate::read_with_orientation(path, access)?.0)
    }

    /// As [`Plate::read`], with the orientation that the photograph was stored in.
    pub fn read_with_orientation(path: &Path, access: &FileAccess) -> Result<(Self, ImageOrientation)> {
        Ok(match read_display_image(path, access)? {
            Some((picture, orientation)) => (Plate::Display(picture), orientation),
            // Which also says what is wrong with a damaged one.
            None => {
                let picture = read_radiance_image(path, access, &ColorSpace::from_files(), None)?;
                (Plate::Linear(picture.colour), picture.orientation)
            }
        })
    }

    /// Makes a plate of rows of red, green, blue bytes.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if the number of bytes is another.
    pub fn from_bytes(width: usize, height: usize, bytes: &[u8]) -> Result<Self> {
        let (data, rest) = bytes.as_chunks::<3>();
        if data.len() != width * height || !rest.is_empty() {
            return Err(Error::parameter(format!("{} bytes are no {width} x {height} pixels of 3", bytes.len())));
        }
        Ok(Plate::Display(Grid { width, height, data: data.to_vec() }))
    }

    /// 8-bit sRGB values.
    pub fn to_display(&self) -> DisplayImage {
        match self {
            Plate::Display(picture) => picture.clone(),
            Plate::Linear(image) => to_display(image, [1.0; 3]),
        }
    }

    /// Returns linear radiance.
    pub fn to_linear(&self) -> RgbImage {
        match self {
            Plate::Display(picture) => {
                let linear: [f32; 256] = std::array::from_fn(|k| from_srgb(k as f64 / 255.0) as f32);
                picture.map(|p| p.map(|c| linear[c as usize]))
            }
            Plate::Linear(image) => image.clone(),
        }
    }

    /// Pixels that show what is in front of the object are put back from `before`.
    pub(super) fn restore(&mut self, before: &Plate, nearer: &Mask) -> Result<()> {
        if [nearer.width, nearer.height] != self.size() {
            let ([width, height], mask) = (self.size(), (nearer.width, nearer.height));
            return Err(Error::parameter(format!(
                "the occlusion mask has {} x {} pixels, the frame {width} x {height}",
                mask.0, mask.1
            )));
        }
        let nearer = nearer.data.iter().enumerate().filter(|(_, near)| **near).map(|(k, _)| k);
        match (self, before) {
            (Plate::Display(to), Plate::Display(from)) => nearer.for_each(|k| to.data[k] = from.data[k]),
            (Plate::Linear(to), Plate::Linear(from)) => nearer.for_each(|k| to.data[k] = from.data[k]),
            _ => {}
        }
        Ok(())
    }
}

/// Steps of the tables that encode, by the square root of the linear value: finer than a twentieth of a code.
const STEPS: usize = 1 << 13;

/// sRGB's curve, both ways, for 8-bit images.
pub(super) struct SrgbCurve {
    linear: [f32; 256],
    display: Vec<f32>,
    codes: Vec<u8>,
}

impl SrgbCurve {
    pub(super) fn new() -> Self {
        let linear = std::array::from_fn(|k| from_srgb(k as f64 / 255.0) as f32);
        let display = (0..=STEPS + 1).map(|k| 255.0 * to_srgb((k as f64 / STEPS as f64).powi(2).min(1.0)) as f32);
        let display: Vec<f32> = display.collect();
        let codes = display.iter().map(|value| value.round() as u8).collect();
        SrgbCurve { linear, display, codes }
    }

    pub(super) fn linear(&self, code: [u8; 3]) -> [f32; 3] {
        code.map(|c| self.linear[c as usize])
    }

    /// Display value, 0 to 255, not rounded; 0 for what is not a number.
    pub(super) fn display(&self, linear: f32) -> f32 {
        let place = linear.clamp(0.0, 1.0).sqrt() * STEPS as f32;
        // A NaN becomes 0.
        let k = place as usize;
        let part = (place - k as f32).max(0.0);
        self.display[k] + (self.display[k + 1] - self.display[k]) * part
    }

    /// [`Self::display`] rounded.
    #[inline]
    pub(super) fn codes(&self, linear: [f32; 3]) -> [u8; 3] {
        // Rounded by adding what has no room for parts. A NaN becomes 0.
        const WHOLE: f32 = (1 << 23) as f32;
        let places = linear.map(|x| (x.sqrt() * STEPS as f32).max(0.0).min(STEPS as f32) + WHOLE);
        places.map(|place| self.codes[(place.to_bits() & (2 * STEPS as u32 - 1)) as usize])
    }

    /// Linear value of a display value, 0 to 255, between the whole ones.
    pub(super) fn linear_of_display(&self, display: f32) -> f32 {
        let display = display.clamp(0.0, 255.0);
        let k = (display as usize).min(254);
        self.linear[k] + (self.linear[k + 1] - self.linear[k]) * (display - k as f32)
    }

    /// Grey values as displayed, from green and a little of the others.
    pub(super) fn grey(&self, plate: &Plate) -> Grid<u8> {
        let mean = |[r, g, b]: [f32; 3]| (0.25 * r + 0.5 * g + 0.25 * b).round() as u8;
        match plate {
            Plate::Display(picture) => picture.map(|p| ((p[0] as u16 + 2 * p[1] as u16 + p[2] as u16 + 2) / 4) as u8),
            Plate::Linear(image) => image.map(|p| mean(p.map(|c| self.display(c)))),
        }
    }

    /// Linear values of one pixel.
    pub(super) fn pixel(&self, plate: &Plate, k: usize) -> [f32; 3] {
        match plate {
            Plate::Display(picture) => self.linear(picture.data[k]),
            Plate::Linear(image) => image.data[k].map(|c| if c.is_finite() { c } else { 0.0 }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_come_back() {
        let curve = SrgbCurve::new();
        for code in 0..=255u8 {
            let [linear, ..] = curve.linear([code; 3]);
            assert!((curve.display(linear) - code as f32).abs() < 0.02, "{code}: {}", curve.display(linear));
            assert_eq!(curve.codes([linear; 3]), [code; 3]);
            assert!((curve.linear_of_display(code as f32) - linear).abs() < 1e-6);
        }
        assert_eq!((curve.display(f32::NAN), curve.display(-1.0), curve.display(9.0)), (0.0, 0.0, 255.0));
        assert_eq!(curve.codes([f32::NAN, -1.0, 9.0]), [0, 0, 255]);
    }
}
