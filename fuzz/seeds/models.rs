//! Materials, light and visibility, and the files that materials come from.

use crate::Seeds;
use std::f64::consts::PI;
use tsuya::Mesh;
use tsuya::brdf::{Brdf, BrdfSample, ClassicalLobe, ClassicalModel, PlanMethod, Population};
use tsuya::lighting::{EnvironmentLobes, EnvironmentMap};
use tsuya::visibility::{BakeOptions, bake};
use tsuya::{
    brdf::{self, FittedMaterial, NamedMaterial},
    lighting,
};

/// A classical material.
pub fn model(number: usize) -> ClassicalModel {
    let lobes = [
        ClassicalLobe::CookTorranceGgx { roughness: 0.3, reflectance: 0.04 },
        ClassicalLobe::BlinnPhong { exponent: 20.0 },
        ClassicalLobe::Ward { roughness: 0.2 },
    ];
    let lobe = lobes[number % lobes.len()].clone();
    ClassicalModel { diffuse: [0.5, 0.3, 0.1 * number as f64], specular: [0.2; 3], lobe }
}

/// One material of each form.
pub fn materials() -> Vec<NamedMaterial> {
    let samples = BrdfSample::tabulate(&model(0), [18, 9, 4]);
    let options = brdf::DsbrdfFitOptions { slices: 6, ..Default::default() };
    let lobes = brdf::fit_dsbrdf(&samples, &options).expect("a material");
    let tuned = brdf::fit_compact(&samples, &Default::default()).expect("a material");
    let (base_colour, specular_colour) = ([0.9, 0.7, 0.3], [1.0; 3]);
    let brass = brdf::Microfacets { base_colour, metallic: 1.0, roughness: 0.3, specular_colour };
    vec![
        NamedMaterial { name: "lobes".into(), material: FittedMaterial::Dsbrdf(lobes) },
        NamedMaterial { name: "compact".into(), material: FittedMaterial::Compact(tuned) },
        NamedMaterial { name: "ward".into(), material: FittedMaterial::Classical(model(2)) },
        NamedMaterial { name: "brass".into(), material: FittedMaterial::MetallicRoughness(brass) },
    ]
}

/// Section `vISB`; places beside the vertices where `places` is more than there are.
pub fn visibility(mesh: &Mesh, places: usize) -> Vec<u8> {
    let options = BakeOptions { size: 8, terms: [3, 2], places, ..Default::default() };
    bake(mesh, &options).expect("visibility of a small mesh").bytes
}

/// Section `lIGt`.
pub fn light(size: usize) -> Vec<u8> {
    let radiance = |[x, y, z]: [f64; 3]| {
        let sun = 20.0 * (30.0 * (0.6 * x + 0.8 * y - 1.0)).exp();
        [0.3 + sun, 0.4 + sun, 0.5 + 0.3 * y.max(0.0) + sun + 0.1 * z.abs()].map(|x| x as f32)
    };
    let environment = EnvironmentMap::from_fn(64, radiance);
    let options = lighting::LobeFitOptions { lobes: 3, evaluations: 20 };
    let diffuse = lighting::fit(&environment, &options, None);
    let mut levels = lighting::prefiltered_maps(&environment, size);
    levels.truncate(3);
    lighting::encode(&EnvironmentLobes { diffuse, prefiltered: levels }, &Default::default()).expect("a light").0
}

/// Tables, fits and plans.
pub fn put(seeds: &Seeds) {
    let head = [90u32, 90, 180].map(u32::to_le_bytes).concat();
    let cells = [0.5f64, 1.0].map(f64::to_le_bytes).concat();
    seeds.put("merl", "zeros", [&head[..], &cells, &[0; 8]].concat());
    seeds.put("merl", "short", [&head[..], &cells, &[1]].concat());
    seeds.put("rgl", "smallest", rgl(&[0.0]));
    seeds.put("rgl", "anisotropic", rgl(&[0.0, 3.0]));
    for number in 0..3 {
        seeds.put("job", &format!("model-{number}"), serde_json::to_vec(&model(number)).expect("a model"));
    }
    let mut population = Population::new();
    for number in 0..3 {
        let material = model(number);
        let value = |_: usize, angles: tsuya::brdf::HalfDifference| {
            let (incoming, outgoing) = angles.directions();
            Some(material.evaluate(incoming, outgoing))
        };
        population.add_values(value).expect("values everywhere");
    }
    for (name, method) in
        [("uniform", PlanMethod::Uniform), ("variance", PlanMethod::Variance), ("optimal", PlanMethod::Optimal)]
    {
        let mut plan = population.plan(6, method).expect("a plan");
        // Shorter: two components are as good as all.
        plan.components.components.truncate(2);
        plan.components.variances.truncate(2);
        seeds.put("plan", name, plan.to_json().expect("a plan"));
    }
}

/// The smallest RGL material: two elevations, everything else on 2 x 2 corners.
fn rgl(azimuths: &[f32]) -> Vec<u8> {
    type Field = (&'static str, Vec<u64>, u8, Vec<u8>);
    let floats = |numbers: &[f32]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let ones = |name, shape: &[u64]| -> Field {
        (name, shape.to_vec(), 10, floats(&vec![1.0; shape.iter().product::<u64>() as usize]))
    };
    let count = azimuths.len() as u64;
    let fields: [Field; 9] = [
        ("description", vec![1], 1, b"x".to_vec()),
        ("phi_i", vec![count], 10, floats(azimuths)),
        ("theta_i", vec![2], 10, floats(&[0.0, 0.5 * PI as f32 - 0.05])),
        ones("ndf", &[2, 2]),
        ones("sigma", &[2, 2]),
        ones("vndf", &[count, 2, 2, 2]),
        ones("luminance", &[count, 2, 2, 2]),
        ones("rgb", &[count, 2, 3, 2, 2]),
        ("jacobian", vec![1], 1, vec![1]),
    ];
    let mut header = b"tensor_file\0\x01\0".to_vec();
    header.extend((fields.len() as u32).to_le_bytes());
    let heads: usize = fields.iter().map(|(name, shape, ..)| 13 + name.len() + 8 * shape.len()).sum();
    let start = header.len() + heads;
    let mut data: Vec<u8> = Vec::new();
    for (name, shape, kind, content) in &fields {
        header.extend((name.len() as u16).to_le_bytes());
        header.extend(name.as_bytes());
        header.extend((shape.len() as u16).to_le_bytes());
        header.push(*kind);
        header.extend(((start + data.len()) as u64).to_le_bytes());
        shape.iter().for_each(|side| header.extend(side.to_le_bytes()));
        data.extend(content);
    }
    [header, data].concat()
}
