//! Which output of an autopilot turns which rotor, and how fast.
//!
//! Everybody numbers the motors of an X differently. Seen from above, with the spin of each:
//!
//! ```text
//!  PX4, ArduPilot quad X      Crazyflie, PX4's 4901       Betaflight quad X
//!
//!   3 cw      1 ccw            4 cw      1 ccw             4 cw      2 ccw
//!        \  /                       \  /                        \  /
//!        /  \                       /  \                        /  \
//!   2 ccw     4 cw             3 ccw     2 cw              3 ccw     1 cw
//! ```

use std::fmt;

use kestrel_core::airframe::Airframe;
use kestrel_core::policy_file::PolicyAirframe;

/// Pulses of a stopped motor and of one at full throttle \[µs\].
const PULSES_US: [f32; 2] = [1000.0, 2000.0];

/// Corners of an X, as [`PolicyAirframe::corners`] has them.
const FRONT_RIGHT: usize = 0;
const REAR_RIGHT: usize = 1;
const REAR_LEFT: usize = 2;
const FRONT_LEFT: usize = 3;

/// How an autopilot numbers the motors of an X.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum MotorOrder {
    /// PX4 and ArduPilot, "quad X": front right, rear left, front left, rear right
    QuadX,
    /// Crazyflie firmware, and PX4's airframe 4901: clockwise from the front right
    Crazyflie,
    /// Betaflight, "quad X": rear right, front right, rear left, front left
    Betaflight,
}

/// How thrust follows throttle u, from 0 to 1: (1 − e) u + e u² of the greatest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustCurve {
    exponent_share: f32,
}

/// Outputs of an autopilot to rotor speeds of an airframe, and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motors {
    /// Rotor of the airframe that each motor turns.
    rotors: [usize; 4],
    curve: ThrustCurve,
    rotor_speed_limit: f32,
    /// Rotor speed of full throttle \[rad/s\]: beyond the limit if the autopilot takes the motors for stronger than they are.
    full_speed: f32,
}

/// Why an airframe does not fit an autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MotorError {
    /// It is no X.
    #[error("expected an airframe whose rotors stand in an X, found a plus: autopilots mix for an X here")]
    Plus,
    /// The rotors turn the other way.
    #[error(
        "expected a front right rotor that turns counter-clockwise, as autopilots mix, found that it turns clockwise: \
         in a task, `rotor_order: fork` of the `vehicle` does that"
    )]
    Spin,
}

impl MotorOrder {
    /// The corners of motors 1 to 4.
    ///
    /// Sources: PX4's `Quadrotor x` geometry and airframe `4901_crazyflie21` (`CA_ROTORi_PX`, `_PY`, `_KM`); ArduPilot's
    /// `AP_MotorsMatrix`, `MOTOR_FRAME_TYPE_X`; Betaflight's `mixerQuadX`, propellers turning inward at the front.
    const fn corners(self) -> [usize; 4] {
        match self {
            Self::QuadX => [FRONT_RIGHT, REAR_LEFT, FRONT_LEFT, REAR_RIGHT],
            Self::Crazyflie => [FRONT_RIGHT, REAR_RIGHT, REAR_LEFT, FRONT_LEFT],
            Self::Betaflight => [REAR_RIGHT, FRONT_RIGHT, REAR_LEFT, FRONT_LEFT],
        }
    }

    /// Rotors of an airframe that motors 1 to 4 turn.
    ///
    /// # Errors
    /// If the airframe is no X, or turns the other way round.
    pub fn rotors(self, airframe: &PolicyAirframe) -> Result<[usize; 4], MotorError> {
        let rotors = airframe.corners().ok_or(MotorError::Plus)?;
        if airframe.turn_as_usual(rotors) {
            Ok(self.corners().map(|corner| rotors[corner]))
        } else {
            Err(MotorError::Spin)
        }
    }
}

impl fmt::Display for MotorOrder {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::QuadX => "quad-x",
            Self::Crazyflie => "crazyflie",
            Self::Betaflight => "betaflight",
        })
    }
}

impl ThrustCurve {
    /// Thrust in proportion to the output: what PX4 assumes (`THR_MDL_FAC` 0, its default).
    pub const PX4: Self = Self { exponent_share: 0.0 };

    /// What ArduPilot assumes (`MOT_THST_EXPO` 0.65, its default).
    pub const ARDUPILOT: Self = Self { exponent_share: 0.65 };

    /// Rotor speed in proportion to the output, thrust to its square: an ordinary speed controller, which Betaflight
    /// does not correct for (`thrust_linear` 0, its default).
    pub const BETAFLIGHT: Self = Self { exponent_share: 1.0 };

    /// The curve with this share of the square, from 0 to 1.
    pub const fn with_square_share(exponent_share: f32) -> Self {
        Self { exponent_share }
    }

    fn thrust_share(self, throttle: f32) -> f32 {
        (1.0 - self.exponent_share) * throttle + self.exponent_share * throttle * throttle
    }

