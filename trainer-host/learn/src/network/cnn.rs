//! Convolutional networks over slices of images: what a policy that sees has in front of its multilayer perceptron.
//!
//! A sample is an image of bytes, `[rows][columns][channels]`, of which a network sees each byte / 255. Convolutions
//! without padding and one dense layer follow, each with a rectifier behind it. The values between the layers lie
//! `[rows][columns][channels]` too, so that what a pixel sees of a row of the layer before it lies side by side.

mod convolution;
mod layer;
mod pass;
mod pixels;
mod transposition;
mod weights;
mod workspace;

use kestrel_core::encoder::{Convolution, EncoderError, EncoderShape, EncoderStage, Volume};
use kestrel_core::seed::Stream;
use serde::{Deserialize, Serialize};

use super::{HIDDEN_GAIN, orthogonal};
use layer::{Grid, Layer};
pub use weights::CnnWeights;
pub use workspace::CnnWorkspace;

/// Of the dense layer's weights: features of order one for what an aviary looks like.
const DENSE_GAIN: f32 = 0.5;

/// What a byte of a grey image is to a CNN.
const GREY: f32 = 0.5;

/// A convolutional network from an image to features. Its shape, and the order of its parameters, are those of the
/// core, so that whatever is trained can fly on a microcontroller.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Saved", into = "Saved")]
pub struct Cnn {
    shape: EncoderShape,
    /// The convolutions, then the dense layer.
    layers: Vec<Layer>,
}

/// What is written of a CNN.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    image: Volume,
    convolutions: Vec<Convolution>,
    features: u16,
}

impl Cnn {
    /// Of a shape.
    pub fn new(shape: EncoderShape) -> Self {
        let Volume { rows, columns, channels } = shape.image();
        let [rows, columns, channels] = [rows, columns, channels].map(usize::from);
        let mut grid = Grid { rows, columns, channels, stored: channels };
        let layer = |stage: &EncoderStage| {
            let kernel = (usize::from(stage.kernel_rows), usize::from(stage.kernel_columns));
            let layer = Layer::new(grid, kernel, usize::from(stage.stride), stage.filters());
            grid = layer.output;
            layer
        };
        Self { layers: shape.stages().iter().map(layer).collect(), shape }
    }

    /// The network of Mnih et al. 2015, `NatureCNN` of Stable-Baselines3, where it has 512 features, and 256 beside other
    /// inputs.
    ///
    /// # Errors
    /// When the image is empty, too large or smaller than 36 x 36 pixels.
    pub fn nature(image: Volume, features: u16) -> Result<Self, EncoderError> {
        let convolutions = [convolution(32, 8, 4), convolution(64, 4, 2), convolution(64, 3, 1)];
        EncoderShape::new(image, &convolutions, features).map(Self::new)
    }

    /// The convolutions of Mnih et al. 2013, which two cores can train, and 64 features for the layers behind them; an
    /// image of less than 40 rows or columns is looked at with a first filter of half the size, which then sees as
    /// much of the view.
    ///
    /// # Errors
    /// When the image is empty, too large or smaller than 10 x 10 pixels.
    pub fn small(image: Volume) -> Result<Self, EncoderError> {
        let first = if image.rows.min(image.columns) < 40 { convolution(16, 4, 2) } else { convolution(16, 8, 4) };
        EncoderShape::new(image, &[first, convolution(32, 4, 2)], 64).map(Self::new)
    }

    /// The image, the convolutions and the number of features.
    pub fn shape(&self) -> &EncoderShape {
        &self.shape
    }

    /// Bytes of an image.
    pub fn image_len(&self) -> usize {
        self.shape.image().len()
    }

    /// Number of features.
    pub fn features(&self) -> usize {
        self.shape.features()
    }

    /// Number of weights and biases.
    pub fn parameter_count(&self) -> usize {
        self.shape.parameter_count()
    }

    /// Multiply-accumulate operations of one forward pass of one sample.
    pub fn multiply_accumulates(&self) -> usize {
        self.shape.multiply_accumulates()
    }

    /// Multiply-accumulate operations of one backward pass of one sample: weights and inputs of each layer, but no
    /// pixels.
    pub fn backward_multiply_accumulates(&self) -> usize {
        2 * self.multiply_accumulates() - self.shape.stages()[0].multiply_accumulates()
    }

    /// Orthogonal weights (Saxe et al. 2014) of gain root two, less in the dense layer, filter by filter; biases of zero,
    /// but in the first layer those with which a grey image leaves nothing.
    ///
    /// Bytes are all positive, and images of aviaries mostly bright: without both, features begin at ten and more, and
    /// saturate the layer behind them before it has learned anything.
    pub fn initialise(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = Vec::with_capacity(self.parameter_count());
        let last = self.shape.stages().len() - 1;
        for (index, stage) in self.shape.stages().iter().enumerate() {
            let gain = if index == last { DENSE_GAIN } else { HIDDEN_GAIN };
            let weights = orthogonal(stage.filters(), stage.terms(), gain, stream);
            let grey = if index == 0 { GREY } else { 0.0 };
            let biases = weights.chunks_exact(stage.terms()).map(|filter| -grey * filter.iter().sum::<f32>());
            parameters.extend(&weights);
            parameters.extend(biases);
        }
        parameters
    }

    /// The parameters, arranged for the products of all slices until they change.
    ///
    /// # Panics
    /// When they are not as many as the CNN's.
    pub fn arrange(&self, parameters: &[f32]) -> CnnWeights {
        CnnWeights::new(self, parameters)
    }

    fn layers(&self) -> &[Layer] {
        &self.layers
    }
}

fn convolution(filters: u16, kernel: u16, stride: u16) -> Convolution {
    Convolution { filters, kernel, stride }
}

impl TryFrom<Saved> for Cnn {
    type Error = EncoderError;

    fn try_from(Saved { image, convolutions, features }: Saved) -> Result<Self, EncoderError> {
        EncoderShape::new(image, &convolutions, features).map(Self::new)
    }
}

impl From<Cnn> for Saved {
    fn from(Cnn { shape, .. }: Cnn) -> Self {
        let features = shape.stages().last().map_or(0, |dense| dense.output.channels);
        Self { image: shape.image(), convolutions: shape.convolutions().collect(), features }
    }
}

#[cfg(test)]
mod tests;
