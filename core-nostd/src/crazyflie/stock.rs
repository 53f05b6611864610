//! Either of the controllers.

use nalgebra::Vector3;

use super::{Cascade, Mellinger, Mix};
use crate::real::Real;
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// Which of the controllers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StockController {
    /// PID loops, the default.
    Cascade,
    /// Mellinger's.
    Mellinger,
}

impl StockController {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Cascade, Self::Mellinger];
}

/// One of the controllers at work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StockPilot<R> {
    /// PID loops.
    Cascade(Cascade<R>),
    /// Mellinger's.
    Mellinger(Mellinger<R>),
}

impl<R: Real> StockPilot<R> {
    /// Takes over a drone that it believes to have this mass \[kg\]; the cascade knows none.
    pub fn begun(controller: StockController, mass_kg: f64, state: &State<R>) -> Self {
        match controller {
            StockController::Cascade => Self::Cascade(Cascade::begun(state)),
            StockController::Mellinger => Self::Mellinger(Mellinger::new(mass_kg)),
        }
    }

    /// [`Cascade::mix`] or [`Mellinger::mix`].
    pub fn mix(&mut self, state: &State<R>, setpoint: &Setpoint<R>, acceleration: &Vector3<R>) -> Mix<R> {
        match self {
            Self::Cascade(cascade) => cascade.mix(state, setpoint),
            Self::Mellinger(mellinger) => mellinger.mix(state, setpoint, acceleration),
        }
    }
}
