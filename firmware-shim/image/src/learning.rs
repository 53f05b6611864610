//! The same bits of learning everywhere: anchors that take in task after task and pull parameters.

use kestrel_core::anchor::Anchor;
use kestrel_core::anchor::fixed::{FixedAnchor, Fraction, Shares};

use crate::digest::Digest;
use crate::input::Inputs;
use crate::machine::{Verdict, hexadecimal, print};

/// Weights and biases of 16-64-64-4.
const PARAMETERS: usize = 16 * 64 + 64 + 64 * 64 + 64 + 64 * 4 + 4;

/// In float: four arrays of 16 KiB.
const FLOAT_PARAMETERS: usize = 4096;

const TASKS: u32 = 100;

/// Steps of each task; in float fewer, for machines without floating point.
const STEPS: u32 = 20;
const FLOAT_STEPS: u32 = 2;

/// What earlier tasks keep of their importance when another is taken in.
const DECAY: f32 = 0.98;

/// Of the pull.
const RATE: f32 = 0.05;

/// Prints the digests of anchors after a hundred tasks.
pub fn run() -> Verdict {
    line("fixed, 3 bytes for each of 5,508 parameters", fixed());
    line("float32, 8 bytes for each of 4,096 parameters", float());
    Verdict::Passed
}

fn line(what: &str, digest: Digest) {
    let digits = hexadecimal(digest.value());
    let digits = core::str::from_utf8(&digits).unwrap_or_default();
    print(&["anchor in ", what, ": 100 tasks ", digits, "\n"]);
}

/// Parameters wander and are pulled back; the curvature of every task is another.
fn fixed() -> Digest {
    let (mut center, mut importance) = ([0; PARAMETERS], [0; PARAMETERS]);
    let (mut parameters, mut curvature) = ([0_i16; PARAMETERS], [0_u8; PARAMETERS]);
    let mut inputs = Inputs::new(3);
    let mut digest = Digest::new();
    let shares = Shares::at(Fraction::nearest(RATE));
    for task in 0..TASKS {
        let mut anchor = FixedAnchor { center: &mut center, importance: &mut importance };
        for step in 0..STEPS {
            for parameter in &mut parameters {
                *parameter = parameter.saturating_add((inputs.bits() % 512) as i16 - 256);
            }
            anchor.pull(&mut parameters, &shares, task * STEPS + step);
        }
        for curvature in &mut curvature {
            *curvature = inputs.bits() as u8;
        }
        anchor.consolidate(&parameters, &curvature, Fraction::nearest(DECAY), task);
        for (center, importance) in center.iter().zip(&importance) {
            digest.add_bytes(&center.to_le_bytes());
            digest.add_bytes(&[*importance]);
        }
    }
    for parameter in &parameters {
        digest.add_bytes(&parameter.to_le_bytes());
    }
    digest
}

fn float() -> Digest {
    let (mut center, mut importance) = ([0.0; FLOAT_PARAMETERS], [0.0; FLOAT_PARAMETERS]);
    let (mut parameters, mut values) = ([0.0; FLOAT_PARAMETERS], [0.0; FLOAT_PARAMETERS]);
    let mut inputs = Inputs::new(4);
    let mut digest = Digest::new();
    for _ in 0..TASKS {
        let mut anchor = Anchor { center: &mut center, importance: &mut importance };
        for _ in 0..FLOAT_STEPS {
            inputs.fill_usual(&mut values);
            for (parameter, value) in parameters.iter_mut().zip(&values) {
                *parameter += 0.01 * value;
            }
            anchor.pull(&mut parameters, RATE);
        }
        inputs.fill_usual(&mut values);
        for value in &mut values {
            *value *= *value;
        }
        anchor.consolidate(&parameters, &values, DECAY);
        digest.add(&center);
        digest.add(&importance);
    }
    digest.add(&parameters);
    digest
}
