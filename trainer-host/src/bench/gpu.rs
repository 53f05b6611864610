//! How many images a GPU makes.

use std::time::Duration;

use kestrel_gpu::{Batch, Gpu};
use kestrel_sim::camera::{Backend, Camera, Image, RenderError, Scene, Shot};
use kestrel_sim::scenario::Scenario;

use super::{Figure, Sight, best_rate, views};

/// Views of a batch: a test's, a small training's, a large one's.
const BATCHES: [usize; 3] = [16, 1024, 16_384];

/// What a GPU should make of the least world, when its batches are large; of others in proportion to the aims of one core.
const AIM: f64 = 5e6;

/// A GPU, or an adapter in software where there is none.
///
/// # Errors
/// When there is neither.
pub(crate) fn open() -> Result<Gpu, RenderError> {
    Gpu::open(Backend::Gpu).or_else(|error| Gpu::open(Backend::Software).map_err(|_| error))
}

/// Lines for a world: batches that stay on the GPU, and the largest of them read back. An adapter in software gets the
/// smallest only.
///
/// # Errors
/// When the memory is too small or the device is lost.
pub(crate) fn sight(
    gpu: &Gpu,
    sight: &Sight,
    scenario: &Scenario,
    duration: Duration,
) -> Result<Vec<Figure>, RenderError> {
    let world = &scenario.aviary.world;
    let views = views(world);
    let scenes = gpu.upload(&[&Scene::new(world)])?;
    let sizes = if gpu.is_software() { &BATCHES[..1] } else { &BATCHES[..] };
    let aim = AIM * sight.aim / super::SIGHTS[0].aim;
    let mut figures = Vec::new();
    for &size in sizes {
        let shots: Vec<Shot> = views.iter().cycle().take(size).map(|&view| Shot { scene: 0, view }).collect();
        let mut batch = scenes.batch(&Camera::REFERENCE, size)?;
        let figure = |what: &str, per_second, limit| Figure {
            what: format!("images, {}, {size} at once{what}", sight.what),
            per_second,
            aim,
            limit,
        };
        let kept = rate(&mut batch, &shots, duration, |batch| batch.wait())?;
        figures.push(figure("", kept, "planes and roots per pixel; small batches by their submission"));
        if size == sizes[sizes.len() - 1] {
            let mut images: Vec<Image> = Vec::new();
            let read = rate(&mut batch, &shots, duration, |batch| batch.read(&mut images))?;
            figures.push(figure(", read", read, "36 kB an image over the bus, unpacked by one core"));
        }
    }
    Ok(figures)
}

fn rate<'a>(
    batch: &mut Batch<'a>,
    shots: &[Shot],
    duration: Duration,
    mut end: impl FnMut(&mut Batch<'a>) -> Result<(), RenderError>,
) -> Result<f64, RenderError> {
    let mut failed = None;
    let rate = best_rate(duration, || {
        let done = batch.render(shots).and_then(|()| end(batch));
        failed = failed.take().or(done.err());
        shots.len() as u64
    });
    failed.map_or(Ok(rate), Err)
}
