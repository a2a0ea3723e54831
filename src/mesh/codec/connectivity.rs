//! Connectivity: regions grow over their border, one symbol a border edge. Specified in `spec/mesh.md`.
//!
//! A *gate* is a directed edge that a triangle still to come may have. The gates of a region's border form closed loops. At a gate
//! `a -> b` the next triangle is `(a, b, w)`, and the symbol codes `w`. Edges that no symbol joins stay apart: their two
//! sides are coded as border. So every list of triangles can be coded, manifold or not.

use crate::entropy::{BitCoder, BitModel, NumberModel};

/// No gate, no half-edge, no vertex.
pub(super) const NONE: u32 = u32::MAX;

/// The third vertex at a gate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GateSymbol {
    /// A vertex that did not come before.
    New,
    /// The vertex before the gate on its loop; the triangle fills the gate before as well.
    Previous,
    /// The vertex after the gate on its loop; the triangle fills the gate after as well.
    Next,
    /// No triangle here.
    Border,
    /// The vertex so many steps before the one of `Previous`, on the same loop.
    Before(u32),
    /// The vertex so many steps after the one of `Next`, on the same loop.
    After(u32),
    /// Any vertex that came before.
    Known(u32),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum GateState {
    Open,
    /// Known to have no triangle.
    Border,
    Filled,
}

#[derive(Debug, Clone, Copy)]
struct Gate {
    from: u32,
    to: u32,
    previous: u32,
    next: u32,
    /// The half-edge on the known side.
    half_edge: u32,
    state: GateState,
}

/// Triangles so far, and the borders around them. Half-edge `3 t + k` goes from corner `k` to corner `k + 1` of triangle `t`.
#[derive(Debug, Default)]
pub(super) struct Growth {
    pub(super) triangles: Vec<[u32; 3]>,
    /// For each half-edge the one on the other side, or [`NONE`].
    pub(super) opposite: Vec<u32>,
    pub(super) vertices: u32,
    gates: Vec<Gate>,
    /// Triangles at each vertex so far.
    degrees: Vec<u32>,
    /// The latest gate that begins at each vertex.
    latest: Vec<u32>,
    /// Gates in the order in which they will be visited.
    queue: std::collections::VecDeque<u32>,
    /// The gate to visit before those in the queue.
    urgent: u32,
}

