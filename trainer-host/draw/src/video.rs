//! Videos of flights as cameras see them: from behind, on board, how far things are and what they are.
//!
//! A [`RecordedScene`] is a recorded flight in its world. A [`Video`] looks at it in a [`Style`] and makes a [`Picture`] of any
//! moment, or all of them, 25 a second, as GIF or MP4. The same flight gives the same bytes, for any number of threads.

pub(crate) mod channel;
pub(crate) mod chase;
pub(crate) mod gif_writer;
#[cfg(feature = "mp4")]
pub mod h264;
#[cfg(feature = "mp4")]
mod mp4_writer;
mod palette;
pub(crate) mod playback;
pub(crate) mod recorded_scene;
pub(crate) mod shadow;
#[cfg(test)]
mod tests;
pub(crate) mod trail;

use std::path::Path;

use kestrel_sim::camera::{Camera, Cpu, Image, RenderError, Renderer, Scene, Shot};
use kestrel_sim::scenario::Scenario;
use rayon::prelude::*;

pub use channel::{DepthScale, label_colour};
pub use recorded_scene::RecordedScene;

use crate::drawing::PngError;
use crate::picture::{Picture, Rgb, text_width};
use crate::recorded_flight::{FlightError, FlightRecording};
use channel::LEGEND;
use chase::{Chase, VIEW_ANGLE, on_board};
use gif_writer::{Format, PAUSE_SECS, Writer};
use palette::Palette;
use playback::{Moment, PICTURE_SECS};
use recorded_scene::Caption;

/// One of the pictures beside each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Panel {
    /// From behind the drone
    Chase,
    /// What its camera sees
    Onboard,
    /// How far away that is
    Depth,
    /// Which things that are
    Labels,
}

impl Panel {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Chase, Self::Onboard, Self::Depth, Self::Labels];

    fn name(self) -> &'static str {
        match self {
            Self::Chase => "chase",
            Self::Onboard => "on board",
            Self::Depth => "depth",
            Self::Labels => "labels",
        }
    }
}

/// How a flight is looked at.
#[derive(Clone, Debug, PartialEq)]
pub struct Style {
    /// What is beside each other, from the left; at least one.
    pub panels: Vec<Panel>,
    /// Columns and rows of each panel \[px\].
    pub size: [usize; 2],
    /// Angle of view of the drone's camera, across \[rad\].
    pub view_angle: f64,
    /// Rays across a pixel, and down it, whose colours are averaged.
    pub samples: usize,
    /// Which drone is followed.
    pub drone: usize,
}

/// Why there is no video.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The recording cannot be shown.
    #[error(transparent)]
    Flight(#[from] FlightError),
    /// A drone that no camera can follow.
    #[error(
        "{name}: frame {frame} of drone {drone} is {metres:e} m from the origin with an attitude of length {length}: \
         expected at most 1e5 m and a length of 1"
    )]
    Lost {
        /// The recording.
        name: String,
        /// Counted from zero.
        drone: usize,
        /// Counted from zero.
        frame: usize,
        /// Distance from the origin.
        metres: f32,
        /// Length of the quaternion.
        length: f32,
    },
    /// The cameras fail.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The file cannot be made.
    #[error(transparent)]
    Png(#[from] PngError),
    /// The encoder failed.
    #[error("cannot encode the flight as {}: {reason}", format.name())]
    Encoding {
        /// As what.
        format: VideoFormat,
        /// Its words.
        reason: String,
    },
    /// The format has no pictures of that size.
    #[error("found {}x{} pixels, expected at most {}", size[0], size[1], format.limit())]
    Size {
        /// Which one.
        format: VideoFormat,
        /// Columns and rows \[px\].
        size: [usize; 2],
    },
}

/// What kind of file a video is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VideoFormat {
    /// Endlessly repeated, in 255 colours; every viewer shows it.
    Gif,
    /// H.264, several times smaller; every browser and player shows it.
    #[cfg(feature = "mp4")]
    Mp4,
}

