//! Convolutional networks over tiles of images: what a policy that sees has in front of its multilayer perceptron.
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

use kestrel_sim::seed::Stream;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{HIDDEN_GAIN, orthogonal};
use layer::{Grid, Layer};
pub use weights::EyeWeights;
pub use workspace::EyeWorkspace;

/// Most values of an image, of an activation and of a layer's weights: beyond, a shape is a slip of the pen.
const MOST_VALUES: usize = 1 << 26;

/// Square filters that move over an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Convolution {
    /// Number of filters, the channels behind them.
    pub filters: usize,
    /// Rows, and columns, of a filter \[pixels\].
    pub kernel: usize,
    /// Distance from one place of a filter to the next \[pixels\].
    pub stride: usize,
}

/// The shape of a convolutional network from an image to features.
///
/// Its parameters are one slice: for each convolution the weights `[filters][kernel row][kernel column][channel]`,
/// then the biases `[filters]`; last the dense layer's weights `[features][row][column][channel]` and biases
/// `[features]`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Shape", into = "Shape")]
pub struct Eye {
    shape: Shape,
    /// The convolutions, then the dense layer.
    layers: Vec<Layer>,
}

/// What is written of an eye.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Shape {
    rows: usize,
    columns: usize,
    channels: usize,
    convolutions: Vec<Convolution>,
    features: usize,
}

/// Why there is no such eye.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum EyeError {
    /// Nothing can be seen.
    #[error("expected an image of at least 1 x 1 x 1 values, found {rows} x {columns} x {channels}")]
    EmptyImage {
        /// Of the image.
        rows: usize,
        /// Of the image.
        columns: usize,
        /// Of the image.
        channels: usize,
    },
    /// Nothing moves over the image.
    #[error("expected at least one convolution, found none")]
    NoConvolution,
    /// A convolution without filters, extent or step.
    #[error("expected at least one filter, a kernel and a stride of at least 1, found {0:?}")]
    EmptyConvolution(Convolution),
    /// A filter finds no place.
    #[error("expected a kernel within the {rows} x {columns} pixels before it, found {kernel} x {kernel}")]
    KernelTooLarge {
        /// Of the filter.
        kernel: usize,
        /// Before the layer.
        rows: usize,
        /// Before the layer.
        columns: usize,
    },
    /// No features.
    #[error("expected at least one feature, found none")]
    NoFeatures,
    /// More than any memory should hold.
    #[error(
        "expected at most {MOST_VALUES} values in an image, an activation or the weights of a layer, found more"
    )]
    TooLarge,
}

impl Eye {
    /// For images of `[rows, columns, channels]`.
    ///
    /// # Errors
    /// When a part is empty or unreasonably large, or a kernel is larger than what is before it.
    pub fn new(
        [rows, columns, channels]: [usize; 3],
        convolutions: &[Convolution],
        features: usize,
    ) -> Result<Self, EyeError> {
        let shape = Shape { rows, columns, channels, convolutions: convolutions.to_vec(), features };
        let layers = shape.layers()?;
        Ok(Self { shape, layers })
    }

    /// The network of Mnih et al. 2015, `NatureCNN` of Stable-Baselines3: 512 features.
    ///
    /// # Errors
    /// When the image is empty or smaller than 36 x 36 pixels.
    pub fn nature(image: [usize; 3]) -> Result<Self, EyeError> {
        let [first, second, third] = [(32, 8, 4), (64, 4, 2), (64, 3, 1)]
            .map(|(filters, kernel, stride)| Convolution { filters, kernel, stride });
        Self::new(image, &[first, second, third], 512)
    }

    /// The convolutions of Mnih et al. 2013, which two cores can train, and 64 features for the layers behind them; an
    /// image of less than 40 rows or columns is looked at with a first filter of half the size, which then sees as
    /// much of the view.
    ///
    /// # Errors
    /// When the image is empty or smaller than 10 x 10 pixels.
    pub fn small(image: [usize; 3]) -> Result<Self, EyeError> {
        let first = if image[0].min(image[1]) < 40 { (16, 4, 2) } else { (16, 8, 4) };
        let convolutions =
            [first, (32, 4, 2)].map(|(filters, kernel, stride)| Convolution { filters, kernel, stride });
        Self::new(image, &convolutions, 64)
    }

