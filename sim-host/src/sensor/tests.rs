use kestrel_core::attitude::Attitude;

use super::instrument::{Bias, Noise, Sampling};
use super::signal::{Direction, Signal};
use super::*;
use crate::seed::{Purpose, Seed};

const CONTROL_SECS: f64 = 0.01;

fn stream(seed: u64) -> Stream {
    Stream::new(Seed(seed), 0, Purpose::Reset)
}

fn perfect(signal: Signal) -> Instrument {
    Instrument {
        signal,
        noise: Noise::Constant(0.0),
        bias: Bias { constant: 0.0, walk: 0.0 },
        limits: [f64::NEG_INFINITY, f64::INFINITY],
        resolution: 0.0,
        sampling: Sampling { rate_hz: 1000.0, latency_secs: 0.0, drop_out: 0.0 },
        unit: 1.0,
    }
}

fn at_height(height: f64) -> State<f64> {
    State {
        position: Vector3::new(0.0, 0.0, height),
        world_from_body: Attitude::level(),
        velocity: Vector3::zeros(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [0.0; 4],
    }
}

fn truth(state: &State<f64>) -> Truth<'_> {
    Truth { state, specific_force_in_body: Vector3::zeros(), raycast: None }
}

/// What one value of an instrument reads while the height is as `heights` say.
fn readings(instrument: Instrument, seed: u64, heights: impl Iterator<Item = f64>) -> Vec<f64> {
    let suite = SensorSuite::new(vec![instrument], CONTROL_SECS);
    let mut stream = stream(seed);
    let mut memory = suite.begin(&mut stream);
    let mut out = vec![0.0; suite.len()];
    let mut read = |height| {
        suite.read(&mut memory, &truth(&at_height(height)), &mut stream, &mut out);
        f64::from(out[0])
    };
    heights.map(&mut read).collect()
}

/// One reading of a perfect instrument.
fn read(signal: Signal, truth: &Truth<'_>) -> Vec<f32> {
    let suite = SensorSuite::new(vec![perfect(signal)], CONTROL_SECS);
    let mut stream = stream(0);
    let mut memory = suite.begin(&mut stream);
    let mut out = vec![0.0; suite.len()];
    suite.read(&mut memory, truth, &mut stream, &mut out);
    out
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64).sqrt()
}

#[test]
fn noise_is_white_and_as_strong_as_asked() {
    let instrument = Instrument { noise: Noise::Constant(0.3), ..perfect(Signal::Height) };
    let values = readings(instrument, 1, std::iter::repeat_n(2.0, 50_000));
    // Standard errors: 0.0013 of the mean, 0.001 of the deviation, 0.0045 of the correlation.
    assert!((mean(&values) - 2.0).abs() < 5e-3, "{}", mean(&values));
    assert!((deviation(&values) - 0.3).abs() < 4e-3, "{}", deviation(&values));
    let products: Vec<f64> = values.windows(2).map(|pair| (pair[0] - 2.0) * (pair[1] - 2.0) / 0.09).collect();
    assert!(mean(&products).abs() < 0.018, "{}", mean(&products));
}

#[test]
fn the_constant_bias_differs_from_episode_to_episode_and_not_within() {
    let instrument = Instrument { bias: Bias { constant: 0.5, walk: 0.0 }, ..perfect(Signal::Height) };
    let biases: Vec<f64> = (0..4000)
        .map(|seed| {
            let values = readings(instrument, seed, std::iter::repeat_n(0.0, 5));
            assert!(values.iter().all(|value| *value == values[0]));
            values[0]
        })
        .collect();
    assert!(mean(&biases).abs() < 0.03 && (deviation(&biases) - 0.5).abs() < 0.02);
}

#[test]
fn the_biass_walk_grows_with_the_square_root_of_time() {
    let instrument = Instrument { bias: Bias { constant: 0.0, walk: 0.2 }, ..perfect(Signal::Height) };
    let slow = Instrument { sampling: Sampling { rate_hz: 10.0, ..instrument.sampling }, ..instrument };
    for instrument in [instrument, slow] {
        let after = |secs: usize| -> Vec<f64> {
            let last =
                |seed| *readings(instrument, seed, std::iter::repeat_n(0.0, 100 * secs + 1)).last().unwrap();
            (0..1500).map(last).collect()
        };
        let (one, four) = (deviation(&after(1)), deviation(&after(4)));
        assert!((one - 0.2).abs() < 0.02 && (four - 0.4).abs() < 0.04, "{one} {four}");
    }
}

