//! Letters of 3 x 5 pixels for the names on contact sheets.

use tsuya::metrics::DisplayImage;

/// Each letter five rows of three pixels, an octal digit a row.
const LETTERS: [(char, u16); 39] = [
    ('a', 0o25755),
    ('b', 0o65656),
    ('c', 0o34443),
    ('d', 0o65556),
    ('e', 0o74647),
    ('f', 0o74644),
    ('g', 0o34553),
    ('h', 0o55755),
    ('i', 0o72227),
    ('j', 0o11152),
    ('k', 0o55655),
    ('l', 0o44447),
    ('m', 0o57755),
    ('n', 0o65555),
    ('o', 0o25552),
    ('p', 0o65644),
    ('q', 0o25573),
    ('r', 0o65655),
    ('s', 0o34216),
    ('t', 0o72222),
    ('u', 0o55557),
    ('v', 0o55552),
    ('w', 0o55775),
    ('x', 0o55255),
    ('y', 0o55222),
    ('z', 0o71247),
    ('0', 0o75557),
    ('1', 0o26227),
    ('2', 0o71747),
    ('3', 0o71717),
    ('4', 0o55711),
    ('5', 0o74717),
    ('6', 0o74757),
    ('7', 0o71122),
    ('8', 0o75757),
    ('9', 0o75717),
    ('-', 0o00700),
    ('_', 0o00007),
    ('.', 0o00002),
];
const SCALE: usize = 2;
/// Height of a line with its gap.
pub const LINE: usize = 7 * SCALE;

/// Writes a line with its upper left corner at a place; what lies outside the picture is left out.
pub fn write(picture: &mut DisplayImage, left: usize, top: usize, text: &str) {
    for (index, letter) in text.chars().enumerate() {
        let letter = letter.to_ascii_lowercase();
        let Some((_, rows)) = LETTERS.iter().find(|(known, _)| *known == letter) else { continue };
        for k in 0..15 * SCALE * SCALE {
            let (x, y) = (k % (3 * SCALE), k / (3 * SCALE));
            let (column, row) = (left + index * 4 * SCALE + x, top + SCALE + y);
            let set = rows >> (3 * (4 - y / SCALE) + 2 - x / SCALE) & 1 == 1;
            if set && column < picture.width && row < picture.height {
                *picture.value_at_mut(column, row) = [220; 3];
            }
        }
    }
}
