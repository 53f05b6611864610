mod collision;
mod faults;

use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;
use kestrel_core::setpoint::Setpoint;
use proptest::prelude::*;

use kestrel_core::attitude::Attitude;

use super::*;
use crate::fence::{Cylinder, ZoneKind};
use crate::plant::{FlatFloor, Plant};
use crate::settings::AutopilotSettings;
use crate::testing::{dishonest_policy, hover_policy, pilot};

/// An autopilot in its plant.
struct Rig {
    autopilot: Autopilot<Faulty>,
    plant: FlatFloor,
    surroundings: Surroundings,
}

/// What a processor does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Answer {
    /// It computes the policy.
    Right,
    /// Nothing.
    Silent,
    /// This, whatever the state \[rad/s\].
    Always([f32; 4]),
}

/// A processor that may fail.
struct Faulty {
    pilot: Pilot<'static>,
    answer: Answer,
}

impl PolicyBackend for Faulty {
    fn control_secs(&self) -> f32 {
        PolicyBackend::control_secs(&self.pilot)
    }

    fn observation(&self) -> &ObservationLayout {
        PolicyBackend::observation(&self.pilot)
    }

    fn healthy(&mut self) -> bool {
        self.answer == Answer::Right && self.pilot.healthy()
    }

    fn reset(&mut self) {
        PolicyBackend::reset(&mut self.pilot);
    }

    fn tick(&mut self, state: &State<f32>, setpoint: &Setpoint<f32>) -> Option<[f32; 4]> {
        match self.answer {
            Answer::Right => PolicyBackend::tick(&mut self.pilot, state, setpoint),
            Answer::Silent => None,
            Answer::Always(targets) => Some(targets),
        }
    }
}

impl Rig {
    fn new() -> Self {
        Self::with(hover_policy())
    }

    fn with(policy: Vec<u8>) -> Self {
        let backend = Faulty { pilot: pilot(policy), answer: Answer::Right };
        let autopilot = Autopilot::new(backend, &CF2X);
        let plant = FlatFloor::new(&CF2X, autopilot.control_secs());
        let mut rig = Self { autopilot, plant, surroundings: Surroundings::default() };
        rig.tick();
        rig
    }

    fn in_mode(mode: Mode) -> Self {
        Self::flown(mode, Controller::Policy)
    }

    /// In a mode, with a controller.
    fn flown(mode: Mode, controller: Controller) -> Self {
        let mut rig = Self::new();
        rig.accept(Command::SelectController(controller));
        if mode == Mode::Disarmed {
            return rig;
        }
        rig.accept(Command::Arm);
        if mode == Mode::Armed {
            return rig;
        }
        rig.accept(Command::TakeOff { altitude_m: 1.0 });
        if mode == Mode::TakingOff {
            return rig;
        }
        rig.fly_until(Mode::Holding, 10.0);
        match mode {
            Mode::Guided => rig.accept(Command::GoTo(Vector3::new(0.5, 0.0, 1.0))),
            Mode::Offboard => {
                rig.stream(SetPoint::Position(Vector3::new(0.5, 0.0, 1.0)));
                rig.accept(Command::Offboard);
            }
            Mode::Returning => rig.accept(Command::Return),
            Mode::Landing => rig.accept(Command::Land),
            Mode::Landed => {
                rig.accept(Command::Land);
                rig.fly_until(Mode::Landed, 10.0);
            }
            Mode::Disarmed | Mode::Armed | Mode::TakingOff | Mode::Holding => {}
        }
        rig
    }

    fn tick(&mut self) -> [f32; 4] {
        let targets = self.autopilot.tick(self.plant.state(), &self.surroundings);
        self.plant.step(&targets);
        targets
    }

    fn fly(&mut self, secs: f32) {
        for _ in 0..(secs / self.autopilot.control_secs()).round() as u32 {
            self.tick();
        }
    }

