//! Orthonormal wavelet transform with Daubechies' filter of two vanishing moments (4 taps), periodic, in one, two and three
//! dimensions. Forward and inverse use only additions and multiplications in a fixed order: the same everywhere.

/// `(1 + s, 3 + s, 3 - s, 1 - s) / (4 sqrt 2)` with `s = sqrt 3`, rounded to 32-bit floating point.
pub(crate) const LOW: [f32; 4] = [0.482_962_9, 0.836_516_3, 0.224_143_86, -0.129_409_52];

/// The shape of a patch's volume: `side x side` samples in each of `views` views, `view_levels` and `log2 side` levels.
///
/// Samples are stored view by view, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct VolumeShape {
    /// Binary logarithm of the side.
    pub side_log2: u8,
    /// Length of the view axis, a multiple of `1 << view_levels`.
    pub views: usize,
    /// Levels of the transform along the views.
    pub view_levels: u8,
}

impl VolumeShape {
    /// Returns the shape for `views` views and `view_levels` levels, the axis padded to a multiple of `1 << levels`.
    pub(crate) fn padded(side_log2: u8, views: usize, view_levels: u8) -> Self {
        VolumeShape { side_log2, views: views.next_multiple_of(1 << view_levels), view_levels }
    }
    /// Samples along a side.
    pub(crate) fn side(&self) -> usize {
        1 << self.side_log2
    }
    /// Samples of one view.
    pub(crate) fn area(&self) -> usize {
        1 << (2 * self.side_log2)
    }
    /// Samples in all.
    pub(crate) fn len(&self) -> usize {
        self.area() * self.views
    }
}

/// Transforms `L` volumes at once in place, their samples interleaved: multi-level along the views, then multi-level in each
/// resulting picture (rows and columns in turn). `scratch` grows as needed.
pub(crate) fn forward<const L: usize>(volume: &mut [[f32; L]], shape: VolumeShape, scratch: &mut Vec<[f32; L]>) {
    scratch.resize(shape.len().max(scratch.len()), [0.0; L]);
    let (side, area) = (shape.side(), shape.area());
    for level in 0..shape.view_levels {
        forward_step(volume, scratch, shape.views >> level, area, area);
    }
    for picture in volume.chunks_exact_mut(area) {
        let mut count = side;
        while count > 1 {
            for row in picture.chunks_exact_mut(side).take(count) {
                forward_step(row, scratch, count, 1, 1);
            }
            forward_step(picture, scratch, count, side, count);
            count /= 2;
        }
    }
}

/// Undoes [`forward`].
pub(crate) fn inverse<const L: usize>(volume: &mut [[f32; L]], shape: VolumeShape, scratch: &mut Vec<[f32; L]>) {
    scratch.resize(shape.len().max(scratch.len()), [0.0; L]);
    let (side, area) = (shape.side(), shape.area());
    for picture in volume.chunks_exact_mut(area) {
        let mut count = 2;
        while count <= side {
            inverse_step(picture, scratch, count, side, count);
            for row in picture.chunks_exact_mut(side).take(count) {
                inverse_step(row, scratch, count, 1, 1);
            }
            count *= 2;
        }
    }
    for level in (0..shape.view_levels).rev() {
        inverse_step(volume, scratch, shape.views >> level, area, area);
    }
}

/// One level along an axis of `count` lines, `stride` apart, `size` samples each; low half first.
#[inline(always)]
fn forward_step<const L: usize>(
    data: &mut [[f32; L]],
    scratch: &mut [[f32; L]],
    count: usize,
    stride: usize,
    size: usize,
) {
    let half = count / 2;
    for k in 0..half {
        let line = |tap: usize| {
            let at = 2 * k + tap;
            // Two lines are shorter than the filter: it goes round twice.
            let at = if at < count { at } else { at % count };
            &data[at * stride..][..size]
        };
        let (a, b, c, d) = (line(0), line(1), line(2), line(3));
        let (low, high) = scratch.split_at_mut(half * size);
        let (low, high) = (&mut low[k * size..][..size], &mut high[k * size..][..size]);
        for i in 0..size {
            (low[i], high[i]) = analyse(&a[i], &b[i], &c[i], &d[i]);
        }
    }
    for k in 0..count {
        data[k * stride..][..size].copy_from_slice(&scratch[k * size..][..size]);
    }
}

