//! Flights of a drone that is known to the last digit, as a log at 100 Hz would show them.

use kestrel_core::airframe::{Airframe, CRAZYFLIE_2_1, GRAVITY};
use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::runge_kutta_4;
use kestrel_core::seed::{Purpose, Seed, Stream};
use kestrel_core::vehicle::{Air, State, Vehicle};
use kestrel_identify::drone::{Drone, ThrustCurve};
use kestrel_identify::flight::{CommandRecord, Flight, Motion};
use kestrel_identify::horizon::{Horizon, Signal};
use kestrel_identify::{Finding, HoldOut, Identification, IdentifyError, Parameter, Settings, Verdict, identify};
use nalgebra::Vector3;

/// Step of the simulation [s].
const STEP_SECS: f64 = 0.0005;

/// Steps between two rows of the log.
const STEPS_PER_ROW: usize = 20;

/// Length of a flight [s].
const FLIGHT_SECS: f64 = 30.0;

/// Flights of a case.
const FLIGHTS: u32 = 2;

/// Flights of a case with a residual network.
const LEARNED_FLIGHTS: u32 = 6;

/// Numbers that differ from what is believed of the drone, and by how much at most.
const DRAWN: [(Parameter, f64); 15] = [
    (Parameter::RotorSpeedLimit, 0.05),
    (Parameter::RotorRise, 0.3),
    (Parameter::RotorFall, 0.3),
    (Parameter::InertiaX, 0.3),
    (Parameter::InertiaY, 0.3),
    (Parameter::TorqueCoefficient, 0.3),
    (Parameter::RotorInertia, 0.3),
    (Parameter::RateDampingX, 0.4),
    (Parameter::RateDampingY, 0.4),
    (Parameter::RateDampingZ, 0.4),
    (Parameter::FlappingMoment, 0.4),
    (Parameter::PlanarDrag, 0.4),
    (Parameter::AxialDrag, 0.4),
    (Parameter::BodyDrag, 0.4),
    (Parameter::IdleShare, 0.0),
];

/// What a log says of the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Recorded {
    /// Every command.
    Commands,
    /// Rotor speeds, a row late and with noise.
    Speeds,
}

/// What the drone has beside the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unmodelled {
    /// Nothing.
    Nothing,
    /// Moments that grow with the cube of the air speed, and lift that grows with its square.
    Air,
}

/// Moment about x and y over inertia and cubed air speed [rad s/m³].
const CUBIC_MOMENT: f64 = 0.3;

/// Lift over mass and squared speed across the thrust [1/m].
const LIFT: f64 = 0.3;

impl Unmodelled {
    /// Linear [m/s², world] and angular acceleration [rad/s²] in a state.
    fn accelerations(self, state: &State<f64>) -> [Vector3<f64>; 2] {
        let air = state.world_from_body.rotate_inverse(state.velocity);
        match self {
            Self::Nothing => [Vector3::zeros(); 2],
            Self::Air => [
                state.world_from_body.rotate(Vector3::z() * (LIFT * air.xy().norm_squared())),
                Vector3::new(air.y, -air.x, 0.0) * (CUBIC_MOMENT * air.norm_squared()),
            ],
        }
    }
}

/// Noise of a measured rotor speed [rad/s]: what a row's jitter of 2 ms makes of a shaken rotor.
const SPEED_NOISE: f64 = 15.0;

/// A drone, and what `identify` made of its flights.
pub(crate) struct Case {
    /// What flew.
    pub(crate) truth: Drone,
    /// What was found.
    pub(crate) found: Identification,
}

impl Case {
    /// Flies the drone of a seed and identifies it.
    ///
    /// # Errors
    /// When its flights cannot be followed.
    pub(crate) fn run(seed: u64, recorded: Recorded) -> Result<Self, IdentifyError> {
        Self::identified(seed, recorded, Unmodelled::Nothing, None)
    }

    /// The same, every command recorded, with a residual network.
    ///
    /// # Errors
    /// When its flights cannot be followed.
    pub(crate) fn with_residual(seed: u64, unmodelled: Unmodelled) -> Result<Self, IdentifyError> {
        Self::identified(seed, Recorded::Commands, unmodelled, Some(Seed(seed)))
    }

    /// Change of each signal's held-out error after half a second by the residual network, as a share.
    pub(crate) fn changes(&self) -> Vec<(Signal, f64)> {
        let change = |horizon: &Horizon| horizon.after(3, 50) / horizon.after(2, 50) - 1.0;
        self.found.horizons.iter().map(|horizon| (horizon.signal, change(horizon))).collect()
    }