    /// Time until the mode changes to `mode` \[s\].
    fn fly_until(&mut self, mode: Mode, limit_secs: f32) -> f32 {
        let control_secs = self.autopilot.control_secs();
        let limit = (limit_secs / control_secs) as u32;
        for ticks in 0..limit {
            if self.autopilot.mode() == mode {
                return ticks as f32 * control_secs;
            }
            self.tick();
        }
        panic!("{} after {limit_secs} s, not {}", self.autopilot.mode().name(), mode.name());
    }

    fn fence(&mut self, x_m: f32, radius_m: f32, height_m: f32) {
        let center = Vector3::new(x_m, 0.0, 0.0);
        self.autopilot.fence.cylinder = Cylinder { center, radius_m: Some(radius_m), height_m: Some(height_m) };
    }

    fn stream(&mut self, set_point: SetPoint) {
        assert_eq!(self.autopilot.set_point(set_point), Ok(()), "{set_point:?}");
    }

    fn accept(&mut self, command: Command) {
        assert_eq!(self.autopilot.command(command), Ok(()), "{command:?}");
    }

    fn refuse(&mut self, command: Command, refusal: Refusal) {
        let before = self.autopilot.mode();
        assert_eq!(self.autopilot.command(command), Err(refusal), "{command:?} in {before:?}");
        assert_eq!(self.autopilot.mode(), before);
    }

    fn position(&self) -> Vector3<f32> {
        self.plant.state().position
    }
}

/// What becomes of a command in each of [`Mode::ALL`].
type Row = [Result<Mode, Refusal>; 9];

#[rustfmt::skip]
fn table() -> [(Command, Row); 11] {
    use Mode::{Armed, Disarmed, Guided, Holding, Landed, Landing, Offboard, Returning, TakingOff};
    use Refusal::{InFlight, NotArmed, NotCruising, NotFlying};
    const AIR: Result<Mode, Refusal> = Err(InFlight);
    const CRUISE: Result<Mode, Refusal> = Err(NotCruising);
    const GROUND: Result<Mode, Refusal> = Err(NotFlying);
    const STREAM: Result<Mode, Refusal> = Err(Refusal::NoSetPoints);
    let stay = Mode::ALL.map(Ok);
    let go_to = Command::GoTo(Vector3::new(0.0, 0.5, 1.0));
    let drift = Command::Velocity(Vector3::new(0.0, 0.5, 0.0));
    let take_off = Command::TakeOff { altitude_m: 0.5 };
    [
        //                     Disarmed       Armed          TakingOff      Holding        Guided         Offboard       Returning      Landing        Landed
        (Command::Arm,        [Ok(Armed),     Ok(Armed),     Ok(TakingOff), Ok(Holding),   Ok(Guided),    Ok(Offboard),  Ok(Returning), Ok(Landing),   Ok(Landed)]),
        (Command::Disarm,     [Ok(Disarmed),  Ok(Disarmed),  AIR,           AIR,           AIR,           AIR,           AIR,           AIR,           Ok(Disarmed)]),
        (Command::StopMotors, [Ok(Disarmed); 9]),
        (take_off,            [Err(NotArmed), Ok(TakingOff), AIR,           AIR,           AIR,           AIR,           AIR,           AIR,           Ok(TakingOff)]),
        (go_to,               [CRUISE,        CRUISE,        CRUISE,        Ok(Guided),    Ok(Guided),    Ok(Guided),    Ok(Guided),    CRUISE,        CRUISE]),
        (drift,               [CRUISE,        CRUISE,        CRUISE,        Ok(Guided),    Ok(Guided),    Ok(Guided),    Ok(Guided),    CRUISE,        CRUISE]),
        // Offboard itself has a stream, the others none.
        (Command::Offboard,   [STREAM,        STREAM,        STREAM,        STREAM,        STREAM,        Ok(Offboard),  STREAM,        STREAM,        STREAM]),
        (Command::Pause,      [CRUISE,        CRUISE,        Ok(Holding),   Ok(Holding),   Ok(Holding),   Ok(Holding),   Ok(Holding),   CRUISE,        CRUISE]),
        (Command::Return,     [GROUND,        GROUND,        Ok(Returning), Ok(Returning), Ok(Returning), Ok(Returning), Ok(Returning), Ok(Returning), GROUND]),
        (Command::Land,       [GROUND,        GROUND,        Ok(Landing),   Ok(Landing),   Ok(Landing),   Ok(Landing),   Ok(Landing),   Ok(Landing),   Ok(Landed)]),
        (Command::SelectController(Controller::Cascade), stay),
    ]
}

