use super::*;
use crate::limits::Limits;
use std::path::PathBuf;

fn budget() -> Budget {
    Budget::new(Limits { memory_bytes: 1 << 28, mesh_elements: 1 << 20, ..Limits::default() })
}

/// Binary little-endian PLY with float positions and triangles.
fn read_ply(bytes: &[u8]) -> Mesh {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let count = |name: &str| -> usize {
        let line = header.lines().find(|line| line.starts_with(&format!("element {name} "))).unwrap();
        line.rsplit(' ').next().unwrap().parse().unwrap()
    };
    let vertex_lines = header.lines().skip_while(|l| !l.starts_with("element vertex")).skip(1);
    let properties = vertex_lines.take_while(|line| line.starts_with("property float")).count();
    let (vertices, triangles) = (count("vertex"), count("face"));
    let number = |at: usize| -> [u8; 4] { bytes[at..at + 4].try_into().unwrap() };
    let positions = (0..vertices)
        .map(|v| std::array::from_fn(|k| f32::from_le_bytes(number(end + 4 * (properties * v + k)))))
        .collect();
    let faces = end + 4 * properties * vertices;
    let triangles = (0..triangles)
        .map(|t| std::array::from_fn(|k| u32::from_le_bytes(number(faces + 13 * t + 1 + 4 * k))))
        .collect();
    Mesh { positions, triangles }
}

/// Encodes, decodes, and checks that every triangle came back with its orientation and every vertex within half a step.
fn round_trip(mesh: &Mesh, bits: u8) -> EncodedMesh {
    let encoded = encode(mesh, &MeshOptions { position_bits: bits }).unwrap();
    let decoded = decode(&encoded.bytes, &budget()).unwrap();
    assert_eq!(decoded, encoded.mesh);
    assert_eq!((decoded.positions.len(), decoded.triangles.len()), (mesh.positions.len(), mesh.triangles.len()));
    let mut seen = vec![false; mesh.triangles.len()];
    for (triangle, &original) in decoded.triangles.iter().zip(&encoded.triangle_order) {
        assert!(!std::mem::replace(&mut seen[original as usize], true));
        let triangle = triangle.map(|v| encoded.vertex_order[v as usize]);
        let [a, b, c] = mesh.triangles[original as usize];
        assert!([[a, b, c], [b, c, a], [c, a, b]].contains(&triangle));
    }
    let axis = |k: usize| mesh.positions.iter().map(move |p| p[k]);
    let side = (0..3).map(|k| axis(k).fold(f32::MIN, f32::max) - axis(k).fold(f32::MAX, f32::min)).fold(0.0, f32::max);
    let half_step = side / ((1u32 << bits) - 1) as f32 * 0.501 + 1e-6 * side;
    let mut seen = vec![false; mesh.positions.len()];
    for (position, &original) in decoded.positions.iter().zip(&encoded.vertex_order) {
        assert!(!std::mem::replace(&mut seen[original as usize], true));
        let given = mesh.positions[original as usize];
        assert!((0..3).all(|k| (position[k] - given[k]).abs() <= half_step), "{position:?} {given:?}");
    }
    encoded
}

#[test]
fn real_meshes_become_small() {
    let data = std::env::var_os("TSUYA_DATA").map_or(PathBuf::from("../shared/data"), PathBuf::from);
    let meshes = [
        ("captures/bunny-ring/scan.ply", 12_500),
        ("captures/sample-spot/scan.ply", 2_700),
        ("captures/spot-dome/scan.ply", 7_750),
        ("multiview/templeRing/hull.ply", 15_300),
    ];
    for (name, bound) in meshes {
        let Ok(bytes) = std::fs::read(data.join(name)) else {
            println!("skipped: {name} is not here");
            continue;
        };
        let mesh = read_ply(&bytes);
        let encoded = round_trip(&mesh, 12);
        let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
        let length = encoded.bytes.len();
        let bits = length as f64 * 8.0 / vertices as f64;
        println!("{name}: {vertices} vertices, {triangles} triangles, {length} bytes, {bits:.2} bits a vertex");
        assert!(length < bound, "{name}: {length} bytes");
        let coarser = [11, 10].map(|bits| round_trip(&mesh, bits).bytes.len());
        println!("  with 11 and 10 bits: {coarser:?}");
    }
}

