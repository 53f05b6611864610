//! Views that are rendered together, and where their images are.

use std::ops::Range;
use std::sync::mpsc;

use kestrel_sim::camera::words::{ViewWords, view_words};
use kestrel_sim::camera::{Camera, Image, RenderError, Shot};
use wgpu::{BindGroup, Buffer, BufferUsages};

use super::division::{Sizes, TILE};
use super::{Gpu, Scenes, adapter};

/// Room for a number of views of one camera. One part for each dispatch; one, unless they are too many for a buffer.
#[derive(Debug)]
pub struct Batch<'a> {
    scenes: &'a Scenes,
    camera: Camera,
    parts: Vec<Part>,
    /// How many were rendered last.
    shots: usize,
}

/// Views whose images are in one buffer.
#[derive(Debug)]
pub struct Part {
    /// Which of the batch.
    pub views: Range<usize>,
    /// Depths `f32` \[m\], then labels `u32`, then colours `u32` (red in the lowest byte, then green, blue, 255), each
    /// `[view][row][column]` for all views of the part.
    pub pixels: Buffer,
    shots: Buffer,
    plot: BindGroup,
    draw: BindGroup,
    /// Where the processor reads.
    staging: Option<Buffer>,
}

impl Scenes {
    /// Makes room for views; as many dispatches as they need.
    ///
    /// # Errors
    /// When a single view is larger than a buffer may be, or all are larger than the memory.
    pub fn batch(&self, camera: &Camera, views: usize) -> Result<Batch<'_>, RenderError> {
        let gpu = &self.gpu;
        let sizes = Sizes::new(camera, self.most_plots);
        gpu.fits("the pixels of one view", sizes.pixels)?;
        gpu.fits("the plots of one view", sizes.plots)?;
        gpu.spans(camera.columns.max(camera.rows))?;
        let ranges = gpu.room.parts(views, &sizes);
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let longest = ranges.iter().map(Range::len).max().unwrap_or(0) as u64;
        let plots = gpu.buffer("plots", sizes.plots * longest.max(1), BufferUsages::STORAGE);
        let parts = ranges.into_iter().map(|range| self.part(camera, range, &plots)).collect();
        if adapter::wait(scope.pop()).is_some() {
            return Err(self.out_of_memory(camera, views));
        }
        Ok(Batch { scenes: self, camera: *camera, parts, shots: 0 })
    }

    fn out_of_memory(&self, camera: &Camera, views: usize) -> RenderError {
        let adapter = self.gpu.name().to_owned();
        RenderError::OutOfMemory { adapter, views, columns: camera.columns, rows: camera.rows }
    }

    fn part(&self, camera: &Camera, views: Range<usize>, plots: &Buffer) -> Part {
        let gpu = &self.gpu;
        let sizes = Sizes::new(camera, self.most_plots);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let pixels = gpu.buffer("pixels", sizes.pixels * views.len() as u64, usage);
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let shots = gpu.buffer("views", size_of::<ViewWords>() as u64 * views.len() as u64, usage);
        let section = camera.columns * camera.rows * views.len();
        let words = camera_words(camera, self.most_plots as u32, section as u32);
        let uniform =
            gpu.buffer("camera", size_of_val(&words) as u64, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        gpu.queue.write_buffer(&uniform, 0, bytemuck::cast_slice(&words));
        let common = [&uniform, &self.heads, &self.bodies, &self.rounds, &shots];
        let plot = gpu.bound(&gpu.plot, &common, &[&self.faces, &self.corners, plots, &self.triangles]);
        let draw = gpu.bound(&gpu.draw, &common, &[&self.looks, plots, &pixels]);
        Part { views, pixels, shots, plot, draw, staging: None }
    }
}

impl Gpu {
    fn bound(&self, pipeline: &wgpu::ComputePipeline, common: &[&Buffer; 5], own: &[&Buffer]) -> BindGroup {
        let buffers = common.iter().chain(own);
        let entries: Vec<_> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }
}

/// The structure `Camera` of `data.wgsl`.
fn camera_words(camera: &Camera, stride: u32, section: u32) -> [u32; 12] {
    let bits = |value: f64| (value as f32).to_bits();
    let [[across, up], [column, row]] = [camera.tangents, camera.sample];
    [
        camera.columns as u32,
        camera.rows as u32,
        bits(across),
        bits(up),
        bits(column),
        bits(row),
        bits(camera.near_m),
        bits(camera.far_m),
        bits(1.0 / camera.near_m),
        bits(1.0 / camera.far_m),
        stride,
        section,
    ]
}

