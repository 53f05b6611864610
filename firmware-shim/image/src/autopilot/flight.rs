//! What happens in each flight, and how it must end.

use kestrel_onboard::autopilot::Mode;
use kestrel_onboard::failsafe::Event;
use kestrel_onboard::flyer::Flyer;

use super::line::{Station, Stream};

/// A flight from the floor, and what somebody or something does to it.
pub(super) struct Flight {
    pub(super) name: &'static str,
    /// Height of the take-off \[m\].
    pub(super) altitude_m: f32,
    /// Fence around home \[m\].
    pub(super) fence_radius_m: Option<f32>,
    /// Corners of a zone to stay in \[m, world x and y\], in which there is a pillar to stay away from.
    pub(super) room: Option<[[f64; 2]; 4]>,
    /// When what happens \[s\].
    pub(super) script: &'static [(f32, Deed)],
    /// How long it is watched \[s\].
    pub(super) secs: f32,
    /// What must go wrong, in order, and nothing else.
    pub(super) events: &'static [Event],
    /// What it must be doing at the end, and who must be flying.
    pub(super) end: (Mode, Flyer),
}

/// What happens.
pub(super) enum Deed {
    /// The ground station sends a command with parameters 1 to 3, until it is acknowledged.
    Command(u16, [f32; 3]),
    /// It sends these set-points from now on.
    Stream(Stream),
    /// It says that it is there, or no more.
    Speak(Station),
    /// The battery has this share left.
    Battery(f32),
    /// The drone is moved \[m, world\].
    Gust([f32; 3]),
    /// The state is no number for so many control periods.
    Blind(u32),
    /// Something turns the drone upside down for so many control periods.
    Tumble(u32),
    /// The policy gives no answer any more.
    Hang,
    /// It wants all there is from every motor.
    Saturate,
    /// Somebody without the key wants the flight terminated.
    Intrude,
}

const ARM: Deed = Deed::Command(400, [1.0, 0.0, 0.0]);
const TAKE_OFF: Deed = Deed::Command(22, [0.0; 3]);
const LAND: Deed = Deed::Command(21, [0.0; 3]);
const OFFBOARD: Deed = Deed::Command(176, [1.0, 6.0, 0.0]);
const BY_CASCADE: Deed = Deed::Command(176, [1.0, 4.0, 12.0]);
const BY_POLICY: Deed = Deed::Command(176, [1.0, 4.0, 11.0]);
const TERMINATE: Deed = Deed::Command(185, [1.0, 0.0, 0.0]);

/// A flight that takes off; the others are made of it.
const UP: Flight = Flight {
    name: "up",
    altitude_m: 1.0,
    fence_radius_m: None,
    room: None,
    script: &[(0.2, ARM), (1.0, TAKE_OFF)],
    secs: 4.0,
    events: &[],
    end: (Mode::Holding, Flyer::Policy),
};

pub(super) const FLIGHTS: [Flight; 11] = [
    Flight {
        name: "there, by the cascade for a while, and down",
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, Deed::Stream(Stream::Position([0.5, 0.3, -1.2]))),
            (6.0, Deed::Stream(Stream::Nothing)),
            (7.0, BY_CASCADE),
            (9.0, BY_POLICY),
            (10.0, LAND),
        ],
        secs: 20.0,
        end: (Mode::Disarmed, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "ground station lost",
        script: &[
            (0.0, Deed::Speak(Station::Present)),
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, Deed::Speak(Station::Gone)),
        ],
        secs: 7.0,
        events: &[Event::LinkLost],
        end: (Mode::Landing, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "battery low, critical, empty",
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, Deed::Battery(0.1)),
            (4.5, Deed::Battery(0.06)),
            (5.5, Deed::Battery(0.04)),
        ],
        secs: 6.0,
        events: &[Event::BatteryLow, Event::BatteryCritical, Event::BatteryEmpty],
        end: (Mode::Landing, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "fence left, and an intruder",
        fence_radius_m: Some(1.0),
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, Deed::Stream(Stream::Position([0.5, 0.0, -1.0]))),
            (6.0, Deed::Stream(Stream::Nothing)),
            (6.5, Deed::Gust([0.0, 0.6, 0.0])),
            (9.0, Deed::Intrude),
        ],
        secs: 10.0,
        events: &[Event::FenceLeft],
        end: (Mode::Holding, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "zone left",
        // It turns inward.
        room: Some([[-1.0, -1.0], [0.0, -0.8], [1.0, -1.0], [0.0, 1.2]]),
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, Deed::Gust([0.45, 0.35, 0.0]))],
        secs: 8.0,
        events: &[Event::FenceLeft],
        end: (Mode::Holding, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "set-points lost",
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, Deed::Stream(Stream::Velocity([0.2, -0.1, 0.0]))),
            (4.5, OFFBOARD),
            (6.5, Deed::Stream(Stream::Level { thrust: 0.55 })),
            (7.0, Deed::Stream(Stream::Nothing)),
        ],
        secs: 9.0,
        events: &[Event::OffboardLost],
        end: (Mode::Holding, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "state no number, shortly and for longer",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, Deed::Blind(4)), (5.0, Deed::Blind(20))],
        secs: 6.0,
        end: (Mode::Disarmed, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "flight terminated",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (3.0, TERMINATE)],
        end: (Mode::Disarmed, Flyer::Policy),
        ..UP
    },
    Flight {
        name: "tumbling",
        altitude_m: 2.0,
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (6.0, Deed::Tumble(20))],
        secs: 8.0,
        events: &[Event::Tilted, Event::Spinning],
        end: (Mode::Landing, Flyer::Cascade),
        ..UP
    },
    Flight {
        name: "policy silent",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, Deed::Hang)],
        secs: 7.0,
        events: &[Event::PolicySilent],
        end: (Mode::Holding, Flyer::Cascade),
        ..UP
    },
    Flight {
        name: "policy saturated",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, Deed::Saturate)],
        secs: 7.0,
        events: &[Event::PolicySaturated],
        end: (Mode::Holding, Flyer::Cascade),
        ..UP
    },
];
