//! What the instruments of a drone measure: the truth, late, coarse and noisy as instruments are.
//!
//! White noise has the densities of the Crazyflie's own instruments where it has them, over half the sampling rate; biases
//! walk as RotorS has them (Furrer et al. 2016, `gazebo_imu_plugin`), each pulled back to zero within its correlation
//! time. They begin at zero, as after the calibration on the ground.

use kestrel_core::instrument::{BiasWalk, measured, specific_force};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use super::magnetic_field::{FLIGHT_YEAR, field_ned_nanotesla};
use super::noise::{Noise, Purpose};
use crate::geodesy::{Geodetic, Home};
use crate::message::{enu_from_ned, frd_from_flu, ned_from_enu};
use crate::plant::Ranges;

/// Magnetometer and barometer deliver at this rate \[Hz\], as PX4's simulations have it.
const SLOW_RATE_HZ: u32 = 50;

/// A GPS receiver delivers at this rate \[Hz\].
const FIX_RATE_HZ: u32 = 10;

/// Age of a fix when it is delivered \[ms\]: what PX4 takes for granted behind a simulator (`EKF2_GPS_DELAY`, which its
/// `px4-rc.simulator` sets). An older one would be wrong by as much as the drone has moved since.
const FIX_AGE_MILLIS: u32 = 10;

/// Noise of the accelerometer along x and y, and along z \[m/s²/√Hz\]: 160 and 190 µg (Bosch BMI088).
const ACCELEROMETER_DENSITY: [f32; 3] = [160e-6 * 9.81, 160e-6 * 9.81, 190e-6 * 9.81];

/// Noise of the gyroscope \[rad/s/√Hz\]: 0.014 °/s (Bosch BMI088).
const GYROSCOPE_DENSITY: f32 = 2.44e-4;

/// The accelerometer delivers no more than this along an axis \[m/s²\]: ±24 g (Bosch BMI088).
const ACCELEROMETER_LIMIT: f32 = 24.0 * 9.81;

/// The gyroscope delivers no more than this about an axis \[rad/s\]: ±2000 °/s (Bosch BMI088).
const GYROSCOPE_LIMIT: f32 = 34.906_586;

/// Noise of a magnetometer \[gauss\]: a Crazyflie has none; PX4's `gazebo_magnetometer_plugin`, 0.4 mG/√Hz at its 100 Hz.
const MAGNETOMETER_DEVIATION: f32 = 4e-3;

/// Noise of the barometer \[Pa\], eight centimetres of height; PX4's `gazebo_barometer_plugin`.
const BAROMETER_DEVIATION: f32 = 1.0;

/// Noise of a position \[m\], horizontal and vertical: a u-blox ZED-F9P with corrections. A receiver without them wanders
/// through the whole aviary.
const FIX_DEVIATION_M: [f32; 3] = [0.01, 0.01, 0.02];

/// Noise of a velocity \[m/s\]: u-blox ZED-F9P.
const FIX_VELOCITY_DEVIATION: f32 = 0.05;

/// \[m/s²\]; RotorS.
const ACCELEROMETER_WALK: BiasWalk<f32> = BiasWalk { density: 6e-3, correlation_secs: 300.0 };

/// \[rad/s\]; RotorS.
const GYROSCOPE_WALK: BiasWalk<f32> = BiasWalk { density: 3.88e-5, correlation_secs: 1000.0 };

/// \[gauss\]; `gazebo_magnetometer_plugin`.
const MAGNETOMETER_WALK: BiasWalk<f32> = BiasWalk { density: 6.4e-6, correlation_secs: 600.0 };

/// \[Pa\]: ±8 Pa, the relative accuracy of the Crazyflie's Bosch BMP388, after some minutes of weather.
const BAROMETER_WALK: BiasWalk<f32> = BiasWalk { density: 0.5, correlation_secs: 600.0 };

/// \[m\]: a centimetre, the accuracy of the ZED-F9P, over a minute of moving satellites.
const FIX_WALK: BiasWalk<f32> = BiasWalk { density: 2e-3, correlation_secs: 60.0 };

/// Of the Multi-ranger deck.
const RANGERS_RATE_HZ: u32 = 20;

/// One sample of all instruments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Specific force, FRD \[m/s²\]: (0, 0, −g) at rest.
    pub specific_force_frd: [f32; 3],
    /// Angular velocity, FRD \[rad/s\].
    pub body_rates_frd: [f32; 3],
    /// What the slow instruments deliver, when they do.
    pub ambient: Option<Ambient>,
    /// What the GPS receiver delivers, when it does.
    pub fix: Option<GnssFix>,
    /// What rangers deliver, when they do, where the plant knows what is around the drone.
    pub ranges: Option<Ranges>,
}

