//! Values on the command line, and the arguments that several subcommands share.

use crate::source;
use clap::Args;
use std::path::{Path, PathBuf};
use tsuya::View;
use tsuya::capture::{CaptureReadOptions, describe};
use tsuya::image::Region;
use tsuya::input::{FileAccess, Folder};
use tsuya::{Error, Result};

/// Numbers with commas between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

/// Parses `1,2.5,-3`.
pub fn numbers(text: &str) -> std::result::Result<Numbers, String> {
    let number = |part: &str| match part.trim().parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        _ => Err(format!("'{part}' is not a number")),
    };
    text.split(',').map(number).collect::<std::result::Result<_, _>>().map(Numbers)
}

/// Exactly three numbers.
pub fn triple(text: &str) -> std::result::Result<[f64; 3], String> {
    let Numbers(values) = numbers(text)?;
    <[f64; 3]>::try_from(values).map_err(|values| format!("three numbers are needed, these are {}", values.len()))
}

/// Width and height, `640x480`.
pub fn size(text: &str) -> std::result::Result<[u32; 2], String> {
    let side = |part: &str| part.parse::<u32>().ok().filter(|&side| (1..=16384).contains(&side));
    let sides = text.split_once(['x', 'X', '×']).map(|(w, h)| (side(w), side(h)));
    match sides {
        Some((Some(width), Some(height))) => Ok([width, height]),
        _ => Err("a size is WIDTHxHEIGHT, each 1 to 16384".into()),
    }
}

/// A region, `X,Y,W,H`: its first column and row, its width and height in pixels.
pub fn region(text: &str) -> std::result::Result<Region, String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[left, top, width, height]) if width > 0 && height > 0 => Ok(Region { left, top, width, height }),
        _ => Err("a region is X,Y,W,H in pixels: its first column and row, its width and height".into()),
    }
}

/// How a capture is read where it does not say so itself.
#[derive(Args, Debug, Clone, Default)]
pub struct CaptureArguments {
    /// The mesh: PLY, OBJ or GLB [default: the one that the capture names, or the only one in its folder].
    #[arg(long, value_name = "FILE")]
    pub mesh: Option<PathBuf>,
    /// Where the mesh stands in the capture's world: the file that `tsuya align -o` wrote.
    #[arg(long, value_name = "FILE")]
    pub mesh_pose: Option<PathBuf>,
    /// The white board's brightness with the specular reflection blocked, over its brightness without polarisers, of red, green
    /// and blue [default: measured on the capture's white board].
    #[arg(long, value_name = "R,G,B", value_parser = triple)]
    pub beta: Option<[f64; 3]>,
    /// Colour space of PNG, JPEG and TIFF photographs: srgb, rec709, gamma-2.2 (any exponent), linear-rec709, linear-NAME
    /// [default: the one that the capture names, else what each photograph says (ICC profile), or srgb].
    #[arg(long, value_name = "NAME")]
    pub color_space: Option<String>,
    /// Multiplies the mesh's coordinates, where its unit is not the cameras': 0.001 for millimetres and metres. 1 takes it as it is,
    /// however large.
    #[arg(long, value_name = "FACTOR")]
    pub mesh_scale: Option<f64>,
    /// The masks show the background, not the object.
    #[arg(long)]
    pub invert_masks: bool,
    /// Divides photographs by the exposures that their EXIF data tell (time, sensitivity, aperture), over the first one's, where the capture states
    /// no times. For raw and linear photographs; curves of cameras do not follow exposure
    #[arg(long)]
    pub exif_exposure: bool,
    /// Takes mesh, cameras and masks as they are, whether they agree or not.
    #[arg(long)]
    pub unchecked: bool,
    #[command(flatten)]
    pub outside: OutsideArgument,
}

/// Where the paths that an input names may lead.
#[derive(Args, Debug, Clone, Copy, Default)]
pub struct OutsideArgument {
    /// Also reads what an input names outside its own folder, by .., absolute paths or links, and hidden files. For inputs that you trust.
    #[arg(long)]
    pub allow_outside: bool,
}

impl OutsideArgument {
    /// The account of one job's input.
    pub fn access(self) -> FileAccess {
        source::access().allow_outside(self.allow_outside)
    }
    /// The folder of a file, for the paths in it.
    pub fn folder(self, file: &Path) -> Folder {
        Folder::containing(file, self.allow_outside)
    }
}

impl CaptureArguments {
    /// The library's options.
    pub fn read_options(&self) -> Result<CaptureReadOptions> {
        let mesh_pose = self.mesh_pose.as_ref().map(|path| crate::align::read_pose(path)).transpose()?;
        Ok(CaptureReadOptions {
            mesh: self.mesh.clone(),
            mesh_pose,
            beta: self.beta,
            color_space: self.color_space.clone(),
            mesh_scale: self.mesh_scale,
            invert_masks: self.invert_masks,
            exif_exposure: self.exif_exposure,
            unchecked: self.unchecked,
            limits: source::limits(),
            allow_outside: self.outside.allow_outside,
        })
    }

    /// The files that reading a capture takes: no output may be one of them.
    pub fn files(&self, capture: &Path) -> Result<Vec<PathBuf>> {
        let description = describe(capture, &self.outside.access())?;
        let mut files = vec![description.path.clone(), capture.to_owned()];
        if let Ok(entries) =
            std::fs::read_dir(if description.path.is_dir() { &description.path } else { Path::new("") })
        {
            files.extend(entries.flatten().map(|entry| entry.path()));
        }
        files.extend(description.files().map(Path::to_owned));
        files.extend(description.find_mesh(&CaptureReadOptions { mesh: self.mesh.clone(), ..Default::default() }));
        files.extend(self.mesh_pose.clone());
        Ok(files)
    }
}

/// A view by its name (with or without extension) or its number.
pub fn find_view(wanted: &str, views: &[View]) -> Result<usize> {
    if let Some(index) = views.iter().position(|view| view.name == wanted) {
        return Ok(index);
    }
    if let Ok(number) = wanted.parse::<usize>() {
        return if number < views.len() {
            Ok(number)
        } else {
            Err(Error::parameter(format!("view {number} does not exist: the file has {} views", views.len())))
        };
    }
    let same: Vec<usize> = (0..views.len()).filter(|&k| stem(&views[k].name) == stem(wanted)).collect();
    match same.as_slice() {
        [index] => Ok(*index),
        _ => Err(Error::parameter(format!("the file has no view called '{wanted}'; tsuya info lists them"))),
    }
}

/// A photograph's name without the extension of a picture.
pub fn stem(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension)) if is_picture(extension) && !stem.is_empty() => stem,
        _ => name,
    }
}

fn is_picture(extension: &str) -> bool {
    let lower = extension.to_ascii_lowercase();
    ["exr", "png", "jpg", "jpeg", "tif", "tiff"].contains(&lower.as_str())
}
