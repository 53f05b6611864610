//! How an episode begins: a start state and the parameters of its drone.

#[cfg(test)]
mod tests;

use kestrel_core::airframe::{Airframe, DragCoefficients, FlightEffects};
use kestrel_core::attitude::Attitude;
use kestrel_core::real::Real;
use kestrel_core::reference::bullet::BulletState;
use kestrel_core::vehicle::{EffectGains, State, Vehicle};
use nalgebra::Vector3;

use crate::latency::Delays;
use crate::scenario::{FreeSpace, PathStarts, Place, Preset, Randomisation, Scenario, StartPosition};
use crate::seed::Stream;
use crate::trajectory::Trajectory;
use crate::world::Cuboid;

/// Draws of a position before the search for a free one ends: in a box that is one tenth free it fails once in 10¹¹ times.
const DRAWS: u32 = 256;

/// What one episode starts from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beginning<R> {
    pub(crate) drone: BulletState<R>,
    pub(crate) vehicle: Vehicle<R>,
    pub(crate) wind: Vector3<R>,
    /// Mass and thrust relative to the nominal ones, for privileged critics.
    pub(crate) factors: [R; 2],
    pub(crate) delays: Delays,
    /// What its goal follows, where it follows a curve.
    pub(crate) trajectory: Option<Trajectory<R>>,
}

/// Draws the next episode of an agent from its stream.
pub(crate) fn begin<R: Real>(
    scenario: &Scenario,
    (agent, room): (usize, u32),
    stream: &mut Stream,
) -> Beginning<R> {
    let trajectory = scenario.goals.trajectories().map(|trajectories| trajectories.draw::<R>(stream));
    let goal = scenario.goals.at(&scenario.aviary_of(room).goal, agent, 0.0).cast();
    let ahead = trajectory.map(|curve| curve.at(R::zero()).0.map(Real::to_f32)).unwrap_or_default();
    let mut motion = start_state(scenario, (agent, room), &(goal + ahead), stream);
    let mut nominal = scenario.airframe;
    if let Some(family) = &scenario.randomisation.airframes {
        nominal = family.draw(&nominal, stream);
        motion.rotor_speeds = [R::from_f64(nominal.hover_rotor_speed()); 4];
    }
    let (airframe, factors) = airframe(&nominal, &scenario.randomisation, stream);
    let wind = stream.direction() * (scenario.randomisation.wind_speed * stream.uniform());
    let mut vehicle = Vehicle::new(&airframe);
    if let Some(effects) = &mut vehicle.effects {
        draw_motors(effects, &scenario.randomisation, stream);
    }
    Beginning {
        drone: BulletState::placed(motion),
        vehicle,
        wind: wind.map(R::from_f32),
        factors: factors.map(R::from_f32),
        delays: scenario.latency.draw(stream),
        trajectory,
    }
}

/// Motors that differ from each other, and what the battery gives them.
fn draw_motors<R: Real>(effects: &mut EffectGains<R>, spread: &Randomisation, stream: &mut Stream) {
    effects.rotor_thrusts = core::array::from_fn(|_| R::from_f32(factor(spread.motor, stream)));
    if spread.weak_motor != [1.0; 2] {
        let weak = stream.below(4) as usize;
        effects.rotor_thrusts[weak] *= R::from_f32(share(spread.weak_motor, stream));
    }
    effects.battery = R::from_f32(share(spread.battery, stream));
}

/// Uniform within bounds; nothing is drawn where they are one number.
fn share([least, most]: [f32; 2], stream: &mut Stream) -> f32 {
    if least < most { stream.between(least, most) } else { least }
}

/// Uniform in `1 ± spread`; nothing is drawn where there is no spread.
fn factor(spread: f32, stream: &mut Stream) -> f32 {
    if spread > 0.0 { stream.between(1.0 - spread, 1.0 + spread) } else { 1.0 }
}

fn start_state<R: Real>(
    scenario: &Scenario,
    (agent, room): (usize, u32),
    goal: &Vector3<f32>,
    stream: &mut Stream,
) -> State<R> {
    let start = &scenario.start;
    let rotor_speed = match scenario.physics.preset {
        Preset::Clean { .. } => scenario.airframe.hover_rotor_speed() as f32,
        // What the reference remembers of rotors are the speeds of the step before, and at a reset there is none.
        Preset::Bullet { .. } => 0.0,
    };
    let position = position(&start.position, (goal, scenario.obstacles_of(room)), stream);
    let attitude = attitude(start.heading_limit, start.tilt_limit, stream);
    let velocity = stream.direction() * (start.speed_limit * stream.uniform());
    let body_rates = stream.direction() * (start.body_rates_limit * stream.uniform());
    let mut state = State {
        position: position.map(R::from_f32),
        world_from_body: attitude.map(R::from_f32),
        velocity: velocity.map(R::from_f32),
        body_rates: body_rates.map(R::from_f32),
        rotor_speeds: [R::from_f32(rotor_speed); 4],
    };
    if let StartPosition::Exactly(places) = &start.position {
        put(&places[agent], start.tilt_limit, stream, &mut state);
    }
    state
}

