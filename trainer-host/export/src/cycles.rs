//! How long a Cortex-M4 would compute: a model, not a measurement.

use core::fmt;
use core::ops::Add;

use kestrel_core::encoder::{EncoderShape, EncoderStage};
use kestrel_core::policy_file::Arithmetic;
use serde::{Deserialize, Serialize};

/// Core clock of the Crazyflie's STM32F405 \[MHz\].
const CLOCK_MHZ: f64 = 168.0;

/// Cycles of a Cortex-M4F without wait states of its flash; the two ends are loads of one and of two cycles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cycles {
    /// At least.
    pub least: f64,
    /// At most.
    pub most: f64,
}

/// What an operation costs, from the instructions of the release build for thumbv7em-none-eabihf (`--emit asm`,
/// `-C target-cpu=cortex-m4`) and the table of the processor's manual.
struct Costs {
    /// Per product of a sum.
    product: Cycles,
    /// Per value copied into a patch.
    gathered: Cycles,
    /// Per sum, requantised and limited.
    output: Cycles,
}

/// Float: 4 instructions per product, which took 5.2 to 5.7 cycles by QEMU's counts of the same loop in a network.
const FLOAT: Costs = Costs {
    product: Cycles { least: 5.2, most: 5.7 },
    gathered: Cycles { least: 4.0, most: 7.0 },
    output: Cycles { least: 6.0, most: 10.0 },
};

/// Eye: 78 instructions for 32 products, of which 39 are loads (`ldrsb`, `smlabb`, `smlabt`).
const FIXED_EYE: Costs = Costs {
    product: Cycles { least: 2.5, most: 3.75 },
    gathered: Cycles { least: 4.0, most: 7.0 },
    output: Cycles { least: 12.0, most: 20.0 },
};

/// Network of 16-bit weights, tangents included: 12.9 to 16.1 thousand cycles for 5,376 products by QEMU's counts.
const FIXED_PRODUCT: Cycles = Cycles { least: 2.4, most: 3.0 };

impl Cycles {
    /// Of one image.
    pub fn of_eye(shape: &EncoderShape, arithmetic: Arithmetic) -> Self {
        let costs = match arithmetic {
            Arithmetic::Float32 => FLOAT,
            Arithmetic::Fixed16 => FIXED_EYE,
        };
        let dense_stage = shape.stages().len() - 1;
        let stage = |(index, stage): (usize, &EncoderStage)| {
            let places = stage.output.len() / stage.filters();
            let gathered = if index < dense_stage { places * stage.terms() } else { 0 };
            let products = costs.product.times(stage.multiply_accumulates());
            products + costs.gathered.times(gathered) + costs.output.times(stage.output.len())
        };
        shape.stages().iter().enumerate().map(stage).fold(Self { least: 0.0, most: 0.0 }, Self::add)
    }

    /// Of one action of a network, tangents included.
    pub fn of_network(multiply_accumulates: usize, arithmetic: Arithmetic) -> Self {
        match arithmetic {
            Arithmetic::Float32 => FLOAT.product.times(multiply_accumulates),
            Arithmetic::Fixed16 => FIXED_PRODUCT.times(multiply_accumulates),
        }
    }

    fn times(self, count: usize) -> Self {
        Self { least: self.least * count as f64, most: self.most * count as f64 }
    }
}

impl Add for Cycles {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { least: self.least + other.least, most: self.most + other.most }
    }
}

impl fmt::Display for Cycles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { least, most } = self;
        let millis = |cycles: f64| cycles / (1e3 * CLOCK_MHZ);
        write!(
            f,
            "estimated {:.1} to {:.1} thousand cycles of a Cortex-M4F, {:.2} to {:.2} ms at {CLOCK_MHZ} MHz",
            least / 1e3,
            most / 1e3,
            millis(*least),
            millis(*most)
        )
    }
}