#[inline(always)]
fn inverse_step<const L: usize>(
    data: &mut [[f32; L]],
    scratch: &mut [[f32; L]],
    count: usize,
    stride: usize,
    size: usize,
) {
    let half = count / 2;
    for k in 0..half {
        let before = if k == 0 { half - 1 } else { k - 1 };
        let line = |index: usize| &data[index * stride..][..size];
        let (low, high, low_before, high_before) = (line(k), line(half + k), line(before), line(half + before));
        let (even, odd) = scratch[2 * k * size..][..2 * size].split_at_mut(size);
        for i in 0..size {
            (even[i], odd[i]) = synthesise(&low[i], &high[i], &low_before[i], &high_before[i]);
        }
    }
    for k in 0..count {
        data[k * stride..][..size].copy_from_slice(&scratch[k * size..][..size]);
    }
}

/// The low and the high coefficient of four samples.
#[inline(always)]
fn analyse<const L: usize>(a: &[f32; L], b: &[f32; L], c: &[f32; L], d: &[f32; L]) -> ([f32; L], [f32; L]) {
    let (mut low, mut high) = ([0.0; L], [0.0; L]);
    for i in 0..L {
        low[i] = LOW[0] * a[i] + LOW[1] * b[i] + LOW[2] * c[i] + LOW[3] * d[i];
        high[i] = LOW[3] * a[i] - LOW[2] * b[i] + LOW[1] * c[i] - LOW[0] * d[i];
    }
    (low, high)
}

/// The even and the odd sample of a pair from its own low and high coefficient and those of the pair before.
#[inline(always)]
fn synthesise<const L: usize>(
    low: &[f32; L],
    high: &[f32; L],
    low_before: &[f32; L],
    high_before: &[f32; L],
) -> ([f32; L], [f32; L]) {
    let (mut even, mut odd) = ([0.0; L], [0.0; L]);
    for i in 0..L {
        even[i] = LOW[0] * low[i] + LOW[3] * high[i] + LOW[2] * low_before[i] + LOW[1] * high_before[i];
        odd[i] = LOW[1] * low[i] - LOW[2] * high[i] + LOW[3] * low_before[i] - LOW[0] * high_before[i];
    }
    (even, odd)
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
            let before: Vec<[f32; 2]> = noise(shape.len() * 2).chunks(2).map(|c| [c[0], c[1]]).collect();
            let mut volume = before.clone();
            let mut scratch = Vec::new();
            forward(&mut volume, shape, &mut scratch);
            let energy = |v: &[[f32; 2]]| v.iter().flatten().map(|&x| (x as f64).powi(2)).sum::<f64>();
            assert!((energy(&volume) / energy(&before) - 1.0).abs() < 1e-6);
            inverse(&mut volume, shape, &mut scratch);
            let error =
                volume.iter().flatten().zip(before.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(error < 2e-6, "{shape:?} {error}");
        }
    }

    #[test]
    fn constants_and_slopes_end_in_the_low_band() {
        let shape = VolumeShape { side_log2: 0, views: 32, view_levels: 1 };
        let mut slope: Vec<[f32; 1]> = (0..32).map(|i| [3.0 + 0.25 * i as f32]).collect();
        forward(&mut slope, shape, &mut Vec::new());
        // Two vanishing moments: only the pair that wraps around sees the jump.
        assert!(slope[16..31].iter().all(|x| x[0].abs() < 1e-5), "{:?}", &slope[16..]);
        let whole = VolumeShape { side_log2: 3, views: 8, view_levels: 3 };
        let mut constant = vec![[1.0]; whole.len()];
        forward(&mut constant, whole, &mut Vec::new());
        assert!((constant[0][0] - (whole.len() as f32).sqrt()).abs() < 1e-4);
        assert!(constant[1..].iter().all(|x| x[0].abs() < 1e-5));
    }
}