    fn identified(
        seed: u64,
        recorded: Recorded,
        unmodelled: Unmodelled,
        residual: Option<Seed>,
    ) -> Result<Self, IdentifyError> {
        let believed = Airframe {
            effects: kestrel_core::airframe::FlightEffects { body_drag: 1.3e-3, ..CRAZYFLIE_2_1.effects },
            ..CRAZYFLIE_2_1
        };
        let mut stream = Stream::new(Seed(seed), 0, Purpose::Reset);
        let truth = drawn(&believed, &mut stream);
        let flights = if residual.is_some() { LEARNED_FLIGHTS } else { FLIGHTS };
        let flights: Vec<Flight> = (1..=flights)
            .map(|number| {
                let (flight, speeds) = fly(&truth, seed, number, unmodelled);
                match recorded {
                    Recorded::Commands => flight,
                    Recorded::Speeds => {
                        with_speeds(flight, &speeds, &mut Stream::new(Seed(seed), number, Purpose::Reset))
                    }
                }
            })
            .collect();
        let settings = Settings { airframe: believed, hold_out: HoldOut::LastQuarter, kept: Vec::new(), residual };
        Ok(Self { truth, found: identify(&flights, &settings, &|| true)? })
    }

    /// Each number that was told, and whether its interval holds the true one.
    pub(crate) fn told(&self) -> impl Iterator<Item = (&Finding, bool)> {
        let told = self.found.findings.iter().filter(|finding| matches!(finding.verdict, Verdict::Told(_)));
        told.map(|finding| {
            let truth = finding.parameter.value(&self.truth);
            (finding, finding.interval().is_some_and(|[low, high]| (low..=high).contains(&truth)))
        })
    }
}

/// A drone near the believed one.
fn drawn(believed: &Airframe, stream: &mut Stream) -> Drone {
    let mut factor = |spread: f64| (f64::from(stream.between(-1.0, 1.0)) * spread).exp();
    let mut airframe = *believed;
    for (parameter, spread) in DRAWN {
        let factor = factor(spread);
        let effects = &mut airframe.effects;
        match parameter {
            Parameter::RotorSpeedLimit => airframe.rotor_speed_limit *= factor,
            Parameter::RotorRise => airframe.rotor_rise_secs *= factor,
            Parameter::RotorFall => airframe.rotor_fall_secs *= factor,
            Parameter::InertiaX => airframe.inertia[0] *= factor,
            Parameter::InertiaY => airframe.inertia[1] *= factor,
            Parameter::TorqueCoefficient => airframe.torque_coefficient *= factor,
            Parameter::RotorInertia => effects.rotor_inertia *= factor,
            Parameter::RateDampingX => effects.rate_damping[0] *= factor,
            Parameter::RateDampingY => effects.rate_damping[1] *= factor,
            Parameter::RateDampingZ => effects.rate_damping[2] *= factor,
            Parameter::FlappingMoment => effects.flapping_moment *= factor,
            Parameter::PlanarDrag => airframe.drag_coefficients.planar *= factor,
            Parameter::AxialDrag => airframe.drag_coefficients.axial *= factor,
            Parameter::BodyDrag => effects.body_drag *= factor,
            Parameter::ThrustCoefficient
            | Parameter::IdleShare
            | Parameter::FullVolts
            | Parameter::Delay
            | Parameter::InertiaZ => (),
        }
    }
    let delay_steps = 8.0 + f64::from(stream.below(32));
    let idle_share = 0.1 + 0.1 * f64::from(stream.uniform());
    let thrust_curve = ThrustCurve { idle_share, delay_secs: delay_steps * STEP_SECS, ..ThrustCurve::IDEAL };
    Drone { airframe, thrust_curve }
}

/// What the pilot asks for, anew after a while.
#[derive(Clone, Copy, Default)]
struct Wish {
    tilt: [f64; 2],
    yaw_rate: f64,
    climb: f64,
}

