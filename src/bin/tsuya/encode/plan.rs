//! `tsuya encode --plan`: what an encode will take, from the sizes of the photographs alone.

use crate::output;
use anyhow::Result;
use serde_json::{Value, json};
use std::ops::Range;
use std::path::Path;
use tsuya::capture::{CaptureDescription, FrameDescription, describe};
use tsuya::input::FileAccess;
use tsuya::{EncodeOptions, EncodeTarget, Profile, Refinement};

/// Share of the photographs' pixels that show the object, where masks say so, and where there are none.
const MASKED: [Range<f64>; 2] = [0.08..0.6, 0.1..1.0];
/// Bytes of the file for each pixel of the object and component at quality 75, and for the mesh and the rest.
const BYTES: Range<f64> = 0.08..0.45;
const OTHER_BYTES: Range<f64> = 5e3..6e4;
/// Processor seconds for each pixel of a photograph and component, of those of another make and of search for a target.
const SECONDS: Range<f64> = 0.4e-6..3e-6;
/// Bytes of memory for each pixel of the largest photograph and component, for all photographs that are worked on at once, and for the rest.
const MEMORY: Range<f64> = 40.0..500.0;
const OTHER_MEMORY: Range<f64> = 25e6..80e6;
/// Processor seconds and bytes of memory for each pixel that the surface is refined by, and the most of these pixels.
const REFINING_SECONDS: Range<f64> = 2e-6..24e-6;
const REFINING_MEMORY: Range<f64> = 10.0..90.0;
const REFINING_PIXELS: u64 = 16 << 20;
/// Bytes of the temporary file for each pixel of the object and component.
const TEMPORARY: Range<f64> = 4.0..16.0;

/// What an encode will take.
struct EncodePlan {
    photographs: usize,
    pixels: u64,
    largest: [u32; 2],
    masked_pixels: Range<f64>,
    memory: Range<f64>,
    temporary: Range<f64>,
    processor_seconds: Range<f64>,
    seconds: Range<f64>,
    bytes: Option<Range<f64>>,
}

/// How many times the bytes of quality 75 a quality takes.
fn rate(quality: f64) -> Range<f64> {
    let halvings = (quality - 75.0) / 25.0;
    let (a, b) = (1.6f64.powf(halvings), 2.2f64.powf(halvings));
    a.min(b)..a.max(b)
}

fn times(a: &Range<f64>, b: &Range<f64>) -> Range<f64> {
    a.start * b.start..a.end * b.end
}

fn sum(a: &Range<f64>, b: &Range<f64>) -> Range<f64> {
    a.start + b.start..a.end + b.end
}

