//! What an airframe lacks in acceleration, as two small networks say it: bounded, by what is known at that instant, in
//! lanes.

use std::fmt;

use kestrel_core::activation::tanh;
use kestrel_core::vehicle::State;
use kestrel_learn::network::{Mlp, Workspace};
use nalgebra::Vector3;

use crate::airframe_file::digits;

/// Air velocity \[m/s, body\], body rates \[rad/s\], rotor speeds \[rad/s\]. Air does not know where down is, so that the
/// direction of gravity is not among them.
pub(crate) const INPUTS: usize = 10;

/// Widths of the hidden layers.
pub(crate) const HIDDEN: [usize; 2] = [16, 16];

/// Deviations from its mean beyond which an input counts as that far away: no flight says what is beyond.
pub(crate) const FARTHEST: f64 = 4.0;

/// Deviation of an input below which it says nothing, in its unit: a signal that was not measured is constant.
const STILL: f64 = 1e-6;

/// What a network is told at an instant.
pub(crate) fn inputs(state: &State<f64>) -> [f64; INPUTS] {
    let air = state.world_from_body.rotate_inverse(state.velocity);
    let (rates, [a, b, c, d]) = (&state.body_rates, state.rotor_speeds);
    [air.x, air.y, air.z, rates.x, rates.y, rates.z, a, b, c, d]
}

/// Accelerations that an airframe lacks, learned from its flights; a half that none of them taught adds nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ResidualNetwork {
    pub(crate) linear: Option<BoundedMlp>,
    pub(crate) angular: Option<BoundedMlp>,
}

impl ResidualNetwork {
    /// Greatest linear acceleration along body x, y, z that it can add \[m/s²\]: zero where it learned nothing.
    pub fn linear_bounds(&self) -> Vector3<f64> {
        self.linear.as_ref().map_or_else(Vector3::zeros, |network| network.bounds)
    }

    /// Greatest angular acceleration about body x, y, z that it can add \[rad/s²\]: zero where it learned nothing.
    pub fn angular_bounds(&self) -> Vector3<f64> {
        self.angular.as_ref().map_or_else(Vector3::zeros, |network| network.bounds)
    }

    /// Linear \[m/s², body\] and angular \[rad/s², body\] acceleration that it adds to the airframe's in `state`, whatever
    /// that is within the bounds, and finite.
    pub fn accelerations(&self, state: &State<f64>) -> [Vector3<f64>; 2] {
        [&self.linear, &self.angular].map(|half| Lanes::new(half.as_ref(), 1).accelerations([*state])[0])
    }
}

impl fmt::Display for ResidualNetwork {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = HIDDEN;
        write!(formatter, "Residual network: {INPUTS} inputs, {first} and {second} tanh")?;
        let halves = [("linear", &self.linear, "m/s²"), ("angular", &self.angular, "rad/s²")];
        for (name, half, unit) in halves {
            match half {
                Some(BoundedMlp { bounds: limits, .. }) => {
                    let [x, y, z] = [limits.x, limits.y, limits.z].map(digits);
                    write!(formatter, "; {name} acceleration within ±{x}, ±{y}, ±{z} {unit}")?;
                }
                None => write!(formatter, "; {name} acceleration none")?,
            }
        }
        formatter.write_str(".")
    }
}

/// Three accelerations along or about body x, y, z: a perceptron whose outputs are bounded.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct BoundedMlp {
    pub(crate) mlp: Mlp,
    pub(crate) parameters: Vec<f32>,
    /// Of the inputs, in their units.
    means: [f64; INPUTS],
    /// Reciprocal deviations of the inputs; zero of those that say nothing.
    pub(crate) scales: [f64; INPUTS],
    /// Greatest output, either way.
    pub(crate) bounds: Vector3<f64>,
}

impl BoundedMlp {
    /// For instants like `seen`, with these weights and biases of [`Self::shape`].
    pub(crate) fn new(seen: &[[f64; INPUTS]], bounds: Vector3<f64>, parameters: Vec<f32>) -> Self {
        let count = seen.len().max(1) as f64;
        let mean = |index: usize| seen.iter().map(|inputs| inputs[index]).sum::<f64>() / count;
        let means: [f64; INPUTS] = std::array::from_fn(mean);
        let scale = |index: usize| {
            let squares = seen.iter().map(|inputs| (inputs[index] - means[index]).powi(2)).sum::<f64>();
            let deviation = (squares / count).sqrt();
            if deviation > STILL { 1.0 / deviation } else { 0.0 }
        };
        Self { mlp: Self::shape(), parameters, means, scales: std::array::from_fn(scale), bounds }
    }

    pub(crate) fn shape() -> Mlp {
        Mlp::new(INPUTS, &HIDDEN, 3)
    }

    /// Inputs as the perceptron reads them: mean zero, deviation one, none far away; what is no number is the mean.
    pub(crate) fn normalised(&self, inputs: &[f64; INPUTS]) -> [f32; INPUTS] {
        std::array::from_fn(|index| {
            let scaled = (inputs[index] - self.means[index]) * self.scales[index];
            if scaled.is_nan() { 0.0 } else { scaled.clamp(-FARTHEST, FARTHEST) as f32 }
        })
    }
}

