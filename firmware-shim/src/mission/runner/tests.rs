use proptest::prelude::*;

use super::*;

const HERE: MissionTarget = MissionTarget { horizontal_m: None, height_m: None };

fn proceed(step: MissionStep) -> MissionLeg {
    MissionLeg { step, heading: None, after: AfterStep::Proceed }
}

fn to(x: f32, y: f32, z: f32) -> MissionTarget {
    MissionTarget { horizontal_m: Some([x, y]), height_m: Some(z) }
}

fn go_to(x: f32, y: f32, z: f32, hold_secs: f32) -> MissionLeg {
    proceed(MissionStep::GoTo { target: to(x, y, z), hold_secs, radius_m: None })
}

fn on_ground() -> MissionInput {
    MissionInput { position: Vector3::zeros(), heading: 0.0, motion: DroneMotion::OnGround, secs: 0.0 }
}

/// A drone that does what it is told at 1 m/s, ten times a second.
struct Drone {
    runner: MissionRunner,
    legs: Vec<MissionLeg>,
    situation: MissionInput,
    reached: Vec<u16>,
    told: Vec<Directive>,
    top: f32,
}

impl Drone {
    fn new(legs: &[MissionLeg]) -> Self {
        let situation = on_ground();
        let (runner, legs) = (MissionRunner::default(), legs.to_vec());
        Self { runner, legs, situation, reached: Vec::new(), told: Vec::new(), top: 0.0 }
    }

    fn started(legs: &[MissionLeg]) -> Self {
        let mut drone = Self::new(legs);
        assert!(drone.runner.start(&drone.legs));
        drone
    }

    fn tick(&mut self) -> Directive {
        let reached = &mut self.reached;
        let directive = self.runner.advance(&self.legs, &self.situation, &mut |item| reached.push(item));
        if self.told.last() != Some(&directive) {
            self.told.push(directive);
        }
        self.handle(directive);
        self.situation.secs += 0.1;
        directive
    }

    fn handle(&mut self, directive: Directive) {
        match directive {
            Directive::TakeOff { altitude_m } => {
                self.top = altitude_m.unwrap_or(1.0);
                let [x, y] = [self.situation.position.x, self.situation.position.y];
                self.head_for(Vector3::new(x, y, self.top), 1.0);
            }
            Directive::HeadFor { point, speed, heading } => {
                self.situation.heading = heading.unwrap_or(self.situation.heading);
                self.head_for(point, speed.unwrap_or(1.0));
            }
            // Half a radian a second.
            Directive::Face { heading } => {
                self.situation.heading += (heading - self.situation.heading).clamp(-0.05, 0.05);
            }
            Directive::Wait | Directive::Done => {
                if self.situation.motion != DroneMotion::OnGround {
                    self.situation.motion = DroneMotion::Resting;
                }
            }
            Directive::Return | Directive::Land => {
                self.situation.position.z -= 0.1;
                if self.situation.position.z <= 0.0 {
                    self.situation.motion = DroneMotion::OnGround;
                }
            }
        }
    }

    fn head_for(&mut self, point: Vector3<f32>, speed: f32) {
        let way = point - self.situation.position;
        let step = way.norm().min(0.1 * speed);
        self.situation.position += way.try_normalize(1e-6).unwrap_or_default() * step;
        let rests = (point - self.situation.position).norm() < 1e-3;
        self.situation.motion = if rests { DroneMotion::Resting } else { DroneMotion::Travelling };
    }

    fn fly(&mut self, secs: f64) {
        let end = self.situation.secs + secs;
        while self.situation.secs < end {
            self.tick();
        }
    }
}

#[test]
fn a_mission_is_flown_from_take_off_to_landing() {
    let mut drone = Drone::started(&[
        proceed(MissionStep::TakeOff(MissionTarget { horizontal_m: None, height_m: Some(2.0) })),
        go_to(3.0, 0.0, 2.0, 0.0),
        proceed(MissionStep::Skip),
        proceed(MissionStep::ChangeSpeed(MissionSpeed::Of(0.5))),
        go_to(3.0, 3.0, 2.0, 1.0),
        proceed(MissionStep::Land(HERE)),
    ]);
    drone.fly(30.0);
    assert_eq!(drone.reached, [0, 1, 2, 3, 4, 5]);
    assert_eq!(drone.runner.phase(), MissionPhase::Complete);
    assert_eq!(drone.runner.current(), 5);
    let head_for = |x, y, speed| Directive::HeadFor { point: Vector3::new(x, y, 2.0), speed, heading: None };
    let expected = [
        Directive::TakeOff { altitude_m: Some(2.0) },
        head_for(3.0, 0.0, None),
        head_for(3.0, 3.0, Some(0.5)),
        Directive::Land,
        Directive::Done,
    ];
    assert_eq!(drone.told, expected);
    assert!((drone.situation.position - Vector3::new(3.0, 3.0, 0.0)).norm() < 0.25);
}

