//! What an image file says about its colours: ICC profiles, PNG's chunks, chromaticities; as curves and a matrix to linear Rec. 709.

use crate::image::from_srgb;
use crate::input::escaped;
use glam::{DMat3, DVec2, DVec3};
use moxcms::{ColorProfile, DataColorSpace, ParsingOptions, ProfileText, ToneReprCurve};

/// Bytes of an ICC profile, and entries of its curves and tables, at most. Those of printers, which are larger, would not be applied.
pub(super) const MAX_PROFILE_BYTES: usize = 1 << 20;
const MAX_TABLE_ENTRIES: usize = 1 << 18;
/// Memory of reading a profile, of its curves and of what is made of them.
pub(super) const MEMORY_BYTES: u64 = 4 << 20;
/// Curves and matrices that differ less from sRGB's are taken for them.
const SAME_CURVE: f64 = 1e-3;
const SAME_MATRIX: f64 = 2e-3;

/// The white of the profile connection space (ICC.1:2022, 7.2.16).
const D50: DVec3 = DVec3::new(0.9642, 1.0, 0.8249);

/// Chromaticities of red, green, blue and white.
pub(super) type Chromaticities = [[f64; 2]; 4];
pub(super) const REC709: Chromaticities = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]];
const P3_D65: Chromaticities = [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], [0.3127, 0.3290]];
const P3_DCI: Chromaticities = [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], [0.314, 0.351]];
const REC2020: Chromaticities = [[0.708, 0.292], [0.170, 0.797], [0.131, 0.046], [0.3127, 0.3290]];
const REC601_625: Chromaticities = [[0.64, 0.33], [0.29, 0.60], [0.15, 0.06], [0.3127, 0.3290]];
const REC601_525: Chromaticities = [[0.630, 0.340], [0.310, 0.595], [0.155, 0.070], [0.3127, 0.3290]];

/// The curve from a stored value, 0 to 1, to a linear one.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Curve {
    Srgb,
    /// Rec. 709's camera curve, reversed.
    Rec709,
    Power(f64),
    /// ICC's parametric curve of type 4 (ICC.1:2022, 10.18): `(a x + b)^g + e` from `d` on, `c x + f` below.
    Parametric {
        g: f64,
        a: f64,
        b: f64,
        c: f64,
        d: f64,
        e: f64,
        f: f64,
    },
    /// Values at equal steps, 65535 for 1.
    Table(Vec<u16>),
}

impl Curve {
    pub(super) fn linear(&self, x: f64) -> f64 {
        match self {
            Curve::Srgb => from_srgb(x),
            Curve::Rec709 if x < 0.081 => x / 4.5,
            Curve::Rec709 => ((x + 0.099) / 1.099).powf(1.0 / 0.45),
            Curve::Power(exponent) => x.powf(*exponent),
            &Curve::Parametric { g, a, b, d, e, .. } if x >= d => (a * x + b).max(0.0).powf(g) + e,
            Curve::Parametric { c, f, .. } => c * x + f,
            Curve::Table(values) => {
                let position = x * (values.len() - 1) as f64;
                let k = (position as usize).min(values.len().saturating_sub(2));
                let [from, to] = [k, k + 1].map(|k| f64::from(values[k.min(values.len() - 1)]) / 65535.0);
                from + (to - from) * (position - k as f64)
            }
        }
    }

    fn from_icc(curve: &ToneReprCurve) -> Option<Self> {
        Some(match curve {
            ToneReprCurve::Lut(values) => match values[..] {
                [] => Curve::Power(1.0),
                // An exponent with eight bits behind the point.
                [exponent] => Curve::Power(f64::from(exponent) / 256.0),
                _ => Curve::Table(values.clone()),
            },
            ToneReprCurve::Parametric(numbers) => {
                let numbers: Vec<f64> = numbers.iter().map(|&v| f64::from(v)).collect();
                let curve = |g, a, b, c, d, e, f| Curve::Parametric { g, a, b, c, d, e, f };
                match numbers[..] {
                    [g] => Curve::Power(g),
                    [g, a, b] if a != 0.0 => curve(g, a, b, 0.0, -b / a, 0.0, 0.0),
                    [g, a, b, c] if a != 0.0 => curve(g, a, b, 0.0, -b / a, c, c),
                    [g, a, b, c, d] => curve(g, a, b, c, d, 0.0, 0.0),
                    [g, a, b, c, d, e, f] => curve(g, a, b, c, d, e, f),
                    _ => return None,
                }
            }
        })
    }

