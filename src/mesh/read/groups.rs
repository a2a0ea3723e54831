//! Groups of a mesh's triangles by the names of their materials.

use std::collections::{HashMap, HashSet};

/// Name of the group of triangles without a material, where others have one.
const UNNAMED: &str = "default";

/// Names of a glTF document's materials, each different from those before it: the number is added to a name that is taken, and stands for one that is
/// missing. Groups of triangles are called so.
pub(crate) fn material_names<'a>(stated: impl Iterator<Item = Option<&'a str>>) -> Vec<String> {
    let mut taken = HashSet::new();
    let distinct = |(number, stated): (usize, Option<&str>)| {
        let mut name = match stated.filter(|name| !name.is_empty()) {
            Some(name) => name.to_owned(),
            None => format!("material {number}"),
        };
        while !taken.insert(name.clone()) {
            name = format!("{name} ({number})");
        }
        name
    };
    stated.enumerate().map(distinct).collect()
}

/// Groups of triangles, each of one material's name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeshGroups {
    /// Names, each once, in the order in which triangles take them; none of a mesh without materials.
    pub names: Vec<String>,
    /// For each triangle the place of its group's name; empty for a mesh without materials.
    pub of_triangle: Vec<u32>,
}

/// Runs of triangles of one group, as files have them.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct GroupRuns {
    /// Names, of which some may have no triangle.
    names: Vec<String>,
    places: HashMap<String, usize>,
    /// First triangle of each run, and the place of its name; `None` without a material.
    runs: Vec<(usize, Option<usize>)>,
}

impl GroupRuns {
    /// Returns the place of a name, a new one if it was not there.
    pub(super) fn place(&mut self, name: &str) -> usize {
        if let Some(&place) = self.places.get(name) {
            return place;
        }
        let place = self.names.len();
        self.names.push(name.to_owned());
        self.places.insert(name.to_owned(), place);
        place
    }

    /// Triangles from here on are of a group.
    pub(super) fn begin(&mut self, first_triangle: usize, group: Option<usize>) {
        if self.runs.last().is_none_or(|(_, last)| *last != group) {
            self.runs.push((first_triangle, group));
        }
    }

    /// The groups of so many triangles.
    pub(super) fn groups(mut self, triangles: usize) -> MeshGroups {
        if self.runs.iter().all(|(_, group)| group.is_none()) {
            return MeshGroups::default();
        }
        if self.runs.first().is_none_or(|&(first, _)| first > 0) {
            self.runs.insert(0, (0, None));
        }
        let has_unnamed = self.runs.iter().any(|(_, group)| group.is_none());
        let unnamed = if has_unnamed { self.place(UNNAMED) } else { 0 };
        let mut groups = MeshGroups { names: Vec::new(), of_triangle: Vec::with_capacity(triangles) };
        let mut places: Vec<Option<u32>> = vec![None; self.names.len()];
        for (k, &(first, group)) in self.runs.iter().enumerate() {
            let end = self.runs.get(k + 1).map_or(triangles, |next| next.0).min(triangles);
            if first >= end {
                continue;
            }
            let name = group.unwrap_or(unnamed);
            let place = *places[name].get_or_insert_with(|| {
                groups.names.push(self.names[name].clone());
                groups.names.len() as u32 - 1
            });
            groups.of_triangle.resize(end, place);
        }
        groups
    }
}