#[test]
fn a_mission_without_a_take_off_takes_off_by_itself() {
    let mut drone = Drone::started(&[go_to(2.0, 0.0, 1.0, 0.0), proceed(MissionStep::Return)]);
    assert_eq!(drone.tick(), Directive::TakeOff { altitude_m: None });
    drone.fly(10.0);
    assert_eq!(drone.reached, [0, 1]);
    assert_eq!(drone.situation.motion, DroneMotion::OnGround);
}

#[test]
fn a_take_off_in_flight_climbs_and_never_sinks() {
    for (height, expected) in [(2.0, 2.0), (0.5, 1.0)] {
        let target = MissionTarget { horizontal_m: Some([1.0, 0.0]), height_m: Some(height) };
        let mut drone = Drone::new(&[proceed(MissionStep::TakeOff(target))]);
        drone.situation.motion = DroneMotion::Resting;
        drone.situation.position = Vector3::new(0.0, 0.0, 1.0);
        drone.runner.start(&drone.legs.clone());
        let point = Vector3::new(1.0, 0.0, expected);
        assert_eq!(drone.tick(), Directive::HeadFor { point, speed: None, heading: None });
    }
}

#[test]
fn a_take_off_elsewhere_climbs_before_it_travels() {
    let target = MissionTarget { horizontal_m: Some([2.0, 0.0]), height_m: Some(3.0) };
    let mut drone = Drone::started(&[proceed(MissionStep::TakeOff(target))]);
    drone.fly(10.0);
    let point = Vector3::new(2.0, 0.0, 3.0);
    let expected = [
        Directive::TakeOff { altitude_m: Some(3.0) },
        Directive::HeadFor { point, speed: None, heading: None },
        Directive::Done,
    ];
    assert_eq!(drone.told, expected);
}

#[test]
fn a_hold_lasts_from_the_arrival_on() {
    let mut drone = Drone::started(&[go_to(0.0, 0.0, 1.0, 5.0), proceed(MissionStep::Delay { secs: 2.0 })]);
    while drone.reached.is_empty() {
        drone.tick();
    }
    let left = drone.situation.secs;
    assert!((5.5..6.5).contains(&left), "{left}");
    while drone.reached.len() < 2 {
        let directive = drone.tick();
        assert!(matches!(directive, Directive::Wait | Directive::Done), "{directive:?}");
    }
    assert!((2.0..2.2).contains(&(drone.situation.secs - left)), "{}", drone.situation.secs - left);
}

#[test]
fn a_point_is_reached_within_the_radius_of_the_sender() {
    let leg = |radius_m| proceed(MissionStep::GoTo { target: to(10.0, 0.0, 1.0), hold_secs: 0.0, radius_m });
    for (radius_m, at) in [(Some(3.0), 3.0), (None, RADIUS_M), (Some(1e-9), LEAST_RADIUS_M)] {
        let mut drone = Drone::started(&[leg(radius_m)]);
        while drone.reached.is_empty() {
            drone.tick();
        }
        let distance = 10.0 - drone.situation.position.x;
        assert!((at - 0.11..=at + 1e-4).contains(&distance), "{distance} instead of {at}");
    }
}

#[test]
fn loitering_ends_when_it_is_told() {
    let time = LoiterTime::UntilContinued;
    let mut drone =
        Drone::started(&[proceed(MissionStep::Loiter { target: HERE, time }), proceed(MissionStep::Land(HERE))]);
    drone.fly(100.0);
    assert!(drone.reached.is_empty());
    drone.runner.resume();
    drone.fly(5.0);
    assert_eq!(drone.reached, [0, 1]);
}

