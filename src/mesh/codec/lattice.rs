//! Positions on the lattice of the quantised mesh.

/// Lattice positions.
pub(super) type Lattice = [i32; 3];
