//! What the page shows of a flight: pixels, and what is drawn over them.

use std::collections::VecDeque;

use kestrel_core::airframe::Airframe;
use kestrel_core::vehicle::State;
use kestrel_draw::live::{LiveScene, Orbit};
use kestrel_sim::world::Pose;
use nalgebra::Vector3;
use wasm_bindgen::prelude::*;

use crate::pixels::rgba;

/// Points of the way of each drone that are kept: four seconds at 50 Hz.
const TRAIL: usize = 200;

/// From where the page looks, and how large.
#[wasm_bindgen]
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Direction in which the camera looks \[rad\], from the x axis towards the y axis.
    pub heading: f64,
    /// How far it is above the drone \[rad\].
    pub elevation: f64,
    /// Its distance, times that of the camera of videos: half a metre for a Crazyflie.
    pub zoom: f64,
    /// Columns of the picture \[px\].
    pub columns: usize,
    /// Its rows \[px\].
    pub rows: usize,
    /// Rays across a pixel, and down it.
    pub samples: usize,
}

#[wasm_bindgen]
impl Look {
    /// A view of a flight.
    #[wasm_bindgen(constructor)]
    pub fn new(heading: f64, elevation: f64, zoom: f64) -> Self {
        Self { heading, elevation, zoom, columns: 640, rows: 360, samples: 1 }
    }
}

impl Look {
    fn orbit(&self) -> Orbit {
        Orbit { heading: self.heading, elevation: self.elevation, zoom: self.zoom }
    }
}

/// Position \[m, world\], speed \[m/s\], tilt \[rad\], distance to the goal \[m\], rotor speeds as shares of the greatest.
pub(crate) fn telemetry(state: &State<f32>, goal: &Vector3<f32>, airframe: &Airframe) -> Vec<f32> {
    let tilt = state.world_from_body.up_cosine().clamp(-1.0, 1.0).acos();
    let motion = [state.velocity.norm(), tilt, (goal - state.position).norm()];
    let rotors = state.rotor_speeds.map(|speed| speed / airframe.rotor_speed_limit as f32);
    state.position.iter().copied().chain(motion).chain(rotors).collect()
}

/// Drones in a world, and the ways behind them.
#[derive(Clone, Debug)]
pub(crate) struct Stage {
    pub(crate) scene: LiveScene,
    trails: Vec<VecDeque<Vector3<f64>>>,
}

impl Stage {
    pub(crate) fn new(scene: LiveScene, drones: usize) -> Self {
        Self { scene, trails: vec![VecDeque::new(); drones] }
    }

    /// The drones have come to these places.
    pub(crate) fn follow(&mut self, places: impl Iterator<Item = Vector3<f64>>) {
        for (trail, place) in self.trails.iter_mut().zip(places) {
            if trail.len() == TRAIL {
                trail.pop_front();
            }
            trail.push_back(place);
        }
    }

    /// Red, green, blue, opacity of each pixel.
    pub(crate) fn draw(&mut self, drones: &[Pose], movables: &[Pose], look: &Look) -> Vec<u8> {
        self.scene.place(drones, movables);
        let centre = drones.iter().map(|pose| pose.position).sum::<Vector3<f64>>() / drones.len().max(1) as f64;
        let size = [look.columns, look.rows];
        let image = self.scene.look(centre, &look.orbit(), size, look.samples);
        rgba(&image.colours, size, look.samples)
    }

    /// Where the way of a drone is in the last picture \[px\]: x and y of each point, NaN where it is hidden.
    pub(crate) fn trail(&self, drone: usize) -> Vec<f32> {
        let points = self.trails.get(drone).into_iter().flatten();
        points.flat_map(|point| self.point(*point)).collect()
    }

    /// Where a point of the world is in the last picture \[px\], NaN where it is hidden.
    pub(crate) fn point(&self, point: Vector3<f64>) -> [f32; 2] {
        self.scene.project(point).unwrap_or([f64::NAN; 2]).map(|place| place as f32)
    }
}
