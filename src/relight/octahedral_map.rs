//! The octahedral grid of [`crate::sphere::octahedral`], in single precision and with a border of one texel, so that reading between
//! texels needs no case: renderers read it millions of times an image.

use crate::sphere::octahedral;
use glam::{Vec2, Vec3, Vec3A};

/// Position of a unit direction in the unit square.
#[inline]
pub(super) fn to_square(direction: Vec3) -> Vec2 {
    let d = direction / (direction.x.abs() + direction.y.abs() + direction.z.abs()).max(1e-20);
    let folded = if d.y >= 0.0 {
        Vec2::new(d.x, d.z)
    } else {
        Vec2::new((1.0 - d.z.abs()).copysign(d.x), (1.0 - d.x.abs()).copysign(d.z))
    };
    folded * 0.5 + 0.5
}

/// Unit direction of a position in the unit square.
pub(super) fn to_direction(at: Vec2) -> Vec3 {
    Vec3::from_array(octahedral::direction(2.0 * at.x as f64 - 1.0, 2.0 * at.y as f64 - 1.0).map(|x| x as f32))
}

/// Direction of a texel's centre.
pub(super) fn texel_direction(side: usize, x: usize, y: usize) -> Vec3 {
    to_direction(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / side as f32)
}

/// Values on the octahedral grid, `side + 2` wide and high.
#[derive(Clone)]
pub(super) struct OctahedralMap {
    pub(super) side: usize,
    texels: Vec<Vec3A>,
}

impl OctahedralMap {
    /// From a value for each texel's direction, in parallel by rows; those at the edges are asked for twice.
    pub(super) fn new(side: usize, value: impl Fn(usize, usize) -> Vec3 + Sync + Send) -> Self {
        let pitch = side + 2;
        let mut texels = vec![Vec3A::ZERO; pitch * pitch];
        crate::parallel::for_each_chunk(&mut texels, pitch, |row, texels| {
            let y = row as isize - 1;
            let beyond = |x: isize| {
                let cell = octahedral::wrap(x, y, side);
                value(cell % side, cell / side)
            };
            let inner = (0..side as isize).contains(&y);
            for (texel, x) in texels.iter_mut().zip(-1..) {
                let inside = inner && (0..side as isize).contains(&x);
                *texel = if inside { value(x as usize, row - 1) } else { beyond(x) }.into();
            }
        });
        OctahedralMap { side, texels }
    }

    /// The value of a texel.
    pub(super) fn texel(&self, x: usize, y: usize) -> Vec3 {
        self.texels[(y + 1) * (self.side + 2) + x + 1].into()
    }

    /// Bilinear reading at a position of the unit square.
    #[inline]
    pub(super) fn sample_bilinear(&self, at: Vec2) -> Vec3 {
        let pitch = self.side + 2;
        let p = at * self.side as f32 + 0.5;
        let (x, y) = ((p.x as usize).min(self.side), (p.y as usize).min(self.side));
        let (s, t) = (p.x - x as f32, p.y - y as f32);
        let first = y * pitch + x;
        let (upper, lower) = (&self.texels[first..first + 2], &self.texels[first + pitch..first + pitch + 2]);
        let sum = (upper[0] + (upper[1] - upper[0]) * s) * (1.0 - t) + (lower[0] + (lower[1] - lower[0]) * s) * t;
        sum.into()
    }
}

#[cfg(test)]
mod tests {
    use crate::relight::octahedral_map::*;

    #[test]
    fn the_square_is_the_sphere() {
        for k in 0..500 {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / 500.0;
            let (s, c) = (k as f32 * 2.4).sin_cos();
            let d = Vec3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z);
            assert!((to_direction(to_square(d)) - d).length() < 1e-5);
        }
        // A smooth function is read smoothly over all edges.
        let sphere = OctahedralMap::new(32, |x, y| texel_direction(32, x, y));
        for k in 0..2000 {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / 2000.0;
            let (s, c) = (k as f32 * 2.4).sin_cos();
            let d = Vec3::new(c * (1.0 - z * z).sqrt(), s * (1.0 - z * z).sqrt(), z);
            assert!((sphere.sample_bilinear(to_square(d)) - d).length() < 0.06, "{d}");
        }
    }
}
