//! Which photograph belongs to which camera, where another order than the given one is more consistent.

use super::consistency::PairConsistency;

/// Among so many orders one agrees by chance to some 0.4. Another one is named where the pairs that it changes are so consistent then, and so
/// much more than as given, in so large a share of them.
const CONVINCING: f64 = 0.45;
const BETTER: f64 = 0.08;
const LESS_APART: f64 = 0.75;
const IMPROVED: f64 = 0.75;
/// Pairs that another order has to change at least.
const MIN_PAIRS: usize = 3;
/// A neighbour is found by consistency of so much.
const FOLLOWED: f64 = 0.15;
/// Pairs from which an order is grown.
const SEEDS: usize = 4;
/// Passes over all exchanges of two photographs.
const MAX_PASSES: usize = 40;

/// An order of the photographs that is more consistent than the given one.
pub(super) struct Reordering {
    /// Views, and the views in whose places their photographs belong.
    pub(super) moved: Vec<[usize; 2]>,
    /// Mean consistency of the pairs that change, as given.
    pub(super) given: f64,
    /// The same in the found order.
    pub(super) found: f64,
}

/// Looks for an order of the photographs in which neighbouring ones agree clearly better. `same_place` tells of two views whether they are one place,
/// whose photographs may be exchanged.
pub(super) fn reordering(
    pairs: &[PairConsistency],
    count: usize,
    same_place: &dyn Fn(usize, usize) -> bool,
) -> Option<Reordering> {
    if pairs.len() < MIN_PAIRS {
        return None;
    }
    let search = Search::new(pairs, count);
    let mut best: Vec<usize> = (0..count).collect();
    search.exchange(&mut best);
    let mut most = search.total(&best);
    for seed in search.seeds() {
        let mut order = search.grow(seed);
        search.exchange(&mut order);
        let total = search.total(&order);
        if total > most {
            (best, most) = (order, total);
        }
    }
    // `best[view]` is the photograph that belongs in the view's place.
    let is_moved: Vec<bool> = (0..count).map(|view| !same_place(view, best[view])).collect();
    let changed: Vec<(f64, f64)> = pairs
        .iter()
        .filter(|pair| pair.views.iter().any(|&view| is_moved[view]))
        .map(|pair| (pair.given(), pair.of(best[pair.views[0]], best[pair.views[1]])))
        .map(|(given, found)| {
            (if given.is_finite() { given } else { 0.0 }, if found.is_finite() { found } else { 0.0 })
        })
        .collect();
    let number = changed.len() as f64;
    let mean = |value: fn(&(f64, f64)) -> f64| changed.iter().map(value).sum::<f64>() / number;
    let improved = changed.iter().filter(|(given, found)| found > given).count() as f64;
    let (given, found) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let convincing = changed.len() >= MIN_PAIRS
        && found >= CONVINCING
        && found >= given + BETTER
        && 1.0 - found <= LESS_APART * (1.0 - given)
        && improved >= IMPROVED * number;
    // What no pair tells of stays unsaid.
    let told = |view: usize| pairs.iter().any(|pair| pair.views.contains(&view));
    let moved = (0..count).filter(|&view| is_moved[view] && told(view)).map(|view| [best[view], view]).collect();
    convincing.then_some(Reordering { moved, given, found })
}

impl Reordering {
    /// Returns what the order has in common, of so many views.
    pub(super) fn pattern(&self, count: usize) -> Option<&'static str> {
        let all =
            |rule: &dyn Fn(usize, usize) -> bool| self.moved.iter().all(|&[photograph, view]| rule(photograph, view));
        let most = 2 * self.moved.len() > count;
        let exchanged = |photograph: usize, view: usize| self.moved.contains(&[view, photograph]);
        if most && all(&|photograph, view| (view + 1) % count == photograph || view + 1 == count) {
            Some("each is that of the camera before it")
        } else if most && all(&|photograph, view| (photograph + 1) % count == view || photograph + 1 == count) {
            Some("each is that of the camera after it")
        } else if most && all(&|photograph, view| photograph + view + 1 == count) {
            Some("they are in reversed order")
        } else if all(&exchanged) {
            Some("two and two exchanged")
        } else {
            None
        }
    }
}

/// An assignment of a pair's photographs, by the pair's index, from which an order is grown.
struct Seed {
    pair: usize,
    photographs: [usize; 2],
}