impl Growth {
    pub(super) fn new() -> Self {
        Growth { urgent: NONE, ..Growth::default() }
    }
    pub(super) fn new_vertex(&mut self) -> u32 {
        self.vertices += 1;
        self.degrees.push(0);
        self.latest.push(NONE);
        self.vertices - 1
    }
    fn triangle(&mut self, corners: [u32; 3]) -> u32 {
        self.triangles.push(corners);
        self.opposite.extend([NONE; 3]);
        for corner in corners {
            self.degrees[corner as usize] += 1;
        }
        self.opposite.len() as u32 - 3
    }
    fn gate(&mut self, from: u32, to: u32, half_edge: u32) -> u32 {
        let index = self.gates.len() as u32;
        self.gates.push(Gate { from, to, previous: index, next: index, half_edge, state: GateState::Open });
        self.latest[from as usize] = index;
        index
    }
    fn link(&mut self, previous: u32, next: u32) {
        self.gates[previous as usize].next = next;
        self.gates[next as usize].previous = previous;
    }
    fn fill(&mut self, gate: u32, half_edge: u32) {
        let gate = &mut self.gates[gate as usize];
        gate.state = GateState::Filled;
        self.opposite[gate.half_edge as usize] = half_edge;
        self.opposite[half_edge as usize] = gate.half_edge;
    }
    /// The first triangle of a region: its vertices are known or were just made.
    pub(super) fn seed(&mut self, corners: [u32; 3]) {
        let half_edge = self.triangle(corners);
        let [a, b, c] = corners;
        let [ba, ac, cb] = [self.gate(b, a, half_edge), self.gate(a, c, half_edge + 2), self.gate(c, b, half_edge + 1)];
        self.link(ba, ac);
        self.link(ac, cb);
        self.link(cb, ba);
        self.queue.extend([ba, ac, cb]);
    }
    /// The next gate to visit.
    pub(super) fn next_gate(&mut self) -> Option<u32> {
        let urgent = std::mem::replace(&mut self.urgent, NONE);
        if urgent != NONE {
            return Some(urgent);
        }
        while let Some(gate) = self.queue.pop_front() {
            if self.gates[gate as usize].state == GateState::Open {
                return Some(gate);
            }
        }
        None
    }
    /// Beginning and end of a gate.
    #[cfg(feature = "encode")]
    pub(super) fn ends(&self, gate: u32) -> (u32, u32) {
        let gate = &self.gates[gate as usize];
        (gate.from, gate.to)
    }
    /// The gate that begins where [`GateSymbol::CodedNeighbours`] or [`GateSymbol::After`] mean.
    fn walk(&self, gate: u32, steps: u32, forward: bool) -> u32 {
        let start = if forward { self.gates[gate as usize].next } else { self.gates[gate as usize].previous };
        (0..steps + forward as u32)
            .fold(start, |at, _| if forward { self.gates[at as usize].next } else { self.gates[at as usize].previous })
    }
    /// The nearest place on the loop where a vertex is.
    #[cfg(feature = "encode")]
    pub(super) fn near(&self, gate: u32, vertex: u32) -> Option<GateSymbol> {
        let is = |steps, forward| self.gates[self.walk(gate, steps, forward) as usize].from == vertex;
        (1..=FARTHEST).find_map(|steps| {
            if is(steps, false) {
                Some(GateSymbol::Before(steps))
            } else {
                is(steps, true).then_some(GateSymbol::After(steps))
            }
        })
    }
    fn open(&self, gate: u32) -> Option<&Gate> {
        Some(&self.gates[gate as usize]).filter(|gate| gate.state == GateState::Open)
    }
    /// The vertex that [`GateSymbol::Previous`] means, where it is allowed.
    pub(super) fn previous_vertex(&self, gate: u32) -> Option<u32> {
        let previous = self.gates[gate as usize].previous;
        self.open(previous).filter(|_| previous != gate).map(|gate| gate.from)
    }
    /// The vertex that [`GateSymbol::Next`] means, where it is allowed.
    pub(super) fn next_vertex(&self, gate: u32) -> Option<u32> {
        let next = self.gates[gate as usize].next;
        self.open(next).filter(|_| next != gate).map(|gate| gate.to)
    }
    /// Applies a symbol. `Previous` and `Next` only where they are allowed.
    pub(super) fn apply(&mut self, gate: u32, symbol: GateSymbol) {
        let Gate { from: a, to: b, previous, next, .. } = self.gates[gate as usize];
        match symbol {
            GateSymbol::Border => self.gates[gate as usize].state = GateState::Border,
            GateSymbol::New => {
                let v = self.new_vertex();
                self.ear(gate, v, NONE);
            }
            GateSymbol::Known(w) => {
                let pass = self.latest[w as usize];
                let pass =
                    if pass != NONE && self.gates[pass as usize].state != GateState::Filled { pass } else { NONE };
                self.ear(gate, w, pass);
            }
            GateSymbol::Before(steps) => {
                let pass = self.walk(gate, steps, false);
                self.ear(gate, self.gates[pass as usize].from, pass);
            }
            GateSymbol::After(steps) => {
                let pass = self.walk(gate, steps, true);
                self.ear(gate, self.gates[pass as usize].from, pass);
            }
            GateSymbol::Previous => {
                let p = self.gates[previous as usize].from;
                let half_edge = self.triangle([a, b, p]);
                self.fill(gate, half_edge);
                self.fill(previous, half_edge + 2);
                let before = self.gates[previous as usize].previous;
                if before == next && self.gates[next as usize].state == GateState::Open {
                    self.fill(next, half_edge + 1);
                } else if before != gate {
                    let rest = self.gate(p, b, half_edge + 1);
                    self.link(before, rest);
                    self.link(rest, next);
                    self.queue.push_back(rest);
                }
            }
            GateSymbol::Next => {
                let n = self.gates[next as usize].to;
                let half_edge = self.triangle([a, b, n]);
                self.fill(gate, half_edge);
                self.fill(next, half_edge + 1);
                let after = self.gates[next as usize].next;
                if after != gate {
                    let rest = self.gate(a, n, half_edge + 2);
                    self.link(previous, rest);
                    self.link(rest, after);
                    self.urgent = rest;
                }
            }
        }
    }
    /// A triangle that fills only the gate; its two other edges open gates. With `pass`, a gate that begins at `w`, the loop is cut
    /// open there: split in two, or joined with another one.
    fn ear(&mut self, gate: u32, w: u32, pass: u32) {
        let Gate { from: a, to: b, previous, next, .. } = self.gates[gate as usize];
        let half_edge = self.triangle([a, b, w]);
        let first = self.gate(a, w, half_edge + 2);
        let second = self.gate(w, b, half_edge + 1);
        // Where the gate was alone on its loop its neighbours are the new gates themselves.
        let (previous, next) =
            (if previous == gate { second } else { previous }, if next == gate { first } else { next });
        self.link(previous, first);
        if pass == NONE || pass == gate {
            self.link(first, second);
        } else {
            let before = self.gates[pass as usize].previous;
            let before = if before == gate { first } else { before };
            self.link(first, pass);
            self.link(before, second);
        }
        self.link(second, next);
        self.fill(gate, half_edge);
        self.urgent = first;
        self.queue.push_back(second);
    }
}

