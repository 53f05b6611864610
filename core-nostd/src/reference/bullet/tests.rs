use super::*;
use crate::airframe::{CF2P, CF2X, HUMMINGBIRD, RACER, RotorOrder};
use crate::dynamics::semi_implicit_euler;
use crate::reference::euler::EulerAngles;
use crate::vehicle::{Air, Ground, Vehicle};

const STEP_SECS: f64 = 1.0 / 240.0;

const MODES: [BulletMode; 6] = [
    BulletMode::Pyb,
    BulletMode::PybGnd,
    BulletMode::PybDrag,
    BulletMode::PybDw,
    BulletMode::PybGndDragDw,
    BulletMode::Dyn,
];

/// A drone on its way, near the ground.
fn moving(rotor_speeds: [f64; 4]) -> State<f64> {
    State {
        position: Vector3::new(0.3, -0.2, 0.15),
        world_from_body: EulerAngles { roll: 0.2, pitch: -0.3, yaw: 1.1 }.attitude(),
        velocity: Vector3::new(1.0, -2.0, 0.5),
        body_rates: Vector3::new(0.4, -0.3, 0.6),
        rotor_speeds,
    }
}

/// Four speeds around hover.
fn speeds(airframe: &Airframe) -> [f64; 4] {
    [1.02, 0.97, 1.01, 0.99].map(|share| share * airframe.hover_rotor_speed())
}

#[test]
fn without_quirks_it_is_the_clean_physics() {
    for airframe in [CF2X, CF2X.numbered(RotorOrder::CounterClockwise), CF2P, HUMMINGBIRD, RACER] {
        let speeds = speeds(&airframe);
        let clean = [
            (BulletMode::Pyb, Ground::Distant, 0.0),
            (BulletMode::PybGnd, Ground::Near, 0.0),
            (BulletMode::PybDrag, Ground::Distant, 1.0),
        ];
        for (mode, ground, drag) in clean {
            let bullet = Bullet::new(&airframe, mode, Quirks::none());
            let mut vehicle = Vehicle::new(&airframe);
            vehicle.planar_drag *= drag;
            vehicle.extra_axial_drag *= drag;
            let air = Air { ground, ..Air::still() };
            let expected = semi_implicit_euler(&vehicle, &moving(speeds), &speeds, &air, STEP_SECS);
            let found = bullet.step(&BulletState::placed(moving(speeds)), &speeds, &[], STEP_SECS).motion;
            assert!((found.position - expected.position).norm() < 1e-12);
            assert!((found.velocity - expected.velocity).norm() < 1e-12);
            let turning = found.body_rates - expected.body_rates;
            assert!(turning.xy().norm() < 1e-10);
            // The clean ground effect raises the reaction torques with the thrusts; the reference's does not.
            if ground == Ground::Distant {
                assert!(turning.z.abs() < 1e-10);
                assert!((found.world_from_body.matrix() - expected.world_from_body.matrix()).norm() < 1e-9);
            }
        }
    }
}

/// Two steps of a drone under another one.
fn two_steps(mode: BulletMode, quirks: Quirks) -> BulletState<f64> {
    let bullet = Bullet::new(&CF2X, mode, quirks);
    let mut start = moving([0.0; 4]);
    start.body_rates *= 10.0;
    let swarm = [start.position + Vector3::new(0.02, 0.0, 0.04)];
    let placed = BulletState::placed(start);
    (0..2).fold(placed, |drone, _| bullet.step(&drone, &speeds(&CF2X), &swarm, STEP_SECS))
}

#[test]
fn every_quirk_alone_changes_the_flight() {
    let (all, none) = (Quirks::upstream(), Quirks::none());
    let every = BulletMode::PybGndDragDw;
    let changed = [
        (every, Quirks { damping: none.damping, ..all }),
        (every, Quirks { rotor_precision: RotorPrecision::Single, ..all }),
        (every, Quirks { link_attitude: none.link_attitude, ..all }),
        (every, Quirks { ground_query: none.ground_query, ..all }),
        (every, Quirks { drag_frame: none.drag_frame, ..all }),
        (every, Quirks { drag_frame: DragFrame::TurnedTwice, ..all }),
        (every, Quirks { drag_rotors: none.drag_rotors, ..all }),
        (every, Quirks { downwash_axis: none.downwash_axis, ..all }),
        (every, Quirks { downwash_nearest: none.downwash_nearest, ..all }),
        (every, Quirks { downwash_reach: 0.01, ..all }),
        (every, Quirks { rotation_cap: 0.01, ..all }),
        (every, Quirks { velocity_cap: 0.5, ..all }),
        (every, Quirks { attitude_update: none.attitude_update, ..all }),
        (BulletMode::Dyn, Quirks { dyn_attitude: DynAttitude::EulerAngles, ..all }),
        (BulletMode::Dyn, Quirks { dyn_levers: none.dyn_levers, ..all }),
        (BulletMode::Dyn, Quirks { dyn_report: DynReport::MinusOne, ..all }),
        (BulletMode::Dyn, Quirks { dyn_report: none.dyn_report, ..all }),
    ];
    for (mode, quirks) in changed {
        assert_ne!(two_steps(mode, quirks), two_steps(mode, all), "{quirks:?}");
    }
}

