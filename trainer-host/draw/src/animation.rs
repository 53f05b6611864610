//! A flight of one or several drones as an animated GIF: recording, playback, camera, scene, captions, encoding.
//!
//! Everything is drawn by this module on the CPU, from nothing but the recording: the same flight gives the same
//! bytes on every machine.

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_sim::outline::Outline;
use kestrel_sim::world::Floor;
use nalgebra::Vector3;
use rayon::prelude::*;

use canvas::Canvas;

mod camera;
mod canvas;
mod caption;
mod drone;
pub(crate) mod encode;
pub(crate) mod font;
pub(crate) mod palette;
pub(crate) mod playback;
mod scene;
pub(crate) mod tracking;
mod view;

/// Width and height of the picture \[px\].
pub const SIZE: [usize; 2] = [480, 360];

/// Height of the strip with the captions, below the scene \[px\].
const STRIP: usize = 56;

/// One flight, as it was flown.
#[derive(Clone, Debug)]
pub struct FlightRecording {
    /// Shown in the picture: ASCII letters, digits and common signs.
    pub title: String,
    /// Time between two frames \[s\].
    pub control_secs: f32,
    /// What flies: its rotor positions and propeller radius are drawn to scale.
    pub airframe: Airframe,
    /// The drones, at least one; they begin together.
    pub drones: Vec<DroneFlight>,
    /// Walls and obstacles where they stand \[m, world\].
    pub solids: Vec<Outline>,
    /// Obstacles that move.
    pub movables: Vec<MovingSolid>,
    /// Whether there is a floor at z = 0; otherwise a plane below the flight gives orientation.
    pub floor: Floor,
}

/// What one drone did.
#[derive(Clone, Debug)]
pub struct DroneFlight {
    /// Where it should go \[m, world\].
    pub goal: Vector3<f32>,
    /// The states, one per control period, at least one; after the last the drone is shown where it ended.
    pub frames: Vec<FlightFrame>,
    /// Sum of the rewards of each control period.
    pub rewards: Vec<f64>,
    /// How it ended, as in reports; empty when it has not.
    pub ending: String,
    /// Whether that was a success.
    pub success: bool,
}

/// The drone at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightFrame {
    /// Where it is.
    pub placement: Placement,
    /// Speed of each rotor as a share of its limit, \[0, 1\], in the airframe's order.
    pub rotor_fractions: [f32; 4],
}

/// A solid that is not always in the same place.
#[derive(Clone, Debug)]
pub struct MovingSolid {
    /// Its surface around its own origin \[m\].
    pub outline: Outline,
    /// Where it is, one per control period, at least one; after the last it stays there.
    pub placements: Vec<Placement>,
}

/// A place and an orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// \[m, world\].
    pub position: Vector3<f32>,
    /// `world_from_body`.
    pub attitude: Attitude<f32>,
}

/// Why a flight cannot be drawn.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum AnimationError {
    /// Nothing was recorded.
    #[error("the recording of the flight holds no frames: expected at least one")]
    Empty,
    /// The time between frames is no positive number.
    #[error("the recording of the flight has a control period of {0} s: expected a positive number")]
    ControlPeriod(f32),
    /// A number that is none.
    #[error("frame {frame} of drone {drone} holds NaN or infinite numbers: expected finite ones")]
    NotFinite {
        /// Counted from zero.
        drone: usize,
        /// Counted from zero.
        frame: usize,
    },
    /// The GIF encoder failed.
    #[error("cannot encode the flight as GIF: {0}")]
    Encoding(String),
}

/// GIF of the flight: 25 pictures per second of flight, then a pause, then again from the start.
///
/// Pictures are drawn in parallel on rayon's current pool.
///
/// # Errors
/// [`AnimationError`] for a recording without frames or with numbers that are none.
pub fn flight_gif(recording: &FlightRecording) -> Result<Vec<u8>, AnimationError> {
    check(recording)?;
    let moments = playback::moments(recording);
    let scene = scene::Scene::of(recording, &moments);
    let shots = scene.shots(&moments);
    let drawn: Vec<_> = shots.par_iter().map(|shot| picture(&scene, shot).quantised()).collect();
    encoded(drawn).map_err(|error| AnimationError::Encoding(error.to_string()))
}

fn encoded(pictures: Vec<Vec<u8>>) -> Result<Vec<u8>, gif::EncodingError> {
    let (palette, unchanged) = (palette::bytes(), palette::UNCHANGED);
    let mut writer = encode::Writer::new(encode::Format { size: SIZE, palette, unchanged })?;
    let last = pictures.len() - 1;
    for (index, picture) in pictures.into_iter().enumerate() {
        let pause = if index == last { encode::PAUSE_SECS } else { 0.0 };
        writer.push(picture, playback::PICTURE_SECS + pause)?;
    }
    writer.finish()
}

fn picture(scene: &scene::Scene<'_>, shot: &scene::Shot<'_>) -> Canvas {
    let mut canvas = Canvas::new(SIZE, palette::PAPER);
    scene.draw(shot, &mut canvas);
    caption::draw(&scene.recording.title, shot.moment, &mut canvas);
    canvas
}

/// Refuses what cannot be shown.
pub(crate) fn check(recording: &FlightRecording) -> Result<(), AnimationError> {
    let drones = &recording.drones;
    if drones.is_empty() || drones.iter().any(|flight| flight.frames.is_empty()) {
        return Err(AnimationError::Empty);
    }
    if !(recording.control_secs.is_finite() && recording.control_secs > 0.0) {
        return Err(AnimationError::ControlPeriod(recording.control_secs));
    }
    for (drone, flight) in drones.iter().enumerate() {
        if let Some(frame) = flight.frames.iter().position(|frame| !is_finite(frame)) {
            return Err(AnimationError::NotFinite { drone, frame });
        }
    }
    Ok(())
}

fn is_finite(frame: &FlightFrame) -> bool {
    let Placement { position, attitude: Attitude { w, x, y, z } } = frame.placement;
    let numbers = [w, x, y, z].into_iter().chain(position.iter().copied()).chain(frame.rotor_fractions);
    numbers.into_iter().all(f32::is_finite)
}

#[cfg(test)]
mod tests;