    /// Rows, columns and channels of an image.
    pub fn image(&self) -> [usize; 3] {
        [self.shape.rows, self.shape.columns, self.shape.channels]
    }

    /// Bytes of an image.
    pub fn image_len(&self) -> usize {
        self.image().iter().product()
    }

    /// The convolutions, first to last.
    pub fn convolutions(&self) -> &[Convolution] {
        &self.shape.convolutions
    }

    /// Number of features.
    pub fn features(&self) -> usize {
        self.shape.features
    }

    /// Number of weights and biases.
    pub fn parameter_count(&self) -> usize {
        self.layers.iter().map(Layer::parameter_count).sum()
    }

    /// Multiply-accumulate operations of one forward pass of one sample.
    pub fn multiply_accumulates(&self) -> usize {
        self.layers.iter().map(Layer::multiply_accumulates).sum()
    }

    /// Multiply-accumulate operations of one backward pass of one sample: weights and inputs of each layer, but no
    /// pixels.
    pub fn backward_multiply_accumulates(&self) -> usize {
        2 * self.multiply_accumulates() - self.layers[0].multiply_accumulates()
    }

    /// Orthogonal weights (Saxe et al. 2014) of gain root two, filter by filter, and zero biases.
    pub fn initialise(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = Vec::with_capacity(self.parameter_count());
        for layer in &self.layers {
            let filters = layer.output.channels;
            parameters.extend(orthogonal(filters, layer.inputs(), HIDDEN_GAIN, stream));
            parameters.extend(std::iter::repeat_n(0.0, filters));
        }
        parameters
    }

    /// The parameters, arranged for the products of all tiles until they change.
    ///
    /// # Panics
    /// When they are not as many as the eye's.
    pub fn arrange(&self, parameters: &[f32]) -> EyeWeights {
        EyeWeights::new(self, parameters)
    }

    fn layers(&self) -> &[Layer] {
        &self.layers
    }
}

impl Shape {
    fn layers(&self) -> Result<Vec<Layer>, EyeError> {
        let Self { rows, columns, channels, ref convolutions, features } = *self;
        if rows == 0 || columns == 0 || channels == 0 {
            return Err(EyeError::EmptyImage { rows, columns, channels });
        }
        if convolutions.is_empty() {
            return Err(EyeError::NoConvolution);
        }
        if features == 0 {
            return Err(EyeError::NoFeatures);
        }
        bounded(&[rows, columns, channels])?;
        let mut grid = Grid { rows, columns, channels, stored: channels };
        let mut layers = Vec::with_capacity(convolutions.len() + 1);
        for convolution in convolutions {
            let layer = convolution.layer(grid)?;
            layers.push(layer);
            grid = layer.output;
        }
        bounded(&[grid.len(), features])?;
        layers.push(Layer::new(grid, (grid.rows, grid.columns), 1, features));
        Ok(layers)
    }
}

impl Convolution {
    fn layer(self, before: Grid) -> Result<Layer, EyeError> {
        let Self { filters, kernel, stride } = self;
        let Grid { rows, columns, stored, .. } = before;
        if filters == 0 || kernel == 0 || stride == 0 {
            return Err(EyeError::EmptyConvolution(self));
        }
        if kernel > rows.min(columns) {
            return Err(EyeError::KernelTooLarge { kernel, rows, columns });
        }
        bounded(&[kernel, kernel, stored, filters])?;
        bounded(&[rows, columns, filters])?;
        Ok(Layer::new(before, (kernel, kernel), stride, filters))
    }
}

fn bounded(extents: &[usize]) -> Result<(), EyeError> {
    let product = extents.iter().try_fold(1_usize, |product, extent| product.checked_mul(*extent));
    if product.is_some_and(|product| product <= MOST_VALUES) { Ok(()) } else { Err(EyeError::TooLarge) }
}

impl TryFrom<Shape> for Eye {
    type Error = EyeError;

    fn try_from(shape: Shape) -> Result<Self, EyeError> {
        let layers = shape.layers()?;
        Ok(Self { shape, layers })
    }
}

impl From<Eye> for Shape {
    fn from(eye: Eye) -> Self {
        eye.shape
    }
}

#[cfg(test)]
mod tests;
