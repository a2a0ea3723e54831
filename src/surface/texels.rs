//! Texels fitted to photographs.
