//! Minimisers: Levenberg-Marquardt for sums of squares, L-BFGS within bounds for other functions.

#[cfg(feature = "encode")]
pub(crate) mod lbfgs;
#[cfg(feature = "encode")]
pub(crate) mod levenberg_marquardt;
