use super::*;
use crate::container::Tag;

#[test]
fn bytes_come_back() {
    let coefficients = [0, 1, 2]
        .map(|c: i32| (0..degrees(true).len() as i32).map(|n: i32| (n * 7919 + c * 31) % 200 / (n + 1) - c).collect());
    let header = CompactHeader { reciprocal: true, step: 20, floor: 8, ceiling: 60, gains: [12, 5, 3] };
    let material = CompactMaterial::new(header, coefficients);
    let bytes = material.encode();
    assert!(CompactMaterial::decode(&bytes, Tag::MATERIALS).unwrap() == material);
    for cut in 0..bytes.len() {
        assert!(CompactMaterial::decode(&bytes[..cut], Tag::MATERIALS).is_err(), "cut at {cut}");
    }
    assert!(CompactMaterial::decode(&[bytes.as_slice(), &[7]].concat(), Tag::MATERIALS).is_err());
}
