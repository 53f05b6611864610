use super::*;
use crate::network::cnn::{Cnn, CnnWorkspace};
use kestrel_core::encoder::{Convolution, EncoderShape, Volume};
use kestrel_core::seed::{Purpose, Seed};

const COLUMNS: usize = 12;
/// Of the observation, of the CNN, of the trunk.
const WIDTHS: (usize, usize, usize) = (5, 6, 7);

fn stream(index: u32) -> Stream {
    Stream::new(Seed(21), index, Purpose::Weights)
}

fn normals(count: usize, index: u32) -> Vec<f32> {
    let mut stream = stream(index);
    (0..count).map(|_| stream.normal()).collect()
}

/// An actor and a critic behind a trunk behind a CNN, with all that they are shown.
struct Seeing {
    cnn: Cnn,
    trunk: SharedTrunk,
    heads: [Mlp; 2],
    images: Vec<u8>,
    observations: Vec<f32>,
    /// Of the loss, for each output of each head.
    weights: [Vec<f32>; 2],
}

impl Seeing {
    fn new() -> Self {
        let image = Volume { rows: 7, columns: 8, channels: 2 };
        let convolution = Convolution { filters: 3, kernel: 3, stride: 2 };
        let cnn = Cnn::new(EncoderShape::new(image, &[convolution], WIDTHS.1 as u16).unwrap());
        let mut bytes = stream(1);
        Self {
            images: (0..COLUMNS * cnn.image_len()).map(|_| bytes.between(0.0, 255.9) as u8).collect(),
            cnn,
            trunk: SharedTrunk::new(WIDTHS.0 + WIDTHS.1, &[9, WIDTHS.2]),
            heads: [Mlp::new(WIDTHS.2, &[8], 4), Mlp::new(WIDTHS.2, &[], 1)],
            observations: normals(WIDTHS.0 * COLUMNS, 2),
            weights: [normals(4 * COLUMNS, 3), normals(COLUMNS, 4)],
        }
    }

    /// The CNN's, the trunk's, the heads'.
    fn parameters(&self) -> [Vec<f32>; 4] {
        let [actor, critic] = [0, 1].map(|head| self.heads[head].initialise(1.0, &mut stream(5 + head as u32)));
        [self.cnn.initialise(&mut stream(7)), self.trunk.initialise(&mut stream(8)), actor, critic]
    }

    /// The loss and its gradient.
    fn evaluate(&self, parameters: &[Vec<f32>; 4]) -> (f64, [Vec<f32>; 4]) {
        let [cnn, trunk, heads @ ..] = parameters;
        let mut gradient = parameters.clone().map(|parameters| vec![0.0; parameters.len()]);
        let weights = self.cnn.arrange(cnn);
        let mut cnn_workspace = CnnWorkspace::new(&self.cnn, COLUMNS);
        let mut inputs = self.observations.clone();
        inputs.resize((WIDTHS.0 + WIDTHS.1) * COLUMNS, 0.0);
        let features = &mut inputs[WIDTHS.0 * COLUMNS..];
        self.cnn.forward(&weights, &self.images, &mut cnn_workspace, features);
        let mut trunk_workspace = SharedTrunkWorkspace::new(&self.trunk, COLUMNS);
        let shared = self.trunk.forward(trunk, &inputs, &mut trunk_workspace).to_vec();
        let mut workspaces = [0, 1].map(|head| Workspace::new(&self.heads[head], COLUMNS));
        let mut loss = 0.0;
        for (head, workspace) in workspaces.iter_mut().enumerate() {
            let outputs = self.heads[head].forward(&heads[head], &shared, workspace);
            let terms = outputs.iter().zip(&self.weights[head]);
            loss += terms.map(|(output, weight)| f64::from(*output) * f64::from(*weight)).sum::<f64>();
        }
        let [cnn_gradient, trunk_gradient, head_gradients @ ..] = &mut gradient;
        let mut shared_deltas = vec![0.0; shared.len()];
        for (head, workspace) in workspaces.iter_mut().enumerate() {
            workspace.output_delta().1.copy_from_slice(&self.weights[head]);
            let mut deltas = vec![0.0; shared.len()];
            let gradient = &mut head_gradients[head];
            self.heads[head].backward_to_inputs(&heads[head], &shared, workspace, gradient, &mut deltas);
            shared_deltas.iter_mut().zip(deltas).for_each(|(sum, delta)| *sum += delta);
        }
        let mut feature_deltas = vec![0.0; WIDTHS.1 * COLUMNS];
        let deltas = (&mut trunk_workspace, &shared_deltas[..]);
        self.trunk.backward(trunk, &inputs, deltas, trunk_gradient, &mut feature_deltas);
        self.cnn.backward(&weights, &self.images, &mut cnn_workspace, &feature_deltas, cnn_gradient);
        (loss, gradient)
    }
}

