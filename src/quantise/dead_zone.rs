//! Uniform quantiser with a dead zone of its own width: what is kept, and how finely.

/// Magnitudes below `threshold` become 0; above it the levels 1, 2, ... are `step` wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DeadZone {
    /// Smallest magnitude that is kept.
    pub threshold: f32,
    /// Width of a level.
    pub step: f32,
}

/// Largest level that a file may hold.
pub(crate) const MAX_INDEX: i32 = 1 << 24;

impl DeadZone {
    /// Level of a value, with its sign.
    pub(crate) fn quantise(&self, value: f32) -> i32 {
        let over = value.abs() - self.threshold;
        // A value that is not a number is not kept.
        if over.is_nan() || over < 0.0 || value == 0.0 {
            return 0;
        }
        let level = 1 + ((over / self.step) as i32).min(MAX_INDEX - 1);
        if value < 0.0 { -level } else { level }
    }
    /// The middle of a level.
    pub(crate) fn dequantise(&self, level: i32) -> f32 {
        if level == 0 {
            return 0.0;
        }
        let magnitude = self.threshold + (level.unsigned_abs() as f32 - 0.5) * self.step;
        if level < 0 { -magnitude } else { magnitude }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_off_by_half_a_step_at_most() {
        let quantiser = DeadZone { threshold: 0.75, step: 0.25 };
        for i in -4000..4000 {
            let value = i as f32 * 0.001;
            let level = quantiser.quantise(value);
            assert_eq!(level == 0, value.abs() < 0.75, "{value}");
            if level != 0 {
                assert!((quantiser.dequantise(level) - value).abs() <= 0.1251, "{value}");
            }
        }
        assert_eq!(quantiser.quantise(f32::NAN), 0);
        assert_eq!(quantiser.quantise(f32::INFINITY), MAX_INDEX);
    }
}