    pub(super) fn is_like(&self, other: &Curve) -> bool {
        (0..=64).map(|k| f64::from(k) / 64.0).all(|x| (self.linear(x) - other.linear(x)).abs() < SAME_CURVE)
    }
}

/// What a file says about its colours.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum FileColour {
    /// Nothing, or the usual: sRGB for integers, linear Rec. 709 for floats.
    Usual,
    /// A space that can be converted.
    Space(Box<FileColourSpace>),
    /// The name of a space that can't, and why.
    Unknown(String, String),
}

/// A space of three curves, and a matrix from its linear values to Rec. 709's.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FileColourSpace {
    /// Its name for messages.
    pub name: String,
    /// Curves of red, green and blue; `None` if all are sRGB's.
    pub curves: Option<[Curve; 3]>,
    /// `None` if the primaries are those of Rec. 709.
    pub to_rec709: Option<DMat3>,
}

impl FileColour {
    fn new(name: String, curves: Option<[Curve; 3]>, to_rec709: Option<DMat3>) -> Self {
        let curves = curves.filter(|curves| curves.iter().any(|curve| !curve.is_like(&Curve::Srgb)));
        let to_rec709 = to_rec709.filter(|matrix| !matrix.abs_diff_eq(DMat3::IDENTITY, SAME_MATRIX));
        let finite = to_rec709.is_none_or(|matrix| matrix.is_finite())
            && curves.iter().flatten().all(|curve| (0..=8).all(|k| curve.linear(f64::from(k) / 8.0).is_finite()));
        match (finite, &curves, &to_rec709) {
            (false, ..) => FileColour::Unknown(name, "its numbers are no colours".into()),
            (true, None, None) => FileColour::Usual,
            _ => FileColour::Space(Box::new(FileColourSpace { name, curves, to_rec709 })),
        }
    }

    /// Of an ICC profile: three curves and three colorants, or a curve of greys.
    pub(super) fn from_icc(bytes: &[u8]) -> Self {
        let unknown = |name: &str, why: &str| FileColour::Unknown(name.into(), why.into());
        if bytes.len() > MAX_PROFILE_BYTES {
            return unknown("ICC profile", &format!("it has {} bytes", bytes.len()));
        }
        let options = ParsingOptions {
            max_profile_size: MAX_PROFILE_BYTES + 1,
            max_allowed_clut_size: MAX_TABLE_ENTRIES,
            max_allowed_trc_size: MAX_TABLE_ENTRIES,
        };
        let profile = match ColorProfile::new_from_slice_with_options(bytes, options) {
            Ok(profile) => profile,
            Err(error) => return unknown("ICC profile", &format!("it is damaged or too large: {error}")),
        };
        let name = format!("ICC profile \"{}\"", escaped(description(&profile)));
        let curve = |curve: &Option<ToneReprCurve>| curve.as_ref().and_then(Curve::from_icc);
        match profile.color_space {
            DataColorSpace::Gray => match curve(&profile.gray_trc) {
                Some(grey) => FileColour::new(name, Some(std::array::from_fn(|_| grey.clone())), None),
                None => unknown(&name, "it has no curve"),
            },
            DataColorSpace::Rgb => {
                let curves = [&profile.red_trc, &profile.green_trc, &profile.blue_trc].map(curve);
                let colorants = [profile.red_colorant, profile.green_colorant, profile.blue_colorant];
                let [x, y, z] = colorants.map(|c| DVec3::new(c.x, c.y, c.z));
                let to_d50 = DMat3::from_cols(x, y, z);
                match curves {
                    [Some(red), Some(green), Some(blue)] if to_d50.determinant().abs() > 1e-6 => {
                        let matrix = to_xyz_d50(&REC709).map(|rec709| rec709.inverse() * to_d50);
                        FileColour::new(name, Some([red, green, blue]), matrix)
                    }
                    _ => unknown(&name, "it has tables instead of curves and colorants"),
                }
            }
            other => unknown(&name, &format!("it is of {other:?}, not of red, green and blue")),
        }
    }