/// Longest distance along a loop that a symbol may code. Part of the format.
pub(super) const FARTHEST: u32 = 8;
/// Contexts of one decision for one kind of loop. Part of the format.
const CONTEXTS: usize = 576;

/// One decision in three contexts; the mean of their probabilities counts.
#[derive(Clone, Copy, Default)]
struct Decision([BitModel; 3]);

/// Adaptive models of the symbols.
pub(super) struct ConnectivityModels {
    new: Vec<Decision>,
    previous: Vec<Decision>,
    next: Vec<Decision>,
    near: BitModel,
    forward: BitModel,
    steps: [NumberModel; 2],
    border: [BitModel; 4],
    known: NumberModel,
    seed_new: [BitModel; 3],
    seed_known: NumberModel,
    /// The last symbol: 0 new, 1 previous, 2 next, 3 any other.
    last: usize,
}

/// Codes a decision: each of its contexts counts its own way.
fn decide<C: BitCoder>(models: &mut [Decision], contexts: [usize; 3], coder: &mut C, bit: bool) -> bool {
    let sum: u32 = (0..3).map(|k| models[contexts[k]].0[k].probability()).sum();
    let bit = coder.bit(sum / 3, bit);
    for (k, context) in contexts.into_iter().enumerate() {
        models[context].0[k].update(bit);
    }
    bit
}

impl ConnectivityModels {
    pub(super) fn new() -> Self {
        let decisions = || vec![Decision::default(); 3 * CONTEXTS];
        ConnectivityModels {
            new: decisions(),
            previous: decisions(),
            next: decisions(),
            near: BitModel::default(),
            forward: BitModel::default(),
            steps: Default::default(),
            border: Default::default(),
            known: NumberModel::default(),
            seed_new: Default::default(),
            seed_known: NumberModel::default(),
            last: 0,
        }
    }

