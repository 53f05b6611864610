//! Lines for the convolutional networks of policies that see.

use std::hint::black_box;
use std::time::Duration;

use kestrel_core::encoder::Volume;
use kestrel_sim::seed::{Purpose, Seed, Stream};

use super::{Figure, best_rate};
use kestrel_learn::network::cnn::{Cnn, CnnWorkspace};

/// Samples of a tile: more do not make products faster, fewer add up the weights' gradient more often.
const COLUMNS: usize = 64;

/// A CNN that is measured, and where we want its passes to be [samples per second of one core\].
struct Measured {
    what: &'static str,
    cnn: Cnn,
    forward_aim: f64,
    both_aim: f64,
}

/// Lines for CNNs on random images of 64×48 pixels with three channels: features alone, and with their gradient.
///
/// # Panics
/// When a preset does not suit such images, which is a bug.
pub(crate) fn eyes(duration: Duration) -> Vec<Figure> {
    let image = Volume { rows: 48, columns: 64, channels: 3 };
    let nature = Cnn::nature(image, 512).expect("its filters are smaller than the image");
    let small = Cnn::small(image).expect("its filters are smaller than the image");
    let measured = [
        Measured { what: "NatureCNN", cnn: nature, forward_aim: 30e3, both_aim: 10e3 },
        Measured { what: "small eye", cnn: small, forward_aim: 80e3, both_aim: 30e3 },
    ];
    measured.iter().flat_map(|measured| measured.figures(duration)).collect()
}

impl Measured {
    fn figures(&self, duration: Duration) -> [Figure; 2] {
        let [forward, both] = self.rates(duration);
        let products = self.cnn.multiply_accumulates();
        let gigaflops = |products: usize, rate: f64| 2e-9 * products as f64 * rate;
        let forward_gigaflops = gigaflops(products, forward);
        let both_gigaflops = gigaflops(products + self.cnn.backward_multiply_accumulates(), both);
        [
            Figure {
                what: format!("{} forward, {forward_gigaflops:.0} GFLOP/s, 1 core", self.what),
                per_second: forward,
                aim: self.forward_aim,
                limit: "loads of one factor per product from the first-level cache",
            },
            Figure {
                what: format!("{} with gradient, {both_gigaflops:.0} GFLOP/s, 1 core", self.what),
                per_second: both,
                aim: self.both_aim,
                limit: "as above, and partial sums that come and go",
            },
        ]
    }

    /// Samples per second forward, and forward and backward.
    fn rates(&self, duration: Duration) -> [f64; 2] {
        let mut stream = Stream::new(Seed(0), 0, Purpose::Weights);
        let weights = self.cnn.arrange(&self.cnn.initialise(&mut stream));
        let images: Vec<u8> =
            (0..COLUMNS * self.cnn.image_len()).map(|_| stream.between(0.0, 255.9) as u8).collect();
        let mut workspace = CnnWorkspace::new(&self.cnn, COLUMNS);
        let mut features = vec![0.0; self.cnn.features() * COLUMNS];
        let deltas: Vec<f32> = features.iter().map(|_| stream.normal()).collect();
        let mut gradient = vec![0.0; self.cnn.parameter_count()];
        let forward = best_rate(duration, || {
            self.cnn.forward(&weights, black_box(&images), &mut workspace, &mut features);
            black_box(&features);
            COLUMNS as u64
        });
        let both = best_rate(duration, || {
            self.cnn.forward(&weights, black_box(&images), &mut workspace, &mut features);
            self.cnn.backward(&weights, &images, &mut workspace, &deltas, &mut gradient);
            black_box(&gradient);
            COLUMNS as u64
        });
        [forward, both]
    }
}
