//! What policy and critic see, and what the policy commands.

mod reference;

use kestrel_core::action::{
    ACTION_LEN, ActionSpace, IntegralVelocities, RotorSpeeds, RotorThrusts, ThrustBodyRates, ThrustTorques,
    Velocities,
};
use kestrel_core::airframe::{Airframe, GRAVITY};
use kestrel_core::observation::{
    BodyLayout, HISTORY_LIMIT, KinematicLayout, MeasuredLayout, OBSERVATION_LIMIT, ObservationLayout, PILOT_LEN,
    PilotForLayout, PilotLayout, PilotMeasuredLayout, Px4NeuralLayout, ReferenceLayout,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use reference::{
    ReferenceActionConfig, ReferenceActionKindConfig, ReferenceControllerConfig, ReferencePrecisionConfig,
};

use super::EPISODE_LIMITS;
use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::physics::Physics;
use crate::rate_loop::GYRO_CUTOFF_HZ;

const FRACTION: Limits = Limits::above(0.0, 1.0, "");
const BODY_RATES: Limits = Limits::above(0.0, 100.0, "rad/s");

/// What a few numbers in -1 to 1 mean.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionConfig {
    /// One speed per rotor.
    RotorSpeeds(RotorSpeedsConfig),
    /// Collective thrust and body rates, which a rate controller tracks.
    ThrustBodyRates(ThrustBodyRatesConfig),
    /// Velocity in the world and yaw rate, which a controller flies.
    Velocity(VelocityConfig),
    /// An action type of gym-pybullet-drones, exactly.
    Published(ReferenceActionConfig),
    /// One thrust per rotor, up to the greatest: what PX4's neural control commands.
    RotorThrusts(RotorThrustsConfig),
    /// Collective thrust and torques as shares of what the rotors have, which fly any drone.
    ThrustTorques(ThrustTorquesConfig),
}

/// One speed per rotor, around the one at which the drone hovers.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RotorSpeedsConfig {
    /// A full action changes the hover speed by this fraction, in (0, 1]. The Crazyflie's rotors reach 1.5 times the
    /// hover speed, so 0.5 is all they have; the reference system has 0.05.
    pub fraction_of_hover: f64,
}

/// One thrust per rotor, linear in the action: the lowest at -1, the greatest that the airframe has at 1.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RotorThrustsConfig {
    /// The lowest thrust as a share of the greatest. Its rotor speed is above that of an idling motor, so that no action
    /// stops a rotor.
    pub lowest_share: f64,
    /// Rotor speed of a motor that is armed and commanded zero, as a share of the greatest speed. PX4's Gazebo has 0.15
    /// for the x500.
    pub idle_speed_share: f64,
}

/// Collective thrust and body rates.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ThrustBodyRatesConfig {
    /// A full action changes the hover thrust by this fraction; 1.25 is all that the Crazyflie has.
    pub fraction_of_hover: f64,
    /// Body rates about x, y, z that a full action asks for.
    pub body_rates_limit_rad_per_s: [f64; 3],
    /// Angular acceleration per error of the body rates. Above 10 the rotors' lag of 0.1 s makes them overshoot.
    pub rate_gains_per_s: [f64; 3],
    /// A rate loop inside, at every physics step and not only once a control period: the firmware's, which the policy on the
    /// drone then needs as well.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_loop: Option<RateLoopConfig>,
}

/// A rate loop that runs at every physics step, on what a filtered gyroscope says.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RateLoopConfig {
    /// Cut-off frequency of the gyroscope's low-pass filter (two poles, Butterworth), below half of the physics steps per
    /// second. Bitcraze's firmware has 80 Hz, which is late by 2.8 ms.
    pub gyro_cutoff_hz: f64,
}

/// Velocity along the world's axes and yaw rate: a policy that commands it need not learn to balance.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct VelocityConfig {
    /// Velocity along each axis that a full action asks for.
    pub speed_limit_m_per_s: f64,
    /// Acceleration per velocity error.
    pub velocity_gain_per_s: f64,
    /// Acceleration per integrated velocity error, which makes up for mass, thrust, drag and wind that the controller is not told
    /// of; with zero, as by default, it does not.
    pub integral_gain_per_s2: f64,
    /// Body rate per sine of the angle between the thrust and where it should point.
    pub attitude_gain_per_s: f64,
    /// What carries it out; of its limits the last is the yaw rate that a full action asks for.
    pub rates: ThrustBodyRatesConfig,
}

