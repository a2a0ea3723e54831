use super::*;
use crate::Limits;
use crate::container::Tag;
use crate::mesh::Mesh;
use crate::reflectance::codec::{MapSteps, decode, encode};
use crate::reflectance::maps::ReflectanceMaps;
use crate::reflectance::torrance_sparrow::{self, SpecularSighting};
use crate::surface::charts::{Chart, Charts};

/// Sightings of a highlight with a core and a wide foot, which no Gaussian has.
fn sightings(sigma: f32, colour: [f32; 3], block: usize) -> Vec<SpecularSighting> {
    (0..40)
        .map(|n| {
            let part = |step: f32| ((n + 17 * block) as f32 * step).fract();
            let geometry = ReflectionGeometry {
                irradiance: [2.0, 3.0, 2.5],
                cos_light: 0.5 + 0.4 * part(0.57),
                cos_view: 0.5 + 0.4 * part(0.31),
                alpha: 1.2 * part(0.618).powi(2),
                difference: 0.2 + 0.6 * part(0.755),
                ..Default::default()
            };
            let shape = (-(geometry.alpha / sigma)).exp() + 0.05 * (-geometry.alpha).exp();
            let fresnel = 1.0 + 2.0 * geometry.difference;
            let radiance = |c: usize| colour[c] * geometry.irradiance[c] * geometry.cos_light * shape * fresnel;
            SpecularSighting { radiance: std::array::from_fn(radiance), geometry }
        })
        .collect()
}

fn fitted() -> (Vec<PaletteEntry>, f64, f64) {
    let blocks: Vec<Vec<SpecularSighting>> =
        (0..60).map(|k| sightings(0.06 * (1 + k % 5) as f32, [0.1 + 0.01 * k as f32, 0.2, 0.3], k as usize)).collect();
    let gaussian: Vec<Option<TorranceSparrowLobe>> = blocks.iter().map(|seen| torrance_sparrow::fit(seen)).collect();
    let mut lobes = gaussian.clone();
    let palette = fit(&mut lobes, &blocks);
    let error = |model: &dyn Fn(usize, &ReflectionGeometry) -> [f32; 3]| {
        let of = |(k, seen): (usize, &Vec<SpecularSighting>)| -> f64 {
            let square = |s: &SpecularSighting| {
                let found = model(k, &s.geometry);
                (0..3).map(|c| (found[c] - s.radiance[c]).powi(2) as f64).sum::<f64>()
            };
            seen.iter().map(square).sum()
        };
        blocks.iter().enumerate().map(of).sum::<f64>()
    };
    let with_palette = error(&|k, g| lobes[k].map_or([0.0; 3], |lobe| evaluate(&palette, &lobe, g)));
    let with_gaussian = error(&|k, g| gaussian[k].map_or([0.0; 3], |lobe| torrance_sparrow::evaluate(&lobe, g)));
    (palette, with_palette, with_gaussian)
}

#[test]
fn a_palette_follows_what_a_gaussian_misses() {
    let (palette, with_palette, with_gaussian) = fitted();
    assert!((2..=4).contains(&palette.len()) && palette.is_sorted_by_key(|entry| entry.level));
    assert!(with_palette < 0.3 * with_gaussian, "{with_palette} {with_gaussian}");
    assert!(fit(&mut [None, None], &[vec![], vec![]]).is_empty());
}

