//! Coding order of the views, and the views that each is predicted from.

use std::collections::HashMap;

/// One view of the coding order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OrderEntry {
    /// Index of the view.
    pub view: usize,
    /// Views it is predicted from, at most two, each with its share out of 255.
    pub references: Vec<(usize, u8)>,
    /// The view whose adaptive state this one starts from.
    pub parent: Option<usize>,
}

impl OrderEntry {
    /// The views that must be decoded before this one.
    pub fn dependencies(&self) -> impl Iterator<Item = usize> + '_ {
        self.references.iter().map(|(view, _)| view).chain(&self.parent).copied()
    }
}

/// Most references of a view. Part of the format.
pub const MAX_REFERENCES: usize = 2;
#[cfg(feature = "encode")]
pub(crate) use planning::coarse_to_fine;

#[cfg(feature = "encode")]
mod planning {
    use crate::predictive::order::OrderEntry;
    use crate::views::View;

    /// Views farther apart than this (radians, light included) do not predict each other.
    const MAX_ANGLE: f64 = 1.1;
    /// Weight of the change of light against the change of view.
    const LIGHT_WEIGHT: f64 = 0.7;

    /// Unit directions from the object's centre to a view's camera and light.
    struct ViewDirections {
        eye: [f64; 3],
        light: Option<[f64; 3]>,
    }

    fn direction(from: [f64; 3], to: [f64; 3]) -> [f64; 3] {
        let d: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().max(f64::MIN_POSITIVE);
        d.map(|v| v / length)
    }

    fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
        (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0).acos()
    }

    impl ViewDirections {
        fn distance(&self, other: &ViewDirections) -> f64 {
            let light = match (self.light, other.light) {
                (Some(a), Some(b)) => angle(a, b),
                _ => 0.0,
            };
            angle(self.eye, other.eye) + LIGHT_WEIGHT * light
        }
    }

    /// Orders the views from coarse to fine: each next one is the farthest from all before it, and is predicted from the
    /// nearest of those and a second one, near and on another side. `centre` is the object's.
    ///
    /// A prefix of the order covers the object evenly, and a view depends on few others.
    pub(crate) fn coarse_to_fine(views: &[View], centre: [f64; 3]) -> Vec<OrderEntry> {
        let places: Vec<ViewDirections> = views
            .iter()
            .map(|view| ViewDirections {
                eye: direction(centre, view.camera.centre()),
                light: view.light.map(|light| direction(centre, light.position)),
            })
            .collect();
        let mut nearest = vec![f64::INFINITY; views.len()];
        let mut order: Vec<OrderEntry> = Vec::with_capacity(views.len());
        for _ in 0..views.len() {
            let coded = |view: usize| nearest[view] == f64::NEG_INFINITY;
            let farthest = (0..views.len()).filter(|&v| !coded(v)).max_by(|&a, &b| {
                // Ties go to the first view; differences below a billionth are ties.
                let key = |v: usize| (nearest[v].min(9.0) * 1e9) as i64;
                key(a).cmp(&key(b)).then(b.cmp(&a))
            });
            let Some(view) = farthest else { break };
            let here = &places[view];
            let mut near: Vec<(usize, f64)> = order
                .iter()
                .map(|s| (s.view, here.distance(&places[s.view])))
                .filter(|&(_, d)| d < MAX_ANGLE)
                .collect();
            near.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            let mut references: Vec<(usize, f64)> = near.iter().take(1).copied().collect();
            if let Some(&(first, _)) = near.first() {
                let side = |other: usize| direction(here.eye, places[other].eye);
                let same_side = |other: usize| {
                    let (a, b) = (side(first), side(other));
                    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
                };
                let score = |&(other, distance): &(usize, f64)| distance * (1.5 + same_side(other));
                references.extend(near[1..].iter().copied().min_by(|a, b| score(a).total_cmp(&score(b))));
            }
            let closeness: f64 = references.iter().map(|&(_, d)| 1.0 / d.max(0.01)).sum();
            order.push(OrderEntry {
                view,
                parent: references.first().map(|r| r.0).or(order.first().map(|s| s.view)),
                references: references
                    .into_iter()
                    .map(|(other, d)| (other, (255.0 / d.max(0.01) / closeness).round() as u8))
                    .collect(),
            });
            nearest[view] = f64::NEG_INFINITY;
            for other in 0..views.len() {
                if nearest[other] != f64::NEG_INFINITY {
                    nearest[other] = nearest[other].min(here.distance(&places[other]));
                }
            }
        }
        order
    }
}

/// Entries that are handed out when what they need is done, depth first: what a done one made possible comes before what waited longer. So
/// few of the done ones are needed at any time; of a ring of views, about two for each halving.
#[derive(Debug)]
pub(crate) struct DepthFirst {
    /// By entry: how many of those that it needs are not done.
    waiting: HashMap<usize, usize>,
    /// By view: the entries that need it.
    dependents: HashMap<usize, Vec<usize>>,
    /// The next one is the last.
    ready: Vec<usize>,
}

impl DepthFirst {
    /// `steps` are indices into `order`, ascending, and hold all that they need ([`closure`]).
    pub(crate) fn new(order: &[OrderEntry], steps: &[usize]) -> Self {
        let (mut waiting, mut dependents) = (HashMap::new(), HashMap::<usize, Vec<usize>>::new());
        for &index in steps {
            let mut count = 0;
            for view in order[index].dependencies() {
                let Some(dependents) = dependents.get_mut(&view) else { continue };
                dependents.push(index);
                count += 1;
            }
            waiting.insert(index, count);
            dependents.insert(order[index].view, Vec::new());
        }
        let ready = steps.iter().rev().copied().filter(|index| waiting[index] == 0).collect();
        DepthFirst { waiting, dependents, ready }
    }

