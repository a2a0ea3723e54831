//! What `tsuya ar` says when it is done. Nothing that it keeps grows with the frames, unless poses are to be printed.

use super::frames::Source;
use crate::output;
use anyhow::Result;
use serde_json::{Value, json};
use tsuya::ar::{FrameReport, FrameTimes};
use tsuya::capture::Calibration;

/// What was done so far.
pub struct Work {
    pub frames: usize,
    /// Frames with some object.
    pub seen: usize,
    /// For each marker the frames without it, and the name of the first.
    pub missing: Vec<(usize, String)>,
    /// Seconds of all frames.
    pub reading: f64,
    pub writing: f64,
    times: FrameTimes,
    rms_pixels: f64,
    /// Markers that were found, over all frames.
    found: usize,
    /// What messages call the markers.
    markers: Vec<String>,
    /// Poses, where they are printed.
    poses: Option<Vec<Value>>,
}

impl Work {
    pub fn new(markers: Vec<String>, as_json: bool) -> Self {
        Work {
            frames: 0,
            seen: 0,
            missing: vec![(0, String::new()); markers.len()],
            reading: 0.0,
            writing: 0.0,
            times: FrameTimes::default(),
            rms_pixels: 0.0,
            found: 0,
            markers,
            poses: as_json.then(Vec::new),
        }
    }

    /// Takes in a frame, one report for each marker.
    pub fn add(&mut self, reports: &[FrameReport], source: &Source) {
        self.frames += 1;
        self.seen += usize::from(reports.iter().any(|report| report.estimate.is_some()));
        for (k, report) in reports.iter().enumerate() {
            match report.estimate {
                Some(estimate) => {
                    self.found += 1;
                    self.rms_pixels += estimate.rms_pixels;
                    let FrameTimes { whole, pose, light, render, composite } = report.times;
                    self.times.whole += whole;
                    self.times.pose += pose;
                    self.times.light += light;
                    self.times.render += render;
                    self.times.composite += composite;
                }
                None => {
                    let (count, first) = &mut self.missing[k];
                    *count += 1;
                    if *count == 1 {
                        *first = source.name(report.frame);
                    }
                }
            }
            if let Some(poses) = &mut self.poses {
                let estimate = report.estimate;
                let mut pose = json!({
                    "frame": source.name(report.frame),
                    "rotation": estimate.map(|e| e.pose.rotation),
                    "translation": estimate.map(|e| e.pose.translation),
                    "rms_pixels": estimate.map(|e| e.rms_pixels),
                    "max_pixels": estimate.map(|e| e.max_pixels),
                    "markers": estimate.map_or(0, |e| e.markers),
                    "gain": report.gain,
                    "noise": report.noise,
                });
                if reports.len() > 1 {
                    pose["marker"] = self.markers[k].as_str().into();
                }
                poses.push(pose);
            }
        }
    }

    /// One sentence for each marker that some frames do not show.
    pub fn warnings(&self) -> Vec<String> {
        let missing = self.missing.iter().zip(&self.markers).filter(|((count, _), _)| *count > 0);
        let without = if self.markers.len() > 1 { "they are without its objects" } else { "they are as they were" };
        let sentence = |((count, first), marker): (&(usize, String), &String)| {
            format!("{count} of {} frames show no marker {marker} (the first: {first}); {without}", self.frames)
        };
        missing.map(sentence).collect()
    }

    /// Prints it; to standard error where standard output is the video.
    pub fn print(self, calibration: &Calibration, seconds: f64, to_error: bool) -> Result<()> {
        let (seen, all) = (self.seen.max(1) as f64, self.frames.max(1) as f64);
        let (reading, writing) = (self.reading / all, self.writing / all);
        let FrameTimes { whole, pose, light, render, composite } = self.times;
        let [whole, pose, light, render, composite] = [whole, pose, light, render, composite].map(|s| s / seen);
        if let Some(poses) = self.poses {
            let report = json!({
                "frames": self.frames,
                "with_marker": self.seen,
                "size": [calibration.camera.width, calibration.camera.height],
                "seconds": seconds,
                "frame_seconds": {
                    "whole": whole, "read": reading, "pose": pose, "light": light, "render": render, "composite": composite, "write": writing,
                },
                "poses": poses,
            });
            if to_error {
                output::eprint_line(&report.to_string());
                return Ok(());
            }
            return output::print_json(&report);
        }
        let [pose, light, render, composite] = [pose, light, render, composite].map(|s| 1e3 * s);
        let text = format!(
            "{} of {} frames with the object, corners {:.2} pixels off\n\
             a frame: pose {pose:.1} ms, light {light:.1} ms, render {render:.1} ms, composite {composite:.1} ms; {:.1} frames a second\n\
             and {:.1} ms reading, {:.1} ms writing\n",
            self.seen,
            self.frames,
            self.rms_pixels / self.found.max(1) as f64,
            1.0 / whole.max(1e-9),
            1e3 * reading,
            1e3 * writing
        );
        if to_error && !output::is_quiet() {
            text.lines().for_each(output::eprint_line);
        }
        if to_error {
            return Ok(());
        }
        output::tell(&text)
    }
}
