//! The core's vehicle driven along a flight: rotors by the commands, and windows from measured starts.

use kestrel_core::airframe::GRAVITY;
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::{Air as Wind, State, Vehicle};
use nalgebra::Vector3;

use crate::course::{Air, Course};
use crate::drone::{Drone, Trim};

/// Least drag that tells an air speed \[1/s\]: without it the air is taken as still.
const TELLING_DRAG: f64 = 0.02;

/// Fastest air that drag may tell \[m/s\]: an accelerometer that is hit shows more.
const AIR_SPEED_LIMIT: f64 = 10.0;

/// A drone along one flight.
pub(crate) struct Driven<'a> {
    course: &'a Course<'a>,
    vehicle: Vehicle<f64>,
    trim: Trim,
    /// Squared speed of all rotors while hovering \[rad²/s²\].
    hover_squares: f64,
    /// Rotor speeds \[rad/s\] at the beginning of each step, and at the end of the last.
    rotor_speeds: Vec<[f64; 4]>,
}

/// Position and velocity, world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moved {
    pub(crate) position: Vector3<f64>,
    pub(crate) velocity: Vector3<f64>,
}

impl<'a> Driven<'a> {
    pub(crate) fn new(course: &'a Course<'a>, drone: &Drone, trim: &Trim) -> Self {
        let vehicle = Vehicle::new(&drone.airframe);
        let hover = drone.airframe.hover_rotor_speed();
        let rotor_speeds = rotor_speeds(course, &vehicle, drone, trim);
        Self { course, vehicle, trim: *trim, hover_squares: 4.0 * hover * hover, rotor_speeds }
    }

    /// Body rates \[rad/s\] after each `stride` of `rows` rows from `row` on.
    pub(crate) fn turned(&self, row: usize, rows: usize, stride: usize) -> Vec<Vector3<f64>> {
        let course = self.course;
        let (steps, secs) = (course.steps_per_row, course.step_secs);
        let mut rates = course.start_rates[row];
        let mut seen = Vec::with_capacity(rows / stride);
        for step in row * steps..(row + rows) * steps {
            let mut state = self.state(step);
            let spin_up = self.spin_up(step);
            let middle = rates + self.turning(&mut state, &spin_up, rates) * (0.5 * secs);
            rates += self.turning(&mut state, &spin_up, middle) * secs;
            if (step + 1 - row * steps).is_multiple_of(stride * steps) {
                seen.push(rates);
            }
        }
        seen
    }

    /// Motion after each `stride` of `rows` rows from `row` on, under the measured attitude.
    pub(crate) fn moved(&self, row: usize, rows: usize, stride: usize) -> Vec<Moved> {
        let (course, Some(motion)) = (self.course, &self.course.flight.motion) else { return Vec::new() };
        let (steps, secs) = (course.steps_per_row, course.step_secs);
        let mut moved = Moved { position: motion.positions[row], velocity: motion.velocities[row] };
        let mut seen = Vec::with_capacity(rows / stride);
        for step in row * steps..(row + rows) * steps {
            let mut state = self.state(step);
            let spin_up = self.spin_up(step);
            state.velocity = moved.velocity;
            state.velocity += self.vehicle.accelerations(&state, &spin_up, &Wind::still()).0 * (0.5 * secs);
            let middle = state.velocity;
            moved.velocity += self.vehicle.accelerations(&state, &spin_up, &Wind::still()).0 * secs;
            moved.position += middle * secs;
            if (step + 1 - row * steps).is_multiple_of(stride * steps) {
                seen.push(moved);
            }
        }
        seen
    }

    /// States after each of `rows` rows from `row` on, nothing of which is given but the first state and, as held from
    /// each row to the next, the measured rotor speeds; empty where these or the motion were not measured.
    pub(crate) fn flown(&self, row: usize, rows: usize) -> Vec<State<f64>> {
        let flight = self.course.flight;
        let (Some(motion), Some(speeds)) = (&flight.motion, &flight.rotor_speeds) else { return Vec::new() };
        let mut state = State {
            position: motion.positions[row],
            world_from_body: self.tilted(&motion.attitudes[row]),
            velocity: motion.velocities[row],
            body_rates: flight.body_rates[row],
            rotor_speeds: speeds[row],
        };
        let mut seen = Vec::with_capacity(rows);
        for now in row..row + rows {
            let spin_up =
                std::array::from_fn(|rotor| (speeds[now][rotor] - state.rotor_speeds[rotor]) / flight.period_secs);
            state.rotor_speeds = speeds[now];
            for _ in 0..self.course.steps_per_row {
                state = self.stepped(&state, &spin_up);
            }
            seen.push(State { world_from_body: self.untilted(&state.world_from_body), ..state });
        }
        seen
    }

