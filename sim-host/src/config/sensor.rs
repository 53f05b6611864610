//! What the drone measures with. Defaults are the Crazyflie's parts, from their data sheets and its firmware.

mod scan;
mod tof;
mod way;

use kestrel_core::airframe::GRAVITY;
use kestrel_core::observation::OBSERVATION_LIMIT;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::course::GatesAhead;
use crate::sensor::instrument::{Bias, Instrument, Noise, Sampling};
use crate::sensor::signal::{Direction, Signal};
use crate::sensor::{Coverage, Mates, Radio, Scan, SensorSuite, Tof, Told};
use crate::term::Cells;
use crate::trajectory::PathAhead;
pub use scan::{ScanConfig, ScanRingConfig};
pub(crate) use tof::TofConfig;
pub use way::WayConfig;

/// Noise bandwidth of a second-order Butterworth low-pass filter over its cut-off frequency: π / (2 √2).
const NOISE_BANDWIDTH: f64 = 1.110_720_734_539_591_5;

/// Standard gravity, the unit of accelerometers' data sheets, in thousandths \[m/s²\].
const MILLI_G: f64 = 9.806_65e-3;

/// Share of a ranger's limit at which its noise has doubled: 2.5 of 4 m in the Crazyflie firmware's `zranger2.c`.
const NOISE_ONSET: f64 = 0.625;

/// What a policy sees as one: gyroscope \[rad/s\] (as in the `pilot` layout) and optical flow \[rad/s\] (1 m/s half a
/// metre above the ground). The accelerometer's is the weight, that of distances and heights a metre.
const BODY_RATES_UNIT: f64 = 10.0;
const FLOW_UNIT: f64 = 2.0;

/// Most mates that a drone sees: more than a policy reads with anything else beside.
const MATES_LIMIT: u64 = 16;

/// Most points of the way ahead, likewise.
const PATH_POINTS_LIMIT: u64 = 32;

/// Most gates ahead, likewise.
const GATES_LIMIT: u64 = 8;

/// Distances that may read as one.
const SCALE: Limits = Limits::from(1e-3, 1000.0, "m");

/// One part of the drone's equipment.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorConfig {
    /// Gyroscope (3 values, one is 10 rad/s) and accelerometer (3 values, one is the weight): the BMI088.
    Imu(ImuConfig),
    /// Optical flow (2 values, one is 2 rad/s) and height above what is below (1 value, in metres): the Flow deck.
    Flow(FlowConfig),
    /// Distance in each of the directions (1 value each, in metres): the Multi-ranger deck.
    Range(RangeConfig),
    /// Height above z = 0 (1 value, in metres): the BMP388.
    Barometer(BarometerConfig),
    /// How near the nearest thing is in a square of zones ahead, in the body frame (1 value each, from 0 at the limit or of
    /// nothing to 1, row by row from the top left): a multizone ranger such as the VL53L5CX. Behind all sensors but a `scan`, and
    /// what is told; once.
    Tof(TofConfig),
    /// How near the nearest thing is along beams that keep their directions in the world (1 value each, from 0 at the
    /// limit to 1): an ideal lidar behind an attitude estimate, fast enough to train with. The last sensor, once.
    Scan(ScanConfig),
    /// The nearest drones of the team, the nearest first: where each is from here (3 values) and how it moves past (3 values),
    /// in the world's axes or the drone's. The last sensor, once.
    Mates(MatesConfig),
    /// Where the goal will be, if it follows a `trajectory`: some points ahead, in the drone's body axes (3 values each).
    /// The last sensor, once.
    Path(PathConfig),
    /// Which cells of a field around the origin were visited in this episode (1 value each, 1 or 0; the cells are those of
    /// the reward `field_coverage`). The last sensor, once.
    Coverage(CoverageConfig),
    /// Where the drone is as seen from the middle of each of the next gates, if the goals are `gates`: forwards, to the left and up
    /// (3 values), and the cosine and sine of the heading in which the gate is flown through. The last sensor, once.
    Gates(GatesAheadConfig),
    /// Where the way to the goal leads, through a map that the drone makes of what its `scan` or `tof` meets (3 values: the
    /// direction of a point ahead on it, world): an occupancy grid and the shortest path in it (A*). Behind one of those, the last
    /// sensor, once.
    Way(WayConfig),
}

