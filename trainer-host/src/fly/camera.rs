//! What a camera on board sees, streamed while the drone flies.

use std::iter;
use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use kestrel_draw::picture::Picture;
use kestrel_draw::video::h264::{Effort, EncodingError, H264Encoder, parameter_sets};
use kestrel_draw::video::{RecordedScene, VideoError};
use kestrel_draw::viewer::Glimpse;
use kestrel_experiments::output::warn;
use kestrel_shim::ai_deck::{self, AiDeck, AiDeckError};
use kestrel_shim::message::sent::camera::CameraProfile;
use kestrel_shim::video::{self, RtspServer};

/// Columns and rows of the pictures \[px\], and how many a second.
const SIZE: [u16; 2] = [640, 480];
const RATE_HZ: u8 = 25;

/// Pictures a second of the AI-deck: what its camera takes by default.
const DECK_RATE_HZ: u8 = 15;

/// Angle of view of both, across \[degrees\].
const VIEW_ANGLE_DEG: u16 = 90;

/// Where its pictures are to be had.
#[derive(Clone, Debug, Default, PartialEq, clap::Args)]
pub(crate) struct CameraOptions {
    /// Stream what a camera on board sees at this address [127.0.0.1:8554] by RTSP, of which ground stations are told
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "127.0.0.1:8554")]
    pub(crate) video: Option<SocketAddr>,

    /// Stream what it sees at this address [127.0.0.1:5000] as Bitcraze's example for the AI-deck does
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = "127.0.0.1:5000")]
    pub(crate) ai_deck: Option<SocketAddr>,
}

