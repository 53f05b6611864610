//! Films of flights as cameras see them: from behind, on board, how far things are and what they are.
//!
//! A [`Stage`] is a recorded flight in its world. A [`Film`] looks at it in a [`Style`] and makes a [`Picture`] of any
//! moment, or all of them, 25 a second, as GIF. The same flight gives the same bytes, for any number of threads.

pub(crate) mod channel;
pub(crate) mod chase;
mod palette;
pub(crate) mod stage;
#[cfg(test)]
mod tests;

use kestrel_sim::camera::{Camera, Image, RenderError, Renderer, Scene, Shot};
use rayon::prelude::*;

pub use channel::{DepthScale, label_colour};
pub use stage::Stage;

use crate::animation::AnimationError;
use crate::animation::encode::{Format, PAUSE_SECS, Writer};
use crate::animation::playback::{Moment, PICTURE_SECS};
use crate::drawing::PngError;
use crate::picture::{Picture, Rgb, text_width};
use channel::LEGEND;
use chase::{Chase, VIEW_ANGLE, on_board};
use palette::Palette;
use stage::Facts;

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

/// Why there is no film.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The recording cannot be shown.
    #[error(transparent)]
    Animation(#[from] AnimationError),
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
}

/// Greatest width and height of a GIF \[px\].
pub const GIF_LIMIT: usize = u16::MAX as usize;

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

/// Width from which words are written twice as large \[px\].
pub(crate) const WIDE: usize = 860;

/// Pictures from which the colours of a film and its scale of depths are taken.
const SAMPLED: usize = 16;

/// Pictures that are rendered before the next progress is told.
const CHUNK: usize = 16;

/// A flight, looked at in a style.
#[derive(Debug)]
pub struct Film<'a> {
    stage: &'a Stage,
    style: &'a Style,
    renderer: &'a Renderer,
    chase: Chase,
    scale: DepthScale,
}

/// What the cameras see at a moment, larger by the samples.
struct Seen {
    chase: Option<Image>,
    on_board: Option<Image>,
}

impl<'a> Film<'a> {
    /// Looks for the camera's way and for a scale of depths that serves the whole film.
    ///
    /// # Panics
    /// When the stage has no such drone, or the style no panel or pixel.
    pub fn new(stage: &'a Stage, style: &'a Style, renderer: &'a Renderer) -> Self {
        assert!(style.drone < stage.drones(), "{} drones fly, not number {}", stage.drones(), style.drone);
        let (chase, scale) = (Chase::of(stage, style.drone), stage.depth_scale(style.drone, style.view_angle));
        Self { stage, style, renderer, chase, scale }
    }

    /// How many pictures the film has.
    pub fn pictures(&self) -> usize {
        self.stage.moments().len()
    }

    /// The picture of a time since the start \[s\]; after the end, of the last one. Depths have a scale of their own.
    ///
    /// # Errors
    /// When the renderer fails.
    pub fn at(&self, secs: f32) -> Result<Picture, FilmError> {
        let moment = self.stage.moment(secs.clamp(0.0, self.stage.secs()));
        let seen = self.see(&moment)?;
        let scale = DepthScale::of(&seen.on_board);
        Ok(self.compose(&moment, &seen, &scale))
    }

    /// The whole film as GIF; nothing when `goes_on`, asked with the number of pictures that are done, says no.
    ///
    /// # Errors
    /// When the renderer or the encoder fails.
    pub fn gif(&self, goes_on: impl FnMut(usize) -> bool) -> Result<Option<Vec<u8>>, FilmError> {
        let moments = self.stage.moments();
        let picture = |index: usize| Ok(self.compose(&moments[index], &self.see(&moments[index])?, &self.scale));
        gif(moments.len(), picture, goes_on)
    }

    /// Columns and rows of the pictures \[px\].
    pub fn size(&self) -> [usize; 2] {
        let Style { panels, size: [width, height], .. } = self.style;
        let legend = if panels.contains(&Panel::Depth) { LEGEND + 3 } else { 0 };
        [MARGIN + panels.len() * (width + MARGIN), TITLE + NAME + height + legend + FOOT]
    }

    /// What the cameras see that the panels need.
    fn see(&self, moment: &Moment) -> Result<Seen, FilmError> {
        let Style { panels, size, view_angle, samples, drone } = self.style;
        let size = size.map(|pixels| pixels * samples);
        let image = |scene: &Scene, view, angle| {
            let shots = [Shot { scene: 0, view }];
            let images = self.renderer.render(&camera(size, angle), &[scene], &shots)?;
            Ok::<_, FilmError>(images.into_iter().next())
        };
        let chase = panels.contains(&Panel::Chase).then(|| {
            image(&self.stage.shown(moment), self.chase.view(moment.elapsed_secs / PICTURE_SECS), VIEW_ANGLE)
        });
        let on_board = panels.iter().any(|panel| *panel != Panel::Chase).then(|| {
            let view = on_board(self.stage, &moment.drones[*drone].frame.placement);
            image(&self.stage.seen(moment, *drone), view, *view_angle)
        });
        Ok(Seen { chase: chase.transpose()?.flatten(), on_board: on_board.transpose()?.flatten() })
    }