#[test]
fn every_mode_answers_every_command_as_drawn() {
    for (command, outcomes) in table() {
        for (mode, outcome) in Mode::ALL.into_iter().zip(outcomes) {
            let mut rig = Rig::in_mode(mode);
            assert_eq!(rig.autopilot.mode(), mode);
            match outcome {
                Ok(next) => {
                    rig.accept(command);
                    assert_eq!(rig.autopilot.mode(), next, "{command:?} in {mode:?}");
                }
                Err(refusal) => rig.refuse(command, refusal),
            }
        }
    }
}

#[test]
fn an_idle_armed_drone_is_disarmed() {
    let secs = Rig::in_mode(Mode::Armed).fly_until(Mode::Disarmed, 20.0);
    assert!((secs - AutopilotSettings::default().idle_secs).abs() < 0.02, "{secs}");
}

#[test]
fn a_landed_drone_is_disarmed() {
    let secs = Rig::in_mode(Mode::Landed).fly_until(Mode::Disarmed, 20.0);
    assert!((secs - AutopilotSettings::default().landed_secs).abs() < 0.02, "{secs}");
}

#[test]
fn a_take_off_ends_at_its_height() {
    let mut rig = Rig::in_mode(Mode::Armed);
    rig.accept(Command::TakeOff { altitude_m: 1.5 });
    let secs = rig.fly_until(Mode::Holding, 10.0);
    assert!(secs > 1.5 / AutopilotSettings::default().climb_speed - 1.0, "{secs}");
    rig.fly(3.0);
    assert!((rig.position() - Vector3::new(0.0, 0.0, 1.5125)).norm() < 0.05, "{}", rig.position());
}

#[test]
fn set_points_are_reached_and_held() {
    let mut rig = Rig::in_mode(Mode::Holding);
    for point in [Vector3::new(1.0, 0.0, 1.0), Vector3::new(1.0, -1.5, 2.0), Vector3::new(-0.5, 0.5, 0.5)] {
        rig.accept(Command::GoTo(point));
        rig.fly(16.0);
        assert!((rig.position() - point).norm() < 0.05, "{} instead of {point}", rig.position());
    }
}

#[test]
fn a_landing_from_high_up_is_fast_first_and_soft_at_last() {
    let mut rig = Rig::flown(Mode::Guided, Controller::Cascade);
    rig.accept(Command::GoTo(Vector3::new(0.0, 0.0, 4.0)));
    rig.fly(16.0);
    rig.accept(Command::Land);
    let (mut fastest, mut softest, mut ticks) = (0.0_f32, 0.0_f32, 0_u16);
    while rig.autopilot.mode() == Mode::Landing {
        let sinking = -rig.plant.state().velocity.z;
        fastest = fastest.max(sinking);
        if rig.position().z < 1.5 {
            softest = softest.max(sinking);
        }
        rig.tick();
        ticks += 1;
    }
    let AutopilotSettings { landing_speed, descent_speed, .. } = AutopilotSettings::default();
    assert!(fastest > 0.9 * descent_speed && softest < 2.0 * landing_speed, "{fastest}, then {softest} m/s");
    let secs = f32::from(ticks) * rig.autopilot.control_secs();
    assert!(secs < 11.0, "{secs} s");
}

#[test]
fn a_landing_is_soft_and_ends_below_its_start() {
    let mut rig = Rig::in_mode(Mode::Guided);
    rig.fly(5.0);
    rig.accept(Command::Land);
    let mut fastest = 0.0_f32;
    while rig.autopilot.mode() == Mode::Landing {
        fastest = fastest.max(-rig.plant.state().velocity.z);
        rig.tick();
    }
    assert_eq!(rig.autopilot.mode(), Mode::Landed);
    assert!(fastest < 2.0 * AutopilotSettings::default().landing_speed, "{fastest} m/s");
    assert!((rig.position() - Vector3::new(0.5, 0.0, 0.0125)).norm() < 0.1, "{}", rig.position());
    assert_eq!(rig.tick(), STOPPED);
}

