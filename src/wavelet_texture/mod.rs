//! Profile `wavelet-texture`: the Wavelet-Texture method of Miyazaki, Shibata and Ikeuchi (2007) as a real bitstream.
//!
//! Photographs are read at the samples of surface patches; a reflection model is fitted; what it leaves is a volume
//! (u, v, view) per patch, of whose wavelet coefficients the largest are kept. `spec/wavelet-texture.md` describes the section.

pub(crate) mod decode;
#[cfg(feature = "encode")]
pub(crate) mod encode;
#[cfg(feature = "encode")]
pub(crate) mod fit;
pub(crate) mod layout;
pub(crate) mod model;
#[cfg(feature = "encode")]
pub(crate) mod samples;
mod stream;

pub(crate) use decode::DecodedWaveletTexture;
pub use decode::decode;
#[cfg(feature = "encode")]
pub(crate) use encode::encode_to_target;
#[cfg(feature = "encode")]
pub use encode::{EncodedWaveletTexture, WaveletOptions, WaveletSampleError, encode};
#[cfg(feature = "encode")]
pub use samples::WaveletSamples;

use crate::container::Tag;
#[cfg(feature = "encode")]
use crate::container::{push_f32, push_u32};
use crate::quantise::dead_zone::DeadZone;
use crate::transform::colour::{ColourRotation, IDENTITY};
use byteorder::{ByteOrder, LittleEndian};

/// Version of the section; 0 is experimental.
const VERSION: u8 = 0;
/// Bytes before the range coded part.
const HEADER_BYTES: usize = 32 + 3 * 36;
/// Most levels of the transform along the views.
const MAX_VIEW_LEVELS: u8 = 7;

/// The section's fixed part.
#[derive(Debug, Clone, Copy, PartialEq)]
struct WaveletHeader {
    modelled: bool,
    relightable: bool,
    lobes: bool,
    components: u8,
    view_levels: u8,
    views: u32,
    patches: u32,
    quantiser: DeadZone,
    diffuse_scale: f32,
    diffuse_step: f32,
    specular_scale: f32,
    /// Colour rotations of `sqrt(K_d)` and of the components' residuals.
    rotations: [ColourRotation; 3],
}

impl WaveletHeader {
    #[cfg(feature = "encode")]
    fn to_bytes(self) -> Vec<u8> {
        let flags = self.modelled as u8 | (self.relightable as u8) << 1 | (self.lobes as u8) << 2;
        let mut bytes = vec![VERSION, flags, self.components, self.view_levels];
        push_u32(&mut bytes, self.views);
        push_u32(&mut bytes, self.patches);
        let [threshold, step] = [self.quantiser.threshold, self.quantiser.step];
        for number in [threshold, step, self.diffuse_scale, self.diffuse_step, self.specular_scale] {
            push_f32(&mut bytes, number);
        }
        for &number in self.rotations.iter().flatten().flatten() {
            push_f32(&mut bytes, number);
        }
        bytes
    }
    fn parse(bytes: &[u8]) -> crate::Result<WaveletHeader> {
        let wrong = |offset: usize, message: &str| crate::Error::format(Tag::WAVELET_TEXTURE, offset as u64, message);
        let Some(header) = bytes.first_chunk::<HEADER_BYTES>() else {
            return Err(wrong(bytes.len(), "shorter than its header of 140 bytes"));
        };
        let [version, flags, components, view_levels] = [header[0], header[1], header[2], header[3]];
        if version != VERSION {
            return Err(crate::Error::Unsupported(format!("version {version} of section {}", Tag::WAVELET_TEXTURE)));
        }
        if flags > 7 {
            return Err(wrong(1, "reserved bits are set"));
        }
        if !(1..=2).contains(&components) {
            return Err(wrong(2, "one or two components expected"));
        }
        if view_levels > MAX_VIEW_LEVELS {
            return Err(wrong(3, "at most 7 levels along the views"));
        }
        let number = |offset: usize| -> crate::Result<f32> {
            let number = LittleEndian::read_f32(&header[offset..]);
            let valid = number.is_finite() && (0.0..=1e30).contains(&number);
            if valid { Ok(number) } else { Err(wrong(offset, "a number in 0..=1e30 expected")) }
        };
        let mut rotations = [IDENTITY; 3];
        for (k, number) in rotations.iter_mut().flatten().flatten().enumerate() {
            *number = LittleEndian::read_f32(&header[32 + 4 * k..]);
            if !(-1.001..=1.001).contains(number) {
                return Err(wrong(32 + 4 * k, "a rotation's element in -1..=1 expected"));
            }
        }
        Ok(WaveletHeader {
            modelled: flags & 1 != 0,
            relightable: flags & 2 != 0,
            lobes: flags & 4 != 0,
            components,
            view_levels,
            views: LittleEndian::read_u32(&header[4..]),
            patches: LittleEndian::read_u32(&header[8..]),
            quantiser: DeadZone { threshold: number(12)?, step: number(16)? },
            diffuse_scale: number(20)?,
            diffuse_step: number(24)?,
            specular_scale: number(28)?,
            rotations,
        })
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests;
