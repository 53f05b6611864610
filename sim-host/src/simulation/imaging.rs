//! The images of a simulation's drones: taken at their pace, spoiled as a real camera does, delivered when they arrive.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::camera::{Calibration, Canvas, Image, Mover, OnboardCamera, Scene};
use crate::contact::Motion;
use crate::scenario::Scenario;
use crate::seed::Stream;
use crate::world::Pose;

/// The cameras of all drones.
#[derive(Clone, Debug)]
pub(super) struct Imaging {
    camera: OnboardCamera,
    scenes: Scenes,
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

/// What cameras look at.
#[derive(Clone, Debug)]
enum Scenes {
    /// The same place, with what moves in the environment that was looked at last.
    Same(Scene),
    /// Of each environment the room that it looked at last, prepared when it is entered.
    Drawn(Vec<Option<(u32, Scene)>>),
}

/// Where a drone is that looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Looking {
    /// Where its image goes.
    pub(super) row: usize,
    /// Among those of the simulation.
    pub(super) environment: usize,
    /// Among those of its environment.
    pub(super) drone: usize,
    /// The room that the environment is in, zero where none is drawn.
    pub(super) room: u32,
    /// Control periods of its episode that have passed.
    pub(super) period: u32,
}

/// What the next images of a drone depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct CameraMemory {
    stream: Stream,
    gain: f32,
    calibration: Calibration,
    /// Images on their way, and in which control period of the episode they arrive.
    coming: VecDeque<(u32, Vec<u8>)>,
    /// Images that have arrived and are still to be shown, the newest first; empty where one is shown at a time.
    shown: VecDeque<Vec<u8>>,
}

/// Everything the next images depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ImagingState {
    images: Vec<u8>,
    memories: Vec<CameraMemory>,
}

