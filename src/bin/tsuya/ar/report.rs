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
    /// Frames with the object, and the first without: its number and name.
    pub seen: usize,
    pub first_missing: Option<(usize, String)>,
    /// Seconds of all frames.
    pub reading: f64,
    pub writing: f64,
    times: FrameTimes,
    rms_pixels: f64,
    /// Poses, where they are printed.
    poses: Option<Vec<Value>>,
}

impl Work {
    pub fn new(as_json: bool) -> Self {
        Work {
            frames: 0,
            seen: 0,
            first_missing: None,
            reading: 0.0,
            writing: 0.0,
            times: FrameTimes::default(),
            rms_pixels: 0.0,
            poses: as_json.then(Vec::new),
        }
    }

    /// Takes in a frame.
    pub fn add(&mut self, report: &FrameReport, source: &Source) {
        self.frames += 1;
        match report.estimate {
            Some(estimate) => {
                self.seen += 1;
                self.rms_pixels += estimate.rms_pixels;
                let FrameTimes { whole, pose, light, render, composite } = report.times;
                self.times.whole += whole;
                self.times.pose += pose;
                self.times.light += light;
                self.times.render += render;
                self.times.composite += composite;
            }
            None if self.first_missing.is_none() => {
                self.first_missing = Some((report.frame, source.name(report.frame)));
            }
            None => {}
        }
        if let Some(poses) = &mut self.poses {
            let estimate = report.estimate;
            poses.push(json!({
                "frame": source.name(report.frame),
                "rotation": estimate.map(|e| e.pose.rotation),
                "translation": estimate.map(|e| e.pose.translation),
                "rms_pixels": estimate.map(|e| e.rms_pixels),
                "max_pixels": estimate.map(|e| e.max_pixels),
                "markers": estimate.map_or(0, |e| e.markers),
                "gain": report.gain,
                "noise": report.noise,
            }));
        }
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
            self.rms_pixels / seen,
            1.0 / whole.max(1e-9),
            1e3 * reading,
            1e3 * writing
        );
        if to_error {
            text.lines().for_each(output::eprint_line);
            return Ok(());
        }
        output::print(&text)
    }
}
