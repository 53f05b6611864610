//! The camera of a drone whose policy sees.

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::camera::{Camera, Channel, Mount, OnboardCamera, Optics};

/// Most pixels across or down: a policy's images are small.
const SIDE_LIMIT: u64 = 512;

/// Most control periods for which an image is held.
const PERIODS_LIMIT: u64 = 1000;

/// Most images at once.
const FRAMES_LIMIT: u64 = 16;

const MEGABYTE: usize = 1 << 20;

/// Nothing that is nearer is seen \[m\].
const NEAR_M: f64 = 0.01;

/// A camera whose images the policy sees beside its observation.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraConfig {
    /// Fixed to the body.
    Mounted(MountedCameraConfig),
    /// As in gym-pybullet-drones: 64×48 pixels of 60 degrees both across and up, an arm's length above the drone, never
    /// tilted sideways.
    Paper(ReferenceCameraConfig),
}

/// A pinhole camera with square pixels, fixed to the body.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MountedCameraConfig {
    /// Pixels of a row.
    pub columns: u64,
    /// Rows.
    pub rows: u64,
    /// Angle of view across.
    pub field_of_view_deg: f64,
    /// Where it is in the body: `[forward, left, up]`.
    pub position_m: [f64; 3],
    /// How far it looks down.
    pub pitch_deg: f64,
    /// What a pixel tells.
    pub channels: Vec<ChannelConfig>,
    /// Depth that reads as 255, and everything beyond.
    pub depth_limit_m: f64,
    /// Control periods from one image to the next; it is held in between.
    pub control_periods_per_image: u64,
    /// Standard deviation of the noise of each colour of each pixel, where 255 is white.
    pub noise: f64,
    /// Each episode has a factor on all colours, drawn from one plus or minus this.
    pub exposure_fraction: f64,
    /// Time for which the shutter is open: colours are averaged over it.
    pub shutter_secs: f64,
    /// Control periods from an image to its arrival.
    pub latency_periods: u64,
    /// Each episode has a focal length, drawn from one plus or minus this of what the angle of view says.
    pub focal_fraction: f64,
    /// Each episode has a mounting that is turned about each axis of the body by up to so much.
    pub mounting_error_deg: f64,
    /// Images that the policy gets at once, side by side in each pixel: the last ones, the newest first.
    pub frames: u64,
    /// How many images lie from one of them to the next.
    pub images_per_frame: u64,
}

/// The reference's camera.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReferenceCameraConfig {
    /// What a pixel tells: `rgba` is its observation `BOTH`, `depth_buffer` its `DEPTH` in bytes.
    pub channels: Vec<ChannelConfig>,
    /// Depth that the channel `depth` reads as 255, and everything beyond.
    pub depth_limit_m: f64,
    /// Control periods from one image to the next; 2 are its 24 Hz.
    pub control_periods_per_image: u64,
}

/// What some bytes of a pixel tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ChannelConfig {
    /// Red, green, blue: 3 bytes.
    Rgb,
    /// Their luma, what a camera without colours sees: 1 byte.
    Grey,
    /// Red, green, blue and 255: 4 bytes.
    Rgba,
    /// Depth along the optical axis, 255 at `depth_limit_m`: 1 byte.
    Depth,
    /// The depth buffer of a renderer, 255 at the farthest: 1 byte.
    DepthBuffer,
    /// What is seen: 0 nothing, 1 the floor, 2 the first solid of the world, and so on, at most 255: 1 byte.
    Labels,
}

impl Default for MountedCameraConfig {
    fn default() -> Self {
        Self {
            columns: 32,
            rows: 24,
            field_of_view_deg: 90.0,
            position_m: [0.03, 0.0, 0.01],
            pitch_deg: 0.0,
            channels: vec![ChannelConfig::Rgb],
            depth_limit_m: 8.0,
            control_periods_per_image: 1,
            noise: 0.0,
            exposure_fraction: 0.0,
            shutter_secs: 0.0,
            latency_periods: 0,
            focal_fraction: 0.0,
            mounting_error_deg: 0.0,
            frames: 1,
            images_per_frame: 1,
        }
    }
}

impl Default for ReferenceCameraConfig {
    fn default() -> Self {
        Self { channels: vec![ChannelConfig::Rgba], depth_limit_m: 8.0, control_periods_per_image: 2 }
    }
}

impl CameraConfig {
    pub(super) fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<OnboardCamera, ConfigError> {
        let camera = match self {
            Self::Mounted(config) => config.check(&field.at("mounted"))?,
            Self::Paper(config) => config.check(airframe, &field.at("paper"))?,
        };
        let bytes = camera.image_len();
        if bytes > MEGABYTE {
            return Err(field.reject(format!("images of {bytes} bytes"), "images of at most 1 MiB"));
        }
        Ok(camera)
    }
}

