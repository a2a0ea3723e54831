//! Files of a capture's surroundings that hold no capture that is read, and what to do with them.

use super::{entries, extension, head};
use crate::error::Error;
use crate::input::escaped;
use std::path::Path;

/// What a kind of file is, and what to do.
type Advice = (&'static str, &'static str);

const CLOUD: Advice = (
    "a point cloud or a set of Gaussian splats",
    "a capture needs photographs with cameras, and a mesh: reconstruct one by Poisson's method or ball pivoting",
);
const LIGHTS: Advice = (
    "lights of reflectance transformation imaging (RTI)",
    "it has one view and neither camera nor mesh, which a capture needs; with a calibrated camera and a mesh write a transforms.json that \
     repeats the camera for each photograph, with its light as light_position",
);
const ELSEWHERE_CAMERAS: &str = "export its cameras, and convert them to a COLMAP model or a transforms.json";
const ELSEWHERE: &str = "convert it to a COLMAP model or a transforms.json";

/// By the extension alone.
const EXTENSIONS: [(&[&str], Advice); 20] = [
    (&["psx", "psz"], ("a Metashape project", "export its cameras (File > Export > Export Cameras, as Agisoft XML)")),
    (
        &["rcproj", "rsproj", "rcprj", "rcalign"],
        (
            "a RealityCapture project",
            "export its registration (as XMP files, or \"Internal/External camera parameters\")",
        ),
    ),
    (&["mg"], ("a Meshroom project", "take cameras.sfm out of its folder StructureFromMotion")),
    (&["abc"], ("an Alembic scene", "Meshroom converts its sfm.abc to sfm.json (ConvertSfMFormat)")),
    (&["zep", "zpr"], ("a 3DF Zephyr project", "export its cameras as a COLMAP model")),
    (&["p4d", "p4b"], ("a Pix4D project", ELSEWHERE_CAMERAS)),
    (&["nvm"], ("a VisualSFM model", ELSEWHERE)),
    (&["mvs"], ("an OpenMVS scene", "give the COLMAP or OpenMVG model that it was made from")),
    (&["db"], ("a database of features", "it holds no poses; run COLMAP's mapper, and give its model")),
    (&["lp", "dome", "rti", "ptm", "hsh"], LIGHTS),
    (&["splat", "ksplat", "spz", "sog", "las", "laz", "e57", "pcd", "xyz", "pts"], CLOUD),
    (
        &["mp4", "mov", "avi", "mkv", "webm", "m4v", "insv", "mts"],
        ("a video", "take photographs out of it, find their cameras with COLMAP, and give its model"),
    ),
    (&["zip", "7z", "rar", "gz", "tgz", "tar", "r3d"], ("an archive", "unpack it, and give the folder")),
    (
        &["ply", "obj", "glb", "gltf", "stl", "fbx", "usdz", "usd", "dae"],
        ("a mesh without photographs", "give the folder or file with the cameras; the mesh goes into option `mesh`"),
    ),
    (&["tsuya"], ("an encoded file", "decode it; a capture comes out")),
    (&["blend"], ("a Blender scene", "export its cameras as a transforms.json")),
    (&["fspy"], ("an fSpy project", "it has one photograph; a capture needs several views")),
    (
        &["jpg", "jpeg", "png", "tif", "tiff", "exr", "heic", "cr2", "cr3", "nef", "arw", "dng", "raf", "orf", "rw2"],
        ("a photograph", "give the folder or file with the cameras"),
    ),
    (
        &["gltx", "x3d", "wrl", "3ds", "max", "c4d", "ma", "mb"],
        ("a scene of a modelling program", "export its cameras as a transforms.json"),
    ),
    (
        &["bag", "mcap"],
        ("a robot's recording", "take photographs out of it, find their cameras with COLMAP, and give its model"),
    ),
];

