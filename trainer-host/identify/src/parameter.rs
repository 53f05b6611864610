//! The numbers that flights may tell, one line each.

use crate::drone::{Drone, Trim, summed_hover_speed, typical, typical_drag};

/// A number of the drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Parameter {
    /// Greatest rotor speed.
    RotorSpeedLimit,
    /// Thrust per squared rotor speed.
    ThrustCoefficient,
    /// Where the line from command to rotor speed begins.
    IdleShare,
    /// Voltage at which the greatest command gives the greatest speed.
    FullVolts,
    /// Time constant of a rotor that speeds up.
    RotorRise,
    /// Time constant of a rotor that slows down.
    RotorFall,
    /// From command to motor.
    Delay,
    /// Rotor drag across the thrust.
    PlanarDrag,
    /// Rotor drag along the thrust.
    AxialDrag,
    /// Quadratic drag of the body.
    BodyDrag,
    /// Moment by air speed.
    FlappingMoment,
    /// Moment of inertia about x.
    InertiaX,
    /// Moment of inertia about y.
    InertiaY,
    /// Moment of inertia about z.
    InertiaZ,
    /// Reaction torque per squared rotor speed.
    TorqueCoefficient,
    /// Inertia of a rotor about its axis.
    RotorInertia,
    /// Moment against a rate about x.
    RateDampingX,
    /// Moment against a rate about y.
    RateDampingY,
    /// Moment against a rate about z.
    RateDampingZ,
}

/// How a number is searched, and how far from where it begins a drone's may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scale {
    /// Positive: its logarithm.
    Logarithmic {
        /// Standard deviation of the logarithm.
        spread: f64,
    },
    /// Any number.
    Linear {
        /// Standard deviation.
        spread: f64,
        /// Step of differences.
        step: f64,
    },
}

/// Step of differences of a logarithm.
const LOGARITHMIC_STEP: f64 = 1e-3;

impl Scale {
    pub(crate) const fn step(self) -> f64 {
        match self {
            Self::Logarithmic { .. } => LOGARITHMIC_STEP,
            Self::Linear { step, .. } => step,
        }
    }

    pub(crate) const fn spread(self) -> f64 {
        match self {
            Self::Logarithmic { spread } | Self::Linear { spread, .. } => spread,
        }
    }
}

impl Parameter {
    /// All of them. Of two that only count together, the later is kept as given.
    pub const ALL: [Self; 19] = [
        Self::RotorSpeedLimit,
        Self::ThrustCoefficient,
        Self::RotorRise,
        Self::RotorFall,
        Self::InertiaX,
        Self::InertiaY,
        Self::TorqueCoefficient,
        Self::RotorInertia,
        Self::RateDampingX,
        Self::RateDampingY,
        Self::RateDampingZ,
        Self::FlappingMoment,
        Self::PlanarDrag,
        Self::AxialDrag,
        Self::IdleShare,
        Self::Delay,
        Self::BodyDrag,
        Self::FullVolts,
        Self::InertiaZ,
    ];