impl VideoFormat {
    /// By the ending of a file's name.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()? {
            "gif" => Some(Self::Gif),
            #[cfg(feature = "mp4")]
            "mp4" => Some(Self::Mp4),
            _ => None,
        }
    }

    fn failed(self, reason: &impl ToString) -> VideoError {
        VideoError::Encoding { format: self, reason: reason.to_string() }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Gif => "GIF",
            #[cfg(feature = "mp4")]
            Self::Mp4 => "MP4",
        }
    }

    /// The greatest size, in words.
    const fn limit(self) -> &'static str {
        match self {
            Self::Gif => "65535 across and down in a GIF",
            #[cfg(feature = "mp4")]
            Self::Mp4 => "8688 across and down and 9 million together in an MP4 (level 5.1 of H.264)",
        }
    }

    /// Says whether it has pictures of a size \[px\].
    ///
    /// # Errors
    /// When they are too large.
    pub fn check(self, size: [usize; 2]) -> Result<(), VideoError> {
        let fits = match self {
            Self::Gif => size.iter().all(|pixels| u16::try_from(*pixels).is_ok()),
            #[cfg(feature = "mp4")]
            Self::Mp4 => h264::level(size).is_some(),
        };
        if fits { Ok(()) } else { Err(VideoError::Size { format: self, size }) }
    }
}

pub(crate) const PAPER: Rgb = [247, 249, 251];
pub(crate) const INK: Rgb = [31, 41, 51];
pub(crate) const MUTED: Rgb = [107, 118, 131];
const GOOD: Rgb = [18, 138, 74];
const BAD: Rgb = [200, 45, 60];

/// Around and between panels \[px\].
const MARGIN: usize = 8;

/// Heights of the title, of a panel's name, and of the line below the panels \[px\].
const TITLE: usize = 28;
const NAME: usize = 12;
const FOOT: usize = 26;

/// Size of small words \[px\].
pub(crate) const SMALL: f32 = 11.0;

/// Width from which titles and captions are larger \[px\].
const WIDE: usize = 860;

/// Pictures from which the colours of a video and its scale of depths are taken.
const SAMPLED: usize = 16;

/// Pictures that are rendered before the next progress is told.
const CHUNK: usize = 16;

/// A flight, looked at in a style.
#[derive(Debug)]
pub struct Video<'a> {
    recorded: &'a RecordedScene,
    style: &'a Style,
    renderer: &'a dyn Renderer,
    chase: Chase,
    scale: DepthScale,
}

/// What the cameras see at a moment, larger by the samples.
struct Seen {
    chase: Option<Image>,
    on_board: Option<Image>,
}

impl<'a> Video<'a> {
    /// Looks for the camera's way and for a scale of depths that serves the whole video.
    ///
    /// # Panics
    /// When the recorded has no such drone, or the style no panel or pixel.
    pub fn new(recorded: &'a RecordedScene, style: &'a Style, renderer: &'a dyn Renderer) -> Self {
        assert!(style.drone < recorded.drones(), "{} drones fly, not number {}", recorded.drones(), style.drone);
        let (chase, scale) =
            (Chase::of(recorded, style.drone), recorded.depth_scale(style.drone, style.view_angle));
        Self { recorded, style, renderer, chase, scale }
    }

    /// How many pictures the video has.
    pub fn pictures(&self) -> usize {
        self.recorded.moments().len()
    }

    /// The picture of a time since the start \[s\]; after the end, of the last one. Depths have a scale of their own.
    ///
    /// # Errors
    /// When the renderer fails.
    pub fn at(&self, secs: f32) -> Result<Picture, VideoError> {
        let moment = self.recorded.moment(secs.clamp(0.0, self.recorded.secs()));
        let seen = self.see(&moment)?;
        let scale = DepthScale::of(&seen.on_board);
        Ok(self.compose(&moment, &seen, &scale))
    }

    /// The whole video as a file; nothing when `goes_on`, asked with the number of pictures that are done, says no.
    ///
    /// # Errors
    /// When the renderer or the encoder fails.
    pub fn file(
        &self,
        format: VideoFormat,
        goes_on: impl FnMut(usize) -> bool,
    ) -> Result<Option<Vec<u8>>, VideoError> {
        let moments = self.recorded.moments();
        let picture = |index: usize| Ok(self.compose(&moments[index], &self.see(&moments[index])?, &self.scale));
        film(format, moments.len(), picture, goes_on)
    }

    /// Columns and rows of the pictures \[px\].
    pub fn size(&self) -> [usize; 2] {
        let Style { panels, size: [width, height], .. } = self.style;
        let legend = if panels.contains(&Panel::Depth) { LEGEND + 3 } else { 0 };
        [MARGIN + panels.len() * (width + MARGIN), TITLE + NAME + height + legend + FOOT]
    }

