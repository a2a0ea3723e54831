//! Polarisation beyond the pair: rotating filters and polarisation cameras, simulated from the sample's diffuse and specular photographs, which are
//! the truth that the separation is judged by.

use crate::support::{read, variant};
use serde_json::{Value, json};
use std::path::Path;
use tsuya::capture::Capture;
use tsuya::image::RgbImage;

/// Angle of the lamp's polariser, in degrees.
const LAMP: f64 = 20.0;
/// Photographs have this many pixels for one of the sample, each way.
const FINER: usize = 3;
const FRAMES: usize = 4;
/// Radiance at which the polarisation camera's values end.
const BRIGHTEST: f32 = 16.0;

/// Diffuse and specular radiance of a frame.
fn parts(capture: &Capture, frame: usize) -> [RgbImage; 2] {
    let frame = &capture.frames[frame];
    let beta = capture.beta.unwrap();
    let diffuse =
        frame.cross.as_ref().unwrap().map(|pixel| std::array::from_fn(|c| (f64::from(pixel[c]) / beta[c]) as f32));
    let mut specular = frame.photograph.clone();
    for (value, diffuse) in specular.data.iter_mut().zip(&diffuse.data) {
        (0..3).for_each(|c| value[c] -= diffuse[c]);
    }
    [diffuse, specular]
}

/// The image with more pixels, bilinear.
fn finer(image: &RgbImage) -> RgbImage {
    let (width, height) = (FINER * image.width, FINER * image.height);
    let taps = |k: usize, side: usize| {
        let place = ((k as f32 + 0.5) / FINER as f32 - 0.5).clamp(0.0, side as f32 - 1.0);
        let first = (place as usize).min(side - 2);
        (first, place - first as f32)
    };
    let pixel = |index: usize| {
        let ((x, along), (y, across)) = (taps(index % width, image.width), taps(index / width, image.height));
        std::array::from_fn(|c| {
            let row = |y: usize| image.row(y)[x][c] * (1.0 - along) + image.row(y)[x + 1][c] * along;
            row(y) * (1.0 - across) + row(y + 1) * across
        })
    };
    RgbImage { width, height, data: (0..width * height).map(pixel).collect() }
}

/// Noise of photons, 1 % at the white board's radiance.
struct Noise(u32);

impl Noise {
    fn of(&mut self, radiance: f64) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.0 >> 8) / f64::from(1u32 << 24) - 0.5
        };
        let normal: f64 = (0..12).map(|_| uniform()).sum();
        radiance + 0.01 * radiance.max(0.0).sqrt() * normal
    }
}

/// Radiance through an analyser at an angle, with noise.
fn through(parts: &[RgbImage; 2], angle: f64, noise: &mut Noise) -> RgbImage {
    let passed = (angle - LAMP).to_radians().cos().powi(2);
    let mut image = parts[0].clone();
    for (value, specular) in image.data.iter_mut().zip(&parts[1].data) {
        for c in 0..3 {
            value[c] = noise.of(0.5 * f64::from(value[c]) + passed * f64::from(specular[c])) as f32;
        }
    }
    image
}

fn write_exr(path: &Path, image: &RgbImage) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    exr::prelude::write_rgb_file(path, image.width, image.height, |x, y| image.row(y)[x].into()).unwrap();
}

/// A capture of the sample's first frames as `record` writes them: it gives a frame's keys.
fn recorded(record: impl Fn(&Path, usize, &[RgbImage; 2]) -> Value) -> (tempfile::TempDir, Vec<[RgbImage; 2]>) {
    let sample = variant(FRAMES, |_, _| {});
    let truth = read(sample.path()).unwrap();
    let truth: Vec<_> = (0..FRAMES).map(|frame| parts(&truth, frame).map(|image| finer(&image))).collect();
    let capture = variant(FRAMES, |description, folder| {
        for key in ["fl_x", "fl_y", "cx", "cy", "w", "h"] {
            description[key] = json!(description[key].as_f64().unwrap() * FINER as f64);
        }
        description.as_object_mut().unwrap().remove("white_reference");
        description.as_object_mut().unwrap().remove("color_space");
        for (number, frame) in description["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
            let frame = frame.as_object_mut().unwrap();
            ["file_path", "cross_file_path", "mask_path"].iter().for_each(|key| drop(frame.remove(*key)));
            let keys = record(folder, number, &truth[number]);
            frame.extend(keys.as_object().unwrap().clone());
        }
    });
    (capture, truth)
}