#[test]
fn palettes_come_back_and_damage_is_found() {
    let (palette, ..) = fitted();
    let budget = || Budget::new(Limits { memory_bytes: 1 << 20, ..Limits::default() });
    let mut bytes = vec![7, 7];
    write_palette(&palette, &mut bytes).unwrap();
    assert!(read_palette(&bytes, 2, Tag::REFLECTANCE, &budget()).unwrap() == (palette.clone(), bytes.len()));
    for cut in 2..bytes.len() {
        assert!(read_palette(&bytes[..cut], 2, Tag::REFLECTANCE, &budget()).is_err(), "cut at {cut}");
    }
    let changed = |at: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = value;
        read_palette(&bytes, 2, Tag::REFLECTANCE, &budget())
    };
    assert!(changed(2, 0).is_err() && changed(2, 9).is_err());
    assert!(read_palette(&bytes, bytes.len() + 9, Tag::REFLECTANCE, &budget()).is_err());
    let small = Budget::new(Limits { memory_bytes: 150_000, ..Limits::default() });
    assert!(matches!(read_palette(&bytes, 2, Tag::REFLECTANCE, &small), Err(Error::Limits { .. })));
    let twice = [palette[0].clone(), palette[0].clone()];
    let mut equal = Vec::new();
    write_palette(&twice, &mut equal).unwrap();
    assert!(read_palette(&equal, 0, Tag::REFLECTANCE, &budget()).unwrap_err().to_string().contains("rise"));
    assert!(write_palette(&[], &mut equal).is_err());
    // Whatever decodes is finite.
    let geometry = ReflectionGeometry {
        irradiance: [1.0; 3],
        cos_light: 0.5,
        cos_view: 0.5,
        alpha: 0.1,
        difference: 0.4,
        ..Default::default()
    };
    let lobe = TorranceSparrowLobe { specular: [0.5; 3], sigma: 0.1 };
    for at in 3..bytes.len() {
        if let Ok((palette, _)) = changed(at, bytes[at] ^ (1 << (at % 8))) {
            let value = evaluate(&palette, &lobe, &geometry);
            assert!(value.iter().all(|v| v.is_finite() && *v >= 0.0), "{value:?}");
        }
    }
}

#[test]
fn gaussians_stand_for_lobes_that_are_nearly_gaussian() {
    // What Torrance and Sparrow's lobe shows, fitted as a palette and made Gaussian again.
    let truth = |k: usize| TorranceSparrowLobe { specular: [0.3, 0.2, 0.1], sigma: 0.08 * (1 + k % 3) as f32 };
    let blocks: Vec<Vec<SpecularSighting>> = (0..60)
        .map(|k| {
            let seen = sightings(0.1, [0.0; 3], k).into_iter();
            // Light and view lie as far from the normal as from the half vector, nearly.
            let geometry = |g: ReflectionGeometry| ReflectionGeometry {
                cos_light: g.difference.cos(),
                cos_view: g.difference.cos(),
                ..g
            };
            seen.map(|s| geometry(s.geometry))
                .map(|geometry| SpecularSighting {
                    radiance: torrance_sparrow::evaluate(&truth(k), &geometry),
                    geometry,
                })
                .collect()
        })
        .collect();
    let mut lobes: Vec<Option<TorranceSparrowLobe>> = blocks.iter().map(|seen| torrance_sparrow::fit(seen)).collect();
    let palette = fit(&mut lobes, &blocks);
    assert!(!palette.is_empty());
    let lobes: Vec<TorranceSparrowLobe> = lobes.into_iter().flatten().collect();
    let grid = |data: Vec<[f32; 3]>| crate::image::Grid { width: data.len(), height: 1, data };
    let maps = ReflectanceMaps {
        relightable: true,
        diffuse: grid(vec![[0.2; 3]; 60]),
        specular: grid(lobes.iter().map(|lobe| lobe.specular).collect()),
        sigma: crate::image::Grid { width: 60, height: 1, data: lobes.iter().map(|lobe| lobe.sigma).collect() },
        palette,
        lobes: Vec::new(),
    };
    let plain = maps.without_palette();
    assert!(plain.palette.is_empty() && plain.diffuse == maps.diffuse);
    for (k, (colour, sigma)) in plain.specular.data.iter().zip(&plain.sigma.data).enumerate() {
        let expected = truth(k);
        let off = |a: f32, b: f32| (a / b - 1.0).abs();
        let colours = (0..3).map(|c| off(colour[c], expected.specular[c])).fold(0.0, f32::max);
        assert!(off(*sigma, expected.sigma) < 0.15 && colours < 0.25, "{k}: {colour:?} {sigma}, {expected:?}");
    }
    let without = ReflectanceMaps { palette: Vec::new(), ..maps };
    assert!(matches!(without.without_palette(), std::borrow::Cow::Borrowed(_)));
}

/// The front of an octahedron and its back beside it.
fn atlas() -> (Mesh, Charts) {
    let mesh = Mesh {
        positions: vec![[1., 0., 0.], [-1., 0., 0.], [0., 1., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]],
        triangles: vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
    };
    let chart = |facing, x| Chart { facing, offset: [x, 10] };
    let charts = Charts {
        width: 40,
        height: 20,
        texels_per_unit: 8.0,
        charts: vec![chart(4, 10), chart(5, 30)],
        chart_of_triangle: vec![0, 0, 0, 0, 1, 1, 1, 1],
    };
    (mesh, charts)
}

