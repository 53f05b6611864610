//! The picture of what the user has chosen.

use kestrel_sim::camera::{Camera, Image, Renderer, Scene, Shot, View};
use kestrel_sim::scenario::Scenario;
use nalgebra::Vector3;

use super::layout::{FOOT, Layout, MARGIN, NAME, Part};
use super::{CameraMode, Controls, Extent, Flow, LEAST_SIZE, Spectacle};
use crate::picture::Picture;
use crate::plan::Subject;
use crate::plan::above::{Above, Flown};
use crate::recorded_flight::Frame;
use crate::video::chase::{self, Chase, VIEW_ANGLE, on_board};
use crate::video::playback::{Moment, PICTURE_SECS};
use crate::video::trail;
use crate::video::{self, DepthScale, Panel, RecordedScene, VideoError, VideoFormat, coloured, draw_caption};

/// Keys and mouse, in one line.
const HELP: &str = "space pause   arrows step, speed   c camera   n drone   r reset   q quit   mouse: drag to turn, wheel to zoom";

/// Rays across a pixel, and down it.
const SAMPLES: usize = 2;

/// A flight and everything that its pictures need.
#[derive(Debug)]
pub struct Viewport<'a> {
    recorded: RecordedScene,
    renderer: &'a dyn Renderer,
    /// Of each drone.
    chases: Vec<Chase>,
    scales: Vec<DepthScale>,
    /// Of the drones' cameras, across \[rad\].
    view_angle: f64,
    subject: Subject,
    size: [usize; 2],
    plan: Above,
}

impl Spectacle for Viewport<'_> {
    fn extent(&self) -> Extent {
        self.extent()
    }

    fn resize(&mut self, size: [usize; 2]) {
        self.resize(size);
    }

    fn picture(&self, controls: &Controls) -> Result<Picture, VideoError> {
        self.picture(controls)
    }

    fn follow(&mut self, _controls: &mut Controls) -> Result<Flow, VideoError> {
        Ok(Flow::Continue)
    }
}

impl<'a> Viewport<'a> {
    /// For pictures of `size` \[px\]; `view_angle` is that of the drones' cameras, across \[rad\].
    pub fn new(
        recorded: RecordedScene,
        scenario: &Scenario,
        renderer: &'a dyn Renderer,
        view_angle: f64,
        size: [usize; 2],
    ) -> Self {
        let subject = Subject::of_scenario(scenario.name.clone(), scenario);
        let size = enlarged(size);
        Self {
            chases: (0..recorded.drones()).map(|drone| Chase::of(&recorded, drone)).collect(),
            scales: scales(&recorded, view_angle),
            plan: Above::fitting(&subject, Layout::of(size).plan.size),
            recorded,
            renderer,
            view_angle,
            subject,
            size,
        }
    }

    /// How much there is to see.
    pub fn extent(&self) -> Extent {
        Extent { secs: self.recorded.secs(), drones: self.recorded.drones(), goes_on: false }
    }

    /// Looks at another flight.
    pub(super) fn begin(&mut self, recorded: RecordedScene, scenario: &Scenario) {
        self.subject = Subject::of_scenario(scenario.name.clone(), scenario);
        self.plan = Above::fitting(&self.subject, Layout::of(self.size).plan.size);
        self.chases = (0..recorded.drones()).map(|drone| Chase::of(&recorded, drone)).collect();
        self.scales = scales(&recorded, self.view_angle);
        self.recorded = recorded;
    }

    /// Adds control periods of a flight that goes on; says how much of its beginning is forgotten \[s\].
    pub(super) fn extend(&mut self, frames: Vec<Frame>, name: &str) -> Result<f32, VideoError> {
        let (known, mut forgotten) = (self.recorded.moments().len(), 0);
        for frame in frames {
            let pictures = self.recorded.push(frame, name)?;
            self.chases.iter_mut().for_each(|chase| chase.forget(pictures));
            forgotten += pictures;
        }
        let pictures = self.recorded.moments().len();
        for (drone, chase) in self.chases.iter_mut().enumerate() {
            chase.extend(&self.recorded, drone);
        }
        // Ever less often: a scale that changes makes a picture flicker.
        if known.ilog2() < pictures.ilog2() {
            self.scales = scales(&self.recorded, self.view_angle);
        }
        Ok(forgotten as f32 * PICTURE_SECS)
    }

    /// Says how a drone's flight ended.
    pub(super) fn end(&mut self, drone: usize, ending: &str, success: bool) {
        self.recorded.end(drone, ending, success);
    }

    /// Makes pictures of another size \[px\], at least [`LEAST_SIZE`].
    pub fn resize(&mut self, size: [usize; 2]) {
        let size = enlarged(size);
        if size != self.size {
            self.size = size;
            self.plan = Above::fitting(&self.subject, Layout::of(size).plan.size);
        }
    }

    /// What there is to see now.
    ///
    /// # Errors
    /// When the renderer fails.
    pub fn picture(&self, controls: &Controls) -> Result<Picture, VideoError> {
        let Controls { playing, speed, .. } = controls;
        self.captioned(controls, &if *playing { format!("{speed}x") } else { format!("paused, {speed}x") })
    }