#[test]
fn a_landing_ends_where_the_drone_touches_down_however_far_aside() {
    for aside_m in [0.35, 0.6] {
        let mut rig = Rig::in_mode(Mode::Landing);
        let mut state = *FlatFloor::new(&CF2X, 0.01).at([aside_m, 0.0]).state();
        state.position.z += 0.01;
        while rig.autopilot.mode() == Mode::Landing {
            // The floor holds it.
            rig.plant.put(state);
            rig.tick();
            assert!(rig.autopilot.ticks_in_mode < 1000, "{aside_m} m aside");
        }
        assert_eq!(rig.autopilot.mode(), Mode::Landed);
    }
}

#[test]
fn a_hovering_drone_is_never_taken_for_a_landed_one() {
    let mut rig = Rig::in_mode(Mode::Landing);
    while rig.position().z > 0.1 {
        rig.tick();
        assert_eq!(rig.autopilot.mode(), Mode::Landing);
    }
}

#[test]
fn a_pause_stops_on_the_way() {
    let mut rig = Rig::in_mode(Mode::Holding);
    rig.accept(Command::GoTo(Vector3::new(5.0, 0.0, 1.0)));
    rig.fly(3.0);
    rig.accept(Command::Pause);
    rig.fly(5.0);
    assert!((0.5..3.0).contains(&rig.position().x), "{}", rig.position());
    assert!(rig.plant.state().velocity.norm() < 0.01);
}

#[test]
fn the_goal_stays_within_its_leash() {
    let mut rig = Rig::in_mode(Mode::Holding);
    rig.accept(Command::GoTo(Vector3::new(3.0, 3.0, 2.0)));
    for _ in 0..1000 {
        rig.tick();
        assert!((rig.autopilot.goal().position() - rig.position()).norm() <= LEASH_M + 0.01);
    }
}

#[test]
fn take_off_heights_have_limits() {
    let mut rig = Rig::in_mode(Mode::Armed);
    for altitude_m in [f32::NAN, f32::INFINITY, -1.0, 0.0, 0.1, 21.0] {
        rig.refuse(Command::TakeOff { altitude_m }, Refusal::Altitude);
    }
}

#[test]
fn a_policy_that_fails_its_self_test_is_not_armed() {
    let mut rig = Rig::with(dishonest_policy());
    rig.refuse(Command::Arm, Refusal::SelfTest);
}

#[test]
fn arming_wants_a_known_level_state_at_rest() {
    let mut autopilot = Autopilot::new(pilot(hover_policy()), &CF2X);
    assert_eq!(autopilot.command(Command::Arm), Err(Refusal::StateUnknown));
    let rest = *FlatFloor::new(&CF2X, 0.01).state();
    let mut tilted = rest;
    tilted.world_from_body.w = 0.9;
    tilted.world_from_body.x = 0.4359;
    let falling = State { velocity: Vector3::new(0.0, 0.0, -1.0), ..rest };
    let unknown = State { position: Vector3::new(0.0, f32::NAN, 0.0), ..rest };
    let wrong = [(tilted, Refusal::NotLevel), (falling, Refusal::Moving), (unknown, Refusal::StateUnknown)];
    for (state, refusal) in wrong {
        assert_eq!(autopilot.tick(&state, &Surroundings::default()), STOPPED);
        assert_eq!(autopilot.command(Command::Arm), Err(refusal));
    }
}