#[test]
fn what_is_told_in_the_middle_of_a_hold_cuts_nothing_short() {
    let mut drone = Drone::started(&[go_to(0.0, 0.0, 1.0, 5.0)]);
    drone.fly(3.0);
    drone.runner.resume();
    drone.fly(1.0);
    assert!(drone.reached.is_empty());
}

#[test]
fn a_pause_waits_and_goes_on_with_the_same_item() {
    let mut drone = Drone::started(&[go_to(5.0, 0.0, 1.0, 0.0), proceed(MissionStep::Land(HERE))]);
    drone.fly(3.0);
    drone.runner.pause();
    assert_eq!((drone.tick(), drone.runner.phase()), (Directive::Wait, MissionPhase::Paused));
    drone.fly(10.0);
    assert!(drone.reached.is_empty());
    drone.runner.resume();
    assert_eq!(
        drone.tick(),
        Directive::HeadFor { point: Vector3::new(5.0, 0.0, 1.0), speed: None, heading: None }
    );
    drone.fly(10.0);
    assert_eq!(drone.reached, [0, 1]);
}

#[test]
fn an_item_that_does_not_continue_pauses_after_it() {
    let first = MissionLeg { after: AfterStep::Pause, ..go_to(1.0, 0.0, 1.0, 0.0) };
    let mut drone = Drone::started(&[first, go_to(2.0, 0.0, 1.0, 0.0)]);
    drone.fly(10.0);
    assert_eq!((drone.runner.phase(), drone.runner.current()), (MissionPhase::Paused, 1));
    assert_eq!(drone.reached, [0]);
    drone.runner.resume();
    drone.fly(10.0);
    assert_eq!(drone.reached, [0, 1]);
}

#[test]
fn a_jump_goes_on_from_there() {
    let legs = [go_to(50.0, 0.0, 1.0, 0.0), go_to(1.0, 0.0, 1.0, 0.0), go_to(2.0, 0.0, 1.0, 0.0)];
    let mut drone = Drone::started(&legs);
    drone.fly(3.0);
    assert!(!drone.runner.jump(3, &legs), "there is no such item");
    assert_eq!(drone.runner.current(), 0);
    assert!(drone.runner.jump(2, &legs));
    drone.fly(10.0);
    assert_eq!(drone.reached, [2]);
    assert!(drone.runner.jump(1, &legs));
    assert_eq!(drone.runner.phase(), MissionPhase::NotStarted, "a jump starts nothing");
    assert_eq!(drone.tick(), Directive::Wait);
    assert!(drone.runner.start(&legs));
    drone.fly(10.0);
    assert_eq!(drone.reached, [2, 1, 2]);
}

#[test]
fn a_mission_that_is_over_starts_anew() {
    let mut drone =
        Drone::started(&[proceed(MissionStep::ChangeSpeed(MissionSpeed::Of(0.5))), go_to(1.0, 0.0, 1.0, 0.0)]);
    drone.fly(10.0);
    assert_eq!(drone.runner.phase(), MissionPhase::Complete);
    assert!(drone.runner.start(&drone.legs.clone()));
    assert_eq!(drone.runner.current(), 0);
    drone.fly(10.0);
    assert_eq!(drone.reached, [0, 1, 0, 1]);
}

#[test]
fn a_jump_leads_back_as_often_as_it_says_and_again_when_it_is_come_to_anew() {
    let jump = |to, times| proceed(MissionStep::Jump { to, times: Some(times) });
    let [first, second] = [go_to(1.0, 0.0, 1.0, 0.0), go_to(2.0, 0.0, 1.0, 0.0)];
    let mut drone = Drone::started(&[first, second, jump(1, 2), jump(0, 1), proceed(MissionStep::Land(HERE))]);
    drone.fly(60.0);
    assert_eq!(drone.reached, [0, 1, 1, 1, 2, 0, 1, 1, 1, 2, 3, 4]);
    assert_eq!(drone.runner.phase(), MissionPhase::Complete);
}

#[test]
fn jumps_that_lead_round_and_round_without_a_way_end_no_tick() {
    let for_ever = proceed(MissionStep::Jump { to: 0, times: None });
    let mut drone = Drone::started(&[proceed(MissionStep::Skip), for_ever]);
    assert_eq!(drone.tick(), Directive::Wait);
    assert_eq!(drone.runner.phase(), MissionPhase::Active);
    drone.runner.pause();
    assert_eq!(drone.runner.phase(), MissionPhase::Paused);
}

