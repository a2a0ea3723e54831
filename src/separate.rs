//! Diffuse and specular reflection out of photographs through polarisers, and back.

use crate::capture::{Capture, CaptureFrame};
use crate::error::{Error, Result};
use crate::image::{Mask, RgbImage};
use crate::mesh::Mesh;
use crate::metrics::Distortion;
use crate::views::codec::ViewsSection;
use crate::views::{Camera, Component, Photograph, View};

/// A capture's photographs as components of reflection.
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    /// Components of each view's images: diffuse and specular, or both combined.
    pub components: Vec<Component>,
    /// Radiance of the white board: the unit of `sqrt(x / white)`.
    pub white: [f64; 3],
    /// The ratio by which the cross photographs were divided.
    pub beta: Option<[f64; 3]>,
    /// The frames, in the capture's order.
    pub views: Vec<ObservedView>,
}

/// One frame's components.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedView {
    /// Name, camera and light.
    pub view: View,
    /// Pixels that show the object.
    pub mask: Option<Mask>,
    /// Linear radiance per component, parallel to [`Observations::components`]; missing pixels are NaN.
    pub images: Vec<RgbImage>,
}

impl Observations {
    /// Leaves out every `every`-th view (the k-th, the 2k-th ...); all stay if it is `None`.
    /// # Errors
    /// [`Error::Parameter`] if `every` is below 2.
    pub fn holding_out(mut self, every: Option<usize>) -> Result<Self> {
        let Some(every) = every else { return Ok(self) };
        if every < 2 {
            return Err(Error::parameter("option `hold_out` takes 2 or more: every k-th view is left out"));
        }
        let mut index = 0;
        self.views.retain(|_| {
            index += 1;
            index % every != 0
        });
        Ok(self)
    }

    /// The cameras of all views.
    pub fn cameras(&self) -> Vec<Camera> {
        self.views.iter().map(|observed| observed.view.camera).collect()
    }

    /// The content of section `VIEW`.
    pub fn views_section(&self) -> ViewsSection {
        ViewsSection {
            white: self.white,
            components: self.components.clone(),
            views: self.views.iter().map(|observed| observed.view.clone()).collect(),
        }
    }

    /// Returns the photographs with the pixels to code: those of the mask (or of `covered`, what the mesh covers, without
    /// one) that are finite in all components; the others become 0. Views without such a pixel add a warning.
    /// # Errors
    /// [`Error::Parameter`] if no photograph has such a pixel.
    pub fn into_masked(self, covered: &[Mask], warnings: &mut Vec<String>) -> Result<Vec<Photograph>> {
        let mut empty = 0;
        let photographs: Vec<Photograph> = (self.views.into_iter().zip(covered))
            .map(|(mut observed, covered)| {
                let mut mask = observed.mask.take().unwrap_or_else(|| covered.clone());
                for (k, inside) in mask.data.iter_mut().enumerate() {
                    if observed.images.iter().any(|image| image.data[k].iter().any(|v| !v.is_finite())) {
                        *inside = false;
                        observed.images.iter_mut().for_each(|image| image.data[k] = [0.0; 3]);
                    }
                }
                empty += (mask.count() == 0) as usize;
                Photograph { mask, images: observed.images }
            })
            .collect();
        if empty == photographs.len() {
            return Err(Error::parameter(
                "no photograph shows a pixel of the object: check masks, mesh position and missing (NaN) pixels",
            ));
        }
        if empty > 0 {
            warnings.push(format!("{empty} views show no pixel of the object"));
        }
        Ok(photographs)
    }
}

/// Photographs to code, with the mesh and the views that the decoder will have: what each profile's encoder starts from.
#[derive(Debug, Clone, Copy)]
pub struct MaskedPhotographs<'a> {
    /// The mesh, as decoded.
    pub mesh: &'a Mesh,
    /// The views, as decoded.
    pub views: &'a [View],
    /// Components of the photographs.
    pub components: &'a [Component],
    /// Radiance of the white board: the unit of `sqrt(x / white)`.
    pub white: [f64; 3],
    /// Pixels that the mesh covers, by view.
    pub covered: &'a [Mask],
    /// The photographs, by view; their masks are the pixels to code.
    pub photographs: &'a [Photograph],
}

impl MaskedPhotographs<'_> {
    /// Compares decoded photographs with these.
    pub fn distortion(&self, decoded: &[Photograph]) -> Distortion {
        Distortion::compare(self.photographs, decoded, self.covered, self.components, self.white)
    }
}

/// `I_d = cross / beta`, `I_s = off - I_d` with its sign (Miyazaki 2007, equations 4, 5, A.3 and A.4); without cross photographs
/// the photographs themselves, combined.
///
/// Takes the frames out of the capture, whose `frames` is empty afterwards, so that no photograph is in memory twice.
pub fn separate(capture: &mut Capture) -> Result<Observations> {
    let polarised = capture.frames.first().is_some_and(|frame| frame.cross.is_some());
    if polarised && capture.beta.is_none() {
        return Err(Error::parameter(
            "separation needs the white board's on / off ratio of each colour: give option `beta`",
        ));
    }
    if let Some(frame) = capture.frames.iter().find(|frame| frame.cross.is_some() != polarised) {
        return Err(Error::parameter(format!(
            "frame {}: all frames need a cross photograph, or none",
            frame.view.name
        )));
    }
    let beta = capture.beta.filter(|_| polarised);
    let components = if polarised { vec![Component::Diffuse, Component::Specular] } else { vec![Component::Combined] };
    let frames = std::mem::take(&mut capture.frames).into_iter().map(|frame| separate_frame(frame, beta)).collect();
    Ok(Observations { components, white: capture.white, beta, views: frames })
}