#[test]
fn a_step_is_seen_after_the_latency() {
    for (latency_secs, late) in [(0.0, 0), (0.004, 0), (0.0075, 1), (0.01, 1), (0.06, 6)] {
        let sampling = Sampling { rate_hz: 1000.0, latency_secs, drop_out: 0.0 };
        let step = (0..50).map(|reading| if reading < 20 { 1.0 } else { 5.0 });
        let values = readings(Instrument { sampling, ..perfect(Signal::Height) }, 0, step);
        assert_eq!(values.iter().position(|value| *value == 5.0), Some(20 + late), "{latency_secs} s");
        assert_eq!(values[0], 1.0, "the instrument was running before");
    }
}

#[test]
fn samples_come_at_their_rate_and_are_held() {
    for rate_hz in [3.0, 10.0, 40.0, 100.0] {
        let sampling = Sampling { rate_hz, latency_secs: 0.0, drop_out: 0.0 };
        let values = readings(
            Instrument { sampling, ..perfect(Signal::Height) },
            3,
            (0..=10_000).map(|reading| f64::from(reading) * 0.5),
        );
        let samples = values.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!((samples as f64 - 100.0 * rate_hz).abs() <= 1.0, "{samples} samples in 100 s at {rate_hz} Hz");
    }
}

#[test]
fn instruments_do_not_wait_for_the_episode() {
    let sampling = Sampling { rate_hz: 10.0, latency_secs: 0.0, drop_out: 0.0 };
    let instrument = Instrument { sampling, ..perfect(Signal::Height) };
    let first = |seed| {
        let values = readings(instrument, seed, (0..12).map(f64::from));
        values.iter().position(|value| *value != values[0]).unwrap() as f64
    };
    let firsts: Vec<f64> = (0..3000).map(first).collect();
    // Uniform in 1 to 10: mean 5.5, standard deviation 2.87.
    assert!((mean(&firsts) - 5.5).abs() < 0.2 && (deviation(&firsts) - 2.87).abs() < 0.15);
}

#[test]
fn lost_samples_leave_the_last_one() {
    let sampling = Sampling { rate_hz: 1000.0, latency_secs: 0.0, drop_out: 0.3 };
    let instrument = Instrument { sampling, ..perfect(Signal::Height) };
    let values = readings(instrument, 5, (0..20_000).map(f64::from));
    let held = values.windows(2).filter(|pair| pair[0] == pair[1]).count() as f64 / 20_000.0;
    assert!((held - 0.3).abs() < 0.015, "{held}");
}

#[test]
fn values_are_limited_rounded_and_scaled() {
    let instrument = Instrument { limits: [-1.0, 2.0], resolution: 0.25, unit: 4.0, ..perfect(Signal::Height) };
    let values = readings(instrument, 0, [-9.0, 0.3, 0.9, 9.0].into_iter());
    assert_eq!(values, [-0.25, 0.0625, 0.25, 0.5]);
}

#[test]
fn an_accelerometer_delivers_its_specific_force() {
    let state = at_height(1.0);
    let truth = Truth { specific_force_in_body: Vector3::new(0.0, 4.0, 9.0), ..truth(&state) };
    assert_eq!(read(Signal::SpecificForce, &truth), [0.0, 4.0, 9.0]);
}

#[test]
fn flow_is_the_firmwares_model() {
    let signal = Signal::Flow { nearest: 0.08 };
    let mut state = at_height(0.5);
    state.velocity = Vector3::new(0.8, -0.2, 0.3);
    assert_eq!(read(signal, &truth(&state)), [1.6, -0.4]);
    // Turning alone: nose down looks like flying backwards, rolling right like flying left.
    state.velocity = Vector3::zeros();
    state.body_rates = Vector3::new(0.25, 0.5, 3.0);
    assert_eq!(read(signal, &truth(&state)), [-0.5, 0.25]);
    // Tilted: (v_x in the body) R₃₃ / z.
    let tilt = 0.4_f64;
    state.world_from_body = Attitude::from_axis_angle(Vector3::y(), tilt);
    state.body_rates = Vector3::zeros();
    state.velocity = Vector3::new(1.0, 0.0, 0.0);
    let expected = tilt.cos() * tilt.cos() / 0.5;
    assert!((f64::from(read(signal, &truth(&state))[0]) - expected).abs() < 1e-6);
}

