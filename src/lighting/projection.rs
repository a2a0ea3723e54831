//! Projections of the sphere onto images (latitude and longitude, cube, mirror ball, fisheye), and environments made of such images.

use super::environment::{EnvironmentMap, direction_at};
use crate::error::{Error, Result};
use crate::image::RgbImage;
use std::f64::consts::PI;

/// Projection of the sphere onto an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EnvironmentProjection {
    /// Latitude and longitude, as [`EnvironmentMap`] has them.
    LatLong,
    /// Six squares: a cross 4 x 3 or 3 x 4 of them, or a strip of +X, -X, +Y, -Y, +Z, -Z. In the horizontal cross the middle row is
    /// -X, +Z, +X, -Z with +Y above and -Y below +Z; in the vertical cross -Z stands upside down below -Y. Seen from inside, as in
    /// OpenGL's cube maps.
    Cube,
    /// A mirror ball that touches all four sides, seen from far away in +Z; what it shows in its middle comes from there.
    MirrorBall,
    /// Fisheye whose image circle touches the shorter sides.
    Fisheye {
        /// Distance from the middle as a function of the angle from the axis.
        model: FisheyeModel,
        /// Angle from edge to edge, degrees, up to 360.
        field_degrees: f64,
        /// Direction of the lens's axis.
        looks: FisheyeAxis,
    },
}

/// A fisheye lens's law.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FisheyeModel {
    /// Distance proportional to the angle.
    Equidistant,
    /// Distance proportional to the sine of half the angle: equal areas for equal solid angles.
    Equisolid,
}

/// Direction of a fisheye lens's axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FisheyeAxis {
    /// To +Z, the middle of a latitude-longitude image, with +Y up in the image.
    Ahead,
    /// To +Y, the zenith, with +Z at the lower edge: the camera was tilted up from [`FisheyeAxis::Ahead`].
    Up,
}

impl EnvironmentProjection {
    /// By the image's shape: 2:1 latitude-longitude, 4:3, 3:4, 6:1 and 1:6 cube.
    pub fn guess(image: &RgbImage) -> Option<Self> {
        let (w, h) = (image.width, image.height);
        if w == 2 * h {
            return Some(EnvironmentProjection::LatLong);
        }
        let cube = (w * 3 == h * 4) || (w * 4 == h * 3) || w == 6 * h || h == 6 * w;
        cube.then_some(EnvironmentProjection::Cube)
    }
}

/// The environment that an image shows, `width` columns wide, or as many as keep its detail.
pub(super) fn unwrap(
    image: RgbImage,
    projection: EnvironmentProjection,
    width: Option<usize>,
) -> std::result::Result<EnvironmentMap, String> {
    if image.width.min(image.height) == 0 {
        return Err("has no pixels".into());
    }
    let make = |natural: usize, f: &dyn Fn([f64; 3]) -> [f32; 3]| {
        let width = width.unwrap_or(natural.next_multiple_of(2)).clamp(4, 8192);
        EnvironmentMap::from_fn(width, f)
    };
    Ok(match projection {
        EnvironmentProjection::LatLong => {
            let environment = EnvironmentMap::new(image).map_err(|e| e.to_string())?.0;
            match width {
                Some(width) => environment.resized(width, width / 2),
                None => environment,
            }
        }
        EnvironmentProjection::Cube => {
            let faces = CubeFaces::of(&image)?;
            make(4 * faces.side, &|d| faces.radiance(&image, d))
        }
        EnvironmentProjection::MirrorBall | EnvironmentProjection::Fisheye { .. } => {
            let lens = ProbeLens::new([image.width, image.height], projection)?;
            make(lens.columns(), &|d| lens.tap(d).map_or([0.0; 3], |tap| tap.read(&image)))
        }
    })
}

/// Makes environments of images of one size, many times: which pixels each direction takes is worked out once.
pub struct Unwrapper {
    size: [usize; 2],
    columns: usize,
    /// For each pixel of the environment; none where the image shows nothing.
    taps: Vec<Option<PixelTap>>,
}

