use super::*;
use kestrel_core::seed::{Purpose, Seed};

fn stream(index: u32) -> Stream {
    Stream::new(Seed(11), index, Purpose::Weights)
}

fn normals(count: usize, index: u32) -> Vec<f32> {
    let mut stream = stream(index);
    (0..count).map(|_| stream.normal()).collect()
}

fn images(cnn: &Cnn, columns: usize) -> Vec<u8> {
    let mut stream = stream(100);
    (0..columns * cnn.image_len()).map(|_| stream.between(0.0, 255.9) as u8).collect()
}

fn volume([rows, columns, channels]: [u16; 3]) -> Volume {
    Volume { rows, columns, channels }
}

fn cnn(image: [u16; 3], convolutions: &[(u16, u16, u16)], features: u16) -> Cnn {
    let convolutions: Vec<Convolution> =
        convolutions.iter().map(|&(filters, kernel, stride)| convolution(filters, kernel, stride)).collect();
    Cnn::new(EncoderShape::new(volume(image), &convolutions, features).unwrap())
}

/// Weights as drawn, and biases that are not zero.
fn parameters(cnn: &Cnn) -> Vec<f32> {
    let mut parameters = cnn.initialise(&mut stream(1));
    for (parameter, shift) in parameters.iter_mut().zip(normals(cnn.parameter_count(), 2)) {
        *parameter += 0.05 * shift;
    }
    parameters
}

/// Odd sizes, filters that fill no vector, kernels as wide as what is before them, pixels that no filter sees.
fn shapes() -> Vec<Cnn> {
    vec![
        cnn([5, 4, 1], &[(3, 2, 1)], 2),
        cnn([9, 13, 2], &[(5, 5, 2)], 7),
        cnn([11, 10, 3], &[(16, 3, 2), (20, 2, 1)], 17),
        cnn([7, 7, 5], &[(4, 3, 1), (33, 3, 2), (6, 2, 1)], 5),
        cnn([12, 9, 1], &[(70, 4, 3), (16, 2, 1)], 65),
        Cnn::nature(volume([37, 45, 3]), 512).unwrap(),
        Cnn::small(volume([24, 32, 4])).unwrap(),
    ]
}

/// A number type for the direct convolution.
trait Number: Copy {
    fn of(value: f32) -> Self;
    fn plus_product(self, a: Self, b: Self) -> Self;
    fn relu(self) -> Self;
}

impl Number for f32 {
    fn of(value: f32) -> Self {
        value
    }

    fn plus_product(self, a: Self, b: Self) -> Self {
        a.mul_add(b, self)
    }

    fn relu(self) -> Self {
        self.max(0.0)
    }
}

impl Number for f64 {
    fn of(value: f32) -> Self {
        f64::from(value)
    }

    fn plus_product(self, a: Self, b: Self) -> Self {
        a * b + self
    }

    fn relu(self) -> Self {
        self.max(0.0)
    }
}

/// One layer of one sample as the definition has it: every sum begins with the bias and goes through the filter row
/// by row, column by column, channel by channel.
fn convolve<T: Number>(
    parameters: &[T],
    [rows, columns, channels]: [usize; 3],
    input: &[T],
    (filters, [kernel_rows, kernel_columns], stride): (usize, [usize; 2], usize),
) -> ([usize; 3], Vec<T>) {
    let size = kernel_rows * kernel_columns * channels;
    let (weights, biases) = parameters.split_at(filters * size);
    let shape = [(rows - kernel_rows) / stride + 1, (columns - kernel_columns) / stride + 1, filters];
    let mut output = Vec::new();
    for (row, column, filter) in (0..shape[0]).flat_map(|row| {
        (0..shape[1]).flat_map(move |column| (0..filters).map(move |filter| (row, column, filter)))
    }) {
        let mut sum = biases[filter];
        for (index, weight) in weights[filter * size..(filter + 1) * size].iter().enumerate() {
            let (at, channel) = (index / channels, index % channels);
            let (at_row, at_column) = (at / kernel_columns, at % kernel_columns);
            let place = ((row * stride + at_row) * columns + column * stride + at_column) * channels + channel;
            sum = sum.plus_product(input[place], *weight);
        }
        output.push(sum.relu());
    }
    (shape, output)
}

