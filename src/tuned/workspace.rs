//! Memory that views are worked on in, used again for the next one.

use super::DecodedView;
use crate::transform::masked::{Coefficients, MaskedPixels, Scratch};
use crate::transform::shape_adaptive::Work;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Memory that a component's picture is worked on in, for the next one to use again.
#[derive(Debug, Default)]
pub struct Workspace {
    pub coefficients: Coefficients,
    pub transform: Work,
}

/// Memory that is not in use.
#[derive(Debug, Default)]
pub struct Workspaces(Mutex<Free>);

#[derive(Debug, Default)]
struct Free {
    workspaces: Vec<Workspace>,
    signals: Vec<Scratch>,
}

impl Workspaces {
    fn free(&self) -> MutexGuard<'_, Free> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
    /// Runs `work` with a workspace of its own.
    pub fn with<T>(&self, work: impl FnOnce(&mut Workspace) -> T) -> T {
        let mut free = self.free();
        let mut workspace = free.workspaces.pop().unwrap_or_default();
        workspace.transform.take_back(0, free.signals.pop().unwrap_or_default());
        drop(free);
        let result = work(&mut workspace);
        self.free().workspaces.push(workspace);
        result
    }
    /// Takes a view's signals, which nobody will look at any more.
    pub fn take_back(&self, view: &mut DecodedView) {
        self.free().signals.extend(view.signals.drain(..).map(MaskedPixels::into_scratch));
    }
}