fn separate_frame(frame: CaptureFrame, beta: Option<[f64; 3]>) -> ObservedView {
    let CaptureFrame { view, photograph: mut off, cross, mask } = frame;
    let images = match (cross, beta) {
        (Some(mut cross), Some(beta)) => {
            for (off, cross) in off.data.iter_mut().zip(&mut cross.data) {
                for colour in 0..3 {
                    cross[colour] = (cross[colour] as f64 / beta[colour]) as f32;
                    off[colour] -= cross[colour];
                }
            }
            vec![cross, off]
        }
        _ => vec![off],
    };
    ObservedView { view, mask, images }
}

/// The photographs of components: unpolarised `off = I_d + I_s`, and cross-polarised `I_d beta` where there are two. The images
/// are parallel to the components and of one size. The inverse of [`separate`] to `f32` rounding.
pub fn recombine(
    components: &[Component],
    images: &[RgbImage],
    beta: Option<[f64; 3]>,
) -> Result<(RgbImage, Option<RgbImage>)> {
    match (components, images) {
        ([Component::Combined], [combined]) => Ok((combined.clone(), None)),
        ([Component::Diffuse, Component::Specular], [diffuse, specular])
            if diffuse.data.len() == specular.data.len() =>
        {
            let mut off = diffuse.clone();
            for (off, specular) in off.data.iter_mut().zip(&specular.data) {
                (0..3).for_each(|colour| off[colour] += specular[colour]);
            }
            let cross = beta.map(|beta| {
                diffuse.map(|pixel| std::array::from_fn(|colour| (pixel[colour] as f64 * beta[colour]) as f32))
            });
            Ok((off, cross))
        }
        _ => Err(Error::parameter("components and images don't belong together: diffuse and specular, or combined")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capture(cross: Option<RgbImage>, beta: Option<[f64; 3]>) -> Capture {
        let photograph = RgbImage {
            width: 2,
            height: 2,
            data: vec![[1.0, 2.0, 3.0], [0.25, 0.5, 0.5], [f32::NAN; 3], [4.0, 0.1, 0.3]],
        };
        let view = View { name: "a".into(), camera: Camera::default(), light: None };
        Capture {
            name: "test".into(),
            frames: vec![CaptureFrame { view, photograph, cross, mask: None }],
            mesh: Mesh::default(),
            origin: [0.0; 3],
            white: [1.0, 0.9, 0.8],
            beta,
            color_space: "linear-rec709".into(),
            warnings: Vec::new(),
            skipped_frames: 0,
            missing_pixels: 1,
            clipping: Default::default(),
        }
    }

    #[test]
    fn polarised_frames_separate_and_recombine() {
        let data = vec![[0.25, 0.5, 0.75], [0.25, 0.25, 0.3], [f32::NAN; 3], [0.7, 0.01, 0.1]];
        let cross = RgbImage { width: 2, height: 2, data };
        let beta = [0.5, 0.4, 0.6];
        let mut capture = capture(Some(cross), Some(beta));
        let original = capture.frames[0].clone();
        let observations = separate(&mut capture).unwrap();
        assert!(capture.frames.is_empty());
        assert_eq!(observations.components, [Component::Diffuse, Component::Specular]);
        assert_eq!(observations.white, [1.0, 0.9, 0.8]);
        let images = &observations.views[0].images;
        assert_eq!(images[0].data[0], [0.5, 1.25, 1.25]);
        assert_eq!(images[1].data[0], [0.5, 0.75, 1.75]);
        assert!(images[1].data[1][0] == -0.25, "the sign stays");
        assert!(images.iter().all(|image| image.data[2].iter().all(|v| v.is_nan())));
        let (off, on) = recombine(&observations.components, images, observations.beta).unwrap();
        let on = on.unwrap();
        for index in [0, 1, 3] {
            for c in 0..3 {
                assert!((off.data[index][c] - original.photograph.data[index][c]).abs() < 5e-7);
                assert!((on.data[index][c] - original.cross.as_ref().unwrap().data[index][c]).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn unpolarised_frames_pass_and_contradictions_do_not() {
        let mut plain = capture(None, Some([0.5; 3]));
        let original = plain.frames[0].photograph.clone();
        let observations = separate(&mut plain).unwrap();
        assert_eq!((observations.components.as_slice(), observations.beta), (&[Component::Combined][..], None));
        assert_eq!(observations.views[0].images[0].data[0], original.data[0]);
        assert_eq!(recombine(&observations.components, &observations.views[0].images, None).unwrap().1, None);

        let cross = RgbImage::filled(2, 2, [0.5; 3]);
        let error = separate(&mut capture(Some(cross.clone()), None)).unwrap_err();
        assert!(error.to_string().contains("`beta`"));
        let mut mixed = capture(Some(cross), Some([0.5; 3]));
        mixed.frames.push(capture(None, None).frames.remove(0));
        assert!(separate(&mut mixed).is_err());
        assert_eq!(mixed.frames.len(), 2);
        assert!(recombine(&[Component::Combined], &[], None).is_err());
    }
}