impl Batch<'_> {
    /// Renders as many shots as there is room for, or fewer. Returns when the GPU knows what to do, before it is done.
    ///
    /// # Errors
    /// When the device is lost.
    ///
    /// # Panics
    /// When there are more shots than room, or one is of a scene that is not there.
    pub fn render(&mut self, shots: &[Shot]) -> Result<(), RenderError> {
        let Self { scenes, camera, parts, .. } = self;
        let room = parts.last().map_or(0, |part| part.views.end);
        assert!(shots.len() <= room, "room for {room} views, not for {}", shots.len());
        assert!(
            shots.iter().all(|shot| shot.scene < scenes.places.len()),
            "shots are of {} scenes",
            scenes.places.len()
        );
        let gpu = &scenes.gpu;
        let tiles = [camera.columns, camera.rows].map(|size| size.div_ceil(TILE) as u32);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for part in parts.iter().filter(|part| part.views.start < shots.len()) {
            let own = &shots[part.views.start..part.views.end.min(shots.len())];
            let words: Vec<ViewWords> = own.iter().map(|shot| view_words(camera, shot)).collect();
            gpu.queue.write_buffer(&part.shots, 0, bytemuck::cast_slice(&words));
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&gpu.plot);
            pass.set_bind_group(0, &part.plot, &[]);
            pass.dispatch_workgroups(own.len() as u32, 1, 1);
            pass.set_pipeline(&gpu.draw);
            pass.set_bind_group(0, &part.draw, &[]);
            pass.dispatch_workgroups(tiles[0], tiles[1], own.len() as u32);
        }
        gpu.queue.submit([encoder.finish()]);
        self.shots = shots.len();
        Ok(())
    }

    /// Waits until the images are there, and leaves them there.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn wait(&self) -> Result<(), RenderError> {
        let gpu = &self.scenes.gpu;
        gpu.device.poll(wgpu::PollType::wait_indefinitely()).map(|_| ()).map_err(|error| gpu.lost(&error))
    }

    /// Where the images are, for the GPU's other work: shots `views` of the batch in each buffer.
    pub fn buffers(&self) -> &[Part] {
        &self.parts
    }

    /// Reads all images back at once, one a shot of the last [`Self::render`], into memory that is used again.
    ///
    /// # Errors
    /// When the device is lost or has no memory left for that.
    pub fn read(&mut self, images: &mut Vec<Image>) -> Result<(), RenderError> {
        let gpu = &self.scenes.gpu;
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for Part { pixels, staging, .. } in &mut self.parts {
            let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
            let staging = staging.get_or_insert_with(|| gpu.buffer("staging", pixels.size(), usage));
            encoder.copy_buffer_to_buffer(pixels, 0, staging, 0, pixels.size());
        }
        if adapter::wait(scope.pop()).is_some() {
            return Err(self.scenes.out_of_memory(&self.camera, self.shots));
        }
        gpu.queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        for staging in self.parts.iter().filter_map(|part| part.staging.as_ref()) {
            let sender = sender.clone();
            staging.map_async(wgpu::MapMode::Read, .., move |result| {
                // Nobody listens when an earlier part failed.
                let _ = sender.send(result);
            });
        }
        drop(sender);
        self.wait()?;
        for result in receiver {
            result.map_err(|error| gpu.lost(&error))?;
        }
        images.resize_with(self.shots, Image::default);
        for part in &self.parts {
            self.read_part(part, images)?;
        }
        Ok(())
    }

    fn read_part(&self, part: &Part, images: &mut [Image]) -> Result<(), RenderError> {
        let Some(staging) = &part.staging else { return Ok(()) };
        let first = part.views.start.min(images.len());
        let images = &mut images[first..part.views.end.min(first.max(self.shots))];
        {
            let bytes = staging.slice(..).get_mapped_range().map_err(|error| self.scenes.gpu.lost(&error))?;
            let words: &[u32] = bytemuck::cast_slice(&bytes);
            let size = self.camera.columns * self.camera.rows;
            let section = size * part.views.len();
            for (index, image) in images.iter_mut().enumerate() {
                let channel = |channel: usize| &words[channel * section + index * size..][..size];
                image.columns = self.camera.columns;
                refill(&mut image.depths, channel(0), f32::from_bits);
                refill(&mut image.labels, channel(1), |label| label as u16);
                refill(&mut image.colours, channel(2), |colour| {
                    let [red, green, blue, _] = colour.to_le_bytes();
                    [red, green, blue]
                });
            }
        }
        staging.unmap();
        Ok(())
    }
}

fn refill<T>(values: &mut Vec<T>, words: &[u32], value: impl Fn(u32) -> T) {
    values.clear();
    values.extend(words.iter().map(|&word| value(word)));
}
