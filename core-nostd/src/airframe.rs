//! Constants of the airframes, each with its source.

use serde::{Deserialize, Serialize};

/// Standard gravity of the reference system \[m/s²\] (gym-pybullet-drones uses 9.8, not 9.81).
pub const GRAVITY: f64 = 9.8;

/// Radians per second of one revolution per minute.
pub const RADIANS_PER_SECOND_PER_RPM: f64 = core::f64::consts::TAU / 60.0;

/// What a drone is made of, in SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Airframe {
    /// Take-off mass \[kg\].
    pub mass: f64,
    /// Principal moments of inertia about body x, y, z \[kg m²\].
    pub inertia: [f64; 3],
    /// Where the rotors are.
    pub layout: Layout,
    /// Which way round the rotors are numbered.
    pub rotor_order: RotorOrder,
    /// Nominal distance of a rotor from the centre \[m\]. The reference's controllers and its DYN model turn the
    /// drone by this lever; for the Crazyflie it differs by 0.3 % from [`Self::layout`].
    pub arm: f64,
    /// Thrust of one rotor per squared speed \[N s²/rad²\].
    pub thrust_coefficient: f64,
    /// Reaction torque of one rotor per squared speed \[N m s²/rad²\]; negative where the first and third rotor
    /// turn clockwise.
    pub torque_coefficient: f64,
    /// Greatest speed of a rotor \[rad/s\].
    pub rotor_speed_limit: f64,
    /// First-order time constant of a rotor that speeds up \[s\].
    pub rotor_rise_secs: f64,
    /// First-order time constant of a rotor that slows down \[s\].
    pub rotor_fall_secs: f64,
    /// Rotor drag across and along the body z axis, per summed rotor speed \[N s²/(m rad)\].
    pub drag_coefficients: DragCoefficients,
    /// Propeller radius \[m\].
    pub propeller_radius: f64,
    /// Strength of the ground effect, dimensionless.
    pub ground_effect_coefficient: f64,
    /// Downwash below the drone.
    pub downwash: Downwash,
    /// Radius of the collision cylinder \[m\].
    pub collision_radius: f64,
    /// Height of the collision cylinder \[m\].
    pub collision_height: f64,
    /// Height of the collision cylinder's centre above the centre of mass \[m\].
    pub collision_offset: f64,
    /// Speed that the maker states \[m/s\]; the reference's velocity action is a share of it.
    pub nominal_speed: f64,
    /// What real flights show beside thrust and rotor drag; policy files do not hold it.
    #[serde(skip)]
    pub effects: FlightEffects,
}

/// Forces and moments of a real drone that the reference's model leaves out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlightEffects {
    /// Moment about body x and y per air speed across the rotors and summed rotor speed \[N s²/rad\]: blade flapping,
    /// and drag above the centre of mass. It lifts the side that meets the air.
    pub flapping_moment: f64,
    /// Moment about body x, y, z against a body rate \[N m s/rad\].
    pub rate_damping: [f64; 3],
    /// Inertia of a rotor and what turns with it, about its axis \[kg m²\]: it reacts to a change of speed, and its
    /// momentum turns with the body.
    pub rotor_inertia: f64,
    /// Drag of the body per squared air speed \[N s²/m²\].
    pub body_drag: f64,
    /// Share of a commanded rotor speed that the battery's resistance costs at full thrust.
    pub battery_sag: f64,
}

impl FlightEffects {
    /// As the reference has it.
    pub const NONE: Self = Self {
        flapping_moment: 0.0,
        rate_damping: [0.0; 3],
        rotor_inertia: 0.0,
        body_drag: 0.0,
        battery_sag: 0.0,
    };
}

/// Which way round the rotors are numbered, seen from above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RotorOrder {
    /// As on the Crazyflie, and in gym-pybullet-drones' `cf2x` since August 2025.
    Clockwise,
    /// The mirror image: its `cf2p`, `hb` and `racer`, and `cf2x` before that date (the thesis's fork).
    CounterClockwise,
}

