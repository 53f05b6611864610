//! Every failsafe, in every mode of flight, with the policy and with the cascade active: when it acts, what it does, and
//! how the flight ends.

use super::*;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cause {
    Stream,
    Link,
    Fence,
    BatteryLow,
    BatteryCritical,
    BatteryEmpty,
    Tilt,
    Spin,
    Silence,
    NotANumber,
    Saturation,
}

const CAUSES: [Cause; 11] = [
    Cause::Stream,
    Cause::Link,
    Cause::Fence,
    Cause::BatteryLow,
    Cause::BatteryCritical,
    Cause::BatteryEmpty,
    Cause::Tilt,
    Cause::Spin,
    Cause::Silence,
    Cause::NotANumber,
    Cause::Saturation,
];

const MODES: [Mode; 6] =
    [Mode::TakingOff, Mode::Holding, Mode::Guided, Mode::Offboard, Mode::Returning, Mode::Landing];

const ACTIONS: [FailsafeAction; 5] = [
    FailsafeAction::Warn,
    FailsafeAction::Hold,
    FailsafeAction::Return,
    FailsafeAction::Land,
    FailsafeAction::StopMotors,
];

/// Height at which a drone is upset \[m\]: high enough to be caught.
const UPSET_HEIGHT_M: f32 = 6.0;

/// Every landing is over by then \[s\].
const END_SECS: f32 = 45.0;

/// One place in the matrix.
#[derive(Clone, Copy, Debug)]
struct Cell {
    cause: Cause,
    mode: Mode,
    controller: Controller,
    action: FailsafeAction,
}

impl Cause {
    const fn event(self) -> FailsafeEvent {
        match self {
            Self::Stream => FailsafeEvent::OffboardLost,
            Self::Link => FailsafeEvent::LinkLost,
            Self::Fence => FailsafeEvent::FenceLeft,
            Self::BatteryLow => FailsafeEvent::BatteryLow,
            Self::BatteryCritical => FailsafeEvent::BatteryCritical,
            Self::BatteryEmpty => FailsafeEvent::BatteryEmpty,
            Self::Tilt => FailsafeEvent::Tilted,
            Self::Spin => FailsafeEvent::Spinning,
            Self::Silence | Self::NotANumber => FailsafeEvent::PolicySilent,
            Self::Saturation => FailsafeEvent::PolicySaturated,
        }
    }

    /// Whether only an active policy can fail so.
    const fn is_of_policy(self) -> bool {
        matches!(self, Self::Silence | Self::NotANumber | Self::Saturation)
    }

    /// How long it must last \[s\].
    const fn within_secs(self, settings: &AutopilotSettings) -> f32 {
        match self {
            Self::Stream => settings.offboard_loss_secs,
            Self::Link => settings.link_loss_secs,
            Self::Fence | Self::BatteryLow | Self::BatteryCritical | Self::BatteryEmpty => 0.0,
            Self::Tilt => settings.tilt_secs,
            Self::Spin => settings.rate_secs,
            Self::Silence | Self::NotANumber => settings.silence_secs,
            Self::Saturation => settings.saturation_secs,
        }
    }
}

impl Cell {
    /// All that can be: a stream is lost in the offboard mode only, a policy fails while active only, and its
    /// failure always has an action.
    fn all() -> Vec<Self> {
        let mut cells = Vec::new();
        for cause in CAUSES {
            for mode in MODES {
                for controller in [Controller::Policy, Controller::Cascade] {
                    cells.extend(ACTIONS.map(|action| Self { cause, mode, controller, action }));
                }
            }
        }
        cells.retain(Self::can_be);
        cells
    }

    fn can_be(&self) -> bool {
        match self.cause {
            Cause::Stream => self.mode == Mode::Offboard,
            Cause::Silence | Cause::NotANumber | Cause::Saturation => {
                self.controller == Controller::Policy && self.action != FailsafeAction::Warn
            }
            Cause::Link
            | Cause::Fence
            | Cause::BatteryLow
            | Cause::BatteryCritical
            | Cause::BatteryEmpty
            | Cause::Tilt
            | Cause::Spin => true,
        }
    }

