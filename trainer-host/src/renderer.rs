//! What renders, of what this program was built with.

#[cfg(feature = "gpu")]
pub(crate) use kestrel_gpu::open;

#[cfg(not(feature = "gpu"))]
use kestrel_sim::camera::{Backend, Cpu, RenderError, Renderer};

/// The processor, unless a GPU was asked for.
///
/// # Errors
/// When a GPU or a software adapter was asked for.
#[cfg(not(feature = "gpu"))]
pub(crate) fn open(backend: Backend) -> Result<Box<dyn Renderer>, RenderError> {
    match backend {
        Backend::Cpu => Ok(Box::new(Cpu::asked_for())),
        Backend::Auto => Ok(Box::new(Cpu::because("this program was built without GPUs"))),
        Backend::Gpu | Backend::Software => Err(RenderError::WithoutGpus),
    }
}