/// A square of cells of one metre.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CoverageConfig {
    /// Along each side of the field, at most 8.
    pub cells: u64,
    /// Tells the way to the middle of the nearest cell that is left as well (2 values, world x and y), and which distance
    /// of it reads as one.
    #[serde(default)]
    pub next_scale_m: Option<f64>,
}

/// What is told of the gates ahead.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GatesAheadConfig {
    /// How many; behind the last gate it is told again.
    pub ahead: u64,
    /// Distance that reads as one.
    pub position_scale_m: f64,
}

/// What is seen of the way ahead of the goal.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PathConfig {
    /// How many points.
    pub points: u64,
    /// Time from one to the next, and from now to the first.
    pub spacing_secs: f64,
    /// Distance that reads as one.
    pub position_scale_m: f64,
}

/// Which drones of the team are seen.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MatesConfig {
    /// How many, fewer than there are drones.
    pub nearest: u64,
    /// Distance that reads as one; of farther mates only the direction is seen.
    pub position_scale_m: f64,
    /// Speed that reads as one.
    pub velocity_scale_m_per_s: f64,
    /// Whether both are in the drone's body axes.
    #[serde(default)]
    pub in_body_axes: bool,
    /// What drones say of themselves by radio; without it they are always seen as they are.
    #[serde(default)]
    pub radio: Option<RadioConfig>,
}

/// Messages in which every drone tells where it is and how it moves; what was heard last is carried on at its velocity.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RadioConfig {
    /// Messages of a drone per second.
    pub rate_hz: f64,
    /// Standard deviation of the position in a message, along each axis.
    pub noise_m: f64,
    /// Share of the messages that a drone does not receive, of each mate by itself.
    pub lost: f64,
}

impl Default for RadioConfig {
    /// Assumptions of what a Crazyflie's peer-to-peer radio and its estimate by flow deck leave.
    fn default() -> Self {
        Self { rate_hz: 20.0, noise_m: 0.05, lost: 0.1 }
    }
}

/// Inertial measurement unit at the centre of mass.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ImuConfig {
    /// Angular velocity in the body frame.
    pub gyroscope: GyroscopeConfig,
    /// Acceleration without gravity in the body frame.
    pub accelerometer: AccelerometerConfig,
}

/// Gyroscope.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GyroscopeConfig {
    /// White noise per square root of bandwidth (BMI088 data sheet: 0.014).
    pub noise_density_deg_per_s_per_sqrt_hz: f64,
    /// Cut-off of the low-pass filter (Crazyflie firmware: 80).
    pub bandwidth_hz: f64,
    /// Standard deviation of the constant error. The firmware removes the offset of up to 1 degree per second at the
    /// start; 7 K of warming since then bring back 0.1 (data sheet: 0.015 per kelvin).
    pub bias_deg_per_s: f64,
    /// Standard deviation of the error's random walk after one second (more than the data sheet's bias instability
    /// of 2 degrees per hour, less than what warming does).
    pub bias_walk_deg_per_s_per_sqrt_s: f64,
    /// Greatest rate (firmware: 2000).
    pub limit_deg_per_s: f64,
    /// Smallest step (16 bits for twice 2000).
    pub resolution_deg_per_s: f64,
    /// Samples per second (firmware: 1000).
    pub rate_hz: f64,
    /// Age of a sample when it arrives; √2 / (2π bandwidth) is that of the filter.
    pub latency_secs: f64,
    /// Share of lost samples.
    pub drop_out: f64,
}

/// Accelerometer.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AccelerometerConfig {
    /// White noise per square root of bandwidth, in thousandths of g (BMI088 data sheet: 0.175). In flight, vibration
    /// is many times that.
    pub noise_density_mg_per_sqrt_hz: f64,
    /// Cut-off of the low-pass filter (Crazyflie firmware: 30).
    pub bandwidth_hz: f64,
    /// Standard deviation of the constant error (data sheet: an offset of 20).
    pub bias_mg: f64,
    /// Standard deviation of the error's random walk after one second (data sheet: 0.2 per kelvin; 1 K in 25 s).
    pub bias_walk_mg_per_sqrt_s: f64,
    /// Greatest acceleration in g (firmware: 24).
    pub limit_g: f64,
    /// Smallest step (16 bits for twice 24 g).
    pub resolution_mg: f64,
    /// Samples per second (firmware: read 1000 times).
    pub rate_hz: f64,
    /// Age of a sample when it arrives; √2 / (2π bandwidth) is that of the filter.
    pub latency_secs: f64,
    /// Share of lost samples.
    pub drop_out: f64,
}