    /// Of primaries and a curve that is the same for all.
    pub(super) fn from_primaries(name: &str, primaries: &Chromaticities, curve: Option<Curve>) -> Self {
        let Some(matrix) = to_rec709(primaries) else {
            return FileColour::Unknown(name.into(), "its chromaticities are no triangle".into());
        };
        FileColour::new(name.into(), curve.map(|curve| std::array::from_fn(|_| curve.clone())), Some(matrix))
    }

    /// Of code points (ITU-T H.273, tables 2 to 4), as in PNG's chunk cICP.
    pub(super) fn from_code_points([primaries, transfer, matrix, full]: [u8; 4]) -> Self {
        let name = format!("cICP chunk {primaries}/{transfer}/{matrix}/{full}");
        let chromaticities = match primaries {
            1 | 2 => &REC709,
            5 => &REC601_625,
            6 | 7 => &REC601_525,
            9 => &REC2020,
            11 => &P3_DCI,
            12 => &P3_D65,
            _ => return FileColour::Unknown(name, "its primaries are not known".into()),
        };
        let curve = match transfer {
            2 | 13 => Curve::Srgb,
            1 | 6 | 14 | 15 => Curve::Rec709,
            4 => Curve::Power(2.2),
            5 => Curve::Power(2.8),
            8 => Curve::Power(1.0),
            16 | 18 => return FileColour::Unknown(name, "PQ and HLG are not read".into()),
            _ => return FileColour::Unknown(name, "its transfer function is not known".into()),
        };
        if matrix != 0 || full != 1 {
            return FileColour::Unknown(name, "it is not of full-range red, green and blue".into());
        }
        FileColour::from_primaries(&name, chromaticities, Some(curve))
    }

    /// Of PNG's chunks gAMA and cHRM. A gamma of 1/2.2 stands for sRGB's curve (PNG, 13.13).
    pub(super) fn from_png_gamma(gamma: Option<f64>, primaries: Option<&Chromaticities>) -> Self {
        let curve = match gamma {
            Some(gamma) if (gamma * 2.2 - 1.0).abs() < 0.01 => Some(Curve::Srgb),
            Some(gamma) if (0.01..=10.0).contains(&gamma) => Some(Curve::Power(1.0 / gamma)),
            Some(gamma) => return FileColour::Unknown("gAMA chunk".into(), format!("its gamma is {gamma}")),
            None => None,
        };
        let name = if primaries.is_some() { "gAMA and cHRM chunks" } else { "gAMA chunk" };
        FileColour::from_primaries(name, primaries.unwrap_or(&REC709), curve)
    }
}

fn description(profile: &ColorProfile) -> &str {
    match &profile.description {
        Some(ProfileText::PlainString(text)) => text,
        Some(ProfileText::Localizable(texts)) => texts.first().map_or("", |text| &text.value),
        Some(ProfileText::Description(text)) => &text.ascii_string,
        None => "without a name",
    }
}

/// The matrix from linear values of some primaries to Rec. 709's, white to white; `None` for chromaticities that are no triangle.
pub(super) fn to_rec709(primaries: &Chromaticities) -> Option<DMat3> {
    Some(to_xyz_d50(&REC709)?.inverse() * to_xyz_d50(primaries)?)
}