impl Unwrapper {
    /// For images of `width` x `height` pixels and environments of `columns` x `columns / 2`. `turn` brings directions of the
    /// environment to directions of the image's axes.
    ///
    /// Errors: a cube, which is not read this way; a fisheye's field out of range; no pixels.
    pub fn new(
        size: [usize; 2],
        projection: EnvironmentProjection,
        columns: usize,
        turn: impl Fn([f64; 3]) -> [f64; 3] + Sync + Send,
    ) -> Result<Self> {
        if size.iter().any(|&side| side < 2) || !(4..=8192).contains(&columns) {
            return Err(Error::parameter(
                "an environment is made of images of 2 x 2 pixels at least, 4 to 8192 columns wide",
            ));
        }
        if projection == EnvironmentProjection::Cube {
            return Err(Error::Unsupported("a sequence of cube pictures; 2:1 and fisheye ones are".into()));
        }
        let lens = ProbeLens::new(size, projection).map_err(Error::parameter)?;
        let rows = columns / 2;
        let taps = crate::parallel::map(columns * rows, |k| {
            let (x, y) = ((k % columns) as f64 + 0.5, (k / columns) as f64 + 0.5);
            lens.tap(turn(direction_at(columns, rows, x, y)))
        });
        Ok(Unwrapper { size, columns, taps })
    }

    /// Returns the environment of an image of linear radiance.
    ///
    /// # Errors
    ///
    /// [`Error::Parameter`] if the image has another size than stated.
    pub fn environment(&self, picture: &RgbImage) -> Result<EnvironmentMap> {
        if [picture.width, picture.height] != self.size {
            let [width, height] = self.size;
            let message = format!(
                "an image of the light has {} x {} pixels, the first had {width} x {height}",
                picture.width, picture.height
            );
            return Err(Error::parameter(message));
        }
        let (width, height) = (self.columns, self.columns / 2);
        let mut image = RgbImage::filled(width, height, [0.0; 3]);
        crate::parallel::for_each_chunk(&mut image.data, width, |row, pixels| {
            for (pixel, tap) in pixels.iter_mut().zip(&self.taps[row * width..]) {
                *pixel = tap.as_ref().map_or([0.0; 3], |tap| tap.read(picture));
            }
        });
        Ok(EnvironmentMap::new(image)?.0)
    }
}

/// Four pixels and a position between them.
struct PixelTap {
    /// The upper left one, and what is added for the one on its right, modulo 2^32, and the one below.
    first: u32,
    right: u32,
    below: u32,
    place: [f32; 2],
}

impl PixelTap {
    #[inline]
    fn read(&self, picture: &RgbImage) -> [f32; 3] {
        let [a, b] = self.place;
        let at = |k: u32| picture.data[k as usize];
        let (p, q) = (at(self.first), at(self.first.wrapping_add(self.right)));
        let below = self.first + self.below;
        let (r, s) = (at(below), at(below.wrapping_add(self.right)));
        std::array::from_fn(|c| (1.0 - b) * ((1.0 - a) * p[c] + a * q[c]) + b * ((1.0 - a) * r[c] + a * s[c]))
    }
}

/// A projection onto one image, in images of one size.
struct ProbeLens {
    size: [usize; 2],
    /// Middle of the largest circle in the image.
    middle: [f64; 2],
    radius: f64,
    law: ProbeLaw,
}

/// Projection of a direction onto the image.
enum ProbeLaw {
    LatLong,
    MirrorBall,
    Fisheye { model: FisheyeModel, half_field: f64, looks: FisheyeAxis },
}

impl ProbeLens {
    /// For all projections but a cube.
    fn new([width, height]: [usize; 2], projection: EnvironmentProjection) -> std::result::Result<Self, String> {
        let law = match projection {
            EnvironmentProjection::LatLong => ProbeLaw::LatLong,
            EnvironmentProjection::MirrorBall => ProbeLaw::MirrorBall,
            EnvironmentProjection::Fisheye { model, field_degrees, looks } => {
                if !(1.0..=360.0).contains(&field_degrees) {
                    return Err("a fisheye's field must be 1 to 360 degrees".into());
                }
                ProbeLaw::Fisheye { model, half_field: field_degrees.to_radians() / 2.0, looks }
            }
            EnvironmentProjection::Cube => return Err("a cube is more than one picture".into()),
        };
        let middle = [width, height].map(|side| side as f64 / 2.0);
        Ok(ProbeLens { size: [width, height], middle, radius: middle[0].min(middle[1]), law })
    }

