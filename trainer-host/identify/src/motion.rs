//! The core's vehicle driven along a flight: rotors by the commands, and windows from measured starts.

use kestrel_core::airframe::GRAVITY;
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::{Air as Wind, Derivative, State, Vehicle};
use nalgebra::Vector3;

use crate::course::{Air, Course};
use crate::drone::{Drone, Trim};
use crate::horizon::STEP_SECS;
use crate::residual_network::{Lanes, ResidualNetwork};

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
    /// What is added to the airframe's accelerations.
    residual: ResidualNetwork,
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
        let (trim, residual) = (*trim, ResidualNetwork::default());
        Self { course, vehicle, trim, hover_squares: 4.0 * hover * hover, rotor_speeds, residual }
    }

    /// The same, with what a network adds to the airframe's accelerations: asked each hundredth of a second, and held until
    /// the next.
    pub(crate) fn with_residual(self, residual: Option<&ResidualNetwork>) -> Self {
        Self { residual: residual.cloned().unwrap_or_default(), ..self }
    }

    /// Body rates \[rad/s\] after each `stride` of `rows` rows from each of `starts` on, `[starts][rows / stride]`.
    pub(crate) fn turned(&self, starts: &[usize], rows: usize, stride: usize) -> Vec<Vec<Vector3<f64>>> {
        let mut lanes = Lanes::new(self.residual.angular.as_ref(), starts.len());
        self.turned_with(&mut lanes, starts, rows, stride)
    }

    /// The same with what the network of `lanes` adds.
    pub(crate) fn turned_with(
        &self,
        lanes: &mut Lanes<'_>,
        starts: &[usize],
        rows: usize,
        stride: usize,
    ) -> Vec<Vec<Vector3<f64>>> {
        let mut rates: Vec<Vector3<f64>> = starts.iter().map(|row| self.course.start_rates[*row]).collect();
        let mut seen = vec![Vec::with_capacity(rows / stride.max(1)); starts.len()];
        for ahead in 0..rows {
            let state = |(start, rates): (&usize, &Vector3<f64>)| State {
                body_rates: *rates,
                ..self.instant(start + ahead)
            };
            let added = lanes.held(self.asks(ahead), starts.iter().zip(&rates).map(state));
            for (lane, rates) in rates.iter_mut().enumerate() {
                *rates = self.turned_by_row(starts[lane] + ahead, *rates, &added[lane]);
                if (ahead + 1).is_multiple_of(stride) {
                    seen[lane].push(*rates);
                }
            }
        }
        seen
    }

    /// Body rates a row later, `added` to their change \[rad/s²\].
    fn turned_by_row(&self, row: usize, mut rates: Vector3<f64>, added: &Vector3<f64>) -> Vector3<f64> {
        let secs = self.course.step_secs;
        for step in self.steps(row) {
            let (mut state, spin_up) = (self.state(step), self.spin_up(step));
            let middle = rates + (self.turning(&mut state, &spin_up, rates) + added) * (0.5 * secs);
            rates += (self.turning(&mut state, &spin_up, middle) + added) * secs;
        }
        rates
    }

    /// Motion after each `stride` of `rows` rows from each of `starts` on, under the measured attitude,
    /// `[starts][rows / stride]`; nothing where it was not measured.
    pub(crate) fn moved(&self, starts: &[usize], rows: usize, stride: usize) -> Vec<Vec<Moved>> {
        let mut lanes = Lanes::new(self.residual.linear.as_ref(), starts.len());
        self.moved_with(&mut lanes, starts, rows, stride)
    }

    /// The same with what the network of `lanes` adds.
    pub(crate) fn moved_with(
        &self,
        lanes: &mut Lanes<'_>,
        starts: &[usize],
        rows: usize,
        stride: usize,
    ) -> Vec<Vec<Moved>> {
        let mut seen = vec![Vec::with_capacity(rows / stride.max(1)); starts.len()];
        let Some(motion) = &self.course.flight.motion else { return seen };
        let start = |row: &usize| Moved { position: motion.positions[*row], velocity: motion.velocities[*row] };
        let mut moved: Vec<Moved> = starts.iter().map(start).collect();
        for ahead in 0..rows {
            let state = |(start, moved): (&usize, &Moved)| State {
                velocity: moved.velocity,
                ..self.instant(start + ahead)
            };
            let added = lanes.held(self.asks(ahead), starts.iter().zip(&moved).map(state));
            for (lane, moved) in moved.iter_mut().enumerate() {
                *moved = self.moved_by_row(starts[lane] + ahead, moved, &added[lane]);
                if (ahead + 1).is_multiple_of(stride) {
                    seen[lane].push(*moved);
                }
            }
        }
        seen
    }

    /// Motion a row later, `added` to its acceleration \[m/s², body\].
    fn moved_by_row(&self, row: usize, moved: &Moved, added: &Vector3<f64>) -> Moved {
        let (mut moved, secs) = (*moved, self.course.step_secs);
        for step in self.steps(row) {
            let (mut state, spin_up) = (self.state(step), self.spin_up(step));
            let added = state.world_from_body.rotate(*added);
            state.velocity = moved.velocity;
            let linear =
                |state: &State<f64>| self.vehicle.accelerations(state, &spin_up, &Wind::still()).0 + added;
            state.velocity += linear(&state) * (0.5 * secs);
            moved.position += state.velocity * secs;
            moved.velocity += linear(&state) * secs;
        }
        moved
    }

    /// States after each of `rows` rows from each of `starts` on, `[starts][rows]`, nothing of which is given but the first
    /// state and, as held from each row to the next, the measured rotor speeds; none where these or the motion were not
    /// measured.
    pub(crate) fn flown(&self, starts: &[usize], rows: usize) -> Vec<Vec<State<f64>>> {
        let flight = self.course.flight;
        let (Some(motion), Some(speeds)) = (&flight.motion, &flight.rotor_speeds) else { return Vec::new() };
        let start = |row: &usize| State {
            position: motion.positions[*row],
            world_from_body: self.tilted(&motion.attitudes[*row]),
            velocity: motion.velocities[*row],
            body_rates: flight.body_rates[*row],
            rotor_speeds: speeds[*row],
        };
        let mut states: Vec<State<f64>> = starts.iter().map(start).collect();
        let mut seen = vec![Vec::with_capacity(rows); starts.len()];
        let [mut linear, mut angular] =
            [&self.residual.linear, &self.residual.angular].map(|half| Lanes::new(half.as_ref(), starts.len()));
        for ahead in 0..rows {
            let now = |lane: usize| speeds[starts[lane] + ahead];
            let known = |(lane, state): (usize, &State<f64>)| State { rotor_speeds: now(lane), ..*state };
            let linear = linear.held(self.asks(ahead), states.iter().enumerate().map(known));
            let angular = angular.held(self.asks(ahead), states.iter().enumerate().map(known));
            for (lane, state) in states.iter_mut().enumerate() {
                *state = self.flown_by_row(state, now(lane), &[linear[lane], angular[lane]]);
                seen[lane].push(State { world_from_body: self.untilted(&state.world_from_body), ..*state });
            }
        }
        seen
    }

    /// The state a row later, with these rotor speeds, `added` to its linear and angular acceleration, both body.
    fn flown_by_row(&self, state: &State<f64>, speeds: [f64; 4], added: &[Vector3<f64>; 2]) -> State<f64> {
        let period_secs = self.course.flight.period_secs;
        let spin_up = std::array::from_fn(|rotor| (speeds[rotor] - state.rotor_speeds[rotor]) / period_secs);
        let held = State { rotor_speeds: speeds, ..*state };
        (0..self.course.steps_per_row).fold(held, |state, _| self.stepped(&state, &spin_up, added))
    }

    /// The state at the beginning of a row as it is measured: attitude, velocity in the air, rates; rotors.
    pub(crate) fn instant(&self, row: usize) -> State<f64> {
        let body_rates = self.course.start_rates[row];
        State { body_rates, ..self.state(row * self.course.steps_per_row) }
    }

    /// Angular acceleration \[rad/s²\] from a row to the next that is measured beside the airframe's.
    pub(crate) fn missing_angular(&self, row: usize) -> Vector3<f64> {
        let [before, after] = [row, row + 1].map(|row| self.course.start_rates[row]);
        let steps = self.course.steps_per_row as f64;
        let explained = |(index, step): (usize, usize)| {
            let rates = before + (after - before) * ((index as f64 + 0.5) / steps);
            self.turning(&mut self.state(step), &self.spin_up(step), rates)
        };
        let explained: Vector3<f64> = self.steps(row).enumerate().map(explained).sum();
        (after - before) / self.course.flight.period_secs - explained / steps
    }

    /// Linear acceleration \[m/s², body\] from a row to the next that is measured beside the airframe's; zero where the
    /// motion was not measured.
    pub(crate) fn missing_linear(&self, row: usize) -> Vector3<f64> {
        let Some(motion) = &self.course.flight.motion else { return Vector3::zeros() };
        let steps = self.course.steps_per_row as f64;
        let explained =
            |step: usize| self.vehicle.accelerations(&self.state(step), &self.spin_up(step), &Wind::still()).0;
        let explained: Vector3<f64> = self.steps(row).map(explained).sum();
        let measured = (motion.velocities[row + 1] - motion.velocities[row]) / self.course.flight.period_secs;
        self.tilted(&motion.attitudes[row]).rotate_inverse(measured - explained / steps)
    }

    /// Rate damping over inertia about each axis \[1/s\].
    pub(crate) fn rate_damping(&self) -> Vector3<f64> {
        self.vehicle.effects.map_or_else(Vector3::zeros, |effects| effects.rate_damping)
    }

    /// Whether a network is asked so many rows after the start of a window.
    fn asks(&self, ahead: usize) -> bool {
        ahead.is_multiple_of(self.course.flight.rows_in(STEP_SECS))
    }

    /// Steps of a row.
    fn steps(&self, row: usize) -> std::ops::Range<usize> {
        row * self.course.steps_per_row..(row + 1) * self.course.steps_per_row
    }

    /// The state a step later, by the midpoint rule, the rotors' speeds held and their change felt.
    fn stepped(&self, state: &State<f64>, spin_up: &[f64; 4], added: &[Vector3<f64>; 2]) -> State<f64> {
        let secs = self.course.step_secs;
        let middle = moved_by(state, &self.derivative(state, spin_up, added), 0.5 * secs);
        moved_by(state, &self.derivative(&middle, spin_up, added), secs)
    }

    /// How a state changes, the rotors' speeds held.
    fn derivative(&self, state: &State<f64>, spin_up: &[f64; 4], added: &[Vector3<f64>; 2]) -> Derivative<f64> {
        let [linear, angular] = added;
        let velocity = self.vehicle.accelerations(state, spin_up, &Wind::still()).0;
        Derivative {
            position: state.velocity,
            world_from_body: state.world_from_body.derivative(state.body_rates),
            velocity: velocity + state.world_from_body.rotate(*linear),
            body_rates: self.turning(&mut state.clone(), spin_up, state.body_rates) + angular,
            rotor_speeds: [0.0; 4],
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

/// `state` after `secs` of a change, the rotors' speeds held.
fn moved_by(state: &State<f64>, change: &Derivative<f64>, secs: f64) -> State<f64> {
    State {
        position: state.position + change.position * secs,
        world_from_body: state.world_from_body.advanced(&change.world_from_body, secs).normalized(),
        velocity: state.velocity + change.velocity * secs,
        body_rates: state.body_rates + change.body_rates * secs,
        rotor_speeds: state.rotor_speeds,
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
