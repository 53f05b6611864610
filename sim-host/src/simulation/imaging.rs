//! The images of a simulation's drones: taken at their pace, spoiled as a real camera does, delivered when they arrive.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::camera::{Canvas, Image, Mover, OnboardCamera, Scene};
use crate::contact::Motion;
use crate::scenario::Scenario;
use crate::seed::Stream;
use crate::world::Pose;

/// The cameras of all drones.
#[derive(Clone, Debug)]
pub(super) struct Imaging {
    camera: OnboardCamera,
    /// With what moves in the environment that was looked at last.
    scene: Scene,
    canvas: Canvas,
    image: Image,
    /// Colours of an exposure, added up.
    sums: Vec<[u16; 3]>,
    /// `[rows][image]`: what each drone saw last.
    images: Vec<u8>,
    /// The same before the reset, of drones whose episode ended in the last step.
    final_images: Vec<u8>,
    /// Of each drone.
    memories: Vec<CameraMemory>,
}

/// What the next images of a drone depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct CameraMemory {
    stream: Stream,
    gain: f32,
    /// Images on their way, and in which control period of the episode they arrive.
    coming: VecDeque<(u32, Vec<u8>)>,
}

/// Everything the next images depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ImagingState {
    images: Vec<u8>,
    memories: Vec<CameraMemory>,
}

impl Imaging {
    /// None where the scenario has no camera; `stream` is that of a row.
    pub(super) fn new(scenario: &Scenario, rows: usize, stream: impl Fn(usize) -> Stream) -> Option<Self> {
        let camera = scenario.camera.clone()?;
        let bytes = rows * camera.image_len();
        let memory = |row| CameraMemory { stream: stream(row), gain: 1.0, coming: VecDeque::new() };
        Some(Self {
            scene: Scene::new(&scenario.aviary.world).with_drones(&scenario.airframe, drones(scenario)),
            canvas: Canvas::default(),
            image: Image::default(),
            sums: Vec::new(),
            images: vec![0; bytes],
            final_images: vec![0; bytes],
            memories: (0..rows).map(memory).collect(),
            camera,
        })
    }

    pub(super) fn images(&self) -> &[u8] {
        &self.images
    }

    pub(super) fn final_images(&self) -> &[u8] {
        &self.final_images
    }

    pub(super) fn save(&self) -> ImagingState {
        ImagingState { images: self.images.clone(), memories: self.memories.clone() }
    }

    /// Whether [`Self::restore`] takes it.
    pub(super) fn fits(&self, state: &ImagingState) -> bool {
        state.images.len() == self.images.len() && state.memories.len() == self.memories.len()
    }

    pub(super) fn restore(&mut self, state: &ImagingState) {
        self.images.copy_from_slice(&state.images);
        self.memories.clone_from_slice(&state.memories);
    }

    /// Whether something is to be placed before a drone looks.
    pub(super) fn has_movers(&self) -> bool {
        self.scene.drones() > 0 || self.scene.movables() > 0
    }

    /// Whether the camera takes an image in the control period of an episode.
    pub(super) fn is_due(&self, period: u32) -> bool {
        self.camera.is_due(period)
    }

    /// Places what moves in a drone's environment; the drone does not see itself.
    pub(super) fn place(&mut self, drone: usize, team: &[Pose], movables: &[Pose]) {
        for (index, pose) in movables.iter().enumerate() {
            self.scene.place(Mover::Movable(index), pose);
        }
        for (index, pose) in team.iter().enumerate().take(self.scene.drones()) {
            if index == drone {
                self.scene.hide(Mover::Drone(index));
            } else {
                self.scene.place(Mover::Drone(index), pose);
            }
        }
    }

    /// Takes the image of a drone in the control period of its episode, if it is time for one, and shows what arrives.
    pub(super) fn look(&mut self, row: usize, drone: &Motion, period: u32) {
        let len = self.camera.image_len();
        if period == 0 {
            let memory = &mut self.memories[row];
            memory.gain = self.camera.optics.draw_gain(&mut memory.stream);
            memory.coming.clear();
        }
        if self.camera.is_due(period) {
            self.expose(row, drone);
            // The first image of an episode finds a camera that has been running.
            if period == 0 || self.camera.optics.latency_periods == 0 {
                self.camera.write(&self.image, &mut self.images[row * len..][..len]);
            } else {
                let mut bytes = vec![0; len];
                self.camera.write(&self.image, &mut bytes);
                self.memories[row].coming.push_back((period + self.camera.optics.latency_periods, bytes));
            }
        }
        let Self { memories, images, .. } = self;
        let coming = &mut memories[row].coming;
        while coming.front().is_some_and(|(arrives, _)| *arrives <= period) {
            if let Some((_, bytes)) = coming.pop_front() {
                images[row * len..][..len].copy_from_slice(&bytes);
            }
        }
    }

    /// Keeps what a drone saw last before it starts anew.
    pub(super) fn keep(&mut self, row: usize) {
        let len = self.camera.image_len();
        let place = row * len..(row + 1) * len;
        self.final_images[place.clone()].copy_from_slice(&self.images[place]);
    }

    /// What the camera makes of what it sees; depth and labels are those of the present.
    fn expose(&mut self, row: usize, drone: &Motion) {
        let Self { camera, scene, canvas, image, sums, memories, .. } = self;
        let instants = camera.optics.instants(drone);
        let count = instants.len() as u16;
        sums.clear();
        sums.resize(camera.camera.rows * camera.camera.columns, [0; 3]);
        for pose in instants.iter().rev() {
            scene.render_into(&camera.camera, &camera.view(pose), canvas, image);
            if count > 1 {
                let colours = sums.as_flattened_mut().iter_mut().zip(image.colours.as_flattened());
                colours.for_each(|(sum, colour)| *sum += u16::from(*colour));
            }
        }
        if count > 1 {
            let colours = image.colours.as_flattened_mut().iter_mut().zip(sums.as_flattened());
            colours.for_each(|(colour, sum)| *colour = ((sum + count / 2) / count) as u8);
        }
        let CameraMemory { stream, gain, .. } = &mut memories[row];
        camera.optics.spoil(*gain, stream, image);
    }
}

/// Drones that others see.
fn drones(scenario: &Scenario) -> usize {
    match scenario.agents.count {
        1 => 0,
        count => count as usize,
    }
}
