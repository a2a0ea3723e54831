//! Repeats the figures of Miyazaki, Shibata, Ikeuchi, "Wavelet-Texture Method", 2007, with profile `wavelet-texture`.
//!
//! Prints, for one capture, the error on visible samples against the share of coefficients kept, beside the published
//! figures and the true bytes of the bitstream.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::Mesh;
use tsuya::image::Mask;
use tsuya::internals::residual::FillEffort;
use tsuya::internals::surface::coverage;
use tsuya::internals::wavelet_texture::{
    EncodedWaveletTexture, WaveletOptions, WaveletSamples, decode, encode, fit_model, photographs, sample_errors,
};
use tsuya::metrics::PhotographError;
use tsuya::{Budget, Limits};
use tsuya::{Component, Photograph, View};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const COMPONENTS: [Component; 2] = [Component::Diffuse, Component::Specular];

fn main() -> Result<()> {
    let start = Instant::now();
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().map_or_else(default_capture, PathBuf::from);
    let capture = Capture::read(&folder)?;
    let samples = WaveletSamples::gather(&capture.mesh, &capture.views, &capture.photographs, 1.0)?;
    let visible = samples.visible();
    println!("{}: {} views, {} triangles", folder.display(), capture.views.len(), capture.mesh.triangles.len());
    println!(
        "{} patches, {} samples a view, {:.1} % of all samples visible, {} coefficients, {:.2} samples a masked pixel ({:.1} s)",
        samples.layout.patches.len(),
        samples.layout.samples_per_view(),
        100.0 * visible as f64 / (samples.layout.samples_per_view() * capture.views.len()) as f64,
        samples.coefficients(),
        visible as f64 / capture.photographs.iter().map(|p| p.mask.count()).sum::<usize>() as f64,
        start.elapsed().as_secs_f64(),
    );
    let model = fit_model(&samples, &COMPONENTS);
    println!("model fitted ({:.1} s)\n", start.elapsed().as_secs_f64());
    println!(
        "PSNR on visible samples, dB; lin: peak = white; clip: first limited to white, as photographs of 8 bits are; sqrt: of sqrt(x / white)."
    );
    println!("bps: bits per visible sample and colour, both components. Image: their sum, sqrt, on the photographs.\n");
    println!(
        "coefficients kept    | diffuse lin / clip / sqrt | specular lin / clip / sqrt | image |     bytes (model) |  bps | published"
    );
    let standard = WaveletOptions::default();
    let per_image = WaveletOptions { view_levels: 0, ..standard };
    let holes = |options: WaveletOptions| WaveletOptions { effort: FillEffort::HOLES_ARE_ZERO, ..options };
    let rows = [
        (0.0, true, standard, "< 30 (model alone)"),
        (1.5, true, standard, ""),
        (2.0, true, standard, ">= 40"),
        (5.0, true, standard, ""),
        (10.0, true, standard, ""),
        (50.0, true, standard, ">= 80"),
        (2.4, true, standard, "48 (with model)"),
        (2.4, false, standard, "47 (without model)"),
        (2.1, true, standard, "43 (3-D)"),
        (2.1, true, per_image, "27 (2-D per image)"),
        (2.1, false, standard, "43 (3-D), here without model"),
        (2.1, false, per_image, "27 (2-D), here without model"),
        (2.1, true, holes(standard), "43 (3-D), here with holes as zeros"),
        (2.1, true, holes(per_image), "27 (2-D), here with holes as zeros"),
        (2.1, false, holes(standard), "43 (3-D), here without model, holes as zeros"),
        (2.1, false, holes(per_image), "27 (2-D), here without model, holes as zeros"),
    ];
    let only: Option<f64> = std::env::var("TSUYA_BENCH_ONLY").ok().and_then(|v| v.parse().ok());
    for (percent, modelled, options, published) in rows {
        if only.is_some_and(|only| only != percent) {
            continue;
        }
        let options = WaveletOptions { keep_percent: percent, ..options };
        let begun = Instant::now();
        let encoded = encode(&samples, &COMPONENTS, modelled.then_some(&model), &options)?;
        let encoding = begun.elapsed().as_secs_f64();
        report(&capture, &samples, &encoded, modelled, options.view_levels, published)?;
        if only.is_some() {
            println!("encode {encoding:.1} s, decode and compare {:.1} s", begun.elapsed().as_secs_f64() - encoding);
        }
    }
    println!("\n{:.0} s in all", start.elapsed().as_secs_f64());
    Ok(())
}

fn report(
    capture: &Capture,
    samples: &WaveletSamples,
    encoded: &EncodedWaveletTexture,
    modelled: bool,
    view_levels: u8,
    published: &str,
) -> Result<()> {
    let budget = Budget::new(Limits::default());
    let decoded = decode(&encoded.bytes, &capture.mesh, &COMPONENTS, capture.views.len(), &budget)?;
    let errors = sample_errors(samples, &decoded, capture.white);
    let photographs = photographs(&decoded, &capture.mesh, &capture.views, |_| true);
    let mut total = PhotographError::default();
    for ((original, decoded), covered) in
        capture.photographs.iter().zip(photographs.iter().flatten()).zip(&capture.covered)
    {
        total.merge(&PhotographError::compare(original, decoded, &COMPONENTS, covered, capture.white));
    }
    let image = total.psnr().sum.unwrap_or(f64::INFINITY);
    println!(
        "{:6.3} % {:5} {:6} |      {:5.1} / {:4.1} / {:4.1} |       {:5.1} / {:4.1} / {:4.1} | {:5.1} | {:9} ({:6}) | {:4.2} | {published}",
        encoded.kept_percent(),
        if modelled { "model" } else { "none" },
        if view_levels > 0 { "3-D" } else { "2-D" },
        errors[0].linear_db,
        errors[0].clipped_db,
        errors[0].sqrt_db,
        errors[1].linear_db,
        errors[1].clipped_db,
        errors[1].sqrt_db,
        image,
        encoded.bytes.len(),
        encoded.model_bytes,
        8.0 * encoded.bytes.len() as f64 / (samples.visible() * 3).max(1) as f64,
    );
    Ok(())
}

fn default_capture() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let data = std::env::var_os("TSUYA_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let ring = data.join("captures/bunny-ring");
    if ring.is_dir() { ring } else { root.join("tests/data/sample-spot") }
}

/// A polarised capture in memory.
struct Capture {
    mesh: Mesh,
    views: Vec<View>,
    white: [f64; 3],
    photographs: Vec<Photograph>,
    /// What the mesh covers in each.
    covered: Vec<Mask>,
}

impl Capture {
    fn read(folder: &Path) -> Result<Capture> {
        let mut capture = tsuya::capture::read(folder, &Default::default())?;
        let observations = tsuya::encoder::separate(&mut capture)?;
        if observations.components != COMPONENTS {
            return Err(format!("{}: photographs with and without polarisers are needed", folder.display()).into());
        }
        let (mut views, mut photographs) = (Vec::new(), Vec::new());
        for frame in observations.views {
            let mask = frame.mask.ok_or_else(|| format!("{}: a mask is needed", frame.view.name))?;
            views.push(frame.view);
            photographs.push(Photograph { mask, images: frame.images });
        }
        let covered = coverage(&capture.mesh, &views);
        Ok(Capture { mesh: capture.mesh, views, white: observations.white, photographs, covered })
    }
}
