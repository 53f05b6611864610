//! A flight that is looked at while it is flown.

use std::iter;
use std::mem;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError};

use kestrel_sim::camera::Renderer;
use kestrel_sim::scenario::Scenario;

use super::{Controls, Extent, Flow, Spectacle, Viewport};
use crate::picture::Picture;
use crate::recorded_flight::{FlightRecording, Frame};
use crate::video::{RecordedScene, VideoError};

/// Angle of view of the drones' cameras, across \[rad\]: a right angle.
const VIEW_ANGLE: f64 = core::f64::consts::FRAC_PI_2;

/// What is told of flights while they are flown.
#[derive(Clone, Debug)]
pub enum Glimpse {
    /// One begins: the task in whose aviary, and what there is of it.
    Begins(Arc<Scenario>, FlightRecording),
    /// It goes on for a control period.
    GoesOn(Frame),
    /// A drone has ended it.
    Ends {
        /// Which one, from 0.
        drone: usize,
        /// How, as in reports.
        ending: String,
        /// Whether that was a success.
        success: bool,
    },
}

/// The picture of flights that somebody else flies, who sends [`Glimpse`]s; the last minutes of a flight are remembered.
#[derive(Debug)]
pub struct LiveViewport<'a> {
    viewport: Viewport<'a>,
    glimpses: Receiver<Glimpse>,
    /// In messages.
    name: String,
}

impl<'a> LiveViewport<'a> {
    /// Waits for the first flight; nothing when none begins. Pictures are as those of [`Viewport::new`].
    ///
    /// # Errors
    /// When it cannot be shown.
    pub fn awaited(
        glimpses: Receiver<Glimpse>,
        renderer: &'a dyn Renderer,
        size: [usize; 2],
    ) -> Result<Option<Self>, VideoError> {
        let first = glimpses.iter().find_map(|glimpse| match glimpse {
            Glimpse::Begins(scenario, flight) => Some((scenario, flight)),
            Glimpse::GoesOn(_) | Glimpse::Ends { .. } => None,
        });
        let Some((scenario, flight)) = first else { return Ok(None) };
        let name = flight.title.clone();
        let scene = RecordedScene::new(flight, &scenario, &name)?;
        let viewport = Viewport::new(scene, &scenario, renderer, VIEW_ANGLE, size);
        Ok(Some(Self { viewport, glimpses, name }))
    }

    /// Waits until nothing more is sent: the last flight, to be looked at as any other.
    ///
    /// # Errors
    /// When it cannot be shown.
    pub fn ended(mut self) -> Result<Viewport<'a>, VideoError> {
        while let Ok(glimpse) = self.glimpses.recv() {
            let more: Vec<_> = iter::once(glimpse).chain(self.glimpses.try_iter()).collect();
            self.take(more)?;
        }
        Ok(self.viewport)
    }

    /// Takes in what was sent; says how much of the beginning of the flight is forgotten \[s\].
    fn take(&mut self, glimpses: Vec<Glimpse>) -> Result<f32, VideoError> {
        let (mut frames, mut forgotten_secs) = (Vec::new(), 0.0);
        for glimpse in glimpses {
            match glimpse {
                Glimpse::GoesOn(frame) => frames.push(frame),
                Glimpse::Begins(scenario, flight) => {
                    self.name.clone_from(&flight.title);
                    self.viewport.begin(RecordedScene::new(flight, &scenario, &self.name)?, &scenario);
                    (frames, forgotten_secs) = (Vec::new(), 0.0);
                }
                Glimpse::Ends { drone, ending, success } => {
                    forgotten_secs += self.viewport.extend(mem::take(&mut frames), &self.name)?;
                    self.viewport.end(drone, &ending, success);
                }
            }
        }
        Ok(forgotten_secs + self.viewport.extend(frames, &self.name)?)
    }
}

