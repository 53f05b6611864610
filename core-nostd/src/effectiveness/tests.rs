use super::*;
use crate::action::{ThrustBodyRates, Velocities};
use crate::airframe::{Airframe, CF2P, CF2X, RotorOrder};
use crate::attitude::Attitude;
use crate::dynamics::Integrator;
use crate::vehicle::{Air, Vehicle};
use proptest::prelude::*;

const SECS: f32 = 0.01;

fn of(airframe: &Airframe) -> RotorEffectiveness {
    let [hover, limit] = [airframe.hover_rotor_speed(), airframe.rotor_speed_limit].map(|speed| speed as f32);
    RotorEffectiveness::new(&PolicyAirframe::from(airframe), hover * hover, limit)
}

fn still(airframe: &Airframe) -> State<f32> {
    State {
        position: Vector3::zeros(),
        world_from_body: Attitude::level(),
        velocity: Vector3::zeros(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [airframe.hover_rotor_speed() as f32; 4],
    }
}

/// Holds a drone whose rotors make these shares of their thrust by a controller without an integral; how far it is from its
/// place \[m\] after so many seconds.
fn offset(
    airframe: &Airframe,
    truth: [f32; 4],
    secs: f32,
    effectiveness: &mut RotorEffectiveness,
    adapts: bool,
) -> f32 {
    let rates = ThrustBodyRates::new(airframe, 1.0, [8.0, 8.0, 3.0], [16.0, 16.0, 6.0]);
    let space = Velocities { rates, speed_limit: 2.0, velocity_gain: 3.0, attitude_gain: 5.0 };
    let vehicle = Vehicle::<f32>::new(airframe);
    let mut state = still(airframe);
    for _ in 0..(secs / SECS) as usize {
        let [x, y, z] = state.position.map(|metres| -metres).into();
        let mut targets = space.rotor_targets(&[x, y, z, 0.0], &state);
        if adapts {
            targets = effectiveness.compensated(&targets);
            effectiveness.learn(&state, &targets, SECS);
        }
        let turned = core::array::from_fn(|rotor| targets[rotor] * truth[rotor].sqrt());
        for _ in 0..4 {
            state = Integrator::SemiImplicitEuler.advance(&vehicle, &state, &turned, &Air::still(), SECS / 4.0);
        }
    }
    state.position.norm()
}

#[test]
fn a_worn_motor_is_found_on_every_layout_and_made_up_for() {
    for airframe in [CF2X, CF2P, CF2X.numbered(RotorOrder::CounterClockwise)] {
        for worn in 0..4 {
            let truth = core::array::from_fn(|rotor| if rotor == worn { 0.93 } else { 1.0 });
            let mut effectiveness = of(&airframe);
            let without = offset(&airframe, truth, 20.0, &mut effectiveness.clone(), false);
            let with = offset(&airframe, truth, 20.0, &mut effectiveness, true);
            assert!(without > 0.05 && with < 0.01, "{without} {with}");
            for (found, truth) in effectiveness.shares().iter().zip(truth) {
                assert!((found - truth).abs() < 0.01, "{:?}", effectiveness.shares());
            }
        }
    }
}

#[test]
fn a_load_is_found_as_thrust_that_all_rotors_lack() {
    let mut effectiveness = of(&CF2X);
    let heavy = Airframe { mass: CF2X.mass + 0.005, ..CF2X };
    // Its controller knows nothing of the load either.
    let truth = [(CF2X.mass / heavy.mass) as f32; 4];
    assert!(offset(&CF2X, truth, 20.0, &mut effectiveness, true) < 0.01);
    for share in effectiveness.shares() {
        assert!((share - truth[0]).abs() < 0.01, "{share}");
    }
}

#[test]
fn the_drone_that_should_be_is_left_as_it_is() {
    let mut effectiveness = of(&CF2X);
    offset(&CF2X, [1.0; 4], 20.0, &mut effectiveness, true);
    for share in effectiveness.shares() {
        assert!((share - 1.0).abs() < 1e-3, "{share}");
    }
    let targets = [1000.0, 1500.0, 0.0, 2000.0];
    for (compensated, target) in of(&CF2X).compensated(&targets).iter().zip(targets) {
        assert!((compensated - target).abs() < 1e-3, "{compensated}");
    }
}

#[test]
fn what_a_rotor_cannot_make_is_taken_from_all() {
    let mut effectiveness = of(&CF2X);
    offset(&CF2X, [0.93, 1.0, 1.0, 1.0], 20.0, &mut effectiveness, true);
    let limit = CF2X.rotor_speed_limit as f32;
    let [worn, sound, ..] = effectiveness.compensated(&[limit; 4]);
    assert_eq!(worn, limit);
    assert!((sound * sound / (limit * limit) - 0.93).abs() < 0.02, "{sound}");
}

#[test]
fn what_it_has_learned_is_forgotten_when_it_is_told_so() {
    let mut effectiveness = of(&CF2X);
    offset(&CF2X, [0.93, 1.0, 1.0, 1.0], 5.0, &mut effectiveness, true);
    assert_ne!(effectiveness.shares(), [1.0; 4]);
    effectiveness.reset();
    assert_eq!(effectiveness, of(&CF2X));
}

/// Of what is known, of the state and of the rotor targets in a control period.
type Change<'a> = &'a dyn Fn(&mut RotorEffectiveness, &mut State<f32>, &mut [f32; 4]);

#[test]
fn nothing_is_learned_on_the_ground_in_steep_flight_and_across_a_pause() {
    let hover = [CF2X.hover_rotor_speed() as f32; 4];
    let falling = |index: usize| State { velocity: Vector3::new(0.0, 0.0, -0.002 * index as f32), ..still(&CF2X) };
    let learned = |change: Change<'_>| {
        let mut effectiveness = of(&CF2X);
        for index in 0..100 {
            let (mut state, mut targets) = (falling(index), hover);
            change(&mut effectiveness, &mut state, &mut targets);
            effectiveness.learn(&state, &targets, SECS);
        }
        effectiveness.shares() != [1.0; 4]
    };
    assert!(learned(&|_, _, _| ()));
    assert!(!learned(&|_, _, targets| *targets = targets.map(|target| 0.3 * target)));
    // About x by 0.8 rad.
    let tilted = Attitude { w: 0.921_06, x: 0.389_42, y: 0.0, z: 0.0 };
    assert!(!learned(&|_, state, _| state.world_from_body = tilted));
    assert!(!learned(&|_, state, _| state.body_rates.x = 4.0));
    assert!(!learned(&|_, state, _| state.velocity.x = f32::NAN));
    assert!(!learned(&|effectiveness, _, _| effectiveness.pause()));
}

proptest! {
    #[test]
    fn whatever_the_numbers_rotors_keep_their_limits(bits in any::<[[u32; 14]; 4]>()) {
        let mut effectiveness = of(&CF2X);
        for bits in bits {
            let [a, b, c, d, x, y, z, p, q, r, w, i, j, secs] = bits.map(f32::from_bits);
            let state = State {
                position: Vector3::zeros(),
                world_from_body: Attitude { w, x: i, y: j, z: 0.0 },
                velocity: Vector3::new(x, y, z),
                body_rates: Vector3::new(p, q, r),
                rotor_speeds: [0.0; 4],
            };
            effectiveness.learn(&state, &[a, b, c, d], secs);
            prop_assert!(effectiveness.shares().iter().all(|share| (SHARES[0]..=SHARES[1]).contains(share)));
            let limit = CF2X.rotor_speed_limit as f32;
            for target in effectiveness.compensated(&[a, b, c, d]) {
                prop_assert!((0.0..=limit).contains(&target), "{target}");
            }
        }
    }
}
