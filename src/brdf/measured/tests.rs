use super::*;
use crate::brdf::{Brdf, BrdfSample, FittedBrdf};
use crate::brdf::{BrdfForm, ClassicalForm, ClassicalLobe, ClassicalModel, FitSettings, Population, fit_samples};

fn read(text: &str) -> Result<MeasuredSamples> {
    MeasuredSamples::from_text(text, Path::new("a.csv"), &FileAccess::default())
}

fn fault(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

#[test]
fn one_sample_is_read_from_every_dialect() {
    let expected = read("wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,r,g,b\n0.6,0,0.8,0,-3,4,0.1,0.2,0.3\n").unwrap();
    assert!(expected.remarks.is_empty(), "{:?}", expected.remarks);
    let sample = expected.samples[0];
    assert_eq!(sample.value, [0.1, 0.2, 0.3]);
    let angle = 0.6f64.asin().to_degrees();
    let comma = format!("{angle:.12}").replace('.', ",");
    for text in [
        format!("b,g,r,phi_o,theta_o,phi_i,theta_i\n0.3,0.2,0.1,-90,{angle},0,{angle}"),
        format!("\u{feff}theta_i;phi_i;theta_o;phi_o;r;g;b\r\n{comma};0;{comma};270,0;0,1;0,2;0,3\r\n"),
        format!("# theta_i phi_i theta_o phi_o r g b\n{angle} 0 -{angle} 90 0.1 0.2 1e-1\n").replace("1e-1", "3e-1"),
        format!("theta_i (rad)\tphi_i_rad\ttheta_r\tphi_r\tr\tg\tb\n{}\t0\t{angle}\t-90\t0.1\t0.2\t0.3", 0.6f64.asin()),
        format!(r#"[{{"theta_i":{angle},"phi_i":0,"theta_o":{angle},"phi_o":-90,"r":0.1,"g":0.2,"b":0.3}}]"#),
        r#"{"name":"x","samples":[{"wi_x":3,"wi_y":0,"wi_z":4,"wo_x":0,"wo_y":-3,"wo_z":4,"r":0.1,"g":0.2,"b":0.3}]}"#
            .into(),
    ] {
        let found = read(&text).unwrap();
        let [one] = found.samples[..] else { panic!("{text}") };
        for k in 0..3 {
            assert!((one.incoming[k] - sample.incoming[k]).abs() < 1e-9, "{text}: {one:?}");
            assert!((one.outgoing[k] - sample.outgoing[k]).abs() < 1e-9, "{text}: {one:?}");
        }
        assert_eq!(one.value, sample.value, "{text}");
    }
}

#[test]
fn repeats_gaps_and_noise() {
    let rows = "theta_i,phi_i,theta_o,phi_o,value,lot\n10,0,20,90,0.100,a\n10,0,20,90,0.120,b\n30,0,20,90,,c\n95,0,20,90,0.1,d\n\
                10,0,20,90,0.110,e\n40,0,20,90,-0.001,f\n";
    let found = read(rows).unwrap();
    assert_eq!((found.samples.len(), found.measured, found.gaps, found.below_horizon), (2, 4, 1, 1));
    assert!((found.samples[0].value[1] - 0.11).abs() < 1e-12 && found.samples[1].value == [0.0; 3]);
    // The repeats differ by 9 %; 2 % are assumed as if three more said so.
    assert_eq!(found.noise_source, NoiseSource::Repeats);
    assert!((0.05..0.09).contains(&found.relative_noise), "{}", found.relative_noise);
    let said = found.remarks.join("\n");
    for part in [
        "a.csv: columns of no meaning here, not used: \"lot\"",
        "1 of 6 rows have no value",
        "1 of 6 rows are left out",
        "negative",
    ] {
        assert!(said.contains(part), "{said}");
    }
    let stated =
        read("theta_i,phi_i,theta_o,phi_o,value,sigma,noise\n10,0,20,90,0.5000,0.03,0.02\n20,0,20,90,0.5,0.03,\n")
            .unwrap();
    assert_eq!(stated.noise_source, NoiseSource::Stated);
    assert!(
        (stated.samples[0].deviation[0] - 0.025).abs() < 1e-4 && (stated.samples[1].deviation[0] - 0.015).abs() < 1e-4
    );
    // What is rounded to hundredths may be wrong by half of one.
    let rounded = read("theta_i,phi_i,theta_o,phi_o,value,sigma\n10,0,20,90,0.01,0\n").unwrap();
    assert!((rounded.samples[0].deviation[0] - 0.01 / 12f64.sqrt()).abs() < 1e-12);
}

#[test]
fn spectra_become_colours() {
    let wavelengths: Vec<String> = (400..=700).step_by(20).map(|w| format!("{w}nm")).collect();
    let cells = |of: &dyn Fn(f64) -> f64| {
        (400..=700).step_by(20).map(|w| format!("{}", of(w as f64))).collect::<Vec<_>>().join(",")
    };
    let text = format!(
        "theta_i,phi_i,theta_o,phi_o,{}\n10,0,20,90,{}\n30,0,20,90,{}\n",
        wavelengths.join(","),
        cells(&|_| 0.25),
        cells(&|w| if w > 580.0 { 0.3 } else { 0.01 })
    );
    let found = read(&text).unwrap();
    assert!(found.samples[0].value.iter().all(|v| (v - 0.25).abs() < 1e-12));
    let [r, g, b] = found.samples[1].value;
    assert!(r > 0.25 && g < 0.1 && b < 0.02, "{:?}", found.samples[1].value);
    assert!(found.remarks[0].contains("CIE 1931") && found.remarks[0].contains("D65"), "{:?}", found.remarks);
}

#[test]
fn faults_name_the_line_and_what_to_do() {
    let names = "theta_i,phi_i,theta_o,phi_o,r,g,b\n";
    for (text, expected) in [
        ("".into(), "line 1: no row of names"),
        ("10,0,20,0,1,1,1".into(), "line 1: the first row names the columns"),
        (
            format!("{names}10,0,20,0,0,1,0,2,0,3"),
            "line 2: 10 cells, 7 columns are named; where numbers have decimal commas",
        ),
        (format!("{names}\n10,0,20,0,0.1,0.2,red"), "line 3: \"red\" is not a number"),
        (format!("{names},0,20,0,0.1,0.2,0.3"), "line 2: a value without a direction"),
        (format!("{names}10,0,2000,0,0.1,0.2,0.3"), "line 2: 2000 is not an angle"),
        (format!("{names}10,0,20,0,1e10,0.2,0.3"), "line 2: a BRDF per steradian"),
        (format!("{names}10,0,20,0,,,"), "no value is above the horizon: 1 rows without a value"),
        ("theta_i,phi_i,theta_o,r,g,b\n1,2,3,4,5,6".into(), "line 1: of the directions phi_o is missing"),
        ("theta_i,phi_i,theta_o,phi_o\n1,2,3,4".into(), "line 1: no column of values"),
        ("theta_i,phi_i,theta_o,phi_o,r,g\n1,2,3,4,5,6".into(), "line 1: of the colours b is missing"),
        ("theta_i,phi_i,theta_o,phi_o,450,500\n1,2,3,4,5,6".into(), "line 1: 2 wavelengths, 3 or more"),
        ("theta_i,phi_i,theta_o,phi_o,value,sigma\n1,2,3,4,5,-1".into(), "line 2: noise of -1"),
        ("theta_i;phi_i;theta_o;phi_o;value\n1;2;3;4;1,234".into(), "line 2: \"1,234\": the comma may be"),
        (
            "theta_i;phi_i;theta_o;phi_o;value\n1,5;2;3;4;0.5".into(),
            "line 2: \"1,5\": decimal commas and decimal points",
        ),
        ("[1]".into(), "sample 1: not an object"),
        ("{}".into(), "a list `samples`"),
        (r#"[{"theta_i":1,"phi_i":1,"theta_o":1,"phi_o":1,"value":"x"}]"#.into(), "sample 1: \"x\" is not a number"),
        (r#"[{"theta_i":1},{"phi_i":1}]"#.into(), "sample 2: it has other fields"),
    ] {
        let said = fault(&text);
        assert!(said.starts_with("a.csv: ") && said.contains(expected), "{text}: {said}");
    }
    let both = "theta_i,phi_i,theta_o,phi_o,wi_x,wi_y,wi_z,wo_x,wo_y,wo_z,value\n10,0,20,0,0,0,1,0,0,1,0.3";
    assert!(fault(both).contains("line 2: the vectors and the angles are different directions"));
    let radians = read(&format!("{names}{}", "0.5,0,0.2,1.5,1,1,1\n0.1,0,1.2,1.5,1,1,1\n".repeat(2))).unwrap();
    assert!(radians.remarks.iter().any(|remark| remark.contains("radians")), "{:?}", radians.remarks);
}

/// Samples of a material at directions as even as can be, with azimuths of the surface.
fn scattered(material: &impl Brdf, count: usize) -> Vec<MeasuredSample> {
    let part = |n: usize, k: i32| (0.5 + n as f64 * 1.112_775_684_278_706f64.powi(-k)).fract();
    let sample = |n: usize| {
        let incoming = vector_of_angles(1.3 * part(n, 1), 6.3 * part(n, 2));
        let outgoing = vector_of_angles(1.3 * part(n, 3), 6.3 * part(n, 4));
        let value = material.evaluate(incoming, outgoing);
        MeasuredSample { incoming, outgoing, value, deviation: value.map(|v| 0.01 * v) }
    };
    (0..count).map(sample).collect()
}

#[test]
fn every_form_fits_scattered_samples() {
    let prior = Population::of_classical_models().prior().unwrap();
    let lobe = ClassicalLobe::CookTorranceGgx { roughness: 0.3, reflectance: 0.05 };
    let made = ClassicalModel { diffuse: [0.3, 0.2, 0.1], specular: [0.8; 3], lobe };
    let samples = scattered(&made, 40);
    let settings = FitSettings::default();
    for form in BrdfForm::all() {
        let fit = fit_measured(&samples, &prior, form, &settings);
        if form == BrdfForm::Dsbrdf {
            let said = fit.unwrap_err().to_string();
            assert!(
                said.contains("takes 6 half angles from 5 degrees on") && said.contains("option `slices`"),
                "{said}"
            );
            let mut few = settings;
            (few.dsbrdf.slices, few.dsbrdf.lobes) = (2, crate::brdf::LobeCount::Given(1));
            assert!(fit_measured(&samples, &prior, form, &few).unwrap().log_rmse_at_samples < 0.2);
            continue;
        }
        let fit = fit.unwrap();
        let most = if form == BrdfForm::Classical(ClassicalForm::Lambert) { 0.2 } else { 0.05 };
        assert!(fit.log_rmse_at_samples < most, "{}: {fit:?}", form.name());
        assert!(fit.expected_log_rmse > 0.0 && fit.expected_log_rmse < 1.0, "{}: {fit:?}", form.name());
    }
    // Two widths come out of the actual azimuths.
    let lobe = ClassicalLobe::WardAnisotropic { roughness: [0.2, 0.5] };
    let brushed = ClassicalModel { lobe, ..made };
    let form = BrdfForm::Classical(ClassicalForm::WardAnisotropic);
    let fit = fit_measured(&scattered(&brushed, 200), &prior, form, &settings).unwrap();
    let FittedBrdf::Classical(ClassicalModel { lobe: ClassicalLobe::WardAnisotropic { roughness }, .. }) = fit.fitted
    else {
        panic!("{fit:?}")
    };
    assert!((roughness[0] / 0.2 - 1.0).abs() < 0.05 && (roughness[1] / 0.5 - 1.0).abs() < 0.05, "{roughness:?}");
    // The next directions are told apart from those that were measured, and lower the expected error.
    let posterior = prior.posterior(&samples).unwrap();
    let next = posterior.next(6).unwrap();
    assert_eq!((next.angles.len(), next.expected_log_rmse.len()), (6, 6));
    assert!(next.expected_log_rmse[5] < posterior.expected_log_rmse());
    assert!(prior.posterior(&[]).is_err() && posterior.next(1_000_000).is_err());
}

#[test]
fn plain_squares_find_a_matt_slice_exactly() {
    let made = ClassicalModel {
        diffuse: [0.6, 0.3, 0.1],
        specular: [0.02; 3],
        lobe: ClassicalLobe::BlinnPhong { exponent: 3.0 },
    };
    let samples = BrdfSample::tabulate(&made, [40, 18, 6]);
    let error = |error| {
        let mut settings = FitSettings::default();
        settings.dsbrdf.error = error;
        let FittedBrdf::Coded(fitted) = fit_samples(&samples, BrdfForm::Dsbrdf, &settings).unwrap() else { panic!() };
        let square = |s: &BrdfSample| {
            let [incoming, outgoing] = super::fit::directions(s);
            (fitted.evaluate(incoming, outgoing)[0] - s.value[0]).powi(2)
        };
        samples.iter().filter(|s| s.theta_h > 0.09).map(square).sum::<f64>()
    };
    let (relative, squares) = (error(crate::brdf::LobeError::Relative), error(crate::brdf::LobeError::Squares));
    assert!(squares <= relative, "{squares} {relative}");
}
