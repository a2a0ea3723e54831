//! Repeats the figures of Miyazaki, Shibata, Ikeuchi, "Wavelet-Texture Method", 2007, with profile `paper`.
//!
//! Prints, for one capture, the error on visible samples against the share of coefficients kept, beside the published
//! figures and the true bytes of the bitstream.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tsuya::asset::{Component, Mesh, View};
use tsuya::image::{Mask, RgbImage};
use tsuya::paper::encode::{fit_model, sample_errors};
use tsuya::paper::{Encoded, Frame, Options, Samples, decode, encode};
use tsuya::surface::visibility::Occluders;
use tsuya::{Budget, Limits};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const COMPONENTS: [Component; 2] = [Component::Diffuse, Component::Specular];

fn main() -> Result<()> {
    let start = Instant::now();
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().map_or_else(default_capture, PathBuf::from);
    let capture = Capture::read(&folder)?;
    let frames: Vec<Frame> = (capture.views.iter().zip(&capture.pictures))
        .map(|(view, (mask, images))| Frame { view, mask: Some(mask), images })
        .collect();
    let samples = Samples::gather(&capture.mesh, &frames, 1.0);
    let visible = samples.visible();
    println!("{}: {} views, {} triangles", folder.display(), capture.views.len(), capture.mesh.triangles.len());
    println!(
        "{} patches, {} samples a view, {:.1} % of all samples visible, {} coefficients, {:.2} samples a masked pixel ({:.1} s)",
        samples.layout.patches.len(),
        samples.layout.samples_per_view(),
        100.0 * visible as f64 / (samples.layout.samples_per_view() * capture.views.len()) as f64,
        samples.coefficients(),
        visible as f64 / capture.pictures.iter().map(|(mask, _)| mask.count()).sum::<usize>() as f64,
        start.elapsed().as_secs_f64(),
    );
    let model = fit_model(&samples, &COMPONENTS);
    println!("model fitted ({:.1} s)\n", start.elapsed().as_secs_f64());
    println!(
        "PSNR on visible samples, dB; linear: peak = white; sqrt: of sqrt(x / white). bps: bits per visible sample and colour,"
    );
    println!("both components. Image: sum of both components, sqrt, on the photographs' covered pixels.\n");
    println!(
        "coefficients kept    | diffuse lin / sqrt | specular lin / sqrt | image |     bytes (model) |  bps | published"
    );
    let standard = Options::default();
    let rows = [
        (0.0, true, standard.view_levels, "< 30 (model alone)"),
        (1.5, true, standard.view_levels, ""),
        (2.0, true, standard.view_levels, ">= 40"),
        (5.0, true, standard.view_levels, ""),
        (10.0, true, standard.view_levels, ""),
        (50.0, true, standard.view_levels, ">= 80"),
        (2.4, true, standard.view_levels, "48 (with model)"),
        (2.4, false, standard.view_levels, "47 (without model)"),
        (2.1, true, standard.view_levels, "43 (3-D)"),
        (2.1, true, 0, "27 (2-D per image)"),
        (2.1, false, standard.view_levels, "43 (3-D), here without model"),
        (2.1, false, 0, "27 (2-D), here without model"),
    ];
    let only: Option<f64> = std::env::var("TSUYA_BENCH_ONLY").ok().and_then(|v| v.parse().ok());
    for (percent, modelled, view_levels, published) in rows {
        if only.is_some_and(|only| only != percent) {
            continue;
        }
        let options = Options { keep_percent: percent, view_levels, ..standard };
        let begun = Instant::now();
        let encoded = encode(&samples, &COMPONENTS, modelled.then_some(&model), &options)?;
        let encoding = begun.elapsed().as_secs_f64();
        report(&capture, &samples, &encoded, modelled, view_levels, published)?;
        if only.is_some() {
            println!("encode {encoding:.1} s, decode and compare {:.1} s", begun.elapsed().as_secs_f64() - encoding);
        }
    }
    println!("\n{:.0} s in all", start.elapsed().as_secs_f64());
    Ok(())
}

fn report(
    capture: &Capture,
    samples: &Samples,
    encoded: &Encoded,
    modelled: bool,
    view_levels: u8,
    published: &str,
) -> Result<()> {
    let budget = Budget::new(Limits::default());
    let decoded = decode(&encoded.bytes, &capture.mesh, &COMPONENTS, capture.views.len(), &budget)?;
    let errors = sample_errors(samples, &decoded, capture.white);
    let occluders = Occluders::new(&capture.mesh);
    let (mut squares, mut count) = (0.0, 0.0);
    for (index, view) in capture.views.iter().enumerate().step_by(4) {
        let picture = decoded.photograph(index, view, |x, y| {
            let hit = occluders.first_hit(&view.camera, [x as f64 + 0.5, y as f64 + 0.5])?;
            Some((hit.triangle, hit.barycentric))
        });
        let (mask, images) = &capture.pictures[index];
        for i in (0..mask.data.len()).filter(|&i| mask.data[i] && picture.mask.data[i]) {
            for c in 0..3 {
                let signal = |x: f32| (x.max(0.0) as f64 / capture.white[c]).sqrt();
                let measured = signal(images[0].data[i][c]).powi(2) + signal(images[1].data[i][c]).powi(2);
                let found = signal(picture.images[0].data[i][c]).powi(2) + signal(picture.images[1].data[i][c]).powi(2);
                squares += (measured.sqrt() - found.sqrt()).powi(2);
                count += 1.0;
            }
        }
    }
    let image = -10.0 * (squares / f64::max(count, 1.0)).log10();
    println!(
        "{:6.3} % {:5} {:6} |      {:5.1} / {:5.1} |       {:5.1} / {:5.1} | {:5.1} | {:9} ({:6}) | {:4.2} | {published}",
        encoded.kept_percent(),
        if modelled { "model" } else { "none" },
        if view_levels > 0 { "3-D" } else { "2-D" },
        errors[0].linear_db,
        errors[0].sqrt_db,
        errors[1].linear_db,
        errors[1].sqrt_db,
        image,
        encoded.bytes.len(),
        encoded.model_bytes,
        8.0 * encoded.bytes.len() as f64 / (samples.visible() * 3).max(1) as f64,
    );
    Ok(())
}

fn default_capture() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let data = std::env::var_os("TSUYA_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let ring = data.join("captures/bunny-ring");
    if ring.is_dir() { ring } else { root.join("tests/data/sample-spot") }
}

/// A polarised capture in memory.
struct Capture {
    mesh: Mesh,
    views: Vec<View>,
    white: [f64; 3],
    pictures: Vec<(Mask, Vec<RgbImage>)>,
}

impl Capture {
    fn read(folder: &Path) -> Result<Capture> {
        let mut capture = tsuya::capture::read(folder, &Default::default())?;
        let observations = tsuya::separate::separate(&mut capture)?;
        if observations.components != COMPONENTS {
            return Err(format!("{}: photographs with and without polarisers are needed", folder.display()).into());
        }
        let (mut views, mut pictures) = (Vec::new(), Vec::new());
        for frame in observations.frames {
            let mask = frame.mask.ok_or_else(|| format!("{}: a mask is needed", frame.view.name))?;
            views.push(frame.view);
            pictures.push((mask, frame.images));
        }
        Ok(Capture { mesh: capture.mesh, views, white: observations.white, pictures })
    }
}
