//! Orthonormal wavelet transform with Daubechies' filter of two vanishing moments (4 taps), periodic, in one, two and three
//! dimensions. Forward and inverse use only additions and multiplications in a fixed order: the same everywhere.

/// `(1 + s, 3 + s, 3 - s, 1 - s) / (4 sqrt 2)` with `s = sqrt 3`, rounded to 32-bit floating point.
pub const LOW: [f32; 4] = [0.482_962_9, 0.836_516_3, 0.224_143_86, -0.129_409_52];

/// The shape of a patch's volume: `side x side` samples in each of `views` views, `view_levels` and `log2 side` levels.
///
/// Samples are stored view by view, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VolumeShape {
    /// Binary logarithm of the side.
    pub side_log2: u8,
    /// Length of the view axis, a multiple of `1 << view_levels`.
    pub views: usize,
    /// Levels of the transform along the views.
    pub view_levels: u8,
}

impl VolumeShape {
    /// The shape for so many views: as many levels as asked, the axis padded to a multiple of `1 << levels`.
    pub fn padded(side_log2: u8, views: usize, view_levels: u8) -> Self {
        VolumeShape { side_log2, views: views.next_multiple_of(1 << view_levels), view_levels }
    }
    /// Samples along a side.
    pub fn side(&self) -> usize {
        1 << self.side_log2
    }
    /// Samples of one view.
    pub fn area(&self) -> usize {
        1 << (2 * self.side_log2)
    }
    /// Samples in all.
    pub fn len(&self) -> usize {
        self.area() * self.views
    }
    /// True without any sample.
    pub fn is_empty(&self) -> bool {
        self.views == 0
    }
}

/// Transforms a volume in place: multi-level along the views, then multi-level in each resulting picture (columns and rows
/// in turn). `scratch` grows as needed.
pub fn forward(volume: &mut [f32], shape: VolumeShape, scratch: &mut Vec<f32>) {
    scratch.resize(shape.len(), 0.0);
    let area = shape.area();
    let mut views = shape.views;
    for _ in 0..shape.view_levels {
        forward_step(volume, scratch, views, area);
        views /= 2;
    }
    for picture in volume.chunks_exact_mut(area) {
        let mut side = shape.side();
        while side > 1 {
            for row in 0..side {
                let row = &mut picture[row * shape.side()..][..side];
                forward_row(row, scratch);
            }
            forward_rows(picture, scratch, side, shape.side());
            side /= 2;
        }
    }
}

/// Undoes [`forward`].
pub fn inverse(volume: &mut [f32], shape: VolumeShape, scratch: &mut Vec<f32>) {
    scratch.resize(shape.len(), 0.0);
    let area = shape.area();
    for picture in volume.chunks_exact_mut(area) {
        let mut side = 2;
        while side <= shape.side() {
            inverse_rows(picture, scratch, side, shape.side());
            for row in 0..side {
                let row = &mut picture[row * shape.side()..][..side];
                inverse_row(row, scratch);
            }
            side *= 2;
        }
    }
    for level in (0..shape.view_levels).rev() {
        inverse_step(volume, scratch, shape.views >> level, area);
    }
}

/// One level along the slowest axis: `count` slices of `size` values; low half first.
fn forward_step(data: &mut [f32], scratch: &mut [f32], count: usize, size: usize) {
    let half = count / 2;
    for k in 0..half {
        let taps: [&[f32]; 4] = std::array::from_fn(|t| &data[(2 * k + t) % count * size..][..size]);
        let (low, high) = scratch.split_at_mut(half * size);
        let (low, high) = (&mut low[k * size..][..size], &mut high[k * size..][..size]);
        for i in 0..size {
            let x = [taps[0][i], taps[1][i], taps[2][i], taps[3][i]];
            low[i] = analyse_low(x);
            high[i] = analyse_high(x);
        }
    }
    data[..count * size].copy_from_slice(&scratch[..count * size]);
}

fn inverse_step(data: &mut [f32], scratch: &mut [f32], count: usize, size: usize) {
    let half = count / 2;
    for k in 0..half {
        let before = (k + half - 1) % half;
        let slice = |index: usize| &data[index * size..][..size];
        let (low, high) = (slice(k), slice(half + k));
        let (low_before, high_before) = (slice(before), slice(half + before));
        let (even, odd) = scratch[2 * k * size..][..2 * size].split_at_mut(size);
        for i in 0..size {
            [even[i], odd[i]] = synthesise([low[i], high[i], low_before[i], high_before[i]]);
        }
    }
    data[..count * size].copy_from_slice(&scratch[..count * size]);
}