/// A flight by a pilot who shakes the drone on every axis, and the rotor speeds at each row.
fn fly(drone: &Drone, seed: u64, number: u32, unmodelled: Unmodelled) -> (Flight, Vec<[f64; 4]>) {
    let mut stream = Stream::new(Seed(seed), number, Purpose::Actions);
    let vehicle = Vehicle::<f64>::new(&drone.airframe);
    let hover = drone.airframe.hover_rotor_speed();
    let mut state = State {
        position: Vector3::new(0.0, 0.0, 50.0),
        world_from_body: Attitude::level(),
        velocity: Vector3::zeros(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [hover; 4],
    };
    let rows = (FLIGHT_SECS / (STEP_SECS * STEPS_PER_ROW as f64)) as usize;
    let late = (drone.thrust_curve.delay_secs / STEP_SECS).round() as usize;
    let (mut wish, mut log) = (Wish::default(), Log::default());
    let mut speeds = Vec::new();
    for row in 0..rows {
        if row % 25 == 0 {
            let mut between = |limit: f32| f64::from(stream.between(-limit, limit));
            wish = Wish {
                tilt: [between(0.5), between(0.5)],
                yaw_rate: between(4.0),
                climb: between(3.0) - 0.5 * state.velocity.z,
            };
        }
        speeds.push(state.rotor_speeds);
        log.note(&state, &commands(drone, &state, &wish, &mut stream), &mut stream);
        for step in 0..STEPS_PER_ROW {
            let given = (row * STEPS_PER_ROW + step).saturating_sub(late) / STEPS_PER_ROW;
            let share = log.volts[given] / drone.thrust_curve.full_volts;
            let targets = log.commands[given]
                .map(|command| drone.airframe.rotor_speed_limit * drone.thrust_curve.speed_share(command, share));
            let [linear, angular] = unmodelled.accelerations(&state);
            state = runge_kutta_4(&vehicle, &state, &targets, &Air::still(), STEP_SECS);
            state.velocity += linear * STEP_SECS;
            state.body_rates += angular * STEP_SECS;
        }
    }
    (log.flight(format!("simulated{number}")), speeds)
}

/// The same flight as a log of rotor speeds shows it.
fn with_speeds(flight: Flight, speeds: &[[f64; 4]], stream: &mut Stream) -> Flight {
    let mut noisy = |speed: f64| speed + SPEED_NOISE * f64::from(stream.normal());
    let late = |row: usize| speeds[row.saturating_sub(1)];
    let rotor_speeds: Vec<[f64; 4]> = (0..speeds.len()).map(|row| late(row).map(&mut noisy)).collect();
    Flight {
        command_record: CommandRecord::Sampled,
        rotor_speeds: Some(rotor_speeds),
        battery_volts: None,
        ..flight
    }
}

/// Attitude and rates by gains that a drone with such lags can bear, and some more shaking.
fn commands(drone: &Drone, state: &State<f64>, wish: &Wish, stream: &mut Stream) -> [f64; 4] {
    let airframe = &drone.airframe;
    let down = state.world_from_body.rotate_inverse(Vector3::new(0.0, 0.0, 1.0));
    let drift = state.world_from_body.rotate_inverse(state.velocity);
    let tilt = [wish.tilt[0] + 0.1 * drift.y, wish.tilt[1] - 0.1 * drift.x];
    let asked = Vector3::new(3.0 * (tilt[0] - down.y), 3.0 * (tilt[1] + down.x), wish.yaw_rate);
    let gains = Vector3::new(9.0, 9.0, 4.0);
    let shaking = Vector3::new(30.0, 30.0, 8.0);
    let turning: Vector3<f64> = (asked - state.body_rates).component_mul(&gains)
        + shaking.map(|size| size * f64::from(stream.between(-1.0, 1.0)));
    let [jx, jy, jz] = airframe.inertia;
    let thrust = airframe.mass * (GRAVITY / down.z.max(0.5) + wish.climb) / 4.0;
    let arm = 0.028;
    let [x, y] = [jx * turning.x / (4.0 * arm), jy * turning.y / (4.0 * arm)];
    let z = jz * turning.z * airframe.thrust_coefficient / (4.0 * airframe.torque_coefficient);
    let thrusts = [thrust - x - y - z, thrust - x + y + z, thrust + x + y - z, thrust + x - y + z];
    thrusts.map(|thrust| {
        let speed = (thrust.max(0.0) / airframe.thrust_coefficient).sqrt() / airframe.rotor_speed_limit;
        let idle = drone.thrust_curve.idle_share;
        ((speed - idle) / (1.0 - idle) * drone.thrust_curve.full_volts / 3.9).clamp(0.05, 1.0)
    })
}

/// Columns of the log, with the noise of a gyroscope, motion capture and a battery's voltmeter.
#[derive(Default)]
struct Log {
    commands: Vec<[f64; 4]>,
    volts: Vec<f64>,
    body_rates: Vec<Vector3<f64>>,
    positions: Vec<Vector3<f64>>,
    velocities: Vec<Vector3<f64>>,
    attitudes: Vec<Attitude<f64>>,
}

impl Log {
    fn note(&mut self, state: &State<f64>, commands: &[f64; 4], stream: &mut Stream) {
        let mut noisy =
            |vector: Vector3<f64>, size: f64| vector.map(|part| part + size * f64::from(stream.normal()));
        self.body_rates.push(noisy(state.body_rates, 0.02));
        self.positions.push(noisy(state.position, 0.001));
        self.velocities.push(noisy(state.velocity, 0.01));
        let turned = noisy(Vector3::zeros(), 0.004);
        let attitude = state.world_from_body;
        self.attitudes.push(attitude.advanced(&attitude.derivative(turned), 1.0).normalized());
        self.volts.push(4.1 - 0.3 * self.volts.len() as f64 / 3000.0);
        self.commands.push(*commands);
    }

    fn flight(self, name: String) -> Flight {
        Flight {
            name,
            start_secs: 0.0,
            period_secs: STEP_SECS * STEPS_PER_ROW as f64,
            measured: vec![true; self.commands.len()],
            commands: self.commands,
            command_record: CommandRecord::Complete,
            rotor_speeds: None,
            body_rates: self.body_rates,
            specific_forces: None,
            motion: Some(Motion {
                positions: self.positions,
                attitudes: self.attitudes,
                velocities: self.velocities,
            }),
            battery_volts: Some(self.volts),
            set_points: None,
        }
    }
}
