//! Which vertices and triangles surround each vertex.

/// Neighbours of the vertices of a mesh, in rows.
pub(super) struct Rings {
    /// Row of each vertex in `neighbours`.
    start: Vec<u32>,
    /// The vertex itself, then its neighbours by rising index.
    neighbours: Vec<u32>,
    /// For each entry the place of the same pair in the neighbour's row.
    twin: Vec<u32>,
    /// Row of each vertex in `triangles`.
    triangle_start: Vec<u32>,
    triangles: Vec<u32>,
}

impl Rings {
    pub(super) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut triangle_start = vec![0u32; vertices + 1];
        triangles.iter().flatten().for_each(|&v| triangle_start[v as usize + 1] += 1);
        (0..vertices).for_each(|v| triangle_start[v + 1] += triangle_start[v]);
        let mut next = triangle_start.clone();
        let mut around = vec![0u32; 3 * triangles.len()];
        for (index, corners) in triangles.iter().enumerate() {
            for &v in corners {
                around[next[v as usize] as usize] = index as u32;
                next[v as usize] += 1;
            }
        }
        let mut rings = Rings {
            start: vec![0],
            neighbours: Vec::with_capacity(8 * vertices),
            twin: Vec::new(),
            triangle_start,
            triangles: around,
        };
        let mut ring = Vec::new();
        for v in 0..vertices {
            ring.clear();
            ring.extend(rings.triangles_of(v).iter().flat_map(|&t| triangles[t as usize]).filter(|&w| w as usize != v));
            ring.sort_unstable();
            ring.dedup();
            rings.neighbours.push(v as u32);
            rings.neighbours.extend(&ring);
            rings.start.push(rings.neighbours.len() as u32);
        }
        let twin = |v: usize, w: u32| {
            let row = rings.row(w as usize);
            let at = row.start + 1;
            let found = rings.neighbours[at..row.end].binary_search(&(v as u32));
            if w as usize == v { row.start as u32 } else { (at + found.unwrap_or(0)) as u32 }
        };
        rings.twin =
            (0..vertices).flat_map(|v| rings.ring(v).iter().map(move |&w| (v, w))).map(|(v, w)| twin(v, w)).collect();
        rings
    }
    pub(super) fn vertices(&self) -> usize {
        self.start.len() - 1
    }
    /// Entries of all rows.
    pub(super) fn entries(&self) -> usize {
        self.neighbours.len()
    }
    /// The entries of a vertex.
    #[inline]
    pub(super) fn row(&self, vertex: usize) -> std::ops::Range<usize> {
        self.start[vertex] as usize..self.start[vertex + 1] as usize
    }
    /// The vertex and its neighbours.
    #[inline]
    pub(super) fn ring(&self, vertex: usize) -> &[u32] {
        &self.neighbours[self.row(vertex)]
    }
    /// For each of [`Self::ring`] the entry of the same pair in the other's row.
    pub(super) fn twins(&self, vertex: usize) -> &[u32] {
        &self.twin[self.row(vertex)]
    }
    /// Triangles at a vertex.
    pub(super) fn triangles_of(&self, vertex: usize) -> &[u32] {
        &self.triangles[self.triangle_start[vertex] as usize..self.triangle_start[vertex + 1] as usize]
    }
}