/// A network beside many windows at once: a row of values each input, a column each window.
pub(crate) struct Lanes<'a> {
    network: Option<(&'a BoundedMlp, Workspace)>,
    /// `[INPUTS][lanes]`.
    inputs: Vec<f32>,
    /// `[lanes]`; zeros without a network.
    accelerations: Vec<Vector3<f64>>,
    /// Inputs of each time that the network was asked, if they are kept.
    kept: Option<Vec<Vec<f32>>>,
}

impl<'a> Lanes<'a> {
    pub(crate) fn new(network: Option<&'a BoundedMlp>, lanes: usize) -> Self {
        let network = network.map(|network| (network, Workspace::new(&network.mlp, lanes)));
        let values = if network.is_some() { INPUTS * lanes } else { 0 };
        Self { network, inputs: vec![0.0; values], accelerations: vec![Vector3::zeros(); lanes], kept: None }
    }

    /// The same, which keeps what the network is told.
    pub(crate) fn keeping(network: &'a BoundedMlp, lanes: usize) -> Self {
        Self { kept: Some(Vec::new()), ..Self::new(Some(network), lanes) }
    }

    /// Inputs of each time that the network was asked, `[times][INPUTS][lanes]`.
    pub(crate) fn kept(self) -> Vec<Vec<f32>> {
        self.kept.unwrap_or_default()
    }

    /// What the network adds in the states, if it is asked, and what it added when it was asked last if it is not.
    pub(crate) fn held(&mut self, asked: bool, states: impl IntoIterator<Item = State<f64>>) -> &[Vector3<f64>] {
        if asked { self.accelerations(states) } else { &self.accelerations }
    }

    /// What the network adds in the state of each lane, body.
    pub(crate) fn accelerations(&mut self, states: impl IntoIterator<Item = State<f64>>) -> &[Vector3<f64>] {
        let lanes = self.accelerations.len();
        let Some((network, workspace)) = self.network.as_mut().filter(|_| lanes > 0) else {
            return &self.accelerations;
        };
        for (lane, state) in states.into_iter().enumerate() {
            for (index, value) in network.normalised(&inputs(&state)).into_iter().enumerate() {
                self.inputs[index * lanes + lane] = value;
            }
        }
        if let Some(kept) = &mut self.kept {
            kept.push(self.inputs.clone());
        }
        let outputs = network.mlp.forward(&network.parameters, &self.inputs, workspace);
        for (lane, acceleration) in self.accelerations.iter_mut().enumerate() {
            let share = |axis: usize| f64::from(tanh(outputs[axis * lanes + lane]));
            *acceleration = network.bounds.component_mul(&Vector3::new(share(0), share(1), share(2)));
        }
        &self.accelerations
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::attitude::Attitude;
    use kestrel_core::seed::{Purpose, Seed, Stream};

    use super::*;

    const BOUNDS: Vector3<f64> = Vector3::new(2.0, 3.0, 4.0);

    fn state(stream: &mut Stream, size: f32) -> State<f64> {
        let mut vector = || Vector3::from_fn(|_, _| f64::from(size * stream.normal()));
        let [position, velocity, body_rates] = [vector(), vector(), vector()];
        let rotor_speeds = [velocity.x, velocity.y, body_rates.x, body_rates.y].map(|speed| 2000.0 + speed);
        State { position, world_from_body: Attitude::level(), velocity, body_rates, rotor_speeds }
    }

    fn network(stream: &mut Stream) -> BoundedMlp {
        let seen: Vec<[f64; INPUTS]> = (0..100).map(|_| inputs(&state(stream, 1.0))).collect();
        BoundedMlp::new(&seen, BOUNDS, BoundedMlp::shape().initialise(30.0, stream))
    }

    #[test]
    fn whatever_it_is_told_it_stays_within_its_bounds() {
        let mut stream = Stream::new(Seed(0), 0, Purpose::Weights);
        let network = ResidualNetwork { linear: None, angular: Some(network(&mut stream)) };
        let mut strange: Vec<State<f64>> =
            [0.1, 1.0, 1e3, 1e30].into_iter().map(|size| state(&mut stream, size)).collect();
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX] {
            strange.push(State { velocity: Vector3::repeat(value), ..strange[0] });
            strange.push(State { rotor_speeds: [value; 4], body_rates: Vector3::repeat(-value), ..strange[0] });
        }
        for state in strange {
            let [linear, angular] = network.accelerations(&state);
            assert_eq!(linear, Vector3::zeros());
            assert!((0..3).all(|axis| angular[axis].abs() <= BOUNDS[axis]), "{angular} in {state:?}");
        }
    }

    #[test]
    fn a_window_among_others_is_a_window_alone() {
        let mut stream = Stream::new(Seed(1), 0, Purpose::Weights);
        let network = network(&mut stream);
        let states: Vec<State<f64>> = (0..37).map(|_| state(&mut stream, 1.0)).collect();
        let mut lanes = Lanes::new(Some(&network), states.len());
        let together = lanes.accelerations(states.clone()).to_vec();
        for (state, together) in states.iter().zip(together) {
            let alone = Lanes::new(Some(&network), 1).accelerations([*state])[0];
            assert!((alone - together).norm() < 1e-5 && together.norm() > 0.0, "{alone} {together}");
        }
        assert!(Lanes::new(Some(&network), 0).accelerations([]).is_empty());
    }
}