/// Why there are no pictures.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CameraError {
    /// The address of the video is taken.
    #[error(transparent)]
    Rtsp(#[from] video::VideoError),
    /// The address of the AI-deck is taken.
    #[error(transparent)]
    AiDeck(#[from] AiDeckError),
    /// The drone is where no camera can follow.
    #[error(transparent)]
    Lost(#[from] VideoError),
    /// The encoder fails.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
}

/// A camera whose pictures somebody may look at.
pub(crate) struct OnboardCamera {
    /// Of the video, if there is one.
    pub(crate) profile: Option<CameraProfile>,
    /// Of the AI-deck, if there is one.
    pub(crate) deck: Option<SocketAddr>,
    /// Who is to be told of the flight.
    pub(crate) spectator: Sender<Glimpse>,
}

impl OnboardCamera {
    /// Listens where the options say, if they do.
    ///
    /// # Errors
    /// If it cannot.
    pub(crate) fn open(options: &CameraOptions) -> Result<Option<Self>, CameraError> {
        let video = options.video.map(Video::open).transpose()?;
        let deck = options.ai_deck.map(AiDeck::open).transpose()?;
        if video.is_none() && deck.is_none() {
            return Ok(None);
        }
        let profile = video.as_ref().map(|video| CameraProfile {
            url: video.server.url(),
            size: SIZE,
            rate_hz: RATE_HZ.into(),
            view_angle_deg: VIEW_ANGLE_DEG,
        });
        let address = deck.as_ref().map(AiDeck::address);
        let (spectator, glimpses) = channel();
        thread::spawn(move || {
            if let Err(error) = stream(&glimpses, video, deck) {
                warn(format_args!("The camera on board stops: {error}"));
            }
        });
        Ok(Some(Self { profile, deck: address, spectator }))
    }
}

/// Streams pictures of what is told, while anybody looks.
fn stream(
    glimpses: &Receiver<Glimpse>,
    mut video: Option<Video>,
    mut deck: Option<AiDeck>,
) -> Result<(), CameraError> {
    let mut scene: Option<RecordedScene> = None;
    let (mut clock, mut control_secs) = (0.0, 0.0);
    let [mut video_due, mut deck_due] = [0.0; 2];
    while let Ok(first) = glimpses.recv() {
        for glimpse in iter::once(first).chain(glimpses.try_iter()) {
            match (glimpse, &mut scene) {
                (Glimpse::Begins(scenario, flight), _) => {
                    control_secs = f64::from(flight.control_secs);
                    scene = Some(RecordedScene::new(flight, &scenario, "the flight")?);
                }
                (Glimpse::GoesOn(frame), Some(scene)) => {
                    scene.push(frame, "the flight")?;
                    clock += control_secs;
                }
                (Glimpse::GoesOn(_), None) | (Glimpse::Ends { .. }, _) => {}
            }
        }
        let Some(scene) = &scene else { continue };
        if let Some(video) = video.as_mut().filter(|video| video.server.is_watched())
            && is_due(clock, &mut video_due, RATE_HZ)
        {
            video.send(&seen(scene, SIZE), clock)?;
        }
        if let Some(deck) = deck.as_mut()
            && is_due(clock, &mut deck_due, DECK_RATE_HZ)
            && deck.is_watched()
        {
            deck.send(&grey(&seen(scene, ai_deck::SIZE)));
        }
    }
    Ok(())
}

/// Whether the next of so many pictures a second is due.
fn is_due(clock: f64, due: &mut f64, rate_hz: u8) -> bool {
    if clock < *due {
        return false;
    }
    let period = f64::from(rate_hz).recip();
    // What was missed is not made up for.
    *due = (*due + period).max(clock);
    true
}

/// What the camera sees now.
fn seen(scene: &RecordedScene, size: [u16; 2]) -> Picture {
    let size = size.map(usize::from);
    let (_, image) = scene.on_board(0, scene.secs(), size, f64::from(VIEW_ANGLE_DEG).to_radians());
    Picture { size, pixels: image.colours }
}

/// Brightness by ITU-R BT.601.
fn grey(picture: &Picture) -> Vec<u8> {
    let brightness = |[red, green, blue]: [u8; 3]| {
        (0.299 * f32::from(red) + 0.587 * f32::from(green) + 0.114 * f32::from(blue)).round() as u8
    };
    picture.pixels.iter().map(|pixel| brightness(*pixel)).collect()
}

/// An encoder, and who plays what it makes.
struct Video {
    server: RtspServer,
    encoder: H264Encoder,
}

impl Video {
    fn open(address: SocketAddr) -> Result<Self, CameraError> {
        let [columns, rows] = SIZE;
        let size = SIZE.map(usize::from);
        let mut encoder = H264Encoder::new(size, RATE_HZ.into(), Effort::Live)?
            .ok_or(VideoError::Size { format: kestrel_draw::video::VideoFormat::Mp4, size })?;
        let [sequence_parameter_set, picture_parameter_set] =
            parameter_sets(&encoder.encode(&Picture::new(size, [0; 3]))?);
        let format =
            video::VideoFormat { columns, rows, rate_hz: RATE_HZ, sequence_parameter_set, picture_parameter_set };
        Ok(Self { server: RtspServer::open(address, format)?, encoder })
    }

    fn send(&mut self, picture: &Picture, secs: f64) -> Result<(), CameraError> {
        if self.server.take_newcomers() {
            self.encoder.request_key();
        }
        self.server.send(&self.encoder.encode(picture)?, secs);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_due_at_their_rate_and_none_is_made_up_for() {
        let mut due = 0.0;
        let count = (0..100).filter(|tick| is_due(f64::from(*tick) * 0.02, &mut due, 25)).count();
        assert_eq!(count, 50);
        assert!(is_due(10.0, &mut due, 25) && is_due(10.02, &mut due, 25) && !is_due(10.03, &mut due, 25));
    }

    #[test]
    fn grey_is_brightness() {
        let picture = Picture { size: [3, 1], pixels: vec![[255; 3], [255, 0, 0], [0; 3]] };
        assert_eq!(grey(&picture), [255, 76, 0]);
    }
}
