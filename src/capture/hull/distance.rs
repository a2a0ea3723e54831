//! Signed distances of a mask's pixels to its edge.

/// Distances in pixels, above zero where the mask is set; the edge runs half-way between the centres of pixels. A mask without an edge is as far
/// from it as the image is large.
pub(super) fn signed_distances(mask: &[bool], width: usize, height: usize) -> Vec<f32> {
    let mut distances = squared(mask, width, height, false);
    let outside = squared(mask, width, height, true);
    for ((distance, outside), &set) in distances.iter_mut().zip(outside).zip(mask) {
        *distance = if set { distance.sqrt() - 0.5 } else { 0.5 - outside.sqrt() };
    }
    distances
}

/// Squares of the distances to the nearest pixel with this value (Felzenszwalb and Huttenlocher 2012): along columns, then the lower envelope of
/// parabolas along rows.
fn squared(mask: &[bool], width: usize, height: usize, value: bool) -> Vec<f32> {
    let far = (width + height) as f32;
    let mut squares = vec![0.0f32; mask.len()];
    for x in 0..width {
        let mut sweep = |rows: &mut dyn Iterator<Item = usize>, first: bool| {
            let mut nearest = far;
            for y in rows {
                let at = y * width + x;
                nearest = if mask[at] == value { 0.0 } else { (nearest + 1.0).min(far) };
                squares[at] = if first { nearest } else { nearest.min(squares[at]) };
            }
        };
        sweep(&mut (0..height), true);
        sweep(&mut (0..height).rev(), false);
    }
    squares.iter_mut().for_each(|distance| *distance *= *distance);
    // Apexes of the envelope's parabolas, and where each begins.
    let (mut apexes, mut starts) = (vec![0usize; width], vec![0.0f64; width + 1]);
    let mut row = vec![0.0f64; width];
    for line in squares.chunks_exact_mut(width) {
        row.iter_mut().zip(&*line).for_each(|(to, from)| *to = f64::from(*from));
        let mut last = 0;
        (apexes[0], starts[0], starts[1]) = (0, f64::NEG_INFINITY, f64::INFINITY);
        for q in 1..width {
            let meets = |p: usize| {
                let square = |v: usize| (v * v) as f64;
                (row[q] + square(q) - row[p] - square(p)) / (2.0 * (q - p) as f64)
            };
            let mut start = meets(apexes[last]);
            while last > 0 && start <= starts[last] {
                last -= 1;
                start = meets(apexes[last]);
            }
            last += 1;
            (apexes[last], starts[last], starts[last + 1]) = (q, start, f64::INFINITY);
        }
        let mut current = 0;
        for (x, distance) in line.iter_mut().enumerate() {
            while starts[current + 1] < x as f64 {
                current += 1;
            }
            let off = x as f64 - apexes[current] as f64;
            *distance = (off * off + row[apexes[current]]) as f32;
        }
    }
    squares
}
