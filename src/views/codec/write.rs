//! The encoder's half: it chooses the lattices so that no projection moves by more than a hundredth of a pixel.

use super::*;
use crate::entropy::RangeEncoder;

/// Half of what the projection of a scene point may move, in pixels: for the rotation, and for the translation.
const HALF_TOLERANCE: f64 = 0.004;
/// Largest movement of a light, relative to its distance from the nearest scene point.
const LIGHT_TOLERANCE: f64 = 1e-5;
/// Scene points that are looked at.
const POINTS: usize = 64;
/// Lags that are tried.
const MAX_LAG: usize = 8;

/// Writes the section. `scene` holds points of the object (vertices of the mesh): the coarsest lattices are chosen that move none
/// of their projections by more than 0.01 pixel.
pub fn encode(section: &ViewsSection, scene: &[[f32; 3]]) -> Result<Vec<u8>> {
    check_input(section)?;
    let quaternions: Vec<[f64; 4]> = section.views.iter().map(quaternion).collect::<Result<_>>()?;
    let stride = scene.len().div_ceil(POINTS).max(1);
    let points: Vec<[f64; 3]> = scene.iter().step_by(stride).map(|p| p.map(|x| x as f64)).collect();
    let rotation_exponent =
        ROTATION_EXPONENTS.into_iter().find(|&exponent| rotations_hold(section, &quaternions, &points, exponent));
    let rotation_exponent = rotation_exponent.unwrap_or(*ROTATION_EXPONENTS.end());
    let length_exponent = length_exponent(section, &points)?;
    let mut best: Option<Vec<u8>> = None;
    for lights_follow_camera in [true, false] {
        for light_lag in 1..=MAX_LAG {
            let header = ViewHeader { rotation_exponent, length_exponent, lights_follow_camera, light_lag };
            let bytes = write(section, &quaternions, &header)?;
            if best.as_ref().is_none_or(|best| bytes.len() < best.len()) {
                best = Some(bytes);
            }
        }
        if section.views.iter().all(|view| view.light.is_none()) {
            break;
        }
    }
    best.ok_or_else(|| Error::parameter("no views"))
}

fn check_input(section: &ViewsSection) -> Result<()> {
    let fail = |message: String| Err(Error::Parameter(message));
    if !section.white.iter().all(|w| (*w as f32).is_finite() && *w as f32 > 0.0) {
        return fail("white must be finite and above 0".into());
    }
    let mut components = section.components.clone();
    components.sort();
    components.dedup();
    if components.len() != section.components.len() || components.len() > 3 {
        return fail("a component comes twice".into());
    }
    for View { name, camera, light } in &section.views {
        let positive = camera.focal.iter().all(|f| (*f as f32).is_finite() && *f as f32 > 0.0);
        let finite = camera.principal.iter().all(|x| (*x as f32).is_finite());
        if !positive || !finite || camera.width == 0 || camera.height == 0 {
            return fail(format!("{name}: camera without pixels, or focal lengths not above 0, or not finite"));
        }
        if name.len() > MAX_NAME_BYTES {
            return fail(format!("name of a view longer than {MAX_NAME_BYTES} bytes"));
        }
        let light_is_finite = |light: &PointLight| {
            light.intensity.iter().all(|x| (*x as f32).is_finite()) && light.position.iter().all(|x| x.is_finite())
        };
        if !camera.translation.iter().all(|x| x.is_finite()) || !light.as_ref().is_none_or(light_is_finite) {
            return fail(format!("{name}: camera or light not finite"));
        }
    }
    Ok(())
}

