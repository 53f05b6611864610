//! Every rule at its limit, their order, and the clocks.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use schemars::schema_for;

use super::trial::{PITCH, RATE_HZ, ROLL, Trial, YAW, scenario};
use super::*;
use crate::seed::{Purpose, Seed, Stream};
use crate::termination::Termination;
use crate::testing::{hover, smallest};

#[test]
fn codes_are_the_endings_in_lanes() {
    assert_eq!(decode(0.0), None);
    for ending in ENDINGS {
        assert_eq!(decode(code(ending)), Some(ending));
        assert_eq!(decode(code(ending) + UNUSUAL), Some(ending));
        assert_eq!(is_failure(code(ending)), ending.is_failure());
        assert_eq!(outcome(code(ending)), ending.outcome());
        assert_ne!(outcome(code(ending) + UNUSUAL), ending.outcome());
        assert_eq!(is_time_limit(code(ending)), ending == Ending::TimeLimit);
    }
    assert!(!is_failure(0.0) && !is_time_limit(0.0) && outcome(0.0) == Outcome::Running);
}

#[test]
fn a_teammate_is_cut_off_when_the_other_was() {
    assert_eq!(outcome(code_of_teammate(code(Ending::Collision))), Outcome::Terminated);
    assert_eq!(outcome(code_of_teammate(code(Ending::OutOfBounds) + UNUSUAL)), Outcome::Truncated);
}

#[test]
fn touching_ends_outside_the_area_where_it_is_allowed() {
    let mut anywhere = Trial::of("collision");
    assert_eq!(anywhere.step(), None);
    anywhere.touches = [[0.0], [1.0]];
    assert_eq!(anywhere.step(), None);
    anywhere.touches = [[1.0], [0.0]];
    assert_eq!(anywhere.step(), Some(Ending::Collision));
    let mut outside = Trial::of("collision_outside: { allowed: { x_m: [4, 5], y_m: [-1, 1] } }");
    outside.touches = [[1.0], [0.0]];
    assert_eq!(outside.at(4.5, 0.0, 0.1), None);
    assert_eq!(outside.at(4.0, 0.0, 0.1), Some(Ending::Collision));
    assert_eq!(outside.at(0.0, 0.0, 0.1), Some(Ending::Collision));
}

#[test]
fn the_landing_zone_ends_in_success() {
    let mut landing = Trial::of("landing");
    landing.touches = [[1.0], [0.0]];
    assert_eq!(landing.step(), None);
    landing.touches = [[0.0], [1.0]];
    assert_eq!(landing.step(), Some(Ending::Success));
}

/// The reference compares with < and >: its box includes its surface, as its reward does.
#[test]
fn bounds_include_their_surface() {
    let box_ = "{ low_m: [-1, -1, 0.5], high_m: [5, 1, 1.5] }";
    for (rule, meaning) in [("out_of_bounds", Outcome::Terminated), ("cut_out_of_bounds", Outcome::Truncated)] {
        let mut bounds = Trial::of(&format!("{rule}: {box_}"));
        assert_eq!(bounds.at(5.0, 1.0, 1.5), None);
        assert_eq!(bounds.at(-1.0, -1.0, 0.5), None);
        for (x, y, z) in [(5.001, 0.0, 1.0), (0.0, -1.001, 1.0), (0.0, 0.0, 0.499), (0.0, 0.0, f64::NAN)] {
            assert_eq!(bounds.at(x, y, z), Some(Ending::OutOfBounds), "{x} {y} {z}");
            assert_eq!(outcome(bounds.code()), meaning);
        }
    }
}

#[test]
fn tilt_ends_by_the_angle_from_upright() {
    let mut tilt = Trial::of("tilt: { limit_deg: 60 }");
    let limit = core::f64::consts::FRAC_PI_3;
    assert_eq!(tilt.turned(YAW, 3.0), None);
    assert_eq!(tilt.turned(ROLL, limit - 1e-3), None);
    assert_eq!(tilt.turned([0.6, 0.8, 0.0], limit + 1e-3), Some(Ending::Tilt));
}