/// Downward camera that sees motion, and a downward ranger.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FlowConfig {
    /// Standard deviation of the white noise (Crazyflie firmware: 2 counts in 10 ms, of 0.1 pixels of 42 / 35 degrees).
    pub noise_rad_per_s: f64,
    /// Standard deviation of the constant error (none is known).
    pub bias_rad_per_s: f64,
    /// Ground that is nearer gives no samples (PMW3901 data sheet: 0.08).
    pub nearest_m: f64,
    /// Greatest flow (PMW3901 data sheet: 7.4).
    pub limit_rad_per_s: f64,
    /// Smallest step (one count in 10 ms).
    pub resolution_rad_per_s: f64,
    /// Samples per second (firmware: 100).
    pub rate_hz: f64,
    /// Age of a sample when it arrives (the motion of 10 ms is 5 ms old on average).
    pub latency_secs: f64,
    /// Share of lost samples: over smooth or dark ground.
    pub drop_out: f64,
    /// The ranger (VL53L1X, read 40 times a second).
    pub height: BeamConfig,
}

/// Rangers around the drone.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RangeConfig {
    /// Where they look, in the order of their values.
    pub directions: Vec<DirectionConfig>,
    /// What each of them is (VL53L1X, read 10 times a second).
    pub beam: BeamConfig,
}

/// A direction fixed to the drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DirectionConfig {
    /// Along x.
    Front,
    /// Against x.
    Back,
    /// Along y.
    Left,
    /// Against y.
    Right,
    /// Along z.
    Up,
    /// Against z.
    Down,
}

/// Laser ranger: one ray, though the real one sees the nearest thing in a cone of 27 degrees.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BeamConfig {
    /// Standard deviation of the white noise near the sensor (Crazyflie firmware: 0.0025).
    pub noise_m: f64,
    /// What the limit adds to it; in between it grows exponentially (firmware: 0.2).
    pub noise_at_limit_m: f64,
    /// Standard deviation of the constant error (VL53L1X: within 0.02, noise included).
    pub bias_m: f64,
    /// Farther things read as this far (data sheet: 4).
    pub limit_m: f64,
    /// Smallest step (data sheet: 0.001).
    pub resolution_m: f64,
    /// Samples per second.
    pub rate_hz: f64,
    /// Age of a sample when it arrives (firmware: it is gathered for 25 ms).
    pub latency_secs: f64,
    /// Share of lost samples.
    pub drop_out: f64,
}

/// Barometer; the wash of rotors is not modelled.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BarometerConfig {
    /// Standard deviation of the white noise (BMP388 data sheet, table 10, in the firmware's setting: 0.11).
    pub noise_m: f64,
    /// Standard deviation of the constant error (data sheet: relative accuracy of 8 Pa).
    pub bias_m: f64,
    /// Standard deviation of the error's random walk after one second (weather: 0.8 m in an hour).
    pub bias_walk_m_per_sqrt_s: f64,
    /// Smallest step (data sheet: 0.33 Pa in the firmware's setting).
    pub resolution_m: f64,
    /// Samples per second (firmware: 50).
    pub rate_hz: f64,
    /// Age of a sample when it arrives (firmware: its filter averages over about four samples).
    pub latency_secs: f64,
    /// Share of lost samples.
    pub drop_out: f64,
}

impl Default for GyroscopeConfig {
    fn default() -> Self {
        Self {
            noise_density_deg_per_s_per_sqrt_hz: 0.014,
            bandwidth_hz: 80.0,
            bias_deg_per_s: 0.1,
            bias_walk_deg_per_s_per_sqrt_s: 0.001,
            limit_deg_per_s: 2000.0,
            resolution_deg_per_s: 0.061,
            rate_hz: 1000.0,
            latency_secs: 0.003,
            drop_out: 0.0,
        }
    }
}

impl Default for AccelerometerConfig {
    fn default() -> Self {
        Self {
            noise_density_mg_per_sqrt_hz: 0.175,
            bandwidth_hz: 30.0,
            bias_mg: 20.0,
            bias_walk_mg_per_sqrt_s: 0.04,
            limit_g: 24.0,
            resolution_mg: 0.732,
            rate_hz: 1000.0,
            latency_secs: 0.0075,
            drop_out: 0.0,
        }
    }
}