    fn throttle(self, thrust_share: f32) -> f32 {
        let linear = 1.0 - self.exponent_share;
        // The root of the quadratic in the form that does not divide by zero where the curve is a line.
        let discriminant = linear * linear + 4.0 * self.exponent_share * thrust_share;
        let divisor = linear + discriminant.sqrt();
        if divisor > 0.0 { 2.0 * thrust_share / divisor } else { 0.0 }
    }
}

impl Motors {
    /// The motors of an airframe, numbered in an autopilot's order.
    ///
    /// # Errors
    /// If the airframe is no X, or turns the other way round.
    pub fn new(airframe: &Airframe, order: MotorOrder, curve: ThrustCurve) -> Result<Self, MotorError> {
        let rotors = order.rotors(&PolicyAirframe::from(airframe))?;
        let rotor_speed_limit = airframe.rotor_speed_limit as f32;
        Ok(Self { rotors, curve, rotor_speed_limit, full_speed: rotor_speed_limit })
    }

    /// The same of an autopilot that takes full throttle for a thrust of so many newtons, whatever the airframe's motors can.
    #[must_use]
    pub fn with_greatest_thrust(self, newtons: f64, airframe: &Airframe) -> Self {
        Self { full_speed: (newtons / airframe.thrust_coefficient).sqrt() as f32, ..self }
    }

    /// Rotor of the airframe that each motor turns.
    pub const fn rotors(&self) -> [usize; 4] {
        self.rotors
    }

    /// Rotor targets \[rad/s\] of throttles from 0 to 1, in the airframe's order. What is no number stops its motor, what
    /// is out of range is limited.
    pub fn rotor_targets(&self, throttles: &[f32; 4]) -> [f32; 4] {
        let mut targets = [0.0; 4];
        for (rotor, throttle) in self.rotors.iter().zip(throttles) {
            let throttle = if throttle.is_finite() { throttle.clamp(0.0, 1.0) } else { 0.0 };
            let wanted = self.full_speed * self.curve.thrust_share(throttle).sqrt();
            targets[*rotor] = wanted.min(self.rotor_speed_limit);
        }
        targets
    }

    /// Throttles from 0 to 1, in the autopilot's order, of rotor targets \[rad/s\].
    pub fn throttles(&self, rotor_targets: &[f32; 4]) -> [f32; 4] {
        self.rotors.map(|rotor| {
            let share = rotor_targets[rotor] / self.full_speed;
            let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
            self.curve.throttle(share * share)
        })
    }
}

