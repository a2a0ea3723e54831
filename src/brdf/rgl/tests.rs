use super::*;
use crate::brdf::test_data::shared;

fn direction([x, y]: [f64; 2]) -> [f64; 3] {
    [x, y, (1.0 - x * x - y * y).sqrt()]
}

#[test]
fn values_are_those_of_another_reader() {
    // BRDF times cosine, by plugin `measured` of Mitsuba 3.9 (single precision).
    let known = [
        ("paper_white_rgb.bsdf", [0.3, 0.2], [-0.25, -0.25], [0.250682, 0.254416, 0.296566]),
        ("paper_white_rgb.bsdf", [0.7, 0.1], [-0.2, 0.6], [0.204956, 0.207562, 0.24107]),
        ("paper_white_rgb.bsdf", [0.0, 0.9], [0.1, -0.85], [0.185539, 0.184986, 0.202911]),
        ("paper_white_rgb.bsdf", [0.05, 0.0], [0.5, 0.5], [0.18186, 0.185179, 0.218095]),
        ("ilm_solo_m_68_rgb.bsdf", [0.3, 0.2], [-0.25, -0.25], [0.00620386, 0.0311915, 0.156771]),
        ("ilm_solo_m_68_rgb.bsdf", [0.7, 0.1], [-0.2, 0.6], [0.000142126, -0.000202264, 0.00283529]),
        ("ilm_solo_m_68_rgb.bsdf", [0.0, 0.9], [0.1, -0.85], [0.00616492, 0.0065851, 0.0600495]),
        ("ilm_solo_m_68_rgb.bsdf", [0.05, 0.0], [0.5, 0.5], [7.49203e-05, 1.96248e-05, 0.00364952]),
        ("cg_sunflower_rgb.bsdf", [0.3, 0.2], [-0.25, -0.25], [0.272632, 0.210206, 0.14855]),
        ("cg_sunflower_rgb.bsdf", [0.7, 0.1], [-0.2, 0.6], [0.211581, 0.0988049, -0.00731193]),
        ("cg_sunflower_rgb.bsdf", [0.0, 0.9], [0.1, -0.85], [0.141084, 0.0744063, 0.0061977]),
        ("cg_sunflower_rgb.bsdf", [0.05, 0.0], [0.5, 0.5], [0.188426, 0.0872691, -0.00734985]),
    ];
    for (name, incoming, outgoing, expected) in known {
        let Some(path) = shared(&format!("brdf/rgl/{name}")) else { return };
        let material = RglMaterial::read(path, &Default::default()).unwrap();
        assert!(!material.description().is_empty());
        let (incoming, outgoing) = (direction(incoming), direction(outgoing));
        let found = material.evaluate(incoming, outgoing).map(|x| x * outgoing[2]);
        for c in 0..3 {
            let expected = f64::max(expected[c], 0.0);
            assert!((found[c] - expected).abs() < 1e-4 * expected + 1e-6, "{name}: {found:?} {expected}");
        }
        assert_eq!(material.evaluate(incoming, [0.6, 0.0, -0.8]), [0.0; 3]);
    }
}

#[test]
fn paper_is_nearly_reciprocal_and_made_so() {
    let Some(path) = shared("brdf/rgl/paper_white_rgb.bsdf") else { return };
    let material = RglMaterial::read(path, &Default::default()).unwrap();
    let (a, b) = (direction([0.7, 0.1]), direction([-0.2, 0.3]));
    let (there, back) = (material.evaluate(a, b), material.evaluate(b, a));
    assert!((there[1] / back[1] - 1.0).abs() < 0.05, "{there:?} {back:?}");
    let reciprocal = material.reciprocal();
    assert_eq!(reciprocal.evaluate(a, b), reciprocal.evaluate(b, a));
}

