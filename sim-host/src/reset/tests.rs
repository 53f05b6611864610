use kestrel_core::airframe::{CRAZYFLIE_2_1, GRAVITY};

use super::*;
use crate::airframe_family::AirframeFamily;
use crate::seed::{Purpose, Seed};
use crate::testing::hover;

const EPISODES: u32 = 2000;

/// What so many episodes of a task begin from.
fn beginnings(scenario: &Scenario) -> Vec<Beginning<f32>> {
    let begin = |environment| begin(scenario, (0, 0), &mut Stream::new(Seed(7), environment, Purpose::Reset));
    (0..EPISODES).map(begin).collect()
}

/// Kolmogorov and Smirnov: no share of the values is further than 0.05 from that of a uniform distribution over
/// \[low, high\], which 2000 draws of one exceed in one of ten thousand tries.
fn assert_uniform(what: &str, low: f32, high: f32, values: impl Iterator<Item = f32>) {
    let mut shares: Vec<f32> = values.map(|value| (value - low) / (high - low)).collect();
    shares.sort_by(f32::total_cmp);
    let count = shares.len() as f32;
    let gap = |(index, share): (usize, &f32)| {
        (share - index as f32 / count).abs().max((share - (index + 1) as f32 / count).abs())
    };
    let distance = shares.iter().enumerate().map(gap).fold(0.0, f32::max);
    assert!(distance < 0.05, "{what}: {distance} from a uniform distribution over {low} to {high}");
}

/// A length that is uniform up to `limit`, and a direction without preference: each of its components is uniform too.
fn assert_drawn(what: &str, limit: f32, vectors: &[Vector3<f32>]) {
    assert_uniform(what, 0.0, limit, vectors.iter().map(Vector3::norm));
    for axis in 0..3 {
        assert_uniform(what, -1.0, 1.0, vectors.iter().map(|vector| vector[axis] / vector.norm()));
    }
}

#[test]
fn speeds_and_wind_are_drawn_in_every_size_and_direction() {
    let mut scenario = hover();
    scenario.start.speed_limit = 2.0;
    scenario.start.body_rates_limit = 3.0;
    scenario.randomisation.wind_speed = 0.5;
    let begun = beginnings(&scenario);
    let of = |part: fn(&Beginning<f32>) -> Vector3<f32>| begun.iter().map(part).collect::<Vec<_>>();
    assert_drawn("velocity", 2.0, &of(|begun| begun.drone.motion.velocity));
    assert_drawn("body rates", 3.0, &of(|begun| begun.drone.motion.body_rates));
    assert_drawn("wind", 0.5, &of(|begun| begun.wind));
}

#[test]
fn positions_are_drawn_at_every_distance_from_the_goal() {
    let mut scenario = hover();
    scenario.start.position = StartPosition::AroundGoal { nearest_m: 0.5, farthest_m: 1.5 };
    let goal = scenario.aviary.goal.cast::<f32>();
    let distances = beginnings(&scenario).into_iter().map(|begun| (begun.drone.motion.position - goal).norm());
    assert_uniform("distance", 0.5, 1.5, distances);
}

#[test]
fn headings_and_tilts_are_drawn_up_to_their_limits() {
    let mut scenario = hover();
    scenario.start.tilt_limit = 0.0;
    scenario.start.heading_limit = 0.6;
    let attitudes = beginnings(&scenario).into_iter().map(|begun| begun.drone.motion.world_from_body);
    assert_uniform("heading", -0.6, 0.6, attitudes.map(|attitude| 2.0 * attitude.z.atan2(attitude.w)));
    scenario.start.tilt_limit = 1.2;
    scenario.start.heading_limit = 0.0;
    let attitudes = beginnings(&scenario).into_iter().map(|begun| begun.drone.motion.world_from_body);
    assert_uniform("tilt", 0.0, 1.2, attitudes.map(|attitude| 2.0 * attitude.w.clamp(-1.0, 1.0).acos()));
}

#[test]
fn masses_and_thrusts_are_drawn_around_the_nominal_ones_and_apart() {
    let mut scenario = hover();
    scenario.randomisation.mass = 0.1;
    scenario.randomisation.thrust = 0.2;
    let factors: Vec<[f32; 2]> = beginnings(&scenario).into_iter().map(|begun| begun.factors).collect();
    assert_uniform("mass", 0.9, 1.1, factors.iter().map(|[mass, _]| *mass));
    assert_uniform("thrust", 0.8, 1.2, factors.iter().map(|[_, thrust]| *thrust));
    let product: f32 = factors.iter().map(|[mass, thrust]| (mass - 1.0) * (thrust - 1.0)).sum();
    // Their covariance, relative to the greatest that there can be.
    assert!((product / EPISODES as f32).abs() < 0.1 * (0.1 * 0.2 / 3.0), "{product}");
}

#[test]
fn every_episode_has_an_airframe_of_its_own_at_its_own_hover() {
    let mut scenario = hover();
    scenario.airframe = CRAZYFLIE_2_1;
    let airframes = AirframeFamily {
        mass: [0.02, 2.5],
        arm: [0.03, 0.4],
        thrust_to_weight: [1.5, 5.0],
        rotor_lag: [0.01, 0.15],
    };
    scenario.randomisation = Randomisation { airframes: Some(airframes), ..Randomisation::NONE };
    let begun = beginnings(&scenario);
    let limit = CRAZYFLIE_2_1.rotor_speed_limit as f32;
    let lift =
        |begun: &Beginning<f32>, speed: f32| 4.0 * begun.vehicle.thrust_gain * speed * speed / GRAVITY as f32;
    let ratios = begun.iter().map(|begun| libm::logf(lift(begun, limit)));
    assert_uniform("thrust over weight", libm::logf(1.5), libm::logf(5.0), ratios);
    let lags = begun.iter().map(|begun| libm::logf(1.0 / begun.vehicle.rotor_rise_rate));
    assert_uniform("rotor lag", libm::logf(0.01), libm::logf(0.15), lags);
    for begun in &begun {
        let hovering = begun.drone.motion.rotor_speeds.map(|speed| lift(begun, speed));
        assert!(hovering.into_iter().all(|lift| (lift - 1.0).abs() < 1e-4), "{hovering:?}");
    }
}

#[test]
fn one_motor_any_of_the_four_is_weak() {
    let mut scenario = hover();
    scenario.airframe = CRAZYFLIE_2_1;
    scenario.randomisation = Randomisation { weak_motor: [0.5, 0.9], ..Randomisation::NONE };
    let thrusts = beginnings(&scenario).into_iter().map(|begun| begun.vehicle.effects.unwrap().rotor_thrusts);
    let weak: Vec<(usize, f32)> = thrusts
        .map(|thrusts| {
            let mut weak = thrusts.into_iter().enumerate().filter(|(_, share)| *share != 1.0);
            let found = weak.next().unwrap();
            assert!(weak.next().is_none(), "{thrusts:?}");
            found
        })
        .collect();
    assert_uniform("thrust of the weak one", 0.5, 0.9, weak.iter().map(|(_, share)| *share));
    for motor in 0..4 {
        let share = weak.iter().filter(|(found, _)| *found == motor).count() as f32 / EPISODES as f32;
        assert!((share - 0.25).abs() < 0.05, "motor {motor}: {share}");
    }
}
