//! Cameras on a GPU: all views of a batch at once, by the arithmetic of the processor's renderer.
//!
//! ```
//! use kestrel_gpu::open;
//! use kestrel_sim::camera::{Backend, Camera, Scene, Shot, View};
//! use kestrel_sim::nalgebra::Vector3;
//! use kestrel_sim::world::World;
//!
//! let renderer = open(Backend::Auto)?; // a GPU where there is one, else the processor
//! let view = View::towards(Vector3::new(0.0, 0.0, 1.0), Vector3::new(1.0, 0.0, 0.9), Vector3::z());
//! let scene = Scene::new(&World::empty());
//! let images = renderer.render(&Camera::REFERENCE, &[&scene], &[Shot { scene: 0, view }])?;
//! assert_eq!(images[0].depths.len(), 64 * 48);
//! println!("{renderer}");
//! # Ok::<(), kestrel_sim::camera::RenderError>(())
//! ```
//!
//! Scenes are uploaded once ([`Gpu::upload`]), what has moved in one again ([`Scenes::update`]), room for a number of views
//! is made once ([`Scenes::batch`]), then each [`Batch::render`] uploads 144 bytes a view and runs two passes. The first says
//! how each body is drawn in each view, the second casts a ray per pixel, tile by tile, at the bodies whose areas meet the
//! tile. Images stay where the GPU's other work finds them ([`Batch::buffers`]) or are read back together ([`Batch::read`]).

mod adapter;
mod batch;
mod division;
#[cfg(test)]
mod tests;

use std::fmt;

pub use batch::{Batch, Part};

use kestrel_sim::camera::words::{Place, SceneWords};
use kestrel_sim::camera::{Backend, Camera, Cpu, Image, RenderError, Renderer, Scene, Shot};

use division::Room;

/// Views that a software adapter renders at once: more only make it slower.
const SOFTWARE_VIEWS: usize = 16;

/// A GPU, or an adapter in software, with the renderer's programs.
#[derive(Clone, Debug)]
pub struct Gpu {
    info: wgpu::AdapterInfo,
    device: wgpu::Device,
    queue: wgpu::Queue,
    plot: wgpu::ComputePipeline,
    draw: wgpu::ComputePipeline,
    room: Room,
}

/// Scenes on a GPU.
#[derive(Debug)]
pub struct Scenes {
    gpu: Gpu,
    /// Where each of them is in the buffers.
    places: Vec<Place>,
    heads: wgpu::Buffer,
    bodies: wgpu::Buffer,
    faces: wgpu::Buffer,
    corners: wgpu::Buffer,
    triangles: wgpu::Buffer,
    rounds: wgpu::Buffer,
    looks: wgpu::Buffer,
    most_plots: usize,
}