/// A small material: 2 elevations, everything else on 2 x 2 corners.
fn small() -> Vec<u8> {
    let fields: [(&str, u8, &[u64]); 9] = [
        ("description", 1, &[4]),
        ("phi_i", 10, &[1]),
        ("theta_i", 10, &[2]),
        ("ndf", 10, &[2, 2]),
        ("sigma", 10, &[2, 2]),
        ("vndf", 10, &[1, 2, 2, 2]),
        ("luminance", 10, &[1, 2, 2, 2]),
        ("rgb", 10, &[1, 2, 3, 2, 2]),
        ("jacobian", 1, &[1]),
    ];
    let header: usize = fields.iter().map(|(name, _, shape)| 13 + name.len() + 8 * shape.len()).sum();
    let mut bytes = b"tensor_file\0\x01\x00".to_vec();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let mut data = Vec::new();
    for (name, kind, shape) in fields {
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend((shape.len() as u16).to_le_bytes());
        bytes.push(kind);
        bytes.extend(((18 + header + data.len()) as u64).to_le_bytes());
        shape.iter().for_each(|length| bytes.extend(length.to_le_bytes()));
        for k in 0..shape.iter().product::<u64>() {
            match name {
                "description" => data.push(b'x'),
                "jacobian" => data.push(1),
                "theta_i" => data.extend((k as f32).to_le_bytes()),
                _ => data.extend(1f32.to_le_bytes()),
            }
        }
    }
    bytes.extend(data);
    bytes
}

#[test]
fn damaged_files_are_named() {
    let bytes = small();
    let material = RglMaterial::from_bytes(&bytes, "x.bsdf").unwrap();
    let value = material.evaluate(direction([0.3, 0.0]), direction([0.0, 0.6]));
    assert!(value.iter().all(|x| (x - 0.25 / 0.8).abs() < 1e-12), "{value:?}");
    let complaint = |bytes: &[u8]| RglMaterial::from_bytes(bytes, "x.bsdf").unwrap_err().to_string();
    for length in 0..bytes.len() {
        let said = complaint(&bytes[..length]);
        assert!(said.starts_with("x.bsdf: ") && (said.contains("cut off") || said.contains("ends after")), "{said}");
    }
    let changed = |at: usize, with: &[u8]| {
        let mut bytes = bytes.clone();
        bytes[at..at + with.len()].copy_from_slice(with);
        complaint(&bytes)
    };
    assert!(changed(0, b"T").contains("not a tensor file"));
    assert!(changed(12, &[2]).contains("version"));
    assert!(changed(14, &[0, 0, 0, 9]).contains("big-endian"));
    let place = |name: &[u8]| bytes.windows(name.len()).position(|window| window == name).unwrap();
    let header = place(b"rgb") + 3;
    assert!(changed(place(b"rgb"), b"xyz").contains("field rgb is missing"));
    assert!(changed(header, &[99]).contains("99 dimensions"));
    assert!(changed(header + 2, &[77]).contains("no such type"));
    assert!(changed(header + 3, &[255; 8]).contains("ends after"));
    assert!(changed(header + 11 + 8, &[255; 8]).contains("ends after"));
    assert!(changed(header + 11 + 8, &[1]).contains("shape"));
    assert!(changed(bytes.len() - 5, &f32::NAN.to_le_bytes()).contains("not finite"));
    assert!(changed(bytes.len() - 5, &[0, 0, 0x7f, 0x7f]).contains("damaged"));
}

#[test]
fn the_warp_and_its_inverse_meet() {
    // Density 4 x y on one patch: marginal y^2, conditional x^2.
    let warp = MarginalWarp::new(vec![0.0, 0.0, 0.0, 4.0], 2, 2, 1, true).unwrap();
    let found = warp.invert([0.5, 0.3], [0, 0], 0.0);
    assert!((found[0] - 0.25).abs() < 1e-12 && (found[1] - 0.09).abs() < 1e-12, "{found:?}");
    assert!((warp.evaluate([0.5, 0.3], [0, 0], 0.0) - 0.6).abs() < 1e-12);
}