/// What the policy sees.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservationConfig {
    /// Position relative to the goal, rotation matrix, velocity, body rates, previous action: 22 values where the
    /// action has four.
    Pilot(PilotConfig),
    /// The 12 values of gym-pybullet-drones before 2023 and of the thesis: position, angles, velocity, axis of rotation,
    /// without the goal.
    Paper(ReferenceObservationConfig),
    /// What gym-pybullet-drones shows since 2023: position, angles, velocity, angular velocity, undivided, and the last
    /// actions.
    Kinematic(KinematicConfig),
    /// What the scenario's sensors deliver, and nothing else.
    Measured,
    /// The `pilot` observation, then what the sensors deliver.
    PilotMeasured(PilotConfig),
    /// In the drone's own axes: position relative to the goal, rotation matrix relative to the wanted heading, velocity,
    /// body rates, the last two actions, a leaky integral of the position error, then what the sensors deliver.
    Body(PilotConfig),
    /// The 15 inputs of PX4's neural control, undivided: goal minus position, two rows of the rotation matrix, velocity, all
    /// in world axes, whose x is east there, and body rates.
    Px4Neural,
}

/// What the `pilot` observation divides by, so that all values are of order one.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PilotConfig {
    /// Distance from the goal that reads as one; of farther goals only the direction is seen.
    pub position_scale_m: f64,
    /// Speed that reads as one.
    pub velocity_scale_m_per_s: f64,
    /// Angular velocity that reads as one.
    pub body_rates_scale_rad_per_s: f64,
}

/// By which the `paper` observation divides.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReferenceObservationConfig {
    /// Three metres per second of this time along x and y, and one along z, read as one. The reference has 5, or 10
    /// where its episodes last 10 s, 20 or 30.
    pub episode_secs: f64,
}

/// What the `kinematic` observation remembers.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct KinematicConfig {
    /// How many past actions are seen, at most 32. The reference shows half a second of them, 15 at 30 Hz.
    pub past_actions: u64,
}

impl Default for ActionConfig {
    fn default() -> Self {
        Self::RotorSpeeds(RotorSpeedsConfig::default())
    }
}

impl Default for RotorSpeedsConfig {
    fn default() -> Self {
        Self { fraction_of_hover: 0.5 }
    }
}

/// Collective thrust from none at -1 to all at 1, and torques about x, y, z, of which a full one adds half of its greatest thrust
/// to each rotor of a cross. Nothing in them belongs to one drone but where its rotors are, which way they turn and how fast
/// they may.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ThrustTorquesConfig {
    /// The least that a rotor is told, as a share of its greatest thrust.
    pub lowest_share: f64,
}

impl Default for ThrustTorquesConfig {
    fn default() -> Self {
        Self { lowest_share: 0.02 }
    }
}

impl Default for RotorThrustsConfig {
    /// A twentieth of the thrust turns a rotor at 0.22 of its greatest speed, half as fast again as a motor that idles.
    fn default() -> Self {
        Self { lowest_share: 0.05, idle_speed_share: 0.15 }
    }
}

impl Default for ThrustBodyRatesConfig {
    /// With a rotor lag of about 0.09 s, a gain of 8 per second damps the rates at 0.6.
    fn default() -> Self {
        Self {
            fraction_of_hover: 1.0,
            body_rates_limit_rad_per_s: [10.0, 10.0, 5.0],
            rate_gains_per_s: [8.0, 8.0, 4.0],
            rate_loop: None,
        }
    }
}

impl Default for RateLoopConfig {
    fn default() -> Self {
        Self { gyro_cutoff_hz: GYRO_CUTOFF_HZ }
    }
}

impl Default for VelocityConfig {
    /// Two metres per second are what the Crazyflie's firmware flies with its Flow deck. With the rotors'
    /// lag of 0.09 s these gains let a step of the velocity overshoot by a tenth; an attitude gain of 8 oscillates.
    fn default() -> Self {
        let rates = ThrustBodyRatesConfig {
            fraction_of_hover: 1.0,
            body_rates_limit_rad_per_s: [8.0, 8.0, 3.0],
            rate_gains_per_s: [16.0, 16.0, 6.0],
            rate_loop: None,
        };
        Self {
            speed_limit_m_per_s: 2.0,
            velocity_gain_per_s: 3.0,
            integral_gain_per_s2: 0.0,
            attitude_gain_per_s: 5.0,
            rates,
        }
    }
}

impl Default for ObservationConfig {
    fn default() -> Self {
        Self::Pilot(PilotConfig::default())
    }
}

impl Default for PilotConfig {
    fn default() -> Self {
        Self { position_scale_m: 1.0, velocity_scale_m_per_s: 2.0, body_rates_scale_rad_per_s: 10.0 }
    }
}

impl Default for ReferenceObservationConfig {
    fn default() -> Self {
        Self { episode_secs: 5.0 }
    }
}

impl Default for KinematicConfig {
    fn default() -> Self {
        Self { past_actions: 15 }
    }
}

