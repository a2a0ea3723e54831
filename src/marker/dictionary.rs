//! OpenCV's predefined ArUco dictionaries (Garrido-Jurado et al. 2014, Pattern Recognition 47): 1000 codes each of 4 x 4 to 7 x 7 bits, of which the
//! smaller dictionaries are the first 50, 100 and 250.

/// The codes of 4 x 4, 5 x 5, 6 x 6 and 7 x 7 bits, one after the other: the bits of a code by rows from the upper left, 1 for white, first bits in
/// the high bits of a byte, without gaps. The values are those of `DICT_4X4_1000` to `DICT_7X7_1000` of OpenCV 4.
const CODES: &[u8] = include_bytes!("opencv_dictionaries.bin");
/// Codes of each size.
const COUNT: usize = 1000;

/// One of OpenCV's dictionaries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ArucoDictionary {
    side: u8,
    count: u16,
}

impl ArucoDictionary {
    pub(super) const fn new(side: u8, count: u16) -> Self {
        ArucoDictionary { side, count }
    }

    /// Bits along a side.
    pub fn side(self) -> usize {
        self.side.into()
    }

    /// Returns the codes, by number.
    pub(super) fn codes(self) -> Vec<u64> {
        let bits = |side: usize| side * side;
        // Each size begins at a whole byte.
        let start: usize = (4..self.side()).map(|side| bits(side) * COUNT / 8).sum();
        let bit = |at: usize| u64::from(CODES[start + at / 8] >> (7 - at % 8) & 1);
        let length = bits(self.side());
        let code = |number: usize| (0..length).fold(0, |code, k| code << 1 | bit(number * length + k));
        (0..usize::from(self.count)).map(code).collect()
    }

    /// Bits of a code that may be read wrongly: as many as OpenCV's detector corrects by default, 0.6 of what the least distance between codes allows.
    pub(super) fn corrected_bits(self) -> u32 {
        match (self.side, self.count) {
            (4, _) => 0,
            (5, _) => 1,
            (6, ..=250) => 3,
            (6, _) => 2,
            (_, ..=50) => 5,
            (_, ..=250) => 4,
            _ => 3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_opencvs() {
        // Rows of number 5 of each size, as OpenCV draws them.
        let fives: [(u8, &[u64]); 4] = [
            (4, &[0b0111, 0b1001, 0b1100, 0b1101]),
            (5, &[0b11101, 0b01000, 0b00010, 0b00001, 0b01101]),
            (6, &[0b110110, 0b001110, 0b100011, 0b100000, 0b111001, 0b101000]),
            (7, &[0b0101100, 0b0100000, 0b0000010, 0b1000010, 0b0011010, 0b1100111, 0b1011100]),
        ];
        for (side, rows) in &fives {
            let expected = rows.iter().fold(0, |code, row| code << side | row);
            assert_eq!(ArucoDictionary::new(*side, 50).codes()[5], expected, "{side}");
        }
        // Least distances between codes, turned ones too, as OpenCV has them: 4, 8, 13 and 19 of 50 codes.
        for (side, least) in [(4u8, 4), (5, 8), (6, 13), (7, 19)] {
            let dictionary = ArucoDictionary::new(side, 50);
            let codes = dictionary.codes();
            let turned = |code: u64| {
                let n = usize::from(side);
                let bit = |row: usize, column: usize| code >> (n * n - 1 - row * n - column) & 1;
                (0..n * n).fold(0, |code, k| code << 1 | bit(k % n, n - 1 - k / n))
            };
            let mut found = u32::MAX;
            for (i, &a) in codes.iter().enumerate() {
                let mut b = a;
                for _ in 0..3 {
                    b = turned(b);
                    found = found.min((a ^ b).count_ones());
                }
                for &c in &codes[i + 1..] {
                    let mut c = c;
                    for _ in 0..4 {
                        found = found.min((a ^ c).count_ones());
                        c = turned(c);
                    }
                }
            }
            assert_eq!(found, least, "{side}");
            assert!(2 * dictionary.corrected_bits() < least);
        }
    }
}
