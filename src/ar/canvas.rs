//! What is drawn, as the lens shows it: the object and its shadow are drawn for a pinhole camera and read at the place where each pixel's ray meets
//! that camera's picture.

use super::plate::{Curve, Plate};
use super::sensor::grain;
use crate::asset::{Camera, Mesh};
use crate::capture::calibration::Calibration;
use crate::image::{Grid, RgbImage};
use crate::relight::{Frame, GroundShadow};

/// The pinhole camera's picture reaches at most this many of its own sizes beyond the frame.
const BEYOND: f64 = 1.0;
/// Rows that are worked on at a time.
const ROWS: usize = 16;

/// Part of a canvas: left, top, width, height.
pub(super) type Part = [usize; 4];

/// The pinhole camera that is drawn for, and where a frame's pixels lie in its picture.
pub(super) struct Canvas {
    pub(super) camera: Camera,
    size: [usize; 2],
    /// Of each pixel of the frame; `None` for a pinhole, whose pixels are the canvas's. Not a number where the lens has no ray.
    places: Option<Vec<[f32; 2]>>,
}

/// An object drawn: radiance times coverage, and coverage.
pub(super) struct Layer {
    pub(super) image: RgbImage,
    pub(super) coverage: Grid<f32>,
}

impl Layer {
    /// Means of `samples` x `samples`.
    pub(super) fn of(frame: &Frame, samples: usize) -> Self {
        let (width, height) = (frame.image.width / samples, frame.image.height / samples);
        let mut layer =
            Layer { image: Grid::filled(width, height, [0.0; 3]), coverage: Grid::filled(width, height, 0.0) };
        let share = 1.0 / (samples * samples) as f32;
        let Layer { image, coverage } = &mut layer;
        crate::parallel::rows(&mut image.data, &mut coverage.data, width * ROWS, |part, pixels, covered| {
            for (k, (pixel, covered)) in pixels.iter_mut().zip(covered).enumerate() {
                let (x, y) = (k % width * samples, (part * ROWS + k / width) * samples);
                for row in y..y + samples {
                    let start = row * frame.image.width + x;
                    let hits = &frame.hit.data[start..start + samples];
                    for (sample, _) in
                        frame.image.data[start..start + samples].iter().zip(hits).filter(|(_, hit)| **hit)
                    {
                        *covered += share;
                        (0..3).for_each(|c| pixel[c] += share * sample[c]);
                    }
                }
            }
        });
        layer
    }

    /// Bilinear at a place of the layer, in pixels; nothing beyond it.
    fn between(&self, [x, y]: [f32; 2]) -> ([f32; 3], f32) {
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (s, t) = (x - left, y - top);
        let (mut colour, mut covered) = ([0.0; 3], 0.0);
        for (row, wy) in [(top, 1.0 - t), (top + 1.0, t)] {
            for (column, wx) in [(left, 1.0 - s), (left + 1.0, s)] {
                if row < 0.0 || column < 0.0 || row >= self.image.height as f32 || column >= self.image.width as f32 {
                    continue;
                }
                let k = row as usize * self.image.width + column as usize;
                covered += wx * wy * self.coverage.data[k];
                (0..3).for_each(|c| colour[c] += wx * wy * self.image.data[k][c]);
            }
        }
        (colour, covered)
    }
}

impl Canvas {
    pub(super) fn new(calibration: &Calibration) -> Self {
        let Calibration { camera, lens } = calibration;
        let size = [camera.width as usize, camera.height as usize];
        if lens.is_pinhole() {
            return Canvas { camera: *camera, size, places: None };
        }
        let places: Vec<[f64; 2]> = crate::parallel::map(size[0] * size[1], |k| {
            let pixel = [(k % size[0]) as f64 + 0.5, (k / size[0]) as f64 + 0.5];
            let bent = std::array::from_fn(|i| (pixel[i] - camera.principal[i]) / camera.focal[i]);
            let ideal = lens.undistort(bent);
            ideal.map_or([f64::NAN; 2], |p| std::array::from_fn(|i| p[i] * camera.focal[i] + camera.principal[i]))
        });
        // A canvas that holds all places, within reason.
        let range = |i: usize| {
            let side = size[i] as f64;
            let values = || places.iter().map(|p| p[i]).filter(|p| p.is_finite());
            let low = values().fold(0.0, f64::min).max(-BEYOND * side).floor();
            let high = values().fold(side, f64::max).min((1.0 + BEYOND) * side).ceil();
            (low, high - low)
        };
        let ((left, width), (top, height)) = (range(0), range(1));
        let camera = Camera {
            width: width as u32,
            height: height as u32,
            principal: [camera.principal[0] - left, camera.principal[1] - top],
            ..*camera
        };
        let places = places.iter().map(|p| [(p[0] - left) as f32, (p[1] - top) as f32]).collect();
        Canvas { camera, size, places: Some(places) }
    }

