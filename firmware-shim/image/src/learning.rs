//! The same bits of learning everywhere: anchors that take in task after task and pull parameters, and an output layer that
//! learns against one.

use kestrel_core::anchor::Anchor;
use kestrel_core::anchor::fixed::{FixedAnchor, Fraction, ProximalShares};
use kestrel_core::fixed::{FixedScratch, OutputLearner};
use kestrel_core::policy_file::PolicyError;

use crate::digest::Digest;
use crate::input::Inputs;
use crate::machine::{Verdict, hexadecimal, print};
use crate::policy::NETWORK;

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

/// Of the output layer of 16-64-64-4.
pub const OUTPUT_PARAMETERS: usize = 4 * (64 + 1);

/// Prints the digests of anchors after a hundred tasks, and of an output layer after as many.
pub fn run() -> Verdict {
    line("anchor in fixed, 3 bytes for each of 5,508 parameters", fixed());
    line("anchor in float32, 8 bytes for each of 4,096 parameters", float());
    match output_layer() {
        Ok(digest) => line("output layer in fixed, 5 bytes for each of 260 parameters with its anchor", digest),
        Err(_) => return Verdict::Failed,
    }
    Verdict::Passed
}

fn line(what: &str, digest: Digest) {
    let digits = hexadecimal(digest.value());
    let digits = core::str::from_utf8(&digits).unwrap_or_default();
    print(&[what, ": 100 tasks ", digits, "\n"]);
}

/// What each task teaches is random, and so is what it shows.
fn output_layer() -> Result<Digest, PolicyError> {
    let network = NETWORK.network()?;
    let mut memory = [0; OUTPUT_PARAMETERS];
    let (mut center, mut importance) = ([0; OUTPUT_PARAMETERS], [0; OUTPUT_PARAMETERS]);
    let mut curvature = [0_u8; OUTPUT_PARAMETERS];
    let mut digest = Digest::new();
    let Some(mut learner) = OutputLearner::new(&network, &mut memory) else { return Ok(digest) };
    let mut inputs = Inputs::new(5);
    let mut scratch = FixedScratch::new();
    let shares = ProximalShares::at(Fraction::nearest(RATE));
    for task in 0..TASKS {
        let mut anchor = FixedAnchor { center: &mut center, importance: &mut importance };
        for step in 0..STEPS {
            let (mut observation, mut target) = ([0.0; 16], [0.0; 4]);
            inputs.fill_usual(&mut observation);
            inputs.fill(&mut target);
            let features = network.features(&observation, &mut scratch);
            digest.add(&learner.learn(features, &target, Fraction::nearest(0.5)));
            if let Ok(parameters) = learner.parameters_mut().try_into() {
                let parameters: &mut [i16; OUTPUT_PARAMETERS] = parameters;
                anchor.proximal_step(parameters, &shares, task * STEPS + step);
            }
        }
        for curvature in &mut curvature {
            *curvature = inputs.bits() as u8;
        }
        if let Ok(parameters) = learner.parameters().try_into() {
            let parameters: &[i16; OUTPUT_PARAMETERS] = parameters;
            anchor.consolidate(parameters, &curvature, Fraction::nearest(DECAY), task);
        }
    }
    for parameter in learner.parameters() {
        digest.add_bytes(&parameter.to_le_bytes());
    }
    Ok(digest)
}

/// Parameters wander and are pulled back; the curvature of every task is another.
fn fixed() -> Digest {
    let (mut center, mut importance) = ([0; PARAMETERS], [0; PARAMETERS]);
    let (mut parameters, mut curvature) = ([0_i16; PARAMETERS], [0_u8; PARAMETERS]);
    let mut inputs = Inputs::new(3);
    let mut digest = Digest::new();
    let shares = ProximalShares::at(Fraction::nearest(RATE));
    for task in 0..TASKS {
        let mut anchor = FixedAnchor { center: &mut center, importance: &mut importance };
        for step in 0..STEPS {
            for parameter in &mut parameters {
                *parameter = parameter.saturating_add((inputs.bits() % 512) as i16 - 256);
            }
            anchor.proximal_step(&mut parameters, &shares, task * STEPS + step);
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
            anchor.proximal_step(&mut parameters, RATE);
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
