//! The object as a camera sees it, exactly or many times a second.

use super::{ArObject, RenderMode};
use crate::error::Result;
use crate::relight::{EnvironmentScene, RealtimeFrame, RealtimeRenderer, add_detail};
use crate::views::Camera;
use std::borrow::Cow;

/// Draws the object.
pub(super) enum ObjectRenderer<'a> {
    Offline(EnvironmentScene<'a>),
    Realtime(Box<RealtimeRenderer<'a>>),
}

impl<'a> ObjectRenderer<'a> {
    pub(super) fn new(scene: EnvironmentScene<'a>, mode: RenderMode) -> Self {
        match mode {
            RenderMode::Offline => ObjectRenderer::Offline(scene),
            RenderMode::Realtime => ObjectRenderer::Realtime(Box::new(RealtimeRenderer::new(scene))),
        }
    }

    /// Renders what `camera`, a window of the canvas, sees.
    pub(super) fn render(&mut self, object: &ArObject, camera: &Camera) -> Result<Cow<'_, RealtimeFrame>> {
        match self {
            ObjectRenderer::Offline(scene) => {
                let mut relit = scene.render(camera, object.shading)?;
                if let Some((renderer, asset)) = object.detail {
                    add_detail(&mut relit, renderer, asset, camera)?;
                }
                Ok(Cow::Owned(RealtimeFrame { image: relit.image, coverage: relit.coverage }))
            }
            ObjectRenderer::Realtime(renderer) => Ok(Cow::Borrowed(renderer.render(camera, object.shading)?)),
        }
    }
}
