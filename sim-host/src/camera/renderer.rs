//! The processor or a GPU, behind one call.

use std::fmt;

#[cfg(feature = "gpu")]
use super::gpu::Gpu;
use super::{Backend, Camera, Canvas, Image, RenderError, Scene, View};

/// A view of one of several scenes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Index of the scene.
    pub scene: usize,
    /// Where the camera is in it.
    pub view: View,
}

/// What renders, chosen once.
#[derive(Debug)]
pub enum Renderer {
    /// The processor, and why: a clause for people.
    Cpu(String),
    /// A GPU, or an adapter in software that was asked for.
    #[cfg(feature = "gpu")]
    Gpu(Box<Gpu>),
}

impl Renderer {
    /// Finds what was asked for.
    ///
    /// # Errors
    /// When a GPU or a software adapter was asked for and there is none that works.
    pub fn open(backend: Backend) -> Result<Self, RenderError> {
        match backend {
            Backend::Cpu => Ok(Self::Cpu("it was asked for".to_owned())),
            #[cfg(feature = "gpu")]
            Backend::Auto => Ok(Gpu::open(Backend::Gpu).map_or_else(|why| Self::Cpu(why.to_string()), Self::of)),
            #[cfg(feature = "gpu")]
            Backend::Gpu | Backend::Software => Gpu::open(backend).map(Self::of),
            #[cfg(not(feature = "gpu"))]
            Backend::Auto => Ok(Self::Cpu("this program was built without GPUs".to_owned())),
            #[cfg(not(feature = "gpu"))]
            Backend::Gpu | Backend::Software => Err(RenderError::WithoutGpus),
        }
    }

    #[cfg(feature = "gpu")]
    fn of(gpu: Gpu) -> Self {
        Self::Gpu(Box::new(gpu))
    }

    /// What a camera sees, an image a shot.
    ///
    /// # Errors
    /// When an image is larger than the GPU can hold, its memory is full or it is lost.
    ///
    /// # Panics
    /// When a shot is of a scene that is not there.
    pub fn render(&self, camera: &Camera, scenes: &[&Scene], shots: &[Shot]) -> Result<Vec<Image>, RenderError> {
        match self {
            Self::Cpu(_) => {
                let mut canvas = Canvas::default();
                let image = |shot: &Shot| {
                    let mut image = Image::default();
                    scenes[shot.scene].render_into(camera, &shot.view, &mut canvas, &mut image);
                    image
                };
                Ok(shots.iter().map(image).collect())
            }
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => {
                let scenes = gpu.upload(scenes)?;
                let mut batch = scenes.batch(camera, shots.len())?;
                let mut images = Vec::new();
                batch.render(shots)?;
                batch.read(&mut images)?;
                Ok(images)
            }
        }
    }
}

impl fmt::Display for Renderer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu(why) => write!(formatter, "rendered by the processor: {why}"),
            #[cfg(feature = "gpu")]
            Self::Gpu(gpu) => write!(formatter, "rendered by {gpu}"),
        }
    }
}
