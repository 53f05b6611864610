//! What keys and the mouse do.

use std::f64::consts::TAU;

use crate::video::playback::PICTURE_SECS;

/// What a key asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Stops the flight, or lets it go on; at its end, from the start.
    Pause,
    /// So many pictures of a 25th of a second on, or back.
    Step(i8),
    /// Twice as fast.
    Faster,
    /// Half as fast.
    Slower,
    /// The next camera.
    NextCamera,
    /// The next drone.
    NextDrone,
    /// Everything as at first.
    Reset,
    /// The end.
    Quit,
}

/// From where the large picture is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum CameraMode {
    /// From behind the drone
    #[default]
    Chase,
    /// Around the drone, as the mouse says
    Orbit,
    /// By the drone's own camera
    Onboard,
}

impl CameraMode {
    /// As captions have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Chase => "chase",
            Self::Orbit => "orbit",
            Self::Onboard => "on board",
        }
    }

    fn next(self) -> Self {
        match self {
            Self::Chase => Self::Orbit,
            Self::Orbit => Self::Onboard,
            Self::Onboard => Self::Chase,
        }
    }
}

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Show the next picture.
    Continue,
    /// The user has seen enough.
    Quit,
}

/// How much there is to see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Length of the flight \[s\].
    pub secs: f32,
    /// Number of drones.
    pub drones: usize,
    /// Whether it is flown while it is looked at.
    pub goes_on: bool,
}

/// What the user has chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Controls {
    /// Time since the start \[s\].
    pub secs: f32,
    /// Whether time goes on.
    pub playing: bool,
    /// Whether the newest moment of a flight that goes on is shown, and not one of before.
    pub newest: bool,
    /// How fast.
    pub speed: f32,
    /// From where.
    pub camera: CameraMode,
    /// Which drone is followed.
    pub drone: usize,
    /// Direction in which the orbiting camera looks \[rad\], from the x axis towards the y axis.
    pub heading: f64,
    /// How far it is above the drone \[rad\].
    pub elevation: f64,
    /// Its distance, times that of the camera behind.
    pub zoom: f64,
}

impl Default for Controls {
    fn default() -> Self {
        Self {
            secs: 0.0,
            playing: true,
            newest: true,
            speed: 1.0,
            camera: CameraMode::Chase,
            drone: 0,
            heading: 0.6,
            elevation: 0.5,
            zoom: 1.5,
        }
    }
}

/// Slowest and fastest time.
const SPEEDS: [f32; 2] = [1.0 / 16.0, 16.0];

/// Angle per pixel that the mouse is dragged \[rad\], and the farthest above and below the drone.
const TURN_PER_PIXEL: f64 = 0.008;
const ELEVATION_LIMIT: f64 = 1.5;

/// Factor of the distance per notch of the wheel, and its limits.
const ZOOM_PER_NOTCH: f64 = 0.88;
const ZOOMS: [f64; 2] = [0.2, 40.0];

/// What a key does: named as in the W3C's UI Events, letters as they are written.
pub fn action(key: &str) -> Option<Action> {
    match key {
        " " | "Space" | "p" => Some(Action::Pause),
        "ArrowRight" | "." => Some(Action::Step(1)),
        "ArrowLeft" | "," => Some(Action::Step(-1)),
        "PageDown" => Some(Action::Step(25)),
        "PageUp" => Some(Action::Step(-25)),
        "ArrowUp" | "+" | "=" => Some(Action::Faster),
        "ArrowDown" | "-" => Some(Action::Slower),
        "c" => Some(Action::NextCamera),
        "n" | "Tab" => Some(Action::NextDrone),
        "r" | "Home" => Some(Action::Reset),
        "q" | "Escape" => Some(Action::Quit),
        _ => None,
    }
}

impl Controls {
    /// Does what a key asks for.
    pub fn apply(&mut self, action: Action, extent: &Extent) -> Flow {
        match action {
            Action::Pause if self.secs >= extent.secs && !extent.goes_on => {
                (self.secs, self.playing) = (0.0, true);
            }
            Action::Pause => (self.playing, self.newest) = (!self.playing, false),
            Action::Step(pictures) => {
                let now = (self.secs / PICTURE_SECS).round() + f32::from(pictures);
                self.secs = (now * PICTURE_SECS).clamp(0.0, extent.secs);
                (self.playing, self.newest) = (false, false);
            }
            Action::Faster => self.speed = (self.speed * 2.0).min(SPEEDS[1]),
            Action::Slower => self.speed = (self.speed / 2.0).max(SPEEDS[0]),
            Action::NextCamera => self.camera = self.camera.next(),
            Action::NextDrone => self.drone = (self.drone + 1) % extent.drones,
            Action::Reset => *self = Self::default(),
            Action::Quit => return Flow::Quit,
        }
        Flow::Continue
    }

    /// Lets time pass \[s\]; the flight stops at its end, unless it goes on.
    pub fn advance(&mut self, passed_secs: f32, extent: &Extent) {
        if extent.goes_on && self.newest {
            self.secs = extent.secs;
        } else if self.playing {
            self.secs = (self.secs + passed_secs * self.speed).min(extent.secs);
            self.newest = self.secs >= extent.secs;
            self.playing = extent.goes_on || !self.newest;
        }
    }

    /// The mouse was dragged \[px\], right and down: the camera goes around the drone.
    pub fn drag(&mut self, [right, down]: [f64; 2]) {
        self.camera = CameraMode::Orbit;
        self.heading = (self.heading - right * TURN_PER_PIXEL).rem_euclid(TAU);
        self.elevation = (self.elevation + down * TURN_PER_PIXEL).clamp(-ELEVATION_LIMIT, ELEVATION_LIMIT);
    }

    /// The wheel was turned, away from the user: the camera comes nearer.
    pub fn zoom(&mut self, notches: f64) {
        self.camera = CameraMode::Orbit;
        self.zoom = (self.zoom * libm::pow(ZOOM_PER_NOTCH, notches)).clamp(ZOOMS[0], ZOOMS[1]);
    }
}
