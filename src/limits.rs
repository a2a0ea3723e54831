//! Bounds on what a file may request, and the memory budget that they are charged to.

use crate::error::{Error, Result};
use std::sync::atomic::{AtomicU64, Ordering};

/// Bounds on what decoding may use. Everything a file sizes is charged to them before it is allocated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of memory for everything that the file sizes, together.
    pub memory_bytes: u64,
    /// Views (captured photographs).
    pub views: u32,
    /// Width or height of an image, in pixels.
    pub image_side: u32,
    /// Vertices or triangles of the mesh.
    pub mesh_elements: u32,
}

impl Limits {
    /// No bounds, for trusted input.
    pub const UNLIMITED: Limits =
        Limits { memory_bytes: u64::MAX, views: u32::MAX, image_side: u32::MAX, mesh_elements: u32::MAX };
}

impl Default for Limits {
    fn default() -> Self {
        Limits { memory_bytes: 4 << 30, views: 65_536, image_side: 32_768, mesh_elements: 1 << 26 }
    }
}

/// Remaining memory budget, shared by the threads of one decode.
#[derive(Debug)]
pub struct Budget {
    limits: Limits,
    left: AtomicU64,
}

impl Budget {
    /// Creates a budget of `limits.memory_bytes`.
    pub fn new(limits: Limits) -> Self {
        Budget { limits, left: AtomicU64::new(limits.memory_bytes) }
    }
    /// The limits of this budget.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }
    /// Charges `bytes` for `what`.
    /// # Errors
    /// [`Error::Limits`] if fewer bytes are left.
    pub fn charge(&self, what: &'static str, bytes: u64) -> Result<()> {
        self.left
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(bytes))
            .map(|_| ())
            .map_err(|left| Error::Limits { what, requested: bytes, allowed: left })
    }
    /// Charges `count` items of `size` bytes.
    pub fn charge_items(&self, what: &'static str, count: u64, size: usize) -> Result<()> {
        let bytes = count.saturating_mul(size as u64);
        self.charge(what, bytes)
    }
    /// Charges `bytes` for `what` until the result is dropped.
    pub fn reserve(&self, what: &'static str, bytes: u64) -> Result<Reservation<'_>> {
        self.charge(what, bytes)?;
        Ok(Reservation { budget: self, bytes })
    }
    /// Bytes that are left.
    pub fn left(&self) -> u64 {
        self.left.load(Ordering::Relaxed)
    }
    /// Returns charged bytes to the budget.
    pub fn release(&self, bytes: u64) {
        self.left.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// Memory charged to a [`Budget`] until this is dropped.
#[derive(Debug)]
#[must_use = "the bytes are released when this is dropped"]
pub struct Reservation<'a> {
    budget: &'a Budget,
    bytes: u64,
}

impl Reservation<'_> {
    /// Charges more bytes to this reservation.
    pub fn grow(&mut self, what: &'static str, bytes: u64) -> Result<()> {
        self.budget.charge(what, bytes)?;
        self.bytes += bytes;
        Ok(())
    }
    /// Leaves the bytes charged for good.
    pub fn keep(mut self) {
        self.bytes = 0;
    }
}

impl Drop for Reservation<'_> {
    fn drop(&mut self) {
        self.budget.release(self.bytes);
    }
}

/// Checks a count that the file claims against its limit.
pub(crate) fn check(what: &'static str, requested: u64, allowed: u64) -> Result<()> {
    if requested > allowed { Err(Error::Limits { what, requested, allowed }) } else { Ok(()) }
}
