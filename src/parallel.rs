//! Independent items, on rayon's current pool where the feature is on; the result is in order either way.
//!
//! Only [`run`] is compiled for rayon, and once. What takes closures is thin, for it is compiled for each of them.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Runs of neighbouring items at most that a list is cut into: enough to keep many threads busy, and few beside the work.
const MAX_RUNS: usize = 512;

/// Calls `work(k)` for each k below `count`.
fn run(count: usize, work: &(dyn Fn(usize) + Sync)) {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        (0..count).into_par_iter().for_each(work);
    }
    #[cfg(not(feature = "parallel"))]
    (0..count).for_each(work);
}

/// Returns what is in a place that one call alone uses.
fn own<T>(place: &Mutex<T>) -> MutexGuard<'_, T> {
    place.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns `(0..count).map(f)`, gathered in order.
pub(crate) fn map<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    let length = count.div_ceil(MAX_RUNS).max(1);
    let runs: Vec<Mutex<Vec<T>>> = (0..count.div_ceil(length)).map(|_| Mutex::new(Vec::new())).collect();
    run(runs.len(), &|k| {
        let start = k * length;
        let items = (start..count.min(start + length)).map(&f).collect();
        *own(&runs[k]) = items;
    });
    let mut all = Vec::with_capacity(count);
    for mut items in runs {
        all.append(items.get_mut().unwrap_or_else(PoisonError::into_inner));
    }
    all
}

/// Returns the number of items that are worked on at the same time.
pub(crate) fn threads() -> usize {
    #[cfg(feature = "parallel")]
    {
        rayon::current_num_threads()
    }
    #[cfg(not(feature = "parallel"))]
    1
}

/// Runs both closures, at the same time if possible; `here` on this thread.
#[cfg(feature = "encode")]
pub(crate) fn join<A, B: Send>(here: impl FnOnce() -> A, elsewhere: impl FnOnce() -> B + Send) -> (A, B) {
    #[cfg(feature = "parallel")]
    {
        let mut result = None;
        let a = rayon::in_place_scope(|scope| {
            scope.spawn(|_| result = Some(elsewhere()));
            here()
        });
        match result {
            Some(b) => (a, b),
            None => unreachable!("the scope ends when all in it have"),
        }
    }
    #[cfg(not(feature = "parallel"))]
    {
        (here(), elsewhere())
    }
}

/// Calls `f(k, part)` for the k-th part of `size` items.
pub(crate) fn for_each_chunk<T: Send>(items: &mut [T], size: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    let parts: Vec<Mutex<&mut [T]>> = items.chunks_mut(size.max(1)).map(Mutex::new).collect();
    run(parts.len(), &|k| f(k, &mut own(&parts[k])));
}

/// Calls `f(k, a, b)` for the k-th part of `size` items of both lists, which are equally long.
pub(crate) fn for_each_chunk_pair<A: Send, B: Send>(
    a: &mut [A],
    b: &mut [B],
    size: usize,
    f: impl Fn(usize, &mut [A], &mut [B]) + Sync + Send,
) {
    let size = size.max(1);
    let parts: Vec<_> = a.chunks_mut(size).zip(b.chunks_mut(size)).map(Mutex::new).collect();
    run(parts.len(), &|k| {
        let (a, b) = &mut *own(&parts[k]);
        f(k, a, b);
    });
}
