//! How the errors of predictions change with the weights of a residual network: through the windows of a flight, many at
//! once, and back again (Werbos 1990, Backpropagation through time).

use kestrel_core::activation::tanh;
use kestrel_core::attitude::Attitude;
use kestrel_learn::network::Workspace;
use nalgebra::Vector3;

use crate::course::{Course, Part};
use crate::drone::{Drone, Trim};
use crate::horizon::STEP_SECS;
use crate::motion::Driven;
use crate::residual_network::{BoundedMlp, FARTHEST, INPUTS, Lanes, inputs};

/// Length of the windows \[s\].
const WINDOW_SECS: f64 = 0.5;

/// Time between the starts of two windows \[s\].
const STRIDE_SECS: f64 = 0.05;

/// Time over which measured and modelled accelerations are compared \[s\]: differences of rates and velocities a hundredth
/// of a second apart are noise for the most part.
const MISSING_SECS: f64 = 0.1;

/// Errors beyond so many typical ones count as that: a marker that jumped does not rule.
const GREATEST_ERROR: f64 = 4.0;

/// Which accelerations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Half {
    /// Linear, which velocity shows.
    Linear,
    /// Angular, which body rates show.
    Angular,
}

impl Half {
    /// Where among the network's inputs its own signal stands, in body axes.
    fn input(self) -> usize {
        match self {
            Self::Linear => 0,
            Self::Angular => 3,
        }
    }
}

/// The windows of a flight that are learned from.
pub(crate) struct LearnedFlight<'a> {
    half: Half,
    course: &'a Course<'a>,
    driven: Driven<'a>,
    /// First row of each window.
    pub(crate) starts: Vec<usize>,
    /// Rows of a window, and those between two times at which the network is asked.
    rows: usize,
    stride: usize,
}

impl<'a> LearnedFlight<'a> {
    /// Without windows where the flight does not show these accelerations.
    pub(crate) fn new(half: Half, course: &'a Course<'a>, drone: &Drone, trim: &Trim) -> Self {
        let shown = match half {
            Half::Linear => course.translation(Part::Fitted),
            Half::Angular => course.rotation(Part::Fitted),
        };
        let windows = course.windows(Part::Fitted, WINDOW_SECS, STRIDE_SECS);
        let starts = if shown.starts.is_empty() { Vec::new() } else { windows.starts };
        let stride = course.flight.rows_in(STEP_SECS);
        Self { half, course, driven: Driven::new(course, drone, trim), starts, rows: windows.rows, stride }
    }

    /// What a network is told at the start of each window, and what is missing after it \[m/s² or rad/s², body\].
    pub(crate) fn missing(&self) -> impl Iterator<Item = ([f64; INPUTS], Vector3<f64>)> {
        let rows = self.course.flight.rows_in(MISSING_SECS);
        self.starts.iter().map(move |start| {
            let shown = (*start..start + rows).map(|row| match self.half {
                Half::Linear => self.driven.missing_linear(row),
                Half::Angular => self.driven.missing_angular(row),
            });
            (inputs(&self.driven.instant(*start)), shown.sum::<Vector3<f64>>() / rows as f64)
        })
    }

    /// Sum of the squared errors without a network, and how many.
    pub(crate) fn squares(&self) -> (Vector3<f64>, f64) {
        let errors = self.errors(&mut Lanes::new(None, self.starts.len()), &self.starts);
        let squares = errors.iter().flatten().map(|error| error.component_mul(error)).sum();
        (squares, errors.iter().map(Vec::len).sum::<usize>() as f64)
    }

    /// Predicted less measured, each time after the network was asked, `[lanes][times]` \[m/s, world, or rad/s, body\].
    fn errors(&self, lanes: &mut Lanes<'_>, starts: &[usize]) -> Vec<Vec<Vector3<f64>>> {
        let (flight, rows, stride) = (self.course.flight, self.rows, self.stride);
        let rates = &flight.body_rates;
        let velocities = flight.motion.as_ref().map_or(&[][..], |motion| &motion.velocities);
        let row = |start: &usize, time: usize| start + (time + 1) * stride;
        let mut errors: Vec<Vec<Vector3<f64>>> = match self.half {
            Half::Linear => {
                let moved = self.driven.moved_with(lanes, starts, rows, stride);
                moved.into_iter().map(|lane| lane.into_iter().map(|moved| moved.velocity).collect()).collect()
            }
            Half::Angular => self.driven.turned_with(lanes, starts, rows, stride),
        };
        for (start, errors) in starts.iter().zip(&mut errors) {
            for (time, error) in errors.iter_mut().enumerate() {
                *error -= match self.half {
                    Half::Linear => velocities[row(start, time)],
                    Half::Angular => rates[row(start, time)],
                };
            }
        }
        errors
    }

