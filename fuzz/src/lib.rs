//! What fuzz targets and seeds share.

pub mod compare;
pub mod damage;
pub mod folder;
pub mod pictures;
pub mod repair;
pub mod scene;
pub mod values;