/// By first letters, or name and letters.
fn by_content(path: &Path) -> Option<Advice> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
    let read = || head(path);
    Some(match extension(path).as_str() {
        "out" if read().starts_with("# Bundle file") || name.starts_with("bundle") => ("a Bundler model", ELSEWHERE),
        "txt" if name.ends_with("calibrated_camera_parameters.txt") || name.ends_with("pmatrix.txt") => {
            ("a list of Pix4D's cameras", ELSEWHERE)
        }
        "txt" if name == "list.txt" && path.with_file_name("bundle.out").exists() => ("a Bundler model", ELSEWHERE),
        "bin" if name == "sfm_data.bin" => {
            ("an OpenMVG scene in binary", "convert it to sfm_data.json (openMVG_main_ConvertSfM_DataFormat)")
        }
        "json" if name == "reconstruction.json" || read().contains("\"reference_lla\"") => {
            ("an OpenSfM model", "export it (opensfm export_colmap)")
        }
        "json" if name == "mesh_info.json" || read().contains("\"blur_score\"") && !read().contains("\"frames\"") => (
            "a part of Polycam's raw data",
            "convert it (nerfstudio's ns-process-data polycam), and give the transforms.json",
        ),
        "json" if name == "metadata.json" && read().contains("\"poses\"") => {
            ("Record3D's metadata", "convert it (nerfstudio's ns-process-data record3d), and give the transforms.json")
        }
        "xml" if read().contains("<BlocksExchange") => ("a ContextCapture block", ELSEWHERE),
        _ => return None,
    })
}

fn advice(path: &Path) -> Option<Advice> {
    let extension = extension(path);
    let known = || EXTENSIONS.iter().find(|(names, _)| names.contains(&extension.as_str())).map(|(_, advice)| *advice);
    by_content(path).or_else(known)
}

/// Returns `true` if a file is known by its name or beginning to be none that is read.
pub(in super::super) fn is_foreign(path: &Path) -> bool {
    by_content(path).is_some()
}

fn is_photograph(path: &Path) -> bool {
    ["jpg", "jpeg", "png", "tif", "tiff", "exr", "heic", "dng"].contains(&extension(path).as_str())
}

/// The error for a file or a folder that is no capture: what it is instead, as far as that is known, and what to do.
pub(in super::super) fn refusal(path: &Path, none: &str) -> Error {
    let name = |path: &Path| escaped(&path.file_name().unwrap_or_default().to_string_lossy());
    if !path.is_dir() {
        let found = advice(path).map(|(what, advice)| format!("this is {what}: {advice}"));
        return Error::input(path, found.unwrap_or_else(|| none.to_owned()));
    }
    let files = entries(path).unwrap_or_default();
    let is_plain = |file: &&std::path::PathBuf| !is_photograph(file) && file.is_file();
    // Projects before what lies beside each of them.
    let kinds = files.iter().filter(is_plain).filter_map(|file| Some((file, advice(file)?)));
    let weight = |(_, (what, _)): &(&std::path::PathBuf, Advice)| {
        usize::from(what.starts_with("a mesh")) * 2
            + usize::from(what.starts_with("an archive") || what.starts_with("a point"))
    };
    if let Some((file, (what, advice))) = kinds.min_by_key(weight) {
        return Error::input(path, format!("{none}; {} is {what}: {advice}", name(file)));
    }
    let folders = ["images", "keyframes", "rgbd"].map(|below| path.join(below));
    let photographs = files.iter().filter(|file| is_photograph(file)).count()
        + folders
            .iter()
            .filter(|folder| folder.is_dir())
            .map(|folder| entries(folder).map_or(0, |files| files.len()))
            .sum::<usize>();
    if photographs > 0 {
        return Error::input(
            path,
            format!(
                "{none}; there are {photographs} photographs, but no cameras: find them with COLMAP, Metashape, RealityCapture or Meshroom"
            ),
        );
    }
    Error::input(path, none)
}