    /// Adds the gradient of half the sum of squared errors, in units of `sizes`, of these windows.
    pub(crate) fn add_gradient(
        &self,
        network: &BoundedMlp,
        starts: &[usize],
        sizes: &Vector3<f64>,
        learning: &mut Learning,
    ) {
        let count = starts.len();
        let mut lanes = Lanes::keeping(network, count);
        let errors = self.errors(&mut lanes, starts);
        let secs = self.stride as f64 * self.course.flight.period_secs;
        let (input, damping) = (self.half.input(), self.damping());
        let mut adjoints = vec![Vector3::<f64>::zeros(); count];
        let Learning { workspace, input_deltas, gradient } = learning;
        for (time, told) in lanes.kept().iter().enumerate().rev() {
            network.mlp.forward(&network.parameters, told, workspace);
            let (outputs, deltas) = workspace.output_delta();
            for (lane, adjoint) in adjoints.iter_mut().enumerate() {
                let error = errors[lane][time].component_div(sizes);
                *adjoint += error.map(|error| error.clamp(-GREATEST_ERROR, GREATEST_ERROR)).component_div(sizes);
                let push =
                    self.body(starts[lane], time).rotate_inverse(*adjoint).component_mul(&network.bounds) * secs;
                for axis in 0..3 {
                    let share = tanh(outputs[axis * count + lane]);
                    deltas[axis * count + lane] = push[axis] as f32 * (1.0 - share * share);
                }
            }
            network.mlp.backward_to_inputs(&network.parameters, told, workspace, gradient, input_deltas);
            for (lane, adjoint) in adjoints.iter_mut().enumerate() {
                let of_input = |axis: usize| {
                    let place = axis * count + lane;
                    // Beyond, an input counts as that far away however far it is.
                    let counts = f64::from(told[place].abs()) < FARTHEST;
                    if counts { network.scales[axis] * f64::from(input_deltas[place]) } else { 0.0 }
                };
                let through = Vector3::from_fn(|axis, _| of_input(input + axis));
                *adjoint += self.body(starts[lane], time).rotate(through) - adjoint.component_mul(&damping) * secs;
            }
        }
    }

    /// From body axes to those of the errors, when the network was asked.
    fn body(&self, start: usize, time: usize) -> Attitude<f64> {
        match self.half {
            Half::Linear => self.driven.instant(start + time * self.stride).world_from_body,
            Half::Angular => Attitude::level(),
        }
    }

    /// What the airframe takes away of an error by itself \[1/s\]: of rates a good deal, of velocities hardly anything.
    fn damping(&self) -> Vector3<f64> {
        match self.half {
            Half::Linear => Vector3::zeros(),
            Half::Angular => self.driven.rate_damping(),
        }
    }
}

/// Where a gradient is added up.
pub(crate) struct Learning {
    workspace: Workspace,
    /// `[INPUTS][lanes]`.
    input_deltas: Vec<f32>,
    /// `[parameters]`.
    pub(crate) gradient: Vec<f32>,
}

impl Learning {
    /// For so many windows at once.
    pub(crate) fn new(lanes: usize) -> Self {
        let shape = BoundedMlp::shape();
        Self {
            workspace: Workspace::new(&shape, lanes),
            input_deltas: vec![0.0; INPUTS * lanes],
            gradient: vec![0.0; shape.parameter_count()],
        }
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::{Airframe, CF2X, DragCoefficients, FlightEffects};
    use kestrel_core::seed::{Purpose, Seed, Stream};

    use super::*;
    use crate::drone::drone_of;
    use crate::flight::{CommandRecord, Flight, Motion};

    const ROWS: usize = 150;

    fn flight() -> Flight {
        let wave = |row: usize, phase: f64| (0.02 * row as f64 + phase).sin();
        let waves = |phase: f64| -> Vec<Vector3<f64>> {
            (0..ROWS).map(|row| Vector3::new(0.0, 1.0, 2.0).map(|part| wave(row, phase + part))).collect()
        };
        let turned = |rates: &Vector3<f64>| Attitude::level().advanced(&Attitude::level().derivative(*rates), 1.0);
        Flight {
            name: "waves".to_owned(),
            start_secs: 0.0,
            period_secs: 0.01,
            measured: vec![true; ROWS],
            commands: (0..ROWS).map(|row| [0.6 + 0.05 * wave(row, 0.0); 4]).collect(),
            command_record: CommandRecord::Complete,
            rotor_speeds: None,
            body_rates: waves(0.3),
            specific_forces: None,
            motion: Some(Motion {
                positions: vec![Vector3::z(); ROWS],
                attitudes: waves(0.5).iter().map(|rates| turned(rates).normalized()).collect(),
                velocities: waves(0.7),
            }),
            battery_volts: None,
            set_points: None,
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_errors() {
        let flight = flight();
        let course = Course::new(&flight, vec![false; ROWS]);
        // Without what the gradient leaves out: drag, and rates that turn each other.
        let airframe = Airframe {
            inertia: [2e-5; 3],
            drag_coefficients: DragCoefficients { planar: 0.0, axial: 0.0 },
            effects: FlightEffects::NONE,
            ..CF2X
        };
        let sizes = Vector3::new(8.0, 9.0, 10.0);
        for half in [Half::Linear, Half::Angular] {
            let learned = LearnedFlight::new(half, &course, &drone_of(&airframe), &Trim::default());
            let seen: Vec<[f64; INPUTS]> = learned.missing().map(|(seen, _)| seen).collect();
            let weights = BoundedMlp::shape().initialise(1.0, &mut Stream::new(Seed(0), 0, Purpose::Weights));
            let network = BoundedMlp::new(&seen, Vector3::new(1.0, 2.0, 3.0), weights);
            let starts = [learned.starts[0], learned.starts[3], learned.starts[7]];
            let mut learning = Learning::new(starts.len());
            learned.add_gradient(&network, &starts, &sizes, &mut learning);
            let cost = |index: usize, change: f32| {
                let mut network = network.clone();
                network.parameters[index] += change;
                let errors = learned.errors(&mut Lanes::new(Some(&network), starts.len()), &starts);
                let squares = errors.iter().flatten().map(|error| error.component_div(&sizes).norm_squared());
                0.5 * squares.sum::<f64>()
            };
            let greatest = learning.gradient.iter().fold(0.0, |most: f32, part| most.max(part.abs()));
            for index in (0..network.parameters.len()).step_by(7) {
                let expected = (cost(index, 0.01) - cost(index, -0.01)) / 0.02;
                let difference = f64::from(learning.gradient[index]) - expected;
                assert!(
                    difference.abs() < 0.02 * f64::from(greatest),
                    "{half:?} {index}: {difference} {expected}"
                );
            }
        }
    }
}