/// The features of one sample.
fn reference<T: Number>(cnn: &Cnn, parameters: &[T], image: &[u8]) -> Vec<T> {
    let Volume { rows, columns, channels } = cnn.shape().image();
    let mut shape = [rows, columns, channels].map(usize::from);
    let mut values: Vec<T> = image.iter().map(|byte| T::of(f32::from(*byte) / 255.0)).collect();
    let mut rest = parameters;
    let mut layer = |shape: &mut [usize; 3], filters, kernel: [usize; 2], stride| {
        let count = filters * (kernel[0] * kernel[1] * shape[2] + 1);
        (*shape, values) = convolve(&rest[..count], *shape, &values, (filters, kernel, stride));
        rest = &rest[count..];
    };
    for Convolution { filters, kernel, stride } in cnn.shape().convolutions() {
        layer(&mut shape, usize::from(filters), [usize::from(kernel); 2], usize::from(stride));
    }
    let kernel = [shape[0], shape[1]];
    layer(&mut shape, cnn.features(), kernel, 1);
    values
}

fn forward(cnn: &Cnn, parameters: &[f32], images: &[u8]) -> Vec<f32> {
    let columns = images.len() / cnn.image_len();
    let mut features = vec![f32::NAN; cnn.features() * columns];
    let mut workspace = CnnWorkspace::new(cnn, columns);
    cnn.forward(&cnn.arrange(parameters), images, &mut workspace, &mut features);
    features
}

fn backward(cnn: &Cnn, parameters: &[f32], images: &[u8], deltas: &[f32]) -> Vec<f32> {
    let columns = images.len() / cnn.image_len();
    let mut features = vec![0.0; cnn.features() * columns];
    let mut workspace = CnnWorkspace::new(cnn, columns);
    let weights = cnn.arrange(parameters);
    cnn.forward(&weights, images, &mut workspace, &mut features);
    let mut gradient = vec![0.0; cnn.parameter_count()];
    cnn.backward(&weights, images, &mut workspace, deltas, &mut gradient);
    gradient
}

#[test]
fn features_are_those_of_a_direct_convolution_to_the_bit() {
    for cnn in shapes() {
        let parameters = parameters(&cnn);
        let images = images(&cnn, 3);
        let features = forward(&cnn, &parameters, &images);
        for (sample, image) in images.chunks_exact(cnn.image_len()).enumerate() {
            for (feature, expected) in reference(&cnn, &parameters, image).iter().enumerate() {
                assert_eq!(features[feature * 3 + sample], *expected, "{:?} {feature}", cnn.shape());
            }
        }
    }
}

#[test]
fn features_do_not_depend_on_the_size_of_the_tile() {
    let cnn = Cnn::small(volume([24, 32, 3])).unwrap();
    let parameters = parameters(&cnn);
    let images = images(&cnn, 256);
    let whole = forward(&cnn, &parameters, &images);
    for columns in [1, 5, 16, 100] {
        for (slice, images) in images.chunks(columns * cnn.image_len()).enumerate() {
            let columns_here = images.len() / cnn.image_len();
            let part = forward(&cnn, &parameters, images);
            for (index, value) in part.iter().enumerate() {
                let (feature, column) = (index / columns_here, index % columns_here);
                assert_eq!(*value, whole[feature * 256 + slice * columns + column]);
            }
        }
    }
}

