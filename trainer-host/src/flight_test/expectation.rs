//! What is to come of a flight, held against its true state.

use std::fmt;

use kestrel_core::vehicle::State;
use kestrel_shim::autopilot::{Mode, STOPPED};
use kestrel_shim::controller::Controller;
use kestrel_shim::steering::yaw;
use nalgebra::Vector3;

use super::flight::{FlownCase, Moment};

/// A drone that is faster has not landed yet \[m/s\]: what the autopilot calls at rest.
const REST_SPEED: f32 = 0.1;

/// A drone that is tilted further has fallen over instead \[rad\].
const LANDED_TILT: f32 = 0.26;

/// What is to come of a flight.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Expectation {
    /// Its name in files.
    pub(crate) name: &'static str,
    /// Begin and end of what is looked at \[s\].
    pub(crate) window_secs: [f64; 2],
    /// How much of that.
    pub(crate) extent: Extent,
    /// What has to hold there.
    pub(crate) condition: Condition,
}

/// When a condition has to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Extent {
    /// At every moment.
    Throughout,
    /// At one moment at least.
    Once,
    /// At the last.
    AtTheEnd,
}

/// What has to hold.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Condition {
    /// No lower than this \[m, world\].
    Above(f32),
    /// In a box \[m, world\]: its corners of the least and of the greatest coordinates.
    Inside([Vector3<f32>; 2]),
    /// In a ball.
    Near {
        /// Its middle \[m, world\].
        point: Vector3<f32>,
        /// \[m\].
        radius_m: f32,
    },
    /// The nose in a direction.
    Heading {
        /// \[rad\], counter-clockwise from the world's x axis.
        heading: f32,
        /// \[rad\].
        within: f32,
    },
    /// Tilted no further \[rad\].
    Tilt(f32),
    /// No faster \[m/s\].
    Speed(f32),
    /// The autopilot in a mode.
    Mode(Mode),
    /// A controller flies.
    Controller(Controller),
    /// No touch of a wall, furniture or a movable body.
    Untouched,
    /// Upright, at rest, with stopped rotors.
    Landed,
    /// The ground station hears words in which this occurs.
    Said(String),
}

/// What came of it instead.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Failure {
    /// Name of the expectation in files.
    pub(crate) name: &'static str,
    /// When \[s\].
    pub(crate) secs: f64,
    /// What was found then.
    pub(crate) found: String,
    /// What was expected.
    pub(crate) expected: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, secs, found, expected } = self;
        write!(formatter, "{name}: at {secs:.2} s found {found}, expected {expected}")
    }
}

impl Expectation {
    /// What came instead, if anything did.
    pub(crate) fn failure(&self, flown: &FlownCase) -> Option<Failure> {
        let [from_secs, until_secs] = self.window_secs;
        let grace_secs = 0.5 * flown.control_secs;
        let window = from_secs - grace_secs..=until_secs + grace_secs;
        let mut seen = flown.moments.iter().filter(|moment| window.contains(&moment.secs));
        let culprit = match self.extent {
            Extent::Throughout => seen.find(|moment| !self.condition.holds(moment)),
            Extent::Once if seen.clone().any(|moment| self.condition.holds(moment)) => None,
            Extent::Once => seen.min_by(|one, other| {
                let miss = |moment| self.condition.miss(moment);
                // Of those that are as far off the last counts.
                miss(one).total_cmp(&miss(other)).then(other.secs.total_cmp(&one.secs))
            }),
            Extent::AtTheEnd => seen.next_back().filter(|moment| !self.condition.holds(moment)),
        }?;
        Some(Failure {
            name: self.name,
            secs: culprit.secs,
            found: self.condition.found(culprit),
            expected: self.condition.expected(self.extent),
        })
    }
}

impl Condition {
    fn holds(&self, moment: &Moment) -> bool {
        let state = &moment.state;
        match self {
            Self::Above(height_m) => state.position.z >= *height_m,
            Self::Inside([low, high]) => state.position >= *low && state.position <= *high,
            Self::Near { point, radius_m } => (state.position - point).norm() <= *radius_m,
            Self::Heading { heading, within } => off(state, *heading).abs() <= *within,
            Self::Tilt(limit) => tilt(state) <= *limit,
            Self::Speed(limit) => state.velocity.norm() <= *limit,
            Self::Mode(mode) => moment.mode == *mode,
            Self::Controller(controller) => moment.controller == *controller,
            Self::Untouched => !moment.touching,
            Self::Landed => has_landed(moment),
            Self::Said(text) => moment.heard.iter().any(|words| words.contains(text.as_str())),
        }
    }

    /// How far a moment is from it, where that is a number.
    fn miss(&self, moment: &Moment) -> f32 {
        match self {
            Self::Near { point, .. } => (moment.state.position - point).norm(),
            Self::Heading { heading, .. } => off(&moment.state, *heading).abs(),
            Self::Above(_)
            | Self::Inside(_)
            | Self::Tilt(_)
            | Self::Speed(_)
            | Self::Mode(_)
            | Self::Controller(_)
            | Self::Untouched
            | Self::Landed
            | Self::Said(_) => 0.0,
        }
    }