    /// What the cameras see that the panels need.
    fn see(&self, moment: &Moment) -> Result<Seen, VideoError> {
        let Style { panels, size, view_angle, samples, drone } = self.style;
        let size = size.map(|pixels| pixels * samples);
        let image = |scene: &Scene, view, angle| {
            let shots = [Shot { scene: 0, view }];
            let images = self.renderer.render(&camera(size, angle), &[scene], &shots)?;
            Ok::<_, VideoError>(images.into_iter().next())
        };
        let chase = panels.contains(&Panel::Chase).then(|| {
            let view = self.chase.view(moment.elapsed_secs / PICTURE_SECS);
            let seen = image(&self.recorded.shown(moment), view, VIEW_ANGLE)?;
            Ok::<_, VideoError>(
                seen.map(|seen| self.recorded.shaded(seen, &camera(size, VIEW_ANGLE), &view, moment)),
            )
        });
        let on_board = panels.iter().any(|panel| *panel != Panel::Chase).then(|| {
            let view = on_board(self.recorded, &moment.drones[*drone].placement);
            image(&self.recorded.seen(moment, *drone), view, *view_angle)
        });
        Ok(Seen { chase: chase.transpose()?.flatten(), on_board: on_board.transpose()?.flatten() })
    }

    fn compose(&self, moment: &Moment, seen: &Seen, scale: &DepthScale) -> Picture {
        let Style { panels, size: [width, height], samples, drone, .. } = self.style;
        let mut picture = Picture::new(self.size(), PAPER);
        picture.text([MARGIN, 7], &self.recorded.flight.title, text_size(self.size()[0]), INK);
        for (index, panel) in panels.iter().enumerate() {
            let left = MARGIN + index * (width + MARGIN);
            picture.text([left, TITLE], panel.name(), SMALL, MUTED);
            let image = if *panel == Panel::Chase { &seen.chase } else { &seen.on_board };
            if let Some(image) = image {
                let mut pixels = coloured(image, *panel, scale).averaged(*samples);
                if *panel == Panel::Chase {
                    let view = self.chase.view(moment.elapsed_secs / PICTURE_SECS);
                    pixels = trail::drawn(self.recorded, moment, &view, image, &pixels);
                }
                picture.paste(&pixels, [left, TITLE + NAME]);
            }
            if *panel == Panel::Depth {
                scale.draw_legend(&mut picture, [left, TITLE + NAME + height + 4], *width, MUTED);
            }
        }
        let foot = picture.size[1] - FOOT + 8;
        draw_caption(&self.recorded.caption(moment, *drone), &mut picture, [MARGIN, foot]);
        picture
    }
}

/// A camera of so many columns and rows, with square pixels.
pub(crate) fn camera([columns, rows]: [usize; 2], view_angle: f64) -> Camera {
    let across = (0.5 * view_angle).tan();
    let tangents = [across, across * rows as f64 / columns as f64];
    Camera { columns, rows, tangents, sample: [0.5; 2], ..Camera::REFERENCE }
}

/// Indices evenly over a video, the first and the last among them.
fn sampled(pictures: usize) -> impl Iterator<Item = usize> {
    let count = pictures.min(SAMPLED);
    (0..count).map(move |index| index * (pictures - 1) / (count - 1).max(1))
}

/// A video of pictures, 25 a second, then a pause; nothing when `goes_on`, asked with the number that is done, says no.
/// Pictures are made in parallel on rayon's current pool, some of them twice.
pub(crate) fn film(
    format: VideoFormat,
    pictures: usize,
    picture: impl Fn(usize) -> Result<Picture, VideoError> + Sync,
    goes_on: impl FnMut(usize) -> bool,
) -> Result<Option<Vec<u8>>, VideoError> {
    match format {
        VideoFormat::Gif => gif(pictures, picture, goes_on),
        #[cfg(feature = "mp4")]
        VideoFormat::Mp4 => mp4(pictures, picture, goes_on),
    }
}

fn gif(
    pictures: usize,
    picture: impl Fn(usize) -> Result<Picture, VideoError> + Sync,
    goes_on: impl FnMut(usize) -> bool,
) -> Result<Option<Vec<u8>>, VideoError> {
    let encoding = |error: gif::EncodingError| VideoFormat::Gif.failed(&error);
    let sample: Vec<usize> = sampled(pictures).collect();
    let sample: Vec<Picture> = sample.into_par_iter().map(&picture).collect::<Result<_, _>>()?;
    let palette = Palette::of(&sample);
    let size = sample.first().map_or([1, 1], |first| first.size);
    let format = Format { size, palette: palette.bytes(), unchanged: palette.unchanged() };
    let mut writer = Writer::new(format).map_err(encoding)?;
    let indices = |index| Ok(palette.indices(&picture(index)?));
    let done = in_chunks(pictures, indices, goes_on, |index, picture| {
        let pause = if index + 1 == pictures { PAUSE_SECS } else { 0.0 };
        writer.push(picture, PICTURE_SECS + pause).map_err(encoding)
    })?;
    if done { writer.finish().map(Some).map_err(encoding) } else { Ok(None) }
}