    /// The state a step later, by the midpoint rule, the rotors' speeds held and their change felt.
    fn stepped(&self, state: &State<f64>, spin_up: &[f64; 4]) -> State<f64> {
        let secs = self.course.step_secs;
        let middle = self.moved_by(state, state, spin_up, 0.5 * secs);
        self.moved_by(state, &middle, spin_up, secs)
    }

    /// `state` moved for `secs` as it moves at `there`.
    fn moved_by(&self, state: &State<f64>, there: &State<f64>, spin_up: &[f64; 4], secs: f64) -> State<f64> {
        let mut there = *there;
        let linear = self.vehicle.accelerations(&there, spin_up, &Wind::still()).0;
        let rates = there.body_rates;
        let angular = self.turning(&mut there, spin_up, rates);
        let attitude = state.world_from_body;
        State {
            position: state.position + there.velocity * secs,
            world_from_body: attitude.advanced(&there.world_from_body.derivative(rates), secs).normalized(),
            velocity: state.velocity + linear * secs,
            body_rates: state.body_rates + angular * secs,
            rotor_speeds: state.rotor_speeds,
        }
    }

    /// Specific force along body z at a row \[m/s²\], of a drone whose attitude is not measured.
    pub(crate) fn lift(&self, row: usize) -> f64 {
        let step = row * self.course.steps_per_row;
        self.vehicle.accelerations(&self.state(step), &self.spin_up(step), &Wind::still()).0.z + GRAVITY
    }

    /// Angular acceleration \[rad/s²\] at the measured rates of a row.
    pub(crate) fn turning_at(&self, row: usize) -> Vector3<f64> {
        let step = row * self.course.steps_per_row;
        self.turning(&mut self.state(step), &self.spin_up(step), self.course.flight.body_rates[row])
    }

    /// Summed rotor speed \[rad/s\] and air velocity \[m/s, body\] at a row.
    pub(crate) fn air_at(&self, row: usize) -> (f64, Vector3<f64>) {
        let state = self.state(row * self.course.steps_per_row);
        (state.rotor_speeds.iter().sum(), state.world_from_body.rotate_inverse(state.velocity))
    }

    fn turning(&self, state: &mut State<f64>, spin_up: &[f64; 4], rates: Vector3<f64>) -> Vector3<f64> {
        state.body_rates = rates;
        let load: f64 = state.rotor_speeds.iter().map(|speed| speed * speed).sum();
        self.vehicle.accelerations(state, spin_up, &Wind::still()).1
            + self.trim.torque * (load / self.hover_squares)
    }

    fn spin_up(&self, step: usize) -> [f64; 4] {
        let (before, after) = (&self.rotor_speeds[step], &self.rotor_speeds[step + 1]);
        std::array::from_fn(|rotor| (after[rotor] - before[rotor]) / self.course.step_secs)
    }

    /// The state in the middle of a step as far as it is given: attitude, velocity in the air, rotors.
    fn state(&self, step: usize) -> State<f64> {
        let (before, after) = (&self.rotor_speeds[step], &self.rotor_speeds[step + 1]);
        let rotor_speeds: [f64; 4] = std::array::from_fn(|rotor| 0.5 * (before[rotor] + after[rotor]));
        let (world_from_body, velocity) = match &self.course.air {
            Air::Motion(motion) => (self.tilted(&motion[step].attitude), motion[step].velocity),
            Air::Drag(forces) => {
                (Attitude::level(), self.air_velocity(&forces[step / self.course.steps_per_row], &rotor_speeds))
            }
            Air::Unknown => (Attitude::level(), Vector3::zeros()),
        };
        let nowhere = Vector3::zeros();
        State { position: nowhere, world_from_body, velocity, body_rates: nowhere, rotor_speeds }
    }

    /// The body's attitude where the markers' is measured.
    fn tilted(&self, attitude: &Attitude<f64>) -> Attitude<f64> {
        let [x, y] = self.trim.tilt;
        attitude.advanced(&attitude.derivative(Vector3::new(x, y, 0.0)), 1.0).normalized()
    }

    /// The markers' attitude where the body's is known.
    fn untilted(&self, attitude: &Attitude<f64>) -> Attitude<f64> {
        let [x, y] = self.trim.tilt;
        attitude.advanced(&attitude.derivative(Vector3::new(-x, -y, 0.0)), 1.0).normalized()
    }