    /// The same; `pace` says how time goes on.
    pub(super) fn captioned(&self, controls: &Controls, pace: &str) -> Result<Picture, VideoError> {
        let drone = controls.drone;
        let moment = self.recorded.moment(controls.secs);
        let layout = Layout::of(self.size);
        let mut picture = Picture::new(self.size, video::PAPER);
        picture.text([MARGIN, 7], &self.recorded.flight.title, video::text_size(self.size[0]), video::INK);
        let main = self.main(&moment, controls, layout.main.size)?;
        let scale = &self.scales[drone];
        paste(&mut picture, &main, Panel::Chase, scale, &layout.main);
        let view = on_board(&self.recorded, &moment.drones[drone].placement);
        let seen =
            self.render(&self.recorded.seen(&moment, drone), view, self.view_angle, layout.on_board.size)?;
        paste(&mut picture, &seen, Panel::Onboard, scale, &layout.on_board);
        paste(&mut picture, &seen, Panel::Depth, scale, &layout.depth);
        picture.paste(&self.plan(&moment), layout.plan.corner);
        for (name, part) in [("plan", layout.plan), ("on board", layout.on_board), ("depth", layout.depth)] {
            picture.text([part.corner[0], part.corner[1] - NAME], name, video::SMALL, video::MUTED);
        }
        let Part { corner: [left, top], size: [width, height] } = layout.depth;
        scale.draw_legend(&mut picture, [left, top + height + 3], width, video::MUTED);
        let foot = self.size[1] - FOOT;
        draw_caption(&self.recorded.caption(&moment, drone), &mut picture, [MARGIN, foot + 7]);
        picture.text(
            [MARGIN, foot + 31],
            &format!("{}   {HELP}", self.status(controls, pace)),
            video::SMALL,
            video::MUTED,
        );
        Ok(picture)
    }

    /// The whole flight as a file, from the camera that the controls say; see [`video::Video::file`].
    ///
    /// # Errors
    /// When the renderer or the encoder fails.
    pub fn video(
        &self,
        controls: &Controls,
        format: VideoFormat,
        goes_on: impl FnMut(usize) -> bool,
    ) -> Result<Option<Vec<u8>>, VideoError> {
        let picture = |index: usize| self.picture(&Controls { secs: index as f32 * PICTURE_SECS, ..*controls });
        video::film(format, self.pictures(), picture, goes_on)
    }

    /// How many pictures that video has.
    pub fn pictures(&self) -> usize {
        self.recorded.moments().len()
    }

    /// The large picture.
    fn main(&self, moment: &Moment, controls: &Controls, size: [usize; 2]) -> Result<Image, VideoError> {
        let Controls { drone, heading, elevation, zoom, .. } = *controls;
        let placement = &moment.drones[drone].placement;
        let view = match controls.camera {
            CameraMode::Chase => self.chases[drone].view(moment.elapsed_secs / PICTURE_SECS),
            CameraMode::Orbit => {
                let distance = zoom * chase::distance(self.recorded.arm_m);
                chase::orbit(placement.position.cast(), heading, elevation, distance)
            }
            CameraMode::Onboard => {
                let scene = self.recorded.seen(moment, drone);
                return self.render(&scene, on_board(&self.recorded, placement), self.view_angle, size);
            }
        };
        let image = self.render(&self.recorded.shown(moment), view, VIEW_ANGLE, size)?;
        Ok(self.recorded.shaded(image, &enlarged_camera(size, VIEW_ANGLE), &view, moment))
    }

    fn render(&self, scene: &Scene, view: View, angle: f64, size: [usize; 2]) -> Result<Image, VideoError> {
        let camera = enlarged_camera(size, angle);
        let images = self.renderer.render(&camera, &[scene], &[Shot { scene: 0, view }])?;
        Ok(images.into_iter().next().unwrap_or_default())
    }

    /// Where all drones are and have been.
    fn plan(&self, moment: &Moment) -> Picture {
        let pictures = (moment.elapsed_secs / PICTURE_SECS) as usize + 1;
        let past = &self.recorded.moments()[..pictures.min(self.recorded.moments().len())];
        let way = |drone: usize| {
            let then = past.iter().chain([moment]).map(|moment| moment.drones[drone].placement);
            let way: Vec<Vector3<f64>> = then.map(|placement| placement.position.cast()).collect();
            let nose = moment.drones[drone].placement.pose().world_from_body.rotate(Vector3::x());
            Flown { way, nose, colour: trail::colour(drone) }
        };
        self.plan.with(&(0..self.recorded.drones()).map(way).collect::<Vec<_>>())
    }

    fn status(&self, controls: &Controls, pace: &str) -> String {
        let Controls { camera, drone, .. } = controls;
        match self.recorded.drones() {
            1 => format!("{pace}, {}", camera.name()),
            drones => format!("{pace}, {}, drone {drone} of {drones}", camera.name()),
        }
    }
}

/// A camera with all rays of the pixels of a picture.
fn enlarged_camera(size: [usize; 2], angle: f64) -> Camera {
    video::camera(size.map(|pixels| pixels * SAMPLES), angle)
}

/// Of the depths that each drone's camera sees.
fn scales(recorded: &RecordedScene, view_angle: f64) -> Vec<DepthScale> {
    (0..recorded.drones()).map(|drone| recorded.depth_scale(drone, view_angle)).collect()
}

fn paste(picture: &mut Picture, image: &Image, panel: Panel, scale: &DepthScale, part: &Part) {
    picture.paste(&coloured(image, panel, scale).averaged(SAMPLES), part.corner);
}

fn enlarged(size: [usize; 2]) -> [usize; 2] {
    [0, 1].map(|axis| size[axis].max(LEAST_SIZE[axis]))
}
