//! Photographs through polarisers that are told by the names of their files and folders alone.

use super::polariser::{MIN_ANGLES, distinct};
use super::{ExposureFile, PhotographFiles};
use crate::capture::description::{CaptureDescription, FrameDescription, WhiteReference, capture_folder};
use crate::input::{FileAccess, Folder, escaped};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders below the capture's that are looked into, one in the other.
const MAX_DEPTH: usize = 4;
/// Files and folders that are looked at, at most.
const MAX_ENTRIES: usize = 20_000;
/// Parts of a path that only say that photographs lie there.
const FOLDERS: [&str; 5] = ["images", "photos", "photographs", "undistorted", "input"];
const EXTENSIONS: [&str; 6] = ["exr", "png", "jpg", "jpeg", "tif", "tiff"];
const WHITE: [&str; 4] = ["white", "white_board", "white_reference", "whiteboard"];

/// Position of the filters, by a word of a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Filter {
    Open,
    Parallel,
    Cross,
    /// Degrees of the polariser before the camera.
    Angle(u16),
}

impl Filter {
    /// Turntables have angles, too, so that those of a polariser need its name: `pol45`.
    fn of_word(word: &str) -> Option<Self> {
        match word {
            "open" | "nopol" | "unpolarised" | "unpolarized" => Some(Filter::Open),
            "parallel" | "par" | "ppol" | "parpol" | "copolarised" | "copolarized" => Some(Filter::Parallel),
            "cross" | "crossed" | "xpol" | "crosspol" | "perp" | "perpendicular" => Some(Filter::Cross),
            _ => {
                let rest =
                    ["polariser", "polarizer", "polar", "pol"].iter().find_map(|name| word.strip_prefix(name))?;
                let angle: u16 = rest.strip_suffix("deg").unwrap_or(rest).parse().ok()?;
                (angle <= 360).then_some(Filter::Angle(angle))
            }
        }
    }
}

/// What photographs of one name have in common, and the filter that one of them tells.
fn key(name: &str) -> (String, Option<Filter>) {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_lowercase();
    let mut filter = None;
    let mut parts = Vec::new();
    for part in stem.split(['/', '\\']).filter(|part| !FOLDERS.contains(part)) {
        let mut words = Vec::new();
        for word in part.split(['_', '-', ' ', '.']) {
            match Filter::of_word(word) {
                Some(found) if filter.is_none() => filter = Some(found),
                _ => words.push(word),
            }
        }
        if !words.is_empty() {
            parts.push(words.join("_"));
        }
    }
    (parts.join("/"), filter)
}

/// Image files of one key, by their names in the capture's folder.
type Group = BTreeMap<Option<Filter>, Vec<String>>;

/// The pair, or the angles, that a group is, if it is one; where a filter has several files, the one that is a frame's counts.
fn photograph(group: &Group, folder: &Folder, frames: &BTreeSet<PathBuf>) -> Option<PhotographFiles> {
    let file = |filter: Option<Filter>| {
        let paths: Vec<PathBuf> = group.get(&filter)?.iter().filter_map(|name| folder.resolve(name).ok()).collect();
        let mut own = paths.iter().filter(|path| frames.contains(*path));
        let path = own.next().or(if paths.len() == 1 { paths.first() } else { None })?;
        Some(vec![ExposureFile { path: path.to_owned(), time: 1.0 }])
    };
    let angle = |filter: &Option<Filter>| match filter {
        Some(Filter::Angle(angle)) => Some((f64::from(*angle), file(*filter)?)),
        _ => None,
    };
    let angles: Vec<_> = group.keys().filter_map(angle).collect();
    if distinct(&angles.iter().map(|(angle, _)| *angle).collect::<Vec<_>>()) >= MIN_ANGLES {
        return Some(PhotographFiles::Polariser(angles));
    }
    let cross = file(Some(Filter::Cross))?;
    if let Some(parallel) = file(Some(Filter::Parallel)) {
        return Some(PhotographFiles::Parallel { parallel, cross });
    }
    let photograph = file(Some(Filter::Open)).or_else(|| file(None))?;
    Some(PhotographFiles::Unpolarised { photograph, cross: Some(cross) })
}

