//! What an observation is made of.

use nalgebra::Vector3;

use crate::limits::ACTION_LIMIT;
use crate::real::Real;
use crate::vehicle::State;

/// Everything that some layout shows of one drone.
#[derive(Clone, Copy, Debug)]
pub struct ObservationInput<'a, R> {
    /// Where the drone is and how it moves.
    pub state: &'a State<R>,
    /// Angular velocity \[rad/s\], world, as the physics reports it: not what the state has in the reference's DYN.
    pub angular_velocity_in_world: Vector3<R>,
    /// Where it should be \[m\], world.
    pub goal: &'a Vector3<R>,
    /// Where it should face: x and y of a unit vector, world.
    pub heading: [R; 2],
    /// The integral of the position error, world, as [`ObservationLayout::integrate`](super::ObservationLayout::integrate)
    /// sums it up.
    pub integral: &'a Vector3<R>,
    /// Past actions, the oldest first; the last is the previous action.
    pub history: &'a [[R; ACTION_LIMIT]],
    /// What its sensors deliver.
    pub measurements: &'a [R],
}

impl<R: Real> ObservationInput<'_, R> {
    /// The last action; zero before the first.
    #[inline(always)]
    pub fn previous_action(&self) -> [R; ACTION_LIMIT] {
        self.history.last().copied().unwrap_or([R::zero(); ACTION_LIMIT])
    }
}
