//! Pictures of a marker, drawn from where it truly is.
#![allow(dead_code)]

use tsuya::Camera;
use tsuya::capture::Lens;
use tsuya::image::Grid;
use tsuya::marker::Pose;

/// Rows of white (1) and black cells of number 0 of tag36h11, without its border.
pub const TAG36H11_0: [&str; 6] = ["110101", "011101", "011000", "101000", "010110", "000100"];
/// The same of the original ArUco dictionary.
pub const ARUCO_0: [&str; 5] = ["10000"; 5];

/// A marker of ARToolKit with 14 cells in its border of one: three more black ones, a picture of 8 x 8 within.
pub const ARTOOLKIT: [&str; 14] = [
    "00000000000000",
    "00000000000000",
    "00000000000000",
    "00011111111000",
    "00010111101000",
    "00010111100000",
    "00010111111000",
    "00010111111000",
    "00010111111000",
    "00010000111000",
    "00011111111000",
    "00000000000000",
    "00000000000000",
    "00000000000000",
];

/// The pattern file of such a marker, of `side` cells; mirrored, if asked.
pub fn pattern_file(cells: &[&str], side: usize, mirrored: bool) -> String {
    let mut text = String::new();
    for turn in 0..4 {
        for colour in 0..3 {
            for k in 0..side * side {
                // Turned counter-clockwise by quarters.
                let (mut row, mut column) = (k / side, k % side);
                for _ in 0..turn {
                    (row, column) = (column, side - 1 - row);
                }
                let column = if mirrored { side - 1 - column } else { column };
                let white = cells[3 + 8 * row / side].as_bytes()[3 + 8 * column / side] == b'1';
                let end = if k % side + 1 == side { '\n' } else { ' ' };
                text += &format!("{}{end}", if white { 230 + colour } else { 30 + 2 * colour });
            }
        }
        text += "\n";
    }
    text
}

/// At the origin, looking to +z.
pub fn camera(width: u32, height: u32, focal: f64) -> Camera {
    let principal = [0.5 * width as f64, 0.5 * height as f64];
    Camera { width, height, focal: [focal; 2], principal, rotation: Pose::IDENTITY.rotation, translation: [0.0; 3] }
}

/// Where the rays of a camera's pixels meet the plane one before it: at the corners of all pixels, as undistorting takes long.
pub struct Rays {
    camera: Camera,
    lens: Lens,
    corners: Vec<[f64; 2]>,
}

impl Rays {
    pub fn new(camera: &Camera, lens: &Lens) -> Self {
        let columns = camera.width as usize + 1;
        let corner = |k: usize| {
            let pixel = [(k % columns) as f64, (k / columns) as f64];
            let bent = std::array::from_fn(|i| (pixel[i] - camera.principal[i]) / camera.focal[i]);
            lens.undistort(bent).unwrap_or([9.0; 2])
        };
        let corners = (0..columns * (camera.height as usize + 1)).map(corner).collect();
        Rays { camera: *camera, lens: *lens, corners }
    }

    /// Between the corners of a pixel.
    fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let columns = self.camera.width as usize + 1;
        let (column, row) = (x as usize, y as usize);
        let (s, t) = (x - column as f64, y - row as f64);
        let corner = |dx: usize, dy: usize| self.corners[(row + dy) * columns + column + dx];
        let ([a, b], [c, d]) = ([corner(0, 0), corner(1, 0)], [corner(0, 1), corner(1, 1)]);
        std::array::from_fn(|i| (a[i] * (1.0 - s) + b[i] * s) * (1.0 - t) + (c[i] * (1.0 - s) + d[i] * s) * t)
    }
}

/// As [`draw_through`], for a single picture.
pub fn draw(camera: &Camera, lens: &Lens, cells: &[&str], pose: &Pose, seed: u32) -> Grid<u8> {
    draw_through(&Rays::new(camera, lens), cells, pose, seed)
}

/// A marker of side 0.1 on white paper, as a camera sees it before a grey wall, with noise.
pub fn draw_through(rays: &Rays, cells: &[&str], pose: &Pose, seed: u32) -> Grid<u8> {
    let Rays { camera, lens, .. } = rays;
    const SAMPLES: usize = 4;
    const WALL: f64 = 90.0;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let count = cells.len() as f64 + 2.0;
    let back = pose.inverse();
    let value = |x: f64, y: f64| {
        let [dx, dy] = rays.at(x, y);
        let (from, to) = (back.transform_point([0.0; 3]), back.transform_point([dx, dy, 1.0]));
        let t = from[2] / (from[2] - to[2]);
        let [u, v] = [0, 1].map(|k| (from[k] + t * (to[k] - from[k])) / 0.1);
        if t <= 0.0 || u.abs() > 0.5 + 1.0 / count || v.abs() > 0.5 + 1.0 / count {
            return WALL;
        }
        let (column, row) = ((u + 0.5) * count - 1.0, (0.5 - v) * count - 1.0);
        if u.abs() > 0.5 || v.abs() > 0.5 {
            return 225.0;
        }
        let cell = |k: f64| if k < 0.0 { None } else { Some(k as usize) };
        let white =
            cell(row).zip(cell(column)).and_then(|(r, c)| cells.get(r)?.as_bytes().get(c)).is_some_and(|&b| b == b'1');
        if white { 225.0 } else { 25.0 }
    };
    // Elsewhere is the wall.
    let reach = 0.1 * camera.focal[0] / pose.translation[2] * 1.1;
    let corner = pose.transform_point([0.0; 3]);
    let (cx, cy) = {
        let [x, y] = lens.distort([corner[0] / corner[2], corner[1] / corner[2]]);
        (camera.focal[0] * x + camera.principal[0], camera.focal[1] * y + camera.principal[1])
    };
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let mut noise = || {
        // The sum of four is near enough to a Gaussian; standard deviation 2.
        let mut sum = 0.0;
        for _ in 0..4 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            sum += (state >> 8) as f64 / (1u32 << 24) as f64 - 0.5;
        }
        sum * 2.0 * 3f64.sqrt()
    };
    let mut picture = Grid::filled(width, height, 0u8);
    for k in 0..picture.data.len() {
        let (x, y) = ((k % width) as f64, (k / width) as f64);
        let at = |i: usize| (i as f64 + 0.5) / SAMPLES as f64;
        let samples = || (0..SAMPLES * SAMPLES).map(|i| value(x + at(i % SAMPLES), y + at(i / SAMPLES))).sum::<f64>();
        let near = (x - cx).abs() < reach && (y - cy).abs() < reach;
        let mean = if near { samples() / (SAMPLES * SAMPLES) as f64 } else { WALL };
        picture.data[k] = (mean + noise()).round().clamp(0.0, 255.0) as u8;
    }
    picture
}

/// The print's axes in the camera's, first as if hung before it, then turned about x, y and z (degrees), at a place.
pub fn posed([x, y, z]: [f64; 3], translation: [f64; 3]) -> Pose {
    let turn = |axis: usize, degrees: f64| {
        let (s, c) = degrees.to_radians().sin_cos();
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut rotation = Pose::IDENTITY.rotation;
        (rotation[i][i], rotation[i][j], rotation[j][i], rotation[j][j]) = (c, -s, s, c);
        Pose { rotation, translation: [0.0; 3] }
    };
    let hung = turn(0, 180.0);
    let Pose { rotation, .. } = turn(2, z).compose(&turn(1, y)).compose(&turn(0, x)).compose(&hung);
    Pose { rotation, translation }
}