#[test]
fn one_bad_reading_is_flown_through_and_a_lasting_one_stops_the_motors() {
    let mut rig = Rig::in_mode(Mode::Holding);
    let last = rig.tick();
    let bad = State { position: Vector3::new(f32::NAN, 0.0, 1.0), ..*rig.plant.state() };
    assert_eq!(rig.autopilot.tick(&bad, &Surroundings::default()), last);
    rig.fly(1.0);
    assert_eq!(rig.autopilot.mode(), Mode::Holding);
    let ticks = (BLIND_SECS / rig.autopilot.control_secs()) as u32 + 2;
    for _ in 0..ticks {
        assert!(rig.autopilot.tick(&bad, &Surroundings::default()).iter().all(|target| target.is_finite()));
    }
    assert_eq!(rig.autopilot.mode(), Mode::Disarmed);
    assert_eq!(rig.autopilot.tick(&bad, &Surroundings::default()), STOPPED);
}

fn any_command() -> impl Strategy<Value = Command> {
    let point = [-3.0_f32..3.0, -3.0_f32..3.0, 0.0_f32..3.0];
    prop_oneof![
        Just(Command::Arm),
        Just(Command::Disarm),
        Just(Command::StopMotors),
        any::<f32>().prop_map(|altitude_m| Command::TakeOff { altitude_m }),
        (0.2_f32..2.0).prop_map(|altitude_m| Command::TakeOff { altitude_m }),
        point.prop_map(|[x, y, z]| Command::GoTo(Vector3::new(x, y, z))),
        any_velocity().prop_map(Command::Velocity),
        Just(Command::Offboard),
        Just(Command::Pause),
        Just(Command::Return),
        Just(Command::Land),
        Just(Command::SelectController(Controller::Policy)),
        Just(Command::SelectController(Controller::Cascade)),
    ]
}

fn any_velocity() -> impl Strategy<Value = Vector3<f32>> {
    let speed = || prop_oneof![-0.6_f32..0.6, any::<f32>()];
    [speed(), speed(), speed()].prop_map(Vector3::from)
}

fn any_set_point() -> impl Strategy<Value = SetPoint> {
    let thrust = || prop_oneof![0.0_f32..1.0, any::<f32>()];
    let attitude = (-1.0_f32..1.0, -1.0_f32..1.0, thrust()).prop_map(|(x, y, thrust)| {
        let world_from_body = Attitude { w: 1.0, x, y, z: 0.0 }.normalized();
        SetPoint::Attitude(AttitudeSetPoint::Attitude { world_from_body, thrust })
    });
    let rates =
        ([-20.0_f32..20.0, -20.0_f32..20.0], any::<f32>(), thrust()).prop_map(|([roll, pitch], yaw, thrust)| {
            SetPoint::Attitude(AttitudeSetPoint::BodyRates { body_rates: Vector3::new(roll, pitch, yaw), thrust })
        });
    let position = [-3.0_f32..3.0, -3.0_f32..3.0, 0.0_f32..3.0].prop_map(|point| SetPoint::Position(point.into()));
    prop_oneof![position, any_velocity().prop_map(SetPoint::Velocity), attitude, rates]
}

/// What the autopilot is shown instead of the true state.
#[derive(Clone, Copy, Debug)]
enum Reading {
    True,
    NotANumber,
    Huge,
}

fn any_reading() -> impl Strategy<Value = Reading> {
    prop_oneof![8 => Just(Reading::True), 1 => Just(Reading::NotANumber), 1 => Just(Reading::Huge)]
}