/// The loss, a different weight on every feature of every sample, in `f64`.
fn loss(cnn: &Cnn, parameters: &[f64], images: &[u8], deltas: &[f32]) -> f64 {
    let columns = images.len() / cnn.image_len();
    let of_sample = |(sample, image): (usize, &[u8])| {
        let features = reference(cnn, parameters, image);
        let weighted = features.iter().enumerate();
        weighted.map(|(row, feature)| f64::from(deltas[row * columns + sample]) * feature).sum::<f64>()
    };
    images.chunks_exact(cnn.image_len()).enumerate().map(of_sample).sum()
}

/// Central differences of the direct convolution in `f64` for some parameters of every layer; where a rectifier bends
/// within the step they may differ, so that few of them have to.
fn check_gradient(cnn: &Cnn, columns: usize, some: usize) {
    let parameters = parameters(cnn);
    let images = images(cnn, columns);
    let deltas = normals(cnn.features() * columns, 4);
    let gradient = backward(cnn, &parameters, &images, &deltas);
    let mut shifted: Vec<f64> = parameters.iter().copied().map(f64::from).collect();
    let mut wrong = Vec::new();
    let indices: Vec<usize> = (0..parameters.len()).step_by(parameters.len().div_ceil(some)).collect();
    let last = (parameters.len() - cnn.features()..parameters.len()).take(some);
    for index in indices.iter().copied().chain(last) {
        let mut at = |shift: f64| {
            shifted[index] = f64::from(parameters[index]) + shift;
            loss(cnn, &shifted, &images, &deltas)
        };
        let expected = (at(1e-6) - at(-1e-6)) / 2e-6;
        at(0.0);
        let found = f64::from(gradient[index]);
        if (found - expected).abs() > 2e-4 + 2e-5 * expected.abs() {
            wrong.push((index, found, expected));
        }
    }
    assert!(wrong.len() * 100 <= indices.len(), "{:?}: {wrong:?}", cnn.shape());
}

#[test]
fn gradients_are_those_of_finite_differences() {
    for cnn in shapes() {
        let is_large = cnn.multiply_accumulates() > 200_000;
        check_gradient(&cnn, if is_large { 2 } else { 11 }, if is_large { 20 } else { 100 });
    }
    check_gradient(&cnn([6, 8, 2], &[(16, 2, 1), (16, 3, 1)], 4), 19, 100);
}

#[test]
fn gradients_of_tiles_add_up() {
    let cnn = cnn([11, 10, 3], &[(16, 3, 2), (20, 2, 1)], 17);
    let (parameters, columns) = (parameters(&cnn), 40);
    let images = images(&cnn, columns);
    let deltas = normals(cnn.features() * columns, 5);
    let whole = backward(&cnn, &parameters, &images, &deltas);
    let weights = cnn.arrange(&parameters);
    let mut workspace = CnnWorkspace::new(&cnn, 20);
    let mut features = vec![0.0; cnn.features() * 20];
    let mut parts = vec![0.0; cnn.parameter_count()];
    for half in 0..2 {
        let images = &images[half * 20 * cnn.image_len()..(half + 1) * 20 * cnn.image_len()];
        let deltas: Vec<f32> =
            deltas.chunks_exact(columns).flat_map(|row| &row[half * 20..(half + 1) * 20]).copied().collect();
        cnn.forward(&weights, images, &mut workspace, &mut features);
        cnn.backward(&weights, images, &mut workspace, &deltas, &mut parts);
    }
    for (whole, parts) in whole.iter().zip(&parts) {
        assert!((whole - parts).abs() <= 1e-5 * whole.abs().max(10.0), "{whole} {parts}");
    }
}

#[test]
fn rearranged_weights_are_those_of_new_parameters() {
    let cnn = cnn([9, 13, 2], &[(5, 5, 2), (20, 2, 1)], 7);
    let (old, new) = (parameters(&cnn), normals(cnn.parameter_count(), 9));
    let images = images(&cnn, 4);
    let mut weights = cnn.arrange(&old);
    weights.arrange(&cnn, &new);
    let mut features = vec![0.0; cnn.features() * 4];
    cnn.forward(&weights, &images, &mut CnnWorkspace::new(&cnn, 4), &mut features);
    assert_eq!(features, forward(&cnn, &new, &images));
}