struct Search<'a> {
    pairs: &'a [PairConsistency],
    count: usize,
    /// Indices of the pairs of each view.
    of_view: Vec<Vec<usize>>,
}

impl<'a> Search<'a> {
    fn new(pairs: &'a [PairConsistency], count: usize) -> Self {
        let mut of_view = vec![Vec::new(); count];
        for (index, pair) in pairs.iter().enumerate() {
            pair.views.iter().for_each(|&view| of_view[view].push(index));
        }
        Search { pairs, count, of_view }
    }

    /// Consistency of a pair, -1 where a photograph does not fit in.
    fn value(&self, pair: usize, photographs: [usize; 2]) -> f64 {
        let value = self.pairs[pair].of(photographs[0], photographs[1]);
        if value.is_finite() { value } else { -1.0 }
    }

    fn in_order(&self, pair: usize, order: &[usize]) -> f64 {
        self.value(pair, self.pairs[pair].views.map(|view| order[view]))
    }

    fn total(&self, order: &[usize]) -> f64 {
        (0..self.pairs.len()).map(|pair| self.in_order(pair, order)).sum()
    }

    /// Exchanges two photographs as long as it makes the order more consistent.
    fn exchange(&self, order: &mut [usize]) {
        let around = |order: &[usize], a: usize, b: usize| -> f64 {
            let of_b = self.of_view[b].iter().filter(|pair| !self.of_view[a].contains(pair));
            self.of_view[a].iter().chain(of_b).map(|&pair| self.in_order(pair, order)).sum()
        };
        for _ in 0..MAX_PASSES {
            let mut changed = false;
            for a in 0..self.count {
                for b in a + 1..self.count {
                    let before = around(order, a, b);
                    order.swap(a, b);
                    if around(order, a, b) > before + 1e-6 {
                        changed = true;
                    } else {
                        order.swap(a, b);
                    }
                }
            }
            if !changed {
                break;
            }
        }
    }

    /// The most consistent photographs of some pairs.
    fn seeds(&self) -> Vec<Seed> {
        let mut best: Vec<(f64, Seed)> = (0..self.pairs.len())
            .filter_map(|pair| {
                let all = (0..self.count).flat_map(|p| (0..self.count).map(move |q| [p, q])).filter(|[p, q]| p != q);
                let (value, photographs) =
                    all.map(|pq| (self.value(pair, pq), pq)).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
                Some((value, Seed { pair, photographs }))
            })
            .collect();
        best.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.pair.cmp(&b.1.pair)));
        best.into_iter().take(SEEDS).map(|(_, seed)| seed).collect()
    }

    /// Assigns one photograph after the other to the neighbours of those that are assigned, the most consistent first.
    fn grow(&self, seed: Seed) -> Vec<usize> {
        let mut order: Vec<Option<usize>> = vec![None; self.count];
        let mut used = vec![false; self.count];
        for (view, photograph) in self.pairs[seed.pair].views.into_iter().zip(seed.photographs) {
            order[view] = Some(photograph);
            used[photograph] = true;
        }
        loop {
            let mut best: Option<(f64, usize, usize)> = None;
            for (index, pair) in self.pairs.iter().enumerate() {
                let [a, b] = pair.views;
                let (view, place): (usize, &dyn Fn(usize) -> [usize; 2]) = match (order[a], order[b]) {
                    (Some(known), None) => (b, &move |photograph| [known, photograph]),
                    (None, Some(known)) => (a, &move |photograph| [photograph, known]),
                    _ => continue,
                };
                for photograph in (0..self.count).filter(|&photograph| !used[photograph]) {
                    let value = self.value(index, place(photograph));
                    if value > best.map_or(FOLLOWED, |best| best.0) {
                        best = Some((value, view, photograph));
                    }
                }
            }
            let Some((_, view, photograph)) = best else { break };
            order[view] = Some(photograph);
            used[photograph] = true;
        }
        // The others stay where they can.
        for view in 0..self.count {
            if order[view].is_none() && !used[view] {
                order[view] = Some(view);
                used[view] = true;
            }
        }
        let mut left = (0..self.count).filter(|&photograph| !used[photograph]);
        order.into_iter().map(|photograph| photograph.or_else(|| left.next()).unwrap_or(0)).collect()
    }
}