impl RotorOrder {
    /// Sign of a rotor's lateral position relative to the clockwise order.
    pub const fn side(self) -> f64 {
        match self {
            Self::Clockwise => 1.0,
            Self::CounterClockwise => -1.0,
        }
    }
}

/// Rotors in the body plane, named here in [`RotorOrder::Clockwise`]; the first and third turn counter-clockwise,
/// so that their reaction pushes the nose to the right.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Layout {
    /// Front right, rear right, rear left, front left.
    Cross {
        /// Distance of every rotor from the body y axis \[m\].
        x: f64,
        /// Distance of every rotor from the body x axis \[m\].
        y: f64,
    },
    /// Front, right, rear, left.
    Plus {
        /// Distance of every rotor from the centre \[m\].
        arm: f64,
    },
}

impl Layout {
    /// Sign of each rotor's reaction torque about body z.
    pub const TORQUE_SIGNS: [f64; 4] = [-1.0, 1.0, -1.0, 1.0];

    /// Rotor positions `[x, y]`, body \[m\].
    pub const fn rotor_positions(&self, order: RotorOrder) -> [[f64; 2]; 4] {
        let side = order.side();
        match *self {
            Self::Cross { x, y } => [[x, -side * y], [-x, -side * y], [-x, side * y], [x, side * y]],
            Self::Plus { arm } => [[arm, 0.0], [0.0, -side * arm], [-arm, 0.0], [0.0, side * arm]],
        }
    }

    /// The same shape with every rotor `arm` \[m\] from the centre, a cross being square.
    #[must_use]
    pub const fn with_arm(&self, arm: f64) -> Self {
        let half_diagonal = arm * core::f64::consts::FRAC_1_SQRT_2;
        match self {
            Self::Cross { .. } => Self::Cross { x: half_diagonal, y: half_diagonal },
            Self::Plus { .. } => Self::Plus { arm },
        }
    }
}

/// Rotor drag (Förster 2015), equal along body x and y.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DragCoefficients {
    /// Along body x and y \[N s²/(m rad)\].
    pub planar: f64,
    /// Along body z \[N s²/(m rad)\].
    pub axial: f64,
}

/// Downwash model of gym-pybullet-drones: a Gaussian jet whose strength falls with the square of the distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Downwash {
    /// Strength \[N\] at a distance of a quarter propeller radius.
    pub strength: f64,
    /// Growth of the jet's width with depth \[m/m\].
    pub width_slope: f64,
    /// Width of the jet extrapolated to the rotor plane \[m\].
    pub width_offset: f64,
}

impl Airframe {
    /// Rotor speed at which four rotors carry the weight \[rad/s\].
    pub fn hover_rotor_speed(&self) -> f64 {
        libm::sqrt(self.mass * GRAVITY / (4.0 * self.thrust_coefficient))
    }

    /// Rotor positions `[x, y]` in their order, body \[m\].
    pub const fn rotor_positions(&self) -> [[f64; 2]; 4] {
        self.layout.rotor_positions(self.rotor_order)
    }

    /// The same drone with its rotors numbered the other way round or not.
    #[must_use]
    pub const fn numbered(self, rotor_order: RotorOrder) -> Self {
        Self { rotor_order, ..self }
    }

    /// Weight \[N\].
    pub fn weight(&self) -> f64 {
        self.mass * GRAVITY
    }

    /// Greatest torque about body x and y as the reference counts it: two rotors of a cross, one of a plus \[N m\].
    pub fn tilting_torque_limit(&self) -> f64 {
        let lever = match self.layout {
            Layout::Cross { .. } => core::f64::consts::SQRT_2 * self.arm,
            Layout::Plus { .. } => self.arm,
        };
        lever * self.thrust_limit() / 4.0
    }

    /// Greatest torque about body z \[N m\]: two rotors at full speed.
    pub fn turning_torque_limit(&self) -> f64 {
        2.0 * self.torque_coefficient.abs() * self.rotor_speed_limit * self.rotor_speed_limit
    }