fn forward_row(row: &mut [f32], scratch: &mut [f32]) {
    let (count, half) = (row.len(), row.len() / 2);
    for k in 0..half {
        let x: [f32; 4] = std::array::from_fn(|t| row[(2 * k + t) % count]);
        scratch[k] = analyse_low(x);
        scratch[half + k] = analyse_high(x);
    }
    row.copy_from_slice(&scratch[..count]);
}

fn inverse_row(row: &mut [f32], scratch: &mut [f32]) {
    let (count, half) = (row.len(), row.len() / 2);
    for k in 0..half {
        let before = (k + half - 1) % half;
        [scratch[2 * k], scratch[2 * k + 1]] = synthesise([row[k], row[half + k], row[before], row[half + before]]);
    }
    row.copy_from_slice(&scratch[..count]);
}

/// One level down the columns of the top left `side x side` corner of a picture.
fn forward_rows(picture: &mut [f32], scratch: &mut [f32], side: usize, stride: usize) {
    let half = side / 2;
    for k in 0..half {
        for i in 0..side {
            let x: [f32; 4] = std::array::from_fn(|t| picture[(2 * k + t) % side * stride + i]);
            scratch[k * side + i] = analyse_low(x);
            scratch[(half + k) * side + i] = analyse_high(x);
        }
    }
    for (row, from) in scratch[..side * side].chunks_exact(side).enumerate() {
        picture[row * stride..][..side].copy_from_slice(from);
    }
}

fn inverse_rows(picture: &mut [f32], scratch: &mut [f32], side: usize, stride: usize) {
    let half = side / 2;
    for k in 0..half {
        let before = (k + half - 1) % half;
        for i in 0..side {
            let at = |row: usize| picture[row * stride + i];
            [scratch[2 * k * side + i], scratch[(2 * k + 1) * side + i]] =
                synthesise([at(k), at(half + k), at(before), at(half + before)]);
        }
    }
    for (row, from) in scratch[..side * side].chunks_exact(side).enumerate() {
        picture[row * stride..][..side].copy_from_slice(from);
    }
}

#[inline(always)]
fn analyse_low(x: [f32; 4]) -> f32 {
    LOW[0] * x[0] + LOW[1] * x[1] + LOW[2] * x[2] + LOW[3] * x[3]
}

#[inline(always)]
fn analyse_high(x: [f32; 4]) -> f32 {
    LOW[3] * x[0] - LOW[2] * x[1] + LOW[1] * x[2] - LOW[0] * x[3]
}

/// The even and the odd sample of a pair from its own low and high coefficient and those of the pair before.
#[inline(always)]
fn synthesise([low, high, low_before, high_before]: [f32; 4]) -> [f32; 2] {
    [
        LOW[0] * low + LOW[3] * high + LOW[2] * low_before + LOW[1] * high_before,
        LOW[1] * low - LOW[2] * high + LOW[3] * low_before - LOW[0] * high_before,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize) -> Vec<f32> {
        let mut state = 1u32;
        (0..n)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 8) as f32 / (1 << 24) as f32 - 0.5
            })
            .collect()
    }

    #[test]
    fn volumes_come_back_and_keep_their_energy() {
        for shape in [
            VolumeShape::padded(0, 1, 0),
            VolumeShape::padded(3, 1, 0),
            VolumeShape::padded(1, 36, 2),
            VolumeShape::padded(2, 36, 3),
            VolumeShape::padded(3, 36, 3),
            VolumeShape::padded(4, 2, 1),
        ] {
            let before = noise(shape.len());
            let mut volume = before.clone();
            let mut scratch = Vec::new();
            forward(&mut volume, shape, &mut scratch);
            let energy = |v: &[f32]| v.iter().map(|&x| (x as f64).powi(2)).sum::<f64>();
            assert!((energy(&volume) / energy(&before) - 1.0).abs() < 1e-6);
            inverse(&mut volume, shape, &mut scratch);
            let error = volume.iter().zip(&before).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(error < 2e-6, "{shape:?} {error}");
        }
    }

    #[test]
    fn constants_and_slopes_end_in_the_low_band() {
        let shape = VolumeShape { side_log2: 0, views: 32, view_levels: 1 };
        let mut slope: Vec<f32> = (0..32).map(|i| 3.0 + 0.25 * i as f32).collect();
        forward(&mut slope, shape, &mut Vec::new());
        // Two vanishing moments: only the pair that wraps around sees the jump.
        assert!(slope[16..31].iter().all(|x| x.abs() < 1e-5), "{:?}", &slope[16..]);
        let whole = VolumeShape { side_log2: 3, views: 8, view_levels: 3 };
        let mut constant = vec![1.0; whole.len()];
        forward(&mut constant, whole, &mut Vec::new());
        assert!((constant[0] - (whole.len() as f32).sqrt()).abs() < 1e-4);
        assert!(constant[1..].iter().all(|x| x.abs() < 1e-5));
    }
}