/// The matrix from linear values to XYZ under D50 (SMPTE RP 177), white adapted by Bradford's matrix (ICC.1:2022, annex E).
fn to_xyz_d50(primaries: &Chromaticities) -> Option<DMat3> {
    let xyz = |[x, y]: [f64; 2]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
    let [red, green, blue, white] = primaries.map(xyz);
    let [r, g, b, _] = primaries.map(DVec2::from_array);
    let columns = DMat3::from_cols(red, green, blue);
    if !columns.is_finite() || !white.is_finite() || (g - r).perp_dot(b - r).abs() < 1e-4 {
        return None;
    }
    let scaled = columns * DMat3::from_diagonal(columns.inverse() * white);
    let bradford = DMat3::from_cols(
        DVec3::new(0.8951, -0.7502, 0.0389),
        DVec3::new(0.2664, 1.7135, -0.0685),
        DVec3::new(-0.1614, 0.0367, 1.0296),
    );
    let gain = (bradford * D50) / (bradford * white);
    Some(bradford.inverse() * DMat3::from_diagonal(gain) * bradford * scaled).filter(|matrix| matrix.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_spaces_by_every_way() {
        // Lindbloom's sRGB matrix under D50.
        let srgb = to_xyz_d50(&REC709).unwrap();
        assert!((srgb.x_axis - DVec3::new(0.43607, 0.22250, 0.01393)).length() < 3e-4, "{srgb}");
        // Rec. 2020 to Rec. 709 (ITU-R BT.2087).
        let wide = to_rec709(&REC2020).unwrap();
        assert!((wide.x_axis - DVec3::new(1.6605, -0.1246, -0.0182)).length() < 1e-3, "{wide}");
        assert_eq!(FileColour::from_code_points([1, 13, 0, 1]), FileColour::Usual);
        assert_eq!(FileColour::from_png_gamma(Some(0.45455), Some(&REC709)), FileColour::Usual);
        let FileColour::Space(linear) = FileColour::from_png_gamma(Some(1.0), None) else { panic!() };
        assert_eq!((linear.curves.unwrap()[0].linear(0.25), linear.to_rec709), (0.25, None));
        let FileColour::Space(p3) = FileColour::from_code_points([12, 13, 0, 1]) else { panic!() };
        assert!(p3.curves.is_none() && p3.to_rec709.is_some_and(|m| (m * DVec3::ONE - DVec3::ONE).length() < 1e-9));
        for points in [[9, 16, 0, 1], [9, 18, 0, 1], [1, 13, 1, 1], [1, 13, 0, 0], [77, 13, 0, 1], [1, 77, 0, 1]] {
            assert!(matches!(FileColour::from_code_points(points), FileColour::Unknown(..)), "{points:?}");
        }
        let flat = [[0.3, 0.3], [0.4, 0.4], [0.5, 0.5], [0.3127, 0.329]];
        assert!(matches!(FileColour::from_primaries("EXR", &flat, None), FileColour::Unknown(..)));
    }

    #[test]
    fn profiles_and_damaged_ones() {
        let encoded = |profile: ColorProfile| profile.encode().unwrap();
        assert_eq!(FileColour::from_icc(&encoded(ColorProfile::new_srgb())), FileColour::Usual);
        let FileColour::Space(adobe) = FileColour::from_icc(&encoded(ColorProfile::new_adobe_rgb())) else { panic!() };
        assert!((adobe.curves.unwrap()[1].linear(0.5) - 0.5f64.powf(2.199_218_75)).abs() < 1e-4);
        // Adobe RGB (1998): red and blue have Rec. 709's chromaticities, green lies outside.
        let matrix = adobe.to_rec709.unwrap();
        assert!((matrix * DVec3::ONE - DVec3::ONE).length() < 2e-3 && matrix.x_axis.x > 1.39, "{matrix}");
        let FileColour::Space(grey) = FileColour::from_icc(&encoded(ColorProfile::new_gray_with_gamma(1.0))) else {
            panic!()
        };
        assert_eq!(grey.curves.unwrap()[0].linear(0.25), 0.25);
        let bytes = encoded(ColorProfile::new_display_p3());
        for at in 0..bytes.len() {
            for value in [0, 0x7f, 0xff, bytes[at] ^ 1] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                if let FileColour::Space(space) = FileColour::from_icc(&damaged) {
                    assert!(space.to_rec709.is_none_or(|matrix| matrix.is_finite()));
                }
            }
            let _ = FileColour::from_icc(&bytes[..at]);
        }
    }
}