    /// Height of the centre of mass in the reference's default start \[m\]: 0.1 m under the collision cylinder.
    pub fn start_height(&self) -> f64 {
        self.collision_height / 2.0 - self.collision_offset + 0.1
    }

    /// Thrust of all rotors at full speed \[N\].
    pub fn thrust_limit(&self) -> f64 {
        4.0 * self.thrust_coefficient * self.rotor_speed_limit * self.rotor_speed_limit
    }
}

const fn per_rpm_squared(coefficient: f64) -> f64 {
    coefficient / (RADIANS_PER_SECOND_PER_RPM * RADIANS_PER_SECOND_PER_RPM)
}

/// Crazyflie 2.x flying with an X layout.
///
/// Mass, inertia, rotor, drag, ground-effect and downwash numbers: `cf2x.urdf` of gym-pybullet-drones (after
/// Förster 2015 and Luis & Le Ny 2016; the layout is the one of its 2025 correction, which is the real drone's).
/// Rotor speed limit: its thrust-to-weight ratio of 2.25. Time constants: rl-tools' identification of the
/// Crazyflie (`l2f/parameters/dynamics/crazyflie.h`).
pub const CF2X: Airframe = Airframe {
    mass: 0.027,
    inertia: [1.4e-5, 1.4e-5, 2.17e-5],
    layout: Layout::Cross { x: 0.028, y: 0.028 },
    rotor_order: RotorOrder::Clockwise,
    arm: 0.0397,
    thrust_coefficient: per_rpm_squared(3.16e-10),
    torque_coefficient: per_rpm_squared(7.94e-12),
    rotor_speed_limit: 21_702.643_775_251_05 * RADIANS_PER_SECOND_PER_RPM,
    rotor_rise_secs: 0.069_090_909,
    rotor_fall_secs: 0.113_737_374,
    drag_coefficients: DragCoefficients { planar: 9.1785e-7, axial: 10.311e-7 },
    propeller_radius: 2.31348e-2,
    ground_effect_coefficient: 11.36859,
    downwash: Downwash { strength: 2267.18, width_slope: 0.16, width_offset: -0.11 },
    collision_radius: 0.06,
    collision_height: 0.025,
    collision_offset: 0.0,
    nominal_speed: 30.0 / 3.6,
    effects: FlightEffects::NONE,
};

/// Crazyflie 2.1 as it flies: [`CF2X`] with what flights of real ones show, as `kestrel identify` finds it.
///
/// Inertia about x and y, reaction torque, rotor inertia, rate damping, time constants and the rotors' greatest speed:
/// 1 kHz logs of motors, gyroscope and accelerometer (Eschmann 2024). Drag: motion capture (`NanoBench`, Ullah & Baca
/// 2026); the flapping moment is what both say. These flights tell ratios only: mass, thrust coefficient and lever are
/// [`CF2X`]'s, and the inertia about z is [`CF2P`]'s.
pub const CRAZYFLIE_2_1: Airframe = Airframe {
    inertia: [1.93e-5, 2.57e-5, 3.2347e-5],
    torque_coefficient: 1.69e-10,
    rotor_speed_limit: 2224.0,
    rotor_rise_secs: 0.065,
    rotor_fall_secs: 0.12,
    drag_coefficients: DragCoefficients { planar: 1.55e-6, axial: 2.0e-6 },
    effects: FlightEffects {
        flapping_moment: 4.8e-8,
        rate_damping: [1.6e-4, 1.7e-4, 5.4e-5],
        rotor_inertia: 4.6e-8,
        body_drag: 1.3e-3,
        battery_sag: 0.0,
    },
    ..CF2X
};

