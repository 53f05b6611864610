use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;

use super::*;
use crate::plant::{FlatFloor, Plant};

const RATE_HZ: u32 = 250;

fn perfect() -> Instruments {
    Instruments::new(Home::default(), Noise::Off, RATE_HZ)
}

fn level() -> State<f32> {
    *FlatFloor::new(&CF2X, 0.004).state()
}

fn close(found: [f32; 3], expected: [f32; 3], tolerance: f32) {
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < tolerance, "{found} instead of {expected}");
    }
}

#[test]
fn a_drone_at_rest_feels_the_floor() {
    let measurement = perfect().measure(&level(), &level());
    close(measurement.specific_force_frd, [0.0, 0.0, -9.8], 1e-6);
    assert_eq!(measurement.body_rates_frd, [0.0; 3]);
}

#[test]
fn a_falling_drone_feels_nothing_and_a_thrusting_one_feels_its_thrust() {
    let mut plant = FlatFloor::new(&CF2X, 0.004);
    for _ in 0..250 {
        plant.step(&[CF2X.rotor_speed_limit as f32; 4]);
    }
    let mut instruments = perfect();
    let mut feel = |plant: &mut FlatFloor, target: f32| {
        let before = *plant.state();
        plant.step(&[target; 4]);
        instruments.measure(&before, plant.state()).specific_force_frd
    };
    let thrust = 2.25 * 9.8;
    let [_, _, down] = feel(&mut plant, CF2X.rotor_speed_limit as f32);
    // Rotor drag takes a part of it at this speed.
    assert!((-thrust..-0.8 * thrust).contains(&down), "{down}");
    let mut last = [0.0; 3];
    for _ in 0..400 {
        last = feel(&mut plant, 0.0);
    }
    assert!(last[2].abs() < 0.1, "{last:?}");
}

#[test]
fn every_way_to_turn_has_its_sign() {
    let state = State { body_rates: Vector3::new(0.1, 0.2, 0.3), ..level() };
    close(perfect().measure(&state, &state).body_rates_frd, [0.1, -0.2, -0.3], 1e-6);
}

#[test]
fn an_accelerating_drone_is_pressed_backwards() {
    let after = State { velocity: Vector3::new(0.004, 0.0, 0.0), ..level() };
    close(perfect().measure(&level(), &after).specific_force_frd, [1.0, 0.0, -9.8], 1e-4);
}

#[test]
fn a_drone_that_faces_north_sees_the_field_of_the_place() {
    let half = core::f64::consts::FRAC_PI_2;
    let north = Attitude::from_axis_angle(Vector3::z(), half).map(|value| value as f32);
    let state = State { world_from_body: north, ..level() };
    let field = perfect().measure(&state, &state).ambient.unwrap().magnetic_field_frd_gauss;
    let [x, y, z] = field;
    let strength = (x * x + y * y + z * z).sqrt();
    let declination = y.atan2(x).to_degrees();
    let inclination = z.atan2(x.hypot(y)).to_degrees();
    // The model at Zürich in the middle of 2027: 0.484 gauss, 3.7° east, 63.5° down.
    assert!((strength - 0.484).abs() < 0.002, "{strength}");
    assert!((declination - 3.7).abs() < 0.2, "{declination}");
    assert!((inclination - 63.5).abs() < 0.2, "{inclination}");
}

#[test]
fn a_drone_that_faces_east_sees_north_on_its_left() {
    let field = perfect().measure(&level(), &level()).ambient.unwrap().magnetic_field_frd_gauss;
    assert!(field[1] < -0.2 && field[2] > 0.4, "{field:?}");
}

#[test]
fn pressures_are_those_of_the_standard_atmosphere() {
    // ISO 2533, table 5: altitude [m], pressure [Pa].
    for (altitude_m, expected) in [(0.0, 101_325.0), (500.0, 95_461.0), (1000.0, 89_876.0), (5000.0, 54_048.0)] {
        assert!((pressure_pa(altitude_m) / expected - 1.0).abs() < 1e-3, "{}", pressure_pa(altitude_m));
        assert!((pressure_altitude_m(pressure_pa(altitude_m)) - altitude_m).abs() < 1e-6);
    }
}

