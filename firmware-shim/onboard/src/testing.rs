//! Policies for tests that need no training; for hosts, by the feature `testing`.

use kestrel_core::action::{ACTION_LEN, ActionSpace, ThrustBodyRates};
use kestrel_core::activation::Activation;
use kestrel_core::airframe::{CF2X, GRAVITY};
use kestrel_core::crc32::crc32;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::{MeasuredLayout, ObservationLayout, PILOT_LEN, PilotLayout, PilotMeasuredLayout};
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{ParameterFormat, PolicyDraft, PolicyFile, PolicyMetadata};

/// Rate and tilt limits of the hover policy \[rad/s\].
const BODY_RATES_LIMIT: f32 = 6.0;

/// Control period of the policies \[s\].
const CONTROL_SECS: f32 = 0.01;

/// A policy file that flies, every 10 ms.
pub fn hover_policy() -> Vec<u8> {
    hover_policy_every(CONTROL_SECS)
}

/// A policy file that flies: position and velocity errors to a tilt, tilt errors to body rates, all linear, in control
/// periods of `control_secs`.
///
/// Gains by pole placement against the rotors' slowest time constant: every pole faster than 1.3 /s and damped
/// with at least 0.4.
pub fn hover_policy_every(control_secs: f32) -> Vec<u8> {
    let (tilt_gain, per_metre, per_speed) = (3.0, 1.0, 1.6);
    let (climb_per_metre, climb_per_speed, yaw_gain) = (2.2, 3.0, 1.0);
    let gravity = GRAVITY as f32;
    let rate = tilt_gain / BODY_RATES_LIMIT;
    let mut weights = [[0.0; PILOT_LEN]; ACTION_LEN];
    let [thrust, roll, pitch, yaw] = &mut weights;
    (thrust[2], thrust[14]) = (-climb_per_metre / gravity, -climb_per_speed / gravity);
    (roll[1], roll[13], roll[8]) = (rate * per_metre / gravity, rate * per_speed / gravity, rate);
    (pitch[0], pitch[12], pitch[5]) = (-rate * per_metre / gravity, -rate * per_speed / gravity, -rate);
    yaw[6] = -yaw_gain / BODY_RATES_LIMIT;
    let scales = PilotLayout { position_scale_m: 1.0, velocity_scale: 1.0, body_rates_scale: 1.0 };
    linear_policy(control_secs, ObservationLayout::Pilot(scales), weights.as_flattened())
}

/// A policy file whose observation shows no goal.
pub fn blind_policy() -> Vec<u8> {
    let layout = ObservationLayout::Measured(MeasuredLayout { len: PILOT_LEN as u8 });
    linear_policy(CONTROL_SECS, layout, &[0.0; PILOT_LEN * ACTION_LEN])
}

/// A policy file whose observation shows a goal, and a value of a sensor.
pub fn sensing_policy() -> Vec<u8> {
    let scales = PilotLayout { position_scale_m: 1.0, velocity_scale: 1.0, body_rates_scale: 1.0 };
    let layout = ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales, measured_len: 1 });
    linear_policy(CONTROL_SECS, layout, &[0.0; (PILOT_LEN + 1) * ACTION_LEN])
}

/// A policy file of one layer.
fn linear_policy(control_period_secs: f32, observation: ObservationLayout, weights: &[f32]) -> Vec<u8> {
    let action = ThrustBodyRates::new(&CF2X, 1.0, [BODY_RATES_LIMIT; 3], [6.0, 6.0, 3.0]);
    let draft = PolicyDraft {
        metadata: PolicyMetadata {
            name: "linear hover",
            observation,
            action: ActionSpace::ThrustBodyRates(action),
            control_period_secs,
            seed: 0,
            training_steps: 0,
            airframe: None,
        },
        parameters: ParameterFormat::Float32,
        layers: &[DenseLayer {
            inputs: observation.len(),
            outputs: ACTION_LEN,
            weights,
            bias: &[0.0; ACTION_LEN],
            activation: Activation::Tanh,
        }],
        golden_observations: &vec![GOLDEN_VALUE; observation.len()],
    };
    let mut bytes = vec![0; draft.file_len().expect("a layer is a policy")];
    draft.write(&mut bytes).expect("the file is as long as it says");
    bytes
}

/// What the one golden observation consists of.
const GOLDEN_VALUE: f32 = 0.123;

/// A policy file whose golden action is not what its network computes, with a right checksum.
///
/// # Panics
/// If a policy file does not hold its golden observation.
pub fn dishonest_policy() -> Vec<u8> {
    let mut bytes = hover_policy();
    let golden = [GOLDEN_VALUE; PILOT_LEN].map(f32::to_le_bytes);
    let observation = golden.as_flattened();
    let start = bytes.windows(observation.len()).position(|window| window == observation);
    let start = start.expect("the golden observation is in the file");
    let action = start + observation.len();
    bytes[action..action + 4].copy_from_slice(&0.5_f32.to_le_bytes());
    let end = bytes.len() - 4;
    let checksum = crc32(&bytes[..end]);
    bytes[end..].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

/// A pilot that lives as long as the test run.
///
/// # Panics
/// If these bytes are no policy.
pub fn pilot(policy: Vec<u8>) -> Pilot<'static> {
    Pilot::new(PolicyFile::parse(policy.leak()).expect("tests write whole policies"))
}