    /// Columns of an environment that has the image's detail.
    fn columns(&self) -> usize {
        match self.law {
            ProbeLaw::LatLong => self.size[0],
            ProbeLaw::MirrorBall => 2 * self.size[0].min(self.size[1]),
            ProbeLaw::Fisheye { half_field, .. } => (self.radius * 2.0 * PI / half_field).round() as usize,
        }
    }

    /// Returns the pixels around the position that shows a direction; `None` outside a fisheye's field.
    #[inline]
    fn tap(&self, direction: [f64; 3]) -> Option<PixelTap> {
        let [width, height] = self.size;
        let [x, y] = self.place(direction)?;
        let wraps = matches!(self.law, ProbeLaw::LatLong);
        let y = (y - 0.5).clamp(0.0, (height - 1) as f64);
        let x = if wraps { (x - 0.5).rem_euclid(width as f64) } else { (x - 0.5).clamp(0.0, (width - 1) as f64) };
        let (column, row) = ((x as usize).min(width - 1), (y as usize).min(height - 1));
        let right = match column + 1 {
            beyond if beyond < width => 1,
            // Back to the first column, modulo 2^32.
            _ if wraps => (column as u32).wrapping_neg(),
            _ => 0,
        };
        let below = if row + 1 < height { width as u32 } else { 0 };
        let place = [(x - column as f64) as f32, (y - row as f64) as f32];
        Some(PixelTap { first: (row * width + column) as u32, right, below, place })
    }

    fn place(&self, d: [f64; 3]) -> Option<[f64; 2]> {
        let ProbeLens { size: [width, height], middle, radius, .. } = *self;
        match self.law {
            ProbeLaw::LatLong => {
                let u = d[0].atan2(-d[2]) / (2.0 * PI);
                Some([(u - u.floor()) * width as f64, d[1].clamp(-1.0, 1.0).acos() / PI * height as f64])
            }
            ProbeLaw::MirrorBall => {
                // The normal lies half way between the view (0, 0, 1) and the direction.
                let half = [d[0], d[1], d[2] + 1.0];
                let length = (half[0] * half[0] + half[1] * half[1] + half[2] * half[2]).sqrt().max(1e-6);
                // Seen from +Z, +X is on the right.
                Some([middle[0] + radius * half[0] / length, middle[1] - radius * half[1] / length])
            }
            ProbeLaw::Fisheye { model, half_field, looks } => {
                // Right, up and forward of the lens. Looking to +Z with +Y up, -X is on the right.
                let (right, up, forward) = match looks {
                    FisheyeAxis::Ahead => (-d[0], d[1], d[2]),
                    FisheyeAxis::Up => (-d[0], -d[2], d[1]),
                };
                let across = right.hypot(up);
                let angle = across.atan2(forward);
                if angle > half_field {
                    return None;
                }
                let distance = match model {
                    FisheyeModel::Equidistant => angle / half_field,
                    FisheyeModel::Equisolid => (angle / 2.0).sin() / (half_field / 2.0).sin(),
                };
                let scale = radius * distance / across.max(1e-12);
                Some([middle[0] + scale * right, middle[1] - scale * up])
            }
        }
    }
}

/// A value between pixels (centres at +0.5), limited to a part of the image: left, top, width, height.
fn bilinear_within(image: &RgbImage, [left, top, width, height]: [usize; 4], x: f64, y: f64) -> [f32; 3] {
    let x = (x - 0.5).clamp(0.0, (width - 1) as f64);
    let y = (y - 0.5).clamp(0.0, (height - 1) as f64);
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
    let (a, b) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let at = |x: usize, y: usize| image.value_at(left + x, top + y);
    let (p, q, r, s) = (at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1));
    std::array::from_fn(|c| (1.0 - b) * ((1.0 - a) * p[c] + a * q[c]) + b * ((1.0 - a) * r[c] + a * s[c]))
}

/// Layout of a cube's six faces in an image.
struct CubeFaces {
    side: usize,
    /// Column and row, in squares, of +X, -X, +Y, -Y, +Z, -Z.
    places: [[usize; 2]; 6],
    /// Whether -Z is turned by half a turn.
    turned: bool,
}

