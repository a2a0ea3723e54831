//! Elementary functions of `+ - *` in a written order: a machine's own library of functions rounds as it likes, decoded values must not
//! depend on it. Normative, `spec/README.md` section 6.

/// `1 / n` for `n` = 0 .. 12; entry 0 is not used.
const RECIPROCALS: [f64; 13] = {
    let mut table = [0.0; 13];
    let mut n = 1;
    while n < 13 {
        table[n] = 1.0 / n as f64;
        n += 1;
    }
    table
};

/// Quotients of successive terms of [`squared_angle`]'s series, `n^2 / ((n + 1) (2 n + 1))`; entry 0 is not used.
const QUOTIENTS: [f64; 25] = {
    let mut table = [0.0; 25];
    let mut n = 1;
    while n < 25 {
        table[n] = (n * n) as f64 / ((n + 1) * (2 * n + 1)) as f64;
        n += 1;
    }
    table
};

/// `e^x`, right to a relative 2e-14; 0 below -87, that of 87 above.
pub(crate) fn exp(x: f64) -> f64 {
    if x.is_nan() || x < -87.0 {
        return 0.0;
    }
    let x = if x > 87.0 { 87.0 } else { x };
    let power = (x * std::f64::consts::LOG2_E + 0.5).floor();
    let rest = x - power * std::f64::consts::LN_2;
    let mut sum = 1.0;
    for n in (1..13).rev() {
        sum = 1.0 + rest * sum * RECIPROCALS[n];
    }
    // Exact: the power lies between -126 and 126.
    sum * f64::from_bits(((power as i64 + 1023) as u64) << 52)
}

/// The square of the angle whose cosine is given, `2 y (1 + y/6 (1 + 4 y/15 (1 + ...)))` of `y = 1 - cosine`: right to 1e-9 of it for
/// cosines in `0..=1`, to which others are limited.
pub(crate) fn squared_angle(cosine: f64) -> f64 {
    let y = 1.0 - cosine;
    let y = if y > 0.0 { y } else { 0.0 };
    let y = if y < 1.0 { y } else { 1.0 };
    let mut sum = 1.0;
    for n in (1..25).rev() {
        sum = 1.0 + y * sum * QUOTIENTS[n];
    }
    2.0 * y * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_near_the_library_s() {
        let mut worst = 0.0f64;
        for i in -870_000..=870_000 {
            let x = i as f64 * 1e-4;
            worst = worst.max((exp(x) / x.exp() - 1.0).abs());
        }
        assert!(worst < 2e-14, "{worst:e}");
        assert_eq!(exp(0.0).to_bits(), 1f64.to_bits());
        assert_eq!(exp(1.0).to_bits(), 0x4005_bf0a_8b14_576a);
        for (x, value) in [(f64::NAN, 0.0), (-87.1, 0.0), (f64::NEG_INFINITY, 0.0), (f64::INFINITY, exp(87.0))] {
            assert_eq!(exp(x).to_bits(), value.to_bits(), "{x}");
        }
    }

    #[test]
    fn squared_angles_are_near_the_library_s() {
        let mut worst = 0.0f64;
        // Near 0 the library's arc cosine of a rounded cosine says nothing: sines of half the angle do.
        for i in 1..=1_000_000 {
            let angle = i as f64 * 1e-6 * std::f64::consts::FRAC_PI_2;
            let cosine = 1.0 - 2.0 * (0.5 * angle).sin().powi(2);
            let right = 4.0 * (0.5 * (1.0 - cosine)).sqrt().asin().powi(2);
            worst = worst.max((squared_angle(cosine) / right - 1.0).abs());
        }
        assert!(worst < 1e-9, "{worst:e}");
        assert_eq!([1.0, 1.5, f64::NAN].map(squared_angle), [0.0; 3]);
        assert_eq!(squared_angle(-1.0), squared_angle(0.0));
    }
}