/// At the place or near it, with its heading unless starts are tilted.
fn put<R: Real>(place: &Place, tilt_limit: f32, stream: &mut Stream, state: &mut State<R>) {
    state.position = place.position.map(R::from_f64);
    if place.spread > 0.0 {
        state.position += (stream.direction() * (place.spread * stream.uniform())).map(R::from_f32);
    }
    if tilt_limit == 0.0 {
        let (sine, cosine) = libm::sincos(0.5 * place.heading);
        let zero = R::zero();
        state.world_from_body = Attitude { w: R::from_f64(cosine), x: zero, y: zero, z: R::from_f64(sine) };
    }
}

fn position(
    place: &StartPosition,
    (goal, obstacles): (&Vector3<f32>, &[Cuboid]),
    stream: &mut Stream,
) -> Vector3<f32> {
    match place {
        StartPosition::AroundGoal { nearest_m, farthest_m } => {
            goal + stream.direction() * stream.between(*nearest_m, *farthest_m)
        }
        StartPosition::Within(cuboid) => {
            Vector3::from_fn(|axis, _| stream.between(cuboid.low[axis], cuboid.high[axis]))
        }
        StartPosition::FreeWithin(space) => free_position(space, obstacles, stream),
        StartPosition::AlongWay(starts) => position_on_way(starts, stream),
        StartPosition::Exactly(_) => Vector3::zeros(),
    }
}

/// Uniform in the free part of a box; where that is very small, the place that is known to be free.
fn free_position(space: &FreeSpace, obstacles: &[Cuboid], stream: &mut Stream) -> Vector3<f32> {
    let Cuboid { low, high } = &space.region;
    let mut draws = (0..DRAWS).map(|_| Vector3::from_fn(|axis, _| stream.between(low[axis], high[axis])));
    draws.find(|point| space.holds_among(point, obstacles)).unwrap_or(space.refuge)
}

/// In the box, or around a point of a way from there.
fn position_on_way(starts: &PathStarts, stream: &mut Stream) -> Vector3<f32> {
    let Cuboid { low, high } = starts.space.region;
    let at_start = Vector3::from_fn(|axis, _| stream.between(low[axis], high[axis]));
    if stream.uniform() < starts.box_share {
        return at_start;
    }
    let (points, spread) = (starts.points(), starts.spread_m);
    let draw = |_| {
        let place = (stream.uniform() * points.len() as f32) as usize;
        points[place.min(points.len() - 1)] + Vector3::from_fn(|_, _| stream.between(-spread, spread))
    };
    (0..DRAWS).map(draw).find(|point| starts.space.holds(point)).unwrap_or(at_start)
}

/// A uniform heading, then a tilt of uniform size about a uniform horizontal axis.
fn attitude(heading_limit: f32, tilt_limit: f32, stream: &mut Stream) -> Attitude<f32> {
    let heading = stream.between(-heading_limit, heading_limit);
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
fn airframe(airframe: &Airframe, spread: &Randomisation, stream: &mut Stream) -> (Airframe, [f32; 2]) {
    // Drawn even without a spread: what follows in the stream does not depend on it.
    let [quickest, slowest] = spread.rotor_lag;
    let mut always = |spread: f32| stream.between(1.0 - spread, 1.0 + spread);
    let (mass, thrust) = (always(spread.mass), always(spread.thrust));
    let lag = stream.between(quickest, slowest);
    let mut always = |spread: f32| stream.between(1.0 - spread, 1.0 + spread);
    let inertia = [always(spread.inertia), always(spread.inertia), always(spread.inertia)];
    let torque = share(spread.torque, stream);
    let mut drawn = |value: f64| value * f64::from(factor(spread.effects, stream));
    let (effects, drag) = (&airframe.effects, &airframe.drag_coefficients);
    let drag_coefficients = DragCoefficients { planar: drawn(drag.planar), axial: drawn(drag.axial) };
    let mut effects = FlightEffects {
        flapping_moment: drawn(effects.flapping_moment),
        rate_damping: effects.rate_damping,
        rotor_inertia: drawn(effects.rotor_inertia),
        body_drag: drawn(effects.body_drag),
        battery_sag: drawn(effects.battery_sag),
    };
    let damping = f64::from(share(spread.rate_damping, stream));
    effects.rate_damping = effects.rate_damping.map(|damping_of_axis| damping_of_axis * damping);
    let drawn = Airframe {
        mass: airframe.mass * f64::from(mass),
        inertia: core::array::from_fn(|axis| airframe.inertia[axis] * f64::from(inertia[axis])),
        thrust_coefficient: airframe.thrust_coefficient * f64::from(thrust),
        torque_coefficient: airframe.torque_coefficient * f64::from(thrust * torque),
        rotor_rise_secs: airframe.rotor_rise_secs * f64::from(lag),
        rotor_fall_secs: airframe.rotor_fall_secs * f64::from(lag),
        drag_coefficients,
        effects,
        ..*airframe
    };
    (drawn, [mass, thrust])
}