    /// The action for this cause, a warning for all others.
    fn settings(&self) -> AutopilotSettings {
        let action_of =
            |causes: &[Cause]| if causes.contains(&self.cause) { self.action } else { FailsafeAction::Warn };
        let reaction_of = |causes: &[Cause]| {
            let meant = causes.contains(&self.cause);
            if meant {
                FailsafeReaction::with_cascade(self.action)
            } else {
                FailsafeReaction::only(FailsafeAction::Warn)
            }
        };
        AutopilotSettings {
            offboard_loss_action: action_of(&[Cause::Stream]),
            link_loss_action: action_of(&[Cause::Link]),
            link_loss_secs: 1.0,
            fence_action: action_of(&[Cause::Fence]),
            battery_actions: [Cause::BatteryLow, Cause::BatteryCritical, Cause::BatteryEmpty]
                .map(|cause| action_of(&[cause])),
            upset_reaction: reaction_of(&[Cause::Tilt, Cause::Spin]),
            policy_reaction: reaction_of(&[Cause::Silence, Cause::NotANumber, Cause::Saturation]),
            ..AutopilotSettings::default()
        }
    }

    /// The mode as soon as the failsafe has acted: nothing milder than what is done already.
    fn mode_after(&self) -> Mode {
        if self.action <= self.mode.action() {
            return self.mode;
        }
        match self.action {
            FailsafeAction::Nothing | FailsafeAction::Warn => self.mode,
            FailsafeAction::Hold => Mode::Holding,
            FailsafeAction::Return => Mode::Returning,
            FailsafeAction::Land => Mode::Landing,
            FailsafeAction::StopMotors => Mode::Disarmed,
        }
    }

    fn controller_after(&self) -> Controller {
        let replaced = self.cause.is_of_policy() || matches!(self.cause, Cause::Tilt | Cause::Spin);
        if replaced && self.action > FailsafeAction::Warn { Controller::Cascade } else { self.controller }
    }
}

/// In the midst of a mode of flight, away from home and from the mode's end.
fn ready(mode: Mode, controller: Controller) -> Rig {
    let begun = match mode {
        Mode::TakingOff | Mode::Landing | Mode::Offboard => mode,
        Mode::Disarmed | Mode::Armed | Mode::Landed | Mode::Holding | Mode::Guided | Mode::Returning => {
            Mode::Holding
        }
    };
    let mut rig = Rig::flown(begun, controller);
    match mode {
        Mode::TakingOff => rig.fly(0.8),
        Mode::Guided => rig.accept(Command::GoTo(Vector3::new(2.0, 0.0, 1.0))),
        Mode::Returning => {
            rig.accept(Command::GoTo(Vector3::new(1.5, 0.0, 1.5)));
            rig.fly(6.0);
            rig.accept(Command::Return);
        }
        Mode::Disarmed | Mode::Armed | Mode::Landed | Mode::Holding | Mode::Offboard | Mode::Landing => {}
    }
    assert_eq!((rig.autopilot.mode(), rig.autopilot.active_controller()), (mode, controller));
    rig
}

/// Brings a cause about.
fn begin(cause: Cause, rig: &mut Rig) {
    let limit = CF2X.rotor_speed_limit as f32;
    let mut state = *rig.plant.state();
    match cause {
        Cause::Stream => {}
        Cause::Link => rig.surroundings.link_age_secs = Some(0.0),
        Cause::Fence => {
            rig.fence(0.0, state.position.x + 1.0, 5.0);
            rig.tick();
            state.position.x += 1.2;
        }
        Cause::BatteryLow => rig.surroundings.battery = 0.14,
        Cause::BatteryCritical => rig.surroundings.battery = 0.06,
        Cause::BatteryEmpty => rig.surroundings.battery = 0.04,
        Cause::Tilt | Cause::Spin => state.position.z = UPSET_HEIGHT_M,
        Cause::Silence => rig.autopilot.controllers.backend().answer = Answer::Silent,
        Cause::NotANumber => {
            rig.autopilot.controllers.backend().answer = Answer::Always([f32::NAN, 1.0, 1.0, 1.0]);
        }
        Cause::Saturation => rig.autopilot.controllers.backend().answer = Answer::Always([limit; 4]),
    }
    rig.plant.put(state);
}

