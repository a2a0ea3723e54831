//! Minimisers: Levenberg-Marquardt for sums of squares, L-BFGS within bounds for other functions, conjugate gradients for large linear
//! systems, coordinate descent for small ones without negative unknowns.

#[cfg(feature = "encode")]
pub(crate) mod conjugate_gradient;
#[cfg(feature = "encode")]
pub(crate) mod lbfgs;
#[cfg(feature = "encode")]
pub(crate) mod levenberg_marquardt;
#[cfg(feature = "encode")]
pub(crate) mod nonnegative;
