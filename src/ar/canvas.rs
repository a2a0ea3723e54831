//! Lens distortion of what is drawn: object and shadow are drawn for a pinhole camera and read where each pixel's ray meets
//! that camera's image.

use super::plate::{Plate, SrgbCurve};
use super::sensor::grain;
use crate::capture::calibration::Calibration;
use crate::image::Grid;
use crate::mesh::Mesh;
use crate::relight::{GroundShadow, RUN, RealtimeFrame};
use crate::views::Camera;
use glam::Vec3A;

/// The pinhole camera's image reaches at most this many of its own sizes beyond the frame.
const BEYOND: f64 = 1.0;
/// Rows that are worked on at a time.
const ROWS: usize = 16;

/// Part of a canvas: left, top, width, height.
pub(super) type CanvasWindow = [usize; 4];

/// The pinhole camera that is drawn for, and where a frame's pixels lie in its image.
pub(super) struct LensCanvas {
    pub(super) camera: Camera,
    size: [usize; 2],
    /// Position of each pixel of the frame on the canvas; `None` for a pinhole, whose pixels are the canvas's. Not a number where the lens has no ray.
    places: Option<Vec<[f32; 2]>>,
}

/// Returns colour and coverage at a position of the object's image, in pixels, bilinear; nothing beyond it.
fn between(frame: &RealtimeFrame, [x, y]: [f32; 2]) -> ([f32; 3], f32) {
    let (x, y) = (x - 0.5, y - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (s, t) = (x - left, y - top);
    let (mut colour, mut covered) = ([0.0; 3], 0.0);
    for (row, wy) in [(top, 1.0 - t), (top + 1.0, t)] {
        for (column, wx) in [(left, 1.0 - s), (left + 1.0, s)] {
            if row < 0.0 || column < 0.0 || row >= frame.image.height as f32 || column >= frame.image.width as f32 {
                continue;
            }
            let k = row as usize * frame.image.width + column as usize;
            covered += wx * wy * frame.coverage.data[k];
            (0..3).for_each(|c| colour[c] += wx * wy * frame.image.data[k][c]);
        }
    }
    (colour, covered)
}

impl LensCanvas {
    pub(super) fn new(calibration: &Calibration) -> Self {
        let Calibration { camera, lens } = calibration;
        let size = [camera.width as usize, camera.height as usize];
        if lens.is_pinhole() {
            return LensCanvas { camera: *camera, size, places: None };
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
        LensCanvas { camera, size, places: Some(places) }
    }

    /// Darkens the ground.
    pub(super) fn blend_shadow(&self, shadow: &GroundShadow, camera: &Camera, curve: &SrgbCurve, plate: &mut Plate) {
        let seen = shadow.project(camera);
        let width = self.size[0];
        // The pixels from column `left` on.
        let ratios = |left: usize, y: usize| {
            let places = match &self.places {
                None => [std::array::from_fn(|k| (left + k) as f32 + 0.5), [y as f32 + 0.5; RUN]],
                Some(places) => {
                    let row = &places[y * width + left..(y + 1) * width];
                    [0, 1].map(|i| std::array::from_fn(|k| row.get(k).map_or(f32::NAN, |place| place[i])))
                }
            };
            seen.ratios(&places)
        };
        match plate {
            Plate::Display(picture) => runs(picture, ratios, |pixel, ratio| {
                *pixel = curve.codes((Vec3A::from(curve.linear(*pixel)) * ratio).to_array());
            }),
            Plate::Linear(image) => {
                runs(image, ratios, |pixel, ratio| *pixel = (Vec3A::from(*pixel) * ratio).to_array());
            }
        }
    }

    /// Puts the object, drawn on a part of the canvas, over the frame, with noise of standard deviation `sigma`.
    pub(super) fn blend_object(
        &self,
        object: &RealtimeFrame,
        part: CanvasWindow,
        gain: [f32; 3],
        (sigma, frame): (f32, u32),
        curve: &SrgbCurve,
        plate: &mut Plate,
    ) {
        let [left, top, width, height] = part;
        let value = |[x, y]: [f32; 2]| {
            let (x, y) = (x - left as f32, y - top as f32);
            if !(x > -1.0 && y > -1.0 && x < width as f32 + 1.0 && y < height as f32 + 1.0) {
                return None;
            }
            let (colour, covered) = match self.places {
                Some(_) => between(object, [x, y]),
                None => {
                    (*object.image.value_at(x as usize, y as usize), *object.coverage.value_at(x as usize, y as usize))
                }
            };
            // In partly covered pixels the photograph's part has its own noise.
            (covered > 0.0).then(|| PixelChange {
                factor: (1.0 - covered).max(0.0),
                colour: std::array::from_fn(|c| colour[c] * gain[c]),
                noise: sigma * covered,
            })
        };
        let part = if self.places.is_some() { self.whole() } else { part };
        self.change(plate, part, curve, frame, value);
    }

    fn whole(&self) -> CanvasWindow {
        [0, 0, self.size[0], self.size[1]]
    }

    /// Changes pixels of a part of the frame, by their positions on the canvas; `frame` chooses the noise.
    fn change(
        &self,
        plate: &mut Plate,
        part: CanvasWindow,
        curve: &SrgbCurve,
        frame: u32,
        value: impl Fn([f32; 2]) -> Option<PixelChange> + Sync + Send,
    ) {
        let width = self.size[0];
        // Linear colour, and noise in display values.
        let blend = |[x, y]: [usize; 2], linear: [f32; 3]| {
            let k = y * width + x;
            let place = self.places.as_ref().map_or_else(|| [x as f32 + 0.5, y as f32 + 0.5], |places| places[k]);
            let PixelChange { factor, colour, noise } = value(place)?;
            let mixed: [f32; 3] = std::array::from_fn(|c| linear[c] * factor + colour[c]);
            Some((mixed, (noise > 0.0).then(|| grain(k as u32, frame).map(|g| g * noise))))
        };
        match plate {
            Plate::Display(picture) => each(picture, part, |at, pixel| {
                *pixel = match blend(at, curve.linear(*pixel)) {
                    None => *pixel,
                    Some((mixed, None)) => curve.codes(mixed),
                    Some((mixed, Some(grain))) => {
                        std::array::from_fn(|c| (curve.display(mixed[c]) + grain[c]).round().clamp(0.0, 255.0) as u8)
                    }
                };
            }),
            Plate::Linear(image) => each(image, part, |at, pixel| {
                let Some((mixed, grain)) = blend(at, *pixel) else { return };
                *pixel = std::array::from_fn(|c| match (mixed[c], grain) {
                    // Noise is known in display values; beyond white there is none.
                    (x, Some(grain)) if x < 1.0 => curve.linear_of_display(curve.display(x) + grain[c]),
                    (x, _) => x,
                });
            }),
        }
    }
}

/// Change of a pixel: `pixel * factor + colour`, and the noise that is added, in display values.
struct PixelChange {
    factor: f32,
    colour: [f32; 3],
    noise: f32,
}

/// `f` of column and row and the pixel, for the pixels of a part of an image.
fn each<P: Send>(
    picture: &mut Grid<P>,
    [left, top, width, height]: CanvasWindow,
    f: impl Fn([usize; 2], &mut P) + Sync + Send,
) {
    rows(picture, |y, row| {
        if (top..top + height).contains(&y) {
            (left..(left + width).min(row.len())).for_each(|x| f([x, y], &mut row[x]));
        }
    });
}

/// `f` of the pixels and what `values` gives for their run, by its first column and its row; runs without are left out.
fn runs<P: Send>(
    picture: &mut Grid<P>,
    values: impl Fn(usize, usize) -> Option<[Vec3A; RUN]> + Sync + Send,
    f: impl Fn(&mut P, Vec3A) + Sync + Send,
) {
    rows(picture, |y, row| {
        for (run, pixels) in row.chunks_mut(RUN).enumerate() {
            let Some(values) = values(run * RUN, y) else { continue };
            pixels.iter_mut().zip(values).for_each(|(pixel, value)| f(pixel, value));
        }
    });
}

/// `f` of the number of a row and its pixels.
fn rows<P: Send>(picture: &mut Grid<P>, f: impl Fn(usize, &mut [P]) + Sync + Send) {
    let columns = picture.width.max(1);
    crate::parallel::for_each_chunk(&mut picture.data, columns * ROWS, |part, pixels| {
        pixels.chunks_exact_mut(columns).enumerate().for_each(|(k, row)| f(part * ROWS + k, row));
    });
}

/// A part of the view.
pub(super) fn cropped(camera: &Camera, [left, top, width, height]: CanvasWindow) -> Camera {
    Camera {
        width: width as u32,
        height: height as u32,
        principal: [camera.principal[0] - left as f64, camera.principal[1] - top as f64],
        ..*camera
    }
}

/// The part of the view that shows the mesh; all of it where some vertex lies behind the camera, `None` where nothing is in sight.
pub(super) fn window_around(mesh: &Mesh, camera: &Camera) -> Option<CanvasWindow> {
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