impl Gpu {
    /// Opens the best GPU for [`Backend::Gpu`] and [`Backend::Auto`], an adapter in software for [`Backend::Software`].
    /// `WGPU_BACKEND` can name the interface: `vulkan`, `metal`, `dx12`.
    ///
    /// # Errors
    /// When there is none, or its driver refuses. [`Backend::Cpu`] is no adapter.
    pub fn open(backend: Backend) -> Result<Self, RenderError> {
        let adapter = adapter::find(backend)?;
        let info = adapter.get_info();
        let limits = adapter.limits();
        let descriptor = wgpu::DeviceDescriptor { required_limits: limits.clone(), ..Default::default() };
        let (device, queue) = adapter::wait(adapter.request_device(&descriptor))
            .map_err(|error| RenderError::Adapter { adapter: info.name.clone(), reason: error.to_string() })?;
        let pipeline = |name, source: &str| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: None,
                module: &module,
                entry_point: Some(name),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        };
        let plot = pipeline("plot", concat!(include_str!("data.wgsl"), include_str!("plot.wgsl")));
        let draw = pipeline("draw", concat!(include_str!("data.wgsl"), include_str!("draw.wgsl")));
        let most_views = if info.device_type == wgpu::DeviceType::Cpu { SOFTWARE_VIEWS } else { usize::MAX };
        Ok(Self { room: Room::new(&limits, most_views), info, device, queue, plot, draw })
    }

    /// As its driver calls it.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// Whether it is no GPU but runs on the processor.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Where its buffers live, for programs that use them there.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// What does its work in order.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Uploads scenes; shots name them by their index.
    ///
    /// # Errors
    /// When they are larger than a buffer may be.
    pub fn upload(&self, scenes: &[&Scene]) -> Result<Scenes, RenderError> {
        let mut words = SceneWords::default();
        let places = scenes.iter().map(|scene| words.push(scene)).collect();
        Ok(Scenes {
            gpu: self.clone(),
            places,
            heads: self.uploaded("scenes", words.scenes.as_flattened())?,
            bodies: self.uploaded("bodies", words.bodies.as_flattened())?,
            faces: self.uploaded("faces", words.faces.as_flattened().as_flattened())?,
            corners: self.uploaded("corners", words.corners.as_flattened())?,
            triangles: self.uploaded("triangles", words.triangles.as_flattened().as_flattened())?,
            rounds: self.uploaded("cylinders", words.rounds.as_flattened().as_flattened())?,
            looks: self.uploaded("surfaces", words.looks.as_flattened())?,
            most_plots: words.most_plots,
        })
    }

    fn uploaded(&self, what: &'static str, words: &[u32]) -> Result<wgpu::Buffer, RenderError> {
        // A binding is never empty; an element takes 64 bytes at most.
        let bytes = (size_of_val(words) as u64).max(64);
        self.fits(what, bytes)?;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let buffer = self.buffer(what, bytes, usage);
        self.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        Ok(buffer)
    }

    fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let label = Some(label);
        self.device.create_buffer(&wgpu::BufferDescriptor { label, size: bytes, usage, mapped_at_creation: false })
    }

    fn fits(&self, what: &'static str, bytes: u64) -> Result<(), RenderError> {
        if bytes <= self.room.bytes {
            return Ok(());
        }
        Err(RenderError::TooLarge { what, bytes, limit: self.room.bytes, adapter: self.info.name.clone() })
    }

    fn spans(&self, pixels: usize) -> Result<(), RenderError> {
        if pixels <= self.room.pixels {
            return Ok(());
        }
        Err(RenderError::TooWide { pixels, limit: self.room.pixels, adapter: self.info.name.clone() })
    }

    fn lost(&self, reason: &impl ToString) -> RenderError {
        RenderError::Lost { adapter: self.info.name.clone(), reason: reason.to_string() }
    }
}

impl Scenes {
    /// Shows what moves in one of them where it is in `scene` now: the uploaded one, or a clone of it. Renderings that were
    /// asked for before are not changed.
    pub fn update(&self, index: usize, scene: &Scene) {
        let place = &self.places[index];
        let words = SceneWords::moving(scene, place);
        let first = &place.moving;
        self.rewrite(&self.bodies, first.body, &words.bodies);
        self.rewrite(&self.faces, first.face, &words.faces);
        self.rewrite(&self.corners, first.corner, &words.corners);
        self.rewrite(&self.rounds, first.round, &words.rounds);
        self.rewrite(&self.looks, first.look, &words.looks);
    }

    fn rewrite<T: bytemuck::NoUninit>(&self, buffer: &wgpu::Buffer, first: usize, elements: &[T]) {
        self.gpu.queue.write_buffer(buffer, (first * size_of::<T>()) as u64, bytemuck::cast_slice(elements));
    }
}

/// Finds what was asked for, of the processor and all adapters.
///
/// # Errors
/// When a GPU or a software adapter was asked for and there is none that works.
pub fn open(backend: Backend) -> Result<Box<dyn Renderer>, RenderError> {
    match backend {
        Backend::Cpu => Ok(Box::new(Cpu::asked_for())),
        Backend::Auto => Ok(match Gpu::open(Backend::Gpu) {
            Ok(gpu) => Box::new(gpu),
            Err(why) => Box::new(Cpu::because(why)),
        }),
        Backend::Gpu | Backend::Software => Ok(Box::new(Gpu::open(backend)?)),
    }
}

impl Renderer for Gpu {
    fn render(&self, camera: &Camera, scenes: &[&Scene], shots: &[Shot]) -> Result<Vec<Image>, RenderError> {
        let scenes = self.upload(scenes)?;
        let mut batch = scenes.batch(camera, shots.len())?;
        let mut images = Vec::new();
        batch.render(shots)?;
        batch.read(&mut images)?;
        Ok(images)
    }
}

impl fmt::Display for Gpu {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let wgpu::AdapterInfo { name, backend, driver, driver_info, .. } = &self.info;
        let kind = if self.is_software() { "software adapter" } else { "GPU" };
        write!(formatter, "rendered by the {kind} {name} ({backend}, {driver} {driver_info})")
    }
}
