//! The examples of `tools/examples`, each run on bundled files.

#[path = "../tools/examples/decode_views.rs"]
#[allow(dead_code)]
mod decode_views;
#[path = "../tools/examples/embed_decoder.rs"]
#[allow(dead_code)]
mod embed_decoder;
#[path = "../tools/examples/fit_merl.rs"]
#[allow(dead_code)]
mod fit_merl;
#[path = "../tools/examples/relight_to_png.rs"]
#[allow(dead_code)]
mod relight_to_png;
#[path = "../tools/examples/write_section.rs"]
#[allow(dead_code)]
mod write_section;

use tsuya::metrics::DisplayImage;

/// Three views of the sample, 6,589 bytes.
const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/spec/vectors/ring-small.tsuya");

#[test]
fn one_view_is_decoded_from_a_part_of_the_file() {
    let (views, [read, bytes]) = decode_views::run(FILE, vec![2]).unwrap();
    assert_eq!(views.len(), 1);
    let (index, name, size, radiance) = &views[0];
    assert_eq!((*index, name.as_str(), *size), (2, "off/002.exr", [128, 128]));
    let expected = [0.3188, 0.2547, 0.1968];
    assert!(radiance.iter().zip(expected).all(|(mean, value)| (mean - value).abs() < 1e-3), "{radiance:?}");
    assert_eq!([read, bytes], [6168, 6589]);
    assert!(decode_views::run(FILE, vec![3]).unwrap_err().to_string().contains("view 3"));
}

#[test]
fn a_view_is_relit() {
    let [captured, turned] = relight_to_png::run(&std::fs::read(FILE).unwrap(), 60.0).unwrap();
    let mean = |image: &DisplayImage| {
        let sum: f64 = image.data.iter().flatten().map(|&code| f64::from(code)).sum();
        sum / (3 * image.data.len()) as f64
    };
    let [captured, turned] = [mean(&captured), mean(&turned)];
    assert!((captured - 34.8).abs() < 0.5 && (turned - 21.6).abs() < 0.5, "{captured} {turned}");
}

#[test]
fn a_view_is_decoded_from_a_stream_that_is_cut() {
    let file = std::fs::read(FILE).unwrap();
    let (photograph, received) = embed_decoder::run(&file[..], 256, 0).unwrap();
    let mask = &photograph.mask;
    assert_eq!((mask.width, mask.height, mask.count(), received, file.len()), (128, 128, 4834, 5376, 6589));
    let cut = embed_decoder::run(&file[..1000], 256, 0).unwrap_err().to_string();
    assert_eq!(cut, "the stream ends after 1000 bytes");
}

#[test]
fn a_table_is_fitted_in_three_forms() {
    let fits = fit_merl::run(&fit_merl::made_up_table()).unwrap();
    assert_eq!(fits.len(), 3);
    for ((name, bytes, error), (max_bytes, max_error)) in fits.iter().zip([(256, 0.02), (400, 0.5), (32, 0.002)]) {
        assert!(*bytes <= max_bytes && *error < max_error, "{name}: {bytes} bytes, {error}");
    }
}

#[test]
fn a_private_section_travels_with_the_file() {
    let file = std::fs::read(FILE).unwrap();
    let changed = write_section::add(&file, "1897.12").unwrap();
    assert_eq!(write_section::read(&file).unwrap(), None);
    assert_eq!(write_section::read(&changed).unwrap().as_deref(), Some("1897.12"));
    assert!(changed.len() < file.len() + 100, "{} bytes more", changed.len() - file.len());
    let decode = |bytes: &[u8]| tsuya::decode(bytes, &tsuya::DecodeOptions::default()).unwrap();
    assert_eq!(decode(&file).photographs, decode(&changed).photographs);
}