    /// Darkens the ground.
    pub(super) fn darken(&self, shadow: &GroundShadow, camera: &Camera, curve: &Curve, plate: &mut Plate) {
        let Some(places) = &self.places else {
            let change = |pixel: &mut [f32; 3], ratio: [f32; 3]| (0..3).for_each(|c| pixel[c] *= ratio[c]);
            let width = self.size[0];
            let rows_of = |part: usize, count: usize| part * ROWS..part * ROWS + count / width;
            match plate {
                Plate::Display(picture) => {
                    let mut unused = vec![(); picture.data.len()];
                    crate::parallel::rows(&mut picture.data, &mut unused, width * ROWS, |part, pixels, _| {
                        shadow.darken(camera, rows_of(part, pixels.len()), |k, ratio| {
                            let mut linear = curve.linear(pixels[k]);
                            change(&mut linear, ratio);
                            pixels[k] = linear.map(|c| curve.display(c).round() as u8);
                        });
                    });
                }
                Plate::Linear(image) => {
                    let mut unused = vec![(); image.data.len()];
                    crate::parallel::rows(&mut image.data, &mut unused, width * ROWS, |part, pixels, _| {
                        shadow.darken(camera, rows_of(part, pixels.len()), |k, ratio| change(&mut pixels[k], ratio));
                    });
                }
            }
            return;
        };
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut ratios =
            Layer { image: Grid::filled(width, height, [0.0; 3]), coverage: Grid::filled(width, height, 0.0) };
        let Layer { image, coverage } = &mut ratios;
        crate::parallel::rows(&mut image.data, &mut coverage.data, width * ROWS, |part, pixels, covered| {
            let first = part * ROWS;
            shadow.darken(camera, first..first + pixels.len() / width, |k, ratio| {
                (pixels[k], covered[k]) = (ratio.map(|r| 1.0 - r), 1.0);
            });
        });
        let noise = (0.0, 0);
        self.change(
            plate,
            curve,
            noise,
            |k| {
                let (taken, covered) = ratios.between(places[k]);
                (covered > 0.0).then(|| (taken.map(|t| (1.0 - t).max(0.0)), [0.0; 3], 0.0))
            },
            [0, 0, self.size[0], self.size[1]],
        );
    }

    /// Puts a layer, a part of the canvas, over the frame.
    pub(super) fn put(
        &self,
        layer: &Layer,
        part: Part,
        gain: [f32; 3],
        noise: (f32, u32),
        curve: &Curve,
        plate: &mut Plate,
    ) {
        let [left, top, width, height] = part;
        let whole = [0, 0, self.size[0], self.size[1]];
        let over = |colour: [f32; 3], covered: f32| {
            let behind = (1.0 - covered).max(0.0);
            ([behind; 3], std::array::from_fn(|c| colour[c] * gain[c]), covered)
        };
        match &self.places {
            None => self.change(
                plate,
                curve,
                noise,
                |k| {
                    let (x, y) = (k % self.size[0], k / self.size[0]);
                    let at = (y - top) * width + (x - left);
                    let covered = layer.coverage.data[at];
                    (covered > 0.0).then(|| over(layer.image.data[at], covered))
                },
                [left, top, width, height],
            ),
            Some(places) => self.change(
                plate,
                curve,
                noise,
                |k| {
                    let [x, y] = places[k];
                    let (x, y) = (x - left as f32, y - top as f32);
                    if !(x > -1.0 && y > -1.0 && x < width as f32 + 1.0 && y < height as f32 + 1.0) {
                        return None;
                    }
                    let (colour, covered) = layer.between([x, y]);
                    (covered > 0.0).then(|| over(colour, covered))
                },
                whole,
            ),
        }
    }