/// Central differences in `f32`, whose sums are rounded: to a hundredth.
#[test]
fn gradients_of_eye_trunk_and_heads_are_those_of_finite_differences() {
    let seeing = Seeing::new();
    let mut parameters = seeing.parameters();
    let (_, gradient) = seeing.evaluate(&parameters);
    let mut wrong = Vec::new();
    for (part, index) in (0..4).flat_map(|part| (0..gradient[part].len()).map(move |index| (part, index))) {
        let center = parameters[part][index];
        let mut at = |shift: f32| {
            parameters[part][index] = center + shift;
            let loss = seeing.evaluate(&parameters).0;
            parameters[part][index] = center;
            loss
        };
        let expected = (at(2e-3) - at(-2e-3)) / 4e-3;
        let found = f64::from(gradient[part][index]);
        if (found - expected).abs() > 3e-3 + 1e-2 * expected.abs() {
            wrong.push((part, index, found, expected));
        }
    }
    // A rectifier may bend between the two.
    assert!(wrong.len() <= gradient[0].len() / 50 && wrong.iter().all(|wrong| wrong.0 == 0), "{wrong:?}");
}

#[test]
fn without_input_deltas_the_gradient_has_the_same_bits() {
    let trunk = SharedTrunk::new(6, &[8, 20]);
    let (parameters, inputs) = (trunk.initialise(&mut stream(1)), normals(6 * COLUMNS, 2));
    let output_deltas = normals(20 * COLUMNS, 3);
    let mut workspace = SharedTrunkWorkspace::new(&trunk, COLUMNS);
    trunk.forward(&parameters, &inputs, &mut workspace);
    let mut gradients = [0, 1].map(|_| vec![0.0; parameters.len()]);
    let mut input_deltas = vec![0.0; 3 * COLUMNS];
    let [with, without] = &mut gradients;
    trunk.backward(&parameters, &inputs, (&mut workspace, &output_deltas), with, &mut input_deltas);
    trunk.backward(&parameters, &inputs, (&mut workspace, &output_deltas), without, &mut []);
    assert_eq!(with, without);
    assert!(input_deltas.iter().any(|delta| *delta != 0.0));
}

#[test]
fn a_trunk_is_a_network_with_tanh_behind_it() {
    let trunk = SharedTrunk::new(6, &[8, 20]);
    let (parameters, inputs) = (trunk.initialise(&mut stream(1)), normals(6 * COLUMNS, 2));
    let mut workspace = SharedTrunkWorkspace::new(&trunk, COLUMNS);
    let found = trunk.forward(&parameters, &inputs, &mut workspace);
    let mut sums = Workspace::new(trunk.mlp(), COLUMNS);
    for (found, sum) in found.iter().zip(trunk.mlp().forward(&parameters, &inputs, &mut sums)) {
        assert!((f64::from(*found) - f64::from(*sum).tanh()).abs() < 2e-6);
    }
}