impl Default for FlowConfig {
    fn default() -> Self {
        Self {
            noise_rad_per_s: 0.41,
            bias_rad_per_s: 0.0,
            nearest_m: 0.08,
            limit_rad_per_s: 7.4,
            resolution_rad_per_s: 0.205,
            rate_hz: 100.0,
            latency_secs: 0.005,
            drop_out: 0.0,
            height: BeamConfig { rate_hz: 40.0, ..BeamConfig::default() },
        }
    }
}

impl Default for RangeConfig {
    fn default() -> Self {
        use DirectionConfig::{Back, Front, Left, Right, Up};
        Self { directions: vec![Front, Back, Left, Right, Up], beam: BeamConfig::default() }
    }
}

impl Default for BeamConfig {
    fn default() -> Self {
        Self {
            noise_m: 0.0025,
            noise_at_limit_m: 0.2,
            bias_m: 0.01,
            limit_m: 4.0,
            resolution_m: 0.001,
            rate_hz: 10.0,
            latency_secs: 0.025,
            drop_out: 0.0,
        }
    }
}

impl Default for PathConfig {
    /// The next half second.
    fn default() -> Self {
        Self { points: 5, spacing_secs: 0.1, position_scale_m: 0.5 }
    }
}

impl Default for GatesAheadConfig {
    /// The next gate and the one behind it.
    fn default() -> Self {
        Self { ahead: 2, position_scale_m: 2.0 }
    }
}

impl GatesAheadConfig {
    fn check(&self, field: &Field<'_>) -> Result<GatesAhead, ConfigError> {
        Ok(GatesAhead {
            gates: field.at("ahead").whole(self.ahead, 1..=GATES_LIMIT)? as usize,
            position_scale_m: field.at("position_scale_m").number(self.position_scale_m, &SCALE)?,
        })
    }
}

impl CoverageConfig {
    fn check(&self, field: &Field<'_>) -> Result<Coverage, ConfigError> {
        Cells::check(self.cells, field)?;
        let scale = self.next_scale_m.map(|scale| field.at("next_scale_m").number(scale, &SCALE)).transpose()?;
        Ok(Coverage { cells: self.cells, next_scale_m: scale })
    }
}

impl PathConfig {
    fn check(&self, field: &Field<'_>) -> Result<PathAhead, ConfigError> {
        Ok(PathAhead {
            points: field.at("points").whole(self.points, 1..=PATH_POINTS_LIMIT)? as usize,
            spacing_secs: field.at("spacing_secs").number(self.spacing_secs, &Limits::from(0.001, 10.0, "s"))?,
            position_scale_m: field.at("position_scale_m").number(self.position_scale_m, &SCALE)?,
        })
    }
}

impl Default for BarometerConfig {
    fn default() -> Self {
        Self {
            noise_m: 0.11,
            bias_m: 0.66,
            bias_walk_m_per_sqrt_s: 0.014,
            resolution_m: 0.028,
            rate_hz: 50.0,
            latency_secs: 0.06,
            drop_out: 0.0,
        }
    }
}

impl SensorConfig {
    /// The equipment, read every `control_secs` \[s\]; an empty list is none.
    ///
    /// # Errors
    /// When a number is out of range, a ranger has no direction or one twice, or there are too many values.
    pub fn check_all(sensors: &[Self], control_secs: f64, field: &Field<'_>) -> Result<SensorSuite, ConfigError> {
        let mut told = None;
        let mut instruments = Vec::new();
        for (index, sensor) in sensors.iter().enumerate() {
            let (field, is_last) = (field.at(index), index + 1 == sensors.len());
            match sensor {
                Self::Mates(config) if is_last => told = Some(Told::Mates(config.check(&field.at("mates"))?)),
                Self::Path(config) if is_last => told = Some(Told::Path(config.check(&field.at("path"))?)),
                Self::Coverage(config) if is_last => {
                    told = Some(Told::Coverage(config.check(&field.at("coverage"))?));
                }
                Self::Gates(config) if is_last => told = Some(Told::Gates(config.check(&field.at("gates"))?)),
                Self::Way(config) if is_last => {
                    told = Some(Told::Way(config.check(control_secs, &field.at("way"))?));
                }
                Self::Imu(_)
                | Self::Flow(_)
                | Self::Range(_)
                | Self::Barometer(_)
                | Self::Tof(_)
                | Self::Scan(_)
                | Self::Mates(_)
                | Self::Path(_)
                | Self::Coverage(_)
                | Self::Gates(_)
                | Self::Way(_) => instruments.extend(sensor.check(&field)?),
            }
        }
        let told_last = usize::from(told.is_some());
        let sensors = &sensors[..sensors.len() - told_last];
        let scan = Self::check_scan(sensors, field)?;
        let tof = Self::check_tof(&sensors[..sensors.len() - usize::from(scan.is_some())], field)?;
        let suite = SensorSuite::new(instruments, control_secs).with_tof(tof).with_scan(scan).with_told(told);
        if suite.len() > OBSERVATION_LIMIT {
            let expected = format!("at most {OBSERVATION_LIMIT}, the most that a policy sees");
            return Err(field.reject(format!("sensors that measure {} values", suite.len()), expected));
        }
        Ok(suite)
    }

