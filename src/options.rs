//! Options of the encoder.

use serde::{Deserialize, Serialize};

/// Method by which photographs are stored. See the chapter on profiles in `spec/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// The Wavelet-Texture method as published in 2007: residual volumes on surface patches (section `PAPR`).
    #[serde(alias = "paper")]
    WaveletTexture,
    /// Photograph planes predicted through the mesh (section `PLAN`).
    #[default]
    #[serde(alias = "tuned")]
    Predictive,
}

/// Bound that the encoding is to reach with as few bytes, or as little error, as possible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EncodeTarget {
    /// 0 to 100; every 25 halve the quantiser step. 75 is about 38 to 40 dB.
    Quality(f64),
    /// Image PSNR of the sum, in dB, at least.
    PsnrDb(f64),
    /// Bytes of the whole file, at most.
    MaxBytes(u64),
    /// Largest difference of the signal `sqrt(x / white)` on any covered pixel and colour of any component, at most.
    MaxError(f64),
    /// Coefficients kept, per cent (profile `wavelet-texture` only).
    KeepPercent(f64),
}

/// Trades file size for decoding speed (profile `predictive` only).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DecodeSpeed {
    /// By the size of the photographs: up to 1.5 megapixels the smallest file, above that as [`DecodeSpeed::Fast`] with predictions of at most
    /// 0.4 megapixels or an eighth of the size.
    #[serde(alias = "auto")]
    #[default]
    Automatic,
    /// The smallest file.
    #[serde(alias = "small")]
    Normal,
    /// About a fifth larger, a view in about a third of the time: predictions at half the size, and one or two symbols for a position's
    /// colours in place of up to a dozen mixed decisions.
    Fast,
    /// About a third larger, a view in about a fifth of the time: the same with predictions at a quarter of the size.
    Fastest,
}

/// Encoder options.
#[derive(Debug, Clone)]
pub struct EncodeOptions {
    /// Method by which photographs are stored.
    pub profile: Profile,
    /// Bound to reach; by default quality 75, in profile `wavelet-texture` 5 % of the coefficients.
    pub target: Option<EncodeTarget>,
    /// Trade of file size for decoding speed (profile `predictive` only).
    pub decode_speed: DecodeSpeed,
    /// Side of the tiles that the finest levels of fast files are cut into, in coefficients: a power of two, 16 to 4096 (profile
    /// `predictive` only). Tiles are decoded side by side; small ones cost bytes.
    pub tile_side: u32,
    /// Leaves every k-th view out (the k-th, the 2k-th ...), to measure views between the captured ones.
    pub hold_out: Option<usize>,
    /// Bits of a mesh coordinate on the longest side, 8 to 20. By default as many as move no vertex by more than an eighth
    /// of a pixel.
    pub position_bits: Option<u8>,
    /// Texels of the reflectance atlas for one pixel of the photographs, each way; fewer where the atlas would have more than about 4
    /// million.
    pub atlas_density: f64,
    /// Model that highlights are fitted with (profile `predictive` only).
    #[cfg(feature = "encode")]
    pub specular: SpecularModel,
    /// What is corrected by the photographs before they are encoded.
    pub refine: Refinement,
    /// Also keeps the sign of specular radiance below zero (noise and double bounces); profile `wavelet-texture` always does.
    pub signed_specular: bool,
    /// Light of the photographs; by default what the capture states of it, which this overrides.
    pub light: Option<CaptureLight>,
    /// Decodes the finished file as a reader does and compares every photograph with what the file states of it.
    pub check: bool,
    /// Keys for the file's metadata, such as `title`, `provenance`, `licence`, `units`.
    pub metadata: serde_json::Map<String, serde_json::Value>,
}

impl Default for EncodeOptions {
    fn default() -> Self {
        EncodeOptions {
            profile: Profile::Predictive,
            target: None,
            decode_speed: DecodeSpeed::default(),
            tile_side: 256,
            hold_out: None,
            position_bits: None,
            atlas_density: 0.4,
            #[cfg(feature = "encode")]
            specular: SpecularModel::default(),
            refine: Refinement::default(),
            signed_specular: false,
            light: None,
            check: true,
            metadata: serde_json::Map::new(),
        }
    }
}

/// What of a capture's geometry is corrected by its photographs before they are encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Refinement {
    /// [`Refinement::Surface`] where that is possible and holds, [`Refinement::None`] elsewhere.
    #[default]
    Automatic,
    /// Nothing.
    None,
    /// The surface: the mesh is subdivided and displaced until it explains the shading and the highlights of the photographs, and kept
    /// if it explains views that it was not fitted to. The file holds the displacements as an image (profile `predictive` only). Takes
    /// both components and known lights.
    Surface,
}

/// Light that photographs were taken in, where their capture does not state it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CaptureLight {
    /// A lamp that stands still relative to the camera: a flash, or the lamp of a turntable before a camera that stands still.
    Camera {
        /// From the camera to the lamp: to the right, upwards and backwards in the photograph, in world units. Fitted where it is `None`.
        offset: Option<[f64; 3]>,
        /// Radiant intensity, red, green, blue. `None`: white, and so strong that the object's brightest parts are nearly white.
        intensity: Option<[f64; 3]>,
    },
    /// A lamp that stands still relative to the object.
    Lamp {
        /// Place in the capture's coordinates.
        position: [f64; 3],
        /// As with [`CaptureLight::Camera`].
        intensity: Option<[f64; 3]>,
    },
    /// All that is around, standing still relative to the object: estimated from the photographs together with the diffuse reflectance
    /// (profile `predictive` only). The file holds it as its light.
    Environment {
        /// Mean radiance of all directions, red, green, blue. `None`: white, and such that the object's brightest parts are nearly white.
        mean_radiance: Option<[f64; 3]>,
    },
}

/// Model that highlights are fitted with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SpecularModel {
    /// [`SpecularModel::GgxLobes`] where the surface was refined, [`SpecularModel::TorranceSparrow`] where it stays as the mesh has it: on
    /// normals of a scan better lobes show nothing better.
    #[default]
    Automatic,
    /// Torrance and Sparrow's lobe for every texel.
    TorranceSparrow,
    /// Widths as in Torrance-Sparrow, shapes from a palette of measured lobes (DSBRDF).
    Dsbrdf,
    /// Weights of five GGX lobes of fixed roughness, above a diffuse layer under a dielectric surface.
    GgxLobes,
}
