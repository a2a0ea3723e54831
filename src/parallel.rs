//! Independent items, on rayon's current pool where the feature is on; the result is in order either way.

/// `(0..count).map(f)`, gathered in order.
pub(crate) fn map<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        (0..count).into_par_iter().map(f).collect()
    }
    #[cfg(not(feature = "parallel"))]
    {
        (0..count).map(f).collect()
    }
}

/// `f(k, a, b)` for the k-th part of `size` items of both lists, which are equally long.
pub(crate) fn rows<A: Send, B: Send>(
    a: &mut [A],
    b: &mut [B],
    size: usize,
    f: impl Fn(usize, &mut [A], &mut [B]) + Sync + Send,
) {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        let parts = a.par_chunks_mut(size.max(1)).zip(b.par_chunks_mut(size.max(1)));
        parts.enumerate().for_each(|(k, (a, b))| f(k, a, b));
    }
    #[cfg(not(feature = "parallel"))]
    {
        let parts = a.chunks_mut(size.max(1)).zip(b.chunks_mut(size.max(1)));
        parts.enumerate().for_each(|(k, (a, b))| f(k, a, b));
    }
}
