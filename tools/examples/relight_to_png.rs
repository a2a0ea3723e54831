//! Renders a view of a file under another light, as PNG: `relight_to_png [FILE [PNG]]`.

use std::error::Error;
use tsuya::metrics::{DisplayImage, to_display};
use tsuya::relight::{AssetRenderer, RenderLighting, RenderOptions};
use tsuya::{DecodeOptions, PointLight, decode};

/// Renders the first view under its captured light, and under that light turned by an angle about +Y.
pub fn run(file: &[u8], degrees: f64) -> Result<[DisplayImage; 2], Box<dyn Error>> {
    let asset = decode(file, &DecodeOptions::default())?;
    let view = asset.views.first().ok_or("the file has no view")?;
    let captured = view.light.ok_or("the capture's lights are unknown: the file can't be relit")?;
    let ([x, y, z], (sin, cos)) = (captured.position, degrees.to_radians().sin_cos());
    let turned = PointLight { position: [cos * x + sin * z, y, cos * z - sin * x], ..captured };
    let renderer = AssetRenderer::new(&asset)?;
    let render = |light| {
        let options = RenderOptions { lighting: RenderLighting::Points(vec![light]), ..Default::default() };
        // Linear radiance; the white board becomes 255.
        renderer.render(&view.camera, &options).map(|render| to_display(&render.image, asset.white))
    };
    Ok([render(captured)?, render(turned)?])
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/spec/vectors/ring-small.tsuya");
    let file = arguments.next().unwrap_or_else(|| sample.to_string());
    let png = arguments.next().unwrap_or_else(|| "relit.png".to_string());
    let [_, relit] = run(&std::fs::read(file)?, 60.0)?;
    let (width, height) = (relit.width as u32, relit.height as u32);
    image::save_buffer(&png, relit.data.as_flattened(), width, height, image::ColorType::Rgb8)?;
    println!("{png}: {width} x {height}");
    Ok(())
}
