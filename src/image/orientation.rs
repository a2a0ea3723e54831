//! The orientation in which a stored image is to be shown.

use super::Grid;

/// Orientation of a photograph as EXIF states it (tag 274): the rows and columns of the stored image may change places, and then its sides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ImageOrientation {
    /// Rows become columns.
    pub transposed: bool,
    /// Left and right change sides, after that.
    pub mirrored_x: bool,
    /// Top and bottom change sides.
    pub mirrored_y: bool,
}

impl ImageOrientation {
    /// Of EXIF's number, 1 to 8; `None` for others.
    pub fn from_exif(number: u8) -> Option<Self> {
        let [transposed, mirrored_x, mirrored_y] = match number {
            1 => [false, false, false],
            2 => [false, true, false],
            3 => [false, true, true],
            4 => [false, false, true],
            5 => [true, false, false],
            6 => [true, true, false],
            7 => [true, true, true],
            8 => [true, false, true],
            _ => return None,
        };
        Some(ImageOrientation { transposed, mirrored_x, mirrored_y })
    }

    /// EXIF's number, 1 to 8.
    pub fn to_exif(self) -> u8 {
        let found = (1..=8).find(|&number| ImageOrientation::from_exif(number) == Some(self));
        found.unwrap_or(1)
    }

    /// Returns `true` if the stored image is shown as it is.
    pub fn is_upright(self) -> bool {
        self == ImageOrientation::default()
    }

    /// Width and height of the shown image from those of the stored one, and the other way about.
    pub fn swap_sides<T>(self, [width, height]: [T; 2]) -> [T; 2] {
        if self.transposed { [height, width] } else { [width, height] }
    }

    /// Returns the image as it is to be shown.
    pub fn apply<T: Copy>(self, stored: Grid<T>) -> Grid<T> {
        if self.is_upright() {
            return stored;
        }
        let [width, height] = self.swap_sides([stored.width, stored.height]);
        let value = |x: usize, y: usize| {
            let x = if self.mirrored_x { width - 1 - x } else { x };
            let y = if self.mirrored_y { height - 1 - y } else { y };
            let [x, y] = self.swap_sides([x, y]);
            *stored.value_at(x, y)
        };
        let data = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        Grid { width, height, data }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_eight() {
        // The letter F, three columns and two rows: a b c / d e f.
        let stored = Grid { width: 3, height: 2, data: b"abcdef".to_vec() };
        let shown = [
            (1, 3, b"abcdef"),
            (2, 3, b"cbafed"),
            (3, 3, b"fedcba"),
            (4, 3, b"defabc"),
            (5, 2, b"adbecf"),
            (6, 2, b"daebfc"),
            (7, 2, b"fcebda"),
            (8, 2, b"cfbead"),
        ];
        for (number, width, data) in shown {
            let orientation = ImageOrientation::from_exif(number).unwrap();
            let upright = orientation.apply(stored.clone());
            assert_eq!((upright.width, &upright.data[..], orientation.to_exif()), (width, &data[..], number));
        }
        assert!(ImageOrientation::from_exif(0).is_none() && ImageOrientation::from_exif(9).is_none());
    }
}
