//! A policy for PX4's neural control module `mc_nn_control`: the network as a `TFLite` model in the module's source files, and
//! the parameters with which PX4 reads its outputs as we do.
//!
//! The module shows the network 15 values, clamps its four outputs to \[-1, 1\], and reads each, plus one, as the thrust of
//! a rotor in units of its own: `output + 1 = coefficient · (rotor speed [1/s])²`. From the rotor speed it makes a share of
//! the motor's range, and from that a command whose curve PX4's output stage takes back (`THR_MDL_FAC`). The model
//! written here holds the policy's network, then what turns its actions into such outputs, limits included: the range
//! of the action space never leaves that of the motors, whatever the module does with the rest.

mod flat_buffer;
mod model;
mod parameters;

use kestrel_core::action::{ActionSpace, RotorThrusts};
use kestrel_core::airframe::RADIANS_PER_SECOND_PER_RPM;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::policy_file::{Activation, Arithmetic, PolicyError, PolicyFile};
use thiserror::Error;

use crate::policy::Policy;
use crate::source::{comment, rows};
use model::{Dense, Follow, Model};
use parameters::MotorParameters;

/// What lies beside the model.
const README: &str = include_str!("px4/README.txt");

/// Why a policy cannot fly in PX4's neural control.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Px4Error {
    /// The bytes are no policy, or its golden vectors fail.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// It is trained for something else.
    #[error("found a policy {found}, expected one {expected}: `configs/px4-neural.yaml` trains such a policy")]
    Other {
        /// What it does.
        found: String,
        /// What PX4's module does.
        expected: &'static str,
    },
    /// PX4's parameters have no room for such rotors.
    #[error("found rotors of {found:.0} RPM, expected at most the {expected:.0} of PX4's `MC_NN_MAX_RPM`")]
    FastRotors {
        /// Greatest speed of the airframe's rotors.
        found: f64,
        /// Greatest that PX4's parameters can say.
        expected: f64,
    },
    /// The lowest action would stop a motor.
    #[error(
        "found a lowest rotor speed of {found:.1} RPM, expected more than the {expected} of an idling motor: PX4 disarms a motor below it"
    )]
    Stopping {
        /// Rotor speed of an action of -1.
        found: f64,
        /// `MC_NN_MIN_RPM`.
        expected: i32,
    },
}

/// The files of the folder: names and contents. `rotors` are those of the airframe that PX4's motors 1 to 4 turn; `bytes` are
/// a policy file in float and start on a four-byte boundary of memory.
///
/// # Errors
/// [`Px4Error`].
pub fn px4_files(bytes: &[u8], rotors: [usize; 4]) -> Result<Vec<(&'static str, Vec<u8>)>, Px4Error> {
    let policy = Policy::parse(bytes)?;
    policy.self_test()?;
    let (policy, space) = suited(&policy)?;
    let motors = MotorParameters::new(space)?;
    let model = model(policy, space, &motors, rotors).bytes();
    let name = comment(policy.metadata().name);
    Ok(vec![
        ("control_net.hpp", header(&name, model.len()).into_bytes()),
        ("control_net.cpp", source(&name, &model).into_bytes()),
        ("kestrel.params", motors.file(&name, policy.metadata().control_period_secs).into_bytes()),
        ("README.txt", README.replace("NAME", &name).into_bytes()),
        ("control_net.tflite", model),
    ])
}

/// The policy, if PX4's module can show it what it sees and do what it commands.
fn suited<'p, 'a>(policy: &'p Policy<'a>) -> Result<(&'p PolicyFile<'a>, &'p RotorThrusts), Px4Error> {
    let other = |found: String, expected| Err(Px4Error::Other { found, expected });
    let policy = match policy {
        Policy::Blind(policy) => policy,
        Policy::Seeing(_) => return other("with a camera".to_owned(), "without"),
        Policy::Recurrent(_) => return other("with a memory".to_owned(), "without"),
    };
    if policy.arithmetic() == Arithmetic::Fixed16 {
        return other("in fixed16".to_owned(), "in float32");
    }
    let metadata = policy.metadata();
    let ObservationLayout::Px4Neural(_) = metadata.observation else {
        return other(format!("that sees `{}`", metadata.observation.name()), "that sees `px4_neural`");
    };
    let ActionSpace::RotorThrusts(space) = &metadata.action else {
        return other(format!("that commands `{}`", metadata.action.name()), "that commands `rotor_thrusts`");
    };
    match policy.activation() {
        Activation::Relu => Ok((policy, space)),
        Activation::Tanh => other("with tangents".to_owned(), "with `training.activation: relu`"),
    }
}

/// The policy's network, whose outputs are PX4's, in the order of its motors.
fn model(policy: &PolicyFile<'_>, space: &RotorThrusts, motors: &MotorParameters, rotors: [usize; 4]) -> Model {
    let shapes: Vec<(usize, usize)> = policy.shapes().collect();
    let (_, hidden) = shapes.split_last().expect("a network has a layer");
    let layer = |(index, (inputs, _)): (usize, &(usize, usize)), rows: &[usize]| Dense {
        inputs: *inputs,
        weights: rows
            .iter()
            .flat_map(|row| (0..*inputs).map(|column| policy.weight(index, *row, column)))
            .collect(),
        biases: rows.iter().map(|row| policy.bias(index, *row)).collect(),
        follow: Follow::Rectifier,
    };
    let mut layers: Vec<Dense> =
        hidden.iter().enumerate().map(|shape| layer(shape, &(0..shape.1.1).collect::<Vec<usize>>())).collect();
    let mut output = layer((hidden.len(), &shapes[hidden.len()]), &rotors);
    let [lowest, highest] =
        [space.lowest_rotor_speed, space.rotor_speed_limit].map(|speed| motors.output_of(speed));
    // Actions of -1 and 1 become the lowest and the highest output, of which the lowest is taken away before the rectifier.
    let per_action = 0.5 * (highest - lowest);
    for weight in &mut output.weights {
        *weight = (f64::from(*weight) * per_action) as f32;
    }
    for bias in &mut output.biases {
        *bias = ((f64::from(*bias) + 1.0) * per_action) as f32;
    }
    layers.push(output);
    layers.push(Dense::negation(rotors.len(), (highest - lowest) as f32, Follow::Rectifier));
    layers.push(Dense::negation(rotors.len(), highest as f32, Follow::Nothing));
    Model { name: policy.metadata().name.to_owned(), layers }
}

fn header(name: &str, len: usize) -> String {
    format!(
        "/* The policy \"{name}\", written by `kestrel export --target px4`. */
#pragma once

#include <cstdint>

constexpr unsigned int control_net_tflite_size = {len};
extern const unsigned char control_net_tflite[];
"
    )
}

fn source(name: &str, model: &[u8]) -> String {
    let bytes = rows(model.iter().map(|byte| format!("0x{byte:02x}")), 16);
    format!(
        "/* The policy \"{name}\", written by `kestrel export --target px4`. */
#include \"control_net.hpp\"

alignas(16) const unsigned char control_net_tflite[] = {{{bytes}
}};
"
    )
}

/// Revolutions per minute of a rotor speed \[rad/s\].
fn rpm(rotor_speed: f32) -> f64 {
    f64::from(rotor_speed) / RADIANS_PER_SECOND_PER_RPM
}

#[cfg(test)]
mod tests;