    /// As in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::RotorSpeedLimit => "rotor speed limit",
            Self::ThrustCoefficient => "thrust coefficient",
            Self::IdleShare => "idle share of the speed",
            Self::FullVolts => "voltage of that limit",
            Self::RotorRise => "rotor rise",
            Self::RotorFall => "rotor fall",
            Self::Delay => "delay of the motors",
            Self::PlanarDrag => "rotor drag, planar",
            Self::AxialDrag => "rotor drag, axial",
            Self::BodyDrag => "body drag, quadratic",
            Self::FlappingMoment => "flapping moment",
            Self::InertiaX => "inertia about x",
            Self::InertiaY => "inertia about y",
            Self::InertiaZ => "inertia about z",
            Self::TorqueCoefficient => "torque coefficient",
            Self::RotorInertia => "rotor inertia",
            Self::RateDampingX => "rate damping about x",
            Self::RateDampingY => "rate damping about y",
            Self::RateDampingZ => "rate damping about z",
        }
    }

    /// Unit of [`Self::value`].
    pub const fn unit(self) -> &'static str {
        match self {
            Self::RotorSpeedLimit => "rad/s",
            Self::ThrustCoefficient => "N s²/rad²",
            Self::IdleShare => "",
            Self::FullVolts => "V",
            Self::RotorRise | Self::RotorFall | Self::Delay => "s",
            Self::PlanarDrag | Self::AxialDrag => "kg/rad",
            Self::BodyDrag => "N s²/m²",
            Self::FlappingMoment => "N s²/rad",
            Self::InertiaX | Self::InertiaY | Self::InertiaZ | Self::RotorInertia => "kg m²",
            Self::TorqueCoefficient => "N m s²/rad²",
            Self::RateDampingX | Self::RateDampingY | Self::RateDampingZ => "N m s/rad",
        }
    }

    /// Its value of a drone, in SI units.
    pub fn value(self, drone: &Drone) -> f64 {
        *self.place(&mut drone.clone())
    }

    /// Makes it the drone's.
    pub(crate) fn set(self, drone: &mut Drone, value: f64) {
        *self.place(drone) = value;
    }

    fn place(self, drone: &mut Drone) -> &mut f64 {
        let (airframe, curve) = (&mut drone.airframe, &mut drone.thrust_curve);
        match self {
            Self::RotorSpeedLimit => &mut airframe.rotor_speed_limit,
            Self::ThrustCoefficient => &mut airframe.thrust_coefficient,
            Self::IdleShare => &mut curve.idle_share,
            Self::FullVolts => &mut curve.full_volts,
            Self::RotorRise => &mut airframe.rotor_rise_secs,
            Self::RotorFall => &mut airframe.rotor_fall_secs,
            Self::Delay => &mut curve.delay_secs,
            Self::PlanarDrag => &mut airframe.drag_coefficients.planar,
            Self::AxialDrag => &mut airframe.drag_coefficients.axial,
            Self::BodyDrag => &mut airframe.effects.body_drag,
            Self::FlappingMoment => &mut airframe.effects.flapping_moment,
            Self::InertiaX => &mut airframe.inertia[0],
            Self::InertiaY => &mut airframe.inertia[1],
            Self::InertiaZ => &mut airframe.inertia[2],
            Self::TorqueCoefficient => &mut airframe.torque_coefficient,
            Self::RotorInertia => &mut airframe.effects.rotor_inertia,
            Self::RateDampingX => &mut airframe.effects.rate_damping[0],
            Self::RateDampingY => &mut airframe.effects.rate_damping[1],
            Self::RateDampingZ => &mut airframe.effects.rate_damping[2],
        }
    }

    /// A factor of three is within what drones of a kind differ by where nothing is known; lags, speeds and voltages are
    /// known better.
    pub(crate) const fn scale(self) -> Scale {
        match self {
            Self::IdleShare => Scale::Linear { spread: 0.2, step: 1e-3 },
            Self::Delay => Scale::Linear { spread: 0.02, step: 5e-5 },
            Self::FullVolts => Scale::Logarithmic { spread: 0.3 },
            Self::RotorSpeedLimit
            | Self::ThrustCoefficient
            | Self::RotorRise
            | Self::RotorFall
            | Self::PlanarDrag
            | Self::AxialDrag
            | Self::BodyDrag
            | Self::FlappingMoment
            | Self::InertiaX
            | Self::InertiaY
            | Self::InertiaZ
            | Self::TorqueCoefficient
            | Self::RotorInertia
            | Self::RateDampingX
            | Self::RateDampingY
            | Self::RateDampingZ => Scale::Logarithmic { spread: 1.0 },
        }
    }

    /// Where the search begins: the drone's value, or a small drone's where it has none of it.
    pub(crate) fn start(self, drone: &Drone) -> f64 {
        let (value, airframe) = (self.value(drone), &drone.airframe);
        if value != 0.0 {
            return value;
        }
        match self {
            Self::PlanarDrag | Self::AxialDrag => typical_drag(airframe),
            // A tenth of the drag at 1 m/s.
            Self::BodyDrag => 0.1 * typical_drag(airframe) * summed_hover_speed(airframe),
            // What real flights of a Crazyflie show: 10 rad/s² per m/s, 3 1/s, a thousandth of the drone's inertia.
            Self::FlappingMoment => typical(airframe, 10.0) / summed_hover_speed(airframe),
            Self::RateDampingX | Self::RateDampingY | Self::RateDampingZ => typical(airframe, 3.0),
            Self::RotorInertia => typical(airframe, 1e-3),
            Self::RotorSpeedLimit
            | Self::ThrustCoefficient
            | Self::IdleShare
            | Self::FullVolts
            | Self::RotorRise
            | Self::RotorFall
            | Self::Delay
            | Self::InertiaX
            | Self::InertiaY
            | Self::InertiaZ
            | Self::TorqueCoefficient => value,
        }
    }

    /// `value` moved by `change` on its scale.
    pub(crate) fn moved(self, value: f64, change: f64) -> f64 {
        match self.scale() {
            Scale::Logarithmic { .. } => value * change.exp(),
            Scale::Linear { .. } => value + change,
        }
    }

    /// How far `value` is from `origin` on its scale.
    pub(crate) fn distance(self, value: f64, origin: f64) -> f64 {
        match self.scale() {
            Scale::Logarithmic { .. } => (value / origin).ln(),
            Scale::Linear { .. } => value - origin,
        }
    }

    /// Bounds of the 95 % interval of a value known to `deviation` on its scale.
    pub fn interval(self, value: f64, deviation: f64) -> [f64; 2] {
        [-1.96, 1.96].map(|share| self.moved(value, share * deviation))
    }

    /// Greatest deviation on its scale of a number that the flights are said to tell.
    pub(crate) const fn told_within(self) -> f64 {
        match self.scale() {
            Scale::Logarithmic { .. } => 0.5,
            Scale::Linear { spread, .. } => 0.5 * spread,
        }
    }
}

/// A number of a flight's [`Trim`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TrimPart {
    Torque(usize),
    Tilt(usize),
    Charge,
    Discharge,
}

impl TrimPart {
    pub(crate) fn place(self, trim: &mut Trim) -> &mut f64 {
        match self {
            Self::Torque(axis) => &mut trim.torque[axis],
            Self::Tilt(axis) => &mut trim.tilt[axis],
            Self::Charge => &mut trim.charge,
            Self::Discharge => &mut trim.discharge_per_sec,
        }
    }

    /// What flights differ by: a gram beside the centre, three degrees of a marker, an eighth of a volt, a volt in five
    /// minutes.
    pub(crate) const fn spread(self) -> f64 {
        match self {
            Self::Torque(_) => 15.0,
            Self::Tilt(_) => 0.05,
            Self::Charge => 0.03,
            Self::Discharge => 0.003,
        }
    }

    /// Step of differences.
    pub(crate) const fn step(self) -> f64 {
        1e-3 * self.spread()
    }
}