    /// The air velocity \[m/s\] whose drag the accelerometer shows.
    fn air_velocity(&self, force: &Vector3<f64>, rotor_speeds: &[f64; 4]) -> Vector3<f64> {
        let rate = self.vehicle.planar_drag * rotor_speeds.iter().sum::<f64>();
        if rate < TELLING_DRAG {
            return Vector3::zeros();
        }
        (force / -rate).cap_magnitude(AIR_SPEED_LIMIT)
    }
}

/// Rotor speeds along the whole flight. A step in which the command changes is taken in two: a rotor that was slowing
/// down and then speeds up has another time constant from that moment on.
fn rotor_speeds(course: &Course<'_>, vehicle: &Vehicle<f64>, drone: &Drone, trim: &Trim) -> Vec<[f64; 4]> {
    if let Some(measured) = &course.flight.rotor_speeds {
        return in_steps(measured, course.steps_per_row);
    }
    let asked = asked_speeds(course, drone, trim);
    let late = drone.thrust_curve.delay_secs / course.flight.period_secs;
    let steps = course.flight.rows() * course.steps_per_row;
    let mut speeds = asked[0];
    let mut seen = Vec::with_capacity(steps + 1);
    seen.push(speeds);
    for step in 0..steps {
        let begin = step as f64 / course.steps_per_row as f64 - late;
        let (row, beyond) = rows_between(begin, 1.0 / course.steps_per_row as f64);
        let at = |row: f64| &asked[(row.max(0.0) as usize).min(asked.len() - 1)];
        for (row, share) in [(row, 1.0 - beyond), (row + 1.0, beyond)] {
            if share > 0.0 {
                speeds = sped_up(vehicle, &speeds, at(row), share * course.step_secs);
            }
        }
        seen.push(speeds);
    }
    seen
}

/// Measured rotor speeds at the beginning of each step, and at the end of the last, on straight lines between the rows.
fn in_steps(measured: &[[f64; 4]], steps_per_row: usize) -> Vec<[f64; 4]> {
    let at = |step: usize| {
        let (row, share) = (step / steps_per_row, (step % steps_per_row) as f64 / steps_per_row as f64);
        let (before, after) =
            (&measured[row.min(measured.len() - 1)], &measured[(row + 1).min(measured.len() - 1)]);
        std::array::from_fn(|rotor| before[rotor] + (after[rotor] - before[rotor]) * share)
    };
    (0..=measured.len() * steps_per_row).map(at).collect()
}

/// Rotor speeds `secs` later, by the midpoint rule.
fn sped_up(vehicle: &Vehicle<f64>, speeds: &[f64; 4], targets: &[f64; 4], secs: f64) -> [f64; 4] {
    let half = vehicle.rotor_accelerations(speeds, targets);
    let middle = std::array::from_fn(|rotor| speeds[rotor] + half[rotor] * (0.5 * secs));
    let whole = vehicle.rotor_accelerations(&middle, targets);
    std::array::from_fn(|rotor| speeds[rotor] + whole[rotor] * secs)
}

/// The rotor speeds \[rad/s\] that the commands of each row ask for.
fn asked_speeds(course: &Course<'_>, drone: &Drone, trim: &Trim) -> Vec<[f64; 4]> {
    let (flight, curve, limit) = (course.flight, &drone.thrust_curve, drone.airframe.rotor_speed_limit);
    let mut spent_secs = 0.0;
    let mut asked = |row: usize| {
        let commands = flight.commands[row];
        let voltage_share = match &flight.battery_volts {
            Some(volts) => volts[row] / curve.full_volts,
            None => trim.charge.exp() - trim.discharge_per_sec * spent_secs,
        };
        spent_secs += 0.25 * commands.iter().sum::<f64>() * flight.period_secs;
        commands.map(|command| limit * curve.speed_share(command, voltage_share))
    };
    (0..flight.rows()).map(&mut asked).collect()
}

/// The row in which `length` rows (at most one) from `begin` on begin, and the share of them that lies in the next one.
fn rows_between(begin: f64, length: f64) -> (f64, f64) {
    let row = begin.floor();
    (row, ((begin + length - (row + 1.0)) / length).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_may_begin_in_one_row_and_end_in_the_next() {
        assert_eq!(rows_between(2.0, 0.5), (2.0, 0.0));
        assert_eq!(rows_between(2.75, 0.5), (2.0, 0.5));
        assert_eq!(rows_between(-0.25, 0.5), (-1.0, 0.5));
        assert_eq!(rows_between(2.5, 0.5), (2.0, 0.0));
    }
}