impl Imaging {
    /// None where the scenario has no camera; `stream` is that of a row.
    pub(super) fn new(
        scenario: &Scenario,
        environments: usize,
        rows: usize,
        stream: impl Fn(usize) -> Stream,
    ) -> Option<Self> {
        let camera = scenario.camera.clone()?;
        let bytes = rows * camera.image_len();
        let memory = |row| CameraMemory {
            stream: stream(row),
            gain: 1.0,
            calibration: Calibration::default(),
            coming: VecDeque::new(),
            shown: VecDeque::new(),
        };
        Some(Self {
            scenes: match scenario.drawn {
                None => Scenes::Same(scene(scenario, 0)),
                Some(_) => Scenes::Drawn(vec![None; environments]),
            },
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

    /// Whether the camera takes an image in the control period of an episode.
    pub(super) fn is_due(&self, period: u32) -> bool {
        self.camera.is_due(period)
    }

    /// Prepares the room that a drone's environment is in, and places there what moves; the drone does not see itself.
    /// `moving` gives the poses of the team and of the movables, if any are to be seen.
    pub(super) fn prepare(
        &mut self,
        looking: &Looking,
        scenario: &Scenario,
        moving: impl FnOnce() -> (Vec<Pose>, Vec<Pose>),
    ) {
        if let Scenes::Drawn(scenes) = &mut self.scenes {
            let place = &mut scenes[looking.environment];
            if place.as_ref().is_none_or(|(room, _)| *room != looking.room) {
                *place = Some((looking.room, scene(scenario, looking.room)));
            }
        }
        let scene = self.scenes.of_mut(looking.environment);
        if scene.drones() == 0 && scene.movables() == 0 {
            return;
        }
        let (team, movables) = moving();
        for (index, pose) in movables.iter().enumerate() {
            scene.place(Mover::Movable(index), pose);
        }
        for (index, pose) in team.iter().enumerate().take(scene.drones()) {
            if index == looking.drone {
                scene.hide(Mover::Drone(index));
            } else {
                scene.place(Mover::Drone(index), pose);
            }
        }
    }

    /// Takes the image of a drone in the control period of its episode, if it is time for one, and shows what arrives.
    pub(super) fn look(&mut self, looking: &Looking, drone: &Motion) {
        let Looking { row, environment, period, .. } = *looking;
        if period == 0 {
            let CameraMemory { stream, gain, calibration, coming, shown } = &mut self.memories[row];
            *gain = self.camera.optics.draw_gain(stream);
            *calibration = self.camera.optics.draw_calibration(stream);
            coming.clear();
            shown.clear();
        }
        if self.camera.is_due(period) {
            self.expose(row, environment, drone);
            let mut bytes = vec![0; self.camera.frame_len()];
            self.camera.write(&self.image, &mut bytes);
            // The first image of an episode finds a camera that has been running.
            let latency = if period == 0 { 0 } else { self.camera.optics.latency_periods };
            self.memories[row].coming.push_back((period + latency, bytes));
        }
        while self.memories[row].coming.front().is_some_and(|(arrives, _)| *arrives <= period) {
            if let Some((_, bytes)) = self.memories[row].coming.pop_front() {
                self.show(row, bytes);
            }
        }
    }

    /// Shows an image that has arrived beside those before it; before the first of an episode there was the same.
    fn show(&mut self, row: usize, bytes: Vec<u8>) {
        let Self { camera, images, memories, .. } = self;
        let len = camera.image_len();
        let stacked = &mut images[row * len..][..len];
        if camera.frames == 1 {
            return stacked.copy_from_slice(&bytes);
        }
        let (shown, apart) = (&mut memories[row].shown, camera.images_per_frame as usize);
        let kept = (camera.frames as usize - 1) * apart + 1;
        shown.truncate(kept - 1);
        shown.push_front(bytes);
        for frame in 0..camera.frames as usize {
            let oldest = shown.len() - 1;
            camera.stack(frame, &shown[oldest.min(frame * apart)], stacked);
        }
    }

    /// Keeps what a drone saw last before it starts anew.
    pub(super) fn keep(&mut self, row: usize) {
        let len = self.camera.image_len();
        let place = row * len..(row + 1) * len;
        self.final_images[place.clone()].copy_from_slice(&self.images[place]);
    }

    /// What the camera makes of what it sees; depth and labels are those of the present.
    fn expose(&mut self, row: usize, environment: usize, drone: &Motion) {
        let Self { camera, scenes, canvas, image, sums, memories, .. } = self;
        let CameraMemory { stream, gain, calibration, .. } = &mut memories[row];
        let (scene, own) = (scenes.of_mut(environment), calibration.camera(&camera.camera));
        let instants = camera.optics.instants(drone);
        let count = instants.len() as u16;
        sums.clear();
        sums.resize(own.rows * own.columns, [0; 3]);
        for pose in instants.iter().rev() {
            scene.render_into(&own, &camera.view(&calibration.askew(pose)), canvas, image);
            if count > 1 {
                let colours = sums.as_flattened_mut().iter_mut().zip(image.colours.as_flattened());
                colours.for_each(|(sum, colour)| *sum += u16::from(*colour));
            }
        }
        if count > 1 {
            let colours = image.colours.as_flattened_mut().iter_mut().zip(sums.as_flattened());
            colours.for_each(|(colour, sum)| *colour = ((sum + count / 2) / count) as u8);
        }
        camera.optics.spoil(*gain, stream, image);
    }
}

impl Scenes {
    /// What the drones of an environment look at, once it is prepared.
    fn of_mut(&mut self, environment: usize) -> &mut Scene {
        match self {
            Self::Same(scene) => scene,
            Self::Drawn(scenes) => {
                let (_, scene) = scenes[environment].as_mut().expect("a room is prepared before anybody looks");
                scene
            }
        }
    }
}

/// A room with its movables and the drones that others see.
fn scene(scenario: &Scenario, room: u32) -> Scene {
    let drones = match scenario.agents.count {
        1 => 0,
        count => count as usize,
    };
    Scene::new(&scenario.aviary_of(room).world).with_drones(&scenario.airframe, drones)
}