/// Crazyflie 2.1 Brushless as it flies, with deck, markers and battery, as `kestrel identify` finds it in flights with
/// motion capture and measured rotor speeds (Busetto et al. 2026, nano-drone benchmark).
///
/// `assets/airframes/crazyflie_2_1_brushless.yaml` says where each number comes from. Mass, lever and greatest thrust
/// (0.2 N a motor) are given; damping about z, ground effect and downwash are [`CRAZYFLIE_2_1`]'s.
pub const CRAZYFLIE_2_1_BRUSHLESS: Airframe = Airframe {
    mass: 0.045,
    inertia: [3.04e-5, 3.28e-5, 5.8e-5],
    layout: Layout::Cross { x: 0.035_355_3, y: 0.035_355_3 },
    arm: 0.05,
    thrust_coefficient: 3.749e-8,
    torque_coefficient: 1.59e-10,
    rotor_speed_limit: 2310.0,
    rotor_rise_secs: 0.065,
    rotor_fall_secs: 0.065,
    drag_coefficients: DragCoefficients { planar: 2.18e-6, axial: 3.28e-6 },
    propeller_radius: 0.0275,
    collision_radius: 0.078,
    collision_height: 0.035,
    effects: FlightEffects {
        flapping_moment: 1.09e-7,
        rate_damping: [5.3e-5, 5.3e-5, 5.4e-5],
        rotor_inertia: 6.15e-8,
        body_drag: 8.4e-4,
        battery_sag: 0.0,
    },
    ..CRAZYFLIE_2_1
};

/// Crazyflie 2.1+: the Crazyflie 2.1 with the propellers 47-17 and their battery.
///
/// Mass, lever and the thrust at which the rotors are limited: crazyflie-firmware (`CF_MASS`, `ARM_LENGTH` and `THRUST_MAX` of
/// `platform_defaults_cf2.h`). The rest: `cf2x_P250` of drone-models 0.1.0, rotors on a load cell as by the firmware's
/// `tools/system_id`, drag in flight; what depends on the rotors' speed there is as it is at hover.
pub const CRAZYFLIE_2_1_PLUS: Airframe = Airframe {
    mass: 0.029,
    inertia: [1.68e-5, 1.68e-5, 2.98e-5],
    layout: Layout::Cross { x: 0.03253, y: 0.03253 },
    arm: 0.046,
    thrust_coefficient: per_rpm_squared(1.443e-10),
    torque_coefficient: per_rpm_squared(1.009e-12),
    rotor_speed_limit: 28_837.5 * RADIANS_PER_SECOND_PER_RPM,
    rotor_rise_secs: 0.114,
    rotor_fall_secs: 0.108,
    drag_coefficients: DragCoefficients { planar: 1.454e-6, axial: 1.805e-6 },
    propeller_radius: 0.0234,
    effects: FlightEffects { rotor_inertia: 2.697e-8, ..FlightEffects::NONE },
    ..CF2X
};

/// Crazyflie 2.1 with the thrust upgrade kit, longer motors and propellers and a battery of 350 mAh: as
/// [`CRAZYFLIE_2_1_PLUS`], from `cf2x_T350`.
pub const CRAZYFLIE_2_1_THRUST_UPGRADE: Airframe = Airframe {
    mass: 0.0325,
    thrust_coefficient: per_rpm_squared(2.536e-10),
    torque_coefficient: per_rpm_squared(1.358e-12),
    rotor_speed_limit: 26_641.7 * RADIANS_PER_SECOND_PER_RPM,
    rotor_rise_secs: 0.0879,
    rotor_fall_secs: 0.0745,
    drag_coefficients: DragCoefficients { planar: 2.097e-6, axial: 2.953e-6 },
    propeller_radius: 0.0254,
    effects: FlightEffects { rotor_inertia: 3.893e-8, ..FlightEffects::NONE },
    ..CRAZYFLIE_2_1_PLUS
};