    /// The ranger of many zones, if there is one.
    fn check_tof(sensors: &[Self], field: &Field<'_>) -> Result<Option<Tof>, ConfigError> {
        let Some(index) = sensors.iter().position(|sensor| matches!(sensor, Self::Tof(_))) else {
            return Ok(None);
        };
        let Some((Self::Tof(tof), [])) = sensors[index..].split_first() else {
            let expected = "one `tof`, as the last but for a `scan` and what is told";
            return Err(field.at(index).reject("a `tof` before other sensors", expected));
        };
        tof.check(&field.at(index).at("tof")).map(Some)
    }

    /// The scan, if there is one.
    fn check_scan(sensors: &[Self], field: &Field<'_>) -> Result<Option<Scan>, ConfigError> {
        let Some(index) = sensors.iter().position(|sensor| matches!(sensor, Self::Scan(_))) else {
            return Ok(None);
        };
        let Some((Self::Scan(scan), [])) = sensors[index..].split_first() else {
            return Err(field
                .at(index)
                .reject("a `scan` before other sensors", "one `scan`, as the last of them"));
        };
        scan.check(&field.at(index).at("scan")).map(Some)
    }

    /// The instruments of this part; a scan is none, and zones neither.
    fn check(&self, field: &Field<'_>) -> Result<Vec<Instrument>, ConfigError> {
        match self {
            Self::Scan(_) | Self::Tof(_) => Ok(Vec::new()),
            Self::Mates(_) => {
                Err(field.reject("`mates` before other sensors", "one `mates`, as the last of them"))
            }
            Self::Path(_) => Err(field.reject("`path` before other sensors", "one `path`, as the last of them")),
            Self::Coverage(_) => {
                Err(field.reject("`coverage` before other sensors", "one `coverage`, as the last of them"))
            }
            Self::Gates(_) => {
                Err(field.reject("`gates` before other sensors", "one `gates`, as the last of them"))
            }
            Self::Way(_) => Err(field.reject("`way` before other sensors", "one `way`, as the last of them")),
            Self::Imu(imu) => {
                let field = field.at("imu");
                let gyroscope = imu.gyroscope.check(&field.at("gyroscope"))?;
                Ok(vec![gyroscope, imu.accelerometer.check(&field.at("accelerometer"))?])
            }
            Self::Flow(flow) => {
                let field = field.at("flow");
                Ok(vec![flow.check(&field)?, flow.height.check(Direction::Down, &field.at("height"))?])
            }
            Self::Range(range) => range.check(&field.at("range")),
            Self::Barometer(barometer) => barometer.check(&field.at("barometer")).map(|each| vec![each]),
        }
    }
}

