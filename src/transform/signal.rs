//! The signal that is coded and measured: the square root of radiance over the white board's radiance, both ways.
//!
//! The noise of photographs grows with the square root of their radiance, so equal steps of the signal are about equally
//! visible. Which precision a function works in is part of the format, or of the stated figures.

use glam::Vec4;

/// Returns the signal of a colour, `sqrt(x / white)`; below zero it is `-sqrt(-x / white)` if `signed`, else 0.
#[cfg(feature = "encode")]
pub(crate) fn forward(radiance: [f32; 3], white: [f32; 3], signed: bool) -> [f32; 3] {
    std::array::from_fn(|k| {
        let x = radiance[k] / white[k];
        if x >= 0.0 {
            x.sqrt()
        } else if signed {
            -(-x).sqrt()
        } else {
            0.0
        }
    })
}

/// Returns the radiance of a signal, `s |s| white`, lane by lane; signals below zero become 0 unless `signed`. Bit-exact
/// (`spec/planes.md`).
#[inline(always)]
pub(crate) fn inverse(signal: Vec4, white: Vec4, signed: bool) -> Vec4 {
    let min = Vec4::splat(if signed { f32::NEG_INFINITY } else { 0.0 });
    let signal = Vec4::select(signal.cmpgt(min), signal, Vec4::ZERO);
    signal * signal.abs() * white
}

/// Returns `sqrt(max(x, 0) / white)` in double precision, in which errors are measured.
#[inline]
pub fn measured(radiance: f32, white: f64) -> f64 {
    (radiance as f64 / white).max(0.0).sqrt()
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn signals_come_back_and_only_signed_ones_below_zero() {
        let white = [0.5, 0.8, 1.25];
        let radiance = [0.3, -0.2, 7.0];
        for signed in [false, true] {
            let [r, g, b] = forward(radiance, white, signed);
            let back = inverse(Vec4::new(r, g, b, 0.0), Vec4::new(white[0], white[1], white[2], 0.0), signed);
            assert!((back.x - 0.3).abs() < 1e-6 && (back.z - 7.0).abs() < 1e-5);
            assert!((back.y - if signed { -0.2 } else { 0.0 }).abs() < 1e-6);
            assert!((measured(radiance[0], white[0] as f64) - r as f64).abs() < 1e-6);
        }
    }
}