impl EncodePlan {
    fn new(description: &CaptureDescription, options: &EncodeOptions) -> Self {
        let kept = |index: &usize| options.hold_out.is_none_or(|k| !(index + 1).is_multiple_of(k));
        let frames = description.frames.iter().enumerate().filter(|(index, _)| kept(index)).map(|(_, frame)| frame);
        let frames: Vec<&FrameDescription> = frames.collect();
        let area = |frame: &&FrameDescription| u64::from(frame.view.camera.width) * u64::from(frame.view.camera.height);
        let components = |frame: &&FrameDescription| 1 + u64::from(frame.photograph.is_polarised());
        let pixels: u64 = frames.iter().map(area).sum();
        let samples: u64 = frames.iter().map(|frame| area(frame) * components(frame)).sum();
        let most: u64 = frames.iter().map(|frame| area(frame) * components(frame)).max().unwrap_or(0);
        let has_masks = frames.iter().any(|frame| frame.mask.is_some());
        let [with, without] = MASKED;
        let share = if has_masks { with } else { without };
        let whole = |value: u64| value as f64..value as f64;
        let masked = times(&share, &whole(samples));
        // Searches encode several times; the published method takes longer for each pixel.
        let effort = match options.target {
            None | Some(EncodeTarget::Quality(_) | EncodeTarget::KeepPercent(_)) => 1.0..1.0,
            Some(_) => 1.5..5.0,
        };
        let is_refined = options.profile == Profile::Predictive
            && options.refine != Refinement::None
            && frames.iter().all(|frame| frame.photograph.is_polarised() && frame.view.light.is_some());
        let refining = whole(if is_refined { pixels.min(REFINING_PIXELS) } else { 0 });
        let coding_seconds = times(&times(&SECONDS, &whole(samples)), &effort);
        let processor_seconds = sum(&coding_seconds, &times(&REFINING_SECONDS, &refining));
        let coding_memory = sum(&times(&MEMORY, &whole(most)), &OTHER_MEMORY);
        let threads = rayon::current_num_threads() as f64;
        // A quarter of the scale of qualities halves the quantiser's step, which takes almost twice the bytes.
        let at_quality = |quality: f64| sum(&times(&times(&BYTES, &masked), &rate(quality)), &OTHER_BYTES);
        let bytes = match (options.profile, options.target) {
            (_, Some(EncodeTarget::MaxBytes(bytes))) => Some(OTHER_BYTES.start.min(bytes as f64)..bytes as f64),
            (Profile::Predictive, None) => Some(at_quality(75.0)),
            (Profile::Predictive, Some(EncodeTarget::Quality(quality))) => Some(at_quality(quality)),
            _ => None,
        };
        EncodePlan {
            photographs: frames.len(),
            pixels,
            largest: frames
                .iter()
                .max_by_key(|frame| area(frame))
                .map_or([0; 2], |frame| [frame.view.camera.width, frame.view.camera.height]),
            masked_pixels: times(&share, &whole(pixels)),
            memory: sum(&coding_memory, &times(&REFINING_MEMORY, &refining)),
            temporary: times(&masked, &TEMPORARY),
            seconds: processor_seconds.start / threads..processor_seconds.end / threads.min(2.0),
            processor_seconds,
            bytes,
        }
    }

    fn json(&self) -> Value {
        let range = |range: &Range<f64>| json!([range.start, range.end]);
        let whole = |range: &Range<f64>| json!([range.start.round() as u64, range.end.round() as u64]);
        json!({
            "photographs": self.photographs,
            "pixels": self.pixels,
            "largest": self.largest,
            "masked_pixels": whole(&self.masked_pixels),
            "memory_bytes": whole(&self.memory),
            "temporary_bytes": whole(&self.temporary),
            "processor_seconds": range(&self.processor_seconds),
            "seconds": range(&self.seconds),
            "bytes": self.bytes.as_ref().map(whole),
        })
    }

    fn text(&self) -> String {
        let mega = |range: &Range<f64>| format!("{:.1} to {:.1}", range.start / 1e6, range.end / 1e6);
        let [width, height] = self.largest;
        let bytes = self.bytes.as_ref().map_or("as the target asks for".into(), |bytes| mega(bytes) + " MB");
        let Range { start, end } = self.seconds;
        format!(
            "photographs        {} of {:.1} megapixels together, the largest {width} x {height}\n\
             showing the object {} megapixels (from the sizes alone: masks are not read)\n\
             file               {bytes}\n\
             time               {start:.0} to {end:.0} s on {} threads\n\
             memory             {} MB\n\
             temporary file     {} MB, in TMPDIR or where the system has large ones\n",
            self.photographs,
            self.pixels as f64 / 1e6,
            mega(&self.masked_pixels),
            rayon::current_num_threads(),
            mega(&self.memory),
            mega(&self.temporary),
        )
    }
}

/// Prints what an encode of a capture will take.
pub fn print(capture: &Path, access: &FileAccess, options: &EncodeOptions, as_json: bool) -> Result<()> {
    let description = describe(capture, access)?;
    output::warn(&description.warnings);
    let plan = EncodePlan::new(&description, options);
    if as_json { output::print_json(&plan.json()) } else { output::print(&plan.text()) }
}