    /// Codes the symbol at a gate. In decoding `symbol` is ignored; `None` if the decoded one is impossible.
    pub(super) fn symbol<C: BitCoder>(
        &mut self,
        coder: &mut C,
        growth: &Growth,
        gate: u32,
        symbol: GateSymbol,
    ) -> Option<GateSymbol> {
        let here = &growth.gates[gate as usize];
        let before = &growth.gates[here.previous as usize];
        let after = &growth.gates[here.next as usize];
        // Triangles at a vertex, 1 and more, as 0 up to `most`.
        let degree = |vertex: u32, most: u32| (growth.degrees[vertex as usize] - 1).min(most) as usize;
        let (a, b, p, n) = (here.from, here.to, before.from, after.to);
        let (a7, b7, p7, n7) = (degree(a, 7), degree(b, 7), degree(p, 7), degree(n, 7));
        let (a4, b4, p4, n4) = (degree(a, 4), degree(b, 4), degree(p, 4), degree(n, 4));
        let (a2, b2, p2, n2) = (degree(a, 2), degree(b, 2), degree(p, 2), degree(n, 2));
        let around = if before.previous == here.next {
            1
        } else if before.previous == after.next {
            2
        } else {
            0
        };
        let last = self.last;
        let of_loop = |contexts: [usize; 3]| contexts.map(|context| around * CONTEXTS + context);

        let contexts = of_loop([((a7 * 8 + b7) * 3 + p2) * 3 + n2, a7 * 5 + p4, (b7 * 5 + n4) * 4 + last]);
        if decide(&mut self.new, contexts, coder, symbol == GateSymbol::New) {
            self.last = 0;
            return Some(GateSymbol::New);
        }
        if growth.previous_vertex(gate).is_some() {
            let contexts = of_loop([((a7 * 8 + p7) * 3 + b2) * 3 + n2, (a7 * 5 + b4) * 4 + last, a7]);
            if decide(&mut self.previous, contexts, coder, symbol == GateSymbol::Previous) {
                self.last = 1;
                return Some(GateSymbol::Previous);
            }
        }
        if growth.next_vertex(gate).is_some() {
            let contexts = of_loop([((b7 * 8 + n7) * 3 + a2) * 3 + p2, (b7 * 5 + a4) * 4 + last, b7]);
            if decide(&mut self.next, contexts, coder, symbol == GateSymbol::Next) {
                self.last = 2;
                return Some(GateSymbol::Next);
            }
        }
        self.last = 3;
        let (near, forward, steps) = match symbol {
            GateSymbol::Before(steps) => (true, false, steps),
            GateSymbol::After(steps) => (true, true, steps),
            _ => (false, false, 1),
        };
        if self.near.code(coder, near) {
            let forward = self.forward.code(coder, forward);
            let steps = self.steps[forward as usize].code(coder, steps - 1) + 1;
            let symbol = if forward { GateSymbol::After(steps) } else { GateSymbol::Before(steps) };
            return Some(symbol).filter(|_| steps <= FARTHEST);
        }
        let context = (before.state == GateState::Border) as usize + 2 * (after.state == GateState::Border) as usize;
        if self.border[context].code(coder, symbol == GateSymbol::Border) {
            return Some(GateSymbol::Border);
        }
        let newest = growth.vertices - 1;
        let back = if let GateSymbol::Known(vertex) = symbol { newest - vertex } else { 0 };
        let back = self.known.code(coder, back);
        newest.checked_sub(back).map(GateSymbol::Known)
    }

    /// Codes one vertex of a region's first triangle: `Ok(None)` for a new one, `Err` if the decoded one is impossible.
    pub(super) fn seed_vertex<C: BitCoder>(
        &mut self,
        coder: &mut C,
        vertices: u32,
        corner: usize,
        vertex: Option<u32>,
    ) -> Result<Option<u32>, ()> {
        if self.seed_new[corner].code(coder, vertex.is_none()) {
            return Ok(None);
        }
        let back = vertex.map_or(0, |vertex| vertices - 1 - vertex);
        let back = self.seed_known.code(coder, back);
        vertices.checked_sub(1).and_then(|newest| newest.checked_sub(back)).map(Some).ok_or(())
    }
}