impl GyroscopeConfig {
    fn check(&self, field: &Field<'_>) -> Result<Instrument, ConfigError> {
        let part = Part(field);
        let density =
            part.error("noise_density_deg_per_s_per_sqrt_hz", self.noise_density_deg_per_s_per_sqrt_hz)?;
        let limit = part.limit("limit_deg_per_s", self.limit_deg_per_s, 10_000.0, "degrees/s")?;
        let resolution = part.error("resolution_deg_per_s", self.resolution_deg_per_s)?;
        let bias = Bias {
            constant: part.error("bias_deg_per_s", self.bias_deg_per_s)?.to_radians(),
            walk: part.error("bias_walk_deg_per_s_per_sqrt_s", self.bias_walk_deg_per_s_per_sqrt_s)?.to_radians(),
        };
        Ok(Instrument {
            signal: Signal::BodyRates,
            noise: Noise::Constant(density.to_radians() * part.noise_bandwidth(self.bandwidth_hz)?.sqrt()),
            bias,
            limits: [-limit.to_radians(), limit.to_radians()],
            resolution: resolution.to_radians(),
            sampling: part.sampling(self.rate_hz, self.latency_secs, self.drop_out)?,
            unit: BODY_RATES_UNIT,
        })
    }
}

impl AccelerometerConfig {
    fn check(&self, field: &Field<'_>) -> Result<Instrument, ConfigError> {
        let part = Part(field);
        let density = part.error("noise_density_mg_per_sqrt_hz", self.noise_density_mg_per_sqrt_hz)?;
        let limit = part.limit("limit_g", self.limit_g, 1000.0, "g")? * 1000.0 * MILLI_G;
        let bias = Bias {
            constant: part.error("bias_mg", self.bias_mg)? * MILLI_G,
            walk: part.error("bias_walk_mg_per_sqrt_s", self.bias_walk_mg_per_sqrt_s)? * MILLI_G,
        };
        Ok(Instrument {
            signal: Signal::SpecificForce,
            noise: Noise::Constant(density * MILLI_G * part.noise_bandwidth(self.bandwidth_hz)?.sqrt()),
            bias,
            limits: [-limit, limit],
            resolution: part.error("resolution_mg", self.resolution_mg)? * MILLI_G,
            sampling: part.sampling(self.rate_hz, self.latency_secs, self.drop_out)?,
            unit: GRAVITY,
        })
    }
}

impl FlowConfig {
    fn check(&self, field: &Field<'_>) -> Result<Instrument, ConfigError> {
        let part = Part(field);
        let limit = part.limit("limit_rad_per_s", self.limit_rad_per_s, 1000.0, "rad/s")?;
        Ok(Instrument {
            signal: Signal::Flow { nearest: part.limit("nearest_m", self.nearest_m, 10.0, "m")? },
            noise: Noise::Constant(part.error("noise_rad_per_s", self.noise_rad_per_s)?),
            bias: Bias { constant: part.error("bias_rad_per_s", self.bias_rad_per_s)?, walk: 0.0 },
            limits: [-limit, limit],
            resolution: part.error("resolution_rad_per_s", self.resolution_rad_per_s)?,
            sampling: part.sampling(self.rate_hz, self.latency_secs, self.drop_out)?,
            unit: FLOW_UNIT,
        })
    }
}

impl RangeConfig {
    fn check(&self, field: &Field<'_>) -> Result<Vec<Instrument>, ConfigError> {
        let directions = field.at("directions");
        if self.directions.is_empty() {
            return Err(directions.reject("no directions", "at least one, such as `front`"));
        }
        let again = |index: usize| self.directions[..index].contains(&self.directions[index]);
        if let Some(index) = (0..self.directions.len()).find(|index| again(*index)) {
            return Err(directions.at(index).reject("a direction a second time", "each direction once"));
        }
        let beam = field.at("beam");
        self.directions.iter().map(|direction| self.beam.check(direction.checked(), &beam)).collect()
    }
}

impl DirectionConfig {
    fn checked(self) -> Direction {
        match self {
            Self::Front => Direction::Front,
            Self::Back => Direction::Back,
            Self::Left => Direction::Left,
            Self::Right => Direction::Right,
            Self::Up => Direction::Up,
            Self::Down => Direction::Down,
        }
    }
}

impl BeamConfig {
    fn check(&self, direction: Direction, field: &Field<'_>) -> Result<Instrument, ConfigError> {
        let part = Part(field);
        let limit = part.limit("limit_m", self.limit_m, 1000.0, "m")?;
        let near = part.error("noise_m", self.noise_m)?;
        let far = part.error("noise_at_limit_m", self.noise_at_limit_m)?;
        Ok(Instrument {
            signal: Signal::Distance { direction, limit },
            noise: growing(near, far, limit),
            bias: Bias { constant: part.error("bias_m", self.bias_m)?, walk: 0.0 },
            limits: [0.0, limit],
            resolution: part.error("resolution_m", self.resolution_m)?,
            sampling: part.sampling(self.rate_hz, self.latency_secs, self.drop_out)?,
            unit: 1.0,
        })
    }
}