/// A bent grid of `2 side^2` triangles.
fn grid(side: u32) -> Mesh {
    let place = |x: u32, y: u32| [x as f32, y as f32, (x * x) as f32 * 0.01 + (x * y) as f32 * 0.005];
    let positions = (0..=side).flat_map(|y| (0..=side).map(move |x| place(x, y))).collect();
    let square = |x: u32, y: u32| {
        let at = y * (side + 1) + x;
        [[at, at + 1, at + side + 2], [at, at + side + 2, at + side + 1]]
    };
    let triangles = (0..side).flat_map(|y| (0..side).flat_map(move |x| square(x, y))).collect();
    Mesh { positions, triangles }
}

struct Random(u64);
impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % bound
    }
}

#[test]
fn regular_meshes_cost_almost_nothing() {
    let encoded = round_trip(&grid(64), 12);
    let bits = encoded.bytes.len() as f64 * 8.0 / (2.0 * 64.0 * 64.0);
    assert!(bits < 2.7, "{bits} bits a triangle");
    let flat = Mesh { positions: grid(100).positions.iter().map(|p| [p[0], p[1], 0.0]).collect(), ..grid(100) };
    let encoded = round_trip(&flat, 12);
    assert!(encoded.bytes.len() < 2600, "{} bytes for 20000 triangles", encoded.bytes.len());
}

#[test]
fn every_list_of_triangles_comes_back() {
    let mut random = Random(7);
    for case in 0..400 {
        let vertices = 1 + random.below(30);
        let count = random.below(60);
        // Anything: repeated corners, duplicates, edges of many triangles, vertices without triangles.
        let triangles = (0..count).map(|_| [0; 3].map(|_| random.below(vertices) as u32)).collect();
        let positions = (0..vertices).map(|_| [0; 3].map(|_| random.below(50) as f32 - 20.0)).collect();
        round_trip(&Mesh { positions, triangles }, 1 + case as u8 % 24);
    }
    // A grid with holes, flipped and doubled triangles, and a handle through shared vertices.
    for seed in 0..40 {
        let mut mesh = grid(12);
        let mut random = Random(seed);
        for _ in 0..random.below(60) {
            let at = random.below(mesh.triangles.len());
            match random.below(4) {
                0 => mesh.triangles[at].swap(0, 1),
                1 => mesh.triangles.push(mesh.triangles[at]),
                2 => mesh.triangles[at][random.below(3)] = random.below(mesh.positions.len()) as u32,
                _ => {
                    mesh.triangles.swap_remove(at);
                }
            }
        }
        round_trip(&mesh, 10);
    }
}