fn read(state: &State<f32>, reading: Reading) -> State<f32> {
    let wrong = |x: f32| State { position: Vector3::new(x, -x, x), velocity: Vector3::new(-x, x, x), ..*state };
    match reading {
        Reading::True => *state,
        Reading::NotANumber => wrong(f32::NAN),
        Reading::Huge => wrong(f32::MAX),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn motors_are_finite_in_range_and_stopped_unless_armed_by_command(
        script in proptest::collection::vec((any_command(), any_set_point(), any_reading(), 1_u32..150), 1..25)
    ) {
        let limit = CF2X.rotor_speed_limit as f32 * 1.000_001;
        let mut rig = Rig::new();
        let mut allowed = false;
        for (command, set_point, reading, ticks) in script {
            let _ = rig.autopilot.set_point(set_point);
            let accepted = rig.autopilot.command(command).is_ok();
            if accepted && command == Command::Arm {
                allowed = true;
            }
            for _ in 0..ticks {
                let state = read(rig.plant.state(), reading);
                let targets = rig.autopilot.tick(&state, &Surroundings::default());
                rig.plant.step(&targets);
                let mode = rig.autopilot.mode();
                allowed &= mode.armed();
                prop_assert!(allowed || !mode.armed(), "armed without a command");
                prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{targets:?}");
                prop_assert!(mode.flies() || targets == STOPPED);
                prop_assert!(!mode.flies() || targets.iter().all(|target| *target > 0.0), "a motor stopped in flight");
                prop_assert!(rig.autopilot.goal().position().iter().all(|value| value.is_finite()));
            }
        }
    }
}

#[test]
fn streams_of_every_kind_are_followed() {
    let mut rig = Rig::in_mode(Mode::Offboard);
    for _ in 0..600 {
        rig.stream(SetPoint::Velocity(Vector3::new(0.3, 0.0, 0.1)));
        rig.tick();
    }
    let velocity = rig.plant.state().velocity;
    assert!((velocity - Vector3::new(0.3, 0.0, 0.1)).norm() < 0.05, "{velocity}");
    let tilted = Attitude::from_axis_angle(Vector3::y(), 0.1).map(|value| value as f32);
    for _ in 0..100 {
        rig.stream(SetPoint::Attitude(AttitudeSetPoint::Attitude { world_from_body: tilted, thrust: 0.45 }));
        rig.tick();
    }
    assert!(rig.plant.state().velocity.x > 0.6, "{}", rig.plant.state().velocity);
    rig.fly(10.0);
    assert_eq!(rig.autopilot.mode(), Mode::Holding);
    assert!(rig.plant.state().velocity.norm() < 0.05, "the policy has caught it");
}

#[test]
fn the_cascade_turns_the_nose_where_it_is_told() {
    let mut rig = Rig::flown(Mode::Holding, Controller::Cascade);
    let nose = |rig: &Rig| yaw(&rig.plant.state().world_from_body);
    assert!(nose(&rig).abs() < 0.05, "it keeps the heading of its start");
    rig.autopilot.face(Facing::Toward(1.2)).unwrap();
    rig.fly(5.0);
    assert!((nose(&rig) - 1.2).abs() < 0.05, "{}", nose(&rig));
    rig.autopilot.face(Facing::Turning(-0.5)).unwrap();
    rig.fly(2.0);
    assert!((nose(&rig) - 0.2).abs() < 0.35, "a radian to the right, some of it still to come: {}", nose(&rig));
    for wrong in [Facing::Toward(f32::NAN), Facing::Turning(f32::INFINITY), Facing::Turning(9.0)] {
        assert_eq!(rig.autopilot.face(wrong), Err(Refusal::Speed));
    }
}

#[test]
fn the_offboard_mode_wants_a_stream_and_streams_want_the_offboard_mode() {
    let mut rig = Rig::in_mode(Mode::Holding);
    let velocity = SetPoint::Velocity(Vector3::new(0.1, 0.0, 0.0));
    assert_eq!(rig.autopilot.command(Command::Offboard), Err(Refusal::NoSetPoints));
    assert_eq!(rig.autopilot.set_point(velocity), Err(Refusal::NotOffboard));
    rig.accept(Command::Offboard);
    rig.stream(velocity);
    assert_eq!(rig.autopilot.mode(), Mode::Offboard);
}

#[test]
fn a_fence_is_not_crossed_on_command() {
    let mut rig = Rig::in_mode(Mode::Holding);
    rig.fence(0.0, 1.5, 2.0);
    rig.refuse(Command::GoTo(Vector3::new(1.4, 0.0, 1.0)), Refusal::Fence);
    rig.refuse(Command::GoTo(Vector3::new(0.0, 0.0, 1.9)), Refusal::Fence);
    rig.accept(Command::Velocity(Vector3::new(0.5, 0.0, 0.0)));
    for _ in 0..1000 {
        rig.tick();
        assert!(rig.autopilot.fence.margin_m(&rig.position()) > 0.0, "{}", rig.position());
        assert!(rig.autopilot.events().is_empty());
    }
    let mut rig = Rig::in_mode(Mode::Armed);
    rig.fence(0.0, 1.5, 2.0);
    rig.refuse(Command::TakeOff { altitude_m: 3.0 }, Refusal::Fence);
}

#[test]
fn it_has_landed_when_it_has_rested_for_half_a_second() {
    let mut rig = Rig::in_mode(Mode::Landing);
    let mut resting = 0;
    while rig.autopilot.mode() == Mode::Landing {
        rig.tick();
        resting = rig.autopilot.ticks_at_rest.max(resting);
    }
    assert_eq!(rig.autopilot.mode(), Mode::Landed);
    let secs = resting as f32 * rig.autopilot.control_secs();
    assert!((REST_SECS - 0.015..REST_SECS + 0.005).contains(&secs), "{secs} s");
}

#[test]
fn saturations_that_are_too_short_do_not_add_up() {
    let mut rig = Rig::in_mode(Mode::Holding);
    let greatest = Answer::Always([CF2X.rotor_speed_limit as f32; 4]);
    for _ in 0..4 {
        for (answer, ticks) in [(greatest, 20), (Answer::Right, 1)] {
            rig.autopilot.controllers.backend().answer = answer;
            for _ in 0..ticks {
                rig.plant
                    .put(State { position: Vector3::new(0.0, 0.0, 1.0), ..*FlatFloor::new(&CF2X, 0.01).state() });
                rig.tick();
                assert_eq!(rig.autopilot.events().as_slice(), []);
            }
        }
    }
}

#[test]
fn outside_a_zone_it_is_not_armed() {
    let mut zones = Zones::default();
    zones.add_circle([9.0, 0.0].into(), 5.0, ZoneKind::Inside { group: 0 }).unwrap();
    let mut rig = Rig::new();
    rig.autopilot.enclose(zones);
    rig.refuse(Command::Arm, Refusal::Fence);
    rig.autopilot.enclose(Zones::default());
    rig.accept(Command::Arm);
}

#[test]
fn a_fence_that_leaves_no_place_to_hold_is_landed_in() {
    let mut rig = Rig::in_mode(Mode::Holding);
    rig.fence(9.0, 1.0, 5.0);
    rig.tick();
    assert_eq!(rig.autopilot.mode(), Mode::Landing);
}

#[test]
fn it_returns_home_at_its_height() {
    let mut rig = Rig::in_mode(Mode::Holding);
    rig.accept(Command::GoTo(Vector3::new(2.0, 1.0, 0.7)));
    rig.fly(12.0);
    rig.accept(Command::Return);
    let mut highest = 0.0_f32;
    while rig.autopilot.mode() == Mode::Returning {
        highest = highest.max(rig.position().z);
        rig.tick();
    }
    assert!((highest - 1.5).abs() < 0.1, "{highest} m");
    rig.fly_until(Mode::Landed, 20.0);
    assert!(rig.position().xy().norm() < 0.1, "{}", rig.position());
}

#[test]
fn the_cascade_flies_a_whole_flight() {
    let mut rig = Rig::new();
    rig.accept(Command::SelectController(Controller::Cascade));
    rig.accept(Command::Arm);
    rig.accept(Command::TakeOff { altitude_m: 1.0 });
    rig.fly_until(Mode::Holding, 10.0);
    rig.accept(Command::GoTo(Vector3::new(1.0, 0.5, 1.2)));
    rig.fly(10.0);
    assert!((rig.position() - Vector3::new(1.0, 0.5, 1.2)).norm() < 0.05, "{}", rig.position());
    rig.accept(Command::SelectController(Controller::Policy));
    rig.fly(5.0);
    assert!((rig.position() - Vector3::new(1.0, 0.5, 1.2)).norm() < 0.05, "{}", rig.position());
    rig.accept(Command::Land);
    rig.fly_until(Mode::Disarmed, 20.0);
}

#[test]
fn a_critical_battery_is_not_armed() {
    let mut rig = Rig::new();
    rig.surroundings.battery = 0.07;
    rig.tick();
    rig.refuse(Command::Arm, Refusal::Battery);
}