#[test]
fn roll_and_pitch_have_each_their_limit() {
    let rule = "roll_pitch: { limit_deg: 57.29577951308232";
    let mut angles = Trial::of(&format!("{rule} }}"));
    for axis in [ROLL, PITCH] {
        for sign in [-1.0, 1.0] {
            assert_eq!(angles.turned(axis, sign * 0.999_999), None);
            assert_eq!(angles.turned(axis, sign * 1.000_001), Some(Ending::Tilt));
        }
    }
    assert_eq!(angles.turned(YAW, 3.0), None);
    assert_eq!(angles.turned(ROLL, 3.1), Some(Ending::Tilt));
    assert_eq!(outcome(angles.code()), Outcome::Terminated);
    let mut cut = Trial::of(&format!("{rule}, truncates: true }}"));
    assert_eq!(cut.turned(PITCH, 1.1), Some(Ending::Tilt));
    assert_eq!(outcome(cut.code()), Outcome::Truncated);
}

#[test]
fn distances_end_when_too_great_or_small_enough() {
    let mut far = Trial::of("distance: { limit_m: 1.5 }");
    let mut near = Trial::of("arrival: { radius_m: 0.5 }");
    for (distance, too_far, arrived) in [(0.499, false, true), (0.5, false, false), (1.5, true, false)] {
        (far.distance, near.distance) = (distance, distance);
        assert_eq!(far.step(), too_far.then_some(Ending::Distance));
        assert_eq!(near.step(), arrived.then_some(Ending::Success));
    }
}

#[test]
fn a_field_is_covered_cell_by_cell() {
    let mut field = Trial::of("field_covered: { cells: 2 }");
    let places = [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (-1.5, 0.5), (-0.5, -0.5), (0.5, 0.5)];
    let ends = places.map(|(x, y)| field.at(x, y, 1.0));
    assert_eq!(ends[..5], [None; 5]);
    assert_eq!(ends[5], Some(Ending::Success));
    let mut published = Trial::of("field_covered: { cells: 1, as_published: true }");
    assert_eq!(published.at(-1.5, 0.0, 1.0), None);
    assert_eq!(published.at(-1.4, -1.4, 1.0), Some(Ending::Success));
}

#[test]
fn fuel_lasts_for_control_periods() {
    let lasts = |yaml: &str| {
        let mut fuel = Trial::of(yaml);
        fuel.scenario.episode_secs = 100.0;
        let mut steps = 1;
        while fuel.at(3.0, 0.0, 1.0).is_none() {
            steps += 1;
        }
        assert_eq!(fuel.step(), Some(Ending::OutOfFuel));
        steps
    };
    let rule = "fuel: { interval_secs: 4, station_m: [0, 0, 0.5]";
    assert_eq!(lasts(&format!("{rule} }}")), 192);
    assert_eq!(lasts(&format!("{rule}, as_published: true }}")), 960);
}

#[test]
fn fuel_is_refilled_at_the_station() {
    let rule = "fuel: { interval_secs: 0.0625, station_m: [0, 0, 0.5]";
    // Three control periods; as published the station is at 1.01347 m and the tank holds fifteen.
    let mut fuel = Trial::of(&format!("{rule} }}"));
    for _ in 0..5 {
        assert_eq!(fuel.at(0.0, 0.0, 0.7), None);
        assert_eq!(fuel.at(0.0, 0.0, 0.7), None);
        assert_eq!(fuel.at(0.0, 0.1, 0.56), None);
    }
    let mut published = Trial::of(&format!("{rule}, as_published: true }}"));
    let mut ends = (0..14).map(|_| published.at(0.0, 0.0, 0.5)).collect::<Vec<_>>();
    ends.push(published.at(0.0, 0.0, 1.13));
    ends.extend((0..14).map(|_| published.at(0.0, 0.0, 0.5)));
    assert_eq!(ends, [None; 29]);
    assert_eq!(published.at(0.0, 0.0, 0.5), Some(Ending::OutOfFuel));
}

#[test]
fn entering_an_area_is_success_and_the_eleventh_step_as_published() {
    let rule = "enter_area: { area: { x_m: [4, 5], y_m: [-1, 1] }";
    let mut corrected = Trial::of(&format!("{rule} }}"));
    assert_eq!(corrected.at(3.9, 0.0, 1.0), None);
    assert_eq!(corrected.at(4.1, 0.0, 1.0), Some(Ending::Success));
    let mut published = Trial::of(&format!("{rule}, as_published: true }}"));
    assert!((0..10).all(|_| published.at(4.1, 0.0, 1.0).is_none()));
    assert_eq!(published.at(0.0, 0.0, 1.0), Some(Ending::Overdue));
}

