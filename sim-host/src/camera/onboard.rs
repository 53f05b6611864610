//! The camera that a drone carries, and the bytes of its images that a policy gets.

use nalgebra::Vector3;

use super::{Camera, Image, Optics, View};
use crate::world::Pose;

/// A drone's camera; where a policy has images, all drones have the same.
#[derive(Clone, Debug, PartialEq)]
pub struct OnboardCamera {
    /// What it is.
    pub camera: Camera,
    /// Where it is.
    pub mount: Mount,
    /// What a pixel tells, in this order; at least one.
    pub channels: Vec<Channel>,
    /// Control periods from one image to the next, at least one; it is held in between.
    pub control_periods_per_image: u32,
    /// Where it differs from a perfect one.
    pub optics: Optics,
    /// Images that a policy gets at once, at least one: the last ones, the newest first.
    pub frames: u32,
    /// How many images lie from one of them to the next, at least one.
    pub images_per_frame: u32,
}

/// How a camera is fixed to a drone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mount {
    /// As in the reference: so far above the drone's centre in the world \[m\], and never tilted sideways.
    Reference {
        /// The arm's length of the airframe.
        arm_m: f64,
    },
    /// Fixed to the body.
    Body {
        /// \[m, body\].
        position: Vector3<f64>,
        /// How far the optical axis is turned from forward to downward \[rad\].
        pitch: f64,
    },
}

/// What some bytes of a pixel tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Channel {
    /// Red, green, blue.
    Rgb,
    /// Luma of the three, as ITU-R BT.601 weighs them: what a sensor without colour filters sees.
    Grey,
    /// The same as `Rgb` and an opaque 255, as the reference has it.
    Rgba,
    /// Depth along the optical axis: 255 is this \[m\] and everything beyond.
    Depth {
        /// Greater than zero.
        limit_m: f64,
    },
    /// What a depth buffer holds: 255 is the farthest that is seen, and half of that is twice as far as the nearest. The
    /// reference's, in bytes.
    DepthBuffer,
    /// Label of what is seen, at most 255.
    Labels,
}

impl OnboardCamera {
    /// Bytes of a pixel of what a policy gets: the channels of each frame, the newest first.
    pub fn pixel_len(&self) -> usize {
        self.frames as usize * self.frame_pixel_len()
    }

    /// Bytes of what a policy gets, `[rows][columns][frames][channels]`.
    pub fn image_len(&self) -> usize {
        self.frames as usize * self.frame_len()
    }

    /// Bytes of one image, `[rows][columns][channels]`.
    pub fn frame_len(&self) -> usize {
        self.camera.rows * self.camera.columns * self.frame_pixel_len()
    }

    fn frame_pixel_len(&self) -> usize {
        self.channels.iter().map(|channel| channel.bytes()).sum()
    }

    /// Whether an image is taken when so many control periods of an episode have passed: at its start, and whenever the
    /// camera's number of them is over. The reference counts from one: it takes the second image after the first period.
    pub fn is_due(&self, period: u32) -> bool {
        let every = self.control_periods_per_image;
        match self.mount {
            Mount::Body { .. } => period.is_multiple_of(every),
            Mount::Reference { .. } => period == 0 || (period - 1).is_multiple_of(every),
        }
    }

    /// What the camera of a drone looks at.
    pub fn view(&self, drone: &Pose) -> View {
        match self.mount {
            Mount::Reference { arm_m } => View::paper(drone, arm_m),
            Mount::Body { position, pitch } => {
                let turned = |axis: Vector3<f64>| drone.world_from_body.rotate(axis);
                let (sine, cosine) = libm::sincos(pitch);
                View {
                    eye: drone.position + turned(position),
                    right: turned(-Vector3::y()),
                    down: turned(Vector3::new(-sine, 0.0, -cosine)),
                    forward: turned(Vector3::new(cosine, 0.0, -sine)),
                }
            }
        }
    }

    /// Writes the bytes of an image of this camera, `[rows][columns][channels]`.
    ///
    /// # Panics
    /// When the image or the place for it has another size.
    pub fn write(&self, image: &Image, bytes: &mut [u8]) {
        assert_eq!(bytes.len(), self.frame_len(), "an image has so many bytes");
        let stride = self.frame_pixel_len();
        let mut first = 0;
        for channel in &self.channels {
            let places = bytes.chunks_exact_mut(stride).map(|pixel| &mut pixel[first..first + channel.bytes()]);
            match *channel {
                Channel::Rgb | Channel::Rgba => write_colours(image, places),
                Channel::Grey => write_bytes(&image.colours, places, luma),
                Channel::Depth { limit_m } => {
                    let scale = (255.0 / limit_m) as f32;
                    write_bytes(&image.depths, places, |depth| (depth * scale + 0.5) as u8);
                }
                Channel::DepthBuffer => {
                    let Camera { near_m, far_m, .. } = self.camera;
                    let at = (far_m / (far_m - near_m)) as f32;
                    let near = near_m as f32;
                    write_bytes(&image.depths, places, |depth| (255.0 * (at - at * near / depth) + 0.5) as u8);
                }
                Channel::Labels => write_bytes(&image.labels, places, |label| label.min(255) as u8),
            }
            first += channel.bytes();
        }
    }

    /// Puts one image among those that a policy gets at once.
    ///
    /// # Panics
    /// When the image or the place for all has another size.
    pub(crate) fn stack(&self, frame: usize, bytes: &[u8], stacked: &mut [u8]) {
        assert_eq!((bytes.len(), stacked.len()), (self.frame_len(), self.image_len()), "sizes of a stack");
        let len = self.frame_pixel_len();
        let places = stacked.chunks_exact_mut(self.pixel_len()).map(|pixel| &mut pixel[frame * len..][..len]);
        places.zip(bytes.chunks_exact(len)).for_each(|(place, pixel)| place.copy_from_slice(pixel));
    }
}

