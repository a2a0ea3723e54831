//! Texels that no triangle uses, for the filters of renderers.

use super::{Grid, Mask, RgbImage};

/// Rings of texels that [`RgbImage::fill_outside`] fills around the mask.
const RINGS: usize = 8;

impl RgbImage {
    /// Fills a texture outside `mask` for renderers: from the neighbours, and where that does not reach with the mean colour, so that the
    /// smallest mip levels keep it.
    pub fn fill_outside(&mut self, mask: &Mask) {
        dilate(self, mask, RINGS);
        let used: Vec<[f32; 3]> = self.data.iter().zip(&mask.data).filter(|(_, m)| **m).map(|(x, _)| *x).collect();
        let mean = |c: usize| (used.iter().map(|x| x[c] as f64).sum::<f64>() / used.len().max(1) as f64) as f32;
        let mean = std::array::from_fn(mean);
        // Texels in use may be black; so may what the rings took from them, which then is as good as not reached.
        let unused = self.data.iter_mut().zip(&mask.data).filter(|(x, used)| !**used && x.iter().all(|v| *v == 0.0));
        unused.for_each(|(x, _)| *x = mean);
    }
}

/// Fills texels outside `mask` from their neighbours, `rings` times: for GPU textures, whose filters reach further than bilinear.
fn dilate(image: &mut Grid<[f32; 3]>, mask: &Mask, rings: usize) {
    let (width, height) = (image.width, image.height);
    let mut known = mask.clone();
    for _ in 0..rings {
        let before = known.clone();
        let old = image.clone();
        for y in 0..height {
            for x in 0..width {
                if *before.value_at(x, y) {
                    continue;
                }
                let mut sum = [0f32; 3];
                let mut count = 0f32;
                for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)] {
                    let (Some(nx), Some(ny)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else { continue };
                    if nx < width && ny < height && *before.value_at(nx, ny) {
                        (0..3).for_each(|c| sum[c] += old.value_at(nx, ny)[c]);
                        count += 1.0;
                    }
                }
                if count > 0.0 {
                    *image.value_at_mut(x, y) = sum.map(|s| s / count);
                    *known.value_at_mut(x, y) = true;
                }
            }
        }
    }
}
