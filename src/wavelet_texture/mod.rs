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
pub use samples::{PosedPhotograph, WaveletSamples};

use crate::container::Tag;
use crate::quantise::dead_zone::DeadZone;
use crate::transform::colour::{ColourRotation, IDENTITY};

/// The section's four letters.
pub(crate) const TAG: Tag = Tag::WAVELET_TEXTURE;
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
    /// Of `sqrt(K_d)` and of the components' residuals.
    rotations: [ColourRotation; 3],
}

impl WaveletHeader {
    #[cfg(feature = "encode")]
    fn to_bytes(self) -> Vec<u8> {
        let flags = self.modelled as u8 | (self.relightable as u8) << 1 | (self.lobes as u8) << 2;
        let mut bytes = vec![VERSION, flags, self.components, self.view_levels];
        bytes.extend(self.views.to_le_bytes());
        bytes.extend(self.patches.to_le_bytes());
        let [threshold, step] = [self.quantiser.threshold, self.quantiser.step];
        for number in [threshold, step, self.diffuse_scale, self.diffuse_step, self.specular_scale] {
            bytes.extend(number.to_le_bytes());
        }
        for number in self.rotations.iter().flatten().flatten() {
            bytes.extend(number.to_le_bytes());
        }
        bytes
    }
    fn parse(bytes: &[u8]) -> crate::Result<WaveletHeader> {
        let wrong = |offset: usize, message: &str| crate::Error::format(TAG, offset as u64, message);
        let Some(header) = bytes.first_chunk::<HEADER_BYTES>() else {
            return Err(wrong(bytes.len(), "shorter than its header of 140 bytes"));
        };
        let [version, flags, components, view_levels] = [header[0], header[1], header[2], header[3]];
        if version != VERSION {
            return Err(crate::Error::Unsupported(format!("version {version} of section {TAG}")));
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
        let word = |offset: usize| -> [u8; 4] { std::array::from_fn(|i| header[offset + i]) };
        let number = |offset: usize| -> crate::Result<f32> {
            let number = f32::from_le_bytes(word(offset));
            let valid = number.is_finite() && (0.0..=1e30).contains(&number);
            if valid { Ok(number) } else { Err(wrong(offset, "a number in 0..=1e30 expected")) }
        };
        let mut rotations = [IDENTITY; 3];
        for (k, number) in rotations.iter_mut().flatten().flatten().enumerate() {
            *number = f32::from_le_bytes(word(32 + 4 * k));
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
            views: u32::from_le_bytes(word(4)),
            patches: u32::from_le_bytes(word(8)),
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
