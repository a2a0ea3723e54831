//! Bilinear functions on the unit square, and the warp whose density such a function is.
//!
//! A sample `(x, y)` is warped to a place by inverting first the marginal distribution of rows, then the conditional one along the
//! (interpolated) row. Here the other direction is needed only: from the place to the sample, which is a sum.

/// Slices of `rows * columns` values at the corners of equal patches; between two slices, everything is linear.
#[derive(Debug, Clone)]
pub(crate) struct MarginalWarp {
    columns: usize,
    rows: usize,
    values: Vec<f64>,
    /// Integral of each row from its begin to each column; empty unless normalised.
    conditional: Vec<f64>,
    /// Integral of the rows from the first to each row; empty unless normalised.
    marginal: Vec<f64>,
}

impl MarginalWarp {
    /// Checks sizes; with `normalised`, makes the integral of each slice 1.
    pub(crate) fn new(
        mut values: Vec<f64>,
        columns: usize,
        rows: usize,
        slices: usize,
        normalised: bool,
    ) -> std::result::Result<Self, String> {
        if columns < 2 || rows < 2 || slices == 0 {
            return Err(format!("{slices} slices of {rows} x {columns} values, at least 1 of 2 x 2 expected"));
        }
        let slice_values = rows.checked_mul(columns).filter(|&count| count.checked_mul(slices) == Some(values.len()));
        let slice_values =
            slice_values.ok_or_else(|| format!("{} values are not {slices} x {rows} x {columns}", values.len()))?;
        let (mut conditional, mut marginal) = (Vec::new(), Vec::new());
        if normalised {
            let (half_column, half_row) = (0.5 / (columns - 1) as f64, 0.5 / (rows - 1) as f64);
            for slice in values.chunks_exact_mut(slice_values) {
                let (first_row, first_marginal) = (conditional.len(), marginal.len());
                let mut totals: Vec<f64> = Vec::new();
                for row in slice.chunks_exact(columns) {
                    let mut sum = 0.0;
                    conditional.push(0.0);
                    for pair in row.windows(2) {
                        sum += half_column * (pair[0] + pair[1]);
                        conditional.push(sum);
                    }
                    totals.push(sum);
                }
                let mut sum = 0.0;
                marginal.push(0.0);
                for pair in totals.windows(2) {
                    sum += half_row * (pair[0] + pair[1]);
                    marginal.push(sum);
                }
                if sum <= 1e-30 {
                    return Err("a density of nothing but zeros".into());
                }
                let scale = 1.0 / sum;
                let scaled = conditional[first_row..].iter_mut().chain(&mut marginal[first_marginal..]).chain(slice);
                scaled.for_each(|x| *x *= scale);
            }
        }
        Ok(MarginalWarp { columns, rows, values, conditional, marginal })
    }

    /// The largest value.
    pub(crate) fn max_value(&self) -> f64 {
        self.values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }

    /// The value at a place (along columns, along rows), `part` of the way between two slices.
    pub(crate) fn evaluate(&self, place: [f64; 2], slices: [usize; 2], part: f64) -> f64 {
        let patch = self.cell_at(place);
        let [first, second] = slices.map(|slice| {
            let [top, bottom] = self.corners(&patch, slice);
            mix(mix(top[0], top[1], patch.along), mix(bottom[0], bottom[1], patch.along), patch.down)
        });
        mix(first, second, part)
    }

    /// The sample that is warped to a place. Only for normalised functions.
    pub(crate) fn invert(&self, place: [f64; 2], slices: [usize; 2], part: f64) -> [f64; 2] {
        let patch = self.cell_at(place);
        let (mut corners, mut before, mut totals, mut above) = ([[0.0; 2]; 2], [0.0; 2], [0.0; 2], 0.0);
        for (slice, weight) in [(slices[0], 1.0 - part), (slices[1], part)] {
            let found = self.corners(&patch, slice);
            for r in 0..2 {
                let row = (slice * self.rows + patch.row + r) * self.columns;
                let at = |column: usize| self.conditional.get(row + column).copied().unwrap_or(0.0);
                before[r] += weight * at(patch.column);
                totals[r] += weight * at(self.columns - 1);
                (0..2).for_each(|c| corners[r][c] += weight * found[r][c]);
            }
            above += weight * self.marginal.get(slice * self.rows + patch.row).copied().unwrap_or(0.0);
        }
        // Integrals of linear functions to part of a patch.
        let within = |from: f64, to: f64, part: f64| part * (from + 0.5 * part * (to - from));
        let down = above + within(totals[0], totals[1], patch.down) / (self.rows - 1) as f64;
        let [left, right] = [0, 1].map(|c| mix(corners[0][c], corners[1][c], patch.down));
        let total = mix(totals[0], totals[1], patch.down);
        let along =
            mix(before[0], before[1], patch.down) + within(left, right, patch.along) / (self.columns - 1) as f64;
        let along = if total > 0.0 { along / total } else { 0.0 };
        [along.clamp(0.0, 1.0), down.clamp(0.0, 1.0)]
    }

    fn cell_at(&self, place: [f64; 2]) -> WarpCell {
        let split = |x: f64, corners: usize| {
            let x = x.clamp(0.0, 1.0) * (corners - 1) as f64;
            let begin = (x as usize).min(corners - 2);
            (begin, x - begin as f64)
        };
        let ((column, along), (row, down)) = (split(place[0], self.columns), split(place[1], self.rows));
        WarpCell { column, row, along, down }
    }

    fn corners(&self, patch: &WarpCell, slice: usize) -> [[f64; 2]; 2] {
        [0, 1].map(|r| {
            let row = (slice * self.rows + patch.row + r) * self.columns;
            [0, 1].map(|c| self.values.get(row + patch.column + c).copied().unwrap_or(0.0))
        })
    }
}

/// The patch that a place lies in, and where in it.
struct WarpCell {
    column: usize,
    row: usize,
    along: f64,
    down: f64,
}

fn mix(from: f64, to: f64, part: f64) -> f64 {
    from + (to - from) * part
}