/// Unit quaternion of a view's rotation.
fn quaternion(view: &View) -> Result<[f64; 4]> {
    let r = &view.camera.rotation;
    // Four times the square of each component; the largest is safe to divide by.
    let squares = [
        1.0 + r[0][0] + r[1][1] + r[2][2],
        1.0 + r[0][0] - r[1][1] - r[2][2],
        1.0 - r[0][0] + r[1][1] - r[2][2],
        1.0 - r[0][0] - r[1][1] + r[2][2],
    ];
    let largest = (0..4).max_by(|&a, &b| squares[a].total_cmp(&squares[b])).unwrap_or(0);
    let (xw, yw, zw) = (r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]);
    let (xy, xz, yz) = (r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]);
    let row = match largest {
        0 => [squares[0], xw, yw, zw],
        1 => [xw, squares[1], xy, xz],
        2 => [yw, xy, squares[2], yz],
        _ => [zw, xz, yz, squares[3]],
    };
    let q = normalised(row).unwrap_or(IDENTITY_POSE.rotation);
    let close = matrix(q).iter().flatten().zip(r.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-4);
    if close { Ok(q) } else { Err(Error::Parameter(format!("{}: rotation is not a rotation matrix", view.name))) }
}

/// Largest movement of the points' projections in pixels when one camera takes the other's place.
fn movement(camera: &Camera, other: &Camera, points: &[[f64; 3]]) -> f64 {
    let (width, height) = (camera.width as f64, camera.height as f64);
    let near = |[x, y]: [f64; 2]| x > -width && x < 2.0 * width && y > -height && y < 2.0 * height;
    let moved = points.iter().filter_map(|&point| {
        let (a, _) = camera.project(point).filter(|(a, _)| near(*a))?;
        let Some((b, _)) = other.project(point) else { return Some(f64::INFINITY) };
        Some(((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt())
    });
    moved.fold(0.0, f64::max)
}

fn rotations_hold(section: &ViewsSection, quaternions: &[[f64; 4]], points: &[[f64; 3]], exponent: i32) -> bool {
    if points.is_empty() {
        return exponent >= 22;
    }
    section.views.iter().zip(quaternions).all(|(view, &q)| {
        // Against a prediction by nothing and by something odd: rounding depends on it.
        [IDENTITY_POSE.rotation, [0.5, 0.5, -0.5, 0.5]].into_iter().all(|predicted| {
            let turn = difference(predicted, q, exponent);
            rotation_from(predicted, turn, exponent).is_some_and(|rotation| {
                let camera = Camera { rotation: matrix(rotation), ..view.camera };
                movement(&view.camera, &camera, points) <= HALF_TOLERANCE
            })
        })
    })
}

/// The coarsest lattice of lengths that holds the tolerances.
fn length_exponent(section: &ViewsSection, points: &[[f64; 3]]) -> Result<i32> {
    let lengths = section.views.iter().flat_map(|view| {
        let light = view.light.map(|light| {
            let q = view.camera.to_camera(light.position);
            (0..3).map(|k| q[k].abs().max(light.position[k].abs())).fold(0.0, f64::max)
        });
        view.camera.translation.into_iter().map(f64::abs).chain(light)
    });
    let longest = lengths.fold(0.0, f64::max);
    // Differences must stay within 2^30 as well.
    let fits = |exponent: i32| longest / lattice_step(exponent) < (MAX_COORDINATE / 4) as f64;
    let holds = |exponent: i32| {
        if points.is_empty() {
            return longest / lattice_step(exponent) >= (1 << 24) as f64 || longest == 0.0;
        }
        let unit = lattice_step(exponent);
        section.views.iter().all(|view| {
            // The worst rounding, not the one that happens.
            let corners = (0..8).all(|corner: i32| {
                let half = |k: usize| if corner >> k & 1 == 1 { unit / 2.0 } else { -unit / 2.0 };
                let translation = std::array::from_fn(|k| view.camera.translation[k] + half(k));
                movement(&view.camera, &Camera { translation, ..view.camera }, points) <= HALF_TOLERANCE
            });
            corners
                && view.light.is_none_or(|light| {
                    let distance =
                        |p: &[f64; 3]| (0..3).map(|k| (p[k] - light.position[k]).powi(2)).sum::<f64>().sqrt();
                    unit <= LIGHT_TOLERANCE * points.iter().map(distance).fold(f64::INFINITY, f64::min)
                })
        })
    };
    let finest = LENGTH_EXPONENTS.filter(|&exponent| fits(exponent)).max();
    LENGTH_EXPONENTS
        .filter(|&exponent| fits(exponent))
        .find(|&exponent| holds(exponent))
        .or(finest)
        .ok_or_else(|| Error::parameter("cameras or lights too far from the world's origin"))
}

fn difference(predicted: [f64; 4], rotation: [f64; 4], exponent: i32) -> [i64; 4] {
    let mut turn = multiply(conjugate(predicted), rotation);
    if turn[0] < 0.0 {
        turn = turn.map(|part| -part);
    }
    let mut lattice = turn.map(|part| (part / lattice_step(exponent)).round() as i64);
    lattice[0] -= 1 << exponent;
    lattice
}

fn size<const N: usize>(values: &[i64; N]) -> i64 {
    values.iter().map(|value| 64 - value.unsigned_abs().leading_zeros() as i64).sum()
}

fn minus(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn write(section: &ViewsSection, quaternions: &[[f64; 4]], header: &ViewHeader) -> Result<Vec<u8>> {
    let mut coder = RangeEncoder::new();
    let mut models = ViewSectionModels::new();
    let coder = &mut coder;
    for white in section.white {
        code_float(coder, white);
    }
    models.small.code(coder, section.components.len() as u32);
    for component in &section.components {
        let value = match component {
            Component::Diffuse => 0,
            Component::Specular => 1,
            Component::Combined => 2,
        };
        models.small.code(coder, value);
    }
    let count = u32::try_from(section.views.len()).ok().filter(|count| *count < u32::MAX);
    models.small.code(coder, count.ok_or_else(|| Error::parameter("too many views"))?);
    models.small.code_signed(coder, header.rotation_exponent);
    models.small.code_signed(coder, header.length_exponent);
    models.small.code(coder, header.lights_follow_camera as u32);
    models.small.code(coder, header.light_lag as u32 - 1);

    let mut last_name: &[u8] = b"";
    let mut cameras: Vec<Camera> = Vec::new();
    let mut poses: [Option<LatticePose>; 2] = [None; 2];
    let mut lights: Vec<[i64; 3]> = Vec::new();
    let mut intensities: Vec<[f64; 3]> = Vec::new();
    let (mut was_successor, mut was_same) = (false, false);
    for (view, &rotation) in section.views.iter().zip(quaternions) {
        write_name(coder, &mut models, last_name, view.name.as_bytes(), &mut was_successor);
        last_name = view.name.as_bytes();
        let intrinsics = write_intrinsics(coder, &mut models, &mut cameras, &view.camera);
        let pose = write_pose(coder, &mut models, &mut poses, &mut was_same, (view, rotation), header)?;
        let camera = camera_from(&intrinsics, &pose, header);
        models.lit.code(coder, view.light.is_some());
        if let Some(light) = view.light {
            // On the decoded camera's axes, so that its rounding does not add up.
            let place = if header.lights_follow_camera { camera.to_camera(light.position) } else { light.position };
            let lattice = place.map(|part| (part / lattice_step(header.length_exponent)).round() as i64);
            let shift = minus(lattice, predicted_light(&lights, header.light_lag));
            for (number, part) in models.light.iter_mut().zip(shift) {
                number.code_signed(coder, part as i32);
            }
            lights.push(lattice);
            let intensity = light.intensity.map(|x| x as f32 as f64);
            let known = intensities.iter().rposition(|other| *other == intensity);
            models.new_intensity.code(coder, known.is_none());
            let back = known.map_or(0, |at| intensities.len() - 1 - at);
            if known.is_none() {
                for value in intensity {
                    code_float(coder, value);
                }
                intensities.push(intensity);
            }
            models.intensity_index.code(coder, back as u32);
        }
    }
    code_end(coder);
    let mut bytes = vec![VERSION];
    bytes.extend(std::mem::take(coder).finish());
    Ok(bytes)
}

fn write_name(
    coder: &mut RangeEncoder,
    models: &mut ViewSectionModels,
    last: &[u8],
    name: &[u8],
    was_successor: &mut bool,
) {
    if let Some(next) = successor(last) {
        *was_successor = models.successor[*was_successor as usize].code(coder, next == name);
        if *was_successor {
            return;
        }
    }
    let prefix = last.iter().zip(name).take_while(|(a, b)| a == b).count();
    let (last, name) = (&last[prefix..], &name[prefix..]);
    let suffix = last.iter().rev().zip(name.iter().rev()).take_while(|(a, b)| a == b).count();
    let middle = &name[..name.len() - suffix];
    for (number, value) in models.lengths.iter_mut().zip([prefix, suffix, middle.len()]) {
        number.code(coder, value as u32);
    }
    for &letter in middle {
        models.letter(coder, letter);
    }
}

fn write_intrinsics(
    coder: &mut RangeEncoder,
    models: &mut ViewSectionModels,
    known: &mut Vec<Camera>,
    camera: &Camera,
) -> Camera {
    let narrow = |values: [f64; 2]| values.map(|x| x as f32 as f64);
    let (focal, principal) = (narrow(camera.focal), narrow(camera.principal));
    let camera = Camera { width: camera.width, height: camera.height, focal, principal, ..Camera::default() };
    let found = known.iter().rposition(|other| *other == camera);
    models.new_camera.code(coder, found.is_none());
    if let Some(at) = found {
        models.camera_index.code(coder, (known.len() - 1 - at) as u32);
        return camera;
    }
    models.sizes[0].code(coder, camera.width);
    models.sizes[1].code(coder, camera.height);
    let square = focal[0] == focal[1];
    models.square.code(coder, square);
    code_float(coder, focal[0]);
    if !square {
        code_float(coder, focal[1]);
    }
    for value in principal {
        code_float(coder, value);
    }
    known.push(camera);
    camera
}

fn write_pose(
    coder: &mut RangeEncoder,
    models: &mut ViewSectionModels,
    poses: &mut [Option<LatticePose>; 2],
    was_same: &mut bool,
    (view, rotation): (&View, [f64; 4]),
    header: &ViewHeader,
) -> Result<LatticePose> {
    let [last, before] = *poses;
    let wanted = view.camera.translation.map(|part| (part / lattice_step(header.length_exponent)).round() as i64);
    let exponent = header.rotation_exponent;
    if let Some(last) = last {
        let near = difference(last.rotation, rotation, exponent) == [0; 4];
        *was_same = models.same_pose[*was_same as usize].code(coder, near && wanted == last.translation);
        if *was_same {
            return Ok(last);
        }
    }
    let mut predicted = last.unwrap_or(IDENTITY_POSE);
    if let (Some(last), Some(before)) = (last, before) {
        let further = extrapolated_rotation(last.rotation, before.rotation);
        let better =
            size(&difference(further, rotation, exponent)) < size(&difference(last.rotation, rotation, exponent));
        if models.extrapolated[0].code(coder, better) {
            predicted.rotation = further;
        }
        let further = extrapolated_translation(last.translation, before.translation);
        let better = size(&minus(wanted, further)) < size(&minus(wanted, last.translation));
        if models.extrapolated[1].code(coder, better) {
            predicted.translation = further;
        }
    }
    let turn = difference(predicted.rotation, rotation, exponent);
    for (number, part) in models.rotation.iter_mut().zip(turn) {
        number.code_signed(coder, part as i32);
    }
    for (number, part) in models.translation.iter_mut().zip(minus(wanted, predicted.translation)) {
        number.code_signed(coder, part as i32);
    }
    let rotation = rotation_from(predicted.rotation, turn, exponent);
    let rotation = rotation.ok_or_else(|| Error::parameter(format!("{}: rotation can't be coded", view.name)))?;
    let pose = LatticePose { rotation, translation: wanted };
    *poses = [Some(pose), last];
    Ok(pose)
}