/// One sample of the magnetometer and the barometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ambient {
    /// Magnetic field, FRD \[gauss\].
    pub magnetic_field_frd_gauss: [f32; 3],
    /// Static pressure \[Pa\].
    pub pressure_pa: f32,
    /// Height of that pressure in the standard atmosphere \[m\].
    pub pressure_altitude_m: f32,
    /// Of the air \[°C\].
    pub temperature_celsius: f32,
}

/// One fix of the GPS receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssFix {
    /// Where the drone was.
    pub position: Geodetic,
    /// Its velocity, NED \[m/s\].
    pub velocity_ned: [f32; 3],
}

/// The instruments of one drone.
#[derive(Clone, Debug)]
pub struct Instruments {
    home: Home,
    field_in_world_gauss: Vector3<f32>,
    noise: Noise,
    rate_hz: u32,
    count: u64,
    drifts: Drifts,
    fix_on_its_way: Option<GnssFix>,
}

/// The present bias of every instrument, in the units of [`Measurement`].
#[derive(Clone, Copy, Debug, Default)]
struct Drifts {
    specific_force: [f32; 3],
    body_rates: [f32; 3],
    magnetic_field_gauss: [f32; 3],
    pressure_pa: [f32; 3],
    position_m: [f32; 3],
}

impl Instruments {
    /// Instruments at home, sampled at this rate.
    pub fn new(home: Home, noise: Noise, rate_hz: u32) -> Self {
        let field_ned = field_ned_nanotesla(&home, FLIGHT_YEAR);
        Self {
            home,
            // 100,000 nT are one gauss.
            field_in_world_gauss: enu_from_ned(field_ned.map(|component| (component * 1e-5) as f32)),
            noise,
            rate_hz: rate_hz.max(1),
            count: 0,
            drifts: Drifts::default(),
            fix_on_its_way: None,
        }
    }

    /// Forgets biases and fixes and counts from zero again, so that what follows depends on nothing before.
    pub fn restart(&mut self) {
        *self = Self { count: 0, drifts: Drifts::default(), fix_on_its_way: None, ..*self };
    }

    /// The next sample, of a drone that moved from one true state to another within a sampling period.
    pub fn measure(&mut self, before: &State<f32>, after: &State<f32>) -> Measurement {
        let measurement = Measurement {
            specific_force_frd: self.specific_force(before, after),
            body_rates_frd: self.body_rates(after),
            ambient: self.due(SLOW_RATE_HZ).then(|| self.ambient(after)),
            fix: self.fix(after),
            ranges: None,
        };
        self.count += 1;
        measurement
    }

    /// Whether rangers measure with the next sample.
    pub fn rangers_are_due(&self) -> bool {
        self.due(RANGERS_RATE_HZ)
    }

    /// Whether an instrument of this rate measures with this sample.
    fn due(&self, rate_hz: u32) -> bool {
        self.since_due(rate_hz) == 0
    }

    /// Samples since an instrument of this rate measured.
    fn since_due(&self, rate_hz: u32) -> u64 {
        self.count % u64::from((self.rate_hz / rate_hz).max(1))
    }

    fn specific_force(&mut self, before: &State<f32>, after: &State<f32>) -> [f32; 3] {
        let secs = self.period_secs();
        let truth = frd_from_flu(&specific_force(&before.velocity, after, secs));
        let normals = self.noise.normals(Purpose::AccelerometerDrift, self.count);
        advance(&mut self.drifts.specific_force, &ACCELEROMETER_WALK, normals, secs);
        let deviation = ACCELEROMETER_DENSITY.map(|density| density * self.root_bandwidth());
        let normals = self.noise.normals(Purpose::Accelerometer, self.count);
        within(ACCELEROMETER_LIMIT, truth, self.drifts.specific_force, noise(deviation, normals))
    }

    fn body_rates(&mut self, state: &State<f32>) -> [f32; 3] {
        let secs = self.period_secs();
        let normals = self.noise.normals(Purpose::GyroscopeDrift, self.count);
        advance(&mut self.drifts.body_rates, &GYROSCOPE_WALK, normals, secs);
        let deviation = [GYROSCOPE_DENSITY * self.root_bandwidth(); 3];
        let normals = self.noise.normals(Purpose::Gyroscope, self.count);
        let truth = frd_from_flu(&state.body_rates);
        within(GYROSCOPE_LIMIT, truth, self.drifts.body_rates, noise(deviation, normals))
    }