impl ActionConfig {
    /// The action space around the hover of `airframe`.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<ActionSpace, ConfigError> {
        match self {
            Self::RotorSpeeds(config) => {
                let field = field.at("rotor_speeds").at("fraction_of_hover");
                let fraction = field.number(config.fraction_of_hover, &FRACTION)?;
                Ok(ActionSpace::RotorSpeeds(RotorSpeeds::new(airframe, fraction)))
            }
            Self::ThrustBodyRates(config) => {
                let space = config.check(airframe, &field.at("thrust_body_rates"))?;
                Ok(match config.rate_loop {
                    None => ActionSpace::ThrustBodyRates(space),
                    Some(_) => ActionSpace::RateLoop(space),
                })
            }
            Self::Velocity(config) => config.check(airframe, &field.at("velocity")),
            Self::Published(config) => Ok(ActionSpace::Reference(config.check(airframe))),
            Self::RotorThrusts(config) => {
                config.check(airframe, &field.at("rotor_thrusts")).map(ActionSpace::RotorThrusts)
            }
            Self::ThrustTorques(config) => {
                let hover = airframe.weight() / airframe.thrust_limit();
                let field = field.at("thrust_torques").at("lowest_share");
                let lowest = field.number(config.lowest_share, &Limits::between(0.0, hover, ""))?;
                Ok(ActionSpace::ThrustTorques(ThrustTorques::new(airframe, lowest)))
            }
        }
    }
}

impl ActionConfig {
    /// Cut-off frequency of the gyroscope's filter \[Hz\] of the rate loop, which nothing reads where there is none.
    ///
    /// # Errors
    /// When it is not below half of the physics rate, or the rate loop stands where there can be none.
    pub fn check_gyro(&self, physics: &Physics, field: &Field<'_>) -> Result<f64, ConfigError> {
        let (rates, field) = match self {
            Self::ThrustBodyRates(config) => (config.rate_loop, field.at("thrust_body_rates").at("rate_loop")),
            Self::Velocity(config) => {
                let field = field.at("velocity").at("rates").at("rate_loop");
                if config.rates.rate_loop.is_some() {
                    return Err(field.reject("a rate loop", "none: only `thrust_body_rates` has one"));
                }
                (None, field)
            }
            Self::RotorSpeeds(_) | Self::Published(_) | Self::RotorThrusts(_) | Self::ThrustTorques(_) => {
                (None, field.at("rate_loop"))
            }
        };
        let Some(rates) = rates else { return Ok(GYRO_CUTOFF_HZ) };
        let nyquist = 0.5 / physics.substep_secs();
        let below = Limits::between(0.0, nyquist, "Hz, half of the physics steps per second");
        field.at("gyro_cutoff_hz").real(rates.gyro_cutoff_hz, &below)
    }
}

impl RotorThrustsConfig {
    fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<RotorThrusts, ConfigError> {
        let idle = field.at("idle_speed_share").real(self.idle_speed_share, &Limits::above(0.0, 0.9, ""))?;
        let hover = airframe.weight() / airframe.thrust_limit();
        let between_idling_and_hovering = Limits::between(idle * idle, hover, "");
        let lowest = field.at("lowest_share").real(self.lowest_share, &between_idling_and_hovering)?;
        Ok(RotorThrusts::new(airframe, lowest, idle * airframe.rotor_speed_limit))
    }
}

impl ThrustBodyRatesConfig {
    fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<ThrustBodyRates, ConfigError> {
        let spare = airframe.thrust_limit() / (airframe.mass * GRAVITY) - 1.0;
        let thrust = Limits::above(0.0, (spare * 1e3).round() / 1e3, "");
        Ok(ThrustBodyRates::new(
            airframe,
            field.at("fraction_of_hover").number(self.fraction_of_hover, &thrust)?,
            field.at("body_rates_limit_rad_per_s").numbers(self.body_rates_limit_rad_per_s, &BODY_RATES)?,
            field.at("rate_gains_per_s").numbers(self.rate_gains_per_s, &Limits::above(0.0, 100.0, "1/s"))?,
        ))
    }
}

impl VelocityConfig {
    fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<ActionSpace, ConfigError> {
        let gain = |key: &str, value: f64| field.at(key).number(value, &Limits::above(0.0, 100.0, "1/s"));
        let velocities = Velocities {
            rates: self.rates.check(airframe, &field.at("rates"))?,
            speed_limit: field
                .at("speed_limit_m_per_s")
                .number(self.speed_limit_m_per_s, &Limits::above(0.0, 20.0, "m/s"))?,
            velocity_gain: gain("velocity_gain_per_s", self.velocity_gain_per_s)?,
            attitude_gain: gain("attitude_gain_per_s", self.attitude_gain_per_s)?,
        };
        let range = Limits::from(0.0, 100.0, "1/s²");
        let integral_gain = field.at("integral_gain_per_s2").number(self.integral_gain_per_s2, &range)?;
        Ok(if integral_gain > 0.0 {
            ActionSpace::IntegralVelocities(IntegralVelocities { velocities, integral_gain })
        } else {
            ActionSpace::Velocities(velocities)
        })
    }
}