#[cfg(feature = "mp4")]
fn mp4(
    pictures: usize,
    picture: impl Fn(usize) -> Result<Picture, VideoError> + Sync,
    goes_on: impl FnMut(usize) -> bool,
) -> Result<Option<Vec<u8>>, VideoError> {
    let mut writer = mp4_writer::Writer::new(picture(0)?.size)?;
    let frame = |index| Ok(h264::frame(&picture(index)?));
    let done = in_chunks(pictures, frame, goes_on, |index, frame| {
        let times = if index + 1 == pictures { 1 + (PAUSE_SECS / PICTURE_SECS) as usize } else { 1 };
        (0..times).try_for_each(|_| writer.push(&frame))
    })?;
    if done { writer.finish().map(Some) } else { Ok(None) }
}

/// Makes things of so many pictures in parallel and takes them in order; false when `goes_on` says no before the end.
fn in_chunks<T: Send>(
    pictures: usize,
    made: impl Fn(usize) -> Result<T, VideoError> + Sync,
    mut goes_on: impl FnMut(usize) -> bool,
    mut take: impl FnMut(usize, T) -> Result<(), VideoError>,
) -> Result<bool, VideoError> {
    for first in (0..pictures).step_by(CHUNK) {
        if !goes_on(first) {
            return Ok(false);
        }
        let chunk = first..pictures.min(first + CHUNK);
        let drawn: Vec<T> = chunk.clone().into_par_iter().map(&made).collect::<Result<_, VideoError>>()?;
        chunk.zip(drawn).try_for_each(|(index, made)| take(index, made))?;
    }
    goes_on(pictures);
    Ok(true)
}

/// An image in the colours of a panel.
pub(crate) fn coloured(image: &Image, panel: Panel, scale: &DepthScale) -> Picture {
    let size = [image.columns, image.colours.len() / image.columns.max(1)];
    let pixels = match panel {
        Panel::Chase | Panel::Onboard => image.colours.clone(),
        Panel::Depth => {
            image.depths.iter().zip(&image.labels).map(|(depth, label)| scale.colour(*depth, *label)).collect()
        }
        Panel::Labels => image.labels.iter().map(|label| label_colour(*label)).collect(),
    };
    Picture { size, pixels }
}

/// Size of titles and captions in a picture so wide \[px\].
pub(crate) fn text_size(width: usize) -> f32 {
    if width < WIDE { SMALL } else { 18.0 }
}

/// Time, return, distance, speed and the ending, in columns.
pub(crate) fn draw_caption(caption: &Caption, picture: &mut Picture, [left, top]: [usize; 2]) {
    let Caption { secs, episode_return, distance, speed, ending } = caption;
    let size = text_size(picture.size[0]);
    let columns = [
        (Some(format!("{secs:.2} s")), "00.00 s"),
        (episode_return.map(|sum| format!("return {sum:.2}")), "return −0000.00"),
        (distance.map(|metres| format!("{metres:.2} m to go")), "00.00 m to go"),
        (Some(format!("{speed:.2} m/s")), "00.00 m/s"),
    ];
    let mut left = left;
    for (words, widest) in columns.iter().filter_map(|(words, widest)| words.as_ref().zip(Some(widest))) {
        picture.text([left, top], words, size, INK);
        left += text_width(widest, size) + (0.8 * size) as usize;
    }
    if let Some((ending, success)) = ending {
        picture.text([left, top], ending, size, if *success { GOOD } else { BAD });
    }
}

/// The flight behind its first drone as a video, rendered by the processor; nothing else is needed.
///
/// # Errors
/// For a recording without frames or with numbers that are none, or when the encoder fails.
pub fn flight_video(
    flight: FlightRecording,
    scenario: &Scenario,
    name: &str,
    format: VideoFormat,
) -> Result<Vec<u8>, VideoError> {
    let recorded = RecordedScene::new(flight, scenario, name)?;
    let style =
        Style { panels: vec![Panel::Chase], size: [480, 304], view_angle: VIEW_ANGLE, samples: 2, drone: 0 };
    let renderer = Cpu::asked_for();
    let file = Video::new(&recorded, &style, &renderer).file(format, |_| true)?;
    Ok(file.unwrap_or_default())
}