    /// What a moment shows instead, in words.
    fn found(&self, moment: &Moment) -> String {
        let state = &moment.state;
        let place = point_text(&state.position);
        match self {
            Self::Above(_) => format!("a height of {:.3} m", state.position.z),
            Self::Inside(_) => format!("the drone at {place}"),
            Self::Near { point, .. } => {
                format!("the drone at {place}, {:.2} m away", (state.position - point).norm())
            }
            Self::Heading { .. } => format!("a heading of {:.0}°", yaw(&state.world_from_body).to_degrees()),
            Self::Tilt(_) => format!("a tilt of {:.0}°", tilt(state).to_degrees()),
            Self::Speed(_) => format!("{:.2} m/s", state.velocity.norm()),
            Self::Mode(_) => format!("the mode {}", moment.mode.name()),
            Self::Controller(_) => format!("the {}", controller_name(moment.controller)),
            Self::Untouched => format!("a touch at {place}"),
            Self::Landed => format!(
                "a drone that is {}, at {place}, {:.2} m/s fast, tilted by {:.0}°",
                moment.mode.name(),
                state.velocity.norm(),
                tilt(state).to_degrees()
            ),
            Self::Said(_) => "none".to_owned(),
        }
    }

    /// What it asks for, in words.
    fn expected(&self, extent: Extent) -> String {
        let before = match extent {
            Extent::Throughout | Extent::AtTheEnd => "",
            Extent::Once => "once ",
        };
        let wanted = match self {
            Self::Above(height_m) => format!("at least {height_m} m"),
            Self::Inside([low, high]) => format!("it between {} and {}", point_text(low), point_text(high)),
            Self::Near { point, radius_m } => format!("it within {radius_m} m of {}", point_text(point)),
            Self::Heading { heading, within } => {
                format!("{:.0}° within {:.0}°", heading.to_degrees(), within.to_degrees())
            }
            Self::Tilt(tilt) => format!("at most {:.0}°", tilt.to_degrees()),
            Self::Speed(speed) => format!("at most {speed} m/s"),
            Self::Mode(mode) => format!("the mode {}", mode.name()),
            Self::Controller(controller) => format!("the {}", controller_name(*controller)),
            Self::Untouched => "none".to_owned(),
            Self::Landed => "one that has landed upright, at rest, with stopped rotors".to_owned(),
            Self::Said(text) => format!("words with \"{text}\""),
        };
        format!("{before}{wanted}")
    }
}

fn has_landed(moment: &Moment) -> bool {
    let on_ground = match moment.mode {
        Mode::Landed | Mode::Disarmed => true,
        Mode::Armed
        | Mode::TakingOff
        | Mode::Holding
        | Mode::Guided
        | Mode::Offboard
        | Mode::Returning
        | Mode::Landing => false,
    };
    let still = moment.state.velocity.norm() < REST_SPEED && tilt(&moment.state) < LANDED_TILT;
    on_ground && still && moment.rotor_targets == STOPPED
}

/// Angle between the drone's axis and the vertical \[rad\].
fn tilt(state: &State<f32>) -> f32 {
    state.world_from_body.up_cosine().clamp(-1.0, 1.0).acos()
}

/// From a heading to the drone's, the shorter way \[rad\].
fn off(state: &State<f32>, heading: f32) -> f32 {
    let turn = yaw(&state.world_from_body) - heading;
    turn - (turn / core::f32::consts::TAU).round() * core::f32::consts::TAU
}

fn controller_name(controller: Controller) -> &'static str {
    match controller {
        Controller::Policy => "policy in charge",
        Controller::Cascade => "cascade in charge",
    }
}

fn point_text(point: &Vector3<f32>) -> String {
    format!("({:.2}, {:.2}, {:.2}) m", point.x, point.y, point.z)
}

#[cfg(test)]
mod tests {
    use kestrel_core::attitude::Attitude;

    use super::*;

    /// A drone that climbs at 1 m/s from the origin for a second, ten times a second.
    fn climb() -> FlownCase {
        let moment = |index: usize| Moment {
            secs: 0.1 * index as f64,
            state: State {
                position: Vector3::new(0.0, 0.0, 0.1 * index as f32),
                world_from_body: Attitude::level(),
                velocity: Vector3::z(),
                body_rates: Vector3::zeros(),
                rotor_speeds: [0.0; 4],
            },
            mode: if index < 5 { Mode::TakingOff } else { Mode::Holding },
            controller: Controller::Policy,
            rotor_targets: [100.0; 4],
            touching: index == 7,
            heard: if index == 5 { vec!["take-off complete".to_owned()] } else { Vec::new() },
        };
        FlownCase { control_secs: 0.1, moments: (0..=10).map(moment).collect(), movables: Vec::new(), hash: 0 }
    }

