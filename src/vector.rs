//! Products of vectors, in the order of operations that the format's texts give: sums from left to right, no fused multiply-add.

/// Returns the scalar product.
#[inline(always)]
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the vector product.
#[inline(always)]
pub(crate) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns the scalar product of the first numbers of both, as many as the shorter one has.
#[cfg(feature = "encode")]
pub(crate) fn dot_slices(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns a vector's direction, 0 for that of no length, and its squared length.
#[inline(always)]
pub(crate) fn unit(v: [f64; 3]) -> ([f64; 3], f64) {
    let squared = dot(v, v);
    let scale = if squared > 0.0 { 1.0 / squared.sqrt() } else { 0.0 };
    (v.map(|x| x * scale), squared)
}

/// Returns the unit vector from one point to another and the squared distance.
#[inline(always)]
pub(crate) fn direction(from: [f64; 3], to: [f64; 3]) -> ([f64; 3], f64) {
    unit(std::array::from_fn(|i| to[i] - from[i]))
}

/// Points that are worked on side by side.
pub(crate) const LANES: usize = 8;
/// A number of each of them.
pub(crate) type DoubleLanes = [f64; LANES];

/// Returns the numbers that `of` gives for each lane.
#[inline(always)]
pub(crate) fn lanes(of: impl FnMut(usize) -> f64) -> DoubleLanes {
    std::array::from_fn(of)
}

/// Returns the scalar products.
#[inline(always)]
pub(crate) fn dot_lanes(a: &[DoubleLanes; 3], b: &[DoubleLanes; 3]) -> DoubleLanes {
    lanes(|i| a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i])
}

/// Returns the vectors from points to a place.
#[inline(always)]
pub(crate) fn towards(points: &[DoubleLanes; 3], place: [f64; 3]) -> [DoubleLanes; 3] {
    [0, 1, 2].map(|k| lanes(|i| place[k] - points[k][i]))
}