#[test]
fn slow_instruments_deliver_at_their_rates_and_fixes_arrive_ten_milliseconds_late() {
    for rate_hz in [50, 250, 500, 1200] {
        let mut instruments = Instruments::new(Home::default(), Noise::Off, rate_hz);
        let (mut slow, mut fixes) = (0, 0);
        for _ in 0..10 * rate_hz {
            let measurement = instruments.measure(&level(), &level());
            slow += u32::from(measurement.ambient.is_some());
            fixes += u32::from(measurement.fix.is_some());
        }
        assert_eq!((slow, fixes), (500, 100), "at {rate_hz} Hz");
    }
    let mut instruments = perfect();
    let mut fixes = (0..).filter_map(|step| {
        let position = Vector3::new(0.0, 0.0, step as f32);
        Some((step, instruments.measure(&level(), &State { position, ..level() }).fix?))
    });
    for (taken, delivered) in [(0.0, 3), (25.0, 28)] {
        let (step, fix) = fixes.next().unwrap();
        assert_eq!(step, delivered, "ten milliseconds, in whole steps");
        assert!((fix.position.altitude_m - (488.0 + taken)).abs() < 1e-6, "the fix of step {taken}: {fix:?}");
    }
}

#[test]
fn noise_has_the_deviation_of_its_datasheet() {
    let mut instruments = Instruments::new(Home::default(), Noise::Seeded(3), RATE_HZ);
    let count = 20_000;
    let (mut gyroscope, mut accelerometer, mut barometer, mut slow) = (0.0, 0.0, 0.0, 0.0);
    let truth = pressure_pa(488.0125) as f32;
    for _ in 0..count {
        let measurement = instruments.measure(&level(), &level());
        let drifts = instruments.drifts;
        gyroscope += (measurement.body_rates_frd[0] - drifts.body_rates[0]).powi(2);
        accelerometer += (measurement.specific_force_frd[2] + 9.8 - drifts.specific_force[2]).powi(2);
        if let Some(ambient) = measurement.ambient {
            barometer += (ambient.pressure_pa - truth - drifts.pressure_pa[0]).powi(2);
            slow += 1.0;
        }
    }
    let deviation = |sum: f32, count: f32| (sum / count).sqrt();
    assert!((deviation(gyroscope, count as f32) / 2.73e-3 - 1.0).abs() < 0.03);
    assert!((deviation(accelerometer, count as f32) / 0.0208 - 1.0).abs() < 0.03);
    assert!((deviation(barometer, slow) - 1.0).abs() < 0.05);
}

#[test]
fn biases_stay_where_their_walk_lets_them() {
    // The stationary deviation of a Gauss-Markov process: density times the root of half the correlation time.
    let mut instruments = Instruments::new(Home::default(), Noise::Seeded(11), RATE_HZ);
    for _ in 0..100_000 {
        instruments.measure(&level(), &level());
    }
    let Drifts { specific_force, body_rates, magnetic_field_gauss, pressure_pa, position_m } = instruments.drifts;
    for (bias, walk) in [
        (specific_force, ACCELEROMETER_WALK),
        (body_rates, GYROSCOPE_WALK),
        (magnetic_field_gauss, MAGNETOMETER_WALK),
        (pressure_pa, BAROMETER_WALK),
        (position_m, FIX_WALK),
    ] {
        let deviation = walk.density * (0.5 * walk.correlation_secs).sqrt();
        assert!(bias.iter().all(|bias| *bias != 0.0 && bias.abs() < 4.0 * deviation), "{bias:?} {deviation}");
    }
}

#[test]
fn equal_seeds_measure_alike_also_after_a_restart() {
    let measure = |instruments: &mut Instruments| -> Vec<Measurement> {
        (0..100).map(|_| instruments.measure(&level(), &level())).collect()
    };
    let mut first = Instruments::new(Home::default(), Noise::Seeded(5), RATE_HZ);
    let mut second = first.clone();
    let measured = measure(&mut first);
    assert_eq!(measured, measure(&mut second));
    assert_ne!(measured, measure(&mut second), "time goes on");
    second.restart();
    assert_eq!(measured, measure(&mut second));
    let mut other = Instruments::new(Home::default(), Noise::Seeded(6), RATE_HZ);
    assert_ne!(measured, measure(&mut other));
}

#[test]
fn instruments_saturate_instead_of_overflowing() {
    let fast = State { velocity: Vector3::new(1e9, 0.0, 0.0), body_rates: Vector3::new(0.0, 1e9, 0.0), ..level() };
    let measurement = perfect().measure(&level(), &fast);
    assert_eq!(measurement.specific_force_frd[0], 24.0 * 9.81);
    assert_eq!(measurement.body_rates_frd[1], -34.906_586);
}