/// Makes one frame of photographs through several filters, where their names tell that they are and the description does not: files that differ
/// by a word such as `parallel`, `cross` or `pol45`, or lie in folders of such names, whether they have cameras of their own or not. The camera
/// of the photograph without filters, or of the first filter, is that of all.
pub(in super::super) fn pair_by_names(description: &mut CaptureDescription, access: &FileAccess) {
    let is_single = |frame: &FrameDescription| match &frame.photograph {
        PhotographFiles::Unpolarised { photograph, cross: None } => photograph.len() == 1,
        _ => false,
    };
    if !description.frames.iter().all(is_single) {
        return;
    }
    let folder = Folder::new(capture_folder(&description.path), &description.path, access.allows_outside());
    let Some(groups) = groups(folder.path()) else { return };
    let files: BTreeSet<PathBuf> = description.frames.iter().map(|frame| frame.photograph.first().to_owned()).collect();
    let mut pairs: BTreeMap<String, Paired> = BTreeMap::new();
    let mut alone = 0;
    for (index, frame) in description.frames.iter().enumerate() {
        let name = frame.photograph.first().strip_prefix(folder.path()).ok().and_then(Path::to_str);
        let (key, filter) = key(name.unwrap_or_default());
        if let Some(pair) = pairs.get_mut(&key) {
            (pair.filter, pair.index) = (pair.filter, pair.index).min((filter, index));
        } else if let Some(photograph) = groups.get(&key).and_then(|group| photograph(group, &folder, &files)) {
            pairs.insert(key, Paired { filter, index, photograph });
        } else {
            alone += 1;
        }
    }
    let Some(Paired { photograph, .. }) = pairs.values().min_by_key(|pair| pair.index) else { return };
    let names = photograph.files().take(4).map(|file| file.strip_prefix(folder.path()).unwrap_or(file));
    let names = names.map(|name| escaped(&name.to_string_lossy())).collect::<Vec<_>>().join(", ");
    let kind = match photograph {
        PhotographFiles::Polariser(angles) => format!("{} angles of a polariser", angles.len()),
        PhotographFiles::Parallel { .. } => "parallel and crossed polarisers".to_owned(),
        _ => "no and crossed polarisers".to_owned(),
    };
    let count = pairs.len();
    if count < alone {
        let message = format!(
            "{count} photographs are told by their names to be through {kind} ({names}); as {alone} are not, all are taken as they are"
        );
        description.warnings.push(message);
        return;
    }
    description.warnings.push(format!("{count} photographs are through {kind}, by the names of their files: {names}"));
    let boards =
        || WHITE.iter().filter_map(|name| photograph_of_board(groups.get(*name)?, photograph, &folder, &files));
    let board = description.white_reference.is_none().then(|| boards().next()).flatten();
    let mut chosen: BTreeMap<usize, PhotographFiles> =
        pairs.into_values().map(|pair| (pair.index, pair.photograph)).collect();
    let in_pairs: BTreeSet<PathBuf> = chosen.values().flat_map(PhotographFiles::files).map(Path::to_owned).collect();
    let frames = std::mem::take(&mut description.frames).into_iter().enumerate();
    description.frames = frames
        .filter_map(|(index, frame)| match chosen.remove(&index) {
            Some(photograph) => Some(FrameDescription { photograph, ..frame }),
            None => (!in_pairs.contains(frame.photograph.first())).then_some(frame),
        })
        .collect();
    if let Some(board) = board {
        description.white_reference = Some(WhiteReference { photograph: board });
    }
}

/// Frames that are one.
struct Paired {
    /// Filter and number of the frame whose camera and name stay.
    filter: Option<Filter>,
    index: usize,
    photograph: PhotographFiles,
}

/// The white board's photograph, if it was taken through the same filters as this one.
fn photograph_of_board(
    group: &Group,
    like: &PhotographFiles,
    folder: &Folder,
    frames: &BTreeSet<PathBuf>,
) -> Option<PhotographFiles> {
    let board = photograph(group, folder, frames)?;
    (std::mem::discriminant(&board) == std::mem::discriminant(like)).then_some(board)
}

/// Image files of a capture's folder, by what their names have in common; `None` where there are too many.
fn groups(folder: &Path) -> Option<BTreeMap<String, Group>> {
    let mut groups: BTreeMap<String, Group> = BTreeMap::new();
    let mut left = MAX_ENTRIES;
    let mut open = vec![(folder.to_owned(), String::new(), 0)];
    while let Some((path, parent, depth)) = open.pop() {
        let Ok(entries) = std::fs::read_dir(&path) else { continue };
        for entry in entries.flatten() {
            left = left.checked_sub(1)?;
            let Some(own) = entry.file_name().to_str().filter(|own| !own.starts_with('.')).map(str::to_owned) else {
                continue;
            };
            let name = if parent.is_empty() { own } else { format!("{parent}/{own}") };
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                if depth < MAX_DEPTH {
                    open.push((entry.path(), name, depth + 1));
                }
                continue;
            }
            let extension = name.rsplit_once('.').map_or("", |(_, extension)| extension).to_ascii_lowercase();
            if EXTENSIONS.contains(&extension.as_str()) {
                let (key, filter) = key(&name);
                groups.entry(key).or_default().entry(filter).or_default().push(name);
            }
        }
    }
    groups.values_mut().flat_map(BTreeMap::values_mut).for_each(|names| names.sort());
    Some(groups)
}