impl MountedCameraConfig {
    fn check(&self, field: &Field<'_>) -> Result<OnboardCamera, ConfigError> {
        let side = |key: &str, value| field.at(key).whole(value, 8..=SIDE_LIMIT).map(|side| side as usize);
        let (columns, rows) = (side("columns", self.columns)?, side("rows", self.rows)?);
        let across =
            field.at("field_of_view_deg").real(self.field_of_view_deg, &Limits::from(1.0, 160.0, "degrees"))?;
        let tangent = libm::tan(across.to_radians() / 2.0);
        let position = field.at("position_m").reals(self.position_m, &Limits::from(-1.0, 1.0, "m"))?;
        let pitch = field.at("pitch_deg").real(self.pitch_deg, &Limits::from(-90.0, 90.0, "degrees"))?;
        Ok(OnboardCamera {
            camera: Camera {
                columns,
                rows,
                tangents: [tangent, tangent * rows as f64 / columns as f64],
                sample: [0.5; 2],
                near_m: NEAR_M,
                far_m: Camera::REFERENCE.far_m,
            },
            mount: Mount::Body { position: Vector3::from(position), pitch: pitch.to_radians() },
            channels: ChannelConfig::check_all(&self.channels, self.depth_limit_m, field)?,
            control_periods_per_image: periods(self.control_periods_per_image, field)?,
            optics: self.optics(field)?,
            frames: field.at("frames").whole(self.frames, 1..=FRAMES_LIMIT)? as u32,
            images_per_frame: field.at("images_per_frame").whole(self.images_per_frame, 1..=PERIODS_LIMIT)? as u32,
        })
    }

    fn optics(&self, field: &Field<'_>) -> Result<Optics, ConfigError> {
        let number = |key: &str, value, limits| field.at(key).number(value, &limits);
        Ok(Optics {
            noise: number("noise", self.noise, Limits::from(0.0, 64.0, ""))?,
            exposure: number("exposure_fraction", self.exposure_fraction, Limits::from(0.0, 0.9, ""))?,
            shutter_secs: field.at("shutter_secs").real(self.shutter_secs, &Limits::from(0.0, 0.1, "s"))?,
            latency_periods: field.at("latency_periods").whole(self.latency_periods, 0..=PERIODS_LIMIT)? as u32,
            focal: field.at("focal_fraction").real(self.focal_fraction, &Limits::from(0.0, 0.5, ""))?,
            turn: field
                .at("mounting_error_deg")
                .real(self.mounting_error_deg, &Limits::from(0.0, 45.0, "degrees"))?
                .to_radians(),
        })
    }
}

impl ReferenceCameraConfig {
    fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<OnboardCamera, ConfigError> {
        Ok(OnboardCamera {
            camera: Camera { near_m: airframe.arm, ..Camera::REFERENCE },
            mount: Mount::Reference { arm_m: airframe.arm },
            channels: ChannelConfig::check_all(&self.channels, self.depth_limit_m, field)?,
            control_periods_per_image: periods(self.control_periods_per_image, field)?,
            optics: Optics::default(),
            frames: 1,
            images_per_frame: 1,
        })
    }
}

impl ChannelConfig {
    /// The channels of a camera; `field` is that of the camera.
    fn check_all(channels: &[Self], depth_limit_m: f64, field: &Field<'_>) -> Result<Vec<Channel>, ConfigError> {
        let limit_m = field.at("depth_limit_m").real(depth_limit_m, &Limits::from(0.1, 1000.0, "m"))?;
        let field = field.at("channels");
        if channels.is_empty() {
            return Err(field.reject("no channel", "at least one, such as `rgb`"));
        }
        for (index, channel) in channels.iter().enumerate() {
            if channels[..index].contains(channel) {
                return Err(field.at(index).reject("a channel that is there already", "each channel once"));
            }
        }
        let channel = |channel: &Self| match channel {
            Self::Rgb => Channel::Rgb,
            Self::Grey => Channel::Grey,
            Self::Rgba => Channel::Rgba,
            Self::Depth => Channel::Depth { limit_m },
            Self::DepthBuffer => Channel::DepthBuffer,
            Self::Labels => Channel::Labels,
        };
        Ok(channels.iter().map(channel).collect())
    }
}

fn periods(value: u64, field: &Field<'_>) -> Result<u32, ConfigError> {
    let periods = field.at("control_periods_per_image").whole(value, 1..=PERIODS_LIMIT)?;
    Ok(periods as u32)
}