impl ObservationConfig {
    /// The layout beside actions of `action_len` values, with sensors that deliver `measured_len`.
    ///
    /// # Errors
    /// When a scale is out of range, or there are too many values, or none.
    pub fn check(
        &self,
        action_len: usize,
        measured_len: usize,
        field: &Field<'_>,
    ) -> Result<ObservationLayout, ConfigError> {
        match self {
            Self::Pilot(config) => config.check(&field.at("pilot")).map(|scales| pilot_layout(scales, action_len)),
            Self::Paper(config) => {
                let secs = field.at("paper").at("episode_secs").number(config.episode_secs, &EPISODE_LIMITS)?;
                Ok(ObservationLayout::Reference(ReferenceLayout::of_episode(secs)))
            }
            Self::Kinematic(config) => {
                config.check(action_len, &field.at("kinematic")).map(ObservationLayout::Kinematic)
            }
            Self::PilotMeasured(config) => {
                let field = field.at("pilot_measured");
                pilot_measured_layout(config.check(&field)?, action_len, measured_len, &field)
            }
            Self::Body(config) => {
                let field = field.at("body");
                body_layout(config.check(&field)?, action_len, measured_len, &field)
            }
            Self::Measured => measured_layout(measured_len, field).map(ObservationLayout::Measured),
            Self::Px4Neural => Ok(ObservationLayout::Px4Neural(Px4NeuralLayout)),
        }
    }
}

fn pilot_layout(scales: PilotLayout, action_len: usize) -> ObservationLayout {
    match action_len {
        ACTION_LEN => ObservationLayout::Pilot(scales),
        _ => ObservationLayout::PilotFor(PilotForLayout { scales, action_len: action_len as u8 }),
    }
}

fn pilot_measured_layout(
    scales: PilotLayout,
    action_len: usize,
    measured_len: usize,
    field: &Field<'_>,
) -> Result<ObservationLayout, ConfigError> {
    let most = OBSERVATION_LIMIT - PILOT_LEN;
    if !(1..=most).contains(&measured_len) {
        let expected = format!("1 to {most} of `scenario.sensors`");
        return Err(field.reject(format!("sensors that deliver {measured_len} values"), expected));
    }
    if action_len != ACTION_LEN {
        let expected = format!("an action of {ACTION_LEN} values");
        return Err(field.reject(format!("`pilot_measured` beside an action of {action_len} values"), expected));
    }
    Ok(ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales, measured_len: measured_len as u8 }))
}

fn body_layout(
    scales: PilotLayout,
    action_len: usize,
    measured_len: usize,
    field: &Field<'_>,
) -> Result<ObservationLayout, ConfigError> {
    let layout = |measured_len| BodyLayout { scales, action_len: action_len as u8, measured_len };
    let most = OBSERVATION_LIMIT - layout(0).len();
    if measured_len > most {
        let found = format!("sensors that deliver {measured_len} values");
        return Err(field.reject(found, format!("at most {most} of `scenario.sensors`")));
    }
    Ok(ObservationLayout::Body(layout(measured_len as u8)))
}

fn measured_layout(len: usize, field: &Field<'_>) -> Result<MeasuredLayout, ConfigError> {
    match len {
        0 => Err(field.reject("`measured` without sensors", "at least one of `scenario.sensors`")),
        1..=OBSERVATION_LIMIT => Ok(MeasuredLayout { len: len as u8 }),
        _ => {
            let found = format!("sensors that deliver {len} values");
            Err(field.reject(found, format!("at most {OBSERVATION_LIMIT}")))
        }
    }
}

impl PilotConfig {
    fn check(&self, field: &Field<'_>) -> Result<PilotLayout, ConfigError> {
        let scale = |key: &str, value: f64, unit| field.at(key).number(value, &Limits::from(0.01, 1000.0, unit));
        Ok(PilotLayout {
            position_scale_m: scale("position_scale_m", self.position_scale_m, "m")?,
            velocity_scale: scale("velocity_scale_m_per_s", self.velocity_scale_m_per_s, "m/s")?,
            body_rates_scale: scale("body_rates_scale_rad_per_s", self.body_rates_scale_rad_per_s, "rad/s")?,
        })
    }
}

impl KinematicConfig {
    fn check(&self, action_len: usize, field: &Field<'_>) -> Result<KinematicLayout, ConfigError> {
        let layout = |past_actions| KinematicLayout { past_actions, action_len: action_len as u8 };
        let room = (OBSERVATION_LIMIT - layout(0).len()) / action_len;
        let limit = room.min(HISTORY_LIMIT) as u64;
        let past_actions = field.at("past_actions").whole(self.past_actions, 0..=limit)?;
        Ok(layout(past_actions as u8))
    }
}
