//! How an episode begins: a start state and the parameters of its drone.

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::{State, Vehicle};
use nalgebra::Vector3;

use crate::scenario::{Randomisation, Scenario, Start, StartPosition};
use crate::seed::Stream;

/// What one episode starts from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beginning {
    pub(crate) state: State<f32>,
    pub(crate) vehicle: Vehicle<f32>,
    pub(crate) wind: Vector3<f32>,
    /// Mass and thrust relative to the nominal ones, for privileged critics.
    pub(crate) factors: [f32; 2],
}

/// Draws the next episode of a stream.
pub(crate) fn begin(scenario: &Scenario, stream: &mut Stream) -> Beginning {
    let state = start_state(scenario, stream);
    let (vehicle, factors) = vehicle(&scenario.airframe, &scenario.randomisation, stream);
    let wind = stream.direction() * (scenario.randomisation.wind_speed * stream.uniform());
    Beginning { state, vehicle, wind, factors }
}

fn start_state(scenario: &Scenario, stream: &mut Stream) -> State<f32> {
    let start = &scenario.start;
    State {
        position: position(start, &scenario.aviary.goal, stream),
        world_from_body: attitude(start.tilt_limit, stream),
        velocity: stream.direction() * (start.speed_limit * stream.uniform()),
        body_rates: stream.direction() * (start.body_rates_limit * stream.uniform()),
        rotor_speeds: [scenario.airframe.hover_rotor_speed() as f32; 4],
    }
}

fn position(start: &Start, goal: &Vector3<f32>, stream: &mut Stream) -> Vector3<f32> {
    match &start.position {
        StartPosition::AroundGoal { nearest_m, farthest_m } => {
            goal + stream.direction() * stream.between(*nearest_m, *farthest_m)
        }
        StartPosition::Within(cuboid) => {
            Vector3::from_fn(|axis, _| stream.between(cuboid.low[axis], cuboid.high[axis]))
        }
    }
}

/// Any heading, then a tilt of uniform size about a uniform horizontal axis.
fn attitude(tilt_limit: f32, stream: &mut Stream) -> Attitude<f32> {
    let heading = stream.between(-core::f32::consts::PI, core::f32::consts::PI);
    let azimuth = stream.between(-core::f32::consts::PI, core::f32::consts::PI);
    let tilt = tilt_limit * stream.uniform();
    let about_z = Attitude { w: libm::cosf(0.5 * heading), x: 0.0, y: 0.0, z: libm::sinf(0.5 * heading) };
    let sine = libm::sinf(0.5 * tilt);
    let tilted = Attitude {
        w: libm::cosf(0.5 * tilt),
        x: sine * libm::cosf(azimuth),
        y: sine * libm::sinf(azimuth),
        z: 0.0,
    };
    tilted.after(&about_z)
}

/// The drone of an episode and its mass and thrust factors.
fn vehicle(airframe: &Airframe, spread: &Randomisation, stream: &mut Stream) -> (Vehicle<f32>, [f32; 2]) {
    let mut factor = |spread: f32| stream.between(1.0 - spread, 1.0 + spread);
    let (mass, thrust, lag) = (factor(spread.mass), factor(spread.thrust), factor(spread.rotor_lag));
    let inertia = [factor(spread.inertia), factor(spread.inertia), factor(spread.inertia)];
    let drawn = Airframe {
        mass: airframe.mass * f64::from(mass),
        inertia: core::array::from_fn(|axis| airframe.inertia[axis] * f64::from(inertia[axis])),
        thrust_coefficient: airframe.thrust_coefficient * f64::from(thrust),
        torque_coefficient: airframe.torque_coefficient * f64::from(thrust),
        rotor_rise_secs: airframe.rotor_rise_secs * f64::from(lag),
        rotor_fall_secs: airframe.rotor_fall_secs * f64::from(lag),
        ..*airframe
    };
    (Vehicle::new(&drawn), [mass, thrust])
}
