//! The processor or a GPU, behind one call.

use std::fmt::{Debug, Display, Formatter, Result as FmtResult};

use super::{Camera, Canvas, Image, RenderError, Scene, View};

/// A view of one of several scenes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Index of the scene.
    pub scene: usize,
    /// Where the camera is in it.
    pub view: View,
}

/// What renders, chosen once: [`Cpu`], or the GPU of the package `kestrel-gpu`. Shows itself as a clause for people.
pub trait Renderer: Debug + Display + Send + Sync {
    /// What a camera sees, an image a shot.
    ///
    /// # Errors
    /// When an image is larger than the GPU can hold, its memory is full or it is lost.
    ///
    /// # Panics
    /// When a shot is of a scene that is not there.
    fn render(&self, camera: &Camera, scenes: &[&Scene], shots: &[Shot]) -> Result<Vec<Image>, RenderError>;
}

/// The processor.
#[derive(Clone, Debug)]
pub struct Cpu {
    /// Why it renders: a clause for people.
    why: String,
}

impl Cpu {
    /// Because it was asked for.
    pub fn asked_for() -> Self {
        Self::because("it was asked for")
    }

    /// For want of something faster.
    pub fn because(why: impl Display) -> Self {
        Self { why: why.to_string() }
    }
}

impl Renderer for Cpu {
    fn render(&self, camera: &Camera, scenes: &[&Scene], shots: &[Shot]) -> Result<Vec<Image>, RenderError> {
        let mut canvas = Canvas::default();
        let image = |shot: &Shot| {
            let mut image = Image::default();
            scenes[shot.scene].render_into(camera, &shot.view, &mut canvas, &mut image);
            image
        };
        Ok(shots.iter().map(image).collect())
    }
}

impl Display for Cpu {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> FmtResult {
        write!(formatter, "rendered by the processor: {}", self.why)
    }
}