#[test]
fn the_exit_asks_for_a_level_drone_as_published() {
    let rule = "exit: { region: { low_m: [-2, 0, 0], high_m: [-1, 1, 1] }";
    let mut published = Trial::of(&format!("{rule}, as_published: true }}"));
    let mut corrected = Trial::of(&format!("{rule} }}"));
    for trial in [&mut published, &mut corrected] {
        assert_eq!(trial.at(0.0, 0.5, 0.5), None);
        assert_eq!(trial.at(-1.5, 0.5, 0.5), Some(Ending::Success));
    }
    assert_eq!(published.turned(ROLL, 0.22), None);
    assert_eq!(corrected.turned(ROLL, 0.22), Some(Ending::Success));
}

#[test]
fn resting_counts_what_is_slow_upright_and_touching_without_a_break() {
    // A fifteenth of a second is three periods of 48 Hz.
    let mut trial = Trial::of("rest: { speed_limit_m_per_s: 0.05, tilt_limit_deg: 15, rest_secs: 0.0625 }");
    let mut rest = |speed: f64, angle: f64, touching: f64| {
        (trial.touches, trial.swarm.velocity) = ([[0.0], [touching]], [[0.0], [speed], [0.0]]);
        trial.turned(PITCH, angle)
    };
    let (upright, tilted) = (0.26, 0.27);
    let broken = [(0.06, upright, 1.0), (0.0, tilted, 1.0), (0.0, upright, 0.0)];
    for (speed, angle, touching) in broken {
        assert_eq!([rest(0.04, upright, 1.0), rest(0.04, upright, 1.0)], [None, None]);
        assert_eq!(rest(speed, angle, touching), None);
    }
    assert_eq!([rest(0.0, 0.0, 1.0), rest(0.0, 0.0, 1.0)], [None, None]);
    assert_eq!(rest(0.04, upright, 1.0), Some(Ending::Success));
}

#[test]
fn holding_counts_slow_periods_near_the_goal() {
    let mut hold = Trial::of("hold: { radius_m: 0.1, speed_limit_m_per_s: 0.5, periods: 3 }");
    let mut step = |distance: f64, speed: f64| {
        (hold.distance, hold.swarm.velocity) = (distance, [[speed], [0.0], [0.0]]);
        hold.step()
    };
    let ends = [(0.05, 0.4), (0.05, 0.6), (0.15, 0.1), (0.05, 0.1)].map(|(distance, speed)| step(distance, speed));
    assert_eq!(ends, [None; 4]);
    assert_eq!(step(0.0, 0.0), Some(Ending::Success));
}

#[test]
fn failures_come_before_success_and_the_first_of_the_list_before_the_others() {
    let mut scenario = scenario("collision, distance: { limit_m: 1 }, landing");
    scenario.success = Success::Reach {
        region: Cuboid { low: Vector3::repeat(-1.0), high: Vector3::repeat(1.0) },
        speed_limit: 1.0,
    };
    let mut trial = Trial::under(scenario);
    assert_eq!(trial.step(), Some(Ending::Success));
    trial.distance = 2.0;
    assert_eq!(trial.step(), Some(Ending::Distance));
    trial.touches = [[1.0], [1.0]];
    assert_eq!(trial.step(), Some(Ending::Collision));
    trial.swarm.velocity[0] = [f64::NAN];
    assert_eq!(trial.step(), Some(Ending::OutOfBounds));
}

#[test]
fn a_flight_beyond_the_model_ends() {
    let mut trial = Trial::of("");
    trial.swarm.velocity[2] = [-199.0];
    assert_eq!(trial.step(), None);
    trial.swarm.velocity[2] = [-201.0];
    assert_eq!(trial.step(), Some(Ending::OutOfBounds));
    trial.swarm.velocity[2] = [0.0];
    trial.swarm.body_rates[0] = [301.0];
    assert_eq!(trial.step(), Some(Ending::OutOfBounds));
}

