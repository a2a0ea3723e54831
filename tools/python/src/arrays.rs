//! Images, masks and lists of vectors as NumPy arrays, and back. Arrays that are given out take their memory over from Rust.

use numpy::{
    AllowTypeChange, Element, PyArray1, PyArray2, PyArray3, PyArrayLike2, PyArrayLike3, PyArrayMethods,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tsuya::image::{Grid, Mask, RgbImage};

/// Anything that NumPy takes for an image of colours.
pub type ColourArray<'py> = PyArrayLike3<'py, f32, AllowTypeChange>;
/// Anything that NumPy takes for a mask.
pub type MaskArray<'py> = PyArrayLike2<'py, bool, AllowTypeChange>;
/// Anything that NumPy takes for rows of numbers.
pub type RowArray<'py, T> = PyArrayLike2<'py, T, AllowTypeChange>;

/// An image as (height, width, 3).
pub fn from_image(py: Python<'_>, image: RgbImage) -> PyResult<Bound<'_, PyArray3<f32>>> {
    PyArray1::from_vec(py, image.data.into_flattened()).reshape([image.height, image.width, 3])
}

/// A grid of numbers as (height, width).
pub fn from_grid<T: Element>(py: Python<'_>, grid: Grid<T>) -> PyResult<Bound<'_, PyArray2<T>>> {
    PyArray1::from_vec(py, grid.data).reshape([grid.height, grid.width])
}

/// Vectors as rows.
pub fn from_rows<T: Element, const N: usize>(py: Python<'_>, rows: Vec<[T; N]>) -> PyResult<Bound<'_, PyArray2<T>>> {
    let count = rows.len();
    PyArray1::from_vec(py, rows.into_flattened()).reshape([count, N])
}

/// An image of the shape (height, width, 3).
pub fn to_image(name: &str, array: &ColourArray<'_>) -> PyResult<RgbImage> {
    let &[height, width, channels] = array.shape() else { unreachable!("three dimensions") };
    if channels != 3 {
        return Err(PyValueError::new_err(format!("{name} has the shape (height, width, 3), not {:?}", array.shape())));
    }
    let values = array.as_array();
    let values = values.as_standard_layout();
    let data = values.as_slice().map_or(Vec::new(), |values| values.as_chunks::<3>().0.to_vec());
    Ok(RgbImage { width, height, data })
}

/// A mask of the shape (height, width).
pub fn to_mask(array: &MaskArray<'_>) -> Mask {
    let &[height, width] = array.shape() else { unreachable!("two dimensions") };
    Mask { width, height, data: array.as_array().iter().copied().collect() }
}

/// Rows of `N` numbers.
pub fn to_rows<T: Element + Copy, const N: usize>(name: &str, array: &RowArray<'_, T>) -> PyResult<Vec<[T; N]>> {
    if array.shape()[1] != N {
        return Err(PyValueError::new_err(format!("{name} has the shape (count, {N}), not {:?}", array.shape())));
    }
    let values = array.as_array();
    Ok(values.rows().into_iter().map(|row| std::array::from_fn(|k| row[k])).collect())
}