#[test]
fn sections_with_a_palette_come_back_and_hostile_ones_are_refused() {
    let (mesh, charts) = atlas();
    let (palette, ..) = fitted();
    let grid = |value: &dyn Fn(usize) -> f32| crate::image::Grid {
        width: 40,
        height: 20,
        data: (0..800).map(value).collect::<Vec<f32>>(),
    };
    let maps = ReflectanceMaps {
        relightable: true,
        diffuse: grid(&|_| 0.3).map(|&x| [x; 3]),
        specular: grid(&|k| 0.2 + 0.1 * (k % 40) as f32 / 40.0).map(|&x| [x, 0.5 * x, x]),
        sigma: grid(&|k| 0.08 + 0.2 * (k / 40) as f32 / 20.0),
        palette,
        lobes: Vec::new(),
    };
    let steps = MapSteps { diffuse: 1.0, specular: 1.0, sigma: 1.0 };
    let (bytes, expected) = encode(&maps, &mesh, &charts, &steps, 0.0).unwrap();
    let read = |bytes: &[u8]| decode(bytes, &mesh, &charts, &Budget::new(Limits::default()));
    let decoded = read(&bytes).unwrap();
    assert!(decoded == expected && decoded.palette == maps.palette);
    // The same light as from the maps that were coded, within their steps.
    let geometry = ReflectionGeometry {
        irradiance: [1.0; 3],
        cos_light: 0.8,
        cos_view: 0.7,
        alpha: 0.05,
        difference: 0.4,
        ..Default::default()
    };
    for at in [[10.0, 10.0], [8.5, 11.0], [30.0, 9.0]] {
        let light =
            |maps| crate::reflectance::maps::evaluate(maps, crate::views::Component::Specular, at, Some(&geometry));
        let (before, after) = (light(&maps), light(&decoded));
        assert!((0..3).all(|c| (after[c] / before[c] - 1.0).abs() < 0.1), "{before:?} {after:?}");
    }
    // The palette begins at byte 23: its count, then level, length and lobes of each entry.
    let end = bytes.len();
    let palette_end = 24 + maps.palette.iter().map(|entry| 3 + entry.lobes.encode().len()).sum::<usize>();
    assert!(palette_end < end);
    for cut in 0..palette_end {
        assert!(matches!(read(&bytes[..cut]), Err(Error::Format { .. })), "cut at {cut}");
    }
    let changed = |at: usize, value: u8| {
        let mut bytes = bytes.clone();
        bytes[at] = value;
        read(&bytes)
    };
    // Lobes need other planes, and go without a palette.
    assert!(changed(1, 4).unwrap_err().to_string().contains("18 expected"));
    assert!(matches!(changed(1, 6), Err(Error::Unsupported(_))) && matches!(changed(1, 8), Err(Error::Unsupported(_))));
    assert!(changed(2, 3).unwrap_err().to_string().contains("specular"));
    assert!(matches!(changed(23, 0), Err(Error::Format { .. })) && matches!(changed(23, 9), Err(Error::Format { .. })));
    assert!(matches!(changed(25, 0xff), Err(Error::Format { .. })));
    let small = Budget::new(Limits { memory_bytes: 150_000, ..Limits::default() });
    assert!(matches!(decode(&bytes, &mesh, &charts, &small), Err(Error::Limits { .. })));
}

#[test]
fn the_levels_of_sigma_are_those_of_the_library_s_exponential() {
    // Rounded to single both give the same on machines whose own exponential is good; the format's is the same everywhere.
    let library = |level: i32| 0.02 * ((level as f32 / 255.0) * 40f32.ln()).exp();
    let same = (0..256).filter(|&level| sigma_of_level(level).to_bits() == library(level).to_bits()).count();
    assert!(same >= 250, "{same}");
    assert_eq!([0, 128, 255].map(|level| sigma_of_level(level).to_bits()), [0x3ca3_d70a, 0x3e02_779a, 0x3f4c_cccc]);
}
