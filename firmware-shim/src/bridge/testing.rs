//! A pilot for scripted peers: takes off, goes to a point and lands, all in NED and FRD, with a mixer of its own that
//! shares no line with the bridge's.

use kestrel_core::airframe::{CF2X, GRAVITY};
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// Times at which the next part of the flight begins \[s\].
const TAKE_OFF_SECS: f32 = 0.5;
const TRAVEL_SECS: f32 = 5.0;
const LAND_SECS: f32 = 11.0;

/// The whole flight \[s\].
pub(super) const FLIGHT_SECS: f32 = 18.0;

/// Where it goes \[m, NED from the start\], and the same in the world: east, north, up.
const GOAL_NED: [f32; 3] = [0.8, 0.5, -1.0];
const GOAL_IN_WORLD: [f32; 3] = [0.5, 0.8, 1.0];

/// A motor as its autopilot's documentation has it: signs forward and to the right, and 1 for counter-clockwise.
pub(super) type Place = [f32; 3];

/// PX4's and ArduPilot's quad X: FR CCW, RL CCW, FL CW, RR CW.
pub(super) const QUAD_X: [Place; 4] = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]];

/// Betaflight's quad X: RR CW, FR CCW, RL CCW, FL CW.
pub(super) const BETAFLIGHT: [Place; 4] =
    [[-1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0]];

/// Bitcraze's: FR CCW, RR CW, RL CCW, FL CW.
pub(super) const CRAZYFLIE: [Place; 4] =
    [[1.0, 1.0, 1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, -1.0]];

/// What a peer knows of its drone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) position_ned: [f32; 3],
    pub(super) velocity_ned: [f32; 3],
    /// NED from FRD: w, x, y, z.
    pub(super) attitude: [f32; 4],
    pub(super) body_rates_frd: [f32; 3],
}

/// Thrust of each motor as a share of its greatest, in the order of its table.
pub(super) fn fly(seen: &Seen, secs: f32, places: &[Place; 4]) -> [f32; 4] {
    if !(TAKE_OFF_SECS..FLIGHT_SECS - 1.0).contains(&secs) {
        return [0.0; 4];
    }
    let wanted = acceleration(seen, &target(secs));
    let [w, x, y, z] = seen.attitude;
    let attitude = Attitude { w, x, y, z }.normalized();
    // Tilt so that "up" of the body points along the wanted thrust: its direction in the body is the error.
    let thrust = attitude.rotate_inverse(wanted - Vector3::z() * GRAVITY as f32);
    let collective = (-thrust.z).clamp(4.0, 18.0);
    let (tilt_roll, tilt_pitch) = (thrust.y / GRAVITY as f32, -thrust.x / GRAVITY as f32);
    let [p, q, r] = seen.body_rates_frd;
    let turning = [6.0 * (3.0 * tilt_roll - p), 6.0 * (3.0 * tilt_pitch - q), -3.0 * r];
    mix(collective, turning, places)
}

fn target(secs: f32) -> [f32; 3] {
    let [north, east, down] = GOAL_NED;
    if secs < TRAVEL_SECS {
        [0.0, 0.0, down * ((secs - TAKE_OFF_SECS) / 2.0).min(1.0)]
    } else if secs < LAND_SECS {
        let share = ((secs - TRAVEL_SECS) / 2.0).min(1.0);
        [north * share, east * share, down]
    } else {
        [north, east, down + 0.3 * (secs - LAND_SECS)]
    }
}

/// \[m/s², NED\].
fn acceleration(seen: &Seen, target: &[f32; 3]) -> Vector3<f32> {
    let axis = |axis: usize, per_metre: f32, per_speed: f32, limit: f32| {
        let missing = target[axis] - seen.position_ned[axis];
        (per_metre * missing - per_speed * seen.velocity_ned[axis]).clamp(-limit, limit)
    };
    Vector3::new(axis(0, 1.0, 1.6, 2.5), axis(1, 1.0, 1.6, 2.5), axis(2, 2.2, 3.0, 4.0))
}

/// Shares of the motors' thrust for a collective \[m/s²\] and an angular acceleration \[rad/s², FRD\].
fn mix(collective: f32, turning: [f32; 3], places: &[Place; 4]) -> [f32; 4] {
    let lever = 0.028;
    let per_thrust = (CF2X.torque_coefficient / CF2X.thrust_coefficient) as f32;
    let [jx, jy, jz] = CF2X.inertia.map(|inertia| inertia as f32);
    places.map(|[forward, right, counter_clockwise]| {
        let force = 0.25
            * (CF2X.mass as f32 * collective - right * jx * turning[0] / lever
                + forward * jy * turning[1] / lever
                + counter_clockwise * jz * turning[2] / per_thrust);
        (force / (CF2X.thrust_limit() as f32 / 4.0)).clamp(0.0, 1.0)
    })
}

/// True states of a flight, judged when it is over.
#[derive(Debug, Default)]
pub(super) struct Judge {
    moments: Vec<(f64, State<f32>)>,
}

impl Judge {
    pub(super) fn see(&mut self, secs: f64, state: &State<f32>) {
        self.moments.push((secs, *state));
    }

    fn at(&self, secs: f64) -> &State<f32> {
        let place = self.moments.partition_point(|(at, _)| *at < secs).min(self.moments.len() - 1);
        &self.moments[place].1
    }

    /// Whether the flight that began at `start_secs` was the wanted one, within `radius_m`.
    pub(super) fn judge(&self, start_secs: f64, radius_m: f32) {
        let goal = Vector3::from(GOAL_IN_WORLD);
        let before = self.at(start_secs + f64::from(TAKE_OFF_SECS) - 0.1);
        assert!(before.position.z < 0.013, "it stands until it is told to rise: {}", before.position);
        let top = self.at(start_secs + f64::from(TRAVEL_SECS) - 0.1);
        assert!((top.position - Vector3::z()).norm() < radius_m, "after the climb: {}", top.position);
        let there = self.at(start_secs + f64::from(LAND_SECS) - 0.1);
        assert!((there.position - goal).norm() < radius_m, "at the point: {}", there.position);
        assert!(there.velocity.norm() < 0.2, "at the point: {}", there.velocity);
        let end = self.moments.last().map(|(_, state)| *state).unwrap();
        assert_eq!(end.position.z, 0.0125, "landed");
        assert_eq!(end.velocity.norm(), 0.0);
        assert!((end.position.xy() - goal.xy()).norm() < radius_m + 0.1, "landed at {}", end.position);
    }
}

/// FNV-1a over the bits of states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct StateHash(u64);

impl StateHash {
    pub(super) const fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    pub(super) fn add(&mut self, state: &State<f32>) {
        let State { position, world_from_body: q, velocity, body_rates, rotor_speeds } = state;
        let vectors = [position, velocity, body_rates];
        let numbers = vectors.into_iter().flat_map(|vector| vector.iter().copied());
        for number in numbers.chain([q.w, q.x, q.y, q.z]).chain(*rotor_speeds) {
            for byte in number.to_bits().to_le_bytes() {
                self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
        }
    }
}
