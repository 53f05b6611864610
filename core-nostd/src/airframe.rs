//! Constants of the airframes, each with its source.

/// Standard gravity of the reference system \[m/s²\] (gym-pybullet-drones uses 9.8, not 9.81).
pub const GRAVITY: f64 = 9.8;

/// Radians per second of one revolution per minute.
pub const RADIANS_PER_SECOND_PER_RPM: f64 = core::f64::consts::TAU / 60.0;

/// What a drone is made of, in SI units; rotors in the Crazyflie's own order (clockwise from front right).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Airframe {
    /// Take-off mass \[kg\].
    pub mass: f64,
    /// Principal moments of inertia about body x, y, z \[kg m²\].
    pub inertia: [f64; 3],
    /// Where the rotors are.
    pub layout: Layout,
    /// Thrust of one rotor per squared speed \[N s²/rad²\].
    pub thrust_coefficient: f64,
    /// Reaction torque of one rotor per squared speed \[N m s²/rad²\].
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
    /// Height of the collision cylinder, centred on the centre of mass \[m\].
    pub collision_height: f64,
}

/// Rotors in the body plane, clockwise seen from above; the first and third turn counter-clockwise, so that their
/// reaction pushes the nose to the right.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    pub const fn rotor_positions(&self) -> [[f64; 2]; 4] {
        match *self {
            Self::Cross { x, y } => [[x, -y], [-x, -y], [-x, y], [x, y]],
            Self::Plus { arm } => [[arm, 0.0], [0.0, -arm], [-arm, 0.0], [0.0, arm]],
        }
    }
}

/// Rotor drag (Förster 2015), equal along body x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DragCoefficients {
    /// Along body x and y \[N s²/(m rad)\].
    pub planar: f64,
    /// Along body z \[N s²/(m rad)\].
    pub axial: f64,
}

/// Downwash model of gym-pybullet-drones: a Gaussian jet whose strength falls with the square of the distance.
#[derive(Clone, Copy, Debug, PartialEq)]
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
};

/// Crazyflie 2.x flying with a plus layout: `cf2p.urdf` of gym-pybullet-drones, rotors clockwise from the front.
pub const CF2P: Airframe =
    Airframe { inertia: [2.3951e-5, 2.3951e-5, 3.2347e-5], layout: Layout::Plus { arm: 0.0397 }, ..CF2X };
