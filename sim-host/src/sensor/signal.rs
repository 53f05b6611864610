//! What each instrument would deliver if it was perfect.

use nalgebra::Vector3;

use super::Truth;

/// Farther ground does not move in the picture of an optical-flow sensor \[m\]: 10 m/s are 0.1 rad/s there.
const FLOW_REACH: f64 = 100.0;

/// What an instrument measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Signal {
    /// Body rates \[rad/s\]: a gyroscope.
    BodyRates,
    /// Specific force \[m/s²\], body: an accelerometer at the centre of mass.
    SpecificForce,
    /// How fast the ground below passes through the picture \[rad/s\], along body x and y, as if the drone did not
    /// turn about z: `v_x / d − ω_y` and `v_y / d + ω_x` at the distance d along the body's −z (the model of the
    /// Crazyflie firmware, `mm_flow.c`, which writes d as height over cosine).
    Flow {
        /// Nearer ground is out of focus and gives no sample \[m\].
        nearest: f64,
    },
    /// Distance to the nearest thing along one ray from the centre of mass \[m\], infinite if there is none.
    Distance {
        /// Which way.
        direction: Direction,
        /// Nothing farther is seen \[m\].
        limit: f64,
    },
    /// Height above z = 0 \[m\]: a barometer after its conversion.
    Height,
}

/// The axes of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
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

impl Direction {
    /// As a unit vector, body.
    pub fn in_body(self) -> Vector3<f64> {
        match self {
            Self::Front => Vector3::x(),
            Self::Back => -Vector3::x(),
            Self::Left => Vector3::y(),
            Self::Right => -Vector3::y(),
            Self::Up => Vector3::z(),
            Self::Down => -Vector3::z(),
        }
    }
}

impl Signal {
    /// Number of values.
    pub const fn width(&self) -> usize {
        match self {
            Self::BodyRates | Self::SpecificForce => 3,
            Self::Flow { .. } => 2,
            Self::Distance { .. } | Self::Height => 1,
        }
    }

    /// The true values, in the first [`Self::width`] places; nothing where the instrument would see nothing.
    pub(super) fn of(&self, truth: &Truth<'_>) -> Option<[f64; 3]> {
        match *self {
            Self::BodyRates => Some(truth.state.body_rates.into()),
            Self::SpecificForce => Some(truth.specific_force_in_body.into()),
            Self::Flow { nearest } => flow(truth, nearest),
            Self::Distance { direction, limit } => {
                Some([truth.distance(direction, limit).unwrap_or(f64::INFINITY), 0.0, 0.0])
            }
            Self::Height => Some([truth.state.position.z, 0.0, 0.0]),
        }
    }
}

fn flow(truth: &Truth<'_>, nearest: f64) -> Option<[f64; 3]> {
    let distance = truth.distance(Direction::Down, FLOW_REACH).unwrap_or(f64::INFINITY);
    let velocity = truth.state.world_from_body.rotate_inverse(truth.state.velocity);
    let rates = truth.state.body_rates;
    (distance >= nearest).then(|| [velocity.x / distance - rates.y, velocity.y / distance + rates.x, 0.0])
}

impl Truth<'_> {
    /// Distance to the nearest thing in a direction \[m\], if it is within `limit` \[m\].
    fn distance(&self, direction: Direction, limit: f64) -> Option<f64> {
        let origin = self.state.position;
        let direction = self.state.world_from_body.rotate(direction.in_body());
        match self.raycast {
            Some(raycast) => raycast(origin, direction, limit),
            None => to_floor(origin.z, direction.z).filter(|distance| *distance <= limit),
        }
    }
}

/// Distance along a ray that descends by `-slope` \[m/m\] from `height` \[m\] to z = 0.
fn to_floor(height: f64, slope: f64) -> Option<f64> {
    (slope < 0.0 && height >= 0.0).then(|| height / -slope)
}
