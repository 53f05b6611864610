//! What happens in each flight, and how it must end.

use kestrel_onboard::autopilot::Mode;
use kestrel_onboard::controller::Controller;
use kestrel_onboard::failsafe::FailsafeEvent;

use super::line::{Presence, SetPointStream};

/// A flight from the floor, and the events of its script.
pub(super) struct Flight {
    pub(super) name: &'static str,
    /// Height of the take-off \[m\].
    pub(super) altitude_m: f32,
    /// Fence around home \[m\].
    pub(super) fence_radius_m: Option<f32>,
    /// Corners of a zone to stay in \[m, world x and y\], in which there is a pillar to stay away from.
    pub(super) room: Option<[[f64; 2]; 4]>,
    /// When what happens \[s\].
    pub(super) script: &'static [(f32, ScriptEvent)],
    /// How long it is watched \[s\].
    pub(super) secs: f32,
    /// What must go wrong, in order, and nothing else.
    pub(super) events: &'static [FailsafeEvent],
    /// What it must be doing at the end, and who must be flying.
    pub(super) end: (Mode, Controller),
}

/// What happens.
pub(super) enum ScriptEvent {
    /// The ground station sends a command with parameters 1 to 3, until it is acknowledged.
    Command(u16, [f32; 3]),
    /// It sends these set-points from now on.
    SetPointStream(SetPointStream),
    /// It says that it is there, or no more.
    GroundStation(Presence),
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
    /// A sender without the key commands to terminate the flight.
    Intrude,
}

const ARM: ScriptEvent = ScriptEvent::Command(400, [1.0, 0.0, 0.0]);
const TAKE_OFF: ScriptEvent = ScriptEvent::Command(22, [0.0; 3]);
const LAND: ScriptEvent = ScriptEvent::Command(21, [0.0; 3]);
const OFFBOARD: ScriptEvent = ScriptEvent::Command(176, [1.0, 6.0, 0.0]);
const BY_CASCADE: ScriptEvent = ScriptEvent::Command(176, [1.0, 4.0, 12.0]);
const BY_POLICY: ScriptEvent = ScriptEvent::Command(176, [1.0, 4.0, 11.0]);
const TERMINATE: ScriptEvent = ScriptEvent::Command(185, [1.0, 0.0, 0.0]);

/// A flight that takes off; the others are made of it.
const UP: Flight = Flight {
    name: "up",
    altitude_m: 1.0,
    fence_radius_m: None,
    room: None,
    script: &[(0.2, ARM), (1.0, TAKE_OFF)],
    secs: 4.0,
    events: &[],
    end: (Mode::Holding, Controller::Policy),
};

pub(super) const FLIGHTS: [Flight; 11] = [
    Flight {
        name: "there, by the cascade for a while, and down",
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, ScriptEvent::SetPointStream(SetPointStream::Position([0.5, 0.3, -1.2]))),
            (6.0, ScriptEvent::SetPointStream(SetPointStream::Nothing)),
            (7.0, BY_CASCADE),
            (9.0, BY_POLICY),
            (10.0, LAND),
        ],
        secs: 20.0,
        end: (Mode::Disarmed, Controller::Policy),
        ..UP
    },
    Flight {
        name: "ground station lost",
        script: &[
            (0.0, ScriptEvent::GroundStation(Presence::Present)),
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, ScriptEvent::GroundStation(Presence::Gone)),
        ],
        secs: 7.0,
        events: &[FailsafeEvent::LinkLost],
        end: (Mode::Landing, Controller::Policy),
        ..UP
    },
    Flight {
        name: "battery low, critical, empty",
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, ScriptEvent::Battery(0.1)),
            (4.5, ScriptEvent::Battery(0.06)),
            (5.5, ScriptEvent::Battery(0.04)),
        ],
        secs: 6.0,
        events: &[FailsafeEvent::BatteryLow, FailsafeEvent::BatteryCritical, FailsafeEvent::BatteryEmpty],
        end: (Mode::Landing, Controller::Policy),
        ..UP
    },
    Flight {
        name: "fence left, and an intruder",
        fence_radius_m: Some(1.0),
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, ScriptEvent::SetPointStream(SetPointStream::Position([0.5, 0.0, -1.0]))),
            (6.0, ScriptEvent::SetPointStream(SetPointStream::Nothing)),
            (6.5, ScriptEvent::Gust([0.0, 0.6, 0.0])),
            (9.0, ScriptEvent::Intrude),
        ],
        secs: 10.0,
        events: &[FailsafeEvent::FenceLeft],
        end: (Mode::Holding, Controller::Policy),
        ..UP
    },
    Flight {
        name: "zone left",
        // It turns inward.
        room: Some([[-1.0, -1.0], [0.0, -0.8], [1.0, -1.0], [0.0, 1.2]]),
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, ScriptEvent::Gust([0.45, 0.35, 0.0]))],
        secs: 8.0,
        events: &[FailsafeEvent::FenceLeft],
        end: (Mode::Holding, Controller::Policy),
        ..UP
    },
    Flight {
        name: "set-points lost",
        script: &[
            (0.2, ARM),
            (1.0, TAKE_OFF),
            (4.0, ScriptEvent::SetPointStream(SetPointStream::Velocity([0.2, -0.1, 0.0]))),
            (4.5, OFFBOARD),
            (6.5, ScriptEvent::SetPointStream(SetPointStream::Level { thrust: 0.55 })),
            (7.0, ScriptEvent::SetPointStream(SetPointStream::Nothing)),
        ],
        secs: 9.0,
        events: &[FailsafeEvent::OffboardLost],
        end: (Mode::Holding, Controller::Policy),
        ..UP
    },
    Flight {
        name: "state no number, shortly and for longer",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, ScriptEvent::Blind(4)), (5.0, ScriptEvent::Blind(20))],
        secs: 6.0,
        end: (Mode::Disarmed, Controller::Policy),
        ..UP
    },
    Flight {
        name: "flight terminated",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (3.0, TERMINATE)],
        end: (Mode::Disarmed, Controller::Policy),
        ..UP
    },
    Flight {
        name: "tumbling",
        altitude_m: 2.0,
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (6.0, ScriptEvent::Tumble(20))],
        secs: 8.0,
        events: &[FailsafeEvent::Tilted, FailsafeEvent::Spinning],
        end: (Mode::Landing, Controller::Cascade),
        ..UP
    },
    Flight {
        name: "policy silent",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, ScriptEvent::Hang)],
        secs: 7.0,
        events: &[FailsafeEvent::PolicySilent],
        end: (Mode::Holding, Controller::Cascade),
        ..UP
    },
    Flight {
        name: "policy saturated",
        script: &[(0.2, ARM), (1.0, TAKE_OFF), (4.0, ScriptEvent::Saturate)],
        secs: 7.0,
        events: &[FailsafeEvent::PolicySaturated],
        end: (Mode::Holding, Controller::Cascade),
        ..UP
    },
];