    fn ambient(&mut self, state: &State<f32>) -> Ambient {
        let secs = 1.0 / SLOW_RATE_HZ as f32;
        let normals = self.noise.normals(Purpose::MagnetometerDrift, self.count);
        advance(&mut self.drifts.magnetic_field_gauss, &MAGNETOMETER_WALK, normals, secs);
        let field = frd_from_flu(&state.world_from_body.rotate_inverse(self.field_in_world_gauss));
        let normals = self.noise.normals(Purpose::Magnetometer, self.count);
        let field = within(
            f32::INFINITY,
            field,
            self.drifts.magnetic_field_gauss,
            noise([MAGNETOMETER_DEVIATION; 3], normals),
        );

        let normals = self.noise.normals(Purpose::BarometerDrift, self.count);
        advance(&mut self.drifts.pressure_pa, &BAROMETER_WALK, normals, secs);
        let altitude_m = self.home.altitude_m + f64::from(state.position.z);
        let [normal, ..] = self.noise.normals(Purpose::Barometer, self.count);
        let pressure_pa =
            pressure_pa(altitude_m) as f32 + self.drifts.pressure_pa[0] + BAROMETER_DEVIATION * normal;
        Ambient {
            magnetic_field_frd_gauss: field,
            pressure_pa,
            pressure_altitude_m: pressure_altitude_m(f64::from(pressure_pa)) as f32,
            temperature_celsius: (15.0 - 0.0065 * altitude_m) as f32,
        }
    }

    /// Takes a fix when one is due, and delivers it when it is as old as fixes are.
    fn fix(&mut self, state: &State<f32>) -> Option<GnssFix> {
        if self.due(FIX_RATE_HZ) {
            self.fix_on_its_way = Some(self.taken_fix(state));
        }
        let age = u64::from((self.rate_hz * FIX_AGE_MILLIS).div_ceil(1000));
        if self.since_due(FIX_RATE_HZ) == age { self.fix_on_its_way.take() } else { None }
    }

    fn taken_fix(&mut self, state: &State<f32>) -> GnssFix {
        let normals = self.noise.normals(Purpose::GpsPositionDrift, self.count);
        advance(&mut self.drifts.position_m, &FIX_WALK, normals, 1.0 / FIX_RATE_HZ as f32);
        let normals = self.noise.normals(Purpose::GpsPosition, self.count);
        let position =
            within(f32::INFINITY, state.position.into(), self.drifts.position_m, noise(FIX_DEVIATION_M, normals));
        let normals = self.noise.normals(Purpose::GpsVelocity, self.count);
        let velocity = within(
            f32::INFINITY,
            ned_from_enu(&state.velocity),
            [0.0; 3],
            noise([FIX_VELOCITY_DEVIATION; 3], normals),
        );
        GnssFix { position: self.home.place_of(&position.into()), velocity_ned: velocity }
    }

    fn period_secs(&self) -> f32 {
        1.0 / self.rate_hz as f32
    }

    /// Root of the bandwidth of a sample \[√Hz\].
    fn root_bandwidth(&self) -> f32 {
        libm::sqrtf(0.5 * self.rate_hz as f32)
    }
}

/// Moves a bias on by `secs` with standard normal numbers.
fn advance(bias: &mut [f32; 3], walk: &BiasWalk<f32>, normals: [f32; 3], secs: f32) {
    for (bias, normal) in bias.iter_mut().zip(normals) {
        *bias = walk.step(*bias, normal, secs);
    }
}

fn noise(deviation: [f32; 3], normals: [f32; 3]) -> [f32; 3] {
    core::array::from_fn(|axis| deviation[axis] * normals[axis])
}

/// What is measured along three axes, no farther than a limit from zero.
fn within(limit: f32, truth: [f32; 3], bias: [f32; 3], noise: [f32; 3]) -> [f32; 3] {
    core::array::from_fn(|axis| measured(truth[axis], bias[axis], noise[axis], [-limit, limit]))
}

/// Pressure \[Pa\] at an altitude \[m\] of the International Standard Atmosphere (ISO 2533), below 11 km.
fn pressure_pa(altitude_m: f64) -> f64 {
    101_325.0 * libm::pow(1.0 - 0.0065 * altitude_m / 288.15, 5.255_88)
}

/// The inverse of [`pressure_pa`].
fn pressure_altitude_m(pressure_pa: f64) -> f64 {
    (1.0 - libm::pow((pressure_pa / 101_325.0).max(0.0), 1.0 / 5.255_88)) * 288.15 / 0.0065
}

#[cfg(test)]
mod tests;