    fn failure(window_secs: [f64; 2], extent: Extent, condition: Condition) -> Option<String> {
        let expectation = Expectation { name: "it", window_secs, extent, condition };
        expectation.failure(&climb()).map(|failure| failure.to_string())
    }

    const WHOLE: [f64; 2] = [0.0, 1.0];

    fn near(height: f32, radius_m: f32) -> Condition {
        Condition::Near { point: Vector3::new(0.0, 0.0, height), radius_m }
    }

    #[test]
    fn what_holds_is_no_failure() {
        use Extent::{AtTheEnd, Once, Throughout};
        let box_around = [Vector3::new(-0.1, -0.1, 0.0), Vector3::new(0.1, 0.1, 1.0)];
        let cases = [
            ([0.5, 1.0], Throughout, Condition::Above(0.499)),
            (WHOLE, Throughout, Condition::Inside(box_around)),
            (WHOLE, Once, near(0.31, 0.02)),
            ([0.4, 0.6], Throughout, near(0.5, 0.11)),
            (WHOLE, Throughout, Condition::Heading { heading: core::f32::consts::TAU, within: 0.01 }),
            (WHOLE, Throughout, Condition::Tilt(0.01)),
            (WHOLE, Throughout, Condition::Speed(1.001)),
            (WHOLE, Once, Condition::Mode(Mode::Holding)),
            (WHOLE, AtTheEnd, Condition::Mode(Mode::Holding)),
            ([0.5, 1.0], Throughout, Condition::Mode(Mode::Holding)),
            (WHOLE, Throughout, Condition::Controller(Controller::Policy)),
            ([0.8, 1.0], Throughout, Condition::Untouched),
            (WHOLE, Once, Condition::Said("take-off".to_owned())),
        ];
        for (window_secs, extent, condition) in cases {
            assert_eq!(failure(window_secs, extent, condition.clone()), None, "{condition:?}");
        }
    }

    #[test]
    fn what_does_not_hold_is_told_with_its_time() {
        use Extent::{AtTheEnd, Once, Throughout};
        let low_box = [Vector3::new(-0.1, -0.1, 0.0), Vector3::new(0.1, 0.1, 0.55)];
        let cases = [
            (
                [0.2, 1.0],
                Throughout,
                Condition::Above(0.25),
                "at 0.20 s found a height of 0.200 m, expected at least 0.25 m",
            ),
            (WHOLE, Throughout, Condition::Inside(low_box), "at 0.60 s found the drone at (0.00, 0.00, 0.60) m"),
            (
                WHOLE,
                Once,
                near(3.0, 0.5),
                "at 1.00 s found the drone at (0.00, 0.00, 1.00) m, 2.00 m away, expected once it",
            ),
            (WHOLE, Throughout, near(0.0, 0.25), "at 0.30 s"),
            (
                WHOLE,
                Throughout,
                Condition::Heading { heading: 1.0, within: 0.5 },
                "a heading of 0°, expected 57° within 29°",
            ),
            (WHOLE, Throughout, Condition::Tilt(-0.1), "a tilt of 0°"),
            (WHOLE, Throughout, Condition::Speed(0.9), "found 1.00 m/s, expected at most 0.9 m/s"),
            (
                [0.0, 0.4],
                Once,
                Condition::Mode(Mode::Holding),
                "at 0.40 s found the mode taking off, expected once the mode holding",
            ),
            (WHOLE, Throughout, Condition::Mode(Mode::TakingOff), "at 0.50 s found the mode holding"),
            (WHOLE, Throughout, Condition::Controller(Controller::Cascade), "expected the cascade in charge"),
            (WHOLE, Throughout, Condition::Untouched, "at 0.70 s found a touch at (0.00, 0.00, 0.70) m"),
            (WHOLE, AtTheEnd, Condition::Landed, "at 1.00 s found a drone that is holding"),
            (
                [0.6, 1.0],
                Once,
                Condition::Said("take-off".to_owned()),
                "found none, expected once words with \"take-off\"",
            ),
        ];
        for (window_secs, extent, condition, expected) in cases {
            let text = failure(window_secs, extent, condition).unwrap();
            assert!(text.starts_with("it: ") && text.contains(expected), "{text}");
        }
    }

    #[test]
    fn landed_is_upright_at_rest_and_stopped() {
        let flown = climb();
        let rests = |change: &dyn Fn(&mut Moment)| {
            let mut moment = flown.moments[0].clone();
            (moment.mode, moment.state.velocity, moment.rotor_targets) =
                (Mode::Disarmed, Vector3::zeros(), STOPPED);
            change(&mut moment);
            Condition::Landed.holds(&moment)
        };
        assert!(rests(&|_| {}));
        assert!(!rests(&|moment| moment.mode = Mode::Landing));
        assert!(!rests(&|moment| moment.state.velocity.z = -1.0));
        assert!(!rests(&|moment| moment.rotor_targets = [1.0; 4]));
        let overturned = Attitude { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };
        assert!(!rests(&|moment| moment.state.world_from_body = overturned));
    }
}
