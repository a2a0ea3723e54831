//! Stages below the public modules, for the project's own tests, benchmarks, fuzz targets and test vectors. No part of the public interface:
//! it changes without notice.

#![allow(missing_docs)]

#[cfg(feature = "encode")]
pub use crate::separate::MaskedPhotographs;
#[cfg(feature = "encode")]
pub use crate::views::source::PhotographSource;

pub mod container {
    pub mod metadata {
        pub use crate::container::metadata::decode;
        #[cfg(feature = "encode")]
        pub use crate::container::metadata::encode;
    }
}

pub mod entropy {
    pub use crate::entropy::average::AverageModel;
    pub use crate::entropy::mixer::{Mixer, MixerContext};
    pub use crate::entropy::symbol::SymbolModel;
    pub use crate::entropy::{BitCoder, BitModel, NumberModel, RangeDecoder, RansDecoder, SymbolCoder, code_end};
    #[cfg(feature = "encode")]
    pub use crate::entropy::{RangeEncoder, RansEncoder};
}

pub mod predictive {
    pub use crate::predictive::decode::decode;
    #[cfg(feature = "encode")]
    pub use crate::predictive::encode::{PlaneEncoder, PlaneQuality};
    pub use crate::predictive::header::{CodedEntry, CodedTile, PREFIX_BYTES, PlaneHeader};
    pub use crate::predictive::order::{MAX_REFERENCES, OrderEntry};
    pub use crate::predictive::{ComponentCoding, MaskCoding, PlaneCoding};
    pub use crate::residual::tiles::TileGrid;
}

pub mod quantise {
    pub use crate::quantise::bands::{Quantiser, RateDistortion};
}

#[cfg(feature = "encode")]
pub mod refine {
    pub use crate::refine::{RefinedSurface, refine_observations};
}

pub mod reflectance {
    pub use crate::reflectance::ReflectionGeometry;
    #[cfg(feature = "encode")]
    pub use crate::reflectance::codec::encode;
    pub use crate::reflectance::codec::{MapSteps, decode};
    #[cfg(feature = "encode")]
    pub use crate::reflectance::gather::{ReflectanceSources, fit_maps};
    pub use crate::reflectance::maps::evaluate;
}

pub mod residual {
    pub mod coefficients {
        #[cfg(feature = "encode")]
        pub use crate::residual::coefficients::encode;
        pub use crate::residual::coefficients::{
            CoefficientModels, Modelling, PictureStreams, PictureTask, Prediction, decode,
        };
        pub use crate::residual::tiles::Tiling;
    }
    pub use crate::residual::mask::{MaskModels, code_mask};
    #[cfg(feature = "encode")]
    pub use crate::residual::volume::FillEffort;
}

pub mod sphere {
    pub use crate::sphere::octahedral::{directions, solid_angles};
}

pub mod surface {
    pub mod atlas {
        #[cfg(feature = "encode")]
        pub use crate::surface::atlas::layout;
        pub use crate::surface::atlas::{rasterise_atlas, rasterise_atlas_within};
    }
    pub mod charts {
        pub use crate::surface::charts::decode;
        #[cfg(feature = "encode")]
        pub use crate::surface::charts::encode;
    }
    pub mod displacement {
        pub use crate::surface::displacement::decode;
        #[cfg(feature = "encode")]
        pub use crate::surface::displacement::{Displacements, encode};
    }
    #[cfg(feature = "encode")]
    pub use crate::surface::raster::coverage_runs;
    pub use crate::surface::raster::{coverage, rasterise, vertex_normals};
}

pub mod transform {
    pub use crate::transform::shape_adaptive::{ColourLanes, WaveletPlan};
}

pub mod views {
    #[cfg(feature = "encode")]
    pub use crate::views::codec::encode;
    pub use crate::views::codec::{ViewsSection, decode};
}

pub mod visibility {
    pub use crate::visibility::codec::decode;
    #[cfg(feature = "encode")]
    pub use crate::visibility::rays::{DirectionGrid, MeshRays, RayScratch};
}

pub mod wavelet_texture {
    pub use crate::wavelet_texture::decode::photographs;
    #[cfg(feature = "encode")]
    pub use crate::wavelet_texture::encode::{fit_model, sample_errors};
    #[cfg(feature = "encode")]
    pub use crate::wavelet_texture::{EncodedWaveletTexture, WaveletOptions, encode};
    pub use crate::wavelet_texture::{WaveletSamples, decode};
}