    fn compose(&self, moment: &Moment, seen: &Seen, scale: &DepthScale) -> Picture {
        let Style { panels, size: [width, height], samples, drone, .. } = self.style;
        let mut picture = Picture::new(self.size(), PAPER);
        picture.text([MARGIN, 7], &self.stage.flight.title, if self.size()[0] < WIDE { 1 } else { 2 }, INK);
        for (index, panel) in panels.iter().enumerate() {
            let left = MARGIN + index * (width + MARGIN);
            picture.text([left, TITLE], panel.name(), 1, MUTED);
            let image = if *panel == Panel::Chase { &seen.chase } else { &seen.on_board };
            if let Some(image) = image {
                picture.paste(&coloured(image, *panel, scale).averaged(*samples), [left, TITLE + NAME]);
            }
            if *panel == Panel::Depth {
                scale.draw_legend(&mut picture, [left, TITLE + NAME + height + 4], *width, MUTED);
            }
        }
        let foot = picture.size[1] - FOOT + 8;
        draw_facts(&self.stage.facts(moment, *drone), &mut picture, [MARGIN, foot]);
        picture
    }
}

/// A camera of so many columns and rows, with square pixels.
pub(crate) fn camera([columns, rows]: [usize; 2], view_angle: f64) -> Camera {
    let across = (0.5 * view_angle).tan();
    let tangents = [across, across * rows as f64 / columns as f64];
    Camera { columns, rows, tangents, sample: [0.5; 2], ..Camera::REFERENCE }
}

/// Indices evenly over a film, the first and the last among them.
fn sampled(pictures: usize) -> impl Iterator<Item = usize> {
    let count = pictures.min(SAMPLED);
    (0..count).map(move |index| index * (pictures - 1) / (count - 1).max(1))
}

/// A film of pictures, 25 a second, then a pause; nothing when `goes_on`, asked with the number that is done, says no.
/// Pictures are made in parallel on rayon's current pool, some of them twice.
pub(crate) fn gif(
    pictures: usize,
    picture: impl Fn(usize) -> Result<Picture, FilmError> + Sync,
    mut goes_on: impl FnMut(usize) -> bool,
) -> Result<Option<Vec<u8>>, FilmError> {
    let encoding = |error: gif::EncodingError| AnimationError::Encoding(error.to_string());
    let sample: Vec<usize> = sampled(pictures).collect();
    let sample: Vec<Picture> = sample.into_par_iter().map(&picture).collect::<Result<_, _>>()?;
    let palette = Palette::of(&sample);
    let size = sample.first().map_or([1, 1], |first| first.size);
    let format = Format { size, palette: palette.bytes(), unchanged: palette.unchanged() };
    let mut writer = Writer::new(format).map_err(encoding)?;
    for first in (0..pictures).step_by(CHUNK) {
        if !goes_on(first) {
            return Ok(None);
        }
        let indices = |index| Ok(palette.indices(&picture(index)?));
        let chunk = first..pictures.min(first + CHUNK);
        let drawn: Vec<Vec<u8>> = chunk.clone().into_par_iter().map(indices).collect::<Result<_, FilmError>>()?;
        for (index, picture) in chunk.zip(drawn) {
            let pause = if index + 1 == pictures { PAUSE_SECS } else { 0.0 };
            writer.push(picture, PICTURE_SECS + pause).map_err(encoding)?;
        }
    }
    goes_on(pictures);
    Ok(Some(writer.finish().map_err(encoding)?))
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

/// Time, return, distance, speed and the ending, one after the other.
pub(crate) fn draw_facts(facts: &Facts, picture: &mut Picture, [left, top]: [usize; 2]) {
    let Facts { secs, episode_return, distance, speed, ending } = facts;
    let scale = if picture.size[0] < WIDE { 1 } else { 2 };
    let words = format!("{secs:.2} s  return {episode_return:8.2}  {distance:5.2} m to go  {speed:4.2} m/s");
    picture.text([left, top], &words, scale, INK);
    if let Some((ending, success)) = ending {
        let colour = if *success { GOOD } else { BAD };
        picture.text([left + text_width(&words, scale) + 12 * scale, top], ending, scale, colour);
    }
}