/// The throttle of a pulse \[µs\], 0 below 1000 and 1 above 2000.
pub fn throttle_of_pulse(pulse_us: f32) -> f32 {
    let [stopped, full] = PULSES_US;
    if pulse_us.is_finite() { ((pulse_us - stopped) / (full - stopped)).clamp(0.0, 1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::{CF2P, CF2X, RACER, RotorOrder};
    use kestrel_core::attitude::Attitude;
    use kestrel_core::vehicle::{Air, State, Vehicle};
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;

    /// Where motor `motor` pushes the drone when it alone turns: signs of the roll, pitch and yaw acceleration (FRD).
    fn push(airframe: &Airframe, order: MotorOrder, motor: usize) -> [f32; 3] {
        let motors = Motors::new(airframe, order, ThrustCurve::PX4).unwrap();
        let mut throttles = [0.0; 4];
        throttles[motor - 1] = 1.0;
        let state = State {
            position: Vector3::zeros(),
            world_from_body: Attitude::level(),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: motors.rotor_targets(&throttles),
        };
        let (_, turning) = Vehicle::<f32>::new(airframe).accelerations(&state, &[0.0; 4], &Air::still());
        [turning.x.signum(), -turning.y.signum(), -turning.z.signum()]
    }

    /// A motor in front pitches up, one on the right rolls left, one that turns counter-clockwise yaws right.
    const FRONT_RIGHT_CCW: [f32; 3] = [-1.0, 1.0, 1.0];
    const REAR_LEFT_CCW: [f32; 3] = [1.0, -1.0, 1.0];
    const FRONT_LEFT_CW: [f32; 3] = [1.0, 1.0, -1.0];
    const REAR_RIGHT_CW: [f32; 3] = [-1.0, -1.0, -1.0];

    fn check(order: MotorOrder, expected: [[f32; 3]; 4]) {
        for airframe in [CF2X, RACER] {
            for (index, expected) in expected.into_iter().enumerate() {
                assert_eq!(push(&airframe, order, index + 1), expected, "{order} motor {}", index + 1);
            }
        }
    }

    #[test]
    fn quad_x_counts_across() {
        // CA_ROTOR0..3 of PX4's quad X: (+x, +y), (-x, -y), (+x, -y), (-x, +y) in FRD, KM +, +, -, -.
        check(MotorOrder::QuadX, [FRONT_RIGHT_CCW, REAR_LEFT_CCW, FRONT_LEFT_CW, REAR_RIGHT_CW]);
    }

    #[test]
    fn a_crazyflie_counts_clockwise() {
        check(MotorOrder::Crazyflie, [FRONT_RIGHT_CCW, REAR_RIGHT_CW, REAR_LEFT_CCW, FRONT_LEFT_CW]);
        let motors = Motors::new(&CF2X, MotorOrder::Crazyflie, ThrustCurve::PX4).unwrap();
        assert_eq!(motors.rotors, [0, 1, 2, 3]);
    }

    #[test]
    fn betaflight_counts_from_the_rear() {
        check(MotorOrder::Betaflight, [REAR_RIGHT_CW, FRONT_RIGHT_CCW, REAR_LEFT_CCW, FRONT_LEFT_CW]);
    }

    #[test]
    fn learned_policies_inside_px4_use_the_same_table() {
        // PX4's mc_raptor hands its Crazyflie-ordered actions to the quad X as [0, 2, 3, 1].
        let motors = Motors::new(&CF2X, MotorOrder::QuadX, ThrustCurve::PX4).unwrap();
        assert_eq!(motors.rotors, [0, 2, 3, 1]);
    }

    #[test]
    fn airframes_that_an_autopilot_would_overturn_are_refused() {
        let motors = |airframe: &Airframe| Motors::new(airframe, MotorOrder::QuadX, ThrustCurve::PX4);
        assert_eq!(motors(&CF2P), Err(MotorError::Plus));
        assert_eq!(motors(&CF2X.numbered(RotorOrder::CounterClockwise)), Err(MotorError::Spin));
    }

    #[test]
    fn what_is_no_throttle_stops_the_motor_or_is_limited() {
        let motors = Motors::new(&CF2X, MotorOrder::Crazyflie, ThrustCurve::BETAFLIGHT).unwrap();
        let limit = CF2X.rotor_speed_limit as f32;
        assert_eq!(motors.throttles(&[f32::NAN, -1.0, 2.0 * limit, 0.0]), [0.0, 0.0, 1.0, 0.0]);
        assert_eq!(motors.rotor_targets(&[f32::NAN, -0.5, 1.5, 1.0]), [0.0, 0.0, limit, limit]);
        assert_eq!(
            motors.rotor_targets(&[f32::INFINITY, f32::NEG_INFINITY, 0.0, 0.5]),
            [0.0, 0.0, 0.0, 0.5 * limit]
        );

        for (pulse_us, throttle) in [(0.0, 0.0), (1000.0, 0.0), (1250.0, 0.25), (2000.0, 1.0), (65535.0, 1.0)] {
            assert_eq!(throttle_of_pulse(pulse_us), throttle);
        }
        assert_eq!(throttle_of_pulse(f32::NAN), 0.0);
    }

    #[test]
    fn full_throttle_is_the_thrust_that_an_autopilot_takes_it_for() {
        let motors = Motors::new(&CF2X, MotorOrder::Crazyflie, ThrustCurve::PX4).unwrap();
        let thrust = |speed: f32| CF2X.thrust_coefficient * f64::from(speed).powi(2);
        let firmware = motors.with_greatest_thrust(0.12, &CF2X);
        assert!((thrust(firmware.rotor_targets(&[1.0; 4])[0]) - 0.12).abs() < 1e-6);
        assert!((thrust(firmware.rotor_targets(&[0.25; 4])[0]) - 0.03).abs() < 1e-6);
        let stronger = motors.with_greatest_thrust(1.0, &CF2X);
        assert_eq!(stronger.rotor_targets(&[1.0; 4]), [CF2X.rotor_speed_limit as f32; 4]);
    }

    #[test]
    fn half_the_throttle_is_the_thrust_that_each_autopilot_expects() {
        for (curve, share) in
            [(ThrustCurve::PX4, 0.5), (ThrustCurve::ARDUPILOT, 0.3375), (ThrustCurve::BETAFLIGHT, 0.25)]
        {
            let motors = Motors::new(&CF2X, MotorOrder::QuadX, curve).unwrap();
            let speed = motors.rotor_targets(&[0.5; 4])[0] / CF2X.rotor_speed_limit as f32;
            assert!((speed * speed - share).abs() < 1e-6);
        }
    }

    proptest! {
        #[test]
        fn throttles_come_back(throttles in proptest::array::uniform4(0.0_f32..=1.0)) {
            for curve in [ThrustCurve::PX4, ThrustCurve::ARDUPILOT, ThrustCurve::BETAFLIGHT] {
                for order in [MotorOrder::QuadX, MotorOrder::Crazyflie, MotorOrder::Betaflight] {
                    let motors = Motors::new(&CF2X, order, curve).unwrap();
                    let back = motors.throttles(&motors.rotor_targets(&throttles));
                    for (back, throttle) in back.iter().zip(throttles) {
                        prop_assert!((back - throttle).abs() < 1e-5);
                    }
                }
            }
        }

        #[test]
        fn whatever_is_commanded_rotor_targets_stay_in_range(throttles in proptest::array::uniform4(any::<f32>())) {
            let motors = Motors::new(&CF2X, MotorOrder::QuadX, ThrustCurve::ARDUPILOT).unwrap();
            let targets = motors.rotor_targets(&throttles);
            prop_assert!(targets.iter().all(|target| (0.0..=CF2X.rotor_speed_limit as f32).contains(target)));
        }
    }
}
