//! Any small picture set is coded, and decodes to what the encoder said.

use arbitrary::{self, Arbitrary, Unstructured};
use tsuya::DecodeSpeed;
use tsuya::internals::MaskedPhotographs;
use tsuya::internals::predictive::{PREFIX_BYTES, PlaneEncoder, PlaneHeader, PlaneQuality};
use tsuya::{Budget, Limits};
use tsuya::{Component, Photograph};
use tsuya::{
    image::{Mask, RgbImage},
    internals,
};
use tsuya_fuzz::scene;

#[derive(Arbitrary, Debug)]
struct Input {
    views: u8,
    width: u8,
    height: u8,
    polarised: bool,
    signed: bool,
    decoding: u8,
    step: u8,
    lambda: u8,
    shift: i8,
    masks: [u64; 4],
    pixels: Vec<f32>,
}

pub fn fuzz(bytes: &[u8]) {
    let Ok(input) = Input::arbitrary(&mut Unstructured::new(bytes)) else { return };
    let (width, height) = (1 + input.width as usize % 48, 1 + input.height as usize % 48);
    let mut mesh = scene::mesh();
    mesh.positions[0][0] += input.shift as f32 * 0.02;
    let views = scene::views(1 + input.views as usize % 4, width as u32, height as u32);
    let components = [Component::Diffuse, Component::Specular, Component::Combined];
    let components = if input.polarised { &components[..2] } else { &components[2..] };
    let mut numbers = input.pixels.iter().map(|x| if x.is_finite() { x.clamp(-1e4, 1e4) } else { 0.5 }).cycle();
    let photographs: Vec<Photograph> = (0..views.len())
        .map(|view| {
            let data = (0..width * height).map(|i| input.masks[view % 4] >> (i * 7 / width % 64) & 1 == 1).collect();
            let image = |_| {
                let data = (0..width * height).map(|_| [0; 3].map(|_| numbers.next().unwrap_or(0.3))).collect();
                RgbImage { width, height, data }
            };
            Photograph { mask: Mask { width, height, data }, images: components.iter().map(image).collect() }
        })
        .collect();
    let white = [1.0, 0.9, 0.8];
    let quality = PlaneQuality {
        step: 0.002 + input.step as f32 * 0.002,
        lambda: input.lambda as f32 * 0.002,
        decode_speed: [DecodeSpeed::Normal, DecodeSpeed::Fast, DecodeSpeed::Fastest][input.decoding as usize % 3],
        tile_side_log2: 4 + input.decoding / 3 % 9,
        ..PlaneQuality::default()
    };
    let covered = tsuya::internals::surface::coverage_runs(&mesh, &views);
    let covered = &covered[..];
    let source =
        MaskedPhotographs { mesh: &mesh, views: &views, components, white, covered, photographs: &photographs };
    let encoder = PlaneEncoder::new(&source, input.signed).expect("photographs in memory");
    let encoded = encoder.encode(&quality).expect("every picture set can be coded");
    let budget = Budget::new(Limits::default());
    let header = PlaneHeader::parse(&encoded.bytes, &views, components.len(), &budget).expect("our own head");
    let body = &encoded.bytes[PREFIX_BYTES + PlaneHeader::head_bytes(&encoded.bytes).expect("our own head") as usize..];
    let read = |range: std::ops::Range<u64>| Ok(Some(body[range.start as usize..range.end as usize].to_vec()));
    let decoded =
        internals::predictive::decode(&header, &mesh, (&views, white), |_| true, read, &budget).expect("our own file");
    for ((decoded, expected), target) in decoded.iter().zip(&encoded.photographs).zip(&photographs) {
        let decoded = decoded.as_ref().expect("all views were asked for");
        assert_eq!(decoded.mask, target.mask);
        for (a, b) in decoded.images.iter().zip(&expected.images) {
            assert!(a.data.iter().flatten().zip(b.data.iter().flatten()).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
    }
}
