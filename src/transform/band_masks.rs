//! Masks of a level's bands, from the mask of the picture that it divides (normative, `spec/planes.md`).

use crate::image::Mask;

/// Whether a slot of the low and of the high half exists: by the even and the odd pixel that go there, and the even one after these. A pixel
/// without neighbours always goes to the low half.
#[inline(always)]
fn slots(even: bool, odd: bool, next: bool) -> [bool; 2] {
    [even | (odd & !next), odd & (even | next)]
}

/// Masks of the low and the high half of all rows.
fn halves_of_rows(mask: &Mask) -> [Mask; 2] {
    let (width, half) = (mask.width, mask.width.div_ceil(2));
    let mut halves = [(); 2].map(|()| Mask::filled(half, mask.height, false));
    let [low, high] = halves.each_mut().map(|mask| mask.data.chunks_exact_mut(half.max(1)));
    for ((low, high), row) in low.zip(high).zip(mask.data.chunks_exact(width.max(1))) {
        let (pairs, following) = (row.as_chunks::<2>().0, row.get(2..).unwrap_or_default().as_chunks::<2>().0);
        for ((low, high), (&[even, odd], &[next, _])) in low.iter_mut().zip(&mut *high).zip(pairs.iter().zip(following))
        {
            [*low, *high] = slots(even, odd, next);
        }
        let pixel = |x: usize| row.get(x).is_some_and(|&set| set);
        for k in following.len()..half {
            [low[k], high[k]] = slots(pixel(2 * k), pixel(2 * k + 1), pixel(2 * k + 2));
        }
    }
    halves
}

/// Masks of the low and the high half of all columns.
fn halves_of_columns(mask: &Mask) -> [Mask; 2] {
    let (width, half) = (mask.width, mask.height.div_ceil(2));
    let mut halves = [(); 2].map(|()| Mask::filled(width, half, false));
    let [low, high] = halves.each_mut().map(|mask| mask.data.chunks_exact_mut(width.max(1)));
    let outside = vec![false; width];
    for (k, (low, high)) in low.zip(high).enumerate() {
        let row = |y: usize| if y < mask.height { mask.row(y) } else { &outside };
        let pixels = row(2 * k).iter().zip(row(2 * k + 1)).zip(row(2 * k + 2));
        for ((low, high), ((&even, &odd), &next)) in low.iter_mut().zip(high).zip(pixels) {
            [*low, *high] = slots(even, odd, next);
        }
    }
    halves
}

/// Masks of the four quarters and of the halves that lie between.
pub(super) struct LevelMasks {
    /// The halves of rows, low and high.
    pub(super) halves: [Mask; 2],
    pub(super) low: Mask,
    pub(super) horizontal: Mask,
    pub(super) vertical: Mask,
    pub(super) diagonal: Mask,
}

impl LevelMasks {
    pub(super) fn new(mask: &Mask) -> Self {
        let halves = halves_of_rows(mask);
        let [[low, vertical], [horizontal, diagonal]] = halves.each_ref().map(halves_of_columns);
        LevelMasks { halves, low, horizontal, vertical, diagonal }
    }
}

/// The mask of the low band after one level.
pub(crate) fn low_mask(mask: &Mask) -> Mask {
    let [left, _] = halves_of_rows(mask);
    let [low, _] = halves_of_columns(&left);
    low
}
