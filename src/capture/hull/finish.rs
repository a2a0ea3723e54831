//! What is done to a contoured surface: specks left out, steps of the pixels smoothed.

use crate::mesh::Mesh;
use glam::Vec3;

/// A part of the surface with a smaller share of the largest part's triangles is a speck.
const SPECK: f64 = 0.01;
/// Smoothing steps inwards and outwards, which keep the volume (Taubin 1995), and how often.
const STEPS: [f32; 2] = [0.5, -0.53];
const ROUNDS: usize = 3;

/// Leaves specks out; returns how many there were.
pub(super) fn keep_large_parts(mesh: &mut Mesh) -> usize {
    let mut parents: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    fn root(parents: &mut [u32], mut at: u32) -> u32 {
        while parents[at as usize] != at {
            parents[at as usize] = parents[parents[at as usize] as usize];
            at = parents[at as usize];
        }
        at
    }
    for &[a, b, c] in &mesh.triangles {
        for other in [b, c] {
            let (p, q) = (root(&mut parents, a), root(&mut parents, other));
            parents[p.max(q) as usize] = p.min(q);
        }
    }
    let part: Vec<u32> = mesh.triangles.iter().map(|triangle| root(&mut parents, triangle[0])).collect();
    let mut sizes = vec![0u32; mesh.positions.len()];
    part.iter().for_each(|&part| sizes[part as usize] += 1);
    let least = f64::from(sizes.iter().copied().max().unwrap_or(0)) * SPECK;
    let dropped = sizes.iter().filter(|&&size| size > 0 && f64::from(size) < least).count();
    let mut index = 0;
    mesh.triangles.retain(|_| {
        index += 1;
        f64::from(sizes[part[index - 1] as usize]) >= least
    });
    let mut places = vec![u32::MAX; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|&vertex| places[vertex as usize] = 0);
    let mut kept = Vec::new();
    for (place, position) in places.iter_mut().zip(&mesh.positions) {
        if *place == 0 {
            *place = kept.len() as u32;
            kept.push(*position);
        }
    }
    mesh.triangles.iter_mut().flatten().for_each(|vertex| *vertex = places[*vertex as usize]);
    mesh.positions = kept;
    dropped
}

/// Smooths a closed surface, no vertex by more than half a cell along an axis.
pub(super) fn smooth(mesh: &mut Mesh, cell: f64) {
    let before: Vec<Vec3> = mesh.positions.iter().map(|p| Vec3::from_array(*p)).collect();
    let most = Vec3::splat(0.5 * cell as f32);
    let mut now = before.clone();
    let mut sums = vec![(Vec3::ZERO, 0u32); now.len()];
    for step in std::iter::repeat_n(STEPS, ROUNDS).flatten() {
        sums.fill((Vec3::ZERO, 0));
        // Each edge of a closed surface comes twice, once each way.
        for triangle in &mesh.triangles {
            for k in 0..3 {
                let (sum, count) = &mut sums[triangle[k] as usize];
                *sum += now[triangle[(k + 1) % 3] as usize];
                *count += 1;
            }
        }
        for ((place, origin), (sum, count)) in now.iter_mut().zip(&before).zip(&sums) {
            let moved = *place + step * (*sum / (*count).max(1) as f32 - *place);
            *place = moved.clamp(*origin - most, *origin + most);
        }
    }
    mesh.positions = now.into_iter().map(|position| position.to_array()).collect();
}
