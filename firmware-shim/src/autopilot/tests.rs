use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;
use proptest::prelude::*;

use super::*;
use crate::plant::{FlatFloor, Plant};
use crate::testing::{dishonest_policy, hover_policy, pilot};

/// An autopilot in its plant.
struct Rig {
    autopilot: Autopilot<Pilot<'static>>,
    plant: FlatFloor,
}

impl Rig {
    fn new() -> Self {
        Self::with(hover_policy())
    }

    fn with(policy: Vec<u8>) -> Self {
        let autopilot = Autopilot::new(pilot(policy));
        let plant = FlatFloor::new(&CF2X, autopilot.control_secs());
        let mut rig = Self { autopilot, plant };
        rig.tick();
        rig
    }

    fn in_mode(mode: Mode) -> Self {
        let mut rig = Self::new();
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
        let targets = self.autopilot.tick(self.plant.state());
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

const MODES: [Mode; 7] =
    [Mode::Disarmed, Mode::Armed, Mode::TakingOff, Mode::Holding, Mode::Guided, Mode::Landing, Mode::Landed];

/// What becomes of a command in each of [`MODES`].
type Row = [Result<Mode, Refusal>; 7];

#[rustfmt::skip]
fn table() -> [(Command, Row); 8] {
    use Mode::{Armed, Disarmed, Guided, Holding, Landed, Landing, TakingOff};
    use Refusal::{InFlight, NotArmed, NotCruising, NotFlying};
    const AIR: Result<Mode, Refusal> = Err(InFlight);
    const CRUISE: Result<Mode, Refusal> = Err(NotCruising);
    let go_to = Command::GoTo(Vector3::new(0.0, 0.5, 1.0));
    let velocity = Command::Velocity(Vector3::new(0.3, 0.0, 0.0));
    let take_off = Command::TakeOff { altitude_m: 0.5 };
    [
        //                     Disarmed        Armed          TakingOff      Holding      Guided       Landing      Landed
        (Command::Arm,        [Ok(Armed),      Ok(Armed),     Ok(TakingOff), Ok(Holding), Ok(Guided),  Ok(Landing), Ok(Landed)]),
        (Command::Disarm,     [Ok(Disarmed),   Ok(Disarmed),  AIR,           AIR,         AIR,         AIR,         Ok(Disarmed)]),
        (Command::StopMotors, [Ok(Disarmed); 7]),
        (take_off,            [Err(NotArmed),  Ok(TakingOff), AIR,           AIR,         AIR,         AIR,         Ok(TakingOff)]),
        (go_to,               [CRUISE,         CRUISE,        CRUISE,        Ok(Guided),  Ok(Guided),  CRUISE,      CRUISE]),
        (velocity,            [CRUISE,         CRUISE,        CRUISE,        Ok(Guided),  Ok(Guided),  CRUISE,      CRUISE]),
        (Command::Pause,      [CRUISE,         CRUISE,        Ok(Holding),   Ok(Holding), Ok(Holding), CRUISE,      CRUISE]),
        (Command::Land,       [Err(NotFlying), Err(NotFlying), Ok(Landing),  Ok(Landing), Ok(Landing), Ok(Landing), Ok(Landed)]),
    ]
}

#[test]
fn every_mode_answers_every_command_as_drawn() {
    for (command, outcomes) in table() {
        for (mode, outcome) in MODES.into_iter().zip(outcomes) {
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
    assert!((secs - IDLE_SECS).abs() < 0.02, "{secs}");
}

#[test]
fn a_landed_drone_is_disarmed() {
    let secs = Rig::in_mode(Mode::Landed).fly_until(Mode::Disarmed, 20.0);
    assert!((secs - LANDED_SECS).abs() < 0.02, "{secs}");
}

#[test]
fn a_take_off_ends_at_its_height() {
    let mut rig = Rig::in_mode(Mode::Armed);
    rig.accept(Command::TakeOff { altitude_m: 1.5 });
    let secs = rig.fly_until(Mode::Holding, 10.0);
    assert!(secs > 1.5 / CLIMB_SPEED - 1.0, "{secs}");
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
    assert!(fastest < 2.0 * DESCENT_SPEED, "{fastest} m/s");
    assert!((rig.position() - Vector3::new(0.5, 0.0, 0.0125)).norm() < 0.1, "{}", rig.position());
    assert_eq!(rig.tick(), STOPPED);
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
fn a_velocity_is_flown_until_another_command() {
    let mut rig = Rig::in_mode(Mode::Holding);
    rig.fly(3.0);
    // So slow that the leash is long enough for the lag of this policy.
    let velocity = Vector3::new(0.12, -0.16, 0.1);
    rig.accept(Command::Velocity(velocity));
    rig.fly(5.0);
    let start = rig.position();
    rig.fly(4.0);
    assert!((rig.position() - start - velocity * 4.0).norm() < 0.05, "{}", rig.position() - start);
    rig.accept(Command::Pause);
    rig.fly(5.0);
    assert!(rig.plant.state().velocity.norm() < 0.01);
}

#[test]
fn velocities_have_a_limit() {
    let mut rig = Rig::in_mode(Mode::Guided);
    for wrong in
        [Vector3::new(0.8, 0.8, 0.0), Vector3::new(f32::NAN, 0.0, 0.0), Vector3::new(0.0, f32::INFINITY, 0.0)]
    {
        rig.refuse(Command::Velocity(wrong), Refusal::Speed);
    }
    rig.accept(Command::Velocity(Vector3::new(0.0, 0.0, SPEED_LIMIT)));
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
    let mut autopilot = Autopilot::new(pilot(hover_policy()));
    assert_eq!(autopilot.command(Command::Arm), Err(Refusal::StateUnknown));
    let rest = *FlatFloor::new(&CF2X, 0.01).state();
    let mut tilted = rest;
    tilted.world_from_body.w = 0.9;
    tilted.world_from_body.x = 0.4359;
    let falling = State { velocity: Vector3::new(0.0, 0.0, -1.0), ..rest };
    let unknown = State { position: Vector3::new(0.0, f32::NAN, 0.0), ..rest };
    let wrong = [(tilted, Refusal::NotLevel), (falling, Refusal::Moving), (unknown, Refusal::StateUnknown)];
    for (state, refusal) in wrong {
        assert_eq!(autopilot.tick(&state), STOPPED);
        assert_eq!(autopilot.command(Command::Arm), Err(refusal));
    }
}

#[test]
fn one_bad_reading_is_flown_through_and_a_lasting_one_stops_the_motors() {
    let mut rig = Rig::in_mode(Mode::Holding);
    let last = rig.tick();
    let bad = State { position: Vector3::new(f32::NAN, 0.0, 1.0), ..*rig.plant.state() };
    assert_eq!(rig.autopilot.tick(&bad), last);
    rig.fly(1.0);
    assert_eq!(rig.autopilot.mode(), Mode::Holding);
    let ticks = (BLIND_SECS / rig.autopilot.control_secs()) as u32 + 2;
    for _ in 0..ticks {
        assert!(rig.autopilot.tick(&bad).iter().all(|target| target.is_finite()));
    }
    assert_eq!(rig.autopilot.mode(), Mode::Disarmed);
    assert_eq!(rig.autopilot.tick(&bad), STOPPED);
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
        any::<[f32; 3]>().prop_map(|velocity| Command::Velocity(velocity.into())),
        [-0.5_f32..0.5, -0.5_f32..0.5, -0.5_f32..0.5].prop_map(|velocity| Command::Velocity(velocity.into())),
        Just(Command::Pause),
        Just(Command::Land),
    ]
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
        script in proptest::collection::vec((any_command(), any_reading(), 1_u32..150), 1..25)
    ) {
        let limit = CF2X.rotor_speed_limit as f32 * 1.000_001;
        let mut rig = Rig::new();
        let mut allowed = false;
        for (command, reading, ticks) in script {
            let accepted = rig.autopilot.command(command).is_ok();
            if accepted && command == Command::Arm {
                allowed = true;
            }
            for _ in 0..ticks {
                let state = read(rig.plant.state(), reading);
                let targets = rig.autopilot.tick(&state);
                rig.plant.step(&targets);
                let mode = rig.autopilot.mode();
                allowed &= mode.armed();
                prop_assert!(allowed || !mode.armed(), "armed without a command");
                prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{targets:?}");
                prop_assert!(mode.flies() || targets == STOPPED);
                prop_assert!(rig.autopilot.goal().position().iter().all(|value| value.is_finite()));
            }
        }
    }
}

/// A processor that answers so many times.
struct Tired {
    pilot: Pilot<'static>,
    answers: u32,
}

impl Processor for Tired {
    fn control_secs(&self) -> f32 {
        Processor::control_secs(&self.pilot)
    }

    fn observation(&self) -> &ObservationLayout {
        Processor::observation(&self.pilot)
    }

    fn healthy(&mut self) -> bool {
        self.answers > 0
    }

    fn reset(&mut self) {
        Processor::reset(&mut self.pilot);
    }

    fn tick(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> Option<[f32; 4]> {
        self.answers = self.answers.checked_sub(1)?;
        Processor::tick(&mut self.pilot, state, goal)
    }
}

#[test]
fn a_processor_that_falls_silent_is_waited_for_and_then_the_motors_stop() {
    let mut autopilot = Autopilot::new(Tired { pilot: pilot(hover_policy()), answers: 50 });
    let control_secs = autopilot.control_secs();
    let mut plant = FlatFloor::new(&CF2X, control_secs);
    let mut step = |autopilot: &mut Autopilot<Tired>| {
        let targets = autopilot.tick(plant.state());
        plant.step(&targets);
        targets
    };
    step(&mut autopilot);
    autopilot.command(Command::Arm).unwrap();
    autopilot.command(Command::TakeOff { altitude_m: 1.0 }).unwrap();
    let last = (0..50).map(|_| step(&mut autopilot)).last().unwrap();
    let waits = (BLIND_SECS / control_secs) as u32;
    for _ in 0..waits {
        assert_eq!(step(&mut autopilot), last);
        assert!(autopilot.mode().flies());
    }
    let targets = (0..2).map(|_| step(&mut autopilot)).last().unwrap();
    assert_eq!((targets, autopilot.mode()), (STOPPED, Mode::Disarmed));
    assert!(!autopilot.healthy());
}
