//! What a real camera does to its images.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{Camera, Image};
use crate::contact::Motion;
use crate::seed::Stream;
use crate::world::Pose;

/// Instants of an exposure that are averaged.
pub(crate) const INSTANTS: u32 = 4;

/// Standard deviation of the sum of four uniform bytes: √(4 (256² − 1) / 12).
const BYTES_SPREAD: f32 = 147.8;

/// Where a camera differs from a perfect one. Depth and labels are always perfect.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Optics {
    /// Standard deviation of the noise of each colour of each pixel, where 255 is white.
    pub noise: f32,
    /// Each episode has a factor on all colours, uniform in `1 ± exposure`; in \[0, 1).
    pub exposure: f32,
    /// Time for which the shutter is open \[s\]: colours are averaged over it.
    pub shutter_secs: f64,
    /// Control periods from an image's end to its arrival.
    pub latency_periods: u32,
    /// Each episode has a focal length, uniform in `1 ± focal` of the camera's; in \[0, 1).
    pub focal: f64,
    /// Each episode has a mounting that is turned about each axis of the body, uniform in ± so much \[rad\].
    pub turn: f64,
}

/// How the camera of a drone differs from that of the airframe in an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Calibration {
    /// Of the focal length.
    factor: f64,
    /// Of the mounting \[rad, body\].
    turn: [f64; 3],
}

impl Default for Calibration {
    fn default() -> Self {
        Self { factor: 1.0, turn: [0.0; 3] }
    }
}

impl Calibration {
    /// The camera with its own focal length.
    pub(crate) fn camera(&self, camera: &Camera) -> Camera {
        Camera { tangents: camera.tangents.map(|tangent| tangent / self.factor), ..*camera }
    }

    /// A drone whose camera looks where the one that is mounted askew does.
    pub(crate) fn askew(&self, drone: &Pose) -> Pose {
        let turn = Vector3::from(self.turn);
        let Some(axis) = turn.try_normalize(0.0) else { return *drone };
        let turn = Attitude::from_axis_angle(axis, turn.norm());
        Pose { position: drone.position, world_from_body: drone.world_from_body.after(&turn) }
    }
}

impl Optics {
    /// The factor on all colours of an episode.
    pub(crate) fn draw_gain(&self, stream: &mut Stream) -> f32 {
        if self.exposure == 0.0 { 1.0 } else { stream.between(1.0 - self.exposure, 1.0 + self.exposure) }
    }

    /// What an episode's camera is like.
    pub(crate) fn draw_calibration(&self, stream: &mut Stream) -> Calibration {
        let mut within =
            |limit: f64| if limit == 0.0 { 0.0 } else { limit * f64::from(stream.between(-1.0, 1.0)) };
        Calibration { factor: 1.0 + within(self.focal), turn: [self.turn; 3].map(within) }
    }

    /// Where a drone was at each of the instants that make an image, the last one first; only where it is now without a
    /// shutter.
    pub(crate) fn instants(&self, drone: &Motion) -> Vec<Pose> {
        if self.shutter_secs == 0.0 {
            return vec![drone.pose];
        }
        let ago = |instant: u32| self.shutter_secs * f64::from(instant) / f64::from(INSTANTS);
        (0..INSTANTS).map(|instant| earlier(drone, ago(instant))).collect()
    }

    /// Makes an image too bright or too dark, and noisy.
    pub(crate) fn spoil(&self, gain: f32, stream: &mut Stream, image: &mut Image) {
        if gain == 1.0 && self.noise == 0.0 {
            return;
        }
        let (scale, nonce) = (self.noise / BYTES_SPREAD, stream.next_u32());
        for (place, colour) in (0_u32..).zip(image.colours.as_flattened_mut()) {
            let sum: u32 = scrambled(place ^ nonce).to_le_bytes().into_iter().map(u32::from).sum();
            let noisy = gain * f32::from(*colour) + scale * (sum as f32 - 510.0);
            *colour = (noisy + 0.5) as u8;
        }
    }
}

/// Where a drone was some time ago, had it moved all the time as it does now.
fn earlier(drone: &Motion, secs: f64) -> Pose {
    let axis = drone.body_rates.try_normalize(0.0).unwrap_or_else(Vector3::z);
    let back = Attitude::from_axis_angle(axis, -drone.body_rates.norm() * secs);
    Pose {
        position: drone.pose.position - drone.velocity * secs,
        world_from_body: drone.pose.world_from_body.after(&back),
    }
}

