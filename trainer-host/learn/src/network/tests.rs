use super::*;
use kestrel_core::seed::{Purpose, Seed};
use proptest::prelude::*;

const COLUMNS: usize = 40;

fn stream(index: u32) -> Stream {
    Stream::new(Seed(42), index, Purpose::Weights)
}

fn normals(count: usize, index: u32) -> Vec<f32> {
    let mut stream = stream(index);
    (0..count).map(|_| stream.normal()).collect()
}

/// The same network in `f64`, sample by sample, written without any of the kernels.
fn reference(mlp: &Mlp, parameters: &[f64], input: &[f64]) -> Vec<f64> {
    let (mut values, mut rest) = (input.to_vec(), parameters);
    for (index, pair) in mlp.widths().windows(2).enumerate() {
        let (weights, left) = rest.split_at(pair[0] * pair[1]);
        let (biases, left) = left.split_at(pair[1]);
        let sums = weights.chunks_exact(pair[0]).zip(biases).map(|(row, bias)| inner(row, &values) + bias);
        let is_hidden = index + 2 < mlp.widths().len();
        let activated = |sum: f64| match mlp.activation {
            Activation::Tanh => libm::tanh(sum),
            Activation::Relu => sum.max(0.0),
        };
        values = sums.map(|sum| if is_hidden { activated(sum) } else { sum }).collect();
        rest = left;
    }
    values
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().copied().map(f64::from).collect()
}

fn column(inputs: &[f32], index: usize) -> Vec<f64> {
    inputs.chunks_exact(COLUMNS).map(|row| f64::from(row[index])).collect()
}

/// A loss with a different weight on every output of every sample, so that no gradient hides behind another.
fn loss(mlp: &Mlp, parameters: &[f64], inputs: &[f32], weights: &[f32]) -> f64 {
    let sample = |index: usize| {
        let outputs = reference(mlp, parameters, &column(inputs, index));
        let weighted =
            outputs.iter().enumerate().map(|(row, output)| f64::from(weights[row * COLUMNS + index]) * output);
        weighted.sum::<f64>()
    };
    (0..COLUMNS).map(sample).sum()
}

/// Central differences of the reference against backpropagation, for every parameter of every layer.
fn check_gradient(mlp: &Mlp) {
    let (inputs, outputs) = (mlp.inputs(), mlp.outputs());
    let mut parameters = mlp.initialise(1.0, &mut stream(1));
    for (parameter, shift) in parameters.iter_mut().zip(normals(mlp.parameter_count(), 2)) {
        *parameter += 0.1 * shift;
    }
    let (slice, weights) = (normals(inputs * COLUMNS, 3), normals(outputs * COLUMNS, 4));
    let mut workspace = Workspace::new(mlp, COLUMNS);
    mlp.forward(&parameters, &slice, &mut workspace);
    workspace.output_delta().1.copy_from_slice(&weights);
    let mut gradient = vec![0.0; mlp.parameter_count()];
    mlp.backward(&parameters, &slice, &mut workspace, &mut gradient);
    let mut shifted = wide(&parameters);
    for (index, found) in gradient.iter().enumerate() {
        let mut at = |shift: f64| {
            shifted[index] = f64::from(parameters[index]) + shift;
            loss(mlp, &shifted, &slice, &weights)
        };
        let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
        at(0.0);
        assert!(
            (f64::from(*found) - expected).abs() < 2e-4 + 2e-5 * expected.abs(),
            "{index}: {found}, not {expected}"
        );
    }
}

#[test]
fn forward_is_the_reference_in_f64() {
    let mlp = Mlp::new(22, &[64, 64], 4);
    let parameters = mlp.initialise(1.0, &mut stream(0));
    let slice = normals(22 * COLUMNS, 1);
    let mut workspace = Workspace::new(&mlp, COLUMNS);
    let outputs = mlp.forward(&parameters, &slice, &mut workspace).to_vec();
    for index in 0..COLUMNS {
        let expected = reference(&mlp, &wide(&parameters), &column(&slice, index));
        for (row, expected) in expected.iter().enumerate() {
            assert!((f64::from(outputs[row * COLUMNS + index]) - expected).abs() < 1e-5);
        }
    }
}

#[test]
fn the_gradient_of_narrow_and_wide_layers_is_that_of_finite_differences() {
    check_gradient(&Mlp::new(5, &[12, 9], 4));
    check_gradient(&Mlp::new(3, &[3], 1));
    check_gradient(&Mlp::new(7, &[], 4));
    check_gradient(&Mlp::new(6, &[8, 5, 11], 10));
    check_gradient(&Mlp::new(6, &[8, 5, 11], 4).with_activation(Activation::Relu));
}