/// PSNR in dB of diffuse and specular radiance, which are to be multiplied by `unit`, over what the object fills, to the white board's.
fn separation(capture: &Path, unit: f32, truth: &[[RgbImage; 2]]) -> [f64; 2] {
    let capture = read(capture).unwrap();
    assert_eq!(capture.frames.len(), truth.len());
    let (mut squares, mut count) = ([0.0; 2], 0.0);
    for (frame, truth) in truth.iter().enumerate() {
        let found = parts(&capture, frame);
        // The background is black.
        for k in (0..truth[0].data.len()).filter(|&k| truth[0].data[k][1] > 0.01) {
            count += 3.0;
            for (part, sum) in squares.iter_mut().enumerate() {
                *sum += (0..3)
                    .map(|c| f64::from(unit * found[part].data[k][c] - truth[part].data[k][c]).powi(2))
                    .sum::<f64>();
            }
        }
    }
    squares.map(|sum| -10.0 * (sum / count).log10())
}

#[test]
fn rotating_filters_parallel_pairs_and_polarisation_cameras_separate() {
    let angles = [0.0, 45.0, 90.0, 135.0];
    let (rotating, truth) = recorded(|folder, number, parts| {
        let shot = |angle: f64| {
            let name = format!("{number}-{angle}.exr");
            write_exr(&folder.join(&name), &through(parts, angle, &mut Noise(number as u32 + angle as u32)));
            json!({"file_path": name, "angle": angle})
        };
        json!({"polarisers": angles.map(shot)})
    });
    let (parallel, _) = recorded(|folder, number, parts| {
        for (name, angle) in [("parallel", LAMP), ("cross", LAMP + 90.0)] {
            let path = folder.join(name).join(format!("{number}.exr"));
            write_exr(&path, &through(parts, angle, &mut Noise(number as u32 + angle as u32)));
        }
        json!({"file_path": format!("parallel/{number}.exr")})
    });
    let (mosaic, _) = recorded(|folder, number, parts| {
        let cells = [90.0, 45.0, 135.0, 0.0];
        let shots = cells.map(|angle| through(parts, angle, &mut Noise(number as u32 + angle as u32)));
        let value = |x: u32, y: u32| {
            let colour = [0, 1, 1, 2][(x / 2 % 2 + y / 2 % 2 * 2) as usize];
            let radiance: f32 = shots[(x % 2 + y % 2 * 2) as usize].row(y as usize)[x as usize][colour];
            image::Luma([(65535.0 * (radiance / BRIGHTEST).clamp(0.0, 1.0)).round() as u16])
        };
        let (width, height) = (shots[0].width as u32, shots[0].height as u32);
        let name = format!("{number}.png");
        image::ImageBuffer::from_fn(width, height, value).save(folder.join(&name)).unwrap();
        json!({"file_path": name, "polarisation_mosaic": {"angles": cells, "colours": "RGGB"}})
    });
    for (capture, unit, least) in
        [(&rotating, 1.0, [44.5, 46.0]), (&parallel, 1.0, [43.5, 46.0]), (&mosaic, BRIGHTEST, [33.0, 29.2])]
    {
        let found = separation(capture.path(), unit, &truth);
        eprintln!("{found:?}");
        assert!(found[0] > least[0] && found[1] > least[1], "{found:?}, at least {least:?}");
    }
}