impl Channel {
    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            Self::Rgb => 3,
            Self::Rgba => 4,
            Self::Grey | Self::Depth { .. } | Self::DepthBuffer | Self::Labels => 1,
        }
    }
}

/// ITU-R BT.601, in parts of 256.
fn luma([red, green, blue]: [u8; 3]) -> u8 {
    let sum = 77 * u32::from(red) + 150 * u32::from(green) + 29 * u32::from(blue);
    ((sum + 128) >> 8) as u8
}

/// What is behind the colours, if anything, is opaque.
fn write_colours<'a>(image: &Image, places: impl Iterator<Item = &'a mut [u8]>) {
    for (place, colour) in places.zip(&image.colours) {
        let (rgb, alpha) = place.split_at_mut(3);
        rgb.copy_from_slice(colour);
        alpha.fill(255);
    }
}

fn write_bytes<'a, T: Copy>(values: &[T], places: impl Iterator<Item = &'a mut [u8]>, byte: impl Fn(T) -> u8) {
    for (place, value) in places.zip(values) {
        place[0] = byte(*value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_core::attitude::Attitude;

    fn camera(channels: Vec<Channel>) -> OnboardCamera {
        let camera = Camera { columns: 2, rows: 1, near_m: 0.5, far_m: 100.0, ..Camera::REFERENCE };
        let mount = Mount::Body { position: Vector3::new(0.03, 0.0, 0.01), pitch: 0.0 };
        let optics = Optics::default();
        OnboardCamera {
            camera,
            mount,
            channels,
            control_periods_per_image: 1,
            optics,
            frames: 1,
            images_per_frame: 1,
        }
    }

    fn image() -> Image {
        Image { columns: 2, depths: vec![1.0, 100.0], labels: vec![7, 300], colours: vec![[1, 2, 3], [4, 5, 6]] }
    }

    #[test]
    fn channels_of_a_pixel_lie_side_by_side() {
        let camera = camera(vec![Channel::Rgb, Channel::Depth { limit_m: 4.0 }, Channel::Labels]);
        let mut bytes = vec![0; camera.image_len()];
        camera.write(&image(), &mut bytes);
        assert_eq!(bytes, [1, 2, 3, 64, 7, 4, 5, 6, 255, 255]);
    }

    #[test]
    fn the_references_bytes_are_opaque_colours_and_a_depth_buffer() {
        let camera = camera(vec![Channel::Rgba, Channel::DepthBuffer]);
        let mut bytes = vec![0; camera.image_len()];
        camera.write(&image(), &mut bytes);
        // Twice as far as the nearest is half of the buffer, by (f - fn/z) / (f - n) = 0.5025.
        assert_eq!(bytes, [1, 2, 3, 255, 128, 4, 5, 6, 255, 255]);
    }

    #[test]
    fn grey_is_luma_and_frames_lie_in_each_pixel() {
        let camera = OnboardCamera { frames: 2, ..camera(vec![Channel::Grey, Channel::Labels]) };
        assert_eq!((camera.frame_len(), camera.pixel_len(), camera.image_len()), (4, 4, 8));
        let mut bytes = vec![0; camera.frame_len()];
        let colours = vec![[255; 3], [100, 50, 200]];
        camera.write(&Image { colours, ..image() }, &mut bytes);
        // 0.299 · 100 + 0.587 · 50 + 0.114 · 200 = 82.05.
        assert_eq!(bytes, [255, 7, 82, 255]);
        let mut stacked = vec![0; camera.image_len()];
        camera.stack(0, &bytes, &mut stacked);
        camera.stack(1, &[1, 2, 3, 4], &mut stacked);
        assert_eq!(stacked, [255, 7, 1, 2, 82, 255, 3, 4]);
    }

    #[test]
    fn images_are_taken_at_the_start_and_then_at_a_pace() {
        let held = OnboardCamera { control_periods_per_image: 3, ..camera(vec![Channel::Rgb]) };
        let due = |camera: &OnboardCamera| (0..8).filter(|period| camera.is_due(*period)).collect::<Vec<u32>>();
        assert_eq!(due(&held), [0, 3, 6]);
        let paper = OnboardCamera { mount: Mount::Reference { arm_m: 0.04 }, ..held };
        assert_eq!(due(&paper), [0, 1, 4, 7]);
    }

    #[test]
    fn a_camera_on_the_body_turns_with_it() {
        let quarter = core::f64::consts::FRAC_1_SQRT_2;
        let left = Pose {
            position: Vector3::new(1.0, 2.0, 3.0),
            world_from_body: Attitude { w: quarter, x: 0.0, y: 0.0, z: quarter },
        };
        let close = |one: Vector3<f64>, other: [f64; 3]| (one - Vector3::from(other)).norm() < 1e-12;
        let view = camera(vec![Channel::Rgb]).view(&left);
        assert!(close(view.eye, [1.0, 2.03, 3.01]) && close(view.forward, [0.0, 1.0, 0.0]), "{view:?}");
        assert!(close(view.right, [1.0, 0.0, 0.0]) && close(view.down, [0.0, 0.0, -1.0]), "{view:?}");
        let mount = Mount::Body { position: Vector3::zeros(), pitch: core::f64::consts::FRAC_PI_2 };
        let view = OnboardCamera { mount, ..camera(vec![Channel::Rgb]) }.view(&left);
        assert!(close(view.forward, [0.0, 0.0, -1.0]) && close(view.down, [0.0, -1.0, 0.0]), "{view:?}");
    }
}