/// A checkpoint of a network with tangents has the bytes that it had when there was nothing else.
#[test]
fn a_shape_is_saved_as_its_widths() {
    let mlp = Mlp::new(22, &[64, 64], 4);
    for (mlp, bytes) in
        [(mlp.clone(), &[4, 22, 64, 64, 4][..]), (mlp.with_activation(Activation::Relu), &[5, 0, 22, 64, 64, 4])]
    {
        let saved = postcard::to_allocvec(&mlp).unwrap();
        assert_eq!(saved, bytes);
        assert_eq!(postcard::from_bytes::<Mlp>(&saved).unwrap(), mlp);
    }
}

#[test]
fn gradients_of_tiles_add_up() {
    let mlp = Mlp::new(4, &[8], 1);
    let parameters = mlp.initialise(1.0, &mut stream(5));
    let slice = normals(4 * COLUMNS, 6);
    let mut workspace = Workspace::new(&mlp, COLUMNS);
    let mut gradients = vec![vec![0.0; mlp.parameter_count()]; 2];
    for (gradient, times) in gradients.iter_mut().zip([1, 2]) {
        for _ in 0..times {
            mlp.forward(&parameters, &slice, &mut workspace);
            workspace.output_delta().1.fill(0.5);
            mlp.backward(&parameters, &slice, &mut workspace, gradient);
        }
    }
    for (once, twice) in gradients[0].iter().zip(&gradients[1]) {
        assert!((2.0 * once - twice).abs() <= 1e-5 * once.abs().max(1.0));
    }
}

#[test]
fn initial_weights_are_orthogonal_and_biases_zero() {
    for (inputs, outputs) in [(22, 64), (64, 64), (64, 4), (64, 1)] {
        let mlp = Mlp::new(inputs, &[], outputs);
        let parameters = mlp.initialise(0.5, &mut stream(7));
        let layer = mlp.layers(&parameters)[0];
        assert!(layer.biases.iter().all(|bias| *bias == 0.0));
        let (count, length) = (inputs.min(outputs), inputs.max(outputs));
        let entry = |vector: usize, index: usize| {
            let (row, column) = if outputs <= inputs { (vector, index) } else { (index, vector) };
            f64::from(layer.weights[row * inputs + column])
        };
        for (a, b) in (0..count).flat_map(|a| (0..=a).map(move |b| (a, b))) {
            let product: f64 = (0..length).map(|index| entry(a, index) * entry(b, index)).sum();
            let expected = if a == b { 0.25 } else { 0.0 };
            assert!((product - expected).abs() < 1e-6, "{a} {b}: {product}");
        }
    }
}

#[test]
fn hidden_layers_have_gain_root_two() {
    let mlp = Mlp::new(8, &[8], 4);
    let parameters = mlp.initialise(0.01, &mut stream(8));
    let layers = mlp.layers(&parameters);
    let square = |row: &[f32]| row.iter().map(|weight| weight * weight).sum::<f32>();
    assert!((square(&layers[0].weights[..8]) - 2.0).abs() < 1e-5);
    assert!((square(&layers[1].weights[..8]) - 1e-4).abs() < 1e-8);
}

#[test]
fn the_shape_counts_parameters_and_products() {
    let mlp = Mlp::new(22, &[64, 64], 4);
    assert_eq!(mlp.parameter_count(), 22 * 64 + 64 + 64 * 64 + 64 + 64 * 4 + 4);
    assert_eq!(mlp.multiply_accumulates(), 5760);
}

proptest! {
    #[test]
    fn a_column_does_not_depend_on_its_neighbours(index in 0..COLUMNS, other in -2.0_f32..2.0) {
        let mlp = Mlp::new(6, &[16, 16], 4);
        let parameters = mlp.initialise(1.0, &mut stream(9));
        let slice = normals(6 * COLUMNS, 10);
        let changed: Vec<f32> =
            slice.iter().enumerate().map(|(i, value)| if i % COLUMNS == index { *value } else { other }).collect();
        let mut workspace = Workspace::new(&mlp, COLUMNS);
        let before = mlp.forward(&parameters, &slice, &mut workspace).to_vec();
        let after = mlp.forward(&parameters, &changed, &mut workspace);
        for row in 0..4 {
            prop_assert_eq!(before[row * COLUMNS + index], after[row * COLUMNS + index]);
        }
    }
}