#[test]
fn a_nose_turns_where_it_should_and_nobody_waits_for_one_that_does_not() {
    let turn = |turn| proceed(MissionStep::Turn(turn));
    let faces = MissionLeg { heading: Some(-1.0), ..go_to(1.0, 0.0, 1.0, 0.0) };
    let mut drone = Drone::started(&[faces, turn(MissionTurn::By(0.5)), turn(MissionTurn::To(2.0))]);
    drone.fly(15.0);
    assert!(drone.told.contains(&Directive::Face { heading: -0.5 }), "{:?}", drone.told);
    assert!((drone.situation.heading - 2.0).abs() <= TURNED_RAD, "{}", drone.situation.heading);
    assert_eq!(drone.reached, [0, 1, 2]);
    let mut blind = MissionRunner::default();
    let legs = [turn(MissionTurn::To(2.0))];
    assert!(blind.start(&legs));
    let resting = MissionInput { motion: DroneMotion::Resting, ..on_ground() };
    assert_eq!(blind.advance(&legs, &resting, &mut |_| panic!()), Directive::Face { heading: 2.0 });
    let later = MissionInput { secs: TURN_SECS, ..resting };
    assert_eq!(blind.advance(&legs, &later, &mut |_| {}), Directive::Done);
    assert!(blind.start(&legs));
    assert_eq!(blind.advance(&legs, &on_ground(), &mut |_| {}), Directive::Done, "on the ground nothing turns");
}

#[test]
fn no_mission_starts_nothing_and_one_that_vanished_is_over() {
    let mut runner = MissionRunner::default();
    assert!(!runner.start(&[]));
    assert!(runner.start(&[proceed(MissionStep::Skip)]));
    let situation = on_ground();
    assert_eq!(runner.advance(&[], &situation, &mut |_| panic!()), Directive::Done);
}

#[test]
fn a_drone_that_does_not_know_where_it_is_waits() {
    let mut drone = Drone::started(&[go_to(1.0, 0.0, 1.0, 0.0)]);
    drone.situation.motion = DroneMotion::Resting;
    drone.situation.position.x = f32::NAN;
    assert_eq!(drone.tick(), Directive::Wait);
    drone.situation.position.x = 0.0;
    assert_eq!(
        drone.tick(),
        Directive::HeadFor { point: Vector3::new(1.0, 0.0, 1.0), speed: None, heading: None }
    );
}

fn any_leg() -> impl Strategy<Value = MissionLeg> {
    let target = proptest::option::of([-2.0_f32..2.0, -2.0_f32..2.0]);
    let target = (target, proptest::option::of(0.0_f32..3.0))
        .prop_map(|(horizontal_m, height_m)| MissionTarget { horizontal_m, height_m });
    let step = prop_oneof![
        target.clone().prop_map(MissionStep::TakeOff),
        (target.clone(), 0.0_f32..2.0).prop_map(|(target, hold_secs)| MissionStep::GoTo {
            target,
            hold_secs,
            radius_m: None
        }),
        target.clone().prop_map(|target| MissionStep::Loiter { target, time: LoiterTime::Secs(1.0) }),
        target.clone().prop_map(|target| MissionStep::Loiter { target, time: LoiterTime::UntilContinued }),
        target.prop_map(MissionStep::Land),
        Just(MissionStep::Return),
        (0.1_f32..2.0).prop_map(|speed| MissionStep::ChangeSpeed(MissionSpeed::Of(speed))),
        (0.0_f32..2.0).prop_map(|secs| MissionStep::Delay { secs }),
        (-3.0_f32..3.0).prop_map(|angle| MissionStep::Turn(MissionTurn::By(angle))),
        Just(MissionStep::Skip),
    ];
    (step, prop_oneof![Just(AfterStep::Proceed), Just(AfterStep::Pause)]).prop_map(|(step, after)| MissionLeg {
        step,
        heading: None,
        after,
    })
}

proptest! {
    #[test]
    fn every_mission_ends_with_every_item_reached_once(legs in proptest::collection::vec(any_leg(), 1..20)) {
        let mut drone = Drone::started(&legs);
        for _ in 0..100 {
            drone.fly(15.0);
            drone.runner.resume();
        }
        prop_assert_eq!(drone.runner.phase(), MissionPhase::Complete);
        prop_assert_eq!(drone.reached, (0..legs.len() as u16).collect::<Vec<_>>());
    }
}