impl Spectacle for LiveViewport<'_> {
    fn extent(&self) -> Extent {
        Extent { goes_on: true, ..self.viewport.extent() }
    }

    fn resize(&mut self, size: [usize; 2]) {
        self.viewport.resize(size);
    }

    fn picture(&self, controls: &Controls) -> Result<Picture, VideoError> {
        if controls.newest { self.viewport.captioned(controls, "live") } else { self.viewport.picture(controls) }
    }

    /// While the user has paused, nothing new comes in.
    fn follow(&mut self, controls: &mut Controls) -> Result<Flow, VideoError> {
        if !controls.playing {
            return Ok(Flow::Continue);
        }
        let mut glimpses = Vec::new();
        let over = loop {
            match self.glimpses.try_recv() {
                Ok(glimpse) => glimpses.push(glimpse),
                Err(TryRecvError::Empty) => break false,
                Err(TryRecvError::Disconnected) => break true,
            }
        };
        let forgotten_secs = self.take(glimpses)?;
        controls.secs = (controls.secs - forgotten_secs).clamp(0.0, self.viewport.extent().secs);
        Ok(if over { Flow::Quit } else { Flow::Continue })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use kestrel_sim::camera::Cpu;

    use super::*;
    use crate::testing::{flown, scenario};

    /// The frames of a flight after its first, and what there was of it then.
    fn told(flight: &FlightRecording) -> (FlightRecording, Vec<Frame>) {
        let mut begun = flight.clone();
        for drone in &mut begun.drones {
            drone.frames.truncate(1);
            drone.rewards.clear();
            drone.ending.clear();
        }
        let frame = |index: usize| Frame {
            drones: flight.drones.iter().map(|drone| drone.frames[index]).collect(),
            movables: Vec::new(),
            rewards: flight.drones.iter().map(|drone| drone.rewards[index - 1]).collect(),
        };
        (begun, (1..flight.drones[0].frames.len()).map(frame).collect())
    }

    #[test]
    fn a_flight_that_was_watched_looks_as_one_that_was_recorded() {
        let scenario = Arc::new(scenario("cross.yaml", 2.0));
        let mut flight = flown(&scenario);
        let renderer = Cpu::asked_for();
        let (begun, frames) = told(&flight);
        let (sender, glimpses) = channel();
        sender.send(Glimpse::Begins(Arc::clone(&scenario), begun)).unwrap();
        let mut live = LiveViewport::awaited(glimpses, &renderer, [480, 300]).unwrap().unwrap();
        let mut controls = Controls::default();
        for some in frames.chunks(7) {
            for frame in some {
                sender.send(Glimpse::GoesOn(frame.clone())).unwrap();
            }
            assert_eq!(live.follow(&mut controls).unwrap(), Flow::Continue);
            controls.advance(0.0, &live.extent());
            assert_eq!(controls.secs, live.extent().secs, "the newest moment is shown");
        }
        sender.send(Glimpse::Ends { drone: 0, ending: "time limit".to_owned(), success: false }).unwrap();
        drop(sender);
        assert_eq!(live.follow(&mut controls).unwrap(), Flow::Quit);
        let rewards = flight.drones[0].frames.len() - 1;
        flight.drones[0].rewards.truncate(rewards);
        let recorded = RecordedScene::new(flight, &scenario, "flight").unwrap();
        let viewport = Viewport::new(recorded, &scenario, &renderer, VIEW_ANGLE, [480, 300]);
        for secs in [0.0, 0.5, 1.0, viewport.extent().secs] {
            let then = Controls { secs, newest: false, ..Controls::default() };
            let [watched, recorded] = [live.picture(&then), viewport.picture(&then)].map(Result::unwrap);
            // The scale of depths is of what had been seen by then: pictures may differ there.
            let above = 300 / 2 * 480;
            assert!(watched.pixels[..above] == recorded.pixels[..above], "at {secs} s");
        }
    }

    #[test]
    fn a_paused_flight_stands_still_and_another_begins_at_its_start() {
        let scenario = Arc::new(scenario("cross.yaml", 1.0));
        let renderer = Cpu::asked_for();
        let (begun, frames) = told(&flown(&scenario));
        let (sender, glimpses) = channel();
        sender.send(Glimpse::Begins(Arc::clone(&scenario), begun.clone())).unwrap();
        let mut live = LiveViewport::awaited(glimpses, &renderer, [320, 240]).unwrap().unwrap();
        for frame in frames {
            sender.send(Glimpse::GoesOn(frame)).unwrap();
        }
        let mut paused = Controls { playing: false, ..Controls::default() };
        live.follow(&mut paused).unwrap();
        assert_eq!(live.extent().secs, 0.0);
        live.follow(&mut Controls::default()).unwrap();
        let secs = live.extent().secs;
        assert!(secs > 0.5, "{secs}");
        sender.send(Glimpse::Begins(Arc::clone(&scenario), begun)).unwrap();
        let mut controls = Controls { secs, ..Controls::default() };
        live.follow(&mut controls).unwrap();
        assert_eq!((controls.secs, live.extent().secs), (0.0, 0.0));
        drop(sender);
        assert_eq!(live.ended().unwrap().extent().secs, 0.0);
    }

    #[test]
    fn nothing_begins() {
        let (sender, glimpses) = channel();
        drop(sender);
        assert!(LiveViewport::awaited(glimpses, &Cpu::asked_for(), [320, 240]).unwrap().is_none());
    }

    #[test]
    fn what_was_long_ago_is_forgotten() {
        let scenario = scenario("cross.yaml", 1.0);
        let (begun, frames) = told(&flown(&scenario));
        let mut scene = RecordedScene::new(begun, &scenario, "flight").unwrap();
        let periods_a_picture = 0.04 / scenario.physics.control_secs();
        let mut forgotten = 0;
        for _ in 0..(15_100.0 * periods_a_picture) as usize {
            forgotten += scene.push(frames[0].clone(), "flight").unwrap();
        }
        assert_eq!(forgotten, 7_500);
        let last = scene.moment(scene.secs());
        let caption = scene.caption(&last, 0);
        assert!((caption.secs - 604.0).abs() < 0.1 && (scene.secs() - 304.0).abs() < 0.1, "{caption:?}");
        let paid = frames[0].rewards[0];
        let steps = (604.0 / scenario.physics.control_secs()) as f64;
        assert!((caption.episode_return.unwrap() / (paid * steps) - 1.0).abs() < 1e-3, "{caption:?}");
    }
}
