//! Arrays that are handed out as bytes.

/// An array of one kind of numbers.
pub enum Output {
    Text(String),
    Bytes(Vec<u8>),
    Floats(Vec<f32>),
    Halves(Vec<u16>),
    Colours(Vec<[f32; 3]>),
    Pixels(Vec<[f32; 4]>),
    Coordinates(Vec<[f32; 2]>),
    Integers(Vec<u32>),
    Triangles(Vec<[u32; 3]>),
    Weights(Vec<i8>),
}

impl Output {
    pub fn bytes(&self) -> &[u8] {
        match self {
            Output::Text(text) => text.as_bytes(),
            Output::Bytes(data) => data,
            Output::Floats(data) => bytemuck::cast_slice(data),
            Output::Halves(data) => bytemuck::cast_slice(data),
            Output::Colours(data) => bytemuck::cast_slice(data),
            Output::Pixels(data) => bytemuck::cast_slice(data),
            Output::Coordinates(data) => bytemuck::cast_slice(data),
            Output::Integers(data) => bytemuck::cast_slice(data),
            Output::Triangles(data) => bytemuck::cast_slice(data),
            Output::Weights(data) => bytemuck::cast_slice(data),
        }
    }
}

/// The nearest half floats; beyond their range the largest one, so that no texture holds an infinity. Without a branch, so that some are
/// worked on side by side: the crate `half` does it in software here, and several times slower.
pub fn to_halves(values: &[[f32; 4]], halves: &mut [[u16; 4]]) {
    const MAX_HALF: f32 = 65504.0;
    /// The exponent field of 2^-14, below which halves have fewer digits.
    const MIN_EXPONENT: u32 = 113 << 23;
    for (value, half) in values.as_flattened().iter().zip(halves.as_flattened_mut()) {
        let sign = value.to_bits() >> 16 & 0x8000;
        let magnitude = if value.abs() < MAX_HALF { value.abs() } else { MAX_HALF };
        let exponent = (magnitude.to_bits() & 0xff << 23).max(MIN_EXPONENT);
        // Adding 2^13 times the power of two below makes the sum round to the ten digits of a half, which are its lowest then.
        let digits = (magnitude + f32::from_bits(exponent + (13 << 23))).to_bits() & 0xfff;
        *half = (sign | (((exponent - MIN_EXPONENT) >> 13) + digits)) as u16;
    }
}