#[test]
fn ground_out_of_focus_gives_no_flow() {
    let suite = SensorSuite::new(vec![perfect(Signal::Flow { nearest: 0.08 })], CONTROL_SECS);
    let mut stream = stream(0);
    let mut memory = suite.begin(&mut stream);
    let mut out = [0.0; 2];
    for (height, expected) in [(0.02, 0.0), (1.0, 1.0), (0.05, 1.0), (0.5, 2.0)] {
        let mut state = at_height(height);
        state.velocity.x = 1.0;
        suite.read(&mut memory, &truth(&state), &mut stream, &mut out);
        assert_eq!(out, [expected, 0.0], "at {height} m");
    }
}

#[test]
fn rangers_look_where_they_point() {
    use Direction::{Back, Down, Front, Left, Right, Up};
    // A wall at x = 3 and nothing else, seen by a drone that faces +y.
    let wall = |origin: Vector3<f64>, direction: Vector3<f64>, limit: f64| {
        let distance = (3.0 - origin.x) / direction.x;
        (direction.x > 1e-9 && distance <= limit).then_some(distance)
    };
    let mut state = at_height(1.0);
    state.world_from_body = Attitude::from_axis_angle(Vector3::z(), std::f64::consts::FRAC_PI_2);
    let truth = Truth { raycast: Some(&wall), ..truth(&state) };
    for (direction, expected) in [(Front, 4.0), (Back, 4.0), (Left, 4.0), (Right, 3.0), (Up, 4.0), (Down, 4.0)] {
        let instrument = Instrument { limits: [0.0, 4.0], ..perfect(Signal::Distance { direction, limit: 4.0 }) };
        let suite = SensorSuite::new(vec![instrument], CONTROL_SECS);
        let (mut stream, mut out) = (stream(0), [0.0]);
        suite.read(&mut suite.begin(&mut stream), &truth, &mut stream, &mut out);
        assert!((out[0] - expected).abs() < 1e-6, "{direction:?}: {}", out[0]);
    }
}

#[test]
fn a_rangers_noise_grows_with_the_distance_and_nothing_is_read_as_the_limit() {
    let noise = Noise::Growing { near: 0.0025, onset: 2.5, growth: 80.0_f64.ln() / 1.5 };
    let signal = Signal::Distance { direction: Direction::Down, limit: 4.0 };
    let instrument = Instrument { noise, limits: [0.0, 4.0], ..perfect(signal) };
    for (height, expected) in [(1.0, 0.00253), (2.5, 0.005), (3.4, 0.0372)] {
        let found = deviation(&readings(instrument, 2, std::iter::repeat_n(height, 20_000)));
        assert!((found / expected - 1.0).abs() < 0.03, "{found} at {height} m");
    }
    assert!(readings(instrument, 2, std::iter::repeat_n(9.0, 100)).iter().all(|value| *value == 4.0));
}

#[test]
fn a_saved_memory_goes_on_with_the_same_bits() {
    let sampling = Sampling { rate_hz: 30.0, latency_secs: 0.04, drop_out: 0.1 };
    let bias = Bias { constant: 0.1, walk: 0.1 };
    let instrument = Instrument { noise: Noise::Constant(0.2), bias, sampling, ..perfect(Signal::BodyRates) };
    let suite = SensorSuite::new(vec![instrument, perfect(Signal::Height)], CONTROL_SECS);
    let mut stream = stream(11);
    let mut memory = suite.begin(&mut stream);
    let (mut out, mut again) = ([0.0; 4], [0.0; 4]);
    for reading in 0..200 {
        let state = at_height(f64::from(reading) * 0.01);
        let saved = serde_json::to_string(&(&memory, &stream)).unwrap();
        let (mut restored, mut restored_stream): (SensorMemory, Stream) = serde_json::from_str(&saved).unwrap();
        suite.read(&mut memory, &truth(&state), &mut stream, &mut out);
        suite.read(&mut restored, &truth(&state), &mut restored_stream, &mut again);
        assert_eq!((out, &memory, &stream), (again, &restored, &restored_stream));
    }
}