    /// Returns the next entries, as many of the first `most` as `fit` says of them; none if all are done.
    pub(crate) fn take(&mut self, most: usize, fit: impl FnOnce(&[usize]) -> usize) -> Vec<usize> {
        let first: Vec<usize> = self.ready.iter().rev().take(most).copied().collect();
        let count = if first.is_empty() { 0 } else { fit(&first).clamp(1, first.len()) };
        self.ready.truncate(self.ready.len() - count);
        first[..count].to_vec()
    }

    /// Tells that these entries are done.
    pub(crate) fn done(&mut self, order: &[OrderEntry], entries: &[usize]) {
        let mut possible = Vec::new();
        for dependent in entries.iter().filter_map(|&index| self.dependents.get(&order[index].view)).flatten() {
            if let Some(count) = self.waiting.get_mut(dependent) {
                *count -= 1;
                if *count == 0 {
                    possible.push(*dependent);
                }
            }
        }
        possible.sort_unstable_by(|a, b| b.cmp(a));
        self.ready.append(&mut possible);
    }
}

/// Returns the entries that decoding `wanted` views takes, in coding order, as indices into `order`.
pub(crate) fn closure(order: &[OrderEntry], wanted: impl Fn(usize) -> bool) -> Vec<usize> {
    closure_beyond(order, wanted, |_| false)
}

/// Returns the [`closure`] if some views are `known` already.
pub(crate) fn closure_beyond(
    order: &[OrderEntry],
    wanted: impl Fn(usize) -> bool,
    known: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let mut needed = std::collections::HashSet::new();
    let mut steps: Vec<usize> = (0..order.len())
        .rev()
        .filter(|&index| {
            let step = &order[index];
            let take = (wanted(step.view) || needed.contains(&step.view)) && !known(step.view);
            if take {
                needed.extend(step.dependencies());
            }
            take
        })
        .collect();
    steps.reverse();
    steps
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use crate::predictive::order::*;
    use crate::views::{Camera, View};

    fn ring(count: usize) -> Vec<View> {
        (0..count)
            .map(|i| {
                let (sin, cos) = (i as f64 * std::f64::consts::TAU / count as f64).sin_cos();
                // Camera at (4 sin, 0, 4 cos) looking at the origin.
                let rotation = [[cos, 0.0, -sin], [0.0, -1.0, 0.0], [-sin, 0.0, -cos]];
                let camera = Camera { rotation, translation: [0.0, 0.0, 4.0], ..Camera::default() };
                View { name: i.to_string(), camera, light: None }
            })
            .collect()
    }

    #[test]
    fn a_ring_is_halved_again_and_again() {
        let order = coarse_to_fine(&ring(36), [0.0; 3]);
        let mut seen: Vec<usize> = order.iter().map(|s| s.view).collect();
        assert_eq!(seen[..4], [0, 18, 9, 27]);
        seen.sort_unstable();
        assert_eq!(seen, (0..36).collect::<Vec<_>>());
        assert_eq!(order.iter().filter(|s| s.references.is_empty()).count(), 4);
        for step in &order[18..] {
            // The last half lies between its references.
            let sides: Vec<i64> =
                step.references.iter().map(|r| (r.0 as i64 - step.view as i64 + 54) % 36 - 18).collect();
            assert!(sides[0] * sides[1] < 0 && sides.iter().all(|s| s.abs() <= 2), "{step:?}");
        }
        for view in 0..36 {
            assert!(closure(&order, |v| v == view).len() <= 8);
        }
    }

    /// Most views that are held at once, for `views` on a ring of which `side_by_side` are coded at a time.
    fn held(views: usize, side_by_side: usize) -> usize {
        let order = coarse_to_fine(&ring(views), [0.0; 3]);
        let steps: Vec<usize> = (0..views).collect();
        let mut needs = vec![0; views];
        order.iter().flat_map(OrderEntry::dependencies).for_each(|view| needs[view] += 1);
        let mut schedule = DepthFirst::new(&order, &steps);
        let (mut done, mut held, mut most) = (vec![false; views], 0usize, 0);
        loop {
            let entries = schedule.take(side_by_side, <[usize]>::len);
            if entries.is_empty() {
                break;
            }
            for &index in &entries {
                assert!(order[index].dependencies().all(|view| done[view]), "{index} needs what is not done");
                held += usize::from(needs[order[index].view] > 0);
                for view in order[index].dependencies() {
                    needs[view] -= 1;
                    held -= usize::from(needs[view] == 0);
                }
            }
            entries.iter().for_each(|&index| done[order[index].view] = true);
            schedule.done(&order, &entries);
            most = most.max(held);
        }
        assert!(done.iter().all(|&done| done) && held == 0);
        most
    }

    #[test]
    fn few_views_are_held_however_many_there_are() {
        // Twice the views take one more level of halving; wave by wave they would be 16, 32 and 64.
        assert_eq!([36, 72, 144].map(|views| held(views, 1)), [5, 6, 7]);
        assert!(held(144, 4) < 24, "{}", held(144, 4));
    }
}