#[test]
fn single_precision_stays_close_to_double() {
    for mode in MODES {
        let wide = Bullet::<f64>::new(&CF2X, mode, Quirks::upstream());
        let narrow = Bullet::<f32>::new(&CF2X, mode, Quirks::upstream());
        let wanted = speeds(&CF2X);
        let mut exact = BulletState::placed(State { body_rates: Vector3::zeros(), ..moving(wanted) });
        let mut close = BulletState::placed(State {
            position: exact.motion.position.map(|value| value as f32),
            world_from_body: Attitude {
                w: exact.motion.world_from_body.w as f32,
                x: exact.motion.world_from_body.x as f32,
                y: exact.motion.world_from_body.y as f32,
                z: exact.motion.world_from_body.z as f32,
            },
            velocity: exact.motion.velocity.map(|value| value as f32),
            body_rates: Vector3::zeros(),
            rotor_speeds: wanted.map(|speed| speed as f32),
        });
        for _ in 0..48 {
            exact = wide.step(&exact, &wanted, &[Vector3::new(0.3, -0.2, 0.9)], STEP_SECS);
            let above = [Vector3::new(0.3_f32, -0.2, 0.9)];
            close = narrow.step(&close, &wanted.map(|speed| speed as f32), &above, STEP_SECS as f32);
        }
        assert!((exact.motion.position - close.motion.position.map(f64::from)).norm() < 1e-4, "{mode:?}");
        assert!((exact.motion.body_rates - close.motion.body_rates.map(f64::from)).norm() < 1e-2, "{mode:?}");
    }
}

#[test]
fn a_state_that_is_not_a_number_stays_so() {
    for mode in MODES {
        let bullet = Bullet::new(&CF2X, mode, Quirks::upstream());
        let start = State { velocity: Vector3::new(f64::NAN, 0.0, 0.0), ..moving(speeds(&CF2X)) };
        let after = bullet.step(&BulletState::placed(start), &speeds(&CF2X), &[], STEP_SECS);
        assert!(after.motion.velocity.x.is_nan() && after.motion.position.x.is_nan());
        let start = State { body_rates: Vector3::new(f64::NAN, 0.0, 0.0), ..moving(speeds(&CF2X)) };
        let after = bullet.step(&BulletState::placed(start), &speeds(&CF2X), &[], STEP_SECS);
        assert!(after.motion.body_rates.x.is_nan() && after.motion.world_from_body.w.is_nan());
    }
}

#[test]
fn velocities_stay_within_the_cap_of_each_world_component() {
    let bullet = Bullet::new(&CF2X, BulletMode::Pyb, Quirks { damping: 0.0, ..Quirks::upstream() });
    let start = State {
        velocity: Vector3::new(120.0, -150.0, 99.0),
        body_rates: Vector3::new(0.0, 0.0, -130.0),
        world_from_body: Attitude::level(),
        ..moving([0.0; 4])
    };
    let after = bullet.step(&BulletState::placed(start), &[0.0; 4], &[], STEP_SECS);
    assert_eq!([after.motion.velocity.x, after.motion.velocity.y], [100.0, -100.0]);
    assert!((after.motion.body_rates.z + 100.0).abs() < 1e-9);
}

#[test]
fn downwash_diverges_upstream_and_has_a_floor_without_quirks() {
    let push = |quirks, above: f64| {
        let bullet = Bullet::new(&CF2X, BulletMode::PybDw, quirks);
        let start = State { velocity: Vector3::zeros(), ..moving([0.0; 4]) };
        let swarm = [start.position, start.position + Vector3::new(0.0, 0.0, above)];
        let alone = bullet.step(&BulletState::placed(start), &[0.0; 4], &[], STEP_SECS);
        let below = bullet.step(&BulletState::placed(start), &[0.0; 4], &swarm, STEP_SECS);
        CF2X.mass * (alone.motion.velocity - below.motion.velocity).norm() / STEP_SECS
    };
    // The reference's own example: 0.3034 N half a metre below.
    assert!((push(Quirks { velocity_cap: f64::INFINITY, ..Quirks::upstream() }, 0.5) - 0.3034).abs() < 1e-4);
    assert!(push(Quirks { velocity_cap: f64::INFINITY, ..Quirks::upstream() }, 1e-3) > 1e4);
    assert!((push(Quirks::none(), 1e-3) - push(Quirks::none(), 0.05)).abs() < 1e-9);
    assert_eq!(push(Quirks::upstream(), -0.5), 0.0);
}

#[test]
fn the_series_are_sine_and_cosine() {
    for hundredth in 1..157 {
        let angle = f64::from(hundredth) / 100.0;
        let (sinc, cosine) = sinc_cosine(angle * angle);
        assert!((sinc - libm::sin(angle) / angle).abs() < 3e-16 && (cosine - libm::cos(angle)).abs() < 3e-16);
    }
    assert_eq!(sinc_cosine(0.0), (1.0, 1.0));
}
