//! Adaptive probabilities that a mixer mixes and an average averages.

/// An adaptive probability: 22 bits of probability above 10 bits of count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ProbabilitySlot(u32);

/// `65536 / (n + 1.5)`, rounded down.
const RECIPROCAL: [u32; 256] = {
    let mut table = [0; 256];
    let mut n = 0;
    while n < table.len() {
        table[n] = 2 * 65536 / (2 * n as u32 + 3);
        n += 1;
    }
    table
};

impl ProbabilitySlot {
    /// Slots that have seen nothing. Not inlined: there are many calls, and one is not often.
    #[inline(never)]
    pub(super) fn fresh(count: usize) -> Vec<ProbabilitySlot> {
        vec![ProbabilitySlot(1 << 31); count]
    }
    /// Probability of a 1 in `1 / 2^BITS`, at most 22 bits.
    #[inline(always)]
    pub(super) fn probability<const BITS: u32>(self) -> u32 {
        self.0 >> (32 - BITS)
    }
    /// Learns from a bit: the n-th update moves the slot by `1 / (n + 1.5)`, no slower than for `SLOWEST`.
    #[inline(always)]
    pub(super) fn update<const SLOWEST: u32>(&mut self, bit: bool) {
        let (probability, count) = (self.0 >> 10, self.0 & 1023);
        let target = if bit { (1 << 22) - 1 } else { 0 };
        let step = ((target - probability as i32) as i64 * RECIPROCAL[count as usize & 255] as i64) >> 16;
        self.0 = ((probability as i32 + step as i32) as u32) << 10 | (count + 1).min(SLOWEST);
    }
}