/// A quadrotor of 5-inch propellers, as the Crazyflie Bolt flies them.
///
/// Bitcraze publishes no such build. Mass, inertia, layout and rotors: the drone of Agilicious (Foehn et al. 2022), 752 g
/// with its computer; the Bolt, 9 g, takes the place of its flight controller. Drag, ground effect and downwash are not
/// published; the rotors' inertia is that of a rod of 4 g, 127 mm long.
pub const BOLT_5_INCH: Airframe = Airframe {
    mass: 0.752,
    inertia: [2.5e-3, 2.1e-3, 4.3e-3],
    layout: Layout::Cross { x: 0.075, y: 0.1 },
    arm: 0.125,
    thrust_coefficient: per_rpm_squared(1.7135e-8),
    torque_coefficient: per_rpm_squared(3.7697e-10),
    rotor_speed_limit: 26_738.0 * RADIANS_PER_SECOND_PER_RPM,
    rotor_rise_secs: 0.033,
    rotor_fall_secs: 0.033,
    drag_coefficients: DragCoefficients { planar: 0.0, axial: 0.0 },
    propeller_radius: 0.0635,
    ground_effect_coefficient: 0.0,
    downwash: Downwash { strength: 0.0, width_slope: 0.0, width_offset: 1.0 },
    collision_radius: 0.1885,
    collision_height: 0.1,
    nominal_speed: 100.0 / 3.6,
    effects: FlightEffects { rotor_inertia: 5.4e-6, ..FlightEffects::NONE },
    ..CF2X
};

/// Holybro X500 v2 as PX4's Gazebo flies it (`x500` of PX4-gazebo-models).
///
/// Mass and inertia: body and rotors; drag along the rotors is that of Gazebo's loss of thrust at hover. Ground effect and
/// downwash: [`CF2X`]'s, for want of a measurement.
pub const X500: Airframe = Airframe {
    mass: 2.064_307_692_307_692,
    inertia: [0.023_846_67, 0.023_846_67, 0.043_999_96],
    layout: Layout::Cross { x: 0.174, y: 0.174 },
    arm: 0.24607,
    thrust_coefficient: per_rpm_squared(9.374_566_976_784_94e-8),
    torque_coefficient: per_rpm_squared(1.499_930_716_285_590_2e-9),
    rotor_speed_limit: 9_549.296_585_513_72 * RADIANS_PER_SECOND_PER_RPM,
    rotor_rise_secs: 0.0125,
    rotor_fall_secs: 0.025,
    drag_coefficients: DragCoefficients { planar: 8.06428e-5, axial: 2.63e-4 },
    propeller_radius: 0.14,
    collision_radius: 0.386,
    collision_height: 0.29,
    collision_offset: -0.082,
    nominal_speed: 43.0 / 3.6,
    ..CF2X
};

/// Crazyflie 2.x flying with a plus layout: `cf2p.urdf` of gym-pybullet-drones, but with the rotors clockwise from
/// the front (the reference has them the other way round: [`Airframe::numbered`]).
pub const CF2P: Airframe =
    Airframe { inertia: [2.3951e-5, 2.3951e-5, 3.2347e-5], layout: Layout::Plus { arm: 0.0397 }, ..CF2X };

/// `AscTec` Hummingbird: `hb.urdf` of gym-pybullet-drones before 2023, which knows no drag, ground effect or downwash
/// of it. Rotor speed limit: its thrust-to-weight ratio of 2. The rotors' time constants are the Crazyflie's,
/// stretched by the ratio of the hover speeds (4477.6 against 14468.4 RPM), for want of a measurement.
pub const HUMMINGBIRD: Airframe = Airframe {
    mass: 0.5,
    inertia: [0.0023, 0.0023, 0.004],
    layout: Layout::Plus { arm: 0.175 },
    rotor_order: RotorOrder::CounterClockwise,
    arm: 0.175,
    thrust_coefficient: per_rpm_squared(6.11e-8),
    torque_coefficient: per_rpm_squared(1.5e-9),
    rotor_speed_limit: 6_332.313_927_204_475_5 * RADIANS_PER_SECOND_PER_RPM,
    rotor_rise_secs: 3.231_275 * CF2X.rotor_rise_secs,
    rotor_fall_secs: 3.231_275 * CF2X.rotor_fall_secs,
    drag_coefficients: DragCoefficients { planar: 0.0, axial: 0.0 },
    propeller_radius: 0.0,
    ground_effect_coefficient: 0.0,
    downwash: Downwash { strength: 0.0, width_slope: 0.0, width_offset: 1.0 },
    collision_radius: 0.25,
    collision_height: 0.15,
    collision_offset: -0.075,
    nominal_speed: 50.0 / 3.6,
    effects: FlightEffects::NONE,
};