/// The last step of a drone that lands in it, by the clock.
fn last_step(clock: Clock, time_limit: TimeLimit) -> (f64, Ending, Outcome) {
    let mut scenario = scenario("landing");
    (scenario.clock, scenario.time_limit, scenario.episode_secs) = (clock, time_limit, 0.5);
    scenario.physics.control_rate_hz = RATE_HZ;
    let mut trial = Trial::under(scenario);
    while trial.step().is_none() {}
    trial.steps -= 1.0;
    let time_limit = outcome(trial.code());
    trial.touches = [[0.0], [1.0]];
    trial.steps -= 1.0;
    (trial.steps + 1.0, trial.step().unwrap(), time_limit)
}

#[test]
fn the_published_clock_is_two_periods_late_and_looks_at_nothing_else() {
    assert_eq!(last_step(Clock::Elapsed, TimeLimit::Truncates), (24.0, Ending::Success, Outcome::Truncated));
    assert_eq!(last_step(Clock::Elapsed, TimeLimit::Terminates), (24.0, Ending::Success, Outcome::Terminated));
    assert_eq!(last_step(Clock::Reference, TimeLimit::Truncates), (26.0, Ending::TimeLimit, Outcome::Truncated));
    assert_eq!(last_step(Clock::Reference, TimeLimit::Terminates), (26.0, Ending::TimeLimit, Outcome::Terminated));
}

#[test]
fn episodes_have_the_reference_s_lengths() {
    let mut scenario = hover();
    scenario.clock = Clock::Reference;
    let mut steps = |secs: f32, rate: f64| {
        (scenario.episode_secs, scenario.physics.control_rate_hz) = (secs, rate);
        scenario.episode_steps()
    };
    // Section 2 of the fact sheet; upstream's eight seconds at 30 Hz.
    let lengths = [(5.0, 48.0), (10.0, 48.0), (20.0, 48.0), (30.0, 48.0), (5.0, 240.0), (8.0, 30.0)];
    assert_eq!(lengths.map(|(secs, rate)| steps(secs, rate)), [242, 482, 962, 1442, 1202, 242]);
}

/// The codes of a flight that has a little of everything, under one rule.
fn codes(rule: &str) -> Vec<f32> {
    let mut stream = Stream::new(Seed(1), 0, Purpose::Actions);
    let mut draw = |low: f32, high: f32| f64::from(stream.between(low, high));
    let mut trial = Trial::of(rule);
    trial.scenario.episode_secs = 1000.0;
    let mut step = |step: u32| {
        let rests = step >= 150;
        trial.swarm.position = [[draw(-0.5, 0.5)], [draw(-0.2, 1.2)], [draw(1.5, 2.5)]];
        trial.distance = draw(0.0, 1.0);
        trial.touches = [0.2, 0.3].map(|share| [f64::from(u8::from(draw(0.0, 1.0) < share))]);
        trial.swarm.velocity = [0; 3].map(|_| [draw(-0.6, 0.6)]);
        trial.swarm.body_rates = trial.swarm.velocity.map(|[value]| [3.0 * value]);
        let axis = Vector3::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-1.0, 1.0));
        let mut angle = draw(-0.02, 0.02);
        if rests {
            (trial.touches, trial.swarm.velocity, angle) = ([[0.0], [1.0]], [[0.0]; 3], 0.0);
        }
        let Attitude { w, x, y, z } = Attitude::from_axis_angle(axis.normalize(), angle);
        trial.swarm.attitude = [[w], [x], [y], [z]];
        trial.code()
    };
    (0..200).map(&mut step).collect()
}

#[test]
fn every_key_reaches_its_own_termination() {
    let schema = schema_for!(Termination).to_value();
    let flights: Vec<(&str, Vec<f32>)> = Termination::KEYS
        .iter()
        .map(|key| {
            let yaml = smallest(&schema, key);
            assert_eq!(scenario(&yaml).terminations[0].name(), *key);
            (*key, codes(&yaml))
        })
        .collect();
    for (index, (key, codes)) in flights.iter().enumerate() {
        assert!(codes.iter().any(|code| *code != 0.0), "`{key}` ends nothing");
        let twin = flights[..index].iter().find(|(_, others)| others == codes);
        assert!(twin.is_none(), "`{key}` ends what `{}` does", twin.map_or("", |(key, _)| key));
    }
}