#[test]
fn small_and_odd_meshes_come_back() {
    let positions = |list: &[[f32; 3]]| list.to_vec();
    let tetrahedron = Mesh {
        positions: positions(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    };
    assert!(round_trip(&tetrahedron, 12).bytes.len() < 50);
    round_trip(&Mesh::default(), 12);
    round_trip(&Mesh { positions: positions(&[[1e11, -3.0, 5.0]]), triangles: vec![[0, 0, 0]] }, 12);
    round_trip(&Mesh { positions: positions(&[[2.0; 3]; 5]), triangles: vec![] }, 1);
    // A fan of many triangles at one vertex: the work stays linear.
    let rim = 50_000u32;
    let positions =
        (0..=rim).map(|k| if k == 0 { [0.0; 3] } else { [(k % 317) as f32, (k % 211) as f32, 0.5] }).collect();
    let fan = Mesh { positions, triangles: (1..rim).map(|k| [0, k, k + 1]).collect() };
    round_trip(&fan, 12);
}

#[test]
fn impossible_meshes_are_refused_in_writing() {
    let good = grid(2);
    let options = MeshOptions::default();
    let index = Mesh { triangles: vec![[0, 1, 9]], ..good.clone() };
    let infinite = Mesh { positions: vec![[0.0, f32::INFINITY, 0.0]; 9], ..good.clone() };
    for (mesh, options) in [
        (index, options),
        (infinite, options),
        (good.clone(), MeshOptions { position_bits: 0 }),
        (good, MeshOptions { position_bits: 25 }),
    ] {
        assert!(matches!(encode(&mesh, &options), Err(Error::Parameter(_))));
    }
}

/// Bytes are equal on every platform, and for as long as this version is written.
#[test]
fn golden_bytes() {
    let encoded = encode(&grid(6), &MeshOptions { position_bits: 11 }).unwrap();
    let mut hasher = crc32fast::Hasher::new();
    for x in encoded.mesh.positions.as_flattened() {
        hasher.update(&x.to_le_bytes());
    }
    for v in encoded.mesh.triangles.as_flattened() {
        hasher.update(&v.to_le_bytes());
    }
    assert_eq!(
        (encoded.bytes.len(), crc32fast::hash(&encoded.bytes), hasher.finalize()),
        (171, 1785148722, 1419165819)
    );
}

#[test]
fn hostile_bytes_are_refused() {
    let bytes = encode(&grid(5), &MeshOptions::default()).unwrap().bytes;
    for length in 0..bytes.len() {
        assert!(decode(&bytes[..length], &budget()).is_err(), "cut to {length}");
    }
    for extra in [0, 1, 128, 255] {
        assert!(decode(&[&bytes[..], &[extra]].concat(), &budget()).is_err(), "one more byte {extra}");
    }
    let mut future = bytes.clone();
    future[0] = 1;
    assert!(matches!(decode(&future, &budget()), Err(Error::Unsupported(_))));
    let few = Budget::new(Limits { mesh_elements: 49, ..Limits::default() });
    assert!(matches!(decode(&bytes, &few), Err(Error::Limits { .. })));
    let small = Budget::new(Limits { memory_bytes: 4000, ..Limits::default() });
    assert!(matches!(decode(&bytes, &small), Err(Error::Limits { .. })));
    let mut random = Random(1);
    for _ in 0..4000 {
        let mut damaged = bytes.clone();
        for _ in 0..1 + random.below(3) {
            let at = 1 + random.below(damaged.len() - 1);
            damaged[at] = random.below(256) as u8;
        }
        let _ = decode(&damaged, &budget());
    }
}

#[test]
fn positions_beyond_the_bound_are_refused() {
    let scaled = |by: f32| {
        let mut mesh = grid(3);
        let longest = mesh.positions.as_flattened().iter().fold(0.0, |most: f32, x| most.max(x.abs()));
        mesh.positions.iter_mut().flatten().for_each(|x| *x *= by / longest);
        mesh
    };
    let near = encode(&scaled(1e11), &MeshOptions::default()).unwrap();
    assert_eq!(decode(&near.bytes, &budget()).unwrap(), near.mesh);
    for by in [1.1e12, 1e18] {
        assert!(matches!(encode(&scaled(by), &MeshOptions::default()), Err(Error::Parameter(_))), "{by:e}");
    }
    for (origin, step) in [(1.1e12, 0.0), (-1.1e12, 0.0), (0.0, 1e10), (f32::NAN, 1.0), (0.0, f32::INFINITY)] {
        let header = MeshHeader { vertices: 3, triangles: 1, bits: 8, origin: [0.0, origin, 0.0], step };
        let error = check_header(&header, 100, &budget()).unwrap_err();
        assert!(error.to_string().contains("lattice"), "{error}");
    }
}

/// A header alone that claims what its few bytes could never tell costs nothing.
#[test]
fn large_claims_need_bytes() {
    for (vertices, triangles) in [(0, 1 << 26), (1 << 26, 0), (1 << 26, 1 << 26)] {
        let header = MeshHeader { vertices, triangles, bits: 12, origin: [0.0; 3], step: 1.0 };
        let mut coder = crate::entropy::RangeEncoder::new();
        header.code(&mut coder);
        let bytes = [&[VERSION][..], &coder.finish(), &[0x55; 100]].concat();
        let error = decode(&bytes, &Budget::new(Limits { memory_bytes: u64::MAX, ..Limits::default() })).unwrap_err();
        assert!(error.to_string().contains("than the bytes can tell"), "{error}");
    }
    // Just enough bytes: the triangles are there, made of whatever the bytes say, or are refused; either way at once.
    for fill in [0x00, 0x55, 0xaa, 0xff] {
        let header = MeshHeader { vertices: 1 << 20, triangles: 1 << 20, bits: 12, origin: [0.0; 3], step: 1.0 };
        let mut coder = crate::entropy::RangeEncoder::new();
        header.code(&mut coder);
        let bytes = [&[VERSION][..], &coder.finish(), &[fill; 64]].concat();
        let _ = decode(&bytes, &Budget::new(Limits { memory_bytes: 1 << 30, ..Limits::default() }));
    }
}