impl CubeFaces {
    fn of(image: &RgbImage) -> std::result::Result<CubeFaces, String> {
        let (w, h) = (image.width, image.height);
        let cross = [[2, 1], [0, 1], [1, 0], [1, 2], [1, 1]];
        let places = |last: [usize; 2]| std::array::from_fn(|k| cross.get(k).copied().unwrap_or(last));
        if w * 3 == h * 4 && w >= 4 {
            Ok(CubeFaces { side: w / 4, places: places([3, 1]), turned: false })
        } else if w * 4 == h * 3 && w >= 3 {
            Ok(CubeFaces { side: w / 3, places: places([1, 3]), turned: true })
        } else if w == 6 * h {
            Ok(CubeFaces { side: h, places: std::array::from_fn(|k| [k, 0]), turned: false })
        } else if h == 6 * w {
            Ok(CubeFaces { side: w, places: std::array::from_fn(|k| [0, k]), turned: false })
        } else {
            Err(format!("{w} x {h} pixels are no cross (4:3, 3:4) and no strip (6:1, 1:6) of six squares"))
        }
    }

    fn radiance(&self, image: &RgbImage, [x, y, z]: [f64; 3]) -> [f32; 3] {
        let [ax, ay, az] = [x.abs(), y.abs(), z.abs()];
        // OpenGL's table of faces: major axis, then s to the right and t down.
        let (face, s, t, major) = if ax >= ay && ax >= az {
            if x > 0.0 { (0, -z, -y, ax) } else { (1, z, -y, ax) }
        } else if ay >= az {
            if y > 0.0 { (2, x, z, ay) } else { (3, x, -z, ay) }
        } else if z > 0.0 {
            (4, x, -y, az)
        } else {
            (5, -x, -y, az)
        };
        let (s, t) = if face == 5 && self.turned { (-s, -t) } else { (s, t) };
        let to_pixels = |s: f64| (s / major + 1.0) * 0.5 * self.side as f64;
        let [column, row] = self.places[face];
        let part = [column * self.side, row * self.side, self.side, self.side];
        bilinear_within(image, part, to_pixels(s), to_pixels(t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(d: [f64; 3]) -> [f32; 3] {
        d.map(|x| (x + 1.0) as f32)
    }

    fn check(environment: &EnvironmentMap, tolerance: f32, only: impl Fn([f64; 3]) -> bool) {
        let mut compared = 0;
        for d in crate::sphere::octahedral::directions(12).into_iter().filter(|&d| only(d)) {
            let found = environment.radiance(d);
            let wanted = linear(d);
            assert!((0..3).all(|c| (found[c] - wanted[c]).abs() < tolerance), "{d:?}: {found:?}, not {wanted:?}");
            compared += 1;
        }
        assert!(compared > 20);
    }

    /// An image drawn by the inverse of a projection: direction of each place, none outside.
    fn draw(width: usize, height: usize, direction: impl Fn(f64, f64) -> Option<[f64; 3]>) -> RgbImage {
        let mut image = RgbImage::filled(width, height, [0.0; 3]);
        for k in 0..image.data.len() {
            if let Some(d) = direction((k % width) as f64 + 0.5, (k / width) as f64 + 0.5) {
                image.data[k] = linear(d);
            }
        }
        image
    }

    #[test]
    fn a_mirror_ball_shows_the_whole_sphere() {
        let ball = draw(200, 200, |x, y| {
            let (nx, ny) = ((x - 100.0) / 100.0, (100.0 - y) / 100.0);
            let nz = (1.0 - nx * nx - ny * ny).max(0.0).sqrt();
            // The view (0, 0, 1) mirrored at the normal.
            Some([2.0 * nz * nx, 2.0 * nz * ny, 2.0 * nz * nz - 1.0])
        });
        let environment = unwrap(ball, EnvironmentProjection::MirrorBall, None).unwrap();
        check(&environment, 0.05, |d| d[2] > -0.9);
    }

    #[test]
    fn fisheyes_of_both_laws_and_any_field() {
        for (field, model) in
            [(180.0, FisheyeModel::Equidistant), (360.0, FisheyeModel::Equidistant), (220.0, FisheyeModel::Equisolid)]
        {
            for looks in [FisheyeAxis::Ahead, FisheyeAxis::Up] {
                let half = f64::to_radians(field) / 2.0;
                let picture = draw(220, 200, |x, y| {
                    let (px, py) = ((x - 110.0) / 100.0, (100.0 - y) / 100.0);
                    let r = px.hypot(py).clamp(1e-9, 1.0);
                    let angle = match model {
                        FisheyeModel::Equidistant => r * half,
                        FisheyeModel::Equisolid => 2.0 * (r * (half / 2.0).sin()).asin(),
                    };
                    let (right, up) = (angle.sin() * px / r, angle.sin() * py / r);
                    Some(match looks {
                        FisheyeAxis::Ahead => [-right, up, angle.cos()],
                        FisheyeAxis::Up => [-right, angle.cos(), -up],
                    })
                });
                let projection = EnvironmentProjection::Fisheye { model, field_degrees: field, looks };
                let environment = unwrap(picture, projection, None).unwrap();
                let least = (half - 0.1).cos();
                check(&environment, 0.03, |d| if looks == FisheyeAxis::Up { d[1] > least } else { d[2] > least });
            }
        }
    }

    #[test]
    fn sequences_are_unwrapped_as_single_pictures_are() {
        let fisheye = EnvironmentProjection::Fisheye {
            model: FisheyeModel::Equisolid,
            field_degrees: 200.0,
            looks: FisheyeAxis::Up,
        };
        for projection in [fisheye, EnvironmentProjection::LatLong, EnvironmentProjection::MirrorBall] {
            let picture = draw(96, 48, |x, y| Some([(x / 30.0).sin(), (y / 20.0).cos(), (x * y / 900.0).sin()]));
            let straight = Unwrapper::new([96, 48], projection, 64, |d| d).unwrap().environment(&picture).unwrap();
            let single = unwrap(picture.clone(), projection, None).unwrap();
            let turned = Unwrapper::new([96, 48], projection, 64, |d| super::super::environment::turn_y(d, -90.0));
            let turned = turned.unwrap().environment(&picture).unwrap();
            for k in 0..64 * 32 {
                let d = straight.direction((k % 64) as f64 + 0.5, (k / 64) as f64 + 0.5);
                let (found, wanted) = (straight.image().data[k], single.radiance(d));
                // Beside the edge of a fisheye's field one of the two is black.
                let black = |v: [f32; 3]| v.iter().any(|&c| c < 0.3);
                let near = (0..3).all(|c| (found[c] - wanted[c]).abs() < 0.12);
                assert!(near || black(found) || black(wanted), "{projection:?} {d:?}: {found:?}, {wanted:?}");
                let quarter = turned.image().data[k / 64 * 64 + (k + 48) % 64];
                assert!((0..3).all(|c| (quarter[c] - found[c]).abs() < 1e-5), "{projection:?} {k}");
            }
            let smaller = draw(48, 48, |_, _| Some([0.0, 1.0, 0.0]));
            assert!(Unwrapper::new([96, 48], projection, 64, |d| d).unwrap().environment(&smaller).is_err());
        }
        assert!(Unwrapper::new([96, 48], EnvironmentProjection::Cube, 64, |d| d).is_err());
    }

    #[test]
    fn cubes_of_four_layouts() {
        let face = |k: usize, s: f64, t: f64| {
            let d = match k {
                0 => [1.0, -t, -s],
                1 => [-1.0, -t, s],
                2 => [s, 1.0, t],
                3 => [s, -1.0, -t],
                4 => [s, -t, 1.0],
                _ => [-s, -t, -1.0],
            };
            let length = d.iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
            d.map(|x| x / length)
        };
        for (columns, rows) in [(4, 3), (3, 4), (6, 1), (1, 6)] {
            let side = 48;
            let faces = CubeFaces::of(&RgbImage::filled(columns * side, rows * side, [0.0; 3])).unwrap();
            let picture = draw(columns * side, rows * side, |x, y| {
                let (column, row) = (x as usize / side, y as usize / side);
                let k = faces.places.iter().position(|&place| place == [column, row])?;
                let to = |p: f64| p % side as f64 / side as f64 * 2.0 - 1.0;
                let sign = if k == 5 && faces.turned { -1.0 } else { 1.0 };
                Some(face(k, sign * to(x), sign * to(y)))
            });
            assert_eq!(EnvironmentProjection::guess(&picture), Some(EnvironmentProjection::Cube));
            check(&unwrap(picture, EnvironmentProjection::Cube, None).unwrap(), 0.05, |_| true);
        }
        assert!(unwrap(RgbImage::filled(5, 4, [0.0; 3]), EnvironmentProjection::Cube, None).is_err());
    }
}
