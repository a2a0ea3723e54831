//! Photographs that are opened when they are needed.

use super::{Photograph, View};
use crate::error::Result;
use crate::parallel;
use std::borrow::{Borrow, Cow};
use std::fmt::Debug;
use std::hash::Hasher;
use std::ops::Range;

/// Photographs by view, handed out one at a time: only those in use need be in memory.
pub trait PhotographSource: Debug + Sync {
    /// Returns the photograph of a view.
    fn photograph(&self, view: usize) -> Result<Cow<'_, Photograph>>;
    /// Photographs that may be asked for side by side, at least one.
    fn at_once(&self) -> usize {
        usize::MAX
    }
}

impl<P: Borrow<Photograph> + Debug + Sync> PhotographSource for Vec<P> {
    fn photograph(&self, view: usize) -> Result<Cow<'_, Photograph>> {
        Ok(Cow::Borrowed(self[view].borrow()))
    }
}

/// Photographs that are open side by side, at most, however many threads there are.
pub(crate) const MOST_OPEN: usize = 8;
/// Pixels of photographs that are open side by side, at most, beside those of one.
const MOST_PIXELS: u64 = 8 << 20;

/// Returns runs of views whose photographs may be open side by side.
pub(crate) fn open_together(views: &[View], at_once: usize) -> Vec<Range<usize>> {
    let most = at_once.clamp(1, MOST_OPEN);
    let mut runs: Vec<Range<usize>> = Vec::new();
    let mut pixels = 0;
    for (index, view) in views.iter().enumerate() {
        let more = u64::from(view.camera.width) * u64::from(view.camera.height);
        match runs.last_mut() {
            Some(run) if run.len() < most && pixels + more <= MOST_PIXELS => {
                run.end += 1;
                pixels += more;
            }
            _ => {
                runs.push(index..index + 1);
                pixels = more;
            }
        }
    }
    runs
}

/// Opens some photographs side by side.
pub(crate) fn open_run<'a>(source: &'a dyn PhotographSource, run: &Range<usize>) -> Result<Vec<Cow<'a, Photograph>>> {
    parallel::map(run.len(), |k| source.photograph(run.start + k)).into_iter().collect()
}

impl Photograph {
    /// Returns a number by which this photograph is told from any other, bit for bit, within one run of a program.
    pub(crate) fn digest(&self) -> u64 {
        let mut hasher = std::hash::DefaultHasher::new();
        [self.mask.width, self.mask.height, self.images.len()].iter().for_each(|&size| hasher.write_usize(size));
        let mut bytes = Vec::new();
        for inside in self.mask.data.chunks(1 << 14) {
            bytes.clear();
            bytes.extend(inside.iter().map(|&inside| u8::from(inside)));
            hasher.write(&bytes);
        }
        for values in self.images.iter().flat_map(|image| image.data.as_flattened().chunks(1 << 12)) {
            bytes.clear();
            bytes.extend(values.iter().flat_map(|value| value.to_bits().to_le_bytes()));
            hasher.write(&bytes);
        }
        hasher.finish()
    }
}