/// A number whose bits look random, of another one (the finaliser of `MurmurHash3`, Appleby 2011).
fn scrambled(number: u32) -> u32 {
    let mut bits = number.wrapping_mul(0x9E37_79B9);
    bits = (bits ^ bits >> 16).wrapping_mul(0x85EB_CA6B);
    bits = (bits ^ bits >> 13).wrapping_mul(0xC2B2_AE35);
    bits ^ bits >> 16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Purpose, Seed};

    fn grey() -> Image {
        Image { columns: 100, depths: vec![1.0; 10_000], labels: vec![0; 10_000], colours: vec![[100; 3]; 10_000] }
    }

    fn stream() -> Stream {
        Stream::new(Seed(3), 0, Purpose::Camera)
    }

    #[test]
    fn noise_has_its_mean_and_spread_and_differs_from_image_to_image() {
        let optics = Optics { noise: 8.0, ..Optics::default() };
        let (mut stream, mut images) = (stream(), [grey(), grey()]);
        for image in &mut images {
            optics.spoil(1.0, &mut stream, image);
        }
        assert_ne!(images[0].colours, images[1].colours);
        assert_eq!((&images[0].depths, &images[0].labels), (&grey().depths, &grey().labels));
        let errors = images[0].colours.as_flattened().iter().map(|value| f64::from(*value) - 100.0);
        let (sum, squares) =
            errors.fold((0.0, 0.0), |(sum, squares), error| (sum + error, squares + error * error));
        let (mean, spread) = (sum / 30_000.0, (squares / 30_000.0_f64).sqrt());
        assert!(mean.abs() < 0.2 && (spread - 8.0).abs() < 0.2, "mean {mean}, spread {spread}");
    }

    #[test]
    fn exposure_is_one_factor_that_ends_at_black_and_white() {
        let optics = Optics { exposure: 0.5, ..Optics::default() };
        let mut stream = stream();
        let gains: Vec<f32> = (0..200).map(|_| optics.draw_gain(&mut stream)).collect();
        let [least, most] = [f32::min, f32::max].map(|pick| gains.iter().copied().reduce(pick).unwrap());
        assert!(least > 0.5 && least < 0.52 && most < 1.5 && most > 1.48, "{least} to {most}");
        let mut image = Image { colours: vec![[0, 100, 200]], ..Image::default() };
        optics.spoil(1.4, &mut stream, &mut image);
        assert_eq!(image.colours, [[0, 140, 255]]);
        assert_eq!(Optics::default().draw_gain(&mut stream), 1.0);
    }

    #[test]
    fn a_calibration_turns_the_view_and_scales_the_focal_length_within_its_limits() {
        let optics = Optics { focal: 0.1, turn: 0.05, ..Optics::default() };
        let (mut stream, drone) = (stream(), Pose::at(Vector3::new(1.0, 2.0, 3.0)));
        let [mut widest, mut farthest] = [0.0_f64; 2];
        for _ in 0..500 {
            let own = optics.draw_calibration(&mut stream);
            let scale = Camera::REFERENCE.tangents[0] / own.camera(&Camera::REFERENCE).tangents[0];
            widest = widest.max((scale - 1.0).abs());
            let askew = own.askew(&drone);
            assert_eq!(askew.position, drone.position);
            let apart = askew.world_from_body.rotate(Vector3::x()).angle(&Vector3::x());
            farthest = farthest.max(apart);
        }
        // About two axes at once.
        assert!(widest > 0.098 && widest < 0.1 && farthest > 0.06 && farthest < 0.072, "{widest} {farthest}");
        let perfect = Optics::default().draw_calibration(&mut stream);
        assert_eq!((perfect, perfect.askew(&drone)), (Calibration::default(), drone));
    }

    #[test]
    fn an_open_shutter_sees_where_the_drone_was() {
        let turning = Motion {
            pose: Pose { position: Vector3::new(1.0, 0.0, 1.0), world_from_body: Attitude::level() },
            velocity: Vector3::new(2.0, 0.0, 0.0),
            body_rates: Vector3::new(0.0, 0.0, 3.0),
        };
        let optics = Optics { shutter_secs: 0.02, ..Optics::default() };
        let poses = optics.instants(&turning);
        assert_eq!((poses.len(), poses[0]), (4, turning.pose));
        // Three quarters of the time ago.
        let (last, angle) = (poses[3], -3.0 * 0.015);
        assert!((last.position - Vector3::new(0.97, 0.0, 1.0)).norm() < 1e-12);
        let ahead = last.world_from_body.rotate(Vector3::x());
        assert!((ahead - Vector3::new(libm::cos(angle), libm::sin(angle), 0.0)).norm() < 1e-12, "{ahead}");
        assert_eq!(Optics::default().instants(&turning), [turning.pose]);
    }
}