    /// For the pixels of a part of the frame: `pixel * factor + colour`, with noise where the third number, the coverage, is above 0.
    fn change(
        &self,
        plate: &mut Plate,
        curve: &Curve,
        (sigma, frame): (f32, u32),
        value: impl Fn(usize) -> Option<([f32; 3], [f32; 3], f32)> + Sync + Send,
        [left, top, part_width, part_height]: Part,
    ) {
        let width = self.size[0];
        let (right, bottom) = ((left + part_width).min(width), (top + part_height).min(self.size[1]));
        let blend = |k: usize, linear: [f32; 3]| {
            let (factor, colour, covered) = value(k)?;
            let mixed: [f32; 3] = std::array::from_fn(|c| linear[c] * factor[c] + colour[c]);
            let grain = if covered > 0.0 && sigma > 0.0 { grain(k as u32, frame) } else { [0.0; 3] };
            // In partly covered pixels the photograph's part has its own.
            Some((mixed, grain.map(|g| g * sigma * covered)))
        };
        match plate {
            Plate::Display(picture) => {
                let mut unused = vec![(); picture.data.len()];
                crate::parallel::rows(&mut picture.data, &mut unused, width * ROWS, |part, pixels, _| {
                    for row in (part * ROWS).max(top)..(part * ROWS + pixels.len() / width).min(bottom) {
                        for k in row * width + left..row * width + right {
                            let pixel = &mut pixels[k - part * ROWS * width];
                            if let Some((mixed, grain)) = blend(k, curve.linear(*pixel)) {
                                *pixel = std::array::from_fn(|c| {
                                    (curve.display(mixed[c]) + grain[c]).round().clamp(0.0, 255.0) as u8
                                });
                            }
                        }
                    }
                });
            }
            Plate::Linear(image) => {
                let mut unused = vec![(); image.data.len()];
                crate::parallel::rows(&mut image.data, &mut unused, width * ROWS, |part, pixels, _| {
                    for row in (part * ROWS).max(top)..(part * ROWS + pixels.len() / width).min(bottom) {
                        for k in row * width + left..row * width + right {
                            let pixel = &mut pixels[k - part * ROWS * width];
                            let Some((mixed, grain)) = blend(k, *pixel) else { continue };
                            *pixel = std::array::from_fn(|c| match mixed[c] {
                                // Noise is known in display values; beyond white there is none.
                                x if x < 1.0 && grain[c] != 0.0 => curve.undisplay(curve.display(x) + grain[c]),
                                x => x,
                            });
                        }
                    }
                });
            }
        }
    }
}

/// A part of the view.
pub(super) fn cropped(camera: &Camera, [left, top, width, height]: Part) -> Camera {
    Camera {
        width: width as u32,
        height: height as u32,
        principal: [camera.principal[0] - left as f64, camera.principal[1] - top as f64],
        ..*camera
    }
}

/// The part of the view that shows the mesh; all of it where some vertex lies behind the camera, `None` where nothing is in sight.
pub(super) fn part_around(mesh: &Mesh, camera: &Camera) -> Option<Part> {
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    let mut behind = 0;
    for position in &mesh.positions {
        let Some((pixel, _)) = camera.project(position.map(f64::from)) else {
            behind += 1;
            continue;
        };
        (0..2).for_each(|i| (low[i], high[i]) = (low[i].min(pixel[i]), high[i].max(pixel[i])));
    }
    if behind == mesh.positions.len() {
        return None;
    }
    let size = [camera.width as f64, camera.height as f64];
    if behind > 0 {
        (low, high) = ([0.0; 2], size);
    }
    // One pixel more on each side.
    let from: [f64; 2] = std::array::from_fn(|i| (low[i] - 1.0).floor().clamp(0.0, size[i]));
    let to: [f64; 2] = std::array::from_fn(|i| (high[i] + 1.0).ceil().clamp(0.0, size[i]));
    let part = [from[0], from[1], to[0] - from[0], to[1] - from[1]].map(|x| x as usize);
    (part[2] > 0 && part[3] > 0).then_some(part)
}
