//! Diffuse and specular reflection out of photographs through polarisers, and back.

use crate::capture::{Capture, CaptureFrame, OpenCapture};
use crate::container::thumbnail;
use crate::error::{Error, Result};
use crate::image::{Mask, MaskRuns, RgbImage};
use crate::mesh::Mesh;
use crate::metrics::Distortion;
use crate::rate::CodedView;
use crate::views::source::{PhotographSource, open_run, open_together};
use crate::views::{Component, Photograph, View};
use std::borrow::Cow;

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
        let kept = kept(self.views.len(), every)?;
        let mut index = 0;
        self.views.retain(|_| {
            index += 1;
            kept.binary_search(&(index - 1)).is_ok()
        });
        Ok(self)
    }
}

/// The views that stay where every `every`-th one is held out.
fn kept(views: usize, every: Option<usize>) -> Result<Vec<usize>> {
    if every.is_some_and(|every| every < 2) {
        return Err(Error::parameter("option `hold_out` takes 2 or more: every k-th view is left out"));
    }
    Ok((0..views).filter(|view| every.is_none_or(|every| (view + 1) % every != 0)).collect())
}

/// The frames of a capture as components of reflection, each separated when it is asked for.
#[derive(Debug)]
pub(crate) struct SeparatedFrames<'a> {
    capture: &'a OpenCapture,
    /// Frames in the capture, by view.
    frames: Vec<usize>,
    /// As [`Observations::components`].
    pub components: Vec<Component>,
    beta: Option<[f64; 3]>,
}

impl<'a> SeparatedFrames<'a> {
    /// The frames of a capture but those that are held out, see [`Observations::holding_out`].
    /// # Errors
    /// As [`separate`].
    pub(crate) fn new(capture: &'a OpenCapture, hold_out: Option<usize>) -> Result<Self> {
        let (components, beta) = components(capture.is_polarised(), capture.beta)?;
        Ok(SeparatedFrames { capture, frames: kept(capture.views().len(), hold_out)?, components, beta })
    }

    /// Name, camera and light of each view.
    pub(crate) fn views(&self) -> Vec<View> {
        self.frames.iter().map(|&frame| self.capture.views()[frame].clone()).collect()
    }

    /// Radiance of the white board.
    pub(crate) fn white(&self) -> [f64; 3] {
        self.capture.white
    }

    /// Opens a view.
    pub(crate) fn observe(&self, view: usize) -> Result<ObservedView> {
        let frame = self.capture.frame(self.frames[view])?.into_owned();
        check_frame(&frame, self.capture.is_polarised())?;
        Ok(separate_frame(frame, self.beta))
    }

    /// Views that may be opened side by side.
    pub(crate) fn at_once(&self) -> usize {
        self.capture.frames.at_once()
    }
}

/// Separated frames with the pixels to code: those of the mask (or of what the mesh covers, without one) that are finite in all components; the
/// others become 0.
#[derive(Debug)]
pub(crate) struct FramesToCode<'a> {
    /// The frames.
    pub frames: &'a SeparatedFrames<'a>,
    /// Pixels that the mesh covers, by view.
    pub covered: &'a [MaskRuns],
}

impl PhotographSource for FramesToCode<'_> {
    fn photograph(&self, view: usize) -> Result<Cow<'_, Photograph>> {
        let ObservedView { mask, mut images, .. } = self.frames.observe(view)?;
        let mut mask = mask.unwrap_or_else(|| self.covered[view].mask());
        for (k, inside) in mask.data.iter_mut().enumerate() {
            if images.iter().any(|image| image.data[k].iter().any(|v| !v.is_finite())) {
                *inside = false;
                images.iter_mut().for_each(|image| image.data[k] = [0.0; 3]);
            }
        }
        Ok(Cow::Owned(Photograph { mask, images }))
    }
    fn at_once(&self) -> usize {
        self.frames.at_once()
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
    pub covered: &'a [MaskRuns],
    /// The photographs, by view; their masks are the pixels to code.
    pub photographs: &'a dyn PhotographSource,
}

impl<'a> MaskedPhotographs<'a> {
    /// Calls `visit` with each view's photograph, in order.
    pub(crate) fn for_each(&self, mut visit: impl FnMut(usize, &Photograph) -> Result<()>) -> Result<()> {
        for run in open_together(self.views, self.photographs.at_once()) {
            let opened = open_run(self.photographs, &run)?;
            run.zip(&opened).try_for_each(|(view, photograph)| visit(view, photograph))?;
        }
        Ok(())
    }