/// Racing quadrotor of gym-pybullet-drones 2.x: `racer.urdf`; drag, ground effect, downwash and collision numbers are
/// the Crazyflie's there too, and its rotors turn the other way. Rotor speed limit: its thrust-to-weight ratio of
/// 4.17. The rotors' time constants are the Crazyflie's, for want of a measurement.
pub const RACER: Airframe = Airframe {
    mass: 0.830,
    inertia: [0.003_113, 0.003_113, 0.003_113],
    layout: Layout::Cross { x: 0.085, y: 0.0675 },
    rotor_order: RotorOrder::CounterClockwise,
    arm: 0.109,
    thrust_coefficient: per_rpm_squared(8.47e-9),
    torque_coefficient: -per_rpm_squared(2.13e-11),
    rotor_speed_limit: 31_640.869_585_066_295 * RADIANS_PER_SECOND_PER_RPM,
    propeller_radius: 12.7e-2,
    nominal_speed: 200.0 / 3.6,
    ..CF2X
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derived_constants_are_the_references() {
        // Section 1.2 of its fact sheet; RPM are turned into rad/s.
        let near = |value: f64, expected: f64| (value / expected - 1.0).abs() < 1e-9;
        assert!(near(CF2X.hover_rotor_speed() / RADIANS_PER_SECOND_PER_RPM, 14_468.429_183_500_699));
        assert!(near(HUMMINGBIRD.hover_rotor_speed() / RADIANS_PER_SECOND_PER_RPM, 4_477.622_118_528_302));
        assert!(near(CF2X.thrust_limit(), 0.595_35) && near(HUMMINGBIRD.thrust_limit(), 9.8));
        assert!(near(RACER.thrust_limit(), 4.17 * RACER.weight()));
        assert!(near(CF2X.tilting_torque_limit(), 0.008_356_374_040_261_31));
        assert!(
            near(CF2P.tilting_torque_limit(), 0.005_908_848_75)
                && near(HUMMINGBIRD.tilting_torque_limit(), 0.428_75)
        );
        assert!(near(CF2X.turning_torque_limit(), 0.007_479_555_379_746_838));
        assert!(near(CF2X.start_height(), 0.1125) && near(HUMMINGBIRD.start_height(), 0.25));
    }

    #[test]
    fn crazyflies_thrust_is_what_their_firmware_permits() {
        // THRUST_MAX [N] of a motor, in crazyflie-firmware 2a18fc2.
        for (airframe, thrust_max) in [(CRAZYFLIE_2_1_PLUS, 0.12), (CRAZYFLIE_2_1_THRUST_UPGRADE, 0.18)] {
            assert!((airframe.thrust_limit() / (4.0 * thrust_max) - 1.0).abs() < 1e-5);
        }
        // As identified, more than that: its firmware cuts the top off.
        assert!((CRAZYFLIE_2_1.thrust_limit() / 4.0 - 0.1425).abs() < 1e-4);
    }

    #[test]
    fn the_other_order_is_the_mirror_image() {
        for airframe in [CF2X, CF2P] {
            let mirrored = airframe.numbered(RotorOrder::CounterClockwise);
            for ([x, y], [mirrored_x, mirrored_y]) in
                airframe.rotor_positions().into_iter().zip(mirrored.rotor_positions())
            {
                assert_eq!([x, -y], [mirrored_x, mirrored_y]);
            }
        }
    }
}