/// Noise that doubles at [`NOISE_ONSET`] and has grown by `far` \[m\] at `limit` \[m\].
fn growing(near: f64, far: f64, limit: f64) -> Noise {
    if near == 0.0 || far <= near {
        return Noise::Constant(near.max(far));
    }
    let onset = NOISE_ONSET * limit;
    Noise::Growing { near, onset, growth: libm::log(far / near) / (limit - onset) }
}

impl MatesConfig {
    fn check(&self, field: &Field<'_>) -> Result<Mates, ConfigError> {
        let scale = |key: &str, value: f64, unit| field.at(key).number(value, &Limits::from(0.01, 1000.0, unit));
        Ok(Mates {
            nearest: field.at("nearest").whole(self.nearest, 1..=MATES_LIMIT)? as usize,
            position_scale_m: scale("position_scale_m", self.position_scale_m, "m")?,
            velocity_scale: scale("velocity_scale_m_per_s", self.velocity_scale_m_per_s, "m/s")?,
            in_body_axes: self.in_body_axes,
            radio: self.radio.map(|radio| radio.check(&field.at("radio"))).transpose()?,
        })
    }
}

impl RadioConfig {
    fn check(&self, field: &Field<'_>) -> Result<Radio, ConfigError> {
        Ok(Radio {
            rate_hz: field.at("rate_hz").real(self.rate_hz, &Limits::from(1.0, 1000.0, "Hz"))?,
            noise_m: field.at("noise_m").number(self.noise_m, &Limits::from(0.0, 1.0, "m"))?,
            lost: field.at("lost").real(self.lost, &Limits::from(0.0, 0.9, ""))?,
        })
    }
}

impl BarometerConfig {
    fn check(&self, field: &Field<'_>) -> Result<Instrument, ConfigError> {
        let part = Part(field);
        let bias = Bias {
            constant: part.error("bias_m", self.bias_m)?,
            walk: part.error("bias_walk_m_per_sqrt_s", self.bias_walk_m_per_sqrt_s)?,
        };
        Ok(Instrument {
            signal: Signal::Height,
            noise: Noise::Constant(part.error("noise_m", self.noise_m)?),
            bias,
            limits: [f64::NEG_INFINITY, f64::INFINITY],
            resolution: part.error("resolution_m", self.resolution_m)?,
            sampling: part.sampling(self.rate_hz, self.latency_secs, self.drop_out)?,
            unit: 1.0,
        })
    }
}

/// The place of an instrument in the configuration.
struct Part<'a>(&'a Field<'a>);

impl Part<'_> {
    /// The value of `key`, in double precision.
    fn number(&self, key: &str, value: f64, limits: &Limits) -> Result<f64, ConfigError> {
        self.0.at(key).number(value, limits).map(|_| value)
    }

    /// An error's size, which may be nothing.
    fn error(&self, key: &str, value: f64) -> Result<f64, ConfigError> {
        self.number(key, value, &Limits::from(0.0, 1000.0, ""))
    }

    /// A bound, which may not be nothing.
    fn limit(&self, key: &str, value: f64, greatest: f64, unit: &'static str) -> Result<f64, ConfigError> {
        self.number(key, value, &Limits::above(0.0, greatest, unit))
    }

    /// What a low-pass filter with this cut-off leaves of white noise \[Hz\].
    fn noise_bandwidth(&self, bandwidth_hz: f64) -> Result<f64, ConfigError> {
        let cut_off = self.limit("bandwidth_hz", bandwidth_hz, 10_000.0, "Hz")?;
        Ok(NOISE_BANDWIDTH * cut_off)
    }

    fn sampling(&self, rate_hz: f64, latency_secs: f64, drop_out: f64) -> Result<Sampling, ConfigError> {
        Ok(Sampling {
            rate_hz: self.number("rate_hz", rate_hz, &Limits::from(0.1, 10_000.0, "Hz"))?,
            latency_secs: self.number("latency_secs", latency_secs, &Limits::from(0.0, 1.0, "s"))?,
            drop_out: self.number("drop_out", drop_out, &Limits::from(0.0, 0.99, ""))?,
        })
    }
}

#[cfg(test)]
mod tests;
