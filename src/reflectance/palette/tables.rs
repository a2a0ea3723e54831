//! Palettes as tables, for light from all around, which evaluates a function millions of times.

use super::{PaletteEntry, VALUE_LIMIT, mix};
use std::f64::consts::FRAC_PI_2;

/// Places over the half angle, growing with its square.
const HALF: usize = 512;
/// Places over the difference angle.
const DIFFERENCE: usize = 33;

/// Values of each entry over half and difference angle; between them they are interpolated.
#[derive(Debug)]
pub(crate) struct PaletteTables {
    palette: Vec<PaletteEntry>,
    /// By entry, then difference, then half angle, slowest to fastest.
    values: Vec<[f32; 3]>,
}

impl PaletteTables {
    pub(crate) fn new(palette: &[PaletteEntry]) -> Self {
        let part = |k: usize, of: usize| k as f64 / (of - 1) as f64;
        let rows = crate::parallel::map(palette.len() * DIFFERENCE, |row| {
            let entry = &palette[row / DIFFERENCE].lobes;
            let difference = part(row % DIFFERENCE, DIFFERENCE) * FRAC_PI_2;
            let value = |half: usize| entry.value_at(part(half, HALF).powi(2) * FRAC_PI_2, difference);
            (0..HALF).map(|half| value(half).map(|f| f.min(VALUE_LIMIT) as f32)).collect::<Vec<_>>()
        });
        PaletteTables { palette: palette.to_vec(), values: rows.into_iter().flatten().collect() }
    }

    /// [`super::shape`], within a hundredth of its greatest value.
    pub(crate) fn shape(&self, sigma: f32, alpha: f64, difference: f64) -> [f64; 3] {
        let place = |t: f64, of: usize| {
            let t = t.clamp(0.0, 1.0) * (of - 1) as f64;
            let first = (t as usize).min(of - 2);
            (first, t - first as f64)
        };
        let (row, down) = place(difference / FRAC_PI_2, DIFFERENCE);
        mix(&self.palette, sigma, alpha, |entry, theta_h| {
            let (column, right) = place((theta_h / FRAC_PI_2).sqrt(), HALF);
            let first = (entry * DIFFERENCE + row) * HALF + column;
            let at = |k: usize, c: usize| self.values[k][c] as f64;
            std::array::from_fn(|c| {
                let upper = at(first, c) + right * (at(first + 1, c) - at(first, c));
                let lower = at(first + HALF, c) + right * (at(first + HALF + 1, c) - at(first + HALF, c));
                upper + down * (lower - upper)
            })
        })
    }
}