    /// Returns what is kept of a decoded photograph; `shown` if it is the file's thumbnail.
    pub(crate) fn coded_view(
        &self,
        view: usize,
        original: &Photograph,
        decoded: &Photograph,
        is_shown: bool,
    ) -> CodedView {
        let covered = self.covered[view].mask();
        CodedView {
            distortion: Distortion::compare(original, decoded, &covered, self.components, self.white),
            digest: decoded.digest(),
            thumbnail: is_shown.then(|| thumbnail::reduced(&decoded.sum())),
        }
    }
}

/// Adds a warning of the views of which no pixel is coded.
/// # Errors
/// [`Error::Parameter`] if no view has a pixel to code.
pub(crate) fn check_shown(shown: &[bool], warnings: &mut Vec<String>) -> Result<()> {
    let empty = shown.iter().filter(|&&shown| !shown).count();
    if empty == shown.len() {
        return Err(Error::parameter(
            "no photograph shows a pixel of the object: check masks, mesh position and missing (NaN) pixels",
        ));
    }
    if empty > 0 {
        warnings.push(format!("{empty} views show no pixel of the object"));
    }
    Ok(())
}

/// `I_d = cross / beta`, `I_s = off - I_d` with its sign (Miyazaki 2007, equations 4, 5, A.3 and A.4); without cross photographs
/// the photographs themselves, combined.
///
/// Takes the frames out of the capture, whose `frames` is empty afterwards, so that no photograph is in memory twice.
pub fn separate(capture: &mut Capture) -> Result<Observations> {
    let polarised = capture.frames.first().is_some_and(|frame| frame.cross.is_some());
    let (components, beta) = components(polarised, capture.beta)?;
    capture.frames.iter().try_for_each(|frame| check_frame(frame, polarised))?;
    let frames = std::mem::take(&mut capture.frames).into_iter().map(|frame| separate_frame(frame, beta)).collect();
    Ok(Observations { components, white: capture.white, beta, views: frames })
}

/// The components of a capture's photographs, and what separates them.
fn components(polarised: bool, beta: Option<[f64; 3]>) -> Result<(Vec<Component>, Option<[f64; 3]>)> {
    match (polarised, beta) {
        (true, None) => Err(Error::parameter(
            "separation needs the white board's on / off ratio of each colour: give option `beta`",
        )),
        (true, beta) => Ok((vec![Component::Diffuse, Component::Specular], beta)),
        (false, _) => Ok((vec![Component::Combined], None)),
    }
}

fn check_frame(frame: &CaptureFrame, polarised: bool) -> Result<()> {
    if frame.cross.is_some() != polarised {
        let name = &frame.view.name;
        return Err(Error::parameter(format!("frame {name}: all frames need a cross photograph, or none")));
    }
    frame.check()
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
    use crate::views::Camera;

    fn capture(cross: Option<RgbImage>, beta: Option<[f64; 3]>) -> Capture {
        let photograph = RgbImage {
            width: 2,
            height: 2,
            data: vec![[1.0, 2.0, 3.0], [0.25, 0.5, 0.5], [f32::NAN; 3], [4.0, 0.1, 0.3]],
        };
        let camera = Camera { width: 2, height: 2, ..Camera::default() };
        let view = View { name: "a".into(), camera, light: None };
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

        let refused = |change: fn(&mut CaptureFrame)| {
            let mut wrong = capture(Some(RgbImage::filled(2, 2, [0.5; 3])), Some([0.5; 3]));
            change(&mut wrong.frames[0]);
            separate(&mut wrong).unwrap_err().to_string()
        };
        assert!(refused(|frame| frame.photograph = RgbImage::filled(3, 2, [0.5; 3])).contains("photograph has 3 x 2"));
        assert!(refused(|frame| frame.cross = Some(RgbImage::filled(2, 1, [0.5; 3]))).contains("photograph has 2 x 1"));
        assert!(refused(|frame| frame.mask = Some(Mask::filled(1, 2, true))).contains("mask has 1 x 2"));
        assert!(refused(|frame| frame.mask = Some(Mask::filled(2, 2, false))).contains("shows nothing"));
        assert!(refused(|frame| frame.photograph.data.truncate(3)).contains("photograph"));
    }
}
