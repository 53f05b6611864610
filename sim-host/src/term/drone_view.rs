//! One drone, as reward terms and terminations of a user's own crate see it.

use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::contact::Touch;

/// One drone after a control period; world axes, SI units.
#[derive(Clone, Copy, Debug)]
pub struct DroneView<'a> {
    /// Its state.
    pub state: State<f64>,
    /// Where it shall go \[m\].
    pub goal: Vector3<f64>,
    /// Distance to the goal \[m\].
    pub distance: f64,
    /// The same one control period ago.
    pub previous_distance: f64,
    /// What the policy commanded in this control period, within \[-1, 1\] in Kestrel's own action spaces.
    pub action: &'a [f64],
    /// What it commanded in the one before; zeros in the first.
    pub previous_action: &'a [f64],
    /// What it touches.
    pub touch: Touch,
    /// A lower bound of its centre's distance to the nearest thing that never moves, up to two cells of a grid too small
    /// \[m\]; infinite where contacts are absent.
    pub clearance: f64,
    /// Which drone of its environment it is.
    pub agent: usize,
    /// Where all drones of its environment are \[m\], itself included.
    pub team: &'a [Vector3<f64>],
    /// Control periods flown in this episode, this one included.
    pub period: u32,
    /// Length of one \[s\].
    pub control_secs: f64,
}
