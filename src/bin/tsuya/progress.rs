//! Progress on a terminal; silent elsewhere.

use crate::output;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::Path;
use std::time::Duration;
use tsuya::Result;
use tsuya::capture::{Capture, CaptureReadOptions, OpenCapture, open_with_progress, read_with_progress};

/// A line that says what is being done, until it is dropped.
pub struct Busy(ProgressBar);

/// Shows what is being done.
pub fn busy(what: &'static str) -> Busy {
    let bar = if output::is_quiet() { ProgressBar::hidden() } else { ProgressBar::new_spinner() };
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
        bar.set_style(style);
    }
    bar.set_message(what);
    if !bar.is_hidden() {
        bar.enable_steady_tick(Duration::from_millis(120));
    }
    Busy(bar)
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Reads a capture with a bar of its frames.
pub fn read_capture(path: &Path, options: &CaptureReadOptions) -> Result<Capture> {
    with_bar(|progress| read_with_progress(path, options, progress))
}

/// Opens a capture, whose photographs are not kept, with a bar of its frames.
pub fn open_capture(path: &Path, options: &CaptureReadOptions) -> Result<OpenCapture> {
    with_bar(|progress| open_with_progress(path, options, progress))
}

fn with_bar<T>(read: impl FnOnce(&(dyn Fn(usize, usize) + Sync)) -> T) -> T {
    let bar = if output::is_quiet() { ProgressBar::hidden() } else { ProgressBar::new(0) };
    if let Ok(style) = ProgressStyle::with_template("reading photographs {wide_bar} {pos}/{len}") {
        bar.set_style(style);
    }
    let read = read(&|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    read
}
