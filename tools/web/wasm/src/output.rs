//! Arrays that are handed out as bytes.

use half::f16;

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

/// The nearest half float; beyond its range the largest one, so that no texture holds an infinity.
pub fn half(value: f32) -> u16 {
    let largest = f16::MAX.to_f32_const();
    f16::from_f32(value.clamp(-largest, largest)).to_bits()
}