/// Keeps it up for one control period.
fn keep_up(cause: Cause, rig: &mut Rig) {
    let mut state = *rig.plant.state();
    match cause {
        Cause::Link => {
            let control_secs = rig.autopilot.control_secs();
            rig.surroundings.link_age_secs =
                rig.surroundings.link_age_secs.map(|age_secs| age_secs + control_secs);
        }
        Cause::Tilt => {
            // Just beyond the limit of 60°.
            let tilted = Attitude::from_axis_angle(Vector3::x(), 1.1).map(|value| value as f32);
            state.world_from_body = tilted;
        }
        Cause::Spin => state.body_rates = Vector3::new(0.0, 0.0, 16.0),
        Cause::Stream
        | Cause::Fence
        | Cause::BatteryLow
        | Cause::BatteryCritical
        | Cause::BatteryEmpty
        | Cause::Silence
        | Cause::NotANumber
        | Cause::Saturation => {}
    }
    rig.plant.put(state);
}

/// The stream that the offboard mode lives on.
fn stream(rig: &mut Rig) {
    // Refused after a failsafe.
    let _ = rig.autopilot.set_point(SetPoint::Position(Vector3::new(0.5, 0.0, 1.0)));
}

#[test]
fn every_failsafe_acts_in_its_time_and_ends_well() {
    let cells = Cell::all();
    assert_eq!(cells.len(), 10 + 7 * 60 + 3 * 24);
    for cell in cells {
        try_out(&cell);
    }
}

fn try_out(cell: &Cell) {
    let settings = cell.settings();
    let mut rig = ready(cell.mode, cell.controller);
    rig.autopilot.adjust(settings);
    begin(cell.cause, &mut rig);
    let streaming = cell.mode == Mode::Offboard && cell.cause != Cause::Stream;
    let acted = (0..200).position(|_| {
        keep_up(cell.cause, &mut rig);
        if streaming {
            stream(&mut rig);
        }
        rig.tick();
        rig.autopilot.events().contains(&cell.cause.event())
    });
    let control_secs = rig.autopilot.control_secs();
    let secs = acted.unwrap_or_else(|| panic!("{cell:?} is not noticed")) as f32 * control_secs;
    let late_secs = secs - cell.cause.within_secs(&settings);
    assert!(late_secs.abs() <= 1.001 * control_secs, "{cell:?}: {late_secs} s late");
    assert_eq!(
        (rig.autopilot.mode(), rig.autopilot.active_controller()),
        (cell.mode_after(), cell.controller_after()),
        "{cell:?}"
    );
    for _ in 0..(END_SECS / control_secs) as u32 {
        if streaming {
            stream(&mut rig);
        }
        rig.tick();
    }
    judge_end(cell, &rig);
}

fn judge_end(cell: &Cell, rig: &Rig) {
    let (end, mode) = (rig.position(), rig.autopilot.mode());
    assert!(end.iter().all(|value| value.is_finite()) && end.norm() < 5.0, "{cell:?}: {end}");
    match cell.mode_after() {
        Mode::Returning | Mode::Landing | Mode::Disarmed => {
            assert_eq!(mode, Mode::Disarmed, "{cell:?}: {end}");
            assert!(end.z < 0.02, "{cell:?}: {end}");
        }
        Mode::Holding | Mode::Guided | Mode::TakingOff | Mode::Offboard => {
            let expected = if cell.mode_after() == Mode::TakingOff { Mode::Holding } else { cell.mode_after() };
            assert_eq!(mode, expected, "{cell:?}: {end}");
            assert!(end.z > 0.2, "{cell:?}: {end}");
            assert!(cell.action != FailsafeAction::Hold || rig.autopilot.margin_m(&end) >= 0.0, "{cell:?}: {end}");
        }
        Mode::Armed | Mode::Landed => panic!("{cell:?}"),
    }
    if cell.mode_after() == Mode::Returning {
        assert!((end - rig.autopilot.home()).norm() < 0.3, "{cell:?}: {end}");
    }
}

