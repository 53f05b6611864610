//! Lines for the convolutional networks of policies that see.

use std::hint::black_box;
use std::time::Duration;

use kestrel_core::encoder::Volume;
use kestrel_sim::seed::{Purpose, Seed, Stream};

use super::{Figure, best_rate};
use kestrel_learn::network::eye::{Eye, EyeWorkspace};

/// Samples of a tile: more do not make products faster, fewer add up the weights' gradient more often.
const COLUMNS: usize = 64;

/// An eye that is measured, and where we want its passes to be [samples per second of one core\].
struct Measured {
    what: &'static str,
    eye: Eye,
    forward_aim: f64,
    both_aim: f64,
}

/// Lines for eyes on random images of 64×48 pixels with three channels: features alone, and with their gradient.
///
/// # Panics
/// When a preset does not suit such images, which is a bug.
pub(crate) fn eyes(duration: Duration) -> Vec<Figure> {
    let image = Volume { rows: 48, columns: 64, channels: 3 };
    let nature = Eye::nature(image, 512).expect("its filters are smaller than the image");
    let small = Eye::small(image).expect("its filters are smaller than the image");
    let measured = [
        Measured { what: "NatureCNN", eye: nature, forward_aim: 30e3, both_aim: 10e3 },
        Measured { what: "small eye", eye: small, forward_aim: 80e3, both_aim: 30e3 },
    ];
    measured.iter().flat_map(|measured| measured.figures(duration)).collect()
}

impl Measured {
    fn figures(&self, duration: Duration) -> [Figure; 2] {
        let [forward, both] = self.rates(duration);
        let products = self.eye.multiply_accumulates();
        let gigaflops = |products: usize, rate: f64| 2e-9 * products as f64 * rate;
        let forward_gigaflops = gigaflops(products, forward);
        let both_gigaflops = gigaflops(products + self.eye.backward_multiply_accumulates(), both);
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
        let weights = self.eye.arrange(&self.eye.initialise(&mut stream));
        let images: Vec<u8> =
            (0..COLUMNS * self.eye.image_len()).map(|_| stream.between(0.0, 255.9) as u8).collect();
        let mut workspace = EyeWorkspace::new(&self.eye, COLUMNS);
        let mut features = vec![0.0; self.eye.features() * COLUMNS];
        let deltas: Vec<f32> = features.iter().map(|_| stream.normal()).collect();
        let mut gradient = vec![0.0; self.eye.parameter_count()];
        let forward = best_rate(duration, || {
            self.eye.forward(&weights, black_box(&images), &mut workspace, &mut features);
            black_box(&features);
            COLUMNS as u64
        });
        let both = best_rate(duration, || {
            self.eye.forward(&weights, black_box(&images), &mut workspace, &mut features);
            self.eye.backward(&weights, &images, &mut workspace, &deltas, &mut gradient);
            black_box(&gradient);
            COLUMNS as u64
        });
        [forward, both]
    }
}