#[test]
fn initial_filters_are_orthogonal_with_gain_root_two() {
    let cnn = Cnn::small(volume([24, 32, 1])).unwrap();
    let parameters = cnn.initialise(&mut stream(3));
    assert_eq!(parameters.len(), cnn.parameter_count());
    let filters: Vec<&[f32]> = parameters[..16 * 16].chunks_exact(16).collect();
    for (a, b) in (0..16).flat_map(|a| (0..16).map(move |b| (a, b))) {
        let product: f32 = filters[a].iter().zip(filters[b]).map(|(a, b)| a * b).sum();
        assert!((product - if a == b { 2.0 } else { 0.0 }).abs() < 1e-5, "{a} {b}: {product}");
    }
    for (filter, bias) in filters.iter().zip(&parameters[16 * 16..]) {
        assert!((0.5 * filter.iter().sum::<f32>() + bias).abs() < 1e-6, "a grey image leaves nothing");
    }
    assert!(parameters[parameters.len() - 64..].iter().all(|bias| *bias == 0.0));
}

#[test]
fn features_begin_at_order_one_for_bright_and_for_colourful_images() {
    let cnn = Cnn::small(volume([24, 32, 3])).unwrap();
    let weights = cnn.arrange(&cnn.initialise(&mut stream(4)));
    let mut random = stream(5);
    let colourful: Vec<u8> = (0..cnn.image_len()).map(|_| random.between(0.0, 255.9) as u8).collect();
    for image in [vec![239; cnn.image_len()], colourful] {
        let mut features = vec![0.0; 64];
        cnn.forward(&weights, &image, &mut CnnWorkspace::new(&cnn, 1), &mut features);
        let largest = features.iter().copied().fold(0.0, f32::max);
        assert!(largest > 0.1 && largest < 4.0, "features up to {largest}");
    }
}

#[test]
fn presets_accept_the_smallest_images_that_they_document() {
    type Preset = fn(Volume) -> Result<Cnn, EncoderError>;
    let presets: [(Preset, u16); 2] = [(|image| Cnn::nature(image, 9), 36), (Cnn::small, 10)];
    for (preset, smallest) in presets {
        assert!(preset(volume([smallest, smallest, 1])).is_ok());
        assert!(matches!(preset(volume([smallest, smallest - 1, 1])), Err(EncoderError::Kernel { .. })));
    }
    assert_eq!(Cnn::small(volume([48, 64, 3])).unwrap().shape().stages()[0].kernel_rows, 8);
    assert_eq!(Cnn::small(volume([24, 32, 3])).unwrap().shape().stages()[0].kernel_rows, 4);
}

#[test]
fn the_shape_counts_parameters_and_products() {
    let cnn = Cnn::nature(volume([48, 64, 3]), 512).unwrap();
    let convolutions = 32 * (192 + 1) + 64 * (512 + 1) + 64 * (576 + 1);
    assert_eq!(cnn.parameter_count(), convolutions + 512 * (512 + 1));
    let first = 11 * 15 * 32 * 192;
    assert_eq!(cnn.multiply_accumulates(), first + 4 * 6 * 64 * 512 + 2 * 4 * 64 * 576 + 512 * 512);
    assert_eq!(cnn.backward_multiply_accumulates(), 2 * cnn.multiply_accumulates() - first);
}

#[test]
fn an_eye_is_read_as_it_was_written_and_checked_again() {
    let cnn = Cnn::small(volume([24, 32, 3])).unwrap();
    let text = serde_json::to_string(&cnn).unwrap();
    assert_eq!(serde_json::from_str::<Cnn>(&text).unwrap(), cnn);
    let blind = text.replace("\"rows\":24", "\"rows\":0");
    assert!(serde_json::from_str::<Cnn>(&blind).unwrap_err().to_string().contains("0 rows, 32 columns"));
}