#[test]
fn a_policy_that_does_not_fly_may_fail() {
    for cause in [Cause::Silence, Cause::NotANumber, Cause::Saturation] {
        for mode in MODES {
            let mut rig = ready(mode, Controller::Cascade);
            begin(cause, &mut rig);
            for _ in 0..100 {
                stream(&mut rig);
                rig.tick();
                assert_eq!(rig.autopilot.events(), &FailsafeEvents::new(), "{cause:?} in {mode:?}");
            }
        }
    }
}

#[test]
fn a_policy_that_failed_does_not_fly_again() {
    let mut rig = ready(Mode::Holding, Controller::Policy);
    begin(Cause::Silence, &mut rig);
    rig.fly(5.0);
    assert_eq!((rig.autopilot.active_controller(), rig.autopilot.mode()), (Controller::Cascade, Mode::Holding));
    assert_eq!(rig.autopilot.command(Command::SelectController(Controller::Policy)), Err(Refusal::SelfTest));
}

#[test]
fn a_stale_set_point_stops_the_drone_at_once() {
    let velocity = SetPoint::Velocity(Vector3::new(0.5, 0.0, 0.0));
    let attitude =
        SetPoint::Attitude(AttitudeSetPoint::Attitude { world_from_body: Attitude::level(), thrust: 0.5 });
    let rates = SetPoint::Attitude(AttitudeSetPoint::BodyRates { body_rates: Vector3::zeros(), thrust: 0.5 });
    for set_point in [velocity, attitude, rates] {
        for controller in [Controller::Policy, Controller::Cascade] {
            let mut rig = ready(Mode::Offboard, controller);
            let settings = AutopilotSettings { offboard_loss_secs: 60.0, ..AutopilotSettings::default() };
            rig.autopilot.adjust(settings);
            for _ in 0..20 {
                rig.stream(set_point);
                rig.tick();
            }
            let stopped = |rig: &Rig| rig.autopilot.goal().arrived() && rig.autopilot.attitude_set_point.is_none();
            assert!(!stopped(&rig));
            let control_secs = rig.autopilot.control_secs();
            let ticks = (0..100).position(|_| {
                rig.tick();
                stopped(&rig)
            });
            let secs = ticks.expect("it stops") as f32 * control_secs;
            assert!((secs - settings.set_point_stale_secs).abs() <= 1.001 * control_secs, "{secs} s");
            rig.fly(10.0);
            assert_eq!(rig.autopilot.mode(), Mode::Offboard, "and waits for the stream");
            assert!(rig.plant.state().velocity.norm() < 0.05, "{set_point:?}, {controller:?}");
        }
    }
}

#[test]
fn a_stream_that_goes_on_does_not_undo_a_failsafe_and_a_command_does() {
    for mode in [Mode::Guided, Mode::Offboard] {
        let mut rig = ready(mode, Controller::Policy);
        let there = SetPoint::Position(Vector3::new(1.0, 0.0, 1.0));
        rig.stream(there);
        rig.surroundings.battery = 0.06;
        rig.tick();
        assert_eq!(rig.autopilot.mode(), Mode::Returning);
        assert_eq!(rig.autopilot.set_point(there), Err(Refusal::Failsafe));
        rig.accept(Command::SelectController(Controller::Cascade));
        assert_eq!(rig.autopilot.set_point(there), Err(Refusal::Failsafe), "who flies is another matter");
        rig.accept(Command::Offboard);
        rig.stream(there);
        assert_eq!(rig.autopilot.mode(), Mode::Offboard);
    }
}

#[test]
fn a_stream_that_comes_back_is_followed_again() {
    let mut rig = ready(Mode::Offboard, Controller::Policy);
    rig.fly(1.5);
    assert_eq!(rig.autopilot.mode(), Mode::Holding);
    rig.stream(SetPoint::Position(Vector3::new(1.0, 0.0, 1.0)));
    assert_eq!(rig.autopilot.mode(), Mode::Guided);
}
