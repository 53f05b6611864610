//! One drone in an aviary, for software in the loop: it rests on the floor, takes off, flies and lands.

use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::Integrator;
use kestrel_core::vehicle::{Air, Ground, State, Vehicle};
use nalgebra::Vector3;

use crate::scenario::{Preset, Scenario};
use crate::world::Cuboid;

/// Friction of the drone on what it stands on (pybullet's default, the reference system's).
const FRICTION: f32 = 0.5;

/// A single nominal drone, advanced one control period at a time.
///
/// Free flight is the core's integrator. What the drone stands on (the floor at z = 0 or the top of a solid) is a
/// level, inelastic support with friction: the drone levels out on it and cannot sink; walls are not felt.
#[derive(Clone, Debug)]
pub struct Flight {
    scenario: Scenario,
    vehicle: Vehicle<f32>,
    state: State<f32>,
    resting: bool,
    periods: u64,
}

impl Flight {
    /// A drone at `position` \[m, world\], level, still, rotors stopped.
    pub fn new(scenario: &Scenario, position: Vector3<f32>) -> Self {
        let nothing = Vector3::zeros();
        let mut flight = Self {
            scenario: scenario.clone(),
            vehicle: Vehicle::new(&scenario.airframe),
            state: State {
                position,
                world_from_body: Attitude::level(),
                velocity: nothing,
                body_rates: nothing,
                rotor_speeds: [0.0; 4],
            },
            resting: false,
            periods: 0,
        };
        flight.land(0.0);
        flight
    }

    /// The true state.
    pub fn state(&self) -> &State<f32> {
        &self.state
    }

    /// The scenario it flies in.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Whether the drone stands on something.
    pub fn resting(&self) -> bool {
        self.resting
    }

    /// Simulated time since the beginning \[s\].
    pub fn elapsed_secs(&self) -> f64 {
        self.periods as f64 / self.scenario.physics.control_rate_hz
    }

    /// Advances one control period with rotor targets \[rad/s\] held.
    pub fn step(&mut self, rotor_targets: &[f32; 4]) {
        let physics = self.scenario.physics;
        let still = Vector3::zeros();
        let (integrator, ground) = match physics.preset {
            Preset::Clean { integrator, ground, .. } => (integrator, ground),
            // Those who fly behind an autopilot want a drone, not the reference's quirks.
            Preset::Bullet { .. } => (Integrator::SemiImplicitEuler, Ground::Distant),
        };
        let air = Air { wind: still, force: still, ground };
        let secs = physics.substep_secs() as f32;
        for _ in 0..physics.substeps {
            let next = integrator.advance(&self.vehicle, &self.state, rotor_targets, &air, secs);
            self.state = next.tumbling_within_limit();
            self.land(secs);
        }
        self.periods += 1;
    }

    /// Holds the drone up where it has sunk onto its support.
    fn land(&mut self, secs: f32) {
        let least_height = self.support() + 0.5 * self.scenario.airframe.collision_height as f32;
        let state = &mut self.state;
        self.resting = state.position.z <= least_height && state.velocity.z <= 0.0;
        if !self.resting {
            return;
        }
        state.position.z = least_height;
        let sliding = Vector3::new(state.velocity.x, state.velocity.y, 0.0);
        let kept = 1.0 - FRICTION * kestrel_core::airframe::GRAVITY as f32 * secs / sliding.norm().max(1e-6);
        state.velocity = sliding * kept.max(0.0);
        state.body_rates = Vector3::zeros();
        state.world_from_body = levelled(&state.world_from_body);
    }

    /// Height of what is below the drone \[m\].
    fn support(&self) -> f32 {
        let position = &self.state.position;
        let below = |solid: &&Cuboid| {
            (solid.low.x..=solid.high.x).contains(&position.x)
                && (solid.low.y..=solid.high.y).contains(&position.y)
                && solid.high.z <= position.z + self.scenario.airframe.collision_radius as f32
        };
        let solids = self.scenario.aviary.world.bounds();
        let tops = solids.iter().filter(below).map(|solid| solid.high.z);
        tops.fold(0.0, f32::max)
    }
}

/// The same heading without tilt.
fn levelled(attitude: &Attitude<f32>) -> Attitude<f32> {
    let length = (attitude.w * attitude.w + attitude.z * attitude.z).sqrt();
    if length < 1e-6 {
        return Attitude::level();
    }
    Attitude { w: attitude.w / length, x: 0.0, y: 0.0, z: attitude.z / length }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::hover;
    use crate::world::Solid;

    #[test]
    fn a_drone_without_thrust_falls_and_rests_on_the_floor() {
        let scenario = hover();
        let mut flight = Flight::new(&scenario, Vector3::new(0.2, 0.1, 0.5));
        assert!(!flight.resting());
        for _ in 0..100 {
            flight.step(&[0.0; 4]);
        }
        let state = flight.state();
        assert!(flight.resting() && (state.position.z - 0.0125).abs() < 1e-6);
        assert_eq!(state.velocity, Vector3::zeros());
    }

    #[test]
    fn a_drone_that_tumbles_for_minutes_stays_a_drone() {
        let mut flight = Flight::new(&hover(), Vector3::new(0.0, 0.0, 5_000.0));
        let limit = flight.scenario.airframe.rotor_speed_limit as f32;
        for _ in 0..3_000 {
            flight.step(&[limit, limit, 0.0, 0.0]);
            let State { position, velocity, body_rates, .. } = flight.state;
            assert!(
                position.z.is_finite() && velocity.norm() < 100.0 && body_rates.norm() < 101.0,
                "{:?}",
                flight.state
            );
        }
    }

    #[test]
    fn a_resting_drone_takes_off_when_thrust_exceeds_weight() {
        let scenario = hover();
        let hover_speed = scenario.airframe.hover_rotor_speed() as f32;
        let mut flight = Flight::new(&scenario, Vector3::zeros());
        for _ in 0..100 {
            flight.step(&[0.9 * hover_speed; 4]);
        }
        assert!(flight.resting());
        for _ in 0..100 {
            flight.step(&[1.1 * hover_speed; 4]);
        }
        assert!(!flight.resting() && flight.state().position.z > 0.05);
        assert!((flight.elapsed_secs() - 2.0).abs() < 1e-6);
    }

    #[test]
    fn a_solid_carries_the_drone_that_stands_on_it() {
        let mut scenario = hover();
        let pad = Solid::block("pad", Vector3::new(-1.0, -1.0, 0.0), Vector3::new(1.0, 1.0, 0.1));
        scenario.aviary.world.solids.push(pad);
        let mut flight = Flight::new(&scenario, Vector3::new(0.0, 0.0, 0.3));
        for _ in 0..100 {
            flight.step(&[0.0; 4]);
        }
        assert!((flight.state().position.z - 0.1125).abs() < 1e-6);
    }
}
